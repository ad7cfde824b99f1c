"""States at which friction and contact show: slow slip, and shapes that just overlap.

Random states slide a thousand times faster than the width over which friction passes through zero, and
small shapes seldom meet in them. So some states are drawn for each of these elements; where that fails,
the check says what it has not seen.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deltac.diagnosis.kane import Kane, times
from deltac.diagnosis.states import Scales, States, admissible, draw, onto_speeds, own_speeds
from deltac.dynamics.contact import rubbing_point
from deltac.dynamics.equations_of_motion import evaluate, matrices
from deltac.dynamics.gaps import Gap, all_velocities, gaps
from deltac.dynamics.kkt import least_squares
from deltac.dynamics.spatial import SX
from deltac.errors import InputError
from deltac.mechanism.contact import Contact
from deltac.mechanism.friction import FrictionLaw, JointFriction, PointFriction
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.shapes import Box, Capsule, Shape, Sphere

Array: TypeAlias = NDArray[np.float64]

EACH = 6
"""States that are drawn for each scale of each element."""

CANDIDATES = 4 * EACH
"""States that are tried for it."""

ABOUT = 3.0
"""Slip speeds are drawn from a third of a scale to three times it, where tanh differs from a step."""

COVERED = (0.2, 4.0)
"""A slip speed in this range of a scale counts as about it."""

OTHERS = 30.0
"""All other motion is slowed to this many times the slip: a small difference of large speeds is rounding."""

ROUNDED = 1e5
"""A slip this many times smaller than the speeds it is the difference of is not used."""

DEPTH = 0.1
"""Overlap, as a share of the smallest dimension of two shapes, down to which states are drawn."""

NEWTON_STEPS = 30

RANK = 1e-10
"""Singular values below this share of the largest count as zero."""


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
        approach = ca.jtimes(gap, s.q, ca.jacobian(s.qdot, s.u))
        return self.kane.function([self.slip, ca.jacobian(self.slip, s.u), gap, approach])

    def at(self, t: Array, q: Array, u: Array) -> tuple[Array, Array, Array, Array]:
        """Slip (k, B), its slope by the speeds (B, k, n), gap (B,) and its slope (B, 1, n)."""
        n = len(u)
        slip, slope, gap, approach = evaluate(self._function, t[None, :], q, u)
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
            slip = _slip(kane, rubbing_point(s, element))
            yield Place(
                kane, f"friction {element.name!r}", slip, None, _scales(mechanism, element.law)
            )
        elif isinstance(element, Contact):
            rubbing, depth = element.friction, _depth(mechanism, element)
            scales = {} if rubbing is None else _scales(mechanism, rubbing)
            for gap in gaps(s, element.first, element.second):
                slip = nothing if rubbing is None else _slip(kane, gap)
                yield Place(kane, f"contact {element.name!r}", slip, gap.gap, scales, depth)


def _scales(mechanism: Mechanism, law: FrictionLaw) -> dict[str, float]:
    found = {"width": mechanism.number(law.width)}
    if law.stribeck is not None:
        found["Stribeck speed"] = mechanism.number(law.stribeck)
    return found


def _slip(kane: Kane, gap: Gap) -> SX:
    velocity = gap.relative_velocity(kane.system, all_velocities(kane.system))
    return velocity - ca.dot(gap.n, velocity) * gap.n


def _depth(mechanism: Mechanism, element: Contact) -> float:
    def thickness(shape: Shape) -> float:
        if isinstance(shape, Sphere | Capsule):
            return 2.0 * mechanism.number(shape.radius) or np.inf
        return min(map(mechanism.number, shape.size)) if isinstance(shape, Box) else np.inf

    least = DEPTH * min(thickness(element.first), thickness(element.second))
    return float(least) if np.isfinite(least) else 1e-3


# --- states ------------------------------------------------------------------------------------------


def close_states(kane: Kane, scales: Scales, where: tuple[Place, ...], seed: int) -> States | None:
    """Admissible states of slow slip and small overlap, some for each place and scale; None if none."""
    if not where:
        return None
    try:
        base = draw(kane, scales, count=CANDIDATES, seed=seed)
    except InputError:
        return None
    rng = np.random.default_rng(seed)
    found: list[States] = []
    for place in where:
        among = (
            sum(other.element == place.element for other in where) if place.gap is not None else 1
        )
        wanted = max(1, EACH // among)
        for speed in place.scales.values() or (None,):
            states = base if place.gap is None else _overlapping(place, base, rng)
            if speed is not None and len(states):
                states = _sliding(place, states, speed * ABOUT ** rng.uniform(-1, 1, len(states)))
            if len(states):
                with np.errstate(all="ignore"):
                    good = admissible(kane, scales, states.t, states.q, states.u)
                    good &= _about(place, states, speed)
                found.append(states.take(np.flatnonzero(good)[:wanted]))
    return joined(found) if any(map(len, found)) else None


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
    """States moved by Newton steps, least in the mass metric, until the shapes overlap a little."""
    kane = place.kane
    point = kane.point(base.t, base.q, base.u)
    t, q, u = base.t, point.q, point.u
    still = np.zeros_like(u)
    target = -place.depth * rng.uniform(0.1, 1.0, len(base))
    holonomic = np.array(kane.rows.holonomic, dtype=bool)
    with np.errstate(all="ignore"):
        for _ in range(NEWTON_STEPS):
            terms = kane.motion.terms(t, q, still)
            _, _, gap, approach = place.at(t, q, still)
            rows = np.concatenate([terms.G[:, holonomic], approach], axis=1)
            off = np.concatenate([terms.phi[holonomic], (gap - target)[None, :]])
            usable = np.isfinite(rows).all(axis=(1, 2)) & np.isfinite(off).all(axis=0)
            usable &= np.isfinite(terms.M).all(axis=(1, 2)) & (np.abs(off).max(axis=0) > 1e-14)
            if not usable.any():
                break
            step = np.zeros_like(u)
            try:
                tied = least_squares(terms.M[usable], rows[usable])
            except np.linalg.LinAlgError:
                break
            step[:, usable] = tied.least(off[:, usable].T).T
            q = q + times(terms.W, step)
            for quaternion in kane.motion.quaternions:
                q[quaternion] /= np.linalg.norm(q[quaternion], axis=0)
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
                u = u * np.minimum(1.0, OTHERS * speed / np.maximum(parts, 1e-300))
                continue
            terms = kane.motion.terms(states.t, point.q, point.u)
            size = np.linalg.norm(slip, axis=0)
            missing = slip * (speed / np.where(size > 0.0, size, 1.0) - 1.0)
            rows = np.concatenate([slope, terms.G], axis=1) @ point.Y
            off = np.concatenate([missing, -terms.psi])
            good = np.isfinite(rows).all(axis=(1, 2)) & np.isfinite(off).all(axis=0)
            u = u.copy()
            u[:, good] += times(np.linalg.pinv(rows[good], rcond=RANK), off[:, good])
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
    return np.asarray(touching & slow & (_parts(slope, point.u) < ROUNDED * size))


# --- what was not seen -------------------------------------------------------------------------------


def not_sampled(where: tuple[Place, ...], states: States) -> tuple[str, ...]:
    """What of friction and contact none of the states shows, in words."""
    seen: dict[str, bool] = {}
    for place in where:
        if place.gap is not None:
            words = f"{place.element}, whose shapes overlap at none of the states"
            seen[words] = seen.get(words, False) or bool(_about(place, states, None).any())
        for name, speed in place.scales.items():
            rubbing = "friction of " if place.gap is not None else ""
            words = f"{rubbing}{place.element} at slips about its {name} of {speed:.3g}"
            seen[words] = seen.get(words, False) or bool(_about(place, states, speed).any())
    return tuple(words for words, found in seen.items() if not found)
