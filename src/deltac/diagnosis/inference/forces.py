"""Logged forces between rows: held, straight or smooth, and by which of these laws the rows go.

A force acts from row to row in a way that a log does not say. Where several steps lie between two rows it may
have been held over each of them: a stair, which on average is its line half a step later.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import simpson
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from deltac.arrays import EPS, Array
from deltac.diagnosis.inference.hypotheses import CERTAIN
from deltac.diagnosis.inference.model import Intervals


class ForceBetween(Protocol):
    """Logged forces (N, m) at a fraction of each interval, in a step that begins at another."""

    def __call__(self, fraction: float, begin: float | None = None, /) -> Array:
        """The forces; without a begin, the mean course of those that are held over several steps."""
        ...


class ForceInStep(Protocol):
    """Forces (N, m) at a fraction of a step, and at that stage of it where the log tells them."""

    def __call__(self, fraction: float, stage: int = 0, /) -> Array:
        """The forces; those of the first stage are of the start."""
        ...


FORCES: dict[str, tuple[float, float, float, float]] = {
    "smooth": (0.0, 1.0, 1.0, 0.0),
    "ramp": (0.0, 1.0, 0.0, 0.0),
    "start": (0.0, 0.0, 0.0, 0.0),
    "end": (1.0, 0.0, 0.0, 0.0),
    "mean": (0.5, 0.0, 0.0, 0.0),
    "step": (0.0, 1.0, 1.0, 1.0),
}
"""How logged forces act between two rows: F = F₀ + (a + b s) ΔF + c S(s) + d L(s) at the fraction s of the
interval, as (a, b, c, d); S is what a cubic through the neighbouring rows adds to the straight line, and L
what a force lacks of that which is held over each of several steps between the rows."""


HELD = ("start", "step")
"""Ways in which forces act that are constant over steps."""

SUBDIVISIONS = 4
"""Parts of an interval in which a force that is filtered counts as constant."""


FRACTIONS = 32
"""Fractions of the intervals of which forces are kept: the stages of two steps of order 8."""


@dataclass(frozen=True, eq=False)
class LoggedForce:
    """Logged forces (N, m) between the rows: at the start, their change, and the bends of a spline.

    `doubt` (N, m): by how much their mean over an interval differs between splines of two orders, at most;
    `gap` (N, m): by how much it does; `counts` (N,): times in each interval that they are held.
    """

    first: Array
    change: Array
    bends: tuple[Array, Array]
    doubt: Array
    gap: Array
    counts: NDArray[np.intp]

    def parts(self, s: float, begin: float | None = None) -> tuple[Array, Array, Array, Array]:
        """What a, b, c and d multiply at the fraction s, in a step that begins at another."""
        # Of several steps, half of one later on average.
        count = self.counts[:, None]
        held = np.where(count > 1, s - 0.5 / count, 0.0)
        if begin is not None:
            held = np.floor(begin * count + EPS * count) / count
        bent = self._bent(s)
        return (
            self.change,
            s * self.change,
            bent,
            (held - s) * self.change + self._bent(held) - bent,
        )

    def _bent(self, s: float | Array) -> Array:
        first, last = self.bends
        return np.asarray(s * (1.0 - s) * ((1.0 - s) * first - s * last))

    def __call__(self, kinds: tuple[str, ...]) -> ForceBetween:
        """The forces of each column by its kind, see `FORCES`."""
        weights = np.array([FORCES[kind] for kind in kinds]).reshape(-1, 4).T

        # Methods and their derivatives ask for the same stages again and again.
        @lru_cache(FRACTIONS)
        def at(s: float, begin: float | None = None) -> Array:
            F = self.first
            for weight, part in zip(weights, self.parts(s, begin), strict=True):
                F = F + weight * part if weight.any() else F
            return F

        return at

    @staticmethod
    def filtered(
        intervals: Intervals,
        pieces: list[tuple[int, int]],
        force: ForceBetween,
        delay: float,
        spread: float,
    ) -> Intervals:
        """The intervals with forces that are late, and smooth: weighed by a triangle of that deviation, s."""
        first, last = np.empty_like(intervals.start.F), np.empty_like(intervals.start.F)
        width, within = spread * np.sqrt(6.0), np.linspace(0.0, 1.0, SUBDIVISIONS + 1)
        values = np.stack([force(float(s)) for s in within], axis=1)
        for a, b in pieces:
            t, h = intervals.start.t[a:b, None], intervals.h[a:b]
            steps = np.repeat(h / SUBDIVISIONS, SUBDIVISIONS, axis=1).ravel()
            fine = np.concatenate([(t + within[:-1] * h).ravel(), intervals.end.t[b - 1 : b]])
            means = 0.5 * (values[a:b, :-1] + values[a:b, 1:]).reshape(len(steps), -1)
            # The force goes on beyond both ends as it is there; two integrals make a triangle's mean exact.
            reach = 2.0 * (abs(delay) + width)
            fine = np.concatenate([[fine[0] - reach], fine, [fine[-1] + reach]])
            steps = np.concatenate([[reach], steps, [reach]])
            means = np.concatenate([means[:1], means, means[-1:]])
            impulse = np.concatenate(
                [np.zeros_like(means[:1]), np.cumsum(steps[:, None] * means, axis=0)]
            )
            added = steps[:, None] * 0.5 * (impulse[:-1] + impulse[1:])
            twice = np.concatenate([np.zeros_like(means[:1]), np.cumsum(added, axis=0)])
            integral = CubicHermiteSpline(fine, twice, impulse, axis=0)
            at = np.append(intervals.start.t[a:b], intervals.end.t[b - 1]) - delay
            parts = integral(at + width) - 2.0 * integral(at) + integral(at - width)
            first[a:b], last[a:b] = parts[:-1] / width**2, parts[1:] / width**2
        start, end = intervals.start, intervals.end
        return Intervals(replace(start, F=first), replace(end, F=last))

    @staticmethod
    def of(
        intervals: Intervals, pieces: list[tuple[int, int]], counts: NDArray[np.intp] | None = None
    ) -> LoggedForce:
        """Those of intervals in pieces of consecutive ones, held so many times (N,) in each."""
        first, change, h = intervals.start.F, intervals.end.F - intervals.start.F, intervals.h
        slopes = [np.zeros_like(first), np.zeros_like(first)]
        doubt, gap = np.zeros_like(first), np.zeros_like(first)
        for a, b in pieces:
            t = np.append(intervals.start.t[a:b], intervals.end.t[b - 1])
            F = np.concatenate([first[a:b], intervals.end.F[b - 1 : b]])
            rate = lower = np.gradient(F, t, axis=0, edge_order=2 if len(t) > 2 else 1)
            if len(t) > 3:
                rate = CubicSpline(t, F, axis=0)(t, 1)
            slopes[0][a:b], slopes[1][a:b] = rate[:-1], rate[1:]
            # The mean of s(1 − s)² and of s²(1 − s) is 1/12 each.
            by = rate - lower
            doubt[a:b] = h[a:b] * (np.abs(by[:-1]) + np.abs(by[1:])) / 12.0
            gap[a:b] = h[a:b] * (by[:-1] - by[1:]) / 12.0
        bends = h * slopes[0] - change, h * slopes[1] - change
        counts = np.ones(len(h), dtype=np.intp) if counts is None else counts
        return LoggedForce(first, change, bends, doubt, gap, counts)


def restricted(force: ForceBetween, which: NDArray[np.intp]) -> ForceBetween:
    """The forces in some of the intervals."""
    return lambda s, begin=None: np.asarray(force(s, begin)[which])


def impulse(response: Array, force: Array, h: Array) -> Array:
    """What a force (5, N) at equal fractions of each interval, h (N, 1), moves its end by (N, 2n)."""
    nodes = np.linspace(0.0, 1.0, 5)
    mean = simpson(force, x=nodes, axis=0)[:, None]
    moment = simpson((1.0 - nodes)[:, None] * force, x=nodes, axis=0)[:, None]
    return np.concatenate([response * h**2 * moment, response * h * mean], axis=1)


def likeliest(
    gram: Array, rows: float, declared: Sequence[int], current: Array, laws: Array, shared: int
) -> list[int]:
    """Which law each logged force follows between rows, by the Gram matrix of innovations and force columns.

    All the same one, which the likelihood chooses; one another where that has odds of its own. The laws from
    `shared` on hold for all or none: they are stairs, each of another delay. A `declared` law of −1 is not
    known, and stays what it is if nothing tells.
    """

    def left(which: Sequence[int]) -> float:
        x = np.concatenate([[1.0], (current - laws[list(which)]).ravel()])
        return max(float(x @ gram @ x), 1e-14 * float(gram[0, 0]) + 1e-300)

    def alike(law: int) -> list[int]:
        return [law if d < 0 else d for d in declared]

    before = [int(np.argmin(np.abs(laws - own).sum(axis=1))) for own in current]
    best = min(map(alike, range(len(laws))), key=left)
    if max(best, default=0) >= shared:
        # A delay beyond that of two steps is of the log, as that of a filter is.
        x = np.concatenate([[1.0], (current - laws[best]).ravel()])
        delay = np.zeros_like(laws[best])
        delay[:, 3] = np.array(declared) < 0
        y = gram @ np.concatenate([[0.0], delay.ravel()])
        further = float(x @ y) / max(float(y[1:] @ delay.ravel()), 1e-300)
        if laws[max(best), 3] + further > BEYOND * laws[shared:, 3].max():
            best = min(map(alike, range(shared)), key=left)
    if 0.5 * rows * np.log(left(before) / left(best)) < CERTAIN:
        best = before
    for k in range(len(declared) if len(declared) <= SINGLY else 0):
        if declared[k] < 0:
            other = min(([*best[:k], law, *best[k + 1 :]] for law in range(shared)), key=left)
            price = CERTAIN + np.log(len(laws) * len(declared))
            if 0.5 * rows * np.log(left(best) / left(other)) > price:
                best = other
    return best


BEYOND = 1.5
"""Delay, in that of a force that is held twice in each interval, beyond which it is the log's."""

SINGLY = 12
"""Columns of logged forces up to which each is asked on its own."""
