"""Stiff mechanisms: steps that explicit solvers cannot take, what is said when runs end, what is refused."""

from __future__ import annotations

import re
import warnings
from functools import cache, partial
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import deltac as dc
from deltac.arrays import ENDLESS, PHYSICAL
from deltac.errors import InputError
from deltac.problems import Problem
from deltac.simulation.solvers import SOLVERS
from tests.systems.linkages import four_bars
from tests.systems.machines import pendulum, robot

IMPLICIT = [s.name for s in SOLVERS.values() if s.family == "implicit"]
SUNDIALS = ["CVODES", "IDAS"]


@cache
def governor() -> Problem:
    return dc.problems.load("stiff-governor")


def stopped(*arguments: Any, **options: Any) -> tuple[dc.Trajectory, str]:
    """A run that ends before its time, and its words."""
    with pytest.warns(dc.SimulationStoppedWarning) as caught:
        run = dc.simulate(*arguments, **options)
    assert not run.provenance.completed
    assert str(caught[0].message) == run.provenance.message
    return run, run.provenance.message


def pushed(law: str) -> dc.Mechanism:
    """A block of 1 kg on a straight track, pushed by a force of that law."""
    return dc.Mechanism(
        [dc.point_mass("block", 1.0)],
        [dc.prismatic("x", "ground", "block", "x")],
        [dc.forces.joint_torque("push", "x", law)],
    )


# --- the governor of A05 --------------------------------------------------------------------------


def test_explicit_solvers_break_down_and_name_the_time_scale() -> None:
    """ode4 is stable to h |λ| = 2.79; the couplers' rate is c/m-like, some 8e3 1/s."""
    p = governor()
    run, message = stopped(p.mechanism, p.state, 0.1, 1e-3, "ode4")
    scale = float(re.findall(r"1/\|λ\| = (\S+) s", message)[0])
    assert scale == pytest.approx(1.23e-4, rel=0.01)
    limit = float(re.findall(r"steps below (\S+) s", message)[0])
    assert "generalized-alpha" in message and "implicit-midpoint" in message
    assert 0.0 < run.t[-1] < 0.1 and np.isfinite(run.q).all()
    fine = dc.simulate(p.mechanism, p.state, 0.1, 0.1 / np.ceil(0.1 / limit * 1.05), "ode4")
    assert fine.provenance.completed


def spring(*events: Any) -> dc.Mechanism:
    """1 kg on 10⁶ N/m: 1/|λ| = 1 ms; a step of 10 ms of ode4 grows by 10⁴/24 − …, some 370 times."""
    return dc.Mechanism(
        [dc.point_mass("m", 1.0)],
        [dc.prismatic("x", "ground", "m", "x", stiffness=1e6)],
        events=events,
    )


def test_a_finite_blow_up_is_no_completed_run() -> None:
    """ode4 is stable to h ω = √8: to 2.8 ms here."""
    mechanism = spring()
    run, message = stopped(mechanism, mechanism.state({"x": 0.5}), 0.5, 0.01, "ode4")
    assert run.t[-1] < 0.2 and np.abs(run.q).max() < PHYSICAL
    assert "beyond all measure" in message and "0.001 s (an oscillation)" in message
    assert "steps below 0.0028 s" in message and "must resolve every touch" in message


def test_a_blow_up_that_events_keep_in_bounds_is_told() -> None:
    mechanism = spring(dc.events.joint_stop("stop", "x", lower=-10, upper=10, restitution=0.5))
    state = mechanism.state({"x": 0.5})
    with pytest.warns(
        dc.StiffStepWarning, match=r"0\.001 s \(an oscillation\).*steps below 0\.0028 s"
    ):
        dc.simulate(mechanism, state, 0.1, 0.01, "ode4")
    with warnings.catch_warnings():
        warnings.simplefilter("error", dc.StiffStepWarning)
        dc.simulate(mechanism, state, 0.1, 2.5e-3, "ode4")


def test_a_step_that_is_short_enough_is_not_blamed() -> None:
    """A motion that blows up by itself, at a step that resolves it: u̇ = u³ without bound."""
    mechanism = pushed("u.x**3")
    _, message = stopped(mechanism, mechanism.state(speeds={"x": 1.0}), 2.0, 1e-3, "ode4")
    assert "not finite" in message and "time scale" not in message


