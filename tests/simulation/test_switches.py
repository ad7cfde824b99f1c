"""Laws with kinks and jumps: with switches=True no step goes across, and every solver keeps its order."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import deltac as dc
from deltac.solvers import FixedStep, Scipy

LAWS = {
    "jump": "where(q.x > 0.3, -4.0, 1.0) - 3*q.x",
    "kink": "-9*q.x - 5*max(q.x - 0.2, 0)",
    "sign": "-2*q.x - 0.05*sign(u.x)",
    "abs": "-2*q.x - 0.3*u.x*abs(u.x)",
    "time": "-q.x + where(t > 0.777, sin(t), 0)",
}


def slider(law: str) -> dc.Mechanism:
    return dc.Mechanism(
        bodies=[dc.point_mass("mass", 1.0)],
        joints=[dc.prismatic("x", "ground", "mass", axis="x")],
        forces=[dc.forces.joint_torque("motor", "x", law)],
    )


def end(law: str, solver: str, steps: int, *, switches: bool) -> np.ndarray:
    mechanism = slider(law)
    start = mechanism.state({"x": 1.0}, speeds={"x": 0.1})
    run = dc.simulate(mechanism, start, 2.0, 2.0 / steps, FixedStep(solver, switches=switches), ())
    return np.array([run.q[-1, 0], run.u[-1, 0]])


@pytest.mark.parametrize("name", LAWS)
def test_the_order_survives_a_switch(name: str) -> None:
    law = LAWS[name]
    exact = end(law, "ode8", 320, switches=True)
    for solver, order in (("ode2", 2), ("ode4", 4)):
        errors = [np.abs(end(law, solver, n, switches=True) - exact).max() for n in (40, 80, 160)]
        orders = np.log2(np.array(errors[:-1]) / errors[1:])
        assert (orders > order - 0.3).all(), (solver, errors)
    if name in ("jump", "kink"):  # and does not without
        across = [np.abs(end(law, "ode4", n, switches=False) - exact).max() for n in (40, 160)]
        assert np.log2(across[0] / across[1]) / 2 < 3.5


def test_switch_times_of_a_piecewise_linear_oscillator() -> None:
    """ẍ = −4 x, on one side of x = 0 −16 x: half periods π/2 and π/4 in turn, in closed form."""
    mechanism = slider("where(q.x > 0, -4*q.x, -16*q.x)")
    run = dc.simulate(
        mechanism, mechanism.state({"x": 1.0}), 3.5, 0.02, FixedStep("ode8", switches=True)
    )
    expected = [math.pi / 4, math.pi / 2, math.pi]  # a quarter, then half a fast, half a slow one
    np.testing.assert_allclose([e.t for e in run.events], expected, rtol=0, atol=1e-10)
    assert {name for e in run.events for name in e.names} == {"switch actuator motor"}


@pytest.mark.parametrize("work", ["in-loop", "samples"])
@pytest.mark.parametrize("name", ["jump", "sign"])
def test_the_ledger_closes_across_jumps_of_the_force(name: str, work: str) -> None:
    mechanism = slider(LAWS[name])
    start = mechanism.state({"x": 1.0}, speeds={"x": 0.1})
    run = dc.simulate(mechanism, start, 2.0, 0.01, FixedStep("ode8", switches=True))
    assert run.events
    jump = np.subtract(run.events[0].udot_after, run.events[0].udot_before)  # type: ignore[arg-type]
    # "jump" passes x = 0.3 downwards, from −4 to 1; friction turns from −0.05 to 0.05.
    assert jump[0] == pytest.approx(5.0 if name == "jump" else 0.1, abs=1e-9)
    ledger = dc.balance(mechanism, run, work=work)
    for delta_c in ledger.delta_c.values():
        # ode8's error is rounding; the samples' quadrature is of order five at the pieces' ends.
        assert np.abs(delta_c).max() < 2e-12
    assert dc.audit(mechanism, run, work=work).verdict.kind == "consistent"


def test_dry_friction_that_sticks_is_said() -> None:
    """Decelerated by sign(u) to rest, where the force law has no value: stick."""
    mechanism = slider("-3*sign(u.x)")
    with pytest.warns(dc.SimulationStoppedWarning, match="from both sides"):
        run = dc.simulate(
            mechanism, mechanism.state(speeds={"x": 1.5}), 1.0, 0.03125, FixedStep(switches=True)
        )
    assert run.t[-1] == pytest.approx(0.5, abs=1e-12)
    assert run.q[-1, 0] == pytest.approx(0.375, abs=1e-12)
    assert dc.balance(mechanism, run).work["actuator motor"][-1] == pytest.approx(-1.125, abs=1e-12)


def test_a_start_from_rest_finds_its_side() -> None:
    """At rest sign(u) is zero; the motion decides which side it is."""
    mechanism = slider("5.0 - 3*sign(u.x)")
    run = dc.simulate(mechanism, mechanism.state(), 1.0, 0.125, FixedStep("ode4", switches=True))
    assert run.q[-1, 0] == pytest.approx(1.0, abs=1e-13)


def test_switches_and_impacts_together() -> None:
    mechanism = dc.Mechanism(
        bodies=[dc.point_mass("mass", 1.0)],
        joints=[dc.prismatic("x", "ground", "mass", axis="x")],
        forces=[dc.forces.joint_torque("motor", "x", "-1.0 - 0.3*sign(u.x)")],
        events=[dc.events.joint_stop("wall", "x", lower=0.0, restitution=0.9)],
    )
    start = mechanism.state({"x": 1.0}, speeds={"x": -0.1})
    run = dc.simulate(mechanism, start, 4.0, 0.05, FixedStep("ode4", switches=True))
    # Down from 1 with −0.7: v² = 0.01 + 1.4; up with 0.81 of it against −1.3.
    hit, top = run.events[:2]
    assert hit.t == pytest.approx((math.sqrt(1.41) - 0.1) / 0.7, abs=1e-12)
    assert hit.energy_lost == pytest.approx(0.5 * 1.41 * 0.19, abs=1e-12)
    assert top.q[0] == pytest.approx(0.81 * 1.41 / 2.6, abs=1e-12)
    for work in ("in-loop", "samples"):
        ledger = dc.balance(mechanism, run, work=work)
        assert max(np.abs(d).max() for d in ledger.delta_c.values()) < 1e-11


@pytest.mark.parametrize(
    "options", [FixedStep("ode4", switches=True), Scipy(switches=True)], ids=str
)
def test_switches_in_a_loop_whose_parameters_vary(options: FixedStep | Scipy) -> None:
    """Sides of laws follow the parameters that are kept as symbols; the motion is that of plain numbers."""
    mechanism = dc.Mechanism(
        bodies=[
            dc.bodies.rod("crank", "m", 1.0),
            dc.bodies.rod("rod", "m", 2.0),
            dc.bodies.point_mass("slider", 1.5),
        ],
        joints=[
            dc.joints.revolute("crank", "ground", "crank"),
            dc.joints.revolute("pin", "crank", "rod", position=(1.0, 0.0, 0.0)),
            dc.joints.prismatic("slide", "ground", "slider", "x"),
        ],
        forces=[dc.forces.joint_torque("rub", "slide", "-3*sign(u.slide)")],
        constraints=[dc.constraints.loop_spherical("wrist", "rod", "slider", point1=(2.0, 0, 0))],
        parameters={"m": 1.0},
    )
    guess = mechanism.state({"crank": 1.0, "pin": -1.4, "slide": 2.3}, {"crank": -5.0})
    state = dc.assemble(mechanism, guess, pinned=("crank",)).state
    runs = [
        dc.simulate(model, state, 0.5, 2e-3, options)
        for model in (mechanism, mechanism.varying("m"))
    ]
    assert runs[0].events[0].t == pytest.approx(runs[1].events[0].t, abs=1e-12)
    np.testing.assert_allclose(runs[0].q, runs[1].q, atol=1e-10)


def test_a_switch_within_a_switch_follows_it() -> None:
    """|q − ½ sign u| has a side that jumps with u's; the motion is that of tiny steps across both."""
    mechanism = dc.Mechanism(
        bodies=[dc.bodies.point_mass("m", 1.0)],
        joints=[dc.joints.prismatic("x", "ground", "m", "x")],
        forces=[dc.forces.joint_torque("law", "x", "-9*q.x - 2*abs(q.x - 0.5*sign(u.x))")],
    )
    state = mechanism.state({"x": 0.2}, {"x": 1.0})
    run = dc.simulate(mechanism, state, 3.0, 0.02, FixedStep("ode8", switches=True))
    fine = dc.simulate(mechanism, state, 3.0, 1e-4, "ode4", record=100)
    assert run.provenance.completed
    assert len(run.events) > 3
    np.testing.assert_allclose(run.q[-1], fine.q[-1], atol=1e-3)


