"""Constraints: closed loops, guides, couplings, contacts, rolling and skating. Each may move in time.

A holonomic constraint keeps functions of (q, t) at zero; a motion constraint keeps functions linear in
the speeds at zero, A v + b = 0. Every length, angle or point component that is called a *law of t* may be
an expression of t and parameters: then the constraint is rheonomic (or acatastatic), and its force does
work. Points and axes are components in the body frame, or world components for the "ground".
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any, TypeAlias

import numpy as np

from deltac.arrays import TINY
from deltac.errors import ModelError
from deltac.mechanism.expressions import symbol_of
from deltac.mechanism.laws import LawLike, as_law, symbol_names
from deltac.mechanism.parts import (
    AnyBody,
    Axis,
    FieldKind,
    LawOfMotion,
    LawOfPlace,
    LawOfTime,
    NonNegative,
    Point,
    PointOfTime,
    PositiveOfTime,
    Rotation,
    constructor,
    each,
)
from deltac.mechanism.quantities import IDENTITY, ZERO, is_zero, positive, unit_vector, vector
from deltac.mechanism.scene import Constraint, Expr, Scene
from deltac.mechanism.scope import GROUND, Scope

Direction: TypeAlias = tuple[float, float, float]


@dataclass(frozen=True)
class Loop(Constraint):
    """A joint that closes a loop: `kind` "spherical", "revolute", "universal", "prismatic" or "weld".

    The points coincide (for "prismatic": the second lies on the line through the first along `axis1`);
    "revolute" keeps `axis1` and `axis2` parallel, "universal" perpendicular; "prismatic" and "weld" keep
    `rotation`, the second body's axes in components of the first. Points may be laws of t.
    """

    name: str
    kind: str
    body1: AnyBody
    body2: AnyBody
    point1: PointOfTime
    point2: PointOfTime
    axis1: Axis = "z"
    axis2: Axis = "z"
    rotation: Rotation = IDENTITY

    noun = "loop constraint"
    bodies = ("body1", "body2")

    def positions(self, scene: Scene) -> list[Expr]:
        """Gap and turn of the two bodies' frames, as far as the kind keeps them."""
        gap = scene.place(self.body2, self.point2) - scene.place(self.body1, self.point1)
        first = scene.rotation(self.body1)
        across = [scene.matrix([n]).T for n in perpendiculars(self.axis1)]
        if self.kind == "prismatic":
            local = first.T @ gap
            return [*(scene.dot(n, local) for n in across), *self._turned(scene, first)]
        # World components: a planar loop then has rows that vanish by themselves, which are left out.
        rows = _entries(gap)
        if self.kind == "weld":
            rows += self._turned(scene, first)
        if self.kind == "revolute":
            axis2 = first.T @ scene.axis(self.body2, self.axis2)
            rows += [scene.dot(n, axis2) for n in across]
        if self.kind == "universal":
            axes = scene.axis(self.body1, self.axis1), scene.axis(self.body2, self.axis2)
            rows.append(scene.dot(*axes))
        return rows

    def _turned(self, scene: Scene, first: Expr) -> list[Expr]:
        """Three rows that keep the relative rotation: the skew part of R1ᵀ R2 R0ᵀ."""
        R = (first.T @ scene.rotation(self.body2)) @ scene.matrix(self.rotation).T
        return [0.5 * (R[2, 1] - R[1, 2]), 0.5 * (R[0, 2] - R[2, 0]), 0.5 * (R[1, 0] - R[0, 1])]


@constructor
def loop_spherical(
    name: str, body1: str, body2: str, *, point1: Point = ZERO, point2: Point = ZERO
) -> Loop:
    """Two points coincide (three rows)."""
    return Loop(name, "spherical", body1, body2, point1, point2)


@constructor
def loop_revolute(
    name: str,
    body1: str,
    body2: str,
    *,
    point1: Point = ZERO,
    point2: Point = ZERO,
    axis1: Axis = "z",
    axis2: Axis = None,
) -> Loop:
    """A hinge: the points coincide and the axes are parallel (five rows); `axis2` is `axis1` by default."""
    parallel = axis1 if axis2 is None else axis2
    return Loop(name, "revolute", body1, body2, point1, point2, axis1, parallel)


@constructor
def loop_universal(
    name: str,
    body1: str,
    body2: str,
    *,
    point1: Point = ZERO,
    point2: Point = ZERO,
    axis1: Axis = "x",
    axis2: Axis = "y",
) -> Loop:
    """A universal joint: the points coincide and the axes are perpendicular (four rows)."""
    return Loop(name, "universal", body1, body2, point1, point2, axis1, axis2)


