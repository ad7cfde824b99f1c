"""Rotations against SciPy's, and at the turns where a formula may lose digits."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from deltac import rotations

HALF_TURNS = Rotation.from_rotvec(
    np.pi * np.vstack([np.eye(3), np.ones((1, 3)) / 3**0.5, [[0.6, 0.8, 0.0]]])
)
TURNS = Rotation.concatenate([Rotation.random(50, random_state=3), HALF_TURNS, Rotation.identity()])


def test_quaternions_and_matrices() -> None:
    q = np.roll(TURNS.as_quat(), 1, axis=1)
    R = rotations.matrices(7.0 * q)
    np.testing.assert_allclose(R, TURNS.as_matrix(), atol=1e-15)
    for matrix in R:
        found = rotations.quaternion(matrix)
        assert found[0] >= 0.0
        np.testing.assert_allclose(np.linalg.norm(found), 1.0, atol=1e-15)
        np.testing.assert_allclose(rotations.matrices(found), matrix, atol=1e-15)


def test_no_quaternion_is_no_turn_and_quarter_turns_have_zeros() -> None:
    assert np.array_equal(rotations.matrices(np.zeros((2, 4))), [np.eye(3)] * 2)
    quarter = rotations.matrices([0.5**0.5, 0.0, 0.0, 0.5**0.5])
    assert quarter[0, 0] == quarter[1, 1] == 0.0


@pytest.mark.parametrize("length", [1e-200, 1e200])
def test_quaternions_of_any_length(length: float) -> None:
    expected = np.array([0.5, 0.5, -0.5, 0.5])
    np.testing.assert_array_equal(
        rotations.matrices(length * expected), rotations.matrices(expected)
    )


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_turns_about_axes(axis: int) -> None:
    angles = np.array([0.3, -2.0, 4.0])
    expected = Rotation.from_euler("xyz"[axis], angles[:, None]).as_matrix()
    np.testing.assert_allclose(rotations.about(axis, angles), expected, atol=1e-15)


def test_roll_pitch_yaw() -> None:
    expected = Rotation.from_euler("xyz", [0.1, -0.7, 2.0]).as_matrix()
    np.testing.assert_allclose(rotations.roll_pitch_yaw(0.1, -0.7, 2.0), expected, atol=1e-15)
