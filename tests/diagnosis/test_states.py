"""Random admissible states, and the tests of accelerations at them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings

import deltac as dc
from deltac.diagnosis.residuals.at_states import EquationTest
from deltac.diagnosis.residuals.kane import Kane, times
from deltac.diagnosis.residuals.states import random_states
from tests.oracles.textbook.tree import Textbook
from tests.systems.hand_equations import CASES, lagrange_top, spherical_pendulum
from tests.systems.random_mechanisms import Options, Sample, samples


def test_the_same_seed_gives_the_same_states() -> None:
    mechanism = dc.problems.load("heavy-top").mechanism
    a, b, c = (random_states(mechanism, seed=k) for k in (3, 3, 4))
    assert np.array_equal(a.q, b.q) and np.array_equal(a.u, b.u) and np.array_equal(a.t, b.t)
    assert not np.array_equal(a.q, c.q)
    assert len(a) == 64


def test_quaternions_have_unit_length_and_all_orientations() -> None:
    states = random_states(dc.problems.load("heavy-top").mechanism, count=400)
    assert np.abs(np.linalg.norm(states.q, axis=0) - 1.0).max() < 1e-15
    # Uniform on the sphere: each component has mean 0 and variance 1/4, here within 4 sigma.
    assert np.abs(states.q.mean(axis=1)).max() < 4 * 0.5 / 20
    assert np.abs((states.q**2).mean(axis=1) - 0.25).max() < 4 * 0.18 / 20


@pytest.mark.parametrize("length", [0.01, 1.0, 100.0])
def test_speeds_are_those_of_a_pendulum_of_that_length(length: float) -> None:
    mechanism = dc.Mechanism(
        bodies=[dc.point_mass("bob", 1.0, (0.0, -length, 0.0))],
        joints=[dc.revolute("pin", "ground", "bob")],
        gravity=(0.0, -9.81, 0.0),
    )
    # m l² ω² against m g l |sin q|, whose median over the circle is 1/√2
    rate = Kane(mechanism).scales.rate
    assert rate == pytest.approx(np.sqrt(9.81 / length / np.sqrt(2)), rel=0.3)
    typical = np.sqrt(np.mean(random_states(mechanism, count=200).u ** 2))
    assert 0.7 * rate < typical < 3.0 * rate


def test_a_slide_moves_within_the_length_of_the_mechanism() -> None:
    states = random_states(dc.problems.load("free-particle").mechanism)
    assert 0.5 < np.abs(states.q).max() <= 1.0  # a point has no length: 1 m


def test_states_meet_a_rod_and_its_rate() -> None:
    states = random_states(dc.problems.load("spherical-pendulum").mechanism)
    assert np.abs(np.linalg.norm(states.q, axis=0) - 1.0).max() < 1e-12
    assert np.abs(np.sum(states.q * states.u, axis=0)).max() < 1e-12 * np.abs(states.u).max()
    assert np.abs(states.u).max() > 1.0


def test_states_meet_a_blade() -> None:
    states = random_states(dc.problems.load("chaplygin-sleigh").mechanism)
    lateral = -states.u[0] * np.sin(states.q[2]) + states.u[1] * np.cos(states.q[2])
    assert np.abs(lateral).max() < 1e-14


def test_states_of_every_problem_are_found() -> None:
    for name in dc.problems.names():
        states = random_states(dc.problems.load(name).mechanism, count=8)
        assert len(states) == 8 and np.isfinite(states.q).all() and np.isfinite(states.u).all()


def test_impossible_constraints_are_told() -> None:
    far = dc.Mechanism(
        bodies=[dc.rod("bar", 1.0, 1.0)],
        joints=[dc.revolute("pin", "ground", "bar")],
        constraints=[dc.constraints.distance("wire", "ground", "bar", 0.1, point1=(5.0, 0.0, 0.0))],
    )
    with pytest.raises(dc.InputError, match="only 0 of 64 random states .* admissible"):
        random_states(far)


def test_own_coordinates_without_a_known_inverse() -> None:
    case = lagrange_top()
    states = random_states(case.mechanism, case.coordinates)
    assert states.coordinates == ("phi", "theta", "psi")
    assert np.abs(np.sin(states.q[1])).min() > 1e-4  # away from the angles' singularity
    assert set(states.describe(0)) == {
        "t",
        "q.phi",
        "q.theta",
        "q.psi",
        "u.phi",
        "u.theta",
        "u.psi",
    }


# --- the equations at these states ----------------------------------------------------------------


@settings(max_examples=12, deadline=None)
@given(samples(Options(massless=False, thin=False, bodies=4)))
def test_accelerations_and_residuals_against_the_textbook(sample: Sample) -> None:
    """Against the dense matrices of the thesis, for trees of all joints and forces."""
    mechanism = sample.mechanism
    if not len(mechanism.free.u):
        return
    try:
        states = random_states(mechanism, count=3)
    except dc.InputError:  # a law that is not finite anywhere
        return
    test = EquationTest(mechanism, states)
    rng = np.random.default_rng(0)
    given_udot = test.acceleration * rng.uniform(0.5, 2.0, test.acceleration.shape)
    for k in range(3):
        q, u = np.zeros(len(mechanism.coordinates)), np.zeros(len(mechanism.speeds))
        q[mechanism.free.q], u[mechanism.free.u] = states.q[:, k], states.u[:, k]
        motors = {m.name: [0.0] * len(mechanism.joint(m.joint).speeds) for m in mechanism.motors}
        book = Textbook(mechanism, float(states.t[k]), q, u, motors)
        udot = book.udot_t.copy()
        udot[mechanism.free.u] = given_udot[:, k]
        residual = book.F_r + book.F_r_star(udot)
        scale = test.scale(given_udot)[:, k]
        # Two routes of some hundred operations each, on terms that add up to `scale`.
        assert np.all(np.abs(test.residual(given_udot)[:, k] - residual) <= 1e-10 * scale + 1e-12)


@pytest.mark.parametrize("name", CASES)
def test_every_testing_function_loses_what_the_residual_takes(name: str) -> None:
    """ε = −Σ u_r (F_r + F*_r) of all four, whatever the accelerations: against the energy's own kernels."""
    case = CASES[name]()
    mechanism = case.mechanism
    if len(mechanism.free.q) < len(
        mechanism.coordinates
    ):  # laws of driven joints make the other columns
        return
    states = random_states(mechanism, case.coordinates, count=16)
    test = EquationTest(mechanism, states.take(np.argsort(states.t)), case.coordinates)
    udot = test.acceleration + np.random.default_rng(5).standard_normal(states.u.shape)
    point = test.point
    run = dc.Trajectory(
        t=point.t,
        q=point.q.T,
        u=point.u.T,
        udot=(times(point.Y, udot) + point.rest).T,
        coordinates=mechanism.coordinates.names,
        speeds=mechanism.speeds.names,
    )
    known, scale = dc.residuals(mechanism, run), np.abs(states.u).max() * test.scale(udot).max()
    for function, values in test.powers(udot).items():
        assert np.abs(values - known[function]).max() < 1e-11 * scale, function