@pytest.mark.long
def test_implicit_solvers_take_steps_eighty_times_the_scale() -> None:
    """h = 0.01 s, 81 times 1/|λ|: the slider within millimetres for 10 s, and better with h²."""
    p = governor()
    height = {float(r.at or 0.0): r.value for r in p.reference if r.quantity.startswith("slider")}
    for solver in ("implicit-midpoint", "generalized-alpha", "discrete-gradient"):
        errors = []
        for h in (0.02, 0.01):
            run = dc.simulate(p.mechanism, p.state, 10.0, h, solver, ("wang",))
            rows = [round(t / h) for t in height]
            found = run.coordinate("slider")[rows] - list(height.values())
            errors.append(np.abs(found).max())
        assert errors[1] < 3e-3
        assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.15)


@pytest.mark.long
def test_the_ledger_shows_what_numerical_damping_takes_out() -> None:
    """The dampers take 3 mJ in 10 s. Backward Euler's own loss is a hundred times as much: in ΔC."""
    p = governor()
    lost = {}
    for solver in ("ode1be", "generalized-alpha", "discrete-gradient"):
        run = dc.simulate(p.mechanism, p.state, 10.0, 0.01, solver, ("wang",))
        ledger = dc.balance(p.mechanism, run)
        lost[solver] = ledger.delta_c["wang"][-1]
        energy = ledger.kinetic + ledger.potential_energy
        change = energy[-1] - energy[0] - run.integrals["wang"][-1]
        assert lost[solver] == pytest.approx(change, abs=1e-9 * ledger.energy_exchanged)
    assert lost["ode1be"] < -0.3
    assert 1e-3 < abs(lost["generalized-alpha"]) < 0.1
    assert abs(lost["discrete-gradient"]) < 1e-8 * 680


@pytest.mark.parametrize("solver", SUNDIALS)
def test_sundials_on_the_governor(solver: str) -> None:
    p = governor()
    run = dc.simulate(p.mechanism, p.state, 10.0, 0.5, dc.solvers.Sundials(solver, 1e-9), ("wang",))
    for reference in p.reference:
        if reference.quantity.startswith(("slider", "arms", "rate")):
            assert reference.measure(run) == pytest.approx(reference.value, abs=1e-6)
    ledger = dc.balance(p.mechanism, run)
    assert np.abs(ledger.delta_c["wang"]).max() < 1e-7 * ledger.energy_exchanged


@pytest.mark.parametrize("solver", SUNDIALS)
def test_sundials_with_equations_by_hand(solver: str) -> None:
    mechanism = pendulum()
    state = mechanism.state({"hinge": 1.0})
    by_hand = dc.Equations(lambda t, q, u: -9.81 / 0.5 * np.sin(q))
    runs = [
        dc.simulate(mechanism, state, 1.0, 0.1, dc.solvers.Sundials(solver, 1e-10), equations=e)
        for e in (None, by_hand)
    ]
    assert np.abs(runs[0].q - runs[1].q).max() < 1e-7
    for name, value in runs[0].integrals.items():
        assert np.abs(value - runs[1].integrals[name]).max() < 1e-6


@pytest.mark.heyoka
@pytest.mark.parametrize("constraints", ["projection", dc.Baumgarte(20.0, 20.0)])
@pytest.mark.parametrize("solver", SUNDIALS)
def test_sundials_with_constraints(solver: str, constraints: Any) -> None:
    mechanism, state = four_bars(1)
    end = dc.simulate(mechanism, state, 0.6, 0.6, "taylor", ())
    run = dc.simulate(mechanism, state, 0.6, 0.05, solver, constraints=constraints)
    assert np.abs(run.q[-1] - end.q[-1]).max() < 1e-6
    ledger = dc.balance(mechanism, run)
    assert np.abs(ledger.delta_c["wang"]).max() < 1e-6 * ledger.energy_exchanged


