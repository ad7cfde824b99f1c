"""Recorders: runs of other simulators as trajectories."""

from __future__ import annotations

from deltac.recorders.batch_recorder import BatchRecorder, record_batch
from deltac.recorders.builder import TrajectoryBuilder
from deltac.recorders.drake_recorder import DrakeRecorder, record_drake
from deltac.recorders.environments import dm_control, gymnasium
from deltac.recorders.exudyn_recorder import ExudynRecorder, record_exudyn
from deltac.recorders.monitor import BoundExceeded, Monitor
from deltac.recorders.mujoco_monitor import MujocoMonitor
from deltac.recorders.mujoco_recorder import (
    MujocoRecorder,
    MujocoSimulator,
    integrator_names,
    mujoco_simulator,
    record_mujoco,
    run_mujoco,
)
from deltac.recorders.pinocchio_recorder import PinocchioRecorder, record_pinocchio
from deltac.recorders.pybullet_recorder import PybulletRecorder, record_pybullet
from deltac.recorders.replay import Replay, replay_mujoco

__all__ = [
    "BatchRecorder",
    "BoundExceeded",
    "DrakeRecorder",
    "ExudynRecorder",
    "Monitor",
    "MujocoMonitor",
    "MujocoRecorder",
    "MujocoSimulator",
    "PinocchioRecorder",
    "PybulletRecorder",
    "Replay",
    "TrajectoryBuilder",
    "dm_control",
    "gymnasium",
    "integrator_names",
    "mujoco_simulator",
    "record_batch",
    "record_drake",
    "record_exudyn",
    "record_mujoco",
    "record_pinocchio",
    "record_pybullet",
    "replay_mujoco",
    "run_mujoco",
]
