"""Bodies and joints of a compiled MuJoCo model as ours.

A body stands at `body_pos`, `body_quat` on its parent and is then moved by its joints in order. Several
joints on one body become a chain with massless frames between; a body without joints is fixed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from deltac.arrays import Array, max_norm
from deltac.bodies import Body, body, frame
from deltac.importers.names import IN_MUJOCO, body_names, joint_names
from deltac.importers.report import Remark
from deltac.importers.urdf import LinkInertia, Urdf, UrdfBody
from deltac.joints import Joint, fixed, free, prismatic, revolute, spherical
from deltac.mechanism import JOINT_KINDS, as_rotation, rotation_matrix


@dataclass(frozen=True)
class Tree:
    """Bodies and joints, and what there is to say about them."""

    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...]
    remarks: tuple[Remark, ...]


def read_tree(model: Any, armature: Array, urdf: Urdf | None = None) -> Tree:
    """The tree of a model; `armature` (nv,) are the rotor inertias of all speeds.

    Links and floating joints of a `urdf` take the place of the model's bodies and of the fixed joints there.
    """
    names, bodies, joints, ignored = body_names(model), [], [], []
    links = urdf.links if urdf is not None else {}
    for i in range(1, model.nbody):
        name, parent = names[i], names[model.body_parentid[i]]
        if not links and _lost(model, i):
            what = "inertia of a body without mass"
            ignored.append(
                Remark(name, what, "its kinetic energy is missing here, so K is too small")
            )
        own = _own_joints(model, i)
        position, rotated = _placement(model, i)
        if urdf is not None and name in urdf.floating:
            joint = urdf.floating[name]
            joints.append(free(joint, name, parent, position=position, rotation=rotated))
        elif not own:
            joints.append(
                fixed(f"{name} (fixed)", parent, name, position=position, rotation=rotated)
            )
        for j in own[:-1]:
            between = f"{name} after {joint_names(model)[j]}"
            bodies.append(frame(between))
            joints.append(_joint(model, j, parent, between, armature))
            parent = between
        if own:
            joints.append(_joint(model, own[-1], parent, name, armature))
        if urdf is not None and links:
            bodies.append(
                _link(name, links.get(name, LinkInertia()), _carries(model, i, names, urdf))
            )
        else:
            bodies.append(_body(model, i, name))
    return Tree(tuple(bodies), tuple(joints), tuple(ignored))


def _own_joints(model: Any, i: int) -> list[int]:
    first = int(model.body_jntadr[i])
    return list(range(first, first + int(model.body_jntnum[i])))


def _placement(model: Any, i: int) -> tuple[Array, Array]:
    return np.array(model.body_pos[i]), turned(model.body_quat[i])


def turned(quaternion: Any) -> Array:
    """The rotation matrix of a unit quaternion, scalar first."""
    return np.array(as_rotation(list(map(float, quaternion)), "rotation"), dtype=np.float64)


def _body(model: Any, i: int, name: str) -> Body:
    mass = float(model.body_mass[i])
    if mass == 0.0:
        return frame(name)
    inertia = _inertia_carried(model, i)
    return body(name, mass, ((inertia + inertia.T) / 2).tolist(), model.body_ipos[i].tolist())


def _link(name: str, link: LinkInertia, carries: bool) -> Body:
    """The body of a URDF's link; one without mass is a frame, if what it carries has some."""
    if link.empty and carries:
        return frame(name)
    if link.rigid(1e-9 * max_norm(link.tensor)):  # as `body` judges it
        return body(name, link.mass, link.tensor, link.centre)
    return UrdfBody(name, link.mass, link.centre, link.tensor)  # type: ignore[arg-type]


def _carries(model: Any, i: int, names: Sequence[str], urdf: Urdf) -> bool:
    """Whether the joint that moves a body moves anything with inertia; True if none does."""
    while i and not model.body_jntnum[i] and names[i] not in urdf.floating:
        i = int(model.body_parentid[i])
    return i == 0 or any(
        not urdf.links.get(names[k], LinkInertia()).empty and _outward(model, i, k)
        for k in range(i, model.nbody)
    )


def _outward(model: Any, i: int, k: int) -> bool:
    """Whether body k is body i or carried by it."""
    while k > i:
        k = int(model.body_parentid[k])
    return k == i


def _inertia(model: Any, i: int) -> Array:
    """Inertia about the mass centre in body axes."""
    axes = turned(model.body_iquat[i])
    return axes @ np.diag(np.array(model.body_inertia[i], dtype=np.float64)) @ axes.T


def _inertia_carried(model: Any, i: int) -> Array:
    """The same, with that of bodies that are fixed to it and have no mass."""
    inertia = _inertia(model, i)
    for k in range(i + 1, model.nbody):
        fixed = int(model.body_parentid[k]) == i and not model.body_jntnum[k]
        if fixed and not model.body_mass[k] > 0.0:
            rotated = turned(model.body_quat[k])
            inertia = inertia + rotated @ _inertia_carried(model, k) @ rotated.T
    return inertia


def _lost(model: Any, i: int) -> bool:
    """Whether a body has inertia, but neither mass nor a parent with mass that it is fixed to."""
    if model.body_mass[i] > 0.0 or not np.asarray(model.body_inertia[i]).any():
        return False
    while i and model.body_mass[i] == 0.0 and not model.body_jntnum[i]:
        i = int(model.body_parentid[i])
    return bool(i) and model.body_mass[i] == 0.0


def _joint(model: Any, j: int, parent: str, child: str, armature: Array) -> Joint:
    name, kind = joint_names(model)[j], IN_MUJOCO[int(model.jnt_type[j])]
    i = int(model.jnt_bodyid[j])
    first = int(model.jnt_dofadr[j])
    rotors = armature[first : first + len(JOINT_KINDS[kind].speeds)]
    options: dict[str, Any] = {"armature": rotors.tolist()} if rotors.any() else {}
    if kind == "free":  # qpos is the pose in the world
        return free(name, child, parent, **options)
    # Only the first joint of a body starts at its place on the parent.
    at, rotated = np.zeros(3), np.eye(3)
    if j == int(model.body_jntadr[i]):
        at, rotated = _placement(model, i)
    anchor, axis = np.array(model.jnt_pos[j]), np.array(model.jnt_axis[j])
    reference = float(model.qpos0[model.jnt_qposadr[j]])
    match kind:
        case "revolute":
            if reference:
                options["rotation"] = rotated @ np.array(rotation_matrix(axis.tolist(), -reference))
            else:
                options["rotation"] = rotated
            placed = {"position": at + rotated @ anchor, "child_position": anchor}
            return revolute(name, parent, child, axis.tolist(), **placed, **options)
        case "prismatic":
            position = at - rotated @ axis * reference
            return prismatic(
                name, parent, child, axis.tolist(), position=position, rotation=rotated, **options
            )
    placed = {"position": at + rotated @ anchor, "child_position": anchor}
    return spherical(name, parent, child, rotation=rotated, **placed, **options)
