"""Prediction errors at a point, whitened, on the fields of an integrator and the columns of all causes.

Beside an unknown integrator they are those of the flow; beside a method, those of its own map.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import simpson

from deltac.arrays import NEGLIGIBLE, SIX_DIGITS, Array
from deltac.diagnosis.inference.fields import FIELDS, FIRST_ORDER, first_order_jacobian
from deltac.diagnosis.inference.hypotheses import (
    MANY,
    TOGETHER,
    Block,
    Fit,
    Posterior,
    refitted,
    search,
    several_of_one_kind,
)
from deltac.diagnosis.inference.integrators import Map, by_causes, numbers_of
from deltac.diagnosis.inference.linearisation import (
    SHARES,
    Point,
    ProcessNoise,
    cause_responses,
    likelihood_of,
)
from deltac.diagnosis.inference.observations import Observations
from deltac.diagnosis.inference.whitening import Innovations, robust_weights
from deltac.diagnosis.measurements.digits import digits_of

ENOUGH = 300
"""Intervals of which the energy that a cause exchanges is summed."""


@dataclass(frozen=True, eq=False)
class Regression:
    """Prediction errors at a point and what may have made them.

    point        at which they are taken
    B            what the integrator's fields, then the columns of causes do to its end (N, 2n, p)
    bent         the same of forces that are otherwise between the rows (N, 2n, k)
    numbers      of the integrator's fields of first order, beside no cause
    innovations  the whitener
    series       whitened equations beside an unknown integrator
    D            whitened columns of causes and of forces between rows (N, d, P + k)
    """

    point: Point
    B: Array
    bent: Array
    numbers: Array
    innovations: Innovations
    series: Block
    D: Array

    @property
    def fields(self) -> int:
        """Columns of the integrator: they come first."""
        return self.point.tangent.count

    @cached_property
    def gram(self) -> Array:
        """DᵀD."""
        X = self.D.reshape(self.series.r.size, self.D.shape[2])
        return np.asarray(X.T @ X)

    @property
    def of_causes(self) -> Array:
        """What the columns of causes do to the flow (N, 2n, P)."""
        return self.B[:, :, self.fields :]

    def beside(self, of: Map, log: Observations | None = None) -> Block:
        """Whitened equations beside a method, perhaps where rows have the noise of another log."""
        point = self.point
        log = log or point.log
        own = point.flow.transition(of)
        Phi = point.tangent.Phi if own is None else own
        errors = point.errors(of.end, Phi)[:, :, None]
        fields = self.B[:, :, : self.fields]
        columns = np.concatenate([errors, fields, self.moved_in(of), self.bent], axis=2)
        white, spread = log.innovations(Phi, point.noise.total)(columns)
        return _block(point, white, 0, _places(point), spread, log.rounding)

    def moved_in(self, of: Map) -> Array:
        """What causes do to the rows (N, 2n, P) by the steps of a method, or else by its numbers."""
        point = self.point
        intervals = point.log.intervals
        own = by_causes(of, point.tangent.J, point.columns, intervals)
        step = intervals.h / of.counts[:, None]
        if own is None:
            own = moved_by(point, self.of_causes, point.columns, numbers_of(of.method), step)
        return own

    def effect_of(self, coefficients: Array) -> Array:
        """What causes of these coefficients (P,) beyond the point's do to the rows (N, 2n)."""
        point = self.point
        change = (coefficients - point.coefficients)[:, None]
        columns = [x @ change for x in (point.columns[0], point.columns[-1])]
        B = self.of_causes @ change
        return moved_by(point, B, columns, self.numbers, point.log.steps)[:, :, 0]

    # --- joules ---

    @cached_property
    def weights(self) -> tuple[Array, Array]:
        """What a defect of an interval adds to ΔC, (N, 2n): ∂E/∂x at its end and, by the flow, at its start.

        Weighed at either end alone the sum is off by a share of the step. The second array is half of the
        difference. Where the motion is stiff, what is at the end no longer tells of the start.
        """
        point, gradient = self.point, self.point.model.energy_gradient
        intervals = point.log.intervals
        mild = (point.tangent.rates * intervals.h)[:, 0] < 1.0
        end = gradient(point.flow.end)
        start = np.array(end)
        transposed = point.tangent.Phi[mild].transpose(0, 2, 1)
        before = gradient(intervals.start)[mild][:, :, None]
        start[mild] = np.linalg.solve(transposed, before)[:, :, 0]
        # The mean of the gradients at prediction and row makes of a quadratic energy what it changes by. It
        # is of both weights: noise squared adds nothing to their difference.
        half = 0.5 * (gradient(intervals.end) - end)
        return 0.5 * (start + end) + half, 0.5 * (end - start)

    @property
    def gradient(self) -> Array:
        """∂E/∂x (N, 2n), the mean of those weights."""
        return self.weights[0]

    @cached_property
    def power(self) -> Array:
        """What a unit of each column adds to ΔC in each interval (N, p), J."""
        return np.asarray(np.einsum("km,kmp->kp", self.gradient, self.B))

    def work(self, x: Array) -> Array:
        """What changes x of the ends of the intervals (N, 2n) add to ΔC (N,), J."""
        return np.asarray(np.einsum("km,km->k", self.gradient, x))

    @cached_property
    def works(self) -> Array:
        """Mean power of a unit of each cause through each speed, of some of the intervals (P, …), W."""
        point = self.point
        some, model = slice(None, None, max(1, len(self.B) // ENOUGH)), point.model
        nodes, columns = point.flow.nodes, [x[some] for x in point.columns]
        power = [model.powers(at.take(some), x) for at, x in zip(nodes, columns, strict=True)]
        works = simpson(power, dx=1.0 / (len(nodes) - 1), axis=0)
        h = point.log.intervals.h[some][:, :, None]
        works = works * h / np.sum(h)
        return np.ascontiguousarray(np.concatenate(works).T)

    def exchanged(self, fit: Fit) -> tuple[Array, Array, Array]:
        """Energy (J) that each cause of a fit exchanges, its standard error, and what it adds to ΔC.

        Of some of the intervals: these are sums that need two digits.
        """
        log, exchanged, errors, energies = self.point.log, [], [], []
        scale = log.whole * float(np.sum(log.intervals.h))
        for k, (c, theta) in enumerate(zip(fit.chosen, fit.theta, strict=True)):
            work = (fit.of(k) @ self.works[list(c.columns)]) * scale
            exchanged.append(float(np.abs(work).sum()))
            energies.append(float(work.sum()))
            relative = fit.deviation(k) / np.maximum(np.abs(theta), 1e-300)
            errors.append(exchanged[-1] * min(float(relative.min()), 1.0))
        return np.array(exchanged), np.array(errors), np.array(energies)

    @cached_property
    def bias(self) -> float:
        """Joules by which noise in the columns themselves may bias a cause.

        Columns are evaluated at the rows, and share their noise with the prediction errors. The bias of
        errors in variables is the ratio of the variances of noise and motion (Fuller, Measurement Error
        Models, 1987, §1.1), here of the energies that flow by either.
        """
        model, log = self.point.model, self.point.log
        displacement = model.difference(log.intervals.start, log.intervals.end)
        motion = np.concatenate(
            [np.cumsum(displacement[a:b], axis=0) for a, b in log.pieces], axis=0
        )
        noise = np.mean(log.noise[1] ** 2, axis=0)
        ratio = np.minimum(noise / np.maximum(np.var(motion, axis=0), 1e-300), 1.0)
        return log.whole * float((ratio * np.abs(self.gradient * displacement)).sum())

    @cached_property
    def omitted(self) -> float:
        """Joules that the first order beyond the series may exchange: `remainder` beside no cause."""
        return self.remainder(self.series)

    def remainder(self, block: Block) -> float:
        """Joules that the first order beyond the series may exchange, with the numbers of a block.

        A term of the next order is ρ times as large, ρ the step times the spectral radius of ∂f/∂x. What is
        below this is no evidence of a mistake.
        """
        log, J = self.point.log, self.point.tangent.J[0]
        some = np.unique(np.linspace(0, len(J) - 1, 32).astype(np.intp))
        radius = np.abs(np.linalg.eigvals(J[some])).max(axis=1)
        rho = log.step * float(np.median(radius))
        x, size = block.projected.nuisance, np.abs(self.gradient)
        parts = [
            log.whole * float((size * np.abs(self.B[:, :, k] @ x[k])).sum())
            for k in ([i for i, f in enumerate(FIELDS) if f.order == order] for order in (1, 2))
        ]
        return max(parts[0] * rho**3, parts[1] * rho**2)


def regression(point: Point) -> Regression:
    """The regression at a point."""
    log, tangent, Q = point.log, point.tangent, point.noise.total
    ni, places = tangent.count, _places(point)
    Phi, fields, of_causes = tangent.Phi, tangent.effects, tangent.transported(point.columns)
    w, bent = point.errors(point.flow.end, Phi), _between_rows(point)
    # The integrator moves the noise of a row and what causes do otherwise than the flow does, by its
    # fields of first order.
    white, _ = log.innovations(Phi, Q)(np.concatenate([w[:, :, None], fields], axis=2))
    alone = _block(point, white, ni, places[:0], 0.0, log.rounding)
    c = np.clip(alone.projected.nuisance[:FIRST_ORDER], -1.0, 1.0)
    moved = Phi
    if log.rounding < 1.0:
        change = first_order_jacobian(point.flow.plant, log.intervals.start, log.steps, c)
        moved = Phi + log.intervals.h[:, :, None] * change @ Phi
        w = point.errors(point.flow.end, moved)
    innovations = log.innovations(moved, Q)
    own = moved_by(point, of_causes, point.columns, c, log.steps)
    white, spread = innovations(np.concatenate([w[:, :, None], fields, own, bent], axis=2))
    series, B = _block(point, white, ni, places, spread, log.rounding), [fields, of_causes]
    D = white[:, :, 1 + ni :]
    return Regression(point, np.concatenate(B, axis=2), bent, c, innovations, series, D)


def with_likelier_noise(at: Regression) -> Point | None:
    """The point with as much noise as is likely beside all columns; None where that is all.

    What causes do looked like noise of forces. Where steps are coarse, or rows far apart, the series may
    leave out more than all that the rows depart by.
    """
    point, noise, Phi = at.point, at.point.noise, at.point.tangent.Phi
    w = point.errors(point.flow.end, Phi)
    fields, causes = np.split(np.concatenate([at.B, at.bent], axis=2), [at.fields], axis=2)
    most = bool(np.any(np.mean(noise.beyond**2, axis=0) > np.mean(w**2, axis=0)))
    parts = [part for part, large in (("beyond", most), ("forces", noise.forces.any())) if large]
    if not parts or w.size < 2 * (at.B.shape[2] + at.bent.shape[2]):
        return None
    likelier = noise
    for part in parts:

        def likelihood(share: float, part: str = part, noise: ProcessNoise = likelier) -> float:
            Q = noise.with_shares(**{part: share}).total
            return likelihood_of(point.log, Phi, Q, w, fields, causes)

        share = max(sorted(SHARES, reverse=True), key=likelihood)
        likelier = likelier.with_shares(**{part: share}) if share != 1.0 else likelier
    return None if likelier is noise else replace(point, noise=likelier)


def _places(point: Point) -> NDArray[np.intp]:
    """Places of the columns of causes, after those of the integrator."""
    return point.tangent.count + np.arange(len(point.coefficients))


def _block(
    point: Point,
    white: Array,
    nuisance: int,
    places: NDArray[np.intp],
    spread: float,
    rounding: float,
) -> Block:
    """Whitened errors with their columns; so many of these, and those of forces, are beside every cause."""
    r, D = white[:, :, 0], white[:, :, 1:]
    weight = np.sqrt(robust_weights(r, D))[:, None]
    if np.any(weight != 1.0):
        r, D = r * weight, D * weight[:, :, None]
    bent = np.arange(point.tangent.count + len(places), D.shape[2])
    return Block(
        r,
        D,
        np.append(np.arange(nuisance), bent),
        np.concatenate([point.tangent.prior[:nuisance], np.ones(len(bent))]),
        places,
        rounding,
        spread,
        origin=point.coefficients[: len(places)],
    )


def _between_rows(point: Point) -> Array:
    """What forces do that are otherwise between rows, by a unit of that (N, 2n, k).

    A straight line lacks the bend of a cubic spline, and both lack what a quintic adds. Neither is noise: it
    goes with the motion, as what a cause does. Rows of erratic forces tell nothing of what is between them:
    how much either of its rows counts in an interval is free, within the share of their noise that is likely.
    """
    forces, h = point.forces, point.log.intervals.h
    logged, share = forces.logged, point.noise.share
    bend, gap = (logged.bends[0] - logged.bends[1]) / 12.0, logged.gap
    first = share * (logged.first - logged.first.mean(axis=0))
    last = first + share * logged.change
    other = {"ramp": (bend, gap), "smooth": (gap,), "step": (gap,)}
    columns = [np.zeros((len(h), 2 * point.model.n, 0))]
    each = [
        (first, last) if erratic and share > 0.0 else other.get(kind, ())
        for kind, erratic in zip(forces.kinds, logged.erratic, strict=True)
    ]
    for k, response in enumerate(point.flow.force_responses if any(each) else ()):
        for size in each[k]:
            if np.any(size[:, k]):
                du = response * h * size[:, k : k + 1]
                columns.append(np.concatenate([0.5 * h * du, du], axis=1)[:, :, None])
    return np.concatenate(columns, axis=2)


def moved_by(point: Point, B: Array, columns: Sequence[Array], c: Array, step: Array) -> Array:
    """What causes do to the rows (N, 2n, P), B by the flow, by an integrator of numbers c of first order.

    Its fields are those of the field with the causes in it: (G, 0), (0, G_q u) and (0, G_u a + a_u G).
    `columns` are their accelerations G (N, n, P) at the nodes; steps are (N, 1).
    """
    n, h = point.model.n, point.log.intervals.h
    moves = B.copy()
    first, last = columns[0], columns[-1]
    mean, size = 0.5 * (first + last), step[:, :, None]
    moves[:, :n] += c[0] * size * h[:, :, None] * mean
    moves[:, n:] += 0.5 * (c[1] + c[2]) * size * (last - first)
    moves[:, n:] += c[2] * size * h[:, :, None] * (point.tangent.J[0][:, n:, n:] @ mean)
    return moves


def searched(
    at: Regression,
    block: Block,
    before: Posterior | None = None,
    enough: float = 0.0,
    start: Fit | None = None,
) -> Posterior:
    """The posterior of causes by a block of equations; the search stops where they leave a share `enough`.

    Or that of causes found before, fitted anew; or of further causes beside those of a `start`.
    """
    point = at.point
    if before is not None:
        return refitted((block,), before, point.candidates)
    # What the series leaves out is estimated without causes, from numbers that a mistake inflates: it does
    # not exclude a cause that leaves next to nothing, nor further causes beside others.
    omitted = 0.0 if start else _least_joules(at, block)
    # Known accelerations are linear in almost all causes: small ones beside large ones are real.
    linear = point.accelerations_known
    return search(
        (block,),
        point.candidates,
        lambda fit: at.exchanged(fit)[0],
        at.bias,
        max(SIX_DIGITS * point.energy, omitted),
        MANY if linear else TOGETHER,
        0.0 if linear else NEGLIGIBLE,
        linear,
        start,
        enough,
    )


def _least_joules(at: Regression, block: Block) -> float:
    """Joules below which nothing is evidence of a mistake."""
    # What the series leaves out is no matter of known accelerations, nor of a method's own map.
    series = len(block.nuisance) > at.bent.shape[2]
    return max(at.bias, at.omitted if series else 0.0)


def mistakes_of_one_kind(at: Regression, block: Block) -> list[Posterior]:
    """The same mistake, made several times.

    What the series leaves out is no bound here: it is estimated from numbers that such mistakes inflate.
    """
    least = max(at.bias, SIX_DIGITS * at.point.energy)
    candidates = at.point.candidates
    sets = several_of_one_kind(block, candidates, lambda fit: at.exchanged(fit)[0], least)
    return [Posterior(fit, (), ()) for fit in sets]


def by_accelerations(point: Point, some: NDArray[np.intp]) -> tuple[Block, Array]:
    """The equations at the starts of some intervals, by accelerations that are known to be theirs.

    Nothing is integrated. The second value is what a unit of each column adds to the accelerations.
    """
    run, model, log = point.run, point.model, point.log
    assert run.udot is not None
    rows = np.concatenate([np.arange(a, b - 1) for a, b in log.rows])[some]
    free, at = model.mechanism.free.u, log.intervals.start.take(some)
    udot, half = run.udot[rows][:, free], digits_of(run)["udot"].half()[rows][:, free]
    a, rest = point.base.at(at), np.zeros_like(at.F)
    columns = cause_responses(point.base, point.kernels, point.built, at, udot, rest, rest)
    slopes = np.abs(point.tangent.J[0][some, model.n :])
    of_rows = np.einsum("kij,kj->ki", slopes, log.digits[0][some])
    sigma = np.sqrt(half**2 + of_rows**2) + 1e-12 * (1.0 + np.abs(a).max())
    sigma = np.sqrt(np.mean(sigma**2, axis=0))
    none, places = np.zeros(0, dtype=np.intp), np.arange(columns.shape[2])
    r, D = (udot - a) / sigma, columns / sigma[:, None]
    origin = np.zeros(len(places)) if point.built is None else point.built.coefficients
    return Block(r, D, none, np.zeros(0), places, 1.0, origin=origin), columns
