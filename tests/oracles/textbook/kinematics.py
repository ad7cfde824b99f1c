"""Kinematics of the textbook: where every body is, and its partial velocities, in plain NumPy.

Everything is in components of the world, as one draws it on paper; ω × d is written out. All functions
take complex coordinates too, so that `along` can differentiate them exactly (Squire and Trapp, *SIAM
Review* 40 (1998) 110-112: with the step 10⁻³⁰ i the error is rounding alone).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.mechanism.joints import Joint
from deltac.mechanism.laws import evaluate, rate
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.quantities import Quantity
from deltac.mechanism.scope import GROUND

Array: TypeAlias = NDArray[Any]
"""Real, or complex inside `along`."""

_STEP = 1e-30


def along(f: Callable[[Array], Array], point: Array, direction: Array) -> Array:
    """The derivative of `f` at `point` along `direction`, exact to rounding (complex step)."""
    derivative: Array = f(point + 1j * _STEP * direction).imag / _STEP
    return derivative


def skew(a: Array) -> Array:
    """The matrix a× with (a×) b = a × b."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def turn(axis: Array, angle: Any) -> Array:
    """The rotation by `angle` about the unit vector `axis`: 1 + sin a× + (1 − cos) (a×)²."""
    a = skew(axis)
    turned: Array = np.eye(3) + np.sin(angle) * a + (1 - np.cos(angle)) * (a @ a)
    return turned


def quaternion_turn(q: Array) -> Array:
    """The rotation of the quaternion q/|q|, scalar first: 1 + 2w v× + 2 (v×)²."""
    unit = q / np.sqrt(np.sum(q * q))  # not abs(): it would not be analytic
    v = skew(unit[1:])
    turned: Array = np.eye(3) + 2 * unit[0] * v + 2 * (v @ v)
    return turned


def quaternion_rates(q: Array) -> Array:
    """W (4 by 3) of q̇ = ½ q ∘ (0, ω) = W ω, with ω in components of the turned frame."""
    return 0.5 * np.vstack([-q[1:], q[0] * np.eye(3) + skew(q[1:])])


@dataclass(frozen=True)
class JointMotion:
    """A joint with n speeds, in components of its frame on the parent.

    The frame on the child stands at `r` (3,), turned by `turned` (3, 3); relative to the parent it moves
    with ṙ = `G_v` u and turns with ω = `G_w` u (3, n each); q̇ = `W` u.
    """

    r: Array
    turned: Array
    G_v: Array
    G_w: Array
    W: Array


def joint_motion(joint: Joint, q: Array, pitch: float) -> JointMotion:
    """The motion of a joint at its own coordinates `q`; `pitch` of a screw in metres per turn."""
    none, one = np.zeros(3), np.eye(3)
    x, y, z = one
    axes = [np.array(axis) for axis in joint.axes]
    match joint.kind:
        case "fixed":
            r, turned, G_v, G_w = none, one, [], []
        case "revolute":
            r, turned, G_v, G_w = none, turn(axes[0], q[0]), [none], [axes[0]]
        case "prismatic":
            r, turned, G_v, G_w = q[0] * axes[0], one, [axes[0]], [none]
        case "screw":
            advance = pitch / (2 * math.pi) * axes[0]
            r, turned, G_v, G_w = q[0] * advance, turn(axes[0], q[0]), [advance], [axes[0]]
        case "cylindrical":
            r, turned = q[1] * axes[0], turn(axes[0], q[0])
            G_v, G_w = [none, axes[0]], [axes[0], none]
        case "universal":
            first = turn(axes[0], q[0])
            r, turned = none, first @ turn(axes[1], q[1])
            G_v, G_w = [none, none], [axes[0], first @ axes[1]]
        case "planar":
            r, turned = q[0] * x + q[1] * y, turn(z, q[2])
            G_v, G_w = [x, y, none], [none, none, z]
        case "spherical":
            turned = quaternion_turn(q)
            return JointMotion(none, turned, np.zeros((3, 3)), turned, quaternion_rates(q))
        case "free":
            turned, nothing = quaternion_turn(q[3:]), np.zeros((3, 3))
            W = np.block([[one, nothing], [np.zeros((4, 3)), quaternion_rates(q[3:])]])
            return JointMotion(
                q[:3], turned, np.hstack([one, nothing]), np.hstack([nothing, turned]), W
            )
        case other:
            raise NotImplementedError(f"joints of kind {other!r} are not in the textbook")
    return JointMotion(r, turned, _columns(G_v), _columns(G_w), np.eye(len(G_v)))


