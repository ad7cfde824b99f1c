"""What results show of themselves: curves over time, errors over steps, sizes, flows of energy.

A panel says what is shown, not how: `plots` draws panels with matplotlib, pages hold them as JSON.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np

from deltac.arrays import EPS, Array
from deltac.diagnosis import Convergence, order_text
from deltac.results import SHOWN, Serialisable, number

if TYPE_CHECKING:
    from deltac.diagnosis import Audit, EquationCheck, Recommendation, Study, StudyRun
    from deltac.energy import Ledger
    from deltac.mechanism import Entries, Mechanism
    from deltac.trajectories import Trajectory


@dataclass(frozen=True, eq=False)
class Line:
    """A curve of a plot over time.

    y        (T,) values in the plot's unit
    name     in the legend and in the CSV
    bar      (T,) half width of a band about it; on a log axis the band reaches from below up to it
    dashed   for what is only compared with
    shown    whether it is drawn at first
    colour   which of the palette; by default the next one; "ink" is what is left of the balance, "ink1" to
             "ink5" the same at coarser steps, "grey" what is only compared with
    """

    name: str
    y: Array
    bar: Array | None = None
    dashed: bool = False
    shown: bool = True
    colour: int | str | None = None


@dataclass(frozen=True)
class Guide:
    """A level that a curve is compared with: y = `value`."""

    name: str
    value: float


class Panel(Serialisable, also=("kind",)):
    """A part of a page; its fields make its JSON, under the name of its kind."""

    kind: ClassVar[str]


@dataclass(frozen=True, eq=False)
class TimePlot(Panel):
    """Curves over time, of one unit. With `log` the sizes |y| are drawn."""

    title: str
    t: Array
    lines: tuple[Line, ...]
    unit: str
    log: bool = False
    guides: tuple[Guide, ...] = ()
    note: str = ""
    tall: bool = False
    kind = "time"


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points of a plot on two log axes; `fit` is a straight line (x, y) through them, `fit_name` its name."""

    name: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    labels: tuple[str, ...] = ()
    joined: bool = True
    fit: tuple[tuple[float, float], tuple[float, float]] | None = None
    fit_name: str = ""
    mark: int | None = None
    colour: int | str | None = None


@dataclass(frozen=True, eq=False)
class LogPlot(Panel):
    """Points on two log axes: errors over steps, errors over time."""

    title: str
    x: str
    y: str
    clouds: tuple[Cloud, ...]
    guides: tuple[Guide, ...] = ()
    note: str = ""
    kind = "points"


@dataclass(frozen=True)
class HeatMap(Panel):
    """Sizes over two axes on one log scale, `low` to `high`, which maps beside each other share.

    `values` are rows along y, None where there is none; `bad` marks cells.
    """

    title: str
    x: str
    y: str
    xs: tuple[float, ...]
    ys: tuple[float, ...]
    values: tuple[tuple[float | None, ...], ...]
    bad: tuple[tuple[bool, ...], ...]
    low: float = 0.0
    high: float = 1.0
    note: str = ""
    kind = "heat"


@dataclass(frozen=True)
class Bars(Panel):
    """Sizes on a log axis, a bar each: (name, size, whether it is too large); `limit` is what is accepted."""

    title: str
    bars: tuple[tuple[str, float, bool], ...]
    limit: float
    note: str = ""
    kind = "bars"


@dataclass(frozen=True)
class FlowChart:
    """Energy (J) that went one way over the whole run; `error` how far it may be off.

    group   "flow": a work; "store": a change of what is stored; "left": what the balance cannot place
    colour  that of its curve
    """

    name: str
    energy: float
    error: float = 0.0
    group: Literal["flow", "store", "left"] = "flow"
    colour: int | str = "grey"


@dataclass(frozen=True)
class Flows(Panel):
    """Where the energy went: works into and out of the system, changes of what is stored, what is left."""

    title: str
    flows: tuple[FlowChart, ...]
    note: str = ""
    kind = "flows"


