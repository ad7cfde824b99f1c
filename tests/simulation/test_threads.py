"""Threads: every solver family, from several threads at once, gives the bits of runs one after the other.

What `simulate` keeps between calls (traced flows, compiled kernels) is shared by all threads; the numbers of
a run must not be. The oracle is the same run alone in its process; nothing but equality will do.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac import problems
from deltac.simulation.solvers import SOLVERS
from tests.support.slow import repeated

THREADS, MEMBERS = 4, 6
Run = Callable[[int], tuple[np.ndarray, ...]]


def together(run: Run) -> None:
    """Runs in threads are, to the last bit, those that follow each other."""
    with ThreadPoolExecutor(THREADS) as pool:
        found = list(pool.map(run, range(MEMBERS)))
    for k in range(MEMBERS):
        for one, other in zip(found[k], run(k), strict=True):
            np.testing.assert_array_equal(one, other)


def started(problem: problems.Problem, k: int) -> dc.State:
    """A start of its own for each member: the problem's, its motion faster by k parts in ten."""
    state = problem.state
    return problem.mechanism.state(state.q, (1.0 + 0.1 * k) * state.u, state.t)


def columns(run: dc.Trajectory) -> tuple[np.ndarray, ...]:
    return (run.t, run.q, run.u, run.udot, *run.integrals.values(), *run.forces.values())  # type: ignore[arg-type]


ONE_OF_A_FAMILY = (
    "ode4",
    "generalized-alpha",
    "discrete-gradient",
    "DOP853",
    "Radau",
    "IDAS",
    "taylor",
)


@pytest.mark.long
@pytest.mark.parametrize(
    "case",
    repeated(
        [(n, s) for n in ("double-pendulum", "n-four-bar") for s in SOLVERS if s != "taylor-quad"],
        *[("double-pendulum", s) for s in ONE_OF_A_FAMILY],
        *[("n-four-bar", s) for s in ("ode4", "generalized-alpha", "IDAS")],
    ),
)
def test_a_solver_in_threads(case: tuple[str, str]) -> None:
    name, solver = case
    if name == "n-four-bar" and solver == "taylor":
        pytest.skip(
            "Taylor's method is compared on the double pendulum; the loop takes long to compile"
        )
    problem, kind = problems.load(name), SOLVERS[solver]
    options: dict[str, Any] = {}
    chosen = dc.solvers.by_name(solver, None if kind.takes_steps else 1e-7)
    if name == "n-four-bar" and solver in ("BDF", "LSODA"):
        options["constraints"] = dc.Baumgarte(5.0, 5.0)

    def run(k: int) -> tuple[np.ndarray, ...]:
        state = started(problem, k)
        return columns(dc.simulate(problem.mechanism, state, 0.5, 0.01, chosen, **options))

    together(run)


@pytest.mark.parametrize("solver", ["ode4", "DOP853"])
def test_events_in_threads(solver: str) -> None:
    problem = problems.load("bouncing-ball")

    def run(k: int) -> tuple[np.ndarray, ...]:
        mechanism = problem.mechanism
        state = mechanism.state(problem.state.q * (1.0 + 0.1 * k), problem.state.u)
        motion = dc.simulate(mechanism, state, 0.9, 0.01, solver)
        return (*columns(motion), *(event.u_after for event in motion.events))

    together(run)


def test_ensembles_in_threads() -> None:
    problem = problems.load("n-four-bar")

    def run(k: int) -> tuple[np.ndarray, ...]:
        states = [started(problem, k + i) for i in range(3)]
        found = dc.simulate_ensemble(problem.mechanism, states, 0.5, 0.01, "ode4", threads=2)
        return (found.q, found.u, *found.delta_c.values())

    together(run)


def test_controllers_and_equations_called_from_python_in_threads() -> None:
    mechanism = dc.Mechanism(
        [dc.point_mass("bob", 1.0, [1.0, 0, 0])],
        [dc.revolute("hinge", "ground", "bob", "z")],
        [dc.forces.joint_torque("motor", "hinge")],
        gravity=[9.81, 0, 0],
    )

    def run(k: int) -> tuple[np.ndarray, ...]:
        controller = dc.Controller(lambda t, q, u: {"motor": -(k + 1) * u[0]}, hold=k % 2 == 0)
        state = mechanism.state({"hinge": 1.0 + 0.1 * k})
        motions = [dc.simulate(mechanism, state, 0.3, 0.01, "ode4", controller=controller)]
        if controller.hold:
            method = "implicit-midpoint"
            motions.append(dc.simulate(mechanism, state, 0.3, 0.01, method, controller=controller))
        return tuple(column for motion in motions for column in columns(motion))

    together(run)
