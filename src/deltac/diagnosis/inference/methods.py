"""Methods by whose own maps the rows of a log follow from each other, beside what causes do."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import Array
from deltac.diagnosis.inference.fields import FIELDS
from deltac.diagnosis.inference.hypotheses import (
    CERTAIN,
    Block,
    Fit,
    Posterior,
    autocorrelation_time,
    fitted,
    nothing,
    price,
)
from deltac.diagnosis.inference.integrators import (
    BY_ALL_DAMPERS,
    INTEGRATORS,
    MOST_SPEEDS,
    Integrator,
    Map,
    maps,
    parted,
)
from deltac.diagnosis.inference.observations import Observations
from deltac.diagnosis.inference.regression import Regression, searched
from deltac.diagnosis.inference.result import KNOWN, SLIGHT
from deltac.diagnosis.inference.whitening import least_squares, weights_beside

FAR = 1e4
"""Ratio of sums of squares beyond which a method at its likeliest states is not tried any further, and an
interval is none of those of an integrator's errors."""


PARTS = (2, 3, 4, 5, 8, 10)
"""Steps between neighbouring rows of a log that does not say its step."""

ALIKE = 3
"""Methods of which the causes are looked for, where several close the rows alike beside all causes."""

SQUARES = 1e-4
"""Share of what a method leaves that causes leave of it where that may be their squares: of a per cent."""

SOME = 0.1
"""Share of it up to which it may be that causes do otherwise in a method's own steps."""


@dataclass(frozen=True, eq=False)
class Methods:
    """Methods whose own maps close the rows best.

    ends    their maps that do so alike, the best first; `others` are next to them
    floor   least sum of squares that all causes leave beside one; `floors` of each that was compared
    alone   what that leaves without causes
    blocks  equations beside the first few, where these were asked for
    """

    ends: list[Map]
    others: list[Map]
    floor: float
    floors: Array
    alone: float
    blocks: tuple[Block, ...] = ()

    @property
    def few(self) -> list[Map]:
        """The first few of all."""
        return [*self.ends, *self.others][:ALIKE]

    def may_close(self, series: Block, best: Fit) -> bool:
        """Whether the best method with all causes leaves about as little as the series with its best ones."""
        return self.floor < SERIES * series.misfit(best.coefficients)


def likeliest_of(r: Array, free: Array) -> int:
    """Which of several residuals (N, m, k) is likeliest, where `free` numbers (k,) were fitted to each."""
    floors = np.maximum((r**2).sum(axis=(0, 1)), 1e-300)
    rows = r.shape[0] * r.shape[1] / autocorrelation_time(r[:, :, int(np.argmin(floors))])
    return int(np.argmin(0.5 * rows * np.log(floors) + free * price(1, rows)))


def alike(r: Array, best: int, rounding: float, free: Array | None = None) -> NDArray[np.intp]:
    """Which of several residuals (N, m, k) are as likely as the best; `free` as of `likeliest_of`."""
    floors = np.maximum((r**2).sum(axis=(0, 1)), 1e-300)
    count = r.shape[0] * r.shape[1]
    rows = count / autocorrelation_time(r[:, :, best])
    odds = 0.5 * rows * np.log(floors / floors[best])
    if free is not None:
        odds += (free - free[best]) * price(1, rows)
    # What is below the rounding of the rows is alike, and rounding is no more than about what is left.
    low = min(rounding * count, KNOWN * floors[best])
    return np.flatnonzero((odds < CERTAIN) | (floors <= low))


SERIES = 4.0
"""Ratio of sums of squares from which on a method's map is not compared any more with the series."""


def log_evidence(a: Block, fit_a: Fit, b: Block, fit_b: Fit) -> float:
    """Log evidence of one block with its causes against another with its own, at the larger of their τ."""
    tau = max(
        autocorrelation_time(x.residual(fit.coefficients)) for x, fit in ((a, fit_a), (b, fit_b))
    )
    return a.evidence(fit_a, tau) - b.evidence(fit_b, tau)


def closest(at: Regression, pairs: Sequence[tuple[Map, Observations]]) -> Methods | None:
    """Those by which rows follow most closely beside all causes, each at states of its own."""
    Phi = at.innovations.Phi
    errors = [at.point.errors(of.end, Phi, log) for of, log in pairs]
    finite = [k for k, w in enumerate(errors) if np.isfinite(w).all()]
    if not finite:
        return None
    ends = [pairs[k][0] for k in finite]
    r, _ = at.innovations(np.stack([errors[k] for k in finite], axis=2))
    y = r.reshape(-1, len(finite))
    X = at.D.reshape(len(y), at.D.shape[2])
    residual = y - X @ least_squares(at.gram, X.T @ y)
    floors = np.maximum((residual**2).sum(axis=0), 1e-300)
    every = np.full(len(pairs), np.inf)
    every[finite] = floors
    free = np.array([of.fitted for of in ends])
    best = likeliest_of(residual.reshape(r.shape), free)
    first = alike(residual.reshape(r.shape), best, pairs[0][1].rounding, free)
    # Those that need no causes come first.
    first = first[np.argsort((y[:, first] ** 2).sum(axis=0), kind="stable")]
    near = [k for k in np.argsort(floors) if k not in first and floors[k] <= FAR * floors[best]]
    alone = float((y[:, best] ** 2).sum())
    ends, others = ([ends[k] for k in some] for some in (first, near))
    return Methods(ends, others, float(floors[best]), every, alone)


