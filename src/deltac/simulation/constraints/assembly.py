"""Assembly: from an approximate guess to coordinates and speeds that satisfy all constraints."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import ASSEMBLED, Array, max_norm
from deltac.dynamics.admissible import onto_positions, onto_speeds
from deltac.dynamics.constraints import ConstraintRows
from deltac.dynamics.equations_of_motion import EquationsOfMotion, equations_of_motion
from deltac.dynamics.independence import independence, row_names
from deltac.dynamics.singular_inertia import without_inertia
from deltac.errors import InputError, StateError, check_names
from deltac.mechanism.joints import JOINT_KINDS
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.state import State

PERTURBATIONS = (1e-9, 1e-6, 1e-3, 0.1)
"""Perturbations (m or rad) of a guess at which Newton's steps do not exist, until one leads to a solution."""


@dataclass(frozen=True)
class Assembly:
    """A state that satisfies the constraints, and the rank of the constraints there.

    `freedom` is the number of degrees of freedom. `redundant` describes the rows that follow from others;
    they are harmless if `residual`, the largest remaining violation, is at round-off. `singular` says whether
    the rank is lower than in the neighbourhood. `moved` is the largest change of a coordinate from the guess.
    """

    state: State
    residual: float
    freedom: int
    redundant: str
    singular: bool
    moved: float


def assemble(mechanism: Mechanism, guess: State, pinned: Collection[str] = ()) -> Assembly:
    """Find a state near a guess that satisfies every constraint: the core of `deltac.assemble`."""
    q_free, u_free = mechanism.coordinates.free_names, mechanism.speeds.free_names
    check_names(pinned, [*q_free, *u_free], "pinned: unknown coordinate")
    equations = equations_of_motion(mechanism)
    rows = equations.rows
    t, q, u = guess.t, guess.q[mechanism.free.q].copy(), guess.u[mechanism.free.u].copy()
    if len(rows):
        # A pinned coordinate of a joint holds the speed that moves it; joints in quaternions as a whole.
        held_q = _held(mechanism, [n for n in pinned if n in q_free])
        held_u = np.array([name in pinned for name in u_free], dtype=bool)
        q = _assembled(equations, t, q, ~held_q)
        u = onto_speeds(equations, t, q, u, movable=~held_u)
        _, psi = equations.violation(t, q, u)
        fastest = max(1.0, max_norm(u))
        if not max_norm(psi) <= ASSEMBLED * fastest:
            raise _unmet(rows, psi, "velocity", "m/s or rad/s")
    rank = independence(equations, t, q)
    full_q, full_u = guess.q.copy(), guess.u.copy()
    moved = max_norm(full_q[mechanism.free.q] - q)
    full_q[mechanism.free.q], full_u[mechanism.free.u] = q, u
    phi, psi = equations.violation(t, q, u)
    return Assembly(
        state=mechanism.state(full_q, full_u, t),
        residual=max_norm(np.concatenate([phi, psi])),
        freedom=rank.freedom,
        redundant=row_names(rows, rank.redundant),
        singular=rank.singular,
        moved=moved,
    )


def _assembled(
    equations: EquationsOfMotion, t: float, guess: Array, movable: NDArray[np.bool_]
) -> Array:
    """Free coordinates that satisfy the constraints, perturbed guesses where Newton fails at this one."""
    still = np.zeros(len(movable))

    def violation(q: Array) -> Array:
        return equations.violation(t, q, still)[0]

    def met(q: Array) -> bool:
        return max_norm(violation(q)) <= ASSEMBLED

    closest_q = onto_positions(equations, t, guess, movable=movable)
    if met(closest_q):
        return closest_q
    M, _, _, _, W = equations.ties(t, guess, still)
    direction = np.random.default_rng(1).uniform(0.5, 1.0, len(movable)) * movable
    for size in PERTURBATIONS:
        q = onto_positions(equations, t, guess + W @ (size * direction), movable=movable)
        if met(q):
            restored = np.where(np.abs(q - guess) <= 2.0 * size, guess, q)
            restored = onto_positions(equations, t, restored, movable=movable)
            return restored if met(restored) else q
    raise _unmet(
        equations.rows, violation(closest_q), "position", "m or rad", _massless(equations, M)
    )


def _massless(equations: EquationsOfMotion, M: Array) -> str:
    """The speeds that make a mass matrix singular, as a further reason; "" if it is regular."""
    mechanism = equations.system.mechanism
    names = [
        repr(mechanism.speeds[int(mechanism.free.u[k])].name)
        for k in without_inertia(np.asarray(M))
    ]
    if not names:
        return ""
    return f". The mass matrix is singular at the guess: a motion along {', '.join(names)} moves no inertia"


def _held(mechanism: Mechanism, pinned: Collection[str]) -> NDArray[np.bool_]:
    """Which free speeds must not move the pinned coordinates."""
    fixed = np.zeros(len(mechanism.free.u), dtype=bool)
    place = {int(index): k for k, index in enumerate(mechanism.free.u)}
    for name in pinned:
        entry = mechanism.coordinates[name]
        joint = mechanism.joint(entry.joint)
        first_q = mechanism.coordinates.of(joint.name).start
        u_slice = mechanism.speeds.of(joint.name)
        offset = JOINT_KINDS[joint.kind].quaternion
        within = entry.index - first_q
        if offset is not None and within >= offset:
            vector_part = range(u_slice.stop - 3, u_slice.stop)
        else:
            vector_part = range(u_slice.start + within, u_slice.start + within + 1)
        for index in vector_part:
            fixed[place[index]] = True
    return fixed


def _unmet(
    rows: ConstraintRows, values: Array, level: str, unit: str, reason: str = ""
) -> InputError:
    worst = int(np.argmax(np.abs(values)))
    return StateError(
        f"the constraints cannot be met at {level} level from this guess: {rows.names[worst]!r} is off by "
        f"{abs(values[worst]):.3g} {unit} at best. Either they contradict each other (or what is pinned), "
        f"or the guess is too far away{reason}"
    )
