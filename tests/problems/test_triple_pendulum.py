"""The thesis's example: the hand-written equations, the mistake, the drive, the variants."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import casadi
import numpy as np
import pytest

from deltac import Controller, InputError, problems, simulate
from deltac.dynamics.system import trace
from deltac.dynamics.terms import forward
from deltac.problems import Problem
from deltac.problems.triple_pendulum import driving_torque
from deltac.problems.triple_pendulum_equations import HandEquations

RNG_SEED = 20080601


def own_dynamics(mechanism: Any) -> Any:
    """(t, q, u, M1) -> u̇ and driving forces of the mechanism's recursions."""
    system = trace(mechanism)
    motion = forward(system)
    inputs = [system.t, system.q, system.u, system.inputs]
    f = casadi.Function("f", inputs, [motion.udot, motion.driving])

    def call(t: float, q: Any, u: Any, torque: Any = ()) -> tuple[Any, Any]:
        udot, driving = f(t, q, u, torque)
        return np.array(udot).ravel(), np.array(driving).ravel()

    return call


def random_states(count: int = 20) -> Any:
    """(t, θ, ω) of all three bars."""
    rng = np.random.default_rng(RNG_SEED)
    for _ in range(count):
        yield rng.uniform(0, 10), rng.uniform(-3, 3, 3), rng.uniform(-8, 8, 3)


def relative(absolute: Any) -> Any:
    return np.diff(absolute, prepend=0.0)


def assert_close(found: Any, expected: Any) -> None:
    """To 1e-12 of the size of the whole: two O(n³) routes through well-conditioned 3 by 3 systems."""
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def equations_of(problem: Problem) -> Callable[..., Any]:
    """The right-hand side of a problem's hand-written equations."""
    assert problem.equations is not None
    return problem.equations.rhs


@pytest.mark.parametrize("damping", [0.0, (0.1, 0.02, 0.3)])
@pytest.mark.parametrize("weights", [(10.0, 30.0, 20.0), (10.0, 40.0, 10.0)])
def test_hand_equations_equal_the_mechanism(damping: Any, weights: Any) -> None:
    problem = problems.load("triple-pendulum", damping=damping, weights=weights)
    rhs = equations_of(problem)
    own = own_dynamics(problem.mechanism)
    for t, theta, omega in random_states():
        by_hand = rhs(t, theta, omega)
        assert_close(relative(by_hand), own(t, relative(theta), relative(omega))[0])


def test_driven_equations_and_torque_equal_the_mechanism() -> None:
    problem = problems.load("driven-triple-pendulum", damping=0.05)
    own = own_dynamics(problem.mechanism)
    free = own_dynamics(problems.load("triple-pendulum", drive="torque", damping=0.05).mechanism)
    hand, rhs = HandEquations.of(problem.mechanism.parameters), equations_of(problem)
    for t, theta, omega in random_states():
        theta[0], omega[0] = math.sin(0.75 * t), 0.75 * math.cos(0.75 * t)
        q, u = relative(theta), relative(omega)
        udot, driving = own(t, q[1:], u[1:])
        first = -(0.75**2) * math.sin(0.75 * t)
        by_hand = np.array([first, *rhs(t, theta[1:], omega[1:])])
        assert_close(relative(by_hand), udot)
        torque = hand.driving_torque(t, theta[1:], omega[1:])
        assert abs(torque - driving[0]) <= 1e-12 * np.abs(driving).max()
        assert_close(free(t, q, u, torque)[0], udot)


def test_the_mistake_is_the_one_sign_of_figure_4_7() -> None:
    right = HandEquations.of(problems.load("triple-pendulum").mechanism.parameters)
    problem = problems.load("triple-pendulum", mistake=True)
    m2, m3, r2, l2 = 30 / 9.8, 20 / 9.8, 0.125, 0.25
    for t, theta, omega in random_states():
        difference = equations_of(problem)(t, theta, omega) - right.free(t, theta, omega)
        (M11, M12, M13, M22, M23, M33), _ = right.terms(theta, omega)
        M = np.array([[M11, M12, M13], [M12, M22, M23], [M13, M23, M33]])
        torque = 2 * (m2 * r2 + m3 * l2) * 9.8 * math.sin(theta[1])
        np.testing.assert_allclose(M @ difference, [0.0, torque, 0.0], atol=1e-10)


