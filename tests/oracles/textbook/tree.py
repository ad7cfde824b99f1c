"""The matrices of the energy theorem, dense and in plain NumPy: the page to read first.

    v = R u + v_t            velocities of all bodies from the independent speeds u
    F* = −(M v̇ + β)          inertia forces
    Rᵀ(F + F*) = 0           Kane's equations, which determine u̇
    F + F* + F′ = 0          Newton and Euler, which then determine the constraint forces F′

Slow, readable, and written without a line of the recursions in `deltac.dynamics.recursions`, which are
tested against it. After K. Gugaratshan, "Investigative study on an energy theorem for developing testing
functions for numerical simulations of multibody dynamic systems", M.S.E. thesis, Western Michigan
University, 2008 (*the thesis*), and Wang and Huston, 1987.

The rows of v, F, F*, F′, β and R are, for each body in the order of `Mechanism.bodies`: velocity of the
mass centre (three, world components), angular velocity (three, body components). After these 6N rows
comes one for each speed of the mechanism: the *rotors*. A joint's armature a adds ½ a u² to the kinetic
energy, so a rotor is a one-dimensional body whose velocity is that speed and whose mass is a (zero
without armature).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from deltac.errors import ModelError
from deltac.mechanism.mechanism import Mechanism
from tests.oracles.textbook.forces import channel_forces
from tests.oracles.textbook.kinematics import (
    Array,
    Tree,
    along,
    coordinate_rates,
    is_prescribed,
    numbers,
    prescribed,
    tree,
)
from tests.oracles.textbook.situation import ChannelForce, Situation


@dataclass(frozen=True, eq=False)
class Textbook:
    """The matrices of a mechanism at the instant (t, q, u).

    `q` (nq,) and `u` (nu,) hold all joints; the entries of prescribed joints are replaced by their laws.
    The independent generalized speeds are the free entries of u, p of them. `inputs` gives the
    generalized forces of motors without a law, by name. Matrices have n = 6N + nu rows.
    InputError for a mechanism with constraints: its joints must be the whole of it, unless `tree_only` asks
    for the matrices of the tree of joints regardless.
    Methods that take accelerations `udot` (nu,) take any: those of a log or a wrong simulation too.
    """

    mechanism: Mechanism
    t: float
    q: Array
    u: Array
    inputs: Mapping[str, Sequence[float]] = field(default_factory=dict)
    tree_only: bool = False

    def __post_init__(self) -> None:
        if self.mechanism.constraints and not self.tree_only:
            names = ", ".join(constraint.name for constraint in self.mechanism.constraints)
            raise ModelError(
                f"the textbook's matrices are of trees, and the mechanism has constraints ({names}); "
                "use the recursions, or leave the constraints out"
            )
        q_t, u_t, _ = prescribed(self.mechanism, self.t)
        driven_q = [entry.prescribed for entry in self.mechanism.coordinates]
        q = np.where(driven_q, q_t, np.array(self.q, dtype=float))
        u = np.where(is_prescribed(self.mechanism), u_t, np.array(self.u, dtype=float))
        object.__setattr__(self, "q", q)
        object.__setattr__(self, "u", u)

    # --- kinematics: v = R u + v_t, q̇ = W u + X ---------------------------------------------------

    @cached_property
    def free(self) -> Array:
        """Places of the independent speeds in u."""
        return np.flatnonzero(~is_prescribed(self.mechanism))

    @cached_property
    def tree(self) -> Tree:
        """Every body in the world."""
        return tree(self.mechanism, self.q)

    @cached_property
    def x(self) -> Array:
        """Mass centres (N, 3) in the world (m)."""
        return np.array(
            [
                self.tree.frames[body.name].place(numbers(self.mechanism, body.mass_centre))
                for body in self.mechanism.bodies
            ]
        )

    @cached_property
    def turned(self) -> Array:
        """Orientations (N, 3, 3): columns are the bodies' axes in the world."""
        return np.array([self.tree.frames[body.name].turned for body in self.mechanism.bodies])

    def partial_velocities(self, q: Array) -> Array:
        """Partial velocities (n, nu) with respect to *all* speeds, driven ones too, at `q`."""
        at = tree(self.mechanism, q)
        rows = []
        for body in self.mechanism.bodies:
            frame = at.frames[body.name]
            centre = frame.place(numbers(self.mechanism, body.mass_centre))
            rows += [frame.partial_velocity(centre), frame.turned.T @ frame.P_w]
        rotors = np.eye(len(self.mechanism.speeds))
        return np.vstack([*rows, rotors])

    @cached_property
    def P(self) -> Array:
        """Partial velocities (n, nu) of all speeds now: v = P u."""
        return self.partial_velocities(self.q)

    @cached_property
    def P_dot(self) -> Array:
        """Their rate Ṗ (n, nu) in the motion."""
        return along(self.partial_velocities, self.q, self.q_dot)

    @cached_property
    def q_dot(self) -> Array:
        """Rates of all coordinates (nq,)."""
        rates: Array = coordinate_rates(self.mechanism, self.q) @ self.u
        return rates

    @cached_property
    def R(self) -> Array:
        """Partial velocities (n, p) of the independent speeds."""
        return self.P[:, self.free]

    @cached_property
    def R_dot(self) -> Array:
        """Ṙ (n, p)."""
        return self.P_dot[:, self.free]

    @cached_property
    def u_t(self) -> Array:
        """The speeds (nu,) that are there when the independent ones are zero: the prescribed ones."""
        return prescribed(self.mechanism, self.t)[1]

    @cached_property
    def udot_t(self) -> Array:
        """Their rates."""
        return prescribed(self.mechanism, self.t)[2]

    @cached_property
    def v(self) -> Array:
        """Velocities (n,)."""
        return self.P @ self.u

    @cached_property
    def v_t(self) -> Array:
        """The acatastatic part (n,) of v."""
        return self.P @ self.u_t

    @cached_property
    def v_t_dot(self) -> Array:
        """v̇_t (n,): the derivative of its components, as stacked."""
        v_t_dot: Array = self.P @ self.udot_t + self.P_dot @ self.u_t
        return v_t_dot

    def v_dot(self, udot: Array) -> Array:
        """v̇ (n,) for accelerations `udot`: the derivative of its components, as stacked."""
        v_dot: Array = self.P @ udot + self.P_dot @ self.u
        return v_dot

    # --- inertia: F* = −(M v̇ + β) ----------------------------------------------------------------

    @cached_property
    def M(self) -> Array:
        """Masses, central inertias and rotor inertias: block diagonal (n, n)."""
        m = self.mechanism
        N = len(m.bodies)
        M = np.zeros((6 * N + len(m.speeds),) * 2)
        for k, body in enumerate(m.bodies):
            i = 6 * k
            M[i : i + 3, i : i + 3] = m.number(body.mass) * np.eye(3)
            M[i + 3 : i + 6, i + 3 : i + 6] = [numbers(m, row) for row in body.inertia]
        for joint in m.joints:
            if joint.armature:
                i = 6 * N + m.speeds.of(joint.name).start
                for k, a in enumerate(numbers(m, joint.armature)):
                    M[i + k, i + k] = a
        return M

    @cached_property
    def beta(self) -> Array:
        """β (n,): ω × Iω in the rows of angular velocity, which are components in a turning basis."""
        momentum = self.M @ self.v
        beta = np.zeros_like(momentum)
        for k in range(len(self.mechanism.bodies)):
            turning = slice(6 * k + 3, 6 * k + 6)
            beta[turning] = np.cross(self.v[turning], momentum[turning])
        return beta

    def F_star(self, udot: Array) -> Array:
        """Inertia forces F* (n,)."""
        return -(self.M @ self.v_dot(udot) + self.beta)

    @cached_property
    def mass_matrix(self) -> Array:
        """RᵀMR (p, p)."""
        return self.R.T @ self.M @ self.R

    # --- active forces ---------------------------------------------------------------------------

    @cached_property
    def channels(self) -> tuple[ChannelForce, ...]:
        """The forces of every channel but those that drive prescribed joints."""
        at = Situation(self.mechanism, self.t, self.q, self.u, self.tree, self.inputs)
        return channel_forces(at)

    @cached_property
    def F(self) -> Array:
        """All active forces (n,) = F_V + F_D."""
        return self.F_V + self.F_D

    @cached_property
    def F_V(self) -> Array:
        """Those with a potential (n,)."""
        return self._sum([c.F for c in self.channels if c.potential is not None])

    @cached_property
    def F_D(self) -> Array:
        """Those without (n,)."""
        return self._sum([c.F for c in self.channels if c.potential is None])

    @cached_property
    def V(self) -> float:
        """Potential energy (J)."""
        return sum(c.potential for c in self.channels if c.potential is not None)

    @cached_property
    def V_t(self) -> float:
        """∂V/∂t (W) of potentials whose law depends on time."""
        return sum(c.explicit for c in self.channels)

    def _sum(self, forces: Sequence[Array]) -> Array:
        return np.sum(forces, axis=0) if forces else np.zeros(len(self.M))

    # --- Kane's equations and the constraint forces ----------------------------------------------

    @cached_property
    def F_r(self) -> Array:
        """Generalized active forces (p,)."""
        return self.R.T @ self.F

    def F_r_star(self, udot: Array) -> Array:
        """Generalized inertia forces (p,)."""
        return self.R.T @ self.F_star(udot)

    @cached_property
    def udot(self) -> Array:
        """All accelerations (nu,): Kane's equations solved, RᵀMR u̇ = Rᵀ(F − β − M(Ṙu + v̇_t))."""
        udot = self.udot_t.copy()
        if len(self.free):
            udot[self.free] = np.linalg.solve(self.mass_matrix, self.F_r + self.F_r_star(udot))
        return udot

    def F_prime(self, udot: Array) -> Array:
        """Constraint forces F′ = −(F + F*) (n,), reactions of ideal joints among them."""
        return -(self.F + self.F_star(udot))

    def driving(self, udot: Array) -> Array:
        """Generalized forces (nu,) that drive the prescribed joints, zero at free ones: PᵀF′."""
        return np.where(is_prescribed(self.mechanism), self.P.T @ self.F_prime(udot), 0.0)

    # --- energies and powers ---------------------------------------------------------------------

    @cached_property
    def K2(self) -> float:
        """½ uᵀRᵀMRu (J)."""
        moved = self.R @ self.u[self.free]
        return float(0.5 * moved @ self.M @ moved)

    @cached_property
    def K1(self) -> float:
        """v_tᵀMRu (J)."""
        return float(self.v_t @ self.M @ self.R @ self.u[self.free])

    @cached_property
    def K0(self) -> float:
        """½ v_tᵀMv_t (J)."""
        return float(0.5 * self.v_t @ self.M @ self.v_t)

    @cached_property
    def K(self) -> float:
        """½ vᵀMv (J)."""
        return float(0.5 * self.v @ self.M @ self.v)

    def K_dot(self, udot: Array) -> float:
        """K̇ = vᵀM v̇ (W)."""
        return float(self.v @ self.M @ self.v_dot(udot))

    def V_dot(self) -> float:
        """V̇ = −vᵀF_V + ∂V/∂t (W)."""
        return float(self.V_t - self.v @ self.F_V)

    def F_0(self, udot: Array) -> float:
        """Liu and Huston's F_0 = −v_tᵀF* (W), (2.3.1)-(2.3.5) of the thesis."""
        return float(-self.v_t @ self.F_star(udot))

    def Q_dot(self, udot: Array) -> float:
        """Wang's net energy flow Q̇ = vᵀF_D + ∂V/∂t + v_tᵀF′ (W), (2.5.54)-(2.5.64) of the thesis."""
        return float(self.v @ self.F_D + self.V_t + self.v_t @ self.F_prime(udot))

    @cached_property
    def rate_1990(self) -> float:
        """Kane and Levinson's bracket of 1990, vᵀM v̇_t − v_tᵀβ (W)."""
        return float(self.v @ self.M @ self.v_t_dot - self.v_t @ self.beta)

    @cached_property
    def rate_1988(self) -> float:
        """Kane and Levinson's bracket of 1988, ∂K/∂t + Σ X_s ∂K/∂q_s of K(q, u, t) (W).

        In the joints' own speeds X is zero at free coordinates, so only prescribed joints go on.
        """

        def K(state: Array) -> Array:
            q, u = np.split(state, [len(self.q)])
            v = self.partial_velocities(q) @ u
            kinetic: Array = 0.5 * v @ self.M @ v
            return kinetic

        q_t = coordinate_rates(self.mechanism, self.q) @ self.u_t
        return float(along(K, np.append(self.q, self.u), np.append(q_t, self.udot_t)))
