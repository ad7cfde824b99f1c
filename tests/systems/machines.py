"""Mechanisms that several test files run."""

from __future__ import annotations

from typing import Any

from deltac.mechanism.bodies import body, box, frame, point_mass, sphere
from deltac.mechanism.forces import (
    joint_damper,
    joint_spring,
    joint_torque,
    point_force,
    spring_damper,
)
from deltac.mechanism.joints import free, prismatic, revolute, screw, spherical, universal
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.state import State


def pendulum(**options: Any) -> Mechanism:
    """A point mass m = 2 kg at l = 0.5 m below a hinge, g = 9.81 m/s²: q̈ = −(g/l) sin q."""
    return Mechanism(
        [point_mass("bob", "m", ["l", 0, 0])],
        [revolute("hinge", "ground", "bob", "z", **options)],
        gravity=["g", 0, 0],
        parameters={"m": 2.0, "l": 0.5, "g": 9.81},
        name="pendulum",
    )


def robot(driven: bool = True) -> tuple[Mechanism, State]:
    """A driven shaft, a hinge with motor and damper, a ball joint and a universal joint: all smooth.

    Without the drive the shaft turns by itself, a rotor inertia on it.
    """
    shaft: dict[str, Any] = {"motion": "0.4*sin(1.3*t)"} if driven else {"armature": 0.1}
    mechanism = Mechanism(
        [
            frame("shaft"),
            box("hub", 1.2, [0.3, 0.2, 0.4]),
            body("top", 0.8, [0.02, 0.03, 0.025], [0, 0.1, -0.2]),
            box("arm", 0.5, [0.1, 0.2, 0.6], [0, 0, -0.3]),
        ],
        [
            revolute("drive", "ground", "shaft", "z", **shaft),
            revolute(
                "hinge",
                "shaft",
                "hub",
                [1, 0.3, 0.2],
                position=[0.2, 0, 0],
                child_position=[0, 0, 0.15],
                damping=0.05,
            ),
            spherical("ball", "hub", "top", position=[0.1, 0.1, -0.2], damping=0.02),
            universal("knuckle", "top", "arm", position=[0, 0.1, -0.3], damping=0.01),
        ],
        [joint_torque("motor", "hinge", "0.2*cos(t)*sin(q.hinge)")],
        gravity=[0, 0, -9.81],
        name="robot",
    )
    state = mechanism.state(
        {"hinge": 0.5, "knuckle.first": 0.3}, {"hinge": 0.4, "ball": [0.3, -0.5, 0.8]}
    )
    return mechanism, state


def workshop() -> tuple[Mechanism, State]:
    """Most of what a mechanism can hold: free and screw joints, springs driven in time, forces."""
    mechanism = Mechanism(
        [
            box("base", "m", [0.4, 0.3, 0.2], [0.02, 0.0, 0.05]),
            frame("carriage"),
            sphere("nut", 0.7, 0.2, [0.05, 0, 0]),
            body("bob", 0.6, [0.02, 0.025, 0.03], [0, 0, -0.2]),
        ],
        [
            free("base", "base"),
            prismatic("lift", "base", "carriage", "z", motion="0.1*sin(2*t) + 0.05*t**2"),
            screw("thread", "carriage", "nut", [0, 1, 0.3], pitch=0.2, damping=0.03, armature=0.01),
            spherical("ball", "base", "bob", position=[0.3, 0, -0.2]),
        ],
        [
            spring_damper(
                "tie",
                "ground",
                "base",
                point2=[0.1, 0.1, 0.1],
                point1=[0, 0, 1.5],
                stiffness=20,
                damping=0.5,
                length="0.3 + 0.05*sin(3*t)",
            ),
            joint_spring("coil", "thread", "k*(1 + 0.2*cos(t))", 0.1),
            joint_damper("grease", "ball", [0.01, 0.02, 0.03]),
            joint_torque("motor", "thread", "0.1*cos(2*t) - 0.01*u.thread"),
            point_force("wind", "bob", ["0.2*sin(t)", 0.1, 0], [0, 0, -0.3], moment=[0, 0, 0.01]),
        ],
        gravity=[0, 0, -9.81],
        parameters={"m": 1.5, "k": 2.0},
        name="workshop",
    )
    half = 0.5**0.5
    state = mechanism.state(
        {"base": [0.1, -0.1, 0.2, half, 0.0, half, 0.0], "thread": 0.2},
        {"base": [0.1, 0, 0.2, 0.3, -0.2, 0.1], "ball": [0.5, 0.3, -0.8], "thread": 1.0},
    )
    return mechanism, state
