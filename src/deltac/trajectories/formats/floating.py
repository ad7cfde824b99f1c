"""Where a foreign log keeps the body that floats: `floating_base`.

Simulators agree on little here: the quaternion stands before the position or after it, with its scalar first
or last; velocity and angular velocity are in the components of the world or of the body, and either may come
first. Names seldom tell, and the motion does: only four consecutive columns are a unit quaternion that turns,
and only three, in one frame, are the angular velocity by which it does.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from deltac import rotations
from deltac.trajectories.rates import continuous, rotation_vectors
from deltac.trajectories.trajectory import FloatArray

AGREES = 0.1
"""How much of their changes coordinates may differ from the integrals of their speeds."""

_CLEARLY = 0.5
"""A frame other than the usual one is taken where that misses so much more."""

_UNIT, _TURNS = 1e-3, 1e-6

_PARTS = 40
"""Parts of a log over which increments are summed."""

_LEAST = 0.05
"""An axis along which there is less of the motion, as a fraction, tells nothing."""

_ORDERS = {"wxyz": (0, 1, 2, 3), "xyzw": (3, 0, 1, 2)}  # places of w, x, y, z


@dataclass(frozen=True)
class Floating:
    """The places of a floating body's columns in a table, in the schema's order, and how they are meant.

    position (3,), quaternion (4,), scalar first, linear and angular velocity (3,). `order` is that of the
    quaternion in the table, "wxyz" or "xyzw"; the frames of both velocities are "world" or "body".
    `miss`: how far the motion differs from what they say, as a fraction.
    """

    position: range
    quaternion: tuple[int, ...]
    linear: range
    angular: range
    order: str
    linear_frame: str
    angular_frame: str
    miss: float

    @property
    def places(self) -> frozenset[int]:
        """Those of all 13 columns."""
        return frozenset((*self.position, *self.quaternion, *self.linear, *self.angular))

    def __str__(self) -> str:
        frames = (
            f"velocity in {self.linear_frame}, angular velocity in {self.angular_frame} components"
        )
        return f"quaternion {self.order}, {frames}"


@dataclass(frozen=True)
class _Rate:
    """A reading of three columns `at` as the rate, in a frame, of what moves `of` other columns."""

    miss: float
    frame: str
    at: range
    of: range


def floating_base(
    t: FloatArray, table: FloatArray, vectors: Sequence[range] = ()
) -> Floating | None:
    """What of the columns (T, n) of a table, in SI units, is a body that moves as its velocities say.

    t (T,), s. `vectors`: places of three columns that are a vector by their names. Position and velocity are
    these, or stand beside the quaternion and the angular velocity. None where nothing moves so.
    """
    if table.shape[1] < 13 or len(t) < 4:
        return None
    readings = (
        one
        for first, order in product(_unit_quaternions(table), _ORDERS)
        for one in _readings(t, table, first, order, vectors)
    )
    return min(readings, key=lambda one: one.miss, default=None)


def moving_poses(
    table: FloatArray, letters: Sequence[str], positions: Collection[int]
) -> Iterator[tuple[int, ...]]:
    """Positions and quaternions beside each other that move, without velocities, by letters of the columns.

    `letters`: of each column the last of its name; `positions`: columns that may be of a position. Gives the
    places of w, x, y, z of the quaternion and of x, y, z of the position.
    """
    for first in _unit_quaternions(table):
        four = range(first, first + 4)
        if sorted(letters[k] for k in four) != ["w", "x", "y", "z"]:
            continue
        for three in (range(first - 3, first), range(first + 4, first + 7)):
            if set(three) <= set(positions) and [letters[k] for k in three] == ["x", "y", "z"]:
                place = {letters[k]: k for k in four}
                if np.max(np.ptp(table[:, three], axis=0)) > 0.0:
                    yield (*(place[c] for c in "wxyz"), *three)


def _unit_quaternions(table: FloatArray) -> Iterator[int]:
    """Where four consecutive columns have length one, and turn."""
    for first in range(table.shape[1] - 3):
        four = table[:, first : first + 4]
        one = (
            np.max(np.abs(np.sum(four * four, axis=1) - 1.0)) < _UNIT
        )  # False where a value is missing
        if one and np.max(np.ptp(four, axis=0)) > _TURNS:
            yield first


def _readings(
    t: FloatArray, table: FloatArray, first: int, order: str, vectors: Sequence[range]
) -> Iterator[Floating]:
    """The reading of the quaternion that begins at a column; none where nothing moves by it."""
    four = range(first, first + 4)
    quaternion = tuple(first + k for k in _ORDERS[order])
    p = continuous(table[:, quaternion])
    turned = {frame: rotation_vectors(p, frame) for frame in ("body", "world")}
    every = [range(k, k + 3) for k in range(table.shape[1] - 2)]
    angular = _best(
        (
            _Rate(_miss(turned[frame], _integral(t, table[:, w])), frame, w, four)
            for w, frame in product(every, turned)
            if not set(w) & set(four)
        ),
        usual="body",
    )
    if angular is None:
        return
    R, w = rotations.matrices(p), angular.at
    free = [x for x in every if not set(x) & {*four, *w}]
    places, speeds = (
        [x for x in free if x in vectors or x.stop == known.start or x.start == known.stop]
        for known in (four, w)
    )
    fitting = [one for one in _linear(t, table, R, places, speeds) if one.miss < AGREES]
    # Sliders and wheels beside the body are the rates of their coordinates as well: the usual order decides.
    first_of_all = [one for one in fitting if one.of.stop == four.start and one.at.stop == w.start]
    linear = _best(first_of_all or fitting, usual="world")
    if linear is not None:
        miss = angular.miss + linear.miss
        yield Floating(
            linear.of, quaternion, linear.at, w, order, linear.frame, angular.frame, miss
        )


def _linear(
    t: FloatArray, table: FloatArray, R: FloatArray, places: list[range], speeds: list[range]
) -> Iterator[_Rate]:
    """Readings of triples as the velocities of others."""
    for v in speeds:
        own = table[:, v]
        by_frame = {"world": own, "body": np.einsum("tij,tj->ti", R, own)}
        for frame, velocity in by_frame.items():
            told = _integral(t, velocity)
            for x in places:
                if not set(x) & set(v):
                    yield _Rate(_miss(np.diff(table[:, x], axis=0), told), frame, v, x)


def _best(readings: Iterable[_Rate], usual: str) -> _Rate | None:
    """The reading that misses least; the one in the usual frame where it misses hardly more."""
    fitting = [one for one in readings if one.miss < AGREES]
    best = min(fitting, key=lambda one: one.miss, default=None)
    plain = min(
        (one for one in fitting if one.frame == usual), key=lambda one: one.miss, default=None
    )
    if best is None or plain is None:
        return best
    return plain if best.miss > _CLEARLY * plain.miss else best


def _integral(t: FloatArray, speeds: FloatArray) -> FloatArray:
    """What speeds (T, 3) move over each interval (T−1, 3)."""
    result: FloatArray = 0.5 * np.diff(t)[:, None] * (speeds[1:] + speeds[:-1])
    return result


def _miss(moved: FloatArray, told: FloatArray) -> float:
    """How far increments (T−1, 3) differ from what speeds say, as a fraction, along the worst axis.

    Summed over some rows the noise of coordinates falls out; then they must agree twice as well.
    """
    rows = np.arange(0, len(moved), max(1, len(moved) // _PARTS))
    sums = (np.add.reduceat(values, rows, axis=0) for values in (moved, told))
    return min(_apart(moved, told), 2.0 * _apart(*sums))


def _apart(moved: FloatArray, told: FloatArray) -> float:
    size = np.abs(moved).sum(axis=0) + np.abs(told).sum(axis=0)
    apart = np.abs(moved - told).sum(axis=0)
    telling = size > _LEAST * size.sum()
    return float(np.max(apart[telling] / size[telling])) if telling.any() else np.inf
