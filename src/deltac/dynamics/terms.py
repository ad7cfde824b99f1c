"""The terms of the energy theorem in symbols: energies, powers, and what prescribed motion adds.

v = R u + v_t, and v_t is the motion at u = 0. In the joints' own speeds that is the motion of the
prescribed joints alone; with own generalized speeds u = Y u′ + Z the free joints take part with Z.
So v_t is always the velocity field of joint speeds u_t, and every scalar product with it is a sum over
speeds: v_tᵀF = u_tᵀ Σ f.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca

from deltac.dynamics.constraints import ConstraintRows
from deltac.dynamics.coordinates import OwnCoordinates, solve_tall
from deltac.dynamics.forces import channels, total_force
from deltac.dynamics.kkt import Schur
from deltac.dynamics.recursions import aba, armature, link_velocities, rates_of, rnea, velocities
from deltac.dynamics.spatial import SX
from deltac.dynamics.system import System
from deltac.mechanism.channels import Channel, ChannelName

DRIFT = ChannelName("correction", "drift")
"""The channel of motion that violates its constraints."""


@dataclass(frozen=True)
class Energies:
    """Kinetic energies of degree 2, 1, 0 in u, and the potential energy (J); or their rates (W)."""

    K2: Any
    K1: Any
    K0: Any
    V: Any

    @property
    def K(self) -> Any:
        """Kinetic energy K2 + K1 + K0."""
        return self.K2 + self.K1 + self.K0


@dataclass(frozen=True)
class Terms(Energies):
    """What testing functions are made of: energies, and powers (W, positive into the system).

    Scalars: SX when traced, arrays (T,) when evaluated. `force_power` = vᵀF, `nonpotential_power` =
    vᵀF_D (with ∂V/∂t of potentials driven in time), `transport_power` = v_tᵀF, `inertia_transport` =
    F_0 = −v_tᵀF*, `prescribed_power` = v_tᵀF′ = Σ over prescribed joints − bᵀλ,
    `correction_power` = ψᵀλ of motion that violates its constraints, `rate_1990` = vᵀM v̇_t − v_tᵀβ,
    `rate_1988` = ∂K/∂t + Σ X_s ∂K/∂q_s.
    """

    force_power: Any
    nonpotential_power: Any
    transport_power: Any
    inertia_transport: Any
    prescribed_power: Any
    correction_power: Any
    rate_1990: Any
    rate_1988: Any


@dataclass(frozen=True)
class Forward:
    """Forward dynamics: accelerations (nu,), driving forces (nu,) and multipliers (nc,)."""

    udot: SX
    driving: SX
    multipliers: SX


def forward(
    system: System,
    parts: tuple[Channel, ...] | None = None,
    constrained: Constrained | None = None,
    damping: tuple[float, float] = (0.0, 0.0),
) -> Forward:
    """The mechanism's own equations of motion.

    A tree by articulated bodies; with constraints, M u̇ = r + Gᵀλ and G u̇ = −γ − 2α ψ − β² φ, where
    `damping` is Baumgarte's (α, β), 1/s, which are zero in exact motion.
    """
    parts = channels(system) if parts is None else parts
    others = tuple(part for part in parts if part.name != "gravity")
    base = ca.vertcat(ca.SX.zeros(3), -system.gravity)
    tau = total_force(system, others)
    if constrained is None:
        udot, driving = aba(system, tau, base)
        return Forward(udot, driving, ca.SX(0, 1))
    rows, free = constrained.rows, system.free_u
    udot = ca.SX(system.at_rest)
    r = (tau - rnea(system, udot, base))[free, :]
    udot[free], multipliers = constrained.schur.solve(r, stabilised(rows, damping))
    driving = driving_forces(system, udot, parts, constrained, multipliers)
    return Forward(udot, driving, multipliers)


def stabilised(rows: ConstraintRows, damping: tuple[float, float]) -> SX:
    """γ + 2α ψ + β² φ, which G u̇ cancels, with Baumgarte's (α, β)."""
    alpha, beta = damping
    return rows.gamma + 2 * alpha * rows.psi + beta**2 * rows.phi


@dataclass(frozen=True)
class Constrained:
    """Independent rows of a mechanism's constraints with their factorised system."""

    rows: ConstraintRows
    schur: Schur

    @property
    def determined(self) -> bool:
        """Whether the constraints leave no freedom: all speeds follow from what is prescribed."""
        return bool(len(self.rows) == self.rows.G.shape[1])

    def multipliers_from(self, force: SX) -> SX:
        """λ whose Gᵀλ is nearest to a generalized force of the free speeds, in the metric M⁻¹."""
        return self.schur.multipliers(-force, ca.SX.zeros(len(self.rows)))


