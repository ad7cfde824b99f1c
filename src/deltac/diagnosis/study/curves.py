"""Runs of one motion at several steps, side by side: common times, state differences, the horizon."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import EPS, ROUGHLY, SAME, SIX_DIGITS, Array, max_norm
from deltac.diagnosis.study.convergence import FEWEST_TIMES, Convergence, between_runs, towards_zero
from deltac.diagnosis.study.runs import BalancedRun, StudyRun
from deltac.diagnosis.verdict import Finding
from deltac.mechanism import Mechanism
from deltac.trajectories import Trajectory

Rows: TypeAlias = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class ComparedRuns:
    """The same motion in n runs, the coarsest first, at their T common times.

    Attributes:
        runs: those of one motion; `t`: their common times (T,).
        rows: of each run, which rows these are.
        states: scaled coordinates and speeds (n, T, m): of one unit and kind, the largest range is 1.
        horizon: the time up to which the three finest stay together.
        first: the coarsest run from which on all stay together up to there.
    """

    runs: tuple[BalancedRun, ...]
    t: Array
    rows: tuple[Rows, ...]
    states: Array
    horizon: float
    first: int

    @property
    def steps(self) -> Array:
        """The step of each run (n,), s, or its tolerance."""
        return np.array([entry.step for entry in self.runs])

    @property
    def within(self) -> int:
        """How many of the common times lie within the horizon."""
        return int(np.searchsorted(self.t, self.horizon, "right"))

    @property
    def apart(self) -> bool:
        """Whether too few times, or runs, are together to compare curves: maxima are all there is."""
        return self.within < FEWEST_TIMES or self.first > len(self.rows) - 2

    def towards_zero(self, curves: Sequence[Array], bars: Sequence[Array]) -> Convergence:
        """How curves of the runs that should be zero converge, as long as these stay together."""
        if self.apart:
            tops, tallest = (np.array([np.abs(x).max() for x in each]) for each in (curves, bars))
            return towards_zero(self.steps, tops[:, None], tallest)
        first, within = self.first, slice(0, self.within)
        y, floors = (
            np.array([x[rows[within]] for x, rows in zip(each, self.rows)])[first:]
            for each in (curves, bars)
        )
        return towards_zero(self.steps[first:], y, floors.max(axis=1))

    def motion(self) -> Convergence:
        """How the motion converges while the runs are together."""
        if self.within < max(2, min(FEWEST_TIMES, len(self.t))):
            return Convergence("does not settle" if len(self.runs) > 1 else "one run")
        x = self.states[self.first :, 1 : self.within]
        rows = np.array([len(entry.run) for entry in self.runs[self.first :]])
        floors = 8.0 * EPS * np.sqrt(rows) * max(1.0, max_norm(x))
        return between_runs(self.steps[self.first :], x, floors)


def compare(mechanism: Mechanism, entries: Sequence[BalancedRun]) -> ComparedRuns:
    """Put runs side by side, coarsest step first."""
    runs = [entry.run for entry in entries]
    t, rows = common_times([run.t for run in runs])
    states = _scaled(mechanism, runs, rows)
    together = [_parting(t, a, b) for a, b in zip(states, states[1:])]
    horizon = min(together[-2:], default=float(t[-1]))
    first = max((k + 1 for k, end in enumerate(together) if end < horizon), default=0)
    return ComparedRuns(tuple(entries), t, tuple(rows), states, horizon, first)


def _parting(t: Array, a: Array, b: Array) -> float:
    """The last time before two motions (T, m) are no longer roughly the same."""
    parted = np.sqrt(np.mean((a - b) ** 2, axis=1)) > ROUGHLY
    k = int(np.argmax(parted)) if parted.any() else len(t)
    return float(t[max(k - 1, 0)])


def common_times(times: Sequence[Array]) -> tuple[Array, list[Rows]]:
    """Times that all runs have a row for, and those rows."""
    fewest = min(times, key=len)
    allowed = SAME * max(float(np.ptp(t)) for t in times)
    shared = np.ones(len(fewest), dtype=np.bool_)
    for t in times:
        shared &= np.abs(t[nearest(t, fewest)] - fewest) <= allowed
    times_shared = fewest[shared]
    return times_shared, [nearest(t, times_shared) for t in times]


def nearest(t: Array, times: Array) -> Rows:
    """The rows whose times are nearest."""
    right = np.clip(np.searchsorted(t, times), 1, max(len(t) - 1, 1))
    if len(t) == 1:
        return np.zeros(len(times), dtype=np.intp)
    before = right - 1
    return np.where(times - t[before] <= t[right] - times, before, right).astype(np.intp)


def scaled_start(mechanism: Mechanism, runs: Sequence[Trajectory]) -> Array:
    """Scaled states of the first rows (n, m)."""
    rows = [np.zeros(1, dtype=np.intp) for _ in runs]
    return _scaled(mechanism, runs, rows)[:, 0]


def _scaled(mechanism: Mechanism, runs: Sequence[Trajectory], rows: Sequence[Rows]) -> Array:
    finest = runs[-1]
    q_scale = _scales(finest.q, [c.unit for c in mechanism.coordinates])
    u_scale = _scales(finest.u, [c.unit for c in mechanism.speeds])
    states = []
    for run, at in zip(runs, rows):
        q = one_sided(mechanism, np.array(run.q[at]), finest.q[rows[-1]])
        states.append(np.concatenate([q / q_scale, run.u[at] / u_scale], axis=1))
    return np.array(states)


def _scales(values: Array, units: Sequence[str]) -> Array:
    """For each column the largest range of a column of its unit (of rotations: 1)."""
    if not len(values):
        return np.ones(len(units))
    ranges, sizes = (
        by_unit(x, units) for x in (np.ptp(values, axis=0), np.abs(values).max(axis=0))
    )
    scale = np.where(ranges > 0.0, ranges, np.maximum(sizes, 1.0))
    return np.where(np.array(units) == "1", 1.0, scale)


def by_unit(sizes: Array, units: Sequence[str]) -> Array:
    """For each column the largest of its unit: what is zero but for rounding has no size of its own."""
    same = np.equal.outer(np.array(units), np.array(units))
    return np.asarray(np.where(same, sizes, 0.0).max(axis=1, initial=0.0))


def one_sided(mechanism: Mechanism, q: Array, reference: Array) -> Array:
    """Coordinates, each quaternion on the side of the reference's: q and −q are one rotation."""
    for place in mechanism.quaternions.values():
        other = np.einsum("ij,ij->i", q[:, place], reference[:, place]) < 0.0
        q[other, place] *= -1.0
    return q


