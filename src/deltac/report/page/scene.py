"""The mechanism as a page shows it moving: geometry, poses along the run, forces as arrows.

Poses are `analysis.kinematics` at the rows of the run, at as many instants as a page can hold; the browser
goes from one to the next in between. Bodies that nobody says the looks of are drawn as what their inertia
is that of: a rod, a disc, a ball, a box.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import casadi as ca
import numpy as np

from deltac.analysis.evaluate import Evaluation, evaluated
from deltac.analysis.kinematics import Kinematics
from deltac.analysis.model import Instants, instants
from deltac.arrays import Array
from deltac.dynamics.constraints import Scene as Places
from deltac.dynamics.equations_of_motion import equations_of_motion, evaluate_at
from deltac.mechanism.bodies import Body
from deltac.mechanism.channels import ChannelName
from deltac.mechanism.constraints import Distance, Loop, PointOn
from deltac.mechanism.contact import Contact
from deltac.mechanism.forces import PointForce, SpringDamper, Tendon
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.scope import GROUND
from deltac.mechanism.shapes import Box, Capsule, HalfSpace, Shape, Sphere
from deltac.mechanism.visuals import Visual
from deltac.report.page.parts import Numbers
from deltac.trajectories import Trajectory

POSES = 250_000
"""Numbers of poses that a page holds, seven for each body and frame: 1.3 MB."""

FRAMES = 3000
"""Instants at which bodies are placed, at most; 60 a second for 50 s."""

FACES = 1500
"""Triangles of a mesh that a page holds, at most; finer ones are made coarser."""

ARROWS = 24
"""Forces that are drawn, at most: those that get largest."""


@dataclass(frozen=True, eq=False)
class Moving:
    """A run: the times of its frames, the poses (frames, bodies, 7): place (m), then quaternion x y z w."""

    name: str
    t: Numbers
    poses: Numbers
    forces: tuple[Arrow, ...] = ()


@dataclass(frozen=True, eq=False)
class Arrow:
    """A force: of what, where it acts (frames, 3), m, and how large it is (frames, 3), N."""

    name: str
    kind: Literal["contact", "constraint", "applied"]
    at: Numbers
    force: Numbers


@dataclass(frozen=True, eq=False)
class Form:
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
    forms: tuple[Form, ...]
    carried: dict[str, Any] | None
    inferred: bool
    tip: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Tie:
    """Something between points of bodies: a spring, a tendon, a rod, a loop that is closed."""

    kind: Literal["spring", "tendon", "rod", "loop"]
    name: str
    points: tuple[tuple[int, tuple[float, ...]], ...]


@dataclass(frozen=True, eq=False)
class Scene:
    """All that moves. Body 0 is the ground; `view` points from the mechanism to the eye, `up` upward.

    `half` is how far it reaches from `centre` to the sides, up and down, to the eye; `radius` all around;
    `size` how large the mechanism itself is (m).
    `follow`: it travels so far that the eye should go with it. `trails`: points whose paths are drawn.
    """

    bodies: tuple[Drawn, ...]
    runs: tuple[Moving, ...]
    ties: tuple[Tie, ...]
    trails: tuple[tuple[int, tuple[float, ...]], ...]
    up: tuple[float, ...]
    view: tuple[float, ...]
    centre: tuple[float, ...]
    half: tuple[float, ...]
    radius: float
    size: float
    floor: float | None
    follow: bool
    side_by_side: bool = False


def scene(
    mechanism: Mechanism, runs: Sequence[tuple[str, Trajectory]], side_by_side: bool = False
) -> Scene | None:
    """The scene of some runs of a mechanism, the first one the main one; None without bodies or rows."""
    if not mechanism.bodies or not runs:
        return None
    sampled = [(name, _frames(mechanism, run, len(runs))) for name, run in runs]
    placed = [_poses(at) for _, at in sampled]
    first = placed[0]
    up = _up(mechanism, first)
    reach = _reach(mechanism, first)
    size = _size(mechanism, first)
    view = _view(up, reach)
    right = _unit(np.cross(up, view)) if abs(up @ view) < 0.999 else _frame(view)[:, 0]
    seen = np.column_stack([right, np.cross(view, right), view])
    low, high = (reach @ seen).min(axis=0), (reach @ seen).max(axis=0)
    half = np.maximum((high - low) / 2, 0.3 * size)
    centre, radius = seen @ (low + high) / 2, float(np.linalg.norm(half))
    bodies = tuple(_bodies(mechanism, size))
    travel = np.ptp(first[:, 1:, :3].mean(axis=1), axis=0)
    moving = []
    for k, ((name, at), poses) in enumerate(zip(sampled, placed)):
        forces = tuple(_arrows(mechanism, runs[0][1], at)) if k == 0 else ()
        moving.append(Moving(name, Numbers(at.t, exact=True), Numbers(poses), forces))
    return Scene(
        bodies,
        tuple(moving),
        tuple(_ties(mechanism)),
        tuple(_trails(mechanism, bodies)),
        _list(up),
        _list(view),
        _list(centre),
        _list(half),
        radius,
        size,
        _floor(mechanism, up, reach),
        bool(np.linalg.norm(travel) > 4.0 * size),
        side_by_side,
    )


# --- poses ---------------------------------------------------------------------------------------


def _frames(mechanism: Mechanism, run: Trajectory, share: int) -> Instants:
    """The run at as many of its rows as the page holds, evenly in time."""
    count = int(max(60, min(FRAMES, POSES / (7 * len(mechanism.bodies) * share))))
    at = instants(mechanism, run)
    if len(at.t) <= count:
        return at
    wanted = np.linspace(at.t[0], at.t[-1], count)
    after = np.clip(np.searchsorted(at.t, wanted), 1, len(at.t) - 1)
    nearer = np.where(wanted - at.t[after - 1] < at.t[after] - wanted, after - 1, after)
    rows = np.unique(nearer)
    return replace(
        at,
        t=at.t[rows],
        q=at.q[rows],
        u=at.u[rows],
        inputs=at.inputs[rows] if len(at.inputs) == len(at.t) else at.inputs,
        udot=None if at.udot is None else at.udot[rows],
    )


def _poses(at: Instants) -> Array:
    """(frames, 1 + bodies, 7): place (m) and quaternion x y z w of every body frame, the ground first."""
    from scipy.spatial.transform import Rotation

    k = Kinematics(at)
    poses = np.zeros((len(at.t), 1 + len(at.mechanism.bodies), 7))
    poses[:, 0, 6] = 1.0
    for i, body in enumerate(at.mechanism.bodies, 1):
        poses[:, i, :3] = k.position(body.name)
        poses[:, i, 3:] = Rotation.from_matrix(k.orientation(body.name)).as_quat()
    return poses


def turned(poses: Array, points: Array) -> Array:
    """Where points (…, 3) of bodies are whose poses (…, 7) are given."""
    q, w = poses[..., 3:6], poses[..., 6:]
    cross = 2.0 * np.cross(q, points)
    placed: Array = poses[..., :3] + points + w * cross + np.cross(q, cross)
    return placed


# --- how large, from where -----------------------------------------------------------------------


def _up(mechanism: Mechanism, poses: Array) -> Array:
    """Against gravity; without it the third axis, or the second of what moves across the third."""
    g = np.array([mechanism.number(x) for x in mechanism.gravity])
    if np.any(g):
        return _unit(-g)
    spread = np.ptp(poses[:, 1:, :3].reshape(-1, 3), axis=0)
    flat = spread[2] < 1e-9 * max(float(spread.max()), 1e-300)
    return np.array([0.0, 1.0, 0.0]) if flat else np.array([0.0, 0.0, 1.0])


def _reach(mechanism: Mechanism, poses: Array) -> Array:
    """Points (n, 3) that the picture must hold: joints, mass centres and corners of all bodies, always."""
    some = poses[:: max(1, len(poses) // 200)]
    points = []
    for i, body in enumerate(mechanism.bodies, 1):
        own = _corners(mechanism, body)
        placed = turned(some[:, i, None, :], own[None])
        points.append(placed.reshape(-1, 3))
    for joint in mechanism.joints:
        if joint.parent == GROUND and joint.kind != "free":
            points.append(np.array([[mechanism.number(x) for x in joint.position]]))
    for tie in _ties(mechanism):
        points += [np.array([point]) for body, point in tie.points if body == 0]
    return np.concatenate(points)


def _corners(mechanism: Mechanism, body: Body) -> Array:
    """Points of a body: its frame, its mass centre, where its joints are, the ends of its looks."""
    own = [np.zeros(3), _numbers(mechanism, body.mass_centre)]
    own += _attached(mechanism, body)
    for visual in mechanism.visuals:
        if visual.body == body.name and visual.kind != "plane":
            own.append(np.array(visual.position, dtype=float))
    if not body.massless and not any(v.body == body.name for v in mechanism.visuals):
        half, axes = _box(mechanism, body)
        if _of_plane_data(half, own):
            half = 0.0 * half
        for sign in (-1.0, 1.0):
            own += [own[1] + sign * h * axis for h, axis in zip(half, axes.T)]
    return np.array(own)


def _size(mechanism: Mechanism, poses: Array) -> float:
    """How large the mechanism is at its start, m."""
    start = np.concatenate(
        [
            turned(poses[0, i, None, :], _corners(mechanism, body))
            for i, body in enumerate(mechanism.bodies, 1)
        ]
    )
    size = float(np.linalg.norm(np.ptp(start, axis=0)))
    if size > 0.0:
        return size
    spread = float(np.linalg.norm(np.ptp(poses[:, 1:, :3].reshape(-1, 3), axis=0)))
    return 0.1 * spread if spread > 0.0 else 1.0


def _view(up: Array, reach: Array) -> Array:
    """Where the eye is: square to a plane motion, else from the front, the right and above."""
    centred = reach - reach.mean(axis=0)
    _, sizes, axes = np.linalg.svd(centred[:: max(1, len(centred) // 5000)], full_matrices=False)
    normal = axes[2] if len(axes) == 3 else np.cross(axes[0], axes[1])
    front = normal - (normal @ up) * up
    flat = sizes[0] > 0.0 and (len(sizes) < 3 or sizes[2] < 1e-3 * sizes[0])
    if not flat or np.linalg.norm(front) < 0.5:
        if flat and abs(normal @ up) > 0.9:  # it moves on a level plane: from above, slantingly
            back = np.array([0.0, -1.0, 0.0]) if abs(up[1]) < 0.9 else np.array([0.0, 0.0, 1.0])
            return _unit(up + 0.55 * back)
        front = np.array([0.0, -1.0, 0.0]) if abs(up[1]) < 0.9 else np.array([0.0, 0.0, 1.0])
        front = front - (front @ up) * up
    front = _unit(front)
    right = np.cross(up, front)
    if right[int(np.argmax(np.abs(right)))] < 0.0:  # the axes of the world to the right
        front, right = -front, -right
    return front if flat else _unit(front + 0.55 * right + 0.38 * up)


def _unit(x: Array) -> Array:
    unit: Array = x / np.linalg.norm(x)
    return unit


def _floor(mechanism: Mechanism, up: Array, reach: Array) -> float | None:
    """The height along `up` of the grid: of the model's floor, else a little below everything."""
    heights = [
        float(np.array(v.position, dtype=float) @ up)
        for v in mechanism.visuals
        if v.kind == "plane" and float(np.array(v.rotation, dtype=float)[:, 2] @ up) > 0.99
    ]
    heights += [
        float(_numbers(mechanism, s.position) @ up)
        for s in _contact_shapes(mechanism)
        if isinstance(s, HalfSpace) and s.body == GROUND and np.array(s.normal) @ up > 0.99
    ]
    if heights:
        return max(heights)
    along = reach @ up
    return float(along.min() - 0.06 * max(float(np.ptp(reach, axis=0).max()), 1e-9))


