"""Force elements in symbols: the generalized force, potential and power of every channel."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

from deltac.dynamics import contact
from deltac.dynamics.channel import Channel as Channel
from deltac.dynamics.laws import to_casadi
from deltac.dynamics.recursions import gather
from deltac.dynamics.spatial import SX, cross
from deltac.dynamics.system import System
from deltac.mechanism.channels import ChannelName
from deltac.mechanism.contact import Contact
from deltac.mechanism.forces import (
    GravityCompensation,
    JointDamper,
    JointSpring,
    JointTorque,
    PointForce,
    SpringDamper,
    Tendon,
)
from deltac.mechanism.friction import JointFriction, PointFriction
from deltac.mechanism.joints import KINDS


def channels(system: System) -> tuple[Channel, ...]:
    """All channels of the mechanism's forces: gravity first, then the elements in their order.

    The driving forces of prescribed joints are not among them: they follow from the motion.
    """
    found: list[Channel] = []
    # An expression may be zero only by the present values of parameters that vary.
    if any(g != 0.0 for g in system.mechanism.gravity):
        found.append(_gravity(system))
    for element in system.mechanism.elements:
        found.extend(_ELEMENTS[type(element)](system, element))
    return tuple(found)


def total_force(system: System, parts: tuple[Channel, ...]) -> SX:
    """Sum of the generalized forces of channels (nu,)."""
    return sum((part.force for part in parts), start=ca.SX.zeros(len(system.mechanism.speeds)))


def _gravity(system: System) -> Channel:
    """V = −Σ m g·x_G; the force m g acts at each mass centre."""
    wrenches: dict[int, SX] = {}
    potential = ca.SX(0)
    for k, (link, pose) in enumerate(zip(system.links, system.poses)):
        if system.mechanism.body(link.joint.child).massless:
            continue
        weight = link.mass * ca.mtimes(pose.E, system.gravity)
        wrenches[k] = ca.vertcat(cross(link.centre, weight), weight)
        centre = pose.r + ca.mtimes(pose.E.T, link.centre)
        potential -= link.mass * ca.dot(system.gravity, centre)
    return Channel(ChannelName("gravity"), gather(system, wrenches), potential)


def _joint_places(system: System, name: str) -> tuple[slice, slice, Any]:
    joint = system.mechanism.joint(name)
    return (
        system.mechanism.coordinates.of(name),
        system.mechanism.speeds.of(name),
        KINDS[joint.kind],
    )


def _joint_spring(system: System, element: JointSpring) -> list[Channel]:
    where_q, where_u, kind = _joint_places(system, element.joint)
    q = system.q_all[where_q]
    force = ca.SX.zeros(len(system.mechanism.speeds))
    own = ca.SX.sym("q", q.shape[0])
    t = ca.SX.sym("t")
    if element.potential is not None:
        # Own symbols stand in for the joint's coordinates, which may be laws of t themselves.
        names = [f"q.{c}" for c in system.mechanism.joint(element.joint).coordinates]
        values = {**system.values, "t": t, **{n: own[k] for k, n in enumerate(names)}}
        potential = to_casadi(element.potential, values)
        W = _link_of(system, element.joint).W
        slope = ca.jacobian(potential, own)
        along = -ca.mtimes(W.T, ca.substitute(slope.T, ca.vertcat(own, t), ca.vertcat(q, system.t)))
    else:
        values = {**system.values, "t": t}
        k = [to_casadi(law, values) for law in element.stiffness]
        rest = [to_casadi(law, values) for law in element.rest]
        potential, along_own = _linear_spring(kind, own, k, rest)
        along = ca.substitute(along_own, ca.vertcat(own, t), ca.vertcat(q, system.t))
    explicit = ca.jacobian(potential, t)
    force[where_u] = along
    both = [potential, explicit]
    potential, explicit = ca.substitute(both, [ca.vertcat(own, t)], [ca.vertcat(q, system.t)])
    return _potential_channels("spring", element.name, force, potential, explicit)


def _linear_spring(kind: Any, q: SX, k: list[SX], rest: list[SX]) -> tuple[SX, SX]:
    """Potential, and generalized force on the joint's speeds, of linear springs."""
    plain = q.shape[0] if kind.quaternion is None else kind.quaternion
    stretch = [q[i] - rest[i] for i in range(plain)]
    potential = sum((0.5 * k[i] * stretch[i] ** 2 for i in range(plain)), start=ca.SX(0))
    force = [-k[i] * stretch[i] for i in range(plain)]
    if kind.quaternion is not None:
        # Rotation vector φ n by the half angle; of q and −q the shorter turn is meant.
        w, v = q[plain], q[plain + 1 :]
        sine = ca.sqrt(ca.dot(v, v))
        turn = 2 * ca.atan2(sine, ca.fabs(w))
        turned = sine > 1e-12 * ca.fabs(w)
        per_sine = ca.if_else(turned, turn / ca.if_else(turned, sine, 1), 2 / ca.fabs(w))
        potential += 0.5 * k[plain] * turn**2
        force.append(-k[plain] * per_sine * ca.if_else(w < 0, -1, 1) * v)
    return potential, ca.vertcat(*force)


