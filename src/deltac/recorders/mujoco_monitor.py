"""A monitor beside MuJoCo: the forces of a step are read from mjData, in a few groups.

After mj_step of a one-step integrator mjData holds the new state and the forces of the step that led to it,
which were constant over the step: just what a monitor calls held. RK4 leaves forces of its last stage; there
a forward pass on a copy of the state gives those of the row.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np

from deltac.arrays import Array
from deltac.dynamics import equations_of, trace
from deltac.energy import Given, Memory
from deltac.errors import ModelError, RecordingError, WrongType
from deltac.importers.names import coordinate_names, joint_names, speed_names, tendon_names
from deltac.mechanism import ChannelName
from deltac.recorders.monitor import BoundExceeded, Monitor
from deltac.recorders.mujoco_forces import Elements, passive_forces, plastic_state
from deltac.recorders.recorder import simulator

Model: TypeAlias = Any
Data: TypeAlias = Any

GROUPS = ("actuator all", "constraint all", "applied all")
"""Of actuators; of contacts, limits, friction loss and equalities; all others but springs and dampers."""

GROUP_SUMS = (
    {"actuator": 1.0},
    {"constraint": 1.0},
    {"smooth": 1.0, "bias": 1.0, "spring": -1.0, "damper": -1.0, "actuator": -1.0},
)
"""The groups as sums of qfrc_… in mjData; the last: all but springs, dampers, actuators and constraints."""

WITHIN_REACH = 50_000
"""Span (numbers) of mjData's memory up to which a row is read in place; beyond, it is copied."""

PASSIVE_CHANNEL = "applied passive"
"""Springs and dampers that the mechanism does not have."""


