"""A log of MuJoCo at a policy's rate, stepped again between its rows: is it reproducible by the model?"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from deltac.diagnosis.inputs.logs import in_model_order
from deltac.diagnosis.verdict import Finding, percent
from deltac.errors import ArgumentsError, InputError, LogError
from deltac.mechanism.mechanism import Mechanism
from deltac.recorders.mujoco_recorder import compiled_model
from deltac.recorders.replay import Replay, replay_mujoco
from deltac.trajectories import Trajectory, read_trajectory
from deltac.trajectories.formats.files import read_arrays

CONTROLS = ("ctrl", "control", "controls", "action", "actions", "act", "u", "a")
ACTIVATIONS = ("act", "activation", "activations")


def replayed(
    model: Any, mechanism: Mechanism, log: Any, mapping: Any
) -> tuple[Trajectory, list[Finding]]:
    """Every step of a log's motion, and whether it is the model's.

    Raises InputError for a model or a log that cannot be stepped.
    """
    if not isinstance(log, str | Path):
        raise ArgumentsError(
            "replay needs a log file with states and controls; this log is not a file"
        )
    try:
        own = compiled_model(model)
    except InputError as error:
        raise InputError(f"replay steps the model with MuJoCo: {error}") from None
    run = read_trajectory(log, mapping, mechanism)
    run, findings = in_model_order(mechanism, run)
    if run.q.shape[1] != own.nq or run.u.shape[1] != own.nv:
        raise LogError(
            f"{log}: the log's coordinates are not all of MuJoCo's model; log qpos and qvel"
        )
    rows = len(run)
    ctrl, act = np.zeros((rows, 0)), np.zeros((rows, own.na))
    if own.na:
        act = _inputs(log, ACTIVATIONS, rows, own.na, "activations (act)")
    if own.nu:
        ctrl = _inputs(log, CONTROLS, rows, own.nu, "controls (ctrl)")
    found = replay_mujoco(own, run.t, run.q, run.u, ctrl, act)
    return found.run, [*findings, _finding(found)]


def _inputs(log: Any, names: tuple[str, ...], rows: int, width: int, what: str) -> np.ndarray:
    arrays = read_arrays(log, names, width)
    if len(arrays) != 1 or len(arrays[0]) != rows:
        raise LogError(
            f"{log}: expected one array of {what}, ({rows}, {width}), named {names[0]!r} or {names[1]!r}; "
            f"found "
            f"{len(arrays)}. The replay steps the model with them"
        )
    return arrays[0]


def _finding(found: Replay) -> Finding:
    belong = ", with the controls of the row after them" if found.late else ""
    steps = f"{found.steps} step{'s' * (found.steps > 1)} from row to row{belong}"
    departs = found.departures
    if not len(departs):
        return Finding(
            "replayed",
            "MuJoCo reproduces the log: from each row it arrives at the next one",
            f"{len(found.t) - 1} times, {steps}; largest miss {percent(float(found.missed.max()))} of what "
            f"changes "
            "from row to row",
            "",
        )
    first = int(departs[0])
    worst = float(found.missed[departs - 1].max())
    return Finding(
        "replay-departs",
        f"the model does not reproduce the log: stepping from row {first - 1} misses row {first}",
        f"t = {found.t[first]:.6g} s, by {percent(float(found.missed[first - 1]))} of what changes from row "
        f"to row; "
        f"{len(departs)} of {len(found.t) - 1} rows are missed, the worst by {percent(worst)}; {steps}",
        "The log was made with another model, step or controls, or something acted that is not in it (a "
        "push, a reset, noise on the action); compare the parameters, or use the rows before that",
        "cause",
    )
