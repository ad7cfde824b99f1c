"""How fast the fastest thing in a mechanism is: what a run that blew up has to be told."""

from __future__ import annotations

import math
from dataclasses import replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deltac.simulation.fixed import Course, Motion
from deltac.simulation.flow import Flow
from deltac.simulation.solvers.explicit import TABLEAUS, growth
from deltac.simulation.solvers.solver import Solver

Array = NDArray[np.float64]

TOLERATED = 1.01
"""Growth of a step that is not yet called unstable: undamped oscillations grow a little with most solvers."""


def reach(solver: Solver, direction: complex) -> float:
    """The largest h |λ| along a direction of λ up to which an explicit solver does not blow up."""
    tableau = TABLEAUS.get(solver.name)
    if tableau is None:  # semi-implicit Euler: h ω = 2 for oscillations, h |λ| = 2 for decay
        return 2.0
    unit = direction / abs(direction)
    for r in np.arange(0.01, 20.0, 0.01):
        if abs(growth(tableau, r * unit)) > TOLERATED:
            return float(r)
    return 20.0


def fastest_rate(flow: Flow, t: float, x: Array, p: Array) -> complex:
    """The eigenvalue λ (1/s) of largest size of ∂(q̇, u̇)/∂(q, u) at a state; NaN where undefined."""
    n = flow.q_size + flow.u_size
    J = ca.jacobian(flow.xdot[:n], flow.x)[:, :n]
    held = ca.substitute(J, flow.inputs, ca.SX.zeros(flow.inputs.shape[0]))
    value = np.array(ca.Function("J", [flow.t, flow.x, flow.p], [ca.densify(held)])(t, x, p))
    if not np.isfinite(value).all():
        return complex(math.nan)
    found = np.linalg.eigvals(value)
    return complex(found[np.argmax(np.abs(found))])


def explained(flow: Flow, solver: Solver, course: Course, motion: Motion) -> Motion:
    """A motion that blew up, with the fastest time scale found and the remedy in its message.

    The scale is that of the start, or that of the last state kept where it is shorter and the state is
    not yet absurd. Nothing is added where the step is short enough for it: then something else is wrong.
    """
    if not motion.message or not flow.traced:
        return motion
    x0, p, h = course.x0, course.p, course.h
    t, rate = course.t0, fastest_rate(flow, course.t0, x0, p)
    last = motion.x[-1]
    if np.isfinite(last).all() and np.abs(last).max() < 1e3 * max(1.0, np.abs(x0).max()):
        later = fastest_rate(flow, float(motion.t[-1]), last, p)
        if abs(later) > abs(rate) or not math.isfinite(abs(rate)):
            t, rate = float(motion.t[-1]), later
    if not math.isfinite(abs(rate)) or abs(rate) == 0.0:
        return motion
    if rate.real > 0.0:  # what grows by itself is no fault of the step
        return motion
    limit = reach(solver, rate)
    if h * abs(rate) <= limit:
        return motion
    what = "decay" if abs(rate.real) >= abs(rate.imag) else "oscillation"
    return replace(
        motion,
        message=f"{motion.message}. The fastest time scale of the mechanism, found at t = {t:.6g} s by "
        f"linearising it, is 1/|λ| = {1 / abs(rate):.3g} s (a {what}); solver {solver.name!r} follows it "
        f"with steps below {limit / abs(rate):.2g} s, and the step is {h:.3g} s. Take such a step, or an "
        "implicit solver: 'generalized-alpha', 'implicit-midpoint', 'ode1be', or 'Radau'",
    )
