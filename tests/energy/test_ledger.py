"""The ledger: what it holds, what it makes of logs that lack or contradict something."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.energy import residuals
from deltac.errors import InputError
from tests.systems.machines import pendulum, robot, workshop


@pytest.fixture(scope="module")
def driven() -> tuple[dc.Mechanism, dc.Trajectory]:
    """A pendulum on a cart that is shaken: small, with a prescribed joint and a damper."""
    mechanism = dc.Mechanism(
        [dc.bodies.frame("cart"), dc.point_mass("bob", 2.0, [0, 0, -0.5])],
        [
            dc.prismatic("shake", "ground", "cart", "x", motion="0.1*sin(5*t)"),
            dc.revolute("hinge", "cart", "bob", "y", damping=0.1),
        ],
        gravity=[0, 0, -9.81],
    )
    start = mechanism.state({"hinge": 0.7})
    return mechanism, dc.simulate(mechanism, start, 2.0, 0.005, "ode8")


def by_hand(run: dc.Trajectory) -> dict[str, Any]:
    """Energies and powers of the shaken pendulum, from elementary mechanics."""
    m, l, g, c = 2.0, 0.5, 9.81, 0.1
    x, v, a = 0.1 * np.sin(5 * run.t), 0.5 * np.cos(5 * run.t), -2.5 * np.sin(5 * run.t)
    q, u = run.coordinate("hinge"), run.speed("hinge")
    # About +y an angle q takes the bob at −z to −x: x_bob = x − l sin q, z_bob = −l cos q.
    udot = (g * np.sin(-q) * m * l + m * l * np.cos(q) * a - c * u) / (m * l**2)
    vx, vz = v - l * np.cos(q) * u, l * np.sin(q) * u
    ax = a - l * np.cos(q) * udot + l * np.sin(q) * u**2
    return {
        "x": x,
        "K": 0.5 * m * (vx**2 + vz**2),
        "K0": 0.5 * m * v**2,
        "V": -m * g * l * np.cos(q),
        "gravity": -m * g * vz,
        "damper": -c * u**2,
        "drive": m * ax,
        "drive power": m * ax * v,
        "udot": udot,
    }


def test_energies_and_powers_against_elementary_mechanics(driven: Any) -> None:
    mechanism, run = driven
    ledger, hand = dc.balance(mechanism, run), by_hand(run)
    assert run.udot is not None
    np.testing.assert_allclose(run.udot[:, 1], hand["udot"], atol=1e-12)
    np.testing.assert_allclose(ledger.kinetic, hand["K"], atol=1e-13)
    np.testing.assert_allclose(ledger.K0, hand["K0"], atol=1e-13)
    np.testing.assert_allclose(ledger.K2, 0.5 * 2 * 0.25 * run.u[:, 1] ** 2, atol=1e-13)
    np.testing.assert_allclose(ledger.potential["gravity"], hand["V"], atol=1e-13)
    np.testing.assert_allclose(ledger.potential_energy, hand["V"], atol=1e-13)
    np.testing.assert_allclose(ledger.power["gravity"], hand["gravity"], atol=1e-12)
    np.testing.assert_allclose(ledger.power["damper hinge"], hand["damper"], atol=1e-13)
    np.testing.assert_allclose(run.forces["prescribed shake"][:, 0], hand["drive"], atol=1e-11)
    np.testing.assert_allclose(ledger.power["prescribed shake"], hand["drive power"], atol=1e-11)
    assert set(ledger.work) == {"gravity", "damper hinge", "prescribed shake"}


def test_works_are_integrals_of_powers(driven: Any) -> None:
    """Against Simpson's rule, whose error is of order h⁴."""
    from scipy.integrate import cumulative_simpson

    mechanism, run = driven
    ledger = dc.balance(mechanism, run)
    for name, work in ledger.work.items():
        simpson = cumulative_simpson(ledger.power[name], x=run.t, initial=0)
        np.testing.assert_allclose(work, simpson, atol=1e-6)
    np.testing.assert_allclose(
        ledger.work["gravity"],
        ledger.potential["gravity"][0] - ledger.potential["gravity"],
        atol=1e-9,
    )