def driving_forces(
    system: System,
    udot: SX,
    parts: tuple[Channel, ...],
    constrained: Constrained | None = None,
    multipliers: SX | None = None,
) -> SX:
    """Forces (nu,) that drive the prescribed joints, from accelerations: −(F* + F + Gᵀλ) there."""
    driving = ca.SX.zeros(len(system.mechanism.speeds))
    places = system.driven_u
    if places:
        needed = rnea(system, udot) - total_force(system, parts)
        if constrained is not None:
            needed = needed - ca.mtimes(constrained.rows.G_all.T, multipliers)
        driving[places] = needed[places]
    return driving


def multipliers(
    system: System, udot: SX, parts: tuple[Channel, ...], constrained: Constrained | None
) -> SX:
    """The multipliers that accelerations ask for: what Gᵀλ can explain of −(F + F*)."""
    if constrained is None:
        return ca.SX(0, 1)
    needed = (rnea(system, udot) - total_force(system, parts))[system.free_u, :]
    return constrained.multipliers_from(needed)


@dataclass(frozen=True)
class Acatastatic:
    """The speeds u_t (nu,) whose motion is v_t, their rate, and X of q̇ = W u + X (free q)."""

    u: SX
    udot: SX
    X: SX
    Y: SX
    Z: SX


def acatastatic(
    system: System,
    own: OwnCoordinates | None = None,
    constrained: Constrained | None = None,
    udot: SX | None = None,
) -> Acatastatic:
    """The part of the motion that is there when the generalized speeds are zero.

    Where the constraints leave no freedom it is the whole motion, with the accelerations `udot` (nu,).
    With constraints that depend on time, or that prescribed joints take part in, it is the motion at zero
    own speeds; without these the motion least in the mass metric that satisfies the constraints, which is
    smooth, and the same whatever the independent speeds.
    """
    nu = len(system.mechanism.speeds)
    u_t, udot_t = ca.SX.zeros(nu), ca.SX.zeros(nu)
    for place in system.driven_u:
        u_t[place], udot_t[place] = system.u_all[place], system.udot_all[place]
    Y = ca.SX.eye(system.u.shape[0])
    Z = ca.SX.zeros(system.u.shape[0])
    if own is not None:
        own_q, _ = own.own_state(system)
        Y, Z = ca.substitute([own.Y, own.Z], [own.own_q], [own_q])
        along = ca.vertcat(system.q, system.t)
        Z_dot = ca.jtimes(Z, along, ca.vertcat(system.qdot, 1))
        for k, place in enumerate(system.free_u):
            u_t[place], udot_t[place] = Z[k], Z_dot[k]
    elif constrained is not None:
        rows = constrained.rows
        drift_rows = ca.simplify(rows.b + ca.mtimes(rows.G_all, u_t))
        if ca.sparsify(drift_rows).nnz():
            if constrained.determined:
                udot_t = system.udot_all if udot is None else udot
                Y, Z = ca.SX(system.u.shape[0], 0), system.u
                return Acatastatic(system.u_all, udot_t, system.qdot, Y, Z)
            Z = constrained.schur.least(drift_rows)
            along = ca.vertcat(system.q, system.t)
            u_t[system.free_u] = Z
            udot_t[system.free_u] = ca.jtimes(Z, along, ca.vertcat(system.qdot, 1))
    return Acatastatic(u_t, udot_t, ca.mtimes(system.W, Z), Y, Z)


@dataclass(frozen=True)
class Reactions:
    """Forces F′ of prescribed motion and constraints: `driving` (nu,) and `multipliers` (nc,)."""

    driving: SX
    multipliers: SX


def reactions_from(
    system: System, udot: SX, parts: tuple[Channel, ...], constrained: Constrained | None
) -> Reactions:
    """The reactions that accelerations ask for."""
    lam = multipliers(system, udot, parts, constrained)
    return Reactions(driving_forces(system, udot, parts, constrained, lam), lam)


