"""How fast the fastest thing in a mechanism is: what a run that blew up has to be told."""

from __future__ import annotations

import math
from dataclasses import replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deltac.simulation.fixed import Motion
from deltac.simulation.flow import Flow
from deltac.simulation.solvers.solver import Solver

Array = NDArray[np.float64]

REACH: dict[str, tuple[float, float]] = {
    "ode1": (2.0, 0.0),
    "ode2": (2.0, 0.0),
    "ode3": (2.51, 1.73),
    "ode4": (2.79, 2.83),
    "ode5": (3.31, 1.0),
    "ode8": (5.4, 1.0),
    "semi-implicit-euler": (2.0, 2.0),
}
"""Largest h |λ| at which a solver is stable: for decay (λ < 0) and for oscillation (λ imaginary)."""


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


def explained(
    flow: Flow, solver: Solver, h: float, motion: Motion, t0: float, x0: Array, p: Array
) -> Motion:
    """A motion that blew up, with the fastest time scale found and the remedy in its message.

    The scale is that of the start, or that of the last state kept where it is shorter and the state is
    not yet absurd. Nothing is added where the step is short enough for it: then something else is wrong.
    """
    if not motion.message or not flow.traced:
        return motion
    t, rate = t0, fastest_rate(flow, t0, x0, p)
    last = motion.x[-1]
    if np.isfinite(last).all() and np.abs(last).max() < 1e3 * max(1.0, np.abs(x0).max()):
        later = fastest_rate(flow, float(motion.t[-1]), last, p)
        if abs(later) > abs(rate) or not math.isfinite(abs(rate)):
            t, rate = float(motion.t[-1]), later
    if not math.isfinite(abs(rate)) or abs(rate) == 0.0:
        return motion
    real, imaginary = REACH[solver.name]
    decays = abs(rate.real) >= abs(rate.imag)
    reach = real if decays else max(imaginary, 1.0)
    if h * abs(rate) <= reach:
        return motion
    what = "decay" if decays else "oscillation"
    return replace(
        motion,
        message=f"{motion.message}. The fastest time scale of the mechanism, found at t = {t:.6g} s by "
        f"linearising it, is 1/|λ| = {1 / abs(rate):.3g} s (a {what}); solver {solver.name!r} follows it "
        f"with steps below {reach / abs(rate):.2g} s, and the step is {h:.3g} s. Take such a step, or an "
        "implicit solver: 'generalized-alpha', 'implicit-midpoint', 'ode1be', or 'Radau'",
    )
