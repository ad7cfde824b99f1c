"""Integrals of splines through columns of a log; what depends on the times alone is found once."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from deltac.arrays import Array


def spline_integrals(t: Array, x: Array, degree: int) -> Array:
    """∫x dt over the intervals (T − 1, n) of columns (T, n), by splines through them, not-a-knot at the ends.

    `degree` is odd, and less than T.

    Raises ValueError where x is not finite, LinAlgError for times that are equal.
    """
    times = np.ascontiguousarray(t, dtype=np.float64)
    return _quadrature(times.tobytes(), degree)(np.asarray_chkfinite(x))


@lru_cache(maxsize=16)
def _quadrature(times: bytes, degree: int) -> Callable[[Array], Array]:
    """The same at given times: coefficients from a banded system, times the integrals of B-splines."""
    from scipy.interpolate import BSpline
    from scipy.linalg.lapack import dgbtrf, dgbtrs

    t, k = np.frombuffer(times), degree
    inner = t[(k + 1) // 2 : len(t) - (k + 1) // 2]
    knots = np.concatenate([np.repeat(t[0], k + 1), inner, np.repeat(t[-1], k + 1)])
    # LAPACK's storage: row k + i − j of a column j, below k rows of room.
    at_rows = BSpline.design_matrix(t, knots, k).tocoo()
    band = np.zeros((3 * k + 1, len(t)), order="F")
    band[2 * k + at_rows.row - at_rows.col, at_rows.col] = at_rows.data
    factors, pivots, singular = dgbtrf(band, k, k, overwrite_ab=True)
    if singular:
        raise np.linalg.LinAlgError("times that are equal, or nearly")
    # Gauss's rule with so many nodes is exact for polynomials of the degree.
    nodes, weights = np.polynomial.legendre.leggauss((k + 1) // 2)
    half = 0.5 * np.diff(t)
    integrals = sum(
        BSpline.design_matrix(t[:-1] + half * (1.0 + node), knots, k).multiply(
            (weight * half)[:, None]
        )
        for node, weight in zip(nodes, weights)
    ).tocsr()

    def integrate(x: Array) -> Array:
        coefficients, _ = dgbtrs(factors, k, k, np.array(x, order="F"), pivots, overwrite_b=True)
        return np.asarray(integrals @ coefficients)

    return integrate
