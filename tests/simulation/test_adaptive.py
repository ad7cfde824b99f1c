"""Steps chosen by the local error and by ΔC: against exact motions, and what the tolerance promises."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import deltac as dc

PENDULUM = dc.problems.load("triple-pendulum")


POINT = dc.Mechanism(
    [dc.bodies.point_mass("bob", 1.0, (1.0, 0.0, 0.0))],
    [dc.revolute("hinge", "ground", "bob")],
    gravity=(0.0, -9.81, 0.0),
)
SWUNG = POINT.state([0.3], [1.0])


def _rhs(t: Any, q: Any, u: Any) -> Any:
    return np.array([-9.81 * np.cos(q[0])])


def _taking_part(ledger: dc.Ledger) -> float:
    return float(ledger.kinetic.max() + np.ptp(ledger.potential_energy))


@pytest.mark.parametrize("method", ["ode3", "ode5", "ode8"])
def test_the_tolerance_bounds_delta_c(method: str) -> None:
    reference = dc.simulate(PENDULUM, None, 1.0, 0.05, dc.solvers.Taylor())
    errors = []
    for tolerance in (1e-5, 1e-7):
        solver = dc.solvers.Adaptive(method, tolerance)
        run = dc.simulate(PENDULUM, None, 1.0, 0.05, solver)
        ledger = dc.balance(PENDULUM, run)
        bound = tolerance * _taking_part(ledger)
        assert max(np.abs(c[-1]) for c in ledger.delta_c.values()) < bound
        errors.append(np.abs(run.q - reference.q).max())
        assert run.provenance.tolerance == tolerance
        assert errors[-1] < 10.0 * tolerance
    # Errors follow the tolerance: two decades, or more where few steps are taken.
    assert errors[0] / errors[1] > 20.0


def test_steps_follow_the_motion() -> None:
    """A chain that falls and whips: short steps where the whip is, and few altogether."""
    run = dc.simulate(PENDULUM, None, 2.0, None, dc.solvers.Adaptive("ode5", 1e-7))
    steps = np.diff(run.t)[1:-1]
    assert steps.max() > 8 * steps.min()
    assert run.t[-1] == 2.0
    fixed = dc.simulate(PENDULUM, None, 2.0, 2.0 / len(steps), "ode5")
    exact = dc.simulate(PENDULUM, None, 2.0, 2.0, dc.solvers.Taylor()).q[-1]
    assert np.abs(run.q[-1] - exact).max() < 0.5 * np.abs(fixed.q[-1] - exact).max()


def test_delta_c_shortens_steps_that_the_state_would_allow() -> None:
    """A load told by a law that hardly moves a heavy body: its work is what ΔC sees."""
    heavy = dc.Mechanism(
        [dc.bodies.box("block", 1e3, [1, 1, 1])],
        [dc.prismatic("slide", "ground", "block", "x")],
        [dc.forces.joint_torque("push", "slide", torque="1e3*cos(200*t)")],
    )
    start = heavy.state({}, {"slide": 1.0})
    counts = {}
    for record in ((), ("wang", "liu-huston")):
        run = dc.simulate(heavy, start, 1.0, None, dc.solvers.Adaptive("ode5", 1e-4), record=record)
        counts[bool(record)] = len(run)
    assert counts[True] > 1.3 * counts[False]


@pytest.mark.parametrize("name", ["andrews-squeezer", "bouncing-ball"])
def test_constraints_and_events(name: str) -> None:
    problem = dc.problems.load(name)
    T = 0.01 if name == "andrews-squeezer" else 1.0
    run = dc.simulate(problem, None, T, T / 10, dc.solvers.Adaptive("ode5", 1e-10))
    exact = dc.simulate(problem, None, T, T / 10, dc.solvers.Taylor())
    assert np.abs(run.q - exact.q).max() < 1e-8
    assert len(run.events) == len(exact.events)


def test_equations_called_from_python() -> None:
    found = [
        dc.simulate(POINT, SWUNG, 0.5, 0.1, dc.solvers.Adaptive("ode5", 1e-7), equations=equations)
        for equations in (dc.Equations(_rhs, compiled=False), dc.Equations(_rhs), None)
    ]
    np.testing.assert_allclose(found[0].q, found[1].q, atol=1e-13)
    np.testing.assert_allclose(found[0].q, found[2].q, atol=1e-7)


def test_wrong_equations_are_no_matter_of_the_step() -> None:
    """ΔC does not fall with the step: the run ends in words, and not in ever shorter steps."""
    wrong = dc.Equations(lambda t, q, u: 1.01 * np.array(_rhs(t, q, u)))
    with pytest.warns(dc.SimulationStoppedWarning, match="however short the step"):
        dc.simulate(POINT, SWUNG, 0.5, 0.1, dc.solvers.Adaptive("ode5", 1e-7), equations=wrong)


def test_a_study_over_tolerances() -> None:
    study = dc.study(PENDULUM, duration=0.5, solver=dc.solvers.Adaptive(tolerance=1e-9))
    assert study.verdict.kind == "consistent"


def test_a_law_that_jumps_ends_in_words() -> None:
    jump = dc.Mechanism(
        [dc.point_mass("m", 1.0)],
        [dc.prismatic("x", "ground", "m", "x")],
        [dc.forces.joint_torque("push", "x", torque="where(t < 0.3, 1, log(0.3 - t))")],
    )
    with pytest.warns(dc.SimulationStoppedWarning, match="too small"):
        run = dc.simulate(jump, jump.state(), 1.0, 0.1, dc.solvers.Adaptive("ode5", 1e-9))
    assert run.t[-1] <= 0.3 + 1e-6


@pytest.mark.parametrize(("method", "tolerance"), [("ode4", 1e-6), ("ode5", -1.0), ("ode5", "x")])
def test_options_that_cannot_be(method: str, tolerance: float) -> None:
    with pytest.raises(dc.InputError) as caught:
        dc.solvers.Adaptive(method, tolerance)
    assert caught.value.code == "E-SOLVER"
