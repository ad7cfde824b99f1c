"""ΔC in joules of the integrator, of mistakes in the equations, and of the log.

Along the rows each field does the work ∫(∂E/∂x)·F dt. What the integrator's fields and the mistakes' do not
make of ΔC is of the log: noise and digits of its rows, and what forces did between them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import SIX_DIGITS, Array
from deltac.diagnosis.causes.causes import Candidate
from deltac.diagnosis.inference.comparison import HypothesisComparison
from deltac.diagnosis.inference.fields import FIELDS, FIRST_ORDER, PRIOR
from deltac.diagnosis.inference.forces import HELD, InterpolatedForces
from deltac.diagnosis.inference.hypotheses import (
    CERTAIN,
    SIGNIFICANT,
    Block,
    Fit,
    autocorrelation_time,
    beyond_causes,
    deviation,
    intermittent,
)
from deltac.diagnosis.inference.integrators import (
    EXACT,
    INTEGRATORS,
    USUAL,
    Integrator,
    IntegratorEstimate,
    Map,
    estimate,
    identified,
    maps,
    numbers_of,
)
from deltac.diagnosis.inference.linearisation import Point
from deltac.diagnosis.inference.methods import FAR, as_likely
from deltac.diagnosis.inference.model import Intervals, Rows
from deltac.diagnosis.inference.observations import Observations
from deltac.diagnosis.inference.result import (
    KNOWN,
    OF_THE_LOG,
    Attribution,
    Generic,
    Share,
    UnknownForce,
)

HALF = 0.6
"""Standard deviation of what forces do between rows that a method does not see, in units of what others
would: two of them hold either, with a fifth to spare for what is not linear in it."""


def integrator_estimate(comparison: HypothesisComparison) -> IntegratorEstimate:
    """The integrator, by methods whose maps close the rows, or by its numbers."""
    log = comparison.point.log
    if comparison.maps:
        step = float(np.median(log.intervals.h[:, 0] / comparison.counts))
        others = (of.method for of, _ in _other_states(comparison))
        return identified((*comparison.methods, *others), step)
    c, covariance = comparison.numbers
    some = slice(0, len(FIELDS))
    return estimate(c[some], covariance[some, some], comparison.point.flow.plant.damped, log.step)


def integrator_share(
    comparison: HypothesisComparison, disputed: Array
) -> tuple[Share, Array, float]:
    """The integrator's share of ΔC, what neither it nor the causes do to the rows (N, 2n), and an error.

    The latter is that of the share by forces between the rows. `disputed` joules (N,) may be a mistake's.
    """
    at, log, flow = comparison.at, comparison.point.log, comparison.point.flow
    share, residual, between = (_of_methods if comparison.maps else _of_series)(comparison)
    share, residual = _with_corrections(comparison, share, residual)
    defects = flow.w - residual - comparison.effects
    share = _on_path(comparison, share, defects, residual)
    gaps = log.in_gaps(at.work(defects))
    # Of two flows of order 8 the finer is off by 2⁻⁸ of their difference, unless that is no smaller than what
    # the rows depart by: near singular positions no step is short enough.
    error = flow.prediction.error
    error = np.where(2.0 * error > np.abs(flow.w), error, 2.0**-8 * error)
    of_flow = np.cumsum(np.einsum("km,km->k", np.abs(at.gradient), error))
    each = np.stack([share.curve_error, gaps, of_flow, disputed])
    return Share(share.curve, np.linalg.norm(each, axis=0)), residual, between


def _with_corrections(
    comparison: HypothesisComparison, share: Share, residual: Array
) -> tuple[Share, Array]:
    """The share with what keeps the constraints, as a part of the step, and the residual (N, 2n) without it.

    Projections move states by M⁻¹Gᵀ λ. So does noise of the rows, which does not add up, and that of forces,
    which does: joules are shrunk by the share of their largest square that `SIGNIFICANT` standard errors of
    both explain.
    """
    at, log, across = comparison.at, comparison.point.log, comparison.across
    if across is None:
        return share, residual
    correction = (across @ residual[:, :, None])[:, :, 0]
    curve = log.running(at.work(correction))
    gradient, unknown = (at.gradient[:, None] @ across)[:, 0], comparison.point.noise
    of_rows = np.sum((gradient * log.noise[1]) ** 2, axis=1)
    of_forces = np.einsum("km,kmn,kn->k", gradient, unknown.own + unknown.doubt, gradient)
    noise = np.sqrt(of_rows + of_rows[0] + np.cumsum(np.maximum(of_forces, 0.0))) + 1e-300
    seen = float(np.max((curve / (SIGNIFICANT * noise)) ** 2))
    real = 1.0 - 1.0 / max(seen, 1.0)
    errors = share.curve_error, real * noise, real * (1.0 - real) * curve
    error = np.linalg.norm(errors, axis=0)
    return Share(share.curve + real * curve, error), residual - real * correction


def _of_methods(comparison: HypothesisComparison) -> tuple[Share, Array, float]:
    """The share of methods whose maps close the rows."""
    at, point = comparison.at, comparison.point
    log, defects, methods = point.log, comparison.defects, comparison.methods
    others, flow = _other_states(comparison), point.flow
    defects = [*defects, *(flow.plant.difference(flow.at(own).end, of.end) for of, own in others)]
    across = comparison.across
    if across is not None:  # methods do not differ there: solvers put that right
        apart = [x - defects[0] for x in defects]
        defects = [defects[0] + x - (across @ x[:, :, None])[:, :, 0] for x in apart]
    curves = log.running(np.stack([at.work(x) for x in defects], axis=1)).T
    # Methods that close the rows alike do not make the same joules; nor do forces between rows of which a
    # method takes one alone.
    forces = [curves[0] + x for x in _other_forces(comparison)]
    if _exact_by_other_forces(comparison):
        forces.append((1.0 - HALF) * curves[0])
    near = [log.running(at.work(x)) for x in _near_methods(comparison)]
    between = float(np.abs(forces - curves[0]).max(initial=0.0)) if forces else 0.0
    spread = np.abs(np.stack([*curves, *forces, *near]) - curves[0]).max(axis=0)
    residual = flow.w - defects[0] - comparison.effects
    # Where they leave more than the rows' noise, the rest may be the integrator's, or lost forces'.
    lost = (comparison.counts > 1) | point.forces.switching.any(axis=1)
    known = np.where(log.unknown | lost[:, None], 0.0, at.gradient)
    # Noise of rows does not add up: what the one adds the next takes away.
    rest = np.maximum.accumulate(np.abs(np.cumsum(np.einsum("km,km->k", known, residual))))
    beyond = np.sqrt(max(1.0 - 1.0 / max(comparison.excess, 1.0), 0.0)) * rest
    if methods[0] is EXACT:
        # Errors that are not seen may be of any size that the fields of an integrator may have.
        some = slice(0, len(FIELDS))
        C = comparison.series.numbers(comparison.posterior.best)[1][some, some]
        T = log.running(at.power[:, some])
        variance = np.maximum(np.einsum("ki,ij,kj->k", T, C, T), 0.0)
        beyond = np.hypot(beyond, np.sqrt(variance))
    return Share(curves[0], np.hypot(spread, beyond)), residual, between


def _of_series(comparison: HypothesisComparison) -> tuple[Share, Array, float]:
    """The share of an unknown integrator by its fields, and by what their series leaves out."""
    at, point, fields = comparison.at, comparison.point, comparison.at.fields
    log, unknown, beyond = point.log, point.noise, point.noise.beyond
    c, covariance = comparison.numbers
    residual = point.flow.w - at.B[:, :, :fields] @ c - comparison.effects
    # What the series leaves out is the integrator's too: as much of what is left as is likely.
    noise = log.noise[0] ** 2 + log.noise[1] ** 2
    noise += np.einsum("kii->ki", unknown.own + unknown.doubt)
    own = beyond**2 / (beyond**2 + noise + 1e-300) / max(comparison.excess, 1.0)
    if log.unknown.any():
        own = np.zeros_like(own)
    partly = at.gradient * (1.0 - own)
    curves = log.running(np.einsum("km,kmp->kp", partly, at.B[:, :, :fields]))
    late = at.work(own * residual)
    curve = log.running(at.power[:, :fields]) @ c + log.running(late)
    # Or it is of something else that the series hides.
    either = np.cumsum(np.abs(late))
    if log.unknown.any():
        rate = _of_rates_of_q(point, log)
        curves[:, 0] += rate
        curve += rate * c[0]
    spread = np.maximum(np.einsum("ki,ij,kj->k", curves, covariance, curves), 0.0)
    # The order beyond the series is no noise: its joules grow with the motion, hidden in noise.
    most = np.cumsum(np.einsum("km,km->k", np.abs(at.gradient), np.sqrt(noise)))
    order = np.minimum(at.remainder(comparison.rows) * np.linspace(0.0, 1.0, len(most)), most)
    rest = np.cumsum(np.einsum("km,km->k", partly**2, beyond**2))
    error = np.sqrt(spread + order**2 + rest * comparison.tau + either**2)
    return Share(curve, error), (1.0 - own) * residual, 0.0


def disputed_joules(comparison: HypothesisComparison, scattered: bool) -> Array:
    """Joules (N,) of the integrator's fields that a mistake may have made which does about the same to rows.

    It takes of them what its number within its error does, at most what the nearest method does not explain;
    all of that where it exceeds what integrators have, by their prior. Steps of many sizes, `scattered`, are
    of methods of a higher order: what is certainly of the first is none of theirs.
    """
    at, first = comparison.at, slice(0, FIRST_ORDER)
    if comparison.maps:
        return np.zeros(len(at.B))
    T, best = comparison.point.log.running(at.power[:, first]), comparison.posterior.best
    block, (numbers, covariance) = comparison.blocks[0], comparison.numbers
    c = numbers[first]
    if scattered:
        variance = np.maximum(np.einsum("ki,ij,kj->k", T, covariance[first, first], T), 0.0)
        error = np.sqrt(variance)
        return np.asarray(np.maximum(np.abs(T @ c) - SIGNIFICANT * error, 0.0))
    p, of_fields = block.projected, comparison.rows.projected
    # Of rows that are several steps apart the numbers are parts of those of the step.
    rays = [own for own in (numbers_of(m)[first] for m in INTEGRATORS) if own.any()]
    near = [np.clip(c @ own / (own @ own), 0.0, 1.0) * own for own in rays]
    rest = min((c - own for own in near), key=np.linalg.norm)
    if np.linalg.norm(rest) > SIGNIFICANT * PRIOR[1]:
        return np.abs(T @ rest)
    most = np.zeros(len(T))
    for cause in of_one_number(comparison.point.candidates):
        if any(cause is x or cause.excludes(x) for x in best.chosen):
            continue
        L, some = cause.linear[:, 0], np.array(cause.columns)
        sigma = deviation((block,), cause, best, comparison.tau)
        size = float(L @ p.A[np.ix_(some, some)] @ L)
        if not np.isfinite(sigma) or not size > 0.0:
            continue
        number = np.hypot(L @ p.slope(best.coefficients, some) / size, sigma)
        most = np.maximum(most, number * np.abs(T @ (of_fields.to[first][:, some] @ L)))
    return np.minimum(np.abs(T @ rest), most)


def equations_share(
    comparison: HypothesisComparison, residual: Array, unseen: dict[str, float]
) -> Share:
    """The share of mistakes in the equations."""
    at, point, posterior = comparison.at, comparison.point, comparison.posterior
    effects = comparison.effects
    mistake = _on_path(comparison, _of_causes(comparison, posterior.best), effects, residual)
    # Sets of causes that explain as much do other joules, and one that is not seen may do some.
    sets = [_of_causes(comparison, fit).curve for fit in posterior.alternatives]
    spread = np.abs([x - mistake.curve for x in (mistake.curve, *sets)]).max(axis=0)
    sizes = np.minimum(list(unseen.values()), point.energy)
    hidden = float(np.sqrt(np.mean(sizes**2))) if len(sizes) else 0.0
    grown = np.linspace(0.0, hidden, len(spread))
    work, off = point.work_of_causes
    gaps = point.log.in_gaps(at.work(effects) + work)
    each = np.stack([mistake.curve_error, spread, grown, gaps, point.log.running(off)])
    error = np.linalg.norm(each, axis=0)
    return Share(mistake.curve, error)


def attributed(
    comparison: HypothesisComparison, integrator: Share, equations: Share
) -> tuple[Attribution, Array]:
    """ΔC of the rows in three shares, the log's being the rest; and joules (N,) that nothing explains."""
    at, point = comparison.at, comparison.point
    log, model, noise = point.log, point.model, point.noise
    # What states depart by, with forces that were filtered, and what causes work until then.
    departures = point.flow.w + model.difference(point.as_logged.end, point.nominal.end)
    jump = at.work(departures) + point.work_of_causes[0]
    of_ends = log.noise_of_steps if comparison.speeds_known else log.noise[1]
    of_rows = np.einsum("km,km->k", at.gradient**2, of_ends**2)
    rows = np.sqrt(of_rows + of_rows[0])
    Q = noise.own * max(comparison.excess, 1.0) + noise.doubt
    # Where an interval adds nothing, rounding may make of it a little less.
    unknown = np.maximum(np.einsum("km,kmn,kn->k", at.gradient, Q, at.gradient), 0.0)
    rest = log.running(jump) - integrator.curve - equations.curve
    error = np.hypot(rows, np.sqrt(np.cumsum(unknown) * comparison.tau))
    changed = np.where(point.forces.switching, point.forces.logged.change, 0.0) / np.sqrt(12.0)
    if changed.any():  # all of them perhaps earlier, or later, than in the middle of two rows
        moved = point.flow.moved_by_forces(np.stack([changed] * 5))
        error = np.hypot(error, np.abs(log.running(at.work(moved))))
    of_log = _of_causes(comparison, comparison.posterior.best, of_log=True).curve
    unexplained = np.maximum(np.abs(rest - of_log) - SIGNIFICANT * error, 0.0)
    return Attribution(log.intervals.end.t, integrator, equations, Share(rest, error)), unexplained


