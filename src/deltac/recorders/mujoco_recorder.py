"""Recording MuJoCo: every row one consistent instant, whatever the integrator leaves in mjData.

After mj_step, mjData holds the new qpos and qvel beside accelerations and forces of the old state; with
RK4 those of its last stage. So each step is replayed on a private copy of the state before it, with
the inputs it had: the row is the state *before* the step, with q̈ and the forces of the step's first
forward pass, and the replayed state must be the one that MuJoCo reached.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from deltac.arrays import ENDLESS, EPS, SAME, SOLVED, Array, max_norm
from deltac.calls.arguments import checked
from deltac.calls.progress import Progress
from deltac.errors import InputError, ModelError, RecordingError, StateError, WrongType, check_names
from deltac.importers.mujoco import simulated_model
from deltac.importers.names import coordinate_names, model_name, motor_strengths, speed_names
from deltac.mechanism import State
from deltac.recorders.mujoco_forces import (
    Elements,
    Forces,
    discrete,
    generalized_forces,
    integrator_names,
    mass_times,
    plastic_state,
    solver_name,
)
from deltac.recorders.recorder import OCCASIONAL, Recorder, StepSums, TrajectoryBuilder, simulator
from deltac.simulation import positive
from deltac.trajectories import Provenance, Trajectory

if TYPE_CHECKING:
    from mujoco import MjData, MjModel, MjSpec, mjtIntegrator

Model: TypeAlias = "MjModel"
Data: TypeAlias = "MjData"
ModelSource: TypeAlias = "MjModel | MjSpec | str | Path"
"""Of what MuJoCo compiles a model."""
Control: TypeAlias = "Callable[[MjModel, MjData], object]"
"""Sets the inputs before each step."""

CHANNELS = ("all", "grouped")
INPUTS = (
    "ctrl",
    "qfrc_applied",
    "xfrc_applied",
    "eq_active",
    "mocap_pos",
    "mocap_quat",
    "userdata",
)
"""What a user may set between two steps."""


MUJOCO_ORDERS = {"euler": 1, "rk4": 4, "implicit": 1, "implicitfast": 1, "discrete": 1}
"""Order of each integrator in the state, for smooth forces."""

IMPLICIT_FORCE = "correction implicit"
"""The force that an implicit integrator adds to those of the start of the step: M(q_k)(a − q̈)."""


STAGES = {
    "explicit": "state before each step, with the accelerations and forces that the step used; forces are "
    "held over a step",
    "implicit": "state before each step; udot is the step's (u_{k+1} - u_k)/h, and channel '"
    + IMPLICIT_FORCE
    + "' what the implicit integrator added to the forces at the start of the step: M udot + bias = sum "
    "of forces; its work is part of the integrator's error",
    "rk4": "state before each step, with the accelerations and forces of its first stage; works are those of "
    "all four stages",
}

RK4 = ((0.5, 1.0 / 3.0), (0.5, 1.0 / 3.0), (1.0, 1.0 / 6.0))
"""Of the second to fourth stage: how far it goes along the rates of the stage before, and its weight."""


class MujocoRecorder(Recorder):
    """Record MuJoCo in a loop of your own: call `sample` after each ``mj_step``, or after every few of them.

    Steps that are taken with the same inputs, ``mj_step(model, data, nstep=5)``, are recorded one by one
    all the same. For environments of Gymnasium and dm_control see `deltac.recorders.gymnasium` and
    `deltac.recorders.dm_control`.

    In every row all channels add up to M q̈ + c; gravity and inertial forces are not logged. If there is a
    remainder, the recorder stops and names the joint. The channels:

    - ``actuator <actuator>``: moment × actuator force, with its share where the joint limits the sum
    - ``spring <joint or tendon>``, ``damper <joint or tendon>``: passive forces, with an actuator's viscosity
    - ``applied gravcomp``, ``applied fluid``, ``applied passive``: gravity compensation, fluid; plugins and
      callbacks
    - ``applied qfrc``, ``applied <body>``: `qfrc_applied`, `xfrc_applied`
    - ``contact <geom>:<geom>``: a pair of geoms; all in ``contact all`` with ``channels="grouped"``
    - ``contact adhesion``: the passive part of adhesive contacts
    - ``limit <joint or tendon>``, ``friction <joint or tendon>``: joint and tendon limits, friction loss
    - ``constraint <equality>``: equality constraints
    - ``correction implicit``: what an implicit integrator adds, M(q)(u̇ − q̈), since it evaluates damping at
      the end of the step: part of the integrator's error
    - ``correction solver``: the residual of the constraint solver, above rounding

    `udot` is q̈ for Euler's method, with joint damping (u_{k+1} − u_k)/h; (u_{k+1} − u_k)/h for implicit,
    implicitfast and discrete; q̈ of the first stage for RK4. All but RK4 close with ``work="discrete"``:
    over a step, the change of K equals the discrete work of all channels and of the bias forces, but for
    the change of the mass matrix, ½uᵀ(M_{k+1} − M_k)u. This identity fails if a channel is missing, so it
    tests the log, not the motion. K + V − Q falls with h; with h⁴ for RK4, over contacts with h to h².

    The cost is some tenths of a millisecond per step; with RK4 four times that.

    >>> with record_mujoco(model, data) as rec:  # doctest: +SKIP
    ...     for _ in range(1000):
    ...         mujoco.mj_step(model, data)
    ...         rec.sample()
    >>> run = rec.trajectory()  # doctest: +SKIP

    Args:
        model: the mjModel of the simulation.
        data: its mjData, in the state of the first row.
        channels: "all" has one contact channel for each pair of geoms, "grouped" a single one.

    Raises:
        InputError: MuJoCo is missing, `channels` is unknown, or the model can fall asleep.
    """

    def __init__(self, model: Model, data: Data, channels: str = "all") -> None:
        mujoco = simulator("mujoco", "mujoco")
        check_names([channels], CHANNELS, "unknown channels")
        if model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_SLEEP:
            raise ModelError(
                "the model lets bodies fall asleep, and what MuJoCo holds of those is old: switch it off "
                "(model.opt.enableflags &= ~mujoco.mjtEnableBit.mjENBL_SLEEP)"
            )
        super().__init__(coordinate_names(model), speed_names(model))
        self._mujoco = mujoco
        self._model, self._data = model, data
        self._elements = Elements.of(model, grouped=channels == "grouped")
        self._before, self._stage = mujoco.MjData(model), mujoco.MjData(model)
        kinds = mujoco.mjtJoint
        ahead = {int(kinds.mjJNT_FREE): 3, int(kinds.mjJNT_BALL): 0}
        starts = [
            model.jnt_dofadr[j] + ahead[int(kind)]
            for j, kind in enumerate(model.jnt_type)
            if int(kind) in ahead
        ]
        self._turning = [slice(start, start + 3) for start in starts]
        # What all rows hold depends on whether an implicit integrator corrected any step.
        self._rows: list[_Row] = []
        self._steps: set[float] = set()
        self._off = 0.0
        self._keep()

    def __len__(self) -> int:
        return len(self._rows)

    def sample(self) -> None:
        """Record the step that was just taken, or the steps, if the inputs were the same in all of them.

        Raises InputError when no whole number of steps was taken since the last sample, when state or
        inputs were changed in between, when MuJoCo met a bad value, or when its forces do not add up.
        """
        model, data, before = self._model, self._data, self._before
        trouble = self.trouble()
        if trouble:
            raise RecordingError(f"{trouble}; the samples before that are kept: use trajectory()")
        h = float(model.opt.timestep)
        steps = (data.time - before.time) / h
        if not 0.5 < steps < ENDLESS or abs(steps - round(steps)) > 1e-6:
            raise RecordingError(
                f"sample() at t = {data.time:g} s: {steps:g} steps were taken since the sample at "
                f"{before.time:g} s, expected a whole number from 1 on; call it after mj_step (thin out "
                "later, with run.every), and make a new recorder after a reset"
            )
        self._set_inputs(before)
        rows = [self._replay(before) for _ in range(round(steps))]
        self._check_replay()
        self._rows += rows
        self._steps.add(h)
        self._keep()

    def restart(self, t: float, q: Array, u: Array, ctrl: Array, act: Array) -> None:
        """Put the simulation where a log says that it was; the next `steps` are taken from there."""
        data = self._data
        data.time, data.qpos[:], data.qvel[:], data.ctrl[:], data.act[:] = t, q, u, ctrl, act
        self._set_inputs(self._before)
        warm = np.array(self._before.qacc_warmstart)
        self._keep()
        self._before.qacc_warmstart[:] = warm

    def steps(self, count: int) -> tuple[Array, Array]:
        """Take and record steps with the present inputs; q and u after them."""
        self._rows += [self._replay(self._before) for _ in range(count)]
        self._steps.add(float(self._model.opt.timestep))
        return np.array(self._before.qpos), np.array(self._before.qvel)

    def trouble(self) -> str:
        """What MuJoCo has warned of since the last sample: a state or acceleration gone bad."""
        kinds = self._mujoco.mjtWarning
        for kind, what in (
            (kinds.mjWARN_BADQPOS, "a position"),
            (kinds.mjWARN_BADQVEL, "a speed"),
            (kinds.mjWARN_BADQACC, "an acceleration"),
        ):
            if self._data.warning[kind].number > self._before.warning[kind].number:
                return (
                    f"{what} became too large or not a number in the step from t = "
                    f"{self._before.time:g} s"
                )
        return ""

    def trajectory(self, message: str = "") -> Trajectory:
        """The samples, and as the last row the present state with the inputs that are set now.

        A `message` says why the run ended before its time; then the last row is left out. A run that broke
        off in its first step is the row of its start.
        """
        rows = list(self._rows)
        if not message:
            present = self._mujoco.MjData(self._model)
            self._mujoco.mj_copyData(present, self._model, self._before)
            self._set_inputs(present)
            rows.append(self._replay(present))
        self._builder = TrajectoryBuilder(coordinate_names(self._model), speed_names(self._model))
        implicit = any(row.corrected for row in rows)
        for row in rows:
            forces = row.forces
            if row.correction is not None and implicit:
                forces = {**forces, IMPLICIT_FORCE: row.correction}
            udot = row.step_acceleration if implicit else row.qacc
            self._builder.add(row.t, row.q, row.u, udot, forces)
            self._builder.step(row.step)
            if row.correction is not None and implicit:
                self._builder.work({IMPLICIT_FORCE: row.of_correction})
        if not rows:  # it broke off in its first step: there is the start, and why
            start = self._before
            if not np.isfinite([*start.qpos, *start.qvel]).all():
                raise RecordingError(f"nothing was recorded: {message}")
            self._builder.add(float(start.time), start.qpos, start.qvel)
        return self._builder.trajectory(self._provenance(implicit, message))

    def _keep(self) -> None:
        """Keep all of the present state, warm start and contact memory included."""
        self._mujoco.mj_copyData(self._before, self._model, self._data)

    def _set_inputs(self, data: Data) -> None:
        """Give `data` the present inputs."""
        for name in INPUTS:
            np.copyto(getattr(data, name), getattr(self._data, name))

    def _replay(self, data: Data) -> _Row:
        """Take the step from the state in `data`; the row of what it began with."""
        model, mujoco = self._model, self._mujoco
        t, q, u = float(data.time), np.array(data.qpos), np.array(data.qvel)
        plastic, h = plastic_state(data), float(model.opt.timestep)
        if model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
            mujoco.mj_forward(model, data)
            qacc = np.array(data.qacc)
            forces = generalized_forces(model, data, self._elements, plastic)
            step = StepSums()
            for stage in self._stages(data, forces, plastic):
                step.add(*stage)
            mujoco.mj_RungeKutta(model, data, 4)
            return _Row(t, q, u, qacc, forces, qacc, step)
        mujoco.mj_step(model, data)  # leaves the accelerations and forces of its start
        qacc = np.array(data.qacc)
        forces = generalized_forces(model, data, self._elements, plastic)
        a = (data.qvel - u) / h
        if discrete(model):
            total = np.sum([*forces.values(), np.zeros(model.nv)], axis=0)
            correction = mass_times(model, data, a) + data.qfrc_bias - total
            corrected = max_norm(correction) > SAME * max_norm(total)
        else:
            correction = mass_times(model, data, a - qacc)
            # a is a difference of speeds, so it has their rounding.
            rounding = 64.0 * EPS * max_norm(u) / h
            rounding += SAME * max_norm(a)
            corrected = max_norm(a - qacc) > rounding
        # Forces and accelerations are held, so speeds are linear in time.
        mean, step = 0.5 * (u + data.qvel), StepSums()
        step.add(h, mean, forces)
        work = h * float(correction @ mean)
        return _Row(t, q, u, qacc, forces, a, step, correction, work, corrected)

    def _stages(
        self, data: Data, forces: Forces, plastic: Array
    ) -> Iterator[tuple[float, Array, Forces]]:
        """Duration, speeds and forces of the stages of RK4 from `data`, whose forward pass gave `forces`.

        They are taken as mj_RungeKutta takes them: speeds and activations along the rates of the stage
        before, positions by the exponential map in a chart at the start of the step (Munthe-Kaas), inputs
        as they are.
        """
        model, mujoco, stage = self._model, self._mujoco, self._stage
        h = float(model.opt.timestep)
        mujoco.mj_copyData(stage, model, data)
        rate = np.array(data.qvel)  # of the positions, in the chart
        yield h / 6.0, rate, forces
        for ahead, weight in RK4:
            ahead *= h
            moved = ahead * rate
            stage.qvel[:] = data.qvel + ahead * stage.qacc
            stage.act[:] = data.act + ahead * stage.act_dot
            stage.time = data.time + ahead
            np.copyto(stage.qpos, data.qpos)
            mujoco.mj_integratePos(model, stage.qpos, moved, 1.0)
            mujoco.mj_forward(model, stage)
            yield (
                weight * h,
                stage.qvel,
                generalized_forces(model, stage, self._elements, plastic),
            )
            rate = np.array(stage.qvel)
            for place in self._turning:
                rate[place] = _inverse_dexp(moved[place], rate[place])

    def _check_replay(self) -> None:
        """InputError unless the replayed step ended where MuJoCo's did."""
        for name in ("qpos", "qvel"):
            replayed, reached = getattr(self._before, name), getattr(self._data, name)
            difference = max_norm(replayed - reached)
            scale = max(1.0, max_norm(reached))
            self._off = max(self._off, difference)
            if not difference <= SOLVED * scale:
                raise RecordingError(
                    f"sample() at t = {self._data.time:g} s: the step taken again from the last sample "
                    f"ends with a {name} that is off by {difference:.3g}. Between the samples the state, the "
                    "model or (after the step) the inputs were changed: sample right after mj_step, and "
                    "make a new recorder where you set the state"
                )

    def _provenance(self, implicit: bool, message: str) -> Provenance:
        model, channels, varying = self._model, self._builder.channels, self._builder.varying
        solver = solver_name(model)
        steps = self._steps or {float(model.opt.timestep)}
        return Provenance(
            simulator=f"MuJoCo {self._mujoco.mj_versionString()}",
            solver=solver,
            step=steps.pop() if len(steps) == 1 else None,
            model=model_name(model) or None,
            completed=not message,
            message=message,
            stage=STAGES["rk4" if solver == "rk4" else "implicit" if implicit else "explicit"],
            order=MUJOCO_ORDERS.get(solver),
            held=tuple(channel for channel in channels if channel not in varying),
            inputs="held",
            looked_for=OCCASIONAL,
            acted=self._acted,
            strengths=motor_strengths(model),
            notes={"replay": f"every step was replayed; largest difference {self._off:.3g}"},
        )


