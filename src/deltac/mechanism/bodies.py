"""Rigid bodies: mass, mass centre, central inertia; helpers for common shapes.

All vectors are components in the body frame, whose origin is wherever the user wants it; the
inertia is about the mass centre, along the axes of the body frame (kg·m²).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from deltac.arrays import max_norm
from deltac.errors import ModelError
from deltac.mechanism.laws import LawLike, VectorLike, as_law
from deltac.mechanism.parts import NonNegative, Part, Point, constructor
from deltac.mechanism.quantities import (
    ZERO,
    AxisLike,
    Matrix,
    Quantity,
    positive,
    unit_vector,
    vector,
)
from deltac.mechanism.scope import GROUND, Scope


@dataclass(frozen=True)
class Body(Part):
    """A rigid body; make it by `body`, `rod`, `box`, `disc`, `sphere`, `point_mass` or `frame`.

    `mass` (kg), `mass_centre` (m) from the body frame's origin, `inertia` about the mass centre
    (kg·m², 3 by 3, body components). `massless` marks a frame, which carries joints and points only.
    """

    name: str
    mass: NonNegative
    mass_centre: Point = ZERO
    inertia: Matrix = (ZERO, ZERO, ZERO)
    massless: bool = False

    noun = "body"

    def check(self, scope: Scope) -> None:
        """InputError if mass or inertia cannot belong to a rigid body, by the parameters' values."""
        super().check(scope)
        entries = [entry for row in self.inertia for entry in row]
        scope.laws(entries, scope.constants, f"inertia of {self.where}")
        if not self.massless:
            scope.positive(self.mass, f"mass of {self.where}")
            _check_inertia([[scope.number(e) for e in row] for row in self.inertia], self.name)


@constructor
def body(
    name: str,
    mass: LawLike,
    inertia: VectorLike | Sequence[VectorLike],
    mass_centre: VectorLike = ZERO,
) -> Body:
    """A body of any shape; `inertia` is three principal values or a symmetric 3 by 3 matrix.

    Raises InputError for a mass that is not positive, or an inertia that no rigid body can have:
    the principal moments obey I1 + I2 >= I3 in every order.
    """
    where = f"inertia of body {name!r}"
    rows = list(inertia) if hasattr(inertia, "__len__") else []
    if len(rows) == 3 and not any(
        hasattr(row, "__len__") and not isinstance(row, str) for row in rows
    ):
        a, b, c = vector(rows, where)
        tensor: Matrix = ((a, 0.0, 0.0), (0.0, b, 0.0), (0.0, 0.0, c))
    elif len(rows) == 3:
        first, second, third = (vector(row, where) for row in rows)
        tensor = (first, second, third)
    else:
        raise ModelError(
            f"{where}: expected three principal moments or a 3 by 3 matrix, found {inertia!r}"
        )
    part = Body(_name(name), positive(mass, f"mass of body {name!r}"), mass_centre, tensor)
    entries = [entry for row in tensor for entry in row]
    if all(isinstance(entry, float) for entry in entries):
        _check_inertia([list(row) for row in tensor], name)
    return part


@constructor
def rod(
    name: str,
    mass: LawLike,
    length: LawLike,
    along: AxisLike = "x",
    start: VectorLike = ZERO,
) -> Body:
    """A uniform slender rod from the point `start` along the direction `along`; I = m l²/12."""
    n = unit_vector(along, f"direction of rod {name!r}")
    m = positive(mass, f"mass of body {name!r}")
    l = positive(length, f"length of rod {name!r}")
    p = vector(start, f"start of rod {name!r}")
    centre = tuple(p[i] + 0.5 * l * n[i] for i in range(3))
    return body(name, m, _about_axis(m * l**2 / 12, 0.0, n), centre)