def test_energy_exchanged_by_its_definition(driven: Any) -> None:
    mechanism, run = driven
    ledger, hand = dc.balance(mechanism, run), by_hand(run)
    flow = sum(np.abs(hand[name]) for name in ("gravity", "damper", "drive power"))
    expected = np.trapezoid(flow, run.t) + np.ptp(hand["K"]) + np.ptp(hand["V"])
    # Trapezoids err by the square of the spacing; what goes to and fro within an interval is not counted.
    assert ledger.energy_exchanged == pytest.approx(expected, rel=1e-3)
    assert ledger.energy_exchanged <= expected * (1 + 1e-12)
    largest = np.abs(ledger.delta_c["wang"]).max()
    assert ledger.relative("wang") == pytest.approx(largest / ledger.energy_exchanged, rel=1e-9)


def test_in_loop_and_samples_agree_within_bars() -> None:
    for machine in (robot, workshop):
        mechanism, state = machine()
        run = dc.simulate(mechanism, state, 1.0, 0.005, "ode5")
        loop = dc.balance(mechanism, run)
        assert loop.method == "in-loop" and set(loop.delta_c) >= {"wang", "liu-huston"}
        samples = dc.balance(mechanism, run, "samples", ("wang", "liu-huston"))
        for name in loop.delta_c:
            # The solver's own quadrature is as wrong as its ΔC.
            slack = 2 * np.abs(loop.delta_c[name]).max()
            difference = np.abs(samples.delta_c[name] - loop.delta_c[name])
            assert (difference <= samples.error_bar[name] + slack).all()
            assert samples.error_bar[name].max() < 1e-4 * samples.energy_exchanged


# --- logs with less or other content ----------------------------------------------------------------


def test_a_log_without_accelerations_says_they_are_derived(driven: Any) -> None:
    mechanism, run = driven
    ledger = dc.balance(mechanism, replace(run, udot=None), "samples", ("wang", "liu-huston"))
    assert ledger.basis["u̇"] == "derived"
    for name, values in ledger.delta_c.items():
        assert (np.abs(values) <= ledger.error_bar[name] + 1e-9).all(), name
    with pytest.raises(InputError, match="residuals need the accelerations"):
        residuals(mechanism, replace(run, udot=None))


def test_a_decimated_log_has_wider_bars_and_still_closes(driven: Any) -> None:
    mechanism, run = driven
    bars = []
    for stride in (1, 4, 16):
        ledger = dc.balance(mechanism, run.every(stride), "samples", ("liu-huston",))
        assert (
            np.abs(ledger.delta_c["liu-huston"]) <= ledger.error_bar["liu-huston"] + 1e-11
        ).all()
        bars.append(ledger.error_bar["liu-huston"].max())
    assert bars[0] < bars[1] < bars[2]


def test_a_wrong_model_shows_beyond_its_bar(driven: Any) -> None:
    _, run = driven
    wrong = dc.Mechanism(
        [dc.bodies.frame("cart"), dc.point_mass("bob", 2.0, [0, 0, -0.51])],
        [
            dc.prismatic("shake", "ground", "cart", "x", motion="0.1*sin(5*t)"),
            dc.revolute("hinge", "cart", "bob", "y", damping=0.1),
        ],
        gravity=[0, 0, -9.81],
    )
    ledger = dc.balance(wrong, run, "samples", ("wang", "liu-huston"))
    for name, values in ledger.delta_c.items():
        assert np.abs(values).max() > 1e3 * ledger.error_bar[name].max()


def test_logged_forces_stand_in_for_the_models(driven: Any) -> None:
    """A log that says the damper took twice as much is believed, and then the ledger does not close."""
    mechanism, run = driven
    force = np.zeros_like(run.u)
    force[:, 1] = -0.1 * run.u[:, 1]
    same = replace(run, forces={**run.forces, "damper hinge": force})
    ledger = dc.balance(mechanism, same, "samples", ("wang",))
    assert ledger.basis["damper hinge"] == "measured"
    assert np.abs(ledger.delta_c["wang"]).max() < ledger.error_bar["wang"].max() + 1e-9
    double = replace(run, forces={**run.forces, "damper hinge": 2 * force})
    off = dc.balance(mechanism, double, "samples", ("wang",))
    lost = -off.work["damper hinge"] / 2
    np.testing.assert_allclose(off.delta_c["wang"], lost, atol=1e-7)
    extra = replace(run, forces={**run.forces, "friction hinge": force})
    more = dc.balance(mechanism, extra, "samples", ("wang",))
    np.testing.assert_allclose(more.delta_c["wang"], lost, atol=1e-7)


