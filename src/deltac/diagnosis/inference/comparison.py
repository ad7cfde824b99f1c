"""Hypotheses at a point: causes beside an unknown integrator, and beside methods by whose maps rows close."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import EPS, SIX_DIGITS, SMALL_SHARE, Array
from deltac.diagnosis.inference.hypotheses import (
    CERTAIN,
    Block,
    Posterior,
    autocorrelation_time,
    nothing,
    refitted,
)
from deltac.diagnosis.inference.integrators import EXACT, INTEGRATORS, Integrator, Map, maps
from deltac.diagnosis.inference.linearisation import RELINEARISATIONS, FlowError, Point
from deltac.diagnosis.inference.methods import (
    FAR,
    SOME,
    SQUARES,
    best_of,
    by_own_steps,
    closest,
    log_evidence,
    maps_by_parts,
)
from deltac.diagnosis.inference.observations import Observations
from deltac.diagnosis.inference.regression import (
    Regression,
    by_accelerations,
    regression,
    searched,
    with_likelier_noise,
)
from deltac.diagnosis.inference.result import KNOWN, OF_THE_LOG

SMOOTHINGS = 2
"""Times that the likeliest states are taken anew: twice the digits of the speeds each."""

LESS = 2.0
"""Ratio of standard deviations from which on noise is known better than before."""

STILL = 1e-6
"""Share of the errors of the rows below which states that move by it are the likeliest."""


@dataclass(frozen=True, eq=False)
class HypothesisComparison:
    """Hypotheses compared at a point.

    at         the regression that they are compared by
    point      the same point, with what they tell of noise and states
    posterior  causes with their odds
    series     whitened equations beside an unknown integrator
    rows       the same beside the method that closes the rows, if there is one
    maps       of methods that close them alike, the best first
    promising  the map of a method that would close them but for what may be squares of causes
    near       methods that leave no more than `FAR` times what the best one does, beside all causes
    """

    at: Regression
    point: Point
    posterior: Posterior
    series: Block
    rows: Block
    maps: tuple[Map, ...]
    promising: Map | None
    near: tuple[Integrator, ...]

    @property
    def methods(self) -> tuple[Integrator, ...]:
        """Methods whose own maps close the rows."""
        return tuple(of.method for of in self.maps)

    @property
    def blocks(self) -> tuple[Block, ...]:
        """The whitened equations of which the causes are."""
        measured = self.point.accelerations
        return (self.rows if measured is None else measured[0],)

    @cached_property
    def defects(self) -> list[Array]:
        """What the methods do in each interval beside the flow (N, 2n)."""
        flow = self.at.point.flow
        return [flow.plant.difference(flow.end, of.end) for of in self.maps]

    @property
    def counts(self) -> NDArray[np.intp]:
        """Steps (N,) of the method in each interval."""
        return self.maps[0].counts

    @property
    def closing(self) -> bool:
        """Whether a method leaves nothing but the noise of the rows."""
        rss = self.rows.projected.left(self.posterior.best.coefficients)
        return bool(self.maps) and rss <= self.rows.count

    @property
    def speeds_known(self) -> bool:
        """Whether one method alone makes the coordinates, and so the speeds that the log lacks.

        With forces at the start of a step, semi-implicit Euler makes them as its adjoint does with those at
        the end, by the speeds of the next row.
        """
        point = self.point
        if not self.maps or not point.log.unknown.any():
            return False
        return len(point.states) == 1 and (self.methods[0].order > 1 or not point.forces.kinds)

    @property
    def accuses(self) -> bool:
        """Whether causes are of the equations, and not of the log alone."""
        return any(c.kind not in OF_THE_LOG for c in self.posterior.best.chosen)

    @property
    def exact(self) -> bool:
        """Whether a method's map arrives at the rows to their digits, whatever else they may be known to."""
        if not self.maps:
            return False
        point, Phi = self.point, self.at.point.tangent.Phi
        w, (start, end) = point.errors(self.maps[0].end, Phi), point.log.digits
        variance = end**2 + np.einsum("kij,kj->ki", Phi**2, start**2)
        return bool(np.all(np.mean(w**2, axis=0) <= KNOWN * np.mean(variance, axis=0)))

    @property
    def evidence(self) -> float:
        """Log evidence of the rows, as likely as their noise is small."""
        return self.rows.evidence(self.posterior.best, self.tau) - self.rows.spread

    @cached_property
    def tau(self) -> float:
        """Autocorrelation time of what is left, intervals."""
        return autocorrelation_time(self.rows.residual(self.posterior.best.coefficients))

    @cached_property
    def excess(self) -> float:
        """Variance of what is left, in units of what digits, noise and the flow's error explain."""
        return self.rows.misfit(self.posterior.best.coefficients) / self.rows.count

    @cached_property
    def numbers(self) -> tuple[Array, Array]:
        """Numbers of the integrator's fields beside the causes, and their covariance."""
        numbers, covariance = self.rows.numbers(self.posterior.best)
        return numbers[: self.at.fields], covariance[: self.at.fields, : self.at.fields]

    @cached_property
    def across(self) -> Array | None:
        """What impulses of the constraints make of changes of the states, beside what else is not known.

        Projectors (N, 2n, 2n) of coordinates and of speeds, by least squares weighted with the covariance of
        noise of the rows and of forces; None without constraints.
        """
        flow, log, noise = self.point.flow, self.point.log, self.point.noise
        model, n = flow.plant, flow.plant.n
        if not model.rows_of_G:
            return None
        by_impulses = model.impulses(flow.end.t, flow.end.q)
        unknown = noise.own + noise.doubt
        diagonal, own = np.arange(2 * n), np.hypot(*log.noise)
        unknown[:, diagonal, diagonal] += np.maximum(own, EPS * own.max(axis=0)) ** 2
        size = np.sqrt(unknown[:, diagonal, diagonal])
        across = np.zeros_like(unknown)
        for some in (slice(0, n), slice(n, 2 * n)):
            scale = size[:, some, None]
            C = unknown[:, some, some] / (scale * scale.transpose(0, 2, 1))
            white = np.linalg.inv(np.linalg.cholesky(C + SIX_DIGITS**2 * np.eye(n)))
            white = white / scale.transpose(0, 2, 1)
            across[:, some, some] = by_impulses @ np.linalg.pinv(white @ by_impulses) @ white
        return across

    @cached_property
    def effects(self) -> Array:
        """What the causes do to the rows beyond those that the flow has already (N, 2n)."""
        return self.at.of_causes @ (self.posterior.best.coefficients - self.point.coefficients)


