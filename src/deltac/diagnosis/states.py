"""Random admissible states of a mechanism, at which every term of its equations counts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.diagnosis.kane import Kane, Terms, multiplier_map, quaternions, times
from deltac.errors import InputError
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory

Array: TypeAlias = NDArray[np.float64]

WINDOW = (0.0, 10.0)
"""Times (s) that are drawn from, for laws that depend on time."""

SPREAD = 3.0
"""Speeds are this many times slower to this many times faster than the natural ones."""

ROUNDS, HOPELESS = 40, 4
"""Draws of `count` states, at most; and how many without a single admissible one are enough."""

NEWTON_STEPS = 60
ON_CONSTRAINTS = 1e-9
"""A state that meets its constraints to this (m, rad; relative for speeds) is admissible."""

RANK = 1e-12
WELL_CONDITIONED = 1e-2
"""Own speeds whose Y has a smaller ratio of singular values are near a singularity of the map."""

REGULAR = 1e-11
"""A mass matrix with a smaller eigenvalue than this, scaled to a diagonal of ones, is singular."""

FAR = 1e6
"""No coordinate or speed of an admissible state is larger than this, in its natural scale."""


@dataclass(frozen=True, eq=False)
class States:
    """States at which equations are tested, batch last, as a hand-written rhs takes them.

    `t` (B,) in s; `q` (n, B) and `u` (n, B) in the user's own coordinates and speeds, named by
    `coordinates` and `speeds`, or without a map in the mechanism's free ones.
    """

    t: Array
    q: Array
    u: Array
    coordinates: tuple[str, ...]
    speeds: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.t)

    def take(self, which: Any) -> States:
        """Some of the states."""
        return States(
            self.t[which], self.q[:, which], self.u[:, which], self.coordinates, self.speeds
        )

    def describe(self, k: int) -> Mapping[str, float]:
        """One state by name: ``t``, ``q.<coordinate>``, ``u.<speed>``."""
        return {
            "t": float(self.t[k]),
            **{f"q.{n}": float(x) for n, x in zip(self.coordinates, self.q[:, k])},
            **{f"u.{n}": float(x) for n, x in zip(self.speeds, self.u[:, k])},
        }


@dataclass(frozen=True, eq=False)
class Scales:
    """Natural scales: `length` (m) and `rate` (1/s); `lever` (n,) is the length for speeds in m/s, else 1.

    A motion u = lever·rate has inertia forces of the size of the forces that act at rest.
    """

    length: float
    rate: float
    lever: Array

    @property
    def speed(self) -> Array:
        """A natural speed for each free speed (n,), m/s or rad/s."""
        return self.lever * self.rate


def random_states(
    mechanism: Mechanism,
    coordinates: CoordinateMap | None = None,
    *,
    count: int = 64,
    seed: int = 0,
    window: tuple[float, float] = WINDOW,
) -> States:
    """States of a mechanism, drawn so that gravity, gyroscopic and all other terms are of one size.

    Angles lie anywhere on the circle, slides within the mechanism's own length, quaternions have unit
    length; speeds are about those at which inertia forces equal the forces at rest (√(g/l) of a
    pendulum), from a third of it to three times it; times lie in `window` (s). Positions and speeds meet
    all constraints. The same seed gives the same states.

    Raises InputError for a map that does not fit, or if too few states meet the constraints.
    """
    kane = Kane(mechanism, coordinates)
    return draw(kane, natural_scales(kane), count=count, seed=seed, window=window)


def draw(
    kane: Kane, scales: Scales, *, count: int, seed: int, window: tuple[float, float] = WINDOW
) -> States:
    """`random_states` of a mechanism that is written out already."""
    if count < 1:
        raise InputError(f"count is {count}; expected one state or more")
    rng = np.random.default_rng(seed)
    found: list[States] = []
    for done in range(ROUNDS):
        total = sum(map(len, found))
        if total >= count or (done >= HOPELESS and not total):
            break
        found.append(_draw_once(kane, scales, rng, count, window))
    total = sum(map(len, found))
    if total < count:
        raise InputError(
            f"only {total} of {count} random states of {kane.mechanism.name!r} are admissible: the others "
            "do not meet the constraints, or the coordinate map is singular there; hand over states="
        )
    joined = States(
        np.concatenate([s.t for s in found]),
        np.concatenate([s.q for s in found], axis=1),
        np.concatenate([s.u for s in found], axis=1),
        kane.coordinate_names,
        kane.speed_names,
    )
    return joined.take(slice(0, count))


def states_along(kane: Kane, run: Trajectory, rows: NDArray[np.intp]) -> States:
    """Rows of a run as states in own coordinates.

    Raises InputError for a run of another mechanism, and for a map whose inverse is not known.
    """
    for what, ours, theirs in (
        ("coordinates", kane.mechanism.coordinates.names, run.coordinates),
        ("speeds", kane.mechanism.speeds.names, run.speeds),
    ):
        if tuple(theirs) != ours:
            raise InputError(
                f"the run's {what} are {', '.join(theirs)}; those of {kane.mechanism.name!r} are "
                f"{', '.join(ours)}"
            )
    free = kane.mechanism.free
    t, q, u = run.t[rows], run.q[np.ix_(rows, free.q)].T, run.u[np.ix_(rows, free.u)].T
    own_q = kane.own_coordinates(t, q)
    if own_q is None:
        raise InputError(
            "the coordinate map is not linear with as many coordinates, so its inverse is unknown; give it "
            "inverse="
        )
    own_u, _ = own_speeds(kane, t, own_q, u)
    return States(t, own_q, own_u, kane.coordinate_names, kane.speed_names)


def some_rows(run: Trajectory, most: int) -> NDArray[np.intp]:
    """At most so many rows, evenly over a run."""
    return np.unique(np.linspace(0, len(run) - 1, min(len(run), most)).astype(np.intp))


def natural_scales(kane: Kane) -> Scales:
    """The length and the rate at which a mechanism's own forces move it (see `Scales`)."""
    length = _length(kane.mechanism)
    units = [kane.mechanism.speeds[int(k)].unit for k in kane.mechanism.free.u]
    lever = np.array([length if unit == "m/s" else 1.0 for unit in units])
    rng = np.random.default_rng(0)
    t = rng.uniform(*WINDOW, 32)
    q = _any_coordinates(kane.mechanism, length, rng, 32)
    at_rest = kane.terms(t, q, np.zeros((len(lever), 32)))
    force = np.abs(at_rest.force - at_rest.bias)
    inertia = np.einsum("bij,i,j->b", np.abs(at_rest.M), lever, lever)
    energy = lever @ force
    usable = np.isfinite(energy) & np.isfinite(inertia) & (inertia > 0.0)
    ratio = energy[usable] / inertia[usable]
    rate = float(np.sqrt(np.median(ratio))) if usable.any() else 0.0
    return Scales(length, rate if rate > 1e-6 else 1.0, lever)


