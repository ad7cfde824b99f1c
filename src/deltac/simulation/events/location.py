"""Where in a step a function first passes zero: by its Hermite cubic, then by the solver itself.

Between the ends of a step the function is pictured by the cubic through its values and rates there. If
that has no root (its Bernstein coefficients all have the sign of the start, and it lies in their hull)
there is none. Otherwise the step is taken again in part, by the solver, until the root is met to rounding:
what is found has the solver's accuracy, whatever that of the picture. A graze, two roots in a step, shows
at the extremum of the cubic, which is then looked at itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import ENDLESS, Array, max_norm

Look: TypeAlias = Callable[[float], tuple[float, float]]
"""θ in [0, 1] -> the function and its rate by θ there."""


@dataclass(frozen=True)
class End:
    """A function at an end of an interval: place θ, value, rate by θ; seen so that the start is positive."""

    place: float
    value: float
    rate: float


def may_cross(start: Array, start_rate: Array, end: Array, end_rate: Array) -> NDArray[np.bool_]:
    """Whether cubics, positive at the start, may have a root: some Bernstein coefficient is negative."""
    inner = (start + start_rate / 3.0 < 0.0) | (end - end_rate / 3.0 < 0.0)
    return np.asarray(inner | (end < 0.0))


def crossing(
    look: Look, a: End, b: End, resolution: float, after: bool, depth: int = 6
) -> float | None:
    """The first θ at which a function, positive at the start, becomes negative; None if it does not.

    Args:
        look: the function, by the solver.
        a: what it is at the start; zero, or by rounding below, after an event.
        b: what it is at the end.
        resolution: of θ.
        after: whether an event has just happened at the start, so that a root there is over.
        depth: how often the extremum of the picture may still be looked at.
    """
    h = b.place - a.place
    scaled = [np.array([value * 1.0]) for value in (a.value, a.rate * h, b.value, b.rate * h)]
    scaled[0] = np.maximum(scaled[0], 0.0) if after else scaled[0]
    if not may_cross(*scaled).any() or h <= resolution:
        return a.place if b.value < 0.0 and h <= resolution else None
    cubic = _cubic(a, b)
    guess = _falling_root(cubic, a, h)
    if b.value < 0.0:
        return _polished(look, a, b, a.place + 0.5 * h if guess is None else guess, resolution)
    least = _least(cubic, a, h)
    if least is None or depth == 0:
        return None
    value, rate = look(least)
    first = End(least, value, rate)
    if value < 0.0:
        middle = 0.5 * (a.place + least)
        return _polished(look, a, first, middle if guess is None else guess, resolution)
    # Not below zero there: the picture was rough, the true least value lies down the slope.
    if rate > 0.0:
        return crossing(look, a, first, resolution, after, depth - 1)
    return crossing(look, first, b, resolution, False, depth - 1)


def _polished(look: Look, a: End, b: End, guess: float, resolution: float) -> float:
    """The root between a (positive) and b (negative): Newton's steps, kept within the bracket."""
    low, high = a.place, b.place
    place = min(max(guess, low), high)
    for _ in range(ENDLESS):
        value, rate = look(place)
        if value > 0.0:
            low = max(low, place)
        elif value < 0.0:
            high = min(high, place)
        else:
            return place
        step = -value / rate if rate < 0.0 else np.inf
        following = place + step
        if not low < following < high:
            following = 0.5 * (low + high)
        if abs(following - place) <= resolution or high - low <= resolution:
            return min(max(following, low), high)
        place = following
    return place


def _cubic(a: End, b: End) -> np.polynomial.Polynomial:
    """The Hermite cubic in s = (θ − a)/(b − a)."""
    h = b.place - a.place
    d0, d1, jump = a.rate * h, b.rate * h, b.value - a.value
    return np.polynomial.Polynomial([a.value, d0, 3 * jump - 2 * d0 - d1, d0 + d1 - 2 * jump])


def _real_roots(p: np.polynomial.Polynomial) -> list[float]:
    scale = max_norm(p.coef)
    if scale == 0.0 or not np.isfinite(scale):
        return []
    roots = (p / scale).trim(1e-14).roots()
    return sorted(float(r.real) for r in np.atleast_1d(roots) if abs(r.imag) < 1e-9)


def _falling_root(cubic: np.polynomial.Polynomial, a: End, h: float) -> float | None:
    """Where the cubic first falls through zero; it rises from a root at the start."""
    slope = cubic.deriv()
    for s in _real_roots(cubic):
        if 0.0 <= s <= 1.0 and slope(s) <= 0.0:
            return a.place + s * h
    return None


def _least(cubic: np.polynomial.Polynomial, a: End, h: float) -> float | None:
    """Where the cubic is least inside the interval."""
    inside = [s for s in _real_roots(cubic.deriv()) if 0.0 < s < 1.0]
    if not inside:
        return None
    return a.place + float(min(inside, key=cubic)) * h
