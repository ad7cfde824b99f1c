"""Prediction errors, whitened by the Cholesky factor of their covariance.

The prediction errors w_k = y_{k+1} − φ_k(y_k) = e_{k+1} − Φ_k e_k + B_k θ + v_k of a log are a moving
average of order one in the noise e of its rows, with what the flow does not know, v, added. Their covariance

    E w_k w_kᵀ = R_{k+1} + Φ_k R_k Φ_kᵀ + Q_k ,        E w_{k+1} w_kᵀ = −Φ_{k+1} R_{k+1}

is block-tridiagonal. Its Cholesky factor L is banded, and r = L⁻¹w are the innovations of Kalman's filter
(Schweppe 1965): independent, of unit variance where the noise is as assumed. L⁻¹B are the columns of the
parameters beside them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from deltac.arrays import Array

RIDGE = 1e-10
"""Share of each variance, or column's square, that keeps a matrix of products positive definite.

Half the digits of a double: it is not seen in what is inferred.
"""

GROUP = 16
"""Rows of a block at least: smaller ones are substituted faster together than one after the other."""


@dataclass(frozen=True, eq=False)
class Innovations:
    """The whitener of the prediction errors of N intervals, with 2n components each.

    Args:
        pieces: first and last + 1 of consecutive intervals.
        Phi: transition matrices (N, 2n, 2n).
        noise: standard deviations (N, 2n) of the rows at the starts of the intervals, and at their ends.
        Q: covariance (N, 2n, 2n) of what the flow does not know.
        speeds: whether rows have speeds. If not, three rows of coordinates tell: what the speeds of a row are
            is eliminated, so that nothing is assumed of them.
    """

    pieces: Sequence[tuple[int, int]]
    Phi: Array
    noise: tuple[Array, Array]
    Q: Array
    speeds: bool = True

    def __call__(self, columns: Array) -> tuple[Array, float]:
        """L⁻¹ of columns (N, 2n, p), an array (N, d, p), and log det L; d is 2n, without speeds n."""
        inverse, below, scale, log_det = self._factor
        y = self._without_speeds(columns)
        r = inverse @ self._grouped(y, scale[:, :, None])
        # Forward substitution block by block, all columns at once; what is precomputed is of all blocks.
        wide = below.shape[2]
        carry = inverse[1:, :, :wide] @ below[:-1]
        for k in range(1, len(r)):
            r[k] -= carry[k - 1] @ r[k - 1, -wide:]
        return r.reshape(-1, *y.shape[1:])[: len(y)], log_det

    def errors(self, w: Array) -> tuple[Array, Array]:
        """The likeliest errors of the rows at the starts and at the ends of the intervals, (N, 2n, p) each.

        Those of the smoother of Rauch, Tung and Striebel (1965), E e wᵀ (E w wᵀ)⁻¹ w; each of the columns of
        `w` (N, 2n, p) are prediction errors without what integrator and causes do.
        """
        inverse, below, scale, _ = self._factor
        r = self(w)[0]
        x, wide = self._grouped(r), below.shape[2]
        back, up = inverse.transpose(0, 2, 1), below.transpose(0, 2, 1)
        x[-1] = back[-1] @ x[-1]
        for k in reversed(range(len(x) - 1)):
            x[k, -wide:] -= up[k] @ x[k + 1, :wide]
            x[k] = back[k] @ x[k]
        x = x.reshape(-1, *r.shape[1:])[: len(r)] / scale[:, :, None]
        start, end = (y[:, :, None] ** 2 for y in self.noise)
        if self.speeds:
            back = _transposed(self.Phi) @ x
            return start * (self._before(x) - back), end * (x - self._after(back))
        n = w.shape[1] // 2
        p = self._parts
        x[self._last] = 0.0
        ahead = self._before(_transposed(p.P_after) @ x)
        own, middle = _transposed(p.own) @ x, _transposed(p.middle) @ x
        q = start[:, :n] * (own + self._before(middle + ahead))
        q_end = end[:, :n] * (self._after(own) + middle + ahead)
        v = self.Q @ np.concatenate([ahead - _transposed(p.R) @ x, x], axis=1)
        Phi = self.Phi
        u = p.P @ (q_end - Phi[:, :n, :n] @ q + v[:, :n] - w[:, :n])
        u_end = w[:, n:] + Phi[:, n:, :n] @ q + Phi[:, n:, n:] @ u - v[:, n:]
        return np.concatenate([q, u], axis=1), np.concatenate([q_end, u_end], axis=1)

    # --- where rows have no speeds ---

    @cached_property
    def _last(self) -> NDArray[np.intp]:
        """The last interval of each piece."""
        return np.array([last - 1 for _, last in self.pieces], dtype=np.intp)

    def _after(self, x: Array) -> Array:
        """Values of the next interval of the piece, zero in the last."""
        y = np.zeros_like(x)
        y[:-1] = x[1:]
        y[self._last] = 0.0
        return y

    def _before(self, x: Array) -> Array:
        """Values of the interval before, zero in the first of a piece."""
        y = np.zeros_like(x)
        y[1:] = x[:-1]
        y[[first for first, _ in self.pieces]] = 0.0
        return y

    @cached_property
    def _parts(self) -> _Eliminated:
        n = self.Phi.shape[1] // 2
        P: Array = np.asarray(np.linalg.inv(self.Phi[:, :n, n:]), dtype=float)
        R, along = self.Phi[:, n:, n:] @ P, P @ self.Phi[:, :n, :n]
        own = R @ self.Phi[:, :n, :n] - self.Phi[:, n:, :n]
        return _Eliminated(P, self._after(P), R, own, -self._after(along) - R)

    def _without_speeds(self, columns: Array) -> Array:
        """What prediction errors or columns are without the speeds of the rows."""
        if self.speeds:
            return columns
        n, p = self.Phi.shape[1] // 2, self._parts
        y = columns[:, n:] + self._after(p.P @ columns[:, :n]) - p.R @ columns[:, :n]
        y[self._last] = 0.0
        return y

    # --- the covariance and its factor ---

    @property
    def _group(self) -> int:
        """Intervals that make one block: as many as reach over all lags, and more where they are small."""
        n = int(self.Phi.shape[1]) // 2
        return max(1, GROUP // (2 * n)) if self.speeds else max(2, GROUP // n)

    def _grouped(self, x: Array, scale: Array | float = 1.0) -> Array:
        """Numbers (N, d, p) in units of a scale, by blocks; zeros at the end."""
        N, d, p = x.shape
        whole = np.empty((-(-N // self._group) * self._group, d, p))
        np.divide(x, scale, out=whole[:N])
        whole[N:] = 0.0
        return whole.reshape(-1, self._group * d, p)

    @cached_property
    def _factor(self) -> tuple[Array, Array, Array, float]:
        """L⁻¹ of the diagonal blocks, last columns of the blocks below them, the scale of S, log det L."""
        S, *off = self._covariance()
        N, m = S.shape[:2]
        scale = np.sqrt(np.einsum("kii->ki", S))
        S[:, np.arange(m), np.arange(m)] *= 1.0 + RIDGE
        group, wide = self._group, len(off) * m
        blocks = -(-N // group)
        inverse = np.zeros((blocks, group, m, group, m))
        below = np.zeros((blocks, len(off), m, len(off), m))
        # The lower half of the covariance by blocks; the identity where the last block has no interval.
        for i in range(N - blocks * group, 0):
            inverse[-1, i, :, i] = np.eye(m)
        for lag, C in enumerate([S, *off]):
            C[: N - lag] /= scale[lag:, :, None] * scale[: N - lag, None, :]
            for i in range(group):
                part, ahead = C[i::group], i + lag - group
                place = below[:, ahead] if ahead >= 0 else inverse[:, ahead]
                place[: len(part), :, i - group] = part
        inverse, below = inverse.reshape(blocks, group * m, -1), below.reshape(blocks, wide, wide)
        for k in range(blocks):
            if k:
                inverse[k, :wide, :wide] -= below[k - 1] @ below[k - 1].T
            U, info = lapack.dpotrf(inverse[k].T, overwrite_a=1)
            if info:
                raise np.linalg.LinAlgError(
                    "the covariance of the prediction errors is not positive definite"
                )
            inverse[k] = lapack.dtrtri(U, overwrite_c=1)[0].T
            below[k] = below[k] @ inverse[k, -wide:, -wide:].T
        log_det = np.log(scale).sum() - np.log(np.einsum("kii->ki", inverse)).sum()
        return inverse, below, scale, float(log_det)

    def _covariance(self) -> list[Array]:
        """Covariances (N, d, d) of the blocks with themselves, and of later ones with them, by lag."""
        start, end = (x**2 for x in self.noise)
        if self.speeds:
            m = start.shape[1]
            S = (self.Phi * start[:, None]) @ self.Phi.transpose(0, 2, 1) + self.Q
            S[:, np.arange(m), np.arange(m)] += end
            return [S, -self._after(self.Phi) * end[:, None]]
        n, p = start.shape[1] // 2, self._parts
        first, second, third = start[:, None, :n], end[:, None, :n], self._after(end)[:, None, :n]
        to = np.concatenate([-p.R, np.broadcast_to(np.eye(n), p.R.shape)], axis=2)
        TQ, ahead = to @ self.Q, p.P_after.transpose(0, 2, 1)
        own, middle = p.own.transpose(0, 2, 1), p.middle.transpose(0, 2, 1)
        S = (p.own * first) @ own + (p.middle * second) @ middle + TQ @ to.transpose(0, 2, 1)
        S += p.P_after @ (self._after(self.Q[:, :n, :n]) @ ahead + third.transpose(0, 2, 1) * ahead)
        one = (self._after(p.own) * second) @ middle
        one += (self._after(p.middle) * third + self._after(TQ[:, :, :n])) @ ahead
        two = (self._after(self._after(p.own)) * third) @ ahead
        last = self._last
        S[last] = np.eye(n)
        one[last], two[last] = 0.0, 0.0
        one[last[last > 0] - 1], two[last[last > 0] - 1] = 0.0, 0.0
        two[last[last > 1] - 2] = 0.0
        return [S, one, two]


@dataclass(frozen=True, eq=False)
class _Eliminated:
    """What rows do to three coordinates in a row, (N, n, n), where Φ = [[Φ_qq, Φ_qu], [Φ_uq, Φ_uu]].

    P = Φ_qu⁻¹, that of the next interval, R = Φ_uu P; what multiplies the errors of the first row and of the
    second; of the third it is P of the next interval.
    """

    P: Array
    P_after: Array
    R: Array
    own: Array
    middle: Array


def _transposed(A: Array) -> Array:
    return A.transpose(0, 2, 1)


def inverse_sizes(squares: Array) -> Array:
    """1/√ of sums of squares; 0 for columns in which nothing is."""
    sizes = np.sqrt(np.maximum(squares, 0.0))
    return np.divide(1.0, sizes, out=np.zeros_like(squares), where=squares > 0.0)


def least_squares(A: Array, b: Array) -> Array:
    """Solve A x = b, A (…, n, n) Gram matrices in which columns may be alike; b (n,) or (…, n, m)."""
    if b.ndim == 1:
        return least_squares(A, b[:, None])[:, 0]
    d = inverse_sizes(np.diagonal(A, axis1=-2, axis2=-1))[..., None]
    scaled = d * A * np.swapaxes(d, -2, -1) + RIDGE * np.eye(A.shape[-1])
    return np.asarray(d * np.linalg.solve(scaled, d * b))


def left_by(D: Array, r: Array) -> Array:
    """What columns D (K, p) leave of r (K,), by least squares."""
    gram = D.T @ D
    for _ in range(REFINEMENTS):  # what is left of large numbers is known to rounding then
        r = r - D @ least_squares(gram, D.T @ r)
    return r


def robust_weights(r: Array, D: Array) -> Array:
    """Weights (N,) of intervals under Student's distribution, where a few of them rule the sum of squares.

    They are those of r (N, d), or of what the columns D (N, d, p) leave of it where that is likelier: what a
    cause does in a few intervals is no outlier. By expectation and maximisation (Lange, Little & Taylor,
    Robust statistical modeling using the t distribution, JASA 84, 1989). One everywhere where r has none.
    """
    alone, likelihood = _student(r)
    if np.all(alone == 1.0) or 2 * D.shape[2] > r.size:
        return alone
    weights, beside = weights_beside(r, D, alone)
    price = 0.5 * D.shape[2] * np.log(r.size)
    return weights if beside - price > likelihood else alone


def weights_beside(r: Array, D: Array, weights: Array) -> tuple[Array, float]:
    """The weights (N,) by what columns D (N, d, p) leave of r (N, d), from others; their log likelihood."""
    likelihood = -np.inf
    for _ in range(MAXIMISATIONS):
        scale = np.sqrt(weights)[:, None]
        left = left_by((D * scale[:, :, None]).reshape(r.size, -1), (r * scale).ravel())
        weights, likelihood = _student(left.reshape(r.shape) / scale)
    return weights, likelihood


def _student(r: Array, share: float = 0.02) -> tuple[Array, float]:
    """The weights of residuals r (N, d), and their log likelihood at the scale of typical ones.

    One everywhere unless the largest `share` of the intervals holds more than half of Σ r².
    """
    size, d = np.mean(r**2, axis=1), r.shape[1]
    typical = float(np.median(size)) / 0.45 + 1e-300  # the median of χ²₁ is 0.45
    tail = 1.0 + d * size / (STUDENT * typical)
    likelihood = -0.5 * r.size * np.log(typical) - 0.5 * (STUDENT + d) * np.log(tail).sum()
    ordered = np.sort(size)
    few = max(1, int(share * len(size)))
    some = ordered[-few:].sum() >= 0.5 * ordered.sum()
    weights = (STUDENT + d) / (STUDENT * tail) if some else np.ones(len(r))
    return weights, float(likelihood)


STUDENT = 3.0
"""Degrees of freedom of the heavy-tailed likelihood."""

MAXIMISATIONS, REFINEMENTS = 2, 3
"""Steps of expectation and maximisation, and of least squares: weights and likelihoods need one digit."""