def _length(mechanism: Mechanism) -> float:
    """The largest length (m) among joint placements, mass centres and radii of gyration; 1 if none."""
    number = mechanism.number
    found = [0.0]
    for joint in mechanism.joints:
        for place in (joint.position, joint.child_position):
            found.append(float(np.linalg.norm([number(x) for x in place])))
    for body in mechanism.bodies:
        found.append(float(np.linalg.norm([number(x) for x in body.mass_centre])))
        if not body.massless:
            trace = sum(number(body.inertia[k][k]) for k in range(3))
            found.append(float(np.sqrt(trace / (2.0 * number(body.mass)))))
    return max(found) or 1.0


def _any_coordinates(
    mechanism: Mechanism, length: float, rng: np.random.Generator, count: int
) -> Array:
    """Free coordinates (nq, count) without regard to constraints."""
    entries = [mechanism.coordinates[int(k)] for k in mechanism.free.q]
    reach = np.array([length if entry.unit == "m" else np.pi for entry in entries])
    q = reach[:, None] * rng.uniform(-1.0, 1.0, (len(entries), count))
    for place in quaternions(mechanism):
        turn = rng.standard_normal((4, count))
        q[place] = turn / np.linalg.norm(turn, axis=0)
    return q


def _draw_once(
    kane: Kane,
    scales: Scales,
    rng: np.random.Generator,
    count: int,
    window: tuple[float, float],
) -> States:
    """Up to `count` admissible states."""
    t = rng.uniform(*window, count)
    q = _any_coordinates(kane.mechanism, scales.length, rng, count)
    pace = SPREAD ** rng.uniform(-1.0, 1.0, count)
    u = scales.speed[:, None] * pace * rng.standard_normal((len(scales.lever), count))
    own_q = None if kane.own is not None and kane.own.inverse is None else q
    with np.errstate(all="ignore"):
        if own_q is None:  # the map leads from own coordinates only
            assert kane.own is not None
            own_q = np.pi * rng.uniform(-1.0, 1.0, (kane.own.own_q.shape[0], count))
        else:
            q = onto_positions(kane, t, q)
            u = onto_speeds(kane, t, q, u)
            moved = kane.own_coordinates(t, q)
            assert moved is not None
            own_q = moved
        own_u, regular = own_speeds(kane, t, own_q, u)
        good = regular & admissible(kane, scales, t, own_q, own_u)
    return States(t, own_q, own_u, kane.coordinate_names, kane.speed_names).take(good)


