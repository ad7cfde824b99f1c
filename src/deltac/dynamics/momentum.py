"""Momentum of the parts of a mechanism that hang on the ground, along the directions left free.

The bodies beyond a ground joint move together with a fixed screw s (a translation, or a turn about a
fixed line) if the joint allows it: speeds α(q) of that joint, all others held. Then the ground's
ideal reaction does nothing along s, and d/dt (h·s) = αᵀ Σ f with h·s = αᵀ p, p = M u the joint's
generalized momentum.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from deltac.dynamics.recursions import armature, gather, velocities
from deltac.dynamics.spatial import SX, cross
from deltac.dynamics.system import Link, System
from deltac.mechanism.channels import Channel


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
    V = velocities(system, system.u_all)
    p = gather(system, [link.inertia @ V[k] for k, link in enumerate(system.links)])
    p = p + armature(system) * system.u_all
    found: list[MomentumBalance] = []
    for link in system.links:
        if link.parent >= 0 or link.joint.prescribed or bool(link.joint.armature):
            continue
        for label, own in _free_screws(system, link):
            alpha = ca.SX.zeros(len(system.mechanism.speeds))
            alpha[link.u] = own
            found.append(MomentumBalance(f"{label} {link.joint.name}", ca.dot(alpha, p), alpha))
    return tuple(found)


def _free_screws(system: System, link: Link) -> list[tuple[str, SX]]:
    """Names of fixed screws that a ground joint allows, with the joint's speeds for each."""
    q = system.q_all[link.q]
    eye = ca.SX.eye(3)
    match link.joint.kind:
        case "free":
            made = []
            for k, axis in enumerate("xyz"):
                made.append((f"linear {axis}", ca.vertcat(eye[:, k], ca.SX.zeros(3))))
            R = _orientation(system, link)
            for k, axis in enumerate("xyz"):
                turned = ca.vertcat(cross(eye[:, k], q[:3]), ca.mtimes(R.T, eye[:, k]))
                made.append((f"angular {axis}", turned))
            return made
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
