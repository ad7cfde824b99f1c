"""Recording errors that coordinates and speeds reveal: what is safe to undo is undone, the rest reported."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import EPS, NEGLIGIBLE, ROUGHLY, SIX_DIGITS, Array, max_norm
from deltac.diagnosis.measurements.digits import digits_of
from deltac.diagnosis.measurements.kinematics import (
    LEAST_RATIO,
    SHORTEST_PART,
    ColumnComparison,
    Mask,
    coordinates_against_speeds,
    size_of,
    unsteadiness,
)
from deltac.diagnosis.verdict import Finding, percent
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory
from deltac.trajectories.columns import MechanismNames, RateNames
from deltac.trajectories.motion import CLEAR_RATIO
from deltac.trajectories.rates import GAP, with_speeds

COPIES = 0.34
"""Share of the rows up to which copies are left out and the rest is judged."""

LATE = 0.8
"""Rows by which a column must be late to be called so: schemes leave a half at most."""

RESOLVED = 5e-3
"""Share of the movement that quadrature may miss in a log that is fine enough to be doubted."""

LEAST_GEAR = 10.0 * LEAST_RATIO
"""Relative difference below which one coordinate alone has no gear: clocks drift by less."""


@dataclass(frozen=True, eq=False)
class Cleaned:
    """A run whose evident slips were undone, and what was found."""

    run: Trajectory
    findings: tuple[Finding, ...]


def cleaned(mechanism: Mechanism, run: Trajectory) -> Cleaned:
    """Test q against u, and undo what is safe to undo: copied and interpolated rows, turns of 2π, spikes.

    Of runs whose speeds were derived from the coordinates, angles are unwrapped alone; no row is taken out of
    runs with integrals or events.
    """
    if len(run) < SHORTEST_PART:
        return Cleaned(run, ())
    findings: list[Finding] = []
    if "u" in run.provenance.derived:
        run, findings = _unwrapped(mechanism, run)
        return Cleaned(run, tuple(findings))
    for step in (_without_copies, _at_the_pace_of_the_slower, _at_knots, _unwrapped):
        run, more = step(mechanism, run)
        findings += more
    of_coordinates = differences(run)
    if of_coordinates is not None:
        return Cleaned(of_coordinates, tuple(findings))
    comparisons = coordinates_against_speeds(mechanism, run)
    run, more = _without_spikes(run, comparisons)
    if more:
        findings += more
        comparisons = coordinates_against_speeds(mechanism, run)
    even = _evenly_timed(run)
    if even is not None:
        other = coordinates_against_speeds(mechanism, even)
        if unsteadiness(other) < CLEAR_RATIO * unsteadiness(comparisons):
            findings.append(_jitter(run, even))
            run, comparisons = even, other
    findings += [*_jumps(run, comparisons), *_wrong_rates(run, comparisons)]
    return Cleaned(run, tuple(findings))


# --- what is undone --------------------------------------------------------------------------------------


def _whole(run: Trajectory) -> bool:
    """Whether rows may not be taken out or moved."""
    return bool(run.integrals or run.events)


def _without(run: Trajectory, rows: Sequence[int] | NDArray[np.intp]) -> Trajectory:
    keep = np.ones(len(run), dtype=np.bool_)
    keep[rows] = False
    return run.take(keep)


def _without_copies(_: Mechanism, run: Trajectory) -> tuple[Trajectory, list[Finding]]:
    """Rows that repeat the one before though its speeds say that it moves on."""
    same = _repeated(run.q) & _repeated(run.u)
    if not same.any() or _whole(run):
        return run, []
    movement = np.abs(run.u[:-1]) * np.diff(run.t)[:, None]
    digit = digits_of(run)["q"].half().max(initial=0.0)
    copies = np.flatnonzero(same & np.any(movement > 4.0 * digit, axis=1)) + 1
    if not len(copies):
        return run, []
    return _without(run, copies), [
        Finding(
            "duplicated-rows",
            f"{len(copies)} rows repeat the previous row, although time and speeds advance",
            f"the first is row {copies[0]}, t = {run.t[copies[0]]:.6g} s",
            "They were left out. Write each state once, at its own time",
            "note" if len(copies) <= COPIES * len(run) else "doubt",
        )
    ]


def _repeated(values: Array) -> Mask:
    """Which rows after the first have the same numbers as the row before (T − 1,)."""
    return np.asarray((values[1:] == values[:-1]).all(axis=1))


def _at_the_pace_of_the_slower(
    mechanism: Mechanism, run: Trajectory
) -> tuple[Trajectory, list[Finding]]:
    """Rows in which coordinates or speeds are new, where a slower sensor repeats them for some rows."""
    free = mechanism.free
    if not (len(free.q) and len(free.u)) or _whole(run):
        return run, []
    columns = (("coordinates", run.q[:, free.q]), ("speeds", run.u[:, free.u]))
    old = {what: _repeated(values) for what, values in columns}
    for (what, repeated), other in zip(old.items(), reversed(old.values())):
        new = np.append(0, np.flatnonzero(~repeated) + 1)
        if len(new) < SHORTEST_PART or np.mean(repeated & ~other) < ROUGHLY:
            continue
        pace = np.diff(new)
        every = int(np.median(pace))
        if every < 2 or np.mean(pace == every) < 1.0 - ROUGHLY:
            continue
        remaining = (
            new[1:] if new[1] < every else new
        )  # of the first it is not known how old they are
        finding = Finding(
            "held-columns",
            f"the {what} come from a slower clock: they repeat for {every} rows while the others change",
            f"{len(remaining)} of {len(run)} rows hold new ones",
            "The other rows were left out. Log all columns of a row at one instant",
        )
        return run.take(remaining), [finding]
    return run, []


def _at_knots(_: Mechanism, run: Trajectory) -> tuple[Trajectory, list[Finding]]:
    """The states of the solver between which the rows were interpolated linearly.

    Where coordinates keep their rates over three rows while the speeds beside them change, the rows lie on a
    chord of the motion.
    """
    pairs = RateNames.of(run.coordinates, run.speeds).rates
    if not pairs or _whole(run) or run.works or run.stages is not None:
        return run, []
    digits, t, h = digits_of(run), run.t, np.diff(run.t)
    x, half = (np.hstack(of) for of in ((run.q, run.u), (digits["q"].half(), digits["u"].half())))
    rates = np.diff(x, axis=0) / h[:, None]
    slack = CHORD * (half + EPS * np.abs(t).max() * np.abs(rates).max(axis=0))
    slack = np.maximum(slack, 1e-150)  # of columns that are zero
    share = (h[:-1] / (h[:-1] + h[1:]))[:, None]
    bend = x[1:-1] - (1.0 - share) * x[:-2] - share * x[2:]
    straight = np.all(np.abs(bend) <= slack[1:-1], axis=1)
    q, u = np.array(pairs).T
    due = 0.25 * h[:-1, None] * np.abs(run.u[2:, u] - run.u[:-2, u])
    chords = straight & np.any(due > CHORD * slack[1:-1, q], axis=1)
    if np.sum(chords) < max(SHORTEST_PART, NEGLIGIBLE * len(run)):
        return run, []
    rows, later = _knots(t, x, slack, straight)
    if len(rows) < SHORTEST_PART:
        return run, []
    weight = (later / h[rows - 1])[:, None]

    def moved(values: Array) -> Array:
        """Columns on the line through a row and the one before."""
        return np.asarray(values[rows] + weight * (values[rows] - values[rows - 1]))

    knots = replace(
        run,
        t=t[rows] + later,
        q=moved(run.q),
        u=moved(run.u),
        udot=None if run.udot is None else moved(run.udot),
        forces={name: moved(values) for name, values in run.forces.items()},
        provenance=replace(run.provenance, step=None),
    )
    return knots, [
        Finding(
            "interpolated-rows",
            "rows were interpolated linearly between the solver's own steps",
            f"{int(chords.sum())} of {len(run)} rows lie on chords, which intersect in {len(rows)} states",
            "These states were judged in place of the rows. Log the solver's own steps, or its interpolant",
        )
    ]


def _knots(t: Array, x: Array, slack: Array, straight: Mask) -> tuple[NDArray[np.intp], Array]:
    """The last row (k,) before each state in which two chords intersect, and how much later that is (k,), s.

    The lines through the two rows before and the two rows after an interval must intersect within it, in all
    columns at the same instant: then the solver made no other step there. Or a row is such a state itself.
    """
    h = np.diff(t)
    rates = np.diff(x, axis=0) / h[:, None]
    before, after, within = rates[:-2], rates[2:], h[1:-1]
    apart, turn = x[2:-1] - after * within[:, None] - x[1:-2], before - after
    weights = 1.0 / slack[1:-2]
    size = np.sum((weights * turn) ** 2, axis=1) + 1e-300
    later = np.sum(weights**2 * turn * apart, axis=1) / size
    meet = np.all(np.abs(apart - later[:, None] * turn) <= CHORD * slack[1:-2], axis=1)
    near = CHORD / np.sqrt(size)
    meet &= (later >= -near) & (later <= within + near) & ~(straight[:-1] | straight[1:])
    own = np.flatnonzero(~straight[1:-1] & straight[:-2] & straight[2:]) + 2
    rows = np.concatenate([np.flatnonzero(meet) + 1, own])
    later = np.concatenate([later[meet], np.zeros(len(own))])
    order = np.argsort(t[rows] + later)
    return rows[order], later[order]


CHORD = 8.0
"""Half last digits within which rows lie on a line."""


def differences(run: Trajectory, one_sided: bool = False) -> Trajectory | None:
    """The run with its speeds marked as derived where they are central differences of the coordinates.

    Or where they are differences to the row before or after: so are those of some methods.
    """
    pairs = RateNames.of(run.coordinates, run.speeds).rates
    if len(pairs) < len(run.speeds) or len(run) < SHORTEST_PART or _whole(run):
        return None
    i, j = np.array(pairs).T
    u = run.u[:, j]
    quotients = are_quotients(run.t, run.q[:, i], u, digits_of(run)["u"].half()[:, j])
    if not quotients[one_sided]:
        return None
    # Of the next order: h² d²u/dt² / 6, that is, a sixth of the second differences; h du/dt / 2 to one side.
    order, share = (1, 2.0) if one_sided else (2, 6.0)
    errors = np.abs(np.diff(u, order, axis=0)).max(axis=0) / share
    names = [run.speeds[k] for k in j]
    derived = {**run.provenance.derived, "u": dict(zip(names, errors.tolist(), strict=True))}
    return replace(run, provenance=replace(run.provenance, derived=derived))


def are_quotients(t: Array, x: Array, rate: Array, half: Array) -> tuple[bool, bool]:
    """Whether rates (T, n) are the central difference quotients of x, or those to the row before or after.

    To rounding, and half of the last digit of each (`half`).
    """
    least, one_sided = np.diff(t).min(), np.diff(x, axis=0) / np.diff(t)[:, None]

    def equal(rows: slice, quotient: Array) -> bool:
        of_times = np.abs(t).max() / least * np.abs(quotient)
        rounding = half[rows] + 16.0 * EPS * (np.abs(x[rows]) / least + of_times)
        return bool(np.all(np.abs(rate[rows] - quotient) <= rounding))

    central = equal(slice(1, -1), np.gradient(x, t, axis=0)[1:-1])
    return central, equal(slice(1, None), one_sided) or equal(slice(None, -1), one_sided)


def _unwrapped(mechanism: Mechanism, run: Trajectory) -> tuple[Trajectory, list[Finding]]:
    """Angles that jump by whole turns, as those reduced to (−π, π] do."""
    pairs = [
        (i, j)
        for i, j in RateNames.of(run.coordinates, run.speeds).rates
        if mechanism.coordinates[i].unit == "rad"
    ]
    if not pairs:
        return run, []
    turn = 2.0 * np.pi
    places, rates = (list(of) for of in zip(*pairs))
    derived = [run.speeds[j] in run.provenance.derived.get("u", {}) for j in rates]

    # What coordinates change by beyond what their speeds say; splines of coordinates jump with them.
    u = np.where(derived, 0.0, run.u[:, rates])
    excess = np.diff(run.q[:, places], axis=0) - 0.5 * np.diff(run.t)[:, None] * (u[1:] + u[:-1])
    if max_norm(excess) <= 0.5 * turn:
        return run, []
    q, findings = np.array(run.q), list[Finding]()
    turns = np.round(excess / turn)
    jumping = (turns != 0.0) & (np.abs(excess - turns * turn) < 0.5)
    for i, turned, jumps in zip(places, turns.T, jumping.T):
        within = np.ptp(q[:, i]) < turn + 0.6
        # Of another clock, or of a coarse one, the speeds alone tell of turns.
        jumped = np.abs(np.diff(run.q[:, i])).max() > 0.5 * turn
        if jumps.any() and within and jumped:
            q[1:, i] -= turn * np.cumsum(np.where(jumps, turned, 0.0))
            findings.append(
                Finding(
                    "wrapped-angle",
                    f"coordinate {run.coordinates[i]!r} is wrapped to one turn",
                    f"it jumps by 2π {int(jumps.sum())} times while its speed is steady",
                    "It was unwrapped. Log the angle as the simulator has it",
                    element=run.coordinates[i],
                )
            )
    if not findings:
        return run, findings
    run = replace(run, q=q)
    return (with_speeds(run, MechanismNames.of(mechanism)) if any(derived) else run), findings


def _without_spikes(
    run: Trajectory, comparisons: Mapping[str, ColumnComparison]
) -> tuple[Trajectory, list[Finding]]:
    """Single rows of which a column lies far off its neighbours; only a few are taken out."""
    spikes: dict[int, str] = {}
    for name, comparison in comparisons.items():
        starts = comparison.start[comparison.outliers]
        rows = np.unique(np.concatenate([starts, starts + 1]))
        rows = rows[(rows >= 2) & (rows < len(run) - 2)]
        columns = [run.u[:, run.speeds.index(name)]]
        columns += [run.q[:, k] for k, c in enumerate(run.coordinates) if c == name]
        for x in columns:
            around = x[rows[:, None] + np.array([-2, -1, 1, 2])]
            distance = np.abs(x[rows] - np.median(around, axis=1))
            spikes |= dict.fromkeys(rows[distance > GAP * np.ptp(around, axis=1)].tolist(), name)
    if not spikes or len(spikes) > ROUGHLY * len(run) or _whole(run):
        return run, []
    first = min(spikes)
    finding = Finding(
        "spikes",
        f"{len(spikes)} rows have a value far from those before and after",
        f"the first is {spikes[first]!r} in row {first}, t = {run.t[first]:.6g} s",
        "They were left out. Look for what wrote them",
        element=spikes[first],
    )
    return _without(run, list(spikes)), [finding]


STEP_ERRORS = 3.0
"""Standard errors of the step of an even clock within which the simplest number is taken."""


def _evenly_timed(run: Trajectory) -> Trajectory | None:
    """The run on an even clock, rows whole numbers of steps apart, if its stamps scatter about one."""
    h = np.diff(run.t)
    step = float(np.median(h))
    if _whole(run) or float(np.ptp(h)) <= SIX_DIGITS * step:
        return None
    # However much single steps vary: no row is lost where each is nearest to its own place.
    rows = np.arange(float(len(run)))
    even = np.polyval(np.polyfit(rows, run.t, 1), rows)
    if np.abs(run.t - even).max() >= 0.5 * step:
        for _ in range(3):  # the median of rounded stamps is not their mean
            rows = np.concatenate([[0.0], np.cumsum(np.maximum(np.rint(h / step), 1.0))])
            step, start = (float(x) for x in np.polyfit(rows, run.t, 1))
        even = start + step * rows
    scatter = max_norm(run.t - even)
    if not SIX_DIGITS * step < scatter < 0.5 * step:
        return None
    return replace(run, t=_on_simple_clock(run.t, rows))


def _on_simple_clock(t: Array, rows: Array) -> Array:
    """Times (T,) of an even clock through stamps t, its step the simplest number within its error.

    Steps are given as 0.002 or 1/240 s, and by these alone rows follow from each other to rounding.
    """
    places = rows - rows.mean()
    step = float(places @ t / (places @ places))
    error = float(np.std(t - step * places) / np.linalg.norm(places))

    def near(x: float) -> bool:
        return abs(x - step) <= STEP_ERRORS * error

    decimals = (float(f"{step:.{digits}g}") for digits in range(1, 17))
    simplest = next(filter(near, decimals), step)
    rate = float(f"{1.0 / step:.0f}")
    if rate > 0.0 and near(1.0 / rate) and len(f"{rate:g}") < len(f"{simplest:.15g}".lstrip("0.")):
        simplest = 1.0 / rate
    return np.asarray(t.mean() + simplest * places)


def _jitter(run: Trajectory, even: Trajectory) -> Finding:
    scatter = float(np.std(run.t - even.t))
    step = float(np.median(np.diff(even.t)))
    return Finding(
        "clock-jitter",
        f"the time stamps scatter by {scatter:.2g} s about an even clock",
        f"by their coordinates and speeds the rows are {step:.6g} s apart",
        "They were put back on that clock. Log the simulator's own time, with all its digits",
    )


# --- what is told ----------------------------------------------------------------------------------------


def _jumps(run: Trajectory, comparisons: Mapping[str, ColumnComparison]) -> Iterator[Finding]:
    """Single intervals over which coordinates move farther than any speed in the log would take them."""
    jumped: dict[int, str] = {}
    for name, comparison in comparisons.items():
        farthest = max_norm(comparison.integrals)
        far = comparison.outliers & (np.abs(comparison.defect) > GAP * farthest)
        jumped |= dict.fromkeys(comparison.start[far].tolist(), name)
    rows = np.array(sorted(jumped), dtype=np.intp)
    if not len(rows) or len(rows) > ROUGHLY * len(run) or np.diff(rows).min(initial=2) < 2:
        return
    first = jumped[int(rows[0])]
    times = ", ".join(f"{run.t[k]:.6g}" for k in rows[:3]) + (", …" if len(rows) > 3 else "")
    yield Finding(
        "jump",
        "the state jumps from one row to the next, as where an episode begins anew or a state was set",
        f"{'once' if len(rows) == 1 else f'{len(rows)} times'}, after t = {times} s: {first!r} moves at "
        f"least {GAP:g} times as far as its largest speed would take it",
        "Audit what is before and after each jump separately, or log a column `episode`",
        "doubt",
        first,
    )


def _wrong_rates(run: Trajectory, comparisons: Mapping[str, ColumnComparison]) -> Iterator[Finding]:
    """Swapped and clipped columns, late rows, clock, gears, and speeds that are no rates at all.

    What one of these explains the others are not asked about.
    """
    rest = dict(comparisons)
    swapped = dict(_swapped(rest))
    for name, other in swapped.items():
        if name < other:
            yield Finding(
                "swapped-columns",
                f"the speeds {name!r} and {other!r} seem to be swapped",
                "each coordinate moves with the other's speed",
                "Correct the names of the columns",
                "doubt",
                name,
            )
    rest = {n: c for n, c in rest.items() if n not in swapped}
    clipped = [n for n, c in rest.items() if _is_clipped(run.speed(n), c)]
    for name in clipped:
        yield Finding(
            "clipped-column",
            f"the speed {name!r} stays at its extreme while the coordinate moves faster",
            f"its largest value is {np.abs(run.speed(name)).max():.6g}",
            "Widen the range of the sensor or format that wrote the column",
            "doubt",
            name,
        )
    rest = {n: c for n, c in rest.items() if n not in clipped}
    late = [n for n, c in rest.items() if _is_late(c)]
    if late:
        rows = float(np.median([rest[n].late for n in late]))
        yield Finding(
            "late-rows",
            f"coordinates are {abs(rows):.3g} rows {'older' if rows < 0 else 'newer'} than the speeds beside "
            "them",
            f"shown by {', '.join(map(repr, late[:4]))}",
            "Write coordinates and speeds of the same instant into one row",
            "doubt",
            late[0],
        )
    rest = {n: c for n, c in rest.items() if n not in late}
    scaled = {n: c for n, c in rest.items() if c.scaled and c.departure < NEGLIGIBLE}
    yield from _scaled(scaled, rest) if scaled else ()
    for name, c in rest.items():
        if name not in scaled and c.significant and c.departure > 1e-3:
            bar, moved = size_of(c.bar), size_of(c.increments)
            resolved = bar < RESOLVED * moved and len(run) > 30
            yield Finding(
                "speed-not-rate",
                f"the speed {name!r} is not the rate of its coordinate",
                f"it misses {percent(c.departure)} of the movement, where digits, noise and quadrature "
                f"explain {percent(bar / max(moved, 1e-300))}",
                "Log the speed of the same state, unfiltered and with the same clock",
                "doubt" if c.departure > NEGLIGIBLE and resolved else "note",
                name,
            )


def _swapped(comparisons: Mapping[str, ColumnComparison]) -> Iterator[tuple[str, str]]:
    """Pairs of speeds that fit each other's coordinates and not their own."""

    def fits(a: ColumnComparison, b: ColumnComparison) -> bool:
        if len(a.increments) != len(b.integrals):
            return False
        size = float(np.linalg.norm(a.increments) * np.linalg.norm(b.integrals))
        return abs(float(a.increments @ b.integrals)) > 0.99 * size > 0.0

    poor = {n: c for n, c in comparisons.items() if c.alike < 0.95}
    for a, x in poor.items():
        for b, y in poor.items():
            if a != b and fits(x, y) and fits(y, x):
                yield a, b