def with_unexplained(parts: Attribution, unexplained: Array) -> Attribution:
    """The attribution where joules (N,) that nothing explains may be the integrator's or the log's."""
    integrator, log = (
        Share(share.curve, np.hypot(share.curve_error, unexplained))
        for share in (parts.integrator, parts.log)
    )
    return replace(parts, integrator=integrator, log=log)


GROWTH = 2.0
"""By how much more errors that add up are over half of a log than over times in which noise is forgotten."""


def _of_scatter(work: Array) -> Array:
    """Standard error (N,) of running sums of work (N,), J: of each step where errors of steps add up.

    Noise that went through a filter comes and goes: what is no more over half of the log than over times in
    which that is forgotten is all noise.
    """
    curve, half = np.cumsum(work), len(work) // 2
    lag = min(int(np.ceil(3.0 * autocorrelation_time(work[:, None]))), half)
    near, far = (np.mean((curve[k:] - curve[:-k]) ** 2) for k in (lag, half))
    if far < GROWTH**2 * near:
        return np.asarray(np.sqrt(near) + np.abs(curve))
    return np.full(len(work), np.sqrt(2.0 * np.mean(work**2)))


def of_scattered_steps(
    comparison: HypothesisComparison,
    parts: Attribution,
    residual: Array,
    disputed: Array,
    agreed: bool,
) -> tuple[Attribution, Array]:
    """The attribution where what is left is of steps of many sizes, but for blows (N,), J.

    The joules of blows, if there are any, may be of something that the model lacks; unless accelerations
    `agreed` with it.
    """
    work = comparison.at.work(residual)
    large = (work**2 > FAR * np.median(work**2)) & (not agreed)
    blows = np.where(large, work, 0.0)
    best = comparison.posterior.best
    of_log = _of_causes(comparison, best, of_log=True).curve + np.cumsum(blows)
    # It is all that the balance leaves. Noise comes and goes in that and in what the series leaves of it.
    curve = parts.integrator.curve + parts.log.curve - of_log
    each = np.minimum(*map(_of_scatter, (work - blows, np.diff(curve, prepend=0.0))))
    own, log = parts.integrator.curve_error, parts.log.curve_error
    bars = [own, log, each + disputed, np.cumsum(np.abs(blows))]
    integrator = Share(curve, np.linalg.norm(bars, axis=0))
    return replace(parts, integrator=integrator, log=replace(parts.log, curve=of_log)), blows


