"""Friction and contact of the textbook in plain NumPy: corners, edges and faces, looked at in turn."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any, TypeAlias

import numpy as np

from deltac.mechanism.contact import Contact
from deltac.mechanism.friction import FrictionLaw, JointFriction, PointFriction
from deltac.mechanism.laws import evaluate
from deltac.mechanism.shapes import Box, Capsule, HalfSpace, Shape, Sphere
from tests.oracles.textbook.kinematics import Array, numbers
from tests.oracles.textbook.situation import ChannelForce, Situation, between

Touch: TypeAlias = tuple[float, Array, Array]
"""Gap, unit normal from the second shape to the first, and the place halfway between the surfaces."""


def joint_friction(now: Situation, element: JointFriction) -> list[ChannelForce]:
    """Each speed by itself."""
    joint = now.mechanism.joint(element.joint)
    u = now.u[now.mechanism.speeds.of(joint.name)]
    tau = [-np.sign(v) * _friction(now, law, abs(v)) for v, law in zip(u, element.laws)]
    return [ChannelForce(f"friction {element.name}", between(now, joint, np.array(tau)))]


def point_friction(now: Situation, element: PointFriction) -> list[ChannelForce]:
    """Friction of a given normal force."""
    place = now.place(element.body, element.point)
    n = now.tree.frames[element.on].turned @ np.array(element.normal)
    N = max(evaluate(element.normal_force, now.known), 0.0)
    velocity = now.velocity(element.body, place) - now.velocity(element.on, place)
    force, nothing = -N * _drag(now, element.friction, n, velocity), np.zeros(3)
    acting = [(element.body, place, force, nothing), (element.on, place, -force, nothing)]
    return [ChannelForce(f"friction {element.name}", now.stack(acting))]


def contact(now: Situation, element: Contact) -> list[ChannelForce]:
    """All contact points of a pair of shapes, one after the other."""
    first, second = element.first.body, element.second.body
    k, n_exp, d = now.values([element.stiffness, element.exponent, element.dissipation])
    acting: dict[str, list[tuple[str, Array, Array, Array]]] = {
        kind: [] for kind in ("spring", "contact", "friction")
    }
    V = 0.0
    for gap, n, place in touches(now, element.first, element.second):
        if gap >= 0.0:
            continue
        velocity = now.velocity(first, place) - now.velocity(second, place)
        closing = -float(n @ velocity)
        elastic = k * (-gap) ** n_exp
        V += k * (-gap) ** (n_exp + 1) / (n_exp + 1)
        if element.model == "hunt-crossley":
            total = max(elastic * (1 + d * closing), 0.0)
        else:
            total = max(elastic + d * closing, 0.0)
        forces = {"spring": elastic * n, "contact": (total - elastic) * n}
        if element.friction is not None:
            forces["friction"] = -total * _drag(now, element.friction, n, velocity)
        for kind, force in forces.items():
            acting[kind].append((first, place, force, np.zeros(3)))
            acting[kind].append((second, place, -force, np.zeros(3)))
    made = [ChannelForce(f"spring {element.name}", now.stack(acting["spring"]), V)]
    if element.dissipation != 0.0:
        made.append(ChannelForce(f"contact {element.name}", now.stack(acting["contact"])))
    if element.friction is not None:
        made.append(ChannelForce(f"friction {element.name}", now.stack(acting["friction"])))
    return made


def _friction(now: Situation, law: FrictionLaw, v: float) -> float:
    """The strength of friction f(v), v >= 0."""
    c, s, b, w = now.values([law.coulomb, law.static, law.viscous, law.width])
    excess = 0.0
    if law.stribeck is not None:
        excess = (s - c) * math.exp(-((v / now.mechanism.number(law.stribeck)) ** 2))
    return float((c + excess) * math.tanh(v / w) + b * v)


def _drag(now: Situation, law: FrictionLaw, n: Array, velocity: Array) -> Array:
    """The direction of slip across n, times f of its speed."""
    slip = velocity - (n @ velocity) * n
    speed = math.sqrt(slip @ slip)
    drag: Array = np.zeros(3) if speed == 0.0 else _friction(now, law, speed) * slip / speed
    return drag


# --- where shapes touch ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Placed:
    """A shape in the world: middle, axes of its body as columns, dimensions."""

    shape: Any
    middle: Array
    turned: Array
    sizes: Array

    @property
    def corners(self) -> list[Array]:
        """The corners of a box, by the signs (+++, ++-, …)."""
        axes = self.turned @ np.array(self.shape.rotation)
        return [
            self.middle + axes @ (np.array(signs) * self.sizes / 2)
            for signs in product((1, -1), repeat=3)
        ]

    @property
    def ends(self) -> list[Array]:
        """The ends of a capsule's segment."""
        half = self.turned @ np.array(self.shape.axis) * self.sizes[1] / 2
        return [self.middle + half, self.middle - half]