def own_speeds(kane: Kane, t: Array, own_q: Array, u: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Own speeds (p, B) whose motion is nearest to `u`, and where the map is regular."""
    if kane.own is None:
        return u, np.ones(u.shape[1], dtype=bool)
    still = kane.point(t, own_q, np.zeros((len(kane.speed_names), u.shape[1])))
    finite: NDArray[np.bool_] = np.asarray(
        np.isfinite(still.u).all(axis=0) & np.isfinite(still.Y).all(axis=(1, 2))
    )
    Y = np.where(finite[:, None, None], still.Y, 0.0)
    own_u = times(np.linalg.pinv(Y, rcond=RANK), np.where(finite, u - still.u, 0.0))
    if not Y.shape[2]:
        return own_u, finite
    size = np.linalg.norm(Y, axis=1, keepdims=True)
    values = np.linalg.svd(
        np.divide(Y, size, out=np.zeros_like(Y), where=size > 0.0), compute_uv=False
    )
    return own_u, finite & (values[:, -1] > WELL_CONDITIONED * values[:, 0])


def admissible(
    kane: Kane, scales: Scales, t: Array, own_q: Array, own_u: Array
) -> NDArray[np.bool_]:
    """Which states are finite and regular, and meet all constraints (B,)."""
    point = kane.point(t, own_q, own_u)
    terms = kane.terms(t, point.q, point.u)
    everything = [point.q, point.u, point.rest, terms.bias, terms.force, terms.gamma]
    good = np.logical_and.reduce([np.isfinite(x).all(axis=0) for x in everything])
    good &= _regular(terms.M)
    good &= (np.abs(point.u) < FAR * scales.speed[:, None]).all(axis=0)
    good &= np.abs(terms.phi).max(axis=0, initial=0.0) < ON_CONSTRAINTS
    speed = np.maximum(1.0, np.abs(point.u).max(axis=0, initial=0.0))
    good &= np.abs(terms.psi).max(axis=0, initial=0.0) < ON_CONSTRAINTS * speed
    return np.asarray(good)


def _regular(M: Array) -> NDArray[np.bool_]:
    """Which mass matrices (B, n, n) are positive definite by a margin, whatever the units of the speeds."""
    diagonal = np.einsum("bii->bi", M)
    good: NDArray[np.bool_] = np.asarray(
        np.isfinite(M).all(axis=(1, 2)) & (diagonal > 0.0).all(axis=1)
    )
    if good.any():
        size = np.sqrt(diagonal[good])
        scaled = M[good] / (size[:, :, None] * size[:, None, :])
        good[good] = np.linalg.eigvalsh(scaled)[:, :1].min(axis=1, initial=1.0) > REGULAR
    return good


def onto_positions(kane: Kane, t: Array, q: Array) -> Array:
    """Coordinates moved onto φ = 0 by Newton steps, least in the mass metric; some may not arrive."""
    holonomic = np.array(kane.rows.holonomic, dtype=bool)
    if not holonomic.any():
        return q
    still = np.zeros((len(kane.mechanism.free.u), q.shape[1]))
    for _ in range(NEWTON_STEPS):
        terms = kane.terms(t, q, still)
        phi = np.where(holonomic[:, None], terms.phi, 0.0)
        if np.nan_to_num(np.abs(phi)).max() < 1e-14:
            break
        q = q + times(kane.rates(q), _least(terms, holonomic, -phi))
        for place in kane.quaternions:
            q[place] /= np.linalg.norm(q[place], axis=0)
    return q


def onto_speeds(kane: Kane, t: Array, q: Array, u: Array) -> Array:
    """Speeds moved onto ψ = 0, least in the mass metric."""
    every = np.ones(len(kane.rows), dtype=bool)
    if not len(kane.rows):
        return u
    for _ in range(2):
        terms = kane.terms(t, q, u)
        u = u + _least(terms, every, -terms.psi)
    return u


def _least(terms: Terms, rows: NDArray[np.bool_], target: Array) -> Array:
    """The change of speeds, least in the mass metric, that G maps to `target` on some rows."""
    G = np.where(rows[:, None], terms.G, 0.0)
    usable = np.isfinite(terms.M).all(axis=(1, 2)) & np.isfinite(G).all(axis=(1, 2))
    usable &= np.isfinite(target).all(axis=0)
    step = np.zeros(terms.bias.shape)
    if usable.any():
        response, inverse = multiplier_map(terms.M[usable], G[usable])
        step[:, usable] = times(response, times(inverse, target[:, usable]))
    return step
