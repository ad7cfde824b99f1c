"""Discrete work h fᵀ(u_k + u_{k+1})/2 of engines that hold a force over a step."""

from __future__ import annotations

import numpy as np
import pytest

import deltac as dc
from tests.systems.machines import pendulum


def slider() -> dc.Mechanism:
    """Two masses on a line with springs, dampers and a force: M is constant, and so are partial speeds."""
    return dc.Mechanism(
        [dc.bodies.box("one", 1.0, [1, 1, 1]), dc.bodies.box("two", 2.0, [1, 1, 1])],
        [
            dc.prismatic("first", "ground", "one", "z", stiffness=30.0, damping=0.2),
            dc.prismatic("second", "one", "two", "z", stiffness="20 + 5*sin(t)", rest=0.1),
        ],
        [
            dc.forces.joint_torque("push", "first", "cos(3*t)"),
            dc.forces.joint_damper("slow", "second", "u.second**2"),
        ],
        gravity=[0, 0, -9.81],
    )


@pytest.mark.parametrize("solver", ["ode1", "semi-implicit-euler"])
def test_liu_huston_closes_to_rounding_at_any_step(solver: str) -> None:
    """M (u₊ − u) = h f, times (u₊ + u)/2: an identity of the scheme."""
    mechanism = slider()
    start = mechanism.state({"first": 0.2, "second": -0.1})
    for h in (0.1, 0.01):
        run = dc.simulate(mechanism, start, 2.0, h, solver)
        ledger = dc.balance(mechanism, run, work="discrete")
        assert ledger.method == "discrete"
        scale = ledger.kinetic.max() + max(np.abs(w).max() for w in ledger.work.values())
        assert np.abs(ledger.delta_c["liu-huston"]).max() < 1e-13 * scale
        assert np.abs(ledger.delta_c["wang"]).max() > 1e-4 * scale  # the real error, of order h


def test_wang_keeps_showing_an_error_of_first_order() -> None:
    mechanism = slider()
    start = mechanism.state({"first": 0.2, "second": -0.1})
    sizes = [
        np.abs(
            dc.balance(
                mechanism,
                dc.simulate(mechanism, start, 2.0, h, "semi-implicit-euler"),
                work="discrete",
            ).delta_c["wang"]
        ).max()
        for h in (1e-3, 5e-4)
    ]
    assert np.log2(sizes[0] / sizes[1]) == pytest.approx(1.0, abs=0.15)


def test_a_withheld_channel_shows_at_once() -> None:
    mechanism = slider()
    run = dc.simulate(mechanism, mechanism.state(), 1.0, 0.01, "semi-implicit-euler")
    forgetful = dc.Mechanism(
        mechanism.bodies, mechanism.joints, mechanism.forces[:1], gravity=mechanism.gravity
    )
    whole = dc.balance(mechanism, run, work="discrete")
    less = dc.balance(forgetful, run, work="discrete")
    np.testing.assert_allclose(
        less.delta_c["liu-huston"] - whole.delta_c["liu-huston"],
        whole.work["damper slow"],
        atol=1e-12,
    )
    assert np.abs(whole.work["damper slow"]).max() > 1e-3


def test_works_by_hand() -> None:
    mechanism = pendulum()
    run = dc.simulate(mechanism, mechanism.state({"hinge": 1.0}), 0.5, 0.01, "ode1")
    ledger = dc.balance(mechanism, run, work="discrete")
    q, u = run.q[:, 0], run.u[:, 0]
    moment = -2.0 * 9.81 * 0.5 * np.sin(q)
    expected = np.r_[0, np.cumsum(0.01 * moment[:-1] * (u[1:] + u[:-1]) / 2)]
    np.testing.assert_allclose(ledger.work["gravity"], expected, atol=1e-13)
