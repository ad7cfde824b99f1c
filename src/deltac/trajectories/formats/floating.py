"""Where a foreign log keeps the body that floats: `floating_base`.

Simulators agree on little here: the quaternion stands before the position or after it, with its scalar first
or last; velocity and angular velocity are in the components of the world or of the body, and either may come
first. Names and widths say which columns may be what (`Layout`); the motion decides among these conventions
alone, and against the declared or usual one only where another misses clearly less.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from deltac import rotations
from deltac.arrays import Array
from deltac.trajectories.formats.units import without_unit
from deltac.trajectories.formats.words import NEUTRAL, PLACE_WORDS, UNREAL, words_of
from deltac.trajectories.motion import Movement, preferred

BASES = ("base", "root", "torso", "trunk", "pelvis", "floating base", "free", "")
"""What people call the one body that floats."""

_UNIT_LENGTH, _TURNS = 1e-3, 1e-6

_MOST = 12
"""Vectors of one kind that are tried."""

_LINEAR = frozenset("lin linear linvel vel vels velocity v speed".split())
_ANGULAR_WORDS = frozenset("ang angular angvel rotvel omega gyro w".split())
_FRAMES = {"w": "world", "world": "world", "b": "body", "body": "body"}
"""Last words that say in whose components a vector is: ``root_lin_vel_w``."""

_QUATERNIONS = {"wxyz": (0, 1, 2, 3), "xyzw": (3, 0, 1, 2)}  # places of w, x, y, z


@dataclass(frozen=True)
class Layout:
    """Columns that may be a floating body's: of its position, quaternion, velocity and angular velocity.

    `order` of the quaternion and frames of the velocities are empty where names do not say. `q` and `u` are
    the arrays of which these are a part, without them, in the model's order.
    """

    position: tuple[str, ...]
    quaternion: tuple[str, ...]
    linear: tuple[str, ...]
    angular: tuple[str, ...]
    order: str = ""
    linear_frame: str = ""
    angular_frame: str = ""
    q: tuple[str, ...] = ()
    u: tuple[str, ...] = ()


@dataclass(frozen=True)
class Floating:
    """A layout read in one way: the quaternion's `order`, both frames, and how far the motion misses it.

    `usual`: whether order and frames are the declared ones, or the schema's where none are.
    """

    layout: Layout
    order: str
    linear_frame: str
    angular_frame: str
    miss: float
    usual: bool = False

    @property
    def quaternion(self) -> tuple[str, ...]:
        """Its columns, scalar first."""
        return _scalar_first(self.layout.quaternion, self.order)

    def __str__(self) -> str:
        frames = (
            f"velocity in {self.linear_frame}, angular velocity in {self.angular_frame} components"
        )
        return f"quaternion {self.order}, {frames}"


def floating_base(
    t: Array, table: Mapping[str, Array], layouts: Sequence[Layout]
) -> Floating | None:
    """The reading of the layouts, the most declared first, by which a body moves as its velocities say.

    t (T,), s; table: columns (T,) in SI units. None where nothing moves so.
    """

    def columns(names: Sequence[str]) -> Array:
        return np.column_stack([table[name] for name in names])

    readings = [
        reading
        for layout in layouts
        for order in ([layout.order] if layout.order else _QUATERNIONS)
        for reading in _read(t, columns, layout, order)
    ]
    return preferred(readings, lambda one: one.miss)


def _scalar_first(quaternion: Sequence[str], order: str) -> tuple[str, ...]:
    return tuple(quaternion[k] for k in _QUATERNIONS[order])


def is_turning(p: Array) -> bool:
    """Whether four columns (T, 4) are a unit quaternion that is not constant."""
    with np.errstate(over="ignore"):
        one = (
            np.max(np.abs(np.sum(p * p, axis=1) - 1.0)) < _UNIT_LENGTH
        )  # False where a value is missing
    return bool(one and np.max(np.ptp(p, axis=0)) > _TURNS)


def _read(
    t: Array, columns: Callable[[Sequence[str]], Array], layout: Layout, order: str
) -> Iterator[Floating]:
    """A layout with each pair of frames, the declared or usual ones first; none of no quaternion."""
    p = columns(_scalar_first(layout.quaternion, order))
    if not is_turning(p):
        return
    x, v, w = (columns(part) for part in (layout.position, layout.linear, layout.angular))
    R = rotations.matrices(p)
    linear, angular = layout.linear_frame or "world", layout.angular_frame or "body"
    turns = {frame: Movement.turning(t, p, w, frame).miss for frame in ("body", "world")}
    velocities = {"world": v, "body": np.einsum("tij,tj->ti", R, v)}
    moves = {frame: Movement.of(t, x, velocity).miss for frame, velocity in velocities.items()}
    for first, second in product(_from(linear), _from(angular)):
        usual = (order, first, second) == (layout.order or "wxyz", linear, angular)
        yield Floating(layout, order, first, second, max(moves[first], turns[second]), usual)


def _from(first: str) -> list[str]:
    return sorted(("world", "body"), key=lambda frame: frame != first)


def packed(q: Sequence[str], u: Sequence[str], i: int = 0, j: int = 0) -> Iterator[Layout]:
    """Layouts of a body whose pose begins at the place i of the columns q, and its velocities at j of u."""
    pose, twist = tuple(q[i : i + 7]), tuple(u[j : j + 6])
    rest_q, rest_u = (*q[:i], *q[i + 7 :]), (*u[:j], *u[j + 6 :])
    for x, p in ((pose[:3], pose[3:]), (pose[4:], pose[:4])):
        for v, w in ((twist[:3], twist[3:]), (twist[3:], twist[:3])):
            yield Layout(x, p, v, w, q=rest_q, u=rest_u)


@dataclass(frozen=True)
class Vector:
    """Three or four columns that are one by their names.

    `kind`: "position", "linear", "angular" or "quaternion"; `order` and `frame` where the names say; `own`:
    whether they name the body; `owner`: the words before.
    """

    columns: tuple[str, ...]
    kind: str
    order: str = ""
    frame: str = ""
    own: bool = False
    owner: tuple[str, ...] = ()


def vectors_of(
    arrays: Mapping[str, Sequence[str]], columns: Sequence[str], names: Sequence[str]
) -> list[Vector]:
    """Vectors among arrays of three or four, and columns that end with x, y, z or w; `names` of the body."""
    stems: dict[str, dict[str, str]] = {}
    for column in columns:
        plain = without_unit(column)
        last = (words_of(plain) or ("",))[-1]
        if 0 < len(last) <= 2 and last[-1] in "wxyz":
            stems.setdefault(plain[:-1], {})[last[-1]] = column
    lettered = {
        stem: tuple(of[c] for c in "wxyz" if c in of)
        for stem, of in stems.items()
        if {"x", "y", "z"} <= set(of)
    }
    every = [(stem, several, "wxyz") for stem, several in lettered.items()]
    every += [(name, tuple(c), "") for name, c in arrays.items() if len(c) in (3, 4)]
    own = {words_of(name) for name in (*names, *BASES) if name}
    return [one for each in every if (one := _vector(*each, own)) is not None]


def _vector(
    stem: str, columns: tuple[str, ...], order: str, own: set[tuple[str, ...]]
) -> Vector | None:
    words = words_of(stem)
    if set(words) & (UNREAL | {"acc", "accel", "acceleration", "force", "torque"}):
        return None
    named = any(set(name) <= set(words) for name in own) or not words
    if len(columns) == 4:
        return Vector(columns, "quaternion", order, "", named, words[:-1])
    frame = _FRAMES.get(words[-1], "") if len(words) > 1 else ""
    telling = set(
        words[:-1]
        if frame and set(words[:-1]) & (_LINEAR | _ANGULAR_WORDS | PLACE_WORDS)
        else words
    )
    frame = frame if len(telling) < len(set(words)) else ""
    body_names = [set(name) for name in own]
    rest = telling - NEUTRAL - {"p"}
    if telling & _ANGULAR_WORDS:
        kind = "angular"
    elif telling & _LINEAR:
        kind = "linear"
    elif telling & PLACE_WORDS or not rest or any(rest <= name for name in body_names):
        kind = "position"
    else:
        return None
    return Vector(columns, kind, "", frame if kind != "position" else "", named, words[:-1])


def of_vectors(vectors: Sequence[Vector]) -> Iterator[Layout]:
    """Layouts of vectors of a body, of those that name it where any do."""
    by_kind = {}
    for kind in ("position", "quaternion", "linear", "angular"):
        several = [one for one in vectors if one.kind == kind]
        by_kind[kind] = ([one for one in several if one.own] or several)[:_MOST]
    for x, p, v, w in product(*by_kind.values()):
        if len({*x.columns, *p.columns, *v.columns, *w.columns}) == 13:
            yield Layout(x.columns, p.columns, v.columns, w.columns, p.order, v.frame, w.frame)


def poses(table: Mapping[str, Array], vectors: Sequence[Vector]) -> Iterator[tuple[str, ...]]:
    """Columns of positions with quaternions of the same owner that move: w, x, y, z and x, y, z."""
    for p, x in product(vectors, vectors):
        if p.order and x.kind == "position" and x.owner == p.owner:
            position = np.column_stack([table[name] for name in x.columns])
            turning = is_turning(np.column_stack([table[name] for name in p.columns]))
            if turning and np.max(np.ptp(position, axis=0)) > 0.0:
                yield (*_scalar_first(p.columns, p.order), *x.columns)
