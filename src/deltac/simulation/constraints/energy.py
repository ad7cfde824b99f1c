"""Energy-true steps: the state is brought back to ΔC = 0 of Wang's function after each step.

The change is the least one in the mass metric, ‖δu‖²_M + ‖δq/h‖²_M, along the constraints: where the
mechanism moves, its speeds are scaled; where it comes to rest, it is moved along its forces. The work
this does is booked like that of a projection, so ΔC tells what the run would have lost without it
(Blajer 1998 stabilises energy so; here for whole of Q, with rheonomic and nonholonomic constraints).
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from deltac.arrays import ROUGHLY, TINY, Array, max_norm
from deltac.calls.caching import derived
from deltac.dynamics.kkt import schur
from deltac.dynamics.recursions import crba
from deltac.dynamics.spatial import SX
from deltac.errors import warn_user
from deltac.kernels import Kernel
from deltac.simulation.constraints.projection import projection
from deltac.simulation.flow import StateFlow
from deltac.simulation.step_size.energy_error import ACCURATE

PASSES = 2
"""Newton's steps towards ΔC = 0: what a step of order p leaves, h^(p+1), is left in fourth power."""

LARGEST_PASS = ROUGHLY
"""A pass changes speeds by this share of themselves at most; near rest, by what the forces do in h."""


class EnergyLeftWarning(UserWarning):
    """The corrections of a run could not restore its energy."""


@derived
def energy_correction(flow: StateFlow) -> Any:
    """(t, x; p, h) -> x with K + V − Q as at the start, as a CasADi function."""
    h = ca.SX.sym("h")
    inputs = [flow.t, flow.x, flow.p]
    move = ca.Function("move", [*inputs, h], [_moved(flow, h)], {"cse": True})
    x = flow.x
    for _ in range(PASSES):
        x = move(flow.t, x, flow.p, h)
        if flow.projecting:
            x, _ = projection(flow)(flow.t, x, flow.p)
    return ca.Function("correct", [*inputs, h], [x])


@derived
def _balance(flow: StateFlow) -> Kernel:
    """(t, x; p) -> K, and K + V less what it should be."""
    imbalance = flow.energies[-2] + flow.energies[-1] - flow.x[-1]
    return flow.kernel("energy left", {"K": flow.energies[-2], "left": imbalance})


def check_correction_held(flow: StateFlow, t: Array, x: Array, p: Array) -> None:
    """Warn `EnergyLeftWarning` if the corrections of a run could not keep up with what its steps lost."""
    parameters = {"p": p} if flow.p.shape[0] else {}
    values = _balance(flow)(t=t, x=x, **parameters)
    imbalance, scale = max_norm(values["left"]), max_norm(values["K"])
    if not imbalance <= ACCURATE * scale:
        warn_user(
            f"the correction of the energy could not keep up: K + V is off by up to {imbalance:.3g} J of "
            f"{scale:.3g} J in motion. The step is too large for the motion; take a smaller one, or a solver "
            "of higher order",
            EnergyLeftWarning,
        )


def _moved(flow: StateFlow, h: SX) -> SX:
    """One pass: a step of Newton's along the steepest way, its length bounded."""
    q_part, u_part, z_part = flow.parts
    q, u, z = flow.x[q_part], flow.x[u_part], flow.x[z_part]
    energy = flow.energies[-2] + flow.energies[-1]
    imbalance = energy - z[-1]
    W = ca.jacobian(flow.xdot[q_part], u)
    along_q, along_u = ca.mtimes(W.T, ca.gradient(energy, q)), ca.gradient(energy, u)
    least_q, least_u = _least(flow, along_q), _least(flow, along_u)
    slope = ca.dot(along_u, least_u) + h**2 * ca.dot(along_q, least_q)
    # Where nothing moves and nothing pulls there is no way to go: slope and way are both zero.
    share = ca.fmin(ca.fmax(-imbalance / ca.fmax(slope, TINY), -LARGEST_PASS), LARGEST_PASS)
    moved = flow.normalised(
        ca.vertcat(q + ca.mtimes(W, h**2 * share * least_q), u + share * least_u, z)
    )
    change = flow.energy(flow.t, moved, flow.p) - flow.energies
    moved[z_part] = z + flow.booked(ca.vertcat(change, change[-2] + change[-1]))
    return moved


def _least(flow: StateFlow, force: SX) -> SX:
    """M⁻¹ of a generalized force, as far as the constraints let it act."""
    if flow.bound is not None:
        bound = flow.bound.schur
        still = ca.SX.zeros(len(flow.bound.rows))
        return bound.free_response(force) + bound.response(bound.multipliers(force, still))
    if flow.own is not None:  # in the user's own speeds the mass matrix is K's second derivative
        _, u_part, _ = flow.parts
        M, _ = ca.hessian(flow.energies[-2], flow.x[u_part])
    else:
        free = flow.system.free_u
        M = crba(flow.system)[free, free]
    return schur(M, ca.SX(0, M.shape[0])).free_response(force)
