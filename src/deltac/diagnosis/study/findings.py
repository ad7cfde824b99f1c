"""What a study notices besides its verdict: one function a check, each returns its findings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from deltac.arrays import ROUGHLY, SAME, SMALL_SHARE, TINY
from deltac.diagnosis.inputs.omissions import impacts_not_held
from deltac.diagnosis.study.convergence import (
    FEWEST_TIMES,
    Convergence,
    order_of,
    order_text,
)
from deltac.diagnosis.study.curves import ComparedRuns, by_unit
from deltac.diagnosis.study.runs import corrections
from deltac.diagnosis.verdict import LEAST_ORDER, Finding, percent
from deltac.energy import Ledger
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory


def of_comparison(compared: ComparedRuns, knob: str) -> Iterator[Finding]:
    """Few common times; runs of different length; a horizon before the end."""
    runs = compared.runs
    spans = [(float(r.run.t[0]), float(r.run.t[-1])) for r in runs]
    ends = [end for _, end in spans]
    span = max(end - start for start, end in spans)
    if max(ends) - min(ends) > 1e-6 * span:
        yield Finding(
            "other-times",
            "the runs do not cover the same time; they are compared where all of them have rows",
            ", ".join(f"{knob} {r.step:g}: to {e:.6g} s" for r, e in zip(runs, ends)),
            "End all runs at the same time",
        )
    if len(compared.t) < FEWEST_TIMES:
        yield Finding(
            "few-common-times",
            f"the runs have only {len(compared.t)} times in common, so the motions cannot be compared well",
            f"rows that agree within {SAME:g} of the duration",
            "Choose steps that divide each other (0.01, 0.005, 0.0025), or sample all runs at the same times",
        )
    elif compared.horizon < compared.t[-1] - SAME * span:
        fine, coarse = runs[-1].step, runs[max(-len(runs), -3)].step
        yield Finding(
            "horizon",
            f"the motions at {knob}s {coarse:g} to {fine:g} diverge at t = {compared.horizon:.4g} s, and "
            "convergence is judged up to there",
            f"from there on their states differ by more than a tenth of their ranges: coarse {knob}s, or a "
            "chaotic motion, in which every error grows exponentially",
            f"If smaller {knob}s diverge hardly later, the motion is chaotic: no {knob} predicts it for "
            "longer",
        )


def of_order(state: Convergence, nominal: int | None, solver: str) -> Iterator[Finding]:
    """An observed order that is not the solver's own."""
    if nominal is None:
        return
    if state.order is not None and state.trend == "tends to a limit":
        error = state.order_error or 0.0
        if state.order + error < nominal - LEAST_ORDER:
            yield Finding(
                "order-below-nominal",
                f"the motion converges at order {order_text(state)}, below the {nominal} of {solver}",
                f"by differences of the states at steps {', '.join(f'{h:g}' for h in state.steps)}",
                "Either a force is not smooth (dry friction, contact, a table of values, a controller held "
                "over the step), or the start violates the constraints, or the solver has a bug",
            )


def of_corrections(ledger: Ledger, function: str, allowed: float) -> Iterator[Finding]:
    """A run that was stabilised: one of the two ways to count its corrections is blind."""
    work = corrections(ledger)
    if not work:
        return
    name, largest = max(work.items(), key=lambda item: float(np.abs(item[1]).max()))
    done = float(np.abs(largest).max())
    ways = [
        float(np.abs(x).max()) for x in (ledger.delta_c[function], ledger.uncorrected(function))
    ]
    if done <= allowed or 2.0 * min(ways) > max(ways):  # within a factor of two none is blind
        return
    yield Finding(
        "stabilised",
        f"the run is corrected as it goes ({name}), so one way of computing ΔC is blind to the error",
        f"corrections did up to {done:.2g} J of work, {percent(done / ledger.energy_exchanged)} of the "
        "energy exchanged; "
        f"|ΔC| is {ways[0]:.2g} J with it and {ways[1]:.2g} J without",
        "The larger one is taken as the error; use a method that needs no corrections to see its own",
        element=name,
    )