def test_many_unknowns_are_solved_sparse() -> None:
    """Sixty masses in a row between springs: backward Euler by one linear solution a step, by hand."""
    n, k, h = 60, 1e5, 0.01
    bodies = [dc.point_mass(f"m{i}", 1.0) for i in range(n)]
    joints = [dc.prismatic(f"x{i}", "ground", f"m{i}", "x") for i in range(n)]
    springs = [dc.forces.tendon("s0", coordinates={"x0": 1.0}, stiffness=k)]
    springs += [
        dc.forces.tendon(f"s{i}", coordinates={f"x{i}": 1.0, f"x{i - 1}": -1.0}, stiffness=k)
        for i in range(1, n)
    ]
    mechanism = dc.Mechanism(bodies, joints, springs)
    state = mechanism.state(speeds={"x59": 3.0})
    run = dc.simulate(mechanism, state, 0.2, h, "ode1be", ())
    K = k * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    K[-1, -1] = k
    q, u = state.q.copy(), state.u.copy()
    for _ in range(20):
        u = np.asarray(np.linalg.solve(np.eye(n) + h**2 * K, u - h * K @ q), dtype=np.float64)
        q = q + h * u
    np.testing.assert_allclose(run.q[-1], q, atol=1e-12)
    np.testing.assert_allclose(run.u[-1], u, atol=1e-11)


def test_kinks_are_got_over() -> None:
    """Sliding friction as sharp as 1e-7 m/s, at 10 ms: backward Euler's monotone equation, by bisection."""
    m, force, width, h = 2.0, 3.0, 1e-7, 0.01
    mechanism = dc.Mechanism(
        [dc.point_mass("block", m)],
        [dc.prismatic("x", "ground", "block", "x")],
        [dc.forces.joint_torque("friction", "x", f"-{force}*Min(Max(u.x/{width}, -1), 1)")],
    )
    run = dc.simulate(mechanism, mechanism.state(speeds={"x": 1.0}), 1.0, h, "ode1be", ())
    u = [1.0]
    for _ in range(100):
        rest = partial(
            lambda v, before: m * (v - before) + h * force * np.clip(v / width, -1, 1),
            before=u[-1],
        )
        u.append(brentq(rest, -2.0, 2.0, xtol=1e-16))
    np.testing.assert_allclose(run.u[:, 0], u, atol=1e-12)
    assert 0.0 <= run.u[-1, 0] < width and run.provenance.completed


# --- runs that end --------------------------------------------------------------------------------


@pytest.mark.parametrize("solver", [*IMPLICIT, *SUNDIALS])
def test_failures_end_with_words_and_the_motion_so_far(solver: str) -> None:
    """A push of √(0.5 − x) ceases to be defined where the block passes 0.5 m, after about 0.9 s."""
    mechanism = pushed("sqrt(0.5 - q.x)")
    run, message = stopped(mechanism, mechanism.state(speeds={"x": 0.3}), 2.0, 0.01, solver)
    last = re.search(r"stopped at t = (\S+) s", message)
    # The last state may lie just beyond, where it has no acceleration, and is then left out.
    assert last and run.t[-1] - 1e-9 <= float(last[1]) <= run.t[-1] + 0.01 + 1e-9
    assert 0.5 < run.t[-1] < 1.5 and len(run) == round(run.t[-1] / 0.01) + 1
    assert 0.45 < run.q[-1, 0] <= 0.5 + 1e-9
    if solver in IMPLICIT:
        assert "'x'" in message and "smaller step" in message and "not defined" in message


@pytest.mark.parametrize("solver", SUNDIALS)
@pytest.mark.parametrize(
    ("law", "reason"),
    [("exp(q.x)", f"{ENDLESS} internal steps|are not defined"), ("-sqrt(q.x)", "are not defined")],
)
def test_sundials_ends_in_our_words_alone(
    solver: str, law: str, reason: str, capfd: pytest.CaptureFixture[str]
) -> None:
    """ẍ = eˣ is infinite at 1.35 s; −√x has no value once x < 0. SUNDIALS' own text is not spilled."""
    mechanism = pushed(law)
    run, message = stopped(mechanism, mechanism.state({"x": 1.0}), 3.0, 0.01, solver)
    assert re.search(reason, message) and "SUNDIALS" not in message and "_ERR" not in message
    assert f"stopped at t = {run.t[-1]:.9g} s" in message
    assert f"u.x = {run.u[-1, 0]:.4g}" in message and "Look at the laws there" in message
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("solver", IMPLICIT)
def test_equations_without_a_solution(solver: str) -> None:
    """A push of 10 u² leaves u₁ = u₀ + 10 h u² without a real root once h u > 1/40: it blows up at 1 s."""
    mechanism = pushed("10*u.x**2")
    run, message = stopped(mechanism, mechanism.state(speeds={"x": 0.1}), 2.0, 0.01, solver)
    assert "found no solution" in message or "not defined" in message or "singular" in message
    assert "'x'" in message and 0.8 < run.t[-1] < 1.1


