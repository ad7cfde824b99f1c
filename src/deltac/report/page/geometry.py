"""What bodies look like: shapes of files and contacts, else what their inertia is that of; what ties them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from deltac.arrays import Array
from deltac.mechanism import (
    GROUND,
    Body,
    Box,
    Capsule,
    Distance,
    HalfSpace,
    Loop,
    Mechanism,
    PointOn,
    Shape,
    Sphere,
    SpringDamper,
    Tendon,
    Visual,
)
from deltac.report.page.parts import Numbers

FACES = 1500
"""Triangles of a mesh that a page holds, at most; finer ones are made coarser."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A shape as the page draws it; mesh vertices and faces are flat."""

    kind: str
    size: tuple[float, ...]
    position: tuple[float, ...]
    rotation: tuple[float, ...]
    colour: tuple[float, ...] | None = None
    vertices: Numbers | None = None
    faces: tuple[int, ...] | None = None


@dataclass(frozen=True, eq=False)
class Drawn:
    """A body: its name, its shapes, the joint that carries it, and whether its looks are its inertia's."""

    name: str
    forms: tuple[Solid, ...]
    carried: dict[str, Any] | None
    inferred: bool
    tip: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Tie:
    """Something between points of bodies: a spring, a tendon, a rod, a loop that is closed."""

    kind: Literal["spring", "tendon", "rod", "loop"]
    name: str
    points: tuple[tuple[int, tuple[float, ...]], ...]


def drawn_bodies(mechanism: Mechanism, size: float) -> Iterator[Drawn]:
    """The ground and all bodies as they are drawn, in a mechanism of that size (m)."""
    own: dict[str, list[Solid]] = {GROUND: [], **{body.name: [] for body in mechanism.bodies}}
    for visual in mechanism.visuals:
        own[visual.body].append(_form(visual))
    for shape in contact_shapes(mechanism):
        if not any(v.body == shape.body for v in mechanism.visuals):
            own[shape.body] += [
                f for f in _contact_form(mechanism, shape) if f not in own[shape.body]
            ]
    carrier = {joint.child: joint for joint in mechanism.joints}
    yield Drawn(GROUND, tuple(own[GROUND]), None, False, (0.0, 0.0, 0.0))
    for body in mechanism.bodies:
        forms, joint = own[body.name], carrier[body.name]
        place = numbers(mechanism, joint.child_position)
        inferred = not forms
        if not mechanism.visuals:  # else a body without looks is meant to have none
            forms = [*forms, *_inertial(mechanism, body, place, size, solid=inferred)]
        axis = joint.axes[0] if joint.axes else None
        carried = {
            "name": joint.name,
            "kind": joint.kind,
            "parent": joint.parent,
            "position": listed(place),
            "axis": None
            if axis is None
            else listed(np.array(joint.child_rotation, dtype=float) @ np.array(axis)),
        }
        yield Drawn(body.name, tuple(forms), carried, inferred, _tip(mechanism, body))


def _form(visual: Visual) -> Solid:
    vertices = faces = None
    if visual.vertices is not None and visual.faces is not None:
        points, triangles = coarser(visual.vertices, visual.faces, FACES)
        vertices, faces = Numbers(points), tuple(int(i) for i in triangles.ravel())
    return Solid(
        visual.kind,
        visual.size,
        listed(np.array(visual.position, dtype=float)),
        quaternion(np.array(visual.rotation, dtype=float)),
        visual.colour,
        vertices,
        faces,
    )


def coarser(vertices: Array, faces: Any, most: int) -> tuple[Array, Any]:
    """A mesh of at most `most` triangles, by vertex clustering: those in a cell of a grid become one."""
    cells = 64
    while len(faces) > most and cells >= 4:
        low, extent = vertices.min(axis=0), max(float(np.ptp(vertices, axis=0).max()), 1e-300)
        cell = np.minimum(((vertices - low) / extent * cells).astype(np.intp), cells - 1)
        _, merged = np.unique(cell @ np.array([1, cells, cells * cells]), return_inverse=True)
        counts = np.bincount(merged)
        vertices = np.column_stack([np.bincount(merged, vertices[:, k]) / counts for k in range(3)])
        faces = merged[faces]
        real = (
            (faces[:, 0] != faces[:, 1])
            & (faces[:, 1] != faces[:, 2])
            & (faces[:, 2] != faces[:, 0])
        )
        faces = np.unique(faces[real], axis=0)
        cells = int(cells / 1.4)
    return vertices, faces


def contact_shapes(mechanism: Mechanism) -> Iterator[Shape]:
    """The shapes that touch, of contacts and impacts."""
    for part in (*mechanism.elements, *mechanism.events):
        for name in ("first", "second"):
            shape = getattr(part, name, None)
            if isinstance(shape, Sphere | Capsule | Box | HalfSpace):
                yield shape


