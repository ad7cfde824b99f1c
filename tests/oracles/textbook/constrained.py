"""The matrices of a constrained mechanism, dense and in plain NumPy.

    J v = −f_t      configuration constraints f(x, t) = 0, differentiated
    A v = −b        motion constraints
    v = R s + v_t   with J R = 0, A R = 0
    Rᵀ(F + F*) = 0  Kane's equations in the reduced speeds s, which determine u̇
    F + F* + F′ = 0 whose F′ = Jᵀλ + Aᵀλ then gives the multipliers

The complement R is taken from a singular value decomposition: another route to u̇ and λ than the
factorised multiplier equations of `deltac.dynamics.kkt`, which are tested against it. After the thesis
(see `tests.oracles.textbook.tree`) and Wang, Huston, *Kane's equations with undetermined multipliers*,
1987.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.scope import GROUND
from tests.oracles.textbook.constraints import KINDS, Scene
from tests.oracles.textbook.kinematics import Array, Frame, along, numbers, prescribed, skew, tree
from tests.oracles.textbook.tree import Textbook


@dataclass(frozen=True, eq=False)
class ConstrainedTextbook:
    """The matrices of a constrained mechanism at the instant (t, q, u), all joints in q and u.

    Rows (m of them) are in the order of `Mechanism.constraints`, holonomic rows of each before its
    motion rows. Velocities v are those of `book`, n = 6N + nu rows. The state need not satisfy the
    constraints.
    """

    mechanism: Mechanism
    t: float
    q: Array
    u: Array
    inputs: Mapping[str, Sequence[float]] = field(default_factory=dict)

    @cached_property
    def book(self) -> Textbook:
        """The textbook of the tree of joints alone."""
        return Textbook(self.mechanism, self.t, self.q, self.u, self.inputs, tree_only=True)

    # --- rows ------------------------------------------------------------------------------------

    def _rows(self, scene: Scene) -> list[tuple[str, list[Any], list[Any]]]:
        mechanism = self.mechanism
        return [(c.name, *KINDS[type(c)](scene, c)) for c in mechanism.constraints]

    def f_at(self, t: Any, q: Array) -> Array:
        """The holonomic f at another time and other coordinates, complex ones too."""
        still = np.zeros(len(self.u))
        scene = Scene(self.mechanism, t, q, still, tree(self.mechanism, q).frames, still)
        return np.array([entry for _, f, _ in self._rows(scene) for entry in f])

    def _psi(self, t: Any, q: Array, u: Array) -> Array:
        """ψ (m,) of speeds `u` (nu,)."""
        mechanism = self.book.mechanism
        scene = Scene(mechanism, t, q, u, tree(mechanism, q).frames, u)
        return np.array([entry for _, _, psi in self._rows(scene) for entry in psi])

    @cached_property
    def _now(self) -> list[tuple[str, list[Any], list[Any]]]:
        b = self.book
        return self._rows(Scene(b.mechanism, b.t, b.q, b.u, b.tree.frames, b.u))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The constraint of each row."""
        return tuple(name for name, _, psi in self._now for _ in psi)

    @cached_property
    def holonomic(self) -> Array:
        """Which rows are configuration constraints (m,) of bool."""
        kinds = [k < len(f) for _, f, psi in self._now for k in range(len(psi))]
        return np.array(kinds, dtype=bool)

    @cached_property
    def f(self) -> Array:
        """Values of f (m,), zero at motion constraints."""
        f = np.zeros(len(self.names))
        f[self.holonomic] = [entry for _, f, _ in self._now for entry in f]
        return f

    @cached_property
    def psi(self) -> Array:
        """ψ = B v + c (m,) of the motion."""
        return np.array([entry for _, _, psi in self._now for entry in psi], dtype=float)

    @cached_property
    def c(self) -> Array:
        """What is left of ψ without any motion: f_t at configuration, b at motion constraints (m,)."""
        b = self.book
        return self._psi(b.t, b.q, np.zeros_like(b.u)).astype(float)

    @cached_property
    def B(self) -> Array:
        """J and A row by row (m, n): ψ of unit velocities of single bodies and speeds."""
        b = self.book
        frames, n = self._apart, len(b.M)
        columns = []
        for v in np.eye(n):
            scene = Scene(b.mechanism, b.t, b.q, v[n - len(b.u) :], frames, v)
            columns.append([entry for _, _, psi in self._rows(scene) for entry in psi] - self.c)
        B: Array = np.array(columns, dtype=float).T
        return B

    @cached_property
    def _apart(self) -> dict[str, Frame]:
        """The bodies as if nothing joined them: partial velocities for v itself."""
        b = self.book
        nothing = np.zeros((3, len(b.M)))
        frames = {GROUND: Frame(np.zeros(3), np.eye(3), nothing, nothing)}
        for k, body in enumerate(b.mechanism.bodies):
            frame, P_v, P_w = b.tree.frames[body.name], nothing.copy(), nothing.copy()
            P_v[:, 6 * k : 6 * k + 3] = np.eye(3)
            P_w[:, 6 * k + 3 : 6 * k + 6] = frame.turned
            to_origin = -frame.turned @ numbers(b.mechanism, body.mass_centre)
            frames[body.name] = Frame(frame.origin, frame.turned, P_v - skew(to_origin) @ P_w, P_w)
        return frames

    @property
    def J(self) -> Array:
        """Jacobian of the configuration constraints: J v = −f_t."""
        return self.B[self.holonomic]

    @property
    def A(self) -> Array:
        """Matrix of the motion constraints: A v = −b."""
        return self.B[~self.holonomic]

    @cached_property
    def G_all(self) -> Array:
        """Jacobian (m, nu) by all speeds."""
        return self.B @ self.book.P

    @cached_property
    def G(self) -> Array:
        """Jacobian (m, p) by the free speeds."""
        return self.G_all[:, self.book.free]

    @cached_property
    def gamma(self) -> Array:
        """ψ̇ (m,) without accelerations of the free speeds: ψ̇ = G u̇ + γ."""
        b = self.book

        def psi(instant: Array) -> Array:
            return self._psi(instant[-1], instant[:-1], b.u)

        bending = along(psi, np.append(b.q, b.t), np.append(b.q_dot, 1.0))
        gamma: Array = bending + self.G_all @ b.udot_t
        return gamma

    # --- complement: u = U s + u_t ---------------------------------------------------------------

    @cached_property
    def R_hat(self) -> Array:
        """Orthonormal R̂ (p, p − rank) with G R̂ = 0, by singular values."""
        if not len(self.names):
            return np.eye(len(self.book.free))
        _, sizes, V = np.linalg.svd(self.G)
        rank = int((sizes > 1e-9 * sizes[0]).sum())
        return V[rank:].T

    @cached_property
    def R(self) -> Array:
        """Partial velocities (n, p − rank) that the constraints leave: J R = 0, A R = 0."""
        return self.book.R @ self.R_hat

    @cached_property
    def b_hat(self) -> Array:
        """Free speeds (p,) of the motion that the constraints enforce, least in the mass metric."""
        b = self.book
        return self._enforced(b.q, b.t, b.u_t)

    def _enforced(self, q: Array, t: Any, u_t: Array) -> Array:
        """b̂ at any instant; rows must be independent."""
        b, free = self.book, self.book.free
        P = b.partial_velocities(q)[:, free]
        offset = self._psi(t, q, u_t)
        units = np.eye(len(b.u), dtype=q.dtype)[free]
        G = np.array([self._psi(t, q, u_t + unit) - offset for unit in units]).T
        response = np.linalg.solve(P.T @ b.M @ P, G.T)
        least: Array = -response @ np.linalg.solve(G @ response, offset)
        return least

    @cached_property
    def u_t(self) -> Array:
        """The speeds (nu,) of v_t: prescribed joints, and b̂."""
        u_t = self.book.u_t.copy()
        u_t[self.book.free] += self.b_hat
        return u_t

    @cached_property
    def v_t(self) -> Array:
        """The acatastatic part (n,) of v: J v_t = −f_t, A v_t = −b."""
        return self.book.P @ self.u_t

    @cached_property
    def v_t_dot(self) -> Array:
        """v̇_t (n,)."""
        b, nq = self.book, len(self.book.q)

        def enforced(instant: Array) -> Array:
            return self._enforced(instant[:nq], instant[nq], instant[nq + 1 :])

        udot_t = b.udot_t.copy()
        udot_t[b.free] += along(
            enforced,
            np.concatenate([b.q, [b.t], b.u_t]),
            np.concatenate([b.q_dot, [1.0], b.udot_t]),
        )
        v_t_dot: Array = b.P @ udot_t + b.P_dot @ self.u_t
        return v_t_dot

    # --- motion and multipliers ------------------------------------------------------------------

    @cached_property
    def udot(self) -> Array:
        """All accelerations (nu,): u̇ = R̂ ṡ − G⁺γ, and Kane's equations Rᵀ(F + F*) = 0 for ṡ."""
        b = self.book
        udot = prescribed(b.mechanism, b.t)[2].copy()
        udot[b.free] -= np.linalg.lstsq(self.G, self.gamma, rcond=1e-9)[0]
        if self.R.shape[1]:
            reduced = self.R.T @ b.M @ self.R
            s_dot = np.linalg.solve(reduced, self.R.T @ (b.F + b.F_star(udot)))
            udot[b.free] += self.R_hat @ s_dot
        return udot

    def multipliers(self, udot: Array) -> Array:
        """λ (m,), the least that is, of Gᵀλ = −(RᵀF + RᵀF*) in all free speeds."""
        b = self.book
        missing = -(b.F_r + b.F_r_star(udot))
        found: Array = np.linalg.lstsq(self.G.T, missing, rcond=1e-9)[0]
        return found

    def driving(self, udot: Array) -> Array:
        """Generalized forces (nu,) that drive the prescribed joints, the constraints' share taken off."""
        b = self.book
        ties = self.G_all.T @ self.multipliers(udot)
        driven = np.ones(len(b.u), dtype=bool)
        driven[b.free] = False
        return np.where(driven, b.P.T @ b.F_prime(udot) - ties, 0.0)

    # --- energies and powers ---------------------------------------------------------------------

    @property
    def K_parts(self) -> tuple[float, float, float]:
        """K2, K1, K0 (J), of degree 2, 1, 0 in the reduced speeds."""
        M, v_t = self.book.M, self.v_t
        moved = self.book.v - v_t
        K2, K1, K0 = 0.5 * moved @ M @ moved, v_t @ M @ moved, 0.5 * v_t @ M @ v_t
        return float(K2), float(K1), float(K0)

    def Q_dot(self, udot: Array) -> float:
        """Wang's net energy flow (W), second form: Q̇ = vᵀF_D + ∂V/∂t + driving power − bᵀλ − f_tᵀλ."""
        b = self.book
        flow = b.v @ b.F_D + b.V_t + self.driving(udot) @ b.u - self.c @ self.multipliers(udot)
        return float(flow)

    @property
    def rate_1990(self) -> float:
        """Kane and Levinson's bracket of 1990, vᵀM v̇_t − v_tᵀβ (W)."""
        return float(self.book.v @ self.book.M @ self.v_t_dot - self.v_t @ self.book.beta)
