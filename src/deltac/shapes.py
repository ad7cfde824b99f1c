"""Shapes of bodies, for contact, impact and pictures. They carry no mass."""

from __future__ import annotations

from deltac.mechanism.shapes import (
    Box,
    Capsule,
    HalfSpace,
    Sphere,
    Visual,
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
    "Visual",
    "box",
    "capsule",
    "half_space",
    "point",
    "sphere",
]