def _contact_form(mechanism: Mechanism, shape: Shape) -> Iterator[Solid]:
    at = listed(numbers(mechanism, shape.position))
    sizes = tuple(float(mechanism.number(s)) for s in shape.sizes)
    if isinstance(shape, Sphere) and sizes[0] > 0.0:
        yield Solid("sphere", sizes, at, (0.0, 0.0, 0.0, 1.0))
    elif isinstance(shape, Capsule):
        yield Solid("capsule", sizes, at, quaternion(frame_of(np.array(shape.axis))))
    elif isinstance(shape, Box):
        yield Solid("box", sizes, at, quaternion(np.array(shape.rotation, dtype=float)))
    elif isinstance(shape, HalfSpace):
        yield Solid("plane", (0.0, 0.0), at, quaternion(frame_of(np.array(shape.normal))))


def _inertial(
    mechanism: Mechanism, body: Body, place: Array, size: float, solid: bool
) -> Iterator[Solid]:
    """What a body's inertia is that of, and thin rods from its joint to its mass centre and other joints."""
    thin = 0.011 * size
    centre = numbers(mechanism, body.mass_centre)
    half, axes = np.zeros(3), np.eye(3)
    reached = _attached(mechanism, body)
    if not body.massless and solid:
        half, axes = _box(mechanism, body)
        reached.append(centre)
        if half.max() <= 1e-3 * size or _hides(half, [place, *reached]):
            half = np.zeros(3)
            yield Solid("sphere", (2.6 * thin,), listed(centre), (0.0, 0.0, 0.0, 1.0))
        elif half[1] <= 0.05 * half[2]:  # a rod
            turn = quaternion(frame_of(axes[:, 2]))
            yield Solid("capsule", (1.7 * thin, 2.0 * float(half[2])), listed(centre), turn)
        else:
            yield _round_or_box(half, axes, centre, thin)
    allowed = 1.02 * half + 0.02 * half.max()
    for end in reached:
        inside = all(np.all(np.abs(axes.T @ (p - centre)) <= allowed) for p in (place, end))
        if np.linalg.norm(end - place) > 0.02 * size and not inside:
            yield _stick(place, end, thin)


def _attached(mechanism: Mechanism, body: Body) -> list[Array]:
    """Where a body is joined to others: by joints, constraints, springs and tendons."""
    ends: tuple[tuple[str, Sequence[Any]], ...]
    points: list[Sequence[Any]] = [j.position for j in mechanism.children[body.name]]
    for part in (*mechanism.constraints, *mechanism.elements):
        if isinstance(part, Distance | Loop | SpringDamper):
            ends = ((part.body1, part.point1), (part.body2, part.point2))
        elif isinstance(part, PointOn):
            ends = ((part.body, part.point),)
        else:
            continue
        points += [p for name, p in ends if name == body.name and constant(mechanism, p)]
    return [numbers(mechanism, point) for point in points]


def _hides(half: Array, points: Sequence[Array]) -> bool:
    """Whether a shape of this inertia would hide the body's own points, so that it is not how it looks.

    Data of plane mechanisms have one moment of inertia, which is often put in for all three; other data have
    moments that are much too large. A wheel about its hub has no points apart.
    """
    spread = max(float(np.linalg.norm(a - b)) for a in points for b in points)
    ball = half[2] - half[0] < 1e-6 * half[2]
    return bool(spread > 0.1 * half[2] and half[2] > (0.3 if ball else 2.0) * spread)


def _round_or_box(half: Array, axes: Array, centre: Array, thin: float) -> Solid:
    """A ball where all half edges are the same, a disc or drum where two are, else a box."""
    a, b, c = half
    if c - a < 1e-6 * c:  # a uniform ball of the same moments: 2/5 r² = 2/3 h²
        return Solid(
            "sphere", (float(c * np.sqrt(5.0 / 3.0)),), listed(centre), (0.0, 0.0, 0.0, 1.0)
        )
    if c - b < 1e-6 * c:  # flat: r²/4 = h²/3 across, thickness along the smallest
        size = (float(b * np.sqrt(4.0 / 3.0)), max(2.0 * float(a), thin))
        return Solid("cylinder", size, listed(centre), quaternion(frame_of(axes[:, 0])))
    if b - a < 1e-6 * c:  # long
        size = (max(float(a * np.sqrt(4.0 / 3.0)), thin), 2.0 * float(c))
        return Solid("cylinder", size, listed(centre), quaternion(frame_of(axes[:, 2])))
    turn = axes * np.array([1.0, 1.0, np.sign(np.linalg.det(axes))])
    edges = tuple(max(2.0 * float(h), thin) for h in half)
    return Solid("box", edges, listed(centre), quaternion(turn))


def _box(mechanism: Mechanism, body: Body) -> tuple[Array, Array]:
    """Half edges (3,), smallest first, and axes of the uniform box of the same mass and inertia."""
    tensor = np.array([[mechanism.number(x) for x in row] for row in body.inertia], dtype=float)
    moments, axes = np.linalg.eigh(tensor)
    mass = float(mechanism.number(body.mass))
    if mass <= 0.0:
        return np.zeros(3), np.eye(3)
    squares = 1.5 * (moments.sum() - 2.0 * moments) / mass  # half edge² = 3/2 (Ij + Ik − Ii)/m
    half = np.sqrt(np.maximum(squares, 0.0))
    order = np.argsort(half, kind="stable")
    return half[order], axes[:, order]


