"""What the machine is: bodies, joints, forces, prescribed motions. Declarative, no numerics."""

from __future__ import annotations

from deltac.mechanism.bodies import (
    GROUND,
    Body,
    body,
    box,
    disc,
    frame,
    point_mass,
    rod,
    sphere,
)
from deltac.mechanism.coordinates import CoordinateMap
from deltac.mechanism.forces import (
    joint_damper,
    joint_spring,
    joint_torque,
    point_force,
    spring_damper,
)
from deltac.mechanism.joints import (
    Joint,
    cylindrical,
    fixed,
    free,
    planar,
    prismatic,
    revolute,
    screw,
    spherical,
    universal,
)
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.quantities import rotation
from deltac.mechanism.state import State

__all__ = [
    "GROUND",
    "Body",
    "CoordinateMap",
    "Joint",
    "Mechanism",
    "State",
    "body",
    "box",
    "cylindrical",
    "disc",
    "fixed",
    "frame",
    "free",
    "joint_damper",
    "joint_spring",
    "joint_torque",
    "planar",
    "point_force",
    "point_mass",
    "prismatic",
    "revolute",
    "rod",
    "rotation",
    "screw",
    "sphere",
    "spherical",
    "spring_damper",
    "universal",
]
