"""Events with every family of solvers: bounces, a stop in a closed loop, a clutch that engages.

Oracles are closed forms: flights and half periods by hand, the slider-crank's impacts by quadrature in thirty
digits (its problem). Where a method is exact, only rounding is allowed; else the error falls by its order.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac import problems
from deltac.simulation.solvers import SOLVERS
from tests.support.slow import repeated

G, E = 9.81, 0.8
TOLERANCE = 1e-9
"""The default of the solvers that choose their steps."""

FAMILIES: dict[str, dict[str, Any]] = {
    "ode4": {"step": 0.01},
    "implicit-midpoint": {"step": 0.01},
    "generalized-alpha": {"step": 0.01},
    "discrete-gradient": {"step": 0.01},
    "Radau": {},
    "BDF": {},
    "LSODA": {},
    "CVODES": {"step": 0.02},
    "IDAS": {"step": 0.02},
    "taylor": {"step": 0.05},
}
EXACT = ("ode4", "implicit-midpoint", "generalized-alpha", "discrete-gradient", "Radau", "taylor")
"""Free flight is of degree two in t, which these methods follow to rounding."""


def ball() -> dc.Mechanism:
    return dc.Mechanism(
        bodies=[dc.point_mass("ball", 1.0)],
        joints=[dc.prismatic("height", "ground", "ball", axis="z")],
        gravity=(0.0, 0.0, -G),
        events=[dc.events.joint_stop("floor", "height", lower=0.0, restitution=E)],
    )


def bounced(solver: str, **options: Any) -> tuple[float, float]:
    """The largest errors of the times and losses of four bounces from 1 m: h_k = e^2k, flights by hand."""
    mechanism = ball()
    run = dc.simulate(mechanism, mechanism.state({"height": 1.0}), 2.3, solver=solver, **options)
    assert len(run.events) == 4 and run.provenance.completed
    fall = math.sqrt(2 / G)
    times = fall + np.append(0.0, 2 * fall * np.cumsum(E ** np.arange(1.0, 4.0)))
    losses = (1 - E**2) * G * E ** (2 * np.arange(4))
    for event in run.events:  # impulse times mean speed is what K loses, whatever the solver
        change = 0.5 * float(event.u_after @ event.u_after - event.u_before @ event.u_before)
        assert event.energy_lost == pytest.approx(-change, abs=1e-14 * G)
    ledger = dc.balance(mechanism, run)
    assert ledger.work["impact floor"][-1] == pytest.approx(
        -sum(event.energy_lost for event in run.events), abs=1e-13
    )
    found_t = np.array([event.t for event in run.events])
    found_E = np.array([event.energy_lost for event in run.events])
    return float(np.abs(found_t - times).max()), float(np.abs(found_E - losses).max())


@pytest.mark.parametrize("solver", FAMILIES)
def test_bounces(solver: str) -> None:
    t, lost = bounced(solver, **FAMILIES[solver])
    allowed = 1e-12 if solver in EXACT else 100 * TOLERANCE
    assert t < allowed and lost < allowed * G


def test_bounces_of_backward_euler_are_of_first_order() -> None:
    coarse, fine = (bounced("ode1be", step=h) for h in (2e-3, 1e-3))
    for a, b in zip(coarse, fine):
        assert 1.7 < a / b < 2.3


@pytest.mark.long
@pytest.mark.parametrize(
    "solver",
    repeated(("implicit-midpoint", "generalized-alpha", "discrete-gradient"), "generalized-alpha"),
)
def test_a_stop_in_a_closed_loop_by_implicit_steps(solver: str) -> None:
    """Times and losses are of second order; the discrete gradient loses nothing but what the stop takes."""
    problem = problems.load("struck-slider-crank")
    times = np.array([r.value for r in problem.reference if r.quantity.startswith("time")])
    losses = np.array([r.value for r in problem.reference if r.quantity.startswith("loss")])
    errors = []
    for h in (4e-3, 2e-3):
        run = dc.simulate(problem.mechanism, problem.state, 3.0, h, solver)
        assert run.provenance.completed and len(run.events) == 4
        ledger = dc.balance(problem.mechanism, run)
        lost = np.array([event.energy_lost for event in run.events])
        t = np.array([event.t for event in run.events])
        errors.append((np.abs(t - times).max(), np.abs(lost - losses).max()))
        delta_c = np.abs(ledger.delta_c["wang"]).max()
        if solver == "discrete-gradient":
            assert delta_c < 1e-10 and errors[-1][1] < 1e-10  # rounding of 1500 steps' Newton
    (t_coarse, lost_coarse), (t_fine, lost_fine) = errors
    assert t_fine < 1e-4 and 3.4 < t_coarse / t_fine < 4.6
    if solver != "discrete-gradient":
        assert lost_fine < 1e-4 and lost_coarse / lost_fine > 3.0


@pytest.mark.parametrize("solver", repeated(("IDAS", "CVODES", "Radau", "taylor"), "CVODES"))
def test_a_stop_in_a_closed_loop_by_tolerance(solver: str) -> None:
    problem = problems.load("struck-slider-crank")
    run = dc.simulate(problem.mechanism, problem.state, 3.0, 0.02, solver)
    assert run.provenance.completed and len(run.events) == 4
    for reference in problem.reference:
        # CVODES starts anew at each of 150 samples, since the run is projected there.
        allowed = 1e-11 if solver == "taylor" else 3000 * TOLERANCE
        assert reference.measure(run) == pytest.approx(reference.value, abs=allowed)
    ledger = dc.balance(problem.mechanism, run)
    assert np.abs(ledger.delta_c["wang"]).max() < (1e-11 if solver == "taylor" else 1e-6)


STIFFNESS, PLAY, DRIVING, DRIVEN, START = 200.0, 0.05, 0.5, 0.3, 10.0


def clutch() -> dc.Mechanism:
    """A disc that drives another through a spring with play: it engages when the twist has used that up."""
    law = f"-{STIFFNESS}*max(-q.slip - {PLAY}, 0)"
    return dc.Mechanism(
        bodies=[
            dc.bodies.disc("driving", 2 * DRIVING, 1.0, "z"),
            dc.bodies.disc("driven", 2 * DRIVEN, 1.0, "z"),
        ],
        joints=[
            dc.revolute("shaft", "ground", "driving", "z"),
            dc.revolute("slip", "driving", "driven", "z"),
        ],
        forces=[dc.forces.joint_torque("clutch", "slip", law.replace("-", "", 1))],
    )


def engaged(solver: Any, **options: Any) -> np.ndarray:
    """Errors of the times at which the clutch engages and lets go, and of the driven disc's speed after.

    In between, slip is half a period of √(k/I), I the reduced inertia; the discs exchange as in an elastic
    impact.
    """
    mechanism = clutch()
    start = mechanism.state(None, {"shaft": START, "slip": -START})
    at_switches = replace(dc.solvers.by_name(solver), switches=True)
    run = dc.simulate(mechanism, start, 0.2, solver=at_switches, **options)
    assert [event.names for event in run.events] == [("switch actuator clutch",)] * 2
    reduced = DRIVING * DRIVEN / (DRIVING + DRIVEN)
    t = PLAY / START
    free = t + math.pi / math.sqrt(STIFFNESS / reduced)
    driven = 2 * DRIVING / (DRIVING + DRIVEN) * START
    speed = run.speed("shaft")[-1] + run.speed("slip")[-1]
    return np.abs([run.events[0].t - t, run.events[1].t - free, speed - driven])


@pytest.mark.parametrize("solver", ["implicit-midpoint", "generalized-alpha", "discrete-gradient"])
def test_a_clutch_by_implicit_steps(solver: str) -> None:
    """Free motion is exact. Half a period is of second order, and so is what damping takes of the speed."""
    chosen = dc.solvers.GeneralizedAlpha(0.5) if solver == "generalized-alpha" else solver
    coarse, fine = (engaged(chosen, step=h) for h in (2e-3, 1e-3))
    assert max(coarse[0], fine[0]) < 1e-13
    assert fine[1] < 1e-4 and 3.4 < coarse[1] / fine[1] < 4.6
    if solver == "discrete-gradient":  # energy and momentum give the speed, whatever the step
        assert max(coarse[2], fine[2]) < 1e-11
    else:
        assert fine[2] < 0.02 and coarse[2] > 3.4 * fine[2]


@pytest.mark.parametrize("solver", ["IDAS", "CVODES", "Radau", "taylor"])
def test_a_clutch_by_tolerance(solver: str) -> None:
    assert (engaged(solver, step=1e-2) < (1e-11 if solver == "taylor" else 1e-5)).all()


@pytest.mark.parametrize("solver", [s.name for s in SOLVERS.values() if not s.multistep])
def test_the_energy_is_corrected_with_every_one_step_method(solver: str) -> None:
    """A pendulum at a tolerance or step that loses energy: corrected, K + V is back to rounding."""
    if SOLVERS[solver].family == "taylor":
        pytest.skip("Taylor's method keeps the energy to rounding, and its state is its own")
    mechanism = dc.Mechanism(
        [dc.point_mass("bob", 1.0, [0.5, 0, 0])],
        [dc.revolute("hinge", "ground", "bob", "z")],
        gravity=[G, 0, 0],
    )
    start = mechanism.state({"hinge": 1.0})
    step = 0.01 if SOLVERS[solver].takes_steps else None
    chosen = dc.solvers.by_name(solver, None if step else 1e-3)
    drift = []
    for energy in (False, True):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            run = dc.simulate(
                mechanism, start, 2.0, step, chosen, constraints=dc.Projection(energy)
            )
        ledger = dc.balance(mechanism, run)
        total = ledger.kinetic + ledger.potential["gravity"]
        drift.append(np.abs(total - total[0]).max())
    # What a step of order one leaves at the turning points is more than one bounded correction takes back.
    allowed = 0.1 * drift[0] if SOLVERS[solver].order == 1 else 1e-10
    assert drift[1] < allowed


def test_events_may_begin_before_time_zero() -> None:
    """Times are compared as they are: −0.2 s is before zero, and the end is 0.1 s."""
    mechanism = ball()
    start = mechanism.state({"height": 0.1}, t=-0.2)
    run = dc.simulate(mechanism, start, 0.3, 0.01, "ode4")
    assert run.events[0].t == pytest.approx(math.sqrt(0.2 / G) - 0.2, abs=1e-13)
    assert run.t[-1] == pytest.approx(0.1, abs=1e-15) and len(run) == 31
