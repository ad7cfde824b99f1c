"""The exact flow: each row of a log predicted from the one before, with the variational equation.

With φ_k the flow of ẋ = f from row k to row k + 1, an added field ε F moves the end by ε B_k,
B_k = ∫ Φ(t_{k+1}, t) F dt, and an error e of row k by Φ_k e. Errors of coordinates are counted in the speeds'
components: δq = W δθ, so that quaternions have three.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import EPS, Array
from deltac.diagnosis.residuals.rows import Model, Rows
from deltac.simulation.stepping.runge_kutta import tableau_of

ForceBetween: TypeAlias = Callable[[float], Array]
"""Logged forces (N, m) at a fraction of each interval."""

TILE = 20_000
"""Rows that are evaluated at once: their numbers stay in the processor's cache."""

DOUBLINGS = 4
"""Times that the steps of the flow are halved at most, until they agree beyond the noise of the rows."""

PROBES = 48
"""Intervals on which that is tried."""


@dataclass(frozen=True, eq=False)
class Intervals:
    """Intervals between consecutive rows of a log: their starts and ends, N of them."""

    start: Rows
    end: Rows

    @property
    def h(self) -> Array:
        """Lengths (N, 1), s."""
        return np.asarray((self.end.t - self.start.t)[:, None])

    def __len__(self) -> int:
        return len(self.start.t)

    def taken(self, which: NDArray[np.intp]) -> Intervals:
        """Some of them."""
        return Intervals(self.start.taken(which), self.end.taken(which))


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


@dataclass(frozen=True, eq=False)
class LoggedForce:
    """Logged forces (N, m) between the rows: at the start, their change, and the bends of a cubic."""

    first: Array
    change: Array
    bends: tuple[Array, Array]

    def parts(self, s: float) -> tuple[Array, Array, Array]:
        """What a, b and c multiply at the fraction s."""
        bent = s * (1.0 - s) * ((1.0 - s) * self.bends[0] - s * self.bends[1])
        return self.change, s * self.change, bent

    def __call__(self, kinds: tuple[str, ...]) -> ForceBetween:
        """The forces of each column by its kind, see `FORCES`."""
        a, b, c = np.array([FORCES[kind] for kind in kinds]).reshape(-1, 3).T

        def at(s: float) -> Array:
            steady, linear, bent = self.parts(s)
            return np.asarray(self.first + a * steady + b * linear + c * bent)

        return at

    @staticmethod
    def of(intervals: Intervals, pieces: list[tuple[int, int]]) -> LoggedForce:
        """Those of intervals in pieces of consecutive ones."""
        first, change, h = intervals.start.F, intervals.end.F - intervals.start.F, intervals.h
        slopes = [np.zeros_like(first), np.zeros_like(first)]
        for a, b in pieces:
            t = np.append(intervals.start.t[a:b], intervals.end.t[b - 1])
            F = np.concatenate([first[a:b], intervals.end.F[b - 1 : b]])
            rate = np.gradient(F, t, axis=0, edge_order=2 if len(t) > 2 else 1)
            slopes[0][a:b], slopes[1][a:b] = rate[:-1], rate[1:]
        return LoggedForce(first, change, (h * slopes[0] - change, h * slopes[1] - change))


@dataclass(frozen=True, eq=False)
class Predicted:
    """States along the flow of each interval: `nodes` at equal fractions, the first the row.

    error  of the flow at its end (N, 2n), by halving its steps on some intervals
    """

    nodes: tuple[Rows, ...]
    error: Array

    @property
    def end(self) -> Rows:
        """The prediction of the next row."""
        return self.nodes[-1]


