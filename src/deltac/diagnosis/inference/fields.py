"""What an integrator adds to the equations: elementary differentials of f, by order.

By backward error analysis a one-step method with step h follows, up to higher order, the exact flow of
ẋ = f + Σ c_i h^p_i F_i (Hairer, Lubich, Wanner, Geometric Numerical Integration, ch. IX). For q̇ = u,
u̇ = a(t, q, u) and methods that treat q and u differently these are the fields below; the numbers c_i tell
the method. Derivatives are central differences along directions of the state, on the group of rotations
where coordinates are quaternions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deltac.arrays import Array
from deltac.diagnosis.residuals.rows import Model, Rows

FIRST, SECOND = 1e-4, 1e-3
"""Lengths of differences, of states of unit size, for first and second derivatives: rounding and the next
order are both below 1e-6 of the field."""


@dataclass(frozen=True)
class Field:
    """An elementary differential: its name, and the power of the step that it comes with."""

    name: str
    order: int


FIELDS = (
    Field("q: a", 1), Field("u: a_q u", 1), Field("u: a_u a", 1),
    Field("u: damping a", 1),
    Field("u: damping damping a", 2), Field("u: damping a_q u", 2),
    Field("q: a_q u", 2), Field("q: a_u a", 2), Field("u: a_q a", 2), Field("u: a_u a_q u", 2),
    Field("u: a_u a_u a", 2), Field("u: a_qq u u", 2), Field("u: a_qu u a", 2), Field("u: a_uu a a", 2),
)  # fmt: skip
"""Those of first and second order. "damping" stands for methods that are implicit in the dampers alone."""

PRIOR = {1: 0.5, 2: 0.25, 3: 0.1}
"""Standard deviation of the numbers c of each order before the log is seen: one half, one quarter to one
sixth,
one twenty-fourth to one tenth are those of the methods in use."""


def elementary_differentials(model: Model, at: Rows, h: Array) -> Array:
    """F_i h^p_i (N, 2n, fields) at states, h (N, 1) the integrator's step.

    Logged forces stand still: a method of one stage that takes them at one end of its step is a force that is
    held, which is chosen for the log (`flow.FORCES`).
    """
    t, q, u, F = at.t, at.q, at.u, at.F
    a = model.at(at)
    zero = np.zeros_like(a)

    def moved(along_q: Array | None, along_u: Array | None, d: Array, time: bool = False) -> Array:
        there_q = q if along_q is None else model.moved(q, along_q, d)
        there_u = u if along_u is None else u + d * along_u
        return model.acceleration(t + d[:, 0] if time else t, there_q, there_u, F)

    def length(size: float, *directions: Array) -> Array:
        largest = np.max([np.abs(v).max(axis=1) for v in directions], axis=0)
        return np.asarray((size / np.maximum(largest, 1.0))[:, None])

    def along(along_q: Array | None, along_u: Array | None, time: bool = False) -> Array:
        d = length(FIRST, *(v for v in (along_q, along_u) if v is not None))
        return np.asarray(
            (moved(along_q, along_u, d, time) - moved(along_q, along_u, -d, time)) / (2.0 * d)
        )

    def twice(along_q: Array | None, along_u: Array | None) -> Array:
        d = length(SECOND, *(v for v in (along_q, along_u) if v is not None))
        return np.asarray(
            (moved(along_q, along_u, d) - 2.0 * a + moved(along_q, along_u, -d)) / d**2
        )

    aq_u, au_a = along(u, None, time=True), along(None, a)
    aqq, auu = twice(u, None), twice(None, a)
    mixed = 0.5 * (twice(u, a) - aqq - auu)

    def damped(along_u: Array) -> Array:
        if not model.damped:
            return zero
        d = length(FIRST, along_u)
        change = model.damping(t, q, u + d * along_u, F) - model.damping(t, q, u - d * along_u, F)
        return model.response(t, q, change / (2.0 * d))

    da = damped(a)
    columns = [
        (a, zero), (zero, aq_u), (zero, au_a), (zero, da),
        (zero, damped(da)), (zero, damped(aq_u)),
        (aq_u, zero), (au_a, zero), (zero, along(a, None)), (zero, along(None, aq_u)),
        (zero, along(None, au_a)), (zero, aqq), (zero, mixed), (zero, auu),
    ]  # fmt: skip
    made = np.stack([np.concatenate(pair, axis=1) for pair in columns], axis=2)
    return np.asarray(made * np.stack([h**f.order for f in FIELDS], axis=2))


def next_order(J: Array, fields: Array, t: Array, h: Array) -> Array:
    """Fields of third order in a basis of their own (N, 2n, 2k): J F and dF/dt of those of second order.

    What a series of two orders leaves is of this kind; with a prior of its usual size it is no evidence of
    anything else. `h` (N, 1).
    """
    second = fields[:, :, [k for k, f in enumerate(FIELDS) if f.order == 2]]
    rates = np.gradient(second, t, axis=0) if len(t) > 2 else np.zeros_like(second)
    return np.concatenate([J @ second, rates], axis=2) * h[:, :, None]