def touches(now: Situation, first: Shape, second: Shape) -> Iterator[Touch]:
    """All contact points of two shapes."""
    one, other = (
        Placed(
            shape,
            now.place(shape.body, shape.position),
            now.tree.frames[shape.body].turned,
            numbers(now.mechanism, shape.sizes),
        )
        for shape in (first, second)
    )
    order = [Sphere, Capsule, Box, HalfSpace]
    if order.index(type(first)) <= order.index(type(second)):
        yield from _touches(one, other)
    else:
        for gap, n, place in _touches(other, one):
            yield gap, -n, place


def _touches(one: Placed, other: Placed) -> Iterator[Touch]:
    match one.shape, other.shape:
        case Sphere(), _:
            yield _ball(one.middle, one.sizes[0], other)
        case Capsule(), Capsule():
            yield _segments(one, other)
        case Capsule(), HalfSpace():
            for end in one.ends:
                yield _ball(end, one.sizes[0], other)
        case Capsule(), Box():
            for end in one.ends:
                yield _ball(end, one.sizes[0], other)
            for corner in other.corners:
                gap, n, place = _ball(corner, 0.0, one)
                yield gap, -n, place
        case Box(), HalfSpace():
            for corner in one.corners:
                yield _ball(corner, 0.0, other)
        case Box(), Box():
            for corner in one.corners:
                yield _ball(corner, 0.0, other)
            for corner in other.corners:
                gap, n, place = _ball(corner, 0.0, one)
                yield gap, -n, place


def _ball(centre: Array, radius: float, other: Placed) -> Touch:
    """A ball against any shape."""
    match other.shape:
        case Sphere():
            near, inside, reach = other.middle, False, other.sizes[0]
        case Capsule():
            near, inside, reach = _on_segment(centre, *other.ends), False, other.sizes[0]
        case Box():
            near, inside = _on_box(centre, other)
            reach = 0.0
        case _:
            n = other.turned @ np.array(other.shape.normal)
            height = float(n @ (centre - other.middle))
            return _touch(height - radius, n, centre - radius * n)
    distance = float(np.linalg.norm(centre - near))
    n = (centre - near) / distance
    if inside:
        n, distance = -n, -distance
    return _touch(distance - radius - reach, n, centre - radius * n)


def _touch(gap: float, n: Array, on_first: Array) -> Touch:
    return gap, n, on_first - 0.5 * gap * n


def _on_segment(point: Array, a: Array, b: Array) -> Array:
    """The nearest of: an end, the other end, the foot of the perpendicular where there is one."""
    d = b - a
    s = float(d @ (point - a)) / float(d @ d)
    candidates = [a, b] + ([a + s * d] if 0.0 < s < 1.0 else [])
    return min(candidates, key=lambda near: float(np.linalg.norm(point - near)))


def _on_box(point: Array, box: Placed) -> tuple[Array, bool]:
    """The nearest point of a box's surface, of all its faces, and whether the point is inside."""
    axes = box.turned @ np.array(box.shape.rotation)
    c, half = axes.T @ (point - box.middle), box.sizes / 2
    found = []
    for k, sign in product(range(3), (1, -1)):
        on_face = np.minimum(np.maximum(c, -half), half)
        on_face[k] = sign * half[k]
        found.append(on_face)
    near = min(found, key=lambda p: float(np.linalg.norm(c - p)))
    return box.middle + axes @ near, bool((np.abs(c) < half).all())


def _segments(one: Placed, other: Placed) -> Touch:
    """Two capsules: ends against the other's segment, and where the common perpendicular stands."""
    (a1, b1), (a2, b2) = one.ends, other.ends
    pairs = [(end, _on_segment(end, a2, b2)) for end in (a1, b1)]
    pairs += [(_on_segment(end, a1, b1), end) for end in (a2, b2)]
    d1, d2 = b1 - a1, b2 - a2
    A = np.column_stack([d1, -d2])
    (s, t), *_ = np.linalg.lstsq(A, a2 - a1, rcond=None)
    if 0.0 < s < 1.0 and 0.0 < t < 1.0:
        pairs.append((a1 + s * d1, a2 + t * d2))
    p1, p2 = min(pairs, key=lambda pair: float(np.linalg.norm(pair[0] - pair[1])))
    distance = float(np.linalg.norm(p1 - p2))
    n = (p1 - p2) / distance
    r1, r2 = one.sizes[0], other.sizes[0]
    return _touch(distance - r1 - r2, n, p1 - r1 * n)
