"""Constraints in symbols: positions, velocities, Jacobians, and what depends on time alone.

A holonomic row is φ(q, t) = 0; every row has ψ(q, u, t) = G u + b = 0 at velocity level (φ̇ = ψ), where
u holds all speeds, those of prescribed joints too, and b is what is left without any motion:
f_t of the theory for a configuration constraint, b for a motion constraint. Rows are written on the
released system (symbols for prescribed joints) and their derivatives are exact.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from deltac.dynamics.scene import Scene
from deltac.dynamics.spatial import SX, cross
from deltac.dynamics.system import System, released
from deltac.mechanism.constraints import (
    Angle,
    Constraint,
    Distance,
    Holonomic,
    Loop,
    MotionConstraint,
    PointOn,
    Rolling,
    Skate,
    perpendiculars,
)
from deltac.mechanism.quantities import is_zero


@dataclass(frozen=True)
class Rows:
    """All rows of a mechanism's constraints, in the symbols of its system.

    `names` (nc) tell the constraint of each row, `holonomic` which have a position level. `phi` (nc,) is
    φ, zero where there is none; `psi` (nc,) is ψ; `G_all` (nc by nu) and `G` (nc by free speeds) its
    Jacobians; `b` (nc,) its explicit part; `gamma` (nc,) is ψ̇ at u̇ = 0 of the free speeds, so that
    ψ̇ = G u̇ + γ.
    """

    names: tuple[str, ...]
    holonomic: tuple[bool, ...]
    phi: SX
    psi: SX
    G_all: SX
    G: SX
    b: SX
    gamma: SX

    def __len__(self) -> int:
        return len(self.names)

    def select(self, rows: Sequence[int]) -> Rows:
        """Some of the rows."""
        k = list(rows)
        return Rows(
            tuple(self.names[i] for i in k),
            tuple(self.holonomic[i] for i in k),
            self.phi[k],
            self.psi[k],
            self.G_all[k, :],
            self.G[k, :],
            self.b[k],
            self.gamma[k],
        )

    def places(self, name: str) -> list[int]:
        """The rows of a constraint."""
        return [k for k, owner in enumerate(self.names) if owner == name]


def constraint_rows(system: System) -> Rows:
    """Write out all constraints. Rows that vanish identically (out of a planar loop's plane) are left out."""
    if not system.mechanism.constraints:
        none, free = ca.SX(0, 1), len(system.free_u)
        return Rows((), (), none, none, ca.SX(0, system.u_all.shape[0]), ca.SX(0, free), none, none)
    twin = released(system)
    names: list[str] = []
    holonomic: list[bool] = []
    positions: list[SX] = []
    rates: list[SX] = []
    scene = Scene(twin)
    for constraint in system.mechanism.constraints:
        for phi in _POSITIONS[type(constraint)](scene, constraint):
            names.append(constraint.name)
            holonomic.append(True)
            positions.append(phi)
            rates.append(_rate(twin, phi))
        for psi in _MOTIONS.get(type(constraint), _none)(scene, constraint):
            names.append(constraint.name)
            holonomic.append(False)
            positions.append(ca.SX(0))
            rates.append(psi)
    phi, psi = ca.vertcat(ca.SX(0, 1), *positions), ca.vertcat(ca.SX(0, 1), *rates)
    G_all = ca.jacobian(psi, twin.u_all)
    b = ca.substitute(psi, twin.u_all, ca.SX.zeros(twin.u_all.shape[0]))
    # The symbols of the released system give way to the system's own.
    phi, psi, G_all, b = ca.substitute(
        [phi, psi, G_all, b], [twin.q_all, twin.u_all], [system.q_all, system.u_all]
    )
    along = ca.vertcat(system.q, system.t)
    gamma = ca.jtimes(psi, along, ca.vertcat(system.qdot, 1))
    G = ca.simplify(G_all[:, system.free_u])
    rows = Rows(tuple(names), tuple(holonomic), phi, psi, G_all, G, b, gamma)
    present = [
        k for k in range(len(names)) if ca.sparsify(G_all[k, :]).nnz() or not _vanishes(rows, k)
    ]
    return rows if len(present) == len(names) else rows.select(present)


def _vanishes(rows: Rows, k: int) -> bool:
    """Whether a row without motion holds by itself: constants at rounding level."""
    values = ca.vertcat(rows.phi[k], rows.b[k])
    return bool(values.is_constant()) and float(ca.norm_inf(ca.DM(values))) < 1e-9


def _rate(system: System, phi: SX) -> SX:
    """φ̇ of the released system: it moves with q̇ = W u, and explicitly with t."""
    along = ca.vertcat(system.q_all, system.t)
    return ca.jtimes(phi, along, ca.vertcat(system.qdot_all, 1))


NO_SINE = 1e-280
"""Keeps the slope of a sine finite (zero) where axes are parallel, where it has no direction."""


def _entries(column: SX) -> list[SX]:
    return [column[k] for k in range(column.shape[0])]


def _none(scene: Scene, constraint: Constraint) -> list[SX]:
    return []


def _loop(scene: Scene, c: Loop) -> list[SX]:
    gap = scene.place(c.body2, c.point2) - scene.place(c.body1, c.point1)
    first = scene.rotation(c.body1)
    local = ca.mtimes(first.T, gap)
    parallel = [ca.DM(list(n)) for n in perpendiculars(c.axis1)]
    if c.kind == "prismatic":
        return [*(ca.dot(n, local) for n in parallel), *_turned(scene, c, first)]
    # World components: a planar loop then has rows that vanish by themselves, which are left out.
    rows = _entries(gap)
    if c.kind == "weld":
        rows += _turned(scene, c, first)
    if c.kind == "revolute":
        axis2 = ca.mtimes(first.T, scene.axis(c.body2, c.axis2))
        rows += [ca.dot(n, axis2) for n in parallel]
    if c.kind == "universal":
        rows.append(ca.dot(scene.axis(c.body1, c.axis1), scene.axis(c.body2, c.axis2)))
    return rows


def _turned(scene: Scene, c: Loop, first: SX) -> list[SX]:
    """Three rows that keep the relative rotation: the skew part of R1ᵀ R2 R0ᵀ."""
    wanted = ca.DM([list(row) for row in c.rotation])
    R = ca.mtimes(ca.mtimes(first.T, scene.rotation(c.body2)), wanted.T)
    return [0.5 * (R[2, 1] - R[1, 2]), 0.5 * (R[0, 2] - R[2, 0]), 0.5 * (R[1, 0] - R[0, 1])]


def _distance(scene: Scene, c: Distance) -> list[SX]:
    """(d·d − l²)/2l: smooth, and a length near the constraint."""
    gap = scene.place(c.body2, c.point2) - scene.place(c.body1, c.point1)
    length = scene.vector((c.length,))
    return [(ca.dot(gap, gap) - length**2) / (2 * length)]


def _point_on(scene: Scene, c: PointOn) -> list[SX]:
    x = scene.local(c.on, scene.place(c.body, c.point))
    return _entries(scene.vector(c.equations, {"x": x[0], "y": x[1], "z": x[2]}))


def _angle(scene: Scene, c: Angle) -> list[SX]:
    """α − angle in rad, α by the sine and cosine: the cosine alone loses it, and its slope, towards 0 and π.

    The row then has the size of a turn whatever the angle, and its multiplier is a moment.
    """
    first, second = scene.axis(c.body1, c.axis1), scene.axis(c.body2, c.axis2)
    normal = cross(first, second)
    sine = ca.sqrt(ca.dot(normal, normal) + NO_SINE)
    return [ca.atan2(sine, ca.dot(first, second)) - scene.vector((c.angle,))]


def _holonomic(scene: Scene, c: Holonomic) -> list[SX]:
    return [scene.vector((c.law,))]


def _motion(scene: Scene, c: MotionConstraint) -> list[SX]:
    return [scene.vector((c.law,))]


@dataclass(frozen=True)
class _Contact:
    """Contact of a wheel with its plane, world components: height above it, point, normal, tangents."""

    height: SX
    point: SX
    tangents: tuple[SX, SX]


def _contact(scene: Scene, c: Rolling) -> _Contact:
    n = scene.axis(c.on, c.normal)
    centre = scene.place(c.body, c.centre)
    radius, tube = _entries(scene.vector((c.radius, c.tube)))
    above = ca.dot(centre - scene.place(c.on, c.point), n)
    point = centre - tube * n
    height = above - tube
    if not is_zero(c.radius):
        a = scene.axis(c.body, c.axis)
        lean = ca.dot(n, a)
        sine = ca.sqrt(1 - lean**2)
        point = point - radius * (n - lean * a) / sine
        height = height - radius * sine
    first, second = perpendiculars(c.normal)
    return _Contact(height, point, (scene.axis(c.on, first), scene.axis(c.on, second)))


def contact_point(scene: Scene, c: Rolling) -> SX:
    """Where a wheel touches its plane, world components."""
    return _contact(scene, c).point


def _rolling_position(scene: Scene, c: Rolling) -> list[SX]:
    return [_contact(scene, c).height]


def _rolling_motion(scene: Scene, c: Rolling) -> list[SX]:
    contact = _contact(scene, c)
    x = scene.local(c.on, contact.point)
    surface = scene.vector(c.surface_velocity, {"x": x[0], "y": x[1], "z": x[2]})
    slip = scene.velocity(c.body, contact.point) - scene.velocity(c.on, contact.point)
    slip = slip - ca.mtimes(scene.rotation(c.on), surface)
    return [ca.dot(tangent, slip) for tangent in contact.tangents]


def _skate(scene: Scene, c: Skate) -> list[SX]:
    x = scene.place(c.body, c.point)
    slip = scene.velocity(c.body, x) - scene.velocity(c.on, x)
    return [ca.dot(scene.axis(c.body, c.lateral), slip) - scene.vector((c.drift,))]


_POSITIONS: dict[type, Callable[[Scene, Any], list[SX]]] = {
    Loop: _loop,
    Distance: _distance,
    PointOn: _point_on,
    Angle: _angle,
    Holonomic: _holonomic,
    MotionConstraint: _none,
    Rolling: _rolling_position,
    Skate: _none,
}
"""Position rows φ of every kind of constraint."""

_MOTIONS: dict[type, Callable[[Scene, Any], list[SX]]] = {
    MotionConstraint: _motion,
    Rolling: _rolling_motion,
    Skate: _skate,
}
"""Motion rows ψ of the kinds that have them."""