CURVE_POINTS = 4000
"""Points, or stretches with their extremes, that a curve is drawn with: no screen has more columns."""

MOST_DRAWN = 30
"""Bars, arrows, cells or whole curves of a picture: of more, the largest are drawn, or they are joined."""

SEEN = 0.02
"""Share of what is drawn that can be seen: of a distance to two points, of a curve to a log axis."""


def colours(ledger: Ledger) -> dict[str, int]:
    """The colour of every energy and every channel of a ledger, the same in all panels: the largest first."""
    sources = sorted(ledger.potential, key=lambda name: -float(np.ptp(ledger.potential[name])))
    flowing = [name for name in ledger.work if name not in ledger.potential]
    flowing.sort(key=lambda name: -float(np.ptp(ledger.work[name])))
    stores = ["K", *(["V"] if len(sources) > 1 else []), *(f"V {name}" for name in sources)]
    return {name: k for k, name in enumerate([*stores, *flowing])}


def audit_errors(report: Audit) -> TimePlot:
    """|ΔC| with its error bar, beside what is accepted and what the system has."""
    ledger = report.ledger
    lines = [
        Line(
            "|ΔC|",
            floored(report.energy_error, ledger),
            ledger.error_bar[report.function],
            colour="ink",
        )
    ]
    if report.function in ledger.delta_c and not np.array_equal(
        report.energy_error, ledger.delta_c[report.function]
    ):
        own = floored(ledger.delta_c[report.function], ledger)
        lines.append(Line("|ΔC| without corrections", own, dashed=True, shown=False, colour="grey"))
    lines += [
        Line(f"|ΔC| {name}", floored(values, ledger), shown=False)
        for name, values in ledger.delta_c.items()
        if name != report.function
    ]
    return _balance(
        ledger.t,
        lines,
        report.tolerance * report.reference_energy,
        report.reference_energy,
        "Shaded: how far |ΔC| may be off numerically. A right log stays inside it, or far below "
        "the dashed line.",
    )


def _balance(
    t: Array, lines: Iterable[Line], accepted: float, reference: float, note: str = "", of: str = ""
) -> TimePlot:
    """Curves of |ΔC| beside what is accepted and what the system has (J)."""
    title = f"What is left of the energy balance, |ΔC|{of}"
    guides = scales(accepted, reference)
    return TimePlot(title, t, tuple(lines), "J", log=True, guides=guides, note=note, tall=True)


def scales(accepted: float, reference: float) -> tuple[Guide, ...]:
    """What |ΔC| is compared with, where it is more than nothing."""
    guides = [("accepted", accepted), ("energy of the system", reference)]
    return tuple(Guide(name, value) for name, value in guides if value > 0.0)


def floored(values: Array, ledger: Ledger) -> Array:
    """Sizes, those below rounding of the energy exchanged at rounding: a log axis has no zero."""
    floor = EPS * ledger.energy_exchanged if ledger.energy_exchanged > 0.0 else EPS
    sized: Array = np.maximum(np.abs(values), floor)
    return sized


def lowest(curves: Iterable[Array]) -> float:
    """Where a log axis may begin: below all values of the curves but their few smallest; inf without any."""
    positive = [y[np.isfinite(y) & (y > 0.0)] for y in curves]
    return min((float(np.quantile(y, SEEN)) for y in positive if len(y)), default=np.inf)


def all_functions(ledger: Ledger) -> TimePlot:
    """|ΔC| of every testing function of a ledger, with its error bar."""
    lines = (
        Line(name, floored(values, ledger), ledger.error_bar[name])
        for name, values in ledger.delta_c.items()
    )
    return _balance(ledger.t, lines, 0.0, ledger.reference_energy)


