"""Shapes of bodies, for contact: sphere, point, capsule, box, and the half-space behind a plane.

A shape is fixed in its body's frame (or the ground's) by `position`, and by `rotation`, `axis` or
`normal`. It carries no mass; one body may carry several. Dimensions are numbers, or expressions in the
mechanism's parameters. A `Visual` says what a body looks like, for pictures alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, TypeAlias

from deltac.errors import ModelError
from deltac.mechanism.laws import LawLike, VectorLike
from deltac.mechanism.parts import (
    Axis,
    Declared,
    FieldKind,
    NonNegative,
    Point,
    Positive,
    Rotation,
    constructor,
)
from deltac.mechanism.quantities import (
    IDENTITY,
    ZERO,
    AxisLike,
    Matrix,
    Quantity,
    RotationLike,
    Vector,
    part_name,
    positive,
    vector,
)
from deltac.mechanism.scope import Scope

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def _body(value: Any, where: str) -> str:
    return part_name(value, "the body of a shape")


def _edges(value: Any, where: str) -> Vector:
    a, b, c = (
        positive(edge, f"{where}, component {x}") for edge, x in zip(vector(value, where), "xyz")
    )
    return (a, b, c)


@dataclass(frozen=True)
class Shape(Declared):
    """What a shape is fixed to: a `body`, and a `position` (m) in its frame."""

    noun: ClassVar[str]
    body: Annotated[str, FieldKind(_body)]
    position: Point

    @property
    def where(self) -> str:
        """The shape, as messages call it."""
        return f"{self.noun} of body {self.body!r}"

    @property
    def sizes(self) -> tuple[Quantity, ...]:
        """Its dimensions (m)."""
        return ()

    def check(self, scope: Scope, where: str) -> None:
        """InputError where a shape and the mechanism do not fit: unknown body, unknown symbols, no size."""
        of = f"the {self.noun} of {self.body!r} in {where}"
        scope.body(self.body, f"body of {of}")
        self.check_fields(scope, of)


@dataclass(frozen=True)
class Sphere(Shape):
    """A ball of `radius` (m) about `position`; of radius 0 it is a point."""

    radius: NonNegative

    noun = "sphere shape"

    @property
    def sizes(self) -> tuple[Quantity, ...]:
        """Its radius."""
        return (self.radius,)

    @property
    def is_point(self) -> bool:
        """Whether it was made as a point."""
        return isinstance(self.radius, float) and self.radius == 0.0

    def check(self, scope: Scope, where: str) -> None:
        """InputError as for any shape; a radius may be zero of a point only."""
        super().check(scope, where)
        name = f"radius of the sphere of {self.body!r} in {where}"
        scope.positive(self.radius, name, allow_zero=self.is_point)


@dataclass(frozen=True)
class Capsule(Shape):
    """All within `radius` of a segment of `length` (m) along the unit `axis`, centred at `position`."""

    axis: Axis
    radius: Positive
    length: Positive

    noun = "capsule shape"

    @property
    def sizes(self) -> tuple[Quantity, ...]:
        """Radius and length."""
        return (self.radius, self.length)


@dataclass(frozen=True)
class Box(Shape):
    """A box with edges `size` (m) along the columns of `rotation`, centred at `position`."""

    rotation: Rotation
    size: Annotated[Any, FieldKind(_edges, "constants", "positive")]

    noun = "box shape"

    @property
    def sizes(self) -> tuple[Quantity, ...]:
        """Its edges."""
        return tuple(self.size)


@dataclass(frozen=True)
class HalfSpace(Shape):
    """The plane through `position` and all that lies behind it; the unit `normal` points out of it."""

    normal: Axis

    noun = "half-space"


@constructor
def point(body: str, position: VectorLike = ZERO) -> Sphere:
    """A point of a body (or of the ground), as a sphere of radius 0."""
    return Sphere(body, position, 0.0)


@constructor
def sphere(body: str, radius: LawLike, position: VectorLike = ZERO) -> Sphere:
    """A sphere of `radius` (m) about `position` in the body's frame."""
    return Sphere(body, position, positive(radius, f"radius of sphere shape of body {body!r}"))


@constructor
def capsule(
    body: str,
    radius: LawLike,
    length: LawLike,
    axis: AxisLike = "x",
    position: VectorLike = ZERO,
) -> Capsule:
    """A capsule: a cylinder of `radius` and `length` (m) with half spheres on its ends.

    `position` is its middle and `axis` its direction, in the body's frame.
    """
    return Capsule(body, position, axis, radius, length)


@constructor
def box(
    body: str, size: VectorLike, position: VectorLike = ZERO, rotation: RotationLike = None
) -> Box:
    """A box with edges `size` (m), its middle at `position`, turned by `rotation` in the body's frame."""
    return Box(body, position, rotation, size)


@constructor
def half_space(
    body: str = "ground", normal: AxisLike = "z", position: VectorLike = ZERO
) -> HalfSpace:
    """The plane through `position` and all that is behind it; `normal` points out of the matter.

    On the ground it is a floor or a wall; on a body that moves, a moving plane.
    """
    return HalfSpace(body, position, normal)


def check_pair(first: Shape, second: Shape, where: str) -> None:
    """InputError for two shapes between which no contact is defined."""
    for shape in (first, second):
        if not isinstance(shape, Shape):
            raise ModelError(
                f"{where}: expected a shape such as deltac.shapes.sphere('ball', 0.1), found {shape!r}"
            )
    if first.body == second.body:
        raise ModelError(
            f"{where}: both shapes belong to {first.body!r}, so they cannot move against each other"
        )
    if isinstance(first, HalfSpace) and isinstance(second, HalfSpace):
        raise ModelError(f"{where}: two half-spaces meet nowhere or without end; give one a box")
    if all(isinstance(shape, Sphere) and shape.is_point for shape in (first, second)):
        raise ModelError(f"{where}: two points never touch; give one of them a radius")


# --- what bodies look like: no mechanics --------------------------------------------------------

VisualKind: TypeAlias = Literal[
    "sphere", "box", "capsule", "cylinder", "ellipsoid", "mesh", "plane"
]


@dataclass(frozen=True, eq=False)
class Visual:
    """A shape of a body, in numbers, fixed in the body's frame.

    Attributes:
        body: which body, or "ground".
        kind: "sphere", "box", "capsule", "cylinder", "ellipsoid", "mesh" or "plane".
        size: m; sphere (radius,), box its three edges, capsule and cylinder (radius, length) along the third
            axis, ellipsoid its three half axes, plane its two edges (0 for one without end), its normal the
            third axis; mesh ().
        position: of its middle, m.
        rotation: its axes as columns.
        colour: red, green, blue, opacity, from 0 to 1; None for whatever suits.
        vertices: of a mesh (n, 3), m, in the shape's axes; `faces` (m, 3) their indices.
        name: what the file calls it.
    """

    body: str
    kind: VisualKind
    size: tuple[float, ...] = ()
    position: Vector = ZERO
    rotation: Matrix = IDENTITY
    colour: tuple[float, float, float, float] | None = None
    vertices: NDArray[np.float64] | None = None
    faces: NDArray[np.intp] | None = None
    name: str = ""
