"""Logs put right: forces as they acted, rows that filters spoiled. What is not right is told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from deltac.arrays import Array
from deltac.diagnosis.audit.acted import as_acted
from deltac.diagnosis.audit.reading import Reference
from deltac.diagnosis.explain.regression import LEAST_ROWS
from deltac.diagnosis.inputs.logs import Log, balanced
from deltac.diagnosis.measurements.kinematics import unsteadiness
from deltac.diagnosis.residuals.one_step import LEAST, OneStep, one_step
from deltac.diagnosis.verdict import Finding
from deltac.mechanism.channels import ChannelName
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory
from deltac.trajectories.columns import Kinematics
from deltac.trajectories.lint import gap_rows

ENDS, BEYOND_OTHERS = 0.02, 3.0
"""Share of a log at each end that may be left out, where it leaves so many times more than all others."""

EARLY = 0.02
"""Share of its changes that a force may act before its row and still counts as held over the step."""


def corrected(
    reference: Reference, log: Log, step: OneStep | None
) -> tuple[Log, OneStep | None, list[Finding]]:
    """A log with its one-step test, put right where this shows what it should be, and what was not right."""
    mechanism, found = reference.mechanism, list[Finding]()

    def of(run: Trajectory) -> tuple[Log, OneStep | None]:
        """The log that consists of these rows, and its test."""
        comparisons = {n: c.between(log.run.t, run.t) for n, c in log.comparisons.items()}
        part = balanced(mechanism, run, reference.work, log.findings, comparisons)
        return part, one_step(mechanism, run, lateness(part), unsteadiness(comparisons))

    whole = log.consecutive is log.run
    if whole and step is not None and not step.closes and (made := as_acted(mechanism, log.run)):
        run, found = made
        log, step = of(run)
    if whole and step is not None and not step.closes:
        within = _without_ends(mechanism, log.run, step)
        if within is not None:
            found.append(within[1])
            log, step = of(within[0])
    if step is not None and step.scheme is not None and step.closes and step.scheme.late_forces:
        log, finding = _with_earlier_forces(reference, log)
        found.append(finding)
    return (log if step is None else _held(reference, log, step)), step, found


def lateness(log: Log) -> float:
    """By how many rows coordinates are ahead of their speeds, over all of them."""
    lates = [c.late for c in log.comparisons.values() if c.off < 0.1 and c.instant]
    return float(np.median(lates)) if lates else 0.0


def _without_ends(
    mechanism: Mechanism, run: Trajectory, step: OneStep
) -> tuple[Trajectory, Finding] | None:
    """The log without what differences and filters leave in its first and last rows; None if nothing is.

    Rows at an end leave more than any others by far: energies that are counted from the first of them are off
    all along the log. Only speeds are spoiled so: with speeds that follow from the coordinates, the ends must
    leave no more. An impact or another motion is still there then, and stays.
    """
    left, t = _left(step), step.residual.t
    count = int(ENDS * len(left))
    if count < 1 or run.works or run.integrals:
        return None
    most = BEYOND_OTHERS * float(left[count:-count].max())
    first, last = np.flatnonzero(left[:count] > most), np.flatnonzero(left[-count:] > most)
    start = float(t[first[-1]]) if len(first) else run.t[0]
    end = float(t[len(left) - count + last[0]]) if len(last) else run.t[-1]
    if not (len(first) or len(last)) or _is_motion(mechanism, run, start, end, most):
        return None
    part = run.between(start, end)
    rows = len(run) - len(part)
    if not rows:
        return None
    return part, Finding(
        "spoiled-ends",
        "the first or last rows satisfy the equations far less than all others, as filters and difference "
        "quotients leave them",
        f"{rows} {'rows were' if rows > 1 else 'row was'} left out: those from t = {part.t[0]:.6g} to "
        f"{part.t[-1]:.6g} s are judged",
        "Cut the ends of what was filtered or differenced",
    )


def _left(step: OneStep) -> Array:
    """What each window leaves, as a share of the terms: of the equation that leaves most."""
    scale = np.maximum(step.residual.scale, 1e-300)
    return np.asarray((np.abs(step.residual.forces) / scale).max(axis=1))


def _is_motion(
    mechanism: Mechanism, run: Trajectory, start: float, end: float, most: float
) -> bool:
    """Whether what lies before `start` and after `end` leaves more than `most` by its coordinates, too."""
    from scipy.interpolate import make_interp_spline

    pairs = Kinematics.of(run.coordinates, run.speeds).rates
    if len(pairs) < len(run.speeds) or len(run) < LEAST_ROWS:
        return True  # turns in space have no such rates: nothing is known
    places, speeds = (list(of) for of in zip(*pairs))
    u = np.empty_like(run.u)
    u[:, speeds] = make_interp_spline(run.t, run.q[:, places], 5).derivative()(run.t)
    step = one_step(mechanism, replace(run, u=u))
    if step is None:
        return True
    left, inside = _left(step), (step.residual.t > start) & (step.residual.t < end)
    most = max(most, LEAST, BEYOND_OTHERS * float(left[inside].max(initial=0.0)))
    return bool(np.any(left[~inside] > most))


def _with_earlier_forces(reference: Reference, log: Log) -> tuple[Log, Finding]:
    """The log with its forces one row earlier, where those of a row belong to the step that led to it."""
    run = log.run
    moved = replace(run.every(1).between(run.t[0], run.t[-2]), integrals={}, works={})
    moved = replace(moved, forces={n: f[1:] for n, f in run.forces.items()})
    finding = Finding(
        "forces-one-row-late",
        "the logged forces are one row older than the state: they belong to the step that led to their row",
        "shifted by one row, they satisfy the equations",
        "They were shifted by one row. Log forces with the state in which they act",
    )
    found = balanced(reference.mechanism, moved, reference.work, log.findings, log.comparisons)
    return found, finding


def _held(reference: Reference, log: Log, step: OneStep) -> Log:
    """The log with its work taken as its forces acted: held over each step.

    So an identified integrator took them, or the rows show it where forces rest over several. Methods of
    first order take other forces from the start of a step too; of better ones these change along it.
    """
    run, scheme = log.run, step.scheme
    moving = [n for n, f in run.forces.items() if np.any(f[1:] != f[:-1])]
    known = reference.work or run.integrals or run.events or run.provenance.held is not None
    if not moving or known or log.consecutive is not run or len(gap_rows(run.t)):
        return log
    order = 2
    if step.closes and scheme is not None:
        order = scheme.order if scheme.name else 2
        if scheme.forces == "smooth" or not scheme.explicit:
            return log
    elif not _resting_until_told(step) and not (step.steps is not None and step.steps.held):
        return log
    width = float(np.median(np.diff(run.t)))
    held = tuple(n for n in run.forces if n.kind not in ("prescribed", "constraint"))
    provenance = replace(run.provenance, step=width, held=held)
    acting = replace(run, provenance=provenance)
    if order < 2:
        return balanced(reference.mechanism, acting, "discrete", log.findings, log.comparisons)
    acting = replace(acting, works=held_works(run, held))
    return balanced(reference.mechanism, acting, None, log.findings, log.comparisons)


def held_works(run: Trajectory, held: Sequence[ChannelName]) -> dict[ChannelName, Array]:
    """The work (T,) of forces held from each row to the next, J: F Δq, without an error of quadrature.

    Of forces on speeds that are rates of coordinates; of others by the trapezoid of the speeds.
    """
    h = np.diff(run.t)[:, None]
    moved = 0.5 * h * (run.u[1:] + run.u[:-1])
    for i, j in Kinematics.of(run.coordinates, run.speeds).rates:
        moved[:, j] = np.diff(run.q[:, i])
    return {
        name: np.concatenate([[0.0], np.cumsum(np.sum(run.forces[name][:-1] * moved, axis=1))])
        for name in held
    }


def _resting_until_told(step: OneStep) -> bool:
    """Whether forces are held over several rows, and change with the row that tells it."""
    intervals = step.residual.intervals
    return intervals.held and abs(intervals.early) <= EARLY
