"""Recording MuJoCo inside environments of Gymnasium and dm_control."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from deltac.errors import RecordingError, WrongType
from deltac.recorders.mujoco_recorder import MujocoRecorder, record_mujoco
from deltac.trajectories import Trajectory

if TYPE_CHECKING:
    from dm_control.rl.control import Environment


class RecordedEnvironment:
    """An environment that records what MuJoCo does in it; all else is that of the environment.

    `episodes` are the recorded ones that have ended; `trajectory()` is the present one.
    """

    def __init__(self, env: Any, channels: str, simulation: Callable[[], tuple[Any, Any]]) -> None:
        """`simulation` gives the present model and data of MuJoCo: a reset may make new ones."""
        self.env = env
        self.episodes: list[Trajectory] = []
        self._channels, self._simulation = channels, simulation
        self._recorder: MujocoRecorder | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self.env, name)

    def reset(self, *arguments: Any, **keywords: Any) -> Any:
        """Reset the environment; what was recorded since the last reset becomes an episode."""
        if self._recorder is not None and len(self._recorder):
            self.episodes.append(self._recorder.trajectory())
        self._recorder = None
        result = self.env.reset(*arguments, **keywords)
        self._recorder = record_mujoco(*self._simulation(), self._channels)
        return result

    def step(self, action: Any) -> Any:
        """Step the environment, and record every step of MuJoCo in it."""
        if self._recorder is None:
            raise RecordingError("step() before reset(): reset the environment first")
        result = self.env.step(action)
        self._recorder.sample()
        return result

    def trajectory(self) -> Trajectory:
        """What was recorded since the last reset, at the rate of MuJoCo's steps."""
        if self._recorder is None:
            raise RecordingError("nothing is recorded yet: reset the environment, and step it")
        return self._recorder.trajectory()


def gymnasium(env: object, channels: str = "all") -> RecordedEnvironment:
    """An environment of Gymnasium on MuJoCo that records every step of the physics, frame_skip or not.

    >>> env = deltac.recorders.gymnasium(gymnasium.make("HalfCheetah-v5"))  # doctest: +SKIP
    >>> env.reset(seed=0)  # doctest: +SKIP
    >>> for _ in range(100):
    ...     env.step(env.action_space.sample())  # doctest: +SKIP
    >>> run = env.trajectory()  # doctest: +SKIP

    Args:
        env: the environment, wrapped or not; its bare one has `model` and `data` of MuJoCo.
        channels: as in `record_mujoco`.

    Raises:
        InputError: the environment is not one of MuJoCo.
    """
    bare: Any = getattr(env, "unwrapped", env)
    if not (hasattr(bare, "model") and hasattr(bare, "data")):
        raise WrongType(
            f"gymnasium: found {type(bare).__name__}, expected an environment on MuJoCo, with .model and "
            f".data"
        )
    return RecordedEnvironment(env, channels, lambda: (bare.model, bare.data))


def dm_control(env: Environment, channels: str = "all") -> RecordedEnvironment:
    """An environment of dm_control that records every step of the physics.

    Args:
        env: the environment, with `physics`.
        channels: as in `record_mujoco`.

    Raises:
        InputError: the environment has no physics of MuJoCo.
    """
    if not hasattr(env, "physics"):
        raise WrongType(
            f"dm_control: found {type(env).__name__}, expected an environment with .physics"
        )

    def simulation() -> tuple[Any, Any]:
        return env.physics.model.ptr, env.physics.data.ptr

    return RecordedEnvironment(env, channels, simulation)