def compared(point: Point, before: Posterior | None = None) -> HypothesisComparison:
    """The comparison at a point, and at the likeliest states where the log has no speeds.

    `before`: causes found at another point, of which the numbers are fitted anew. The iterated smoother is
    the method of Gauss and Newton for states and numbers together (Bell, The iterated Kalman smoother as a
    Gauss–Newton method, SIAM J. Optim. 1994).
    """
    comparison = _compared(point, before)
    if before is None:
        comparison = _at_promising(comparison)
    for _ in range(SMOOTHINGS if point.log.unknown.any() else 0):
        earlier, moved = comparison.point.log.beyond[1], _at_likeliest_states(comparison)
        change = np.linalg.norm(moved.log.beyond[1] - earlier)
        if change <= STILL * np.linalg.norm(earlier):
            return replace(comparison, point=moved)
        moved = moved.with_flow().with_tangent().with_columns()
        comparison = _compared(moved, before)
    return comparison


def _compared(point: Point, before: Posterior | None) -> HypothesisComparison:
    """The comparison of causes with what the series may leave out, or with what it is likely to."""
    at = regression(point)
    comparison = _compared_by(at, before)
    # Where causes were found already, they were found beside the noise that is likely.
    asked = before is None and not comparison.exact
    quieter = with_likelier_noise(at) if asked else None
    if quieter is None:
        return comparison
    # All columns explain more than few causes do: these must close the rows, or be found by it alone.
    other = _compared_by(regression(quieter), before)
    closes = other.maps and other.excess <= KNOWN
    alone = other.posterior.best.chosen and not comparison.posterior.best.chosen
    likelier = not len(point.coefficients) and other.evidence > comparison.evidence + CERTAIN
    likelier &= bool(other.maps) or not comparison.maps  # no method is lost for it
    return other if closes or alone or likelier else comparison


