"""Names of a MuJoCo model's elements, coordinates and speeds: one rule for importer and recorder.

An element without a name is called by its kind and index (``joint3``). Coordinates and speeds follow
the mechanism's own rule: the joint's name for one coordinate, ``<joint>.<part>`` for several.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from deltac.errors import ModelError
from deltac.mechanism import GROUND, JOINT_KINDS

IN_MUJOCO = ("free", "spherical", "prismatic", "revolute")
"""Our kind of joint for each value of `mjtJoint`: free, ball, slide, hinge."""


def model_name(model: Any) -> str:
    """The model's own name, the first of all names; "" without one."""
    return bytes(model.names).split(b"\0", 1)[0].decode("utf-8", "replace")


def body_names(model: Any) -> list[str]:
    """All bodies, the world first: it is called ``ground``, as in every mechanism."""
    names = (model.body(i).name for i in range(1, model.nbody))
    return [GROUND, *_named(names, "body", reserved=[GROUND], first=1)]


def joint_names(model: Any) -> list[str]:
    """All joints, in the order of qpos and qvel."""
    return _named((model.joint(i).name for i in range(model.njnt)), "joint")


def tendon_names(model: Any) -> list[str]:
    """All tendons; one that shares its name with a joint gets `` tendon`` after it.

    Joints and tendons share the channels ``spring``, ``damper``, ``limit`` and ``friction``.
    """
    names = (model.tendon(i).name for i in range(model.ntendon))
    return _named(names, "tendon", reserved=joint_names(model))


def actuator_names(model: Any) -> list[str]:
    """All actuators."""
    count = model.nactuator if hasattr(model, "nactuator") else model.nu
    return _named((model.actuator(i).name for i in range(count)), "actuator")


def equality_names(model: Any) -> list[str]:
    """All equality constraints."""
    return _named((model.equality(i).name for i in range(model.neq)), "equality")


def geom_names(model: Any) -> list[str]:
    """All geoms."""
    return _named((model.geom(i).name for i in range(model.ngeom)), "geom")


def coordinate_names(model: Any) -> list[str]:
    """The entries of qpos."""
    return _parts(model, "coordinates")


def speed_names(model: Any) -> list[str]:
    """The entries of qvel."""
    return _parts(model, "speeds")


def _parts(model: Any, what: str) -> list[str]:
    names: list[str] = []
    for name, kind in zip(joint_names(model), model.jnt_type, strict=True):
        for suffix, _ in getattr(JOINT_KINDS[IN_MUJOCO[int(kind)]], what):
            names.append(f"{name}.{suffix}" if suffix else name)
    return names


def _named(
    originals: Iterable[str], kind: str, reserved: Iterable[str] = (), first: int = 0
) -> list[str]:
    """The given names; where there is none the kind and index, where it is taken with the kind after."""
    try:
        names = [name.strip() for name in originals]
    except UnicodeDecodeError:
        raise ModelError(
            f"the name of a {kind} is not UTF-8 text; save the model as such"
        ) from None
    used, outside = set(names), set(reserved)
    for i, name in enumerate(names):
        if not name:
            name = f"{kind}{first + i}"
            while name in used or name in outside:
                name += "'"
        elif name in outside:
            name += f" {kind}"
            while name in used:
                name += "'"
        names[i] = name
        used.add(name)
    return names


def sole_actuators(model: Any) -> dict[str, str]:
    """Actuator -> its joint, of actuators that are the only ones on a joint."""
    import mujoco

    names, joints = actuator_names(model), joint_names(model)
    on_joint = np.asarray(model.actuator_trntype) == mujoco.mjtTrn.mjTRN_JOINT
    of = np.where(on_joint, np.asarray(model.actuator_trnid)[:, 0], -1).tolist()
    return {name: joints[k] for name, k in zip(names, of) if k >= 0 and of.count(k) == 1}


# --- the strengths of MuJoCo's simple actuators --------------------------------------------------

Strengths = dict[str, tuple[float, ...]]


def motor_strengths(model: Any) -> Strengths:
    """Actuator -> gain × gear (6,): force per unit of control, where that is all of its law.

    These are the actuators of fixed gain without a bias; servos and muscles are not among them. A motor
    of several outputs has six numbers for each.
    """
    import mujoco

    strengths: Strengths = {}
    for k, (name, gear) in enumerate(zip(actuator_names(model), _gears(model))):
        fixed = int(model.actuator_gaintype[k]) == int(mujoco.mjtGain.mjGAIN_FIXED)
        biased = int(model.actuator_biastype[k]) != int(mujoco.mjtBias.mjBIAS_NONE)
        if fixed and not biased:
            strengths[name] = tuple(float(x) for x in model.actuator_gainprm[k, 0] * gear)
    return strengths


def _gears(model: Any) -> list[Any]:
    """Gears of each actuator: six numbers for each of its outputs."""
    gears = np.asarray(model.actuator_gear)
    outputs = np.asarray(getattr(model, "actuator_outnum", np.ones(len(gears), dtype=int)))
    return [x.ravel() for x in np.split(gears, np.cumsum(outputs)[:-1])] if len(outputs) else []


@dataclass(frozen=True)
class Feedback:
    """What an actuator adds to a hinge or slide by its bias: −stiffness · q − damping · u, N or N·m."""

    joint: str
    speed: str
    stiffness: float
    damping: float


def feedback(model: Any) -> dict[str, Feedback]:
    """Actuator -> the state in its law, of those of affine bias on a hinge or slide: position servos, ….

    Limits of the force, and a gain that varies with the state, are not looked at.
    """
    import mujoco

    laws: dict[str, Feedback] = {}
    joints, speeds = joint_names(model), speed_names(model)
    affine, on_joints = int(mujoco.mjtBias.mjBIAS_AFFINE), int(mujoco.mjtTrn.mjTRN_JOINT)
    single = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    for k, (name, gear) in enumerate(zip(actuator_names(model), _gears(model))):
        joint = int(model.actuator_trnid[k, 0])
        if int(model.actuator_trntype[k]) != on_joints or int(model.jnt_type[joint]) not in single:
            continue
        if int(model.actuator_biastype[k]) == affine:
            stiffness, damping = (
                -float(x) * float(gear[0]) ** 2 for x in model.actuator_biasprm[k, 1:3]
            )
            speed = speeds[int(model.jnt_dofadr[joint])]
            laws[name] = Feedback(joints[joint], speed, stiffness, damping)
    return laws


def servo_damping(model: Any) -> dict[str, float]:
    """Speed of a hinge or slide -> damping in the laws of its servos, N·s/m or N·m·s/rad, if there is any."""
    damping: dict[str, float] = {}
    for law in feedback(model).values():
        if law.damping:
            damping[law.speed] = damping.get(law.speed, 0.0) + law.damping
    return damping