def _columns(vectors: Sequence[Array]) -> Array:
    return np.array(vectors).reshape(len(vectors), 3).T


@dataclass(frozen=True)
class Frame:
    """A body frame in the world: `origin` (3,), `turned` (3, 3; body to world components).

    `P_v`, `P_w` (3, nu): the origin's velocity is P_v u, the angular velocity P_w u.
    """

    origin: Array
    turned: Array
    P_v: Array
    P_w: Array

    def place(self, point: Array) -> Array:
        """The world position of a point given in the body frame."""
        placed: Array = self.origin + self.turned @ point
        return placed

    def partial_velocity(self, place: Array) -> Array:
        """Partial velocity (3, nu) of the body's point that is at `place` in the world: v + ω × d."""
        partial: Array = self.P_v - skew(place - self.origin) @ self.P_w
        return partial


@dataclass(frozen=True)
class Tree:
    """All bodies (and the ground) by name, and the joints between them.

    `moved` holds, for each joint, where its frame on the child is, and its partial velocity and angular
    velocity relative to the parent (3, n), all in the world.
    """

    frames: Mapping[str, Frame]
    moved: Mapping[str, tuple[Array, Array, Array]]


def numbers(mechanism: Mechanism, quantities: Sequence[Quantity]) -> Array:
    """Quantities at the parameters' values."""
    return np.array([mechanism.number(quantity) for quantity in quantities])


def tree(mechanism: Mechanism, q: Array) -> Tree:
    """Every body in the world at the coordinates `q` (nq,), from the ground outwards."""
    nu = len(mechanism.speeds)
    nothing = np.zeros((3, nu))
    frames = {GROUND: Frame(np.zeros(3), np.eye(3), nothing, nothing)}
    moved: dict[str, tuple[Array, Array, Array]] = {}
    for joint in mechanism.joints:
        parent = frames[joint.parent]
        motion = joint_motion(
            joint, q[mechanism.coordinates.of(joint.name)], mechanism.number(joint.pitch)
        )
        before = parent.turned @ np.array(joint.rotation)
        hinge = parent.place(numbers(mechanism, joint.position)) + before @ motion.r
        G_v, G_w = before @ motion.G_v, before @ motion.G_w
        moved[joint.name] = (hinge, G_v, G_w)

        select = np.eye(nu)[mechanism.speeds.of(joint.name)]
        P_w = parent.P_w + G_w @ select
        P_hinge = parent.partial_velocity(hinge) + G_v @ select
        turned = before @ motion.turned @ np.array(joint.child_rotation).T
        to_origin = -turned @ numbers(mechanism, joint.child_position)
        frames[joint.child] = Frame(hinge + to_origin, turned, P_hinge - skew(to_origin) @ P_w, P_w)
    return Tree(frames, moved)


def coordinate_rates(mechanism: Mechanism, q: Array) -> Array:
    """W (nq by nu) of q̇ = W u for all joints."""
    W = np.zeros((len(mechanism.coordinates), len(mechanism.speeds)), dtype=q.dtype)
    for joint in mechanism.joints:
        rows, columns = mechanism.coordinates.of(joint.name), mechanism.speeds.of(joint.name)
        W[rows, columns] = joint_motion(joint, q[rows], 0.0).W
    return W


def prescribed(mechanism: Mechanism, t: float) -> tuple[Array, Array, Array]:
    """Coordinates (nq,), speeds and accelerations (nu,) of the prescribed joints; zero elsewhere."""
    q = np.zeros(len(mechanism.coordinates))
    u, udot = np.zeros((2, len(mechanism.speeds)))
    known = {**mechanism.parameters, "t": t}
    for joint in mechanism.joints:
        first_q = mechanism.coordinates.of(joint.name).start
        first_u = mechanism.speeds.of(joint.name).start
        for k, law in enumerate(joint.motion):
            q[first_q + k] = evaluate(law, known)
            u[first_u + k] = evaluate(rate(law), known)
            udot[first_u + k] = evaluate(rate(rate(law)), known)
    return q, u, udot


def is_prescribed(mechanism: Mechanism) -> Array:
    """Which speeds are prescribed (nu,) of bool."""
    return np.array([entry.prescribed for entry in mechanism.speeds], dtype=bool)
