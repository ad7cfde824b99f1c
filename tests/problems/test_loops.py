"""Closed loops: the communities' thresholds, the order of ΔC, singular passages."""

from __future__ import annotations

import math

import numpy as np
import pytest

from deltac import balance, problems, simulate
from deltac.problems import bicycle
from tests.oracles import loops, rolling
from tests.support.slow import repeated

ORDER = {"ode3": 3, "ode4": 4}
STEPS = {"andrews-squeezer": 5e-5, "bricard": 0.02, "n-four-bar": 0.01}


@pytest.mark.long
@pytest.mark.parametrize("solver", repeated(ORDER, "ode4"))
@pytest.mark.parametrize("name", repeated(STEPS, "andrews-squeezer", "n-four-bar"))
def test_delta_c_falls_with_the_order_of_the_solver(name: str, solver: str) -> None:
    """Between p and p + 1 where the leading error cancels along the way; measured over two halvings."""
    problem = problems.load(name)
    largest: dict[str, list[float]] = {}
    for k in (1, 2, 4):
        run = simulate(problem.mechanism, problem.state, problem.duration, STEPS[name] / k, solver)
        for function, values in balance(problem.mechanism, run, "in-loop").delta_c.items():
            largest.setdefault(function, []).append(float(np.abs(values).max()))
    p = ORDER[solver]
    for function, (coarse, _, fine) in largest.items():
        slope = 0.5 * math.log2(coarse / fine)
        assert p - 0.15 <= slope <= p + 1, f"{function}: {slope:.2f}"


def test_four_bars_meet_the_benchmarks_thresholds() -> None:
    problem = problems.load("n-four-bar")
    run = simulate(problem.mechanism, problem.state, 10.0, 1e-3, "ode4")
    exact = loops.n_four_bar()
    angle = run.coordinate("crank0")[-1]
    assert abs(math.cos(angle) - exact["tip x at 10 s"]) < 1e-5
    assert abs(math.sin(angle) - exact["tip y at 10 s"]) < 1e-5
    ledger = balance(problem.mechanism, run)
    energy = ledger.kinetic + ledger.potential_energy
    assert np.abs(energy - energy[0]).max() < 1e-3
    # The singular positions are passed as parallelograms: the cranks stay parallel.
    assert np.abs(run.coordinate("crank2") - run.coordinate("crank0")).max() < 1e-6


@pytest.mark.slow
def test_forty_four_bars_run() -> None:
    problem = problems.load("n-four-bar", n=40)
    run = simulate(problem.mechanism, problem.state, 10.0, 1e-3, "ode4", record=10)
    assert run.provenance.completed
    exact = loops.n_four_bar(40)
    angle = run.coordinate("crank0")[-1]
    assert abs(math.cos(angle) - exact["tip x at 10 s"]) < 1e-5
    assert abs(math.sin(angle) - exact["tip y at 10 s"]) < 1e-5
    energy = problem.invariants["energy"](run)
    assert np.abs(energy - energy[0]).max() < 1e-3


def test_bricard_meets_the_benchmarks_thresholds() -> None:
    problem = problems.load("bricard")
    run = simulate(problem.mechanism, problem.state, 10.0, problem.step, problem.solver)
    energy = problem.invariants["energy"](run)
    assert np.abs(energy - energy[0]).max() < 1e-6
    for reference in problem.reference:
        if "vertex" in reference.quantity:
            assert abs(reference.measure(run) - reference.value) < 1e-5, reference.quantity


def test_the_squeezers_energy_balance() -> None:
    problem = problems.load("andrews-squeezer")
    run = simulate(problem.mechanism, problem.state, 0.03, problem.step, problem.solver)
    (balanced,) = (signal(run) for signal in problem.invariants.values())
    assert abs(balanced[-1] - balanced[0]) < 1e-7
    crank = run.coordinate("beta")
    assert crank[-1] - crank[0] > 4 * math.pi  # the motor has turned it, and worked


def test_the_bicycles_published_matrices_follow_from_its_parameters() -> None:
    published = (bicycle.MASS, bicycle.DAMPING, bicycle.STIFFNESS, bicycle.GYRO)
    for ours, theirs in zip(rolling.bicycle_matrices(), published, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-13)
