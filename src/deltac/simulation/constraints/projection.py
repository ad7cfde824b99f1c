"""Staying on the constraints: projection of coordinates and speeds, least in the mass metric.

After each accepted step q and u are moved by M⁻¹Gᵀ(…) until φ and ψ vanish. What this does to the
energies is booked: each testing function's integral takes the change of its E, and the integrals
"correction kinetic" and "correction potential" the changes of K and V.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from deltac.calls.caching import derived
from deltac.dynamics.equations_of_motion import equations_of
from deltac.dynamics.spatial import SX
from deltac.simulation.constraints.singular import DEPENDENT
from deltac.simulation.flow import StateFlow

NEARLY_DEPENDENT = 10.0 * DEPENDENT
"""Smallest pivot, by the largest so far, below which steps of a solver's own choice are not trusted.

An error ε of a step changes the speeds by ε/√pivot when it is projected, and the next accelerations as well:
an error control shortens its steps without end there, or accepts speeds that a projection has changed.
"""


@derived
def projection(flow: StateFlow) -> Any:
    """(t, x; p) -> x on the constraints, and the smallest pivot met, as a CasADi function.

    One Newton step on the coordinates; then, with the factorisation there, a second one and the speeds:
    what a step leaves of order h^(p+1) is left in fourth power. Equations by hand in independent speeds
    determine some coordinates; only those that follow from the constraints are moved.
    """
    bound = flow.bound
    assert bound is not None
    system, rows = flow.system, bound.rows
    q_part, u_part, z_part = flow.parts
    W = equations_of(system).W
    place = [flow.t, system.q, flow.p]
    u_symbols = system.u
    least, speeds = bound.schur.least(rows.phi), bound.schur.least(rows.psi)
    if flow.own is not None:  # own speeds satisfy the constraints by themselves, and stay
        assert flow.own.removal is not None
        u_symbols = flow.own.own_u
        least, speeds = flow.own.removal(rows.phi), ca.SX.zeros(u_symbols.shape[0])
    moved_q = ca.mtimes(W, least)
    first = ca.Function("first", place, [moved_q, smallest_pivot(flow)])
    second = ca.Function(
        "second",
        [flow.t, system.q, u_symbols, flow.p],
        [moved_q, speeds, smallest_pivot(flow)],
    )
    q, u, z = flow.x[q_part], flow.x[u_part], flow.x[z_part]
    dq, pivot = first(flow.t, q, flow.p)
    near = flow.normalised(q + dq)
    dq, du, later = second(flow.t, near, u, flow.p)
    moved = ca.vertcat(flow.normalised(near + dq), u + du, z)
    change = flow.energy(flow.t, moved, flow.p) - flow.energy(flow.t, flow.x, flow.p)
    moved[z_part] = z + flow.booked(change)
    return ca.Function("project", [flow.t, flow.x, flow.p], [moved, ca.fmin(pivot, later)])


@derived
def pivot(flow: StateFlow) -> Any:
    """(t, x; p) -> the smallest pivot of the constraints there, as a CasADi function."""
    return ca.Function("pivot", [flow.t, flow.x, flow.p], [smallest_pivot(flow)])


def smallest_pivot(flow: StateFlow) -> SX:
    """How near the constraints are to being dependent: 1 independent, 0 dependent."""
    assert flow.bound is not None
    pivot = flow.bound.schur.smallest_pivot
    if flow.own is not None:  # the solver's state holds the user's own coordinates
        pivot = ca.substitute(pivot, flow.system.q, flow.own.q)
    return pivot
