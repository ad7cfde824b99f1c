"""`study` with our own solvers: orders, verdicts, blame, and what it says of bad input."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac import Mechanism, State, Study, Trajectory
from deltac.errors import InputError
from deltac.simulation.solvers import SOLVERS
from tests.systems.machines import pendulum, robot

FIXED = [s.name for s in SOLVERS.values() if s.family == "fixed"]
COARSEST = {1: 512, 2: 128, 3: 64, 4: 64, 5: 48, 8: 8}
"""Steps of the coarsest of four runs, by order: resolved, and clear of rounding at the finest."""


def kinds(study: Study) -> set[str]:
    return {f.kind for f in study.findings}


def halved(step: float, count: int = 3) -> list[float]:
    return [step / 2**k for k in range(count)]


def arm() -> tuple[Mechanism, State]:
    """Two damped bars under a torque, without any symmetry that could cancel errors."""
    mechanism = dc.Mechanism(
        [dc.rod("upper", 1.2, 0.7), dc.rod("lower", 0.8, 0.5)],
        [
            dc.revolute("shoulder", "ground", "upper", damping=0.2),
            dc.revolute("elbow", "upper", "lower", position=(0.7, 0, 0), damping=0.1),
        ],
        [dc.forces.joint_torque("motor", "shoulder", "0.7*cos(2*t)*sin(q.shoulder)")],
        gravity=[0, -9.81, 0],
    )
    return mechanism, mechanism.state({"shoulder": -0.9, "elbow": 0.4}, {"elbow": 1.5})


# --- orders ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.slow] * (n == "ode8")) for n in FIXED]
)
def test_every_solver_shows_its_order(name: str) -> None:
    """In the state to ± 0.15; of ΔC between p and p + 1 (Kane and Levinson's functions are of order p)."""
    order = SOLVERS[name].order
    assert order is not None
    mechanism, state = (
        arm() if order < 8 else robot()
    )  # whose errors stay above rounding for longer
    found = dc.study(mechanism, state, 1.28, halved(1.28 / COARSEST.get(order, 32), 4), name)
    motion = found.observed_order["state"]
    assert motion.order == pytest.approx(order, abs=0.15), found.verdict.explain()
    for function in ("wang", "liu-huston"):
        energy = found.observed_order[function]
        assert energy.trend == "falls to zero"
        assert energy.order is not None
        assert order - 0.15 <= energy.order <= order + 1.15, (function, energy)
    assert found.verdict.kind in ("consistent", "integration-error")
    assert not kinds(found) & {"order-below-nominal", "horizon"}


@pytest.mark.slow
@pytest.mark.parametrize("name", [s.name for s in SOLVERS.values() if s.family == "implicit"])
def test_implicit_solvers_show_their_order(name: str) -> None:
    """In the state; one that keeps energy by construction has no error of energy to show an order."""
    mechanism, state = arm()
    order = SOLVERS[name].order
    assert order is not None
    found = dc.study(mechanism, state, 1.28, halved(1.28 / COARSEST[order], 4), name)
    assert found.observed_order["state"].order == pytest.approx(order, abs=0.15)
    assert found.verdict.kind in ("consistent", "integration-error")


def test_adaptive_solvers_by_their_tolerances() -> None:
    mechanism = pendulum()
    state = mechanism.state({"hinge": 2.0})
    solvers = [dc.solvers.Scipy("DOP853", tolerance=t) for t in (1e-5, 1e-7, 1e-9)]
    found = dc.study(mechanism, state, 2.0, solver=solvers)
    assert found.verdict.kind == "consistent"
    assert found.observed_order["state"].order == pytest.approx(1.0, abs=0.3)  # by tolerance
    assert "tolerance 1e-09" in found.verdict.meaning


# --- verdicts -------------------------------------------------------------------------------------


def test_the_error_of_the_integrator_in_words() -> None:
    problem = dc.problems.load("triple-pendulum")
    found = dc.study(problem, duration=2.0, steps=(4e-3, 2e-3, 1e-3), tolerance=1e-12)
    assert found.verdict.kind == "integration-error"
    assert found.exit_code == 1
    order = found.observed_order["wang"]
    assert f"falls at order {order.order:.1f}" in found.verdict.meaning
    assert "at h = 0.001 s it is" in found.verdict.meaning
    assert found.verdict.explain().startswith("integration-error (confidence high). The error is")
    within = dc.study(problem, duration=2.0, steps=(4e-3, 2e-3, 1e-3))
    assert (within.verdict.kind, within.exit_code) == ("consistent", 0)


@pytest.mark.parametrize(
    "steps", [(1e-2, 5e-3, 2.5e-3), (1e-3, 5e-4, 2.5e-4), (4e-4, 2e-4, 1e-4), (1e-2,)]
)
def test_the_mistake_of_figure_4_7_is_blamed_on_coordinate_2(steps: tuple[float, ...]) -> None:
    problem = dc.problems.load("triple-pendulum", mistake=True)
    found = dc.study(problem, duration=2.0, steps=steps, equations=problem.equations)
    assert (found.verdict.kind, found.exit_code) == ("equation-error", 1)
    causes = [f for f in found.findings if f.weight == "cause"]
    assert [f.element for f in causes] == ["theta2"], found.verdict.explain()
    assert found.residuals is not None and found.residuals.blamed == (1,)
    if len(steps) > 2:
        assert found.observed_order["wang"].limit > 1.0  # J, as the thesis has it
        assert "does not vanish as the step is refined" in found.verdict.meaning


def test_right_equations_by_hand_are_not_blamed() -> None:
    problem = dc.problems.load("triple-pendulum")
    for solver, steps in (("ode5", (1e-2, 5e-3, 2.5e-3)), ("ode1", (5e-2, 2.5e-2, 1.25e-2))):
        found = dc.study(
            problem, duration=2.0, steps=steps, solver=solver, equations=problem.equations
        )
        assert found.verdict.kind == ("consistent" if solver == "ode5" else "integration-error")
        assert found.residuals is not None and found.residuals.closes


def test_steps_far_too_coarse_are_the_integrators_fault() -> None:
    problem = dc.problems.load("triple-pendulum", rates=(10.0, 0.0, 0.0))
    found = dc.study(problem, duration=10.0, steps=(0.1, 0.05, 0.025), solver="ode2")
    assert found.verdict.kind == "integration-error"
    # The first two steps make more energy than the motion has: they say nothing of an order.
    assert found.observed_order["wang"].trend == "one run"
    assert "blown-up" in kinds(found)


def test_chaos_is_studied_up_to_where_motions_part() -> None:
    """Fig. 4.8 without dampers."""
    problem = dc.problems.load(
        "triple-pendulum",
        weights=(10, 40, 10),
        start=np.radians([30, 60, 15]),
        rates=(10.0, 0.0, 0.0),
    )
    found = dc.study(problem, duration=20.0, steps=(4e-3, 2e-3, 1e-3), solver="ode4")
    assert found.verdict.kind in ("consistent", "integration-error")
    assert "horizon" in kinds(found)
    assert 0.5 < found.horizon < 19.0


def test_a_run_in_which_nothing_moves_is_unresolved() -> None:
    mechanism = pendulum()
    found = dc.study(mechanism, mechanism.state(), 1.0, (0.04, 0.02, 0.01))
    assert (found.verdict.kind, found.exit_code) == ("unresolved", 3)
    assert "hardly anything moves" in found.verdict.meaning


# --- findings -------------------------------------------------------------------------------------


def test_a_force_that_is_not_smooth_lowers_the_order() -> None:
    mechanism = dc.Mechanism(
        [dc.point_mass("block", 1.0)],
        [dc.prismatic("slide", "ground", "block", "x", stiffness=20.0)],
        [dc.forces.joint_torque("rub", "slide", "-0.5*sign(u.slide)")],
        gravity=[0, 0, 0],
    )
    found = dc.study(mechanism, mechanism.state({"slide": 1.0}), 2.0, halved(0.02, 4), "ode5")
    assert found.verdict.kind != "equation-error"
    assert "order-below-nominal" in kinds(found)


def test_a_controller_held_over_the_step_makes_the_motion_first_order() -> None:
    mechanism = dc.Mechanism(
        [dc.rod("arm", 1.0, 1.0)],
        [dc.revolute("hinge", "ground", "arm")],
        [dc.forces.joint_torque("motor", "hinge")],
        gravity=[0, -9.81, 0],
    )
    state = mechanism.state({"hinge": 0.5})
    held, asked = (
        dc.study(
            mechanism,
            state,
            1.0,
            (0.02, 0.01, 0.005),
            "ode4",
            controller=dc.Controller(
                lambda t, q, u: {"motor": np.sin(3 * t) - 0.5 * u[0]}, hold=hold
            ),
        )
        for hold in (True, False)
    )
    assert held.verdict.kind == asked.verdict.kind == "consistent"
    assert held.observed_order["state"].order == pytest.approx(1.0, abs=0.15)
    assert asked.observed_order["state"].order == pytest.approx(4.0, abs=0.15)
    assert "order-below-nominal" in kinds(held) - kinds(asked)


# --- bad input ------------------------------------------------------------------------------------


def simulator(step: float) -> Trajectory:
    mechanism = pendulum()
    return dc.simulate(mechanism, mechanism.state({"hinge": 1.0}), 1.0, step, "ode4")


def studied(function: Any, steps: Any = (0.02, 0.01, 0.005), **options: Any) -> Study:
    return dc.study(pendulum(), runs=function, steps=steps, **options)


def test_a_simulator_of_ones_own() -> None:
    found = studied(simulator, order=4)
    assert found.solver == "simulator"
    assert found.verdict.kind == "consistent"
    assert found.observed_order["state"].order == pytest.approx(4.0, abs=0.15)


def test_a_simulator_that_ignores_its_step() -> None:
    found = studied(lambda step: replace(simulator(0.01)))
    assert (found.verdict.kind, found.exit_code) == ("unresolved", 3)
    assert "step-ignored" in kinds(found)


def test_a_simulator_that_says_it_took_another_step() -> None:
    found = studied(lambda step: simulator(max(step, 0.01)))
    assert "step-differs" in kinds(found)
    assert found.verdict.kind == "unresolved"


def test_a_simulator_that_crashes_at_one_step() -> None:
    def crashing(step: float) -> Trajectory:
        if step == 0.01:
            raise ZeroDivisionError("no luck")
        return simulator(step)

    found = studied(crashing, (0.02, 0.01, 0.005, 0.0025))
    assert found.verdict.kind == "consistent"
    failed = next(f for f in found.findings if f.kind == "run-failed")
    assert "step 0.01" in failed.what and "ZeroDivisionError: no luck" in failed.evidence
    assert found.runs[1].failure and found.rows()[1]["failure"]
    assert found.observed_order["state"].order == pytest.approx(4.0, abs=0.15)


def test_a_simulator_that_always_crashes() -> None:
    def crashing(step: float) -> Trajectory:
        raise RuntimeError("never")

    with pytest.raises(InputError, match="RuntimeError: never"):
        studied(crashing)


def test_a_simulator_that_returns_something_else() -> None:
    with pytest.raises(InputError, match="returned list, expected a Trajectory"):
        studied(lambda step: [1.0])


def test_runs_over_other_times() -> None:
    found = studied(lambda step: simulator(step).between(0.0, 0.8 if step == 0.01 else 1.0))
    assert "other-times" in kinds(found)
    assert found.comparison.t[-1] == pytest.approx(0.8)
    late = studied(lambda step: simulator(step).between(0.2 if step == 0.01 else 0.0, 1.0))
    assert "other-start" in kinds(late)
    assert late.steps == (0.02, 0.005)


def test_steps_without_common_times() -> None:
    found = studied(simulator, (1 / 53, 1 / 101, 1 / 211))
    assert "few-common-times" in kinds(found)
    assert found.verdict.kind == "consistent"
    assert found.observed_order["wang"].order == pytest.approx(4.5, abs=0.7)  # of the maxima


def test_steps_that_do_not_refine() -> None:
    found = studied(simulator, (0.02, 0.02, 0.01, 0.005))
    assert "steps-do-not-refine" in kinds(found)
    assert found.steps == (0.02, 0.01, 0.005)
    for wrong in ((0.01, -1.0), (0.01, float("nan")), ("x",)):
        with pytest.raises(InputError, match="positive, finite"):
            studied(simulator, wrong)


def test_fewer_than_three_steps_say_what_they_can() -> None:
    two = studied(simulator, (0.02, 0.01), tolerance=1e-12)
    assert two.verdict.kind == "integration-error"  # the equations close at the samples, ΔC falls
    assert two.observed_order["wang"].order == pytest.approx(4.5, abs=0.7)
    assert two.observed_order["state"].order is None
    one = studied(simulator, (0.01,))
    assert one.verdict.kind == "consistent"
    hidden = dc.study(
        pendulum(),
        runs=[replace(simulator(0.05), udot=None, works={}, integrals={})],
        tolerance=1e-9,
    )
    assert hidden.verdict.kind == "unresolved"


def test_a_step_that_does_not_divide_is_left_out() -> None:
    mechanism = pendulum()
    found = dc.study(mechanism, mechanism.state({"hinge": 1.0}), 1.0, (0.02, 0.013, 0.01, 0.005))
    assert "run-failed" in kinds(found)
    assert found.steps == (0.02, 0.01, 0.005)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"steps": (0.01,), "solver": "DOP853"}, "leave out steps="),
        (
            {"solver": [dc.solvers.FixedStep("ode4"), dc.solvers.FixedStep("ode5")]},
            "several tolerances",
        ),
        ({"solver": [dc.solvers.Scipy("RK45"), dc.solvers.Scipy("DOP853")]}, "several tolerances"),
        ({"solver": "taylor"}, "several tolerances"),
        ({"solver": []}, "no solver was given"),
        ({"steps": (0.01,), "tolerance": 2.0}, "between 0 and 1"),
        ({"steps": (0.01,), "solver": "ode55"}, "unknown solver"),
        ({"steps": (0.01,), "runs": simulator, "solver": "ode5"}, "leave out solver"),
        ({"steps": (0.01,), "runs": simulator, "constraints": None}, "constraints"),
        ({"runs": [1]}, "found int, expected Trajectories"),
        ({"runs": 3}, "found int, expected Trajectories"),
        ({"runs": []}, "runs= is empty"),
        ({"steps": (0.01,), "solver": 3}, "expected a name"),
        ({"runs": [1], "steps": (0.01,)}, "leave out steps"),
        ({"steps": (0.01,), "step": 0.01}, "did you mean 'steps'"),
        ({}, "give steps="),
    ],
)
def test_unusable_arguments(options: dict[str, Any], said: str) -> None:
    mechanism = pendulum()
    with pytest.raises(InputError, match=said):
        dc.study(mechanism, mechanism.state({"hinge": 1.0}), 1.0, **options)


