"""A monitor beside MuJoCo: the forces of a step are read from mjData, in a few groups.

After mj_step of a one-step integrator mjData holds the new state and the forces of the step that led to it,
which were constant over the step: just what a monitor calls held. RK4 leaves forces of its last stage; there
a forward pass on a copy of the state gives those of the row.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

from deltac.arrays import Array
from deltac.dynamics.equations_of_motion import equations_of_motion
from deltac.errors import ModelError, RecordingError
from deltac.importers.names import coordinate_names, joint_names, speed_names, tendon_names
from deltac.mechanism.channels import ChannelName
from deltac.recorders.builder import simulator
from deltac.recorders.monitor import BoundExceeded, Monitor
from deltac.recorders.mujoco_forces import Elements, passive_forces

Model: TypeAlias = Any
Data: TypeAlias = Any

GROUPS = ("actuator all", "constraint all", "applied all")
"""Of actuators; of contacts, limits, friction loss and equalities; all others but springs and dampers."""

TERMS = (
    "qfrc_actuator", "qfrc_constraint", "qfrc_smooth", "qfrc_bias", "qfrc_spring", "qfrc_damper"
)  # fmt: skip
SIGNS = np.array([[1.0, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0], [-1, 0, 1, 1, -1, -1]])
"""The groups as sums of forces in mjData: all that accelerates but bias, springs, dampers and actuators."""

PASSIVE = "applied passive"
"""Springs and dampers that the mechanism does not have."""


class MujocoMonitor:
    """Feeds a monitor with the rows of a MuJoCo simulation; made by `Monitor.mujoco`."""

    def __init__(self, monitor: Monitor, model: Model, data: Data) -> None:
        self._mujoco = simulator("mujoco", "mujoco")
        self.monitor, self._model, self._data = monitor, model, data
        mechanism = monitor.mechanism
        names = (tuple(coordinate_names(model)), tuple(speed_names(model)))
        if names != (mechanism.coordinates.names, mechanism.speeds.names):
            raise ModelError(
                f"the MuJoCo model has the speeds {', '.join(names[1])}; the monitor's mechanism "
                f"{mechanism.name!r} has {', '.join(mechanism.speeds.names)}; make the monitor of the same "
                "model: Monitor(model)"
            )
        known = {part.name for part in equations_of_motion(mechanism).channels}
        self._elements = Elements.of(model, grouped=True)
        self._compensated = any(name.element == "gravcomp" for name in known)
        self._missing = self._not_imported(known)
        groups = (*GROUPS, PASSIVE) if self._missing else GROUPS
        self._groups = dict.fromkeys(groups, np.zeros(model.nv))
        self._sums = np.zeros((len(groups), model.nv))
        self._terms = np.zeros((len(TERMS), model.nv))
        self._stages = model.opt.integrator == self._mujoco.mjtIntegrator.mjINT_RK4
        self._state = int(self._mujoco.mjtState.mjSTATE_INTEGRATION)
        self._user = int(self._mujoco.mjtState.mjSTATE_USER)
        self._inputs, self._given = (
            np.zeros(self._mujoco.mj_stateSize(model, self._user)) for _ in range(2)
        )
        self._at_row = self._mujoco.MjData(model)
        self.restart()

    def restart(self) -> None:
        """Begin with the present state of the data: after a reset, or when the state was set."""
        self.monitor.reset()
        self._plastic = np.array(self._data.plastic)  # as it was in the pass whose forces are read
        if self._stages:
            self._row_of_stages(self._data.time)
        else:
            groups = {name: np.zeros(self._model.nv) for name in self._groups}
            self.monitor.update(self._data.time, self._data.qpos, self._data.qvel, held=groups)

    def update(self) -> bool:
        """Take the step that was just made; as `Monitor.update`.

        Raises BoundExceeded as that does, and InputError when not exactly one step was made.
        """
        return self.monitor.judge(self._advance())

    def step(self, halvings: int = 10) -> int:
        """Make a step with the present inputs, in parts where a bound asks for it; the number of parts.

        A step after which a bound is exceeded is taken back, the state with it, and made again in two
        halves, and these likewise. What still exceeds at a step 2^−`halvings` as large is treated as
        `on_exceed` says; with "raise" the data are left in the last state within the bounds.
        """
        model, h = self._model, float(self._model.opt.timestep)
        try:
            return self._part(h, halvings)
        finally:
            model.opt.timestep = h

    def _part(self, h: float, halvings: int) -> int:
        model, data, plastic = self._model, self._data, self._plastic
        before = np.empty(self._mujoco.mj_stateSize(model, self._state))
        self._mujoco.mj_getState(model, data, before, self._state)
        model.opt.timestep = h
        self._mujoco.mj_step(model, data)
        if self._advance():
            return 1
        raising = self.monitor.on_exceed == "raise"
        if halvings <= 0 and not raising:
            self.monitor.judge(False)
            return 1
        exceeded = BoundExceeded(self.monitor)
        self.monitor.reject()
        self._mujoco.mj_setState(model, data, before, self._state)
        self._mujoco.mj_copyState(model, data, self._at_row, self._state)
        self._plastic = plastic
        if halvings <= 0:
            raise exceeded
        return self._part(0.5 * h, halvings - 1) + self._part(0.5 * h, halvings - 1)

    def _advance(self) -> bool:
        """Give the monitor the row after the step."""
        model, data, monitor = self._model, self._data, self.monitor
        t, h = data.time, model.opt.timestep
        if abs(t - monitor.t - h) > 1e-6 * h:
            raise RecordingError(
                f"update() at t = {t:g} s: {(t - monitor.t) / h:g} steps were made since {monitor.t:g} s, "
                "expected 1; call it after each mj_step, and restart() after a reset"
            )
        if self._stages:
            self._jump()
            return self._row_of_stages(t)
        forces = (self._summed(data),) if self._plain else self._read(data).values()
        return monitor.take(t, data.qpos, data.qvel, None, forces)

    def _row_of_stages(self, t: float) -> bool:
        """The row of the present state, with accelerations and forces of a forward pass there."""
        model, data, here = self._model, self._data, self._at_row
        self._mujoco.mj_copyState(model, data, here, self._state)
        self._mujoco.mj_getState(model, data, self._inputs, self._user)
        self._mujoco.mj_forward(model, here)
        return self._give(t, here)

    def _jump(self) -> None:
        """Where inputs changed at the row before, that row again with the inputs which then acted."""
        model, data, here = self._model, self._data, self._at_row
        self._mujoco.mj_getState(model, data, self._given, self._user)
        if self._given.tobytes() != self._inputs.tobytes():
            self._mujoco.mj_copyState(model, data, here, self._user)
            self._mujoco.mj_forward(model, here)
            self._give(self.monitor.t, here)

    def _give(self, t: float, here: Data) -> bool:
        self._read(here)
        if not self.monitor.rows:
            return self.monitor.update(t, here.qpos, here.qvel, here.qacc, self._groups)
        return self.monitor.take(t, here.qpos, here.qvel, here.qacc, self._groups.values())

    @property
    def _plain(self) -> bool:
        """Whether the groups are sums of forces in mjData with the same signs for all speeds."""
        return not (self._compensated or self._missing)

    def _summed(self, data: Data) -> Array:
        """The groups one after the other, `_read` in two calls of NumPy: these are all of its time."""
        np.concatenate([getattr(data, name) for name in TERMS], out=self._terms.reshape(-1))
        np.dot(SIGNS, self._terms, out=self._sums)
        return self._sums.reshape(-1)

    def _read(self, data: Data) -> dict[str, Array]:
        """The groups of forces in mjData, of the forward pass that it holds."""
        other = data.qfrc_smooth + data.qfrc_bias
        other -= data.qfrc_spring
        other -= data.qfrc_damper
        actuator = data.qfrc_actuator
        if self._compensated:
            own = self._elements.as_actuator
            actuator = actuator - np.where(own, data.qfrc_gravcomp, 0.0)
            other -= data.qfrc_gravcomp
        other -= actuator
        groups = self._groups
        groups["actuator all"], groups["constraint all"] = actuator, data.qfrc_constraint
        groups["applied all"] = other
        if self._missing:
            forces = passive_forces(self._model, data, self._elements, self._plastic)
            lacking = [force for name, force in forces.items() if name in self._missing]
            self._plastic = np.array(data.plastic)  # as it is in the next pass
            groups[PASSIVE] = np.sum([*lacking, np.zeros(self._model.nv)], axis=0)
        return groups

    def _not_imported(self, known: set[ChannelName]) -> frozenset[str]:
        """Channels of springs and dampers that MuJoCo has and the mechanism does not."""
        found, joints, tendons = self._elements, joint_names(self._model), tendon_names(self._model)
        names = {f"spring {joints[k]}" for k in found.springs}
        names |= {f"damper {joints[k]}" for k in found.dampers}
        names |= {f"spring {tendons[k]}" for k in found.tendon_springs}
        names |= {f"damper {tendons[k]}" for k in found.tendon_dampers}
        if self._model.nflex:
            names |= {"spring flex", "damper flex"}
        return frozenset(names - known)
