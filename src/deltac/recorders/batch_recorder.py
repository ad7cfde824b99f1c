"""Recording MuJoCo's batches, MJX and MuJoCo Warp: every world an episode, a trajectory of its own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np

from deltac.arrays import SAME_STEP, Array, max_norm
from deltac.calls.arguments import checked
from deltac.errors import InputError, RecordingError
from deltac.importers.names import coordinate_names, model_name, speed_names
from deltac.recorders.mujoco_forces import mass_times, solver_name
from deltac.recorders.mujoco_recorder import IMPLICIT_FORCE, MUJOCO_ORDERS
from deltac.recorders.recorder import HELD_FORCES, OCCASIONAL, Forces, TrajectoryBuilder, simulator
from deltac.trajectories import Provenance, Trajectory

Model: TypeAlias = Any
Batch: TypeAlias = Any

FORCE_FIELDS = ("qfrc_smooth", "qfrc_bias", "qfrc_passive", "qfrc_actuator", "qfrc_constraint")
OPTIONAL = ("qfrc_fluid", "qfrc_gravcomp")


class BatchRecorder:
    """Record a batch of MJX or of MuJoCo Warp: call `sample` with the data after each step.

    A row is the state before a step with the forces of the step, in groups: ``actuator all``,
    ``constraint all`` (contacts, limits, friction loss, equalities) and ``applied all`` (applied forces,
    fluid, compensation of gravity). Springs and dampers are the mechanism's own. What an implicit
    integrator adds is ``correction implicit``, as for `record_mujoco`. Each reset begins a new trajectory.
    Batches are in single precision by default, which shows as noise of 1e-6
    (``jax.config.update("jax_enable_x64", True)``).

    Newton's SolverMuJoCo holds such a batch: record ``solver.mj_model, solver.mjw_data`` before the first
    step and after each. Its other solvers do not keep forces.

    >>> rec = record_batch(model, batch, worlds=range(8))  # doctest: +SKIP
    >>> for _ in range(500):  # doctest: +SKIP
    ...     batch = step(mjx_model, batch)
    ...     rec.sample(batch)
    >>> runs = rec.episodes()  # doctest: +SKIP

    Args:
        model: the mjModel that the batch was put on the device from; Newton's `solver.mj_model`.
        data: the batch at its start: mjx.Data with a leading axis of worlds, or mujoco_warp's Data, which is
            Newton's `solver.mjw_data`.
        worlds: which of them are recorded; by default all.

    Raises:
        InputError: MuJoCo is missing, the data are no batch, or its integrator leaves the forces of another
            stage than that of the step (RK4).
    """

    def __init__(self, model: Model, data: Batch, worlds: Sequence[int] | None = None) -> None:
        self._mujoco = simulator("mujoco", "mujoco")
        self._model = model
        self._solver = solver_name(model)
        if self._solver == "rk4":
            raise RecordingError(
                "with RK4 a batch holds the forces of the last stage, not those of its rows; record with "
                "euler or implicitfast"
            )
        shape = _array(data.qpos).shape
        if len(shape) != 2 or shape[1] != model.nq:
            raise InputError(
                f"data.qpos has shape {shape}, expected (worlds, {model.nq}): a batch, as jax.vmap makes it"
            )
        self._worlds = list(range(shape[0])) if worlds is None else list(worlds)
        for world in self._worlds:
            if not 0 <= world < shape[0]:
                raise InputError(f"worlds: there is no world {world}, they are 0 … {shape[0] - 1}")
        self._state = self._states(data)
        self._rows: list[tuple[tuple[Array, Array, Array], dict[str, Array], Array, Array]] = []

    def __len__(self) -> int:
        return len(self._rows)

    def sample(self, data: Batch) -> None:
        """Record the step that was just made. A world whose time went back begins a new episode.

        Raises InputError when the batch has another number of worlds.
        """
        after = self._states(data)
        forces = {name: self._values(data, name) for name in FORCE_FIELDS}
        forces |= {name: self._values(data, name) for name in OPTIONAL if hasattr(data, name)}
        self._rows.append((self._state, forces, after[0], after[2]))
        self._state = after

    def episodes(self) -> list[Trajectory]:
        """The trajectories, world by world; a world that was reset has one for each episode."""
        runs: list[Trajectory] = []
        for k in range(len(self._worlds)):
            rows: list[int] = []
            for row, (before, _, t, _) in enumerate(self._rows):
                if t[k] > before[0][k]:
                    rows.append(row)
                elif t[k] < before[0][k] and rows:
                    runs.append(self._episode(k, rows))
                    rows = []
            if rows:
                runs.append(self._episode(k, rows))
        return [run for run in runs if len(run) > 1]

    def _episode(self, k: int, rows: Sequence[int]) -> Trajectory:
        model = self._model
        builder = TrajectoryBuilder(coordinate_names(model), speed_names(model))
        data = self._mujoco.MjData(model)
        steps: list[tuple[float, Array, Array, Array, Array, Forces]] = []
        corrected = False
        step = self._step_of(k, rows)
        for row in rows:
            (t, q, u), fields, _, after = self._rows[row]
            f = {name: values[k] for name, values in fields.items()}
            a = (after[k] - u[k]) / step
            other = f["qfrc_smooth"] + f["qfrc_bias"] - f["qfrc_passive"] - f["qfrc_actuator"]
            for name in OPTIONAL:
                other = other + f.get(name, 0.0)
            total = f["qfrc_smooth"] + f["qfrc_constraint"]
            correction = self._mass_times(data, q[k], a) - total
            size = sum(max_norm(f[name]) for name in FORCE_FIELDS)
            # A difference of speeds has their rounding, and forces that of the device.
            eps = float(np.finfo(fields["qfrc_smooth"].dtype).eps)
            least = 64 * eps * (size + self._size_of_mass * max_norm(u[k]) / step)
            corrected |= max_norm(correction) > least
            forces = {
                "actuator all": f["qfrc_actuator"],
                "constraint all": f["qfrc_constraint"],
                "applied all": np.where(np.abs(other) > least, other, 0.0),
                IMPLICIT_FORCE: correction,
            }
            steps.append((float(t[k]), q[k], u[k], a, 0.5 * (u[k] + after[k]), forces))
        for t0, q0, u0, a, mean, forces in steps:
            acting = {n: x for n, x in forces.items() if n != IMPLICIT_FORCE or corrected}
            builder.add(t0, q0, u0, a, acting)
            builder.stage(step, mean, acting)
        return builder.trajectory(
            Provenance(
                simulator=f"MuJoCo {self._mujoco.mj_versionString()} (batch)",
                solver=self._solver,
                step=step,
                order=MUJOCO_ORDERS.get(self._solver),
                model=model_name(model) or None,
                stage=HELD_FORCES,
                held=builder.channels,
                inputs="held",
                looked_for=OCCASIONAL,
                notes={"world": str(self._worlds[k]), "precision": str(self._precision)},
            )
        )

    def _step_of(self, k: int, rows: Sequence[int]) -> float:
        """The step of an episode: the model's, unless its times say another one, as Newton's solvers take."""
        start, end = (float(self._rows[row][2][k]) for row in (rows[0], rows[-1]))
        model_step = float(self._model.opt.timestep)
        step = (end - start) / (len(rows) - 1) if len(rows) > 1 else model_step
        return model_step if abs(step - model_step) < SAME_STEP * model_step else step

    def _mass_times(self, data: Any, q: Array, a: Array) -> Array:
        """M(q) a, by MuJoCo in double precision."""
        mujoco, model = self._mujoco, self._model
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_makeM(model, data)
        self._size_of_mass = max_norm(data.M)
        return mass_times(model, data, a)

    def _states(self, data: Batch) -> tuple[Array, Array, Array]:
        t = np.broadcast_to(_array(data.time), _array(data.qpos).shape[:1])
        self._precision = _array(data.qpos).dtype
        return t[self._worlds].astype(float), self._values(data, "qpos"), self._values(data, "qvel")

    def _values(self, data: Batch, name: str) -> Array:
        values = _array(getattr(data, name))
        return np.array(values[self._worlds])


record_batch = checked(BatchRecorder, name="record_batch")


def _array(values: Any) -> Array:
    """A field of a batch on the host: JAX's arrays convert themselves, Warp's have a method."""
    return np.asarray(values.numpy() if hasattr(values, "numpy") else values)
