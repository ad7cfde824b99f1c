"""Random admissible states of a mechanism, at which every term of its equations counts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Sized
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deltac.arrays import (
    ASSEMBLED,
    NEWTON_STEPS,
    ROOT_EPS,
    ROUGHLY,
    ROUNDED,
    SAME,
    Array,
)
from deltac.calls.arguments import checked
from deltac.diagnosis.residuals.kane import WINDOW, Kane, any_coordinates, times
from deltac.dynamics.admissible import onto_positions, onto_speeds
from deltac.dynamics.equations_of_motion import evaluate_at, matrices
from deltac.dynamics.gaps import Gap, gaps, sliding_point
from deltac.dynamics.singular_inertia import singular_inertia, unit_diagonal
from deltac.dynamics.spatial import SX
from deltac.errors import InputError, ModelError, StateError
from deltac.foreign.limits import Limits
from deltac.mechanism.contact import Contact
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.friction import FrictionLaw, JointFriction, PointFriction
from deltac.mechanism.mechanism import Mechanism
from deltac.models import ModelLike, load_model
from deltac.trajectories import Trajectory

SPREAD = 3.0
"""Speeds are this many times slower to this many times faster than the natural ones; so are slips than the
speeds at which friction changes, where tanh differs from a step."""

ROUNDS, HOPELESS = 40, 4
"""Draws of `count` states, at most; and how many without a single admissible one are enough."""

TRIAL_STATES = 12
"""States at which a hypothesis is tried, or a way to call a function."""

WELL_CONDITIONED = 1e-2
"""Own speeds whose Y has a smaller ratio of singular values are near a singularity of the map; a path on
which the loops and own coordinates have one may change sides."""

PATH_STEPS = 48
"""Steps of a path of assembled configurations."""


@checked
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

    def take(self, which: slice | Sequence[int] | NDArray[np.bool_] | NDArray[np.intp]) -> States:
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

    def in_words(self, k: int) -> str:
        """One state by name: "t = 0, q.hinge = 1.2"."""
        return ", ".join(f"{name} = {value:.6g}" for name, value in self.describe(k).items())


@checked
def random_states(
    model: ModelLike,
    coordinates: CoordinateMap | str | None = None,
    *,
    count: int = 64,
    seed: int = 0,
    window: tuple[float, float] = WINDOW,
) -> States:
    """States of a model, drawn so that gravity, gyroscopic and all other terms are of one size.

    Angles lie anywhere on the circle, slides within the mechanism's own length, quaternions have unit
    length; speeds are about those at which inertia forces equal the forces at rest (√(g/l) of a
    pendulum), from a third of it to three times it; times lie in `window` (s). Positions and speeds meet
    all constraints. The same seed gives the same states. Where the constraints say what own coordinates
    leave open, the states are in the mechanism's coordinates and own speeds, and the loops are assembled
    as at the model's start.

    Raises InputError for a map that does not fit, or if too few states meet the constraints.
    """
    loaded = load_model(model)
    kane = Kane(loaded.mechanism, coordinates, loaded.first)
    return draw(kane, count=count, seed=seed, window=window)


def draw(kane: Kane, *, count: int, seed: int, window: tuple[float, float] = WINDOW) -> States:
    """`random_states` of a mechanism that is written out already."""
    if count < 1:
        raise InputError(f"count is {count}; expected one state or more")
    if seed < 0:
        raise InputError(f"seed is {seed}; expected a whole number, 0 or more")
    if len(window) != 2 or not -np.inf < window[0] <= window[1] < np.inf:
        raise InputError(f"window is {window}; expected a first and a last time, s")
    Limits.current().check("rows", count, "random states:")
    rng = np.random.default_rng(seed)
    batches: list[States] = []
    for done in range(ROUNDS):
        total = sum(map(len, batches))
        if total >= count or (done >= HOPELESS and not total):
            break
        batches.append(_draw_once(kane, rng, count, window))
    total = sum(map(len, batches))
    if total < count:
        raise StateError(
            f"only {total} of {count} random states of {kane.mechanism.name!r} are admissible: the others "
            "do not meet the constraints, or the coordinate map is singular there; hand over states="
        )
    return joined(batches).take(slice(0, count))


def in_user_coordinates(kane: Kane, states: States) -> States:
    """The states as functions of the user's take them: where these leave coordinates to assembly, without."""
    if not kane.assembled or states.coordinates == kane.user_names:
        return states
    y, _ = kane.user_coordinates(states.t, states.q, states.u)
    return States(states.t, y, states.u, kane.user_names, states.speeds)


