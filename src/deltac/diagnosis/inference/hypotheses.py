"""Hypotheses as factorisations of one Gram matrix, and their odds.

[r D]ᵀ[r D] is formed once; every hypothesis, nuisance columns with any set of causes, is a small
least-squares
problem in its entries. What no column models is correlated from row to row, so that N numbers count as
N/τ, with
τ = 1 + 2Σρ the integrated autocorrelation time of what is left (Sokal 1997):

    log odds = ½ (N/τ) ln(RSS_without/RSS_with) − ½ d ln(N/τ) − ln(number of alternatives)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import accumulate, combinations
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import EPS, NEGLIGIBLE, ROUGHLY, SAME, SMALL_SHARE, Array
from deltac.diagnosis.causes.causes import Candidate
from deltac.diagnosis.inference.whitening import inverse_sizes, least_squares

CANCELLED = 512 * EPS
"""Share of a sum of squares below which differences of Gram matrices have no digits: roundings of 10⁵ numbers
add up to their root. Fits to that are equal."""

LAGS = 200
"""Rows over which correlations are summed at most; to where they fall below `NEGLIGIBLE`."""

ITERATIONS, HALVINGS = 12, 4
"""Gauss–Newton steps of causes with squares of their numbers, and of the noise of several blocks; and how
often one is halved that leaves more than before."""

UNIFORM = 0.5
"""Least variance of the last digits of a log, in units of that of uniform ones: what is below is fitted."""


@dataclass(frozen=True, eq=False)
class Block:
    """Whitened equations of one kind: r (K, d) = D (K, d, p) x + noise of an unknown size of its own.

    nuisance  places of columns that every hypothesis has
    prior     standard deviation of their coefficients
    causes    places of the columns of causes, the same causes in all blocks
    rounding  least variance of the noise: what digits alone make of it
    spread    log det of the Cholesky factor by which r and D were whitened
    noise     variance beside which the prior of nuisance columns counts; 0: what all columns together leave
    origin    coefficients of the causes (P,) at which r was taken; zeros where empty
    """

    r: Array
    D: Array
    nuisance: NDArray[np.intp]
    prior: Array
    causes: NDArray[np.intp]
    rounding: float = 0.0
    spread: float = 0.0
    noise: float = 0.0
    origin: Array = field(default_factory=lambda: np.zeros(0))

    @cached_property
    def gram(self) -> tuple[Array, Array, float]:
        """DᵀD, Dᵀr, rᵀr."""
        D = self.D.reshape(self.r.size, self.D.shape[-1])
        r = self.r.ravel()
        return D.T @ D, D.T @ r, float(r @ r)

    def beside(self, noise: float) -> Block:
        """The same equations beside noise of this variance."""
        other = replace(self, noise=noise)
        other.__dict__.update(gram=self.gram, floor=self.floor)
        return other

    @cached_property
    def count(self) -> int:
        """How many numbers tell of the noise."""
        return max(self.r.size - len(self.nuisance), 1)

    @cached_property
    def floor(self) -> float:
        """Variance of the noise: what all columns together leave."""
        A, b, rr = self.gram
        some = np.concatenate([self.nuisance, self.causes])
        x = least_squares(A[some[:, None], some], b[some])
        rss = rr - 2.0 * float(b[some] @ x) + float(x @ A[some[:, None], some] @ x)
        return max(rss, CANCELLED * rr, 1e-300) / max(self.r.size - len(some), 1)

    @property
    def variance(self) -> float:
        """Of the noise, beside which the prior counts."""
        return self.noise or self.floor

    @cached_property
    def _spectrum(self) -> tuple[Array, Array, Array]:
        """Eigenvalues and vectors of the causes' Gram matrix beside the nuisance, in units of raw columns."""
        p = self.projected
        d = inverse_sizes(p.raw)
        values, vectors = np.linalg.eigh(d[:, None] * p.A * d)
        return values, vectors, d

    def evidence(self, fit: Fit, tau: float) -> float:
        """Log evidence of the block with the causes of a fit: likelihood less the price of free numbers."""
        # Numbers with a prior are integrated out: all rows tell of the noise, however many those are.
        rows = self.r.size / tau
        n = self.nuisance
        width = self.prior[:, None] * self.gram[0][np.ix_(n, n)] * self.prior / self.variance
        volume = 0.5 * float(np.linalg.slogdet(np.eye(len(n)) + width / tau)[1]) if len(n) else 0.0
        numbers = sum(c.size for c in fit.chosen)
        likelihood = -0.5 * rows * float(np.log(self.misfit(fit.coefficients)))
        return likelihood - volume - 0.5 * numbers * float(np.log(max(rows, 2.0)))

    def numbers(self, fit: Fit) -> tuple[Array, Array]:
        """Numbers of the nuisance columns beside the causes of a fit, and their covariance."""
        p, variance = self.projected, self.misfit(fit.coefficients) / self.count
        noise = variance * autocorrelation_time(self.residual(fit.coefficients))
        # No number is less known than by its prior, also beside more noise than that was taken beside.
        wider = np.diag(np.sqrt(max(noise - self.variance, 0.0)) / self.prior)
        rows = np.concatenate([p.triangle, wider])
        s = inverse_sizes(np.einsum("ij,ij->j", rows, rows))
        inverse = s[:, None] * np.linalg.pinv(rows * s, rcond=1e-14)
        return p.nuisance_at(fit.coefficients), inverse @ inverse.T * noise

    @property
    def rank(self) -> int:
        """Directions of all causes that the log tells from the nuisance."""
        return int(np.count_nonzero(self._spectrum[0] > SAME))

    @property
    def optimum(self) -> Array:
        """Coefficients (P,) of all columns of causes together, by least squares."""
        values, vectors, d = self._spectrum
        inverse = np.where(values > SAME, 1.0 / np.maximum(values, SAME), 0.0)
        step = d * (vectors @ (inverse * (vectors.T @ (d * self.projected.b))))
        return np.asarray(self.projected.origin + step)

    @cached_property
    def projected(self) -> Projected:
        """What the nuisance columns, with their prior, leave of the causes' Gram matrix.

        By QR: nuisance columns are nearly alike, and the squares of their condition would cost all digits.
        """
        A, b, rr = self.gram
        n, c = self.nuisance, self.causes
        origin = self.origin if len(self.origin) else np.zeros(len(c))
        D = self.D.reshape(self.r.size, self.D.shape[-1])
        s = inverse_sizes(np.diag(A)[n] + self.variance / self.prior**2)
        ridge = np.diag(np.sqrt(self.variance) / self.prior)
        basis, R = np.linalg.qr(np.concatenate([D[:, n], ridge]) * s)
        Q = basis[: len(D)]
        of_r, of_c = Q.T @ self.r.ravel(), (Q.T @ D)[:, c]
        inverse = s[:, None] * np.linalg.pinv(R, rcond=1e-14)
        rss = max(rr - float(of_r @ of_r), CANCELLED * rr, 1e-300)
        left = A[np.ix_(c, c)] - of_c.T @ of_c
        return Projected(
            left, b[c] - of_c.T @ of_r, rss, origin, np.diag(A)[c], inverse @ of_r,
            R / s, inverse @ of_c, rr, basis,
        )  # fmt: skip

    @cached_property
    def least(self) -> float:
        """RSS that digits alone make.

        Those of the rows are known, and columns are exact to half of a double's: what fits better than these
        allow is fitted to rounding. The last digits of a number that hardly changes make less than uniform
        ones; what all columns leave tells by how much.
        """
        rounding = np.clip(self.floor, UNIFORM * self.rounding, self.rounding)
        return max(CANCELLED * self.projected.total, float(rounding) * self.count)

    def misfit(self, coefficients: Array) -> float:
        """RSS with coefficients of causes, at least what digits alone make of it."""
        # Fits are compared again and again; a known array stays alive, so that its place is its own.
        known = self._misfits.get(id(coefficients))
        if known is None:
            left = self.projected.left(coefficients)
            if left <= CANCELLED * self.projected.size(coefficients):
                left = self.rest(coefficients)
            known = coefficients, max(left, self.least)
            self._misfits[id(coefficients)] = known
        return known[1]

    def rest(self, coefficients: Array) -> float:
        """RSS with coefficients of causes, of the residual itself: Gram matrices lose half of its digits."""
        Q, change = self.projected.basis, coefficients - self.projected.origin
        acting = np.flatnonzero(change)
        y = np.zeros(len(Q))
        y[: self.r.size] = (self.r - self.D[:, :, self.causes[acting]] @ change[acting]).ravel()
        for _ in range(2):  # what is left of large numbers is known to rounding then
            y -= Q @ (Q.T @ y)
        return float(y @ y)

    @cached_property
    def _misfits(self) -> dict[int, tuple[Array, float]]:
        return {}

    @cached_property
    def start(self) -> float:
        """The same without causes."""
        return self.misfit(np.zeros(len(self.causes)))

    def share_left(self, fit: Fit) -> float:
        """Share of the amplitude of r that the causes of a fit leave."""
        return float(np.sqrt(self.misfit(fit.coefficients) / self.start))

    def residual(self, coefficients: Array) -> Array:
        """What is left of r (K, d) with coefficients of the causes' columns, nuisance fitted beside."""
        x, change = self.projected.nuisance_at(coefficients), coefficients - self.projected.origin
        acting = np.flatnonzero(change)
        columns = np.concatenate([self.nuisance, self.causes[acting]])
        return np.asarray(self.r - self.D[:, :, columns] @ np.concatenate([x, change[acting]]))