def _of_causes(comparison: HypothesisComparison, fit: Fit, of_log: bool = False) -> Share:
    """ΔC's share of the causes that are of the equations, or of the log: delays and zeros."""
    at, point = comparison.at, comparison.point
    power, chosen, log = at.power[:, at.fields :], fit.chosen, point.log
    own = [(c.kind in OF_THE_LOG) == of_log for c in chosen]
    if not any(own) and not (of_log and point.forces.filter is not None):
        return Share(np.zeros(len(power)), np.zeros(len(power)))
    some = np.repeat(own, [c.size for c in chosen]).astype(bool)
    T = log.running(power @ fit.tangent)[:, some]
    C = fit.covariance[np.ix_(some, some)] * comparison.tau
    spread = np.maximum(np.einsum("ki,ij,kj->k", T, C, T), 0.0)
    coefficients = np.zeros_like(fit.coefficients)
    for k, c in enumerate(chosen):
        if own[k]:
            np.add.at(coefficients, list(c.columns), fit.of(k))
    known = np.where(point.of_equations != of_log, point.coefficients, 0.0)
    # What the causes do that the flow has is known however large it is, the rest to first order.
    if of_log:
        work = at.work(point.model.difference(point.as_logged.end, point.nominal.end))
    else:
        work = point.work_of_causes[0]
    curve = log.running(power @ (coefficients - known) + work)
    return Share(curve, np.sqrt(spread))


