"""Recorders: a running simulator of someone else's becomes a trajectory."""

from __future__ import annotations

from deltac.recorders.builder import TrajectoryBuilder
from deltac.recorders.exudyn_recorder import ExudynRecorder, record_exudyn
from deltac.recorders.mujoco_recorder import (
    MujocoRecorder,
    integrator_names,
    record_mujoco,
)
from deltac.recorders.mujoco_run import run_mujoco
from deltac.recorders.mujoco_simulator import MujocoSimulator, mujoco_simulator

__all__ = [
    "ExudynRecorder",
    "MujocoRecorder",
    "MujocoSimulator",
    "TrajectoryBuilder",
    "integrator_names",
    "mujoco_simulator",
    "record_exudyn",
    "record_mujoco",
    "run_mujoco",
]
