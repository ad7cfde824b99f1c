"""Fixed steps: fused calls, recording, runs that break down, unit quaternions, parameters kept."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.calls.caching import LRUCache
from deltac.kernels import evaluators
from deltac.kernels import kernel as kernels
from deltac.simulation.flow import build_flow
from deltac.simulation.simulate import SimulationStoppedWarning
from deltac.simulation.solvers import find_solver
from deltac.simulation.stepping import explicit
from deltac.simulation.stepping.interpreted import Finish, StageRate
from deltac.simulation.stepping.protocol import StepGrid
from tests.systems.machines import pendulum, robot, workshop


def same(one: dc.Trajectory, other: dc.Trajectory) -> None:
    """Bit for bit."""
    for name in ("t", "q", "u", "udot"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    for name, values in one.integrals.items():
        np.testing.assert_array_equal(values, other.integrals[name])


# --- many steps in a call ---------------------------------------------------------------------------


@pytest.mark.parametrize("solver", ["ode4", "ode8"])
def test_a_loop_over_stages_equals_steps_from_python(
    solver: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All stages run the same machine code; coefficients tell them apart."""
    mechanism, state = robot()
    flow = build_flow(mechanism, ("wang",))
    assert flow.quaternions
    x, p, grid = flow.start(state, np.empty(0)), np.empty(0), StepGrid(0.5, 0.01, 20, 0.7)
    monkeypatch.setattr(explicit, "FUSED_INSTRUCTIONS", 0)
    method = explicit.FixedMethod(flow, find_solver(solver))
    steps = explicit.FixedSteps(method, StageRate(flow, None, p), p, compiled=True)
    block = steps.ahead(grid, 3, x, 100)
    assert block is not None and len(block.states) == 17
    finish = Finish(flow, p)
    for k, after in enumerate(block.states, 3):
        t, until = grid.time(k), grid.time(k + 1)
        x, _ = finish(until, steps.attempt(t, x, until).x1, until - t)
        np.testing.assert_allclose(after, x, rtol=0, atol=1e-13)


def test_blocks_of_rows_leave_no_trace(monkeypatch: pytest.MonkeyPatch) -> None:
    mechanism = pendulum(damping=0.1)
    start = mechanism.state({"hinge": 1.0})
    whole = dc.simulate(mechanism, start, 1.0, 0.01)
    monkeypatch.setattr(explicit, "BLOCK_BYTES", 500)
    same(dc.simulate(mechanism, start, 1.0, 0.01), whole)
    same(dc.simulate(mechanism, start, 1.0, 0.01, record=5), whole.every(5))


