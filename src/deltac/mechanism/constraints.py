"""Constraints: closed loops, guides, couplings, rolling and skating. Each may move in time.

A holonomic constraint keeps functions of (q, t) at zero; a motion constraint keeps functions linear in
the speeds at zero, A v + b = 0. Every length, angle or point component that is called a *law of t* may be
an expression of t and parameters: then the constraint is rheonomic (or acatastatic), and its force does
work. Points and axes are components in the body frame, or world components for the "ground".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

from deltac.mechanism.quantities import (
    Matrix,
    Vector,
    unit_vector,
)

Axis: TypeAlias = tuple[float, float, float]


@dataclass(frozen=True)
class Loop:
    """A joint that closes a loop: `kind` "spherical", "revolute", "universal", "prismatic" or "weld".

    The points coincide (for "prismatic": the second lies on the line through the first along `axis1`);
    "revolute" keeps `axis1` and `axis2` parallel, "universal" perpendicular; "prismatic" and "weld" keep
    `rotation`, the second body's axes in components of the first. Points may be laws of t.
    """

    name: str
    kind: str
    body1: str
    body2: str
    point1: Vector
    point2: Vector
    axis1: Axis
    axis2: Axis
    rotation: Matrix


@dataclass(frozen=True)
class Distance:
    """A massless rod: the distance of two points is `length` (m), a positive law of t."""

    name: str
    body1: str
    body2: str
    point1: Vector
    point2: Vector
    length: Any


@dataclass(frozen=True)
class PointOn:
    """A point of `body` lies on a surface or curve of the body `on`.

    `equations` are laws of x, y, z, the point's coordinates in the frame of `on`, and t; each is kept at
    zero: one for a surface, two for a curve.
    """

    name: str
    body: str
    point: Vector
    on: str
    equations: tuple[Any, ...]


@dataclass(frozen=True)
class Angle:
    """The angle between an axis of each of two bodies is `angle` (rad), a law of t, not 0 or π."""

    name: str
    body1: str
    body2: str
    axis1: Axis
    axis2: Axis
    angle: Any


@dataclass(frozen=True)
class Holonomic:
    """Any f(q, t) = 0: a law of t and the coordinates ``q.<coordinate>``."""

    name: str
    law: Any


@dataclass(frozen=True)
class MotionConstraint:
    """Any A(q, t) v + b(q, t) = 0: a law of t, q, u that is linear in the speeds ``u.<speed>``."""

    name: str
    law: Any


@dataclass(frozen=True)
class Rolling:
    """A wheel, disc or sphere rolls without slip on a plane of the body `on`.

    The wheel turns about `axis` through its `centre`; its edge is a torus with circle radius `radius`
    and tube radius `tube` (a disc: tube 0; a sphere: radius 0). The plane goes through `point` with unit
    `normal` (both in the frame of `on`; `point` may be a law of t). One holonomic row keeps contact, two
    motion rows keep the contact points together: tangential velocities equal up to `surface_velocity`,
    three laws of t and of the contact point's x, y, z in the frame of `on` (m/s).
    """

    name: str
    body: str
    centre: Vector
    axis: Axis
    radius: Any
    tube: Any
    on: str
    point: Vector
    normal: Axis
    surface_velocity: tuple[Any, Any, Any]


@dataclass(frozen=True)
class Skate:
    """A blade: the velocity of a point of `body` relative to `on` has no component along `lateral`.

    `lateral` is a direction fixed in `body`, perpendicular to the blade; `drift` (m/s) is the lateral
    velocity that is kept, a law of t (zero for a blade at rest in the ice).
    """

    name: str
    body: str
    point: Vector
    lateral: Axis
    on: str
    drift: Any


Constraint: TypeAlias = (
    Loop | Distance | PointOn | Angle | Holonomic | MotionConstraint | Rolling | Skate
)


def perpendiculars(n: Axis) -> tuple[Axis, Axis]:
    """Two unit vectors that make a right-handed frame with the unit vector n."""
    k = min(range(3), key=lambda i: abs(n[i]))
    e = [float(i == k) for i in range(3)]
    dot = sum(a * b for a, b in zip(e, n))
    first = unit_vector([e[i] - dot * n[i] for i in range(3)], "direction")
    return first, (
        n[1] * first[2] - n[2] * first[1],
        n[2] * first[0] - n[0] * first[2],
        n[0] * first[1] - n[1] * first[0],
    )