def from_user_coordinates(kane: Kane, states: States) -> States:
    """States in the user's coordinates, assembled; InputError where one cannot be."""
    q, good = assembled_at(kane, states.t, states.q)
    if not good.all():
        k = int(np.argmin(good))
        raise StateError(
            f"the mechanism cannot be assembled at state {states.in_words(k)}, or only beyond a "
            f"singular configuration of {kane.mode}"
        )
    return States(states.t, q, states.u, kane.coordinate_names, states.speeds)


def assembled_at(kane: Kane, t: Array, y: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Coordinates (nq, B) assembled at times t (B,) and own coordinates y (ny, B), and where that succeeded.

    From `kane.base` along a straight line of t and y in short steps, each solved by Newton's method: so the
    loops stay in the same assembly, which changes only through a singular configuration.
    """
    t0, q0 = kane.base
    count = y.shape[1]
    still, at_rest = (
        np.zeros((len(kane.system.free_u), count)),
        np.zeros((len(kane.speed_names), count)),
    )
    q = np.repeat(q0[:, None], count, axis=1)
    y0, _ = kane.user_coordinates(np.full(count, t0), q, at_rest)
    holonomic = np.array(kane.rows.holonomic, dtype=bool)
    good = np.ones(count, dtype=bool)
    with np.errstate(all="ignore"):
        for share in np.linspace(0.0, 1.0, PATH_STEPS + 1)[1:]:
            t_here, y_here = t0 + share * (t - t0), y0 + share * (y - y0)

            def ahead(q: Array, t: Array = t_here, y: Array = y_here) -> tuple[Array, Array]:
                *_, W = kane.motion.ties(t, q, still)
                return kane.user_coordinates(t, q, at_rest)[0] - y, kane.user_slope(t, q) @ W

            q = onto_positions(kane.motion, t_here, q, further=ahead)
            _, phi, _, G, _ = kane.motion.ties(t_here, q, still)
            residual, slope = ahead(q)
            violation = np.abs(np.concatenate([phi[holonomic], residual])).max(axis=0)
            good &= violation < ASSEMBLED
            good &= _well_conditioned(np.concatenate([G[:, holonomic], slope], axis=1))
    return q, good


def _well_conditioned(rows: Array) -> NDArray[np.bool_]:
    """Which matrices (B, k, n), their rows of unit length, are finite and far from losing a rank (B,)."""
    finite: NDArray[np.bool_] = np.asarray(np.isfinite(rows).all(axis=(1, 2)))
    rows = np.where(finite[:, None, None], rows, 0.0)
    size = np.linalg.norm(rows, axis=2, keepdims=True)
    unit = np.divide(rows, size, out=np.zeros_like(rows), where=size > 0.0)
    values = np.linalg.svd(unit, compute_uv=False)
    return np.asarray(finite & (values[:, -1] > WELL_CONDITIONED * values[:, 0]))


def states_along(kane: Kane, run: Trajectory, rows: NDArray[np.intp]) -> States:
    """Rows of a run in the mechanism's order as states in own coordinates.

    Raises InputError for a map whose inverse is not known.
    """
    free = kane.mechanism.free
    return own_states(kane, run.t[rows], run.q[rows].T[free.q], run.u[rows].T[free.u])


def own_states(kane: Kane, t: Array, q: Array, u: Array) -> States:
    """States of the mechanism's free coordinates and speeds in own ones.

    Raises InputError for a map whose inverse is not known.
    """
    own_q = kane.own_coordinates(t, q)
    if own_q is None:
        raise ModelError(
            "the coordinate map is not linear with as many coordinates, so its inverse is unknown; give it "
            "inverse="
        )
    own_u, _ = own_speeds(kane, t, own_q, u)
    return States(t, own_q, own_u, kane.coordinate_names, kane.speed_names)


def some_rows(run: Sized, most: int) -> NDArray[np.intp]:
    """At most so many rows or states, evenly over a run or over states."""
    return np.unique(np.linspace(0, len(run) - 1, min(len(run), most)).astype(np.intp))


def _draw_once(
    kane: Kane,
    rng: np.random.Generator,
    count: int,
    window: tuple[float, float],
) -> States:
    """Up to `count` admissible states."""
    t = rng.uniform(*window, count)
    q = any_coordinates(kane.mechanism, kane.scales.length, rng, count)
    pace = SPREAD ** rng.uniform(-1.0, 1.0, count)
    u = kane.scales.speed[:, None] * pace * rng.standard_normal((len(kane.scales.lever), count))
    own_q = None if kane.own is not None and kane.own.inverse is None else q
    assembled = np.ones(count, dtype=bool)
    with np.errstate(all="ignore"):
        if own_q is None:  # the map leads from own coordinates only
            assert kane.own is not None
            own_q = np.pi * rng.uniform(-1.0, 1.0, (kane.own.own_q.shape[0], count))
        else:
            q = onto_positions(kane.motion, t, q, tolerance=1e-14)
            u = onto_speeds(kane.motion, t, q, u, passes=2)
            moved = kane.own_coordinates(t, q)
            assert moved is not None
            own_q = moved
            if kane.mode:
                y, _ = kane.user_coordinates(t, q, np.zeros((len(kane.speed_names), count)))
                own_q, assembled = assembled_at(kane, t, y)
        own_u, regular = own_speeds(kane, t, own_q, u)
        states = States(t, own_q, own_u, kane.coordinate_names, kane.speed_names)
        return states.take(regular & assembled & admissible(kane, states))


def own_speeds(kane: Kane, t: Array, own_q: Array, u: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Own speeds (p, B) whose motion is nearest to `u`, and where the map is regular."""
    if kane.own is None:
        return u, np.ones(u.shape[1], dtype=bool)
    still = kane.point(t, own_q, np.zeros((len(kane.speed_names), u.shape[1])))
    finite: NDArray[np.bool_] = np.asarray(
        np.isfinite(still.u).all(axis=0) & np.isfinite(still.Y).all(axis=(1, 2))
    )
    Y = np.where(finite[:, None, None], still.Y, 0.0)
    own_u = times(np.linalg.pinv(Y, rcond=SAME), np.where(finite, u - still.u, 0.0))
    if not Y.shape[2]:
        return own_u, finite
    return own_u, finite & _well_conditioned(Y.transpose(0, 2, 1))


def admissible(kane: Kane, states: States) -> NDArray[np.bool_]:
    """Which states are finite and regular, and meet all constraints (B,)."""
    t, point = states.t, kane.point(states.t, states.q, states.u)
    terms = kane.motion.terms(t, point.q, point.u)
    everything = [point.q, point.u, point.rest, terms.bias, terms.force, terms.gamma]
    good = np.logical_and.reduce([np.isfinite(x).all(axis=0) for x in everything])
    regular = _regular(terms.M)
    # One state alone, such as zero, may be singular where the others are not.
    if len(t) > 1 and not regular.any() and (error := singular_inertia(kane.mechanism, terms.M)):
        raise error
    good &= regular
    good &= np.abs(terms.phi).max(axis=0, initial=0.0) < ASSEMBLED
    speed = np.maximum(1.0, np.abs(point.u).max(axis=0, initial=0.0))
    good &= np.abs(terms.psi).max(axis=0, initial=0.0) < ASSEMBLED * speed
    return np.asarray(good)


def _regular(M: Array) -> NDArray[np.bool_]:
    """Which mass matrices (B, n, n) are positive definite beyond rounding, in any units of the speeds."""
    finite = np.isfinite(M).all(axis=(1, 2), keepdims=True)
    scaled, _ = unit_diagonal(np.where(finite, M, 0.0))
    return np.asarray(np.linalg.eigvalsh(scaled)[:, :1].min(axis=1, initial=1.0) > ROUNDED)


# --- states at which friction and contact show: slow slip, and shapes that just overlap ----------
# Random states slide a thousand times faster than the width over which friction passes through
# zero, and small shapes seldom meet in them. So some states are drawn for each of these elements;
# where that fails, the check says what it has not seen.

EACH = TRIAL_STATES // 2
"""States that are drawn for each scale of each element, of four times as many candidates."""

COVERED = (0.2, 4.0)
"""A slip speed in this range of a scale counts as about it."""


@dataclass(frozen=True, eq=False)
class Place:
    """Where something may slide: a joint's speed, a point on a plane, a contact point of two shapes.

    `slip` (k,) is the slip velocity and `gap` the signed gap (None: always closed), in symbols; `scales`
    are slip speeds (m/s or rad/s) at which friction changes, by name; `depth` (m) is an overlap.
    """

    kane: Kane
    element: str
    slip: SX
    gap: SX | None
    scales: dict[str, float]
    depth: float = 0.0

    @cached_property
    def _function(self) -> ca.Function:
        s = self.kane.system
        gap = ca.SX(-1) if self.gap is None else self.gap
        approach = ca.jtimes(gap, s.q, s.W)
        return self.kane.function([self.slip, ca.jacobian(self.slip, s.u), gap, approach])

    def at(self, t: Array, q: Array, u: Array) -> tuple[Array, Array, Array, Array]:
        """Slip (k, B), its slope by the speeds (B, k, n), gap (B,) and its slope (B, 1, n)."""
        n = len(u)
        slip, slope, gap, approach = evaluate_at(self._function, t[None, :], q, u)
        return slip, matrices(slope, len(slip), n), gap[0], matrices(approach, 1, n)


def places(kane: Kane) -> tuple[Place, ...]:
    """Every place of friction or contact that the free speeds move."""
    return tuple(_places(kane))


def _places(kane: Kane) -> Iterator[Place]:
    s, mechanism = kane.system, kane.mechanism
    nothing = ca.SX(0, 1)
    for element in mechanism.elements:
        if isinstance(element, JointFriction):
            where = mechanism.speeds.of(element.joint)
            for k, law in zip(range(where.start, where.stop), element.laws):
                if k in s.free_u:
                    name = f"friction {element.name!r}"
                    yield Place(kane, name, s.u_all[k], None, _scales(mechanism, law))
        elif isinstance(element, PointFriction):
            touch = sliding_point(s, element.body, element.point, element.on, element.normal)
            slip = _slip(touch)
            yield Place(
                kane, f"friction {element.name!r}", slip, None, _scales(mechanism, element.friction)
            )
        elif isinstance(element, Contact):
            rubbing, depth = element.friction, ROUGHLY * element.thickness(mechanism.number)
            if not np.isfinite(depth):
                depth = 1e-3
            scales = {} if rubbing is None else _scales(mechanism, rubbing)
            for gap in gaps(s, element.first, element.second):
                slip = nothing if rubbing is None else _slip(gap)
                yield Place(kane, f"contact {element.name!r}", slip, gap.gap, scales, depth)


def _scales(mechanism: Mechanism, law: FrictionLaw) -> dict[str, float]:
    scales = {"width": mechanism.number(law.width)}
    if law.stribeck is not None:
        scales["Stribeck speed"] = mechanism.number(law.stribeck)
    return scales


def _slip(gap: Gap) -> SX:
    velocity = gap.relative_velocity
    return velocity - ca.dot(gap.n, velocity) * gap.n


# --- states ------------------------------------------------------------------------------------------


def close_states(kane: Kane, where: tuple[Place, ...], seed: int) -> States | None:
    """Admissible states of slow slip and small overlap, some for each place and scale; None if none."""
    if not where:
        return None
    try:
        base = draw(kane, count=4 * EACH, seed=seed)
    except InputError:
        return None
    rng = np.random.default_rng(seed)
    batches: list[States] = []
    for place in where:
        among = (
            sum(other.element == place.element for other in where) if place.gap is not None else 1
        )
        share = max(1, EACH // among)
        for speed in place.scales.values() or (None,):
            states = base if place.gap is None else _overlapping(place, base, rng)
            if speed is not None and len(states):
                states = _sliding(place, states, speed * SPREAD ** rng.uniform(-1, 1, len(states)))
            if len(states):
                with np.errstate(all="ignore"):
                    good = admissible(kane, states)
                    good &= _about(place, states, speed)
                batches.append(states.take(np.flatnonzero(good)[:share]))
    return joined(batches) if any(map(len, batches)) else None


def joined(states: list[States]) -> States:
    """Several states of the same coordinates, one after the other."""
    return States(
        np.concatenate([s.t for s in states]),
        np.concatenate([s.q for s in states], axis=1),
        np.concatenate([s.u for s in states], axis=1),
        states[0].coordinates,
        states[0].speeds,
    )


def _overlapping(place: Place, base: States, rng: np.random.Generator) -> States:
    """States moved, least in the mass metric, until the shapes overlap a little."""
    kane, t = place.kane, base.t
    point = kane.point(t, base.q, base.u)
    q, u, still = point.q, point.u, np.zeros_like(point.u)
    target = -place.depth * rng.uniform(0.1, 1.0, len(base))

    def excess(q: Array) -> tuple[Array, Array]:
        _, _, gap, approach = place.at(t, q, still)
        return (gap - target)[None], approach

    with np.errstate(all="ignore"):
        q = onto_positions(kane.motion, t, q, tolerance=1e-14, most=NEWTON_STEPS, further=excess)
        good = np.isfinite(q).all(axis=0)
        own_q = kane.own_coordinates(t, q)
        if own_q is None:  # the map leads from own coordinates only: by chance
            return base.take(_about(place, base, None))
        t, q, u, own_q = t[good], q[:, good], u[:, good], own_q[:, good]
        own_u, regular = own_speeds(kane, t, own_q, onto_speeds(kane.motion, t, q, u, passes=2))
    return States(t, own_q, own_u, base.coordinates, base.speeds).take(regular)


def _sliding(place: Place, states: States, speed: Array) -> States:
    """States whose slip has these speeds (B,), by the least change of own speeds."""
    kane = place.kane
    u = states.u
    with np.errstate(all="ignore"):
        for slowed in (True, False):  # slow down, then set the slip
            point = kane.point(states.t, states.q, u)
            slip, slope, _, _ = place.at(states.t, point.q, point.u)
            if slowed:
                parts = _parts(slope, point.u)
                u = u * np.minimum(1.0, speed / ROUGHLY / np.maximum(parts, 1e-300))
                continue
            terms = kane.motion.terms(states.t, point.q, point.u)
            size = np.linalg.norm(slip, axis=0)
            missing = slip * (speed / np.where(size > 0.0, size, 1.0) - 1.0)
            rows = np.concatenate([slope, terms.G], axis=1) @ point.Y
            violation = np.concatenate([missing, -terms.psi])
            good = np.isfinite(rows).all(axis=(1, 2)) & np.isfinite(violation).all(axis=0)
            u = u.copy()
            u[:, good] += times(np.linalg.pinv(rows[good], rcond=SAME), violation[:, good])
    return States(states.t, states.q, u, states.coordinates, states.speeds)


def _parts(slope: Array, u: Array) -> Array:
    """The largest component of slip if all its parts had one sign (B,)."""
    return np.asarray(times(np.abs(slope), np.abs(u)).max(axis=0, initial=0.0))


def _about(place: Place, states: States, speed: float | None) -> NDArray[np.bool_]:
    """Which states touch there, with a slip about a speed (None: any)."""
    point = place.kane.point(states.t, states.q, states.u)
    slip, slope, gap, _ = place.at(states.t, point.q, point.u)
    touching: NDArray[np.bool_] = np.asarray(gap < 0.0)
    if speed is None:
        return touching
    size = np.linalg.norm(slip, axis=0)
    slow = (COVERED[0] * speed <= size) & (size <= COVERED[1] * speed)
    # Of the digits of a difference of larger speeds, half are to be left.
    return np.asarray(touching & slow & (ROOT_EPS * _parts(slope, point.u) < size))


# --- what was not seen -------------------------------------------------------------------------------


def not_sampled(where: tuple[Place, ...], states: States) -> tuple[str, ...]:
    """What of friction and contact none of the states shows, in words."""
    covered: dict[str, bool] = {}
    for place in where:
        if place.gap is not None:
            words = f"{place.element}, whose shapes overlap at none of the states"
            covered[words] = covered.get(words, False) or bool(_about(place, states, None).any())
        for name, speed in place.scales.items():
            rubbing = "friction of " if place.gap is not None else ""
            words = f"{rubbing}{place.element} at slips about its {name} of {speed:.3g}"
            covered[words] = covered.get(words, False) or bool(_about(place, states, speed).any())
    return tuple(words for words, sampled in covered.items() if not sampled)
