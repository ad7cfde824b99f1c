"""The textbook against mechanics written out by hand: the thesis's triple pendulum, and x against v.

The pendulum: three uniform bars in a chain, y up, absolute angles θ from the downward vertical. The
mechanism's own coordinates are the relative angles q = RELATIVE θ.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from deltac.dynamics.system import trace
from deltac.dynamics.terms import forward
from deltac.errors import InputError
from deltac.mechanism.bodies import rod
from deltac.mechanism.constraints import holonomic
from deltac.mechanism.forces import joint_torque
from deltac.mechanism.joints import revolute
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.quantities import ZERO
from tests.oracles.textbook.kinematics import along, skew, tree
from tests.oracles.textbook.tree import Textbook
from tests.systems.random_mechanisms import Sample, assert_close, largest, samples

Array = NDArray[Any]

g = 9.8
l = np.array([0.1, 0.25, 0.5])
m = np.array([10.0, 30.0, 20.0]) / g
r = l / 2
I = m * l**2 / 12
TORQUES = np.array([0.7, -0.4, 1.1])
DAMPING = np.array([0.03, 0.02, 0.05])

# Relative rates from absolute ones: q̇ = RELATIVE θ̇.
RELATIVE = np.array([[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [0.0, -1.0, 1.0]])

angles = st.lists(st.floats(-3, 3), min_size=3, max_size=3).map(np.array)


def pendulum(first: Any = None) -> Mechanism:
    """With joint torques and dampers; `first` prescribes θ1."""
    bars = [rod(f"bar{i + 1}", m[i], l[i], along="-y") for i in range(3)]
    joints = [
        revolute(
            f"joint{i + 1}",
            "ground" if i == 0 else f"bar{i}",
            f"bar{i + 1}",
            "z",
            position=ZERO if i == 0 else (0, -l[i - 1], 0),
            damping=DAMPING[i],
            motion=first if i == 0 else None,
        )
        for i in range(3)
    ]
    motors = [joint_torque(f"motor{i + 1}", f"joint{i + 1}", TORQUES[i]) for i in range(3)]
    return Mechanism(bars, joints, motors, gravity=(0, -g, 0))


def coefficients() -> Array:
    """Of θ̈_j C_ij in equation i of (3.1.17)-(3.1.19)."""
    m1, m2, m3 = m
    (l1, l2, _), (r1, r2, r3) = l, r
    a12, a13, a23 = (m2 * r2 + m3 * l2) * l1, m3 * l1 * r3, m3 * l2 * r3
    return np.array(
        [
            [I[0] + m1 * r1**2 + (m2 + m3) * l1**2, a12, a13],
            [a12, I[1] + m2 * r2**2 + m3 * l2**2, a23],
            [a13, a23, I[2] + m3 * r3**2],
        ]
    )


def hand_equations(theta: Array, rate: Array) -> tuple[Array, Array]:
    """Mass matrix and right side of (3.1.17)-(3.1.19) in absolute angles."""
    difference = theta[:, None] - theta[None, :]
    A = coefficients()
    weight = g * np.array(
        [m[0] * r[0] + (m[1] + m[2]) * l[0], m[1] * r[1] + m[2] * l[1], m[2] * r[2]]
    )
    M, c = TORQUES, DAMPING
    relative = RELATIVE @ rate
    motors = np.array([M[0] - M[1], M[1] - M[2], M[2]])
    passed_on = c * relative  # by each joint's damper to the bar before it
    dampers = np.append(passed_on[1:], 0.0) - passed_on
    centrifugal = (A * np.sin(difference)) @ rate**2
    return A * np.cos(difference), motors + dampers - weight * np.sin(theta) - centrifugal


def planar_rows(book_rows: Array) -> Array:
    """The rows of v_x, v_y, ω_z of each bar, which are all that a planar motion has."""
    keep = [6 * k + i for k in range(3) for i in (0, 1, 5)]
    return book_rows[keep]


def explicit_partial_velocities(theta: Array) -> Array:
    """R of the thesis in absolute rates, rows (v_x, v_y, ω) of each bar."""
    rows = []
    for i in range(3):
        reach = [l[j] if j < i else r[j] if j == i else 0.0 for j in range(3)]
        rows += [reach * np.cos(theta), reach * np.sin(theta), np.eye(3)[i]]
    return np.array(rows)


def explicit_rate_of_K(theta: Array, rate: Array, second: Array) -> float:
    """K̇ of K = ½ Σ A_ij cos(θ_i − θ_j) θ̇_i θ̇_j, differentiated by hand."""
    A, total = coefficients(), 0.0
    for i in range(3):
        for j in range(3):
            C, S = np.cos(theta[i] - theta[j]), np.sin(theta[i] - theta[j])
            total += A[i, j] * C * rate[i] * second[j]
            total -= 0.5 * A[i, j] * S * (rate[i] - rate[j]) * rate[i] * rate[j]
    return total


@given(angles, angles, angles)
def test_thesis_pendulum(theta: Array, rate: Array, second: Array) -> None:
    book = Textbook(pendulum(), 0.0, RELATIVE @ theta, RELATIVE @ rate)
    x = [r[0] * np.array([np.sin(theta[0]), -np.cos(theta[0]), 0.0])]
    for i in (1, 2):
        tip = sum(l[j] * np.array([np.sin(theta[j]), -np.cos(theta[j]), 0.0]) for j in range(i))
        x.append(tip + r[i] * np.array([np.sin(theta[i]), -np.cos(theta[i]), 0.0]))
    assert_close(book.x, x, 1e-14)
    R = explicit_partial_velocities(theta)
    assert_close(planar_rows(book.R @ RELATIVE), R, 1e-14)
    scale = 1.0 + largest(rate) ** 2 + largest(second)
    accelerations = RELATIVE @ second
    mass = np.repeat(m, 3)
    mass[2::3] = I
    assert_close(book.K, 0.5 * (R @ rate) @ (mass * (R @ rate)), 1e-14)
    K_dot = explicit_rate_of_K(theta, rate, second)
    assert_close(book.K_dot(accelerations), K_dot, 1e-13, scale * (1 + largest(rate)))
    left, right = hand_equations(theta, rate)
    assert_close(RELATIVE.T @ book.mass_matrix @ RELATIVE, left, 1e-14)
    assert_close(
        RELATIVE.T @ (book.F_r + book.F_r_star(accelerations)), right - left @ second, 1e-13, 100.0
    )


@given(angles, angles)
def test_hand_equations_against_the_articulated_bodies(theta: Array, rate: Array) -> None:
    mechanism = pendulum()
    sample = Sample(mechanism, 0.0, RELATIVE @ theta, RELATIVE @ rate, np.zeros(3))
    system = trace(mechanism)
    (udot,) = sample.evaluate(system, forward(system).udot)
    left, right = hand_equations(theta, rate)
    condition = float(np.linalg.cond(left))
    assert_close(udot, RELATIVE @ np.linalg.solve(left, right), 1e-14 * condition)


@pytest.mark.parametrize("t", [0.0, 0.4, 2.7])
@given(theta=angles, rate=angles)
def test_thesis_pendulum_with_prescribed_first_angle(t: float, theta: Array, rate: Array) -> None:
    """Figures 4.4-4.6: θ1 = sin 0.75 t by a torque, which equation (3.1.17) gives."""
    theta[0], rate[0], first = (
        np.sin(0.75 * t),
        0.75 * np.cos(0.75 * t),
        -(0.75**2) * np.sin(0.75 * t),
    )
    book = Textbook(pendulum("sin(0.75*t)"), t, RELATIVE @ theta, RELATIVE @ rate)
    R = explicit_partial_velocities(theta)
    # Relative speeds of joints 2 and 3 are held in v_t: the whole chain turns with bar 1.
    assert_close(planar_rows(book.v_t), R @ np.full(3, rate[0]), 1e-14)
    assert_close(planar_rows(book.v), R @ rate, 1e-14)
    left, right = hand_equations(theta, rate)
    second = np.full(3, first)
    second[1:] = np.linalg.solve(left[1:, 1:], right[1:] - left[1:, 0] * first)
    scale = float(np.linalg.cond(left[1:, 1:])) * (1 + largest(right))
    assert_close(book.udot, RELATIVE @ second, 1e-14, scale)
    missing = left[0] @ second - right[0]
    assert_close(book.driving(book.udot), [missing, 0.0, 0.0], 1e-13, scale)
    assert_close(
        book.Q_dot(book.udot),
        TORQUES @ book.u - DAMPING @ book.u**2 + missing * rate[0],
        1e-13,
        scale * (1 + largest(rate)) ** 2,
    )


@given(samples())
def test_velocities_are_rates_of_places(sample: Sample) -> None:
    """v_G = ẋ_G and Ȧ = A ω×: the partial velocities against the derivative of the placement."""
    book, mechanism = sample.book, sample.mechanism
    for k, body in enumerate(mechanism.bodies):
        centre = np.array([mechanism.number(c) for c in body.mass_centre])

        def pose(q: Array, name: str = body.name, centre: Array = centre) -> Array:
            frame = tree(mechanism, q).frames[name]
            return np.concatenate([frame.place(centre), frame.turned.ravel()])

        rates = along(pose, sample.q, book.q_dot)
        v, omega = np.split(book.v[6 * k : 6 * k + 6], 2)
        assert_close(rates[:3], v)
        assert_close(rates[3:].reshape(3, 3), book.turned[k] @ skew(omega))


@given(samples())
def test_potentials_lose_what_the_forces_do(sample: Sample) -> None:
    """V̇ = −vᵀF_V + ∂V/∂t by central differences, whose error is of the order of their step squared."""
    book, mechanism = sample.book, sample.mechanism
    h = 1e-5

    def V(s: float) -> float:
        return Textbook(mechanism, sample.t + s, sample.q + s * book.q_dot, sample.u).V

    difference = (V(h) - V(-h)) / (2 * h)
    size = 1.0 + sum(
        abs(c.potential or 0.0) + float(np.abs(c.F) @ np.abs(book.v)) for c in book.channels
    )
    assert abs(difference - book.V_dot()) < 1e-7 * size * (1 + largest(book.v)) ** 2


def test_constraints_are_refused() -> None:
    """Rather than left out without a word."""
    rod_on_pin = Mechanism(
        [rod("bar", 1.0, 0.5)],
        [revolute("pin", "ground", "bar")],
        constraints=[holonomic("stop", "q.pin")],
    )
    with pytest.raises(InputError, match="constraints .stop."):
        Textbook(rod_on_pin, 0.0, np.zeros(1), np.zeros(1))
