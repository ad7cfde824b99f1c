"""A mechanism body by body (in maximal coordinates): stacked velocities, forces and constraints, in symbols.

The rows of v, and of forces F, are for each body in the order of `Mechanism.bodies`: the velocity of the mass
centre (three, world components) and the angular velocity (three, body components). After these 6N rows comes
one for each speed of the mechanism: the *rotors*. A joint's armature a adds ½ a u² to the kinetic energy, so
a rotor is a one-dimensional body whose velocity is that speed and whose mass is a.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca

from deltac.dynamics.constraints import row_entries
from deltac.dynamics.forces import channels_on
from deltac.dynamics.points import PlacedPoint
from deltac.dynamics.recursions import link_velocities
from deltac.dynamics.scene import TracedScene
from deltac.dynamics.spatial import SX, cross
from deltac.dynamics.system import System, released
from deltac.mechanism.scope import GROUND


def _rows(system: System) -> dict[str, int]:
    """The first row of each body."""
    return {body.name: 6 * k for k, body in enumerate(system.mechanism.bodies)}


def stacked_velocities(system: System) -> SX:
    """V (n,) at the system's speeds."""
    velocities, scene = [], TracedScene(system)
    for body in system.mechanism.bodies:
        k = system.index[body.name]
        spin = ca.mtimes(system.links[k].to_body.E, link_velocities(system)[k][:3])
        velocities += [scene.mass_centre(body.name).velocity, spin]
    return ca.vertcat(*velocities, system.u_all)


@dataclass(frozen=True)
class BodyForces(TracedScene):
    """A scene on which forces are F (n,), at mass centres and as moments, in place of generalized forces."""

    def generalized(self, loads: Iterable[tuple[Any, ...]]) -> SX:
        """F of loads: (point, force) or (point, force, moment)."""
        system, rows = self.system, _rows(self.system)
        F = ca.SX.zeros(6 * len(rows) + len(system.mechanism.speeds))
        for point, force, *moment in loads:
            if point.link < 0:
                continue
            link, E = system.links[point.link], system.poses[point.link].E
            about = cross(point.own - link.centre, ca.mtimes(E, force))
            about += ca.mtimes(E, moment[0]) if moment else 0
            k = rows[link.joint.child]
            F[k : k + 3] += force
            F[k + 3 : k + 6] += ca.mtimes(link.to_body.E, about)
        return F

    def on_joint(self, joint: str, values: Any) -> SX:
        """F of a joint's generalized forces: equal and opposite on child and parent.

        Among the wrenches at the joint that do the same power this is the smallest in the joint's own
        directions; any other differs from it by an ideal reaction, which does no work.
        """
        tau = ca.vertcat(*values) if isinstance(values, list) else values
        k = next(k for k, link in enumerate(self.system.links) if link.joint.name == joint)
        S, E = self.system.links[k].S, self.system.poses[k].E
        wrench = ca.mtimes(S, ca.solve(ca.mtimes(S.T, S), tau))
        moment, force = ca.mtimes(E.T, wrench[:3]), ca.mtimes(E.T, wrench[3:])
        child = PlacedPoint(self.system, k, ca.SX.zeros(3))
        parent = PlacedPoint.at(self.system, self.system.links[k].parent, child.place)
        return self.generalized([(child, force, moment), (parent, -force, -moment)])

    def coordinate(self, name: str) -> tuple[SX, SX]:
        """A coordinate, and F of the unit generalized force along the speed that is its rate."""
        q, along = super().coordinate(name)
        joint = self.system.mechanism.coordinates[name].joint
        return q, self.on_joint(joint, along[self.system.mechanism.speeds.of(joint)])

    def power(self, force: SX) -> SX:
        """The power vᵀF, W."""
        return ca.dot(force, stacked_velocities(self.system))


@dataclass(frozen=True)
class _LoosePoint:
    place: SX
    velocity: SX


@dataclass(frozen=True)
class LooseBodies(TracedScene):
    """A scene in which nothing joins the bodies.

    They are displaced by small `x` (6N,) from where the joints hold them, and move with `v` (6N,); both have
    the layout of stacked velocities.
    """

    x: SX
    v: SX

    def _turned(self, body: str) -> tuple[int, SX, SX]:
        """First row of a body, its mass centre, and R from body to world components."""
        k = _rows(self.system)[body]
        centre = self.mass_centre(body).place + self.x[k : k + 3]
        turn = ca.SX.eye(3) + ca.skew(self.x[k + 3 : k + 6])  # to first order
        return k, centre, ca.mtimes(super().rotation(body), turn)

    def rotation(self, body: str) -> SX:
        """R of a body frame: body to world components."""
        return super().rotation(body) if body == GROUND else self._turned(body)[2]

    def place(self, body: str, point: Sequence[object]) -> SX:
        """World position of a point given in a body frame."""
        if body == GROUND:
            return self.vector(point)
        _, centre, R = self._turned(body)
        own = self.vector(point) - self.vector(self.system.mechanism.body(body).mass_centre)
        return centre + ca.mtimes(R, own)

    def angular_velocity(self, body: str) -> SX:
        """World components of a body's angular velocity."""
        if body == GROUND:
            return ca.SX.zeros(3)
        k, _, R = self._turned(body)
        return ca.mtimes(R, self.v[k + 3 : k + 6])

    def velocity(self, body: str, x: SX) -> SX:
        """World velocity of the body's material point that is at the world position `x`."""
        if body == GROUND:
            return ca.SX.zeros(3)
        k, centre, _ = self._turned(body)
        return self.v[k : k + 3] + cross(self.angular_velocity(body), x - centre)

    def point(self, body: str, point: Sequence[object]) -> Any:
        """A point given in the frame of a body."""
        place = self.place(body, point)
        return _LoosePoint(place, self.velocity(body, place))