def _compared_by(at: Regression, before: Posterior | None) -> HypothesisComparison:
    """The comparison of causes, beside an unknown integrator or a method whose map closes the rows."""
    point = at.point
    measured = _measured(at, before) if point.accelerations_known else None
    posterior, series = (measured[1], at.series) if measured else _of_series(at, before)
    point = replace(point, accelerations=measured or point.accelerations)
    promising: Map | None = None
    near: tuple[Integrator, ...] = ()
    price = float(np.log(len({method.name for method in INTEGRATORS})))
    for every in (point.maps, maps_by_parts(at, series, posterior.best)):
        ends = list(every)
        methods = closest(at, [(of, point.log) for of in ends])
        if methods is None:
            continue
        likely = {*methods.ends, *methods.others}
        near = near or tuple(of.method for of in ends if of in likely)
        methods = by_own_steps(at, methods)
        first = methods.ends[0] if methods.floor < SQUARES * methods.alone else None
        if methods.may_close(series, posterior.best):
            alike, rows, other = best_of(at, methods, before, measured and measured[1])
            gain = log_evidence(rows, other.best, series, posterior.best)
            if gain - price <= CERTAIN and not measured:
                # Causes must be likelier than a method without any, beside whichever integrator they are.
                other = Posterior(nothing(len(point.coefficients)), (), other.scores)
                doubt = log_evidence(rows, other.best, series, posterior.best) > -CERTAIN
                # Where causes leave noise, a method that leaves a thousand times as much is no alternative.
                left = series.misfit(posterior.best.coefficients)
                doubt &= left > KNOWN * series.count or SMALL_SHARE * rows.start < left
                gain = np.inf if posterior.best.chosen and doubt else gain
            if gain - price > CERTAIN:
                own = HypothesisComparison(
                    at, point, other, series, rows, tuple(alike), promising, near
                )
                return own if measured else _with_noise_left(own, before)
        promising = promising or first
    return HypothesisComparison(at, point, posterior, series, series, (), promising, near)


def _measured(at: Regression, before: Posterior | None) -> tuple[Block, Posterior]:
    """The equations by known accelerations, and their posterior; the same wherever it is linearised."""
    point = at.point
    known = point.accelerations
    if known is not None and len(known[0].causes) == len(point.coefficients):
        return known
    block, _ = by_accelerations(point, np.arange(len(point.log.intervals)))
    posterior = searched(at, block, before)
    if any(c.kind == "body-centre" and c.size > 1 for c in posterior.best.chosen):
        # The centre may have moved along fewer axes.
        posterior = refitted((block,), posterior, point.candidates)
    return block, posterior


def _of_series(at: Regression, before: Posterior | None) -> tuple[Posterior, Block]:
    """The posterior beside an unknown integrator, and the block with the noise that there is."""
    posterior = searched(at, at.series, before)
    variance = at.series.projected.left(posterior.best.coefficients) / at.series.count
    if variance <= 2.0 * at.series.variance:
        return posterior, at.series
    # The numbers of an integrator are of the size of their prior beside the noise that there is.
    series = at.series.beside(variance)
    return searched(at, series, before), series


def _with_noise_left(
    comparison: HypothesisComparison, before: Posterior | None
) -> HypothesisComparison:
    """The comparison with the noise that a method that closes the rows leaves of them, if that is less.

    What another integrator does looked like noise.
    """
    at, point, of = comparison.at, comparison.point, comparison.maps[0]
    optimum = comparison.rows.optimum - point.coefficients
    w = point.errors(of.end, at.innovations.Phi) - at.moved_in(of) @ optimum
    log, known = point.log.with_noise(w), ~point.log.unknown
    if not np.any(LESS * log.noise[1][:, known] < point.log.noise[1][:, known]):
        return comparison
    rows, point = at.beside(of, log), replace(point, log=log)
    return replace(comparison, point=point, rows=rows, posterior=searched(at, rows, before))


