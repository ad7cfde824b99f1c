"""Sine and cosine written out in products and sums, for code that runs many times.

A call of a library's sine empties the registers of vector code around it, and sine and cosine of an angle
are two calls. Written out, they share the reduction of the angle, and a step of a pendulum in an ensemble
takes two thirds of the time; compiling takes up to half as long again.

The angle is x = k π/2 + r with |r| ≤ π/4 (Cody and Waite's reduction, π/2 in three parts), the polynomials
in r are minimax ones, and the quadrant k turns the pair (cos r, sin r) by right angles. The result is
within two units in the last place where products and sums are fused (all processors with SIMD of 256 bits
and more), elsewhere within |x| ε; NaN where |x| is 1e14 or more, and neighbouring numbers a degree apart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, TypeAlias

Scalar: TypeAlias = Any  # a scalar of an algebra that neither reorders nor folds sums

HALF_PI = (1.5707963267948966, 6.123233995736766e-17, -1.4973849048591698e-33)
"""π/2 in three parts, each the double nearest to what is left."""

SINE = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
"""(sin r − r)/r³ in powers of r² for |r| ≤ π/4, to 2^-58 of r (the coefficients of fdlibm's k_sin.c)."""

COSINE = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)
"""(cos r − 1 + r²/2)/r⁴ in powers of r² for |r| ≤ π/4, to 2^-58 (fdlibm's k_cos.c)."""

TO_INTEGER = 1.5 * 2.0**52
"""Added to a number and taken away again it leaves the nearest integer, of two the even one."""

LARGEST = 1e14
"""Angle (rad) up to which the quadrant is found; next to it, neighbouring numbers are a degree apart."""


def sine(x: Scalar, select: Any, below: Any) -> Scalar:
    """The sine of x; `select(condition, a, b)` and `below(a, b)` are the algebra's own."""
    s, c, a, b = _turned(x, select, below)
    return a * s + b * c


def cosine(x: Scalar, select: Any, below: Any) -> Scalar:
    """The cosine of x; as `sine`, with which it shares most of its operations."""
    s, c, a, b = _turned(x, select, below)
    return a * c - b * s


def _turned(x: Scalar, select: Any, below: Any) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """Sine and cosine of r; cosine and sine of k π/2."""
    k = _nearest(x * (2.0 / math.pi))
    r = x
    for part in HALF_PI:
        r = r - k * part
    z = select(below(x * x, LARGEST**2), r * r, math.nan)
    s = r + (r * z) * _polynomial(SINE, z)
    c = (1.0 - 0.5 * z) + (z * z) * _polynomial(COSINE, z)
    return s, c, _quarter_turns(k + 1.0), _quarter_turns(k)


def _quarter_turns(k: Scalar) -> Scalar:
    """sin(k π/2) of an integer k: 0, 1, 0, −1."""
    return k - 2.0 * _nearest(0.5 * k)


def _nearest(y: Scalar) -> Scalar:
    """The integer nearest to y, of two the even one."""
    return (y + TO_INTEGER) - TO_INTEGER


def _polynomial(coefficients: Sequence[float], z: Scalar) -> Scalar:
    value = coefficients[-1] * z + coefficients[-2]
    for coefficient in coefficients[-3::-1]:
        value = value * z + coefficient
    return value
