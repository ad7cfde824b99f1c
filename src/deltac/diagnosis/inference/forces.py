"""Logged forces between rows: held, straight or smooth, as they were logged or through a filter.

A force acts from row to row in a way that a log does not say. Where several steps lie between two rows it may
have been held over each of them: a stair, which on average is its line half a step later.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import simpson
from scipy.interpolate import CubicHermiteSpline

from deltac.arrays import EPS, ROUGHLY, Array
from deltac.diagnosis.inference.model import Intervals
from deltac.trajectories.splines import spline_integrals, spline_rates


class ForceBetween(Protocol):
    """Logged forces (N, m) at a fraction of each interval, in a step that begins at another.

    Fractions are of all intervals, or of each its own (N, 1).
    """

    def __call__(self, fraction: float | Array, begin: float | Array | None = None, /) -> Array:
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


CUBIC, QUINTIC = 3, 5
"""Degrees of the spline by which smooth forces act, and of the one that estimates its error, which is largest
at the ends, where rows on one side alone tell."""

KEPT_FRACTIONS = 32
"""Fractions of the intervals of which forces are kept: the stages of two steps of order 8."""


@dataclass(frozen=True, eq=False)
class LoggedForce:
    """Logged forces (N, m) between the rows: at the start, their change, and the bends of a spline.

    `gap` (N, m): by how much their mean over an interval differs between splines of two orders; `doubt`: the
    same at most; `ends`: the doubt of the first and the last interval of a piece, of which rows on one side
    alone tell; `counts` (N,): times in each interval that they are held.
    """

    first: Array
    change: Array
    bends: tuple[Array, Array]
    gap: Array
    doubt: Array
    ends: Array
    counts: NDArray[np.intp]

    @cached_property
    def erratic(self) -> NDArray[np.bool_]:
        """Columns (m,) of which the mean of its neighbours predicts a row no better than that of all rows."""
        first, half = self.first, 0.5 * (self.change[1:] - self.change[:-1])
        return np.asarray(np.mean(half**2, axis=0) > np.var(first, axis=0))

    def part(self, which: int, s: float | Array, begin: float | Array | None = None) -> Array:
        """What a, b, c or d multiplies at the fraction s, in a step that begins at another."""
        if which < 2:
            return s * self.change if which else self.change
        if which == 2:
            return self._bent(s)
        # Of several steps, half of one later on average.
        count = self.counts[:, None]
        held = np.where(count > 1, s - 0.5 / count, 0.0)
        if begin is not None:
            held = np.floor(begin * count + EPS * count) / count
        return np.asarray((held - s) * self.change + self._bent(held) - self._bent(s))

    def _bent(self, s: float | Array) -> Array:
        first, last = self.bends
        return np.asarray(s * (1.0 - s) * ((1.0 - s) * first - s * last))

    def __call__(self, kinds: tuple[str, ...]) -> LoggedForceBetween:
        """The forces of each column by its kind."""
        weights = np.array([FORCES[kind] for kind in kinds]).reshape(-1, 4).T
        some = np.flatnonzero(weights.any(axis=1)).tolist()

        def at(s: float | Array, begin: float | Array | None = None) -> Array:
            F = self.first
            for k in some:
                F = F + weights[k] * self.part(k, s, begin)
            return F

        return LoggedForceBetween(self, kinds, at, lru_cache(KEPT_FRACTIONS)(at))

    def take(self, which: NDArray[np.intp]) -> LoggedForce:
        """Those in some of the intervals."""
        first, last = self.bends
        return LoggedForce(
            self.first[which], self.change[which], (first[which], last[which]), self.gap[which],
            self.doubt[which], self.ends[which], self.counts[which],
        )  # fmt: skip

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
        """Those of intervals in pieces of consecutive ones, held so many times (N,) in each.

        Where a log has those at the stages of single steps, they are quadratic in the step: what a controller
        changes at a row is none of their course.
        """
        first, change, h = intervals.start.F, intervals.end.F - intervals.start.F, intervals.h
        if intervals.stages and counts is not None and counts.max() == 1:
            *middle, last = intervals.stages
            bend = 4.0 * np.mean(middle, axis=0) - 2.0 * (first + last) if middle else 0.0 * first
            none = np.zeros_like(first)
            return LoggedForce(first, last - first, (bend, -bend), none, none, none, counts)
        slopes = [np.zeros_like(first), np.zeros_like(first)]
        gap, doubt, ends = (np.zeros_like(first) for _ in range(3))
        for a, b in pieces:
            t = np.append(intervals.start.t[a:b], intervals.end.t[b - 1])
            F = np.concatenate([first[a:b], intervals.end.F[b - 1 : b]])
            rate = lower = np.gradient(F, t, axis=0, edge_order=2 if len(t) > 2 else 1)
            if len(t) > CUBIC:
                rate = spline_rates(t, F, CUBIC)
            slopes[0][a:b], slopes[1][a:b] = rate[:-1], rate[1:]
            # The mean of s(1 − s)² and of s²(1 − s) is 1/12 each.
            by = rate - lower
            gap[a:b] = h[a:b] * (by[:-1] - by[1:]) / 12.0
            doubt[a:b] = h[a:b] * (np.abs(by[:-1]) + np.abs(by[1:])) / 12.0
            if len(t) > QUINTIC:
                outer = [a, b - 1]
                ends[outer] = doubt[outer]
                higher, cubic = (spline_integrals(t, F, k) for k in (QUINTIC, CUBIC))
                gap[a:b] = (higher - cubic) / h[a:b]
                # The error changes its sign; its bound does not vanish there.
                near = np.pad(np.abs(gap[a:b]), ((1, 1), (0, 0)))
                doubt[a:b] = np.max([near[:-2], near[1:-1], near[2:]], axis=0)
        bends = h * slopes[0] - change, h * slopes[1] - change
        counts = np.ones(len(h), dtype=np.intp) if counts is None else counts
        return LoggedForce(first, change, bends, gap, doubt, ends, counts)


@dataclass(frozen=True, eq=False)
class LoggedForceBetween:
    """Logged forces at fractions of each interval, each column by its kind, see `FORCES`.

    at    the forces (N, m) at a fraction, in a step that begins at another
    kept  the same, of one fraction in all intervals: methods and their derivatives ask for it again
    """

    logged: LoggedForce
    kinds: tuple[str, ...]
    at: Callable[..., Array]
    kept: Callable[..., Array]

    def __call__(self, fraction: float | Array, begin: float | Array | None = None, /) -> Array:
        """As of `ForceBetween`."""
        return (self.kept if isinstance(fraction, float) else self.at)(fraction, begin)


def restricted(force: ForceBetween, which: NDArray[np.intp]) -> ForceBetween:
    """The forces in some of the intervals."""
    if isinstance(force, LoggedForceBetween):
        return force.logged.take(which)(force.kinds)
    return lambda s, begin=None, /: np.asarray(force(s, begin)[which])


@dataclass(frozen=True, eq=False)
class InterpolatedForces:
    """Logged forces as they act between the rows.

    logged      those of the rows
    kinds       how each column acts, see `FORCES`
    declared    the same as far as the log says it, else ""
    filter      delay and deviation (s) of a filter of the states, that forces went through as well
    unfiltered  the forces before it
    """

    logged: LoggedForce
    kinds: tuple[str, ...]
    declared: tuple[str, ...]
    filter: tuple[float, float] | None = None
    unfiltered: InterpolatedForces | None = None

    @cached_property
    def between(self) -> ForceBetween:
        """The forces at fractions of each interval."""
        return self.logged(self.kinds)

    @property
    def parts(self) -> NDArray[np.intp] | None:
        """Equal parts (N,) of the intervals over which forces are held."""
        return self.logged.counts if "step" in self.kinds else None

    @cached_property
    def stairs(self) -> tuple[bool, ...]:
        """Whether each column changes at some rows and keeps its value from most to the next: it is held."""
        keeps = np.mean(self.logged.change == 0.0, axis=0)
        return tuple(bool(0.5 < share < 1.0) for share in keeps)

    @property
    def switching(self) -> NDArray[np.bool_]:
        """Where (N, m) stairs change between two rows, of which they have the mean there."""
        own = zip(self.stairs, self.declared, self.kinds, strict=True)
        some = [stair and not declared and kind == "mean" for stair, declared, kind in own]
        return np.asarray((self.logged.change != 0.0) & np.array(some, dtype=np.bool_))

    @cached_property
    def kinked(self) -> tuple[bool, ...]:
        """Whether columns may be piecewise linear: splines of two orders differ by a tenth of the bend."""
        first, last = self.logged.bends
        bend, gap = (np.mean(x**2, axis=0) for x in ((first - last) / 12.0, self.logged.gap))
        return tuple((gap > ROUGHLY**2 * bend).tolist())

    @property
    def continuous(self) -> bool:
        """Whether forces have one value at each row, from both sides."""
        jumps = [k for k, kind in enumerate(self.kinds) if kind not in ("smooth", "ramp")]
        return not self.logged.change[:, jumps].any()

    @property
    def several(self) -> bool:
        """Whether forces may be held several times between some rows."""
        return bool(self.logged.counts.max() > 1)

    def act_as(self, other: InterpolatedForces) -> bool:
        """Whether others, of the same rows, act as these."""
        same = self.kinds == other.kinds and self.filter == other.filter
        return same and np.array_equal(self.logged.counts, other.logged.counts)

    def of(self, kinds: Sequence[str]) -> InterpolatedForces:
        """The same where columns act like this as far as the log does not say how."""
        own = zip(self.declared, kinds, strict=True)
        return replace(self, kinds=tuple(declared or kind for declared, kind in own))

    def alike(self, kind: str) -> InterpolatedForces:
        """The same where all columns act alike as far as the log does not say how."""
        return self.of([kind] * len(self.kinds))

    def held(self, counts: NDArray[np.intp]) -> InterpolatedForces:
        """The same where they may be held so many times (N,) in each interval."""
        return replace(self, logged=replace(self.logged, counts=counts))

    def filtered(
        self, intervals: Intervals, pieces: list[tuple[int, int]], delay: float, spread: float
    ) -> tuple[InterpolatedForces, Intervals]:
        """The forces as a filter of the states makes them, and the intervals with these."""
        unfiltered = self.unfiltered or self
        late = LoggedForce.filtered(intervals, pieces, unfiltered.between, delay, spread)
        smooth = ("smooth",) * len(self.kinds)
        logged = LoggedForce.of(late, pieces)
        forces = InterpolatedForces(logged, smooth, self.declared, (delay, spread), unfiltered)
        return forces, late


def impulse(responses: Array, forces: Array, h: Array) -> Array:
    """What forces (5, N, m, p) at equal fractions of each interval, h (N, 1), move its end by (N, 2n, p).

    `responses` (m, N, n) are the accelerations by a unit of each.
    """
    nodes, of_unit = np.linspace(0.0, 1.0, 5), responses.transpose(1, 2, 0)
    left, h = (1.0 - nodes)[:, None, None, None], h[:, :, None]
    mean, moment = (simpson(x, x=nodes, axis=0) for x in (forces, left * forces))
    return np.concatenate([h**2 * (of_unit @ moment), h * (of_unit @ mean)], axis=1)