def test_compiled_steps_equal_steps_from_python(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same solver, once in machine code and once stage by stage."""
    mechanism, state = robot()
    compiled = dc.simulate(mechanism, state, 0.2, 0.01)
    monkeypatch.setattr(explicit.FixedMethod, "loop", None)
    staged = dc.simulate(mechanism, state, 0.2, 0.01)
    np.testing.assert_allclose(staged.q, compiled.q, rtol=0, atol=1e-13)
    np.testing.assert_allclose(staged.u, compiled.u, rtol=0, atol=1e-13)
    for name, integral in compiled.integrals.items():
        np.testing.assert_allclose(staged.integrals[name], integral, rtol=0, atol=1e-12)


# --- recording -------------------------------------------------------------------------------------


def test_record_every_keeps_the_rows_it_says() -> None:
    mechanism = pendulum()
    start = mechanism.state({"hinge": 1.0}, t=2.0)
    whole = dc.simulate(mechanism, start, 1.2, 0.01)
    some = dc.simulate(mechanism, start, 1.2, 0.01, record=8)
    assert len(some) == 16 and some.t[0] == 2.0
    assert some.t[-1] == pytest.approx(3.2, rel=1e-15)
    same(some, whole.every(8))
    assert some.provenance.step == 0.01


def test_progress_rises_to_one() -> None:
    mechanism = pendulum()
    told: list[float] = []
    dc.simulate(mechanism, mechanism.state(), 1.0, 1e-4, progress=told.append)
    assert told == sorted(told) and told[-1] == 1.0


# --- breakdown -------------------------------------------------------------------------------------


def explosive() -> tuple[dc.Mechanism, dc.State]:
    """u̇ = 1 + u³ in effect: a motor that pushes the harder the faster it turns."""
    mechanism = dc.Mechanism(
        [dc.body("rotor", 1, [1, 1, 1])],
        [dc.revolute("shaft", "ground", "rotor")],
        [dc.forces.joint_torque("motor", "shaft", "1 + u.shaft**3")],
    )
    return mechanism, mechanism.state(speeds={"shaft": 1.0})


@pytest.mark.parametrize("every", [1, 4, 64])
@pytest.mark.parametrize("block", [2**22, 400])
def test_a_run_that_breaks_down_keeps_what_it_has(
    every: int, block: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(explicit, "BLOCK_BYTES", block)
    mechanism, state = explosive()
    with pytest.warns(SimulationStoppedWarning, match="not finite at t = ") as caught:
        run = dc.simulate(mechanism, state, 1.28, 0.01, "ode1", record=every)
    assert not run.provenance.completed
    assert run.provenance.message == str(caught[0].message)
    u, k = 1.0, 0  # Euler by hand
    with np.errstate(over="ignore"):
        while True:
            after = u + 0.01 * (1 + np.float64(u) ** 3)
            if not np.isfinite(after):
                break
            u, k = after, k + 1
    assert f"last finite at t = {k * 0.01:.9g} s" in run.provenance.message
    # The state at step k is finite, but its acceleration need not be: then one row less is kept.
    # At step k the state is finite and its acceleration is not: the sample before it is the last.
    assert round(run.t[-1] / 0.01) == (k - 1) // every * every
    assert np.isfinite(run.u).all() and np.isfinite(run.udot).all()  # type: ignore[arg-type]


@pytest.mark.parametrize("solver", ["RK23", "RK45", "DOP853", "Radau", "BDF", "LSODA"])
def test_adaptive_solvers_stop_at_a_pole(solver: str) -> None:
    """u̇ = 1 + u³ from u = 1 reaches infinity in finite time: ∫ du/(1 + u³) = 0.37355 s."""
    from scipy.integrate import quad

    mechanism, state = explosive()
    pole = quad(lambda u: 1 / (1 + u**3), 1, np.inf)[0]
    with pytest.warns(SimulationStoppedWarning, match="stopped at t = "):
        run = dc.simulate(mechanism, state, 1.0, None, dc.solvers.by_name(solver, 1e-6), ())
    assert not run.provenance.completed
    assert run.t[-1] == pytest.approx(pole, rel=1e-3)


def test_a_run_that_breaks_down_in_python_says_so_too() -> None:
    mechanism, state = explosive()

    def cubic(t: float, q: Any, u: Any) -> Any:
        with np.errstate(over="ignore"):
            return 1 + u * u * u

    with pytest.warns(SimulationStoppedWarning):
        slow = dc.simulate(
            mechanism,
            state,
            1.28,
            0.01,
            "ode1",
            equations=dc.Equations(cubic, compiled=False),
            record=4,
        )
    with pytest.warns(SimulationStoppedWarning):
        fast = dc.simulate(mechanism, state, 1.28, 0.01, "ode1", record=4)
    np.testing.assert_allclose(slow.t, fast.t, rtol=1e-15)
    assert slow.provenance.message == fast.provenance.message


# --- quaternions -----------------------------------------------------------------------------------


@pytest.mark.parametrize("solver", ["ode1", "ode4", "DOP853"])
def test_quaternions_stay_unit(solver: str) -> None:
    box = dc.body("box", 1, [1, 2, 3])
    mechanism = dc.Mechanism([box], [dc.free("base", "box")])
    start = mechanism.state(speeds={"base": [0.1, 0, 0, 0.1, 3, 0.1]})
    run = dc.simulate(mechanism, start, 40.0, 0.01, solver, ())
    np.testing.assert_allclose(np.linalg.norm(run.q[:, 3:], axis=1), 1.0, rtol=4e-16)


# --- compiled once ---------------------------------------------------------------------------------


@pytest.fixture
def compilations(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The kernels compiled during a test, by the number of their instructions."""
    done: list[str] = []
    compile_function = evaluators.compile_function

    def counting(function: Any, batches: bool = True) -> Any:
        done.append(str(function.n_instructions()))
        return compile_function(function, batches)

    monkeypatch.setattr(kernels, "compile_function", counting)
    return done


def test_vary_needs_no_new_compilation_and_gives_the_same_numbers(compilations: list[str]) -> None:
    mechanism = pendulum(damping="0.05*m")
    varying = mechanism.varying("m", "l", "g")
    first = dc.simulate(varying, mechanism.state({"hinge": 1.0}), 1.0, 0.01)
    count = len(compilations)
    assert count > 0
    other = mechanism.with_parameters(m=3.0, l=0.8, g=1.62)
    varying = varying.with_parameters(m=3.0, l=0.8, g=1.62)
    assert varying.hash == other.hash, "it is the same mechanism"
    varied = dc.simulate(varying, other.state({"hinge": 1.0}), 1.0, 0.01)
    assert len(compilations) == count
    folded = dc.simulate(other, other.state({"hinge": 1.0}), 1.0, 0.01)
    assert len(compilations) > count
    # Constants folded in change the order of roundings, over 100 steps.
    np.testing.assert_allclose(varied.q, folded.q, atol=1e-13)
    np.testing.assert_allclose(varied.u, folded.u, atol=1e-13)
    np.testing.assert_allclose(varied.udot, folded.udot, atol=1e-12)  # type: ignore[arg-type]
    np.testing.assert_allclose(varied.integrals["wang"], folded.integrals["wang"], atol=1e-13)
    assert np.abs(first.q - varied.q).max() > 0.1


def test_a_parameter_that_varies_may_start_at_zero() -> None:
    """Nothing may be left out of the code because it is zero in the first call."""
    weightless = pendulum().with_parameters(g=0.0)
    start = weightless.state({"hinge": 1.0})
    still = dc.simulate(weightless.varying("g"), start, 0.5, 0.01)
    assert not still.u.any()
    heavy = pendulum()
    varied = dc.simulate(heavy.varying("g"), start, 0.5, 0.01)
    folded = dc.simulate(heavy, start, 0.5, 0.01)
    np.testing.assert_allclose(varied.q, folded.q, atol=1e-13)
    for name, values in folded.integrals.items():
        np.testing.assert_allclose(varied.integrals[name], values, atol=1e-13)


@pytest.mark.parametrize(
    "solver", ["DOP853", "Radau", pytest.param("taylor", marks=pytest.mark.heyoka)]
)
def test_vary_with_the_other_families(solver: str) -> None:
    mechanism = pendulum().with_parameters(l=0.7)
    start = mechanism.state({"hinge": 1.0})
    varied = dc.simulate(mechanism.varying("l", "g"), start, 1.0, 0.1, solver)
    folded = dc.simulate(mechanism, start, 1.0, 0.1, solver)
    np.testing.assert_allclose(varied.q, folded.q, atol=1e-9)
    np.testing.assert_allclose(varied.integrals["wang"], folded.integrals["wang"], atol=1e-9)


def test_a_second_run_compiles_nothing(compilations: list[str]) -> None:
    mechanism, state = workshop()
    dc.simulate(mechanism, state, 0.1, 0.01, "ode1")
    count = len(compilations)
    again, _ = workshop()  # another object of the same description
    dc.simulate(again, state, 0.2, 0.005, "ode1")
    assert len(compilations) == count


def test_what_is_kept_is_bounded(monkeypatch: pytest.MonkeyPatch, compilations: list[str]) -> None:
    """Three flows are kept, and the one that was not asked for longest goes first."""
    module = importlib.import_module("deltac.simulation.simulate")
    monkeypatch.setattr(module, "_RUNS", LRUCache(3))

    def compiled(length: float) -> bool:
        count = len(compilations)
        mechanism = pendulum().with_parameters(l=length)
        dc.simulate(mechanism, mechanism.state(), 0.1, 0.01, "ode1", ())
        return len(compilations) > count

    assert [compiled(l) for l in (0.5, 0.6, 0.7)] == [True] * 3
    assert not compiled(0.5)  # used again, so 0.6 is now the oldest
    assert compiled(0.8)
    assert len(module._RUNS) == 3
    assert not compiled(0.5) and not compiled(0.7)
    assert compiled(0.6)


# --- repeated runs ---------------------------------------------------------------------------------


def test_runs_repeat_bit_for_bit() -> None:
    mechanism, state = workshop()
    same(
        dc.simulate(mechanism, state, 0.1, 0.01, "ode1"),
        dc.simulate(mechanism, state, 0.1, 0.01, "ode1"),
    )
