"""Recording MuJoCo: every row one consistent instant, whatever the integrator leaves in mjData.

After mj_step, mjData holds the new qpos and qvel beside accelerations and forces of the old state; with
RK4 those of its last stage. So each step is replayed on a private copy of the state before it, with
the inputs it had: the row is the state *before* the step, with q̈ and the forces of the step's first
forward pass, and the replayed state must be the one that MuJoCo reached.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from types import TracebackType
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.errors import InputError, closest
from deltac.importers.motors import motor_strengths
from deltac.importers.names import coordinate_names, speed_names
from deltac.recorders.builder import TrajectoryBuilder
from deltac.recorders.mujoco_forces import (
    OCCASIONAL,
    ROUNDING,
    Elements,
    Forces,
    discrete,
    generalized_forces,
    mass_times,
)
from deltac.recorders.optional import simulator
from deltac.trajectories import Provenance, Trajectory

Array: TypeAlias = NDArray[np.float64]
Model: TypeAlias = Any
Data: TypeAlias = Any

CHANNELS = ("all", "grouped")
EPS = float(np.finfo(np.float64).eps)
INPUTS = (
    "ctrl",
    "qfrc_applied",
    "xfrc_applied",
    "eq_active",
    "mocap_pos",
    "mocap_quat",
    "userdata",
)
"""What a user may set between two steps."""

REPLAY = 1e-6
"""How far a replayed step may be off, relative: the constraint solver's tolerance, not more."""

IMPLICIT = "correction implicit"
"""The force that an implicit integrator adds to those of the start of the step: M(q_k)(a − q̈)."""


STAGES = {
    "explicit": "state before each step, with the accelerations and forces that the step used; forces are "
    "held over a step",
    "implicit": "state before each step; udot is the step's (u_{k+1} - u_k)/h, and channel '"
    + IMPLICIT
    + "' what the implicit integrator added to the forces at the start of the step: M udot + bias = sum "
    "of forces; its work is part of the integrator's error",
    "rk4": "state before each step, with the accelerations and forces of its first stage, continuous "
    "dynamics; those of stages 2 to 4 are not recorded, so discrete work does not close",
}


def integrator_names() -> dict[str, Any]:
    """Name -> value of every integrator of the installed MuJoCo: euler, rk4, implicit, …."""
    values = simulator("mujoco", "mujoco").mjtIntegrator.__members__
    return {name.removeprefix("mjINT_").lower(): value for name, value in values.items()}


def record_mujoco(model: Model, data: Data, channels: str = "all") -> MujocoRecorder:
    """A recorder for a loop of your own: call its `sample` after each ``mj_step``.

    >>> with record_mujoco(model, data) as rec:  # doctest: +SKIP
    ...     for _ in range(1000):
    ...         mujoco.mj_step(model, data)
    ...         rec.sample()
    >>> run = rec.trajectory()  # doctest: +SKIP

    Args:
        model: the mjModel of the simulation.
        data: its mjData, in the state of the first row.
        channels: "all" has one contact channel for each pair of geoms, "grouped" a single one.

    Raises:
        InputError: MuJoCo is missing, `channels` is unknown, or the model can fall asleep.
    """
    return MujocoRecorder(model, data, channels)


