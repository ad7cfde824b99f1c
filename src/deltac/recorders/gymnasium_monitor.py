"""A Gymnasium environment of MuJoCo whose physics steps a monitor follows, whatever its frame skip."""

from __future__ import annotations

from typing import Any

import gymnasium
import mujoco

from deltac.errors import WrongType
from deltac.recorders.monitor import Monitor
from deltac.recorders.mujoco_monitor import MujocoMonitor


class MonitoredEnv(gymnasium.Wrapper[Any, Any, Any, Any]):
    """The environment, with ΔC in each step's info; made by `Monitor.gymnasium`.

    info has ``delta_c``, ``delta_c_bar`` and ``energy_exchanged`` (J) since the last reset, and
    ``energy_within``, whether all of the step's physics steps were within the bounds.
    """

    def __init__(self, env: Any, monitor: Monitor) -> None:
        super().__init__(env)
        self.monitor = monitor
        self._base = env.unwrapped
        if not hasattr(self._base, "_step_mujoco_simulation"):
            raise WrongType(
                f"{type(self._base).__name__} is no gymnasium.envs.mujoco.MujocoEnv: nobody sees its physics "
                "steps from outside; in its own loop call monitor.mujoco(model, data).update() after each"
            )
        self._watch: MujocoMonitor | None = None
        self._within = True
        self._base._step_mujoco_simulation = self._physics

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:
        """Reset the environment, and begin a new balance."""
        observation, info = self.env.reset(**options)
        if self._watch is None:
            self._watch = self.monitor.mujoco(self._base.model, self._base.data)
        else:
            self._watch.restart()
        return observation, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """A step of the environment; raises BoundExceeded as the monitor does."""
        self._within = True
        observation, reward, terminated, truncated, info = self.env.step(action)
        monitor = self.monitor
        info |= {
            "delta_c": monitor.delta_c,
            "delta_c_bar": monitor.error_bar,
            "energy_exchanged": monitor.energy_exchanged,
            "energy_within": self._within,
        }
        return observation, reward, terminated, truncated, info

    def _physics(self, ctrl: Any, n_frames: int) -> None:
        """As the environment does it, one physics step at a time."""
        model, data = self._base.model, self._base.data
        data.ctrl[:] = ctrl
        for _ in range(n_frames):
            mujoco.mj_step(model, data)
            if self._watch is not None:
                self._within &= self._watch.update()
        mujoco.mj_rnePostConstraint(model, data)