record_mujoco = checked(MujocoRecorder, name="record_mujoco")


def _inverse_dexp(x: Array, w: Array) -> Array:
    """The rate ẋ (3,) of a rotation vector x at which exp(x) turns with w, in body components.

    ẋ = w + x × w/2 + c x × (x × w) with c = (1 − (|x|/2) cot(|x|/2))/|x|².
    """
    a = float(np.linalg.norm(x))
    c = 1.0 / 12.0 + a * a / 720.0 if a < 1e-2 else (1.0 - 0.5 * a / math.tan(0.5 * a)) / (a * a)
    across = np.cross(x, w)
    return np.asarray(w + 0.5 * across + c * np.cross(x, across))


@dataclass(frozen=True)
class _Row:
    """A step: the state it began with, q̈ and forces there, and the sums of its stages.

    `correction` is what an implicit integrator added to the forces, `of_correction` its work, J.
    """

    t: float
    q: Array
    u: Array
    qacc: Array
    forces: Forces
    step_acceleration: Array
    step: StepSums
    correction: Array | None = None
    of_correction: float = 0.0
    corrected: bool = False


# --- A whole run of MuJoCo, recorded -------------------------------------------------------------


@checked
def run_mujoco(
    model: Model | str | Path,
    duration: float,
    *,
    data: Data | None = None,
    controller: Control | None = None,
    step: float | None = None,
    integrator: str | None = None,
    channels: str = "all",
    progress: Progress | None = None,
    base: str = "fixed",
) -> Trajectory:
    """Run MuJoCo and record every step.

    Args:
        model: an mjModel, an mjSpec, or the path of an MJCF or URDF file. It is not changed.
        duration: s. Where the step does not divide it, the run goes on to the next whole step, and a note of
            the provenance, "duration", says so.
        data: the initial state and inputs; the model's own initial state by default. Not changed.
        controller: called as controller(model, data) before each step, to set data.ctrl or applied forces.
        step: time step, s; by default the model's own.
        integrator: one of `integrator_names`; by default the model's own.
        channels: as in `record_mujoco`.
        progress: called with the fraction done.
        base: "fixed" or "free", for the root link of a URDF file, as in `read_mechanism`.

    Returns:
        The trajectory: one row for each step and one for the end. A run that blows up stops there; its
        provenance says so.

    Raises:
        InputError: MuJoCo is missing, an argument is unusable, or the forces do not add up.
    """
    mujoco = simulator("mujoco", "mujoco")
    own = as_run(compiled_model(model, base), step, integrator)
    h = float(own.opt.timestep)
    steps = math.ceil(positive(duration, "duration") / h * (1.0 - SAME))
    state = mujoco.MjData(own)
    if data is not None:
        mujoco.mj_copyData(state, own, data)
    with record_mujoco(own, state, channels) as recorder:
        for k in range(steps):
            if controller is not None:
                controller(own, state)
            mujoco.mj_step(own, state)
            trouble = recorder.trouble()
            if trouble:
                return recorder.trajectory(trouble)
            recorder.sample()
            if progress is not None:
                progress((k + 1) / steps)
        if controller is not None:
            controller(own, state)
    run = recorder.trajectory()
    if _divides(h, duration):
        return run
    whole = f"{duration:.9g} s is no whole number of steps of {h:.9g} s: ran {steps} of them"
    notes = {**run.provenance.notes, "duration": f"{whole}, {steps * h:.9g} s"}
    return replace(run, provenance=replace(run.provenance, notes=notes))


