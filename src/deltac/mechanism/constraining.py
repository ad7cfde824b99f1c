"""Constructors of constraints, with checks of what they are given; see `constraints` for what each is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from deltac.errors import InputError
from deltac.mechanism.bodies import GROUND
from deltac.mechanism.constraints import (
    Angle,
    Axis,
    Distance,
    Holonomic,
    Loop,
    MotionConstraint,
    PointOn,
    Rolling,
    Skate,
    perpendiculars,
)
from deltac.mechanism.laws import as_law
from deltac.mechanism.quantities import (
    IDENTITY,
    ZERO,
    part_name,
    positive,
    rotation_matrix,
    unit_vector,
    vector,
)


def _loop(
    kind: str,
    name: str,
    body1: str,
    body2: str,
    point1: Sequence[Any],
    point2: Sequence[Any],
    axis1: str | Sequence[float] = "z",
    axis2: str | Sequence[float] | None = None,
    rotation: Any = None,
) -> Loop:
    where = f"loop {part_name(name, 'a constraint')!r}"
    if body1 == body2:
        raise InputError(f"{where} connects body {body1!r} with itself")
    return Loop(
        name,
        kind,
        body1,
        body2,
        vector(point1, f"point1 of {where}"),
        vector(point2, f"point2 of {where}"),
        unit_vector(axis1, f"axis1 of {where}"),
        unit_vector(axis1 if axis2 is None else axis2, f"axis2 of {where}"),
        IDENTITY if rotation is None else rotation_matrix(rotation, f"rotation of {where}"),
    )


def loop_spherical(
    name: str,
    body1: str,
    body2: str,
    *,
    point1: Sequence[Any] = ZERO,
    point2: Sequence[Any] = ZERO,
) -> Loop:
    """Two points coincide (three rows)."""
    return _loop("spherical", name, body1, body2, point1, point2)


def loop_revolute(
    name: str,
    body1: str,
    body2: str,
    *,
    point1: Sequence[Any] = ZERO,
    point2: Sequence[Any] = ZERO,
    axis1: str | Sequence[float] = "z",
    axis2: str | Sequence[float] | None = None,
) -> Loop:
    """A hinge: the points coincide and the axes are parallel (five rows)."""
    return _loop("revolute", name, body1, body2, point1, point2, axis1, axis2)


def loop_universal(
    name: str,
    body1: str,
    body2: str,
    *,
    point1: Sequence[Any] = ZERO,
    point2: Sequence[Any] = ZERO,
    axis1: str | Sequence[float] = "x",
    axis2: str | Sequence[float] = "y",
) -> Loop:
    """A universal joint: the points coincide and the axes are perpendicular (four rows)."""
    return _loop("universal", name, body1, body2, point1, point2, axis1, axis2)


def loop_prismatic(
    name: str,
    body1: str,
    body2: str,
    *,
    point1: Sequence[Any] = ZERO,
    point2: Sequence[Any] = ZERO,
    axis1: str | Sequence[float] = "x",
    rotation: Any = None,
) -> Loop:
    """A slide along `axis1` of the first body; the second keeps its `rotation` in it (five rows)."""
    return _loop("prismatic", name, body1, body2, point1, point2, axis1, rotation=rotation)


def loop_weld(
    name: str,
    body1: str,
    body2: str,
    *,
    point1: Sequence[Any] = ZERO,
    point2: Sequence[Any] = ZERO,
    rotation: Any = None,
) -> Loop:
    """A rigid connection: points coincide, `rotation` of the second body in the first (six rows)."""
    return _loop("weld", name, body1, body2, point1, point2, rotation=rotation)


def distance(
    name: str,
    body1: str,
    body2: str,
    length: Any,
    *,
    point1: Sequence[Any] = ZERO,
    point2: Sequence[Any] = ZERO,
) -> Distance:
    """Keep the distance of two points at `length`, a law of t (one row); see `Distance`."""
    where = f"distance {part_name(name, 'a constraint')!r}"
    return Distance(
        name,
        body1,
        body2,
        vector(point1, f"point1 of {where}"),
        vector(point2, f"point2 of {where}"),
        positive(length, f"length of {where}"),
    )


def point_on(
    name: str,
    body: str,
    equations: Any,
    *,
    point: Sequence[Any] = ZERO,
    on: str = GROUND,
) -> PointOn:
    """Keep a point on a surface (one equation) or curve (two) of another body; see `PointOn`.

    For example ``point_on("pin", "slider", ["y - 0.1*sin(x)", "z"])``.
    """
    where = f"point on {part_name(name, 'a constraint')!r}"
    given = equations if isinstance(equations, list | tuple) else (equations,)
    return PointOn(
        name,
        body,
        vector(point, f"point of {where}"),
        on,
        tuple(as_law(entry, f"equation of {where}") for entry in given),
    )


def point_in_plane(
    name: str,
    body: str,
    *,
    point: Sequence[Any] = ZERO,
    on: str = GROUND,
    normal: str | Sequence[float] = "z",
    offset: Any = 0.0,
) -> PointOn:
    """Keep a point in the plane normal·(x, y, z) = `offset`, a law of t (one row)."""
    where = f"point in plane {part_name(name, 'a constraint')!r}"
    return PointOn(
        name,
        body,
        vector(point, f"point of {where}"),
        on,
        (_along(unit_vector(normal, where)) - as_law(offset, f"offset of {where}"),),
    )


def point_on_line(
    name: str,
    body: str,
    *,
    point: Sequence[Any] = ZERO,
    on: str = GROUND,
    through: Sequence[Any] = ZERO,
    along: str | Sequence[float] = "x",
) -> PointOn:
    """Keep a point on the line through a point (laws of t) along a direction (two rows)."""
    where = f"point on line {part_name(name, 'a constraint')!r}"
    start = vector(through, f"through of {where}")
    equations = []
    for n in perpendiculars(unit_vector(along, where)):
        equations.append(_along(n) - sum((c * s for c, s in zip(n, start)), start=0.0))
    return PointOn(name, body, vector(point, f"point of {where}"), on, (equations[0], equations[1]))


def angle(
    name: str,
    body1: str,
    body2: str,
    angle: Any,
    *,
    axis1: str | Sequence[float] = "x",
    axis2: str | Sequence[float] = "x",
) -> Angle:
    """Keep the angle between two axes, a law of t other than 0 and π (one row); see `Angle`."""
    where = f"angle {part_name(name, 'a constraint')!r}"
    return Angle(
        name,
        body1,
        body2,
        unit_vector(axis1, f"axis1 of {where}"),
        unit_vector(axis2, f"axis2 of {where}"),
        as_law(angle, f"angle of {where}"),
    )


def gear(name: str, coordinate1: str, coordinate2: str, ratio: Any, phase: Any = 0.0) -> Holonomic:
    """Couple two coordinates: q1 = ratio q2 + phase (one row)."""
    from deltac.mechanism.laws import q

    where = f"gear {part_name(name, 'a constraint')!r}"
    law = q(coordinate1) - as_law(ratio, f"ratio of {where}") * q(coordinate2)
    return Holonomic(name, law - as_law(phase, f"phase of {where}"))


def holonomic(name: str, law: Any) -> Holonomic:
    """Keep any law of t and coordinates at zero (one row); see `Holonomic`."""
    return Holonomic(name, as_law(law, f"holonomic constraint {part_name(name, 'a constraint')!r}"))


def motion_constraint(name: str, law: Any) -> MotionConstraint:
    """Keep any law linear in the speeds at zero (one row); see `MotionConstraint`."""
    return MotionConstraint(
        name, as_law(law, f"motion constraint {part_name(name, 'a constraint')!r}")
    )


def rolling(
    name: str,
    body: str,
    radius: Any = 0.0,
    *,
    tube: Any = 0.0,
    centre: Sequence[Any] = ZERO,
    axis: str | Sequence[float] = "y",
    on: str = GROUND,
    point: Sequence[Any] = ZERO,
    normal: str | Sequence[float] = "z",
    surface_velocity: Sequence[Any] = ZERO,
) -> Rolling:
    """Roll without slip on a plane (three rows); see `Rolling`.

    A disc has a `radius`, a torus-edged wheel `radius` and `tube`, a sphere `tube` alone.
    """
    where = f"rolling {part_name(name, 'a constraint')!r}"
    if body == on:
        raise InputError(f"{where}: body {body!r} cannot roll on itself")
    circle = positive(radius, f"radius of {where}", allow_zero=True)
    edge = positive(tube, f"tube of {where}", allow_zero=True)
    if circle == 0.0 and edge == 0.0:
        raise InputError(
            f"{where}: give a radius (disc, wheel) or a tube radius (sphere) above zero"
        )
    return Rolling(
        name,
        body,
        vector(centre, f"centre of {where}"),
        unit_vector(axis, f"axis of {where}"),
        circle,
        edge,
        on,
        vector(point, f"point of {where}"),
        unit_vector(normal, f"normal of {where}"),
        vector(surface_velocity, f"surface velocity of {where}"),
    )


def skate(
    name: str,
    body: str,
    *,
    point: Sequence[Any] = ZERO,
    lateral: str | Sequence[float] = "y",
    on: str = GROUND,
    drift: Any = 0.0,
) -> Skate:
    """A blade or knife edge: no velocity of the point along `lateral` (one row); see `Skate`."""
    where = f"skate {part_name(name, 'a constraint')!r}"
    return Skate(
        name,
        body,
        vector(point, f"point of {where}"),
        unit_vector(lateral, f"lateral of {where}"),
        on,
        as_law(drift, f"drift of {where}"),
    )


def _along(n: Axis) -> Any:
    """n·(x, y, z) as a law."""
    from deltac.mechanism.laws import symbol_of

    return sum((c * symbol_of(x) for c, x in zip(n, "xyz") if c != 0.0), start=0.0)
