"""Prediction errors, whitened: Kalman's recursion on the noise of the rows.

The prediction errors w_k = y_{k+1} − φ_k(y_k) = e_{k+1} − Φ_k e_k + B_k θ + (O_{k+1} − Φ_k O_k) s of a log
are a moving average of order one in the noise e of its rows. The recursion makes them independent, of unit
variance where the noise is as assumed, together with the columns of every parameter (innovations: Schweppe
1965; columns of parameters beside the state: de Jong 1991).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import Array


@dataclass(frozen=True, eq=False)
class Innovations:
    """Whitened prediction errors r (N, d) and their columns D (N, d, p); `which` intervals they are.

    factor  (N, d, d) lower triangular: factor @ r are the innovations in the units of the states
    """

    r: Array
    D: Array
    which: NDArray[np.intp]
    factor: Array


def innovations(
    stretches: list[tuple[int, int]],
    w: Array,
    Phi: Array,
    B: Array,
    noise: tuple[Array, Array],
    Q: Array,
    habits: tuple[Array, Array],
    observed: NDArray[np.intp],
    unknown: Array,
    chunk: int,
) -> Innovations:
    """Whiten the prediction errors of stretches of intervals (first, last + 1).

    Args:
        stretches: first and last + 1 of consecutive intervals.
        w: prediction errors (N, m) of the intervals.
        Phi: their transition matrices (N, m, m).
        B: columns (N, m, p) of parameters.
        noise: standard deviations (N, m) of the rows at their starts and at their ends.
        Q: covariance (N, m, m) of what the flow does not know.
        habits: columns of habits of recording (N, m, h) at their starts and ends.
        observed: places of the state that the log holds.
        unknown: standard deviation (m,) of the others before anything is seen.
        chunk: intervals after which the recursion starts anew; stretches run side by side.
    """
    m, p, h = w.shape[1], B.shape[2], habits[0].shape[2]
    pieces = [
        np.arange(a, min(a + chunk, last))
        for first, last in stretches
        for a in range(first, last, chunk)
    ]
    pieces = [x for x in pieces if len(x) > 1] or pieces
    longest = max(map(len, pieces))
    index = np.zeros((len(pieces), longest), dtype=np.intp)
    real = np.zeros((len(pieces), longest), dtype=np.bool_)
    for row, x in enumerate(pieces):
        index[row, : len(x)], real[row, : len(x)] = x, True
    variance = tuple(x**2 for x in noise)
    hidden = np.setdiff1d(np.arange(m), observed)
    first = index[:, 0]
    P = np.zeros((len(pieces), m, m))
    P[:, observed, observed] = variance[0][first][:, observed]
    P[:, hidden, hidden] = unknown[hidden] ** 2
    mean = np.zeros((len(pieces), m, 1 + p + h))
    mean[:, :, 1 + p :] = -habits[0][first]
    d = len(observed)
    made = np.zeros((len(pieces), longest, d, 1 + p + h))
    factor = np.zeros((len(pieces), longest, d, d))
    whole, eye = d == m, np.arange(d)
    for k in range(longest):
        at = index[:, k]
        F = Phi[at]
        mean = F @ mean
        mean[:, :, 0] -= w[at]
        mean[:, :, 1 : 1 + p] += B[at]
        P = F @ P @ F.transpose(0, 2, 1) + Q[at]
        seen = mean if whole else mean[:, observed]
        nu = -seen
        nu[:, :, 1 + p :] -= habits[1][at][:, observed]
        cross = P if whole else P[:, :, observed]
        S = cross.copy() if whole else cross[:, observed]
        S[:, eye, eye] += variance[1][at][:, observed]
        scale = np.sqrt(S[:, eye, eye])
        S /= scale[:, :, None] * scale[:, None, :]
        S[:, eye, eye] += ROUNDING
        L = scale[:, :, None] * np.linalg.cholesky(S)
        half = np.linalg.inv(L)
        made[:, k], factor[:, k] = half @ nu, L
        gain = cross @ half.transpose(0, 2, 1) @ half
        mean = mean + gain @ nu
        # Joseph's form stays positive definite, however small the noise of the rows.
        stays = np.broadcast_to(np.eye(m), P.shape).copy()
        stays[:, :, observed] -= gain
        noisy = gain * np.sqrt(variance[1][at][:, None, observed])
        P = stays @ P @ stays.transpose(0, 2, 1) + noisy @ noisy.transpose(0, 2, 1)
    made, factor, which = made[real], factor[real], index[real]
    return Innovations(made[:, :, 0], -made[:, :, 1:], which, factor)


def likelihood(white: Innovations) -> float:
    """Log likelihood of innovations, the columns fitted and the size of all noise together estimated."""
    r, D = white.r.ravel(), white.D.reshape(white.r.size, -1)
    if not np.isfinite(D).all():
        return -np.inf
    if D.shape[1]:
        r = r - D @ np.linalg.lstsq(D, r, rcond=1e-12)[0]
    spread = np.log(np.einsum("kii->ki", white.factor)).sum()
    return float(-spread - 0.5 * r.size * np.log(float(r @ r) / r.size + 1e-300))


def robust_weights(r: Array, share: float = 0.02) -> Array:
    """Weights (N,) of intervals under Student's distribution, where a few intervals rule the sum of squares.

    One everywhere unless the largest `share` of the intervals holds more than half of Σ r².
    """
    size = np.mean(r**2, axis=1)
    ordered = np.sort(size)
    few = max(1, int(share * len(size)))
    if ordered[-few:].sum() < 0.5 * ordered.sum():
        return np.ones(len(r))
    typical = float(np.median(size)) / 0.45 + 1e-300
    d = r.shape[1]
    return np.asarray((STUDENT + d) / (STUDENT + d * size / typical))


ROUNDING = 1e-10
"""Relative variance that keeps covariances positive definite in double precision."""

STUDENT = 3.0
"""Degrees of freedom of the heavy-tailed likelihood."""