def as_run(model: Model, step: float | None = None, integrator: str | None = None) -> Model:
    """A copy of a model for a run with a step and an integrator; InputError for none."""
    own = copy.copy(model)
    if step is not None:
        own.opt.timestep = positive(step, "step")
    if integrator is not None:
        own.opt.integrator = _integrator(integrator)
    # A reset to the initial state in the middle of a run would hide that it blew up.
    own.opt.disableflags |= simulator("mujoco", "mujoco").mjtDisableBit.mjDSBL_AUTORESET
    return own


def _integrator(name: str) -> mjtIntegrator:
    integrators = integrator_names()
    check_names([name], integrators, "unknown integrator")
    return integrators[name]


def _divides(step: float, duration: float) -> bool:
    steps = max(1, round(duration / step))
    return abs(steps * step - duration) <= SAME * duration


def compiled_model(model: Model | str | Path, base: str = "fixed") -> Model:
    """The mjModel that a model, a spec or a file means; InputError for none. `base` is a URDF's root link."""
    mujoco = simulator("mujoco", "mujoco")
    if isinstance(model, mujoco.MjModel):
        return model
    try:
        if isinstance(model, mujoco.MjSpec):
            return model.compile()
        if isinstance(model, str | Path):
            return simulated_model(model, base)
    except ValueError as error:
        raise ModelError(f"MuJoCo cannot read the model {model!s}: {error}") from None
    raise WrongType(
        f"model: found {type(model).__name__}, expected an mjModel, an mjSpec or the path of a file"
    )