# --- tolerances -------------------------------------------------------------------


def test_a_solver_that_chooses_its_steps_is_refined_by_its_tolerance() -> None:
    start = pendulum().state({"hinge": 1.0})
    found = dc.study(pendulum(), start, 1.0, solver=dc.solvers.Scipy("DOP853", tolerance=1e-9))
    assert found.knob == "tolerance"
    assert found.steps == pytest.approx((1e-7, 1e-8, 1e-9))


def test_logs_of_an_adaptive_solver_have_no_order_in_their_tolerance() -> None:
    """Its error is about its tolerance, whatever the order of its formula: 8 was expected, 1 is right."""
    mechanism = pendulum()
    start = mechanism.state({"hinge": 1.0})
    runs = [
        dc.simulate(mechanism, start, 1.0, 0.01, dc.solvers.Scipy("DOP853", tolerance=t))
        for t in (1e-4, 1e-6, 1e-8)
    ]
    found = dc.study(mechanism, runs=runs)
    assert found.nominal is None and "order-below-nominal" not in kinds(found)
    assert found.knob == "tolerance"


def test_a_summary_never_says_that_a_consistent_motion_exceeds_its_tolerance() -> None:
    """A body that turns freely, by equations of its own: of its energy only rounding is exchanged."""
    box = dc.problems.load("torque-free-box")
    found = dc.study(box, duration=1.0, steps=(0.02, 0.01, 0.005), solver="ode4")
    assert found.verdict.kind == "consistent"
    assert ">" not in found.summary() or found.relative <= found.tolerance