def _on_path(
    comparison: HypothesisComparison, share: Share, defects: Array, residual: Array
) -> Share:
    """A share with the errors of its weights, and of the path.

    As much of the share as of the motion is not known: a defect on another path is another one.
    """
    at, log = comparison.at, comparison.point.log
    motion = comparison.point.model.difference(log.intervals.start, log.intervals.end)
    unknown, known = (np.sum(np.abs(at.gradient * x)) for x in (residual, motion))
    doubt = min(float(unknown / max(known, 1e-300)), 1.0)
    slack = log.running(np.einsum("km,km->k", at.weights[1], defects))
    error = np.sqrt(share.curve_error**2 + (doubt * share.curve) ** 2 + slack**2)
    return Share(share.curve, error)


# --- a force that no cause explains ---

PURE = 0.01
"""Square of what coordinates depart by otherwise than by a force, in units of both squares, up to which rows
depart by a force alone: a tenth of the amplitude."""


def unknown_force(comparison: HypothesisComparison) -> tuple[UnknownForce, Attribution] | None:
    """The force by which most rows depart, with ΔC by it; None where they depart otherwise.

    A force that is smooth in a step moves coordinates by what it moves speeds, times half of the step, or as
    much as a method of first order does. So do filters. Logged forces may be wrong in the log: what counts is
    where none acts.
    """
    at, point = comparison.at, comparison.point
    log, model, flow = point.log, point.model, point.flow
    n, h, counts = model.n, log.intervals.h, flow.counts
    if log.unknown.any() or point.forces.filter is not None:
        return None
    if model.rows_of_G or n < len(model.mechanism.speeds):
        return None  # solvers keep constraints by forces of their own, and laws of time may be late
    single = counts is not None and counts.max() == 1
    least, of, own, other = np.inf, flow.exact, flow.w, flow.w[:, :n]
    for one in flow.maps:
        if one.method is not EXACT and not (single and one.method.order == 1):
            continue
        w, share = flow.plant.difference(one.end, log.intervals.end), _share_of_q(one.method)
        ratio = np.median(otherwise_than_by_force(point, w, 1.0, share))
        if ratio < least:
            least, of, own, other = float(ratio), one, w, w[:, :n] - share * h * w[:, n:]
    if least > PURE:
        return None
    exchanged, free = through_speeds(point, own)
    if not exchanged[free].sum() > 0.5 * exchanged.sum():
        return None
    exchanged = exchanged * free
    k = int(np.argmax(exchanged))
    change = log.intervals.end.u[:, k] - log.intervals.start.u[:, k]
    share = float(np.linalg.norm(own[:, n + k]) / (np.linalg.norm(change) + 1e-300))
    name = model.mechanism.speeds[int(model.of_u[k])].name
    if share < PURE:  # of flat filters the fields are of higher order, and small
        return None
    of_others = np.cumsum(np.abs(at.work(np.concatenate([other, np.zeros_like(other)], axis=1))))
    of_rows = np.cumsum(at.work(np.hypot(*log.noise)) ** 2)
    error = np.sqrt(of_others**2 + of_rows) * log.whole
    method = flow.plant.difference(flow.end, of.end)
    parts = Attribution(
        log.intervals.end.t,
        Share(log.running(at.work(method)), error),
        Share(log.running(at.work(own)), error),
        Share(np.zeros_like(error), np.sqrt(of_rows)),
    )
    return UnknownForce(name, float(exchanged.sum()), share), parts


