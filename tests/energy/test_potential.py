"""ΔC with another V(q, t) than the potential energy: (V, G_r) as in (2.1.3)-(2.1.4) of the thesis."""

from __future__ import annotations

import numpy as np
import pytest

import deltac as dc
from deltac.errors import ArgumentsError, InputError

FUNCTIONS = ("kane-levinson-1988", "kane-levinson-1990", "liu-huston", "wang")


def test_without_a_potential_all_forces_are_integrated() -> None:
    """V = 0 and v_t = 0: E = K and P = Σ F_r u_r, which is Liu and Huston's function."""
    pendulum = dc.problems.load("triple-pendulum")
    run = dc.simulate(pendulum, None, 2.0, 0.01, "ode4")
    ledger = dc.balance(pendulum, run, testing=FUNCTIONS, potential="0")
    scale = ledger.energy_exchanged
    for name in FUNCTIONS:
        np.testing.assert_allclose(
            ledger.delta_c[name], ledger.delta_c["liu-huston"], rtol=0, atol=1e-14 * scale
        )
    usual = dc.balance(pendulum, run, work="samples", testing=FUNCTIONS)
    assert np.abs(usual.delta_c["wang"] - ledger.delta_c["wang"]).max() > 1e-9
    np.testing.assert_array_equal(usual.potential_energy, ledger.potential_energy)


@pytest.mark.parametrize(
    "V",
    [
        "0",
        "-0.3*cos(q.slide)",
        "2*q.slide**2 + sin(3*t)",
        "q.shaft*q.slide",
    ],
)
def test_any_potential_serves(V: str) -> None:
    """A bead on a driven hoop: its motion is exact to 1e-12 J, so no V may show more than its error bar."""
    hoop = dc.problems.load("bead-on-hoop")
    run = dc.simulate(hoop, None, 5.0, 1e-3, "ode8", FUNCTIONS)
    ledger = dc.balance(hoop, run, testing=FUNCTIONS, potential=V)
    for name in FUNCTIONS:
        assert np.all(np.abs(ledger.delta_c[name]) <= ledger.error_bar[name] + 1e-11), name


def test_wrong_equations_show_the_same_whatever_the_potential() -> None:
    """ε does not depend on V: where q̇ = u holds, ΔC is the closed form's, −2 g₂ (cos θ₂ − cos θ₂(0))."""
    pendulum = dc.problems.load("triple-pendulum", mistake=True)
    equations = pendulum.equations
    run = dc.simulate(pendulum, None, 1.0, 1e-3, "ode8", equations=equations)
    cosine = np.cos(run.q[:, 0] + run.q[:, 1])
    exact = -2 * 8.75 * (cosine - cosine[0])
    for V in ("0", "-10*cos(q.joint1)", "t*q.joint3"):
        ledger = dc.balance(pendulum, run, testing=FUNCTIONS, potential=V)
        for name in FUNCTIONS:
            assert np.abs(ledger.delta_c[name] - exact).max() < 1e-8, (V, name)


def test_the_potential_decides_what_an_error_of_the_coordinates_shows() -> None:
    """Euler's q̇ = u is off by h u̇/2: V compares coordinates, the integral of F u does not."""
    pendulum = dc.problems.load("triple-pendulum")
    run = dc.simulate(pendulum, None, 2.0, 1e-3, "ode1")
    usual = dc.balance(pendulum, run, work="samples", testing=("wang",)).delta_c["wang"]
    other = dc.balance(pendulum, run, testing=("wang",), potential="0").delta_c["wang"]
    assert abs(usual[-1]) > 0.1 and abs(other[-1]) < 0.6 * abs(usual[-1])


def test_a_driven_joint_whose_torque_was_measured() -> None:
    """Both variants of Wang's function take the same V."""
    pivot = dc.problems.load("driven-pendulum")
    run = dc.simulate(pivot, None, 2.0, 1e-3, "ode8")
    ledger = dc.balance(pivot, run, potential="t**2")
    assert {"wang", "wang-inertial"} <= set(ledger.delta_c)
    for name, values in ledger.delta_c.items():
        assert np.all(np.abs(values) <= ledger.error_bar[name] + 1e-11), name


def test_what_is_no_potential() -> None:
    pendulum = dc.problems.load("triple-pendulum")
    run = dc.simulate(pendulum, None, 0.1, 0.01, "ode4")
    for V, message in (
        ("u.joint1", "potential.*u.joint1"),
        ("q.knee", "potential.*q.knee"),
        ("1 +", "potential"),
    ):
        with pytest.raises(InputError, match=message):
            dc.balance(pendulum, run, potential=V)
    with pytest.raises(ArgumentsError, match="potential.*'in-loop'; leave work out"):
        dc.balance(pendulum, run, work="in-loop", potential="0")
