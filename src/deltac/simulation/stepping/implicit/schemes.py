"""One step of each implicit method, as equations for its unknowns.

The unknowns are speed-like: the new speeds (or h times the new accelerations), then h λ, so that all parts
of the Jacobian are of one size whatever the step. Integrals are taken at the points at which the equations
of motion are met, by the method's own quadrature.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import casadi as ca

from deltac.dynamics.spatial import SX
from deltac.simulation.stepping.implicit.form import ImplicitForm, StagePoint


@dataclass(frozen=True)
class Before:
    """Where a step starts: t, its length h, x = (q, u, z), the method's `memory` and spectral `radius`."""

    t: SX
    h: SX
    q: SX
    u: SX
    z: SX
    memory: SX
    radius: SX


@dataclass(frozen=True)
class StepEquations:
    """A step in symbols: `residual` of the `unknowns` must vanish; then x is `after`, the memory `memory`.

    `speeds` is how many of the unknowns, the first, are speeds.
    """

    unknowns: SX
    speeds: int
    residual: SX
    after: SX
    memory: SX


Scheme: TypeAlias = Callable[[ImplicitForm, Before], StepEquations]


def backward_euler(form: ImplicitForm, b: Before) -> StepEquations:
    """u₁ = u₀ + h u̇₁, q₁ = q₀ + h W u₁, ψ₁ = 0: first order, and L-stable.

    Integrals take P at the end. Positions on the constraints are left to the projection.
    """
    u, impulse = _unknowns(form)
    lam, t = impulse / b.h, b.t + b.h
    end = StagePoint(t, form.moved(b.q, b.h * u), u, (u - b.u) / b.h, lam)
    _, psi, _ = form.constraints(t, end.q, u)
    P = form.powers(end)
    after = ca.vertcat(end.q, u, b.z + b.h * P)
    residual = ca.vertcat(b.h * form.dynamics(end), psi)
    return StepEquations(ca.vertcat(u, impulse), u.shape[0], residual, after, ca.SX(0, 1))


def implicit_midpoint(form: ImplicitForm, b: Before) -> StepEquations:
    """The equations of motion at the middle of the step, ψ₁ = 0 at its end: second order, A-stable.

    Symplectic for the mechanism's own speeds where the mass matrix is constant; K then closes identically
    under Liu and Huston's function, whatever the step.
    """
    u, impulse = _unknowns(form)
    middle = _middle(form, b, u, impulse / b.h, b.h * (b.u + u) / 2)
    q = form.halfway(middle.q, b.h * middle.u)
    _, psi, _ = form.constraints(b.t + b.h, q, u)
    P = form.powers(middle)
    after = ca.vertcat(q, u, b.z + b.h * P)
    residual = ca.vertcat(b.h * form.dynamics(middle), psi)
    return StepEquations(ca.vertcat(u, impulse), u.shape[0], residual, after, ca.SX(0, 1))


def generalized_alpha(form: ImplicitForm, b: Before) -> StepEquations:
    """The method of Chung and Hulbert: second order, with numerical damping of what is fast.

    J. Appl. Mech. 60 (1993) 371-375; with constraints as by Arnold and Brüls, Multibody Syst. Dyn. 18 (2007)
    185-202; turns after Brüls and Cardona, J. Comput. Nonlinear Dyn. 5 (2010) 031002.

    Constraints are met on the position level; velocities are then off by a bias of second order, on which
    multipliers of second order depend. A projected run has no such bias: the projection takes a part of the
    order of h of what λ should do. Both are booked, so that q, u and the work of constraints stay of second
    order; the forces that a trajectory records are those of the state.

    The memory holds the rates (u̇, P) and the method's auxiliary ones, which belong to the time
    t + (α_m − α_f) h. Powers are integrated by the same formulas as speeds (Jansen, Whiting, Hulbert, Comput.
    Methods Appl. Mech. Eng. 190 (2000) 305-319, for first-order systems).
    """
    radius = b.radius
    alpha_m, alpha_f = (2 * radius - 1) / (radius + 1), radius / (radius + 1)
    gamma = 0.5 + alpha_f - alpha_m
    beta = 0.25 * (gamma + 0.5) ** 2
    n, width = b.u.shape[0], b.u.shape[0] + b.z.shape[0]
    # With columns named: of a memory of one entry, no rows would be no columns.
    previous, aux = b.memory[:width, :], b.memory[width:, :]

    def following(rates: SX, part: slice) -> SX:
        """The auxiliary rates at the end of the step."""
        mixed = (1 - alpha_f) * rates + alpha_f * previous[part, :] - alpha_m * aux[part, :]
        return mixed / (1 - alpha_m)

    w, impulse = _unknowns(form)
    udot, lam, t = w / b.h, impulse / b.h, b.t + b.h
    a0, a1 = aux[:n, :], following(udot, slice(0, n))
    u = b.u + b.h * ((1 - gamma) * a0 + gamma * a1)
    q = form.moved(b.q, b.h * b.u + b.h**2 * ((0.5 - beta) * a0 + beta * a1))
    end = StagePoint(t, q, u, udot, lam)
    phi, psi, _ = form.constraints(t, q, u)
    tied = ca.SX(psi)
    tied[form.holonomic] = phi[form.holonomic, :] / b.h
    P = form.powers(end)
    p0, p1 = aux[n:, :], following(P, slice(n, width))
    z = b.z + b.h * ((1 - gamma) * p0 + gamma * p1)
    memory = ca.vertcat(udot, P, a1, p1)
    residual = ca.vertcat(b.h * form.dynamics(end), tied)
    after = ca.vertcat(q, u, z)
    return StepEquations(ca.vertcat(w, impulse), w.shape[0], residual, after, memory)


