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

import numpy as np
from scipy.linalg import lapack

from deltac.arrays import Array

ROUNDING = 1e-10
"""Relative variance that keeps the covariance positive definite in double precision; it is not seen in the
noise of ten million rows."""


def whitened(
    pieces: Sequence[tuple[int, int]],
    Phi: Array,
    noise: tuple[Array, Array],
    Q: Array,
    columns: Array,
) -> tuple[Array, float]:
    """L⁻¹ of columns (N, m, p) of N intervals, (N, m, p); and log det L.

    Args:
        pieces: first and last + 1 of consecutive intervals.
        Phi: transition matrices (N, m, m).
        noise: standard deviations (N, m) of the rows at the starts of the intervals, and at their ends.
        Q: covariance (N, m, m) of what the flow does not know.
        columns: prediction errors and the columns of parameters.
    """
    N, m, p = columns.shape
    start, end = (x**2 for x in noise)
    S = (Phi * start[:, None]) @ Phi.transpose(0, 2, 1) + Q
    S[:, np.arange(m), np.arange(m)] += end
    scale = np.sqrt(S[:, np.arange(m), np.arange(m)])
    S /= scale[:, :, None] * scale[:, None, :]
    S[:, np.arange(m), np.arange(m)] += ROUNDING
    C = np.zeros((N, m, m))
    C[:-1] = -Phi[1:] * end[:-1, None] / (scale[1:, :, None] * scale[:-1, None, :])
    C[[last - 1 for _, last in pieces]] = 0.0
    band = np.zeros((2 * m, N, m))
    for j in range(m):
        band[: m - j, :, j] = S[:, j:, j].T
        band[m - j : 2 * m - j, :, j] += C[:, :, j].T
    factor, info = lapack.dpbtrf(band.reshape(2 * m, N * m), lower=1, overwrite_ab=1)
    if info:
        raise np.linalg.LinAlgError(
            "the covariance of the prediction errors is not positive definite"
        )
    factor = factor.reshape(2 * m, N, m)
    diagonal, below = np.zeros((N, m, m)), np.zeros((N, m, m))
    for j in range(m):
        diagonal[:, j:, j] = factor[: m - j, :, j].T
        below[:, :, j] = factor[m - j : 2 * m - j, :, j].T
    # Forward substitution block by block, all columns at once; what is precomputed is of all blocks together.
    inverse = np.linalg.inv(diagonal)
    r = inverse @ (columns / scale[:, :, None])
    carry = inverse[1:] @ below[:-1]
    for k in range(1, N):
        r[k] -= carry[k - 1] @ r[k - 1]
    return r, float(np.log(factor[0]).sum() + np.log(scale).sum())


def robust_weights(r: Array, share: float = 0.02) -> Array:
    """Weights (N,) of intervals under Student's distribution, where a few of them rule the sum of squares.

    One everywhere unless the largest `share` of the intervals holds more than half of Σ r².
    """
    size = np.mean(r**2, axis=1)
    ordered = np.sort(size)
    few = max(1, int(share * len(size)))
    if ordered[-few:].sum() < 0.5 * ordered.sum():
        return np.ones(len(r))
    typical = float(np.median(size)) / 0.45 + 1e-300  # the median of χ²₁ is 0.45
    d = r.shape[1]
    return np.asarray((STUDENT + d) / (STUDENT + d * size / typical))


STUDENT = 3.0
"""Degrees of freedom of the heavy-tailed likelihood."""
