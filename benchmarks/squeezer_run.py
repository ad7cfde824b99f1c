"""Andrews' squeezing mechanism to 1e-8 rad, beside SUNDIALS' IDA and CVODES, and Exudyn.

SUNDIALS (by CasADi's `integrator`) gets the same equations, the accelerations ẋ as an expression; Exudyn gets
the mechanism as its own bodies and joints. All sides get ready before the clock starts: ours are the
compiled steps that `simulate` takes, without what it checks before and after them, and its whole time stands
beside. Each takes the coarsest step or tolerance whose end is within 1e-8 rad of a run in far smaller
steps; Exudyn's method is of second order, so that its step follows from the error of a coarse run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import compiled_steps
import numpy as np
from measure import contest, median_seconds
from numpy.typing import NDArray
from peers import casadi_squeezer

import deltac as dc
from deltac.simulation.constraints.feasibility import constraint_start
from deltac.simulation.flow import build_flow
from deltac.simulation.solvers import find_solver
from deltac.simulation.stepping.explicit import FixedMethod

Array = NDArray[np.float64]
SOLVER = "ode5"
WITHIN = 1e-8  # rad
STEPS = (150, 200, 300, 400, 450, 500, 550, 600, 800, 1200)
FINE = 8000
TOLERANCES = tuple(digit * 10.0**-n for n in range(9, 14) for digit in (1.0, 0.5, 0.2))
COARSE = 20_000
"""Exudyn's steps of the run from which the others follow."""
MARGIN = 1.05
TARGET = 1.0
CALLS = 10
"""Runs in a measurement: one takes a few milliseconds."""


def run(rounds: int, few: int) -> list[dict[str, Any]]:
    """Find what each side needs for the accuracy, then time that: `few` times beside Exudyn."""
    squeezer = Squeezer()
    simulate_s = median_seconds(squeezer.simulate, few)
    found = [*_beside_sundials(squeezer, rounds), _beside_exudyn(squeezer, few)]
    return [one if "skipped" in one else {**one, "simulate_s": simulate_s} for one in found]


def told(found: dict[str, Any]) -> str:
    """What is particular to this contest, in words."""
    return (
        f"{found['steps']} steps, error {found['our_error_rad']:.0e} rad; the other: {found['needs']}, "
        f"error {found['their_error_rad']:.0e} rad; a whole simulate with the end alone recorded: "
        f"{1e3 * found['simulate_s']:.0f} ms"
    )


class Squeezer:
    """Our side: a compiled step, the end it leads to, and how many steps the accuracy takes."""

    def __init__(self) -> None:
        self.problem, solver = dc.problems.load("andrews-squeezer"), find_solver(SOLVER)
        mechanism = self.problem.mechanism
        self.rows = constraint_start(mechanism, self.problem.state, solver, "projection")
        flow = build_flow(mechanism, ("wang",), rows=self.rows)
        self.stepper = FixedMethod(flow, solver)
        self.start = flow.start(self.problem.state, np.empty(0))
        self.angles = flow.parts[0]
        self.exact = self.end(FINE)
        self.steps = next(n for n in STEPS if self.error(self.end(n)) < WITHIN)

    def end(self, steps: int) -> Array:
        """The angles at the end of a run in so many steps (rad)."""
        h = self.problem.duration / steps
        return compiled_steps.end(self.stepper, self.start, h, steps)[self.angles]

    def simulate(self) -> dc.Trajectory:
        """What a user calls for that end: the same steps, checks and records about them."""
        duration, steps = self.problem.duration, self.steps
        return dc.simulate(
            *(self.problem.mechanism, self.problem.state, duration, duration / steps, SOLVER),
            dc.Record(("wang",), every=steps),
        )

    def error(self, end: Array) -> float:
        """Largest difference from the end of a run in far smaller steps (rad)."""
        return float(np.abs(end - self.exact).max())

    def beside(self, rival: Callable[[], Array], rounds: int, calls: int) -> dict[str, Any]:
        """Our run and the rival's in turn; `calls` of the rival's runs in a measurement."""
        ours = [self.end(self.steps), rival()]
        errors = [self.error(end) for end in ours]
        assert max(errors) < WITHIN, f"errors are {errors} rad, less than {WITHIN:g} expected"
        measured = contest(
            lambda: [self.end(self.steps) for _ in range(CALLS)],
            lambda: [rival() for _ in range(calls)],
            rounds,
        ).summary()
        scale = CALLS / calls
        return {
            "target": TARGET,
            **measured,
            "ours_s": measured["ours_s"] / CALLS,
            "theirs_s": measured["theirs_s"] / calls,
            "ratio": measured["ratio"] * scale,
            "ratio_range": [ratio * scale for ratio in measured["ratio_range"]],
            "steps": self.steps,
            "our_error_rad": errors[0],
            "their_error_rad": errors[1],
        }


def _beside_sundials(squeezer: Squeezer, rounds: int) -> Iterator[dict[str, Any]]:
    problem = squeezer.problem
    free = build_flow(problem.mechanism, ("wang",), rows=squeezer.rows, constraints=None)
    x0 = free.start(problem.state, np.empty(0))
    for rival in casadi_squeezer.rivals(free, x0, problem.duration):
        tolerance, run = next(
            (tolerance, run)
            for tolerance in TOLERANCES
            for run in [_runner(squeezer, rival, tolerance)]
            if squeezer.error(run()) < WITHIN
        )
        yield {
            "name": f"Andrews' squeezer to {WITHIN:g} rad: deltac {SOLVER} / {rival.name}",
            **squeezer.beside(run, rounds, CALLS),
            "needs": f"tolerance {tolerance:g}",
            "tolerance": tolerance,
        }


def _runner(
    squeezer: Squeezer, rival: casadi_squeezer.Sundials, tolerance: float
) -> Callable[[], Array]:
    made = rival.integrator(tolerance)
    return lambda: rival.end(made)[squeezer.angles]


def _beside_exudyn(squeezer: Squeezer, rounds: int) -> dict[str, Any]:
    name = f"Andrews' squeezer to {WITHIN:g} rad: deltac {SOLVER} / Exudyn TrapezoidalIndex2"
    try:
        from peers import exudyn_squeezer
    except ImportError:
        return {"name": name, "skipped": "Exudyn is not installed (the extra 'exudyn' brings it)"}
    rival = exudyn_squeezer.Squeezer(squeezer.problem)
    refined = (squeezer.error(rival.run(COARSE)) / WITHIN) ** (1 / exudyn_squeezer.ORDER)
    steps = math.ceil(MARGIN * COARSE * refined)
    found = squeezer.beside(lambda: rival.run(steps), rounds, 1)
    return {
        "name": name,
        **found,
        "needs": f"{steps} steps of {1e6 * found['theirs_s'] / steps:.0f} µs",
        "their_steps": steps,
    }