def momentum_functions(ledger: Ledger) -> TimePlot:
    """|ΔP| of every speed with its error bar, as a share of the momentum that the speed exchanged."""
    exchanged = {name: size or np.inf for name, size in ledger.momentum_exchanged.items()}
    return TimePlot(
        "What is left of each speed's momentum, |ΔP|, as a share of ∫|ṗ| dt",
        ledger.t,
        tuple(
            Line(
                name,
                np.maximum(np.abs(values) / exchanged[name], EPS),
                ledger.delta_p_bar[name] / exchanged[name],
                shown=k < SHOWN,
            )
            for k, (name, values) in enumerate(ledger.delta_p.items())
        ),
        "1",
        log=True,
    )


def energy_plots(ledger: Ledger) -> Iterator[TimePlot]:
    """Kinetic and potential energies, then the work of every channel that is not in V."""
    K = ledger.kinetic
    V = ledger.potential_energy
    sources = sorted(ledger.potential.items(), key=lambda item: -float(np.ptp(item[1])))
    several, colour = len(sources) > 1, colours(ledger)
    visible = 0.02 * max(float(np.ptp(K)), *(float(np.ptp(v)) for _, v in sources), 0.0)
    yield TimePlot(
        "Energies, from their values at the start",
        ledger.t,
        (
            Line("K", K - K[0], colour=colour["K"]),
            *((Line("V", V - V[0], colour=colour["V"]),) if several else ()),
            *(
                Line(
                    f"V {name}",
                    v - v[0],
                    shown=k < SHOWN and float(np.ptp(v)) >= visible,
                    colour=colour[f"V {name}"],
                )
                for k, (name, v) in enumerate(sources)
            ),
            Line("K + V", K + V - K[0] - V[0], dashed=True, colour="grey"),
        ),
        "J",
    )
    flowing = {n: w - w[0] for n, w in ledger.work.items() if n not in ledger.potential}
    ranked = sorted(
        ((n, w) for n, w in flowing.items() if np.ptp(w) > 0.0),
        key=lambda item: -float(np.ptp(item[1])),
    )
    if ranked:
        yield TimePlot(
            "Work of every channel, from the start",
            ledger.t,
            tuple(
                Line(
                    name,
                    work,
                    ledger.work_error[name]
                    if float(ledger.work_error[name].max()) > 1e-3 * float(np.ptp(work))
                    else None,
                    shown=k < SHOWN,
                    colour=colour[name],
                )
                for k, (name, work) in enumerate(ranked)
            ),
            "J",
            note="Positive: it gave energy to the system.",
        )


def flows_of(ledger: Ledger, function: str, energy_error: Array | None = None) -> Flows:
    """Works into and out of the system over the whole run, what it stored, and what is left."""
    colour = colours(ledger)
    flows = [
        FlowChart(
            name, float(w[-1] - w[0]), float(ledger.work_error[name].max()), colour=colour[name]
        )
        for name, w in ledger.work.items()
        if name not in ledger.potential
    ]
    K = ledger.kinetic
    stored = [FlowChart("ΔK", float(K[-1] - K[0]), group="store", colour=colour["K"])]
    stored += [
        FlowChart(f"ΔV {name}", float(v[-1] - v[0]), group="store", colour=colour[f"V {name}"])
        for name, v in ledger.potential.items()
    ]
    shown, stored = _largest(flows, 12, "channels"), _largest(stored, 5, "stores")
    error = ledger.delta_c[function] if energy_error is None else energy_error
    bar = float(ledger.error_bar[function].max())
    remainder = FlowChart("ΔC, what is left", float(error[-1]), bar, "left", "ink")
    return Flows(
        "Energy from the start to the end of the run",
        (*shown, *stored, remainder),
        "Works that flowed in, what is stored of it, and what the balance cannot place.",
    )


def _largest(flows: Sequence[FlowChart], most: int, what: str) -> list[FlowChart]:
    """The largest of some flows, the others as one."""
    ranked = sorted(flows, key=lambda flow: -abs(flow.energy))
    shown, rest = ranked[:most], ranked[most:]
    if len(rest) < 2:
        return ranked
    total, error = sum(f.energy for f in rest), sum(f.error for f in rest)
    return [*shown, FlowChart(f"{len(rest)} smaller {what}", total, error, rest[0].group)]