ALL_COLUMNS = slice(None)
"""The default of `Projected.slope`."""


@dataclass(frozen=True, eq=False)
class Projected:
    """The causes' Gram matrix after the nuisance columns, with Dᵀr, RSS and nuisance numbers at an origin.

    `basis` is orthonormal, of the nuisance columns and the rows of their prior; `triangle` makes these of it.
    """

    A: Array
    b: Array
    rss: float
    origin: Array
    raw: Array
    nuisance: Array
    triangle: Array
    to: Array
    total: float
    basis: Array

    def _change(self, coefficients: Array) -> tuple[NDArray[np.intp], Array]:
        """Places and sizes of what is other than at the origin: a few causes have few of many columns."""
        change = coefficients - self.origin
        some = np.flatnonzero(change)
        return some, change[some]

    def left(self, coefficients: Array) -> float:
        """RSS with coefficients of causes."""
        some, x = self._change(coefficients)
        gain = 2.0 * float(self.b[some] @ x) - float(x @ self.A[some[:, None], some] @ x)
        return max(self.rss - gain, CANCELLED * self.total)

    def size(self, coefficients: Array) -> float:
        """Sum of squares of which differences make what is left, about."""
        some, x = self._change(coefficients)
        return self.total + float(self.raw[some] @ x**2)

    def slope(self, coefficients: Array, columns: NDArray[np.intp] | slice = ALL_COLUMNS) -> Array:
        """Dᵀr of some columns with coefficients of causes: half the derivative of the RSS, negative."""
        some, x = self._change(coefficients)
        return np.asarray(self.b[columns] - self.A[columns][:, some] @ x)

    def nuisance_at(self, coefficients: Array) -> Array:
        """Coefficients of the nuisance columns beside those of causes."""
        return np.asarray(self.nuisance - self.to @ (coefficients - self.origin))