def _joint_damper(system: System, element: JointDamper) -> list[Channel]:
    _, where, _ = _joint_places(system, element.joint)
    force = ca.SX.zeros(len(system.mechanism.speeds))
    force[where] = -system.vector(element.damping) * system.u_all[where]
    return [Channel(ChannelName("damper", element.name), force)]


def _joint_torque(system: System, element: JointTorque) -> list[Channel]:
    _, where, _ = _joint_places(system, element.joint)
    force = ca.SX.zeros(len(system.mechanism.speeds))
    if element.torque is None:
        force[where] = system.inputs[system.input_places[element.name]]
    else:
        force[where] = system.vector(element.torque)
    return [Channel(ChannelName("actuator", element.name), force, logged=element.torque is None)]


def _point_force(system: System, element: PointForce) -> list[Channel]:
    k, point = system.point(element.body, element.point)
    force, moment = system.vector(element.force), system.vector(element.moment)
    E = system.poses[k].E if element.frame == "world" else system.links[k].to_body.E.T
    f = ca.mtimes(E, force)
    n = ca.mtimes(E, moment) + cross(point, f)
    generalized = gather(system, {k: ca.vertcat(n, f)})
    return [Channel(ChannelName("applied", element.name), generalized)]


def _spring_damper(system: System, element: SpringDamper) -> list[Channel]:
    ends = [
        system.point(element.body1, element.point1),
        system.point(element.body2, element.point2),
    ]
    world = [p if k < 0 else system.poses[k].r + ca.mtimes(system.poses[k].E.T, p) for k, p in ends]
    between = world[1] - world[0]
    t = ca.SX.sym("t")
    values = {**system.values, "t": t}
    k, c = to_casadi(element.stiffness, values), system.number(element.damping)
    rest = to_casadi(element.length, values)
    made: list[Channel] = []
    # Without a rest length the force is −k times the vector: smooth through coincident points.
    centred = isinstance(element.length, float) and element.length == 0.0
    distance = ca.SX.sym("d")
    if centred:
        length, direction = None, between
        potential = 0.5 * k * ca.dot(between, between)
        tension = k
    else:
        length = ca.sqrt(ca.dot(between, between))
        direction = between / length
        potential = 0.5 * k * (distance - rest) ** 2
        tension = k * (distance - rest)
    explicit = ca.jacobian(potential, t)
    old, new = [t], [system.t]
    if length is not None:
        old, new = [t, distance], [system.t, length]
    potential, explicit, tension = ca.substitute([potential, explicit, tension], old, new)
    if not _is_zero(element.stiffness):
        force = _pull(system, ends, tension * direction)
        made.extend(_potential_channels("spring", element.name, force, potential, explicit))
    if not _is_zero(element.damping):
        unit = between / ca.sqrt(ca.dot(between, between))
        closing = ca.dot(unit, _velocity(system, *ends[1]) - _velocity(system, *ends[0]))
        made.append(
            Channel(ChannelName("damper", element.name), _pull(system, ends, c * closing * unit))
        )
    return made


def _tendon(system: System, element: Tendon) -> list[Channel]:
    length, J = _tendon_length(system, element)
    low, high = (system.number(end) for end in element.length)
    stretch = length - low
    if element.length[0] != element.length[1]:
        stretch = ca.fmax(length - high, 0) + ca.fmin(stretch, 0)
    made: list[Channel] = []
    if not all(_is_zero(a) for a in element.stiffness):
        a = [system.number(law) for law in element.stiffness]
        potential = sum(
            (a[k] * stretch ** (k + 2) / (k + 2) for k in range(len(a))), start=ca.SX(0)
        )
        tension = sum((a[k] * stretch ** (k + 1) for k in range(len(a))), start=ca.SX(0))
        made.append(Channel(ChannelName("spring", element.name), -tension * J, potential))
    if not all(_is_zero(a) for a in element.damping):
        rate = ca.dot(J, system.u_all)
        a = [system.number(law) for law in element.damping]
        # Even powers with the sign of the rate: v |v|.
        powers = [rate ** (k + 1) if k % 2 == 0 else rate**k * ca.fabs(rate) for k in range(len(a))]
        tension = sum((c * power for c, power in zip(a, powers)), start=ca.SX(0))
        made.append(Channel(ChannelName("damper", element.name), -tension * J))
    return made


