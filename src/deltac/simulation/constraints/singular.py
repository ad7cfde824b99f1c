"""The slow, safe way over singular configurations: multipliers by numeric least squares.

Where constraints become dependent (a four-bar stretched flat) the factorisation without pivoting fails,
but the motion goes on. A step that meets such a place is taken again here, with the least multipliers
that do what the constraints can ask for.
"""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from deltac.arrays import Array
from deltac.dynamics.admissible import onto_positions, onto_speeds
from deltac.dynamics.equations_of_motion import equations_of, quaternions
from deltac.dynamics.kkt import least_squares
from deltac.dynamics.terms import Reactions, driving_forces, terms
from deltac.simulation.flow import Flow, constraint_forces
from deltac.simulation.solvers import Solver

DEPENDENT = 1e-4
"""Share of a row of the constraints that must be independent of the others.

Far above rounding: the stages of a step are off the constraints by its local error, and near a singular
configuration what is left of a dependent row is that error, which points anywhere.
"""


class SingularMotion:
    """The motion of a constrained mechanism with multipliers by numeric least squares."""

    def __init__(self, flow: Flow, p: Array) -> None:
        """Prepare the pieces of the equations of motion; they are evaluated by CasADi.

        Laws that switch are taken as they are: of `p` only the mechanism's parameters, the first, count.
        """
        bound = flow.bound
        assert bound is not None and flow.equations is None
        system, equations = flow.system, equations_of(flow.system)
        self._flow, self._equations = flow, equations
        self._p = p[: system.p.shape[0]]
        forces, rows = equations.channels, bound.rows
        r = (equations.force - equations.bias)[system.free_u, :]
        outputs = [equations.M, rows.G, r, rows.gamma, system.qdot]
        self._pieces = ca.Function("pieces", [flow.t, flow.x, system.p], outputs)
        self._energies = ca.Function("E", [flow.t, flow.x, system.p], [flow.energies])
        lam = ca.SX.sym("lambda", len(rows))
        driving = driving_forces(system, system.udot_all, forces, bound, lam)
        known = terms(system, system.udot_all, forces, flow.split, bound, Reactions(driving, lam))
        powers = flow.powers(known, forces, Reactions(driving, lam), bound)
        given = [flow.t, flow.x, system.p, system.udot, lam]
        self._powers = ca.Function("P", given, [powers])
        seen = [system.udot_all, driving, *constraint_forces(bound, lam).values()]
        self._seen = ca.Function("seen", given, [ca.densify(value) for value in seen])

    def rate(self, t: float, x: Array) -> Array:
        """ẋ; raises LinAlgError where it is not finite."""
        qdot, udot, lam = self._motion(t, x)
        P = np.array(self._powers(t, x, self._p, udot, lam)).ravel()
        return np.concatenate([qdot, udot, P])

    def observed(self, t: float, x: Array) -> dict[str, Array]:
        """What a trajectory records of a state: u̇, driving and constraint forces, full vectors."""
        _, udot, lam = self._motion(t, x)
        values = (np.array(value).ravel() for value in self._seen(t, x, self._p, udot, lam))
        return dict(zip(("udot", "driving", *self._flow.reactions), values))

    def projected(self, t: float, x: Array) -> Array:
        """The state back on the constraints, the change of the energies booked."""
        q_part, u_part, z_part = self._flow.parts
        before = np.array(self._energies(t, x, self._p)).ravel()
        x, p = x.copy(), self._p
        motion = self._equations
        q = onto_positions(motion, t, x[q_part], p, dependent=DEPENDENT, most=3)
        x[q_part] = q
        x[u_part] = onto_speeds(motion, t, q, x[u_part], p, dependent=DEPENDENT, passes=1)
        first = z_part.start + len(self._flow.works)
        x[first : first + len(before)] += np.array(self._energies(t, x, p)).ravel() - before
        return x

    def _motion(self, t: float, x: Array) -> tuple[Array, Array, Array]:
        """q̇, u̇ and λ."""
        values = [np.array(value) for value in self._pieces(t, x, self._p)]
        if not all(np.isfinite(value).all() for value in values):
            raise np.linalg.LinAlgError("the equations of motion are not finite")
        M, G, r, gamma, qdot = values
        tied = least_squares(M, G, DEPENDENT)
        lam = tied.multipliers(r.ravel(), gamma.ravel())
        return qdot.ravel(), tied.free_response(r.ravel() + G.T @ lam), lam


class CarefulStep:
    """One step of a solver with multipliers by least squares, and a projection to match."""

    def __init__(self, flow: Flow, solver: Solver, p: Array) -> None:
        """Of a flow and its parameters `p`."""
        assert solver.step is not None
        self._flow, self._step, self._p = flow, solver.step, p

    @cached_property
    def _motion(self) -> SingularMotion:
        """Written out when a run first needs it, which most never do."""
        return SingularMotion(self._flow, self._p)

    def __call__(self, t: float, x: Array, h: float) -> Array:
        """The state one step later, on the constraints if the run is projected; NaN if it blows up."""
        try:
            with np.errstate(all="ignore"):
                after = self._step(self._motion.rate, t, x, h, self._flow.parts)
                for place in quaternions(self._flow.system.mechanism):
                    after[place] /= np.linalg.norm(after[place])
                return self._motion.projected(t + h, after) if self._flow.projecting else after
        except np.linalg.LinAlgError:
            return np.full_like(x, np.nan)