def of_constraints(compared: ComparedRuns, tolerance: float, *, trusted: bool) -> Iterator[Finding]:
    """Constraints, driven joints or quaternions that are violated though energy may be kept.

    A violation that stays, however small the step, is none of the integrator: the model's constraint is
    another than the motion's. Motions that have parted say nothing of that.
    """
    runs = compared.runs
    finest = runs[-1]
    for name, values in finest.ledger.violation.items():
        what, _, element = name.partition(" ")
        column = finest.run.u if what in ("velocity", "speed") else finest.run.q
        span = float(np.ptp(column, axis=0).max(initial=0.0))
        worst = float(values.max(initial=0.0))
        if worst <= max(1e-6, tolerance * span):
            continue
        sizes = [float(r.ledger.violation[name].max()) for r in runs]
        together = [
            float(r.ledger.violation[name][rows[: compared.within]].max(initial=0.0))
            for r, rows in zip(runs, compared.rows)
        ]
        stays = (
            len(together) > 1
            and compared.within >= FEWEST_TIMES
            and together[-1] > max(1e-6, tolerance * span)
            and order_of(compared.steps[[0, -1]], together[0], together[-1]) < LEAST_ORDER
        )
        blamed = stays and not trusted and what != "quaternion"
        yield Finding(
            "constraint-violation",
            f"{what} {element!r} is violated, even if the energy balance holds"
            + (
                ", at every step alike"
                if stays
                else "; less so at smaller steps" * (len(sizes) > 1)
            ),
            f"by up to {', '.join(f'{s:.2g}' for s in sizes)}",
            "Check the geometry or the motion of that constraint in the model, and where the motion starts"
            if stays
            else "Use a projection, or a smaller step",
            "cause" if blamed else "note",
            element,
        )


def of_momentum(momentum: Mapping[str, Convergence], finest: Ledger) -> Iterator[Finding]:
    """Momentum balances that do not close, however small the step."""
    for name, convergence in momentum.items():
        if convergence.trend == "tends to a limit":
            yield Finding(
                "momentum",
                f"the balance of {name} does not hold: it is off by {convergence.limit:.3g}, however small "
                "the step",
                f"± {convergence.limit_error:.1g}",
                "A force or a gyroscopic term is wrong or missing; energy reveals it only if it does work",
                element=name,
            )


def of_impacts(mechanism: Mechanism, run: Trajectory) -> Iterator[Finding]:
    """Impacts whose work the run does not hold: seen in its speeds, or else to be feared of its model."""
    jumps = list(_jumps(mechanism, run))
    yield from jumps or impacts_not_held(mechanism, run)


def _jumps(mechanism: Mechanism, run: Trajectory) -> Iterator[Finding]:
    """Speeds that jump between two rows, as in an impact that no channel holds."""
    if len(run) < 5 or any(n.kind in ("impact", "contact") for n in run.forces):
        return
    change = np.abs(np.diff(run.u, axis=0))
    top = by_unit(np.abs(run.u).max(axis=0), [entry.unit for entry in mechanism.speeds])
    around = np.maximum(change[:-2], change[2:])
    # A constant speed that begins to change is no jump: compare with the changes that are usual.
    usual = np.median(change, axis=0)
    sudden = (ROUGHLY * change[1:-1] > np.maximum(around, usual)) & (
        change[1:-1] > SMALL_SHARE * np.maximum(top, TINY)
    )
    if not sudden.any():
        return
    row, k = np.argwhere(sudden)[0]
    yield Finding(
        "impacts",
        "speeds jump between rows, as in impacts",
        f"{int(sudden.any(axis=1).sum())} times, first {run.speeds[k]!r} at t = {run.t[row + 1]:.4g} s",
        "Log the work or the force of impacts (channel 'impact …'), or compare up to the first of them",
        element=run.speeds[k],
    )
