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
from deltac.dynamics.forces import channels, total_force
from deltac.dynamics.kkt import VANISHED
from deltac.dynamics.recursions import crba, rnea
from deltac.dynamics.spatial import SX
from deltac.dynamics.terms import Reactions, driving_forces, terms
from deltac.dynamics.testing_functions import testing_functions
from deltac.simulation.flow import Flow, constraint_forces, quaternions
from deltac.simulation.solvers.solver import Parts, Solver

CUT_OFF = 1e-8
"""Singular values of G M⁻¹ Gᵀ (of unit diagonal) below this fraction of the largest count as zero."""


class LeastSquares:
    """The motion of a constrained mechanism with multipliers by numeric least squares."""

    def __init__(self, flow: Flow, p: Array) -> None:
        """Prepare the pieces of the equations of motion; they are evaluated by CasADi."""
        bound = flow.bound
        assert bound is not None and flow.equations is None
        system = flow.system
        self._flow, self._p = flow, p
        free = system.free_u
        forces = channels(system)
        udot = ca.SX(system.udot_all)
        udot[free] = 0
        r = (total_force(system, forces) - rnea(system, udot))[free]
        rows = bound.rows
        outputs = [crba(system)[free, free], rows.G, r, rows.gamma, rows.phi, rows.psi]
        outputs += [system.qdot, ca.jacobian(system.qdot, system.u)]
        self._pieces = ca.Function("pieces", [flow.t, flow.x, flow.p], outputs)
        self._energies = ca.Function("E", [flow.t, flow.x, flow.p], [flow.energies])
        lam = ca.SX.sym("lambda", len(rows))
        driving = driving_forces(system, system.udot_all, forces, bound, lam)
        known = terms(system, system.udot_all, forces, flow.split, bound, Reactions(driving, lam))
        powers: list[SX] = [f.P(known) for f in testing_functions(flow.testing)]
        due = [known.nonpotential_power + known.prescribed_power] if flow.correcting else []
        still = ca.SX.zeros(len(flow.integrals) - len(powers) - len(due))
        given = [flow.t, flow.x, flow.p, system.udot, lam]
        self._powers = ca.Function("P", given, [ca.vertcat(*powers, still, *due)])
        seen = [system.udot_all, driving, *constraint_forces(bound, lam).values()]
        self._seen = ca.Function("seen", given, [ca.densify(value) for value in seen])

    def rate(self, t: float, x: Array) -> Array:
        """ẋ; raises LinAlgError where it is not finite."""
        qdot, udot, lam = self._motion(t, x)
        P = np.array(self._powers(t, x, self._p, udot, lam))
        return np.concatenate([qdot, udot, P]).ravel()

    def observed(self, t: float, x: Array) -> dict[str, Array]:
        """What a trajectory records of a state: u̇, driving and constraint forces, full vectors."""
        _, udot, lam = self._motion(t, x)
        values = (np.array(value).ravel() for value in self._seen(t, x, self._p, udot, lam))
        return dict(zip(("udot", "driving", *self._flow.reactions), values))

    def projected(self, t: float, x: Array) -> Array:
        """The state back on the constraints, the change of the energies booked."""
        q_part, u_part, z_part = self._flow.parts
        before = np.array(self._energies(t, x, self._p)).ravel()
        x = x.copy()
        for _ in range(3):
            M, G, _, _, phi, psi, _, W = self._evaluated(t, x)
            x[q_part] += (W @ _least(M, G, phi)).ravel()
        M, G, _, _, _, psi, _, _ = self._evaluated(t, x)
        x[u_part] += _least(M, G, psi).ravel()
        x[z_part][: len(before)] += np.array(self._energies(t, x, self._p)).ravel() - before
        return x

    def _motion(self, t: float, x: Array) -> tuple[Array, Array, Array]:
        """q̇, u̇ and λ as columns."""
        M, G, r, gamma, _, _, qdot, _ = self._evaluated(t, x)
        response = np.linalg.solve(M, np.hstack([r, G.T]))
        lam = _solved(G @ response[:, 1:], -gamma - G @ response[:, :1])
        return qdot, response[:, :1] + response[:, 1:] @ lam, lam

    def _evaluated(self, t: float, x: Array) -> list[Array]:
        values = [np.array(value) for value in self._pieces(t, x, self._p)]
        if not all(np.isfinite(value).all() for value in values):
            raise np.linalg.LinAlgError("the equations of motion are not finite")
        return values


class CarefulStep:
    """One step of a solver with multipliers by least squares, and a projection to match."""

    def __init__(self, flow: Flow, solver: Solver, parts: Parts, p: Array) -> None:
        """Of a flow and its parameters `p`; `parts` are the solver's masks."""
        assert solver.step is not None
        self._flow, self._step, self._parts, self._p = flow, solver.step, parts, p

    @cached_property
    def _motion(self) -> LeastSquares:
        """Written out when a run first needs it, which most never do."""
        return LeastSquares(self._flow, self._p)

    def __call__(self, t: float, x: Array, h: float) -> Array:
        """The state one step later, on the constraints if the run is projected; NaN if it blows up."""
        try:
            with np.errstate(all="ignore"):
                after = self._step(self._motion.rate, t, x, h, self._parts)
                for place in quaternions(self._flow.system.mechanism):
                    after[place] /= np.linalg.norm(after[place])
                return self._motion.projected(t + h, after) if self._flow.projecting else after
        except np.linalg.LinAlgError:
            return np.full_like(x, np.nan)


def _least(M: Array, G: Array, violation: Array) -> Array:
    """The change of speeds, least in the mass metric, that removes a violation as far as G can."""
    response = np.linalg.solve(M, G.T)
    return -response @ _solved(G @ response, violation)


def _solved(S: Array, b: Array) -> Array:
    """The least λ of S λ = b as far as it can be met, every row scaled to unit size, vanished ones out."""
    size = np.diag(S)
    present = size > VANISHED * size.max()
    scale = np.where(present, 1.0 / np.sqrt(np.where(present, size, 1.0)), 0.0)[:, None]
    solved: Array = scale * np.linalg.lstsq(scale * S * scale.T, scale * b, rcond=CUT_OFF)[0]
    return solved
