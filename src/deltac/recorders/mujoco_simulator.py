"""MuJoCo as a simulator of a study: `simulator(step)` runs the same motion at any step."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from deltac.errors import InputError, closest
from deltac.importers.names import coordinate_names, speed_names
from deltac.mechanism import State
from deltac.recorders.mujoco_recorder import integrator_names
from deltac.recorders.mujoco_run import compiled_model, run_mujoco
from deltac.recorders.optional import simulator
from deltac.trajectories import Trajectory

ORDERS = {"euler": 1, "rk4": 4, "implicit": 1, "implicitfast": 1, "discrete": 1}
"""Order of each integrator in the state, for smooth forces."""


@dataclass(frozen=True, eq=False)
class MujocoSimulator:
    """A MuJoCo model, its start and its inputs; called with a step (s) it returns the recorded run.

    `solver` and `order` name the integrator and its nominal order.
    """

    model: Any
    duration: float
    integrator: str
    control: Callable[[Any, Any], object] | None
    data: Any

    @property
    def solver(self) -> str:
        """The integrator, as "mujoco:rk4"."""
        return f"mujoco:{self.integrator}"

    @property
    def order(self) -> int | None:
        """The integrator's order, None for one that is not known."""
        return ORDERS.get(self.integrator)

    def __call__(self, step: float) -> Trajectory:
        """The run at this step."""
        return run_mujoco(
            self.model,
            self.duration,
            data=self.data,
            control=self.control,
            step=step,
            integrator=self.integrator,
        )


def mujoco_simulator(
    model: Any,
    duration: float,
    *,
    integrator: str = "rk4",
    control: Callable[[Any, Any], object] | None = None,
    state: State | Any = None,
) -> MujocoSimulator:
    """A MuJoCo model as the `simulator` of a study.

    Args:
        model: an mjModel, an mjSpec, or the path of an MJCF or URDF file.
        duration: s; each step must divide it.
        integrator: "euler", "rk4", "implicit", "implicitfast", or another of the installed MuJoCo.
        control: called as control(model, data) before each step. It is held over the step, so a motion
            that depends on it is of first order in the step, whatever the integrator.
        state: where it starts: an mjData, or a state of the imported mechanism; by default the model's own
            initial state.

    Raises:
        InputError: MuJoCo is missing, the integrator is unknown, or model or state cannot be used.
    """
    mujoco = simulator("mujoco", "mujoco")
    known = integrator_names()
    name = integrator.lower()
    if name not in known:
        raise InputError(f"unknown integrator {integrator!r}{closest(name, known)}")
    own = copy.copy(compiled_model(model))
    data = mujoco.MjData(own)
    if isinstance(state, State):
        _set_state(own, data, state)
    elif state is not None:
        mujoco.mj_copyData(data, own, state)
    return MujocoSimulator(own, duration, name, control, data)


def _set_state(model: Any, data: Any, state: State) -> None:
    """Give the data a mechanism's state; its columns are in MuJoCo's order where they are as many."""
    q, u = np.asarray(state.q), np.asarray(state.u)
    if q.shape != data.qpos.shape or u.shape != data.qvel.shape:
        raise InputError(
            f"the state has {q.size} coordinates and {u.size} speeds, the MuJoCo model {data.qpos.size} "
            f"and {data.qvel.size} ({', '.join(coordinate_names(model)[:6])} …; "
            f"{', '.join(speed_names(model)[:6])} …): give state= as an mjData of this model"
        )
    data.qpos[:], data.qvel[:] = q, u
    data.time = state.t