def autocorrelation_time(r: Array) -> float:
    """τ = 1 + 2Σρ of residuals (K, d), K in the order of time; at least 1."""
    flat, d = r.ravel(), r.shape[1]
    power = float(flat @ flat)
    if not power > 0.0:
        return 1.0
    total = 0.0
    for lag in range(1, min(LAGS, len(r) // 4)):
        rho = float(flat[lag * d :] @ flat[: -lag * d]) / power
        if rho < NEGLIGIBLE:
            break
        total += rho
    return 1.0 + 2.0 * total


@dataclass(frozen=True, eq=False)
class Fit:
    """A set of causes with their numbers.

    chosen        the causes
    theta         their numbers, one array a cause
    coefficients  of all causes' columns (P,)
    log_odds      against the hypothesis without the last of them
    covariance    of all numbers
    factors       what the others multiply each by
    """

    chosen: tuple[Candidate, ...]
    theta: tuple[Array, ...]
    coefficients: Array
    log_odds: float
    covariance: Array
    tangent: Array = field(repr=False)
    each: tuple[float, ...] = ()

    factors: tuple[float, ...] = ()

    def of(self, place: int) -> Array:
        """Coefficients of the columns of one of the causes, beside the others."""
        factor = self.factors[place] if self.factors else 1.0
        return factor * self.chosen[place].coefficients(self.theta[place])

    def repeats(self, other: Fit) -> bool:
        """Whether it is another set in more numbers, of which those that the other lacks are none."""
        gap = np.abs(self.coefficients - other.coefficients)
        deviation = np.sqrt(np.einsum("ij,jk,ik->i", self.tangent, self.covariance, self.tangent))
        return bool(np.all(gap <= SIGNIFICANT * deviation + SAME * np.abs(other.coefficients)))

    def alike(self, other: Fit) -> bool:
        """Whether another set has the same causes."""
        return [c.name for c in self.chosen] == [c.name for c in other.chosen]

    def settled(self, other: Fit) -> bool:
        """Whether another set has the same causes, whose numbers are the same within their errors.

        What Gauss and Newton's next step adds is of second order in that.
        """
        if not self.alike(other):
            return False
        numbers = [np.concatenate(fit.theta) for fit in (self, other)]
        error = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        allowed = error + SAME * np.abs(numbers[1])
        return bool(np.all(np.abs(numbers[0] - numbers[1]) <= allowed))

    def deviation(self, place: int) -> Array:
        """Standard errors of the numbers of a cause."""
        start = sum(c.size for c in self.chosen[:place])
        some = slice(start, start + self.chosen[place].size)
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance)[some], 0.0)))


def nothing(columns: int) -> Fit:
    """No cause."""
    return Fit((), (), np.zeros(columns), 0.0, np.zeros((0, 0)), np.zeros((columns, 0)))


class _Together:
    """Causes at once: their numbers x, one after the other, as coefficients of their own columns.

    `own` are the places of these columns among those of all causes, hundreds. `limits` are those of numbers
    that have squares. `grown`: whether some multiply others.
    """

    def __init__(self, chosen: Sequence[Candidate]) -> None:
        self.chosen = chosen
        own = sorted({k for c in chosen for k in c.columns})
        place = {k: i for i, k in enumerate(own)}
        self.own = np.array(own, dtype=np.intp)
        self.rows = [np.array([place[k] for k in c.columns]) for c in chosen]
        last = list(accumulate(c.size for c in chosen))
        self.numbers = [slice(end - c.size, end) for c, end in zip(chosen, last)]
        self.size = last[-1]
        units = [[c.scales(other) for other in chosen] for c in chosen]
        self.grown = any(map(any, units))
        self.units = np.array(units) if self.grown else np.zeros((0, 0))
        self.linear = not self.grown and all(c.quadratic is None for c in chosen)
        bounds = [c.limit if c.quadratic is not None else np.inf for c in chosen]
        self.limits = np.repeat(bounds, [c.size for c in chosen])
        self._fixed: Array | None = None
        self._fixed = self.tangent(np.zeros(self.size)) if self.linear else None

    def split(self, x: Array) -> tuple[Array, ...]:
        """The numbers of each cause."""
        return tuple(x[of] for of in self.numbers)

    def factors(self, x: Array) -> list[float]:
        """What the others multiply each by: the mass centre of a heavier body moves a heavier mass."""
        if not self.grown:
            return [1.0] * len(self.chosen)
        first = x[[of.start for of in self.numbers]]
        return list((1.0 + first @ self.units).tolist())

    def coefficients(self, x: Array) -> Array:
        """Of the own columns."""
        if self._fixed is not None:
            return np.asarray(self._fixed @ x)
        result = np.zeros(len(self.own))
        of_each = zip(self.chosen, self.split(x), self.rows, self.factors(x))
        for c, theta, at, factor in of_each:
            result[at] += factor * c.coefficients(theta)
        return result

    def bent(self, number: int) -> Array:
        """What the square of a number adds to these."""
        result = np.zeros(len(self.own))
        for c, at, of in zip(self.chosen, self.rows, self.numbers):
            if c.quadratic is not None and of.start <= number < of.stop:
                k = number - of.start
                np.add.at(result, at, c.quadratic[:, k, k])
        return result

    def tangent(self, x: Array) -> Array:
        """Derivatives (columns, numbers) of these."""
        if self._fixed is not None:
            return self._fixed
        T = np.zeros((len(self.own), self.size))
        of_each = zip(self.chosen, self.split(x), self.rows, self.numbers, self.factors(x))
        for k, (c, theta, at, of, factor) in enumerate(of_each):
            T[at, of] += factor * c.tangent(theta)
            for j in np.flatnonzero(self.units[:, k]) if self.grown else ():
                T[at, self.numbers[j].start] += self.units[j, k] * c.coefficients(theta)
        return T