def _at_promising(comparison: HypothesisComparison) -> HypothesisComparison:
    """The comparison, or one linearised at causes beside which a method leaves but their squares.

    The fields of an unknown integrator explain much: by the squares alone it would be preferred.
    """
    best, moved = comparison.posterior.best, comparison
    rounded = comparison.rows.misfit(best.coefficients) <= comparison.rows.least
    for _ in range(RELINEARISATIONS):
        if moved.promising is None or moved.maps:
            break
        block = moved.at.beside(moved.promising)
        # Others beside the first few would explain squares of these.
        causes = searched(moved.at, block, enough=SOME).best
        if block.misfit(causes.coefficients) > SOME * block.start:
            break
        if any(c.edit is not None for c in causes.chosen):
            break  # of those that look alike each is built, in `inference`
        try:
            moved = _compared_by(regression(moved.point.with_causes(causes)), None)
        except (FlowError, np.linalg.LinAlgError):
            break
        # What was fitted to rounding tells nothing of causes but where it is linearised at them.
        if moved.maps or (rounded and moved.posterior.best.chosen):
            return moved
    return comparison


def _at_likeliest_states(comparison: HypothesisComparison) -> Point:
    """The point at the likeliest states beside causes, of a method or of the integrator's fields."""
    at, point, rows = comparison.at, comparison.point, comparison.rows
    best, flow, Phi = comparison.posterior.best, point.flow, at.innovations.Phi
    causes = at.effect_of(best.coefficients)

    def states(residuals: Sequence[Array]) -> list[Observations]:
        errors = at.innovations.errors(np.stack(residuals, axis=2) - causes[:, :, None])
        each = (tuple(x[:, :, k] for x in errors) for k in range(len(residuals)))
        return [point.log.at(point.model, (start, end)) for start, end in each]

    def moved(of: Map, log: Observations) -> tuple[Map, Observations]:
        force, counts, J = point.forces.between, flow.counts, point.tangent.J[-1]
        return next(maps(flow.plant, log.intervals, force, counts, 1, [of.method], J=J), of), log

    # Each method has states of its own, at which it closes the rows or does not.
    own, methods = [(of, point.log) for of in flow.maps if of.method is not EXACT], None
    before = np.full(len(own), np.inf)
    for _ in range(2 * SMOOTHINGS if own else 0):
        logs = states([point.errors(of.end, Phi, log) for of, log in own])
        own = [moved(of, log) for (of, _), log in zip(own, logs, strict=True)]
        pairs, methods = own, closest(at, own)
        if methods is not None:
            digits = max(point.log.rounding * rows.r.size, methods.floor)
            # One that was begun at the states of another takes longer.
            near = (methods.floors <= FAR * digits) | (methods.floors <= SMALL_SHARE * before)
            own = [pair for pair, close in zip(own, near, strict=True) if close]
            before = methods.floors[near]
    if methods is not None and methods.may_close(rows, best):
        # The last step that each took is of its own size: what is below the digits is alike.
        low = min(digits, FAR * methods.floor)
        likely = [pair for pair, x in zip(pairs, methods.floors, strict=True) if x <= low]
        near = methods.floors <= FAR * methods.floor
        siblings = tuple(of.method for (of, _), close in zip(pairs, near, strict=True) if close)
        return replace(point, log=likely[0][1], states=tuple(likely), siblings=siblings)
    w = point.errors(flow.end, Phi)
    if comparison.maps:
        return replace(point, log=states([w - comparison.defects[0]])[0])
    fields = rows.projected.nuisance_at(best.coefficients)[: at.fields]
    return replace(point, log=states([w - at.B[:, :, : at.fields] @ fields])[0])