# --- MuJoCo as a simulator of a study: `simulator(step)` runs the same motion at any step --------


@dataclass(frozen=True, eq=False)
class MujocoSimulator:
    """A MuJoCo model, its start and its inputs; called with a step (s) it returns the recorded run.

    `solver` and `order` name the integrator and its nominal order.
    """

    model: Model
    duration: float
    integrator: str
    controller: Control | None
    data: Data

    @property
    def solver(self) -> str:
        """The integrator, as "mujoco:rk4"."""
        return f"mujoco:{self.integrator}"

    @property
    def order(self) -> int | None:
        """The integrator's order, None for one that is not known."""
        return MUJOCO_ORDERS.get(self.integrator)

    def __call__(self, step: float) -> Trajectory:
        """The run at this step; InputError unless it divides the duration: runs are compared at their end."""
        if not _divides(step, self.duration):
            steps = math.ceil(self.duration / step)
            raise InputError(
                f"step {step:g} does not divide the duration {self.duration:g}; the next smaller one that "
                f"does is step={self.duration / steps:.12g}"
            )
        return run_mujoco(
            self.model,
            self.duration,
            data=self.data,
            controller=self.controller,
            step=step,
            integrator=self.integrator,
        )


@checked
def mujoco_simulator(
    model: ModelSource,
    duration: float,
    *,
    integrator: str = "rk4",
    controller: Control | None = None,
    state: State | Data | None = None,
) -> MujocoSimulator:
    """A MuJoCo model as the `simulator` of a study.

    Args:
        model: an mjModel, an mjSpec, or the path of an MJCF or URDF file.
        duration: s; each step must divide it.
        integrator: "euler", "rk4", "implicit", "implicitfast", or another of the installed MuJoCo.
        controller: called as controller(model, data) before each step. It is held over the step, so a motion
            that depends on it is of first order in the step, whatever the integrator.
        state: where it starts: an mjData, or a state of the imported mechanism; by default the model's own
            initial state.

    Raises:
        InputError: MuJoCo is missing, the integrator is unknown, or model or state cannot be used.
    """
    mujoco = simulator("mujoco", "mujoco")
    _integrator(name := integrator.lower())
    own = copy.copy(compiled_model(model))
    data = mujoco.MjData(own)
    if isinstance(state, State):
        _set_state(own, data, state)
    elif state is not None:
        mujoco.mj_copyData(data, own, state)
    return MujocoSimulator(own, duration, name, controller, data)


def _set_state(model: Any, data: Any, state: State) -> None:
    """Give the data a mechanism's state; its columns are in MuJoCo's order where they are as many."""
    q, u = np.asarray(state.q), np.asarray(state.u)
    if q.shape != data.qpos.shape or u.shape != data.qvel.shape:
        raise StateError(
            f"the state has {q.size} coordinates and {u.size} speeds, the MuJoCo model {data.qpos.size} "
            f"and {data.qvel.size} ({', '.join(coordinate_names(model)[:6])} …; "
            f"{', '.join(speed_names(model)[:6])} …): give state= as an mjData of this model"
        )
    data.qpos[:], data.qvel[:] = q, u
    data.time = state.t