def fitted(
    blocks: Sequence[Block], chosen: Sequence[Candidate], start: Sequence[Array] = ()
) -> Fit | None:
    """The numbers of causes together by maximum likelihood; None where they are not told apart."""
    P, causes = len(blocks[0].causes), _Together(chosen)
    own, x = causes.own, np.zeros(causes.size)
    for of, theta in zip(causes.numbers, start):
        x[of] = theta
    raw = [b.gram[0][(at := b.causes[own])[:, None], at] for b in blocks]
    left_of = [b.projected.A[own[:, None], own] for b in blocks]
    variance = [b.start / b.count for b in blocks]
    prior = causes.limits**-2.0
    if not causes.linear:
        # Where the linear effect of a number vanishes, its square tells; at zero that has no slope.
        T = causes.tangent(x)
        terms = sum((np.sqrt(np.diag(G)) @ np.abs(T)) ** 2 for G in raw)
        vanishing = sum(((G @ T) * T).sum(axis=0) for G in raw) <= CANCELLED * terms
        x = np.where(vanishing & (x == 0.0) & (prior > 0.0), ROUGHLY * causes.limits, x)

    def coefficients(x: Array) -> Array:
        every = np.zeros(P)
        every[own] = causes.coefficients(x)
        return every

    def inverted(T: Array) -> Array | None:
        """The inverse of the normal matrix; None where it is singular."""
        squares = sum((((G @ T) * T).sum(axis=0) / s for G, s in zip(raw, variance)), start=prior)
        if not np.all(squares > 0.0):
            return None
        d = inverse_sizes(squares)
        X = sum((T.T @ A @ T / s for A, s in zip(left_of, variance)), start=np.diag(prior))
        values, vectors = np.linalg.eigh(d[:, None] * X * d)
        if not values[0] >= SAME:
            return None
        return np.asarray(d[:, None] * ((vectors / values) @ vectors.T) * d)

    # What is linear is at its optimum after one step, but for the noise of several blocks.
    once = causes.linear and len(blocks) == 1
    every, inverse = coefficients(x), np.zeros((0, 0))
    for _ in range(1 if once else ITERATIONS):
        T = causes.tangent(x)
        if (now := inverted(T)) is None:
            return None
        inverse = now
        slopes = [T.T @ b.projected.slope(every, own) for b in blocks]
        step = inverse @ sum(y / s for y, s in zip(slopes, variance))
        for _ in range(0 if causes.linear else HALVINGS):
            there = coefficients(x + step)
            left = sum(b.projected.left(there) / s for b, s in zip(blocks, variance))
            if left <= sum(b.projected.left(every) / s for b, s in zip(blocks, variance)):
                break
            step = 0.5 * step
        x = x + step
        every, before = coefficients(x), variance
        variance = [b.misfit(every) / b.count for b in blocks]
        gain = sum(float(y @ step) / s for y, s in zip(slopes, variance))
        if not once and gain < ROUGHLY**2:  # of the sum of squares, in units of the noise
            break
    T = causes.tangent(x)
    covariance = inverse * (variance[0] / before[0]) if once else inverted(T)
    if covariance is None:
        return None
    if not causes.linear:
        # Of t x + q x² = 1, where q is what the squares of a number add: t alone may be none.
        shares = np.ones(causes.size)
        for k, b in enumerate(np.diag(covariance)):
            bent = causes.bent(k)
            q = sum(float(bent @ A @ bent) / s for A, s in zip(left_of, variance))
            shares[k] = 2.0 / (1.0 + np.sqrt(1.0 + 4.0 * b * np.sqrt(max(q, 0.0))))
        covariance = shares[:, None] * covariance * shares
    along = np.zeros((P, causes.size))
    along[own] = T
    factors = tuple(causes.factors(x))
    return Fit(tuple(chosen), causes.split(x), every, 0.0, covariance, along, factors=factors)


def evidence(
    blocks: Sequence[Block], without: Fit, fit: Fit, alternatives: int, exact: bool
) -> float:
    """Log odds of a fit against one with fewer causes; τ of what it leaves where `exact`, else 1."""
    numbers = sum(c.size for c in fit.chosen) - sum(c.size for c in without.chosen)
    total, independent = 0.0, 0.0
    for b in blocks:
        tau = autocorrelation_time(b.residual(fit.coefficients)) if exact else 1.0
        rows = b.count / tau
        before, after = b.misfit(without.coefficients), b.misfit(fit.coefficients)
        total += 0.5 * rows * float(np.log(before / after))
        independent += rows
    return total - price(numbers, independent, alternatives)


@dataclass(frozen=True, eq=False)
class Posterior:
    """What the log says of the causes.

    best          the set of causes that is preferred; none where no cause has odds
    alternatives  sets with another last cause, within odds of 99 : 1
    scores        log odds of single causes, the best first, with the joules that they exchange
    """

    best: Fit
    alternatives: tuple[Fit, ...]
    scores: tuple[tuple[float, Candidate, float], ...]


CERTAIN = float(np.log(99.0))
"""Log odds from which on a cause is told, also from others."""

SIGNIFICANT = 4.0
"""Standard errors beyond which a number is another one."""

