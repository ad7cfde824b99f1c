"""Turns about axes, and link frames along oblique ones: the same rotations as by matrices."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import deltac as dc
from deltac.dynamics.frames import aligned_joints, constant_turns
from deltac.dynamics.recursions import crba
from deltac.dynamics.spatial import Inertia, Transform, Turn
from deltac.dynamics.system import trace
from tests.oracles.textbook.tree import Textbook
from tests.systems.random_geometry import random_rotation
from tests.systems.random_mechanisms import random_state


def number(x: object) -> np.ndarray:
    return np.array(ca.DM(ca.SX(x)))


def quarter_turns() -> list[np.ndarray]:
    """All 24 rotations that take coordinate axes to coordinate axes."""
    found = []
    for permutation in np.eye(3)[
        [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]]
    ]:
        for signs in np.ndindex(2, 2, 2):
            R = permutation * (1 - 2 * np.array(signs))
            if np.linalg.det(R) > 0:
                found.append(R)
    return found


def product(turns: tuple[Turn, ...]) -> np.ndarray:
    E = np.eye(3)
    for turn in turns:
        E = number(turn.matrix) @ E
    return E


def test_turns_make_any_rotation() -> None:
    """To a few roundings of sines and cosines."""
    rng = np.random.default_rng(1)
    for R in [random_rotation(rng) for _ in range(50)] + quarter_turns():
        np.testing.assert_allclose(product(constant_turns(np.array(R))), R, rtol=0, atol=2e-15)
    assert constant_turns(np.eye(3)) == ()


def test_quarter_turns_have_no_rounding() -> None:
    """Their zeros are structural: nothing is multiplied by 6e-17."""
    for R in quarter_turns():
        for turn in constant_turns(R):
            assert {abs(turn.c), abs(turn.s)} == {0.0, 1.0}


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_turn_does_what_its_matrix_does(axis: int) -> None:
    rng = np.random.default_rng(axis)
    turn = Turn(axis, np.cos(0.7), np.sin(0.7))
    E, A, v = number(turn.matrix), rng.normal(size=(3, 3)), rng.normal(size=(3, 2))
    np.testing.assert_allclose(E @ E.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(number(turn @ ca.SX(v)), E @ v, atol=1e-15)
    np.testing.assert_allclose(number(turn.back @ ca.SX(v)), E.T @ v, atol=1e-15)
    found = number(turn.matrix_back(ca.SX(A), symmetric=False))
    np.testing.assert_allclose(found, E.T @ A @ E, atol=2e-15)
    symmetric = A + A.T
    found = number(turn.matrix_back(ca.SX(symmetric), symmetric=True))
    np.testing.assert_allclose(found, E.T @ symmetric @ E, atol=2e-15)


def test_transforms_by_turns_equal_those_by_matrices() -> None:
    rng = np.random.default_rng(5)
    R, r = np.array(random_rotation(rng)), ca.SX(rng.normal(size=3))
    turned, plain = Transform(ca.SX(R), r, constant_turns(R)), Transform(ca.SX(R), r)
    V, A = ca.SX(rng.normal(size=6)), rng.normal(size=(6, 6))
    A = A @ A.T
    inertia = Inertia(ca.SX(A[:3, :3]), ca.SX(A[:3, 3:]), ca.SX(A[3:, 3:]))
    np.testing.assert_allclose(number(turned @ V), number(plain @ V), atol=1e-14)
    np.testing.assert_allclose(
        number(turned.force_back(V)), number(plain.force_back(V)), atol=1e-14
    )
    for a, b in zip(
        vars(turned.inertia_back(inertia)).values(), vars(plain.inertia_back(inertia)).values()
    ):
        np.testing.assert_allclose(number(a), number(b), atol=1e-13)


def oblique() -> dc.Mechanism:
    """A branching arm with oblique, parallel and coordinate axes of all kinds of single-axis joints."""
    names = ("a", "b", "c", "d", "e")
    bodies = [dc.body(n, 1.0 + k, (0.3, 0.4, 0.5), (0.1, 0.2, -0.1)) for k, n in enumerate(names)]
    return dc.Mechanism(
        bodies,
        [
            dc.revolute("j1", "ground", "a", (1, 2, 3), position=(0.1, 0, 0)),
            dc.revolute("j2", "a", "b", (1, 2, 3), position=(0, 0.4, 0)),
            dc.joints.cylindrical("j3", "b", "c", (-1, 1, 0), position=(0.3, 0, 0.1)),
            dc.joints.screw("j4", "b", "d", (0, 1, 0), pitch=0.2, position=(0, 0, 0.5)),
            dc.prismatic("j5", "d", "e", (2, 0, -1), position=(0.2, 0.1, 0)),
        ],
        gravity=(0, 0, -9.81),
    )


def test_only_oblique_joints_are_framed_anew() -> None:
    framed = aligned_joints(oblique())
    assert set(framed) == {"j1", "j2", "j3", "j5"}
    for name, joint in framed.items():
        old = oblique().joint(name)
        axis = np.array(joint.rotation) @ [0, 0, 1]
        given = np.array(old.rotation) @ np.array(old.axes[0])
        np.testing.assert_allclose(axis, given / np.linalg.norm(given), atol=1e-15)


def test_mass_matrix_in_new_frames_is_the_textbooks() -> None:
    mechanism = oblique()
    sample = random_state(mechanism, np.random.default_rng(2))
    system = trace(mechanism)
    (M,) = sample.evaluate(system, crba(system))
    book = Textbook(mechanism, sample.t, sample.q, sample.u)
    expected = book.R.T @ book.M @ book.R
    np.testing.assert_allclose(M, expected, rtol=0, atol=1e-13 * np.abs(expected).max())
