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
from deltac.diagnosis.inference.model import LogModel, Rows

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

    def __init__(self, model: LogModel, at: Rows) -> None:
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

    def damping(self, u: Array) -> Array:
        """The change of the dampers' forces along u."""
        if not self.model.damped:
            return np.zeros_like(self.a)
        at, d = self.rows, _length(FIRST, u)
        ends = (self.model.damping(at.t, at.q, at.u + s * d * u, at.F) for s in (1.0, -1.0))
        return np.asarray((next(ends) - next(ends)) / (2.0 * d))

    def of_dampers(self, u: Array) -> Array:
        """What that does to the accelerations."""
        if not self.model.damped:
            return np.zeros_like(self.a)
        return self.model.response(self.rows.t, self.rows.q, self.damping(u))


def _length(size: float, *directions: Array | None) -> Array:
    largest = np.max([np.abs(v).max(axis=1) for v in directions if v is not None], axis=0)
    return np.asarray((size / np.maximum(largest, 1.0))[:, None])


def _stacked(columns: Sequence[tuple[Array, Array]]) -> Array:
    return np.stack([np.concatenate(pair, axis=1) for pair in columns], axis=2)


def _undamped(D: _Derivatives) -> list[tuple[Array, Array]]:
    """Fields of first order over h, without that of the dampers, which comes last."""
    zero = np.zeros_like(D.a)
    return [
        (D.a, zero), (zero, D.along(D.rows.u, None, in_time=True)), (zero, D.along(None, D.a)),
    ]  # fmt: skip


def elementary_differentials(model: LogModel, at: Rows, h: Array) -> Array:
    """F_i h^p_i (N, 2n, fields) at states, h (N, 1) the integrator's step."""
    D = _Derivatives(model, at)
    a, zero, da = D.a, np.zeros_like(D.a), D.of_dampers(D.a)
    first = [*_undamped(D), (zero, da)]
    aq_u, au_a = first[1][1], first[2][1]
    aqq, auu = D.twice(at.u, None), D.twice(None, a)
    mixed = 0.5 * (D.twice(at.u, a) - aqq - auu)
    second = [
        (zero, D.of_dampers(da)), (zero, D.of_dampers(aq_u)),
        (aq_u, zero), (au_a, zero), (zero, D.along(a, None)), (zero, D.along(None, aq_u)),
        (zero, D.along(None, au_a)), (zero, aqq), (zero, mixed), (zero, auu),
    ]  # fmt: skip
    size = h[:, :, None]
    return np.concatenate([_stacked(first) * size, _stacked(second) * size**2], axis=2)


def first_order_jacobian(model: LogModel, at: Rows, h: Array, c: Array) -> Array:
    """∂/∂x (N, 2n, 2n) of Σ c_i h F_i, of first order: what the integrator makes of errors of a row."""
    n, J = model.n, np.empty((len(at.t), 2 * model.n, 2 * model.n))

    def fields(rows: Rows) -> tuple[Array, Array]:
        """Of all but the dampers, and by how much the dampers' forces change."""
        D = _Derivatives(model, rows)
        return h * (_stacked(_undamped(D)) @ c[:-1]), c[-1] * h * D.damping(D.a)

    (here, force), forces = fields(at), list[Array]()
    still = model.response(at.t, at.q, force) if model.damped else force
    for k, (rows, d) in enumerate(zip(*model.neighbours(at, FIRST), strict=True)):
        moved, other = fields(rows)
        J[:, :, k] = (moved - here) / d
        if k < n and model.damped:
            J[:, n:, k] += (model.response(at.t, rows.q, other) - still) / d
        elif model.damped:
            forces.append((other - force) / d)
    if model.damped:  # along speeds the inertia is the same: it is solved once
        J[:, n:, n:] += model.response(at.t, at.q, np.stack(forces, axis=2))
    return J


def next_order(J: Array, fields: Array, t: Array, h: Array) -> Array:
    """Fields of third order in a basis of their own (N, 2n, 2k): J F and dF/dt of those of second order.

    What a series of two orders leaves is of this kind; with a prior of its usual size it is no evidence of
    anything else. `h` (N, 1).
    """
    second = fields[:, :, [k for k, f in enumerate(FIELDS) if f.order == 2]]
    rates = np.gradient(second, t, axis=0) if len(t) > 2 else np.zeros_like(second)
    return np.concatenate([J @ second, rates], axis=2) * h[:, :, None]


def taken_by_projections(model: LogModel, at: Rows, fields: Array) -> Array:
    """What an orthogonal projection onto the constraints takes of fields of first order (N, 2n, k).

    A projection with the masses as metric moves states along M⁻¹Gᵀ, which process noise covers. One by the
    pseudoinverse of G moves them along Gᵀ, and so along the motion as well.
    """
    n, first = model.n, fields[:, :, :FIRST_ORDER]
    G = model.matrices(at.t, at.q)[1]
    back = np.linalg.pinv(G)
    of_q = back @ (G @ first[:, :n])
    left, turned = first[:, :n] - of_q, np.zeros_like(of_q)
    for k in np.flatnonzero(left.any(axis=(0, 1))).tolist():
        d = _length(FIRST, left[:, :, k])
        moved = model.moved(at.q, left[:, :, k], d)
        turned[:, :, k] = (back @ ((model.matrices(at.t, moved)[1] - G) @ at.u[:, :, None]))[
            :, :, 0
        ] / d
    return np.concatenate([of_q, back @ (G @ first[:, n:]) + turned], axis=1)