@dataclass(frozen=True, eq=False)
class BodyRows:
    """All constraint rows on stacked velocities: ψ = `J` v + `c`, of (t, q); none is left out.

    `names` tell the constraint of each row, `holonomic` which have a position level. Laws of joint
    coordinates and speeds act in the columns of rotors.
    """

    names: tuple[str, ...]
    holonomic: tuple[bool, ...]
    J: SX
    c: SX


def body_rows(system: System) -> BodyRows:
    """The rows of the constraints, in the symbols of a `released` system."""
    x, v = (ca.SX.sym(name, 6 * len(system.mechanism.bodies)) for name in "xv")
    # Coordinates in laws have symbols of their own: where the bodies are does not depend on them here.
    q, u = (ca.SX.sym(name, column.shape[0]) for name, column in (("q", system.q), ("u", system.u)))
    own = {f"q.{e.name}": q[e.index] for e in system.mechanism.coordinates}
    own |= {f"u.{e.name}": u[e.index] for e in system.mechanism.speeds}
    separate = replace(system, q_all=q, u_all=u, values={**system.values, **own})
    scene = LooseBodies(separate, x, v)
    qdot = ca.substitute(system.qdot_all, system.u, u)
    along, pace = ca.vertcat(x, q, system.t), ca.vertcat(v, qdot, 1)
    entries = row_entries(scene, lambda phi: ca.jtimes(phi, along, pace))
    psi = ca.vertcat(ca.SX(0, 1), *(rate for _, _, _, rate in entries))
    speeds = ca.vertcat(v, u)
    at_state = [ca.vertcat(x, speeds, q)], [ca.vertcat(0 * x, 0 * speeds, system.q)]
    J, c = ca.substitute([ca.densify(ca.jacobian(psi, speeds)), psi], *at_state)
    names = tuple(name for name, *_ in entries)
    return BodyRows(names, tuple(of_place for _, of_place, _, _ in entries), J, c)


@dataclass(frozen=True, eq=False)
class Maximal:
    """A mechanism body by body, to be evaluated at (t, q, u, inputs), all joints in q and u.

    The outputs of `function` have these `names`, in order; world components. `x` (3, N) and `turned` (3, 3N):
    mass centres and orientations; `P` (n, nu) and `P_dot`: partial velocities of all speeds, and their rate;
    `F_V`, `F_D` (n,): active forces with and without a potential; `J` (m, n), `c` (m,), see `BodyRows`;
    `G_dot` (m, nu), `c_dot` (m,): rates of J P and of c; of each joint the `place` (3,) of its frame on the
    child, and its `directions` (6, nu): the relative velocity and angular velocity there.
    """

    rows: BodyRows
    names: tuple[str, ...]
    function: Any


def maximal(system: System) -> Maximal:
    """The mechanism of a traced system, body by body; written out once."""
    return system.once(Maximal, lambda: _written_out(released(system)))


def _written_out(s: System) -> Maximal:
    rows, bodies = body_rows(s), [body.name for body in s.mechanism.bodies]
    scene, forces = TracedScene(s), BodyForces(s)
    parts = channels_on(forces)
    along, rate = ca.vertcat(s.q, s.t), ca.vertcat(s.qdot_all, 1)

    def rate_of(matrix: SX) -> SX:
        return ca.reshape(ca.jtimes(ca.vec(ca.densify(matrix)), along, rate), matrix.shape)

    def total(chosen: bool) -> SX:
        zero = forces.generalized([])
        return sum((p.force for p in parts if (p.potential is not None) == chosen), start=zero)

    P = ca.jacobian(stacked_velocities(s), s.u)
    directions = [
        ca.mtimes(ca.diagcat(E.T, E.T), ca.vertcat(link.S[3:, :], link.S[:3, :]))
        for link, E in zip(s.links, (pose.E for pose in s.poses))
    ]
    outputs = {
        "x": ca.horzcat(*(scene.mass_centre(name).place for name in bodies)),
        "turned": ca.horzcat(*(scene.rotation(name) for name in bodies)),
        "P": P,
        "P_dot": rate_of(P),
        "F_V": total(True),
        "F_D": total(False),
        "J": rows.J,
        "c": rows.c,
        "G_dot": rate_of(ca.mtimes(rows.J, P)),
        "c_dot": rate_of(rows.c),
        "place": ca.horzcat(*(pose.r for pose in s.poses)),
        "directions": ca.horzcat(*directions),
    }
    columns = [ca.densify(column) for column in outputs.values()]
    f = ca.Function("maximal", [s.t, s.q, s.u, s.inputs], columns)
    return Maximal(rows, tuple(outputs), f)
