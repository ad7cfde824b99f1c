"""Kinematics of every kind of joint: placement, partial velocities, and the rates of coordinates."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca

from deltac.dynamics.spatial import (
    SX,
    Transform,
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


def _placed(R: SX, r: SX, S: SX, W: SX | None = None) -> JointMotion:
    return JointMotion(Transform(R.T, r), S, ca.SX.eye(S.shape[1]) if W is None else W)


def _axis(joint: Joint, which: int = 0) -> SX:
    return ca.SX(ca.DM(list(joint.axes[which])))


_ORIGIN = ca.SX.zeros(3)


def _fixed(joint: Joint, q: SX, pitch: SX) -> JointMotion:
    return _placed(ca.SX.eye(3), _ORIGIN, ca.SX(6, 0), ca.SX(0, 0))


def _revolute(joint: Joint, q: SX, pitch: SX) -> JointMotion:
    a = _axis(joint)
    return _placed(axis_rotation(joint.axes[0], q), _ORIGIN, ca.vertcat(a, _ORIGIN))


def _prismatic(joint: Joint, q: SX, pitch: SX) -> JointMotion:
    a = _axis(joint)
    return _placed(ca.SX.eye(3), a * q, ca.vertcat(_ORIGIN, a))


def _screw(joint: Joint, q: SX, pitch: SX) -> JointMotion:
    a, lead = _axis(joint), pitch / (2 * math.pi)
    return _placed(axis_rotation(joint.axes[0], q), a * lead * q, ca.vertcat(a, lead * a))


def _cylindrical(joint: Joint, q: SX, pitch: SX) -> JointMotion:
    a = _axis(joint)
    return _placed(axis_rotation(joint.axes[0], q[0]), a * q[1], ca.diagcat(a, a))


def _universal(joint: Joint, q: SX, pitch: SX) -> JointMotion:
    first, second = (axis_rotation(axis, q[k]) for k, axis in enumerate(joint.axes))
    partial = ca.horzcat(ca.mtimes(second.T, _axis(joint)), _axis(joint, 1))
    return _placed(ca.mtimes(first, second), _ORIGIN, ca.vertcat(partial, ca.SX.zeros(3, 2)))


def _planar(joint: Joint, q: SX, pitch: SX) -> JointMotion:
    R = axis_rotation((0.0, 0.0, 1.0), q[2])
    z = ca.SX(ca.DM([0, 0, 1]))
    S = ca.horzcat(
        ca.vertcat(ca.SX.zeros(3, 2), R.T[:, :2]),
        ca.vertcat(z, _ORIGIN),
    )
    return _placed(R, ca.vertcat(q[0], q[1], 0), S)


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
