"""The slow, safe way over singular configurations: multipliers by numeric least squares.

Where constraints become dependent (a four-bar stretched flat) the factorisation without pivoting fails,
but the motion goes on. A step that meets such a place is taken again here, with the least multipliers
that do what the constraints can ask for. Where the constraints leave no freedom, a combination of them that
has become dependent is replaced by its rate, which determines the accelerations of the branch that the
speeds are on, and the finite force of multipliers that grow without bound.
"""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from deltac.arrays import Array
from deltac.dynamics.admissible import onto_positions, onto_speeds
from deltac.dynamics.equations_of_motion import equations_of
from deltac.dynamics.kkt import least_squares
from deltac.dynamics.terms import Reactions, driving_forces, terms
from deltac.simulation.flow import StateFlow, constraint_forces
from deltac.simulation.solvers import Solver

DEPENDENT = 1e-4
"""Share of a row of the constraints that must be independent of the others.

Far above rounding: the stages of a step are off the constraints by its local error, and near a singular
configuration what is left of a dependent row is that error, which points anywhere.
"""


class SingularMotion:
    """The motion of a constrained mechanism with multipliers by numeric least squares."""

    def __init__(self, flow: StateFlow, p: Array) -> None:
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
        # The rates of ψ̇ = G u̇ + γ at a constant u̇, and of G.
        along, at = ca.vertcat(system.q, system.u, system.t), system.udot
        pace = ca.vertcat(system.qdot, at, 1)
        jerk = ca.jtimes(ca.mtimes(rows.G, at) + rows.gamma, along, pace)
        slope, still = ca.jacobian(jerk, at), ca.substitute(jerk, at, ca.SX.zeros(at.shape[0]))
        turning = ca.jtimes(ca.vec(ca.densify(rows.G_all)), along, pace)
        turning = ca.reshape(turning, rows.G_all.shape)
        outputs = [equations.M, rows.G, r, rows.gamma, system.qdot, slope, still, turning]
        outputs = [ca.densify(value) for value in outputs]
        self._pieces = ca.Function("pieces", [flow.t, flow.x, system.p], outputs)
        self._energies = ca.Function("E", [flow.t, flow.x, system.p], [flow.energies])
        lam = ca.SX.sym("lambda", len(rows))
        unbounded = ca.SX.sym("unbounded", system.u_all.shape[0])
        driving = driving_forces(system, system.udot_all, forces, bound, lam)
        driving[system.driven_u] -= unbounded[system.driven_u]
        all_terms = terms(
            system, system.udot_all, forces, flow.split, bound, Reactions(driving, lam)
        )
        powers = flow.powers(all_terms, forces, Reactions(driving, lam), bound)
        inputs = [flow.t, flow.x, system.p, system.udot, lam, unbounded]
        self._powers = ca.Function("P", inputs, [powers])
        observed = [system.udot_all, driving, *constraint_forces(bound, lam).values()]
        self._seen = ca.Function("seen", inputs, [ca.densify(value) for value in observed])

    def rate(self, t: float, x: Array) -> Array:
        """ẋ; raises LinAlgError where it is not finite."""
        qdot, *reactions = self._motion(t, x)
        P = np.array(self._powers(t, x, self._p, *reactions)).ravel()
        return np.concatenate([qdot, reactions[0], P])

    def observed(self, t: float, x: Array) -> dict[str, Array]:
        """What a trajectory records of a state: u̇, driving and constraint forces, full vectors."""
        _, *reactions = self._motion(t, x)
        values = (np.array(value).ravel() for value in self._seen(t, x, self._p, *reactions))
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

    def _motion(self, t: float, x: Array) -> tuple[Array, Array, Array, Array]:
        """q̇, u̇, λ, and the force (nu,) of the part of λ that grows without bound."""
        values = [np.array(value) for value in self._pieces(t, x, self._p)]
        if not all(np.isfinite(value).all() for value in values):
            raise np.linalg.LinAlgError("the equations of motion are not finite")
        M, G, r, gamma, qdot, slope, still, turning = values
        tied = least_squares(M, G, DEPENDENT)
        if not self._flow.driven:
            lam = tied.multipliers(r.ravel(), gamma.ravel())
            udot = tied.free_response(r.ravel() + G.T @ lam)
            return qdot.ravel(), udot, lam, np.zeros(turning.shape[1])
        independent, dependent = tied.combinations(DEPENDENT)
        rows = np.vstack([independent.T @ G, dependent.T @ slope])
        rates = np.concatenate([independent.T @ gamma, dependent.T @ still])
        udot = -np.linalg.lstsq(rows, rates.ravel(), rcond=None)[0]
        free = self._flow.system.free_u
        pulls = np.vstack([independent.T @ G, dependent.T @ turning[:, free]])
        pull = np.linalg.lstsq(pulls.T, M @ udot - r.ravel(), rcond=None)[0]
        bounded, growing = np.split(pull, [independent.shape[1]])
        return qdot.ravel(), udot, independent @ bounded, turning.T @ (dependent @ growing)


SHORTEST_SHARE = 2.0**-10
"""Share of a step beyond which a careful one is not shortened: across a singular position none is exact."""


class CarefulStep:
    """One step of a solver with multipliers by least squares, and a projection to match."""

    def __init__(self, flow: StateFlow, solver: Solver, p: Array, tolerance: float = 0.0) -> None:
        """Of a flow and its parameters `p`; `tolerance` is for `length`."""
        assert solver.step is not None
        self._flow, self._step, self._p, self._tolerance = flow, solver.step, p, tolerance

    def length(self, t: float, x: Array, h: float) -> float:
        """The length, up to h, of a step that two halves agree with to the tolerance, relative to q and u."""
        shortest = SHORTEST_SHARE * h
        while h > shortest:
            whole, halves = self(t, x, h), self(t + h / 2, self(t, x, h / 2), h / 2)
            if all(
                np.abs(whole[part] - halves[part]).max() <= self._tolerance * np.abs(x[part]).max()
                for part in self._flow.parts[:2]
            ):
                break
            h /= 2
        return h

    @cached_property
    def _motion(self) -> SingularMotion:
        """Written out when a run first needs it, which most never do."""
        return SingularMotion(self._flow, self._p)

    def __call__(self, t: float, x: Array, h: float) -> Array:
        """The state one step later, on the constraints if the run is projected; NaN if it blows up."""
        try:
            with np.errstate(all="ignore"):
                after = self._step(self._motion.rate, t, x, h, self._flow.parts)
                for place in self._flow.quaternions:
                    after[place] /= np.linalg.norm(after[place])
                return self._motion.projected(t + h, after) if self._flow.projecting else after
        except np.linalg.LinAlgError:
            return np.full_like(x, np.nan)
