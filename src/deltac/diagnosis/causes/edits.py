"""Edits: mechanisms that are built anew with another place, axis, size or number.

Columns are of first order at the model that they are written out of. A cause of the geometry knows how to
build the mechanism with its numbers θ, and its columns there: ∂/∂θ of what is built.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from scipy.linalg import expm

from deltac.arrays import ROUNDED, Array
from deltac.diagnosis.causes.columns import UNIT_MOMENTS, Column, LogEquations
from deltac.diagnosis.causes.geometry import displacements, with_numbers
from deltac.diagnosis.causes.masses import BodyMass, steiner
from deltac.mechanism.joints import Joint
from deltac.mechanism.mechanism import Mechanism


class Edit(Protocol):
    """What builds a mechanism with other numbers θ (d,)."""

    def mechanism(self, of: Mechanism, theta: Array) -> Mechanism:
        """The mechanism with these numbers; `of` has them at zero."""
        ...

    def weights(self, at: LogEquations, theta: Array) -> Mapping[Column, Array]:
        """∂/∂θ (d,) as coefficients of columns, at equations of a mechanism that was built with θ."""
        ...

    def only(self, some: Sequence[int]) -> Edit:
        """Of some of the numbers."""
        ...


def _tuples(x: Array) -> tuple[Any, ...]:
    return tuple(map(tuple, x.tolist()))


def _cross(w: Array) -> Array:
    return np.asarray(np.cross(np.eye(3), w))


def _turn(w: Array) -> Array:
    """The rotation by a rotation vector."""
    return np.asarray(expm(_cross(w)))


def _left_jacobian(w: Array) -> Array:
    """J with exp(w + dw) = exp(J dw) exp(w): (eˣ − 1)/x of the cross matrix, a corner of an exponential."""
    if not w.any():
        return np.eye(3)
    block = np.zeros((6, 6))
    block[:3, :3], block[:3, 3:] = _cross(w), np.eye(3)
    return np.asarray(expm(block)[:3, 3:])


@dataclass(frozen=True, eq=False)
class Displaced:
    """A joint displaced in its parent, or the child on it: by translations, and rotations about the joint.

    `parent` and `child` (6, d) by units of θ, along the axes of these bodies; None for nothing.
    """

    joint: str
    parent: Array | None
    child: Array | None

    def only(self, some: Sequence[int]) -> Displaced:
        """Of some of the numbers."""
        parent, child = (None if x is None else x[:, some] for x in (self.parent, self.child))
        return Displaced(self.joint, parent, child)

    def mechanism(self, of: Mechanism, theta: Array) -> Mechanism:
        """The mechanism with these numbers."""
        joint = of.joint(self.joint)
        changes = dict[str, object]()
        if self.parent is not None:
            move, turn = np.split(self.parent @ theta, 2)
            changes["position"] = tuple(_moved(of, joint.position, move))
            changes["rotation"] = _tuples(_turn(turn) @ np.array(joint.rotation))
        if self.child is not None:
            move, turn = np.split(self.child @ theta, 2)
            changes["child_position"] = tuple(_moved(of, joint.child_position, -move))
            changes["child_rotation"] = _tuples(_turn(-turn) @ np.array(joint.child_rotation))
        other = replace(joint, **changes)  # type: ignore[arg-type]
        return replace(of, joints=[other if j is joint else j for j in of.joints])

    def weights(self, at: LogEquations, theta: Array) -> Mapping[Column, Array]:
        """∂/∂θ as coefficients of columns of the joint."""
        joint = at.mechanism.joint(self.joint)
        sides = zip(("joint-place", "body-place"), (self.parent, self.child), (1.0, -1.0))
        system = at.symbols.system
        of_sides = system.once(("displacements", self.joint), lambda: displacements(system, joint))
        weights = dict[Column, Array]()
        for (what, unit, sign), motion in zip(sides, of_sides, strict=True):
            if unit is None:
                continue
            turning = _left_jacobian(sign * unit[3:] @ theta) @ unit[3:]
            rows = motion @ np.concatenate([unit[:3], turning])
            rows[np.abs(rows) <= ROUNDED] = 0.0  # of products of rotations
            some = np.flatnonzero(rows.any(axis=1))
            weights |= {Column(what, self.joint, int(k)): rows[k] for k in some}  # type: ignore[arg-type]
        return weights


def _moved(of: Mechanism, place: Sequence[Any], by: Array) -> list[Any]:
    """A place displaced; numbers that stay remain what they are, as parameters."""
    return [of.number(x) + d if d else x for x, d in zip(place, by.tolist())]


@dataclass(frozen=True, eq=False)
class Stretched:
    """A body 1 + θ times as long about its joint: with the joints on it, its mass centre and inertia."""

    body: str

    def only(self, some: Sequence[int]) -> Stretched:
        """Of its one number."""
        return self

    def mechanism(self, of: Mechanism, theta: Array) -> Mechanism:
        """The mechanism with this number."""
        size, body = 1.0 + float(theta[0]), of.body(self.body)
        carrier = next(j for j in of.joints if j.child == self.body)
        origin = np.array([of.number(x) for x in carrier.child_position])

        def stretched(place: Sequence[Any]) -> tuple[float, ...]:
            x = np.array([of.number(n) for n in place])
            return tuple((origin + size * (x - origin)).tolist())

        inertia = np.array([[of.number(x) for x in row] for row in body.inertia])
        first, second, third = _tuples(size**2 * inertia)
        other = replace(
            body, mass_centre=stretched(body.mass_centre), inertia=(first, second, third)
        )
        return replace(
            of,
            bodies=[other if b is body else b for b in of.bodies],
            joints=[
                replace(j, position=stretched(j.position)) if j.parent == self.body else j
                for j in of.joints
            ],
        )

    def weights(self, at: LogEquations, theta: Array) -> Mapping[Column, Array]:
        """∂/∂θ as coefficients of columns of the body's inertia and of the joints on it."""
        mechanism, system = at.mechanism, at.symbols.system
        own = BodyMass.of(system.links[system.index[self.body]])
        mass, centre = own.mass, own.centre
        about = own.central + mass * steiner(centre)
        weights = {
            Column("inertia", self.body, 1 + k): float(x) for k, x in enumerate(mass * centre)
        }
        weights |= {
            Column("inertia", self.body, 4 + k): 2.0 * float(about[i, j])
            for k, (i, j) in enumerate(UNIT_MOMENTS)
        }
        for joint in mechanism.children[self.body]:
            moved = displacements(system, joint)[0][:, :3] @ np.array(bar_of(mechanism, joint))
            weights |= {Column("joint-place", joint.name, k): float(x) for k, x in enumerate(moved)}
        size = 1.0 + float(theta[0])
        return {c: np.array([x / size]) for c, x in weights.items() if x}


