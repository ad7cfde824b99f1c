"""Numbers of a description: a float, or an expression in the mechanism's named parameters.

Every dimension, mass or coefficient may be written ``0.25``, ``"l2/2"`` or as a SymPy expression;
names are resolved by the mechanism that holds the part. Vectors are tuples of three of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.calls.arguments import checked
from deltac.errors import ModelError, UnknownName
from deltac.mechanism.laws import VectorLike, as_law

RotationLike: TypeAlias = "Sequence[Sequence[float]] | Sequence[float] | NDArray[Any] | None"
"""What users may give for a rotation: see `as_rotation`."""

AxisLike: TypeAlias = "str | Sequence[float] | NDArray[Any]"
"""What users may give for a direction: `"x"`, `"-y"`, …, or three numbers."""

Quantity: TypeAlias = Any
"""A float, or a SymPy expression."""

Vector: TypeAlias = tuple[Quantity, Quantity, Quantity]
Matrix: TypeAlias = tuple[Vector, Vector, Vector]

AXES: dict[str, tuple[float, float, float]] = {
    "x": (1.0, 0.0, 0.0),
    "y": (0.0, 1.0, 0.0),
    "z": (0.0, 0.0, 1.0),
    "-x": (-1.0, 0.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
    "-z": (0.0, 0.0, -1.0),
}
IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
ZERO: Vector = (0.0, 0.0, 0.0)


def part_name(name: object, what: str) -> str:
    """The name of a part; InputError says what `what` (as in "a joint") needs."""
    if not isinstance(name, str) or not name.strip() or name != name.strip():
        raise ModelError(f"{what} needs a name without surrounding blanks, found {name!r}")
    return name


def vector(value: VectorLike, where: str) -> Vector:
    """Three quantities; InputError names `where` when there are not three."""
    single = (
        isinstance(value, str) or not hasattr(value, "__len__") or getattr(value, "ndim", 1) == 0
    )
    entries = () if single else tuple(value)
    if len(entries) != 3:
        raise ModelError(f"{where}: expected three components, found {value!r}")
    x, y, z = (as_law(entry, f"{where}, component {c}") for entry, c in zip(entries, "xyz"))
    return (x, y, z)


def unit_vector(value: AxisLike, where: str) -> tuple[float, float, float]:
    """A direction: ``"x"``, ``"-z"``, … or three numbers of any length but zero (normalised)."""
    if isinstance(value, str):
        if value not in AXES:
            raise UnknownName(f"{where}: unknown axis {value!r}; known: {', '.join(AXES)}")
        return AXES[value]
    entries = vector(value, where)
    if not all(isinstance(entry, float) for entry in entries):
        raise ModelError(f"{where}: an axis must be of plain numbers, found {value!r}")
    length = math.hypot(*entries)
    if not length > 0.0:
        raise ModelError(f"{where}: the axis {tuple(entries)} has no direction (length 0)")
    # A unit vector stays what it is, to the last bit: parts are read again when they are copied.
    if abs(length - 1.0) < 1e-15:
        length = 1.0
    x, y, z = (entry / length for entry in entries)
    return (x, y, z)


def as_rotation(value: Any, where: str) -> Matrix:
    """A rotation from three by three numbers, or from a unit quaternion (scalar first).

    Its columns are the turned axes. InputError when it is not a rotation to 1e-6.
    """
    if value is None:
        return IDENTITY
    try:
        r = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        r = np.zeros(0)
    if r.shape == (4,):
        return _from_quaternion(r.tolist(), where)
    if r.shape != (3, 3) or not np.isfinite(r).all():
        raise ModelError(
            f"{where}: expected a 3 by 3 rotation matrix or a quaternion (w, x, y, z), of finite numbers"
        )
    error, determinant = np.abs(r.T @ r - np.eye(3)).max(), np.linalg.det(r)
    if not (error < 1e-6 and determinant > 0.0):
        raise ModelError(
            f"{where}: the matrix is not a rotation (its columns depart from orthonormal by {error:.3g}, "
            f"its determinant is {determinant:.3g}); give an orthonormal matrix, a quaternion, or "
            "deltac.rotation_matrix(axis, angle)"
        )
    a, b, c = ((x, y, z) for x, y, z in r.tolist())
    return (a, b, c)


@checked
def rotation_matrix(axis: AxisLike, angle: float) -> Matrix:
    """The matrix of a turn by `angle` (rad, right-handed) about `axis`: for joints, shapes, loops."""
    n = unit_vector(axis, "rotation")
    if not math.isfinite(angle):
        raise ModelError(f"rotation: the angle is {angle}; expected a finite number of radians")
    half = 0.5 * float(angle)
    w, s = math.cos(half), math.sin(half)
    return _from_quaternion([w, s * n[0], s * n[1], s * n[2]], "rotation")


def _from_quaternion(q: list[float], where: str) -> Matrix:
    norm = math.hypot(*q)
    if not abs(norm - 1.0) < 1e-6:
        raise ModelError(
            f"{where}: the quaternion {tuple(q)} has length {norm:.6g}; expected 1 (scalar first)"
        )
    w, x, y, z = (entry / norm for entry in q)
    return (
        (w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z),
    )


def is_zero(law: Quantity) -> bool:
    """Whether it is the number zero; an expression may be zero by the present values of parameters only."""
    return isinstance(law, float | int) and law == 0


def positive(value: Any, where: str, *, allow_zero: bool = False) -> Quantity:
    """A quantity that must be positive; expressions are checked where parameters are known."""
    quantity = as_law(value, where)
    if isinstance(quantity, float):
        require_positive(quantity, where, allow_zero=allow_zero)
    return quantity


def require_positive(value: float, where: str, *, allow_zero: bool = False) -> None:
    """InputError unless `value` is positive (or zero, if allowed)."""
    if value > 0.0 or (allow_zero and value == 0.0):
        return
    expected = "zero or a positive number" if allow_zero else "a positive number"
    raise ModelError(f"{where}: found {value:g}, expected {expected}")
