"""Mechanisms without freedom: cranks, playback, and the forces that drove them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp

import deltac as dc
from deltac.errors import InputError
from tests.fuzz import driven
from tests.support.slow import repeated

ALL = ("kane-levinson-1988", "kane-levinson-1990", "liu-huston", "wang")
CRANK, ROD, SPEED = 0.1, 0.3, 20.0
MASSES, MOMENTS = (0.4, 0.6, 0.8), (4e-4, 5e-3)


def slider_crank(motion: str = "w*t", rod: float = ROD) -> dc.Mechanism:
    return dc.Mechanism(
        bodies=[
            dc.body(
                "crank", MASSES[0], mass_centre=(CRANK / 2, 0, 0), inertia=(1e-4, *MOMENTS[:1] * 2)
            ),
            dc.body(
                "rod", MASSES[1], mass_centre=(rod / 2, 0, 0), inertia=(1e-4, *MOMENTS[1:] * 2)
            ),
            dc.point_mass("slider", MASSES[2]),
        ],
        joints=[
            dc.revolute("A", "ground", "crank", motion=motion),
            dc.revolute("B", "crank", "rod", position=(CRANK, 0, 0)),
            dc.prismatic("C", "ground", "slider", "x"),
        ],
        constraints=[dc.constraints.loop_spherical("pin", "rod", "slider", point1=(rod, 0, 0))],
        gravity=(0, -9.81, 0),
        parameters={"w": SPEED},
    )


def closed_form() -> tuple[sp.Expr, sp.Expr]:
    """Slider's place and the crank's torque of time: the drive feeds what K + V gains."""
    t = sp.symbols("t")
    a = SPEED * t
    b = -sp.asin(CRANK * sp.sin(a) / ROD)
    x = CRANK * sp.cos(a) + ROD * sp.cos(b)
    centres = [
        (CRANK / 2 * sp.cos(a), CRANK / 2 * sp.sin(a)),
        (CRANK * sp.cos(a) + ROD / 2 * sp.cos(b), CRANK * sp.sin(a) + ROD / 2 * sp.sin(b)),
        (x, sp.Integer(0)),
    ]
    energy = sum(
        m * (sp.diff(cx, t) ** 2 + sp.diff(cy, t) ** 2) / 2 + 9.81 * m * cy
        for m, (cx, cy) in zip(MASSES, centres)
    )
    energy += sum(J * sp.diff(angle, t) ** 2 / 2 for J, angle in zip(MOMENTS, (a, b)))
    return x, sp.diff(energy, t) / SPEED


def start(mechanism: dc.Mechanism) -> dc.State:
    return dc.assemble(mechanism, {"C": CRANK + ROD}).state


@pytest.mark.parametrize(
    "solver",
    [
        "ode1",
        "ode4",
        "generalized-alpha",
        "DOP853",
        "IDAS",
        *repeated(("implicit-midpoint", "Radau", "CVODES")),
    ],
)
def test_slider_crank_by_closed_form(solver: str) -> None:
    """Places are assembled, so exact whatever the solver; torques follow from them alone."""
    mechanism = slider_crank()
    run = dc.simulate(mechanism, start(mechanism), 0.4, 1e-3, solver, ALL)
    t = sp.symbols("t")
    x, torque = (sp.lambdify(t, e)(run.t) for e in closed_form())
    np.testing.assert_allclose(run.q[:, 2], x, atol=1e-12)
    np.testing.assert_allclose(run.forces["prescribed A"][:, 0], torque, atol=1e-9)
    ledger = dc.balance(mechanism, run)
    allowed = {"ode1": 0.1, "generalized-alpha": 1e-4, "implicit-midpoint": 1e-4}.get(solver, 1e-6)
    for name in ALL:
        assert np.abs(ledger.delta_c[name]).max() < allowed * ledger.energy_exchanged
    for name, rate in dc.residuals(mechanism, run).items():
        assert np.abs(rate).max() < 1e-7, name


@pytest.mark.parametrize("name", ALL)
def test_order_of_delta_c(name: str) -> None:
    """Simpson's rule on smooth powers: halving the step leaves a sixteenth."""
    mechanism = slider_crank("w*t + 0.1*sin(30*t)")
    left = [
        np.abs(dc.balance(mechanism, run, testing=[name]).delta_c[name]).max()
        for h in (2e-3, 1e-3)
        for run in [dc.simulate(mechanism, start(mechanism), 0.4, h, "ode4", ALL)]
    ]
    assert 14 < left[0] / left[1] < 20


