"""Implicit solvers: exact facts of each method, constraints, quaternions, and what the ledger shows."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import deltac as dc
from deltac.simulation.flow import build_flow, keeping
from deltac.simulation.solvers import SOLVERS, find_solver
from deltac.simulation.stepping.implicit.stepper import ImplicitMethod, ImplicitSteps
from deltac.simulation.stepping.interpreted import StageRate
from tests.systems.linkages import disc, four_bars
from tests.systems.machines import pendulum, robot, workshop

IMPLICIT = [s.name for s in SOLVERS.values() if s.family == "implicit"]


def oscillator(omega: float) -> tuple[dc.Mechanism, dc.State]:
    """A mass of 2 kg on a spring, at rest 0.3 m from equilibrium."""
    mechanism = dc.Mechanism(
        [dc.point_mass("mass", 2.0)],
        [dc.prismatic("x", "ground", "mass", "x", stiffness=2.0 * omega**2)],
    )
    return mechanism, mechanism.state({"x": 0.3})


# --- exact facts of each method on x″ = −ω² x -----------------------------------------------------


def test_backward_euler_takes_out_what_theory_says() -> None:
    """K + V falls by 1 + (hω)² a step: by hand. All of it is in Wang's ΔC: nothing flows."""
    omega, h = 7.0, 0.02
    mechanism, state = oscillator(omega)
    run = dc.simulate(mechanism, state, 2.0, h, "ode1be")
    ledger = dc.balance(mechanism, run)
    start = 0.5 * 2.0 * omega**2 * 0.3**2
    expected = start * ((1 + (h * omega) ** 2) ** -np.arange(101.0) - 1)
    np.testing.assert_allclose(ledger.delta_c["wang"], expected, atol=1e-12 * start)
    assert expected[-1] < -0.8 * start


@pytest.mark.parametrize("solver", ["implicit-midpoint", dc.solvers.GeneralizedAlpha(1.0)])
def test_undamped_methods_keep_a_quadratic_energy(
    solver: str | dc.solvers.GeneralizedAlpha,
) -> None:
    """At ten steps a radian and at ten radians a step alike: quadratic invariants, to rounding."""
    for h in (0.01, 1.0):
        mechanism, state = oscillator(10.0)
        run = dc.simulate(mechanism, state, 100 * h, h, solver)
        ledger = dc.balance(mechanism, run)
        assert np.abs(ledger.delta_c["wang"]).max() < 1e-11 * ledger.kinetic.max() + 1e-12


@pytest.mark.parametrize("radius", [0.0, 0.3, 0.8])
def test_the_spectral_radius_is_what_was_asked_for(radius: float) -> None:
    """At infinite frequency the three roots of generalized-α meet in −ρ (Chung and Hulbert 1993)."""
    mechanism, state = oscillator(1e4)  # (hω)⁻² = 1e-8 from infinity
    run = dc.simulate(mechanism, state, 12.0, 1.0, dc.solvers.GeneralizedAlpha(radius))
    x = run.q[:, 0]
    recurrence = x[3:] + 3 * radius * x[2:-1] + 3 * radius**2 * x[1:-2] + radius**3 * x[:-3]
    assert np.abs(recurrence).max() < 1e-6 * np.abs(x).max()


def test_generalized_alpha_loses_the_more_the_smaller_its_radius() -> None:
    mechanism, state = oscillator(10.0)
    lost = []
    for radius in (1.0, 0.8, 0.4, 0.0):
        run = dc.simulate(mechanism, state, 2.0, 0.02, dc.solvers.GeneralizedAlpha(radius))
        lost.append(-dc.balance(mechanism, run).delta_c["wang"][-1])
    assert abs(lost[0]) < 1e-12 < 1e-3 < lost[1] < lost[2] < lost[3]


# --- energies -------------------------------------------------------------------------------------


