"""The exact flow: each row of a log predicted from the one before, with the variational equation.

With φ_k the flow of ẋ = f from row k to row k + 1, an added field ε F moves the end by ε B_k,
B_k = ∫ Φ(t_{k+1}, t) F dt, and an error e of row k by Φ_k e. Errors of coordinates are counted in the speeds'
components: δq = W δθ, so that quaternions have three.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import EPS, Array
from deltac.diagnosis.inference.forces import ForceBetween, ForceInStep, restricted
from deltac.diagnosis.inference.model import Intervals, LogModel, Rows
from deltac.simulation.stepping.runge_kutta import Tableau, tableau_of

DOUBLINGS = 4
"""Times that the steps of the flow are halved at most, until they agree beyond the noise of the rows."""

PROBES = 48
"""Intervals on which that is tried."""

REFINEMENTS = 2
"""Times that intervals are refined on their own, by four each: onsets of contact lie within a few steps."""


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
    model: LogModel,
    intervals: Intervals,
    force: ForceBetween,
    noise: Array,
    steps: int = 0,
    parts: NDArray[np.intp] | None = None,
) -> Prediction:
    """The flow of every interval, with as many steps as bring its error below the noise (N, 2n) of the rows.

    Or with so many `steps`, where they are known. Forces may be held over equal `parts` (N,) of each. Those
    in which that is not enough, such as those in which a contact begins, are refined on their own; what error
    remains is told.
    """
    allowed = 0.03 * noise + 100.0 * EPS * _sizes(intervals)
    parts = np.ones(len(intervals), dtype=np.intp) if parts is None else parts
    if not steps:
        probes = np.unique(np.linspace(0, len(intervals) - 1, PROBES).astype(np.intp))
        few, steps = intervals.take(probes), 2
        of_few = restricted(force, probes)
        coarse = _flow(model, few, of_few, 1, 1, parts[probes])[-1]
        while True:
            fine = _flow(model, few, of_few, steps, 1, parts[probes])[-1]
            # Refined on their own are few: nine tenths must be exact enough.
            gap = np.abs(model.difference(coarse, fine)) <= allowed[probes]
            if gap.all(axis=1).mean() >= 0.9 or steps >= 2**DOUBLINGS:
                break
            steps, coarse = 2 * steps, fine
    nodes = _flow(model, intervals, force, steps, 1, parts)
    coarse = _flow(model, intervals, force, steps // 2, 1, parts)[-1]
    error = np.abs(model.difference(coarse, nodes[-1]))
    for level in range(1, REFINEMENTS + 1):
        some = np.flatnonzero(~np.all(error <= allowed, axis=1))
        if not len(some) or len(some) > 0.5 * len(intervals):
            break
        each = 4**level
        own = restricted(force, some)
        finer = _flow(model, intervals.take(some), own, steps, each, parts[some])
        error[some] = np.abs(model.difference(nodes[-1].take(some), finer[-1]))
        nodes = [rows.replaced(some, other) for rows, other in zip(nodes, finer, strict=True)]
    return Prediction(tuple(nodes), error)


def _sizes(intervals: Intervals) -> Array:
    """Sizes (2n,) of coordinates and speeds, of each kind the largest."""
    q = np.abs(intervals.start.q).max(initial=0.0) + 1.0
    u = np.abs(intervals.start.u).max(initial=0.0)
    n = intervals.start.u.shape[1]
    return np.concatenate([np.full(n, q), np.full(n, u)])


def runge_kutta(
    model: LogModel,
    tableau: Tableau,
    at: Rows,
    h: Array,
    force: ForceInStep,
    on_group: bool = False,
) -> tuple[Array, Array]:
    """Coordinates and speeds after a step h (N, 1) by an explicit method.

    The stages' rates of rotations are added as quaternions, or `on_group` as rotation vectors.
    """
    count = len(tableau.c)
    rates = np.empty((count, *(at.u if on_group else at.q).shape))
    slopes = np.empty((count, *at.u.shape))

    def moved(weights: Sequence[float]) -> tuple[Array, Array]:
        w, some = np.array(weights), len(weights)
        dq, du = ((w @ x[:some].reshape(some, -1)).reshape(x.shape[1:]) for x in (rates, slopes))
        return model.moved(at.q, dq, h) if on_group else at.q + h * dq, at.u + h * du

    for stage, (row, c) in enumerate(zip(tableau.a, tableau.c, strict=True)):
        q, u = moved(row) if stage else (at.q, at.u)
        t = at.t + c * h[:, 0]
        rates[stage] = u if on_group else model.rate(t, q, u)
        slopes[stage] = model.acceleration(t, q, u, force(c, stage))
    q, u = moved(tableau.b)
    for i, _ in model.quaternions:
        q[:, i : i + 4] /= np.linalg.norm(q[:, i : i + 4], axis=1, keepdims=True)
    return q, u


def repeated(
    at: Rows, counts: NDArray[np.intp], force: ForceBetween, step: Callable[..., Rows]
) -> Rows:
    """Rows after `counts` (N,) steps of each.

    `step` makes the k-th of those intervals, in an array or all, that have as many; it takes the rows, k, the
    intervals, their counts (N, 1), one number where all are alike, and the forces in them.
    """
    most, alike = int(counts.max()), not np.ptp(counts)
    for k in range(most):
        some = np.flatnonzero(counts > k)
        if len(some) == len(counts):
            at = step(at, k, slice(None), most if alike else counts[:, None], force)
        else:
            own = step(at.take(some), k, some, counts[some, None], restricted(force, some))
            at = at.replaced(some, own)
    return at


def _flow(
    model: LogModel,
    intervals: Intervals,
    force: ForceBetween,
    count: int,
    each: int,
    parts: NDArray[np.intp],
) -> list[Rows]:
    """States at `count` equal fractions of each interval, by `each` steps of order 8; the starts first.

    Steps are as many more as the parts (N,) of an interval need over which forces are held.
    """
    tableau = tableau_of("ode8")
    assert tableau is not None
    start, several = intervals.start, bool(parts.max() > 1)
    counts = each * parts // np.gcd(parts, count)
    h = intervals.h / (count * counts)[:, None]

    def step(
        at: Rows, k: int, some: slice | NDArray[np.intp], counts: int | Array, force: ForceBetween
    ) -> Rows:
        before, whole = (len(nodes) - 1) * counts + k, count * counts

        def within(c: float, _: int = 0) -> Array:
            return force((before + c) / whole, before / whole if several else None)

        q, u = runge_kutta(model, tableau, at, h[some], within)
        return Rows(at.t + h[some, 0], q, u, force((before + 1) / whole))

    nodes = [Rows(start.t, start.q, start.u, force(0.0))]
    for _ in range(count):
        nodes.append(repeated(nodes[-1], counts, force, step))
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


def composed(steps: list[Array]) -> Array:
    """Φ (N, 2n, 2n) over whole intervals, by `transitions`."""
    Phi = np.eye(steps[0].shape[1])
    for first, second in zip(steps[::2], steps[1::2], strict=True):
        Phi = second @ first @ Phi
    return Phi


def transported(h: Array, steps: list[Array], F: list[Array]) -> Array:
    """B = ∫Φ F dt (N, 2n, p) over intervals of length h (N, 1), by `transitions` and F at the nodes.

    By Simpson's rule over two steps each. F (N, 2n, p) or, where that of coordinates is zero, (N, n, p).
    """
    weight, rows = (h / len(steps) / 3.0)[:, :, None], F[0].shape[1]
    B: Array = np.ascontiguousarray(steps[0][:, :, -rows:]) @ (weight * F[0])
    for k, step in enumerate(steps[1:], 1):
        B[:, -rows:] += (4.0 if k % 2 else 2.0) * weight * F[k]
        B = step @ B
    B[:, -rows:] += weight * F[-1]
    return B
