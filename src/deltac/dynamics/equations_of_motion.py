"""The equations of motion of a mechanism: written out once, and shared by all that need them.

    q̇ = W u + X            kinematics
    M u̇ + h = f + Gᵀλ      dynamics; h are the inertia forces at u̇ = 0, f all active forces
    G u̇ + γ = 0            constraints, φ = 0 and ψ = G u + … = 0 differentiated

of the free speeds u. Simulation, assembly, ledgers, residuals and checks take the terms from here, in
symbols to build on, or as numbers at one state or many.

Coordinates without inertia (the surface parameters of a contact point) make M singular; constraints may
determine them. Then M + Gᵀμ G and h + Gᵀμ γ take the places of M and h, with weights μ (kg) on the rows
that hold such coordinates: the same motion and multipliers, since Gᵀμ (G u̇ + γ) = 0, and a positive
definite matrix (Benzi, Golub, Liesen, Acta Numerica 14 (2005) 1-137, section 3.5).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from deltac.arrays import Array
from deltac.dynamics.constraints import ConstraintRows, constraint_rows
from deltac.dynamics.forces import channels, total_force
from deltac.dynamics.kkt import schur
from deltac.dynamics.recursions import crba, rnea
from deltac.dynamics.singular_inertia import regular_least_squares, without_inertia
from deltac.dynamics.spatial import SX
from deltac.dynamics.system import System, trace
from deltac.dynamics.terms import Constrained, Forward, forward
from deltac.kernels.casadi_evaluator import on_arrays
from deltac.kernels.rows import at_rows, whole_output
from deltac.mechanism.channels import Channel, ChannelName
from deltac.mechanism.mechanism import Mechanism


@dataclass(frozen=True, eq=False)
class MotionTerms:
    """The terms of M u̇ + h = f + Gᵀλ, G u̇ + γ = 0 as numbers, of the p free speeds.

    At one state: `M` (p, p), `bias` h (p,), `forces` f of each channel (p,), `phi`, `psi`, `gamma` (nc,),
    `G` (nc, p), `W` (nq, p) of all constraint rows. At B states matrices are (B, …) and columns (…, B).
    With massless coordinates M and h are those that the constraints complete, M + Gᵀμ G and h + Gᵀμ γ.
    """

    M: Array
    bias: Array
    forces: dict[ChannelName, Array]
    phi: Array
    psi: Array
    gamma: Array
    G: Array
    W: Array

    @property
    def force(self) -> Array:
        """The sum of all active forces."""
        return np.asarray(sum(self.forces.values(), start=np.zeros(self.bias.shape)))


@dataclass(frozen=True, eq=False)
class EquationsOfMotion:
    """The equations of motion of a traced system; every term is written out when it is first asked for."""

    system: System

    # --- in symbols ------------------------------------------------------------------------------

    @cached_property
    def channels(self) -> tuple[Channel, ...]:
        """The channels of all active forces."""
        return channels(self.system)

    @cached_property
    def force(self) -> SX:
        """F (nu,): generalized active forces on all speeds."""
        return total_force(self.system, self.channels)

    @cached_property
    def rows(self) -> ConstraintRows:
        """All rows of the constraints, redundant ones too."""
        return constraint_rows(self.system)

    @cached_property
    def M_all(self) -> SX:
        """The mass matrix (nu, nu) of all speeds, those of prescribed joints too."""
        return crba(self.system)

    @cached_property
    def M(self) -> SX:
        """The mass matrix (p, p) of the free speeds."""
        free = self.system.free_u
        return self.M_all[free, free]

    @cached_property
    def massless(self) -> tuple[int, ...]:
        """Free speeds whose motions have no kinetic energy in any position, where there are constraints.

        A position drawn at random stands for any: there an inertia vanishes only if it does everywhere.
        """
        if not len(self.rows):
            return ()
        return tuple(int(k) for k in without_inertia(self._plain_mass_matrix))

    @cached_property
    def _plain_mass_matrix(self) -> Array:
        """M (p, p) in a position drawn at random."""
        s = self.system
        q = np.random.default_rng(1).standard_normal(len(s.free_q))
        p = [s.mechanism.parameters[name] for name in s.vary]
        return self._inertia(0.0, q, p)

    def weights(self, rows: ConstraintRows) -> SX:
        """μ (nc,; kg) of rows: positive for those that hold massless coordinates, else zero.

        Any positive number makes M + Gᵀμ G regular; one of the size of M costs no digits.
        """
        weight = ca.SX(len(rows), 1)
        if self.massless:
            largest = float(np.diagonal(self._plain_mass_matrix).max())
            for k in range(len(rows)):
                if rows.G[k, list(self.massless)].nnz():
                    weight[k] = largest if largest > 0.0 else 1.0
        return weight

    def completed(self, rows: ConstraintRows) -> tuple[SX, SX]:
        """M + Gᵀμ G (p, p) and Gᵀμ γ (p,) of some rows."""
        weight = self.weights(rows)
        pull = ca.mtimes(rows.G.T, ca.diag(weight))
        return self.M + ca.mtimes(pull, rows.G), ca.mtimes(pull, rows.gamma)

    @cached_property
    def bias(self) -> SX:
        """H (nu,): inertia forces where the free speeds have no accelerations, their sign in F* reversed."""
        return rnea(self.system, self.system.at_rest)

    @property
    def W(self) -> SX:
        """W (nq, p) of q̇ = W u + X, free coordinates and speeds."""
        return self.system.W

    @cached_property
    def quaternions(self) -> tuple[slice, ...]:
        """Places of unit quaternions in the free coordinates."""
        return quaternions(self.system.mechanism)

    def constrained(self, places: Sequence[int]) -> Constrained | None:
        """The constraints of some (independent) rows with their factorised system; None without any."""
        if not len(places):
            return None
        chosen = tuple(int(k) for k in places)

        def factorised() -> Constrained:
            rows = self.rows.select(chosen)
            return Constrained(rows, schur(self.completed(rows)[0], rows.G, self.weights(rows)))

        return self.system.once(("constrained", chosen), factorised)

    def motion(self, places: Sequence[int], damping: tuple[float, float] = (0.0, 0.0)) -> Forward:
        """Forward dynamics on some (independent) rows of the constraints."""
        key = ("motion", tuple(map(int, places)), damping)
        bound = self.constrained(places)
        return self.system.once(key, lambda: forward(self.system, self.channels, bound, damping))

    # --- as numbers ------------------------------------------------------------------------------

    @cached_property
    def _terms(self) -> Any:
        s, r, free = self.system, self.rows, self.system.free_u
        forces = ca.horzcat(ca.SX(len(free), 0), *(part.force[free, :] for part in self.channels))
        M, pull = self.completed(r)
        columns = [M, self.bias[free, :] + pull, forces, r.phi, r.psi, r.gamma, r.G, self.W]
        arguments = [s.t, s.q, s.u, s.inputs, s.p]
        return ca.Function("terms", arguments, [ca.vec(x) for x in columns], {"cse": True})

    @property
    def instructions(self) -> int:
        """Size of the terms of the equations: about that of an evaluation of u̇."""
        return int(self._terms.n_instructions())

    @cached_property
    def _onto(self) -> Any:
        s, r = self.system, self.rows
        columns = [self.completed(r)[0], r.phi, r.psi, r.G, self.W]
        arguments = [s.t, s.q, s.u, s.p]
        return ca.Function(
            "onto", arguments, [ca.densify(ca.vec(x)) for x in columns], {"cse": True}
        )

    @cached_property
    def inertia_force(self) -> Any:
        """(t, q, p, a) -> M a (p,) of the free speeds, by inverse dynamics: shorter than M written out."""
        s, a = self.system, ca.SX.sym("a", len(self.system.free_u))
        needed = ca.jtimes(rnea(s, s.udot_all)[s.free_u, :], s.udot, a)
        return ca.Function("inertia_force", [s.t, s.q, s.p, a], [ca.densify(needed)], {"cse": True})

    def mass_matrix(self, t: float, q: Array, p: ArrayLike = ()) -> Array:
        """M (p, p) of the free speeds at one state, as `MotionTerms` has it."""
        if self.massless:
            return self.ties(t, q, np.zeros(len(self.system.free_u)), p)[0]
        return self._inertia(t, q, p)

    def _inertia(self, t: float, q: Array, p: ArrayLike) -> Array:
        """M (p, p) of bodies and rotors alone, column by column."""
        n = len(self.system.free_u)
        if not n:
            return np.zeros((0, 0))
        (M,) = evaluate_at(self.inertia_force, t, np.asarray(q), p, np.eye(n))
        return 0.5 * (M.reshape(n, n) + M.reshape(n, n).T)

    @cached_property
    def _violation(self) -> Any:
        s = self.system
        return ca.Function("violation", [s.t, s.q, s.u, s.p], [self.rows.phi, self.rows.psi])

    def terms(
        self,
        t: ArrayLike,
        q: Array,
        u: Array,
        p: ArrayLike = (),
        inputs: ArrayLike | None = None,
    ) -> MotionTerms:
        """All terms at one state, or at B states (batch last).

        Args:
            t: a number, or (B,).
            q: free coordinates (nq,), or (nq, B).
            u: free speeds (p,), or (p, B).
            p: values of the parameters that the system keeps symbolic.
            inputs: values of the motors without a law; zero by default.
        """
        s, n = self.system, len(self.system.free_u)
        controls = (
            np.zeros(s.inputs.shape[0]) if inputs is None else np.asarray(inputs, dtype=float)
        )
        blocks = evaluate_at(self._terms, t, q, u, controls, p)
        M, bias, forces, phi, psi, gamma, G, W = blocks
        by_channel = forces.reshape(len(self.channels), n, *forces.shape[1:])
        return MotionTerms(
            M=matrices(M, n, n),
            bias=bias,
            forces={part.name: by_channel[k] for k, part in enumerate(self.channels)},
            phi=phi,
            psi=psi,
            gamma=gamma,
            G=matrices(G, len(self.rows), n),
            W=matrices(W, len(s.free_q), n),
        )

    @cached_property
    def _forces(self) -> Any:
        s, free = self.system, self.system.free_u
        forces = [part.force[free, :] for part in self.channels]
        return ca.Function("forces", [s.t, s.q, s.u, s.inputs, s.p], forces, {"cse": True})

    def forces(self, t: Array, q: Array, u: Array) -> dict[ChannelName, Array]:
        """Generalized force (T, p) of each channel at rows (T, …); parameters that are symbols are zero.

        Motors without a law give nothing. The mass matrix, which `terms` have too, takes most of their time.
        """
        s = self.system
        rest = [np.zeros((len(t), x.shape[0])) for x in (s.inputs, s.p)]
        values = at_rows(self._forces, [t, q, u, *rest])
        return {part.name: value for part, value in zip(self.channels, values, strict=True)}

    def solved(self, terms: MotionTerms) -> tuple[Array, Array]:
        """u̇ (p,) and the least λ (nc,) of terms at one state, or (B, p) and (B, nc) at B states.

        Raises ModelError for a singular mass matrix, naming the speeds that move no inertia.
        """
        tied = regular_least_squares(self.system.mechanism, terms.M, terms.G)
        force = (terms.force - terms.bias).T
        multipliers = tied.multipliers(force, terms.gamma.T)
        pull = np.einsum("...cp,...c->...p", terms.G, multipliers)
        return tied.free_response(force + pull), multipliers

    def ties(
        self, t: ArrayLike, q: Array, u: Array, p: ArrayLike = ()
    ) -> tuple[Array, Array, Array, Array, Array]:
        """M, φ, ψ, G, W at one state or many: what it takes to bring a state onto its constraints."""
        n = len(self.system.free_u)
        M, phi, psi, G, W = evaluate_at(self._onto, t, q, u, p)
        nc, nq = len(self.rows), len(self.system.free_q)
        return matrices(M, n, n), phi, psi, matrices(G, nc, n), matrices(W, nq, n)

    def violation(self, t: ArrayLike, q: Array, u: Array, p: ArrayLike = ()) -> tuple[Array, Array]:
        """φ and ψ (nc,) at one state; (nc, B) at B states."""
        phi, psi = evaluate_at(self._violation, t, q, u, p)
        return phi, psi


def equations_of_motion(mechanism: Mechanism, vary: Sequence[str] = ()) -> EquationsOfMotion:
    """The equations of motion of a mechanism, parameters named in `vary` kept symbolic.

    The same description gives the same object: what has been written out once is there.
    """
    return equations_of(trace(mechanism, vary))


def equations_of(system: System) -> EquationsOfMotion:
    """The equations of motion of a traced system."""
    return system.once(EquationsOfMotion, lambda: EquationsOfMotion(system))


def quaternions(mechanism: Mechanism) -> tuple[slice, ...]:
    """Places of unit quaternions in the free coordinates."""
    place = {int(index): k for k, index in enumerate(mechanism.free.q)}
    starts = (place[own.start] for own in mechanism.quaternions.values())
    return tuple(slice(start, start + 4) for start in starts)


def evaluate_at(function: Any, *arguments: ArrayLike) -> list[Array]:
    """A CasADi function of columns at one state, outputs (n,), or at B states, outputs (n, B).

    What is the same at all states may be given once.
    """
    columns = [np.asarray(x, dtype=float) for x in arguments]
    batch = max((x.shape[1] for x in columns if x.ndim == 2), default=None)
    if batch is None:
        return _at_one_state(function, columns)
    if batch == 1:
        results = _at_one_state(function, [x.reshape(-1) for x in columns])
        return [x.reshape(-1, 1) for x in results]
    wide = [
        x.reshape(1, -1) if x.ndim == 1 and x.shape == (batch,) and k == 0 else x
        for k, x in enumerate(columns)
    ]
    wide = [x if x.ndim == 2 else np.repeat(x.reshape(-1, 1), batch, axis=1) for x in wide]
    if _takes(function, [len(x) for x in wide]):
        return [x.T for x in at_rows(function, [x.T for x in wide])]
    called = function.map(batch).call([ca.DM(np.ascontiguousarray(x)) for x in wide])
    return [np.array(x).reshape(-1, batch) for x in called]


def _at_one_state(function: Any, columns: list[Array]) -> list[Array]:
    """Outputs (n,), through buffers: CasADi's own conversions take longer than most functions."""
    if not _takes(function, [x.size for x in columns]):
        return [np.array(x).reshape(-1) for x in function.call([ca.DM(x) for x in columns])]
    arguments, results = (
        [np.ascontiguousarray(x) for x in columns],
        [np.empty(function.nnz_out(k)) for k in range(function.n_out())],
    )
    _kept, evaluate = on_arrays(function, arguments, results)
    evaluate()
    return [whole_output(function, k, x[None])[0] for k, x in enumerate(results)]


def matrices(flat: Array, rows: int, columns: int) -> Array:
    """Matrices (rows, columns), or (B, rows, columns), from their stacked columns (rows·columns[, B])."""
    if flat.ndim == 1:
        return np.ascontiguousarray(flat.reshape(columns, rows).T)
    return np.ascontiguousarray(flat.reshape(columns, rows, flat.shape[1]).transpose(2, 1, 0))


def _takes(function: Any, sizes: list[int]) -> bool:
    """Whether a function takes columns of these sizes: arrays can be its buffers."""
    return sizes == [function.nnz_in(k) for k in range(len(sizes))]
