"""Passive forces of a compiled MuJoCo model as ours: springs, dampers, tendons, gravity compensation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from deltac.arrays import Array
from deltac.forces import gravity_compensation, joint_damper, joint_spring, tendon
from deltac.importers.names import (
    IN_MUJOCO,
    actuator_names,
    body_names,
    joint_names,
    speed_names,
    tendon_names,
)
from deltac.importers.report import Findings, Remark
from deltac.laws import q, u
from deltac.mechanism import JOINT_KINDS, JointSpring, Tendon


def total_armature(model: Any) -> Array:
    """Rotor inertias of all speeds (nv,): of joints, and of the actuators that drive them (gear² times)."""
    total = np.array(model.dof_armature, dtype=float)
    for a, joint in _on_joints(model):
        total[_dofs(model, joint)] += _gear(model, a) ** 2 * _each(model, "actuator_armature", a)
    return total


def read_passive(model: Any, findings: Findings) -> None:
    """Springs and dampers of joints and tendons, and gravity compensation, into `findings`."""
    springs, dampers = (not disabled(model, name) for name in ("SPRING", "DAMPER"))
    for on, what in ((springs, "springs"), (dampers, "dampers")):
        if not on:
            findings.assume("option", f"all passive {what} are switched off")
    for j, name in enumerate(joint_names(model)):
        if springs:
            _joint_spring(model, j, name, findings)
        if dampers:
            _joint_damper(model, j, name, findings)
    for k, name in enumerate(tendon_names(model)):
        _tendon(model, k, name, springs, dampers, findings)
    _gravity_compensation(model, findings)


def disabled(model: Any, name: str) -> bool:
    """Whether an option's flag (``"GRAVITY"``, ``"CONTACT"``, …) switches something off.

    One flag switches off all that MuJoCo's constraint solver makes: contacts, limits, dry friction and
    equalities.
    """
    import mujoco

    names = (name, "CONSTRAINT") if name in OF_CONSTRAINTS else (name,)
    flags = [int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{n}")) for n in names]
    return any(int(model.opt.disableflags) & flag for flag in flags)


OF_CONSTRAINTS = ("CONTACT", "LIMIT", "FRICTIONLOSS", "EQUALITY")
"""Flags of what MuJoCo's constraint solver makes."""


def _polynomial(model: Any, array: str, i: int) -> list[float]:
    """Linear and higher coefficients, trailing zeros left out; older versions have the linear one only."""
    first = float(getattr(model, array)[i])
    higher = getattr(model, f"{array}poly", None)
    coefficients = [first, *(map(float, higher[i]) if higher is not None else ())]
    while len(coefficients) > 1 and coefficients[-1] == 0.0:
        coefficients.pop()
    return coefficients


def _each(model: Any, array: str, i: int) -> float:
    """An entry of an array that not every version of MuJoCo has."""
    values = getattr(model, array, None)
    return 0.0 if values is None else float(values[i])


# --- joints ------------------------------------------------------------------------------------------


def _dofs(model: Any, joint: int) -> slice:
    first = int(model.jnt_dofadr[joint])
    return slice(first, first + len(JOINT_KINDS[IN_MUJOCO[int(model.jnt_type[joint])]].speeds))


def _joint_spring(model: Any, j: int, name: str, findings: Findings) -> None:
    k = _polynomial(model, "jnt_stiffness", j)
    if not any(k):
        return
    kind = IN_MUJOCO[int(model.jnt_type[j])]
    place = int(model.jnt_qposadr[j])
    rest = np.array(
        model.qpos_spring[place : place + len(JOINT_KINDS[kind].coordinates)], dtype=float
    )
    if _plastic(model, "jnt", j):
        findings.leave_to_log(name, "spring that yields", f"spring {name}")
    elif kind in ("revolute", "prismatic"):
        if len(k) == 1:
            findings.forces.append(joint_spring(name, name, k[0], float(rest[0])))
        else:
            x = q(name) - float(rest[0])
            potential = sum(a * x ** (n + 1) / (n + 1) for n, a in enumerate(k, 1))
            findings.forces.append(joint_spring(name, name, potential=potential))
        findings.note(name, f"spring, stiffness {_shown(k)}, rest {rest[0]:g}")
    elif len(k) > 1 or not np.allclose(rest[-4:], [1, 0, 0, 0], rtol=0, atol=1e-12):
        what = "spring of a rotation with higher coefficients or a turned rest position"
        findings.leave_to_log(name, what, f"spring {name}")
    else:
        count = len(rest) - 3
        stiffness, at = (k[0],) * count, (*map(float, rest[:-4]), 0.0)
        findings.forces.append(JointSpring(name, name, stiffness, at))
        findings.note(name, f"spring, stiffness {_shown(k)}")


def _joint_damper(model: Any, j: int, name: str, findings: Findings) -> None:
    speeds = speed_names(model)[_dofs(model, j)]
    c = np.zeros((len(speeds), 3))
    for row, dof in enumerate(range(*_dofs(model, j).indices(model.nv))):
        own = _polynomial(model, "dof_damping", dof)
        c[row, : len(own)] += own
    for a, joint in _on_joints(model):
        if joint == j:
            added = _gear(model, a) ** 2 * np.array(_polynomial(model, "actuator_damping", a))
            c[:, : len(added)] += added
            if added.any():
                who = actuator_names(model)[a]
                findings.note(name, f"damping of actuator {who} {_shown(added)}")
    if c.any():
        laws = [_damping(list(map(float, row)), speed) for row, speed in zip(c, speeds)]
        findings.forces.append(joint_damper(name, name, laws))
        findings.note(name, f"damper, {_shown(c[0])}")


