"""Forces of the textbook: every channel as forces at mass centres and moments on bodies, in plain NumPy.

A force element is a set of forces at points of bodies and of moments, in the world; each is moved to the
mass centre (F; M = d × F), as Kane does before dotting it with partial velocities.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from deltac.errors import ModelError
from deltac.mechanism.contact import Contact
from deltac.mechanism.forces import (
    ForceField,
    GravityCompensation,
    JointDamper,
    JointSpring,
    JointTorque,
    PointForce,
    SpringDamper,
    Tendon,
)
from deltac.mechanism.friction import JointFriction, PointFriction
from deltac.mechanism.joints import JOINT_KINDS
from deltac.mechanism.laws import evaluate, rate
from tests.oracles.textbook import contact
from tests.oracles.textbook.kinematics import Array
from tests.oracles.textbook.situation import ChannelForce, Situation, between


def channel_forces(now: Situation) -> tuple[ChannelForce, ...]:
    """All channels: gravity, then the elements in their order."""
    found = [_gravity(now)] if any(g != 0.0 for g in now.mechanism.gravity) else []
    for element in now.mechanism.elements:
        if type(element) not in STATED:
            raise ModelError(
                f"the textbook's matrices do not state the {element.where}; leave it out"
            )
        found.extend(STATED[type(element)](now, element))
    return tuple(found)


def _gravity(now: Situation) -> ChannelForce:
    """V = −Σ m g·x_G."""
    g, V = now.values(now.mechanism.gravity), 0.0  # type: ignore[arg-type]
    acting = []
    for body in now.mechanism.bodies:
        mass, centre = now.mechanism.number(body.mass), now.place(body.name, body.mass_centre)
        acting.append((body.name, centre, mass * g, np.zeros(3)))
        V -= mass * float(g @ centre)
    return ChannelForce("gravity", now.stack(acting), V)


def _joint_spring(now: Situation, element: JointSpring) -> list[ChannelForce]:
    joint = now.mechanism.joint(element.joint)
    q = now.q[now.mechanism.coordinates.of(joint.name)]
    quaternion = JOINT_KINDS[joint.kind].quaternion
    if element.potential is not None:
        if quaternion is not None:
            raise NotImplementedError("potentials of quaternions are not in the textbook")
        tau = np.array(
            [-evaluate(_slope(element.potential, f"q.{c}"), now.known) for c in joint.coordinates]
        )
        V = evaluate(element.potential, now.known)
        explicit = evaluate(rate(element.potential), now.known)
    else:
        stretch, gradient = _stretch(q, quaternion, now.values(element.rest))
        k = now.values(element.stiffness)
        k_rate = now.values([rate(law) for law in element.stiffness])
        rest_rate = now.values([rate(law) for law in element.rest])
        tau = -(k * stretch) @ gradient
        V = float(0.5 * k @ stretch**2)
        explicit = float(0.5 * k_rate @ stretch**2 - k @ (stretch * rest_rate))
    return _potential(element.name, between(now, joint, tau), V, explicit)


def _stretch(q: Array, quaternion: int | None, rest: Array) -> tuple[Array, Array]:
    """How far each spring of a joint is stretched, and the gradient along the speeds (springs by n)."""
    if quaternion is None:
        return q - rest, np.eye(len(q))
    # The angle φ of a quaternion and its axis, by the shorter way round.
    w, v = abs(q[quaternion]), q[quaternion + 1 :] * (1 if q[quaternion] >= 0 else -1)
    sine = math.sqrt(v @ v)
    axis = v / sine if sine > 0 else v
    angle = 2 * math.atan2(sine, w)
    gradient = np.zeros((quaternion + 1, quaternion + 3))
    gradient[:quaternion, :quaternion] = np.eye(quaternion)
    gradient[quaternion, quaternion:] = axis
    return np.append(q[:quaternion] - rest[:quaternion], angle), gradient


def _slope(law: Any, name: str) -> Any:
    """The derivative of a law along the symbol of that name."""
    if isinstance(law, float):
        return 0.0
    import sympy

    symbol = next((s for s in law.free_symbols if s.name == name), None)
    return 0.0 if symbol is None else sympy.diff(law, symbol)


def _joint_damper(now: Situation, element: JointDamper) -> list[ChannelForce]:
    joint = now.mechanism.joint(element.joint)
    tau = -now.values(element.damping) * now.u[now.mechanism.speeds.of(joint.name)]
    return [ChannelForce(f"damper {element.name}", between(now, joint, tau))]


def _joint_torque(now: Situation, element: JointTorque) -> list[ChannelForce]:
    joint = now.mechanism.joint(element.joint)
    if element.torque is not None:
        tau = now.values(element.torque)
    else:
        tau = np.array(now.inputs[element.name], dtype=float)
    return [ChannelForce(f"actuator {element.name}", between(now, joint, tau))]


def _point_force(now: Situation, element: PointForce) -> list[ChannelForce]:
    turned = np.eye(3) if element.frame == "world" else now.tree.frames[element.body].turned
    force, moment = turned @ now.values(element.force), turned @ now.values(element.moment)
    place = now.place(element.body, element.point)
    F = now.stack([(element.body, place, force, moment)])
    return [ChannelForce(f"applied {element.name}", F)]


def _force_field(now: Situation, element: ForceField) -> list[ChannelForce]:
    frame = now.tree.frames[element.on]
    place = now.place(element.body, element.point)
    x = frame.turned.T @ (place - frame.origin)
    v = frame.turned.T @ (now.velocity(element.body, place) - now.velocity(element.on, place))
    more = {**dict(zip("xyz", x)), **dict(zip(("vx", "vy", "vz"), v))}

    def acting(force: Array) -> Array:
        force, nothing = frame.turned @ force, np.zeros(3)
        return now.stack(
            [(element.body, place, force, nothing), (element.on, place, -force, nothing)]
        )

    V = element.potential
    if V is None:
        force = np.array([evaluate(law, {**now.known, **more}) for law in element.force])
        return [ChannelForce(f"applied {element.name}", acting(force))]
    force = -np.array([evaluate(_slope(V, axis), {**now.known, **more}) for axis in "xyz"])
    explicit = evaluate(rate(V), {**now.known, **more})
    return _potential(
        element.name, acting(force), float(evaluate(V, {**now.known, **more})), explicit
    )


def _spring_damper(now: Situation, element: SpringDamper) -> list[ChannelForce]:
    one, other = element.body1, element.body2
    p1, p2 = now.place(one, element.point1), now.place(other, element.point2)
    k, c, rest = now.values([element.stiffness, element.damping, element.length])
    k_rate, rest_rate = now.values([rate(element.stiffness), rate(element.length)])
    distance = math.sqrt((p2 - p1) @ (p2 - p1))
    # Coincident points have no direction; a spring without length pulls them with force zero.
    direction = (p2 - p1) / distance if distance > 0 else np.zeros(3)
    found: list[ChannelForce] = []

    def pull(tension: float) -> Array:
        force, nothing = tension * direction, np.zeros(3)
        return now.stack([(one, p1, force, nothing), (other, p2, -force, nothing)])

    if element.stiffness != 0.0:
        stretch = distance - rest
        explicit = 0.5 * k_rate * stretch**2 - k * stretch * rest_rate
        F = pull(k * stretch)
        found.extend(_potential(element.name, F, float(0.5 * k * stretch**2), explicit))
    if element.damping != 0.0:
        parting = direction @ (now.velocity(other, p2) - now.velocity(one, p1))
        found.append(ChannelForce(f"damper {element.name}", pull(c * parting)))
    return found


def _tendon(now: Situation, element: Tendon) -> list[ChannelForce]:
    length, rate = 0.0, 0.0
    for name, law in element.coordinates:
        entry = now.mechanism.coordinates[name]
        speed = entry.index - now.mechanism.coordinates.of(entry.joint).start
        speed += now.mechanism.speeds.of(entry.joint).start
        factor = now.mechanism.number(law)
        length, rate = length + factor * now.q[entry.index], rate + factor * now.u[speed]
    segments = []
    for branch in element.branches:
        factor = now.mechanism.number(branch.factor)
        for (one, point1), (other, point2) in pairwise(branch.points):
            p1, p2 = now.place(one, point1), now.place(other, point2)
            distance = math.sqrt((p2 - p1) @ (p2 - p1))
            direction = (p2 - p1) / distance
            length += factor * distance
            rate += factor * direction @ (now.velocity(other, p2) - now.velocity(one, p1))
            segments.append((one, p1, other, p2, factor * direction))
    low, high = (now.mechanism.number(end) for end in element.length)
    x = length - min(max(length, low), high)

    def pull(tension: float) -> Array:
        nothing = np.zeros(3)
        F = now.stack(
            [(one, p1, tension * n, nothing) for one, p1, _, _, n in segments]
            + [(other, p2, -tension * n, nothing) for _, _, other, p2, n in segments]
        )
        for name, law in element.coordinates:
            entry = now.mechanism.coordinates[name]
            joint = now.mechanism.joint(entry.joint)
            tau = np.zeros(len(joint.speeds))
            tau[entry.index - now.mechanism.coordinates.of(joint.name).start] = -tension
            F = F + between(now, joint, now.mechanism.number(law) * tau)
        return F

    found: list[ChannelForce] = []
    k, c = (now.values(laws) for laws in (element.stiffness, element.damping))
    if k.any():
        V = sum(a * x ** (n + 1) / (n + 1) for n, a in enumerate(k, 1))
        found.extend(_potential(element.name, pull(sum(k * x ** np.arange(1, len(k) + 1))), V, 0.0))
    if c.any():
        tension = np.sign(rate) * sum(a * abs(rate) ** n for n, a in enumerate(c, 1))
        found.append(ChannelForce(f"damper {element.name}", pull(tension)))
    return found


def _gravity_compensation(now: Situation, element: GravityCompensation) -> list[ChannelForce]:
    m, g, acting = now.mechanism, now.values(now.mechanism.gravity), []  # type: ignore[arg-type]
    for name, fraction in element.fractions:
        lift = -m.number(fraction) * m.number(m.body(name).mass) * g
        acting.append((name, now.place(name, m.body(name).mass_centre), lift, np.zeros(3)))
    return [ChannelForce(f"applied {element.name}", now.stack(acting))]


def _potential(name: str, F: Array, V: float, explicit: float) -> list[ChannelForce]:
    made = [ChannelForce(f"spring {name}", F, V)]
    if explicit != 0.0:
        made.append(ChannelForce(f"prescribed {name}", np.zeros_like(F), explicit=float(explicit)))
    return made


STATED: dict[type, Callable[[Situation, Any], list[ChannelForce]]] = {
    JointSpring: _joint_spring,
    JointDamper: _joint_damper,
    JointTorque: _joint_torque,
    PointForce: _point_force,
    ForceField: _force_field,
    SpringDamper: _spring_damper,
    Tendon: _tendon,
    GravityCompensation: _gravity_compensation,
    JointFriction: contact.joint_friction,
    PointFriction: contact.point_friction,
    Contact: contact.contact,
}
"""The laws of force elements, by other means than the elements' own."""
