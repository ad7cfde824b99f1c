"""What the machine is: bodies, joints, forces, prescribed motions. Declarative, no numerics."""

from __future__ import annotations

from deltac.mechanism import shapes
from deltac.mechanism.bodies import (
    Body,
    body,
    box,
    disc,
    frame,
    point_mass,
    rod,
    sphere,
)
from deltac.mechanism.constraints import (
    angle,
    distance,
    gear,
    holonomic,
    loop_prismatic,
    loop_revolute,
    loop_spherical,
    loop_universal,
    loop_weld,
    motion_constraint,
    point_in_plane,
    point_on,
    point_on_line,
    rolling,
    skate,
)
from deltac.mechanism.contact import contact
from deltac.mechanism.coordinate_map import CoordinateMap, absolute_angles
from deltac.mechanism.events import event, impact, joint_stop
from deltac.mechanism.forces import (
    gravity_compensation,
    joint_damper,
    joint_spring,
    joint_torque,
    point_force,
    spring_damper,
    tendon,
)
from deltac.mechanism.friction import friction_law, joint_friction, point_friction
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
from deltac.mechanism.scope import GROUND
from deltac.mechanism.state import State

__all__ = [
    "GROUND",
    "Body",
    "CoordinateMap",
    "Joint",
    "Mechanism",
    "State",
    "absolute_angles",
    "angle",
    "body",
    "box",
    "contact",
    "cylindrical",
    "disc",
    "distance",
    "event",
    "fixed",
    "frame",
    "free",
    "friction_law",
    "gear",
    "gravity_compensation",
    "holonomic",
    "impact",
    "joint_damper",
    "joint_friction",
    "joint_spring",
    "joint_stop",
    "joint_torque",
    "loop_prismatic",
    "loop_revolute",
    "loop_spherical",
    "loop_universal",
    "loop_weld",
    "motion_constraint",
    "planar",
    "point_force",
    "point_friction",
    "point_in_plane",
    "point_mass",
    "point_on",
    "point_on_line",
    "prismatic",
    "revolute",
    "rod",
    "rolling",
    "rotation",
    "screw",
    "shapes",
    "skate",
    "sphere",
    "spherical",
    "spring_damper",
    "tendon",
    "universal",
]
