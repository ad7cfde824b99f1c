"""Kinematics of every kind of joint: placement, partial velocities, and the rates of coordinates."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca

from deltac.dynamics.spatial import (
    SX,
    Transform,
    Turn,
    axis_rotation,
    quaternion_rates,
    quaternion_rotation,
)
from deltac.mechanism.joints import Joint


@dataclass(frozen=True)
class JointMotion:
    """Placement, partial velocities and rates of one joint.

    `X` leads from its frame on the parent to its frame on the child; `S` (6 by n, in components and
    about the origin of the child's frame) is the motion subspace of V_J = S u; q̇ = `W` u.
    """

    X: Transform
    S: SX
    W: SX


def joint_motion(joint: Joint, q: SX, pitch: SX) -> JointMotion:
    """The motion of a joint at its own coordinates `q`; `pitch` of a screw in metres per turn."""
    return _MOTIONS[joint.kind](joint, q, pitch)


def _placed(
    R: SX, r: SX, S: SX, W: SX | None = None, turns: tuple[Turn, ...] | None = None
) -> JointMotion:
    return JointMotion(Transform(R.T, r, turns), S, ca.SX.eye(S.shape[1]) if W is None else W)


def _turns(joint: Joint, *angles: SX) -> tuple[Turn, ...] | None:
    """Rotations about the joint's axes, one after the other; None unless all are coordinate axes."""
    turns = []
    for axis, angle in zip(joint.axes, angles):
        k = max(range(3), key=lambda n: abs(axis[n]))
        if abs(axis[k]) != 1.0:
            return None
        turns.append(Turn(k, ca.cos(angle), axis[k] * ca.sin(angle)))
    return tuple(turns)


def _axis(joint: Joint, which: int = 0) -> SX:
    return ca.SX(ca.DM(list(joint.axes[which])))


_ORIGIN = ca.SX.zeros(3)


def _fixed(joint: Joint, q: SX, pitch: SX) -> JointMotion:
    return _placed(ca.SX.eye(3), _ORIGIN, ca.SX(6, 0), ca.SX(0, 0), turns=())


def _revolute(joint: Joint, q: SX, pitch: SX) -> JointMotion:
    a = _axis(joint)
    R, S = axis_rotation(joint.axes[0], q), ca.vertcat(a, _ORIGIN)
    return _placed(R, _ORIGIN, S, turns=_turns(joint, q))


def _prismatic(joint: Joint, q: SX, pitch: SX) -> JointMotion:
    a = _axis(joint)
    return _placed(ca.SX.eye(3), a * q, ca.vertcat(_ORIGIN, a), turns=())


def _screw(joint: Joint, q: SX, pitch: SX) -> JointMotion:
    a, lead = _axis(joint), pitch / (2 * math.pi)
    R, S = axis_rotation(joint.axes[0], q), ca.vertcat(a, lead * a)
    return _placed(R, a * lead * q, S, turns=_turns(joint, q))


def _cylindrical(joint: Joint, q: SX, pitch: SX) -> JointMotion:
    a = _axis(joint)
    R = axis_rotation(joint.axes[0], q[0])
    return _placed(R, a * q[1], ca.diagcat(a, a), turns=_turns(joint, q[0]))


def _universal(joint: Joint, q: SX, pitch: SX) -> JointMotion:
    first, second = (axis_rotation(axis, q[k]) for k, axis in enumerate(joint.axes))
    partial = ca.horzcat(ca.mtimes(second.T, _axis(joint)), _axis(joint, 1))
    S = ca.vertcat(partial, ca.SX.zeros(3, 2))
    return _placed(ca.mtimes(first, second), _ORIGIN, S, turns=_turns(joint, q[0], q[1]))


def _planar(joint: Joint, q: SX, pitch: SX) -> JointMotion:
    R = axis_rotation((0.0, 0.0, 1.0), q[2])
    z = ca.SX(ca.DM([0, 0, 1]))
    S = ca.horzcat(
        ca.vertcat(ca.SX.zeros(3, 2), R.T[:, :2]),
        ca.vertcat(z, _ORIGIN),
    )
    turn = Turn(2, ca.cos(q[2]), ca.sin(q[2]))
    return _placed(R, ca.vertcat(q[0], q[1], 0), S, turns=(turn,))


def _spherical(joint: Joint, q: SX, pitch: SX) -> JointMotion:
    S = ca.vertcat(ca.SX.eye(3), ca.SX.zeros(3, 3))
    return _placed(quaternion_rotation(q), _ORIGIN, S, quaternion_rates(q))


def _free(joint: Joint, q: SX, pitch: SX) -> JointMotion:
    R = quaternion_rotation(q[3:])
    S = ca.vertcat(
        ca.horzcat(ca.SX.zeros(3, 3), ca.SX.eye(3)),
        ca.horzcat(R.T, ca.SX.zeros(3, 3)),
    )
    return _placed(R, q[:3], S, ca.diagcat(ca.SX.eye(3), quaternion_rates(q[3:])))


_MOTIONS: dict[str, Callable[[Joint, SX, SX], JointMotion]] = {
    "fixed": _fixed,
    "revolute": _revolute,
    "prismatic": _prismatic,
    "screw": _screw,
    "cylindrical": _cylindrical,
    "universal": _universal,
    "planar": _planar,
    "spherical": _spherical,
    "free": _free,
}
