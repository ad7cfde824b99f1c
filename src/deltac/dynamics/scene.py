"""The scene of a traced mechanism: where points of bodies are, how they move, and what forces there do.

It is what force elements state their laws on (`mechanism.scene` says what they may ask), and what
constraints are written on.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from deltac.dynamics.gaps import Gap, gaps, sliding_point
from deltac.dynamics.laws import to_casadi
from deltac.dynamics.points import PlacedPoint, rotation, wrenches
from deltac.dynamics.recursions import gather, link_velocities
from deltac.dynamics.spatial import SX, cross
from deltac.dynamics.system import System
from deltac.mechanism.joints import JOINT_KINDS
from deltac.mechanism.shapes import Shape


@dataclass(frozen=True)
class TracedScene:
    """Points, axes and velocities of bodies in the world, in the symbols of a system."""

    system: System

    sqrt = staticmethod(ca.sqrt)
    exp = staticmethod(ca.exp)
    tanh = staticmethod(ca.tanh)
    atan2 = staticmethod(ca.atan2)
    abs = staticmethod(ca.fabs)
    maximum = staticmethod(ca.fmax)
    minimum = staticmethod(ca.fmin)
    where = staticmethod(ca.if_else)
    dot = staticmethod(ca.dot)
    cross = staticmethod(cross)

    # --- laws

    def number(self, law: object) -> SX:
        """A law or quantity as a scalar."""
        return self.system.number(law)

    def vector(self, laws: Sequence[object], extra: dict[str, SX] | None = None) -> SX:
        """Laws of the system's symbols, and of further ones, as a column."""
        values = {**self.system.values, **(extra or {})}
        return ca.vertcat(*(to_casadi(law, values) for law in laws))

    def matrix(self, rows: Sequence[Sequence[float]]) -> SX:
        """A matrix of numbers."""
        return ca.SX(ca.DM([list(row) for row in rows]))

    def time_rate(self, law: object) -> SX:
        """∂/∂t of a law of time."""
        return ca.jacobian(self.system.number(law), self.system.t)

    def from_potential(self, joint: str, potential: object) -> tuple[SX, SX, SX]:
        """Of a law V(q, t) of a joint's coordinates: V, −∂V/∂q along the joint's speeds, ∂V/∂t."""
        system, mechanism = self.system, self.system.mechanism
        names = [f"q.{name}" for name in mechanism.joint(joint).coordinates]
        q = system.q_all[mechanism.coordinates.of(joint)]
        V, force, explicit = self._from_law(potential, names, q)
        W = next(link.W for link in system.links if link.joint.name == joint)
        return V, ca.mtimes(W.T, force), explicit

    def field(self, potential: object, place: SX) -> tuple[SX, SX, SX]:
        """Of a law V(x, y, z, t) at a place (3,): V, −∂V/∂(x, y, z), ∂V/∂t."""
        return self._from_law(potential, "xyz", place)

    def _from_law(self, potential: object, names: Sequence[str], x: SX) -> tuple[SX, SX, SX]:
        """Of a law V(x, t), the entries of x by `names`: V, −∂V/∂x, ∂V/∂t at `x`."""
        # Own symbols stand in for t and x, which may be laws of t themselves.
        t, own = ca.SX.sym("t"), ca.SX.sym("x", len(names))
        V = to_casadi(
            potential, {**self.system.values, "t": t, **dict(zip(names, ca.vertsplit(own)))}
        )
        V, slope, explicit = ca.substitute(
            [V, ca.jacobian(V, own).T, ca.jacobian(V, t)],
            [ca.vertcat(own, t)],
            [ca.vertcat(x, self.system.t)],
        )
        return V, -slope, explicit

    # --- joints

    def coordinates(self, joint: str) -> tuple[list[SX], SX | None]:
        """The plain coordinates of a joint, and its quaternion (4,; scalar first), if it has one."""
        q = self.system.q_all[self.system.mechanism.coordinates.of(joint)]
        start = JOINT_KINDS[self.system.mechanism.joint(joint).kind].quaternion
        plain = q.shape[0] if start is None else start
        return [q[k] for k in range(plain)], None if start is None else q[start:]

    def speeds(self, joint: str) -> SX:
        """The speeds of a joint."""
        return self.system.u_all[self.system.mechanism.speeds.of(joint)]

    def inputs(self, motor: str) -> SX:
        """The values that a controller or a log gives a motor."""
        return self.system.inputs[self.system.input_places[motor]]

    def coordinate(self, name: str) -> tuple[SX, SX]:
        """A coordinate, and the unit generalized force (nu,) along the speed that is its rate."""
        mechanism = self.system.mechanism
        entry = mechanism.coordinates[name]
        first = mechanism.coordinates.of(entry.joint).start
        along = ca.SX.zeros(self.system.u_all.shape[0])
        along[mechanism.speeds.of(entry.joint).start + entry.index - first] = 1
        return self.system.q_all[entry.index], along

    # --- bodies

    def rotation(self, body: str) -> SX:
        """R of a body frame: body to world components."""
        return rotation(self.system, body)

    def axis(self, body: str, axis: Sequence[float]) -> SX:
        """World components of a direction fixed in a body."""
        return ca.mtimes(self.rotation(body), ca.DM(list(axis)))

    def point(self, body: str, point: Sequence[object]) -> PlacedPoint:
        """A point given in the frame of a body."""
        return PlacedPoint(self.system, *self.system.point(body, point))

    def point_at(self, body: str, place: SX) -> PlacedPoint:
        """The body's material point that is at a place in the world now."""
        return PlacedPoint.at(self.system, self.system.index[body], place)

    def place(self, body: str, point: Sequence[object]) -> SX:
        """World position of a point given in a body frame."""
        return self.point(body, point).place

    def mass_centre(self, body: str) -> PlacedPoint:
        """The mass centre of a body."""
        k = self.system.index[body]
        return PlacedPoint(self.system, k, self.system.links[k].centre)

    def weight(self, body: str) -> SX:
        """The weight (3,) of a body, N."""
        return self.system.links[self.system.index[body]].mass * self.system.gravity

    def local(self, body: str, x: SX) -> SX:
        """Coordinates in a body frame of a world position."""
        return ca.mtimes(self.rotation(body).T, x - self.place(body, (0.0, 0.0, 0.0)))

    def angular_velocity(self, body: str) -> SX:
        """World components of a body's angular velocity."""
        k = self.system.index[body]
        if k < 0:
            return ca.SX.zeros(3)
        return ca.mtimes(self.system.poses[k].E.T, link_velocities(self.system)[k][:3])

    def velocity(self, body: str, x: SX) -> SX:
        """World velocity of the body's material point that is at the world position `x`."""
        k = self.system.index[body]
        if k < 0:
            return ca.SX.zeros(3)
        E, o = self.system.poses[k].E, self.system.poses[k].r
        V = link_velocities(self.system)[k]
        w, v = ca.mtimes(E.T, V[:3]), ca.mtimes(E.T, V[3:])
        return v + cross(w, x - o)

    def touches(self, first: Shape, second: Shape) -> tuple[Gap, ...]:
        """The contact points of two shapes."""
        return gaps(self.system, first, second)

    def sliding(
        self, body: str, point: Sequence[Any], on: str, normal: tuple[float, float, float]
    ) -> Gap:
        """Where a point of a body slides on a plane of another, of whose frame the normal is."""
        return sliding_point(self.system, body, point, on, normal)

    # --- forces

    def on_joint(self, joint: str, values: Any) -> SX:
        """The generalized force (nu,) of values (a column or a list) on the speeds of a joint."""
        force = ca.SX.zeros(self.system.u_all.shape[0])
        column = ca.vertcat(*values) if isinstance(values, list) else values
        force[self.system.mechanism.speeds.of(joint)] = column
        return force

    def generalized(self, loads: Iterable[tuple[Any, ...]]) -> SX:
        """The generalized force (nu,) of loads: (point, force) or (point, force, moment)."""
        return gather(self.system, wrenches(loads))

    def power(self, force: SX) -> SX:
        """The power of a generalized force, W."""
        return ca.dot(force, self.system.u_all)