@pytest.mark.parametrize("steps", [(4e-4, 2e-4, 1e-4), (5e-4, 2.5e-4)])
def test_a_step_at_which_the_run_blows_up_gives_no_order(steps: tuple[float, ...]) -> None:
    """Between a run that blew up and one that did not ΔC "falls at order 37": that is none of ode4.

    The largest step that is stable is 2.79/|λ| = 3.4e-4 s (`tests/simulation/test_stiff.py`).
    """
    p = dc.problems.load("stiff-governor")
    found = dc.study(p.mechanism, p.state, 0.1, steps=steps, solver="ode4")
    order = found.observed_order["wang"].order
    if len(steps) == 2:
        assert order is None and found.observed_order["wang"].trend == "one run"
    else:
        # An order more than the method's, as wherever a decay has died down by the end.
        assert order is not None and 3.5 < order < 5.5


def test_a_run_that_diverges_but_stays_finite_gives_no_order() -> None:
    """The pendulum at 0.5 s takes 1e6 J from nowhere, at 0.05 s and less it keeps its 10 J."""
    p = dc.problems.load("triple-pendulum")
    steps = (0.2, 5e-3, 2.5e-3, 1.25e-3)
    found = dc.study(p.mechanism, p.state, 1.0, steps=steps, solver="implicit-midpoint")
    assert found.observed_order["wang"].order == pytest.approx(2.0, abs=0.1)
    assert [r.step for r in found.runs] == list(steps)  # and the table still shows it