SHORTLIST = 12
"""Causes of which the correlation of what they leave is looked at."""

TOGETHER, MANY = 3, 24
"""Maximum numbers of simultaneous causes, by prediction errors and by known accelerations."""


PROMISING = 48
"""Causes that are fitted in full at most."""


def _ordered(
    blocks: Sequence[Block], best: Fit, candidates: Sequence[Candidate]
) -> list[tuple[float, Candidate]]:
    """The causes that alone explain most of what is left, by the most that each may add to the log odds.

    That is by the columns that the chosen causes leave of its own: exact for a cause that is linear in its
    numbers.
    """
    alone, beside, rows, least = [], [], 0.0, 0.0
    for block in blocks:
        p, now = block.projected, best.coefficients
        variance = block.misfit(now) / block.count
        A, b = p.A / variance, p.slope(now) / variance
        alone.append((A, b))
        if best.chosen:
            to = A @ best.tangent
            inner = np.linalg.pinv(best.tangent.T @ to, rcond=SAME, hermitian=True)
            A, b = A - to @ inner @ to.T, b - to @ (inner @ (best.tangent.T @ b))
        beside.append((A, b))
        rows += block.count
        least += block.least / variance

    gains = _gains(alone, _stacked(tuple(candidates)), len(candidates))
    promising = list[Candidate]()
    for k in np.argsort(-gains, kind="stable").tolist():
        c = candidates[k]
        if not any(c is x or c.excludes(x) or x.excludes(c) for x in best.chosen):
            promising.append(c)
        if len(promising) == PROMISING:
            break
    numbers = [c.linear if c.quadratic is None else np.eye(len(c.columns)) for c in promising]
    gains = _gains(beside, _alike(promising, numbers), len(promising))
    bounds = []
    for c, gain in zip(promising, gains.tolist()):
        left = max(rows - gain, least, 1e-300)
        most = 0.5 * rows * float(np.log(rows / left))
        bounds.append((most - price(c.size, rows, len(candidates)), c))
    bounds.sort(key=lambda item: -item[0])
    return bounds


Stack: TypeAlias = tuple[NDArray[np.intp], NDArray[np.intp], Array]
"""Causes that have as many columns and numbers as each other: their places, columns (k, a), L (k, a, d)."""


def _alike(causes: Sequence[Candidate], numbers: Sequence[Array]) -> list[Stack]:
    """Causes whose columns times `numbers` are what they do, by the shape of these."""
    places: dict[tuple[int, ...], list[int]] = {}
    for k, L in enumerate(numbers):
        places.setdefault(L.shape, []).append(k)
    return [
        (
            np.array(some),
            np.array([causes[k].columns for k in some]),
            np.array([numbers[k] for k in some]),
        )
        for some in places.values()
    ]


@lru_cache(4)
def _stacked(causes: tuple[Candidate, ...]) -> list[Stack]:
    """All causes of a log to first order: they are compared again and again."""
    return _alike(causes, [c.linear for c in causes])


def _gains(parts: Sequence[tuple[Array, Array]], stacks: Sequence[Stack], count: int) -> Array:
    """What each of so many causes takes off the sums of squares of parts (DᵀD, Dᵀr)."""
    gains = np.zeros(count)
    for places, columns, L in stacks:
        to_numbers = L.transpose(0, 2, 1)
        A = np.zeros((len(places), L.shape[2], L.shape[2]))
        b = np.zeros((len(places), L.shape[2], 1))
        for gram, right in parts:
            A += to_numbers @ gram[columns[:, :, None], columns[:, None, :]] @ L
            b += to_numbers @ right[columns][:, :, None]
        gains[places] = np.sum(b * least_squares(A, b), axis=(1, 2))
    return gains


def price(numbers: int, rows: float, alternatives: int = 1) -> float:
    """Log odds that free numbers and the choice among alternatives cost."""
    return 0.5 * numbers * float(np.log(max(rows, 2.0))) + float(np.log(max(alternatives, 1)))


