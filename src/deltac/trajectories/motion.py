"""Whether coordinates move as their speeds say: Δq over each interval beside ∫u dt.

The one test of kinematics that needs no model: it tells times, orders of state vectors, frames and orders of
quaternions when a log is read, and slips of units afterwards.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from deltac.arrays import NEGLIGIBLE, ROUGHLY, Array, max_norm
from deltac.trajectories.rates import continuous, rotation_vectors

T = TypeVar("T")


CLEAR_RATIO = 0.5
"""A reading other than the declared or usual one must miss by so much less."""

FIT, NEAR_RATIO = 0.98, 0.02
"""Least correlation of a fit that counts, and how near its ratio is to a known one, relative."""

INCREMENTS = 40
"""Parts of a log over which increments are summed."""


@dataclass(frozen=True, eq=False)
class Movement:
    """Increments of coordinates and integrals of speeds, over intervals (I, n)."""

    increments: Array
    integrals: Array

    @classmethod
    def of(cls, t: Array, q: Array, u: Array) -> Movement:
        """Of coordinates (T, n) with the rates u (T, n)."""
        return cls(np.diff(q, axis=0), integral(t, u))

    @classmethod
    def turning(cls, t: Array, p: Array, w: Array, frame: str) -> Movement:
        """Of quaternions (T, 4), scalar first, with angular velocities in "body" or "world" components."""
        return cls(rotation_vectors(continuous(p), frame), integral(t, w))

    def among(self, intervals: npt.NDArray[np.bool_]) -> Movement:
        """The same over some of the intervals."""
        return Movement(self.increments[intervals], self.integrals[intervals])

    def column(self, k: int) -> Movement:
        """That of one coordinate (I, 1)."""
        return Movement(self.increments[:, k : k + 1], self.integrals[:, k : k + 1])

    def sizes(self) -> tuple[float, float]:
        """The sum of all movement, and of all differences; missing values count nothing."""
        return (
            float(np.nansum(np.abs(self.increments)) + np.nansum(np.abs(self.integrals))),
            float(np.nansum(np.abs(self.increments - self.integrals))),
        )

    @property
    def miss(self) -> float:
        """How far the increments differ from what speeds say, as a share, along the worst axis.

        Summed over some rows the noise of coordinates falls out; then they must agree twice as well.
        """
        rows = np.arange(0, len(self.increments), max(1, len(self.increments) // INCREMENTS))
        sums = (
            np.add.reduceat(values, rows, axis=0) for values in (self.increments, self.integrals)
        )
        return min(_worst(self.increments, self.integrals), 2.0 * _worst(*sums))

    def fit(self) -> RatioFit:
        """Least squares of the increments on the integrals, scaled first: no square under- or overflows."""
        a, b = (max_norm(x) for x in (self.increments, self.integrals))
        if not (a > 0.0 and b > 0.0):
            return RatioFit(0.0, 0.0)
        x, y = (self.integrals / b).ravel(), (self.increments / a).ravel()
        xy, xx, yy = float(x @ y), float(x @ x), float(y @ y)
        return RatioFit(xy / xx * (a / b), xy / math.sqrt(xx * yy))


@dataclass(frozen=True)
class RatioFit:
    """Δq = ratio · ∫u dt; `correlation` 1 where that holds exactly, 0 where nothing moves."""

    ratio: float
    correlation: float

    @property
    def good(self) -> bool:
        """Whether it counts."""
        return abs(self.correlation) >= FIT

    def near(self, value: float) -> bool:
        """Whether it counts, and its ratio is this one."""
        return self.good and abs(self.ratio / value - 1.0) <= NEAR_RATIO

    def beats(self, usual: RatioFit) -> bool:
        """Whether this reading fits where the usual one does not, and by far better."""
        misfit, usual_misfit = 1.0 - abs(self.correlation), 1.0 - abs(usual.correlation)
        return self.good and not usual.good and misfit < 0.2 * usual_misfit


def preferred(readings: Sequence[T], miss: Callable[[T], float]) -> T | None:
    """The first, the declared or usual one, unless another agrees with the motion and misses clearly less.

    Where none agrees, since samples are far apart or noisy, the one that misses clearly less than all others.
    """
    ordered = sorted(readings, key=miss)
    if not ordered:
        return None
    best, least = ordered[0], miss(ordered[0])
    if least < ROUGHLY:
        return readings[0] if least > CLEAR_RATIO * miss(readings[0]) else best
    return best if least < CLEAR_RATIO * min([1.0, *map(miss, ordered[1:])]) else None


def integral(t: Array, u: Array) -> Array:
    """What speeds (T, n) move over each interval (T−1, n), by trapezoids."""
    result: Array = 0.5 * np.diff(t)[:, None] * (u[1:] + u[:-1])
    return result


def _worst(moved: Array, integrated: Array) -> float:
    size = np.abs(moved).sum(axis=0) + np.abs(integrated).sum(axis=0)
    difference = np.abs(moved - integrated).sum(axis=0)
    telling = size > NEGLIGIBLE * size.sum()
    return float(np.max(difference[telling] / size[telling])) if telling.any() else np.inf