def _share_of_q(method: Integrator) -> float:
    """What a force in a step moves coordinates by, in units of the step times what it moves speeds by."""
    return 0.5 + method.numbers.get("q: a", 0.0)


def otherwise_than_by_force(point: Point, w: Array, of_noise: float, share: float = 0.5) -> Array:
    """Square of what coordinates depart by otherwise than by a force, in units of both squares (N,).

    Of changes w (N, 2n) of states by a method in which a force moves coordinates by that `share` of the step
    times what it moves speeds. Intervals within the noise of the rows have the ratio `of_noise`.
    """
    n, h = point.model.n, point.log.intervals.h
    size, noise = squares(point, w), squares(point, np.hypot(*point.log.noise))
    of_coordinates = np.zeros_like(w)
    of_coordinates[:, :n] = w[:, :n] - share * h * w[:, n:]
    other = squares(point, of_coordinates) / (size + 1e-300)
    return np.where(size > KNOWN * noise, other, of_noise)


def squares(point: Point, w: Array) -> Array:
    """Squares (N,) of changes w (N, 2n) of states by inertia; of speeds, what they do in half a step."""
    n, half = point.model.n, 0.5 * point.log.intervals.h
    inertia = point.model.inertia(point.log.intervals.start)
    return np.asarray((inertia * (w[:, :n] ** 2 + (half * w[:, n:]) ** 2)).sum(axis=1))


