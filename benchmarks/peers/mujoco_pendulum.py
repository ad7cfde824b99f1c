"""The triple pendulum in MuJoCo: RK4 by its own `rollout`, a loop over `mj_step` in C on one thread."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np
from mujoco import rollout

from peers.rival import ALONG, Array, Pendulum, Rival

TARGET = 6.0


def rivals(pendulum: Pendulum) -> Iterator[Rival]:
    """MuJoCo's method of highest order."""
    made = model(pendulum)
    data = mujoco.MjData(made)
    data.qpos[:], data.qvel[:] = pendulum.q, pendulum.u
    spec = mujoco.mjtState.mjSTATE_FULLPHYSICS
    start = np.empty(mujoco.mj_stateSize(made, spec))
    mujoco.mj_getState(made, data, start, spec)

    def run() -> Array:
        states, _ = rollout.rollout(made, data, start, nstep=pendulum.steps)
        return np.asarray(states[0, :, 1:4])

    yield Rival("MuJoCo RK4", run, pendulum.steps, 4, 4, "rollout: t, q, u", TARGET)


def model(pendulum: Pendulum) -> Any:
    """Three bars in the plane; no geometry, so that MuJoCo has no contacts to look for."""
    bars = [
        f'<body pos="0 {-above!r} 0"><joint type="hinge" axis="0 0 1"/>'
        f'<inertial pos="0 {-l / 2!r} 0" mass="{m!r}" diaginertia="{I!r} {ALONG!r} {I!r}"/>'
        for m, l, I, above in zip(
            pendulum.masses, pendulum.lengths, pendulum.inertias, pendulum.offsets
        )
    ]
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler angle="radian"/>'
        f'<option timestep="{pendulum.step!r}" integrator="RK4" gravity="0 {-pendulum.gravity!r} 0">'
        '<flag contact="disable" constraint="disable" actuation="disable"/></option>'
        f"<worldbody>{''.join(bars)}{'</body>' * 3}</worldbody></mujoco>"
    )
