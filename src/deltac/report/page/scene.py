"""The mechanism as a page shows it moving: geometry, poses along the run, forces as arrows.

Poses are `analysis.kinematics` at the rows of the run, at as many instants as a page can hold; the browser
goes from one to the next in between. Bodies that nobody says the looks of are drawn as what their inertia
is that of: a rod, a disc, a ball, a box.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from deltac.analysis.kinematics import Kinematics
from deltac.analysis.model import Instants, instants
from deltac.arrays import Array
from deltac.mechanism import GROUND, HalfSpace, Mechanism
from deltac.report.page.forces import Arrow, arrows
from deltac.report.page.geometry import (
    Drawn,
    Tie,
    contact_shapes,
    corners,
    drawn_bodies,
    frame_of,
    listed,
    numbers,
    ties,
    trails,
    unit,
)
from deltac.report.page.parts import PAGE_NUMBERS, Numbers
from deltac.report.panels import CURVE_POINTS, MOST_DRAWN
from deltac.trajectories import Trajectory


@dataclass(frozen=True, eq=False)
class Moving:
    """A run: the times of its frames, the poses (frames, bodies, 7): place (m), then quaternion x y z w."""

    name: str
    t: Numbers
    poses: Numbers
    forces: tuple[Arrow, ...] = ()


@dataclass(frozen=True, eq=False)
class Drawing:
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
) -> Drawing | None:
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
    right = unit(np.cross(up, view)) if abs(up @ view) < 0.999 else frame_of(view)[:, 0]
    axes = np.column_stack([right, np.cross(view, right), view])
    low, high = (reach @ axes).min(axis=0), (reach @ axes).max(axis=0)
    half = np.maximum((high - low) / 2, 0.3 * size)
    centre, radius = axes @ (low + high) / 2, float(np.linalg.norm(half))
    bodies = tuple(drawn_bodies(mechanism, size))
    travel = np.ptp(first[:, 1:, :3].mean(axis=1), axis=0)
    shown = []
    for k, ((name, at), poses) in enumerate(zip(sampled, placed)):
        forces = tuple(arrows(mechanism, runs[0][1], at)) if k == 0 else ()
        shown.append(Moving(name, Numbers(at.t, exact=True), Numbers(poses), forces))
    return Drawing(
        bodies,
        tuple(shown),
        tuple(ties(mechanism)),
        tuple(trails(mechanism, bodies)),
        listed(up),
        listed(view),
        listed(centre),
        listed(half),
        radius,
        size,
        _floor(mechanism, up, reach),
        bool(np.linalg.norm(travel) > 4.0 * size),
        side_by_side,
    )


# --- poses ---------------------------------------------------------------------------------------


def _frames(mechanism: Mechanism, run: Trajectory, share: int) -> Instants:
    """The run at as many of its rows as the page holds, evenly in time.

    A body and a frame take seven numbers each, a force six.
    """
    of_frame = 7 * len(mechanism.bodies) * share + 6 * min(MOST_DRAWN, len(run.forces))
    count = int(max(60, min(CURVE_POINTS, PAGE_NUMBERS / of_frame)))
    at = instants(mechanism, run)
    if len(at.t) <= count:
        return at
    times = np.linspace(at.t[0], at.t[-1], count)
    after = np.clip(np.searchsorted(at.t, times), 1, len(at.t) - 1)
    nearer = np.where(times - at.t[after - 1] < at.t[after] - times, after - 1, after)
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
        return unit(-g)
    spread = np.ptp(poses[:, 1:, :3].reshape(-1, 3), axis=0)
    flat = spread[2] < 1e-9 * max(float(spread.max()), 1e-300)
    return np.array([0.0, 1.0, 0.0]) if flat else np.array([0.0, 0.0, 1.0])


def _reach(mechanism: Mechanism, poses: Array) -> Array:
    """Points (n, 3) that the picture must hold: joints, mass centres and corners of all bodies, always."""
    some = poses[:: max(1, len(poses) // 200)]
    points = []
    for i, body in enumerate(mechanism.bodies, 1):
        own = corners(mechanism, body)
        placed = turned(some[:, i, None, :], own[None])
        points.append(placed.reshape(-1, 3))
    for joint in mechanism.joints:
        if joint.parent == GROUND and joint.kind != "free":
            points.append(np.array([[mechanism.number(x) for x in joint.position]]))
    for tie in ties(mechanism):
        points += [np.array([point]) for body, point in tie.points if body == 0]
    return np.concatenate(points)


def _size(mechanism: Mechanism, poses: Array) -> float:
    """How large the mechanism is at its start, m."""
    start = np.concatenate(
        [
            turned(poses[0, i, None, :], corners(mechanism, body))
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
            return unit(up + 0.55 * back)
        front = np.array([0.0, -1.0, 0.0]) if abs(up[1]) < 0.9 else np.array([0.0, 0.0, 1.0])
        front = front - (front @ up) * up
    front = unit(front)
    right = np.cross(up, front)
    if right[int(np.argmax(np.abs(right)))] < 0.0:  # the axes of the world to the right
        front, right = -front, -right
    return front if flat else unit(front + 0.55 * right + 0.38 * up)


def _floor(mechanism: Mechanism, up: Array, reach: Array) -> float | None:
    """The height along `up` of the grid: of the model's floor, else a little below everything."""
    heights = [
        float(np.array(v.position, dtype=float) @ up)
        for v in mechanism.visuals
        if v.kind == "plane" and float(np.array(v.rotation, dtype=float)[:, 2] @ up) > 0.99
    ]
    heights += [
        float(numbers(mechanism, s.position) @ up)
        for s in contact_shapes(mechanism)
        if isinstance(s, HalfSpace) and s.body == GROUND and np.array(s.normal) @ up > 0.99
    ]
    if heights:
        return max(heights)
    along = reach @ up
    return float(along.min() - 0.06 * max(float(np.ptp(reach, axis=0).max()), 1e-9))