def test_a_wrong_logged_drive_is_seen_by_wang_and_not_by_its_inertial_form(driven: Any) -> None:
    mechanism, run = driven
    drive = run.forces["prescribed shake"].copy()
    drive[:, 0] += 0.5
    wrong = replace(run, forces={"prescribed shake": drive})
    ledger = dc.balance(mechanism, wrong, "samples", ("wang", "liu-huston"))
    assert ledger.basis["prescribed shake"] == "measured"
    # 0.5 N over the cart's path.
    np.testing.assert_allclose(
        *(ledger.delta_c["wang"], -0.5 * (run.q[:, 0] - run.q[0, 0])),
        atol=ledger.error_bar["wang"].max(),
    )
    for name in ("wang-inertial", "liu-huston"):
        assert np.abs(ledger.delta_c[name]).max() < 1e-9


def test_a_joint_that_leaves_its_law_is_a_violation(driven: Any) -> None:
    mechanism, run = driven
    ledger = dc.balance(mechanism, run)
    assert ledger.violation["coordinate shake"].max() < 1e-15
    assert ledger.violation["speed shake"].max() < 1e-14
    q, u = run.q.copy(), run.u.copy()
    q[7, 0] += 0.01
    u[9, 0] -= 0.2
    off = dc.balance(mechanism, replace(run, q=q, u=u))
    assert off.violation["coordinate shake"][7] == pytest.approx(0.01)
    assert off.violation["speed shake"][9] == pytest.approx(0.2)
    assert np.delete(off.violation["coordinate shake"], 7).max() < 1e-15


def test_quaternions_off_unit_length_are_a_violation() -> None:
    mechanism = dc.Mechanism([dc.bodies.box("b", 1, [1, 2, 3])], [dc.free("base", "b")])
    run = dc.simulate(mechanism, mechanism.state(speeds={"base": [0, 0, 1, 1, 2, 3]}), 0.2, 0.02)
    q = run.q.copy()
    q[3, 3:] *= 1.1
    ledger = dc.balance(mechanism, replace(run, q=q))
    assert ledger.violation["quaternion base"][3] == pytest.approx(0.1)
    assert np.delete(ledger.violation["quaternion base"], 3).max() < 1e-15


def test_a_motion_in_which_nothing_moves() -> None:
    mechanism = pendulum()
    run = dc.simulate(mechanism, mechanism.state(), 1.0, 0.1, "ode4")
    ledger = dc.balance(mechanism, run)
    assert ledger.energy_exchanged == 0.0
    assert ledger.relative("wang") == 0.0
    assert not ledger.delta_c["wang"].any()
    assert (ledger.error_bar["wang"] > 0).all()  # V is not zero, so neither is its rounding


def test_a_mechanism_prescribed_entirely_passes_anything() -> None:
    """Theory, section 3: the inertial forms are blind there. The driving torque is known all the same."""
    mechanism = pendulum(motion="sin(2*t)")
    t = np.linspace(0, 1, 101)
    q, u = np.sin(2 * t)[:, None], 2 * np.cos(2 * t)[:, None]
    run = dc.Trajectory(t=t, q=q, u=u, coordinates=("hinge",), speeds=("hinge",))
    ledger = dc.balance(mechanism, run, "samples", ("wang", "liu-huston"))
    for values in ledger.delta_c.values():
        assert np.abs(values).max() < 1e-9
    torque = 2.0 * 0.25 * -4 * np.sin(2 * t) + 2 * 9.81 * 0.5 * np.sin(q[:, 0])
    np.testing.assert_allclose(ledger.power["prescribed hinge"], torque * u[:, 0], atol=1e-11)