class MujocoMonitor:
    """Feeds a monitor with the rows of a MuJoCo simulation; made by `Monitor.mujoco`."""

    def __init__(self, monitor: Monitor, model: Model, data: Data) -> None:
        self._mujoco = simulator("mujoco", "mujoco")
        for name, value, kind in (("model", model, "MjModel"), ("data", data, "MjData")):
            if not isinstance(value, getattr(self._mujoco, kind)):
                raise WrongType(
                    f"{name}: found {type(value).__name__}, expected a mujoco.{kind}; it is "
                    "monitor.mujoco(model, data)"
                )
        self.monitor, self._model, self._data = monitor, model, data
        mechanism = monitor.mechanism
        names = (tuple(coordinate_names(model)), tuple(speed_names(model)))
        if names != (mechanism.coordinates.names, mechanism.speeds.names):
            raise ModelError(
                f"the MuJoCo model has the speeds {', '.join(names[1])}; the monitor's mechanism "
                f"{mechanism.name!r} has {', '.join(mechanism.speeds.names)}; make the monitor of the same "
                "model: Monitor(model)"
            )
        channels = {part.name for part in equations_of(trace(mechanism)).channels}
        self._elements = Elements.of(model, grouped=True)
        self._compensated = any(name.element == "gravcomp" for name in channels)
        self._missing = self._not_imported(channels)
        self._names = tuple(
            map(ChannelName.parse, (*GROUPS, PASSIVE_CHANNEL) if self._missing else GROUPS)
        )
        self._stages = model.opt.integrator == self._mujoco.mjtIntegrator.mjINT_RK4
        self._state = int(self._mujoco.mjtState.mjSTATE_INTEGRATION)
        self._user = int(self._mujoco.mjtState.mjSTATE_USER)
        self._inputs, self._present = (
            np.zeros(self._mujoco.mj_stateSize(model, self._user)) for _ in range(2)
        )
        self._at_row = self._mujoco.MjData(model)
        self._opt = model.opt
        self._given, self._row = self._layout(self._at_row if self._stages else data)
        self.restart()

    def restart(self) -> None:
        """Begin with the present state of the data: after a reset, or when the state was set."""
        data = self._data
        self._plastic = plastic_state(data)  # as it was in the pass whose forces are read
        if self._stages:
            self._forward(data)
        self._read()
        self.monitor.follow(data.time, self._given, self._row)

    def update(self) -> bool:
        """Take the step that was just made; as `Monitor.update`.

        Raises BoundExceeded as that does, and InputError when not exactly one step was made.
        """
        return self._advance() or self.monitor.judge(False)

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
        data, monitor = self._data, self.monitor
        t, h = data.time, self._opt.timestep
        if abs(t - monitor.t - h) > 1e-6 * h:
            raise RecordingError(
                f"update() at t = {t:g} s: {(t - monitor.t) / h:g} steps were made since {monitor.t:g} s, "
                "expected 1; call it after each mj_step, and restart() after a reset"
            )
        if self._stages:
            self._jump()
            self._forward(data)
        self._read()
        return monitor.take(t)

    def _forward(self, data: Data) -> None:
        """Accelerations and forces of the present state, on the copy; the inputs that acted."""
        self._mujoco.mj_copyState(self._model, data, self._at_row, self._state)
        self._mujoco.mj_getState(self._model, data, self._inputs, self._user)
        self._mujoco.mj_forward(self._model, self._at_row)

    def _jump(self) -> None:
        """Where inputs changed at the row before, that row again with the inputs which then acted."""
        model, data, row_data = self._model, self._data, self._at_row
        self._mujoco.mj_getState(model, data, self._present, self._user)
        if self._present.tobytes() != self._inputs.tobytes():
            self._mujoco.mj_copyState(model, data, row_data, self._user)
            self._mujoco.mj_forward(model, row_data)
            self._read()
            self.monitor.jump()

    def _layout(self, data: Data) -> tuple[Given, Array]:
        """What a row brings, and where it is found: in mjData itself, if nothing is to be computed."""
        held_forces, forces = ((), self._names) if self._stages else (self._names, ())
        inputs = Given(forces, held_forces, rated=self._stages)
        named = {name: getattr(data, f"qfrc_{name}") for group in GROUP_SUMS for name in group}
        arrays = {"q": data.qpos, "u": data.qvel, "udot": data.qacc, **named}
        places = {name: array.ctypes.data for name, array in arrays.items()}
        first = min(arrays, key=lambda name: places[name])
        ends = [places[name] + array.nbytes for name, array in arrays.items()]
        size = (max(ends) - places[first]) // 8
        if self._compensated or self._missing or size > WITHIN_REACH:
            nq, nu = len(data.qpos), len(data.qvel)
            return inputs, np.zeros(inputs.place(nq, nu).size)
        at = {name: (place - places[first]) // 8 for name, place in places.items()}
        blocks = tuple(
            tuple((at[name], sign) for name, sign in group.items()) for group in GROUP_SUMS
        )
        memory = Memory(size, at["q"], at["u"], at["udot"], blocks)
        # One allocation, mjData's buffer, holds all arrays but those of contacts and constraint rows
        # (mjdata.h), and lives as long as any of them.
        row = np.lib.stride_tricks.as_strided(arrays[first], (size,), (8,), writeable=False)
        return replace(inputs, memory=memory), row

    def _read(self) -> None:
        """Copy the row of the forward pass that mjData holds, with groups that are not there as such."""
        if self._given.memory is not None:
            return
        data = self._at_row if self._stages else self._data
        actuator = data.qfrc_actuator
        other = data.qfrc_smooth + data.qfrc_bias - data.qfrc_spring - data.qfrc_damper
        if self._compensated:
            own = self._elements.as_actuator
            actuator = actuator - np.where(own, data.qfrc_gravcomp, 0.0)
            other -= data.qfrc_gravcomp
        groups = [actuator, data.qfrc_constraint, other - actuator]
        if self._missing:
            forces = passive_forces(self._model, data, self._elements, self._plastic)
            unmodelled = [force for name, force in forces.items() if name in self._missing]
            self._plastic = plastic_state(data)  # as it is in the next pass
            groups.append(np.sum([*unmodelled, np.zeros(self._model.nv)], axis=0))
        rates = [data.qacc] if self._stages else []
        np.concatenate((data.qpos, data.qvel, *rates, *groups), out=self._row)

    def _not_imported(self, channels: set[ChannelName]) -> frozenset[str]:
        """Channels of springs and dampers that MuJoCo has and the mechanism does not."""
        elements, joints, tendons = (
            self._elements,
            joint_names(self._model),
            tendon_names(self._model),
        )
        names = {f"spring {joints[k]}" for k in elements.springs}
        names |= {f"damper {joints[k]}" for k in elements.dampers}
        names |= {f"spring {tendons[k]}" for k in elements.tendon_springs}
        names |= {f"damper {tendons[k]}" for k in elements.tendon_dampers}
        if self._model.nflex:
            names |= {"spring flex", "damper flex"}
        return frozenset(names - channels)
