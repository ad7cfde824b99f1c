"""Runs with constraints that move: what they do is work, and the ledger books it."""

from __future__ import annotations

import numpy as np
import pytest

import deltac as dc
from deltac.energy import balance
from tests.systems.linkages import ALL, linkage


def on_table(motion: str, turning: float) -> tuple[dc.Mechanism, dc.State]:
    """A ball on a table that turns (a belt velocity of the ground's plane) and rises."""
    ball = dc.bodies.sphere("ball", 0.5, 0.1)
    contact = dc.constraints.rolling(
        "contact",
        "ball",
        tube=0.1,
        point=[0, 0, motion],
        surface_velocity=[f"-{turning}*y", f"{turning}*x", 0],
    )
    mechanism = dc.Mechanism(
        [ball], [dc.free("base", "ball")], constraints=[contact], gravity=[0, 0, -9.81]
    )
    guess = mechanism.state({"base.x": 0.5, "base.z": 0.1}, {"base.vx": 0.2})
    return mechanism, dc.assemble(mechanism, guess, ("base.x", "base.y", "base.vx")).state


def test_a_ball_on_a_turning_table_runs_on_a_circle() -> None:
    """Weltner: the centre turns at 2/7 Ω; the table does work on it, so K + V alone fails."""
    Omega = 2.0
    mechanism, state = on_table("0", Omega)
    run = dc.simulate(mechanism, state, 5.0, 0.005, "ode5", ALL)
    ledger = balance(mechanism, run)
    v0 = state.u[0] + 1j * state.u[1]
    v = run.u[:, 0] + 1j * run.u[:, 1]
    # v̇ = (2/7) Ω i v, so v turns at 2/7 Ω; ode5 has its own 1e-10 here.
    np.testing.assert_allclose(v, v0 * np.exp(2j / 7 * Omega * run.t), atol=1e-9)
    for function in ALL:
        assert np.abs(ledger.delta_c[function]).max() < 1e-9
    mechanical = ledger.kinetic + ledger.potential_energy
    assert np.ptp(mechanical) > 1e-2
    np.testing.assert_allclose(
        mechanical - mechanical[0], ledger.work["constraint contact"], atol=1e-8
    )


@pytest.mark.long
def test_a_ball_on_a_rising_table_is_lifted_by_the_contact() -> None:
    """m (g + z̈) ż is the power of the vertical multiplier: leaving it out fails by joules."""
    mechanism, state = on_table("0.2*sin(2*t)", 2.0)
    run = dc.simulate(mechanism, state, 2.0, 0.005, "ode5", ALL)
    ledger = balance(mechanism, run)
    t = run.t
    lift = 0.5 * (9.81 - 0.8 * np.sin(2 * t)) * 0.4 * np.cos(2 * t)
    level, at_rest = on_table("0", 2.0)
    flat = balance(level, dc.simulate(level, at_rest, 2.0, 0.005, "ode5", ALL))
    turned = flat.power["constraint contact"]
    np.testing.assert_allclose(ledger.power["constraint contact"], lift + turned, atol=1e-8)
    for function in ALL:
        assert np.abs(ledger.delta_c[function]).max() < 1e-9
    assert np.ptp(ledger.delta_c["wang"] + ledger.work["constraint contact"]) > 0.5


def driven(how: str) -> tuple[dc.Mechanism, dc.State]:
    """The crank-rocker driven by its crank, with a bob hanging on the coupler that is left to swing."""
    plain, _ = linkage()
    law = "1 + 0.8*sin(2*t)"
    joints, constraints = list(plain.joints), list(plain.constraints)
    if how == "joint":
        joints[0] = dc.revolute("input", "ground", "crank", "z", motion=law)
    else:
        constraints.append(dc.constraints.holonomic("held", f"q.input - ({law})"))
    joints.append(dc.revolute("swing", "coupler", "bob", "z", position=[0.5, 0, 0]))
    bob = dc.point_mass("bob", 0.7, [0.3, 0, 0])
    mechanism = dc.Mechanism(
        [*plain.bodies, bob], joints, constraints=constraints, gravity=[0, -9.81, 0]
    )
    guess = {"knee": -0.4, "output": 1.5, "swing": -1.0}
    if how == "constraint":
        guess["input"] = 1.0
    return mechanism, dc.assemble(mechanism, mechanism.state(guess), ("swing",)).state


@pytest.mark.long
def test_the_same_drive_told_two_ways() -> None:
    """A prescribed hinge inside a loop, and the same angle held by a constraint that moves."""
    runs = {}
    for how in ("joint", "constraint"):
        mechanism, state = driven(how)
        run = dc.simulate(mechanism, state, 1.0, 0.004, "ode8", ALL)
        runs[how] = (run, balance(mechanism, run))
        for function in ALL:
            assert np.abs(runs[how][1].delta_c[function]).max() < 1e-10
    (one, by_joint), (two, by_constraint) = runs["joint"], runs["constraint"]
    places = [one.coordinates.index(name) for name in two.coordinates]
    np.testing.assert_allclose(one.q[:, places], two.q, atol=1e-11)
    # The multiplier is the driving torque.
    np.testing.assert_allclose(
        by_joint.power["prescribed input"], by_constraint.power["constraint held"], atol=1e-8
    )
    assert np.abs(by_joint.power["prescribed input"]).max() > 1.0