@pytest.mark.parametrize("name", ["triple-pendulum", "driven-triple-pendulum"])
def test_hand_equations_take_batches_and_symbols(name: str) -> None:
    rhs = equations_of(problems.load(name, damping=0.01))
    n = 3 if name == "triple-pendulum" else 2
    rng = np.random.default_rng(RNG_SEED)
    q, u = rng.normal(size=(2, n, 7))
    columns = [rhs(0.4, q[:, k], u[:, k]) for k in range(7)]
    # NumPy's functions of arrays and of scalars may differ in the last bit.
    np.testing.assert_allclose(rhs(0.4, q, u), np.stack(columns, axis=1), rtol=1e-12, atol=1e-12)

    x = casadi.SX.sym("x", 2 * n)
    entries = np.empty(2 * n, dtype=object)
    for k in range(2 * n):
        entries[k] = x[k]
    traced = casadi.vertcat(*rhs(0.4, entries[:n], entries[n:]))
    value = casadi.Function("f", [x], [traced])(np.concatenate([q[:, 0], u[:, 0]]))
    assert_close(np.array(value).ravel(), columns[0])


def test_the_motion_is_the_same_whether_bar_1_is_driven_by_law_or_by_torque() -> None:
    driven = problems.load("driven-triple-pendulum")
    by_torque = problems.load("triple-pendulum", drive="torque")
    hand = HandEquations.of(by_torque.mechanism.parameters)

    def motor(t: float, q: Any, u: Any) -> dict[str, float]:
        theta, omega = np.cumsum(q), np.cumsum(u)
        return {"M1": hand.driving_torque(t, theta[1:], omega[1:])}

    def run(problem: Any, **options: Any) -> Any:
        return simulate(problem.mechanism, problem.state, 0.5, 1e-3, "ode5", **options)

    law = run(driven)
    torque = run(by_torque, controller=Controller(motor, hold=False))
    # Both are of order 5: errors of some (10 rad/s · 1 ms)⁵ and less.
    np.testing.assert_allclose(torque.q, law.q, rtol=0, atol=1e-9)
    logged = law.forces["prescribed joint1"][:, 0]
    np.testing.assert_allclose(driving_torque(driven.mechanism, law), logged, rtol=0, atol=1e-11)
    np.testing.assert_allclose(torque.forces["actuator M1"][:, 0], logged, rtol=0, atol=1e-6)


def test_variants_keep_their_meaning() -> None:
    problem = problems.load("triple-pendulum", start=(0.1, 0.3, 0.2), rates=(1.0, 3.0, -2.0))
    np.testing.assert_allclose(problem.state.q, [0.1, 0.2, -0.1], atol=1e-16)
    np.testing.assert_allclose(problem.state.u, [1.0, 2.0, -5.0], atol=1e-15)
    assert problems.load("triple-pendulum", damping=1e-3).conserved == ()
    driven = problems.load("driven-triple-pendulum")
    np.testing.assert_allclose(np.cumsum(driven.state.u), [0.75, 0.0, 0.0], atol=1e-15)
    varied = problem.mechanism.with_parameters(m2=1.0, l3=0.4, c1=0.2)
    assert varied.parameters["m2"] == 1.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"drive": "motor"}, "drive is 'motor'"),
        ({"start": (1.0, 2.0)}, "expected three numbers"),
        ({"rates": 3.0}, "expected three numbers"),
        ({"drive": "motion", "start": (0.5, 0.0, 0.0)}, "starts by its drive"),
        ({"drive": "torque", "rates": (1.0, 0.0, 0.0)}, "starts by its drive"),
        ({"damping": (0.1, 0.2)}, "expected three numbers"),
        ({"weights": (10.0, -30.0, 20.0)}, "mass"),
        ({"mistakes": True}, "did you mean 'mistake'"),
    ],
)
def test_bad_options_are_named(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        problems.load("triple-pendulum", **options)
