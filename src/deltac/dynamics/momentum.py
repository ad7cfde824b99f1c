"""Momenta: those of generalized speeds, and those of the parts of a mechanism that hang on the ground.

The momentum p_r = ∂K/∂u_r of a speed is s_r·H_r: s_r is the joint's motion vector, H_r the momentum of all
bodies that the joint carries. So ṗ_r = F_r + (Gᵀλ)_r + ṡ_r·H_r, where the last term is ∂K/∂q_r if u_r = q̇_r.
None of it needs accelerations: each speed has a testing function ΔP_r of its own.

The bodies beyond a ground joint move together with a fixed screw s (a translation, or a turn about a
fixed line) if the joint allows it: speeds α(q) of that joint, all others held. Then the ground's
ideal reaction does nothing along s, and d/dt (h·s) = αᵀ Σ f with h·s = αᵀ p, p = M u the joint's
generalized momentum.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from deltac.dynamics.coordinates import OwnCoordinates
from deltac.dynamics.recursions import armature, link_velocities, rnea
from deltac.dynamics.spatial import SX, cross, cross_force
from deltac.dynamics.system import Link, System
from deltac.dynamics.terms import Constrained
from deltac.mechanism.channels import Channel


@dataclass(frozen=True)
class MomentumFunctions:
    """The generalized momenta `momentum` p_r (n,), kg·m/s or kg·m²/s, and their rates (n,), N or N·m.

    Exact motion satisfies ṗ_r = `rate`, hence ΔP_r = p_r − p_r(0) − ∫ rate dt = 0. `names` are the speeds.
    """

    names: tuple[str, ...]
    momentum: SX
    rate: SX


def momentum_functions(
    system: System, force: SX, own: OwnCoordinates | None = None
) -> MomentumFunctions:
    """The momentum testing functions of the free speeds.

    Args:
        system: the mechanism in symbols.
        force: generalized forces (nu,) of all channels and constraints.
        own: own generalized speeds u′ of u = Y u′ + Z, which give Kane's form p′ = Yᵀp. Where they satisfy
            the constraints, these drop out, and `force` need not hold them.
    """
    free = system.free_u
    V, H = _carried_momenta(system)
    turned = ca.SX.zeros(len(system.mechanism.speeds))
    for k, link in enumerate(system.links):
        turned[link.u] = ca.mtimes(link.S_dot.T, H[k]) - ca.mtimes(
            link.S.T, cross_force(V[k], H[k])
        )
    p, rate = _generalized_momenta(system, H)[free, :], (force + turned)[free, :]
    names = tuple(system.mechanism.speeds[k].name for k in free)
    if own is None:
        return MomentumFunctions(names, p, rate)
    own_q, _ = own.own_state(system)
    Y = ca.substitute(own.Y, own.own_q, own_q)
    Y_dot = ca.jtimes(Y, ca.vertcat(system.q, system.t), ca.vertcat(system.qdot, 1))
    along = ca.mtimes(Y.T, rate) + ca.mtimes(Y_dot.T, p)
    return MomentumFunctions(own.names, ca.mtimes(Y.T, p), along)


def constraint_force(system: System, force: SX, constrained: Constrained | None) -> SX:
    """Generalized forces Gᵀλ (nu,) of the constraints beside `force` (nu,), by the equations at a state."""
    if constrained is None:
        return ca.SX.zeros(len(system.mechanism.speeds))
    needed = (force - rnea(system, system.at_rest))[system.free_u]
    multipliers = constrained.schur.multipliers(needed, constrained.rows.gamma)
    return ca.mtimes(constrained.rows.G_all.T, multipliers)


def _carried_momenta(system: System) -> tuple[list[SX], list[SX]]:
    """Velocity of each link, and the momentum of all bodies that its joint carries (link frames)."""
    V = link_velocities(system)
    H = [link.inertia @ V[k] for k, link in enumerate(system.links)]
    for k in reversed(range(len(H))):
        link = system.links[k]
        if link.parent >= 0:
            H[link.parent] += link.X.force_back(H[k])
    return V, H


def _generalized_momenta(system: System, H: Sequence[SX]) -> SX:
    """Momenta p (nu,) of all speeds, rotors included."""
    p = armature(system) * system.u_all
    for link, carried in zip(system.links, H):
        if link.joint.speeds:  # CasADi adds no 1×0 to a 0×1
            p[link.u] += ca.mtimes(link.S.T, carried)
    return p


@dataclass(frozen=True)
class MomentumBalance:
    """`momentum` h·s (kg·m/s or kg·m²/s) obeys d/dt momentum = Σ over channels of αᵀf.

    `alpha` (nu,) are the speeds that carry the rigid motion s.
    """

    name: str
    momentum: SX
    alpha: SX

    def force(self, parts: tuple[Channel, ...]) -> SX:
        """Its rate by the forces of `parts` (N or N·m)."""
        return sum((ca.dot(self.alpha, part.force) for part in parts), start=ca.SX(0))


def momentum_balances(system: System) -> tuple[MomentumBalance, ...]:
    """The balances of all ground joints; prescribed and fixed ones leave no direction free."""
    _, H = _carried_momenta(system)
    p = _generalized_momenta(system, H)
    balances: list[MomentumBalance] = []
    for link in system.links:
        if link.parent >= 0 or link.joint.prescribed or bool(link.joint.armature):
            continue
        for label, own in _free_screws(system, link):
            alpha = ca.SX.zeros(len(system.mechanism.speeds))
            alpha[link.u] = own
            balances.append(MomentumBalance(f"{label} {link.joint.name}", ca.dot(alpha, p), alpha))
    return tuple(balances)


def _free_screws(system: System, link: Link) -> list[tuple[str, SX]]:
    """Names of fixed screws that a ground joint allows, with the joint's speeds for each."""
    q = system.q_all[link.q]
    eye = ca.SX.eye(3)
    match link.joint.kind:
        case "free":
            screws = []
            for k, axis in enumerate("xyz"):
                screws.append((f"linear {axis}", ca.vertcat(eye[:, k], ca.SX.zeros(3))))
            R = _orientation(system, link)
            for k, axis in enumerate("xyz"):
                turned = ca.vertcat(cross(eye[:, k], q[:3]), ca.mtimes(R.T, eye[:, k]))
                screws.append((f"angular {axis}", turned))
            return screws
        case "spherical":
            R = _orientation(system, link)
            return [(f"angular {axis}", ca.mtimes(R.T, eye[:, k])) for k, axis in enumerate("xyz")]
        case "planar":
            return [
                ("linear x", ca.vertcat(1, 0, 0)),
                ("linear y", ca.vertcat(0, 1, 0)),
                ("angular z", ca.vertcat(-q[1], q[0], 1)),
            ]
        case "revolute" | "screw":
            return [("angular", ca.SX(1))]
        case "prismatic":
            return [("linear", ca.SX(1))]
        case "cylindrical":
            return [("angular", ca.vertcat(1, 0)), ("linear", ca.vertcat(0, 1))]
        case "universal":
            return [("angular", ca.vertcat(1, 0))]
    return []


def _orientation(system: System, link: Link) -> SX:
    """Rotation of the link in its joint's frame on the ground."""
    before = ca.SX(ca.DM([list(row) for row in link.joint.rotation]))
    return ca.mtimes(before.T, link.X.E.T)
