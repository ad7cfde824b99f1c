"""The work of a sweep: runs of one model in one setting, as an ensemble where that can be; or studies."""

from __future__ import annotations

import math
import time
import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from deltac.arrays import Array, max_norm
from deltac.errors import InputError
from deltac.fleets.rows import NUMBER, SETTING, TEXT, Piece, Setting, failed_outcome
from deltac.foreign.isolation import Failure
from deltac.mechanism import Mechanism, State

if TYPE_CHECKING:
    from deltac.simulation import Ensemble
    from deltac.trajectories import Trajectory

RECORDS = 8
"""Times at which the energies of a run are looked at, at most, besides the start."""

CLOSER = RECORDS**2
"""A run that seems wrong is looked at this many times at least: a few may all fall on turning points of a
periodic motion, where it has little energy."""

NUMBERS_HELD = 1 << 20
"""Numbers of one quantity, of runs by times, that are held at once when looking closer."""

TESTING = ("wang", "liu-huston")

RUN_OUTCOME: dict[str, str] = {
    "verdict": TEXT,
    "confidence": TEXT,
    "relative": NUMBER,
    "energy_error": NUMBER,
    "energy": NUMBER,
    **{f"delta_c.{name}": NUMBER for name in TESTING},
    "order": NUMBER,
    "stopped": NUMBER,
    "evaluations": NUMBER,
    "seconds": NUMBER,
    "findings": TEXT,
    "code": TEXT,
    "message": TEXT,
    "details": TEXT,
}
"""What the table says of every run; see docs/fleets.md."""


@dataclass(frozen=True, eq=False)
class Task(Setting):
    """A setting whose runs can be made, every default written out.

    `start`: where a run starts, but for what the axes say. The mechanism has the parameters that are the same
    in all runs. `solver_tolerance` is None for solvers with fixed steps, and for the default one.
    """

    solver: str
    duration: float
    axes: tuple[str, ...]
    verb: str
    mechanism: Mechanism
    start: State
    tolerance: float


@dataclass(frozen=True, eq=False)
class RefusedRun(Setting):
    """A setting whose runs cannot be made, since its model cannot be read, or lacks what is asked of it."""

    axes: tuple[str, ...]
    failure: Failure


@dataclass(frozen=True, eq=False)
class RunPiece(Piece):
    """Some runs of a setting: the values of their axes (N, axes)."""

    needs = (
        "deltac.verbs",
        "deltac.simulation.ensemble.ensemble",
        "llvmlite.binding",
    )
    kinds = RUN_OUTCOME
    per_row = "values"

    task: Task | RefusedRun
    values: Array

    def outcome(self) -> dict[str, Any]:
        """As an ensemble where that can be, else one by one."""
        from deltac.simulation import find_solver

        task = self.task
        if isinstance(task, RefusedRun):
            return {n: values * self.rows for n, values in failed_outcome(task.failure).items()}
        if task.verb == "study":
            return _by_members(self, _study, together=False)
        if find_solver(task.solver).family == "fixed" and not task.mechanism.events:
            return _by_members(self, _ensemble, together=True)
        return _by_members(self, _single, together=False)

    def about(self) -> dict[str, Any]:
        """Model, setting and axes of the first run."""
        setting = {name: getattr(self.task, name) for name in SETTING if name != "duration"}
        return {**setting, **dict(zip(self.task.axes, self.values[0].tolist()))}

    def point(self) -> dict[str, tuple[str, Any]]:
        """Setting and axes."""
        kinds = {name: TEXT if name in ("model", "solver") else NUMBER for name in SETTING}
        return {
            **{
                name: (kind, [getattr(self.task, name)] * self.rows) for name, kind in kinds.items()
            },
            **{name: (NUMBER, self.values[:, k]) for k, name in enumerate(self.task.axes)},
        }


def _parameters(task: Task, row: Array) -> dict[str, float]:
    """Values of the parameters that vary."""
    named = zip(task.axes, row.tolist())
    return {n.removeprefix("parameter."): v for n, v in named if n.startswith("parameter.")}


