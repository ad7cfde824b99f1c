"""The equations of motion as implicit methods want them: unsolved, r(t, q, u, u̇, λ) = 0.

The residual is that of inverse dynamics (Newton–Euler forward and back), which costs a fraction of forward
dynamics, and whose derivatives are sparse where those of the articulated-body algorithm are full.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from deltac.dynamics.forces import channels, total_force
from deltac.dynamics.recursions import rnea
from deltac.dynamics.spatial import SX
from deltac.dynamics.terms import Reactions, driving_forces, terms
from deltac.errors import SolverError
from deltac.mechanism.joints import JOINT_KINDS
from deltac.simulation.flow import StateFlow


@dataclass(frozen=True)
class StagePoint:
    """An instant of a motion, in symbols: everything the equations of motion speak of."""

    t: SX
    q: SX
    u: SX
    udot: SX
    multipliers: SX


@dataclass(frozen=True)
class Slots:
    """Where a joint's free coordinates and speeds lie, and where in its coordinates a quaternion begins."""

    q: list[int]
    u: list[int]
    quaternion: int | None


class ImplicitForm:
    """The unsolved equations of a flow at a `StagePoint`, for values of motors and parameters."""

    def __init__(self, flow: StateFlow) -> None:
        """Write them out; InputError for equations by hand whose derivatives are unknown."""
        self.flow = flow
        system = flow.system
        q_part, u_part, z_part = flow.parts
        self.q, self.u = flow.x[q_part], flow.x[u_part]
        own = flow.equations is not None
        rows = None if own or flow.bound is None else flow.bound.rows
        self.multipliers = 0 if rows is None else len(rows)
        self.holonomic = [] if rows is None else [k for k, h in enumerate(rows.holonomic) if h]
        self.slots = [] if flow.own is not None else _slots(flow)
        lam = ca.SX.sym("lambda", self.multipliers)
        udot = ca.SX.sym("udot", flow.u_size) if own else system.udot
        nonpotential = ca.SX(0)
        if own:
            _check_by_hand(flow)
            r = udot - flow.xdot[u_part]
            P = flow.xdot[z_part]
        else:
            forces = channels(system)
            r = (rnea(system, system.udot_all) - total_force(system, forces))[system.free_u, :]
            if rows is not None:
                r = r - ca.mtimes(rows.G.T, lam)
            driving = driving_forces(system, system.udot_all, forces, flow.bound, lam)
            reactions = Reactions(driving, lam)
            all_terms = terms(system, system.udot_all, forces, flow.split, flow.bound, reactions)
            nonpotential = all_terms.nonpotential_power
            P = flow.powers(all_terms, forces, reactions, flow.bound)
        point = [flow.t, self.q, self.u, udot, lam, flow.inputs, flow.p]
        self._dynamics = ca.Function("r", point, [r])
        self._powers = ca.Function("P", point, [P, nonpotential])
        phi, psi, G = ca.SX(0, 1), ca.SX(0, 1), ca.SX(0, flow.u_size)
        if rows is not None:
            phi, psi, G = rows.phi, rows.psi, rows.G
        place = [flow.t, self.q, self.u, flow.p]
        self._constraints = ca.Function("constraints", place, [phi, psi, G])
        self._energy = ca.Function("E", place, [flow.energies[-2] + flow.energies[-1]])

    def dynamics(self, at: StagePoint) -> SX:
        """M u̇ + h − F − Gᵀλ (nu,), which exact motion keeps at zero."""
        return self._dynamics(*self._values(at))

    def powers(self, at: StagePoint) -> SX:
        """The rates of all integrals (W), with the point's own u̇ and λ."""
        return self._powers(*self._values(at))[0]

    def nonpotential_power(self, at: StagePoint) -> SX:
        """vᵀF_D, W."""
        return self._powers(*self._values(at))[1]

    def constraints(self, t: SX, q: SX, u: SX) -> tuple[SX, SX, SX]:
        """φ, ψ (nc,) and G (nc by nu)."""
        phi, psi, G = self._constraints(t, q, u, self.flow.p)
        return phi, psi, G

    def energy(self, t: SX, q: SX, u: SX) -> SX:
        """K + V, J."""
        return self._energy(t, q, u, self.flow.p)

    def _values(self, at: StagePoint) -> list[SX]:
        return [at.t, at.q, at.u, at.udot, at.multipliers, self.flow.inputs, self.flow.p]

    def halfway(self, q: SX, d: SX) -> SX:
        """The coordinates after half the motion `d` (nu,), a product of speeds and a time.

        Twice halfway is the whole. Plain coordinates add d/2. Quaternions turn by q ∘ (1, d/4), made
        unit: what the midpoint rule makes of q̇ = ½ q ∘ ω, exact to second order and always of length one.
        """
        if not self.slots:
            return q + d / 2
        result = ca.SX(q)
        for slots in self.slots:
            plain = len(slots.q) if slots.quaternion is None else slots.quaternion
            for i in range(plain):
                result[slots.q[i]] = q[slots.q[i]] + d[slots.u[i]] / 2
            if slots.quaternion is not None:
                places = slots.q[plain:]
                turned = _composed(q[places], ca.vertcat(1, d[slots.u[plain:]] / 4))
                result[places] = turned / ca.sqrt(ca.dot(turned, turned))
        return result

    def moved(self, q: SX, d: SX) -> SX:
        """The coordinates after the motion `d`."""
        return self.halfway(self.halfway(q, d), d)


def _composed(a: SX, b: SX) -> SX:
    """The product of two quaternions, scalar first."""
    return ca.vertcat(
        a[0] * b[0] - ca.dot(a[1:], b[1:]),
        a[0] * b[1:] + b[0] * a[1:] + ca.cross(a[1:], b[1:]),
    )


def _slots(flow: StateFlow) -> list[Slots]:
    mechanism = flow.system.mechanism
    q = {int(place): k for k, place in enumerate(mechanism.free.q)}
    u = {int(place): k for k, place in enumerate(mechanism.free.u)}
    slots = []
    for joint in mechanism.joints:
        if joint.prescribed or not joint.speeds:
            continue
        in_q, in_u = mechanism.coordinates.of(joint.name), mechanism.speeds.of(joint.name)
        slots.append(
            Slots(
                [q[k] for k in range(in_q.start, in_q.stop)],
                [u[k] for k in range(in_u.start, in_u.stop)],
                JOINT_KINDS[joint.kind].quaternion,
            )
        )
    return slots


def _check_by_hand(flow: StateFlow) -> None:
    assert flow.equations is not None
    name = flow.equations.name
    if not flow.traced:
        raise SolverError(
            f"{name}: an implicit solver differentiates the equations, and these can only be called from "
            "Python; write rhs with arithmetic and NumPy's elementary functions, or use 'Radau'"
        )
    if flow.own is not None and flow.own.removal is not None:
        raise SolverError(
            f"{name}: an implicit solver keeps equations of the mechanism on its constraints, not those in "
            "fewer coordinates; use 'Radau', or solve the mechanism's own equations"
        )
    if flow.own is not None and not _same(flow.own.own_qdot, flow.own.own_u):
        raise SolverError(
            f"{name}: an implicit solver needs own speeds that are the rates of the own coordinates; "
            "leave out u= of the coordinate map, or use 'Radau'"
        )


def _same(a: Any, b: Any) -> bool:
    return bool(a.shape == b.shape and ca.is_equal(a, b, 5))