class MujocoRecorder:
    """Rows of a running MuJoCo simulation; made by `record_mujoco`."""

    def __init__(self, model: Model, data: Data, channels: str = "all") -> None:
        mujoco = simulator("mujoco", "mujoco")
        if channels not in CHANNELS:
            raise InputError(f"unknown channels={channels!r}{closest(str(channels), CHANNELS)}")
        if model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_SLEEP:
            raise InputError(
                "the model lets bodies fall asleep, and what MuJoCo holds of those is old: switch it off "
                "(model.opt.enableflags &= ~mujoco.mjtEnableBit.mjENBL_SLEEP)"
            )
        self._mujoco = mujoco
        self._model, self._data = model, data
        self._elements = Elements.of(model, grouped=channels == "grouped")
        self._before = mujoco.MjData(model)
        self._rows: list[_Row] = []
        self._steps: set[float] = set()
        self._varied: dict[str, NDArray[np.bool_]] = {}
        self._off = 0.0
        self._keep()

    def __enter__(self) -> MujocoRecorder:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Nothing to release; the trajectory stays available."""

    def __len__(self) -> int:
        return len(self._rows)

    def sample(self) -> None:
        """Record the step that was just taken.

        Raises InputError when not exactly one step was taken since the last sample, when the state was
        changed by other means, when MuJoCo met a bad value, or when its forces do not add up.
        """
        model, data, before = self._model, self._data, self._before
        trouble = self.trouble()
        if trouble:
            raise InputError(f"{trouble}; the samples before that are kept: use trajectory()")
        h = float(model.opt.timestep)
        taken = (data.time - before.time) / h
        if abs(taken - 1.0) > 1e-6:
            raise InputError(
                f"sample() at t = {data.time:g} s: {taken:g} steps were taken since the sample at "
                f"{before.time:g} s, expected 1; call it after each mj_step (thin out later, with "
                "run.every), and make a new recorder after a reset"
            )
        self._set_inputs(before)
        row = self._replay(before)
        self._check_replay()
        self._rows.append(row)
        self._steps.add(h)
        self._keep()

    def trouble(self) -> str:
        """What MuJoCo has warned of since the last sample: a state or acceleration gone bad."""
        kinds = self._mujoco.mjtWarning
        for kind, what in (
            (kinds.mjWARN_BADQPOS, "a position"),
            (kinds.mjWARN_BADQVEL, "a speed"),
            (kinds.mjWARN_BADQACC, "an acceleration"),
        ):
            if self._data.warning[kind].number > self._before.warning[kind].number:
                return (
                    f"{what} became too large or not a number in the step from t = "
                    f"{self._before.time:g} s"
                )
        return ""

    def trajectory(self, message: str = "") -> Trajectory:
        """The samples, and as the last row the present state with the inputs that are set now.

        A `message` says why the run ended before its time; then the last row is left out, and no
        samples at all are an InputError.
        """
        rows = list(self._rows)
        if not message:
            present = self._mujoco.MjData(self._model)
            self._mujoco.mj_copyData(present, self._model, self._before)
            self._set_inputs(present)
            rows.append(self._replay(present))
        if not rows:
            raise InputError(f"nothing was recorded: {message}")
        implicit = any(row.corrected for row in rows)
        builder = TrajectoryBuilder(coordinate_names(self._model), speed_names(self._model))
        for row in rows:
            forces = {**row.forces, IMPLICIT: row.correction} if implicit else row.forces
            builder.add(
                row.t, row.q, row.u, row.step_acceleration if implicit else row.qacc, forces
            )
        return builder.trajectory(self._provenance(implicit, builder.channels, message))

    def _keep(self) -> None:
        """Keep all of the present state, warm start and contact memory included."""
        self._mujoco.mj_copyData(self._before, self._model, self._data)

    def _set_inputs(self, data: Data) -> None:
        """Give `data` the present inputs; note which of them changed since the last sample."""
        for name in INPUTS:
            old, new = getattr(data, name), getattr(self._data, name)
            differs = np.asarray(old != new)
            varied = differs.any(axis=1) if name == "xfrc_applied" else differs
            if self._rows:
                before = self._varied.get(name, varied)
                self._varied[name] = np.asarray(before | varied, dtype=np.bool_)
            np.copyto(old, new)

    def _replay(self, data: Data) -> _Row:
        """Take the step from the state in `data`; the row of what it began with."""
        model, mujoco = self._model, self._mujoco
        t, q, u = float(data.time), np.array(data.qpos), np.array(data.qvel)
        plastic, h = np.array(data.plastic), float(model.opt.timestep)
        stages = model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
        if stages:
            mujoco.mj_forward(model, data)
        else:
            mujoco.mj_step(model, data)  # leaves the accelerations and forces of its start
        qacc = np.array(data.qacc)
        forces = generalized_forces(model, data, self._elements, plastic)
        if stages:
            mujoco.mj_RungeKutta(model, data, 4)
            return _Row(t, q, u, qacc, forces, qacc, np.zeros(model.nv), corrected=False)
        a = (data.qvel - u) / h
        if discrete(model):
            total = np.sum([*forces.values(), np.zeros(model.nv)], axis=0)
            correction = mass_times(model, data, a) + data.qfrc_bias - total
            corrected = bool(
                np.abs(correction).max(initial=0.0) > ROUNDING * np.abs(total).max(initial=0.0)
            )
        else:
            correction = mass_times(model, data, a - qacc)
            # a is a difference of speeds, so it has their rounding.
            rounding = 64.0 * EPS * np.abs(u).max(initial=0.0) / h
            rounding += ROUNDING * np.abs(a).max(initial=0.0)
            corrected = bool(np.abs(a - qacc).max(initial=0.0) > rounding)
        return _Row(t, q, u, qacc, forces, a, correction, corrected)

    def _check_replay(self) -> None:
        """InputError unless the replayed step ended where MuJoCo's did."""
        for name in ("qpos", "qvel"):
            replayed, reached = getattr(self._before, name), getattr(self._data, name)
            off = float(np.abs(replayed - reached).max(initial=0.0))
            scale = max(1.0, float(np.abs(reached).max(initial=0.0)))
            self._off = max(self._off, off)
            if not off <= REPLAY * scale:
                raise InputError(
                    f"sample() at t = {self._data.time:g} s: the step taken again from the last sample "
                    f"ends with a {name} that is off by {off:.3g}. Between the samples the state, the "
                    "model or (after the step) the inputs were changed: sample right after mj_step, and "
                    "make a new recorder where you set the state"
                )

    def _provenance(self, implicit: bool, channels: tuple[str, ...], message: str) -> Provenance:
        model = self._model
        solver = next(n for n, v in integrator_names().items() if v == model.opt.integrator)
        notes = {
            "stage": STAGES["rk4" if solver == "rk4" else "implicit" if implicit else "explicit"],
            "held": ";".join(channels if solver != "rk4" else self._varied_channels(channels)),
            "looked_for": ";".join(OCCASIONAL),
            "acted": ";".join(n for n in channels if n.partition(" ")[0] in OCCASIONAL),
            "strengths": json.dumps(motor_strengths(model)),
            "replay": f"every step was replayed; largest difference {self._off:.3g}",
        }
        steps = self._steps or {float(model.opt.timestep)}
        return Provenance(
            simulator=f"MuJoCo {self._mujoco.mj_versionString()}",
            solver=solver,
            step=steps.pop() if len(steps) == 1 else None,
            model=bytes(model.names).split(b"\0", 1)[0].decode() or None,
            completed=not message,
            message=message,
            notes=notes,
        )

    def _varied_channels(self, channels: tuple[str, ...]) -> list[str]:
        """Channels of inputs that were changed from step to step, and are constant in between."""
        model, varied = self._model, self._varied
        held = []
        for k, name in enumerate(self._elements.actuators):
            own = slice(
                model.actuator_ctrladr[k], model.actuator_ctrladr[k] + model.actuator_ctrlnum[k]
            )
            stateful = model.actuator_actadr[k] >= 0  # an activation smooths the control
            if "ctrl" in varied and varied["ctrl"][own].any() and not stateful:
                held.append(f"actuator {name}")
        if "qfrc_applied" in varied and varied["qfrc_applied"].any():
            held.append("applied qfrc")
        for body in np.flatnonzero(varied.get("xfrc_applied", np.zeros(0))):
            held.append(f"applied {self._elements.bodies[body]}")
        return [channel for channel in held if channel in channels]


@dataclass(frozen=True)
class _Row:
    """A step: the state it began with, q̈ and forces there, and what an implicit integrator added."""

    t: float
    q: Array
    u: Array
    qacc: Array
    forces: Forces
    step_acceleration: Array
    correction: Array
    corrected: bool
