"""The rivals run the same motion, and are of the order that the benchmarks' tables state."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.simulation.constraints.feasibility import constraint_start
from deltac.simulation.flow import build_flow
from deltac.simulation.solvers import find_solver
from tests.support.slow import repeated

pytestmark = pytest.mark.case_study("test_rival_converges_at_its_order")

peers: ModuleType = pytest.importorskip(
    "peers", reason="the benchmarks are not part of an installed package"
)

DURATION, COARSE, TINY = 0.5, 0.001, 1e-4


@pytest.fixture(scope="module")
def exact() -> np.ndarray:
    """Angles of the pendulum after every coarse step: rounding is all that is left of their error."""
    problem = dc.problems.load("triple-pendulum")
    run = dc.simulate(problem.mechanism, problem.state, DURATION, TINY, "ode8", ())
    return run.q[:: round(COARSE / TINY)][1:]


def _rivals(adapter: str, step: float) -> list[Any]:
    pendulum = peers.Pendulum(dc.problems.load("triple-pendulum"), DURATION, step)
    found = peers.pendulum_rivals(adapter, pendulum)
    if isinstance(found[0], peers.Absent):
        pytest.skip(found[0].why)
    return list(found)


@pytest.mark.parametrize(
    "adapter", repeated(peers.PENDULUMS, *(p for p in peers.PENDULUMS if p != "pydy_pendulum"))
)
def test_rival_converges_at_its_order(adapter: str, exact: np.ndarray) -> None:
    """Halving the step divides the error by 2^p, from a step that leaves it far above rounding."""
    for coarse, fine in zip(_rivals(adapter, COARSE), _rivals(adapter, COARSE / 2), strict=True):
        errors = []
        for rival in (coarse, fine):
            angles = rival.run()
            assert angles.shape == (rival.steps, 3), rival.name
            each = len(angles) // len(exact)
            errors.append(np.abs(angles[each - 1 :: each] - exact).max())
        observed = np.log2(errors[0] / errors[1])
        assert errors[0] < 1e-3, f"{rival.name}: another motion"
        assert abs(observed - rival.order) < 0.3, f"{rival.name}: order {observed:.2f}, {errors}"


@pytest.mark.parametrize("adapter", peers.PENDULUMS)
def test_rival_can_be_run_again(adapter: str) -> None:
    """A second run starts where the first one did, not where it ended."""
    for rival in _rivals(adapter, COARSE):
        np.testing.assert_array_equal(rival.run().copy(), rival.run(), err_msg=rival.name)


def test_missing_program_is_said_to_be(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> ModuleType:
        raise ImportError("No module named 'pydrake'")

    monkeypatch.setattr(peers, "import_module", missing)
    (absent,) = peers.pendulum_rivals("drake_pendulum", None)
    assert isinstance(absent, peers.Absent)
    assert absent.name == "drake"
    assert "pydrake" in absent.why and "'bench'" in absent.why


def test_loop_in_python_is_the_classical_method() -> None:
    """ẋ = x: a step multiplies x by the exponential series up to h⁴."""
    loop = import_module("peers.python_loop")
    h = 0.3
    factor = 1 + h + h**2 / 2 + h**3 / 6 + h**4 / 24
    kept = loop.runge_kutta4(lambda x: x, np.array([1.0, -2.0]), h, 3)
    np.testing.assert_allclose(kept, np.outer(factor ** np.arange(1, 4), [1.0, -2.0]), rtol=1e-14)


@pytest.fixture(scope="module")
def squeezer() -> tuple[dc.problems.Problem, np.ndarray]:
    """The problem and its published angles at the end, in the order of the mechanism's joints."""
    problem = dc.problems.load("andrews-squeezer")
    published = {r.quantity: r.value for r in problem.reference if r.kind == "published"}
    # beta, Theta, gamma, delta, Phi, epsilon, Omega
    return problem, np.array([published[f"{letter} (test set) at 0.03 s"] for letter in "βΘγδΦεΩ"])


def test_sundials_reaches_the_published_end_of_the_squeezer(squeezer: Any) -> None:
    """At a tolerance of 1e-8 its error is some 1e-6 rad; interpreted or compiled, it is the same motion."""
    problem, end = squeezer
    adapter = import_module("peers.casadi_squeezer")
    solver = find_solver("ode5")
    rows = constraint_start(problem.mechanism, problem.state, solver, "projection")
    flow = build_flow(problem.mechanism, ("wang",), rows=rows, constraints=None)
    start = flow.start(problem.state, np.empty(0))
    found = list(adapter.rivals(flow, start, problem.duration))
    assert {rival.method for rival in found} == set(adapter.METHODS)
    for rival in found:
        error = np.abs(rival.end(rival.integrator(1e-8))[flow.parts[0]] - end).max()
        assert error < 1e-5, rival.name


def test_exudyn_squeezer_converges_to_the_published_end(squeezer: Any) -> None:
    """The trapezoidal rule, from 3000 to 6000 steps, against the numbers of the problem's source."""
    pytest.importorskip("exudyn", reason="Exudyn (deltac[exudyn]) is not installed")
    adapter = import_module("peers.exudyn_squeezer")
    problem, end = squeezer
    machine = adapter.Squeezer(problem)
    errors = [np.abs(machine.run(steps) - end).max() for steps in (3000, 6000)]
    assert errors[0] < 1e-4
    assert np.log2(errors[0] / errors[1]) == pytest.approx(adapter.ORDER, abs=0.1)


def test_table_says_where_deltac_loses_and_what_is_missing() -> None:
    table = import_module("single_run").table
    row = {
        "rival": "slow",
        "order": 4,
        "evaluations": 4,
        "our_us_per_step": 1.0,
        "their_us_per_step": 2.0,
        "their_error_rad": 1e-10,
        "ratio": 2.0,
        "ratio_range": [1.9, 2.1],
        "note": "",
    }
    lost = {**row, "rival": "quick", "ratio": 0.5}
    missing = {"rival": "absent", "skipped": "not installed"}
    lines = table([row, lost, missing]).splitlines()
    said = {line.split()[0]: line for line in lines if line.strip()}
    assert "LOST" in said["quick"] and "LOST" not in said["slow"]
    assert "not installed" in said["absent"]