def _tendon_length(system: System, element: Tendon) -> tuple[SX, SX]:
    """Length of a tendon and its gradient J (nu,) along the speeds: l̇ = J·u."""
    length, J = ca.SX(0), ca.SX.zeros(len(system.mechanism.speeds))
    for name, factor in element.coordinates:
        coordinate = system.mechanism.coordinates[name]
        first = system.mechanism.coordinates.of(coordinate.joint).start
        place = system.mechanism.speeds.of(coordinate.joint).start + coordinate.index - first
        length += system.number(factor) * system.q_all[coordinate.index]
        J[place] += system.number(factor)
    for branch in element.branches:
        factor = system.number(branch.factor)
        ends = [system.point(body, point) for body, point in branch.points]
        world = [
            p if k < 0 else system.poses[k].r + ca.mtimes(system.poses[k].E.T, p) for k, p in ends
        ]
        for i in range(len(ends) - 1):
            between = world[i + 1] - world[i]
            distance = ca.sqrt(ca.dot(between, between))
            length += factor * distance
            if ends[i][0] != ends[i + 1][0]:  # within one body nothing changes
                J -= _pull(system, ends[i : i + 2], factor * between / distance)
    return length, J


def _gravity_compensation(system: System, element: GravityCompensation) -> list[Channel]:
    wrenches: dict[int, SX] = {}
    for name, fraction in element.fractions:
        k = system.index[name]
        link = system.links[k]
        lift = -system.number(fraction) * link.mass * ca.mtimes(system.poses[k].E, system.gravity)
        wrenches[k] = ca.vertcat(cross(link.centre, lift), lift)
    return [Channel(ChannelName("applied", element.name), gather(system, wrenches))]


def _pull(system: System, ends: list[tuple[int, SX]], tension: SX) -> SX:
    """Generalized force of `tension` (world components) on the first point, its opposite on the second."""
    result = ca.SX.zeros(len(system.mechanism.speeds))
    for sign, (k, point) in zip((1, -1), ends):
        if k >= 0:
            f = sign * ca.mtimes(system.poses[k].E, tension)
            result += gather(system, {k: ca.vertcat(cross(point, f), f)})
    return result


def _velocity(system: System, k: int, point: SX) -> SX:
    """World velocity of a point given in a link frame."""
    if k < 0:
        return ca.SX.zeros(3)
    V = ca.SX.zeros(6)
    chain = []
    while k >= 0:
        chain.append(k)
        k = system.links[k].parent
    for place in reversed(chain):
        link = system.links[place]
        V = ca.mtimes(link.S, system.u_all[link.u, :]) + (link.X @ V)
    return ca.mtimes(system.poses[chain[0]].E.T, V[3:] + cross(V[:3], point))


def _potential_channels(
    kind: str, name: str, force: SX, potential: SX, explicit: SX
) -> list[Channel]:
    made = [Channel(ChannelName(kind, name), force, potential)]
    if not ca.SX(explicit).is_zero():
        nothing = ca.SX.zeros(force.shape[0])
        made.append(Channel(ChannelName("prescribed", name), nothing, explicit=explicit))
    return made


def _is_zero(law: object) -> bool:
    return isinstance(law, float) and law == 0.0


def _link_of(system: System, joint: str) -> Any:
    return next(link for link in system.links if link.joint.name == joint)


_ELEMENTS: dict[type, Callable[[System, Any], list[Channel]]] = {
    JointSpring: _joint_spring,
    JointDamper: _joint_damper,
    JointTorque: _joint_torque,
    PointForce: _point_force,
    SpringDamper: _spring_damper,
    Tendon: _tendon,
    GravityCompensation: _gravity_compensation,
    JointFriction: contact.joint_friction,
    PointFriction: contact.point_friction,
    Contact: contact.contact,
}
