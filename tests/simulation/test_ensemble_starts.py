"""Where members may start, each by its own parameters; and what is refused, naming the first bad one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.mechanism.state import State
from tests.systems.machines import pendulum


def four_bar() -> dc.Mechanism:
    """A crank, a coupler and a rocker; the coupler is L long, the pivots 1 m apart."""
    return dc.Mechanism(
        [dc.rod("crank", 1.0, 0.4), dc.rod("coupler", 1.0, "L"), dc.rod("rocker", 1.0, 0.8)],
        [
            dc.revolute("a", "ground", "crank"),
            dc.revolute("b", "crank", "coupler", position=(0.4, 0, 0)),
            dc.revolute("c", "ground", "rocker", position=(1, 0, 0)),
        ],
        constraints=[
            dc.constraints.loop_revolute(
                "closing", "coupler", "rocker", point1=("L", 0, 0), point2=(0.8, 0, 0)
            )
        ],
        gravity=(0, -9.81, 0),
        parameters={"L": 1.0},
        name="four-bar",
    )


FOUR_BAR = four_bar()
LENGTHS = np.array([0.9, 1.0, 1.1])


def assembled(L: float = 1.0, crank: float = 1.0) -> State:
    mechanism = FOUR_BAR.with_parameters(L=L)
    guess = mechanism.state({"a": crank, "b": -0.5, "c": 2.0}, {"a": 1.0})
    return dc.assemble(mechanism, guess, pinned=["a"]).state


def gap(L: float, q: np.ndarray) -> np.ndarray:
    """How far apart the ends of coupler and rocker are, world components, by complex numbers."""
    a, b, c = q
    apart = 0.4 * np.exp(1j * a) + L * np.exp(1j * (a + b)) - 1.0 - 0.8 * np.exp(1j * c)
    return np.array([apart.real, apart.imag])


@pytest.mark.long
def test_members_start_by_their_own_parameters() -> None:
    """Also member 0, whose length is not the mechanism's; they stay on their own loops."""
    starts = [assembled(float(L)) for L in LENGTHS]
    runs = dc.simulate_ensemble(FOUR_BAR, starts, 0.2, 1e-3, "ode4", vary={"L": LENGTHS})
    for k, L in enumerate(LENGTHS):
        np.testing.assert_array_equal(runs.q[0, k], starts[k].q)
        assert np.abs(gap(L, runs.q[-1, k])).max() < 1e-12  # projected after each step
        one = dc.simulate(FOUR_BAR.with_parameters(L=float(L)), starts[k], 0.2, 1e-3, "ode4")
        np.testing.assert_allclose(runs.q[-1, k], one.q[-1], rtol=0, atol=1e-11)


def test_a_member_off_its_loop() -> None:
    """The violation told is the larger component of the gap, to the digits shown."""
    good = assembled()
    Q, U = np.array([good.q] * 4), np.zeros((4, 3))
    Q[2, 1] += 0.3
    Q[3, 1] += 0.4
    told = f"member 2 violates constraint 'closing' at position level by {np.abs(gap(1.0, Q[2])).max():.3g}"
    with pytest.raises(dc.InputError, match=told) as caught:
        dc.simulate_ensemble(FOUR_BAR, (Q, U), 1.0, 1e-3)
    assert "deltac.assemble(mechanism, state)" in str(caught.value)


def test_a_member_whose_speeds_violate_its_loop() -> None:
    good = assembled()
    U = np.array([good.u, good.u + [0.0, 0.5, 0.0]])
    with pytest.raises(dc.InputError, match="member 1 violates constraint 'closing' at velocity"):
        dc.simulate_ensemble(FOUR_BAR, (np.array([good.q] * 2), U), 1.0, 1e-3)


def test_one_state_does_for_one_length_only() -> None:
    with pytest.raises(dc.InputError, match="member 1 violates constraint 'closing'") as caught:
        dc.simulate_ensemble(FOUR_BAR, assembled(), 1.0, 1e-3, vary={"L": [1.0, 1.1, 0.9]})
    assert "deltac.assemble(mechanism.with_parameters(L=1.1), state)" in str(caught.value)


def driven() -> dc.Mechanism:
    return dc.Mechanism(
        [dc.point_mass("cart", 1.0), dc.rod("rod", 1.0, 1.0, "-y")],
        [
            dc.prismatic("drive", "ground", "cart", motion="A*cos(t)"),
            dc.revolute("hinge", "cart", "rod"),
        ],
        gravity=(0, -9.81, 0),
        parameters={"A": 0.5},
    )


