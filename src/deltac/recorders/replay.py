"""A log of states and controls at a policy's rate, stepped again between its rows by MuJoCo.

The rows tell where the motion was, the model what happened in between: from each row the model takes as
many steps as there are to the next one, with the controls of the row. Where it arrives at the next row, the
log is this model's, and every step is known with its forces; where it does not, the log is of another
model, or something else acted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import LONG_LOG, SAME_STEP, SMALL_SHARE, SOME_ROWS, Array, max_norm
from deltac.errors import LogError
from deltac.importers.mujoco import quiet
from deltac.recorders.mujoco_recorder import ModelSource, MujocoRecorder, as_run, compiled_model
from deltac.recorders.recorder import ENGINE, simulator
from deltac.trajectories import Trajectory

DIGITS_ALLOWED = 8.0
"""Units in the last digit of the log that are allowed for besides."""

STATES_WITHIN_DIGITS = 8
"""States within the digits of a missed row that are stepped: a miss within their spread does not count."""


@dataclass(frozen=True, eq=False)
class Replay:
    """A log that was stepped again.

    run        every step of the model between the rows, with forces and accelerations
    arrivals   q (T − 1, nq) and u (T − 1, nv) that the model arrives at, from the row before
    missed     (T − 1,) by how much each next row was missed, as a share of what changes from row to row
    allowed    (T − 1,) how much is allowed, for the digits of the log, and for what contacts make of them
    t          (T,) times of the rows, s
    steps      steps of the model from row to row
    late       whether the controls of a row are those of the steps that led to it
    """

    run: Trajectory
    arrivals: tuple[Array, Array]
    missed: Array
    allowed: Array
    t: Array
    steps: int
    late: bool

    @property
    def departures(self) -> NDArray[np.intp]:
        """Places of the rows that the model does not arrive at."""
        return np.flatnonzero(self.missed > self.allowed) + 1


@dataclass(frozen=True, eq=False)
class Prediction:
    """Rows of a log, and the steps that a model takes from some of them to the next.

    t, q, u     of all rows: (T,), (T, nq), (T, nv)
    ctrl, act   of the steps from each row (T − 1, nu), (T − 1, na)
    steps       of the model from row to row
    rows        those from which it is stepped
    """

    t: Array
    q: Array
    u: Array
    ctrl: Array
    act: Array
    steps: int
    rows: NDArray[np.intp]

    @property
    def scale(self) -> Array:
        """What speeds change by from row to row, typically, and what that moves coordinates by (2 nv,)."""
        each = np.median(np.abs(np.diff(self.u, axis=0)), axis=0)
        each = np.maximum(each, SMALL_SHARE * each.max()) + 1e-12
        return np.concatenate([each * float(np.median(np.diff(self.t))), each])

    def within_digits(self, seed: int = 0) -> Prediction:
        """The same with other states within the last digits of the rows."""
        rng = np.random.default_rng(seed)
        q, u = (x + _resolution(x) * rng.uniform(-1.0, 1.0, x.shape) for x in (self.q, self.u))
        return replace(self, q=q, u=u)

    def arrivals(self, model: Any) -> tuple[Array, Array]:
        """States (N, nq) and (N, nv) that the model arrives at."""
        mujoco = simulator("mujoco", "mujoco")
        data = mujoco.MjData(model)
        q, u = self.q[self.rows], self.u[self.rows]
        with quiet(mujoco):  # the model may have parameters that are only tried
            for k, place, speed in zip(self.rows, q, u, strict=True):
                data.time, data.qpos[:], data.qvel[:] = self.t[k], place, speed
                data.ctrl[:], data.act[:], data.qacc_warmstart[:] = self.ctrl[k], self.act[k], 0.0
                mujoco.mj_step(model, data, self.steps)
                place[:], speed[:] = data.qpos, data.qvel
        return q, u

    def errors(self, model: Any) -> Array:
        """What the rows after these are beyond the states that the model arrives at (N, 2 nv)."""
        mujoco = simulator("mujoco", "mujoco")
        q, u = self.arrivals(model)
        errors = np.concatenate([np.zeros_like(u), self.u[self.rows + 1] - u], axis=1)
        for error, one, other in zip(errors, q, self.q[self.rows + 1], strict=True):
            mujoco.mj_differentiatePos(model, error[: model.nv], 1.0, one, other)
        hinges = model.jnt_dofadr[model.jnt_type == int(mujoco.mjtJoint.mjJNT_HINGE)]
        turns = 2.0 * np.pi
        errors[:, hinges] -= turns * np.round(errors[:, hinges] / turns)
        return np.asarray(errors)


def replay_mujoco(
    model: ModelSource,
    t: Array,
    q: Array,
    u: Array,
    ctrl: Array,
    act: Array | None = None,
    *,
    base: str = "fixed",
) -> Replay:
    """Step a MuJoCo model between the rows of a log.

    Args:
        model: an mjModel, an mjSpec, or the path of an MJCF or URDF file.
        t: times (T,), s, equally far apart, a whole number of the model's steps.
        q: qpos (T, nq).
        u: qvel (T, nv).
        ctrl: controls (T, nu), held until the next row; or those of the steps that led to their row, which is
            found out.
        act: activations (T, na), of actuators that have such.
        base: "fixed" or "free", for the root link of a URDF file.

    Raises:
        InputError: MuJoCo is missing, or the log does not fit the model or its step.
    """
    own = as_run(compiled_model(model, base))
    h = float(own.opt.timestep)
    act = np.zeros((len(t), own.na)) if act is None else act
    widths = {
        "qpos": (q, own.nq),
        "qvel": (u, own.nv),
        "ctrl": (ctrl, own.nu),
        "act": (act, own.na),
    }
    for name, (array, width) in widths.items():
        if array.shape != (len(t), width):
            raise LogError(
                f"--replay: the log has {name} of shape {array.shape}, the model asks for ({len(t)}, {width})"
            )
    if len(t) < 2:
        raise LogError("--replay: the log has a single row; expected two or more")
    ratios = np.diff(t) / h
    steps = round(float(np.median(ratios)))
    if steps < 1 or np.abs(ratios - steps).max() > SAME_STEP * max(steps, 1):
        row = int(np.argmax(np.abs(ratios - steps)))
        raise LogError(
            f"--replay: rows {row} and {row + 1} are {t[row + 1] - t[row]:.6g} s apart; expected a "
            f"whole number of the model's steps of {h:g} s, the same between all rows (elsewhere {steps}). "
            "Give the model the timestep of the run, and log at equal distances"
        )
    # Do controls belong to the steps after their row, or before it?
    rows = range(min(len(t) - 1, SOME_ROWS))
    shifts = (0, 1) if own.nu else (0,)
    turning = np.zeros(own.nq, dtype=np.bool_)
    hinges = own.jnt_type == simulator("mujoco", "mujoco").mjtJoint.mjJNT_HINGE
    turning[own.jnt_qposadr[hinges]] = True
    misses = [
        _missed(_stepped(own, t, q, u, ctrl, act, steps, rows, shift)[1], q, u, turning)
        for shift in shifts
    ]
    late = len(misses) > 1 and float(np.median(misses[1])) < 0.1 * float(np.median(misses[0]))
    run, ends = _stepped(own, t, q, u, ctrl, act, steps, range(len(t) - 1), int(late))
    missed = _missed(ends, q, u, turning)
    digits = DIGITS_ALLOWED * max(_resolution(q) / _change(q), _resolution(u) / _change(u))
    allowed = np.full(len(missed), ENGINE + digits * steps)
    some = np.flatnonzero(missed > allowed)
    if len(some):  # contacts spread what the digits of a row leave open
        prediction = Prediction(t, q, u, ctrl[int(late) :], act, steps, some)
        here = prediction.arrivals(own)
        for seed in range(STATES_WITHIN_DIGITS):
            there = prediction.within_digits(seed).arrivals(own)
            apart = [np.abs(x - y) / _change(z) for x, y, z in zip(here, there, (q, u))]
            allowed[some] = np.maximum(allowed[some], 2.0 * np.hstack(apart).max(axis=1))
    arrivals = np.array([q for q, _ in ends]), np.array([u for _, u in ends])
    return Replay(run, arrivals, missed, allowed, t, steps, late)


def _stepped(
    model: Any,
    t: Array,
    q: Array,
    u: Array,
    ctrl: Array,
    act: Array,
    steps: int,
    rows: range,
    shift: int,
) -> tuple[Trajectory, list[tuple[Array, Array]]]:
    """The run through these rows, and the state that is arrived at after each."""
    data = simulator("mujoco", "mujoco").MjData(model)
    recorder = MujocoRecorder(model, data)
    ends = []
    for k in rows:
        recorder.restart(float(t[k]), q[k], u[k], ctrl[k + shift], act[k])
        ends.append(recorder.steps(steps))
    last = rows[-1] + 1
    recorder.restart(float(t[last]), q[last], u[last], ctrl[last], act[last])
    return recorder.trajectory(), ends


def _missed(
    ends: list[tuple[Array, Array]], q: Array, u: Array, turning: NDArray[np.bool_]
) -> Array:
    """By how much each next row is missed, as a share of what changes from row to row.

    Coordinates that are `turning` (nq,) are angles of hinges: they may be wrapped to one turn.
    """
    own_q, own_u = (np.array(x) for x in zip(*ends, strict=True))
    of_q, of_u = own_q - q[1 : len(ends) + 1], own_u - u[1 : len(ends) + 1]
    of_q -= np.where(turning, 2.0 * np.pi * np.round(of_q / (2.0 * np.pi)), 0.0)
    missed: Array = np.abs(np.hstack([of_q / _change(q), of_u / _change(u)])).max(axis=1)
    return np.where(np.isfinite(missed), missed, np.inf)


def _change(values: Array) -> float:
    """What changes from row to row, typically; above zero."""
    change = np.abs(np.diff(values, axis=0)).max(axis=1)
    return max(float(np.median(change)), 1e-6 * max_norm(values), 1e-12)


def _resolution(values: Array) -> float:
    """The unit in the last digit that was written."""
    largest = max_norm(values)
    if np.array_equal(values, values.astype(np.float32)):
        return 2.0**-24 * largest
    for decimals in range(1, 10):
        if np.array_equal(np.round(values, decimals), values):
            return 0.5 * 10.0**-decimals
    some = values[np.abs(values) > 1e-200][:LONG_LOG]
    for digits in range(4, 13):  # significant ones, as "%.6g" writes them
        scale = 10.0 ** (digits - 1 - np.floor(np.log10(np.abs(some))))
        if np.allclose(np.round(some * scale) / scale, some, rtol=1e-15, atol=0.0):
            return 0.5 * 10.0 ** (1 - digits) * largest
    return 2.0**-53 * largest