def search(
    blocks: Sequence[Block],
    candidates: Sequence[Candidate],
    exchanged: Callable[[Fit], Array],
    least: float,
    negligible: float = 0.0,
    most: int = TOGETHER,
    beside: float = NEGLIGIBLE,
    pairs: bool = False,
    start: Fit | None = None,
    enough: float = 0.0,
) -> Posterior:
    """The causes with the best odds, one after the other, each beside all before, and those of a `start`.

    Beside the one that was added, another may come in the place of each before (sequential replacement: A.
    Miller, Subset Selection in Regression, 2002, ch. 3).
    `exchanged` are the joules that each cause of a fit exchanges; a cause of less than `least` is not told,
    one of less than `negligible` only if it leaves next to nothing (`SMALL_SHARE`) of what was left before.
    `most` are found together, each with a share of `beside` of the largest at least; the search stops where
    they leave a share `enough` of the sum of squares. `pairs`: mass and mass centre of a body at once.
    """
    best, near = start or nothing(len(blocks[0].causes)), list[Fit]()
    scores: list[tuple[float, Candidate, float]] = []

    def extended(without: Fit, wanted: int) -> list[tuple[float, Fit]]:
        """A set with one cause more, each with its odds: by the likeliest, and so many at least."""
        fits, top = list[tuple[float, Fit]](), CERTAIN
        for bound, c in _ordered(blocks, without, candidates):
            if len(fits) >= wanted and bound < top - CERTAIN:
                break
            fit = fitted(blocks, (*without.chosen, c), without.theta)
            if fit is None or not all(x.plausible(t) for x, t in zip(fit.chosen, fit.theta)):
                continue
            joules = exchanged(fit)
            if joules.min() < max(least, beside * joules.max()):
                continue
            if joules.min() < negligible and not _explains_all(blocks, without, fit):
                continue
            fits.append((evidence(blocks, without, fit, len(candidates), False), fit))
            top = max(top, fits[-1][0])
        return fits

    for _ in range(most):
        fits = extended(best, 0 if scores else SHORTLIST)
        alone = max(fits, key=lambda item: item[0])[1] if fits else best
        for pair in _of_one_body(best, candidates) if pairs else ():
            fit = fitted(blocks, (*best.chosen, *pair), best.theta)
            if fit is None or not all(x.plausible(t) for x, t in zip(fit.chosen, fit.theta)):
                continue
            left = [b.misfit(fit.coefficients) / b.misfit(alone.coefficients) for b in blocks]
            if exchanged(fit).min() >= max(least, negligible) and max(left) < NEGLIGIBLE:
                fits.append((evidence(blocks, best, fit, len(candidates), False), fit))
        fits.sort(key=lambda item: (-round(item[0], 3), item[1].chosen[-1].rank(item[1].theta[-1])))
        if not scores:
            scores = [(e, f.chosen[-1], float(exchanged(f)[0])) for e, f in fits[:SHORTLIST]]
        if not fits or fits[0][0] < CERTAIN:
            break
        near = [f for e, f in fits if e >= fits[0][0] - CERTAIN]
        best = min(near, key=lambda f: f.chosen[-1].rank(f.theta[-1]))
        # A cause that was found before the others may have stood for one that explains more beside them.
        for k in range(len(best.chosen) - 1):
            if all(b.misfit(best.coefficients) <= b.count for b in blocks):
                break
            others = _without(blocks, best, k)
            now = evidence(blocks, others, best, len(candidates), False)
            odds, other = max(extended(others, 0), key=lambda item: item[0], default=(now, best))
            if odds > now + CERTAIN:
                best, near = other, [other]
        if all(b.misfit(best.coefficients) <= enough * b.start for b in blocks):
            break
    return Posterior(*_pruned(blocks, best, near, len(candidates)), tuple(scores))


def several_of_one_kind(
    block: Block,
    candidates: Sequence[Candidate],
    exchanged: Callable[[Fit], Array],
    least: float,
) -> list[Fit]:
    """Sets of several causes of one kind or two, or of one body, each plausible and of some joules.

    Files of mechanisms leave dampers and rotors out of all joints, and payloads change all the inertia of a
    body. One after the other, something else that does a little of all that they do would be preferred.
    """
    none, sets = nothing(len(block.causes)), list[Fit]()
    acting = np.flatnonzero(block.projected.raw).tolist()  # what stands still tells of no number
    for some in _of_one_kind([c for c in candidates if not set(c.columns).isdisjoint(acting)]):
        fit: Fit | None = none
        while fit is not None and len(some) > 1 and len(fit.chosen) != len(some):
            fit = fitted((block,), some)
            if fit is not None:
                each = zip(fit.chosen, fit.theta, exchanged(fit).tolist(), strict=True)
                some = [c for c, theta, joules in each if joules >= least and c.plausible(theta)]
        if fit is not None and len(some) > 1 and not any(fit.alike(one) for one in sets):
            sets.append(fit)
    return sets


def _of_one_kind(candidates: Sequence[Candidate]) -> Iterator[list[Candidate]]:
    """Causes of one number that are the same mistake, or two that files make in all joints.

    Also mass, mass centre and moments of a body, which a payload changes together.
    """
    kinds: dict[str, list[Candidate]] = {}
    for c in candidates:
        if c.size == 1:
            kinds.setdefault(c.kind, []).append(c)
    several = {
        kind: some
        for kind, some in kinds.items()
        if 1 < len(some) == len({c.what for c in some}) <= MANY
    }
    yield from several.values()
    for one, other in combinations([several[kind] for kind in LEFT_OUT if kind in several], 2):
        yield [*one, *other]
    # Of a mass centre that may move along one axis or several, the last is that of most.
    own = {(c.kind, c.element): c for c in sorted(candidates, key=lambda c: c.size)}
    for body in [element for kind, element in own if kind == "body-mass"][:MANY]:
        for moments in ("body-moments", "body-tensor"):
            some = [own.get((kind, body)) for kind in ("body-mass", "body-centre", moments)]
            inertia = [c for c in some if c is not None]
            if len(inertia) == len(some):
                yield inertia


LEFT_OUT = ("missing-damper", "missing-rotor-inertia", "missing-friction")
"""What files of mechanisms leave out of joints, and simulators have."""


def _of_one_body(
    best: Fit, candidates: Sequence[Candidate]
) -> Iterator[tuple[Candidate, Candidate]]:
    """Mass and mass centre of a body: neither alone looks like both."""
    free = [c for c in candidates if not any(c is x or c.excludes(x) for x in best.chosen)]
    centres = [c for c in free if c.kind == "body-centre"]
    for mass in free:
        own = [c for c in centres if c.element == mass.element and mass.kind == "body-mass"]
        if own:
            yield mass, max(own, key=lambda c: c.size)


def _explains_all(blocks: Sequence[Block], without: Fit, fit: Fit) -> bool:
    return all(
        b.misfit(fit.coefficients) <= SMALL_SHARE * b.misfit(without.coefficients) for b in blocks
    )