def test_prescribed_joints_go_by_their_members_parameters() -> None:
    mechanism, amplitudes = driven(), [0.1, 0.2]
    Q, U = np.array([[0.1, 0.3], [0.2, 0.3]]), np.zeros((2, 2))
    runs = dc.simulate_ensemble(mechanism, (Q, U), 0.1, 0.01, vary={"A": amplitudes})
    np.testing.assert_allclose(runs.q[-1, :, 0], np.cos(0.1) * Q[:, 0], rtol=1e-14)
    shared = dc.simulate_ensemble(
        mechanism, mechanism.state({"hinge": 0.3}), 0.1, 0.01, vary={"A": amplitudes}
    )
    np.testing.assert_array_equal(shared.q, runs.q)
    for place, words in (((1, 0), "gives 0.2 at t = 0"), ((0, 0), "gives 0.1 at t = 0")):
        wrong = Q.copy()
        wrong[place] = 0.5
        with pytest.raises(
            dc.InputError, match=f"member {place[0]}: 'drive' is prescribed.*{words}"
        ):
            dc.simulate_ensemble(mechanism, (wrong, U), 0.1, 0.01, vary={"A": amplitudes})
    U[1, 0] = 1.0
    with pytest.raises(dc.InputError, match="member 1: 'drive' is prescribed"):
        dc.simulate_ensemble(mechanism, (Q, U), 0.1, 0.01, vary={"A": amplitudes})


@pytest.mark.parametrize("length", [0.0, 3.0, 1.01])
def test_quaternions_are_of_unit_length(length: float) -> None:
    """As `mechanism.state` has it."""
    mechanism = dc.Mechanism(
        [dc.bodies.box("box", 1.0, (0.1, 0.2, 0.3))], [dc.joints.spherical("ball", "ground", "box")]
    )
    Q = np.array([[0.6, 0.8, 0.0, 0.0]] * 3)
    Q[1] *= length
    for refused in (
        lambda: dc.simulate_ensemble(mechanism, (Q, np.ones((3, 3))), 0.1, 0.01),
        lambda: mechanism.state(Q[1]),
    ):
        with pytest.raises(dc.InputError, match=f"quaternion of joint 'ball'.*length {length:g}"):
            refused()
    Q[1] = [0.6003, 0.8004, 0.0, 0.0]  # 1.0005 long
    runs = dc.simulate_ensemble(mechanism, (Q, np.ones((3, 3))), 0.1, 0.01)
    np.testing.assert_allclose(runs.q[0, 1], [0.6, 0.8, 0, 0], rtol=1e-15)
    np.testing.assert_array_equal(runs.q[0, 0], Q[0])


def test_members_of_states_are_those_of_arrays() -> None:
    mechanism = pendulum()
    angles = [0.1, 0.2, 0.3]
    states = [mechanism.state([q], t=2.0) for q in angles]
    runs = dc.simulate_ensemble(mechanism, states, 0.1, 0.01)
    arrays = dc.simulate_ensemble(mechanism, (np.array([angles]).T, np.zeros((3, 1))), 0.1, 0.01)
    np.testing.assert_array_equal(runs.q, arrays.q)
    np.testing.assert_array_equal(runs.t, [2.0, 2.1])