def _states(task: Task, values: Array) -> tuple[Array, Array]:
    """Q (N, nq) and U (N, nu): the start, with what the axes say put in."""
    Q, U = (np.tile(part, (len(values), 1)) for part in (task.start.q, task.start.u))
    for k, axis in enumerate(task.axes):
        group, _, name = axis.partition(".")
        if group == "q":
            Q[:, task.mechanism.coordinates.names.index(name)] = values[:, k]
        elif group == "u":
            U[:, task.mechanism.speeds.names.index(name)] = values[:, k]
    return Q, U


def _by_members(piece: RunPiece, work: Any, *, together: bool) -> dict[str, Any]:
    """The outcome of `work`; where it refuses, that of the halves, down to the run that is refused."""
    if piece.rows == 1 or together:
        try:
            return dict(work(piece))
        except InputError as error:
            if piece.rows == 1:
                return failed_outcome(Failure(error.code, str(error)))
    halves = piece.halves()
    (a, n), (b, m) = ((_by_members(half, work, together=together), half.rows) for half in halves)
    return {name: [*a.get(name, [None] * n), *b.get(name, [None] * m)] for name in {**a, **b}}


_WARM: set[Any] = set()
"""Settings whose kernels are compiled in this process."""


def _ensemble(piece: RunPiece) -> dict[str, Any]:
    from deltac.kernels import AVX512_WIDTH
    from deltac.simulation import find_solver, whole_steps

    task = piece.task
    assert isinstance(task, Task) and task.step is not None
    steps = whole_steps(task.duration, task.step, 1)
    records = max(k for k in range(1, RECORDS + 1) if steps % k == 0)
    own = [name for name in task.axes if name.startswith("parameter.")]

    def run(members: Any, records: int) -> Ensemble:
        from deltac.simulation import Record
        from deltac.verbs import simulate_ensemble

        values = piece.values[members]
        states: Any = task.start
        if len(own) < len(task.axes):
            Q, U = _states(task, values)
            states = (Q, U)
            if task.start.t:
                states = [State(task.start.t, q, u) for q, u in zip(Q, U)]
        vary = {n.removeprefix("parameter."): values[:, task.axes.index(n)] for n in own}
        return simulate_ensemble(
            task.mechanism,
            states,
            task.duration,
            task.step,  # type: ignore[arg-type]
            task.solver,
            Record(TESTING, steps // records),
            vary=vary,
            threads=1,
        )

    key = (task.mechanism.digest(own and [n[10:] for n in own]), task.solver, steps // records)
    if key not in _WARM:  # compiled before the clock runs
        run(slice(0, AVX512_WIDTH), records)
        _WARM.add(key)
    began = time.process_time()
    ensemble = run(slice(None), records)
    lost = np.isfinite(ensemble.stopped)
    error, energy, *largest = _extremes(ensemble)
    relative, verdict = judged(error, energy, lost, task.tolerance)
    if (more := _closer(steps)) > records:
        accused = np.flatnonzero((relative > task.tolerance) & ~lost)
        for some in np.array_split(accused, math.ceil(len(accused) * more / NUMBERS_HELD) or 1):
            closer = _extremes(run(some, more)) if len(some) else []
            for values, again in zip((error, energy, *largest), closer):
                values[some] = np.fmax(values[some], again)
        relative, verdict = judged(error, energy, lost, task.tolerance)
    count = len(piece.addresses)
    seconds = (time.process_time() - began) / count
    stages = find_solver(task.solver).stages
    steps_taken = np.where(lost, np.round((ensemble.stopped - task.start.t) / task.step), steps)
    return {
        "verdict": verdict,
        "relative": relative,
        "energy_error": error,
        "energy": energy,
        **{f"delta_c.{name}": values for name, values in zip(TESTING, largest)},
        "stopped": ensemble.stopped,
        "evaluations": stages * steps_taken,
        "seconds": np.full(count, seconds),
    }


def _closer(steps: int) -> int:
    """Times at which a run of so many steps is examined: a divisor of these, `CLOSER` or slightly more."""
    return next(k for k in range(min(CLOSER, steps), steps + 1) if steps % k == 0)


def _extremes(ensemble: Ensemble) -> list[Array]:
    """Of every run the largest energy error, the energy, the largest |ΔC| of each testing function, in J."""
    V = ensemble.potential
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of runs that are lost before the first record
        return [
            np.nanmax(np.abs(ensemble.delta_c["wang"] + ensemble.corrections), axis=0),
            np.nanmax(ensemble.kinetic, axis=0) + np.nanmax(V, axis=0) - np.nanmin(V, axis=0),
            *(np.nanmax(np.abs(ensemble.delta_c[n]), axis=0) for n in TESTING),
        ]


def judged(error: Array, energy: Array, lost: Array, tolerance: float) -> tuple[Array, list[str]]:
    """Energy errors as fractions of the energy that the system has, and what they mean.

    Our own runs obey the model's equations: an error is the integration's. A system without energy tells
    nothing.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.where(energy > 0.0, error / energy, math.nan)
    words = np.where(relative <= tolerance, "consistent", "integration-error")
    words = np.where(np.isnan(relative), "unresolved", words)
    return relative, np.where(lost, "integration-error", words).tolist()


def motion(task: Task, values: Array) -> tuple[Mechanism, Trajectory]:
    """The mechanism and the run of one point, `values` (1, axes)."""
    from deltac.simulation import Record, solver_options
    from deltac.verbs import simulate

    parameters = _parameters(task, values[0])
    # Compiled once for all of their values.
    mechanism = task.mechanism.varying(*parameters).with_parameters(**parameters)
    Q, U = _states(task, values)
    run = simulate(
        mechanism,
        State(task.start.t, Q[0], U[0]),
        task.duration,
        task.step,
        solver_options(task.solver, task.solver_tolerance),
        Record(TESTING),
    )
    return mechanism, run


def _single(piece: RunPiece) -> dict[str, Any]:
    """One run by `simulate`: of solvers that ensembles do not have, and of mechanisms with events."""
    from deltac.simulation import find_solver
    from deltac.verbs import balance

    task = piece.task
    assert isinstance(task, Task)
    solver = find_solver(task.solver)
    began = time.process_time()
    mechanism, run = motion(task, piece.values)
    seconds = time.process_time() - began
    ledger = balance(mechanism, run)
    error = max_norm(ledger.uncorrected("wang"))
    energy = ledger.reference_energy
    lost = not run.provenance.completed
    relative, verdict = judged(
        np.array([error]), np.array([energy]), np.array([lost]), task.tolerance
    )
    steps = None
    if solver.family == "fixed" and task.step is not None:
        steps = [float(solver.stages * round(run.duration / task.step))]
    return {
        "verdict": verdict,
        "relative": relative,
        "energy_error": [error],
        "energy": [energy],
        **{f"delta_c.{n}": [max_norm(ledger.delta_c[n])] for n in TESTING},
        "stopped": [float(run.t[-1]) if lost else None],
        "message": [run.provenance.message or None],
        "seconds": [seconds],
        **({} if steps is None else {"evaluations": steps}),
    }


def _study(piece: RunPiece) -> dict[str, Any]:
    """One study: at 4, 2 and 1 times the step; at 1, 1/2 and 1/4 where these do not divide the duration.

    Of solvers that choose their steps at 100, 10 and 1 times their tolerance.
    """
    from deltac import study
    from deltac.simulation import Adaptive, find_solver, solver_options, three_steps

    task, (row,) = piece.task, piece.values
    assert isinstance(task, Task)
    mechanism = task.mechanism.with_parameters(**_parameters(task, row))
    Q, U = _states(task, piece.values)
    began = time.process_time()
    stepping = find_solver(task.solver).takes_steps
    # Taylor's method has no tolerance by default, which could be refined.
    refined = None if stepping else task.solver_tolerance or Adaptive.tolerance
    solver = solver_options(task.solver, refined)
    steps = None
    if stepping and task.step is not None:
        steps = three_steps(task.duration, task.step)
    result = study(
        mechanism,
        State(task.start.t, Q[0], U[0]),
        task.duration,
        steps,
        solver,
        tolerance=task.tolerance,
        record=TESTING,
    )
    order = result.observed_order["state"].order if "state" in result.observed_order else None
    error = float(result.errors[-1])
    return {
        "verdict": [result.verdict.kind],
        "confidence": [result.verdict.confidence],
        "relative": [result.relative],
        "energy_error": [error],
        "energy": [result.reference_energy],
        "order": [order],
        "seconds": [time.process_time() - began],
        "findings": [" ".join(f.code for f in result.findings)],
        "message": [result.summary()],
        "details": [None if result.exit_code == 0 else result.explain()],
    }
