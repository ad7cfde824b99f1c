"""How fast the fastest thing in a mechanism is, and what that asks of a step: one limit, one remedy."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import casadi as ca
import numpy as np

from deltac.arrays import PHYSICAL, Array, max_norm
from deltac.calls.caching import derived
from deltac.errors import warn_user
from deltac.simulation.flow import StateFlow
from deltac.simulation.solvers import Solver
from deltac.simulation.stepping.protocol import Motion
from deltac.simulation.stepping.runge_kutta import growth, tableau_of


class StiffStepWarning(UserWarning):
    """A step too large for the time scales of a mechanism, or of its friction or contact."""


TOLERATED = 1.01
"""Growth of a step that is not yet called unstable: undamped oscillations grow a little with most solvers."""


DOUBLED = 2.0
"""Growth per step beyond which a run follows nothing; the ledger tells of smaller growth."""

CHEAP_SIZE = 12
"""Coordinates and speeds up to which eigenvalues are cheap enough to be looked at for every run."""


@lru_cache(maxsize=256)
def reach(solver: Solver, direction: complex) -> float:
    """The largest h |λ| along a direction of λ up to which a solver does not blow up."""
    if solver.family != "fixed":
        return math.inf
    tableau = tableau_of(solver.name)
    if tableau is None:  # semi-implicit Euler: h ω = 2 for oscillations, h |λ| = 2 for decay
        return 2.0
    unit = direction / abs(direction)
    for r in np.arange(0.01, 20.0, 0.01):
        if abs(growth(tableau, r * unit)) > TOLERATED:
            return float(r)
    return 20.0


def longest_step(solver: Solver, rate: complex, *, touch: bool = False) -> float:
    """The largest step (s) of a solver for a motion exp(λ t).

    A `touch`, which lasts π/|λ|, must be resolved by all: about three steps within it.
    """
    most = reach(solver, rate / abs(rate))
    return (min(most, 1.0) if touch else most) / abs(rate)


def remedy(longest: float) -> str:
    """What to do about a step that is too large, in one sentence."""
    return (
        f"Take steps below {longest:.2g} s, or 'Radau' or 'CVODES', which choose their own; implicit fixed "
        "steps ('generalized-alpha', 'implicit-midpoint', 'ode1be') may be longer where the fast motion has "
        "settled, but must resolve every touch"
    )


@derived
def _jacobian(flow: StateFlow) -> ca.Function:
    """∂(q̇, u̇)/∂(q, u), motors at zero."""
    n = flow.q_size + flow.u_size
    J = ca.jacobian(flow.xdot[:n], flow.x)[:, :n]
    steady = ca.substitute(J, flow.inputs, ca.SX.zeros(flow.inputs.shape[0]))
    return ca.Function("J", [flow.t, flow.x, flow.p], [ca.densify(steady)])


def fastest_rate(flow: StateFlow, t: float, x: Array, p: Array) -> complex:
    """The eigenvalue λ (1/s) of largest size of ∂(q̇, u̇)/∂(q, u) at a state; NaN where undefined."""
    value = np.array(_jacobian(flow)(t, x, p))
    if not np.isfinite(value).all():
        return complex(math.nan)
    eigenvalues = np.linalg.eigvals(value)
    return complex(eigenvalues[np.argmax(np.abs(eigenvalues))])


def explained(
    flow: StateFlow, solver: Solver, h: float, p: Array, x0: Array, motion: Motion
) -> Motion:
    """A motion of explicit fixed steps; one that blew up has the time scale and the remedy in its message.

    What grew beyond all measure ends there, though it is finite. Warns `StiffStepWarning` of a run that came
    to its end with steps that cannot follow the mechanism as it was at the start (events can keep it in
    bounds).
    """
    if not flow.q_size + flow.u_size:  # a tree whose joints are all prescribed: time alone moves it
        return motion
    if not motion.message:
        motion = _within_measure(motion, x0, flow.q_size + flow.u_size)
    small = flow.q_size + flow.u_size <= CHEAP_SIZE
    if not flow.traced or not (motion.message or small):
        return motion
    t, rate = float(motion.t[0]), fastest_rate(flow, float(motion.t[0]), x0, p)
    last = motion.x[-1]
    sane = np.isfinite(last).all() and np.abs(last).max() < 1e3 * max(1.0, np.abs(x0).max())
    if motion.message and sane:
        later = fastest_rate(flow, float(motion.t[-1]), last, p)
        if abs(later) > abs(rate) or not math.isfinite(abs(rate)):
            t, rate = float(motion.t[-1]), later
    # What grows by itself is no fault of the step.
    if not math.isfinite(abs(rate)) or abs(rate) == 0.0 or rate.real > 1e-6 * abs(rate):
        return motion
    longest = longest_step(solver, rate)
    if h <= longest:
        return motion
    what = "a decay" if abs(rate.real) >= abs(rate.imag) else "an oscillation"
    words = (
        f"The fastest time scale of the mechanism, found at t = {t:.6g} s by linearising it, is 1/|λ| = "
        f"{1 / abs(rate):.3g} s ({what}), too fast for solver {solver.name!r} with a step of {h:.3g} s. "
        f"{remedy(longest)}"
    )
    if motion.message:
        return replace(motion, message=f"{motion.message}. {words}")
    if _growth(solver, h * rate) > DOUBLED:
        warn_user(f"the step is outside the solver's stability region. {words}", StiffStepWarning)
    return motion


def _growth(solver: Solver, z: complex) -> float:
    """What a step makes of an error."""
    tableau = tableau_of(solver.name)
    if tableau is not None:
        return abs(growth(tableau, z))
    return abs(z) ** 2 - 1.0  # semi-implicit Euler, of the order of its larger eigenvalue


def _within_measure(motion: Motion, x0: Array, n: int) -> Motion:
    """The motion up to where its state has grown absurdly."""
    x, most = motion.x[:, :n], PHYSICAL * max(1.0, max_norm(x0[:n]))
    if not max(x.max(initial=0.0), -x.min(initial=0.0)) > most:
        return motion
    size = np.abs(x).max(axis=1)
    k = max(int(np.argmax(size > most)), 1)
    message = (
        f"stopped at t = {motion.t[k - 1]:.9g} s: the state then grows to {size[k]:.2g}, "
        "beyond all measure"
    )
    return Motion(motion.t[:k], motion.x[:k], motion.inputs[:k], message)
