"""Sine and cosine written out, against mpmath; compiled, and on plain arrays where nothing is fused."""

from __future__ import annotations

import casadi
import mpmath
import numpy as np
import pytest
from numpy.typing import NDArray

from deltac.kernels import Kernel
from deltac.kernels.lowering import HALF_PI, LARGEST_ANGLE, cosine, sine

Array = NDArray[np.float64]
EPS = np.finfo(float).eps
UNITS = 2.0  # in the last place: two roundings of the reduced angle, one or two of the polynomial


def angles(largest: float) -> Array:
    """Random angles of all sizes up to the largest, and the neighbours of multiples of π/4."""
    rng = np.random.default_rng(5)
    turns = np.arange(-40, 41) * (np.pi / 4)
    near = np.concatenate([np.nextafter(turns, -np.inf), turns, np.nextafter(turns, np.inf)])
    sizes = largest ** rng.uniform(-2, 1, 600) * rng.choice([-1, 1], 600)
    return np.concatenate([rng.uniform(-10, 10, 600), near, sizes, [0.0, 5e-324, 1e-200]])


def exact(x: Array) -> tuple[Array, Array]:
    """Sine and cosine, rounded once."""
    with mpmath.workprec(200):
        pairs = [(float(mpmath.sin(v)), float(mpmath.cos(v))) for v in map(mpmath.mpf, x.tolist())]
    sines, cosines = np.array(pairs).T
    return sines, cosines


def compiled(x: Array) -> Array:
    pytest.importorskip("llvmlite")
    a = casadi.SX.sym("a")
    return Kernel({"a": a}, {"sin": casadi.sin(a), "cos": casadi.cos(a)}).flat(x[None, :])


@pytest.mark.heyoka
def test_compiled_within_units_of_the_last_place() -> None:
    x = angles(0.99 * LARGEST_ANGLE)
    for found, expected in zip(compiled(x), exact(x)):
        assert np.abs(found - expected).max() <= UNITS * EPS / 2
        assert (np.abs(found - expected) <= UNITS * np.spacing(np.abs(expected))).all()


def test_where_nothing_is_fused_within_the_rounding_of_the_angle() -> None:
    x = angles(0.99 * LARGEST_ANGLE)
    for function, expected in zip((sine, cosine), exact(x)):
        found = function(x, np.where, np.less)
        assert (np.abs(found - expected) <= UNITS * EPS / 2 + np.abs(x) * EPS).all()


def test_the_parts_of_a_right_angle() -> None:
    with mpmath.workprec(400):
        left = mpmath.pi / 2 - sum(map(mpmath.mpf, HALF_PI))
        assert abs(left) < mpmath.mpf(2) ** -160  # three parts of 53 bits each, signs included


@pytest.mark.heyoka
def test_what_has_no_sine_is_not_a_number() -> None:
    sizes = 10.0 ** np.random.default_rng(2).uniform(14.01, 20.0, 5000)
    x = np.concatenate([[np.nan, np.inf, -np.inf, 1e300], sizes, -sizes])
    assert np.isnan(compiled(x)).all()


@pytest.mark.heyoka
def test_one_state_as_many() -> None:
    x = angles(100.0)
    kernel_in, kernel_out = np.empty(1), np.empty(2)
    a = casadi.SX.sym("a")
    kernel = Kernel({"a": a}, {"y": casadi.vertcat(casadi.sin(a), casadi.cos(a))})
    many = kernel.flat(x[None, :])
    for value, expected in zip(x, many.T):
        kernel_in[0] = value
        np.testing.assert_allclose(kernel.single(kernel_in, kernel_out), expected, rtol=0, atol=EPS)