# --- looks ---------------------------------------------------------------------------------------


def _bodies(mechanism: Mechanism, size: float) -> Iterator[Drawn]:
    own: dict[str, list[Form]] = {GROUND: [], **{body.name: [] for body in mechanism.bodies}}
    for visual in mechanism.visuals:
        own[visual.body].append(_form(visual))
    for shape in _contact_shapes(mechanism):
        if not any(v.body == shape.body for v in mechanism.visuals):
            own[shape.body] += [
                f for f in _contact_form(mechanism, shape) if f not in own[shape.body]
            ]
    carrier = {joint.child: joint for joint in mechanism.joints}
    yield Drawn(GROUND, tuple(own[GROUND]), None, False, (0.0, 0.0, 0.0))
    for body in mechanism.bodies:
        forms, joint = own[body.name], carrier[body.name]
        here = _numbers(mechanism, joint.child_position)
        inferred = not forms
        if not mechanism.visuals:  # else a body without looks is meant to have none
            forms = [*forms, *_inertial(mechanism, body, here, size, solid=inferred)]
        axis = joint.axes[0] if joint.axes else None
        carried = {
            "name": joint.name,
            "kind": joint.kind,
            "parent": joint.parent,
            "position": _list(here),
            "axis": None
            if axis is None
            else _list(np.array(joint.child_rotation, dtype=float) @ np.array(axis)),
        }
        yield Drawn(body.name, tuple(forms), carried, inferred, _tip(mechanism, body))