@constructor
def loop_prismatic(
    name: str,
    body1: str,
    body2: str,
    *,
    point1: Point = ZERO,
    point2: Point = ZERO,
    axis1: Axis = "x",
    rotation: Rotation = IDENTITY,
) -> Loop:
    """A slide along `axis1` of the first body; the second keeps its `rotation` in it (five rows)."""
    return Loop(name, "prismatic", body1, body2, point1, point2, axis1, axis1, rotation)


@constructor
def loop_weld(
    name: str,
    body1: str,
    body2: str,
    *,
    point1: Point = ZERO,
    point2: Point = ZERO,
    rotation: Rotation = IDENTITY,
) -> Loop:
    """A rigid connection: points coincide, `rotation` of the second body in the first (six rows)."""
    return Loop(name, "weld", body1, body2, point1, point2, rotation=rotation)


@constructor
@dataclass(frozen=True)
class Distance(Constraint):
    """A massless rod: the distance of two points is `length` (m), a positive law of t."""

    name: str
    body1: AnyBody
    body2: AnyBody
    point1: PointOfTime = field(default=ZERO, kw_only=True)
    point2: PointOfTime = field(default=ZERO, kw_only=True)
    length: PositiveOfTime

    noun = "distance constraint"
    bodies = ("body1", "body2")

    def positions(self, scene: Scene) -> list[Expr]:
        """(d·d − l²)/2l: smooth, and a length near the constraint."""
        gap = scene.place(self.body2, self.point2) - scene.place(self.body1, self.point1)
        length = scene.number(self.length)
        return [(scene.dot(gap, gap) - length**2) / (2 * length)]


def _surface(value: Any, where: str) -> Any:
    law = as_law(value, where)
    if not symbol_names(law) & {"x", "y", "z"}:
        raise ModelError(f"{where}: {law} holds none of x, y, z")
    return law


def _equations(value: Any, where: str) -> tuple[Any, ...]:
    equations = tuple(_surface(law, where) for law in each(value, where))
    if not equations:
        raise ModelError(f"{where}: found none, expected one for a surface, two for a curve")
    return equations


LawOfSurface: TypeAlias = Annotated[Any, FieldKind(_surface, "on_surface")]
"""A law of t and of x, y, z in the frame of a body, zero on the surface and with a slope there."""

LawsOfSurface: TypeAlias = Annotated[Any, FieldKind(_equations, "on_surface")]
"""Laws of t and of x, y, z in the frame of a body."""

VectorOfSurface: TypeAlias = Annotated[Any, FieldKind(vector, "on_surface")]


@constructor
@dataclass(frozen=True)
class PointOn(Constraint):
    """A point of `body` lies on a surface or curve of the body `on`.

    `equations` are laws of x, y, z, the point's coordinates in the frame of `on`, and t; each is kept at
    zero: one for a surface, two for a curve. For example
    ``point_on("pin", "slider", ["y - 0.1*sin(x)", "z"])``.
    """

    name: str
    body: AnyBody
    point: PointOfTime = field(default=ZERO, kw_only=True)
    on: AnyBody = field(default=GROUND, kw_only=True)
    equations: LawsOfSurface

    noun = "point-on constraint"
    bodies = ("body", "on")

    def positions(self, scene: Scene) -> list[Expr]:
        """The equations at the point's coordinates in the frame of `on`."""
        x = scene.local(self.on, scene.place(self.body, self.point))
        return _entries(scene.vector(self.equations, {"x": x[0], "y": x[1], "z": x[2]}))


@constructor
def point_in_plane(
    name: str,
    body: str,
    *,
    point: PointOfTime = ZERO,
    on: str = GROUND,
    normal: Axis = "z",
    offset: LawOfTime = 0.0,
) -> PointOn:
    """Keep a point in the plane normal·(x, y, z) = `offset`, a law of t (one row)."""
    where = PointOn.called(name)
    height = _along(unit_vector(normal, f"normal of {where}"))
    return PointOn(name, body, height - as_law(offset, f"offset of {where}"), point=point, on=on)


@constructor
def point_on_line(
    name: str,
    body: str,
    *,
    point: PointOfTime = ZERO,
    on: str = GROUND,
    through: PointOfTime = ZERO,
    along: Axis = "x",
) -> PointOn:
    """Keep a point on the line through a point (laws of t) along a direction (two rows)."""
    where = PointOn.called(name)
    start = vector(through, f"through of {where}")
    normals = perpendiculars(unit_vector(along, f"along of {where}"))
    offsets = [sum((c * s for c, s in zip(n, start)), start=0.0) for n in normals]
    equations = [_along(n) - offset for n, offset in zip(normals, offsets)]
    return PointOn(name, body, equations, point=point, on=on)