def discrete_gradient(form: ImplicitForm, b: Before) -> StepEquations:
    """The midpoint rule with a discrete gradient of K + V: second order, and energy is kept.

    After Gonzalez, J. Nonlinear Sci. 6 (1996) 449-467: K + V changes by the work of non-potential forces
    alone. Momenta, which his scheme can keep as well, are right to second order.

    The gradient is corrected along the motion, in the mass metric: by μ M u_m, of second order in h, with μ
    such that K + V changes over the step by h vᵀF_D of its middle, configuration-dependent M(q) and
    multipliers included. Constraints hold at the end on both levels: φ₁ = 0 by a correction h Gᵀκ of the
    motion, ψ₁ = 0 by λ.
    """
    u, impulse = _unknowns(form)
    kappa = ca.SX.sym("kappa", len(form.holonomic))
    _, _, G = form.constraints(b.t, b.q, b.u)
    d = b.h * ((b.u + u) / 2 + ca.mtimes(G[form.holonomic, :].T, kappa))
    middle = _middle(form, b, u, impulse / b.h, d)
    q, t = form.halfway(middle.q, d), b.t + b.h
    r = form.dynamics(middle)
    at_rest = StagePoint(middle.t, middle.q, middle.u, 0 * middle.u, middle.multipliers)
    velocity = StagePoint(middle.t, middle.q, middle.u, middle.u, middle.multipliers)
    momentum = form.dynamics(velocity) - form.dynamics(at_rest)  # M u_m: r is linear in u̇
    before = form.energy(b.t, b.q, b.u)
    gained = (form.energy(t, q, u) - before) / b.h
    gap = gained - form.nonpotential_power(middle) - ca.dot(middle.u, r)
    # Where all stands still there is nothing to correct: the gap is rounding of the energies.
    still = 2.2e-16 * ca.fabs(before) + 1e-300
    mu = gap / (ca.dot(middle.u, momentum) + still)
    phi, psi, _ = form.constraints(t, q, u)
    # What λ does at the middle, where ψ is not zero, the correction has undone: it is no one's work.
    P = form.powers(StagePoint(middle.t, middle.q, middle.u, middle.udot, 0 * impulse))
    after = ca.vertcat(q, u, b.z + b.h * P)
    residual = ca.vertcat(b.h * (r + mu * momentum), psi, phi[form.holonomic, :] / b.h)
    unknowns = ca.vertcat(u, kappa, impulse)
    speeds = u.shape[0] + kappa.shape[0]
    return StepEquations(unknowns, speeds, residual, after, ca.SX(0, 1))


SCHEMES: dict[str, Scheme] = {
    "ode1be": backward_euler,
    "implicit-midpoint": implicit_midpoint,
    "generalized-alpha": generalized_alpha,
    "discrete-gradient": discrete_gradient,
}
"""The step of every implicit solver, by its name."""


def _unknowns(form: ImplicitForm) -> tuple[SX, SX]:
    return ca.SX.sym("w", form.flow.u_size), ca.SX.sym("impulse", form.multipliers)


def _middle(form: ImplicitForm, b: Before, u: SX, lam: SX, d: SX) -> StagePoint:
    return StagePoint(b.t + b.h / 2, form.halfway(b.q, d), (b.u + u) / 2, (u - b.u) / b.h, lam)
