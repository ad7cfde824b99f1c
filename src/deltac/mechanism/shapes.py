"""Shapes of bodies, for contact: sphere, point, capsule, box, and the half-space behind a plane.

A shape is fixed in its body's frame (or the ground's) by `position`, and by `rotation`, `axis` or
`normal`. It carries no mass; one body may carry several. Dimensions are numbers, or expressions in the
mechanism's parameters. A `Visual` says what a body looks like, for pictures alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from deltac.errors import ModelError, UnknownName, closest
from deltac.mechanism.parts import constructor
from deltac.mechanism.quantities import (
    IDENTITY,
    ZERO,
    Matrix,
    Quantity,
    Vector,
    as_rotation,
    part_name,
    positive,
    unit_vector,
    vector,
)
from deltac.mechanism.scope import GROUND, Scope

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Sphere:
    """A ball of `radius` (m) about `position`; of radius 0 it is a point."""

    body: str
    position: Vector
    radius: Quantity

    @property
    def sizes(self) -> tuple[Quantity, ...]:
        """Its dimensions (m)."""
        return (self.radius,)


@dataclass(frozen=True)
class Capsule:
    """All within `radius` of a segment of `length` (m) along the unit `axis`, centred at `position`."""

    body: str
    position: Vector
    axis: tuple[float, float, float]
    radius: Quantity
    length: Quantity

    @property
    def sizes(self) -> tuple[Quantity, ...]:
        """Its dimensions (m)."""
        return (self.radius, self.length)


@dataclass(frozen=True)
class Box:
    """A box with edges `size` (m) along the columns of `rotation`, centred at `position`."""

    body: str
    position: Vector
    rotation: Matrix
    size: Vector

    @property
    def sizes(self) -> tuple[Quantity, ...]:
        """Its dimensions (m)."""
        return self.size


@dataclass(frozen=True)
class HalfSpace:
    """The plane through `position` and all that lies behind it; the unit `normal` points out of it."""

    body: str
    position: Vector
    normal: tuple[float, float, float]

    @property
    def sizes(self) -> tuple[Quantity, ...]:
        """It has none."""
        return ()


Shape: TypeAlias = Sphere | Capsule | Box | HalfSpace


@constructor
def point(body: str, position: Sequence[Any] = ZERO) -> Sphere:
    """A point of a body (or of the ground), as a sphere of radius 0."""
    where = f"point shape of body {part_name(body, 'the body of a shape')!r}"
    return Sphere(body, vector(position, f"position of {where}"), 0.0)


@constructor
def sphere(body: str, radius: Any, position: Sequence[Any] = ZERO) -> Sphere:
    """A sphere of `radius` (m) about `position` in the body's frame."""
    where = f"sphere shape of body {part_name(body, 'the body of a shape')!r}"
    return Sphere(
        body, vector(position, f"position of {where}"), positive(radius, f"radius of {where}")
    )


@constructor
def capsule(
    body: str,
    radius: Any,
    length: Any,
    axis: str | Sequence[float] = "x",
    position: Sequence[Any] = ZERO,
) -> Capsule:
    """A capsule: a cylinder of `radius` and `length` (m) with half spheres on its ends.

    `position` is its middle and `axis` its direction, in the body's frame.
    """
    where = f"capsule shape of body {part_name(body, 'the body of a shape')!r}"
    return Capsule(
        body,
        vector(position, f"position of {where}"),
        unit_vector(axis, f"axis of {where}"),
        positive(radius, f"radius of {where}"),
        positive(length, f"length of {where}"),
    )


@constructor
def box(
    body: str, size: Sequence[Any], position: Sequence[Any] = ZERO, rotation: Any = None
) -> Box:
    """A box with edges `size` (m), its middle at `position`, turned by `rotation` in the body's frame."""
    where = f"box shape of body {part_name(body, 'the body of a shape')!r}"
    a, b, c = (
        positive(s, f"size of {where}, component {x}")
        for s, x in zip(vector(size, f"size of {where}"), "xyz")
    )
    return Box(
        body,
        vector(position, f"position of {where}"),
        as_rotation(rotation, f"rotation of {where}"),
        (a, b, c),
    )


@constructor
def half_space(
    body: str = "ground", normal: str | Sequence[float] = "z", position: Sequence[Any] = ZERO
) -> HalfSpace:
    """The plane through `position` and all that is behind it; `normal` points out of the matter.

    On the ground it is a floor or a wall; on a body that moves, a moving plane.
    """
    where = f"half-space of body {part_name(body, 'the body of a shape')!r}"
    return HalfSpace(
        body, vector(position, f"position of {where}"), unit_vector(normal, f"normal of {where}")
    )


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
    if _is_point(first) and _is_point(second):
        raise ModelError(f"{where}: two points never touch; give one of them a radius")


def check_shape(scope: Scope, shape: Shape, where: str) -> None:
    """InputError where a shape and the mechanism do not fit: unknown body, unknown symbols, no size."""
    names = [GROUND, *scope.bodies]
    if shape.body not in names:
        raise UnknownName(
            f"{where}: a shape belongs to the unknown body {shape.body!r}{closest(shape.body, names)}"
        )
    of = f"the {_WORDS[type(shape)]} of {shape.body!r} in {where}"
    scope.laws((*shape.position, *shape.sizes), scope.constants, of)
    for size in shape.sizes:
        scope.positive(size, f"a size of {of}", allow_zero=_is_point(shape))


def _is_point(shape: Shape) -> bool:
    return isinstance(shape, Sphere) and isinstance(shape.radius, float) and shape.radius == 0.0


_WORDS = {Sphere: "sphere", Capsule: "capsule", Box: "box", HalfSpace: "half-space"}


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