def named(entry: StudyRun, unit: str) -> str:
    """A run of a study by its step, or by its tolerance, which has no unit."""
    return f"h = {number(entry.step, 's')}" if unit else f"tolerance {number(entry.step)}"


INKS = ("ink", "ink1", "ink2", "ink3", "ink4", "ink5")
"""Colours of what is left of the balance: of the finest step, and one for each coarser one."""


def study_errors(report: Study) -> TimePlot:
    """|ΔC| of every run, on the times of the finest."""
    name = report.function
    usable = [entry for entry in report.runs if entry.ledger is not None]
    finest = usable[-1]
    assert finest.ledger is not None
    t = finest.ledger.t
    lines = []
    for k, entry in enumerate(usable):
        assert entry.ledger is not None and entry.energy_error is not None
        y = floored(entry.energy_error[name], entry.ledger)
        last = entry is finest
        bar = None if entry.bar is None else entry.bar[name]
        at = resampled(entry.ledger.t, y, t)
        colour = INKS[min(len(usable) - 1 - k, len(INKS) - 1)]
        lines.append(Line(named(entry, report.unit), at, bar if last else None, colour=colour))
    return _balance(
        t,
        lines,
        report.tolerance * report.reference_energy,
        report.reference_energy,
        "An integrator's error falls with the step; an error of the equations stays where it is.",
        f" ({name})",
    )


def resampled(t: Array, y: Array, at: Array) -> Array:
    """A curve at other times: as it is where they are its own, else between its rows; none beyond its end."""
    if len(t) == len(at) and np.array_equal(t, at):
        return y
    curve: Array = np.interp(at, t, y, right=np.nan)
    return curve


def orders(report: Study) -> LogPlot:
    """Largest |ΔC| and state difference over the step, each with the line of its observed order.

    An order may be of a part of the runs alone: what it was fitted to is then drawn as points of their own.
    """
    energy_scale = report.reference_energy or 1.0
    steps = np.asarray(report.steps)
    errors = np.asarray(report.errors) / energy_scale
    energy, state = report.observed_order[report.function], report.observed_order["state"]
    fitted = np.asarray(energy.sizes) / energy_scale
    common = steps[len(steps) - len(fitted) :]
    limited = energy.trend == "tends to a limit"
    whole = bool((np.abs(fitted - errors[len(steps) - len(fitted) :]) <= SEEN * fitted).all())
    part = report.horizon < report.comparison.t[-1]
    same = f"the same, {'before the motions part' if part else 'at times that all steps share'}"
    moved = np.asarray(state.sizes)
    clouds = [
        _cloud(
            f"|ΔC| {report.function}",
            steps,
            errors,
            energy if whole and not limited else None,
            "ink",
        ),
        None if whole else _cloud(same, common, fitted, None if limited else energy, "ink2"),
        _cloud(
            "motion, to the next finer run",
            steps[len(steps) - 1 - len(moved) : -1] if len(moved) else moved,
            moved,
            state,
            "grey",
        ),
    ]
    limit = (Guide("limit of |ΔC|", energy.limit / energy_scale),) if limited else ()
    return LogPlot(
        "How the errors fall with the step",
        "step h (s)" if report.unit else "tolerance",
        "share of energy, or of the ranges",
        tuple(cloud for cloud in clouds if cloud is not None),
        (Guide("accepted", report.tolerance), *limit),
        note="" if report.nominal is None else f"The solver's own order is {report.nominal}.",
    )


