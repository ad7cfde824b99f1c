"""A mechanism in a still picture: where it is at the end, and, paler, where it was before.

What is drawn is the scene that pages show moving; every shape is its outline as the eye sees it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from deltac.arrays import Array
from deltac.errors import ModelError
from deltac.mechanism import Mechanism, State
from deltac.report.page.geometry import Solid, unit
from deltac.report.page.scene import Drawing, scene, turned
from deltac.report.picture import blank
from deltac.report.style import SMALL_TEXT, styled
from deltac.trajectories import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BODIES = ("#0072b2", "#d55e00", "#009e73", "#e69f00", "#cc79a7", "#56b4e9", "#8a6d3b")


def still(
    mechanism: Mechanism,
    motion: Trajectory | State | None = None,
    *,
    places: int = 1,
    title: str = "",
    size: tuple[float, float] = (4.8, 3.2),
) -> Figure:
    """The mechanism at the end of a run, and at `places` − 1 earlier instants, evenly spread, paler.

    Without a run it is at a state, by default with all coordinates zero. `size` is in inches.

    Raises InputError for a mechanism without bodies.
    """
    if not isinstance(motion, Trajectory):
        motion = _standing(mechanism, mechanism.state() if motion is None else motion)
    drawing = scene(mechanism, [("", motion)])
    if drawing is None:
        raise ModelError(f"mechanism {mechanism.name!r} has no bodies to draw")
    with styled():
        figure = blank(size[1], title, width=size[0])
        figure.subplots_adjust(
            left=0.0, right=1.0, bottom=0.0, top=1.0 - 0.42 * bool(title) / size[1]
        )
        panel = figure.subplots()
        frames = len(drawing.runs[0].t.values)
        draw(
            panel,
            drawing,
            [round(k * (frames - 1) / max(places - 1, 1)) for k in range(places)]
            if places > 1
            else [frames - 1],
        )
    return figure


def _standing(mechanism: Mechanism, state: State) -> Trajectory:
    return Trajectory(
        t=np.array([state.t]),
        q=np.array([state.q]),
        u=np.array([state.u]),
        coordinates=mechanism.coordinates.names,
        speeds=mechanism.speeds.names,
    )


def draw(panel: Axes, drawing: Drawing, frames: Sequence[int], trail: bool = True) -> None:
    """Draw a scene at some of its frames, the last one full, into axes that fit it."""
    eye, up, axes = np.array(drawing.view), np.array(drawing.up), _seen(drawing)
    run = drawing.runs[0]
    poses = np.asarray(run.poses.values)
    centre = np.array(drawing.centre) @ axes
    half = np.array(drawing.half)[:2] * 1.14
    box = panel.get_window_extent()
    width, height = box.width / panel.figure.dpi, box.height / panel.figure.dpi
    if half[0] * height > half[1] * width:
        half = np.array([half[0], half[0] * height / width])
    else:
        half = np.array([half[1] * width / height, half[1]])
    panel.set_xlim(centre[0] - half[0], centre[0] + half[0])
    panel.set_ylim(centre[1] - half[1], centre[1] + half[1])
    panel.set_aspect("equal")
    panel.axis("off")
    if drawing.floor is not None:
        level = float((up * drawing.floor) @ axes[:, 1])
        panel.axhline(level, color="#cccccc", linewidth=1.0, zorder=0)
    if trail:
        for body, point in drawing.trails:
            path = turned(poses[: int(frames[-1]) + 1, body], np.array(point)) @ axes
            panel.plot(*path.T, color="#9a9a9a", linewidth=0.6, zorder=1)
    per_point = 72.0 * width / (2.0 * half[0])
    for k, frame in enumerate(map(int, frames)):
        share = (k + 1) / len(frames)
        opacity = 1.0 if k == len(frames) - 1 else 0.12 + 0.35 * share**2
        _frame(panel, drawing, poses[frame], axes, eye, opacity, 2.0 + k, per_point)


def _seen(drawing: Drawing) -> Array:
    """The directions (3, 2) to the right and upward, as the eye sees the scene."""
    eye = np.array(drawing.view)
    right = np.cross(drawing.up, eye)
    right = unit(right) if np.linalg.norm(right) > 1e-6 else np.array([1.0, 0.0, 0.0])
    return np.column_stack([right, np.cross(eye, right)])


def _frame(
    panel: Axes,
    drawing: Drawing,
    poses: Array,
    axes: Array,
    eye: Array,
    opacity: float,
    order: float,
    per_point: float,
) -> None:
    """All bodies at one instant, those farther from the eye first, then joints and ties."""
    outlines = []
    for i, body in enumerate(drawing.bodies):
        for form in body.forms:
            corners = _corners(form)
            if len(corners):
                placed = turned(poses[i], corners)
                outlines.append((float((placed @ eye).mean()), i, form, placed @ axes))
    for _, i, form, points in sorted(outlines, key=lambda entry: entry[0]):
        colour: Any = BODIES[(i - 1) % len(BODIES)] if i else "#bbbbbb"
        if form.colour is not None and i:
            colour = form.colour[:3]
        hull = _hull(points)
        # What only its inertia is known of may be large and in front of others.
        veiled = drawing.bodies[i].inferred and form.kind != "capsule" and len(drawing.bodies) > 4
        look: dict[str, Any] = {"alpha": opacity * (0.45 if veiled else 1.0), "zorder": order}
        panel.fill(*hull.T, facecolor=colour, edgecolor="white", linewidth=0.8, **look)
        if float(np.ptp(hull, axis=0).max()) * per_point < SMALL_TEXT:
            place = hull.mean(axis=0)
            panel.plot(*place, "o", color=colour, markersize=SMALL_TEXT, markeredgewidth=0, **look)
    for tie in drawing.ties:
        ends = np.array([turned(poses[i], np.array(p)) for i, p in tie.points]) @ axes
        if tie.kind == "loop":
            panel.plot(
                *ends.T, "o", color="#333333", markersize=3, alpha=opacity, zorder=order + 0.6
            )
        else:
            style = {"spring": (0, (1, 0.8)), "tendon": "-", "rod": "-"}[tie.kind]
            line: dict[str, Any] = {"color": "#555555", "alpha": opacity, "zorder": order + 0.5}
            panel.plot(*ends.T, linestyle=style, linewidth=1.6, **line)
    for i, body in enumerate(drawing.bodies):
        if body.carried is not None and body.carried["kind"] != "free":
            at = turned(poses[i], np.array(body.carried["position"])) @ axes
            panel.plot(
                *at,
                "o",
                color="white",
                markeredgecolor="#333333",
                markeredgewidth=0.8,
                markersize=min(4.0, max(2.0, 0.012 * drawing.size * per_point)),
                alpha=opacity,
                zorder=order + 0.7,
            )


def _corners(form: Solid) -> Array:
    """Points whose hull is the shape (n, 3), in the body's frame; none of what has no end."""
    if form.kind in ("sphere", "ellipsoid"):  # one radius or three
        points = np.array(form.size) * _ball()
    elif form.kind == "box":
        points = np.array(form.size) * (np.array(list(np.ndindex(2, 2, 2))) - 0.5)
    elif form.kind in ("capsule", "cylinder"):
        radius, length = form.size
        ring = radius * (_ball() if form.kind == "capsule" else _circle())
        points = np.concatenate([ring + [0, 0, length / 2], ring - [0, 0, length / 2]])
    elif form.vertices is not None:
        points = np.asarray(form.vertices.values, dtype=float).reshape(-1, 3)
    else:
        return np.zeros((0, 3))
    pose = np.array([*form.position, *form.rotation])
    return turned(pose, points)


def _ball() -> Array:
    """Points on the unit sphere."""
    levels = np.linspace(-math.pi / 2, math.pi / 2, 13)
    return np.concatenate([math.cos(a) * _circle() + [0, 0, math.sin(a)] for a in levels])


def _circle() -> Array:
    """Points on the unit circle in the plane of x and y."""
    turn = np.linspace(0.0, 2.0 * math.pi, 36, endpoint=False)
    return np.column_stack([np.cos(turn), np.sin(turn), np.zeros(len(turn))])


def _hull(points: Array) -> Array:
    """The convex outline (n, 2) of points in the plane; of points on a line its two ends."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        outline: Array = points[ConvexHull(points).vertices]
        return outline
    except QhullError:
        along = points @ (points[-1] - points[0])
        return points[[int(np.argmin(along)), int(np.argmax(along))]]
