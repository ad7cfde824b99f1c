"""Constraints: closed loops, guides, couplings, rolling and skating."""

from __future__ import annotations

from deltac.mechanism.constraints import (
    angle,
    belt,
    bevel_gear,
    differential,
    distance,
    gear,
    higher_pair,
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

__all__ = [
    "angle",
    "belt",
    "bevel_gear",
    "differential",
    "distance",
    "gear",
    "higher_pair",
    "holonomic",
    "loop_prismatic",
    "loop_revolute",
    "loop_spherical",
    "loop_universal",
    "loop_weld",
    "motion_constraint",
    "point_in_plane",
    "point_on",
    "point_on_line",
    "rolling",
    "skate",
]
