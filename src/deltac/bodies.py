"""Rigid bodies: how their mass, mass centre and inertia are given."""

from __future__ import annotations

from deltac.mechanism.bodies import Body, body, box, disc, frame, point_mass, rod, sphere

__all__ = ["Body", "body", "box", "disc", "frame", "point_mass", "rod", "sphere"]