# --- which runs are of one motion and may be compared, and what is wrong with the others ---------


def disagreements(
    mechanism: Mechanism, runs: Sequence[StudyRun]
) -> tuple[list[BalancedRun], list[Finding]]:
    """The runs that are of one motion and may be compared, and what is wrong with the others.

    The finest run is taken for the motion that was meant.
    """
    usable = [entry for entry in runs if isinstance(entry, BalancedRun)]
    findings = list(_failures(runs))
    if len(usable) < 2:
        return usable, findings
    finest = usable[-1].run
    starts = scaled_start(mechanism, [entry.run for entry in usable])
    span = float(finest.t[-1] - finest.t[0])
    comparable: list[BalancedRun] = []
    for entry, start in zip(usable, starts):
        late = abs(entry.run.t[0] - finest.t[0]) > 1e-6 * span
        distance = max_norm(start - starts[-1])
        if late or distance > SIX_DIGITS:
            findings.append(_other_start(entry, finest, distance, late=bool(late)))
        elif comparable and _same(comparable[-1].run, entry.run):
            findings.append(_ignored(comparable[-1], entry))
        elif _diverged(entry, usable[-1]):
            findings += [] if entry.blown_up else [_of_divergence(entry, usable[-1])]
        else:
            comparable.append(entry)
    return comparable, findings


def _diverged(entry: BalancedRun, finest: BalancedRun) -> bool:
    """Whether a run is no approximation of the motion any more: it gives no order.

    It blew up, or its energy error exceeds all the energy that the finest run exchanged, which itself is
    credible.
    """
    exchanged = finest.ledger.energy_exchanged
    if finest.blown_up or _energy_error(finest) > ROUGHLY * exchanged:
        return False
    return entry.blown_up or _energy_error(entry) > exchanged


def _energy_error(entry: BalancedRun) -> float:
    """Largest |ΔC| (J), of the testing function that shows least: some see what is no error of the step."""
    return min(max_norm(curve) for curve in entry.energy_error.values())


def _of_divergence(entry: BalancedRun, finest: BalancedRun) -> Finding:
    return Finding(
        "blown-up",
        f"the run at step {entry.step:g} diverges: its energy error is larger than the energy of the motion",
        f"{_energy_error(entry):.3g} J; {finest.ledger.energy_exchanged:.3g} J exchanged at step "
        f"{finest.step:g}",
        "It says nothing of convergence and is not compared; give smaller steps",
    )


def _same(a: Trajectory, b: Trajectory) -> bool:
    return (
        len(a) == len(b) and bool(np.array_equal(a.t, b.t)) and bool(np.array_equal(a.q, b.q))
    ) and bool(np.array_equal(a.u, b.u) and np.ptp(a.u) + np.ptp(a.q) > 0.0)


def _failures(runs: Sequence[StudyRun]) -> Iterator[Finding]:
    """What was noticed of single runs, once of all that have it, and the runs that are not there."""
    alike: dict[tuple[str, str, str], list[Finding]] = {}
    for entry in runs:
        for f in entry.findings:
            alike.setdefault((f.kind, f.element, f.weight), []).append(f)
    for same in alike.values():
        yield replace(same[-1], what="; ".join(dict.fromkeys(f.what for f in same)))
    for entry in runs:
        if entry.failure:
            yield Finding(
                "run-failed",
                f"there is no run at step {entry.step:g}",
                entry.failure.rstrip("."),
                "The other runs are judged without it",
            )


def _other_start(entry: BalancedRun, finest: Trajectory, distance: float, *, late: bool) -> Finding:
    evidence = (
        f"it starts at t = {entry.run.t[0]:g} s, the finest at {finest.t[0]:g} s"
        if late
        else f"its first state is off by {distance:.2g} of the range of the motion"
    )
    return Finding(
        "other-start",
        f"the run at step {entry.step:g} starts at another time or state than the finest one and is not "
        "compared with it",
        evidence,
        "Start all runs in the same state at the same time",
    )


def _ignored(a: StudyRun, b: StudyRun) -> Finding:
    return Finding(
        "step-ignored",
        f"the runs at steps {a.step:g} and {b.step:g} are identical",
        "the simulator ignores its step",
        "Make the simulator use the step that it is called with, then repeat the study",
        "doubt",
    )
