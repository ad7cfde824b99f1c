"""Constraints: closed loops, guides, couplings, rolling and skating. Each may move in time.

A holonomic constraint keeps functions of (q, t) at zero; a motion constraint keeps functions linear in
the speeds at zero, A v + b = 0. Every length, angle or point component that is called a *law of t* may be
an expression of t and parameters: then the constraint is rheonomic (or acatastatic), and its force does
work. Points and axes are components in the body frame, or world components for the "ground".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from deltac.errors import ModelError
from deltac.mechanism.laws import as_law, symbol_names, symbol_of
from deltac.mechanism.quantities import (
    IDENTITY,
    ZERO,
    Matrix,
    Vector,
    as_rotation,
    is_zero,
    positive,
    unit_vector,
    vector,
)
from deltac.mechanism.scene import Constraint, Expr, Scene
from deltac.mechanism.scope import GROUND, Scope, constructor

Axis: TypeAlias = tuple[float, float, float]

NO_SINE = 1e-280
"""Keeps the slope of a sine finite (zero) where axes are parallel, where it has no direction."""


@dataclass(frozen=True)
class Loop(Constraint):
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

    noun = "loop constraint"

    def check(self, scope: Scope) -> None:
        """InputError for unknown bodies and symbols."""
        _bodies(scope, self.where, self.body1, self.body2)
        scope.laws((*self.point1, *self.point2), scope.in_time, f"a point of {self.where}")

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
    where = Loop.called(name)
    if body1 == body2:
        raise ModelError(f"{where} connects body {body1!r} with itself")
    return Loop(
        name,
        kind,
        body1,
        body2,
        vector(point1, f"point1 of {where}"),
        vector(point2, f"point2 of {where}"),
        unit_vector(axis1, f"axis1 of {where}"),
        unit_vector(axis1 if axis2 is None else axis2, f"axis2 of {where}"),
        IDENTITY if rotation is None else as_rotation(rotation, f"rotation of {where}"),
    )


@constructor
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


@constructor
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


@constructor
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


@constructor
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


@constructor
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


@dataclass(frozen=True)
class Distance(Constraint):
    """A massless rod: the distance of two points is `length` (m), a positive law of t."""

    name: str
    body1: str
    body2: str
    point1: Vector
    point2: Vector
    length: Any

    noun = "distance constraint"

    def check(self, scope: Scope) -> None:
        """InputError for unknown bodies and symbols."""
        _bodies(scope, self.where, self.body1, self.body2)
        scope.laws((*self.point1, *self.point2), scope.in_time, f"a point of {self.where}")
        scope.laws([self.length], scope.in_time, f"length of {self.where}")

    def positions(self, scene: Scene) -> list[Expr]:
        """(d·d − l²)/2l: smooth, and a length near the constraint."""
        gap = scene.place(self.body2, self.point2) - scene.place(self.body1, self.point1)
        length = scene.number(self.length)
        return [(scene.dot(gap, gap) - length**2) / (2 * length)]


@constructor
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
    where = Distance.called(name)
    return Distance(
        name,
        body1,
        body2,
        vector(point1, f"point1 of {where}"),
        vector(point2, f"point2 of {where}"),
        positive(length, f"length of {where}"),
    )


@dataclass(frozen=True)
class PointOn(Constraint):
    """A point of `body` lies on a surface or curve of the body `on`.

    `equations` are laws of x, y, z, the point's coordinates in the frame of `on`, and t; each is kept at
    zero: one for a surface, two for a curve.
    """

    name: str
    body: str
    point: Vector
    on: str
    equations: tuple[Any, ...]

    noun = "point-on constraint"

    def check(self, scope: Scope) -> None:
        """InputError for unknown bodies and symbols, and an equation without x, y, z."""
        _bodies(scope, self.where, self.body, self.on)
        scope.laws(self.point, scope.in_time, f"point of {self.where}")
        scope.laws(self.equations, (*"xyz", *scope.in_time), f"equation of {self.where}")
        for law in self.equations:
            if not symbol_names(law) & {"x", "y", "z"}:
                raise ModelError(f"equation of {self.where}: {law} holds none of x, y, z")

    def positions(self, scene: Scene) -> list[Expr]:
        """The equations at the point's coordinates in the frame of `on`."""
        x = scene.local(self.on, scene.place(self.body, self.point))
        return _entries(scene.vector(self.equations, {"x": x[0], "y": x[1], "z": x[2]}))


@constructor
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
    where = PointOn.called(name)
    given = equations if isinstance(equations, list | tuple) else (equations,)
    return PointOn(
        name,
        body,
        vector(point, f"point of {where}"),
        on,
        tuple(as_law(entry, f"equation of {where}") for entry in given),
    )


@constructor
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
    where = PointOn.called(name)
    return PointOn(
        name,
        body,
        vector(point, f"point of {where}"),
        on,
        (_along(unit_vector(normal, where)) - as_law(offset, f"offset of {where}"),),
    )


@constructor
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
    where = PointOn.called(name)
    start = vector(through, f"through of {where}")
    equations = []
    for n in perpendiculars(unit_vector(along, where)):
        equations.append(_along(n) - sum((c * s for c, s in zip(n, start)), start=0.0))
    return PointOn(name, body, vector(point, f"point of {where}"), on, (equations[0], equations[1]))


