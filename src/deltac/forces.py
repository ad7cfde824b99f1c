"""Force elements: springs, dampers, motors, loads, tendons, friction and compliant contact."""

from __future__ import annotations

from deltac.mechanism.contact import contact
from deltac.mechanism.forces import (
    force_field,
    gravity_compensation,
    joint_damper,
    joint_spring,
    joint_torque,
    point_force,
    spring_damper,
    tendon,
)
from deltac.mechanism.friction import friction_law, joint_friction, point_friction

__all__ = [
    "contact",
    "force_field",
    "friction_law",
    "gravity_compensation",
    "joint_damper",
    "joint_friction",
    "joint_spring",
    "joint_torque",
    "point_force",
    "point_friction",
    "spring_damper",
    "tendon",
]