@dataclass(frozen=True, eq=False)
class Renumbered:
    """Numbers of elements and constraints, by their addresses, larger by θ."""

    addresses: tuple[str, ...]

    def only(self, some: Sequence[int]) -> Renumbered:
        """Of some of the numbers."""
        return Renumbered(tuple(self.addresses[k] for k in some))

    def mechanism(self, of: Mechanism, theta: Array) -> Mechanism:
        """The mechanism with these numbers."""
        return with_numbers(of, dict(zip(self.addresses, theta.tolist(), strict=True)))

    def weights(self, at: LogEquations, theta: Array) -> Mapping[Column, Array]:
        """Each number has a column of its own."""
        rows = np.eye(len(self.addresses))
        return {Column("number", name): row for name, row in zip(self.addresses, rows, strict=True)}


@dataclass(frozen=True, eq=False)
class Reparametrised:
    """A named parameter of the mechanism, larger by θ."""

    name: str

    def only(self, some: Sequence[int]) -> Reparametrised:
        """Of its one number."""
        return self

    def mechanism(self, of: Mechanism, theta: Array) -> Mechanism:
        """The mechanism with this value."""
        return of.with_parameters(**{self.name: of.parameters[self.name] + float(theta[0])})

    def weights(self, at: LogEquations, theta: Array) -> Mapping[Column, Array]:
        """The column of the parameter."""
        return {Column("parameter", self.name): np.ones(1)}


def bar_of(mechanism: Mechanism, joint: Joint) -> Array | None:
    """From the joint that carries a joint's parent to it, along the parent's axes; None on the ground."""
    carrier = next((j for j in mechanism.joints if j.child == joint.parent), None)
    if carrier is None:
        return None
    ends = ([mechanism.number(x) for x in p] for p in (carrier.child_position, joint.position))
    start, end = map(np.array, ends)
    return np.asarray(end - start)
