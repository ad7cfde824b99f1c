"""Whether a run with constraints can start: consistent state, independent rows, degrees of freedom."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from deltac.arrays import SOLVED, Array
from deltac.calls.caching import LRUCache
from deltac.dynamics.constraints import ConstraintRows
from deltac.dynamics.equations_of_motion import EquationsOfMotion, equations_of_motion
from deltac.dynamics.independence import Independence, independence
from deltac.errors import ModelError, SolverError, StateError
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.state import State
from deltac.simulation.constraints.singular import DEPENDENT
from deltac.simulation.flow import Baumgarte, Keeping, Projection, keeping
from deltac.simulation.solvers import Solver

NONE: Array = np.empty(0)
START_TOLERANCE = SOLVED
"""Largest violation of a constraint that a start may have (m or rad, and per s)."""


LEAST_SHARE = 0.1 * DEPENDENT
"""Independent share of a constraint row below which a run is refused.

The compiled factorisation squares it, and hands over to least squares at 3e-6, which leave out what is
independent to less than 1e-4: between exactly dependent rows and this, the two differ by more than rounding.
"""


def constraint_start(
    mechanism: Mechanism,
    state: State,
    solver: Solver,
    constraints: str | Keeping,
    vary: Sequence[str] = (),
    p: Array = NONE,
) -> tuple[int, ...]:
    """The independent rows to build the equations on.

    Parameters named in `vary` have the values `p`, others those of the mechanism.

    Raises InputError for a state that violates a constraint, for constraints that leave no freedom, for a
    singular start, and for a way of staying on the constraints that does not go with the solver.
    """
    constraints = keeping(constraints)
    if solver.family == "implicit" and isinstance(constraints, Baumgarte):
        raise SolverError(
            f"solver {solver.name!r} satisfies the constraints itself, so {constraints!r} has nothing to act "
            "on; use constraints='projection' or None"
        )
    if not mechanism.constraints:
        return ()
    if isinstance(constraints, Projection) and solver.family == "scipy" and solver.multistep:
        raise SolverError(
            f"solver {solver.name!r} remembers earlier steps, so its states cannot be projected; use "
            "'Radau' or 'DOP853', or constraints=deltac.Baumgarte(alpha, beta)"
        )
    motion = equations_of_motion(mechanism, vary)
    q, u = state.q[mechanism.free.q], state.u[mechanism.free.u]
    cache = motion.system.once("starts", lambda: LRUCache[Independence](16))
    place = (state.t, *(np.asarray(a, dtype=float).tobytes() for a in (q, u, p)))
    start = cache.get(place, lambda: _consistent(motion, state.t, q, u, p))
    if start.margin < LEAST_SHARE and not start.singular:
        raise StateError(
            f"the constraints of {mechanism.name!r} are nearly dependent at the start: one of "
            f"{', '.join(dict.fromkeys(motion.rows.names))} is independent of the others only to "
            f"{start.margin:.1g} of itself, so that no motion can be trusted, with it or without it. "
            "Where it should follow from the others, deltac.assemble(mechanism, state) makes the state "
            "exact; else move it away from them"
        )
    if start.freedom == 0 and not driven(motion):
        raise ModelError(
            f"the constraints leave mechanism {mechanism.name!r} no degree of freedom, and nothing drives "
            "it: it cannot move. Prescribe a joint (motion=), or let a constraint move in time"
        )
    if start.singular:
        raise StateError(
            f"the start of {mechanism.name!r} is a singular configuration: its constraints are dependent "
            f"there, and more than one motion may start; give a nearby state to choose one"
        )
    return start.independent


def driven(motion: EquationsOfMotion) -> bool:
    """Whether a joint is prescribed or a constraint moves in time: then there is motion without freedom."""
    return bool(motion.system.driven_u) or bool(ca.sparsify(ca.simplify(motion.rows.b)).nnz())


def _consistent(motion: EquationsOfMotion, t: float, q: Array, u: Array, p: Array) -> Independence:
    """The independence of the constraints at a state that meets them; StateError for one that does not."""
    if violation := violated(motion.rows, *motion.violation(t, q, u, p)):
        raise StateError(
            f"the start violates {violation}; deltac.assemble(mechanism, state) finds a consistent state "
            "nearby"
        )
    return independence(motion, t, q, p)


def violated(rows: ConstraintRows, phi: Array, psi: Array) -> str:
    """Which constraint is violated and by how much, in words; "" where φ and ψ (nc,) are small enough."""
    for level, values, unit in (("position", phi, "m or rad"), ("velocity", psi, "m/s or rad/s")):
        worst = int(np.argmax(np.abs(values))) if len(values) else 0
        if len(values) and not abs(values[worst]) <= START_TOLERANCE:
            return f"constraint {rows.names[worst]!r} at {level} level by {abs(values[worst]):.3g} {unit}"
    return ""


def check_members(
    mechanism: Mechanism, t: float, Q: Array, U: Array, names: Sequence[str], p: Array
) -> None:
    """InputError for the first member that starts off a constraint, by its own parameters.

    `Q` (N, nq) and `U` (N, nu) are of all joints, `p` (np, N) values of the parameters `names`.
    """
    if not mechanism.constraints:
        return
    motion = equations_of_motion(mechanism, names)
    q, u = Q[:, mechanism.free.q].T, U[:, mechanism.free.u].T
    phi, psi = motion.violation(t, q, u, p)
    bad = np.flatnonzero(~(np.abs(np.vstack([phi, psi])) <= START_TOLERANCE).all(axis=0))
    if len(bad):
        k = int(bad[0])
        own = ", ".join(f"{name}={value:g}" for name, value in zip(names, p[:, k]))
        its = f"mechanism.with_parameters({own})" if own else "mechanism"
        raise StateError(
            f"states: member {k} violates {violated(motion.rows, phi[:, k], psi[:, k])} at its start; "
            f"deltac.assemble({its}, state) finds a consistent state nearby"
        )