@constructor
@dataclass(frozen=True)
class Angle(Constraint):
    """The angle between an axis of each of two bodies is `angle` (rad), a law of t, not 0 or π."""

    name: str
    body1: AnyBody
    body2: AnyBody
    axis1: Axis = field(default="x", kw_only=True)
    axis2: Axis = field(default="x", kw_only=True)
    angle: LawOfTime

    noun = "angle constraint"
    bodies = ("body1", "body2")

    def positions(self, scene: Scene) -> list[Expr]:
        """α − angle (rad), α by sine and cosine: the cosine alone loses it, and its slope, towards 0 and π.

        The row then has the size of a turn whatever the angle, and its multiplier is a moment.
        """
        first, second = scene.axis(self.body1, self.axis1), scene.axis(self.body2, self.axis2)
        normal = scene.cross(first, second)
        # Axes that are parallel have no direction across both: the slope is zero there, not NaN.
        sine = scene.sqrt(scene.dot(normal, normal) + TINY)
        return [scene.atan2(sine, scene.dot(first, second)) - scene.number(self.angle)]


@constructor
@dataclass(frozen=True)
class Holonomic(Constraint):
    """Any f(q, t) = 0: a law of t and the coordinates ``q.<coordinate>``."""

    name: str
    law: LawOfPlace

    noun = "holonomic constraint"

    def check(self, scope: Scope) -> None:
        """InputError for unknown symbols, and a law without coordinates."""
        super().check(scope)
        if not any(name.startswith("q.") for name in symbol_names(self.law)):
            raise ModelError(f"law of {self.where}: {self.law} holds no coordinate q.<name>")

    def positions(self, scene: Scene) -> list[Expr]:
        """The law."""
        return [scene.number(self.law)]


@constructor
def gear(
    name: str, coordinate1: str, coordinate2: str, ratio: LawLike, phase: LawLike = 0.0
) -> Holonomic:
    """Couple two coordinates: q1 = ratio q2 + phase (one row)."""
    where = Holonomic.called(name)
    first, second = (symbol_of(f"q.{coordinate}") for coordinate in (coordinate1, coordinate2))
    turned = as_law(ratio, f"ratio of {where}") * second
    return Holonomic(name, first - turned - as_law(phase, f"phase of {where}"))


@constructor
def belt(
    name: str,
    coordinate1: str,
    radius1: LawLike,
    coordinate2: str,
    radius2: LawLike,
    *,
    crossed: bool = False,
    phase: LawLike = 0.0,
) -> Holonomic:
    """A belt or chain over two pulleys: r1 q1 = ± r2 q2 + phase (one row, m), − where it is `crossed`.

    Both turn about parallel axes on one carrier. Radii are numbers or parameters, m; `phase` is a length of
    belt, m, and may be a law of t. A sliding coordinate counts as a pulley of radius 1: a rack, or a rope.
    """
    where = Holonomic.called(name)
    first, second = (
        positive(radius, f"{which} of {where}") * symbol_of(f"q.{coordinate}")
        for which, radius, coordinate in (
            ("radius1", radius1, coordinate1),
            ("radius2", radius2, coordinate2),
        )
    )
    sign = -1 if crossed else 1
    return Holonomic(name, first - sign * second - as_law(phase, f"phase of {where}"))


@constructor
def differential(
    name: str,
    coordinate1: str,
    coordinate2: str,
    carrier: str,
    ratio: LawLike = 1.0,
    phase: LawLike = 0.0,
) -> Holonomic:
    """A differential or planetary gear: (q1 − qc) + ratio (q2 − qc) = phase (one row; Willis 1841).

    All three angles are measured from the housing, about one axis. Bevel gears of a car's differential have
    the ratio 1: the carrier turns by the mean of both. A planetary gear has z2/z1, the teeth of its ring by
    those of its sun.
    """
    where = Holonomic.called(name)
    q1, q2, qc = (symbol_of(f"q.{c}") for c in (coordinate1, coordinate2, carrier))
    geared = as_law(ratio, f"ratio of {where}")
    return Holonomic(name, (q1 - qc) + geared * (q2 - qc) - as_law(phase, f"phase of {where}"))


