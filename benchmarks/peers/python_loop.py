"""A classical Runge–Kutta method in Python, for programs that give the accelerations and no integrator."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LASTING = 1.0
"""Seconds of the motion that such a run covers: it takes ten and more times as long as the others."""


def runge_kutta4(rate: Callable[[Array], Array], x: Array, h: float, steps: int) -> Array:
    """The states (steps, n) after every step of length h, from x (n,)."""
    kept = np.empty((steps, len(x)))
    for k in range(steps):
        k1 = rate(x)
        k2 = rate(x + h / 2 * k1)
        k3 = rate(x + h / 2 * k2)
        k4 = rate(x + h * k3)
        x = x + h / 6 * (k1 + 2 * (k2 + k3) + k4)
        kept[k] = x
    return kept
