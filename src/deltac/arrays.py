"""The array type of the whole package, and the numbers that mean the same wherever they are used."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array: TypeAlias = NDArray[np.float64]
"""Real numbers in double precision, of any shape; docstrings say which."""

EPS = float(np.finfo(np.float64).eps)
"""Spacing of the numbers at one, 2⁻⁵²: what one rounding may change, relative."""

ROUNDED = 4096 * EPS
"""What thousands of roundings add up to, relative: 10⁻¹²."""

ROOT_EPS = float(np.sqrt(EPS))
"""Half of a double's digits: what a square, or a first difference, keeps of a number."""

TINY = float(np.finfo(np.float64).tiny)
"""The smallest normal number: it keeps a quotient finite where the divisor may be zero."""

ASSEMBLED = 1e-9
"""Largest violation of a constraint (m or rad; per s at unit speeds) by a state that meets it.

Rows have the size of lengths and angles. Newton's method reaches EPS times the condition of the constraint
Jacobian, which `feasibility` bounds by 10⁵; the rest is room for mechanisms of 10 to 100 m.
"""

PHYSICAL = float(np.finfo(np.float64).max) ** (1 / 6)
"""No coordinate, speed or force is larger in SI units: squares of products of three do not overflow."""

SAME = 1e-9
"""Relative difference of numbers that are the same but for rounding.

Hundreds of operations lose 10⁻¹³; the rest is room for what cancels, and for numbers that were written with
ten digits. Of singular values, by the largest: those that are zero.
"""

SMALL_SHARE = 1e-3
"""What is smaller than this share of its like counts as this share: nothing is measured by what vanishes."""

ENDLESS = 20_000
"""Rounds after which a loop that should end by itself is given up: it will not end."""

SAME_STEP = 1e-2
"""Relative difference of steps that are the same: times of logs are rounded, or in single precision."""

SOME_ROWS = 64
"""Rows of which the others do as they do, where nothing is estimated: all agree, or one of them does not."""

NEWTON_STEPS = 100
"""Iterations after which what has not converged will not."""

SOLVED = 1e-6
"""What iterative solvers of constraints leave of what they solve, relative."""

SIX_DIGITS = 1e-5
"""Differences that six digits do not show: of a factor from one."""

NEGLIGIBLE = 0.05
"""A share that is neglected beside the whole: what is said of the whole is then known to so much."""

ROUGHLY = 0.1
"""Share up to which two numbers agree roughly: what differs by more is not the same, nor known."""

LONG_LOG = 20_000
"""Rows that tell what a log's statistics can: the deviation of noise to a hundredth.

Of longer logs some rows are looked at, or kept.
"""

HALF_DIGITS = 1e-7
"""Relative difference of what agrees to half of a double's digits.

Numbers that a small linear problem, a square or a difference quotient gave have lost the other half; that
measured or fitted numbers agree so well is no coincidence.
"""


def max_norm(values: ArrayLike) -> float:
    """The largest absolute value of the entries; 0 where there are none."""
    return float(np.abs(values).max(initial=0.0))


def medians(values: Array) -> Array:
    """Medians along the last axis, many times as fast as by `np.median`.

    That looks for NaN by sorting, and loads `numpy.ma`.
    """
    middle = values.shape[-1] // 2
    ordered = np.partition(values, middle, axis=-1)
    median = ordered[..., middle]
    if values.shape[-1] % 2 == 0:
        median = 0.5 * (ordered[..., :middle].max(axis=-1) + median)
    return np.where(np.isnan(values).any(axis=-1), np.nan, median)