def test_midpoint_closes_liu_huston_at_any_step_and_wang_shows_joules() -> None:
    """K is quadratic and M constant: ΔK = h u_m·F identically, however wrong the motion."""
    problem = dc.problems.load("elastic-pendulum")
    run = dc.simulate(problem.mechanism, problem.state, 10.0, 0.1, "implicit-midpoint")
    ledger = dc.balance(problem.mechanism, run)
    assert np.abs(ledger.delta_c["liu-huston"]).max() < 1e-12 * ledger.energy_exchanged
    assert np.abs(ledger.delta_c["wang"]).max() > 0.01


def undriven() -> tuple[dc.Mechanism, dc.State]:
    return robot(driven=False)


def four_bar() -> tuple[dc.Mechanism, dc.State]:
    return four_bars(1)


def swinging() -> tuple[dc.Mechanism, dc.State]:
    problem = dc.problems.load("triple-pendulum", rates=(10.0, 0.0, 0.0))
    return problem.mechanism, problem.state


@pytest.mark.parametrize(
    "make", [undriven, four_bar, swinging, pytest.param(disc, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("h", [1e-2, pytest.param(2.5e-2, marks=pytest.mark.slow)])
def test_discrete_gradient_closes_the_energy(make: Any, h: float) -> None:
    """Torques, dampers, M(q), quaternions, loops, rolling: K + V − Q to Newton's tolerance (1e-13 a step)."""
    mechanism, state = make()
    run = dc.simulate(mechanism, state, 1.0, h, "discrete-gradient")
    ledger = dc.balance(mechanism, run)
    assert np.abs(ledger.delta_c["wang"]).max() < 1e-11 * ledger.energy_exchanged
    assert np.abs(ledger.delta_c["liu-huston"]).max() > 1e-6 * ledger.energy_exchanged


@pytest.mark.parametrize(
    "solver", ["ode1be", "implicit-midpoint", "generalized-alpha", "discrete-gradient"]
)
def test_a_mechanism_with_motion_constraints_alone(solver: str) -> None:
    """Chaplygin's sleigh: ω = ω0 sech(kt) at 1 s is 1.4011606946870, to the method's order."""
    problem = dc.problems.load("chaplygin-sleigh")
    errors = []
    for h in (0.02, 0.01):
        run = dc.simulate(problem.mechanism, problem.state, 1.0, h, solver)
        errors.append(abs(run.u[-1, -1] - 1.4011606946870))
    assert errors[0] < (0.05 if solver == "ode1be" else 1e-3)
    assert np.log2(errors[0] / errors[1]) > (0.8 if solver == "ode1be" else 1.7)


# --- constraints ----------------------------------------------------------------------------------

L, G, M = 0.5, 9.81, 2.0


def tethered() -> tuple[dc.Mechanism, dc.State]:
    """The pendulum as a particle in the plane (x, y) with a constraint on its distance."""
    mechanism = dc.Mechanism(
        [dc.bodies.frame("carriage"), dc.point_mass("bob", M)],
        [
            dc.prismatic("x", "ground", "carriage", "x"),
            dc.prismatic("y", "carriage", "bob", "y"),
        ],
        constraints=[dc.constraints.distance("rope", "ground", "bob", L)],
        gravity=(0, -G, 0),
    )
    return mechanism, mechanism.state({"x": L, "y": 0.0}, {"x": 0.0, "y": -1.0})


def tension(t: Any) -> tuple[Any, Any, Any]:
    """Positions, velocities and tension of the pendulum from its angle: θ̈ = −(g/l) sin θ by SciPy."""
    found = solve_ivp(
        lambda _, y: [y[1], -G / L * np.sin(y[0])],
        (0, float(np.max(t)) + 1e-9),
        [np.pi / 2, -1.0 / L],
        "DOP853",
        t_eval=t,
        rtol=1e-13,
        atol=1e-13,
    )
    angle, rate = found.y
    q = L * np.column_stack([np.sin(angle), -np.cos(angle)])
    u = L * (rate * np.array([np.cos(angle), np.sin(angle)])).T
    return q, u, M * (G * np.cos(angle) + L * rate**2)


def steps_of(solver: str, T: float, steps: int, constraints: Any) -> tuple[Any, Any]:
    """x and the method's own multipliers after each step."""
    mechanism, state = tethered()
    flow = build_flow(mechanism, rows=(0,), constraints=keeping(constraints))
    none = np.empty(0)
    method = ImplicitMethod(flow, find_solver(solver))
    stepper = ImplicitSteps(method, StageRate(flow, None, none), none, 0.8)
    x, states, multipliers = flow.start(state, none), [], []
    for k in range(steps):
        t, following = k * T / steps, (k + 1) * T / steps
        x = stepper.attempt(t, x, following).x1
        stepper.accept(following, x)
        states.append(x[:4])
        multipliers.append(float(stepper.taken.y[-1]) * steps / T)  # y ends in h λ
    return np.array(states), np.array(multipliers)


def test_generalized_alpha_is_second_order_in_q_u_and_lambda() -> None:
    """On the index-3 level, nothing projected: q and u at every step, λ when the start is forgotten.

    A start with ψ = 0 lacks the bias of the velocities on which λ lives: an error of first order in λ, which
    dies out with the spectral radius (Arnold, Brüls, Cardona, Numer. Math. 129 (2015) 149-179).
    """
    T, errors = 1.0, []
    for steps in (100, 200, 400):
        x, lam = steps_of("generalized-alpha", T, steps, None)
        q, u, force = tension(np.arange(1, steps + 1) * T / steps)
        errors.append([np.abs(x[:, :2] - q).max(), np.abs(x[:, 2:] - u).max()])
        errors[-1].append(np.abs(-lam - force)[steps // 2 :].max())
        assert np.abs(np.hypot(*x[:, :2].T) - L).max() < 1e-13, "φ is met to Newton's tolerance"
    slopes = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    np.testing.assert_allclose(slopes, 2.0, atol=0.15)


@pytest.mark.parametrize("constraints", ["projection", None])
@pytest.mark.parametrize("solver", ["implicit-midpoint", "generalized-alpha", "discrete-gradient"])
def test_recorded_multipliers_are_second_order(solver: str, constraints: Any) -> None:
    """The forces of constraints in the trajectory, at every row."""
    mechanism, state = tethered()
    errors = []
    for steps in (100, 200):
        run = dc.simulate(mechanism, state, 1.0, 1.0 / steps, solver, (), constraints=constraints)
        q, _, force = tension(run.t)
        errors.append(np.abs(run.forces["constraint rope"] + force[:, None] * q / L).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.15)


@pytest.mark.parametrize(
    "solver",
    [
        pytest.param("ode1be", marks=pytest.mark.slow),
        pytest.param("implicit-midpoint", marks=pytest.mark.slow),
        "generalized-alpha",
    ],
)
def test_work_of_moving_constraints_keeps_the_order(solver: str) -> None:
    """Q of a ball on a table that rises: λ and b at the solver's own stages."""
    problem = dc.problems.load("ball-on-rising-table")
    mechanism, state = problem.mechanism, problem.state
    end = dc.simulate(mechanism, state, 0.4, 0.4 / 64, "ode8", ("wang",)).integrals["wang"][-1]
    errors = []
    for steps in (256, 512):
        run = dc.simulate(mechanism, state, 0.4, 0.4 / steps, solver, ("wang",))
        errors.append(abs(run.integrals["wang"][-1] - end))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(SOLVERS[solver].order, abs=0.2)


@pytest.mark.parametrize("make", [four_bar, pytest.param(disc, marks=pytest.mark.slow)])
@pytest.mark.parametrize("solver", IMPLICIT)
def test_runs_stay_on_their_constraints(solver: str, make: Any) -> None:
    mechanism, state = make()
    ledger = dc.balance(mechanism, dc.simulate(mechanism, state, 0.5, 1e-3, solver))
    # Projection leaves the fourth power of what a step leaves: rounding, from second order on.
    allowed = 1e-12 if SOLVERS[solver].order == 2 else 1e-9
    for name, violation in ledger.violation.items():
        assert violation.max() < allowed, name


# --- turns, drives, parameters, controllers -------------------------------------------------------


@pytest.mark.parametrize(
    "solver",
    [
        "generalized-alpha",
        *(pytest.param(s, marks=pytest.mark.slow) for s in ("ode1be", "implicit-midpoint")),
    ],
)
def test_everything_a_mechanism_can_hold(solver: str) -> None:
    """Free and screw joints, drives, springs that depend on time, against ode8; unit quaternions."""
    mechanism, state = workshop()
    end = dc.simulate(
        mechanism, state, 0.4, 0.4 / 128, "ode8", dc.Record(testing=("wang",), every=128)
    )
    errors = []
    for steps in (64, 128):
        run = dc.simulate(mechanism, state, 0.4, 0.4 / steps, solver, ("wang",))
        found = [run.q[-1] - end.q[-1], run.u[-1] - end.u[-1]]
        found += [run.integrals[n][-1:] - end.integrals[n][-1:] for n in run.integrals]
        errors.append(np.abs(np.concatenate(found)).max())
        for joint in ("base", "ball"):
            parts = [run.coordinate(f"{joint}.{part}") for part in ("qw", "qx", "qy", "qz")]
            np.testing.assert_allclose(np.sum(np.square(parts), axis=0), 1.0, atol=1e-15 * 8)
    assert np.log2(errors[0] / errors[1]) == pytest.approx(SOLVERS[solver].order, abs=0.2)


@pytest.mark.parametrize("solver", IMPLICIT)
def test_parameters_that_vary_and_equations_by_hand(solver: str) -> None:
    mechanism = pendulum()
    state = mechanism.state({"hinge": 1.0})
    own = dc.simulate(mechanism, state, 1.0, 0.01, solver)
    varied = dc.simulate(mechanism.varying("l"), state, 1.0, 0.01, solver)
    assert np.abs(varied.q - own.q).max() < 1e-11
    if solver == "discrete-gradient":
        return
    by_hand = dc.Equations(lambda t, q, u: -9.81 / 0.5 * np.sin(q))
    run = dc.simulate(mechanism, state, 1.0, 0.01, solver, equations=by_hand)
    assert np.abs(run.q - own.q).max() < 1e-11
    for name in run.integrals:
        assert np.abs(run.integrals[name] - own.integrals[name]).max() < 1e-10


@pytest.mark.parametrize("solver", IMPLICIT)
def test_a_held_controller(solver: str) -> None:
    """A constant push by a controller and by a law: the same run, and its work is in the ledger."""
    bodies = [dc.point_mass("block", 2.0)]
    joints = [dc.prismatic("x", "ground", "block", "x", damping=0.3)]
    runs = []
    for torque in (None, 3.0):
        mechanism = dc.Mechanism(bodies, joints, [dc.forces.joint_torque("push", "x", torque)])
        given: dict[str, Any] = (
            {} if torque else {"controller": dc.Controller(lambda t, q, u: {"push": 3.0})}
        )
        runs.append(dc.simulate(mechanism, mechanism.state(), 1.0, 0.005, solver, **given))
        ledger = dc.balance(mechanism, runs[-1])
        assert ledger.work["actuator push"][-1] == pytest.approx(3.0 * runs[-1].q[-1, 0], rel=1e-2)
    np.testing.assert_allclose(runs[0].q, runs[1].q, atol=1e-13)


@pytest.mark.parametrize("solver", IMPLICIT)
def test_nothing_recorded_changes_no_motion(solver: str) -> None:
    """One speed and no integral is the least that a method can hold."""
    mechanism, state = oscillator(7.0)
    plain, full = (dc.simulate(mechanism, state, 0.5, 0.01, solver, r) for r in ([], ["wang"]))
    assert not plain.integrals and full.integrals
    np.testing.assert_allclose(plain.q, full.q, atol=1e-13)


def test_progress_and_rows() -> None:
    mechanism = pendulum()
    told: list[float] = []
    run = dc.simulate(
        mechanism,
        mechanism.state({"hinge": 1.0}),
        1.0,
        1 / 256,
        "implicit-midpoint",
        progress=told.append,
        record=32,
    )
    np.testing.assert_allclose(run.t, np.linspace(0, 1, 9), atol=1e-15)
    assert told == sorted(told) and 0.0 < told[0] < 0.1 and told[-1] == 1.0
    assert run.provenance.step == 1 / 256
