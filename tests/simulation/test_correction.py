"""Projection(energy=True): what it holds, what it moves, what it costs, and what it books."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import minimize

import deltac as dc
from deltac.simulation.solvers import SOLVERS

FIXED = [name for name, solver in SOLVERS.items() if solver.family == "fixed"]
EPS = float(np.finfo(np.float64).eps)


def energy(ledger: dc.Ledger) -> np.ndarray:
    return ledger.kinetic + sum(ledger.potential.values())


@pytest.mark.parametrize("solver", FIXED)
def test_energy_is_held_and_what_it_took_is_booked(solver: str) -> None:
    """Each pass leaves the square of what is left, so two leave rounding; ΔC tells the rest."""
    problem, order = dc.problems.load("triple-pendulum"), SOLVERS[solver].order
    run = dc.simulate(
        problem.mechanism,
        problem.state,
        0.5,
        step=1e-3,
        solver=solver,
        constraints=dc.Projection(energy=True),
    )
    ledger = dc.balance(problem.mechanism, run)
    E = energy(ledger)
    scale = float(np.abs(ledger.kinetic).max() + np.abs(E).max())
    # From rest, the first steps may have to put back more than a pass may move.
    assert_allclose(E[5:], E[0], rtol=0, atol=(1e-9 if order == 1 else 50 * EPS) * scale)
    assert_allclose(
        ledger.delta_c["wang"][5:], -ledger.work["correction energy"][5:], atol=1e-9 * scale
    )
    plain = dc.simulate(problem.mechanism, problem.state, 0.5, step=1e-3, solver=solver)
    lost = dc.balance(problem.mechanism, plain).delta_c["wang"]
    # The same losses, but for what the correction moves: half of them again at first order.
    assert abs(ledger.delta_c["wang"][-1]) > 0.3 * abs(lost[-1]) - 50 * EPS * scale


def test_order_of_the_motion_stays() -> None:
    """A correction of order h^(p+1) a step leaves a solver of order p one of order p."""
    problem = dc.problems.load("triple-pendulum")
    exact = dc.simulate(problem.mechanism, problem.state, 1.0, step=1.0, solver="taylor")
    errors = [
        np.abs(
            dc.simulate(
                problem.mechanism,
                problem.state,
                1.0,
                step=h,
                solver="ode4",
                constraints=dc.Projection(energy=True),
            ).q[-1]
            - exact.q[-1]
        ).max()
        for h in (2e-3, 1e-3, 5e-4)
    ]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders.min() > 3.7


def test_change_is_the_least_in_the_mass_metric() -> None:
    """Against a general minimiser: ‖δu‖²_M + ‖δq/h‖²_M subject to the energy, from one step of Euler."""
    length, mass, g, h = 1.0, 2.0, 9.81, 0.01
    bob = dc.point_mass("bob", mass)
    mechanism = dc.Mechanism(
        bodies=[bob],
        joints=[dc.revolute("pin", "ground", "bob", axis=(0, 0, 1), child_position=(0, length, 0))],
        gravity=(0.0, -g, 0.0),
    )
    state = mechanism.state({"pin": 0.2}, speeds={"pin": 0.4})
    options: dict[str, Any] = {"step": h, "solver": "ode1"}
    (q0, u0), (q1, u1) = (
        (run.q[-1, 0], run.u[-1, 0])
        for run in (
            dc.simulate(mechanism, state, h, **options),
            dc.simulate(mechanism, state, h, **options, constraints=dc.Projection(energy=True)),
        )
    )
    inertia = mass * length**2

    def total(q: float, u: float) -> float:
        return float(0.5 * inertia * u**2 - mass * g * length * np.cos(q))

    target = total(0.2, 0.4)
    found = minimize(
        lambda d: 1e4 * inertia * (d[1] ** 2 + (d[0] / h) ** 2),
        [0.0, 0.0],
        method="SLSQP",
        constraints={"type": "eq", "fun": lambda d: total(q0 + d[0], u0 + d[1]) - target},
        options={"ftol": 1e-15},
    )
    # Along the steepest way instead of the shortest: they differ in second order of the change.
    change = np.array([q1 - q0, u1 - u0])
    assert_allclose(change, found.x, atol=0.05 * np.abs(found.x).max())
    assert total(q1, u1) == pytest.approx(target, abs=1e-9)


def test_work_that_flows_in_is_kept() -> None:
    """With dampers and a motor the balance K + V − Q is brought to zero, not K + V to its start."""
    problem = dc.problems.load("driven-triple-pendulum")
    run = dc.simulate(
        problem.mechanism,
        problem.state,
        2.0,
        step=5e-3,
        solver="ode2",
        constraints=dc.Projection(energy=True),
    )
    ledger = dc.balance(problem.mechanism, run)
    E = energy(ledger)
    assert np.ptp(E) > 0.1
    due = ledger.delta_c["wang"] + ledger.work["correction energy"]
    assert_allclose(due, 0.0, atol=1e-9 * np.ptp(E))


@pytest.mark.parametrize(
    "solver", [n for n, s in SOLVERS.items() if s.takes_steps and s.order == 2]
)
def test_energy_that_a_damper_takes_is_gone(solver: str) -> None:
    """ω = ω₀ e^(−c t/J) of a disc on a damper, implicit solvers too: at second order, twice the steps."""
    if solver == "discrete-gradient":
        pytest.skip("it keeps the energy's balance by itself, to rounding")
    mechanism = dc.Mechanism(
        bodies=[dc.bodies.disc("disc", 2.0, 1.0, axis="z")],
        joints=[dc.joints.revolute("axle", "ground", "disc", "z", damping=3.0)],
    )
    found = [
        dc.simulate(
            mechanism,
            mechanism.state(speeds={"axle": 1.0}),
            1.0,
            step=h,
            solver=solver,
            constraints=dc.Projection(energy=True),
        ).u[-1, 0]
        for h in (0.05, 0.025)
    ]
    errors = np.abs(np.array(found) - np.exp(-3.0))
    assert errors[0] < 2e-3
    assert errors[1] < 0.35 * errors[0]


@pytest.mark.long
def test_constraints_and_quaternions_are_respected() -> None:
    problem = dc.problems.load("bricard")
    run = dc.simulate(
        problem.mechanism,
        problem.state,
        0.5,
        step=2e-3,
        solver="ode2",
        constraints=dc.Projection(energy=True),
    )
    ledger = dc.balance(problem.mechanism, run)
    assert max(float(v.max()) for v in ledger.violation.values()) < 1e-9
    E = energy(ledger)
    # Projecting after the last pass changes the energy by a product of two small things.
    assert_allclose(E, E[0], rtol=0, atol=1e-9 * np.ptp(ledger.kinetic))
    top = dc.problems.load("heavy-top")
    spun = dc.simulate(
        top.mechanism,
        top.state,
        0.02,
        step=1e-4,
        solver="ode4",
        constraints=dc.Projection(energy=True),
    )
    E = energy(dc.balance(top.mechanism, spun))
    assert_allclose(E, E[0], rtol=100 * EPS)


def test_equations_by_hand_in_their_own_coordinates() -> None:
    problem = dc.problems.load("triple-pendulum")
    assert problem.equations is not None
    for compiled in (True, False):
        equations = replace(problem.equations, compiled=compiled)
        run = dc.simulate(
            problem.mechanism,
            problem.state,
            0.1,
            step=1e-2,
            solver="ode2",
            equations=equations,
            constraints=dc.Projection(energy=True),
        )
        E = energy(dc.balance(problem.mechanism, run))
        assert_allclose(E, E[0], atol=1e-9)


def test_refusals_say_what_to_do() -> None:
    problem = dc.problems.load("triple-pendulum")
    with pytest.raises(dc.InputError, match="expected 'projection', deltac.Projection"):
        dc.simulate(problem.mechanism, problem.state, 1.0, step=1e-2, constraints="energy")
    for solver in ("BDF", "CVODES", "taylor"):
        with pytest.raises(dc.InputError, match="one-step solver"):
            dc.simulate(
                problem.mechanism,
                problem.state,
                1.0,
                solver=solver,
                constraints=dc.Projection(energy=True),
            )


def test_a_correction_that_cannot_keep_up_says_so() -> None:
    problem = dc.problems.load("triple-pendulum")
    with pytest.warns(dc.EnergyLeftWarning, match="could not keep up: K . V is off by up to .* J"):
        dc.simulate(
            problem.mechanism,
            problem.state,
            2.0,
            0.05,
            "ode2",
            constraints=dc.Projection(energy=True),
        )
