"""What deltac adds to the compiled code it stands on: whole runs beside the bare calls inside them.

The bare side has no trajectory to fill, no checks, no report: the compiled loop of steps, and heyoka's own
Taylor integrator, made before the clock starts. What CasADi's evaluator, which takes
LLVM's place where that has no wheels, does with the same steps stands beside.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import casadi as ca
import compiled_steps
import numpy as np
from measure import contest
from numpy.typing import NDArray

import deltac as dc
from deltac.kernels import evaluator_name, to_heyoka
from deltac.simulation.constraints.feasibility import constraint_start
from deltac.simulation.flow import build_flow
from deltac.simulation.solvers import find_solver
from deltac.simulation.stepping.explicit import FixedMethod

Array = NDArray[np.float64]
DURATION, STEP = 10.0, 1e-4
TIED_STEPS, TIED_RUNS = 500, 20
TESTING = ("wang", "liu-huston")
EVERY = 0.01
"""Seconds between the rows of the Taylor method's runs: what is in between is its own affair."""


@dataclass(frozen=True)
class Pair:
    """A whole run of deltac's, the bare calls beside it, and how many steps or rows each makes."""

    name: str
    whole: Callable[[], Any]
    bare: Callable[[], Any]
    count: int
    unit: str


def run(rounds: int) -> list[dict[str, Any]]:
    """Both sides in turn; {"skipped": why} without heyoka."""
    if evaluator_name() != "llvm":
        return [{"name": "what deltac adds to heyoka", "skipped": "llvm is not the evaluator"}]
    problem = dc.problems.load("triple-pendulum")
    tied = dc.problems.load("andrews-squeezer")
    pairs = (_steps(problem), _constrained(tied, 1), _constrained(tied, TIED_STEPS))
    return [_measured(pair, rounds) for pair in (*pairs, _taylor(problem), _interpreted(problem))]


def table(found: list[dict[str, Any]]) -> str:
    """A line each."""
    lines = [
        "\nwhat a run takes beside the compiled code alone (triple pendulum where nothing is said)"
    ]
    for one in found:
        if "skipped" in one:
            lines.append(f"  {one['name']}: skipped: {one['skipped']}")
            continue
        low, high = one["ratio_range"]
        lines.append(
            f"  {one['name']}: {one['whole_us']:.2f} µs and {one['bare_us']:.2f} µs {one['unit']}, "
            f"{one['ratio']:.2f} ({low:.2f} to {high:.2f})"
        )
    return "\n".join(lines)


def _measured(pair: Pair, rounds: int) -> dict[str, Any]:
    found = contest(pair.bare, pair.whole, rounds).summary()
    return {
        "name": pair.name,
        "unit": pair.unit,
        "whole_us": 1e6 * found["theirs_s"] / pair.count,
        "bare_us": 1e6 * found["ours_s"] / pair.count,
        "ratio": found["ratio"],
        "ratio_range": found["ratio_range"],
        "rounds": found["rounds"],
    }


def _steps(problem: dc.problems.Problem) -> Pair:
    """simulate, and the very loop it calls, a thousand steps over and over."""
    steps, at_once = round(DURATION / STEP), 1000
    method = _stepper(problem)
    loop, start = method.loop, _start(problem, method)
    assert loop is not None
    constants = np.array([0.0, STEP])

    def bare() -> None:
        for _ in range(steps // at_once):
            loop.run(0, start, constants, at_once)

    return Pair(
        "ode5 with testing functions / the compiled loop",
        lambda: dc.simulate(problem.mechanism, problem.state, DURATION, STEP, "ode5", TESTING),
        bare,
        steps,
        "per step",
    )


def _constrained(problem: dc.problems.Problem, every: int) -> Pair:
    """simulate of a mechanism with constraints, from a start that it knows, and its compiled steps."""
    step = problem.duration / TIED_STEPS
    rows = constraint_start(problem.mechanism, problem.state, find_solver("ode5"), "projection")
    flow = build_flow(problem.mechanism, ("wang",), rows=rows)
    method = FixedMethod(flow, find_solver("ode5"))
    start, record = _start(problem, method), dc.Record(("wang",), every=every)

    def whole() -> None:
        for _ in range(TIED_RUNS):
            dc.simulate(problem, step=step, solver="ode5", record=record)

    def bare() -> None:
        for _ in range(TIED_RUNS):
            compiled_steps.end(method, start, step, TIED_STEPS)

    kept = "each step recorded" if every == 1 else "the end recorded"
    return Pair(
        f"squeezer, a later simulate of {TIED_STEPS} steps, {kept} / its compiled steps",
        whole,
        bare,
        TIED_STEPS * TIED_RUNS,
        "per step",
    )


def _taylor(problem: dc.problems.Problem) -> Pair:
    """simulate with the Taylor method, and heyoka's integrator of the same equations."""
    import heyoka as hy

    flow = build_flow(problem.mechanism)
    x = [hy.expression(f"x{k}") for k in range(flow.x.shape[0])]
    rate = ca.Function("xdot", [flow.t, flow.x], [ca.cse(ca.densify(flow.xdot))])
    (rates,) = to_heyoka(rate, [[hy.time], x])
    start = flow.start(problem.state, np.empty(0))
    method = hy.taylor_adaptive(list(zip(x, rates)), start, compact_mode=True)
    times = np.arange(0.0, DURATION + EVERY / 2, EVERY)

    def whole() -> dc.Trajectory:
        return dc.simulate(problem.mechanism, problem.state, DURATION, EVERY, "taylor", record=())

    def bare() -> Array:
        method.time, method.state[:] = 0.0, start
        return np.asarray(method.propagate_grid(times)[-1])

    off = float(np.abs(bare()[-1, :3] - whole().q[-1]).max())
    assert off < 1e-10, f"deltac's Taylor run and heyoka's own end {off:.1e} rad apart"
    return Pair("taylor / heyoka's taylor_adaptive", whole, bare, len(times) - 1, "per row")


def _interpreted(problem: dc.problems.Problem) -> Pair:
    """The same steps on CasADi's evaluator."""
    steps = round(DURATION / STEP) // 10
    fast = _stepper(problem)
    start = _start(problem, fast)
    with _evaluator("casadi"):
        slow = _stepper(problem)
        compiled_steps.end(slow, start, STEP, 1)
    ends = [compiled_steps.end(method, start, STEP, steps) for method in (fast, slow)]
    off = float(np.abs(ends[0] - ends[1]).max())
    assert off < 1e-10, f"the two evaluators end {off:.1e} apart"
    return Pair(
        "ode5 with testing functions on CasADi's evaluator / as machine code by LLVM",
        lambda: compiled_steps.end(slow, start, STEP, steps),
        lambda: compiled_steps.end(fast, start, STEP, steps),
        steps,
        "per step",
    )


def _stepper(problem: dc.problems.Problem) -> FixedMethod:
    flow = build_flow(problem.mechanism, TESTING)
    return FixedMethod(flow, find_solver("ode5"))


def _start(problem: dc.problems.Problem, stepper: FixedMethod) -> Array:
    return stepper.flow.start(problem.state, np.empty(0))


@contextmanager
def _evaluator(name: str) -> Iterator[None]:
    """What is compiled meanwhile is compiled by that evaluator."""
    before = os.environ.get("DELTAC_EVALUATOR")
    os.environ["DELTAC_EVALUATOR"] = name
    try:
        yield
    finally:
        del os.environ["DELTAC_EVALUATOR"]
        if before is not None:
            os.environ["DELTAC_EVALUATOR"] = before
