"""Evaluations, kinematics, linearisation and equilibria against closed forms and published numbers."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.errors import InputError
from deltac.problems import bicycle
from deltac.problems.problem import G
from tests.support.slow import repeated
from tests.systems.constrained_mechanisms import four_bar, parallelogram
from tests.systems.machines import pendulum, robot

EPS = float(np.finfo(float).eps)


# --- evaluate ------------------------------------------------------------------------------------------


def test_a_pendulum() -> None:
    """m l² q̈ = −m g l sin q − c q̇; the axis x points down."""
    mechanism = replace(
        pendulum(), joints=[dc.revolute("hinge", "ground", "bob", "z", damping=0.3)]
    )
    found = dc.evaluate(mechanism, mechanism.state({"hinge": 0.4}, {"hinge": 1.5}))
    m, l, g = 2.0, 0.5, 9.81
    assert found.M.item() == pytest.approx(m * l**2, rel=4 * EPS)
    assert found.forces["gravity"].item() == pytest.approx(-m * g * l * np.sin(0.4), rel=8 * EPS)
    assert found.forces["damper hinge"].item() == pytest.approx(-0.45, rel=4 * EPS)
    assert found.kinetic == pytest.approx(0.5 * m * l**2 * 1.5**2, rel=4 * EPS)
    assert found.potential["gravity"] == pytest.approx(-m * g * l * np.cos(0.4), rel=4 * EPS)
    expected = -g / l * np.sin(0.4) - 0.45 / (m * l**2)
    assert found.udot.item() == pytest.approx(expected, rel=16 * EPS)


@pytest.mark.parametrize(
    "name",
    repeated(
        ("andrews-squeezer", "ball-on-table", "driven-triple-pendulum"),
        *("ball-on-table", "driven-triple-pendulum"),
    ),
)
def test_along_a_run_it_is_what_the_run_recorded(name: str) -> None:
    problem = dc.problems.load(name)
    run = dc.simulate(problem.mechanism, problem.state, 20 * problem.step, problem.step, "ode5")
    found = dc.evaluate(problem, run)
    assert run.udot is not None
    scale = np.abs(run.udot).max()
    # The compiled step solves the same equations in another order: rounding times their condition.
    np.testing.assert_allclose(found.udot, run.udot, atol=1e-9 * scale)
    nu = len(problem.mechanism.speeds)
    assert found.G.shape == (21, len(found.rows), len(found.speeds))
    assert found.driving.shape == (21, nu)
    for joint in problem.mechanism.joints:
        if joint.prescribed:
            force = run.forces[f"prescribed {joint.name}"]
            np.testing.assert_allclose(found.driving, force, atol=1e-9 * np.abs(force).max())
    pull = np.einsum("tcp,tc->tp", found.G, found.multipliers)
    recorded = sum(f for n, f in run.forces.items() if n.startswith("constraint "))
    free = problem.mechanism.free.u
    if len(found.rows):
        size = np.abs(recorded).max()
        assert isinstance(recorded, np.ndarray)
        np.testing.assert_allclose(pull, recorded[:, free], atol=1e-8 * size)


def test_matrices_and_evaluation_agree_by_two_routes() -> None:
    """Dense textbook matrices and traced recursions share no code."""
    mechanism, state = robot()
    found, book = dc.evaluate(mechanism, state), dc.matrices(mechanism, state)
    free = mechanism.free.u
    B = book.B[:, free]
    np.testing.assert_allclose(found.M, B.T @ book.M @ B, atol=1e-13)
    np.testing.assert_allclose(found.udot, book.udot, atol=1e-10)
    total = sum(f for f in found.forces.values())
    assert isinstance(total, np.ndarray)
    np.testing.assert_allclose(total[free], B.T @ book.F, atol=1e-11)


def test_bad_input() -> None:
    mechanism = pendulum()
    with pytest.raises(InputError, match="Problem"):
        dc.evaluate(mechanism)
    with pytest.raises(InputError, match="ndarray"):
        dc.evaluate(mechanism, np.zeros(2))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="3 coordinates"):
        dc.evaluate(mechanism, four_bar().state())
    with pytest.raises(InputError, match="'bobb'"):
        dc.kinematics(mechanism, mechanism.state()).position("bobb")
    with pytest.raises(InputError, match="rolling"):
        dc.kinematics(mechanism, mechanism.state()).contact_point("wheel")


# --- kinematics ----------------------------------------------------------------------------------------


def test_kinematics_of_a_pendulum() -> None:
    mechanism = pendulum()
    run = dc.simulate(mechanism, mechanism.state({"hinge": 1.0}), 0.2, 0.05)
    k, q, u = dc.kinematics(mechanism, run), run.q[:, 0], run.u[:, 0]
    zero = np.zeros_like(q)
    at = np.c_[0.5 * np.cos(q), 0.5 * np.sin(q), zero]
    np.testing.assert_allclose(k.position("bob", [0.5, 0, 0]), at, atol=4 * EPS)
    velocity = np.c_[-0.5 * np.sin(q) * u, 0.5 * np.cos(q) * u, zero]
    np.testing.assert_allclose(k.velocity("bob", [0.5, 0, 0]), velocity, atol=1e-14)
    np.testing.assert_allclose(k.angular_velocity("bob"), np.c_[zero, zero, u], atol=4 * EPS)
    turned = k.orientation("bob")
    assert turned.shape == (5, 3, 3)
    np.testing.assert_allclose(turned[:, 0, 0], np.cos(q), atol=4 * EPS)
    np.testing.assert_allclose(turned[:, 1, 0], np.sin(q), atol=4 * EPS)
    single = dc.kinematics(mechanism, mechanism.state({"hinge": 1.0}))
    np.testing.assert_allclose(single.position("bob", [0.5, 0, 0]), at[0], atol=4 * EPS)


def test_a_rolling_disc_touches_where_its_point_rests() -> None:
    problem = dc.problems.load("rolling-disc")
    run = dc.simulate(problem.mechanism, problem.state, 0.5, 0.01)
    (contact,) = (c.name for c in problem.mechanism.constraints)
    touch = dc.kinematics(problem, run).contact_point(contact)
    assert touch.shape == (51, 3)
    book = dc.kinematics(problem, run)
    body = problem.mechanism.bodies[-1].name
    R, origin = book.orientation(body), book.position(body)
    v, w = book.velocity(body), book.angular_velocity(body)
    slip = v + np.cross(w, touch - origin)
    assert np.abs(slip).max() < 1e-9 and R.shape == (51, 3, 3)


def test_a_run_knows_its_kinematics_and_multipliers(tmp_path: Any) -> None:
    problem = dc.problems.load("rolling-disc")
    run = dc.simulate(problem, None, 0.2, 0.01)
    k, body = dc.kinematics(problem, run), problem.mechanism.bodies[-1].name
    (contact,) = (c.name for c in problem.mechanism.constraints)
    for name, given in (
        ("position", (body, (0.0, 0.0, 0.01))),
        ("velocity", (body,)),
        ("orientation", (body,)),
        ("angular_velocity", (body,)),
        ("contact_point", (contact,)),
    ):
        assert np.array_equal(getattr(run, name)(*given), getattr(k, name)(*given))
    assert np.array_equal(run.every(2).position(body), run.position(body)[::2])
    # Gᵀλ is the force that the run has recorded.
    found = dc.evaluate(problem, run)
    force = np.einsum("tcp,tc->tp", found.G, run.multipliers[contact])
    free = problem.mechanism.free.u
    np.testing.assert_allclose(force, run.forces[f"constraint {contact}"][:, free], atol=1e-9)
    run.write(tmp_path / "run.parquet")
    back = dc.read_trajectory(tmp_path / "run.parquet")
    for ask in (lambda: back.position(body), lambda: back.multipliers):
        with pytest.raises(InputError) as caught:
            ask()
        assert caught.value.code == "E-STATE"


# --- linearise -----------------------------------------------------------------------------------------


def test_small_motions_of_a_pendulum_with_a_motor() -> None:
    mechanism = replace(pendulum(), forces=[dc.forces.joint_torque("motor", "hinge")])
    found = dc.linearise(mechanism, mechanism.state())
    np.testing.assert_allclose(found.A, [[0, 1], [-9.81 / 0.5, 0]], atol=1e-14)  # type: ignore[arg-type]
    np.testing.assert_allclose(found.B, [[0], [1 / (2 * 0.5**2)]], atol=1e-14)  # type: ignore[arg-type]
    assert found.names == ("δ hinge", "hinge") and found.inputs == ("motor",)
    frequency = np.sqrt(9.81 / 0.5)
    np.testing.assert_allclose(np.abs(found.eigenvalues.imag), frequency, rtol=1e-14)


@pytest.mark.parametrize("name", ["robot", "four-bar", "chaplygin-sleigh"])
def test_slopes_against_runs_from_neighbouring_starts(name: str) -> None:
    """δẋ = A δx about a motion: two runs from starts a little apart, over a short time."""
    if name == "robot":
        mechanism, state = robot()
    elif name == "four-bar":
        mechanism = four_bar()
        state = dc.assemble(mechanism, mechanism.state(parallelogram(1.0), [1, -1, 1])).state
    else:
        problem = dc.problems.load(name)
        mechanism, state = problem.mechanism, problem.state
    found = dc.linearise(mechanism, state)
    free = mechanism.free
    independent = [n.removeprefix("δ ") for n in found.names if n.startswith("δ ")]
    speeds = [n for n in found.names if not n.startswith("δ ")]
    names = mechanism.speeds.names
    here = dc.evaluate(mechanism, state)
    eps = 1e-6
    for k, name_k in enumerate(found.names):
        if name_k.startswith("δ ") and len(mechanism.coordinates) != len(mechanism.speeds):
            continue  # a quaternion's displacement is no coordinate's
        differences = []
        for sign in (1, -1):
            q, u = state.q.copy(), state.u.copy()
            if name_k.startswith("δ "):
                q[names.index(name_k.removeprefix("δ "))] += sign * eps
            else:
                u[names.index(name_k)] += sign * eps
            moved = mechanism.state(q, u, state.t)
            if mechanism.constraints:
                held = {*independent, *speeds} if len(q) == len(u) else set(speeds)
                moved = dc.assemble(mechanism, moved, pinned=held).state
            there = dc.evaluate(mechanism, moved)
            differences.append(there.udot)
        slope = (differences[0] - differences[1]) / (2 * eps)
        rows = [names.index(n) for n in speeds]
        size = max(1.0, np.abs(found.A).max())
        # Central differences: ε² times third derivatives, and rounding over ε.
        np.testing.assert_allclose(found.A[len(independent) :, k], slope[rows], atol=2e-7 * size)
    assert len(here.udot) == len(names) and len(free.u) >= len(speeds)


SPEEDS = np.linspace(0.0, 10.0, 11)


def test_eigenvalues_of_the_bicycle_at_eleven_speeds() -> None:
    """Against those of the published linear equations of lean and steer (Meijaard et al., 2007)."""
    dc.linearise(bicycle.problem(speed=5.0, nudge=0.0))  # traced once
    begun = time.process_time()
    for v in SPEEDS:
        dc.linearise(bicycle.problem(speed=float(v), nudge=0.0))
    assert time.process_time() - begun < 1.0  # s of CPU: all eleven
    for v in SPEEDS:
        problem = bicycle.problem(speed=float(v), nudge=0.0)
        found = dc.linearise(problem).eigenvalues
        A = np.zeros((4, 4))
        A[:2, 2:] = np.eye(2)
        A[2:, :2] = -np.linalg.solve(bicycle.MASS, G * bicycle.STIFFNESS + v**2 * bicycle.GYRO)
        A[2:, 2:] = -np.linalg.solve(bicycle.MASS, v * bicycle.DAMPING)
        for published in np.linalg.eigvals(A):
            near = np.abs(found - published).min()
            # The published matrices have 14 digits; a double eigenvalue keeps half of them.
            assert near < 1e-6 * max(1.0, abs(published))
        # What is left moves nothing: place, heading, wheels.
        assert np.sort(np.abs(found))[: len(found) - 4].max() < 1e-5


# --- equilibrium ---------------------------------------------------------------------------------------


def test_a_pendulum_rests_below_or_above() -> None:
    mechanism = pendulum()
    below = dc.equilibrium(mechanism, mechanism.state({"hinge": 0.8}))
    assert below.state.q[0] == pytest.approx(0.0, abs=1e-12) and below.stability == "marginal"
    above = dc.equilibrium(mechanism, mechanism.state({"hinge": 2.9}))
    assert above.state.q[0] == pytest.approx(np.pi, abs=1e-12) and above.stability == "unstable"
    np.testing.assert_allclose(
        above.eigenvalues.real, [-np.sqrt(9.81 / 0.5), np.sqrt(9.81 / 0.5)], rtol=1e-12
    )
    damped = replace(mechanism, joints=[dc.revolute("hinge", "ground", "bob", "z", damping=0.1)])
    assert dc.equilibrium(damped, damped.state()).stability == "asymptotically stable"


def test_a_bead_rests_on_a_turning_hoop() -> None:
    """cos θ = g/(Ω² r) from the bottom, where the centrifugal force balances gravity."""
    problem = dc.problems.load("bead-on-hoop")
    found = dc.equilibrium(problem)
    again = dc.evaluate(problem.mechanism, found.state)
    assert np.abs(again.udot[problem.mechanism.free.u]).max() < 1e-9


def test_a_hanging_loop_rests_on_its_constraints() -> None:
    mechanism = replace(four_bar(), gravity=(0.3, -9.81, 0.0))
    found = dc.equilibrium(
        mechanism, dc.assemble(mechanism, mechanism.state(parallelogram(-1.0))).state
    )
    phi = dc.evaluate(mechanism, found.state).phi
    assert np.abs(phi).max() < 1e-12 and found.residual < 1e-9
    udot = dc.evaluate(mechanism, found.state).udot
    assert np.abs(udot).max() < 1e-8


def test_no_equilibrium() -> None:
    falling = dc.Mechanism(
        [dc.bodies.sphere("ball", 1.0, 0.1)], [dc.free("ball", "ball")], gravity=[0, 0, -9.81]
    )
    with pytest.raises(InputError, match="ball.vz"):
        dc.equilibrium(falling, falling.state())


def test_a_hanging_chain_of_a_hundred_masses() -> None:
    """Daniel Bernoulli's chain: ω² = g/l times the roots of Laguerre's polynomial of that degree.

    By slopes along directions, whose memory grows with the size and not with its square.
    """
    n, link = 100, 0.1
    chain = dc.Mechanism(
        [dc.point_mass(f"mass {k}", 1.0, at=(0, -link, 0)) for k in range(n)],
        [
            dc.revolute(
                f"hinge {k}",
                f"mass {k - 1}" if k else "ground",
                f"mass {k}",
                position=(0, -link if k else 0, 0),
            )
            for k in range(n)
        ],
        gravity=(0, -9.81, 0),
    )
    small = dc.linearise(chain, chain.state())
    frequencies = np.sort(small.eigenvalues.imag[small.eigenvalues.imag > 0.0])
    roots, _ = np.polynomial.laguerre.laggauss(n)
    np.testing.assert_allclose(frequencies, np.sqrt(9.81 / link * roots), rtol=1e-8)
