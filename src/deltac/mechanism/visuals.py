"""What bodies look like: shapes for pictures, without any mechanics. Importers take them from their files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

from deltac.mechanism.quantities import IDENTITY, ZERO, Matrix, Vector

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

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