def maps_by_parts(at: Regression, series: Block, best: Fit) -> Iterator[Map]:
    """Maps where several steps of unknown length lie between rows, as the series' numbers say."""
    point, flow = at.point, at.point.flow
    if point.run.provenance.step is not None or flow.plant.n > MOST_SPEEDS:
        return
    # With the right method rows may need no cause, and then causes stand for what it does.
    some, likely = slice(0, len(FIELDS)), dict[tuple[Integrator, int], None]()
    for fit in (nothing(len(best.coefficients)), best)[: 1 + bool(best.chosen)]:
        c, covariance = _typical(series, fit).numbers(fit)
        near = parted(c[some], covariance[some, some], PARTS, flow.plant.damped)
        likely |= dict.fromkeys(near)
    # What dampers elsewhere than in joints do is no field of its own.
    by_all = next(method for method in INTEGRATORS if method.name == BY_ALL_DAMPERS)
    likely |= dict.fromkeys((by_all, k) for method, k in likely if method.order == 1)
    for method, k in likely:
        intervals, force, put_back = point.log.intervals, point.forces.between, flow.projected
        yield from maps(flow.plant, intervals, force, flow.counts, k, [method], projected=put_back)


def _typical(series: Block, best: Fit) -> Block:
    """The equations weighted by what the series leaves of them: kinks of forces are none of it."""
    fields = series.D[:, :, series.nuisance]
    of_causes = series.D[:, :, series.causes] @ (best.coefficients - series.projected.origin)
    weights, _ = weights_beside(series.r - of_causes, fields, np.ones(len(series.r)))
    scale = np.sqrt(weights)[:, None]
    return replace(series, r=series.r * scale, D=series.D * scale[:, :, None])


def by_own_steps(at: Regression, methods: Methods) -> Methods:
    """The methods, with the floor that causes leave in their own steps where the series' leave some."""
    low, high = SQUARES * methods.alone, SOME * methods.alone
    if not len(at.point.coefficients) or not low < methods.floor < high:
        return methods
    blocks = tuple(at.beside(of) for of in methods.few)
    floor = min(block.floor * block.count for block in blocks)
    return replace(methods, floor=floor, blocks=blocks)


def best_of(
    at: Regression, methods: Methods, before: Posterior | None, measured: Posterior | None
) -> tuple[list[Map], Block, Posterior]:
    """The best of methods that are alike beside all causes, and those that are so beside its own.

    All causes together imitate a method that is near the right one, few do not: where none explains what
    all do, those near are tried as well. Causes are those `measured` by accelerations, if there are any.
    """
    trials, ends = list[tuple[Block, Posterior]](), methods.ends
    for k, of in enumerate(methods.few):
        block = methods.blocks[k] if methods.blocks else at.beside(of)
        trials.append((block, measured or searched(at, block, before)))
        misfit = block.misfit(trials[-1][1].best.coefficients)
        explained = misfit <= max(FAR * methods.floor, block.least)
        if explained and (len(trials) >= len(ends) or not trials[-1][1].best.chosen):
            break
    ends = [*ends, *methods.others][: max(len(ends), len(trials))]
    k = _likeliest(at, trials, [of.fitted for of in ends])
    best, own = trials[k]
    return as_likely(at, ends, k, own.best), best, own


def as_likely(at: Regression, ends: Sequence[Map], best: int, fit: Fit) -> list[Map]:
    """The best of several maps, and those that are as likely beside the causes of a fit."""
    point, Phi = at.point, at.innovations.Phi
    moved = at.effect_of(fit.coefficients)
    white, _ = at.innovations(np.stack([point.errors(of.end, Phi) - moved for of in ends], axis=2))
    likely = alike(white, best, point.log.rounding)
    return [ends[best], *(ends[i] for i in likely if i != best)]


def _likeliest(
    at: Regression, trials: Sequence[tuple[Block, Posterior]], free: Sequence[int]
) -> int:
    """Which of several methods, each with the causes beside it and `free` numbers fitted, is the likeliest.

    Odds of a cause are those against all methods without it. What another method makes of it as likely,
    and much smaller, is what that does otherwise.
    """
    k = 0
    for i, (block, posterior) in enumerate(trials):
        best, own = trials[k]
        more = np.sign(len(posterior.best.chosen) - len(own.best.chosen))
        cost = price(free[i] - free[k], block.r.size)
        if log_evidence(block, posterior.best, best, own.best) - cost > more * CERTAIN:
            k = i
    best, own = trials[k]
    energy = at.exchanged(own.best)[0].max(initial=0.0)
    for i, (block, _) in enumerate(trials):
        fit = fitted((block,), own.best.chosen) if i != k and own.best.chosen else None
        if fit is None or log_evidence(block, fit, best, own.best) < -CERTAIN:
            continue
        if at.exchanged(fit)[0].max() < SLIGHT * energy:
            return i
    return k
