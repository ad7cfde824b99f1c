"""What an integrator adds to the equations: elementary differentials of f, by order.

By backward error analysis a one-step method with step h follows, up to higher order, the exact flow of
ẋ = f + Σ c_i h^p_i F_i (Hairer, Lubich, Wanner, Geometric Numerical Integration, ch. IX). For q̇ = u,
u̇ = a(t, q, u) and methods that treat q and u differently these are the fields below; the numbers c_i tell
the method. Derivatives are central differences along directions of the state, on the group of rotations
where coordinates are quaternions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deltac.arrays import Array
from deltac.diagnosis.inference.model import Model, Rows

FIRST, SECOND = 1e-4, 1e-3
"""Lengths of differences, of states of unit size, for first and second derivatives: rounding and the next
order are both below 1e-6 of the field."""


@dataclass(frozen=True)
class Field:
    """An elementary differential: its name, and the power of the step that it comes with."""

    name: str
    order: int


FIRST_ORDER = 4
"""How many of the fields are of first order; they come first."""

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


class _Derivatives:
    """Derivatives of the accelerations along directions of the state, by central differences at rows.

    Logged forces stand still: a method of one stage that takes them at one end of its step is a force that is
    held, which is chosen for the log (`flow.FORCES`).
    """

    def __init__(self, model: Model, at: Rows) -> None:
        self.model, self.rows = model, at
        self.a = model.at(at)

    def _ends(
        self, q: Array | None, u: Array | None, d: Array, in_time: bool = False
    ) -> list[Array]:
        """At the states a length d (N, 1) ahead along (q, u), and as far behind."""
        at = self.rows
        return self.model.at_each(
            [
                Rows(
                    at.t + s[:, 0] if in_time else at.t,
                    at.q if q is None else self.model.moved(at.q, q, s),
                    at.u if u is None else at.u + s * u,
                    at.F,
                )
                for s in (d, -d)
            ]
        )

    def along(self, q: Array | None, u: Array | None, in_time: bool = False) -> Array:
        """First derivative along (q, u)."""
        d = _length(FIRST, q, u)
        ahead, behind = self._ends(q, u, d, in_time)
        return np.asarray((ahead - behind) / (2.0 * d))

    def twice(self, q: Array | None, u: Array | None) -> Array:
        """Second derivative along (q, u)."""
        d = _length(SECOND, q, u)
        ahead, behind = self._ends(q, u, d)
        return np.asarray((ahead + behind - 2.0 * self.a) / d**2)

    def of_dampers(self, u: Array) -> Array:
        """What the change of the dampers' forces along u does to the accelerations."""
        at, model = self.rows, self.model
        if not model.damped:
            return np.zeros_like(self.a)
        d = _length(FIRST, u)
        ends = (model.damping(at.t, at.q, at.u + s * d * u, at.F) for s in (1.0, -1.0))
        return model.response(at.t, at.q, (next(ends) - next(ends)) / (2.0 * d))


def _length(size: float, *directions: Array | None) -> Array:
    largest = np.max([np.abs(v).max(axis=1) for v in directions if v is not None], axis=0)
    return np.asarray((size / np.maximum(largest, 1.0))[:, None])


def _stacked(columns: Sequence[tuple[Array, Array]]) -> Array:
    return np.stack([np.concatenate(pair, axis=1) for pair in columns], axis=2)


def _first_order(model: Model, at: Rows, h: Array) -> Array:
    D = _Derivatives(model, at)
    zero = np.zeros_like(D.a)
    columns = [
        (D.a, zero), (zero, D.along(at.u, None, in_time=True)), (zero, D.along(None, D.a)),
        (zero, D.of_dampers(D.a)),
    ]  # fmt: skip
    return np.asarray(_stacked(columns) * h[:, :, None])


def elementary_differentials(model: Model, at: Rows, h: Array) -> Array:
    """F_i h^p_i (N, 2n, fields) at states, h (N, 1) the integrator's step."""
    D, first = _Derivatives(model, at), _first_order(model, at, h)
    n, a, zero = model.n, D.a, np.zeros_like(D.a)
    aq_u, au_a, da = (first[:, n:, k] / h for k in (1, 2, 3))
    aqq, auu = D.twice(at.u, None), D.twice(None, a)
    mixed = 0.5 * (D.twice(at.u, a) - aqq - auu)
    second = [
        (zero, D.of_dampers(da)), (zero, D.of_dampers(aq_u)),
        (aq_u, zero), (au_a, zero), (zero, D.along(a, None)), (zero, D.along(None, aq_u)),
        (zero, D.along(None, au_a)), (zero, aqq), (zero, mixed), (zero, auu),
    ]  # fmt: skip
    return np.concatenate([first, _stacked(second) * h[:, :, None] ** 2], axis=2)


def first_order_jacobian(model: Model, at: Rows, h: Array, c: Array) -> Array:
    """∂/∂x (N, 2n, 2n) of Σ c_i h F_i, of first order: what the integrator makes of errors of a row."""
    n = model.n

    def total(q: Array, u: Array) -> Array:
        moved = Rows(at.t, q, u, at.F)
        return np.asarray(_first_order(model, moved, h) @ c)

    here, columns = total(at.q, at.u), []
    for k in range(2 * n):
        e = np.zeros((1, n))
        e[0, k % n] = 1.0
        d = FIRST * (
            1.0 + (0.0 if k < n else float(np.nanmax(np.abs(at.u[:, k - n]), initial=0.0)))
        )
        along = np.broadcast_to(e, at.u.shape)
        q = model.moved(at.q, along, np.full((len(at.t), 1), d)) if k < n else at.q
        columns.append((total(q, at.u if k < n else at.u + d * e) - here) / d)
    return np.stack(columns, axis=2)


def next_order(J: Array, fields: Array, t: Array, h: Array) -> Array:
    """Fields of third order in a basis of their own (N, 2n, 2k): J F and dF/dt of those of second order.

    What a series of two orders leaves is of this kind; with a prior of its usual size it is no evidence of
    anything else. `h` (N, 1).
    """
    second = fields[:, :, [k for k, f in enumerate(FIELDS) if f.order == 2]]
    rates = np.gradient(second, t, axis=0) if len(t) > 2 else np.zeros_like(second)
    return np.concatenate([J @ second, rates], axis=2) * h[:, :, None]
