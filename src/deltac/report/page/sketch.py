"""A still picture of a scene as SVG path data: its bodies as lines and circles, as the eye sees them."""

from __future__ import annotations

import numpy as np

from deltac.arrays import Array
from deltac.report.page.scene import Scene, turned

WIDTH, HEIGHT, MARGIN = 230.0, 130.0, 12.0


def sketch(scene: Scene, at: float = 0.35) -> tuple[str, str]:
    """The bodies at a share `at` of the run, and the paths of their ends, as path data in 230 by 130.

    Rods and springs are lines, balls and discs circles, boxes and meshes the outline of their edges.
    """
    poses = scene.runs[0].poses.values
    frame = int(at * (len(poses) - 1))
    now = poses[frame]
    lines = [turned(now[k], line) for k, line in _lines(scene)]
    for tie in scene.ties:
        if tie.kind != "loop":
            lines.append(np.array([turned(now[k], np.array(point)) for k, point in tie.points]))
    stride = max(1, len(poses) // 200)
    before = poses[max(0, frame - len(poses) // 4) : frame + 1 : stride]
    bodies = len(lines)
    lines += [turned(before[:, k], np.array(point)) for k, point in scene.trails]
    if not lines:
        return "", ""
    up, view = np.array(scene.up), np.array(scene.view)
    right = np.cross(up, view)
    right = right / np.linalg.norm(right) if np.linalg.norm(right) > 1e-9 else np.eye(3)[0]
    plane = np.column_stack([right, -np.cross(view, right)])
    drawn = [line @ plane for line in lines]
    every = np.concatenate(drawn)
    low, high = every.min(axis=0), every.max(axis=0)
    room = np.array([WIDTH - 2 * MARGIN, HEIGHT - 2 * MARGIN])
    scale = float(np.min(room / np.maximum(high - low, 1e-9 + 0.05 * scene.size)))
    placed = [(line - (low + high) / 2) * scale + np.array([WIDTH, HEIGHT]) / 2 for line in drawn]
    return _path(placed[:bodies]), _path(placed[bodies:])


def _path(lines: list[Array]) -> str:
    told = ("L".join(f"{x:.1f} {y:.1f}" for x, y in line) for line in lines if len(line) > 1)
    return "".join(f"M{line}" for line in told)


def _lines(scene: Scene) -> list[tuple[int, Array]]:
    """Polylines (n, 3) of every body in its own frame, with the body's place."""
    from scipy.spatial.transform import Rotation

    found = []
    for k, body in enumerate(scene.bodies):
        for form in body.forms:
            if form.kind == "plane":
                continue
            shape = _outline(form.kind, form.size)
            if form.vertices is not None:
                points = np.asarray(form.vertices.values)
                low, high = points.min(axis=0), points.max(axis=0)
                shape = [edge * (high - low) / 2 + (low + high) / 2 for edge in _EDGES]
            turn = Rotation.from_quat(form.rotation).as_matrix()
            found += [(k, edge @ turn.T + np.array(form.position)) for edge in shape]
    return found


def _outline(kind: str, size: tuple[float, ...]) -> list[Array]:
    if kind == "capsule":
        radius, length = size
        if length > 6.0 * radius:
            return [np.array([[0.0, 0.0, -length / 2], [0.0, 0.0, length / 2]])]
        return [_CIRCLE * (radius + length / 2), _CIRCLE[:, [0, 2, 1]] * (radius + length / 2)]
    if kind == "cylinder":
        radius, length = size
        ends = [np.array([0.0, 0.0, s * length / 2]) for s in (-1.0, 1.0)]
        return [_CIRCLE * radius + end for end in ends] + [np.array(ends)] * (length > radius)
    if kind == "sphere":
        return [_CIRCLE[:, list(order)] * size[0] for order in ((0, 1, 2), (0, 2, 1), (2, 0, 1))]
    if kind == "ellipsoid":
        return [_CIRCLE * np.array(size), _CIRCLE[:, [0, 2, 1]] * np.array(size)]
    return [edge * np.array(size) / 2 for edge in _EDGES] if kind == "box" else []


_TURN = np.linspace(0.0, 2.0 * np.pi, 25)
_CIRCLE = np.column_stack([np.cos(_TURN), np.sin(_TURN), np.zeros(25)])
_SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]])
_EDGES = [
    np.column_stack([_SQUARE, np.full(5, -1.0)]),
    np.column_stack([_SQUARE, np.full(5, 1.0)]),
    *(np.array([[x, y, -1.0], [x, y, 1.0]]) for x, y in _SQUARE[:4]),
]
"""Edges of a box of half edge 1."""
