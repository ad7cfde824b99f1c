"""Rotations as arrays: matrices that turn body into parent components, and quaternions, scalar first."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from deltac.arrays import Array


def matrices(quaternions: ArrayLike) -> Array:
    """Rotation matrices (…, 3, 3) of quaternions (…, 4) of any length; the identity where one is zero."""
    q = np.asarray(quaternions, dtype=np.float64)
    largest = np.abs(q).max(axis=-1, keepdims=True)
    q = np.where(largest == 0.0, [1.0, 0.0, 0.0, 0.0], q / np.where(largest == 0.0, 1.0, largest))
    w, x, y, z = np.moveaxis(q / np.linalg.norm(q, axis=-1, keepdims=True), -1, 0)
    # Written so that quarter turns have zeros.
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def quaternion(R: Array) -> Array:
    """The unit quaternion (4,), its scalar not negative, of a rotation matrix (3, 3)."""
    products = np.diag([1.0, -1.0, -1.0, -1.0]) * np.trace(R) + np.eye(4)  # 4 q qᵀ
    products[1:, 1:] += R + R.T
    products[0, 1:] = products[1:, 0] = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    # Its column of the largest component loses no digits.
    q = products[:, products.diagonal().argmax()]
    q = q / np.linalg.norm(q)
    return np.asarray(-q if q[0] < 0.0 else q)


def about(axis: int, angle: ArrayLike) -> Array:
    """The rotations (…, 3, 3) by angles (…) about a coordinate axis, 0, 1 or 2."""
    c, s = np.cos(angle), np.sin(angle)
    turned = np.zeros((*np.shape(angle), 3, 3))
    j, k = (axis + 1) % 3, (axis + 2) % 3
    turned[..., axis, axis] = 1.0
    turned[..., j, j] = turned[..., k, k] = c
    turned[..., k, j], turned[..., j, k] = s, -s
    return turned


def roll_pitch_yaw(roll: float, pitch: float, yaw: float) -> Array:
    """The rotation (3, 3) by angles about the fixed axes x, y and z, as URDF and SDFormat have it."""
    return about(2, yaw) @ about(1, pitch) @ about(0, roll)
