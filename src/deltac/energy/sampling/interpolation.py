"""Interpolation between samples, compiled: many intervals at once, the weights shared by all columns.

An interval is seen through a window of samples around it. Its times are given in units of the interval,
from its start, so that weights are of order one; and of values only differences to one of the window are
weighted, so that a large constant costs no digits.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import TypeAlias

import casadi as ca
import numpy as np

from deltac.arrays import Array
from deltac.kernels import Kernel
from deltac.kernels.kernel import SX
from deltac.trajectories.splines import gauss_legendre

Block: TypeAlias = tuple[int, int, int]
"""(start, stop, first): intervals start to stop, the window of interval k starts at first + k − start."""


@lru_cache(maxsize=32)
def hermite_kernel(
    window: int, smooth: int, rated: int, plain: int, nodes: tuple[float, ...]
) -> Kernel:
    """Values and rates at nodes of an interval, from a window of samples.

    Inputs: times z (window), the interval's `width` (s); of each sample in turn the values `y` (smooth)
    and rates `dy` (smooth), interpolated by Hermite's polynomial, and values alone `f` (plain), by
    Lagrange's. Outputs: ``node<i>``, a column of the values (smooth, then plain) and of the rates of the
    first `rated` smooth columns.
    """
    z, width = ca.SX.sym("z", window), ca.SX.sym("width")
    y, dy = (ca.SX.sym(name, smooth * window) for name in ("y", "dy"))
    f = ca.SX.sym("f", plain * window)
    x = ca.SX.sym("x")
    l, l_own = _lagrange(z, x)
    value = (1 - 2 * (x - z) * l_own) * l**2
    rate = (x - z) * l**2 * width
    slopes = [ca.jacobian(weights, x) / width for weights in (value, rate)]
    Y, D, F = (
        ca.reshape(column, n, window) for column, n in ((y, smooth), (dy, smooth), (f, plain))
    )
    start = Y[:, max(0, window // 2 - 1)]
    Y = Y - ca.repmat(start, 1, window)
    outputs: dict[str, SX] = {}
    for i, node in enumerate(nodes):
        at = ca.substitute([value, rate, *slopes, l], [x], [ca.SX(node)])
        outputs[f"node{i}"] = ca.vertcat(
            start + ca.mtimes(Y, at[0]) + ca.mtimes(D, at[1]),
            ca.mtimes(F, at[4]),
            ca.mtimes(Y[:rated, :], at[2]) + ca.mtimes(D[:rated, :], at[3]),
        )
    inputs = {"z": z, "width": width, "y": y, "dy": dy, "f": f}
    return Kernel(inputs, outputs, name="interpolation")


@lru_cache(maxsize=32)
def lagrange_kernel(window: int) -> Kernel:
    """Weights (window) with which values in a window make ∫ over an interval of the polynomial through them.

    Inputs: times `z` (window) and the interval's `width` (s).
    """
    z, width = ca.SX.sym("z", window), ca.SX.sym("width")
    points, gauss = gauss_legendre((window + 1) // 2)
    x = ca.SX.sym("x")
    l, _ = _lagrange(z, x)
    weights = sum(
        0.5 * g * ca.substitute(l, x, ca.SX(0.5 * (1 + point))) for point, g in zip(points, gauss)
    )
    return Kernel({"z": z, "width": width}, {"weights": weights * width}, name="quadrature")


def _lagrange(z: SX, x: SX) -> tuple[SX, SX]:
    """Lagrange's polynomials at x, and the slope of each at its own node."""
    count = z.numel()
    polynomials, slopes = [], []
    for j in range(count):
        inverse = [1 / (z[j] - z[k]) for k in range(count) if k != j]
        factors = [x - z[k] for k in range(count) if k != j]
        product = ca.SX(1)
        for a, b in zip(factors, inverse):
            product = product * (a * b)
        polynomials.append(product)
        slopes.append(sum(inverse, start=ca.SX(0)))
    return ca.vertcat(*polynomials), ca.vertcat(*slopes)


def blocks(samples: int, window: int, size: int) -> Iterator[Block]:
    """Cut the intervals into blocks of at most `size`.

    Windows lie around their interval, but for the first and the last few of them.
    """
    reach = max(0, window // 2 - 1)
    last = samples - window + reach
    for row in range(reach):
        yield row, row + 1, 0
    for start in range(reach, last + 1, size):
        yield start, min(start + size, last + 1), start - reach
    for row in range(last + 1, samples - 1):
        yield row, row + 1, samples - window


def equidistant(t: Array) -> bool:
    """Whether times differ from equidistant ones by no more than their rounding."""
    aside = np.linspace(t[0], t[-1], len(t))
    aside -= t
    return bool(max(aside.max(), -aside.min()) <= 2 * np.spacing(max(abs(t[0]), abs(t[-1]))))


def clock(t: Array, *, even: bool | None = None) -> Array:
    """Times from the first on; without their rounding where they are equidistant.

    Stamps of seconds since 1970 are rounded to 2e-7 s, which intervals of milliseconds would feel. `even`
    tells whether they are, where that is known.
    """
    even = equidistant(t) if even is None else even
    return np.linspace(0.0, t[-1] - t[0], len(t)) if even else t - t[0]


def window_times(t: Array, start: int, first: int, z: Array, width: Array) -> None:
    """Write the times of the windows (window, B), in units of their intervals, and the widths (1, B)."""
    window, size = z.shape
    begin = t[start : start + size]
    np.subtract(t[start + 1 : start + size + 1], begin, out=width[0])
    for j in range(window):
        np.subtract(t[first + j : first + j + size], begin, out=z[j])
    z /= width


def windows_of(rows: Array, first: int, window: int, out: Array) -> None:
    """Write the windows of columns, rows here (n, T), to `out`: (window · n, B), sample by sample."""
    n, size = len(rows), out.shape[1]
    for j in range(window):
        out[j * n : (j + 1) * n] = rows[:, first + j : first + j + size]