@pytest.mark.parametrize("hold", [True, False])
def test_switches_with_a_controller(hold: bool) -> None:
    """A controller that says what a law says leaves the switches where they are."""
    law = dc.forces.joint_torque("rub", "x", "-2*q.x - 0.05*sign(u.x)")
    model = slider("0.2")
    by_law = replace(model, forces=(law, *model.forces))
    free = replace(model, forces=(law, dc.forces.joint_torque("motor", "x")))
    controller = dc.Controller(lambda t, q, u: {"motor": 0.2}, hold=hold)
    start = free.state({"x": 1.0}, speeds={"x": 0.1})
    options = FixedStep("ode8", switches=True)
    expected = dc.simulate(by_law, start, 2.0, 0.02, options)
    run = dc.simulate(free, start, 2.0, 0.02, options, controller=controller)
    assert [e.t for e in run.events] == pytest.approx([e.t for e in expected.events], abs=1e-9)
    np.testing.assert_allclose(run.q, expected.q, atol=1e-12)


@pytest.mark.parametrize("compiled", [None, False])
def test_events_of_equations_in_their_own_coordinates(compiled: bool | None) -> None:
    """ẍ = −x in s = 2x: u passes zero at π/2, and so does the law's sign."""
    mechanism = replace(slider("-q.x - 0.1*sign(u.x)"), events=(dc.events.event("turn", "u.x"),))
    own = dc.CoordinateMap(("s",), q={"x": "0.5*q.s"})
    equations = dc.Equations(lambda t, q, u: np.array([-q[0]]), own, compiled=compiled)
    start = mechanism.state(speeds={"x": 1.0})
    for switches in (False, True):
        run = dc.simulate(
            mechanism, start, 2.0, 0.02, FixedStep("ode8", switches=switches), equations=equations
        )
        assert [e.t for e in run.events] == pytest.approx([math.pi / 2], abs=1e-10)
        np.testing.assert_allclose(run.q[:, 0], np.sin(run.t), atol=1e-12)