def _damping(c: Sequence[float], speed: str) -> Any:
    """The coefficient of −u in −(a u + b u|u| + c u³)."""
    if not any(c[1:]):
        return c[0]
    return c[0] + c[1] * abs(u(speed)) + c[2] * u(speed) ** 2


def _on_joints(model: Any) -> list[tuple[int, int]]:
    """Actuators that act on a joint, and that joint."""
    import mujoco

    kinds = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
    return _acting(model, tuple(map(int, kinds)))


def _on_tendons(model: Any) -> list[tuple[int, int]]:
    import mujoco

    return _acting(model, (int(mujoco.mjtTrn.mjTRN_TENDON),))


def _acting(model: Any, kinds: tuple[int, ...]) -> list[tuple[int, int]]:
    return [
        (a, int(model.actuator_trnid[a, 0]))
        for a in range(len(actuator_names(model)))
        if int(model.actuator_trntype[a]) in kinds
    ]


def _gear(model: Any, actuator: int) -> float:
    outputs = getattr(model, "actuator_outadr", None)
    row = actuator if outputs is None else int(outputs[actuator])
    return float(model.actuator_gear[row, 0])


# --- tendons -----------------------------------------------------------------------------------------


def _tendon(
    model: Any, k: int, name: str, springs: bool, dampers: bool, findings: Findings
) -> None:
    stiffness = _polynomial(model, "tendon_stiffness", k) if springs else [0.0]
    damping = np.zeros(3)
    if dampers:
        own = _polynomial(model, "tendon_damping", k)
        damping[: len(own)] += own
    armature = _each(model, "tendon_armature", k)
    for a, target in _on_tendons(model):
        if target == k:
            gear = _gear(model, a) ** 2
            armature += gear * _each(model, "actuator_armature", a)
            if dampers and hasattr(model, "actuator_damping"):
                added = gear * np.array(_polynomial(model, "actuator_damping", a))
                damping[: len(added)] += added
    if armature:
        findings.ignored.append(
            Remark(
                name,
                f"inertia of the tendon, {armature:g} kg",
                "its kinetic energy ½ m l̇² is missing here, so K is too small",
            )
        )
    if not any(stiffness) and not damping.any():
        findings.note(name, "tendon without spring and damper: it carries forces only")
        return
    if any(stiffness) and _plastic(model, "tendon", k):
        findings.leave_to_log(name, "spring that yields", f"spring {name}")
        stiffness = [0.0]
    element = _path(model, k, name, stiffness, damping.tolist())
    if element is None:
        for kind, values in (("spring", stiffness), ("damper", damping)):
            if any(values):
                what = f"{kind} of a tendon that wraps around geoms"
                findings.leave_to_log(name, what, f"{kind} {name}")
    elif any(stiffness) or damping.any():
        findings.forces.append(element)
        shown = f"stiffness {_shown(stiffness)}, damping {_shown(damping)}"
        findings.note(name, f"tendon, {shown}")


def _path(
    model: Any, k: int, name: str, stiffness: Sequence[float], damping: Sequence[float]
) -> Tendon | None:
    """The tendon; None if it wraps around a geom."""
    import mujoco

    wrap = mujoco.mjtWrap
    coordinates: dict[str, float] = {}
    branches: list[tuple[list[tuple[str, list[float]]], float]] = [([], 1.0)]
    first = int(model.tendon_adr[k])
    for w in range(first, first + int(model.tendon_num[k])):
        which, value = int(model.wrap_objid[w]), float(model.wrap_prm[w])
        match int(model.wrap_type[w]):
            case wrap.mjWRAP_JOINT:
                joint = joint_names(model)[which]
                coordinates[joint] = coordinates.get(joint, 0.0) + value
            case wrap.mjWRAP_SITE:
                body = body_names(model)[model.site_bodyid[which]]
                branches[-1][0].append((body, model.site_pos[which].tolist()))
            case wrap.mjWRAP_PULLEY:
                branches.append(([], 1.0 / value))
            case _:
                return None
    low, high = map(float, model.tendon_lengthspring[k])
    return tendon(
        name,
        coordinates=coordinates,
        branches=[branch for branch in branches if len(branch[0]) > 1],
        stiffness=list(stiffness),
        damping=list(damping),
        length=(low, high),
    )


# --- gravity compensation ----------------------------------------------------------------------------


def _gravity_compensation(model: Any, findings: Findings) -> None:
    if disabled(model, "GRAVITY"):
        return
    fractions = {
        name: float(model.body_gravcomp[i])
        for i, name in enumerate(body_names(model))
        if i and model.body_gravcomp[i] != 0.0 and model.body_mass[i] > 0.0
    }
    if fractions:
        findings.forces.append(gravity_compensation("gravcomp", fractions))
        for name, fraction in fractions.items():
            findings.note(name, f"gravity compensation of {fraction:g} of its weight")


def _plastic(model: Any, kind: str, i: int) -> bool:
    places = getattr(model, f"{kind}_plasticadr", None)
    return places is not None and int(places[i]) >= 0


def _shown(values: Any) -> str:
    entries = [float(value) for value in values]
    while len(entries) > 1 and entries[-1] == 0.0:
        entries.pop()
    return ", ".join(f"{value:g}" for value in entries)
