"""Link frames that make recursions cheap: z along the joint's axis, as Denavit and Hartenberg place them.

A joint whose axis is a coordinate axis keeps its frame, so that the structural zeros of planar chains stay.
Any other joint with a single axis has its frame turned: z becomes the axis, and x the common normal to the
axis of the joint that comes next, if it is oblique too; then the rotation from link to link is one turn
about x and one about z.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Set
from dataclasses import replace
from typing import Any

import numpy as np

from deltac.arrays import EPS, HALF_DIGITS, Array
from deltac.dynamics.spatial import Turn
from deltac.mechanism.joints import Joint
from deltac.mechanism.mechanism import Mechanism

ALIGNABLE = frozenset({"revolute", "prismatic", "screw", "cylindrical"})
Z_AXIS = (0.0, 0.0, 1.0)
SNAP = 4 * EPS
"""Cosines and sines this near to 0 and ±1 are taken for them: a quarter turn is seldom exact."""


def aligned_joints(mechanism: Mechanism) -> Mapping[str, Joint]:
    """Joints with oblique axes, by name, as equal joints whose frames on both bodies are turned."""
    oblique = {joint.name for joint in mechanism.joints if _is_oblique(joint)}
    return {
        joint.name: _turned(joint, _axes(mechanism, joint, oblique))
        for joint in mechanism.joints
        if joint.name in oblique
    }


def _axes(mechanism: Mechanism, joint: Joint, oblique: Set[str]) -> Array:
    """The axes (columns) of the turned frame, in the joint's frame."""
    z = np.array(joint.axes[0], dtype=np.float64)
    z /= np.linalg.norm(z)
    following = (
        np.array(other.rotation) @ np.array(other.axes[0])
        for other in mechanism.joints
        if other.parent == joint.child and other.name in oblique
    )
    ahead = next(following, z)  # in the child's body frame; from there into the joint's
    x = np.cross(z, np.array(joint.child_rotation).T @ ahead)
    if np.linalg.norm(x) < HALF_DIGITS * np.linalg.norm(ahead):
        x = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
    x -= z * (z @ x)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _turned(joint: Joint, axes: Array) -> Joint:
    def turned(R: Any) -> Any:
        return tuple(map(tuple, (np.array(R) @ axes).tolist()))

    return replace(
        joint,
        axes=(Z_AXIS,),
        rotation=turned(joint.rotation),
        child_rotation=turned(joint.child_rotation),
    )


def _is_oblique(joint: Joint) -> bool:
    return joint.kind in ALIGNABLE and sum(entry != 0.0 for entry in joint.axes[0]) > 1


def constant_turns(E: Array) -> tuple[Turn, ...]:
    """A rotation matrix as turns about z, x and z, first one first; turns by nothing are left out.

    E = Z(γ) X(α) Z(β) with the matrices of `Turn`: E₂₂ = cos α, and the last row and column have β and γ.
    """
    alpha = math.atan2(math.hypot(E[2, 0], E[2, 1]), E[2, 2])
    if math.sin(alpha) > SNAP:
        beta = math.atan2(E[2, 0], -E[2, 1])
        gamma = math.atan2(E[0, 2], E[1, 2])
    else:  # both about the same axis
        alpha = 0.0 if E[2, 2] > 0 else math.pi
        beta, gamma = 0.0, math.atan2(-E[1, 0], E[0, 0])
    turns = ((2, beta), (0, alpha), (2, gamma))
    factors = (Turn(axis, _snapped(math.cos(a)), _snapped(math.sin(a))) for axis, a in turns)
    return tuple(turn for turn in factors if (turn.c, turn.s) != (1.0, 0.0))


def _snapped(value: float) -> float:
    nearest = float(round(value))
    return nearest if abs(value - nearest) < SNAP else value