@constructor
def bevel_gear(
    name: str,
    coordinate1: str,
    teeth1: LawLike,
    coordinate2: str,
    teeth2: LawLike,
    phase: LawLike = 0.0,
) -> Holonomic:
    """Two toothed wheels that mesh from outside, bevel or spur: teeth1 q1 + teeth2 q2 = teeth1 phase.

    Each angle is about its own axis on one carrier. Both axes point away from where they meet (of spur gears:
    in one direction), so that the wheels turn in opposite senses. One row, of the angle q1.
    """
    where = Holonomic.called(name)
    first, second = (positive(z, f"teeth of {where}") for z in (teeth1, teeth2))
    return gear(name, coordinate1, coordinate2, -second / first, phase)


@constructor
@dataclass(frozen=True)
class MotionConstraint(Constraint):
    """Any A(q, t) v + b(q, t) = 0: a law of t, q, u that is linear in the speeds ``u.<speed>``."""

    name: str
    law: LawOfMotion

    noun = "motion constraint"

    def check(self, scope: Scope) -> None:
        """InputError for unknown symbols, and a law that is not linear in the speeds."""
        import sympy

        super().check(scope)
        speeds = [s for s in getattr(self.law, "free_symbols", ()) if s.name.startswith("u.")]
        if not speeds:
            raise ModelError(f"law of {self.where}: {self.law} holds no speed u.<name>")
        for a in speeds:
            for b in speeds:
                if sympy.simplify(sympy.diff(self.law, a, b)) != 0:
                    raise ModelError(
                        f"law of {self.where}: {self.law} is not linear in {a}; only "
                        "A(q, t) v + b(q, t) = 0 is a simple nonholonomic constraint"
                    )

    def motions(self, scene: Scene) -> list[Expr]:
        """The law."""
        return [scene.number(self.law)]


@constructor
@dataclass(frozen=True)
class Rolling(Constraint):
    """A wheel, disc or sphere rolls without slip on a plane of the body `on`.

    The wheel turns about `axis` through its `centre`; its edge is a torus with circle radius `radius`
    and tube radius `tube`: a disc has a `radius`, a torus-edged wheel both, a sphere `tube` alone. The
    plane goes through `point` with unit `normal` (both in the frame of `on`; `point` may be a law of t).
    One holonomic row keeps contact, two motion rows keep the contact points together: tangential velocities
    equal up to `surface_velocity`, three laws of t and of the contact point's x, y, z in the frame of `on`
    (m/s).
    """

    name: str
    body: AnyBody
    centre: Point = field(default=ZERO, kw_only=True)
    axis: Axis = field(default="y", kw_only=True)
    radius: NonNegative = 0.0
    tube: NonNegative = field(default=0.0, kw_only=True)
    on: AnyBody = field(default=GROUND, kw_only=True)
    point: PointOfTime = field(default=ZERO, kw_only=True)
    normal: Axis = field(default="z", kw_only=True)
    surface_velocity: VectorOfSurface = field(default=ZERO, kw_only=True)

    noun = "rolling constraint"
    bodies = ("body", "on")

    def __post_init__(self) -> None:
        super().__post_init__()
        if is_zero(self.radius) and is_zero(self.tube):
            raise ModelError(
                f"{self.where}: give a radius (disc, wheel) or a tube radius (sphere) above zero"
            )

    def positions(self, scene: Scene) -> list[Expr]:
        """The height above the plane."""
        return [self._contact(scene)[0]]

    def motions(self, scene: Scene) -> list[Expr]:
        """The slip velocity along two tangents of the plane."""
        point = self.contact_point(scene)
        x = scene.local(self.on, point)
        surface = scene.vector(self.surface_velocity, {"x": x[0], "y": x[1], "z": x[2]})
        slip = scene.velocity(self.body, point) - scene.velocity(self.on, point)
        slip = slip - scene.rotation(self.on) @ surface
        tangents = (scene.axis(self.on, n) for n in perpendiculars(self.normal))
        return [scene.dot(tangent, slip) for tangent in tangents]

    def contact_point(self, scene: Scene) -> Expr:
        """Where the wheel touches its plane, world components."""
        return self._contact(scene)[1]

    def _contact(self, scene: Scene) -> tuple[Expr, Expr]:
        """Height above the plane, and the contact point."""
        n = scene.axis(self.on, self.normal)
        centre = scene.place(self.body, self.centre)
        radius, tube = scene.number(self.radius), scene.number(self.tube)
        point = centre - tube * n
        height = scene.dot(centre - scene.place(self.on, self.point), n) - tube
        if not is_zero(self.radius):
            a = scene.axis(self.body, self.axis)
            lean = scene.dot(n, a)
            sine = scene.sqrt(1 - lean**2)
            point = point - radius * (n - lean * a) / sine
            height = height - radius * sine
        return height, point


