"""Gaps between shapes in symbols: where they may touch, how far apart they are, which way they part.

For a pair of shapes: a list of potential contact points, each with the signed gap g (m, negative where
the shapes overlap), the unit normal n from the second shape to the first, and the place of the contact
halfway between the two surface points. On the line through both, n·(v1 − v2) = ġ, so that a force f(g) n
on the first body and its opposite on the second have the potential −∫ f dg, exactly.

| pair | points |
|---|---|
| sphere and sphere, capsule, box, half-space | 1: the closest |
| capsule and capsule | 1: the closest; of parallel ones some closest pair |
| capsule and half-space | 2: the ends |
| box and half-space | 8: the corners |
| capsule and box | 10: the capsule's ends against the box, the box's corners against the capsule |
| box and box | 16: the corners of each against the other |

Not seen: an edge of a box across an edge of another box, or across a capsule's side. Inside a box the gap
is measured to the nearest face, and the normal jumps where the nearest face changes. Where two features
see the same overlap (corner on corner), both count.

Closest points of segments: C. Ericson, Real-Time Collision Detection (2005), section 5.1.9; all clamps are
fmin, fmax, and no branch divides by zero.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, TypeAlias

import casadi as ca

from deltac.arrays import ROUNDED
from deltac.dynamics.points import PlacedPoint, rotation
from deltac.dynamics.spatial import SX, cross
from deltac.dynamics.system import System
from deltac.mechanism.shapes import Box, Capsule, HalfSpace, Shape, Sphere

NO_DIRECTION = ROUNDED**2
"""Squared distances (m²) below this have no direction; then a fixed one is taken."""


@dataclass(frozen=True)
class Gap:
    """A potential contact point of two shapes, in symbols of the state; world components.

    `gap` g (m) is negative where the shapes overlap; the unit normal `n` (3,) points from the second to
    the first; `on_first`, `on_second` (3,) are the places of the two surface points, and `place` (3,) the
    one halfway between. `links` are the places of the bodies in `System.links` (−1: ground). `label` says
    which point of the pair it is ("corner +-+").
    """

    label: str
    gap: SX
    n: SX
    on_first: SX
    on_second: SX
    system: System
    links: tuple[int, int]

    @property
    def place(self) -> SX:
        """Where the contact is: halfway between the surface points."""
        return 0.5 * (self.on_first + self.on_second)

    @property
    def points(self) -> tuple[PlacedPoint, PlacedPoint]:
        """The material points of the first and the second body at `place`."""
        first, second = (PlacedPoint.at(self.system, k, self.place) for k in self.links)
        return first, second

    @property
    def relative_velocity(self) -> SX:
        """Velocity (3,) of the first body's material point at `place` relative to the second's."""
        first, second = self.points
        return first.velocity - second.velocity

    def loads(self, force: SX) -> list[tuple[PlacedPoint, SX]]:
        """`force` (3,) on the first body, its opposite on the second."""
        first, second = self.points
        return [(first, force), (second, -force)]


def gaps(system: System, first: Shape, second: Shape) -> tuple[Gap, ...]:
    """All potential contact points of two shapes, in an order that never changes."""
    one, other = _placed(system, first), _placed(system, second)
    links = (system.index[first.body], system.index[second.body])
    order = list(_AGAINST)
    flipped = order.index(type(first)) > order.index(type(second))
    if flipped:
        one, other = other, one
    distances = []
    for label, g, n, point in _pair(one, other):
        # The point lies on the first of the pair; the other surface is g away along n.
        ends = (point, point - g * n)
        if flipped:
            n, ends = -n, (ends[1], ends[0])
        distances.append(Gap(label, g, n, *ends, system, links))
    return tuple(distances)


def sliding_point(
    system: System, body: str, point: Sequence[object], on: str, normal: Sequence[float]
) -> Gap:
    """Where a point of a body slides on a plane of another: a contact point that is always closed."""
    place = PlacedPoint(system, *system.point(body, point)).place
    n = ca.mtimes(rotation(system, on), ca.SX(ca.DM(list(normal))))
    links = (system.index[body], system.index[on])
    return Gap("", ca.SX(0), n, place, place, system, links)


@dataclass(frozen=True)
class _Placed:
    """A shape in the world: its origin, the turn of its body, and its dimensions in symbols."""

    shape: Any
    origin: SX
    turned: SX
    sizes: tuple[SX, ...]

    @property
    def direction(self) -> SX:
        """The axis of a capsule, the normal of a half-space; world components."""
        own = self.shape.axis if isinstance(self.shape, Capsule) else self.shape.normal
        return ca.mtimes(self.turned, ca.DM(list(own)))

    @property
    def axes(self) -> SX:
        """The axes of a box as columns; world components."""
        return ca.mtimes(self.turned, ca.DM([list(row) for row in self.shape.rotation]))

    @property
    def balls(self) -> Iterator[tuple[str, SX, SX]]:
        """What a shape is made of against others: label, centre and radius.

        The ball itself, a capsule's ends, a box's corners by the signs of their coordinates.
        """
        if isinstance(self.shape, Sphere):
            yield "", self.origin, self.sizes[0]
        elif isinstance(self.shape, Capsule):
            half = 0.5 * self.sizes[1] * self.direction
            yield "end +", self.origin + half, self.sizes[0]
            yield "end -", self.origin - half, self.sizes[0]
        else:
            axes = self.axes
            for signs in product((1, -1), repeat=3):
                half = ca.vertcat(*(0.5 * s * size for s, size in zip(signs, self.sizes)))
                name = "".join("+" if s > 0 else "-" for s in signs)
                yield f"corner {name}", self.origin + ca.mtimes(axes, half), ca.SX(0)


def _placed(system: System, shape: Shape) -> _Placed:
    origin = PlacedPoint(system, *system.point(shape.body, shape.position)).place
    sizes = tuple(system.number(size) for size in shape.sizes)
    return _Placed(shape, origin, rotation(system, shape.body), sizes)


# --- a ball against a shape: gap, normal from the shape to the ball, surface point of the ball ---------

_Surface: TypeAlias = tuple[SX, SX, SX]


def _ball_plane(centre: SX, radius: SX, plane: _Placed) -> _Surface:
    n = plane.direction
    return ca.dot(n, centre - plane.origin) - radius, n, centre - radius * n


def _ball_ball(c1: SX, r1: SX, c2: SX, r2: SX) -> _Surface:
    n, distance = _direction(c1 - c2, ca.DM([0.0, 0.0, 1.0]))
    return distance - r1 - r2, n, c1 - r1 * n


def _ball_sphere(centre: SX, radius: SX, sphere: _Placed) -> _Surface:
    return _ball_ball(centre, radius, sphere.origin, sphere.sizes[0])


def _ball_box(centre: SX, radius: SX, box: _Placed) -> _Surface:
    """Outside to the nearest point of the box, inside to the nearest face."""
    axes = box.axes
    c = ca.mtimes(axes.T, centre - box.origin)
    half = [0.5 * size for size in box.sizes]
    nearest = ca.vertcat(*(_clamp(c[i], half[i]) for i in range(3)))
    depth = [half[i] - ca.fabs(c[i]) for i in range(3)]
    least = ca.fmin(ca.fmin(depth[0], depth[1]), depth[2])
    # The first face that is nearest: exactly one of the three.
    x = depth[0] <= least
    y = ca.logic_and(ca.logic_not(x), depth[1] <= least)
    z = ca.logic_not(ca.logic_or(x, y))
    face = ca.vertcat(*(ca.if_else(hit, _sign(c[i]), 0) for i, hit in enumerate((x, y, z))))
    away = c - nearest
    n_out, distance = _direction(away, ca.SX.zeros(3))
    outside = ca.dot(away, away) > NO_DIRECTION
    n = ca.mtimes(axes, ca.if_else(outside, n_out, face))
    return ca.if_else(outside, distance, -least) - radius, n, centre - radius * n


def _ball_capsule(centre: SX, radius: SX, capsule: _Placed) -> _Surface:
    a = capsule.direction
    s = _clamp(ca.dot(a, centre - capsule.origin), 0.5 * capsule.sizes[1])
    return _ball_ball(centre, radius, capsule.origin + s * a, capsule.sizes[0])


def _capsule_capsule(one: _Placed, other: _Placed) -> _Surface:
    a, b, between = one.direction, other.direction, one.origin - other.origin
    h_a, h_b = 0.5 * one.sizes[1], 0.5 * other.sizes[1]
    cosine, along_a, along_b = ca.dot(a, b), ca.dot(a, between), ca.dot(b, between)
    # Each centre line is nearest to the other where both derivatives of the distance vanish; parallel
    # lines are everywhere, so they start from the middle of the first. Then each in turn, clamped.
    sine2 = ca.sumsqr(cross(a, b))
    parallel = sine2 < NO_DIRECTION
    s = ca.if_else(parallel, 0, (cosine * along_b - along_a) / ca.if_else(parallel, 1, sine2))
    s = _clamp(s, h_a)
    t = _clamp(along_b + s * cosine, h_b)
    s = _clamp(t * cosine - along_a, h_a)
    near_a, near_b = one.origin + s * a, other.origin + t * b
    return _ball_ball(near_a, one.sizes[0], near_b, other.sizes[0])


_AGAINST: dict[type, Callable[[SX, SX, _Placed], _Surface]] = {
    Sphere: _ball_sphere,
    Capsule: _ball_capsule,
    Box: _ball_box,
    HalfSpace: _ball_plane,
}
"""Of two shapes, the one that comes first here is made of balls."""


def _pair(one: _Placed, other: _Placed) -> Iterator[tuple[str, SX, SX, SX]]:
    """Contact points: label, gap, normal from the second to the first, surface point of the first."""
    if isinstance(one.shape, Capsule) and isinstance(other.shape, Capsule):
        yield ("", *_capsule_capsule(one, other))
        return
    alike = type(one.shape) is type(other.shape) is Box
    for label, centre, radius in one.balls:
        place = f"first's {label}" if alike else label
        yield (place, *_AGAINST[type(other.shape)](centre, radius, other))
    if isinstance(other.shape, Box) and not isinstance(one.shape, Sphere):
        for label, corner, radius in other.balls:
            g, n, _ = _AGAINST[type(one.shape)](corner, radius, one)
            yield f"second's {label}" if alike else label, g, -n, corner - g * n


def _clamp(x: SX, half: SX) -> SX:
    return ca.fmin(ca.fmax(x, -half), half)


def _sign(x: SX) -> SX:
    """Of zero it is +1: a normal must have a length."""
    return ca.if_else(x < 0, -1, 1)


def _direction(d: SX, otherwise: SX) -> tuple[SX, SX]:
    """Unit vector along d and its length; of nearly no length, `otherwise` and 0."""
    square = ca.dot(d, d)
    far = square > NO_DIRECTION
    length = ca.sqrt(ca.if_else(far, square, 1))
    return ca.if_else(far, d / length, otherwise), ca.if_else(far, length, 0)
