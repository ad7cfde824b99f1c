"""Splines through columns at given times, not-a-knot at the ends.

Audits ask for integrals and rates of many columns at the same times: what depends on these is found once.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np

from deltac.arrays import LONG_LOG, Array

T = TypeVar("T")


SHORT, REMEMBERED = 1000, 64
"""Rows of stretches that logs are tested by, and how many such are remembered: some 30 MB."""


def spline_integrals(t: Array, x: Array, degree: int) -> Array:
    """∫x dt over the intervals (T − 1, n) of columns (T, n).

    `degree` is odd, and less than T.

    Raises ValueError where x is not finite, LinAlgError for times that are equal.
    """
    return _applied(_integrals, t, x, degree)


def spline_rates(t: Array, x: Array, degree: int) -> Array:
    """dx/dt at the times (T, n) of columns (T, n); see `spline_integrals`."""
    return _applied(_rates, t, x, degree)


def smooth_rates(t: Array, x: Array) -> Array:
    """dx/dt at the times (T, n) of columns (T, n), by a spline of degree 5 where there are enough of them."""
    degree = min(5, len(t) - 1)
    degree -= 1 - degree % 2  # odd degrees interpolate at the samples themselves
    return spline_rates(t, x, max(1, degree))


def _applied(operator: Any, t: Array, x: Array, degree: int) -> Array:
    times = np.ascontiguousarray(t, dtype=np.float64).tobytes()
    coefficients, matrix = _coefficients(len(t))(times, degree), operator(len(t))(times, degree)
    return np.asarray(matrix @ coefficients(np.asarray_chkfinite(x)))


def gauss_legendre(count: int) -> tuple[Array, Array]:
    """Nodes on (−1, 1) and weights of Gauss's rule with so many points.

    They are the eigenvalues of the Jacobi matrix of Legendre's polynomials, and twice the squares of its
    eigenvectors' first components (Golub and Welsch, 1969). NumPy's own loads all of `numpy.polynomial`.
    """
    k = np.arange(1.0, count)
    nodes, vectors = np.linalg.eigh(np.diag(k / np.sqrt(4.0 * k**2 - 1.0), -1))
    return nodes, 2.0 * vectors[0] ** 2


def _remembered(find: Callable[[bytes, int], T]) -> Callable[[int], Callable[[bytes, int], T]]:
    """What depends on the times of so many rows: a few are kept of long ones, many of short ones."""
    few, many = lru_cache(maxsize=8)(find), lru_cache(maxsize=REMEMBERED)(find)
    return lambda rows: many if rows <= SHORT else few if rows <= LONG_LOG else find


def _knots(t: Array, degree: int) -> Array:
    inner = t[(degree + 1) // 2 : len(t) - (degree + 1) // 2]
    return np.concatenate([np.repeat(t[0], degree + 1), inner, np.repeat(t[-1], degree + 1)])


@_remembered
def _coefficients(times: bytes, degree: int) -> Callable[[Array], Array]:
    """Values (T, n) -> coefficients of B-splines (T, n), by a banded system."""
    from scipy.interpolate import BSpline
    from scipy.linalg.lapack import dgbtrf, dgbtrs

    t, k = np.frombuffer(times), degree
    at_rows = BSpline.design_matrix(t, _knots(t, k), k).tocoo()
    # LAPACK's storage: entry (i, j) in row 2k + i − j of column j.
    band = np.zeros((3 * k + 1, len(t)), order="F")
    band[2 * k + at_rows.row - at_rows.col, at_rows.col] = at_rows.data
    factors, pivots, singular = dgbtrf(band, k, k, overwrite_ab=True)
    if singular:
        raise np.linalg.LinAlgError("times that are equal, or nearly")
    return lambda x: np.asarray(
        dgbtrs(factors, k, k, np.array(x, order="F"), pivots, overwrite_b=True)[0]
    )


@_remembered
def _integrals(times: bytes, degree: int) -> Any:
    """Coefficients -> integrals over the intervals, a sparse matrix.

    Gauss's rule with (degree + 1)/2 nodes is exact for polynomials of the degree.
    """
    from scipy.interpolate import BSpline

    t = np.frombuffer(times)
    knots, half = _knots(t, degree), 0.5 * np.diff(t)
    nodes, weights = gauss_legendre((degree + 1) // 2)
    parts = (
        BSpline.design_matrix(t[:-1] + half * (1.0 + node), knots, degree).multiply(
            (weight * half)[:, None]
        )
        for node, weight in zip(nodes, weights)
    )
    return sum(parts).tocsr()


@_remembered
def _rates(times: bytes, degree: int) -> Any:
    """Coefficients -> rates at the times, a sparse matrix.

    The derivative has k (c[j+1] − c[j])/(t[j+k+1] − t[j+1]) for coefficients (de Boor, X(15)).
    """
    from scipy.interpolate import BSpline
    from scipy.sparse import diags

    t, k = np.frombuffer(times), degree
    knots = _knots(t, k)
    size = k / (knots[k + 1 : -1] - knots[1 : -k - 1])
    differences = diags([-size, size], [0, 1], shape=(len(t) - 1, len(t)))
    return (BSpline.design_matrix(t, knots[1:-1], k - 1) @ differences).tocsr()