def test_runs_of_few_samples() -> None:
    mechanism = pendulum()
    start = mechanism.state({"hinge": 1.0})
    for steps in (1, 2, 3, 4, 5, 8):
        run = dc.simulate(mechanism, start, 0.01 * steps, 0.01, "ode8")
        ledger = dc.balance(mechanism, run, "samples", ("liu-huston",))
        bar = ledger.error_bar["liu-huston"]
        assert (np.abs(ledger.delta_c["liu-huston"]) <= bar + 1e-13).all()


def test_everything_is_in_the_table(driven: Any) -> None:
    mechanism, run = driven
    ledger = dc.balance(mechanism, run)
    table = ledger.to_frame()
    assert table.height == len(run)
    for column in (
        *("time", "kinetic", "potential.gravity", "power.damper hinge", "work.prescribed shake"),
        *("work_error.prescribed shake", "delta_c.wang", "error_bar.wang"),
        "violation.coordinate shake",
    ):
        assert column in table.columns
    np.testing.assert_array_equal(table["delta_c.wang"].to_numpy(), ledger.delta_c["wang"])
    assert "wang" in repr(ledger) and "J exchanged" in repr(ledger)


# --- refusals --------------------------------------------------------------------------------------


def refused(words: list[str], mechanism: Any, run: Any, *args: Any, **options: Any) -> None:
    with pytest.raises(InputError) as caught:
        dc.balance(mechanism, run, *args, **options)
    for word in words:
        assert word in str(caught.value)


def test_ways_and_names_that_do_not_exist(driven: Any) -> None:
    mechanism, run = driven
    bare = replace(run, works={}, integrals={})
    refused(["'average'", "in-loop, samples, discrete"], mechanism, run, "average")
    refused(["no integrals", "work='samples'", "testing="], mechanism, bare, "in-loop")
    refused(["'wnag'", "did you mean 'wang'"], mechanism, run, "samples", ("wnag",))
    refused(["'wnag'", "did you mean 'wang'"], mechanism, run, None, ("wnag",))
    refused(
        ["'kane-levinson-1990'", "not integrated in the loop", "wang, liu-huston"],
        *(mechanism, run, "in-loop", ("kane-levinson-1990",)),
    )
    refused(
        ["'kane-levinson-1990'", "discrete"], mechanism, run, "discrete", ("kane-levinson-1990",)
    )
    assert dc.balance(mechanism, bare).method == "samples"
    assert set(dc.balance(mechanism, run, testing="wang").delta_c) >= {"wang"}


def test_runs_of_another_mechanism(driven: Any) -> None:
    mechanism, run = driven
    one = replace(run, coordinates=("shake", "hing"))
    refused(["coordinate 'hing'", "did you mean 'hinge'"], mechanism, one)
    other = replace(run, speeds=("shak", "hinge"))
    refused(["speed 'shak'", "did you mean 'shake'"], mechanism, other)
    turned = replace(run, coordinates=("hinge", "shake"))
    refused(["different order", "hinge, shake", "shake, hinge"], mechanism, turned)
    less = dc.Trajectory(
        t=run.t, q=run.q[:, :1], u=run.u[:, :1], coordinates=("shake",), speeds=("shake",)
    )
    refused(["lacks", "'hinge'"], mechanism, less)
    refused(["single sample", "two"], mechanism, run.between(0.0, 0.0))


def test_motors_whose_force_nobody_knows() -> None:
    mechanism = dc.Mechanism(
        [dc.bodies.box("arm", 1, [1, 1, 1])],
        [dc.revolute("hinge", "ground", "arm")],
        [dc.forces.joint_torque("motor", "hinge")],
    )
    t = np.linspace(0, 1, 11)
    zero = np.zeros((11, 1))
    run = dc.Trajectory(t=t, q=zero, u=zero, coordinates=("hinge",), speeds=("hinge",))
    refused(["'actuator motor'", "no law", "force.actuator motor.<speed>"], mechanism, run)
    dc.balance(mechanism, replace(run, forces={"actuator motor": zero}))