def _cloud(
    name: str, h: Array, sizes: Array, convergence: Convergence | None, colour: str
) -> Cloud | None:
    """Positive sizes over the step, and the observed order through the finest of the points that gave it."""
    positive = np.isfinite(sizes) & (sizes > 0.0)
    if not positive.any():
        return None
    h, sizes = h[positive], sizes[positive]
    fit, fit_name = None, ""
    if (
        convergence
        and convergence.order is not None
        and convergence.steps
        and convergence.trend != "does not settle"
    ):
        near = int(np.argmin(np.abs(h - convergence.steps[-1])))
        ends = [
            (float(x), float(sizes[near] * (x / h[near]) ** convergence.order))
            for x in (h[-1], h[0])
        ]
        fit, fit_name = (ends[0], ends[1]), f"order {order_text(convergence)}"
    return Cloud(
        name, tuple(h), tuple(sizes), joined=fit is None, fit=fit, fit_name=fit_name, colour=colour
    )


def _by_unit(what: str, t: Array, values: Array, entries: Entries) -> Iterator[TimePlot]:
    units: dict[str, list[int]] = {}
    for k, entry in enumerate(entries):
        units.setdefault(entry.unit, []).append(k)
    for unit, places in units.items():
        label = "quaternions" if unit == "1" else unit
        columns = [(entries[k].name, values[:, k]) for k in places]
        yield by_name(f"{what} ({label})", t, columns, "" if unit == "1" else unit)


def by_name(title: str, t: Array, columns: Sequence[tuple[str, Array]], unit: str = "") -> TimePlot:
    """Columns with their names; those that move most are shown at first."""
    ranges = [float(np.ptp(values)) for _, values in columns]
    least = min(sorted(ranges, reverse=True)[:SHOWN], default=0.0)
    vacancies = SHOWN
    lines = []
    for (name, values), size in zip(columns, ranges):
        shown = size >= least and vacancies > 0
        vacancies -= shown
        lines.append(Line(name, values, shown=shown))
    return TimePlot(title, t, tuple(lines), unit)


def motions(run: Trajectory, mechanism: Mechanism) -> Iterator[TimePlot]:
    """The coordinates by unit, then the speeds."""
    yield from _by_unit("Coordinates", run.t, run.q, mechanism.coordinates)
    yield from _by_unit("Speeds", run.t, run.u, mechanism.speeds)


def residuals(report: EquationCheck) -> Bars:
    """What each equation leaves at random states, beside what is accepted."""
    rows = report.relative_residual.items()
    return Bars(
        "Residual of each equation, as a share of its terms",
        tuple(
            (f"equation {k} ({speed})", value, k in {blame.number for blame in report.blame})
            for k, (speed, value) in enumerate(rows, 1)
        ),
        report.tolerance,
    )


def fronts(report: Recommendation) -> Iterator[LogPlot]:
    """Work and precision: |ΔC| of every trial over the time that it took, then the error of the motion."""
    yield _front(
        report, "energy", "Energy error over time of computation", "|ΔC|, share of the energy"
    )
    if any(np.isfinite(trial.motion) and trial.motion > 0.0 for trial in report.trials):
        yield _front(
            report,
            "motion",
            "Error of the motion over time of computation",
            "share of the ranges of q, u",
        )


def _front(report: Recommendation, what: str, title: str, says: str) -> LogPlot:
    from deltac.diagnosis import setting_of

    clouds = []
    for k, solver in enumerate(dict.fromkeys(trial.solver for trial in report.trials)):
        own = [
            t
            for t in sorted(report.trials, key=lambda t: t.seconds)
            if t.solver == solver
            and np.isfinite(t.seconds)
            and np.isfinite(getattr(t, what))
            and getattr(t, what) > 0.0
        ]
        if own:
            chosen = report.best
            clouds.append(
                Cloud(
                    solver,
                    tuple(t.seconds for t in own),
                    tuple(getattr(t, what) for t in own),
                    tuple(f"{solver}, {setting_of(t)}" for t in own),
                    mark=own.index(chosen) if chosen in own else None,
                    colour=k,
                )
            )
    asked = report.tolerance if what == "energy" else report.motion_tolerance
    guides = (Guide("asked for", asked),) if np.isfinite(asked) else ()
    note = "Down and to the left is better. The ring marks the recommended setting."
    return LogPlot(title, "time of a run (s)", says, tuple(clouds), guides, note)
