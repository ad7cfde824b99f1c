"""Impacts that follow each other ever faster: infinitely many in a finite time (Zeno)."""

from __future__ import annotations

from collections.abc import Sequence

HEIGHT = 1e-12
"""Flights that reach no farther than this (m or rad) are lost in rounding."""


class Accumulation:
    """Watches the times between impacts at each point.

    Flights τ, r τ, r² τ, … end τ r/(1 − r) after the last impact.
    """

    def __init__(self, names: Sequence[str]) -> None:
        """`names` of what happens, for words."""
        self._names = names
        self._times: dict[int, list[float]] = {}
        self._end: dict[int, float] = {}

    def add(self, point: int, t: float, speed: float) -> bool:
        """Note an impact that left with `speed`; whether its flights have become too short to follow."""
        times = self._times.setdefault(point, [])
        times.append(t)
        del times[:-4]
        if len(times) < 4:
            return False
        first, second, third = (b - a for a, b in zip(times, times[1:]))
        if not 0.0 < third < second < first:
            return False
        ratio = third / second
        self._end[point] = t + third * ratio / (1.0 - ratio)
        return abs(speed) * third <= HEIGHT

    def words(self, point: int) -> str:
        """What is to be said, with the time at which they come to their end."""
        t = self._times[point][-1]
        return (
            f"stopped at t = {t:.9g} s: {self._names[point]!r} happens ever faster, infinitely often until "
            f"t = {self._end[point]:.12g} s, and then the contact lasts. End the run before (a shorter "
            "duration, or a terminal event), or use a compliant contact"
        )