def refitted(
    blocks: Sequence[Block], before: Posterior, candidates: Sequence[Candidate]
) -> Posterior:
    """The same causes with their numbers fitted anew, without those that have no odds any more.

    Of sets that explained as much before, and of simpler causes in the place of one of several numbers, those
    that explain as much here are equal again: what is preferred may be another one.
    """
    likely = [c for odds, c, _ in before.scores if odds > CERTAIN]
    sets = [(f.chosen, f.theta) for f in (before.best, *before.alternatives)]
    chosen, theta = sets[0]
    for k, c in enumerate(chosen):
        rest = [*chosen[:k], *chosen[k + 1 :]], [*theta[:k], *theta[k + 1 :]]
        sets += [
            ((*rest[0], simple), tuple(rest[1]))
            for simple in candidates
            if simple.size < c.size
            and (simple in likely or set(simple.columns) <= set(c.columns))
            and not any(simple is x or simple.excludes(x) or x.excludes(simple) for x in rest[0])
        ]
    fits = [fit for fit in (fitted(blocks, *some) for some in sets if some[0]) if fit is not None]
    fits = [f for f in fits if all(c.plausible(x) for c, x in zip(f.chosen, f.theta))]
    if not fits:
        return before
    odds = np.zeros(len(fits))
    for b in blocks:
        tau = max(autocorrelation_time(b.residual(fit.coefficients)) for fit in fits)
        odds += [b.evidence(fit, tau) for fit in fits]
    equal = [fit for fit, e in zip(fits, odds) if e >= odds.max() - CERTAIN]
    best = min(equal, key=lambda f: sum(c.rank(x) for c, x in zip(f.chosen, f.theta)))
    if any(c.kind == "body-centre" for c in best.chosen):  # along fewer axes, if these do as well
        same = [(c.kind, c.element) for c in best.chosen]
        alike = (f for f in equal if [(c.kind, c.element) for c in f.chosen] == same)
        best = min(alike, key=lambda f: sum(map(len, f.theta)))
    best, near = _pruned(blocks, best, [f for f in equal if f is not best], len(candidates))
    return Posterior(best, near, before.scores)


def _pruned(
    blocks: Sequence[Block], best: Fit, near: list[Fit], alternatives: int
) -> tuple[Fit, tuple[Fit, ...]]:
    """The set without causes that have no odds beside the others, and other sets that explain as much.

    Each is judged by what all others leave: a cause that is not in the set yet makes what is left correlated.
    """
    whole = best
    while best.chosen:
        odds = []
        for k in range(len(best.chosen)):
            others = _without(blocks, best, k)
            odds.append(evidence(blocks, others, best, alternatives, True))
        worst = int(np.argmin(odds))
        if odds[worst] >= CERTAIN:
            best = replace(best, log_odds=odds[-1], each=tuple(odds))
            equals = near if best.chosen == whole.chosen else []
            return best, tuple(f for f in equals if not f.repeats(best))
        best = _without(blocks, best, worst)
    return best, ()


STRETCHES = 16
"""Stretches of a log of which the scores are compared."""


def steadfast(posterior: Posterior, blocks: Sequence[Block], alternatives: int) -> Posterior:
    """The posterior without causes that stretches of the log do not agree on.

    A number of the equations is the same in all of them. What imitates a cause, as errors that come and go,
    is not: the scatter of its scores between stretches is larger than what is left says (the cluster-robust
    test of Liang & Zeger, Biometrika 73, 1986, by Student's distribution).
    """
    best = posterior.best
    while best.chosen:
        odds = np.array(_by_stretches(blocks, best, alternatives))
        possible = [c.possible(x) for c, x in zip(best.chosen, best.theta, strict=True)]
        odds[~np.array(possible)] = -np.inf
        worst = int(np.argmin(odds))
        others = _without(blocks, best, worst)
        # What explains nearly everything that the others leave is no imitation.
        if odds[worst] >= CERTAIN or (possible[worst] and _explains_all(blocks, others, best)):
            break
        best = others
    if best is posterior.best:
        return posterior
    each = [
        evidence(blocks, _without(blocks, best, k), best, alternatives, True)
        for k in range(len(best.chosen))
    ]
    best = replace(best, log_odds=each[-1] if each else 0.0, each=tuple(each))
    return Posterior(best, (), posterior.scores)


def _by_stretches(blocks: Sequence[Block], fit: Fit, alternatives: int) -> list[float]:
    """Log odds of each cause of a fit, by the scatter of the scores of all between stretches."""
    own = np.flatnonzero(fit.tangent.any(axis=1))
    normal, scores, rows = np.zeros((fit.tangent.shape[1],) * 2), list[Array](), 0.0
    for b in blocks:
        r = b.residual(fit.coefficients)
        X = (b.D[:, :, b.causes[own]] @ fit.tangent[own]).reshape(r.size, -1)
        Q = b.projected.basis[: r.size]
        X = X - Q @ (Q.T @ X)
        variance = b.misfit(fit.coefficients) / b.count
        normal += X.T @ X / variance
        scores += [x / variance for x in _scores(r, X, Q)]
        rows += b.count / autocorrelation_time(r)
    G = np.array(scores)
    inverse = np.linalg.pinv(normal, hermitian=True)
    covariance = inverse @ (G.T @ G) @ inverse
    freedom, odds, first = max(len(G) - 1, 1), list[float](), 0
    for theta in fit.theta:
        some = slice(first, first + len(theta))
        first += len(theta)
        square = float(theta @ np.linalg.pinv(covariance[some, some], hermitian=True) @ theta)
        likelihood = 0.5 * (freedom + len(theta)) * float(np.log1p(square / freedom))
        odds.append(likelihood - price(len(theta), rows, alternatives))
    return odds