NAN, INF = float("nan"), float("inf")
PENDULUM = pendulum()
Q, U = np.zeros((3, 1)), np.zeros((3, 1))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"duration": NAN}, ["duration is nan", "positive"]),
        ({"duration": INF}, ["duration is inf", "finite"]),
        ({"duration": "long"}, ["duration is 'long'"]),
        ({"step": "short"}, ["step 'short'", "positive number of seconds"]),
        ({"step": []}, ["step []", "positive number of seconds"]),
        ({"step": [0.1, NAN, 0.1]}, ["expected a positive number"]),
        ({"step": 1e-300}, ["step 1e-300", "1e+300 times", "at most 1e+15 steps", "larger step"]),
        ({"record": 2.0}, ["record is 2.0", "whole number"]),
        ({"record": 0}, ["record: every is 0", "whole number"]),
        ({"threads": 1.5}, ["threads is 1.5", "whole number, 1 or more"]),
        ({"solver": 5}, ["solver is 5", "a name"]),
        ({"solver": []}, ["solver is []", "a name"]),
        ({"solver": ["ode4", 5, "ode4"]}, ["solver is 5", "a name"]),
        ({"states": (np.zeros((0, 1)), np.zeros((0, 1)))}, ["Q has shape (0, 1)", "N at least 1"]),
        ({"states": Q}, ["one array of shape (3, 1)", "(Q, U)"]),
        ({"states": np.zeros((2, 1))}, ["one array of shape (2, 1)", "(Q, U)"]),
        ({"states": (Q, U, Q)}, ["a tuple of 3 entries", "(Q, U)"]),
        ({"states": []}, ["found list", "a sequence of States"]),
        ({"states": None}, ["does not say where its motion starts"]),
        ({"states": ([[0.0], [0.0, 1.0]], U)}, ["Q: expected numbers", "(N, nq)"]),
        ({"states": (Q, "fast")}, ["U: expected numbers", "(N, nu)"]),
        ({"states": [PENDULUM.state(), Q]}, ["member 1 is of type ndarray", "expected a State"]),
        (
            {"states": [PENDULUM.state(), PENDULUM.state(t=0.5)]},
            ["member 1 starts at t = 0.5 s", "member 0 at 0 s", "one time"],
        ),
        (
            {"states": State(0.0, np.zeros(2), np.zeros(1))},
            ["member 0 has 2 coordinates and 1 speeds", "'pendulum' has 1 and 1"],
        ),
        ({"vary": ["m"]}, ["vary is ['m']", "by name"]),
        ({"vary": "m"}, ["vary is 'm'", "by name"]),
    ],
)
def test_bad_input_is_named(change: dict[str, Any], words: list[str]) -> None:
    given = {"states": (Q, U), "duration": 1.0, "step": 0.1, **change}
    with pytest.raises(dc.InputError) as caught:
        dc.simulate_ensemble(PENDULUM, **given)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"step": 1e-300}, ["1e+300 times", "at most 1e+15 steps"]),
        ({"step": 5e-324}, ["inf times", "at most 1e+15 steps"]),
        ({"solver": []}, ["solver is []", "a name"]),
    ],
)
def test_a_single_run_refuses_the_same(options: Mapping[str, Any], words: list[str]) -> None:
    with pytest.raises(dc.InputError) as caught:
        dc.simulate(PENDULUM, PENDULUM.state(), **{"duration": 1.0, "step": 0.1, **options})
    for word in words:
        assert word in str(caught.value)


def test_a_motor_needs_a_law() -> None:
    """There is no controller that could set it."""
    motor = dc.Mechanism(
        PENDULUM.bodies,
        PENDULUM.joints,
        [dc.forces.joint_torque("motor", "hinge")],
        parameters=PENDULUM.parameters,
    )
    with pytest.raises(dc.InputError, match="'motor' has no law"):
        dc.simulate_ensemble(motor, motor.state(), 1.0, 0.1)


@pytest.mark.parametrize("verb", ["simulate", "simulate_ensemble", "balance"])
def test_what_is_no_model(verb: str) -> None:
    run = dc.simulate(PENDULUM, PENDULUM.state(), 0.2, 0.1)
    rest = (run,) if verb == "balance" else (PENDULUM.state(), 1.0, 0.1)
    for given, code in ((None, "E-TYPE"), ("simple-pendulmu", "E-NAME"), (5.0, "E-TYPE")):
        with pytest.raises(dc.InputError) as error:
            getattr(dc, verb)(given, *rest)
        assert error.value.code == code


def test_what_is_no_member_and_no_trajectory() -> None:
    runs = dc.simulate_ensemble(PENDULUM, (Q, U), 0.2, 0.1)
    for k in (1.0, 3, "first"):
        with pytest.raises(dc.InputError, match="there are 3; expected a whole number from 0 to 2"):
            runs.member(k)  # type: ignore[arg-type]
    assert len(runs.member(-1)) == 2 and len(runs.member(np.int64(2))) == 2  # type: ignore[arg-type]
    for given, words in (
        (runs, r"found Ensemble; use ensemble.member\(k\)"),
        ("x.parquet", r"found 'x.parquet'; use deltac.read_trajectory\(file\)"),
        (None, "found NoneType$"),
    ):
        with pytest.raises(dc.InputError, match=f"expected a Trajectory, {words}"):
            dc.balance(PENDULUM, given)  # type: ignore[arg-type]
