"""ABA, CRBA and RNEA against Pinocchio and MuJoCo: the same random trees, built in both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from numpy.typing import NDArray

from deltac.dynamics.recursions import aba, crba, rnea
from deltac.dynamics.spatial import SX
from deltac.dynamics.system import System, trace
from deltac.mechanism.joints import Joint
from deltac.mechanism.mechanism import Mechanism
from tests.systems.random_mechanisms import Options, Sample, assert_close, largest, samples

Array = NDArray[Any]

# All three solve the same system by other routes, so its condition bounds their agreement.
ROUNDING = 1e-13

PLAIN = Options(
    prescribed=False, forces=False, massless=False, thin=False, armature_on_quaternions=False
)


def weight(system: System) -> SX:
    """The ground's acceleration that stands for gravity."""
    return ca.vertcat(ca.SX.zeros(3), -system.gravity)


def compare(sample: Sample, M: Array, tau: Array, solve: Callable[[Array], Array]) -> None:
    """Against another engine's mass matrix, inverse dynamics at `udot`, and forward dynamics."""
    system = trace(sample.mechanism)
    applied = np.linspace(-1, 1, len(sample.u))
    inverse = rnea(system, system.udot_all, weight(system))
    forward, _ = aba(system, ca.SX(ca.DM(applied)), weight(system))
    found = sample.evaluate(system, crba(system), inverse, forward)
    assert_close(found[0], M)
    assert_close(found[1], tau, scale=largest(M) * (1 + largest(sample.u) ** 2))
    condition = float(np.linalg.cond(M)) if len(M) else 1.0
    assert_close(found[2], solve(applied), ROUNDING * max(10.0, condition))


def depth_first(mechanism: Mechanism) -> list[Joint]:
    """Both engines keep the joints of a subtree together."""

    def below(body: str) -> list[Joint]:
        return [j for joint in mechanism.children[body] for j in (joint, *below(joint.child))]

    return below("ground")


# --- Pinocchio ---------------------------------------------------------------------------------------

IN_PINOCCHIO = ("fixed", "revolute", "prismatic", "screw", "cylindrical", "spherical", "free")


def pinocchio_joint(pin: Any, joint: Joint, pitch: float) -> Any:
    axes = [np.array(axis) for axis in joint.axes]
    match joint.kind:
        case "revolute":
            return pin.JointModelRevoluteUnaligned(axes[0])
        case "prismatic":
            return pin.JointModelPrismaticUnaligned(axes[0])
        case "screw":
            return pin.JointModelHelicalUnaligned(axes[0], pitch / (2 * np.pi))
        case "cylindrical":
            both = pin.JointModelComposite()
            both.addJoint(pin.JointModelRevoluteUnaligned(axes[0]))
            both.addJoint(pin.JointModelPrismaticUnaligned(axes[0]))
            return both
        case "spherical":
            return pin.JointModelSpherical()
    return pin.JointModelFreeFlyer()


def in_pinocchio(pin: Any, mechanism: Mechanism) -> Any:
    """Its joint frames are ours on the child; bodies are set into them."""

    def numbers(quantities: Any) -> Array:
        return np.array([mechanism.number(quantity) for quantity in quantities])

    model = pin.Model()
    model.gravity.linear = numbers(mechanism.gravity)
    carrier = {"ground": (0, pin.SE3.Identity())}
    for joint in depth_first(mechanism):
        parent, parent_body = carrier[joint.parent]
        before = parent_body * pin.SE3(np.array(joint.rotation), numbers(joint.position))
        on_child = pin.SE3(np.array(joint.child_rotation), numbers(joint.child_position))
        if joint.kind == "fixed":
            index, placed = parent, before * on_child.inverse()
        else:
            own = pinocchio_joint(pin, joint, mechanism.number(joint.pitch))
            index = model.addJoint(parent, own, before, joint.name)
            placed = on_child.inverse()
        body = mechanism.body(joint.child)
        central = np.array([numbers(row) for row in body.inertia])
        inertia = pin.Inertia(mechanism.number(body.mass), numbers(body.mass_centre), central)
        model.appendBodyToJoint(index, inertia, placed)
        carrier[joint.child] = (index, placed)
    return model


def to_pinocchio(sample: Sample) -> tuple[Array, Array, Array]:
    """q in Pinocchio's order (quaternions scalar last), T of v = T u, and Ṫ u.

    Pinocchio's free flyer has its linear velocity in body components: v = Rᵀ ẋ, v̇ = Rᵀ ẍ − ω × v.
    """
    book, mechanism = sample.book, sample.mechanism
    nu = len(sample.u)
    q, T, bias = [np.zeros(0)], [np.zeros((0, nu))], [np.zeros(0)]
    for joint in depth_first(mechanism):
        own = sample.q[mechanism.coordinates.of(joint.name)].copy()
        select = np.eye(nu)[mechanism.speeds.of(joint.name)]
        rest = np.zeros(len(select))
        if joint.kind in ("spherical", "free"):
            own[-4:] = np.roll(own[-4:], -1)
        if joint.kind == "free":
            before = book.tree.frames[joint.parent].turned @ np.array(joint.rotation)
            R = before.T @ book.tree.frames[joint.child].turned
            select[:3] = R.T @ select[:3]
            rest[:3] = -np.cross(select[3:] @ sample.u, select[:3] @ sample.u)
        q.append(own)
        T.append(select)
        bias.append(rest)
    return np.concatenate(q), np.vstack(T), np.concatenate(bias)