def test_prescribed_revolute() -> None:
    """A single joint: no state but integrals. τ = J θ̈ + m g c cos θ."""
    mechanism = dc.Mechanism(
        bodies=[dc.body("bar", 0.5, mass_centre=(0.3, 0, 0), inertia=(0.01, 0.02, 0.03))],
        joints=[dc.revolute("j", "ground", "bar", motion="3*t + 0.2*sin(5*t)")],
        gravity=(0, -9.81, 0),
    )
    for solver in ("ode4", "implicit-midpoint", "DOP853", "taylor"):
        run = dc.simulate(mechanism, mechanism.state(), 1.0, 1e-2, solver)
        angle, pull = 3 * run.t + 0.2 * np.sin(5 * run.t), -5 * np.sin(5 * run.t)
        torque = (0.03 + 0.5 * 0.09) * pull + 0.5 * 9.81 * 0.3 * np.cos(angle)
        np.testing.assert_allclose(run.forces["prescribed j"][:, 0], torque, atol=1e-12)
        assert dc.audit(mechanism, run).exit_code == 0
    assert not dc.simulate(mechanism, mechanism.state(), 1.0, 1e-2, "ode4", ()).integrals


@pytest.mark.parametrize("seed", range(10))
def test_against_newton_and_euler(seed: int) -> None:
    """Random driven trees and four-bars, some flat on the way: `tests.fuzz.driven`."""
    assert driven.judged(seed) == "right"


@pytest.mark.parametrize("solver", ["ode4", "DOP853", "implicit-midpoint"])
@pytest.mark.parametrize("offset", [0.3, -1.0])
def test_through_singular_positions_by_continuity(solver: str, offset: float) -> None:
    """A slider-crank of equal links: the slider passes the crank's axis, where it could also stay."""
    mechanism = slider_crank(f"w*t + {offset!r}", CRANK)
    guess = {"B": -2 * offset, "C": 2 * CRANK * np.cos(offset)}
    run = dc.simulate(mechanism, dc.assemble(mechanism, guess).state, 0.5, 1e-3, solver)
    a = SPEED * run.t + offset
    np.testing.assert_allclose(run.q, np.c_[a, -2 * a, 2 * CRANK * np.cos(a)], atol=1e-10)


def test_locked_mechanism_and_end_of_reach() -> None:
    """Without a drive nothing moves; a drive that goes on where links cannot follow ends the run."""
    locked = replace(
        slider_crank(),
        joints=[replace(joint, motion=()) for joint in slider_crank().joints],
        constraints=[*slider_crank().constraints, dc.constraints.holonomic("held", "q.A")],
    )
    with pytest.raises(InputError, match="nothing drives it"):
        dc.simulate(locked, start(locked), 0.1, 1e-3, "ode4")
    short = slider_crank("w*t", 0.08)
    with pytest.warns(dc.SimulationStoppedWarning, match="can no longer be met"):
        run = dc.simulate(short, dc.assemble(short, {"C": 0.18}).state, 0.2, 1e-3, "ode4")
    assert run.t[-1] == pytest.approx(np.arcsin(0.8) / SPEED, abs=2e-3)


def test_inverse_dynamics_of_a_recorded_motion() -> None:
    """The torque of the crank by closed form, from a log without accelerations and forces."""
    mechanism = slider_crank()
    run = dc.simulate(mechanism, start(mechanism), 0.4, 5e-4, "ode4")
    recorded = replace(run, udot=None, forces={}, integrals={}, works={})
    free = replace(mechanism, joints=[replace(joint, motion=()) for joint in mechanism.joints])
    _, torque = closed_form()
    expected = sp.lambdify(sp.symbols("t"), torque)(run.t)
    found = dc.inverse_dynamics(free, recorded, ["A"])
    assert list(found.forces) == ["actuator A"]
    np.testing.assert_allclose(found.forces["actuator A"][:, 0], expected, atol=1e-5)
    assert np.abs(found.residual).max() < 1e-9 and not len(found.singular)
    audit = dc.audit(free, found.run)
    assert audit.exit_code == 0
    again = dc.inverse_dynamics(mechanism, run)
    for name, force in {**again.forces, **again.constraints}.items():
        np.testing.assert_allclose(force, run.forces[name], atol=1e-11)


def test_inverse_dynamics_says_what_is_not_determined() -> None:
    mechanism = slider_crank()
    run = dc.simulate(mechanism, start(mechanism), 0.1, 1e-3, "ode4")
    with pytest.raises(InputError, match="are not determined by the motion"):
        dc.inverse_dynamics(mechanism, run, ["A", "C"])
    with pytest.raises(InputError, match="no joint that moves is called 'a'"):
        dc.inverse_dynamics(mechanism, run, ["a"])
    # A motion that the drive cannot make: the slider is pushed by a force that nobody declares.
    free = replace(
        mechanism,
        joints=[replace(joint, motion=()) for joint in mechanism.joints],
        constraints=(),
    )
    found = dc.inverse_dynamics(free, replace(run, forces={}), ["A", "B"])
    assert run.udot is not None
    np.testing.assert_allclose(found.residual[:, 2], MASSES[2] * run.udot[:, 2], rtol=1e-9)
