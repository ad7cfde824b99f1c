"""An imported mechanism beside the MuJoCo model that it was read from, at random states."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deltac.dynamics.forces import channels
from deltac.dynamics.recursions import crba, rnea
from deltac.dynamics.system import trace
from deltac.dynamics.terms import terms
from deltac.importers.names import body_names
from deltac.mechanism.mechanism import Mechanism

Array = NDArray[np.float64]


def random_states(mujoco: Any, model: Any, count: int, seed: int = 1) -> list[tuple[Array, Array]]:
    """States about the reference: every joint moved by about half a radian or metre."""
    rng = np.random.default_rng(seed)
    made = []
    for _ in range(count):
        q = np.array(model.qpos0)
        mujoco.mj_integratePos(model, q, rng.normal(0, 0.5, model.nv), 1.0)
        made.append((q, rng.normal(0, 1, model.nv)))
    return made


def differences(mujoco: Any, model: Any, mechanism: Mechanism, count: int = 3) -> dict[str, float]:
    """Largest differences from MuJoCo, each relative to the size of what is compared.

    Of positions and axes of all bodies, mass centres, the mass matrix, gyroscopic forces and weights,
    kinetic and potential energy, and the generalized forces of springs, dampers and gravity compensation.
    """
    system = trace(mechanism)
    parts = channels(system)
    frames = body_names(model)[1:]
    poses = [_pose(system, body) for body in frames]
    heavy = [i for i, body in enumerate(frames) if not mechanism.body(body).massless]
    centres = [_point(system, frames[i], mechanism.body(frames[i]).mass_centre) for i in heavy]
    energies = terms(system, system.udot_all, parts)
    outputs = {
        "pose": ca.horzcat(ca.SX(12, 0), *poses),
        "centre": ca.horzcat(ca.SX(3, 0), *centres),
        "mass matrix": crba(system),
        "bias": rnea(system, ca.SX.zeros(model.nv), ca.vertcat(ca.SX.zeros(3), -system.gravity)),
        "K": energies.K2 + energies.K1 + energies.K0,
        "V": energies.V,
        "springs": _sum(parts, "spring ", model.nv),
        "dampers": _sum(parts, "damper ", model.nv),
        "gravcomp": _sum(parts, "applied gravcomp", model.nv),
    }
    function = ca.Function(
        "all", [system.q, system.u], [ca.densify(ca.SX(o)) for o in outputs.values()]
    )
    data = mujoco.MjData(model)
    saved = int(model.opt.enableflags)
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    worst: dict[str, float] = dict.fromkeys(outputs, 0.0)
    for q, u in random_states(mujoco, model, count):
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = q, u
        mujoco.mj_forward(model, data)
        M = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, M)
        scale = abs(model.body_mass * np.abs(data.xipos @ model.opt.gravity)).sum()
        expected = {
            "pose": np.vstack([data.xpos[1:].T, data.xmat[1:].T]),
            "centre": data.xipos[1:][heavy].T,
            "mass matrix": M,
            "bias": data.qfrc_bias,
            "K": data.energy[1],
            "V": data.energy[0],
            "springs": data.qfrc_spring,
            "dampers": data.qfrc_damper,
            "gravcomp": data.qfrc_gravcomp,
        }
        for (what, want), found in zip(expected.items(), function.call([q, u]), strict=True):
            want = np.asarray(want, dtype=float)
            got = np.array(found).reshape(want.shape)
            size = max(np.abs(want).max(initial=0.0), scale if what == "V" else 0.0) or 1.0
            difference = float(np.abs(got - want).max(initial=0.0)) / size
            worst[what] = max(worst[what], difference if np.isfinite(difference) else np.inf)
    model.opt.enableflags = saved
    return worst


def _pose(system: Any, body: str) -> Any:
    """Origin and axes (row by row) of a body frame in the world."""
    place, origin = system.point(body, (0.0, 0.0, 0.0))
    pose, to_body = system.poses[place], system.links[place].to_body
    turned = ca.mtimes(pose.E.T, to_body.E.T)
    return ca.vertcat(pose.r + ca.mtimes(pose.E.T, origin), ca.vec(turned.T))


def _point(system: Any, body: str, point: Any) -> Any:
    place, p = system.point(body, point)
    return system.poses[place].r + ca.mtimes(system.poses[place].E.T, p)


def _sum(parts: Any, prefix: str, nv: int) -> Any:
    start = ca.SX.zeros(nv)
    return sum((part.force for part in parts if part.name.startswith(prefix)), start=start)