def predicted(
    model: Model, intervals: Intervals, force: ForceBetween, noise: Array, steps: int = 0
) -> Predicted:
    """The flow of every interval, with as many steps as bring its error below the noise (N, 2n) of the rows.

    Or with so many `steps`, where they are known.
    """
    some = np.unique(np.linspace(0, len(intervals) - 1, PROBES).astype(np.intp))
    few = intervals.taken(some)

    def of_few(s: float) -> Array:
        return np.asarray(force(s)[some])

    count, error = steps or 2, np.zeros(2 * model.n)
    coarse = _flow(model, few, of_few, count // 2)[-1]
    for _ in range(1 if steps else DOUBLINGS):
        fine = _flow(model, few, of_few, count)[-1]
        gap = np.abs(difference(model, coarse, fine))
        error = gap.max(axis=0, initial=0.0)
        finite = np.isfinite(error).all()
        if finite and np.all(gap <= 0.03 * noise[some] + 100.0 * EPS * np.abs(_sizes(few))):
            break
        if not steps and count < 2**DOUBLINGS:
            count, coarse = 2 * count, fine
    return Predicted(
        tuple(_flow(model, intervals, force, count)), np.broadcast_to(error, noise.shape)
    )


def _sizes(intervals: Intervals) -> Array:
    """Sizes of coordinates and speeds, of each kind the largest."""
    q = np.abs(intervals.start.q).max(initial=0.0) + 1.0
    u = np.abs(intervals.start.u).max(initial=0.0)
    n = intervals.start.u.shape[1]
    return np.concatenate([np.full(n, q), np.full(n, u)])


def _flow(model: Model, intervals: Intervals, force: ForceBetween, count: int) -> list[Rows]:
    """States at the ends of `count` steps of order 8 in each interval, the starts first."""
    tableau = tableau_of("ode8")
    assert tableau is not None
    start, h = intervals.start, intervals.h / count
    nodes = [Rows(start.t, start.q, start.u, force(0.0))]
    for k in range(count):
        t, q, u = nodes[-1].t, nodes[-1].q, nodes[-1].u
        rates, slopes = list[Array](), list[Array]()
        for row, c in zip(tableau.a, tableau.c):
            qs, us = q, u
            if row:
                dq, du = (np.zeros_like(x[0]) for x in (rates, slopes))
                for weight, rate, slope in zip(row, rates, slopes):
                    if weight:
                        dq, du = dq + weight * rate, du + weight * slope
                qs, us = q + h * dq, u + h * du
            ts = t + c * h[:, 0]
            rates.append(model.rate(ts, qs, us))
            slopes.append(model.acceleration(ts, qs, us, force((k + c) / count)))
        q = q + h * sum(w * r for w, r in zip(tableau.b, rates) if w)
        u = u + h * sum(w * s for w, s in zip(tableau.b, slopes) if w)
        for i, _ in model.quaternions:
            q[:, i : i + 4] /= np.linalg.norm(q[:, i : i + 4], axis=1, keepdims=True)
        nodes.append(Rows(start.t + (k + 1) * h[:, 0], q, u, force((k + 1) / count)))
    return nodes


def difference(model: Model, base: Rows, other: Rows) -> Array:
    """What moves `base` to `other`, (N, 2n): along the speeds and rotation vectors, then speeds."""
    moved = np.zeros_like(base.u)
    for i, j in model.rates:
        moved[:, j] = other.q[:, i] - base.q[:, i]
    for i, j in model.quaternions:
        p, r = base.q[:, i : i + 4], other.q[:, i : i + 4]
        p, r = (x / np.linalg.norm(x, axis=1, keepdims=True) for x in (p, r))
        w = np.sum(p * r, axis=1, keepdims=True)
        v = p[:, :1] * r[:, 1:] - r[:, :1] * p[:, 1:] - np.cross(p[:, 1:], r[:, 1:])
        moved[:, j : j + 3] = 2.0 * np.where(w < 0.0, -v, v)
    return np.concatenate([moved, other.u - base.u], axis=1)


def jacobians(model: Model, at: Rows) -> Array:
    """∂ẋ/∂x (N, 2n, 2n) in the components of `difference`."""
    n, count = model.n, len(at.t)
    J = np.zeros((count, 2 * n, 2 * n))
    J[:, np.arange(n), n + np.arange(n)] = 1.0
    for _, j in model.quaternions:
        J[:, j : j + 3, j : j + 3] = -_cross(at.u[:, j : j + 3])
    here = model.at(at)
    one = np.ones((count, 1))
    for k in range(n):
        e = np.zeros((1, n))
        e[0, k] = 1.0
        d = 1e-7
        there = model.acceleration(
            at.t, model.moved(at.q, np.broadcast_to(e, at.u.shape), d * one), at.u, at.F
        )
        J[:, n:, k] = (there - here) / d
        d = 1e-7 * (1.0 + float(np.abs(at.u[:, k]).max(initial=0.0)))
        J[:, n:, n + k] = (model.acceleration(at.t, at.q, at.u + d * e, at.F) - here) / d
    return J


def _cross(w: Array) -> Array:
    made = np.zeros((len(w), 3, 3))
    made[:, 0, 1], made[:, 0, 2], made[:, 1, 2] = -w[:, 2], w[:, 1], -w[:, 0]
    return made - made.transpose(0, 2, 1)


def transported(h: Array, J: list[Array], F: list[Array]) -> tuple[Array, Array]:
    """Φ (N, 2n, 2n) and B (N, 2n, p) over intervals of length h (N, 1), by J and F at their nodes.

    Φ between neighbouring nodes by a step of the classical Runge–Kutta method with J linear between them, and
    ∫Φ F dt over two of them by Simpson's rule.
    """
    count = len(J) - 1
    step = (h / count)[:, :, None]
    one = np.eye(J[0].shape[1])

    def over(k: int) -> Array:
        middle = 0.5 * (J[k] + J[k + 1])
        k2 = middle + 0.5 * step * middle @ J[k]
        k3 = middle + 0.5 * step * middle @ k2
        k4 = J[k + 1] + step * J[k + 1] @ k3
        return np.asarray(one + (step / 6.0) * (J[k] + 2.0 * k2 + 2.0 * k3 + k4))

    Phi, B = np.broadcast_to(one, J[0].shape), np.zeros_like(F[0])
    for k in range(0, count, 2):
        first, second = over(k), over(k + 1)
        B = second @ (first @ (B + (step / 3.0) * F[k]) + (4.0 * step / 3.0) * F[k + 1])
        B += (step / 3.0) * F[k + 2]
        Phi = second @ first @ Phi
    return Phi, B