def test_a_step_too_large_for_the_law_is_the_steps_fault() -> None:
    """The same mechanism without the singular law runs through."""
    mechanism = dc.Mechanism([dc.point_mass("m", 1.0)], [dc.prismatic("x", "ground", "m", "x")])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = dc.simulate(mechanism, mechanism.state(speeds={"x": 0.3}), 2.0, 0.01, "ode1be")
    assert run.q[-1, 0] == pytest.approx(0.6, abs=1e-12)


# --- what is refused ------------------------------------------------------------------------------


def refusal(*arguments: Any, **options: Any) -> str:
    with pytest.raises(InputError) as caught:
        dc.simulate(*arguments, **options)
    return str(caught.value)


def test_the_discrete_gradient_refuses_what_is_fed_in_time() -> None:
    mechanism, state = robot()
    message = refusal(mechanism, state, 1.0, 0.01, "discrete-gradient")
    assert "'drive'" in message and "implicit-midpoint" in message
    mechanism = dc.Mechanism(
        [dc.point_mass("m", 1.0)],
        [dc.prismatic("x", "ground", "m", "x")],
        [dc.forces.joint_spring("coil", "x", "3 + sin(t)")],
    )
    message = refusal(mechanism, mechanism.state(), 1.0, 0.01, "discrete-gradient")
    assert "coil" in message and "depends on time" in message
    problem = dc.problems.load("ball-on-rising-table")
    message = refusal(problem.mechanism, problem.state, 0.1, 0.01, "discrete-gradient")
    assert "constraint" in message and "moves in time" in message
    equations = dc.Equations(lambda t, q, u: -q)
    message = refusal(
        pendulum(), pendulum().state(), 1.0, 0.01, "discrete-gradient", equations=equations
    )
    assert "equations by hand" in message


def test_equations_without_derivatives_are_refused() -> None:
    mechanism = pendulum()
    state = mechanism.state({"hinge": 1.0})
    called = dc.Equations(lambda t, q, u: -q, compiled=False)
    for solver in ("ode1be", *SUNDIALS):
        message = refusal(mechanism, state, 1.0, 0.01, solver, equations=called)
        assert "Radau" in message


def test_own_speeds_that_are_no_rates_are_refused() -> None:
    mechanism = pendulum()
    own = dc.CoordinateMap(("a",), ("b",), q={"hinge": "2*q.a"}, u={"hinge": "3*u.b"})
    equations = dc.Equations(lambda t, q, u: -q, coordinates=own)
    message = refusal(mechanism, mechanism.state(), 1.0, 0.01, "ode1be", equations=equations)
    assert "rates of the own coordinates" in message


@pytest.mark.parametrize("solver", ["ode1be", *SUNDIALS])
def test_controllers_within_steps_are_refused(solver: str) -> None:
    mechanism = dc.Mechanism(
        [dc.point_mass("m", 1.0)],
        [dc.prismatic("x", "ground", "m", "x")],
        [dc.forces.joint_torque("push", "x", None)],
    )
    controller = dc.Controller(lambda t, q, u: {"push": 1.0}, hold=False)
    message = refusal(mechanism, mechanism.state(), 1.0, 0.01, solver, controller=controller)
    assert "derivative" in message or "differentiated" in message


@pytest.mark.parametrize("radius", [-0.1, 1.5, float("nan"), "soft"])
def test_the_spectral_radius_is_checked(radius: Any) -> None:
    with pytest.raises(InputError) as caught:
        dc.solvers.GeneralizedAlpha(radius)
    assert "spectral_radius" in str(caught.value) and repr(radius) in str(caught.value)


def test_other_options_that_do_not_go_with_a_solver() -> None:
    mechanism = pendulum()
    state = mechanism.state()
    assert "step=" in refusal(mechanism, state, 1.0, None, "ode1be")
    four, start = four_bars(1)
    message = refusal(
        four, start, 1.0, 0.01, "generalized-alpha", constraints=dc.Baumgarte(5.0, 5.0)
    )
    assert "Baumgarte" in message
    with pytest.raises(InputError, match="explicit"):
        dc.simulate_ensemble(mechanism, (state.q[None], state.u[None]), 1.0, 0.01, "ode1be")
