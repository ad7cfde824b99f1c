"""A humanoid of 27 degrees of freedom, and a log of any length of it: smooth, and exact to rounding.

The motion is prescribed, sines of every coordinate; the forces that make it are MuJoCo's, by `mj_inverse`.
So the log is one of a motion that obeys the equations, and its ledger must close.
"""

from __future__ import annotations

import multiprocessing
import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

import deltac as dc

Array = NDArray[np.float64]
STEP = 2e-3  # s
AMPLITUDE = 0.3  # rad, m
AXIS = np.array([2.0, -1.0, 2.0]) / 3.0
"""The pelvis turns to and fro about this, in the world and in itself."""

# body: (parent, place in it, half length of the capsule below, radius, axes of its hinges)
BODIES: dict[str, tuple[str, str, float, float, str]] = {
    "abdomen": ("pelvis", "0 0 0.15", 0.08, 0.09, "zy"),
    "chest": ("abdomen", "0 0 0.2", 0.12, 0.1, "x"),
    "thigh_r": ("pelvis", "0 -0.1 -0.05", -0.17, 0.06, "xzy"),
    "shin_r": ("thigh_r", "0 0 -0.4", -0.15, 0.05, "y"),
    "foot_r": ("shin_r", "0 0 -0.39", -0.03, 0.04, "yx"),
    "thigh_l": ("pelvis", "0 0.1 -0.05", -0.17, 0.06, "xzy"),
    "shin_l": ("thigh_l", "0 0 -0.4", -0.15, 0.05, "y"),
    "foot_l": ("shin_l", "0 0 -0.39", -0.03, 0.04, "yx"),
    "arm_r": ("chest", "0 -0.2 0.15", -0.12, 0.04, "xy"),
    "forearm_r": ("arm_r", "0 0 -0.3", -0.12, 0.03, "y"),
    "arm_l": ("chest", "0 0.2 0.15", -0.12, 0.04, "xy"),
    "forearm_l": ("arm_l", "0 0 -0.3", -0.12, 0.03, "y"),
}
GROUPS = ("trunk", "legs", "arms")


def mjcf() -> str:
    """The humanoid; no contacts, which a ledger takes from the log anyway."""
    return (
        '<mujoco model="humanoid"><compiler angle="radian"/>'
        f'<option timestep="{STEP}"><flag contact="disable" constraint="disable" energy="enable"/>'
        '</option><default><joint damping="2" stiffness="10" armature="0.01"/>'
        '<geom type="capsule" density="1000"/></default><worldbody><body name="pelvis" pos="0 0 1">'
        '<freejoint name="root"/><geom size="0.1" fromto="0 -0.07 0 0 0.07 0"/>'
        f"{_children('pelvis')}</body></worldbody></mujoco>"
    )


def _children(parent: str) -> str:
    return "".join(
        f'<body name="{name}" pos="{place}">'
        + "".join(f'<joint name="{name}_{a}" axis="{_axis(a)}"/>' for a in axes)
        + f'<geom size="{radius}" fromto="0 0 0 0.02 0 {2 * half}"/>{_children(name)}</body>'
        for name, (above, place, half, radius, axes) in BODIES.items()
        if above == parent
    )


def _axis(letter: str) -> str:
    return " ".join("1" if letter == each else "0" for each in "xyz")


def model() -> Any:
    """The humanoid as a MuJoCo model."""
    import mujoco

    return mujoco.MjModel.from_xml_string(mjcf())


def motion(model: Any, rows: int) -> tuple[Array, Array, Array, Array]:
    """t (T,), q (T, 28), u and u̇ (T, 27) of a motion that is known in closed form."""
    rng = np.random.default_rng(3)
    t = STEP * np.arange(rows)
    q, u, udot = np.empty((rows, model.nq)), np.empty((rows, model.nv)), np.empty((rows, model.nv))
    for k in range(model.nv):
        omega, phase = rng.uniform(2.0, 6.0), rng.uniform(0.0, 2 * np.pi)  # rad/s
        y = AMPLITUDE * np.sin(omega * t + phase)
        dy, ddy = AMPLITUDE * omega * np.cos(omega * t + phase), -(omega**2) * y
        if 3 <= k < 6:  # the turn, once
            if k == 3:
                q[:, 3], q[:, 4:7] = np.cos(y / 2), np.sin(y / 2)[:, None] * AXIS
                u[:, 3:6], udot[:, 3:6] = dy[:, None] * AXIS, ddy[:, None] * AXIS
            continue
        q[:, k if k < 3 else k + 1], u[:, k], udot[:, k] = y, dy, ddy
    return t, q, u, udot


def log(rows: int) -> dc.Trajectory:
    """A log of the humanoid: accelerations, motors of each group, and the force that carries the pelvis."""
    from deltac.importers import read_mechanism

    m = model()
    t, q, u, udot = motion(m, rows)
    needed = in_parallel(_inverse, q, u, udot)
    names = [m.joint(m.dof_jntid[k]).name.split("_")[0] for k in range(m.nv)]
    group = np.array([_group(name) for name in names])
    forces = {
        ("applied" if name == "root" else "actuator") + f" {name}": needed * (group == name)
        for name in ("root", *GROUPS)
    }
    mechanism, _ = read_mechanism(m)
    return dc.Trajectory(
        t=t,
        q=q,
        u=u,
        udot=udot,
        coordinates=mechanism.coordinates.names,
        speeds=mechanism.speeds.names,
        forces=forces,
    )


def _group(name: str) -> str:
    if name in ("thigh", "shin", "foot"):
        return "legs"
    return {"root": "root", "abdomen": "trunk", "chest": "trunk"}.get(name, "arms")


_shared: tuple[Array, ...] = ()


def in_parallel(work: Any, *arrays: Array) -> Array:
    """`work` on blocks of rows, in a process for each core, which share the arrays; the results joined."""
    global _shared
    _shared, cores = arrays, os.cpu_count() or 1
    ends = np.linspace(0, len(arrays[0]), cores + 1).astype(int).tolist()
    with multiprocessing.get_context("fork").Pool(cores) as pool:
        return np.concatenate(pool.starmap(_on_rows, [(work, *e) for e in zip(ends, ends[1:])]))


def _on_rows(work: Any, start: int, stop: int) -> Array:
    return np.asarray(work(*(a[start:stop] for a in _shared)))


def _inverse(q: Array, u: Array, udot: Array) -> Array:
    import mujoco

    m = model()
    data = mujoco.MjData(m)
    found = np.empty_like(u)
    for k in range(len(q)):
        data.qpos, data.qvel, data.qacc = q[k], u[k], udot[k]
        mujoco.mj_inverse(m, data)
        found[k] = data.qfrc_inverse
    return found