@constructor
def box(name: str, mass: LawLike, size: VectorLike, mass_centre: VectorLike = ZERO) -> Body:
    """A uniform box with edges `size` along the body axes, centred at `mass_centre`."""
    m = positive(mass, f"mass of body {name!r}")
    sides = vector(size, f"size of box {name!r}")
    a, b, c = (positive(side, f"size of box {name!r}") for side in sides)
    moments = (m * (b**2 + c**2) / 12, m * (a**2 + c**2) / 12, m * (a**2 + b**2) / 12)
    return body(name, m, moments, mass_centre)


@constructor
def disc(
    name: str,
    mass: LawLike,
    radius: LawLike,
    axis: AxisLike = "z",
    thickness: LawLike = 0.0,
    mass_centre: VectorLike = ZERO,
) -> Body:
    """A uniform disc (a cylinder of length `thickness`) about `axis`, centred at `mass_centre`."""
    m = positive(mass, f"mass of body {name!r}")
    r = positive(radius, f"radius of disc {name!r}")
    h = positive(thickness, f"thickness of disc {name!r}", allow_zero=True)
    n = unit_vector(axis, f"axis of disc {name!r}")
    return body(name, m, _about_axis(m * (3 * r**2 + h**2) / 12, m * r**2 / 2, n), mass_centre)


@constructor
def sphere(name: str, mass: LawLike, radius: LawLike, mass_centre: VectorLike = ZERO) -> Body:
    """A uniform solid sphere centred at `mass_centre`; I = 2/5 m r²."""
    m = positive(mass, f"mass of body {name!r}")
    r = positive(radius, f"radius of sphere {name!r}")
    moment = 2 * m * r**2 / 5
    return body(name, m, (moment, moment, moment), mass_centre)


@constructor
def point_mass(name: str, mass: LawLike, at: VectorLike = ZERO) -> Body:
    """A particle at the point `at` of its body frame; it has no inertia of its own."""
    return body(name, mass, ZERO, at)


@constructor
def frame(name: str) -> Body:
    """A massless frame: carries joints and points, as an intermediate of composed joints.

    Something with mass must be carried by it, or constraints must determine the joint that moves it.
    """
    return Body(_name(name), 0.0, massless=True)


def _name(name: Any) -> str:
    if name == GROUND:
        raise ModelError("no body may be called 'ground': that is the inertial frame's name")
    Body.called(name)
    return str(name)


def _about_axis(across: Quantity, along: Quantity, n: tuple[float, float, float]) -> Matrix:
    """Inertia of an axially symmetric body: `across` 1 + (`along` − `across`) n nᵀ."""
    across, along = as_law(across, "inertia"), as_law(along, "inertia")
    rows = []
    for i in range(3):
        row = [across * float(i == j) + (along - across) * (n[i] * n[j]) for j in range(3)]
        rows.append((row[0], row[1], row[2]))
    return (rows[0], rows[1], rows[2])


def _check_inertia(tensor: list[list[float]], name: str) -> None:
    import numpy as np

    where = f"inertia of body {name!r}"
    inertia = np.array(tensor, dtype=float)
    scale = max_norm(inertia)
    if scale == 0.0:
        return
    if np.abs(inertia - inertia.T).max() > 1e-9 * scale:
        raise ModelError(f"{where}: the matrix is not symmetric:\n{inertia}")
    principal = np.linalg.eigvalsh(inertia)
    # A thin plate or rod meets the bounds with equality, so rounding must be allowed for.
    if principal[0] < -1e-9 * scale:
        raise ModelError(f"{where}: the principal moment {principal[0]:.6g} kg·m² is negative")
    if principal[2] > principal[0] + principal[1] + 1e-9 * scale:
        a, b, c = principal
        raise ModelError(
            f"{where}: principal moments {a:.6g}, {b:.6g}, {c:.6g} kg·m² break the triangle "
            f"inequality ({a:.6g} + {b:.6g} < {c:.6g}); no rigid body has them. "
            "Is the inertia about the mass centre, and are the units kg·m²?"
        )