def _form(visual: Visual) -> Form:
    vertices = faces = None
    if visual.vertices is not None and visual.faces is not None:
        points, triangles = coarser(visual.vertices, visual.faces, FACES)
        vertices, faces = Numbers(points), tuple(int(i) for i in triangles.ravel())
    return Form(
        visual.kind,
        visual.size,
        _list(np.array(visual.position, dtype=float)),
        _quaternion(np.array(visual.rotation, dtype=float)),
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


def _contact_shapes(mechanism: Mechanism) -> Iterator[Shape]:
    for part in (*mechanism.elements, *mechanism.events):
        for name in ("first", "second"):
            shape = getattr(part, name, None)
            if isinstance(shape, Sphere | Capsule | Box | HalfSpace):
                yield shape


def _contact_form(mechanism: Mechanism, shape: Shape) -> Iterator[Form]:
    at = _list(_numbers(mechanism, shape.position))
    sizes = tuple(float(mechanism.number(s)) for s in shape.sizes)
    if isinstance(shape, Sphere) and sizes[0] > 0.0:
        yield Form("sphere", sizes, at, (0.0, 0.0, 0.0, 1.0))
    elif isinstance(shape, Capsule):
        yield Form("capsule", sizes, at, _quaternion(_frame(np.array(shape.axis))))
    elif isinstance(shape, Box):
        yield Form("box", sizes, at, _quaternion(np.array(shape.rotation, dtype=float)))
    elif isinstance(shape, HalfSpace):
        yield Form("plane", (0.0, 0.0), at, _quaternion(_frame(np.array(shape.normal))))


def _inertial(
    mechanism: Mechanism, body: Body, here: Array, size: float, solid: bool
) -> Iterator[Form]:
    """What a body's inertia is that of, and thin rods from its joint to its mass centre and other joints."""
    thin = 0.011 * size
    centre = _numbers(mechanism, body.mass_centre)
    half, axes = np.zeros(3), np.eye(3)
    reached = _attached(mechanism, body)
    if not body.massless and solid:
        half, axes = _box(mechanism, body)
        reached.append(centre)
        if half.max() <= 1e-3 * size or _of_plane_data(half, [here, *reached]):
            half = np.zeros(3)
            yield Form("sphere", (2.6 * thin,), _list(centre), (0.0, 0.0, 0.0, 1.0))
        elif half[1] <= 0.05 * half[2]:  # a rod
            turn = _quaternion(_frame(axes[:, 2]))
            yield Form("capsule", (1.7 * thin, 2.0 * float(half[2])), _list(centre), turn)
        else:
            yield _round_or_box(half, axes, centre, thin)
    allowed = 1.02 * half + 0.02 * half.max()
    for end in reached:
        inside = all(np.all(np.abs(axes.T @ (p - centre)) <= allowed) for p in (here, end))
        if np.linalg.norm(end - here) > 0.02 * size and not inside:
            yield _stick(here, end, thin)


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
        points += [p for name, p in ends if name == body.name and _constant(mechanism, p)]
    return [_numbers(mechanism, point) for point in points]


def _of_plane_data(half: Array, points: Sequence[Array]) -> bool:
    """Whether a ball of this inertia would hide the body's own points: so do data of a plane mechanism.

    They know one moment of inertia, which is often put in for all three.
    """
    spread = max(float(np.linalg.norm(a - b)) for a in points for b in points)
    return bool(half[2] - half[0] < 1e-6 * half[2] and spread > 0.0 and half[2] > 0.3 * spread)


def _round_or_box(half: Array, axes: Array, centre: Array, thin: float) -> Form:
    """A ball where all half edges are the same, a disc or drum where two are, else a box."""
    a, b, c = half
    if c - a < 1e-6 * c:  # a uniform ball of the same moments: 2/5 r² = 2/3 h²
        return Form("sphere", (float(c * np.sqrt(5.0 / 3.0)),), _list(centre), (0.0, 0.0, 0.0, 1.0))
    if c - b < 1e-6 * c:  # flat: r²/4 = h²/3 across, thickness along the smallest
        size = (float(b * np.sqrt(4.0 / 3.0)), max(2.0 * float(a), thin))
        return Form("cylinder", size, _list(centre), _quaternion(_frame(axes[:, 0])))
    if b - a < 1e-6 * c:  # long
        size = (max(float(a * np.sqrt(4.0 / 3.0)), thin), 2.0 * float(c))
        return Form("cylinder", size, _list(centre), _quaternion(_frame(axes[:, 2])))
    turn = axes * np.array([1.0, 1.0, np.sign(np.linalg.det(axes))])
    edges = tuple(max(2.0 * float(h), thin) for h in half)
    return Form("box", edges, _list(centre), _quaternion(turn))


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


def _stick(start: Array, end: Array, radius: float) -> Form:
    along = end - start
    length = float(np.linalg.norm(along))
    return Form(
        "capsule", (radius, length), _list((start + end) / 2), _quaternion(_frame(along / length))
    )


def _tip(mechanism: Mechanism, body: Body) -> tuple[float, ...]:
    """The point of a body that is farthest from the joint that carries it."""
    joint = next(j for j in mechanism.joints if j.child == body.name)
    here = _numbers(mechanism, joint.child_position)
    points = _corners(mechanism, body)[1:]
    return _list(points[int(np.argmax(np.linalg.norm(points - here, axis=1)))])


def _trails(
    mechanism: Mechanism, bodies: Sequence[Drawn]
) -> Iterator[tuple[int, tuple[float, ...]]]:
    """The ends of the tree's branches, six at most."""
    ends = [i for i, body in enumerate(bodies) if i and not mechanism.children[body.name]]
    for i in ends[:6]:
        yield i, bodies[i].tip


def _ties(mechanism: Mechanism) -> Iterator[Tie]:
    place = {GROUND: 0, **{body.name: i for i, body in enumerate(mechanism.bodies, 1)}}

    def at(body: str, point: Sequence[Any]) -> tuple[int, tuple[float, ...]]:
        return place[body], _list(_numbers(mechanism, point))

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
            if all(_constant(mechanism, p) for p in points):
                ends = (at(constraint.body1, points[0]), at(constraint.body2, points[1]))
                yield Tie(kind, constraint.name, ends)


def _constant(mechanism: Mechanism, point: Sequence[Any]) -> bool:
    return all(mechanism.scope.is_constant(x) for x in point)


# --- forces --------------------------------------------------------------------------------------


def _arrows(mechanism: Mechanism, run: Trajectory, at: Instants) -> Iterator[Arrow]:
    """Forces of constraints, contacts and applied ones, the largest of them."""
    acting = _Acted(mechanism, run, at)
    arrows = [arrow for part in _acting(mechanism, run) if (arrow := part.arrow(acting))]
    arrows.sort(key=lambda arrow: -float(np.abs(arrow.force.values).max(initial=0.0)))
    yield from arrows[:ARROWS]


@dataclass(frozen=True, eq=False)
class _Acted:
    """Generalized forces of a run at the instants that are shown."""

    mechanism: Mechanism
    run: Trajectory
    at: Instants

    @cached_property
    def evaluation(self) -> Evaluation:
        """What the model says of these instants."""
        return evaluated(equations_of_motion(self.mechanism), self.at)

    def force(self, channels: Sequence[str]) -> Array:
        """The sum (frames, free speeds) over some channels: as logged, else as the model has it."""
        free = self.mechanism.free.u
        total = np.zeros((len(self.at.t), len(free)))
        rows = np.searchsorted(self.run.t, self.at.t)
        logged = [self.run.forces[c] for c in channels if c in self.run.forces]
        for values in logged:
            total += values[rows][:, free]
        for channel in () if logged else channels:
            name = ChannelName.parse(channel)
            found = self.evaluation
            if name.kind == "constraint":
                own = [k for k, row in enumerate(found.rows) if row == name.element]
                total += np.einsum("tcp,tc->tp", found.G[:, own], found.multipliers[:, own])
            elif name in found.forces:
                total += found.forces[name][:, free]
        return total


@dataclass(frozen=True)
class _Acting:
    """Channels whose force acts on `body`, and in reverse on `other`, at `point` of the body.

    If it `slides`, it acts somewhere near that point: where its moment about the place vanishes.
    """

    name: str
    kind: Literal["contact", "constraint", "applied"]
    channels: tuple[str, ...]
    body: str
    other: str
    point: tuple[Any, ...]
    slides: bool = False

    def arrow(self, acted: _Acted) -> Arrow | None:
        """The force that has this generalized force, least where several have; None without any."""
        generalized = acted.force(self.channels)
        if not np.any(generalized):
            return None
        place, jacobian = _jacobian(acted.mechanism, acted.at, self.body, self.other, self.point)
        power = np.linalg.pinv(jacobian[:, :3].transpose(0, 2, 1), rcond=1e-9)
        force = np.einsum("tij,tj->ti", power, generalized)
        left = generalized - np.einsum("tij,ti->tj", jacobian[:, :3], force)
        if np.abs(left).max() > 1e-6 * np.abs(generalized).max() and self.slides:
            inverse = np.linalg.pinv(jacobian.transpose(0, 2, 1), rcond=1e-9)
            wrench = np.einsum("tij,tj->ti", inverse, generalized)
            force, moment = wrench[:, :3], wrench[:, 3:]
            square = np.maximum(np.einsum("ti,ti->t", force, force), 1e-300)
            place = place + np.cross(force, moment) / square[:, None]
        return Arrow(self.name, self.kind, Numbers(place), Numbers(force))


def _acting(mechanism: Mechanism, run: Trajectory) -> Iterator[_Acting]:
    for c in mechanism.constraints:
        channels = (f"constraint {c.name}",)
        if isinstance(c, Distance | Loop) and _constant(mechanism, c.point2):
            yield _Acting(c.name, "constraint", channels, c.body2, c.body1, tuple(c.point2))
        elif isinstance(c, PointOn) and _constant(mechanism, c.point):
            yield _Acting(c.name, "constraint", channels, c.body, c.on, tuple(c.point))
    for e in mechanism.elements:
        if isinstance(e, Contact):
            three = tuple(f"{kind} {e.name}" for kind in ("spring", "contact", "friction"))
            body, other = (e.first, e.second) if e.second.body == GROUND else (e.second, e.first)
            yield _Acting(
                e.name, "contact", three, body.body, other.body, tuple(body.position), True
            )
        elif isinstance(e, PointForce) and any(_is_force(x) for x in e.force):
            yield _Acting(e.name, "applied", (f"applied {e.name}",), e.body, GROUND, tuple(e.point))
    looks = {v.name: v for v in mechanism.visuals}
    for channel in run.forces:
        first, colon, second = channel.element.partition(":")
        if channel.kind == "contact" and colon and {first, second} <= looks.keys():
            one, two = looks[first], looks[second]
            if one.body != GROUND:
                one, two = two, one
            yield _Acting(
                channel.element, "contact", (channel,), two.body, one.body, two.position, True
            )


def _is_force(law: Any) -> bool:
    return not (isinstance(law, float | int) and law == 0)


def _jacobian(
    mechanism: Mechanism, at: Instants, body: str, other: str, point: Sequence[Any]
) -> tuple[Array, Array]:
    """Where a point of a body is (frames, 3), and its Jacobian (frames, 6, free), translation first.

    Of the velocity beside that of the point of `other` in the same place.
    """
    system = equations_of_motion(mechanism).system

    def function() -> Any:
        places = system.once("scene", lambda: Places(system))
        x = places.point(body, point)
        moves = places.velocity(body, x) - places.velocity(other, x)
        turns = places.angular_velocity(body) - places.angular_velocity(other)
        rates = ca.jacobian(ca.vertcat(moves, turns), system.u)
        given = [system.t, system.q, system.u]
        return ca.Function("arrow", given, [ca.densify(x), ca.densify(ca.vec(rates))])

    f = system.once(("arrow", body, other, *map(repr, point)), function)
    free = mechanism.free
    x, rates = evaluate_at(f, at.t[None, :], at.q[:, free.q].T, at.u[:, free.u].T)
    return x.T, rates.T.reshape(len(at.t), len(free.u), 6).transpose(0, 2, 1)


# --- numbers -------------------------------------------------------------------------------------


def _numbers(mechanism: Mechanism, point: Sequence[Any]) -> Array:
    return np.array([mechanism.number(x) for x in point], dtype=float)


def _list(x: Array) -> tuple[float, ...]:
    return tuple(float(v) for v in x)


def _frame(axis: Array) -> Array:
    """A rotation whose third column is the axis."""
    z = axis / np.linalg.norm(axis)
    helper = np.array([1.0, 0.0, 0.0]) if abs(z[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = np.cross(helper, z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _quaternion(rotation: Array) -> tuple[float, ...]:
    from scipy.spatial.transform import Rotation

    return _list(Rotation.from_matrix(rotation).as_quat())