def _stick(start: Array, end: Array, radius: float) -> Solid:
    along = end - start
    length = float(np.linalg.norm(along))
    return Solid(
        "capsule", (radius, length), listed((start + end) / 2), quaternion(frame_of(along / length))
    )


def _tip(mechanism: Mechanism, body: Body) -> tuple[float, ...]:
    """The point of a body that is farthest from the joint that carries it."""
    joint = next(j for j in mechanism.joints if j.child == body.name)
    place = numbers(mechanism, joint.child_position)
    points = corners(mechanism, body)[1:]
    return listed(points[int(np.argmax(np.linalg.norm(points - place, axis=1)))])


def trails(
    mechanism: Mechanism, bodies: Sequence[Drawn]
) -> Iterator[tuple[int, tuple[float, ...]]]:
    """The ends of the tree's branches, six at most."""
    ends = [i for i, body in enumerate(bodies) if i and not mechanism.children[body.name]]
    for i in ends[:6]:
        yield i, bodies[i].tip


def ties(mechanism: Mechanism) -> Iterator[Tie]:
    """Springs, tendons, massless rods and closed loops."""
    place = {GROUND: 0, **{body.name: i for i, body in enumerate(mechanism.bodies, 1)}}

    def at(body: str, point: Sequence[Any]) -> tuple[int, tuple[float, ...]]:
        return place[body], listed(numbers(mechanism, point))

    for element in mechanism.elements:
        if isinstance(element, SpringDamper):
            ends = (at(element.body1, element.point1), at(element.body2, element.point2))
            yield Tie("spring", element.name, ends)
        elif isinstance(element, Tendon):
            for branch in element.branches:
                yield Tie("tendon", element.name, tuple(at(b, p) for b, p in branch.points))
    for constraint in mechanism.constraints:
        if isinstance(constraint, Distance | Loop):
            kind: Literal["rod", "loop"] = "rod" if isinstance(constraint, Distance) else "loop"
            points = (constraint.point1, constraint.point2)
            if all(constant(mechanism, p) for p in points):
                ends = (at(constraint.body1, points[0]), at(constraint.body2, points[1]))
                yield Tie(kind, constraint.name, ends)


def constant(mechanism: Mechanism, point: Sequence[Any]) -> bool:
    """Whether a point is fixed in its body."""
    return all(mechanism.scope.is_constant(x) for x in point)


def corners(mechanism: Mechanism, body: Body) -> Array:
    """Points of a body: its frame, its mass centre, where its joints are, the ends of its looks."""
    own = [np.zeros(3), numbers(mechanism, body.mass_centre)]
    own += _attached(mechanism, body)
    for visual in mechanism.visuals:
        if visual.body == body.name and visual.kind != "plane":
            own += _ends(visual)
    if not body.massless and not any(v.body == body.name for v in mechanism.visuals):
        half, axes = _box(mechanism, body)
        if _hides(half, own):
            half = 0.0 * half
        for sign in (-1.0, 1.0):
            own += [own[1] + sign * h * axis for h, axis in zip(half, axes.T)]
    return np.array(own)


def _ends(visual: Visual) -> Iterator[Array]:
    """The corners of the box that holds a shape, in the body's frame."""
    high = np.ones(3)
    match visual.kind:
        case "sphere":
            high = high * visual.size[0]
        case "capsule":
            radius, length = visual.size
            high = np.array([radius, radius, length / 2 + radius])
        case "cylinder":
            radius, length = visual.size
            high = np.array([radius, radius, length / 2])
        case "mesh":
            high = np.zeros(3)
        case _:
            high = np.array(visual.size) * (0.5 if visual.kind == "box" else 1.0)
    low = -high
    if visual.vertices is not None and len(visual.vertices):
        low, high = visual.vertices.min(axis=0), visual.vertices.max(axis=0)
    turn, middle = np.array(visual.rotation, dtype=float), np.array(visual.position, dtype=float)
    for corner in np.ndindex(2, 2, 2):
        yield middle + turn @ np.where(corner, high, low)


def numbers(mechanism: Mechanism, point: Sequence[Any]) -> Array:
    """The values of a vector's quantities."""
    return np.array([mechanism.number(x) for x in point], dtype=float)


def listed(x: Array) -> tuple[float, ...]:
    """An array as numbers of Python."""
    return tuple(float(v) for v in x)


def frame_of(axis: Array) -> Array:
    """A rotation whose third column is the axis."""
    z = axis / np.linalg.norm(axis)
    helper = np.array([1.0, 0.0, 0.0]) if abs(z[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = np.cross(helper, z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def quaternion(rotation: Array) -> tuple[float, ...]:
    """Of a rotation matrix: x, y, z, w."""
    from scipy.spatial.transform import Rotation

    return listed(Rotation.from_matrix(rotation).as_quat())


def unit(x: Array) -> Array:
    """A vector of length 1 in its direction."""
    unit: Array = x / np.linalg.norm(x)
    return unit