def _is_clipped(u: Array, c: ColumnComparison) -> bool:
    """Whether a speed has its extreme in many rows, between which the coordinate moves faster."""
    size = np.abs(u)
    at = size >= size.max(initial=0.0) * (1.0 - 1e-12)
    inside = at[c.start] & at[c.start + 1]
    if at.sum() < 6 or inside.sum() < 4 or inside.all():
        return False
    excess = np.median(np.abs(c.increments[inside]) - np.abs(c.integrals[inside]))
    return bool(excess > 5.0 * np.median(c.bar) + 1e-3 * size_of(c.increments))


def _is_late(c: ColumnComparison) -> bool:
    """Whether the rate is of another row, and changes enough from row to row to tell."""
    tells = c.instant and c.departure < 0.2 and not (c.significant and c.departure > NEGLIGIBLE)
    return tells and abs(c.late) > LATE and abs(c.ratio - 1.0) < 0.1


def _scaled(
    scaled: dict[str, ColumnComparison], every: dict[str, ColumnComparison]
) -> Iterator[Finding]:
    """One factor in all columns is a clock's; else gears between coordinates and speeds."""
    ratios = np.array([c.ratio for c in scaled.values()])
    errors = np.array([max(c.ratio_error, LEAST_RATIO) for c in scaled.values()])
    common = float(np.average(ratios, weights=errors**-2))
    agree = np.all(np.abs(ratios - common) < 3.0 * errors + 1e-3 * abs(common - 1.0))
    others = [c for n, c in every.items() if n not in scaled]
    dissent = any(abs(c.ratio - common) > c.ratio_error + SIX_DIGITS for c in others)
    if agree and not dissent and (len(every) > 1 or abs(common - 1.0) < 0.05):
        yield Finding(
            "clock-scale",
            f"all coordinates move by {common:.6g} times as far as their speeds say: the clock is wrong",
            f"of {len(scaled)} coordinates, each ± {float(errors.min()):.1g}",
            f"Multiply the times by {common:.6g}, or log the simulator's own time",
            "doubt",
            factor=common,
            error=float(errors.min()),
        )
        return
    for name, c in scaled.items():
        if abs(c.ratio - 1.0) >= LEAST_GEAR:
            yield Finding(
                "gear-between-q-and-u",
                f"coordinate {name!r} moves by {c.ratio:.6g} times what its speed says",
                f"± {max(c.ratio_error, LEAST_RATIO):.1g}",
                "Log both on the same side of the gear, in the same units",
                "doubt",
                name,
                c.ratio,
                c.ratio_error,
            )