@dataclass(frozen=True)
class Angle(Constraint):
    """The angle between an axis of each of two bodies is `angle` (rad), a law of t, not 0 or π."""

    name: str
    body1: str
    body2: str
    axis1: Axis
    axis2: Axis
    angle: Any

    noun = "angle constraint"

    def check(self, scope: Scope) -> None:
        """InputError for unknown bodies and symbols."""
        _bodies(scope, self.where, self.body1, self.body2)
        scope.laws([self.angle], scope.in_time, f"angle of {self.where}")

    def positions(self, scene: Scene) -> list[Expr]:
        """α − angle (rad), α by sine and cosine: the cosine alone loses it, and its slope, towards 0 and π.

        The row then has the size of a turn whatever the angle, and its multiplier is a moment.
        """
        first, second = scene.axis(self.body1, self.axis1), scene.axis(self.body2, self.axis2)
        normal = scene.cross(first, second)
        sine = scene.sqrt(scene.dot(normal, normal) + NO_SINE)
        return [scene.atan2(sine, scene.dot(first, second)) - scene.number(self.angle)]


@constructor
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
    where = Angle.called(name)
    return Angle(
        name,
        body1,
        body2,
        unit_vector(axis1, f"axis1 of {where}"),
        unit_vector(axis2, f"axis2 of {where}"),
        as_law(angle, f"angle of {where}"),
    )


@dataclass(frozen=True)
class Holonomic(Constraint):
    """Any f(q, t) = 0: a law of t and the coordinates ``q.<coordinate>``."""

    name: str
    law: Any

    noun = "holonomic constraint"

    def check(self, scope: Scope) -> None:
        """InputError for unknown symbols, and a law without coordinates."""
        scope.laws([self.law], scope.in_place, f"law of {self.where}")
        if not any(name.startswith("q.") for name in symbol_names(self.law)):
            raise ModelError(f"law of {self.where}: {self.law} holds no coordinate q.<name>")

    def positions(self, scene: Scene) -> list[Expr]:
        """The law."""
        return [scene.number(self.law)]


@constructor
def holonomic(name: str, law: Any) -> Holonomic:
    """Keep any law of t and coordinates at zero (one row); see `Holonomic`."""
    return Holonomic(name, as_law(law, Holonomic.called(name)))


@constructor
def gear(name: str, coordinate1: str, coordinate2: str, ratio: Any, phase: Any = 0.0) -> Holonomic:
    """Couple two coordinates: q1 = ratio q2 + phase (one row)."""
    where = Holonomic.called(name)
    law = symbol_of(f"q.{coordinate1}") - as_law(ratio, f"ratio of {where}") * symbol_of(
        f"q.{coordinate2}"
    )
    return Holonomic(name, law - as_law(phase, f"phase of {where}"))


@dataclass(frozen=True)
class MotionConstraint(Constraint):
    """Any A(q, t) v + b(q, t) = 0: a law of t, q, u that is linear in the speeds ``u.<speed>``."""

    name: str
    law: Any

    noun = "motion constraint"

    def check(self, scope: Scope) -> None:
        """InputError for unknown symbols, and a law that is not linear in the speeds."""
        import sympy

        scope.laws([self.law], scope.in_motion, f"law of {self.where}")
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
def motion_constraint(name: str, law: Any) -> MotionConstraint:
    """Keep any law linear in the speeds at zero (one row); see `MotionConstraint`."""
    return MotionConstraint(name, as_law(law, MotionConstraint.called(name)))


@dataclass(frozen=True)
class Rolling(Constraint):
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

    noun = "rolling constraint"

    def check(self, scope: Scope) -> None:
        """InputError for unknown bodies and symbols."""
        _bodies(scope, self.where, self.body, self.on)
        scope.laws(self.centre, scope.constants, f"centre of {self.where}")
        scope.laws((self.radius, self.tube), scope.constants, f"radius of {self.where}")
        scope.laws(self.point, scope.in_time, f"point of {self.where}")
        velocity = (*"xyz", *scope.in_time)
        scope.laws(self.surface_velocity, velocity, f"surface velocity of {self.where}")

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
    where = Rolling.called(name)
    if body == on:
        raise ModelError(f"{where}: body {body!r} cannot roll on itself")
    circle = positive(radius, f"radius of {where}", allow_zero=True)
    edge = positive(tube, f"tube of {where}", allow_zero=True)
    if circle == 0.0 and edge == 0.0:
        raise ModelError(
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


@dataclass(frozen=True)
class Skate(Constraint):
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

    noun = "skate constraint"

    def check(self, scope: Scope) -> None:
        """InputError for unknown bodies and symbols."""
        _bodies(scope, self.where, self.body, self.on)
        scope.laws(self.point, scope.constants, f"point of {self.where}")
        scope.laws([self.drift], scope.in_time, f"drift of {self.where}")

    def motions(self, scene: Scene) -> list[Expr]:
        """The slip velocity along `lateral`, less the drift."""
        x = scene.place(self.body, self.point)
        slip = scene.velocity(self.body, x) - scene.velocity(self.on, x)
        return [scene.dot(scene.axis(self.body, self.lateral), slip) - scene.number(self.drift)]


@constructor
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
    where = Skate.called(name)
    return Skate(
        name,
        body,
        vector(point, f"point of {where}"),
        unit_vector(lateral, f"lateral of {where}"),
        on,
        as_law(drift, f"drift of {where}"),
    )


def _bodies(scope: Scope, where: str, *names: str) -> None:
    for name in names:
        scope.body(name, where)
    if all(name == GROUND for name in names):
        raise ModelError(f"{where} connects the ground with itself")


def _entries(column: Expr) -> list[Expr]:
    return [column[k] for k in range(column.shape[0])]


def _along(n: Axis) -> Any:
    """n·(x, y, z) as a law."""
    return sum((c * symbol_of(x) for c, x in zip(n, "xyz") if c != 0.0), start=0.0)


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