@given(samples(replace(PLAIN, joints=IN_PINOCCHIO, armature=False)))
def test_pinocchio(sample: Sample) -> None:
    pin = pytest.importorskip("pinocchio", reason="Pinocchio is not installed on this platform")
    model = in_pinocchio(pin, sample.mechanism)
    data = model.createData()
    q, T, bias = to_pinocchio(sample)
    M = np.array(pin.crba(model, data, q))
    M = np.triu(M) + np.triu(M, 1).T
    tau = pin.rnea(model, data, q, T @ sample.u, T @ sample.udot + bias)

    def solve(applied: Array) -> Array:
        a = pin.aba(model, data, q, T @ sample.u, T @ applied)  # T is orthogonal: T⁻ᵀ = T
        return np.asarray(T.T @ (a - bias))

    compare(sample, T.T @ M @ T, T.T @ tau, solve)


# --- MuJoCo ------------------------------------------------------------------------------------------

IN_MUJOCO = ("fixed", "revolute", "prismatic", "cylindrical", "universal", "planar", "spherical")
"""Its free joints stand on the world only, so they are drawn as the first joint of a tree."""


def text(values: Any) -> str:
    return " ".join(repr(float(value)) for value in np.asarray(values).ravel())


def in_mjcf(mujoco: Any, mechanism: Mechanism) -> str:
    """The mechanism as MJCF: bodies nested in the pose of q = 0, joints in the child's frame."""

    def numbers(quantities: Any) -> Array:
        return np.array([mechanism.number(quantity) for quantity in quantities])

    def quaternion(turned: Array) -> str:
        made = np.zeros(4)
        mujoco.mju_mat2Quat(made, np.ascontiguousarray(turned).ravel())
        return text(made)

    def joints(joint: Joint) -> str:
        on_child = np.array(joint.child_rotation)
        axes = [on_child @ np.array(axis) for axis in joint.axes]
        x, y, z = on_child.T
        parts: list[tuple[str, Any]] = {
            "fixed": [],
            "revolute": [("hinge", axes)],
            "prismatic": [("slide", axes)],
            "cylindrical": [("hinge", axes), ("slide", axes)],
            "universal": [("hinge", axes[:1]), ("hinge", axes[1:])],
            "planar": [("slide", [x]), ("slide", [y]), ("hinge", [z])],
            "spherical": [("ball", [z])],
            "free": [("free", [z])],
        }[joint.kind]
        rotors = numbers(joint.armature) if joint.armature else np.zeros(len(parts))
        at = text(numbers(joint.child_position))
        return "".join(
            f'<joint type="{kind}" pos="{at}" axis="{text(axis[0])}" armature="{float(a)!r}"/>'
            for (kind, axis), a in zip(parts, rotors, strict=False)
        )

    def body(joint: Joint) -> str:
        own = mechanism.body(joint.child)
        turned = np.array(joint.rotation) @ np.array(joint.child_rotation).T
        at = numbers(joint.position) - turned @ numbers(joint.child_position)
        moments, principal = np.linalg.eigh([numbers(row) for row in own.inertia])
        principal = principal * np.sign(np.linalg.det(principal))
        inside = "".join(body(below) for below in mechanism.children[own.name])
        return (
            f'<body pos="{text(at)}" quat="{quaternion(turned)}">{joints(joint)}'
            f'<inertial mass="{mechanism.number(own.mass)!r}" pos="{text(numbers(own.mass_centre))}" '
            f'quat="{quaternion(principal)}" diaginertia="{text(moments)}"/>{inside}</body>'
        )

    tree = "".join(body(joint) for joint in mechanism.children["ground"])
    return (
        f'<mujoco><compiler angle="radian"/><option gravity="{text(numbers(mechanism.gravity))}"/>'
        f"<worldbody>{tree}</worldbody></mujoco>"
    )


def to_mujoco(mujoco: Any, sample: Sample) -> tuple[Array, Array]:
    """qpos, and T of qvel = T u: MuJoCo's order; a free joint counts from the world, not its frame."""
    mechanism = sample.mechanism
    q, T = [np.zeros(0)], [np.zeros((0, len(sample.u)))]
    for joint in depth_first(mechanism):
        own = sample.q[mechanism.coordinates.of(joint.name)]
        select = np.eye(len(sample.u))[mechanism.speeds.of(joint.name)]
        if joint.kind == "free":
            placed, turned = sample.book.tree.frames[joint.child], np.zeros(4)
            mujoco.mju_mat2Quat(turned, np.ascontiguousarray(placed.turned).ravel())
            own = np.concatenate([placed.origin, turned])
            select[:3] = np.array(joint.rotation) @ select[:3]
        q.append(own)
        T.append(select)
    return np.concatenate(q), np.vstack(T)


def mujoco_agrees(sample: Sample) -> None:
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed on this platform")
    model = mujoco.MjModel.from_xml_string(in_mjcf(mujoco, sample.mechanism))
    data = mujoco.MjData(model)
    q, T = to_mujoco(mujoco, sample)
    assert model.nv == len(sample.u)
    if not model.nv:
        return
    data.qpos, data.qvel, data.qacc = q, T @ sample.u, T @ sample.udot
    mujoco.mj_forward(model, data)
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    tau = M @ (T @ sample.udot) + data.qfrc_bias

    def solve(applied: Array) -> Array:
        data.qfrc_applied = T @ applied
        mujoco.mj_forward(model, data)
        return np.asarray(T.T @ np.array(data.qacc))

    compare(sample, T.T @ M @ T, T.T @ tau, solve)


@given(samples(replace(PLAIN, joints=IN_MUJOCO)))
def test_mujoco(sample: Sample) -> None:
    mujoco_agrees(sample)


@given(samples(replace(PLAIN, joints=IN_MUJOCO, first="free")))
def test_mujoco_floating(sample: Sample) -> None:
    mujoco_agrees(sample)