def through_speeds(point: Point, w: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Energy (n,) that changes w (N, 2n) of states move through speeds, J; and where no logged force acts."""
    model = point.model
    power = model.powers(point.log.intervals.end, w[:, model.n :, None])[:, :, 0]
    acting = {k for places in model.log.places.values() for k in places}
    free = np.array([int(k) not in acting for k in model.of_u])
    return np.abs(power).sum(axis=0) * point.log.whole, free


# --- what else the same rows may be of ---


def _other_forces(comparison: HypothesisComparison) -> Iterator[Array]:
    """What forces that the closing method cannot tell from those assumed add to its joules (N,), running.

    The method, or another that closes the rows alike, makes the same rows of them within the noise; the exact
    motion differs. A method that evaluates forces at several instants of a step needs functions of time.
    Forces that keep their values over several rows are held; those that splines resolve are not piecewise
    linear.
    """
    at, point, methods = comparison.at, comparison.point, dict.fromkeys(comparison.methods)
    first, forces, log, plant = comparison.methods[0], point.forces, point.log, point.flow.plant
    if first is EXACT or first.holding or not forces.kinds:
        return
    if point.run.provenance.held is not None:
        return

    def arrival(method: Integrator, by: InterpolatedForces) -> Rows | None:
        """The rows that a method makes of those before; None if it has no map of such steps."""
        force, (start, end) = by.between, (log.intervals.start, log.intervals.end)
        own = Intervals(replace(start, F=force(0.0)), replace(end, F=force(1.0)))
        of = next(maps(plant, own, force, comparison.counts, 1, [method]), None)
        return None if of is None else of.end

    @cache
    def assumed() -> Rows | None:
        return arrival(first, forces)

    def alike(method: Integrator, other: InterpolatedForces) -> bool:
        one, two = assumed(), arrival(method, other)
        if one is None or two is None:
            return False
        apart = point.model.difference(one, two)
        return bool(0.5 * np.sum((apart / log.noise[1]) ** 2) < CERTAIN)

    held = "step" if forces.several else "end" if first.later else "start"
    functions = ["smooth"] if forces.several else ["ramp", "smooth"]
    for kind in [held, *functions] if first.samples_once else functions:
        smooth = [kind == "ramp" and not kinked for kinked in forces.kinked]
        own = zip(forces.kinds, forces.stairs, smooth, strict=True)
        other = forces.of([before if any(as_before) else kind for before, *as_before in own])
        nodes = np.linspace(0.0, 1.0, 5)
        change = np.stack([other.between(s) - forces.between(s) for s in nodes])
        if change.any() and any(alike(m, other) for m in methods if m is not EXACT):
            yield -HALF * log.running(at.work(point.flow.moved_by_forces(change)))


def _exact_by_other_forces(comparison: HypothesisComparison) -> bool:
    """Whether the exact flow, by forces that act otherwise between the rows, is as likely as the method."""
    point, rows = comparison.point, comparison.rows
    flow, forces = point.flow, point.forces
    if point.forces_known or forces.filter is not None or comparison.methods[0] is EXACT:
        return False
    w = [point.errors(comparison.maps[0].end, point.tangent.Phi)]
    for kind in ("start", "ramp", "smooth"):
        other = forces.alike(kind)
        change = np.stack([other.between(s) - forces.between(s) for s in np.linspace(0.0, 1.0, 5)])
        w.append(point.errors(flow.end, point.tangent.Phi) - flow.moved_by_forces(change))
    columns = np.stack(w, axis=2) - comparison.effects[:, :, None]
    white, _ = point.log.innovations(point.tangent.Phi, point.noise.total)(columns)
    rss = np.maximum(np.sum(white**2, axis=(0, 1)), rows.least)
    odds = 0.5 * rows.count / comparison.tau * np.log(rss[1:].min() / rss[0])
    return bool(odds < CERTAIN)


def _near_methods(comparison: HypothesisComparison) -> Iterator[Array]:
    """What usual methods with a memory do (N, 2n) that the rows do not tell from the closing method."""
    at, point, method = comparison.at, comparison.point, comparison.methods[0]
    if method.order != 2 or point.log.unknown.any():
        return
    flow = point.flow
    others = maps(flow.plant, flow.intervals, point.forces.between, flow.counts, 1, USUAL)
    likely = as_likely(at, [comparison.maps[0], *others], 0, comparison.posterior.best)
    yield from (flow.plant.difference(flow.end, of.end) for of in likely[1:])


def _other_states(comparison: HypothesisComparison) -> tuple[tuple[Map, Observations], ...]:
    """Methods that close coordinates alone as well as the one found, each with speeds of its own."""
    states = comparison.point.states
    names = [method.name for method in comparison.methods]
    found = bool(states) and states[0][0].method.name in names
    return states[1:] if found else ()


def _of_rates_of_q(point: Point, log: Observations) -> Array:
    """What a unit of the field (a, 0) of first order adds to ΔC of the rates of the coordinates (N,), J.

    Methods that are one method of the coordinates alone have speeds of other instants. Where the log has none
    and no method is known, the energy is that of the coordinates' own rates, q̇ = u + c h a.
    """
    n, h, (first, _) = point.model.n, point.log.steps, log.pieces[0]

    def shift(at: Rows, h: Array) -> Array:
        gradient = point.model.energy_gradient(at)[:, n:]
        return np.asarray(np.einsum("km,km->k", gradient, h * point.flow.plant.at(at)))

    begin = log.intervals.start.take(np.array([first]))
    return shift(log.intervals.end, h) - shift(begin, h[first : first + 1])


def of_one_number(causes: Sequence[Candidate]) -> list[Candidate]:
    """Those in the equations that are linear in one number."""
    return [c for c in causes if c.size == 1 and c.quadratic is None and c.kind not in OF_THE_LOG]


def unseen_joules(
    point: Point, block: Block, best: Fit, tau: float, curves: Array
) -> dict[str, float]:
    """Energy (J) that a mistake of one number may add to ΔC at one standard error, by its name.

    `curves` (N, P) are what a unit of each column adds to ΔC.
    """
    joules = dict[str, float]()
    for c in of_one_number(point.candidates):
        if any(c is x or c.excludes(x) for x in best.chosen):
            continue
        sigma = deviation((block,), c, best, tau)
        most = float(np.abs(curves[:, list(c.columns)] @ c.linear[:, 0]).max())
        if most > 0.0 and np.isfinite(sigma):  # else it is one of those found
            joules[name_of(c)] = max(joules.get(name_of(c), 0.0), sigma * most)
    return joules


def generic_equations(comparison: HypothesisComparison) -> Generic:
    """All columns of causes together against the best set, with the joules of what they explain beyond it."""
    at, point, best = comparison.at, comparison.point, comparison.posterior.best
    odds, explained, further = beyond_causes(comparison.blocks[0], best)
    joules = float(np.abs(at.gradient * (at.of_causes @ further)).sum() * point.log.whole)
    within_noise = comparison.excess <= 1.0
    if within_noise or joules < max(SIX_DIGITS * point.energy, at.bias, at.omitted):
        odds = -np.inf
    shift = 0.0
    if not comparison.maps:
        p = comparison.rows.projected
        other = p.nuisance_at(best.coefficients + further)[: at.fields]
        change = at.power[:, : at.fields] @ (other - comparison.numbers[0])
        shift = float(np.abs(point.log.running(change)).max())
    return Generic(odds, joules, explained, shift)


def name_of(c: Candidate) -> str:
    """The name under which a mistake is told that nobody sees."""
    return f"{c.kind} {c.element}".strip()


def intermittent_force(
    comparison: HypothesisComparison, residual: Array
) -> tuple[float, NDArray[np.bool_]]:
    """Log odds that something acts from time to time, and when; none where logged forces may be that.

    Forces that were not declared to be held may do otherwise between two rows, as those of contacts at
    the stages of a step: by as much as they change, at most. Where steps are lost, those that come and go
    may have been anything.
    """
    at, point = comparison.at, comparison.point
    thinned, forces = point.lost, point.forces
    odds, active = intermittent(comparison.rows, comparison.posterior.best, thinned)
    if odds <= CERTAIN:
        return odds, active
    h, speeds = point.log.intervals.h, at.gradient[:, point.model.n :]
    possible, lost, acts = np.zeros(len(residual)), list[Array](), forces.logged.first != 0.0
    comes_and_goes = acts.any(axis=0) & ~acts.all(axis=0)
    for k, response in enumerate(point.flow.force_responses):
        free = thinned | (forces.declared[k] not in HELD)
        moved = response * h * forces.logged.change[:, k : k + 1]
        possible += free * np.abs(speeds * moved).sum(axis=1)
        if comes_and_goes[k]:
            unit = response * thinned[:, None]
            none = np.zeros_like(unit)
            lost += [np.hstack([none, unit]), np.hstack([unit, none])]
    if lost:
        # What these forces cannot make of it.
        columns = np.stack(lost, axis=2)
        residual = residual - (columns @ (np.linalg.pinv(columns) @ residual[:, :, None]))[:, :, 0]
    made = possible[active].sum() > np.abs(at.gradient * residual)[active].sum()
    return (-np.inf if made else odds), active