def test_residuals_agree_with_those_of_a_log() -> None:
    """`energy.residuals` evaluates other kernels, at the samples of a run."""
    p = dc.problems.load("triple-pendulum", damping=0.02, mistake=True)
    run = dc.simulate(p.mechanism, p.state, duration=0.2, step=1e-2, equations=p.equations)
    assert run.udot is not None
    known = dc.residuals(p.mechanism, run)
    states = dc.States(run.t, run.q.T, run.u.T, run.coordinates, run.speeds)
    test, udot = EquationTest(p.mechanism, states), run.udot.T
    assert np.abs(test.residual(udot).T - known["coordinates"]).max() < 1e-11
    for name in ("wang", "liu-huston", "kane-levinson-1988", "kane-levinson-1990"):
        assert np.abs(test.powers(udot)[name] - known[name]).max() < 1e-10


def test_states_off_the_constraints_are_refused() -> None:
    case = spherical_pendulum()
    states = random_states(case.mechanism, count=4)
    moved = dc.States(states.t, 1.01 * states.q, states.u, states.coordinates, states.speeds)
    with pytest.raises(dc.InputError, match="constraint 'rod' is off by .* position level"):
        EquationTest(case.mechanism, moved)


def test_a_minimal_map_that_leaves_the_constraint_is_refused() -> None:
    mechanism = dc.problems.load("spherical-pendulum").mechanism
    wrong = dc.CoordinateMap(
        ("a", "b"), q={"x": "l*sin(q.a)", "y": "l*sin(q.b)", "z": "-l*cos(q.a)"}
    )
    with pytest.raises(dc.InputError, match="admissible"):
        random_states(mechanism, wrong)