@constructor
@dataclass(frozen=True)
class Skate(Constraint):
    """A blade: the velocity of a point of `body` relative to `on` has no component along `lateral`.

    `lateral` is a direction fixed in `body`, perpendicular to the blade; `drift` (m/s) is the lateral
    velocity that is kept, a law of t (zero for a blade at rest in the ice).
    """

    name: str
    body: AnyBody
    point: Point = field(default=ZERO, kw_only=True)
    lateral: Axis = field(default="y", kw_only=True)
    on: AnyBody = field(default=GROUND, kw_only=True)
    drift: LawOfTime = field(default=0.0, kw_only=True)

    noun = "skate constraint"
    bodies = ("body", "on")

    def motions(self, scene: Scene) -> list[Expr]:
        """The slip velocity along `lateral`, less the drift."""
        x = scene.place(self.body, self.point)
        slip = scene.velocity(self.body, x) - scene.velocity(self.on, x)
        return [scene.dot(scene.axis(self.body, self.lateral), slip) - scene.number(self.drift)]


@constructor
@dataclass(frozen=True)
class HigherPair(Constraint):
    """Surfaces of two bodies touch where the origin of the body `at` is, and may roll on each other there.

    `surface1`, `surface2` are laws of x, y, z in the frame of each body, and t, that vanish on the surface.
    The point lies on both, and their normals are parallel there: four rows, of which three determine the
    point, so `at` is a massless frame that moves freely, on three prismatic joints say. `along`, a direction
    fixed in `body2` and nowhere normal to its surface, gives the tangents in which normals and slip are
    compared. With `rolling` two motion rows keep the contact points together; spin about the normal is free.

    For example a wheel's cone on the round head of a rail, or an ellipsoid on a plane:
    ``higher_pair("contact", "egg", "(x/2)**2 + y**2 + z**2 - 1", "ground", "z", at="mark")``.
    """

    name: str
    body1: AnyBody
    surface1: LawOfSurface
    body2: AnyBody
    surface2: LawOfSurface
    at: AnyBody = field(kw_only=True)
    along: Axis = field(default="x", kw_only=True)
    rolling: bool = field(default=False, kw_only=True)

    noun = "higher pair"
    bodies = ("body1", "body2")

    def positions(self, scene: Scene) -> list[Expr]:
        """How far the point is from either surface (m, to first order), and sines of the normals' angle."""
        height1, n1 = self._at_surface(scene, self.body1, self.surface1)
        height2, _ = self._at_surface(scene, self.body2, self.surface2)
        return [height1, height2, *(scene.dot(n1, tangent) for tangent in self._tangents(scene))]

    def motions(self, scene: Scene) -> list[Expr]:
        """The slip velocity along both tangents, if it rolls."""
        if not self.rolling:
            return []
        point = scene.place(self.at, ZERO)
        slip = scene.velocity(self.body1, point) - scene.velocity(self.body2, point)
        return [scene.dot(tangent, slip) for tangent in self._tangents(scene)]

    def _at_surface(self, scene: Scene, body: str, surface: Any) -> tuple[Expr, Expr]:
        """The law by its slope, and the unit normal in world components, at the point."""
        law, fall, _ = scene.field(surface, scene.local(body, scene.place(self.at, ZERO)))
        slope = scene.sqrt(scene.dot(fall, fall))
        return law / slope, scene.rotation(body) @ (fall / slope)

    def _tangents(self, scene: Scene) -> tuple[Expr, Expr]:
        """Unit tangents of the second surface: nearest to `along`, and across it."""
        _, n = self._at_surface(scene, self.body2, self.surface2)
        across = scene.cross(n, scene.axis(self.body2, self.along))
        across = across / scene.sqrt(scene.dot(across, across))
        return scene.cross(across, n), across


def _entries(column: Expr) -> list[Expr]:
    return [column[k] for k in range(column.shape[0])]


def _along(n: Direction) -> Any:
    """n·(x, y, z) as a law."""
    return sum((c * symbol_of(x) for c, x in zip(n, "xyz") if c != 0.0), start=0.0)


def perpendiculars(n: Direction) -> tuple[Direction, Direction]:
    """Two unit vectors that make a right-handed frame with the unit vector n."""
    k = min(range(3), key=lambda i: abs(n[i]))
    e = [float(i == k) for i in range(3)]
    dot = sum(a * b for a, b in zip(e, n))
    first = unit_vector([e[i] - dot * n[i] for i in range(3)], "direction")
    second: Direction = tuple(np.cross(n, first).tolist())
    return first, second


angle = Angle
distance = Distance
higher_pair = HigherPair
holonomic = Holonomic
motion_constraint = MotionConstraint
point_on = PointOn
rolling = Rolling
skate = Skate
