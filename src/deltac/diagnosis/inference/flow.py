"""The exact flow: each row of a log predicted from the one before, with the variational equation.

With φ_k the flow of ẋ = f from row k to row k + 1, an added field ε F moves the end by ε B_k,
B_k = ∫ Φ(t_{k+1}, t) F dt, and an error e of row k by Φ_k e. Errors of coordinates are counted in the speeds'
components: δq = W δθ, so that quaternions have three.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from deltac.arrays import EPS, Array
from deltac.diagnosis.inference.model import Model, Rows
from deltac.simulation.stepping.runge_kutta import Tableau, tableau_of

ForceBetween: TypeAlias = Callable[[float], Array]
"""Logged forces (N, m) at a fraction of each interval."""


class ForceInStep(Protocol):
    """Forces (N, m) at a fraction of a step, and at that stage of it where the log tells them."""

    def __call__(self, fraction: float, stage: int = 0, /) -> Array:
        """The forces; those of the first stage are of the start."""
        ...


DOUBLINGS = 4
"""Times that the steps of the flow are halved at most, until they agree beyond the noise of the rows."""

PROBES = 48
"""Intervals on which that is tried."""

REFINEMENTS = 2
"""Times that intervals are refined on their own, by four each: onsets of contact lie within a few steps."""


@dataclass(frozen=True, eq=False)
class Intervals:
    """Intervals between consecutive rows of a log: their starts and ends, N of them.

    `stages`: logged forces (N, m) at the later stages of the step that the solver made from the start.
    """

    start: Rows
    end: Rows
    stages: tuple[Array, ...] = ()

    @property
    def h(self) -> Array:
        """Lengths (N, 1), s."""
        return np.asarray((self.end.t - self.start.t)[:, None])

    def __len__(self) -> int:
        return len(self.start.t)

    def take(self, which: NDArray[np.intp]) -> Intervals:
        """Some of them."""
        stages = tuple(F[which] for F in self.stages)
        return Intervals(self.start.take(which), self.end.take(which), stages)


FORCES: dict[str, tuple[float, float, float]] = {
    "smooth": (0.0, 1.0, 1.0),
    "ramp": (0.0, 1.0, 0.0),
    "start": (0.0, 0.0, 0.0),
    "end": (1.0, 0.0, 0.0),
    "mean": (0.5, 0.0, 0.0),
}
"""How logged forces act between two rows: F = F₀ + (a + b s) ΔF + c S(s) at the fraction s of the
interval, as
(a, b, c); S is what a cubic through the neighbouring rows adds to the straight line."""


SUBDIVISIONS = 4
"""Parts of an interval in which a force that is filtered counts as constant."""


FRACTIONS = 32
"""Fractions of the intervals of which forces are kept: the stages of two steps of order 8."""


@dataclass(frozen=True, eq=False)
class LoggedForce:
    """Logged forces (N, m) between the rows: at the start, their change, and the bends of a spline.

    `doubt` (N, m): by how much their mean over an interval differs between splines of two orders, at most;
    `gap` (N, m): by how much it does.
    """

    first: Array
    change: Array
    bends: tuple[Array, Array]
    doubt: Array
    gap: Array

    def parts(self, s: float) -> tuple[Array, Array, Array]:
        """What a, b and c multiply at the fraction s."""
        bent = s * (1.0 - s) * ((1.0 - s) * self.bends[0] - s * self.bends[1])
        return self.change, s * self.change, bent

    def __call__(self, kinds: tuple[str, ...]) -> ForceBetween:
        """The forces of each column by its kind, see `FORCES`."""
        weights = np.array([FORCES[kind] for kind in kinds]).reshape(-1, 3).T

        # Methods and their derivatives ask for the same stages again and again.
        @lru_cache(FRACTIONS)
        def at(s: float) -> Array:
            F = self.first
            for weight, part in zip(weights, self.parts(s), strict=True):
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
    def of(intervals: Intervals, pieces: list[tuple[int, int]]) -> LoggedForce:
        """Those of intervals in pieces of consecutive ones."""
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
        return LoggedForce(first, change, bends, doubt, gap)


@dataclass(frozen=True, eq=False)
class Prediction:
    """States along the flow of each interval: `nodes` at equal fractions, the first the row.

    error  of the flow at its end (N, 2n), by halving its steps
    """

    nodes: tuple[Rows, ...]
    error: Array

    @property
    def end(self) -> Rows:
        """The prediction of the next row."""
        return self.nodes[-1]


def predict(
    model: Model, intervals: Intervals, force: ForceBetween, noise: Array, steps: int = 0
) -> Prediction:
    """The flow of every interval, with as many steps as bring its error below the noise (N, 2n) of the rows.

    Or with so many `steps`, where they are known. Intervals in which that is not enough, such as those in
    which a contact begins, are refined on their own; what error remains is told.
    """
    allowed = 0.03 * noise + 100.0 * EPS * _sizes(intervals)
    if not steps:
        probes = np.unique(np.linspace(0, len(intervals) - 1, PROBES).astype(np.intp))
        few, steps = intervals.take(probes), 2
        coarse = _flow(model, few, restricted(force, probes), 1)[-1]
        while True:
            fine = _flow(model, few, restricted(force, probes), steps)[-1]
            # Refined on their own are few: nine tenths must be exact enough.
            gap = np.abs(model.difference(coarse, fine)) <= allowed[probes]
            if gap.all(axis=1).mean() >= 0.9 or steps >= 2**DOUBLINGS:
                break
            steps, coarse = 2 * steps, fine
    nodes = _flow(model, intervals, force, steps)
    error = np.abs(model.difference(_flow(model, intervals, force, steps // 2)[-1], nodes[-1]))
    for level in range(1, REFINEMENTS + 1):
        some = np.flatnonzero(~np.all(error <= allowed, axis=1))
        if not len(some) or len(some) > 0.5 * len(intervals):
            break
        each = 4**level
        finer = _flow(model, intervals.take(some), restricted(force, some), steps, each)
        error[some] = np.abs(model.difference(nodes[-1].take(some), finer[-1]))
        nodes = [_replaced(rows, some, own) for rows, own in zip(nodes, finer, strict=True)]
    return Prediction(tuple(nodes), error)


def restricted(force: ForceBetween, which: NDArray[np.intp]) -> ForceBetween:
    """The forces in some of the intervals."""
    return lambda s: np.asarray(force(s)[which])


def _replaced(rows: Rows, which: NDArray[np.intp], own: Rows) -> Rows:
    columns = [np.array(x) for x in (rows.t, rows.q, rows.u, rows.F)]
    for x, y in zip(columns, (own.t, own.q, own.u, own.F), strict=True):
        x[which] = y
    return Rows(*columns)


def _sizes(intervals: Intervals) -> Array:
    """Sizes (2n,) of coordinates and speeds, of each kind the largest."""
    q = np.abs(intervals.start.q).max(initial=0.0) + 1.0
    u = np.abs(intervals.start.u).max(initial=0.0)
    n = intervals.start.u.shape[1]
    return np.concatenate([np.full(n, q), np.full(n, u)])


def runge_kutta(
    model: Model,
    tableau: Tableau,
    at: Rows,
    h: Array,
    force: ForceInStep,
    on_group: bool = False,
) -> tuple[Array, Array]:
    """Coordinates and speeds after a step h (N, 1) by an explicit method.

    The stages' rates of rotations are added as quaternions, or `on_group` as rotation vectors.
    """
    rates, slopes = list[Array](), list[Array]()

    def moved(weights: Sequence[float]) -> tuple[Array, Array]:
        dq, du = np.zeros_like(rates[0]), np.zeros_like(slopes[0])
        for w, r, s in zip(weights, rates, slopes, strict=True):
            if w:
                dq += w * r
                du += w * s
        return model.moved(at.q, dq, h) if on_group else at.q + h * dq, at.u + h * du

    for stage, (row, c) in enumerate(zip(tableau.a, tableau.c, strict=True)):
        q, u = moved(row) if rates else (at.q, at.u)
        t = at.t + c * h[:, 0]
        rates.append(u if on_group else model.rate(t, q, u))
        slopes.append(model.acceleration(t, q, u, force(c, stage)))
    q, u = moved(tableau.b)
    for i, _ in model.quaternions:
        q[:, i : i + 4] /= np.linalg.norm(q[:, i : i + 4], axis=1, keepdims=True)
    return q, u


def _flow(
    model: Model, intervals: Intervals, force: ForceBetween, count: int, each: int = 1
) -> list[Rows]:
    """States at the ends of `count` parts of each interval, of `each` steps of order 8; the starts first."""
    tableau = tableau_of("ode8")
    assert tableau is not None
    start, h = intervals.start, intervals.h / (count * each)
    nodes = [Rows(start.t, start.q, start.u, force(0.0))]
    at = nodes[0]
    for k in range(count * each):

        def within(c: float, _: int = 0, k: int = k) -> Array:
            return force((k + c) / (count * each))

        q, u = runge_kutta(model, tableau, at, h, within)
        at = Rows(start.t + (k + 1) * h[:, 0], q, u, force((k + 1) / (count * each)))
        if (k + 1) % each == 0:
            nodes.append(at)
    return nodes


def transitions(h: Array, J: list[Array]) -> list[Array]:
    """Φ (N, 2n, 2n) between neighbouring nodes of intervals of length h (N, 1), by J at the nodes.

    By a step of the classical Runge–Kutta method, J linear within it.
    """
    step = (h / (len(J) - 1))[:, :, None]
    half, one = 0.5 * step, np.eye(J[0].shape[1])

    def over(first: Array, last: Array) -> Array:
        middle = 0.5 * (first + last)
        k2 = middle + half * (middle @ first)
        k3 = middle + half * (middle @ k2)
        k4 = last + step * (last @ k3)
        return np.asarray(one + (step / 6.0) * (first + 2.0 * k2 + 2.0 * k3 + k4))

    return [over(*ends) for ends in zip(J, J[1:], strict=False)]


def transported(h: Array, steps: list[Array], F: list[Array]) -> tuple[Array, Array]:
    """Φ (N, 2n, 2n) and B (N, 2n, p) over intervals of length h (N, 1), by `transitions` and F at the nodes.

    B = ∫Φ F dt by Simpson's rule over two steps each.
    """
    weight = (h / len(steps) / 3.0)[:, :, None]
    Phi, B = np.eye(steps[0].shape[1]), np.zeros_like(F[0])
    for k in range(0, len(steps), 2):
        first, second = steps[k], steps[k + 1]
        B = second @ (first @ (B + weight * F[k]) + 4.0 * weight * F[k + 1])
        B += weight * F[k + 2]
        Phi = second @ first @ Phi
    return Phi, B
