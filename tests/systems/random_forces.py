"""Random force elements on a mechanism: one example of every kind that there is."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn
from numpy.typing import NDArray

from deltac.mechanism import shapes
from deltac.mechanism.contact import Contact, contact
from deltac.mechanism.forces import (
    ForceField,
    GravityCompensation,
    JointDamper,
    JointSpring,
    JointTorque,
    PointForce,
    SpringDamper,
    Tendon,
    force_field,
    gravity_compensation,
    joint_damper,
    joint_spring,
    joint_torque,
    point_force,
    spring_damper,
    tendon,
)
from deltac.mechanism.friction import (
    JointFriction,
    PointFriction,
    friction_law,
    joint_friction,
    point_friction,
)
from deltac.mechanism.joints import JOINT_KINDS
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.scope import GROUND
from deltac.mechanism.shapes import Shape
from tests.oracles.textbook.forces import STATED
from tests.systems.random_geometry import random_direction, random_rotation

Array = NDArray[Any]


def _law(rng: np.random.Generator, mechanism: Mechanism) -> str:
    """A smooth law of t, a coordinate and a speed."""
    terms = [f"{rng.normal():.3f}*cos(w_p*t)"]
    if len(mechanism.coordinates):
        terms.append(f"{rng.normal():.3f}*sin(q.{rng.choice(mechanism.coordinates.names)})")
    if len(mechanism.speeds):
        terms.append(f"{rng.normal():.3f}*u.{rng.choice(mechanism.speeds.names)}**2")
    return " + ".join(terms)


ELEMENTS: dict[type, tuple[str, ...]] = {
    JointSpring: ("potential", "rest"),
    JointDamper: ("damper",),
    JointTorque: ("torque",),
    PointForce: ("force", "moment"),
    ForceField: ("stream", "well"),
    SpringDamper: ("damped", "centred", "driven"),
    Tendon: ("cord", "coupling"),
    GravityCompensation: ("lift",),
    JointFriction: ("joint friction",),
    PointFriction: ("point friction",),
    Contact: ("ball on plane", "ball in box", "box on box", "capsules", "capsule in box"),
}
"""What `random_force` can make of every type of force element."""

EVERY_FORCE = [what for kind, some in ELEMENTS.items() if kind in STATED for what in some]
"""Those that random mechanisms draw: what the textbook states by other means."""


def drawn_forces(
    draw: DrawFn, rng: np.random.Generator, mechanism: Mechanism, in_time: bool = True
) -> list[Any]:
    """Up to four force elements; `in_time`: potentials may depend on time."""
    wanted = draw(st.lists(st.sampled_from(EVERY_FORCE), max_size=4), label="forces")
    made = []
    for k, what in enumerate(wanted):
        element = random_force(rng, mechanism, what, f"f{k}", in_time)
        made += [element] if element is not None else []
    return made


def random_force(
    rng: np.random.Generator, mechanism: Mechanism, what: str, name: str, in_time: bool = True
) -> Any:
    """A random force element of the kind `what`, or None where the mechanism has no place for it."""
    moving = [joint for joint in mechanism.joints if joint.speeds]
    plain = [joint for joint in moving if JOINT_KINDS[joint.kind].rates]
    joint: Any = None
    if what in ("torque", "damper", "joint friction"):
        if not moving:
            return None
        joint = moving[rng.integers(len(moving))]
    elif what in ("potential", "rest", "coupling"):
        if not plain:
            return None
        joint = plain[rng.integers(len(plain))]

    def law() -> str:
        return _law(rng, mechanism)

    one, other = _two_bodies(rng, mechanism)
    points = {"point1": rng.normal(0, 0.5, 3), "point2": rng.normal(0, 2, 3)}
    swing = "*(1 + 0.3*sin(t))" if in_time else ""
    match what:
        case "torque":
            return joint_torque(name, joint.name, [law() for _ in joint.speeds])
        case "damper":
            return joint_damper(name, joint.name, [0.7] * len(joint.speeds))
        case "potential":
            s = " + ".join(f"q.{c}" for c in joint.coordinates)
            return joint_spring(name, joint.name, potential=f"k_p*(1 - cos({s})){swing} + ({s})**4")
        case "rest":
            count = len(joint.coordinates)
            return joint_spring(name, joint.name, [f"k_p{swing}"] * count, [f"0.2{swing}"] * count)
        case "force":
            return point_force(
                name,
                other,
                [law(), 1.0, law()],
                rng.normal(size=3),
                frame=str(rng.choice(["world", "body"])),  # type: ignore[arg-type]
            )
        case "moment":
            return point_force(
                name,
                other,
                moment=[law(), "w_p", 0.0],
                frame=str(rng.choice(["world", "body"])),  # type: ignore[arg-type]
            )
        case "stream":
            laws = [f"0.4*vy*z - {law()}", "-0.3*(vx - 0.2*cos(t)*y)", "sin(x)*w_p + 0.1*vz"]
            return force_field(name, other, laws, rng.normal(size=3), on=one)
        case "well":
            potential = f"-k_p{swing}/sqrt(1 + x**2 + 2*y**2 + z**2) + 0.3*x*z"
            return force_field(name, other, point=rng.normal(size=3), potential=potential, on=one)
        case "damped":
            return spring_damper(
                name, one, other, **points, stiffness="k_p", damping=0.8, length=0.3
            )
        case "centred":
            return spring_damper(name, one, other, **points, stiffness=f"k_p{swing}")
        case "driven":
            return spring_damper(name, one, other, **points, stiffness=2.5, length=f"l_p{swing}")
        case "cord":
            third = str(rng.choice([GROUND, *(body.name for body in mechanism.bodies)]))
            path = [(body, rng.normal(0, 1, 3)) for body in (one, other, third)]
            more = [([(other, rng.normal(0, 1, 3)), (one, [2.0, "l_p", 0.0])], "l_p/2")]
            band = [float(end) for end in np.sort(rng.uniform(0, 4, 2))]
            return tendon(
                name,
                path,
                branches=more,  # type: ignore[arg-type]
                stiffness=["k_p", 0.4],
                damping=[0.3, 0.2],
                length=band,
            )
        case "coupling":
            weights = {c: float(rng.normal()) for c in joint.coordinates}
            return tendon(
                name,
                coordinates=weights,
                stiffness=[1.2, 0.3, 0.5],
                damping=["k_p", 0.0, 0.7],
                length=0.3,
            )
        case "lift":
            return gravity_compensation(name, {other: 0.7})
        case "joint friction":
            strengths = ["k_p*(2 + sin(t))", *[0.4] * 5][: len(joint.speeds)]
            return joint_friction(name, joint.name, strengths, viscous=0.2, width=0.3)  # type: ignore[arg-type]
        case "point friction":
            rubbing = friction_law(0.5, static=0.8, stribeck=0.5, viscous=0.1, width="l_p")
            point = rng.normal(0, 0.5, 3)
            return point_friction(
                name, other, law(), rubbing, point=point, on=one, normal=random_direction(rng)
            )
        case _:
            return random_contact(rng, what, name, one, other)


def random_contact(rng: np.random.Generator, what: str, name: str, one: str, other: str) -> Any:
    """A contact of shapes so large that they often overlap."""

    def at() -> Array:
        return rng.normal(0, 0.4, 3)

    pair: tuple[Shape, Shape]
    match what:
        case "ball on plane":
            pair = (
                shapes.sphere(other, "1 + l_p", at()),
                shapes.half_space(one, random_direction(rng)),
            )
            given: dict[str, Any] = {"exponent": 1.5, "dissipation": 0.4, "friction": 0.6}
        case "ball in box":
            pair = shapes.sphere(other, 1.2, at()), shapes.box(one, (1, 2, "3*l_p"), at())
            given = {"model": "kelvin-voigt", "dissipation": "0.1*k_p"}
        case "box on box":
            pair = (
                shapes.box(one, (2, 1.5, 1), at(), random_rotation(rng)),
                shapes.box(other, (1, 2, 1.4), at(), random_rotation(rng)),
            )
            given = {"friction": friction_law(0.3, viscous=0.2, width=0.1), "exponent": 1.25}
        case "capsules":
            pair = (
                shapes.capsule(one, 0.7, "2*l_p", random_direction(rng), at()),
                shapes.capsule(other, 0.6, 1.3, random_direction(rng), at()),
            )
            given = {"dissipation": 1.5, "friction": 0.8, "exponent": 2.0}
        case "capsule in box":
            pair = (
                shapes.box(one, (2, 1.5, 1), at()),
                shapes.capsule(other, 0.6, 1.3, random_direction(rng), at()),
            )
            given = {"dissipation": 0.2}
        case _:
            raise ValueError(what)
    first, second = pair
    return contact(name, first, second, "2*k_p", **given)


def _two_bodies(rng: np.random.Generator, mechanism: Mechanism) -> tuple[str, str]:
    """Two different bodies, the first possibly the ground."""
    names = [body.name for body in mechanism.bodies]
    other = str(rng.choice(names))
    one = str(rng.choice([GROUND, *(name for name in names if name != other)]))
    return one, other
