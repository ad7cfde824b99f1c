"""A log of MuJoCo at a policy's rate, stepped again between its rows: is it reproducible by the model?"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from deltac.arrays import ROUGHLY, SAME, SAME_STEP, SMALL_SHARE, SOME_ROWS, Array
from deltac.calls.progress import TimeLimit
from deltac.diagnosis.audit.identification import identified, stepped_otherwise
from deltac.diagnosis.inputs.channels import foreign_channels
from deltac.diagnosis.inputs.logs import LogLike, in_model_order
from deltac.diagnosis.inputs.omissions import assumed_zero
from deltac.diagnosis.verdict import Finding, percent
from deltac.energy import balance
from deltac.errors import ArgumentsError, InputError, LogError, listed
from deltac.forces import joint_torque
from deltac.importers.names import actuator_names, feedback
from deltac.laws import q, u
from deltac.mechanism import Element
from deltac.mechanism.mechanism import Mechanism
from deltac.models import ModelLike
from deltac.recorders.mujoco_forces import (
    Forces,
    actuator_forces,
    constrained,
    of_controls_alone,
    solver_name,
)
from deltac.recorders.mujoco_recorder import as_run, compiled_model
from deltac.recorders.replay import Prediction, Replay, replay_mujoco
from deltac.trajectories import Trajectory
from deltac.trajectories.formats.files import log_reading, naming
from deltac.trajectories.formats.mapping import MappingLike
from deltac.trajectories.formats.objects import is_table
from deltac.trajectories.formats.reading import LogReading
from deltac.trajectories.formats.recognition import arrays_named, columns_of

if TYPE_CHECKING:
    from mujoco import MjModel

    from deltac.diagnosis.audit.audit import AuditReference

OF_MUJOCO = ("ctrl", "control", "controls")
CONTROLS = (*OF_MUJOCO, "action", "actions", "act", "u", "a")
ACTIVATIONS = ("act", "activation", "activations")

REPLAYED_STEPS = 20_000
"""Steps of a replay that nobody asked for: each takes milliseconds, as all of its forces are recorded."""

OUTLIER = 10.0
"""Miss of a row, in units of the typical one, from which on rows are not all missed alike."""


@dataclass(frozen=True, eq=False)
class Attempt:
    """What became of a replay.

    run                    every step of the motion; None where there was none
    findings               what it tells
    departures             (T,) energy (J) of each row of the run beyond that of the state at which the step
                           before it arrived
    with_actuators         the log with the forces of its actuators, where its rows are not reproduced, and
                           what these forces are by the state, as elements
    with_other_parameters  the replay by other parameters of the model that reproduce the log; None for none
    occasional             whether some rows are missed by far more than the typical one, as after a push
    scaled                 whether its controls may be a policy's outputs, which are scaled before they act
    """

    run: Trajectory | None
    findings: tuple[Finding, ...] = ()
    departures: Array | None = None
    with_actuators: tuple[Trajectory, tuple[Element, ...]] | None = None
    with_other_parameters: Callable[[], Attempt | None] | None = None
    occasional: bool = False
    scaled: bool = True


def replayed(
    model: ModelLike,
    reference: AuditReference,
    log: LogLike,
    mapping: MappingLike,
    *,
    required: bool,
    limit: TimeLimit,
) -> Attempt:
    """Every step of a log's motion, and whether it is the model's.

    Unless it is `required`, only a log that lacks forces which its model has is stepped, not one with forces
    that the model lacks nor that of a URDF file, and kept only where its first rows are reproduced: else
    model, step or controls are not those of the log, which is then judged as it is, for nobody claimed that
    they are the same. A finding says why.

    Raises InputError for a model or a log that cannot be stepped, if the replay is required.
    """
    mechanism, report = reference.mechanism, reference.import_report
    if isinstance(log, Trajectory) or not (isinstance(log, str | Path) or is_table(log)):
        if not required:
            return Attempt(None)
        raise ArgumentsError(
            "replay needs a log file or a table with states and controls; this log is a finished run"
        )
    if not required and report is not None and report.source.lower().endswith(".urdf"):
        return Attempt(None)  # a URDF file tells of no simulator, nor of its step
    try:
        program = compiled_model(model)
    except InputError as error:
        if not required:
            return Attempt(None)
        raise InputError(f"replay steps the model with MuJoCo: {error}") from None
    with naming(log):
        try:
            reading = log_reading(log, mapping, mechanism)
            if required:
                attempt = _attempt(mechanism, reading, *_stepped(program, mechanism, reading))
            else:
                run = reading.trajectory()
                missing = assumed_zero(run, report)
                # With foreign forces nothing is stepped.
                if not missing or foreign_channels(mechanism, run, report):
                    return Attempt(None)
                attempt = _unasked(program, mechanism, reading, missing, limit)
        except InputError:
            if required:
                raise
            return Attempt(None)  # the audit says what is wrong with the log
        if any(f.kind in ("not-replayed", "replay-departs") for f in attempt.findings):
            scaled = not (program.nu and _arrays(reading, OF_MUJOCO, program.nu))
            with_actuators = _with_actuators(program, mechanism, reading)
            other = partial(_with_other_parameters, program, reference, reading, scaled, limit)
            return replace(
                attempt, with_actuators=with_actuators, scaled=scaled, with_other_parameters=other
            )
        return attempt


def _attempt(
    mechanism: Mechanism, reading: LogReading, replay: Replay, findings: Sequence[Finding]
) -> Attempt:
    read = reading.trajectory().provenance
    source = replace(replay.run.provenance, reading=read.reading, guessed=read.guessed)
    run = replace(replay.run, provenance=source)
    told = (*findings, _of(replay))
    return Attempt(run, told, _departures(mechanism, replay)[0], occasional=_is_occasional(replay))


def _with_other_parameters(
    program: MjModel,
    reference: AuditReference,
    reading: LogReading,
    scaled: bool,
    limit: TimeLimit,
) -> Attempt | None:
    """The replay by the model with other parameters that reproduces the log; None where none do.

    Where controls may be `scaled` before they act, gears and masses of all bodies tell nothing.
    """
    mechanism, own = reference.mechanism, as_run(program)
    try:
        run, (ctrl, act), findings = _inputs(own, mechanism, reading)
        first = replay_mujoco(own, *(x[: SOME_ROWS + 1] for x in (run.t, run.q, run.u, ctrl, act)))
    except InputError:
        return None
    if first.steps * (len(run) - 1) > REPLAYED_STEPS or limit.passed(
        "other parameters of the model"
    ):
        return None
    late, rows = int(first.late), np.arange(len(run) - 1)
    prediction = Prediction(run.t, run.q, run.u, ctrl[late:], act, first.steps, rows)
    missed = np.abs(prediction.errors(own) / prediction.scale).max(axis=1)
    if not np.isfinite(missed).all():
        return None  # the model leaves all bounds within a step
    rows = np.flatnonzero(missed > SMALL_SHARE * missed.max())
    if not len(rows):
        return None
    some = replace(prediction, rows=rows)
    if (again := stepped_otherwise(own, some)) is not None:
        replay = replay_mujoco(again, run.t, run.q, run.u, ctrl, act)
        told = Finding(
            "identified",
            "MuJoCo reproduces the log with another step or integrator than the model's: "
            f"{solver_name(again)} of {again.opt.timestep:.6g} s, not {solver_name(own)} of "
            f"{own.opt.timestep:.6g} s",
            f"the model's own steps miss {len(rows)} of {len(missed)} rows",
            "The log is judged with these options; give them to the model to repeat the run",
            "note",
        )
    else:
        fit = identified(own, some, REPLAYED_STEPS)
        if fit is None or (scaled and any(p.scales for p in fit.chosen)):
            return None
        replay = replay_mujoco(fit.of(own), run.t, run.q, run.u, ctrl, act)
        arrivals = prediction.arrivals(own)
        joules, energy = _departures(mechanism, replace(replay, arrivals=arrivals))
        most = float(np.abs(np.cumsum(joules)).max())
        unseen = all(p.of_logged_forces for p in fit.chosen)
        told = Finding(
            "identified",
            "MuJoCo reproduces the log with other parameters than the model's: "
            + "; or ".join(one.changes(own) for one in (fit, *fit.others)),
            f"the model's own steps miss {len(rows)} of {len(missed)} rows, which adds up to {most:.3g} J; "
            f"with these parameters, {percent(fit.left)} of the misses are left",
            "Give the model the values that the simulator used",
            "cause" if unseen and most > reference.tolerance * energy else "note",
            fit.chosen[0].element,
        )
    if len(replay.departures) and not _is_occasional(replay):
        return None
    attempt = _attempt(mechanism, reading, replay, (*findings, told))
    # What is left of a few rows is the solver's, of contacts that are close to none.
    kept = tuple(f for f in attempt.findings if f.kind != "replay-departs")
    return replace(attempt, findings=kept)


def _is_occasional(replay: Replay) -> bool:
    """Whether some rows are missed by far more than the typical one: noise and mistakes miss all alike."""
    return bool(
        len(replay.departures) and replay.missed.max() >= OUTLIER * np.median(replay.missed)
    )


def _departures(mechanism: Mechanism, replay: Replay) -> tuple[Array, float]:
    """Energy (T,) of each row of a replay beyond that of the state at which the step before arrived, J.

    And the energy that the system has.
    """
    places = replay.steps * np.arange(1, len(replay.t))
    rows = replace(replay.run.take(places), udot=None, forces={}, works={}, integrals={}, events=())
    q, u = replay.arrivals
    ledgers = [
        balance(mechanism, in_model_order(mechanism, states)[0])
        for states in (rows, replace(rows, q=q, u=u))
    ]
    energies = [ledger.kinetic + ledger.potential_energy for ledger in ledgers]
    joules = np.zeros(len(replay.run))
    joules[places] = energies[0] - energies[1]
    return joules, ledgers[0].reference_energy


def _unasked(
    program: MjModel,
    mechanism: Mechanism,
    reading: LogReading,
    missing: Sequence[str],
    limit: TimeLimit,
) -> Attempt:
    """The replay of a log that lacks the forces of the channels `missing`, or why there is none."""
    if program.nu and not _controls(reading, program):
        if not any(name.startswith("actuator ") for name in missing):
            return Attempt(None)  # their forces are logged
        return _not_replayed(
            "the log has neither controls nor forces: most of what moved the model is unknown",
            f"missing: ctrl (T, {program.nu}), or the forces of {listed(map(repr, missing))}",
            "Log data.ctrl at each row: MuJoCo is then stepped between the rows, and every force is known. "
            "Of this log can be judged whether coordinates move as their speeds say and, in free flight, the "
            "momentum of the whole",
        )
    if limit.passed("the replay of the log by MuJoCo"):
        return Attempt(None)
    try:
        start = time.monotonic()
        replay, _ = _stepped(program, mechanism, reading, SOME_ROWS + 1)
        if 2 * len(replay.departures) > len(replay.missed):
            return _departing(replay)
        intervals = len(reading.trajectory()) - 1
        seconds = (time.monotonic() - start) * intervals / len(replay.missed)
        if limit.passed("the replay of the log by MuJoCo", seconds):
            return Attempt(None)
        steps = replay.steps * intervals
        if steps > REPLAYED_STEPS:
            return _not_replayed(
                "the log is long, and was not stepped again",
                f"{steps} steps of the model, more than {REPLAYED_STEPS}",
                "Ask for it (replay=True, --replay), or audit a part of the log",
            )
        replay, findings = _stepped(program, mechanism, reading)
        if len(replay.departures) and not _is_occasional(replay):
            return _departing(replay)
        return _attempt(mechanism, reading, replay, findings)
    except InputError as error:
        return _not_replayed("the model cannot be stepped between the rows", str(error), "")


def _with_actuators(
    program: MjModel, mechanism: Mechanism, reading: LogReading
) -> tuple[Trajectory, tuple[Element, ...]] | None:
    """The log with the forces of actuators by its controls, and what these forces are by the state.

    None where the controls do not tell them. MuJoCo asks for forces once a step, but at each stage of RK4;
    there, and over several steps, those that vary with the state are laws of the model, and the rest is held.
    """
    run, _ = in_model_order(mechanism, reading.trajectory())
    controls = _controls(reading, program)
    fits = (run.q.shape[1], run.u.shape[1]) == (program.nq, program.nv)
    if not fits or len(controls) != 1 or len(controls[0]) != len(run):
        return None
    if not np.isfinite(controls[0]).all():
        return None
    if np.mean(constrained(program, run.q, run.u)) > ROUGHLY:
        return None  # whose forces no row tells
    forces = actuator_forces(program, run.q, run.u, controls[0])
    if forces is None:
        return None
    one_step = np.abs(np.diff(run.t) / program.opt.timestep - 1.0).max(initial=0.0) <= SAME_STEP
    laws: tuple[Element, ...] = ()
    if not of_controls_alone(program) and (not one_step or solver_name(program) == "rk4"):
        split = _laws_of_state(program, run, controls[0], forces)
        if split is None:
            return None
        forces, laws = split
    held = run.provenance.held
    if one_step:  # over several the controls may have been others
        held = (*(held or ()), *forces)
    provenance = replace(run.provenance, held=held)
    return replace(run, forces={**run.forces, **forces}, provenance=provenance), laws


def _laws_of_state(
    program: MjModel, run: Trajectory, controls: Array, forces: Forces
) -> tuple[Forces, tuple[Element, ...]] | None:
    """What of actuators' forces is by their controls alone, and the rest as elements.

    None where the rest is no linear law, as of a force that meets its limit.
    """
    at_rest = np.broadcast_to(program.qpos0, run.q.shape), np.zeros_like(run.u)
    by_controls, laws = actuator_forces(program, *at_rest, controls), list[Element]()
    if by_controls is None:
        return None
    linear = {name: force.copy() for name, force in by_controls.items()}
    for name, law in feedback(program).items():
        at_q, at_u = run.coordinates.index(law.joint), run.speeds.index(law.speed)
        channel, start = f"actuator {name}", law.stiffness * program.qpos0[at_q]
        by_controls[channel][:, at_u] += start
        state = law.stiffness * run.q[:, at_q] + law.damping * run.u[:, at_u]
        linear[channel][:, at_u] += start - state
        if law.stiffness:
            torque = -law.stiffness * q(law.joint)
            laws.append(joint_torque(f"{name} by position", law.joint, torque))
        if law.damping:
            torque = -law.damping * u(law.speed)
            laws.append(joint_torque(f"{name} by speed", law.joint, torque))
    same = all(
        np.abs(linear[n] - f).max(initial=0.0) <= SAME * np.abs(f).max(initial=0.0)
        for n, f in forces.items()
    )
    return (by_controls, tuple(laws)) if same else None


def _stepped(
    program: MjModel, mechanism: Mechanism, reading: LogReading, rows: int | None = None
) -> tuple[Replay, list[Finding]]:
    """The replay of a log, or of its first rows; InputError where it cannot be stepped."""
    run, inputs, findings = _inputs(program, mechanism, reading)
    states = (x[:rows] for x in (run.t, run.q, run.u, *inputs))
    return replay_mujoco(program, *states), findings


def _inputs(
    program: MjModel, mechanism: Mechanism, reading: LogReading
) -> tuple[Trajectory, tuple[Array, Array], list[Finding]]:
    """The log, and its controls and activations; InputError where it cannot be stepped."""
    run, findings = in_model_order(mechanism, reading.trajectory())
    if run.q.shape[1] != program.nq or run.u.shape[1] != program.nv:
        raise LogError("the log's coordinates are not all of MuJoCo's model; log qpos and qvel")
    inputs = list[Array]()
    for names, width, what, arrays in (
        (CONTROLS, program.nu, "controls (ctrl)", _controls(reading, program)),
        (ACTIVATIONS, program.na, "activations (act)", _arrays(reading, ACTIVATIONS, program.na)),
    ):
        arrays = arrays if width else [np.zeros((len(run), 0))]
        if len(arrays) != 1 or len(arrays[0]) != len(run):
            named = [c for c in _free(reading) if c.split("[")[0] in names]
            shapes = (
                listed([str(x.shape) for x in arrays] or [f"column {c!r}" for c in named]) or "none"
            )
            each = _of_actuators(reading, program) if names is CONTROLS else {}
            if any(each.values()):  # a column for each actuator
                shapes = listed(f"{c or 'none'} of actuator {n!r}" for n, c in each.items())
            raise LogError(
                f"expected one array of {what}, ({len(run)}, {width}), named {names[0]!r} or {names[1]!r}; "
                f"found {shapes}. The replay steps the model with them"
            )
        if not np.isfinite(arrays[0]).all():
            row = int(np.argmin(np.isfinite(arrays[0]).all(axis=1)))
            raise LogError(
                f"row {row} (t = {run.t[row]:.6g} s) of the {what} is not a number; give each row its values"
            )
        inputs.append(arrays[0])
    return run, (inputs[0], inputs[1]), findings


def _controls(reading: LogReading, program: MjModel) -> list[Array]:
    """Arrays (T, nu) of controls, or one of columns that name each an actuator and a control."""
    arrays = _arrays(reading, CONTROLS, program.nu) if program.nu else []
    if arrays or not program.nu:
        return arrays
    free, each = _free(reading), _of_actuators(reading, program).values()
    return [np.column_stack([free[c] for (c,) in each])] if all(len(c) == 1 for c in each) else []


def _of_actuators(reading: LogReading, program: MjModel) -> dict[str, list[str]]:
    """Actuator -> the columns that name it and a control."""
    free = _free(reading)
    return {name: columns_of(free, name, CONTROLS) for name in actuator_names(program)}


def _arrays(reading: LogReading, names: tuple[str, ...], width: int) -> list[Array]:
    """Arrays (T, width) of one of these names, of columns that are nothing else."""
    return arrays_named(_free(reading), names, width)


def _free(reading: LogReading) -> dict[str, Array]:
    """Columns that mean nothing yet."""
    columns = {one.column for one in reading.meanings.values()}
    return {n: c for n, c in reading.raw.columns.items() if n not in columns}


def _of(replay: Replay) -> Finding:
    belong = ", with the controls of the row after them" if replay.late else ""
    steps = f"{replay.steps} step{'s' * (replay.steps > 1)} from row to row{belong}"
    departures, intervals = replay.departures, len(replay.t) - 1
    if not len(departures):
        return Finding(
            "replayed",
            "MuJoCo reproduces the log: from each row it arrives at the next one",
            f"{intervals} times, {steps}; largest miss {percent(float(replay.missed.max()))} of what changes "
            "from row to row",
            "",
        )
    first = int(departures[0])
    worst = float(replay.missed[departures - 1].max())
    return Finding(
        "replay-departs",
        f"the model does not reproduce the log: stepping from row {first - 1} misses row {first}",
        f"t = {replay.t[first]:.6g} s, by {percent(float(replay.missed[first - 1]))} of what changes from "
        f"row to row; {len(departures)} of {intervals} rows are missed, the worst by "
        f"{percent(worst)}; {steps}",
        "The log was made with another model, step or controls, or something acted that is not in it (a "
        "push, a reset, noise on the action); compare the parameters, or use the rows before that",
        "cause",
        factor=worst,
    )


def _departing(replay: Replay) -> Attempt:
    return Attempt(None, (as_note(_of(replay)),))


def as_note(departs: Finding) -> Finding:
    """What a replay misses, told of a log that is judged without it: it accuses nobody."""
    return replace(departs, kind="not-replayed", weight="note")


def _not_replayed(what: str, evidence: str, remedy: str) -> Attempt:
    return Attempt(None, (Finding("not-replayed", what, evidence, remedy, "note"),))
