"""Events within runs: found to rounding, with the solver's accuracy, by every solver that can."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.arrays import EPS
from deltac.simulation.events.location import End, crossing

G = 9.81
SOLVERS: list[tuple[Any, dict[str, Any]]] = [
    ("ode8", {"step": 0.02}),
    (dc.solvers.Scipy("DOP853", 1e-12), {}),
    (dc.solvers.Scipy("DOP853", 1e-12), {"step": 0.02}),
    (dc.solvers.Scipy("Radau", 1e-10), {"step": 0.1}),
    (dc.solvers.Scipy("LSODA", 1e-12), {"step": 0.1}),
]


def oscillator(*events: Any, **options: Any) -> dc.Mechanism:
    """ẍ = −4 x: x = cos 2t from (1, 0)."""
    return dc.Mechanism(
        bodies=[dc.point_mass("mass", 1.0)],
        joints=[dc.prismatic("x", "ground", "mass", axis="x", stiffness=4.0)],
        events=events,
        **options,
    )


def run_of(mechanism: dc.Mechanism, duration: float = 2.0, **options: Any) -> dc.Trajectory:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return dc.simulate(mechanism, mechanism.state({"x": 1.0}), duration, **options)


@pytest.mark.parametrize(("solver", "options"), SOLVERS)
def test_events_are_met_by_every_solver(solver: Any, options: dict[str, Any]) -> None:
    mechanism = oscillator(
        dc.events.event("zero", "q.x"),
        dc.events.event("upward", "q.x", direction="rising"),
        dc.events.event("noon", "t - 1"),
        dc.events.event("turn", "u.x", direction="rising"),
    )
    run = run_of(mechanism, 4.0, solver=solver, **options)
    times: dict[str, list[float]] = {}
    for event in run.events:
        for name in event.names:
            times.setdefault(name, []).append(event.t)
    # cos 2t passes zero at π/4 + k π/2; its rate −2 sin 2t upwards at π/2 + k π. The global error of the
    # solvers at this tolerance or step is below 1e-9.
    quarter = math.pi / 4
    expected = {
        "event zero": [quarter, 3 * quarter, 5 * quarter],
        "event upward": [3 * quarter],
        "event noon": [1.0],
        "event turn": [2 * quarter],
    }
    assert set(times) == set(expected)
    for name, found in times.items():
        np.testing.assert_allclose(found, expected[name], rtol=0, atol=1e-9)
    for event in run.events:
        assert event.q[0] == pytest.approx(math.cos(2 * event.t), abs=1e-8)
        np.testing.assert_array_equal(event.u_before, event.u_after)
        assert not event.impulses and event.energy_lost == 0.0
    if "step" in options:  # the samples stay those of the grid
        np.testing.assert_allclose(run.t, np.arange(len(run)) * options["step"], atol=1e-12)


def test_events_do_not_disturb_a_fixed_step_run_beyond_its_error() -> None:
    plain = run_of(oscillator(), solver="ode5", step=0.01)
    watched = run_of(oscillator(dc.events.event("zero", "q.x")), solver="ode5", step=0.01)
    np.testing.assert_array_equal(plain.t, watched.t)
    error = np.abs(plain.q[:, 0] - np.cos(2 * plain.t)).max()
    assert np.abs(plain.q - watched.q).max() <= 2 * error


def test_the_solvers_order_is_that_of_the_event_times() -> None:
    errors = []
    for step in (0.1, 0.05, 0.025):
        run = run_of(oscillator(dc.events.event("zero", "q.x")), 2.5, solver="ode4", step=step)
        errors.append(abs(run.events[1].t - 3 * math.pi / 4))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > 3.7).all(), (errors, orders)


def test_a_terminal_event_ends_the_run_where_it_happens() -> None:
    mechanism = oscillator(dc.events.event("half", "q.x - 0.5", terminal=True))
    for solver, options in SOLVERS:
        run = run_of(mechanism, solver=solver, **options)
        assert run.t[-1] == run.events[-1].t == pytest.approx(math.pi / 6, abs=1e-9)
        assert run.q[-1, 0] == pytest.approx(0.5, abs=1e-9)
        assert run.provenance.completed
        assert run.provenance.ended.startswith("event 'half'")


def test_a_graze_within_a_step_is_seen() -> None:
    """Cos 2t is above 0.99999 for 4.5 ms about t = π: less than a tenth of the step."""
    mechanism = oscillator(dc.events.event("top", "q.x - 0.99999"))
    start = mechanism.state({"x": 0.0}, speeds={"x": 2.0})  # x = sin 2t, tops at π/4
    run = dc.simulate(mechanism, start, 1.6, solver="ode8", step=0.05)
    half = 0.5 * math.acos(0.99999)
    expected = [math.pi / 4 - half, math.pi / 4 + half]
    np.testing.assert_allclose([e.t for e in run.events], expected, rtol=0, atol=1e-8)


def test_a_root_is_found_where_the_cubic_is_a_poor_picture() -> None:
    """Of sin(5θ + 0.1), the first fall through zero counts; a cubic knows little of it."""

    def look(theta: float) -> tuple[float, float]:
        return math.sin(5 * theta + 0.1), 5 * math.cos(5 * theta + 0.1)

    found = crossing(look, End(0.0, *look(0.0)), End(1.0, *look(1.0)), EPS, after=False)
    exact = (math.pi - 0.1) / 5
    assert found == pytest.approx(exact, abs=4 * EPS)
    none = crossing(
        lambda x: (1 + x, 1.0), End(0.0, 1.0, 1.0), End(1.0, 2.0, 1.0), EPS, after=False
    )
    assert none is None


def test_events_of_constrained_and_controlled_runs() -> None:
    circle = dc.Mechanism(
        bodies=[dc.bodies.sphere("bead", 1.0, 0.1)],
        joints=[dc.joints.planar("plane", "ground", "bead")],
        constraints=[dc.constraints.distance("rod", "ground", "bead", length=1.0)],
        events=[dc.events.event("right", "q.plane.x - 0.8")],
    )
    start = circle.state({"plane.y": 1.0}, speeds={"plane.x": 1.0})
    run = dc.simulate(circle, start, 1.2, 0.01, "ode5")
    # On the unit circle with unit speed: sin t = 0.8.
    assert run.events[0].t == pytest.approx(math.asin(0.8), abs=1e-10)

    motor = dc.Mechanism(
        bodies=[dc.point_mass("mass", 1.0)],
        joints=[dc.prismatic("x", "ground", "mass", axis="x")],
        forces=[dc.forces.joint_torque("motor", "x")],
        events=[dc.events.event("there", "q.x - 0.3")],
    )
    controller = dc.Controller(lambda t, q, u: {"motor": 2.0})
    held = dc.simulate(motor, motor.state(), 1.0, 0.01, controller=controller)
    assert held.events[0].t == pytest.approx(math.sqrt(0.3), abs=1e-12)
    np.testing.assert_array_equal(held.events[0].forces_after["actuator motor"], [2.0])


def test_events_of_equations_by_hand() -> None:
    mechanism = oscillator(dc.events.joint_stop("wall", "x", lower=-0.5, restitution=0.5))
    for compiled in (True, False):
        equations = dc.Equations(lambda t, q, u: -4.0 * q, compiled=compiled)
        run = dc.simulate(
            mechanism, mechanism.state({"x": 1.0}), 1.5, 0.01, "ode8", equations=equations
        )
        assert run.events[0].t == pytest.approx(math.pi / 3, abs=1e-11)
        ledger = dc.balance(mechanism, run)
        assert np.abs(ledger.delta_c["wang"]).max() < 1e-12


def test_a_correction_and_events_do_not_go_together() -> None:
    mechanism = oscillator(dc.events.event("zero", "q.x"))
    with pytest.raises(dc.InputError, match="cannot be combined with events"):
        dc.simulate(
            mechanism,
            mechanism.state({"x": 1.0}),
            1.0,
            0.1,
            "ode4",
            constraints=dc.Projection(energy=True),
        )


def test_ensembles_and_foreign_coordinates_say_so() -> None:
    mechanism = oscillator(dc.events.joint_stop("wall", "x", lower=-0.5))
    state = mechanism.state({"x": 1.0})
    with pytest.raises(dc.InputError, match="an ensemble does not stop at"):
        dc.simulate_ensemble(mechanism, state, 1.0, 0.1)
    own = dc.Equations(
        lambda t, q, u: -4 * q, coordinates=dc.CoordinateMap(("y",), q={"x": "2 * q.y"})
    )
    with pytest.raises(dc.InputError, match="'wall' and equations by hand in coordinates"):
        dc.simulate(mechanism, state, 1.0, 0.1, equations=own)
