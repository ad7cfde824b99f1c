"""A whole run of MuJoCo, recorded."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from deltac.errors import InputError, closest
from deltac.recorders.mujoco_recorder import Data, Model, integrator_names, record_mujoco
from deltac.recorders.optional import simulator
from deltac.trajectories import Trajectory

Control = Callable[[Model, Data], object]


def run_mujoco(
    model: Model | str | Path,
    duration: float,
    *,
    data: Data | None = None,
    control: Control | None = None,
    step: float | None = None,
    integrator: str | None = None,
    channels: str = "all",
    progress: Callable[[float], None] | None = None,
) -> Trajectory:
    """Run MuJoCo and record every step.

    Args:
        model: an mjModel, an mjSpec, or the path of an MJCF or URDF file. It is not changed.
        duration: s; a whole number of steps.
        data: the initial state and inputs; the model's own initial state by default. Not changed.
        control: called as control(model, data) before each step, to set data.ctrl or applied forces.
        step: time step, s; by default the model's own.
        integrator: one of `integrator_names`; by default the model's own.
        channels: as in `record_mujoco`.
        progress: called with the fraction done.

    Returns:
        The trajectory: one row for each step and one for the end. A run that blows up stops there; its
        provenance says so.

    Raises:
        InputError: MuJoCo is missing, an argument is unusable, or the forces do not add up.
    """
    mujoco = simulator("mujoco", "mujoco")
    own = copy.copy(compiled_model(model))
    if step is not None:
        own.opt.timestep = _positive("step", step)
    if integrator is not None:
        known = integrator_names()
        if integrator not in known:
            raise InputError(f"unknown integrator {integrator!r}{closest(str(integrator), known)}")
        own.opt.integrator = known[integrator]
    # A reset to the initial state in the middle of a run would hide that it blew up.
    own.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    h = float(own.opt.timestep)
    steps = round(_positive("duration", duration) / h)
    if steps < 1 or abs(steps * h - duration) > 1e-9 * duration:
        near = duration / max(1, math.ceil(duration / h))
        raise InputError(
            f"step {h:g} does not divide the duration {duration:g} (it goes {duration / h:.6g} times); the "
            f"next smaller one that does is step={near:.12g}, the nearest duration for this one "
            f"{max(1, steps) * h:.12g}"
        )
    moving = mujoco.MjData(own)
    if data is not None:
        mujoco.mj_copyData(moving, own, data)
    with record_mujoco(own, moving, channels) as recorder:
        for k in range(steps):
            if control is not None:
                control(own, moving)
            mujoco.mj_step(own, moving)
            trouble = recorder.trouble()
            if trouble:
                return recorder.trajectory(trouble)
            recorder.sample()
            if progress is not None:
                progress((k + 1) / steps)
        if control is not None:
            control(own, moving)
    return recorder.trajectory()


def compiled_model(model: Model | str | Path) -> Model:
    """The mjModel that a model, a spec or a file means; InputError for none."""
    mujoco = simulator("mujoco", "mujoco")
    if isinstance(model, mujoco.MjModel):
        return model
    try:
        if isinstance(model, mujoco.MjSpec):
            return model.compile()
        if isinstance(model, str | Path):
            return mujoco.MjModel.from_xml_path(str(model))
    except ValueError as error:
        raise InputError(f"MuJoCo cannot read the model {model!s}: {error}") from None
    raise InputError(
        f"model: found {type(model).__name__}, expected an mjModel, an mjSpec or the path of a file"
    )


def _positive(name: str, value: float) -> float:
    if not (isinstance(value, int | float | np.number) and np.isfinite(value) and value > 0):
        raise InputError(f"{name}={value!r}: expected a positive number of seconds")
    return float(value)
