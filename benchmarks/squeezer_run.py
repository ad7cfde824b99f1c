"""Andrews' squeezing mechanism to 1e-8 rad, beside SUNDIALS' IDA on the same compiled equations.

Both sides get their equations ready before the clock starts: we a step of ode5 with projection, IDA (by
CasADi's `integrator`) the accelerations ẋ as an expression, with exact Jacobians. Each takes the coarsest
step or tolerance of its list whose end is within 1e-8 rad of a run in far smaller steps.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from measure import contest
from numpy.typing import NDArray

import deltac as dc
from deltac.simulation.course import Course
from deltac.simulation.feasibility import constraint_start
from deltac.simulation.fixed import FixedStepper
from deltac.simulation.flow import build_flow
from deltac.simulation.solvers import find_solver

Array = NDArray[np.float64]
WITHIN = 1e-8  # rad
STEPS = (150, 200, 300, 400, 600, 800, 1200)
FINE = 8000
TOLERANCES = (1e-9, 1e-10, 1e-11, 3e-12, 1e-12, 3e-13, 1e-13)
TARGET = 1.0
CALLS = 10
"""Runs in a measurement: one takes a few milliseconds."""


def run(rounds: int) -> dict[str, Any]:
    """Find what each side needs for the accuracy, then time that."""
    problem, solver = dc.problems.load("andrews-squeezer"), find_solver("ode5")
    mechanism, end, nothing = problem.mechanism, problem.duration, np.empty(0)
    rows = constraint_start(mechanism, problem.state, solver, None, "projection")
    flow = build_flow(mechanism, ("wang",), rows=rows)
    stepper, start = FixedStepper(flow, solver), flow.start(problem.state, nothing)
    angles = flow.parts[0]

    def ours(steps: int) -> Array:
        return stepper.run(Course(nothing, start, 0.0, end / steps, steps, steps)).x[-1][angles]

    exact = ours(FINE)
    steps = next(n for n in STEPS if _off(ours(n), exact) < WITHIN)
    free = build_flow(mechanism, ("wang",), rows=rows, stabilisation="none")
    x0 = free.start(problem.state, nothing)

    def rival(name: str, tolerance: float) -> Any:
        options = {"reltol": tolerance, "abstol": tolerance / 10, "max_num_steps": 10**6}
        equations = {"x": free.x, "t": free.t, "ode": free.xdot}
        return ca.integrator("rival", name, equations, 0.0, end, options)

    def last(integrator: Any) -> Array:
        return np.array(integrator(x0=x0)["xf"]).ravel()[angles]

    tolerance, ida = next(
        (tolerance, made)
        for tolerance in TOLERANCES
        for made in [rival("idas", tolerance)]
        if _off(last(made), exact) < WITHIN
    )
    measured = contest(
        lambda: [ours(steps) for _ in range(CALLS)],
        lambda: [last(ida) for _ in range(CALLS)],
        rounds,
    ).summary()
    for side in ("ours_s", "theirs_s"):
        measured[side] /= CALLS
    return {
        "name": f"Andrews' squeezer to {WITHIN:g} rad: deltac ode5 / SUNDIALS IDA",
        "target": TARGET,
        **measured,
        "steps": steps,
        "tolerance": tolerance,
        "our_error_rad": _off(ours(steps), exact),
        "their_error_rad": _off(last(ida), exact),
    }


def told(found: dict[str, Any]) -> str:
    """What is particular to this contest, in words."""
    return (
        f"{found['steps']} steps, error {found['our_error_rad']:.0e} rad; IDA at {found['tolerance']:g}, "
        f"error {found['their_error_rad']:.0e} rad"
    )


def _off(found: Array, exact: Array) -> float:
    return float(np.abs(found - exact).max())