def terms(
    system: System,
    udot: SX,
    parts: tuple[Channel, ...],
    own: OwnCoordinates | None = None,
    constrained: Constrained | None = None,
    reactions: Reactions | None = None,
) -> Terms:
    """All terms for accelerations `udot` (nu,), whoever made them.

    `reactions` are the driving forces and multipliers when they are known on their own; by default they
    are found from the accelerations, F′ = −(F + F*).
    """
    if reactions is None:
        reactions = reactions_from(system, udot, parts, constrained)
    drift = acatastatic(system, own, constrained, udot)
    V_t = velocities(system, drift.u)
    V = link_velocities(system)
    V_r = [v - v_t for v, v_t in zip(V, V_t)]
    A_t = rates_of(system, V, drift.u, drift.udot)
    rotor, u_r = armature(system), system.u_all - drift.u
    inertia = [link.inertia for link in system.links]

    def form(a: list[SX], b: list[SX], wa: SX, wb: SX) -> SX:
        parts = (ca.dot(x, I @ y) for x, I, y in zip(a, inertia, b) if not y.is_zero())
        return sum(parts, start=ca.SX(0)) + ca.dot(wa, rotor * wb)

    K2 = 0.5 * form(V_r, V_r, u_r, u_r)
    K1 = form(V_r, V_t, u_r, drift.u)
    K0 = 0.5 * form(V_t, V_t, drift.u, drift.u)
    force = total_force(system, parts)
    powers = channel_powers(system, parts)
    potential = {part.name for part in parts if part.potential is not None}
    prescribed_power = ca.dot(reactions.driving, system.u_all)
    correction_power = ca.SX(0)
    if constrained is not None:
        prescribed_power -= ca.dot(constrained.rows.b, reactions.multipliers)
        correction_power = ca.dot(constrained.rows.psi, reactions.multipliers)
    return Terms(
        K2=K2,
        K1=K1,
        K0=K0,
        V=_sum({part.name: part.potential for part in parts if part.potential is not None}),
        force_power=ca.dot(force, system.u_all),
        nonpotential_power=_sum({n: p for n, p in powers.items() if n not in potential}),
        transport_power=ca.dot(force, drift.u),
        inertia_transport=ca.SX(0) if drift.u.is_zero() else ca.dot(rnea(system, udot), drift.u),
        prescribed_power=prescribed_power,
        correction_power=correction_power,
        rate_1990=form(V, A_t, system.u_all, drift.udot),
        rate_1988=_rate_1988(system, 0.5 * form(V, V, system.u_all, system.u_all), drift),
    )


def channel_powers(system: System, parts: tuple[Channel, ...]) -> dict[ChannelName, SX]:
    """Power of each channel, f·u + explicit (W)."""
    powers: dict[ChannelName, SX] = {}
    for part in parts:
        power = ca.dot(part.force, system.u_all)
        if part.explicit is not None:
            power = power + part.explicit
        powers[part.name] = power
    return powers


def reaction_powers(
    system: System, reactions: Reactions, constrained: Constrained | None
) -> dict[ChannelName, SX]:
    """Power (W) of what drives each prescribed joint, of each constraint, −bᵀλ, and of drift, ψᵀλ."""
    powers: dict[ChannelName, SX] = {}
    for joint in system.mechanism.joints:
        if joint.prescribed:
            place = system.mechanism.speeds.of(joint.name)
            power = ca.dot(reactions.driving[place], system.u_all[place])
            powers[ChannelName("prescribed", joint.name)] = power
    if constrained is not None:
        rows, multipliers = constrained.rows, reactions.multipliers
        for name in dict.fromkeys(rows.names):
            k = rows.places(name)
            powers[ChannelName("constraint", name)] = -ca.dot(rows.b[k], multipliers[k])
        powers[DRIFT] = ca.dot(rows.psi, multipliers)
    return powers


def _rate_1988(system: System, K: SX, drift: Acatastatic) -> SX:
    """∂K/∂t + Σ X_s ∂K/∂q_s of K as a function of q, u′, t (Kane and Levinson 1988)."""
    along = ca.vertcat(system.q, system.t)
    direction = ca.vertcat(drift.X, 1)
    if not drift.Y.shape[1]:  # without own speeds K depends on t alone
        return ca.jtimes(
            K, ca.vertcat(along, system.u), ca.vertcat(direction, drift.udot[system.free_u, :])
        )
    speeds_held = ca.SX.sym("own_u", drift.Y.shape[1])
    u = ca.mtimes(drift.Y, speeds_held) + drift.Z
    u_rate = ca.jtimes(u, along, direction)
    if u_rate.nnz() and ca.depends_on(u_rate, speeds_held):
        own_u = solve_tall(drift.Y, system.u - drift.Z)
        u_rate = ca.substitute(u_rate, speeds_held, own_u)
    return ca.jtimes(K, along, direction) + ca.jtimes(K, system.u, u_rate)


def _sum(values: Mapping[str, SX]) -> SX:
    return sum(values.values(), start=ca.SX(0))
