"""Recorders: a running simulator of someone else's becomes a trajectory."""

from __future__ import annotations

from deltac.recorders.builder import TrajectoryBuilder
from deltac.recorders.drake_recorder import DrakeRecorder, record_drake
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

__all__ = [
    "BoundExceeded",
    "DrakeRecorder",
    "ExudynRecorder",
    "Monitor",
    "MujocoMonitor",
    "MujocoRecorder",
    "MujocoSimulator",
    "PinocchioRecorder",
    "PybulletRecorder",
    "TrajectoryBuilder",
    "integrator_names",
    "mujoco_simulator",
    "record_drake",
    "record_exudyn",
    "record_mujoco",
    "record_pinocchio",
    "record_pybullet",
    "run_mujoco",
]
