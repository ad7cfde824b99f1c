"""Shapes of bodies, for contact and impact. They carry no mass."""

from __future__ import annotations

from deltac.mechanism.shapes import (
    Box,
    Capsule,
    HalfSpace,
    Sphere,
    box,
    capsule,
    half_space,
    point,
    sphere,
)

__all__ = [
    "Box",
    "Capsule",
    "HalfSpace",
    "Sphere",
    "box",
    "capsule",
    "half_space",
    "point",
    "sphere",
]
