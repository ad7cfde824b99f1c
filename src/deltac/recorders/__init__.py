"""Recorders: a running simulator of someone else's becomes a trajectory."""

from __future__ import annotations

from deltac.recorders.builder import TrajectoryBuilder
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

__all__ = [
    "BoundExceeded",
    "ExudynRecorder",
    "Monitor",
    "MujocoMonitor",
    "MujocoRecorder",
    "MujocoSimulator",
    "TrajectoryBuilder",
    "integrator_names",
    "mujoco_simulator",
    "record_exudyn",
    "record_mujoco",
    "run_mujoco",
]