def _scores(r: Array, X: Array, Q: Array) -> Iterator[Array]:
    """Scores of each stretch, where columns (K · d, q) leave r (K, d).

    Residuals of rows with a large leverage are smaller than the errors that made them: each stretch has
    (1 − H)^−½ r, H its block of the hat matrix (Bell & McCaffrey, Survey Methodology 28, 2002). Q spans the
    nuisance columns. The boundaries divide the mean of time and information equally.
    """
    Y = np.linalg.qr(X * inverse_sizes(np.sum(X**2, axis=0)))[0]
    Z = np.concatenate([Q, Y], axis=1)
    information = np.sum(Y**2, axis=1).reshape(r.shape).sum(axis=1) + Y.shape[1] / len(r)
    share = np.cumsum(information) / information.sum()
    ends = np.unique(np.searchsorted(share, np.arange(1, STRETCHES) / STRETCHES)) + 1
    ends = ends[ends < len(r)]
    for part in np.split(np.arange(r.size).reshape(r.shape), ends):
        some = part.ravel()
        rest = r.ravel()[some]
        leverage, along = np.linalg.eigh(Z[some].T @ Z[some])
        acting = leverage > SAME
        own = Z[some] @ along[:, acting] / np.sqrt(leverage[acting])
        grown = 1.0 / np.sqrt(np.maximum(1.0 - leverage[acting], SAME)) - 1.0
        yield X[some].T @ (rest + own @ (grown * (own.T @ rest)))


def _without(blocks: Sequence[Block], fit: Fit, k: int) -> Fit:
    """The set without one of its causes, its numbers fitted anew."""
    rest = [*fit.chosen[:k], *fit.chosen[k + 1 :]]
    other = fitted(blocks, rest, [*fit.theta[:k], *fit.theta[k + 1 :]]) if rest else None
    return other or nothing(len(blocks[0].causes))


def deviation(blocks: Sequence[Block], c: Candidate, best: Fit, tau: float) -> float:
    """Standard error of the number of a cause of one, beside those of a fit."""
    columns, L = list(c.columns), c.linear[:, 0]
    information = 0.0
    for b in blocks:
        p = b.projected
        variance = p.left(best.coefficients) / b.count
        information += float(L @ p.A[np.ix_(columns, columns)] @ L) / variance
    return float(np.sqrt(tau / information)) if information > 0.0 else np.inf


def beyond_causes(block: Block, best: Fit) -> tuple[float, float, Array]:
    """Log odds and share of what all columns explain beyond the best set, and their coefficients so far."""
    coefficients, rank = block.optimum, block.rank
    # So many columns fit noise as well: it is told by the numbers that they leave free.
    free = max(block.count - rank, 1)
    rows = free / autocorrelation_time(block.residual(coefficients))
    before, after = block.misfit(best.coefficients), block.misfit(coefficients)
    ratio = max(before * free / (after * block.count), 1.0)
    odds = 0.5 * rows * float(np.log(ratio)) - 0.5 * rank * float(np.log(max(rows, 2.0)))
    return odds, 1.0 - 1.0 / ratio, coefficients - best.coefficients


def intermittent(
    block: Block, best: Fit, thinned: NDArray[np.bool_]
) -> tuple[float, NDArray[np.bool_]]:
    """Log odds that what is left comes in intervals of their own, and these intervals (N,).

    Two variances, of quiet and of active intervals, against the one of the best causes; each spell of
    activity costs its two ends. What logged forces did in intervals of which steps are lost is not known:
    beside others that are whole, these tell nothing.
    """
    none = np.zeros(len(block.r), dtype=np.bool_)
    whole = np.flatnonzero(~thinned) if not thinned.all() else np.arange(len(block.r))
    r = block.residual(np.zeros(len(block.causes)))[whole]
    n, d = r.shape
    size = np.mean(r**2, axis=1) + 1e-300
    ordered = np.sort(size)
    quiet = float(np.median(ordered[: max(4, n // 2)])) + 1e-300
    active = size > ACTIVE * quiet
    if not 2 < active.sum() < 0.7 * n:
        return -np.inf, none
    # What acts begins and ends from one interval to the next: a remainder of the series comes and goes
    # smoothly.
    edges = np.flatnonzero(np.diff(active.astype(int)))
    if active[0] and len(edges) == 1:  # what a log begins with fades, as the start of a filter does
        return -np.inf, none
    ratio = np.abs(np.log(size[edges + 1] / size[edges]))
    if not np.median(ratio) > np.log(ACTIVE):
        return -np.inf, none
    if len(block.nuisance):
        # Nuisance columns of quiet intervals alone: what acts now and then must not bend them.
        D, y = block.D[whole][:, :, block.nuisance], block.r[whole]
        ridge = np.diag(np.sqrt(block.floor) / block.prior)
        A = np.concatenate([D[~active].reshape(-1, D.shape[2]), ridge])
        b = np.concatenate([y[~active].ravel(), np.zeros(len(ridge))])
        r = y - D @ np.linalg.lstsq(A, b, rcond=1e-13)[0]
    low, high = float(np.mean(r[~active] ** 2)), float(np.mean(r[active] ** 2))
    share = active.mean()
    one = float(np.mean(block.residual(best.coefficients)[whole] ** 2))
    tau = autocorrelation_time(r[~active])
    spells = int(np.count_nonzero(np.diff(active.astype(int)) == 1)) + 1
    two = (1 - share) * np.log(low + 1e-300) + share * np.log(high + 1e-300)
    odds = 0.5 * n * d / tau * (np.log(one + 1e-300) - two)
    none[whole] = active
    return float(odds - 2.0 * spells * np.log(n)), none


ACTIVE = 100.0
"""Variance of an interval beside that of quiet ones from which on something acts in it that does not in
those."""
