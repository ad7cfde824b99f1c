"""Joints: each places a body relative to its parent, by coordinates q and speeds u of its own."""

from __future__ import annotations

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

__all__ = [
    "Joint",
    "cylindrical",
    "fixed",
    "free",
    "planar",
    "prismatic",
    "revolute",
    "screw",
    "spherical",
    "universal",
]
