"""What a log says: its integrator, the causes of what its rows do not follow from each other, ΔC in joules.

The prediction errors of a log, whitened, are regressed on the fields of an unknown integrator or compared
with the maps of known ones, and on the columns of every cause. All hypotheses are factorisations of one Gram
matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import count
from typing import TypeAlias

import numpy as np

from deltac.arrays import NEGLIGIBLE, ROUGHLY, SIX_DIGITS, SMALL_SHARE, Array
from deltac.calls.progress import TimeLimit
from deltac.diagnosis.causes.causes import TERMS_OF_AN_EQUATION, Candidate, alike
from deltac.diagnosis.causes.columns import ColumnKernels, LogEquations, column_kernels
from deltac.diagnosis.causes.geometry import geometry_columns
from deltac.diagnosis.inference.attribution import (
    PURE,
    attributed,
    disputed_joules,
    equations_share,
    generic_equations,
    integrator_estimate,
    integrator_share,
    intermittent_force,
    name_of,
    of_one_number,
    of_scattered_steps,
    otherwise_than_by_force,
    squares,
    through_speeds,
    unknown_force,
    unseen_joules,
    with_unexplained,
)
from deltac.diagnosis.inference.comparison import HypothesisComparison, compared
from deltac.diagnosis.inference.hypotheses import (
    CERTAIN,
    TOGETHER,
    Block,
    Fit,
    Posterior,
    fitted,
    nothing,
    refitted,
    steadfast,
)
from deltac.diagnosis.inference.integrators import Integrator
from deltac.diagnosis.inference.interpolation import (
    WITHIN_A_ROW,
    acting_as_in,
    closed_by_other_forces,
    left_by_shifts,
    with_filter,
    with_likeliest_forces,
)
from deltac.diagnosis.inference.linearisation import (
    NO_MOTION,
    RELINEARISATIONS,
    Point,
    start,
)
from deltac.diagnosis.inference.model import LogModel
from deltac.diagnosis.inference.observations import EVERY_STEP, observations
from deltac.diagnosis.inference.reduced import reductions
from deltac.diagnosis.inference.regression import (
    by_accelerations,
    mistakes_of_one_kind,
    regression,
    searched,
)
from deltac.diagnosis.inference.result import (
    KNOWN,
    OF_DELAYS,
    OF_INERTIA,
    OF_THE_LOG,
    SLIGHT,
    WHITE,
    Inference,
)
from deltac.kernels.rows import compiled_rows
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory
from deltac.trajectories.trajectory import INTERPOLATED, ROWS

WORK = 3e8
"""Instructions that the columns of causes may take, about: some tenths of a second."""

PRODUCT = 0.02
"""Time of a product of two numbers in one of matrices beside that of an instruction that is interpreted."""

SAMPLE = 300
"""Intervals by which most of the causes are excluded that are alike to first order."""

FEW = 60
"""Rows that tell how well the numbers of causes are known where no cause can have odds."""

MOST_ROWS, LEAST_ROWS = 8000, 150

MOST_COST = 100_000
"""Instructions of the columns at a row up to which the geometry is asked as well."""

MANY_NUMBERS = 200_000
"""Intervals times columns of causes from which on a sample is asked first: all take seconds."""

FORCED = 0.5
"""Square of what coordinates depart by beyond what their speeds do to them, in units of both squares, that no
force makes: a smooth one makes none, what is of each on its own is one."""


@dataclass(frozen=True, eq=False)
class Unclosed:
    """A log of which the rows do not follow from each other without a cause: the points to begin at.

    alone  the inference in all coordinates without causes; None where the equations have no motion
    """

    points: tuple[Point, ...]
    alone: Inference | None
    equations: LogEquations
    kernels: ColumnKernels

    def left_by_shifts(self, beside_causes: bool) -> dict[int, float]:
        """Variance that forces of other rows leave in a sample, by rows of delay; empty without forces."""
        point = self.points[-1] if self.points else None
        if point is not None and point.forces.kinds and not point.forces_known:
            with np.errstate(all="ignore"), compiled_rows(), suppress(*NO_MOTION):
                if beside_causes:
                    point = point.with_candidates(self.equations, self.kernels)
                return left_by_shifts(point.sampled(SAMPLE).with_columns())
        return {}

    def with_causes(
        self, limit: TimeLimit | None = None, lacking: bool = False, filtered: bool = False
    ) -> Inference | None:
        """The inference with causes; None where the equations have no motion between the rows.

        Where the time `limit` has passed, places and axes are no causes, and causes count to first order; so
        they do where a log is `lacking` forces of the model, which may be all that is wrong, unless causes
        are of inertia, that no force looks like.
        """
        # What looks like a mistake in all coordinates may be what an integrator of a few of them does.
        result, before = None, None
        with np.errstate(all="ignore"), compiled_rows():
            for point in self.points:
                sample = self._of_sample(point, limit, lacking, filtered)
                if sample is not None:
                    return sample
                found = _to_first_order(
                    point, self.equations, self.kernels, limit, lacking, filtered
                )
                if found is None or (before and _no_better(found[1], before)):
                    continue
                own = _at_itself(point, self.equations, *found, limit, filtered)
                if own is None:
                    continue
                if self.alone and self.alone.closes and not own.finds_something:
                    # Causes that some rows suggest have no odds in all rows, which follow without causes.
                    none = nothing(len(own.posterior.best.coefficients))
                    without = replace(own.posterior, best=none, alternatives=())
                    return _with_excluded(self.alone, replace(own, posterior=without))
                if _follow_by_causes(own) and own.filter is None:
                    # What they do in rows that were not looked at is not what they do in others.
                    every = self._with_more_rows(point)
                    more = None if every is point else self._beside_causes(every, own)
                    return more if more and _follow_by_causes(more) else own
                if own.closes or own.excess <= KNOWN:
                    return own
                if result is None or own.flow < result.flow:
                    result, before = own, found[1]
        return result

    def _of_sample(
        self, point: Point, limit: TimeLimit | None, lacking: bool, filtered: bool
    ) -> Inference | None:
        """The inference from a sample of the rows, where more rows would tell no more; else None.

        Its causes explain all but a thousandth, and all rows follow beside them; or they leave a thousand
        times the noise. Joules are of all rows, unless these prefer other causes to the latter.
        """
        intervals, departing = len(point.log.intervals), self.alone.excess if self.alone else np.inf
        if intervals * len(self.kernels.columns) < MANY_NUMBERS or intervals < 2 * SAMPLE:
            return None
        if SMALL_SHARE**2 * departing < 1.0:  # they depart by less than a thousand times the noise
            return None
        try:
            some = point.sampled(SAMPLE)
        except NO_MOTION:
            return None
        found = _to_first_order(some, self.equations, self.kernels, limit, lacking, filtered)
        own = found and _at_itself(some, self.equations, *found, limit, filtered)
        if not own or own.filter is not None:
            return None
        certain = _follow_by_causes(own) and 1.0 - own.explained <= SMALL_SHARE**2
        named = own.force is not None or bool(own.posterior.best.chosen)
        hopeless = named and SMALL_SHARE**2 * own.excess >= 1.0
        if not (certain or hopeless):
            return None
        every = self._with_more_rows(point) if certain else point
        result = self._beside_causes(every, own, hopeless)
        if result is not None:
            return result if hopeless or _follow_by_causes(result) else None
        return own if hopeless else None

    def _with_more_rows(self, point: Point) -> Point:
        """The point at more of the rows, where many columns left time for some: causes once known are few."""
        if point.log.whole <= EVERY_STEP:
            return point
        most = int(np.clip(WORK / self.kernels.cost, LEAST_ROWS, MOST_ROWS))
        log = observations(point.model, point.run, most)
        if log is None or len(log.intervals) <= len(point.log.intervals):
            return point
        with suppress(*NO_MOTION):
            return start(point.model, point.run, log, point.energy)
        return point

    def _beside_causes(self, rows: Point, own: Inference, rival: bool = False) -> Inference | None:
        """The inference at other rows with the causes that some have; None where these prefer others."""
        best = own.posterior.best
        every = replace(rows, columns=[]).with_candidates(self.equations, self.kernels)
        if None in alike(every.candidates, best.chosen):
            every = every.with_candidates(self.equations, geometry_columns(self.equations))
        forces = replace(rows.forces, kinds=own.forces)
        every = every.with_flow(forces=forces).with_noise_of_rows().with_process_noise()
        whole = _settled(every.narrowed(own.posterior), own.posterior, rival)
        if whole is None or not whole.posterior.best.alike(best):
            return None
        return _with_excluded(inferred(whole), own)


def _follow_by_causes(result: Inference) -> bool:
    """Whether rows follow from each other but for noise, beside causes."""
    return result.finds_something and (result.closes or result.excess <= KNOWN)


def infer(
    mechanism: Mechanism, run: Trajectory, energy: float = 0.0, limit: TimeLimit | None = None
) -> Inference | None:
    """The inference for a run whose columns are in the mechanism's order; None for too few rows.

    `energy` and `limit` as of `closed` and of `Unclosed.with_causes`.
    """
    begun = closed(mechanism, run, energy)
    return begun.with_causes(limit) if isinstance(begun, Unclosed) else begun


def closed(
    mechanism: Mechanism, run: Trajectory, energy: float = 0.0
) -> Inference | Unclosed | None:
    """The inference where rows follow from each other without a cause; None for too few rows.

    `energy` is what the run exchanges (J): causes that exchange less than `NEGLIGIBLE` of it must be all.
    """
    if not len(mechanism.free.u) or len(run) < 3:
        return None
    model = LogModel(mechanism, run)
    equations = LogEquations(mechanism, run)
    kernels = column_kernels(equations)
    points, whole = list[tuple[float, Point]](), None
    with np.errstate(all="ignore"), compiled_rows():
        for one in (*reductions(model, run), model):
            alone = _closed(one, run, equations, kernels, energy)
            # The fields of an integrator are many in all coordinates; a method of a few is sure.
            if isinstance(alone, Inference) and (alone.methods or one is model):
                return alone
            if isinstance(alone, tuple):
                inference, point = alone
                points.append((inference.excess, point))
                whole = inference if one is model else None
    # Coordinates in which least is left are likely those of the integrator; all of them come last.
    points.sort(key=lambda item: item[0] if item[1].model.n < model.n else np.inf)
    return Unclosed(tuple(point for _, point in points), whole, equations, kernels)


def infer_alone(mechanism: Mechanism, run: Trajectory) -> Inference | None:
    """The inference without causes: what an integrator and noise leave; None as for `infer`."""
    model = LogModel(mechanism, run)
    log = observations(model, run, MOST_ROWS)
    if log is None:
        return None
    try:
        with np.errstate(all="ignore"), compiled_rows():
            return inferred(likeliest(start(model, run, log)))
    except NO_MOTION:
        return None


def _closed(
    model: LogModel, run: Trajectory, equations: LogEquations, kernels: ColumnKernels, energy: float
) -> Inference | tuple[Inference, Point] | None:
    """The result of rows that follow from each other without a cause; or None.

    Else the result without causes, and the point to begin at.
    """
    products = 2 * model.n * len(kernels.columns) ** 2
    cost = kernels.cost + PRODUCT * products
    log = observations(model, run, int(np.clip(WORK / cost, LEAST_ROWS, MOST_ROWS)))
    few = observations(model, run, FEW)
    if log is None or few is None:
        return None
    try:
        comparison = likeliest(start(model, run, log, energy))
        alone, block, point = inferred(comparison), comparison.blocks[0], comparison.point
        by_accelerations = point.accelerations is not None
        if block.projected.left(np.zeros(0)) > KNOWN * block.least:
            # What departs between rows of which the accelerations are the model's is of the steps.
            by_accelerations = _accelerations_agree(point) and _of_no_force(point, alone.residual)
            if not by_accelerations:
                return alone, point
            scattered = inferred(comparison, scattered=True, agreed=True)
            alone = replace(scattered, integrator=alone.integrator)
        # What comes and goes within the noise of the rows is nothing.
        if alone.excess > 1.0 and alone.finds_something:
            return alone, point
        if by_accelerations:
            return _by_accelerations(alone, comparison, equations, kernels)
        # A few rows exclude most mistakes; what they leave open, all rows are asked for.
        for rows in (few, log):
            some = point if rows is log else start(model, run, rows, energy)
            excluded = inferred(likeliest(some.with_candidates(equations, kernels)))
            something = excluded.excess > 1.0 and excluded.finds_something
            if something or excluded.posterior.best.chosen:
                return alone, point
            # Those that do nothing in a few rows may do something in others.
            every = {name_of(c) for c in of_one_number(excluded.candidates)}
            seen = {x for x, joules in excluded.unseen.items() if joules <= SIX_DIGITS * energy}
            if seen >= every:
                break
        return _with_excluded(alone, excluded)
    except NO_MOTION:
        return None


def _accelerations_agree(point: Point) -> bool:
    """Whether accelerations of a log whose origin is not known are those of the model to their digits.

    Rows of other equations would not have them; others may be differences, and tell nothing.
    """
    run, free = point.run, point.model.mechanism.free.u
    if run.udot is None or "udot" in run.provenance.derived or point.model.n < len(free):
        return False
    rows = np.concatenate([np.arange(a, b - 1) for a, b in point.log.rows])
    some = np.flatnonzero(np.isfinite(run.udot[rows][:, free]).all(axis=1))
    if len(some) < FEW:
        return False
    block, _ = by_accelerations(point, some)
    return block.projected.left(np.zeros(0)) <= block.least


def _of_no_force(point: Point, residual: Array) -> bool:
    """Whether most of what is left (N, 2n) is of no force: one moves coordinates by h/2 of the speeds."""
    # In most intervals: blows are of a few, and leave the others.
    return bool(np.median(otherwise_than_by_force(point, residual, 0.0)) > FORCED)


def _with_excluded(alone: Inference, sample: Inference) -> Inference:
    """The result of a log that closes, with what a sample of its rows tells of the causes excluded."""
    share = np.sqrt(len(sample.w) / len(alone.w))
    return replace(
        alone,
        kernels=sample.kernels,
        blocks=sample.blocks,
        posterior=sample.posterior,
        candidates=sample.candidates,
        generic=sample.generic,
        unseen={name: float(share) * joules for name, joules in sample.unseen.items()},
    )


def _by_accelerations(
    alone: Inference,
    comparison: HypothesisComparison,
    equations: LogEquations,
    kernels: ColumnKernels,
) -> Inference:
    """The result of a log whose accelerations close, with how large the mistakes are that some rows hide.

    A unit of a cause moves the accelerations by its column, and does the work of that.
    """
    point = comparison.point.with_candidates(equations, kernels)
    some = np.unique(np.linspace(0, len(point.log.intervals) - 1, FEW).astype(np.intp))
    block, columns = by_accelerations(point, some)
    speeds = comparison.at.gradient[some, point.model.n :]
    power = np.einsum("kn,knp->kp", speeds, columns)
    curves = np.cumsum(power, axis=0) * (point.log.duration / len(some))
    best = nothing(len(point.coefficients))
    excluded = replace(
        alone,
        kernels=point.kernels,
        blocks=(block,),
        posterior=Posterior(best, (), ()),
        candidates=point.candidates,
        unseen=unseen_joules(point, block, best, alone.tau, curves),
        w=point.flow.w[some],
    )
    return _with_excluded(alone, excluded)


def _no_better(one: Inference, other: Inference) -> bool:
    """Whether causes of one leave about as much as those of another, and exchange as much, or more."""
    less = 1.0 - NEGLIGIBLE
    return one.flow > less * other.flow and one.excess > less * other.excess


def _passed(limit: TimeLimit | None, what: str) -> bool:
    return limit is not None and limit.passed(what)


def _to_first_order(
    point: Point,
    equations: LogEquations,
    kernels: ColumnKernels,
    limit: TimeLimit | None,
    lacking: bool,
    filtered: bool,
) -> tuple[HypothesisComparison, Inference, bool] | None:
    """Causes to first order, with places and axes where something is found; and whether they are asked on.

    They are not where terms of single equations explain nearly everything, nor where the log lacks forces
    that may be what was found.
    """
    try:
        comparison = likeliest(point.with_candidates(equations, kernels))
        result = inferred(comparison)
        term = None if filtered or not _is_unexplained(point, result) else _term(point, equations)
        if term is not None:
            return term, inferred(term), False
        chosen = result.posterior.best.chosen
        asked = not lacking or bool(chosen and all(c.kind in OF_INERTIA for c in chosen))
        if (
            asked
            and result.finds_something
            and kernels.cost < MOST_COST
            and not _passed(limit, "places and axes as causes")
        ):
            # Only then is it asked for places and axes: their columns are as many again.
            geometry = geometry_columns(equations)
            found = comparison.point
            if found.forces.filter is not None:  # beside other causes forces look filtered
                found = point.with_candidates(equations, kernels)
            comparison = likeliest(found.with_candidates(equations, geometry), comparison)
            result = inferred(comparison)
    except NO_MOTION:
        return None
    return comparison, result, asked


def _at_itself(
    point: Point,
    equations: LogEquations,
    comparison: HypothesisComparison,
    result: Inference,
    asked: bool,
    limit: TimeLimit | None,
    filtered: bool,
) -> Inference | None:
    """The result with causes that were found to first order, linearised at themselves."""
    try:
        chosen = comparison.posterior.best.chosen
        if chosen and asked and not _passed(limit, "causes linearised at themselves"):
            block = comparison.blocks[0]
            alone = block.projected.left(np.zeros_like(comparison.posterior.best.coefficients))
            first = comparison
            comparison = _with_further(_relinearised(comparison), comparison.point)
            comparison = _acting_as_in(comparison, comparison.posterior)
            causes, others = comparison.posterior, len(comparison.point.candidates)
            comparison = replace(comparison, posterior=steadfast(causes, comparison.blocks, others))
            built = comparison.point.built is not None
            result = replace(inferred(comparison), unbuilt=result if built else None, alone=alone)
            result = replace(result, zero=_zero_instead(first, comparison.posterior.best))
            without = _closing_alone(point, comparison)
            if without is not None:
                return inferred(without)
        # To first order other causes may explain what terms of one equation do.
        doubted = asked and chosen and not filtered and result.excess > KNOWN and not result.closes
        term = _term(point, equations) if doubted else None
        if term is not None:
            return inferred(term)
        forced = not filtered and _is_unexplained(point, result)
        return (_of_force(point, result) if forced else None) or _of_steps(comparison, result)
    except NO_MOTION:
        return None


def _is_unexplained(point: Point, result: Inference) -> bool:
    """Whether causes leave a tenth of the amplitude beyond the noise, in rows as the simulator made them."""
    run = point.run
    own = "u" not in run.provenance.derived and run.provenance.notes.get(ROWS) != INTERPOLATED
    return own and result.unnamed > PURE


def _of_force(point: Point, result: Inference) -> Inference | None:
    """The result with a force without a name, where causes leave most of it."""
    alone = compared(_without_causes(point))
    found = unknown_force(alone)
    if found is None:
        return None
    force, parts = found
    # Most of it may be named, and the rest of logged forces.
    exchanged, free = through_speeds(alone.point, result.residual)
    left = float(exchanged[free].sum())
    if left < np.sqrt(PURE) * force.exchanged:
        return None
    posterior = replace(result.posterior, best=alone.posterior.best, alternatives=())
    return replace(
        inferred(alone),
        force=force,
        attribution=parts,
        kernels=result.kernels,
        posterior=posterior,
        intermittent=(-np.inf, np.zeros(len(parts.t), dtype=np.bool_)),
        unexplained=0.0,
    )


def _term(point: Point, equations: LogEquations) -> HypothesisComparison | None:
    """The comparison with terms of single equations as the only causes, if these leave next to nothing."""
    speeds = equations.mechanism.speeds.names
    some = {(what, speed) for _, what in TERMS_OF_AN_EQUATION for speed in speeds}
    kernels = column_kernels(equations, some)
    if not kernels.columns:
        return None
    comparison = likeliest(point.with_candidates(equations, kernels))
    if not comparison.posterior.best.chosen:
        return None
    comparison = _relinearised(comparison)
    result = inferred(comparison)
    right = result.closes or result.excess <= KNOWN or 1.0 - result.explained <= SMALL_SHARE**2
    return comparison if right and result.posterior.best.chosen else None


def _without_causes(point: Point) -> Point:
    """The point of the model alone, without columns of causes."""
    none: tuple[tuple[ColumnKernels, ...], tuple[Candidate, ...]] = (), ()
    return replace(point, own=none, built=None, coefficients=np.zeros(0)).with_columns()


def _closing_alone(point: Point, found: HypothesisComparison) -> HypothesisComparison | None:
    """The comparison without causes where the right integrator needs none; else None.

    All columns of causes beside a method near the right one leave less than the right one alone, which is as
    likely. Or the rows follow within the noise by an unknown integrator, and do not beside the causes.
    """
    if found.blocks[0] is not found.rows or not found.posterior.best.chosen:
        return None
    alone = compared(_without_causes(point))
    if alone.excess <= KNOWN < found.excess:
        return alone
    if not alone.maps or alone.excess > 1.0:
        return None
    odds = _log_odds([found, alone])
    return alone if odds[0] < odds[1] + CERTAIN else None


def likeliest(point: Point, before: HypothesisComparison | None = None) -> HypothesisComparison:
    """The comparison of causes where logged forces act as is likeliest.

    What mistakes do looks like filters and those like mistakes: filters are asked for beside causes. Where a
    method closes the rows, forces act as they do in it. Beside the causes that were likeliest `before` of
    fewer, all of this was asked.
    """
    point = point.with_columns()
    asked = compared(point) if before and point.forces is before.point.forces else None
    if before and asked and before.posterior.best.alike(asked.posterior.best):
        return asked
    acting = with_likeliest_forces(point)
    comparison = asked if asked and acting is point else compared(acting)
    comparison, others = closed_by_other_forces(comparison, SAMPLE)
    if not comparison.closing:
        best = _in_equations(comparison)
        moved = comparison.point
        # Without causes they were asked already. How often they were held is told by a delay, step by step.
        moved = with_filter(with_likeliest_forces(moved, best) if best.chosen else moved, best)
        known = (one for one in others if one.at.point.forces.act_as(moved.forces))
        if moved is not comparison.point:
            comparison = next(known, None) or compared(moved)
    return _acting_as_in(comparison)


def _acting_as_in(
    comparison: HypothesisComparison, before: Posterior | None = None
) -> HypothesisComparison:
    """The comparison with forces that act as the method implies, where the rows do not show how they act.

    `before`: causes at which it is linearised.
    """
    if not comparison.maps or comparison.point.run.provenance.held is not None:
        return comparison
    method = comparison.methods[0]
    # Before causes are linearised at themselves, another method than the right one may leave less: only one
    # beside which the rows follow but for noise tells of forces.
    follows = comparison.excess <= KNOWN
    for function in ("smooth", "ramp") if method.samples_once or follows else ():
        moved = acting_as_in(comparison, function)
        if moved is comparison.point:
            break
        other = compared(moved, before)
        # The right method makes the same rows by them.
        same = other.maps and other.methods[0].name == method.name
        if same or (before is None and method.order == 1):
            return other
    return comparison


def _in_equations(comparison: HypothesisComparison) -> Fit:
    """The best causes that are of the equations, alone: what forces do is asked anew."""
    chosen = [c for c in comparison.posterior.best.chosen if c.kind not in OF_THE_LOG]
    fit = fitted(comparison.blocks, chosen) if chosen else None
    return fit or nothing(len(comparison.point.coefficients))


def _relinearised(comparison: HypothesisComparison) -> HypothesisComparison:
    """The comparison with causes linearised at themselves: what they do is not linear in their size.

    Causes of the geometry are built into the model. To first order one may look like another: each that does
    is built, and others are asked for beside the likeliest.
    """
    point, found = comparison.point.among(comparison.near), comparison.posterior
    rivals = _rivals(comparison)
    if not rivals or all(c.kind in OF_THE_LOG for c in found.best.chosen):
        return _at_causes(point, found) or comparison
    equal = _likely_rivals(point, rivals, (comparison.blocks[0].share_left(found.best), found))
    if not equal:
        return comparison
    # Of one cause in fewer and in more numbers the former.
    simplest = {
        tuple(c.what for c in one.posterior.best.chosen): one
        for one in sorted(equal, key=_rank)[::-1]
    }
    first, *others = sorted(simplest.values(), key=_rank)
    left = _left_to_first_order(comparison, first.posterior.best)
    for zero in _zeros(comparison) if left is not None else ():
        # What a zero does to third order is not in its columns.
        third = (zero.theta[0][0] ** 2 / 6.0) ** 2 * comparison.blocks[0].start
        if comparison.blocks[0].misfit(zero.coefficients) <= max(left, third):
            own = refitted(comparison.blocks, Posterior(zero, (), found.scores), ())
            return replace(comparison, posterior=own)
    others = [one for one in others if len(one.posterior.best.chosen) == 1]
    return _beside(_at_causes(point, first.posterior, first) or comparison, point, others)


def _zeros(comparison: HypothesisComparison) -> list[Fit]:
    """Zeros of the log that may be off: they do what turns of bodies do, and are not built."""
    scores, blocks = comparison.posterior.scores, comparison.blocks
    fits = [fitted(blocks, [c]) for _, c, _ in scores if c.kind == "zero-offset"]
    return [fit for fit in fits if fit is not None]


def _left_to_first_order(comparison: HypothesisComparison, best: Fit) -> float | None:
    """Sum of squares that a single cause leaves to first order; None for several."""
    same = [c for c in alike(comparison.point.candidates, best.chosen) if c is not None]
    fits = [fitted(comparison.blocks, [c]) for c in same]
    left = [comparison.blocks[0].misfit(fit.coefficients) for fit in fits if fit]
    return max(left, default=0.0) if len(best.chosen) == 1 else None


def _zero_instead(comparison: HypothesisComparison, best: Fit) -> Fit | None:
    """The zero of a coordinate that may do what a cause does, as far as squares of its size leave that open.

    Rows of which that zero is put right decide.
    """
    block, left = comparison.blocks[0], _left_to_first_order(comparison, best)
    if left is None or any(c.kind in OF_THE_LOG for c in best.chosen):
        return None
    for zero in _zeros(comparison):
        squares = zero.theta[0][0] ** 2 * np.sqrt(block.start)
        if block.misfit(zero.coefficients) <= (np.sqrt(left) + squares) ** 2:
            return zero
    return None


Rival: TypeAlias = tuple[float, Posterior]
"""Share of the amplitude that causes leave to first order, and the causes."""


def _likely_rivals(
    point: Point, rivals: Sequence[Rival], found: Rival
) -> list[HypothesisComparison]:
    """The likeliest of the rivals and of what was found, where they are built.

    Most rivals are excluded by a sample of the rows. Where all that remain leave nothing in the sample, only
    the first of them is built in all rows.
    """
    several = len(rivals) > TOGETHER and len(point.log.intervals) >= 2 * SAMPLE
    few = list[tuple[float, HypothesisComparison]]()
    if several and point.forces.filter is None:
        with suppress(*NO_MOTION):
            few = _built(point.sampled(SAMPLE), rivals)
    likely = sorted(_likeliest([one for _, one in few]), key=_rank)
    best = found[1].best
    if len(best.chosen) > 1 or any(one.posterior.best.alike(best) for one in likely):
        nothing_left = [(0.0, one.posterior) for one in likely[:1] if _nothing_left(one)]
        for _, first in _built(point, nothing_left):
            if _nothing_left(first):
                return [first, *likely[1:]]
    some = [(left, one.posterior) for left, one in few if one in likely] or list(rivals)
    if not any(one.best.alike(best) for _, one in some):
        some = sorted([*some, found], key=_by_left)
    return _likeliest([one for _, one in _built(point, some)])


def _built(point: Point, rivals: Sequence[Rival]) -> list[tuple[float, HypothesisComparison]]:
    """Rivals that settle where they are built, each by its own columns, with what they leave to first order.

    Once the rows follow beside a rival, those of as many causes are left out that leave much more to first
    order than it did, and more than squares of their numbers could. So are several causes that leave more
    than a single one which explains all but noise: none of them does the same as that.
    """
    settled, least = list[tuple[float, HypothesisComparison]](), dict[int, float]()
    single = np.inf
    for left, one in rivals:
        causes = list(zip(one.best.chosen, one.best.theta, strict=True))
        squares = max(c.squares(x) for c, x in causes)
        simpler = min((x for k, x in least.items() if k <= len(causes)), default=np.inf)
        if left > simpler / ROUGHLY + squares or (len(causes) > 1 and left > single):
            continue
        own = _settled(point.narrowed(one), one, True)
        if own is not None and own.posterior.best.chosen:
            settled.append((left, own))
            noise = _nothing_left(own) or own.excess <= 1.0
            if noise and len(causes) == 1:
                single = min(single, left)
            if noise or own.excess <= KNOWN:
                least.setdefault(len(causes), left)
    return settled


def _likeliest(built: Sequence[HypothesisComparison]) -> list[HypothesisComparison]:
    """Those that leave nothing, by a known method if there is one, or else those as likely as the best.

    What leaves more than noise is not likely where another does not.
    """
    equal = [one for one in built if _nothing_left(one)]
    if equal or not built:
        return [one for one in equal if one.maps] or equal
    if min(one.excess for one in built) <= 1.0:
        built = [one for one in built if one.excess <= KNOWN]
    odds = _log_odds(built)
    return [one for one, x in zip(built, odds, strict=True) if x > odds.max() - CERTAIN]


def _rank(comparison: HypothesisComparison) -> tuple[int, int]:
    """Numbers of the causes, and their rank: the smallest are preferred."""
    best = comparison.posterior.best
    numbers = sum(c.size for c in best.chosen)
    return numbers, sum(c.rank(x) for c, x in zip(best.chosen, best.theta, strict=True))


def _nothing_left(comparison: HypothesisComparison) -> bool:
    """Whether the causes leave what digits alone make."""
    block = comparison.blocks[0]
    return block.misfit(comparison.posterior.best.coefficients) <= KNOWN * block.least


def _log_odds(comparisons: Sequence[HypothesisComparison]) -> Array:
    """Log evidence of each, integrator and noise included, with the autocorrelation time of the likeliest.

    What a wrong one leaves is no noise: it may be as slow as the motion, and would discount the rows of all.
    """

    def evidence(tau: float) -> Array:
        each = [(one.blocks[0], one.posterior.best) for one in comparisons]
        return np.array([block.evidence(best, tau) - block.spread / tau for block, best in each])

    return evidence(comparisons[int(np.argmax(evidence(1.0)))].tau)


def _at_causes(
    point: Point, found: Posterior, near: HypothesisComparison | None = None
) -> HypothesisComparison | None:
    """The comparison at causes that were found elsewhere; None where they do not move, or are not told apart.

    Their numbers settle by their own columns first, from where they were compared by these if they were: all
    others cost several times as much.
    """
    alone = near
    if near is None or not _nothing_left(near):
        alone = _settled(near.point if near else point.narrowed(found), found)
    if alone is None or not alone.posterior.best.chosen:
        return _settled(point, found)
    acting = _by_other_forces(alone)
    moved = None if acting is alone else _settled(acting.point, acting.posterior)
    if moved is not None and moved.posterior.best.chosen:
        alone = moved
        point = point.with_flow(forces=moved.point.forces).with_noise_of_rows()
    return _settled(point, alone.posterior, True)


def _by_other_forces(built: HypothesisComparison) -> HypothesisComparison:
    """The comparison at the same causes where all forces act in the likeliest way of those that are usual.

    How they act was told to first order beside causes that had not settled. A method that takes the force of
    a row alone and an unknown one beside smooth forces are far from each other.
    """
    point = built.point
    if _nothing_left(built) or point.forces.filter is not None or point.forces_known:
        return built
    tried = [built]
    for kind in ("smooth", "ramp", "start"):
        forces = point.forces.alike(kind)
        if forces.kinds != point.forces.kinds:
            moved = point.with_flow(forces=forces).with_noise_of_rows().with_process_noise()
            tried.append(compared(moved, built.posterior))
    return _likelier(*(one for one in tried if one.posterior.best.alike(built.posterior.best)))


def _likelier(*comparisons: HypothesisComparison) -> HypothesisComparison:
    """The first of several comparisons, or that which is certainly likelier than it."""
    odds = _log_odds(comparisons)
    return comparisons[int(np.argmax(odds)) if odds.max() > odds[0] + CERTAIN else 0]


def _settled(point: Point, found: Posterior, rival: bool = False) -> HypothesisComparison | None:
    """The same by the columns of the point alone, linearised at the causes until their numbers settle.

    It goes on as long as a step takes away more than it leaves, and the one before did, or was beside another
    method: what it leaves then is no curvature. A `rival` goes no further.
    """
    moved, reached, earlier = None, np.inf, set[tuple[str, ...]]()
    try:
        for turn in count():
            before, closing = (moved.posterior, moved.methods) if moved else (found, ())
            if not _late_forces(point, before.best) and all(
                c.kind in OF_THE_LOG for c in before.best.chosen
            ):
                break
            own = _linearised(point, before, closing if turn > 1 else ())
            if own is None:
                return None
            moved, point, best = own, own.point, own.posterior.best
            block = own.blocks[0]
            left, start = (block.misfit(x) for x in (best.coefficients, point.coefficients))
            # Sums of squares beside different methods do not compare, and two methods may alternate.
            names = tuple(method.name for method in own.methods)
            halved = 2.0 * left <= start and (2.0 * start <= reached or names not in earlier)
            last = rival or turn + 1 >= RELINEARISATIONS or before.best.settled(best)
            reached = start
            earlier.add(names)
            closed = start <= KNOWN * block.least
            # Rows that an unknown integrator closes may be closed by a method once causes are built in.
            unknown = closed and not own.maps and not turn
            if not unknown and (closed or (last and not halved)):
                break
    except NO_MOTION:
        return None
    return moved


def _linearised(
    point: Point, found: Posterior, methods: tuple[Integrator, ...] = ()
) -> HypothesisComparison | None:
    """The comparison linearised at causes; None where these are not told apart there."""
    for delay, spread in _late_forces(point, found.best):
        if abs(delay) > WITHIN_A_ROW * point.log.step or point.forces.filter is not None:
            point = point.filtered(delay, spread)
    point = point.with_causes(found.best, methods)
    if point.forces.filter is not None:
        point = point.with_process_noise()
    there = point.named(found)
    if not there.best.chosen:
        return None
    moved = compared(point, there)
    if not _nothing_left(moved):  # beside wrong equations, forces looked otherwise between rows
        acting = with_likeliest_forces(point, moved.posterior.best)
        if acting is not point:
            # To first order they may look likelier than they are.
            moved = _likelier(moved, compared(acting, moved.posterior))
    best = moved.posterior.best
    return moved if len(best.each) == len(best.chosen) else None


def _rivals(comparison: HypothesisComparison) -> list[Rival]:
    """Causes that explain most of what is left to first order, of each the likeliest in so many numbers.

    Those of the geometry, and mistakes that were made several times; with the share of the amplitude that
    they leave.
    """
    point, block, scores = comparison.point, comparison.blocks[0], comparison.posterior.scores
    ways = [(comparison.at, block)]
    if point.model.n == len(point.model.mechanism.free.u) and not _nothing_left(comparison):
        at = regression(point.with_measured_columns())
        ways.append((at, at.series))
    rivals = dict[tuple[object, ...], Rival]()

    def add(own: Block, fit: Fit, *what: object) -> None:
        share = own.share_left(fit)
        if share < (rivals[what][0] if what in rivals else np.sqrt(SLIGHT)):
            rivals[what] = share, Posterior(fit, (), ())

    for way, own in ways:
        for one in mistakes_of_one_kind(way, own):
            add(own, one.best, *(c.name for c in one.best.chosen))
    whats = {c.what for _, c, _ in scores if c.kind not in OF_THE_LOG}
    built = any(c.edit is not None for _, c, _ in scores)
    for c in (c for c in point.candidates if c.what in whats) if built else ():
        fit = fitted(comparison.blocks, [c])
        if fit is not None and c.plausible(fit.theta[0]):
            add(block, fit, *c.what, c.size)
    return sorted(rivals.values(), key=_by_left)


def _by_left(rival: Rival) -> float:
    """Sort key of rivals, by what they leave to first order: a cause more has to leave less."""
    return rival[0] * len(rival[1].best.chosen)


def _beside(
    built: HypothesisComparison, point: Point, equal: Sequence[HypothesisComparison]
) -> HypothesisComparison:
    """The comparison of further causes beside one that is built; others that were built explain as much."""
    best = built.posterior.best
    if len(best.chosen) != 1:
        return built
    of_geometry = best.chosen[0].edit is not None
    some = np.flatnonzero(best.coefficients)
    others = [] if of_geometry else list(built.posterior.alternatives)
    for one in equal:
        fit = one.posterior.best
        (c,), (x,) = fit.chosen, fit.theta
        # It does the same to the rows.
        along = np.outer(best.coefficients[some], x) / float(x @ x)
        same = replace(c, columns=tuple(map(int, some)), linear=along, quadratic=None)
        tangent = np.zeros((len(best.coefficients), c.size))
        tangent[some] = along
        others.append(replace(fit, chosen=(same,), coefficients=best.coefficients, tangent=tangent))
    return replace(built, posterior=replace(built.posterior, alternatives=tuple(others)))


def _with_further(built: HypothesisComparison, point: Point) -> HypothesisComparison:
    """The comparison with causes beside those found that the squares of these have hidden."""
    if not point.forces.act_as(built.point.forces) and built.point.forces.filter is None:
        point = point.with_flow(forces=built.point.forces).with_noise_of_rows()
    for _ in range(RELINEARISATIONS):
        block, best = built.blocks[0], built.posterior.best
        if not best.chosen or _nothing_left(built) or built.closing or built.excess <= KNOWN:
            break
        own = {c.name for c in best.chosen}
        sets = [*mistakes_of_one_kind(built.at, built.rows), searched(built.at, block, start=best)]
        more = [
            (block.share_left(x.best), x) for x in sets if own < {c.name for c in x.best.chosen}
        ]
        tried = list[HypothesisComparison]()
        for _, found in sorted(more, key=_by_left):
            one = _at_causes(point, found)
            tried += [] if one is None else [one]
            if one is not None and _nothing_left(one):
                break
        likelier = _likelier(built, *tried)
        if likelier is built:
            break
        built = likelier
    return built


def _late_forces(point: Point, best: Fit) -> list[tuple[float, float]]:
    """Delays and deviations (s) of a filter of the forces, as causes of a fit say."""
    # The delay of a motor that is the only one is that of all forces.
    single = sum(c.what == "delay" and c.index == 0 for c in point.whats) == 1
    kinds = OF_DELAYS if single else OF_DELAYS[:1]
    least = point.log.step**2 / 12.0  # what is held over a step is spread so much
    each = zip(best.chosen, best.theta, strict=True)
    late = [(x[0], x[-1] if len(x) > 1 else x[0] ** 2) for c, x in each if c.kind in kinds]
    return [(float(d), float(np.sqrt(max(s - d**2, least)))) for d, s in late]


def _of_steps(comparison: HypothesisComparison, result: Inference) -> Inference:
    """The result, with what is left as errors of steps where most of it is of no force.

    A force moves coordinates by what it moves speeds, times half the interval. Errors of a step that an
    adaptive method chose, or of the polynomial in it, move each on its own.
    """
    rows, best, point = comparison.rows, result.posterior.best.coefficients, comparison.point
    whole, rest = (rows.projected.left(x) for x in (0.0 * best, best))
    named = rest - rows.count < SLIGHT * whole
    generic = result.generic  # terms of a model do not explain all that errors of steps leave
    named |= generic.share > 1.0 - SMALL_SHARE
    if named or point.log.unknown.any() or comparison.blocks[0] is not rows:
        return result
    left, of_flow = (squares(point, x).sum() for x in (result.residual, result.w))
    if comparison.maps and left <= SMALL_SHARE**2 * of_flow:
        return result  # what the solver of an implicit method leaves of its equations
    if not _of_no_force(point, result.residual):
        return result
    none = replace(result.posterior, best=nothing(len(best)), alternatives=())
    if comparison.excess > KNOWN:  # steps of many sizes are of no fixed method
        comparison = replace(comparison, maps=(), rows=comparison.series)
    of_steps = inferred(replace(comparison, posterior=none), scattered=True)
    if result.tau > WHITE:  # what steps do in several rows, causes imitate
        return of_steps
    parts, of_causes = of_steps.attribution, result.attribution.equations.curve
    error = np.hypot(parts.integrator.curve_error, of_causes)
    parts = replace(parts, integrator=replace(parts.integrator, curve_error=error))
    disputed = max(of_steps.disputed, float(np.abs(of_causes).max()))
    return replace(of_steps, attribution=parts, disputed=disputed)


def inferred(
    comparison: HypothesisComparison, scattered: bool = False, agreed: bool = False
) -> Inference:
    """What a comparison says of a log.

    `scattered`: what is left is of steps of many sizes, but for blows, unless accelerations `agreed`.
    """
    at, point, posterior = comparison.at, comparison.point, comparison.posterior
    tau, log, best = comparison.tau, point.log, posterior.best
    curves = log.running(at.power[:, at.fields :])
    unseen = unseen_joules(point, comparison.blocks[0], best, tau, curves)
    integrator = integrator_estimate(comparison)
    disputed = np.zeros(len(at.B)) if agreed else disputed_joules(comparison, scattered)
    share, residual, between = integrator_share(comparison, disputed)
    equations = equations_share(comparison, residual, unseen)
    attribution, left = attributed(comparison, share, equations)
    unexplained = float(left.max(initial=0.0))
    generic = generic_equations(comparison)
    odds, active = intermittent_force(comparison, residual)
    if scattered:
        attribution, blows = of_scattered_steps(comparison, attribution, residual, disputed, agreed)
        unexplained, active = float(np.abs(blows).sum()), active & (blows != 0.0)
        generic = replace(generic, log_odds=-np.inf)
        integrator = replace(integrator, names=("adaptive",))
    else:
        attribution = with_unexplained(attribution, left)
    exchanged, errors, energy = at.exchanged(best)
    return Inference(
        model=point.model,
        log=log,
        kernels=point.kernels,
        forces=point.forces.kinds,
        filter=point.forces.filter,
        methods=comparison.methods,
        blocks=comparison.blocks,
        measured=comparison.blocks[0] is not comparison.rows,
        posterior=posterior,
        candidates=point.candidates,
        integrator=integrator,
        attribution=attribution,
        tau=tau,
        excess=comparison.excess,
        whole=log.whole,
        exchanged=exchanged,
        exchanged_error=errors * np.sqrt(tau),
        energy=energy,
        generic=generic,
        unexplained=unexplained,
        intermittent=(odds, active),
        disputed=float(np.abs(disputed).max()),
        unseen=unseen,
        speeds_known=comparison.speeds_known,
        between=between,
        switching=bool(point.forces.switching.any()),
        lost=bool(point.lost.any()) and any(kind != "start" for kind in point.forces.kinds),
        scattered=scattered,
        residual=residual,
        acceleration=point.model.at(point.flow.nodes[0]),
        w=point.w,
        steps=point.flow.w - comparison.effects - (0.0 if scattered else residual),
        gradient=at.gradient,
    )
