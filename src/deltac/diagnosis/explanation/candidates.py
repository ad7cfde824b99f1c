"""A candidate: a change of a mechanism that a person would name, one to six numbers θ.

A cause maps its numbers to coefficients of the columns, θ ↦ L θ + θᵀQθ: linear for almost all;
a mass centre that moves changes the moments of inertia about the joint by squares, and a delay has
f(t − τ) = f − τ ḟ + τ² f̈/2.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.diagnosis.explanation.columns import UNIT_MOMENTS, Column

Array: TypeAlias = NDArray[np.float64]
Sign = Literal["any", "positive", "factor"]

PREFERENCE = (
    "gravity",
    "mass-scale",
    "actuator-gear",
    "channel-factor",
    "body-inertia",
    "body-mass",
    "damping",
    "stiffness",
    "missing-damper",
    "missing-rotor-inertia",
    "armature",
    "body-centre",
    "body-moments",
    "body-moment",
    "missing-friction",
    "missing-spring",
    "rest-angle",
    "actuator-delay",
    "constant-force",
    "gravity-vector",
    "applied-force",
    "applied-moment",
    "thrust",
    "body-torque",
    "body-tensor",
)
"""Of causes that explain the same by as many numbers, the one that comes first is named first."""


_TELLS = {
    "mass-scale": "mJ",
    "body-inertia": "mJ",
    "body-mass": "m",
    "body-centre": "c",
    "body-moments": "J",
    "body-moment": "J",
    "body-tensor": "J",
}
"""Which of a body's mass, mass centre and central inertia a cause tells."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A cause that may be.

    kind, element   what it would be, and of which body, joint's speed or channel
    columns         places of its columns; coefficients are linear θ + θᵀ quadratic θ
    linear          (a, d); quadratic (a, d, d) or None
    names           of its d numbers
    base            what the model has of it (d,): values are base + θ
    units           of its d numbers
    sign            "positive": base + θ > 0; "factor": it is a factor between 0.1 and 10
    origin          "logged" or "computed" for channels
    limit           of |θ|
    """

    kind: str
    element: str
    columns: tuple[int, ...]
    linear: Array
    names: tuple[str, ...]
    base: Array
    units: tuple[str, ...]
    sign: Sign = "any"
    quadratic: Array | None = None
    origin: str = ""
    limit: float = np.inf

    @property
    def size(self) -> int:
        """How many numbers it has."""
        return int(self.linear.shape[1])

    def rank(self, theta: Array) -> int:
        """Order of preference of causes that explain the same; factors beyond two come late."""
        size = np.abs(self.base + theta)
        far = "1" in self.units and bool(np.any((size > 2.0) | (size < 0.5)))
        place: int = PREFERENCE.index(self.kind)
        return place + len(PREFERENCE) if far else place

    def coefficients(self, theta: Array) -> Array:
        """Coefficients (a,) of its columns."""
        made = self.linear @ theta
        if self.quadratic is not None:
            made = made + np.einsum("aij,i,j->a", self.quadratic, theta, theta)
        return np.asarray(made)

    def tangent(self, theta: Array) -> Array:
        """Their derivatives (a, d)."""
        if self.quadratic is None:
            return self.linear
        both = self.quadratic + self.quadratic.transpose(0, 2, 1)
        return np.asarray(self.linear + np.einsum("aij,j->ai", both, theta))

    def scales(self, other: Candidate) -> float:
        """By how much the coefficients of another cause grow with a unit of this one's number.

        A mass that is larger and moved has its product in the residual; so have gear and delay of a
        motor, stiffness and rest angle of a spring.
        """
        if other.kind == "body-centre" and (
            self.kind == "mass-scale"
            or (self.kind in ("body-mass", "body-inertia") and self.element == other.element)
        ):
            return 1.0
        if self.element != other.element:
            return 0.0
        if (self.kind, other.kind) == ("actuator-gear", "actuator-delay"):
            return 1.0
        if (self.kind, other.kind) == ("stiffness", "rest-angle"):
            return float(1.0 / self.base[0])
        return 0.0

    @property
    def of_a_body(self) -> bool:
        """Whether it tells a number of a body, and so may exclude others."""
        return self.kind in _TELLS

    def excludes(self, other: Candidate) -> bool:
        """Whether both together would tell one number of a body twice, in sentences that contradict."""
        here, there = _TELLS.get(self.kind, ""), _TELLS.get(other.kind, "")
        same = self.element == other.element or "mass-scale" in (self.kind, other.kind)
        if self.kind == other.kind == "body-moment":
            return self.names == other.names
        return same and any(told in there for told in here)

    def plausible(self, theta: Array) -> bool:
        """Whether the world could have it: dampers brake, masses stay within a decade."""
        value = self.base + theta
        if float(np.linalg.norm(theta)) > self.limit:
            return False
        if self.kind == "body-tensor":
            principal = np.linalg.eigvalsh(tensor(value))
            return bool(principal[0] > 0.0 and principal[2] <= principal[0] + principal[1])
        if self.sign == "positive":
            return bool(np.all(value > 0.0))
        return self.sign == "any" or bool(np.all((value > 0.1) & (value < 10.0)))


@dataclass(frozen=True)
class Places:
    """Where columns are."""

    of: Mapping[Column, int]

    def __call__(self, *columns: Column) -> tuple[int, ...] | None:
        """The places of columns, None where one is missing."""
        found = [self.of.get(c) for c in columns]
        return None if None in found else tuple(p for p in found if p is not None)


def one(
    kind: str,
    element: str,
    columns: tuple[int, ...] | None,
    weights: Sequence[float],
    name: str,
    base: float,
    unit: str,
    sign: Sign = "any",
    origin: str = "",
) -> Iterator[Candidate]:
    """A cause of one number, if its columns are there and not all weights zero."""
    L = np.array(weights, dtype=float)[:, None]
    if columns is not None and L.any():
        yield Candidate(
            kind, element, columns, L, (name,), np.array([base]), (unit,), sign, origin=origin
        )


def tensor(six: Array) -> Array:
    """The symmetric matrix of six moments and products of inertia."""
    J = np.zeros((3, 3))
    for value, (i, j) in zip(six, UNIT_MOMENTS):
        J[i, j] = J[j, i] = value
    return J
