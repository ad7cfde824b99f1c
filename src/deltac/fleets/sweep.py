"""`sweep`: one plan, many runs; whatever stops it, the next call goes on."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from deltac.calls.arguments import checked
from deltac.calls.interrupts import interruptible
from deltac.calls.progress import Progress
from deltac.errors import ArgumentsError, InputError, SpecificationError, check_names
from deltac.fleets.design import Design, lay_out
from deltac.fleets.fleet import Plan
from deltac.fleets.result import Fleet
from deltac.fleets.rows import LONG_PIECE, PIECES_A_WORKER, SETTING, Piece, Setting
from deltac.fleets.runs import RefusedRun, RunPiece, Task
from deltac.fleets.spec import SweepSpec, make_spec, read_spec
from deltac.fleets.store import ADDRESS, digest, versions
from deltac.foreign.isolation import Failure
from deltac.mechanism import State
from deltac.models import Model, ModelLike, load_model

LARGEST_PIECE = 16384
"""Runs in a piece, at most: their records and states take some MB."""


@dataclass(frozen=True, eq=False)
class SweepPlan(Plan):
    """The points of a sweep, and what the runs of each setting share."""

    kind = "sweep"

    spec: SweepSpec
    design: Design
    tasks: tuple[Task | RefusedRun, ...]

    def head(self) -> dict[str, Any]:
        """The specification, and the digests of the models."""
        models = {task.model: task.mechanism.hash for task in self.tasks if isinstance(task, Task)}
        plan = self.spec.model_dump(mode="json", by_alias=True, exclude={"execution"})
        return {"plan": plan, "models": models}

    def piece(self, rows: Sequence[int]) -> RunPiece:
        """The piece of these rows, all of one setting."""
        chosen = np.asarray(rows)
        addresses = tuple(self.addresses[k] for k in rows)
        task = self.tasks[int(self.design.setting[chosen[0]])]
        return RunPiece(addresses, task, self.design.values[chosen])

    def pieces(self, rows: Sequence[int], workers: int, chunk: int | None) -> Iterator[Piece]:
        """Pieces of one setting."""
        places = np.asarray(rows)
        setting = self.design.setting[places]
        for one in dict.fromkeys(setting.tolist()):
            alike = places[setting == one].tolist()
            most = LONG_PIECE if self.spec.verb == "study" else LARGEST_PIECE
            share = math.ceil(len(alike) / (PIECES_A_WORKER * workers))
            # Whole vectors of any machine, and not so few that calls cost more than they do.
            size = chunk or max(1, min(most, max(64, -(-share // 64) * 64)))
            for first in range(0, len(alike), size):
                yield self.piece(alike[first : first + size])

    def piece_at(self, address: str) -> RunPiece:
        """The piece of one run, by its address or the beginning of it; InputError if there is none."""
        return self.piece([self.place(address)])

    def write_case(self, address: str, path: Path) -> None:
        """The audit of one run, with the mechanism moving."""
        from deltac import audit
        from deltac.fleets.runs import motion

        piece = self.piece_at(address)
        if isinstance(piece.task, RefusedRun):
            raise InputError.of(piece.task.failure.code, piece.task.failure.message)
        mechanism, run = motion(piece.task, piece.values)
        audit(mechanism, run, tolerance=piece.task.tolerance).report(path)


def plan_sweep(
    source: ModelLike | Mapping[str, Any],
    models: Mapping[str, ModelLike] | None = None,
    **options: Any,
) -> SweepPlan:
    """Read, validate and lay out a sweep; nothing is run. See `sweep` for the arguments.

    Of several models those that cannot be read, or lack what is asked of them, are refused by themselves:
    their rows say why.

    Raises InputError for whatever cannot be run in any of its points.
    """
    spec, named = _spec(source, options)
    named = {**named, **(models or {})}
    design = lay_out(spec)
    loaded: dict[str, Model | InputError] = {}
    tasks: list[Task | RefusedRun] = []
    errors: list[InputError] = []
    for setting in design.settings:
        if setting.model is None:
            raise SpecificationError("model: say what is swept, model = … or vary.model = [ … ]")
        try:
            if setting.model not in loaded:
                loaded[setting.model] = _loaded(named.get(setting.model, setting.model))
            model = loaded[setting.model]
            if isinstance(model, InputError):
                raise model
            tasks.append(_task(spec, setting, model, design.axes))
        except InputError as error:
            errors.append(error)
            failure = Failure(error.code, str(error))
            tasks.append(RefusedRun(**asdict(setting), axes=design.axes, failure=failure))
    if errors and (len(loaded) == 1 or len(errors) == len(tasks)):
        raise errors[0]
    if spec.design.kind != "list":
        design, tasks = _distinct(design, tasks)
    addresses = tuple(_addresses(design, tasks))
    command = f"deltac sweep {source}" if isinstance(source, str | Path) else "dc.sweep(…)"
    return SweepPlan(spec.name, addresses, command, spec, design, tuple(tasks))


def _loaded(source: ModelLike) -> Model | InputError:
    """The model, or why it is none."""
    try:
        return load_model(source)
    except InputError as error:
        return error


def _distinct(
    design: Design, tasks: Sequence[Task | RefusedRun]
) -> tuple[Design, list[Task | RefusedRun]]:
    """Each setting once: to a solver without fixed steps, all steps that are varied are the same."""
    first: dict[tuple[Any, ...], int] = {}
    for k, task in enumerate(tasks):
        first.setdefault(tuple(getattr(task, name) for name in SETTING), k)
    if len(first) == len(tasks):
        return design, list(tasks)
    settings = list(first.values())
    rows = np.isin(design.setting, settings)
    return Design(
        tuple(design.settings[k] for k in settings),
        np.searchsorted(settings, design.setting[rows]),
        design.axes,
        design.values[rows],
    ), [tasks[k] for k in settings]


def _spec(source: Any, options: Mapping[str, Any]) -> tuple[SweepSpec, dict[str, ModelLike]]:
    """The plan as validated values, and the models that were handed over as objects."""
    if isinstance(source, str | Path) and Path(source).suffix.lower() == ".toml":
        if options:
            raise ArgumentsError(
                f"{source} says what is swept; change {', '.join(options)} there, or give the model itself"
            )
        return read_spec(source), {}
    if isinstance(source, Mapping):
        return make_spec({**source, **options}), {}
    many = list(source) if isinstance(source, list) else [source]
    named: dict[str, ModelLike] = {}
    for one in many:
        if isinstance(one, str | Path):
            named[str(one)] = str(one)
        else:
            label = load_model(one).mechanism.name
            if label in named:
                raise SpecificationError(
                    f"two models are called {label!r}; give them different names"
                )
            named[label] = one
    values = {k: v for k, v in options.items() if v is not None}
    values["vary"] = _nested(values.get("vary") or {})
    if len(many) > 1:
        values["vary"]["model"] = list(named)
    else:
        values["model"] = next(iter(named))
    spec = make_spec(values)
    return (spec if spec.name else spec.model_copy(update={"name": next(iter(named))})), named


def _nested(vary: Mapping[str, Any]) -> dict[str, Any]:
    """Axes as TOML has them, of flat names such as "parameter.m" and of arrays."""
    nested: dict[str, Any] = {}
    for name, axis in vary.items():
        values = axis
        if isinstance(axis, np.ndarray | tuple | range):
            values = np.asarray(axis).tolist()
        if isinstance(values, list):
            values = [float(v) if isinstance(v, int) else v for v in values]
        group, dot, own = name.partition(".")
        if dot:
            nested.setdefault(group, {})[own] = values
        else:
            nested[name] = values
    return nested


def _task(spec: SweepSpec, setting: Setting, model: Model, axes: tuple[str, ...]) -> Task:
    """What the runs of a setting share, every default written out; InputError for unknown names."""
    from deltac.simulation import find_solver, whole_steps

    varied = [axis.partition(".")[2] for axis in axes if axis.startswith("parameter.")]
    mechanism = model.mechanism.opened(*varied, where="vary.parameter: ")
    mechanism = mechanism.with_parameters(**spec.parameter)
    names_of = {
        "parameter": list(mechanism.parameters),
        "q": list(mechanism.coordinates.names),
        "u": list(mechanism.speeds.names),
    }
    for axis in axes:
        group, _, name = axis.partition(".")
        check_names([name], names_of[group], f"vary.{group}: model {setting.model!r} has no")
    start = model.start(spec.state)
    if spec.parameter and spec.state is None and model.problem is None:
        start = Model(mechanism, model.starts).start(None)
    q, u = start.q.copy(), start.u.copy()
    for values, chosen, names in ((q, spec.q, names_of["q"]), (u, spec.u, names_of["u"])):
        check_names(chosen, names, f"model {setting.model!r} has no")
        for name, value in chosen.items():
            values[names.index(name)] = value
    duration = model.lasting(setting.duration)
    problem = model.problem
    solver = find_solver(setting.solver or (problem.solver if problem else "ode5"))
    step, solver_tolerance = setting.step, setting.solver_tolerance
    # Each kind of solver has one of the two.
    if solver.takes_steps:
        solver_tolerance = None
    elif spec.vary.step is not None or spec.design.file is not None:
        step = None
    if step is None and problem is not None and solver.takes_steps:
        step = problem.step
    if solver.takes_steps:
        if step is None:
            raise SpecificationError(
                f"step: say which step (s) solver {solver.name!r} takes, step = …"
            )
        whole_steps(duration, step, 1)
    return Task(
        verb=spec.verb,
        model=setting.model,
        mechanism=mechanism,
        start=State(start.t, q, u),
        solver=solver.name,
        step=step,
        solver_tolerance=solver_tolerance,
        duration=duration,
        tolerance=spec.tolerance,
        axes=axes,
    )


def _addresses(design: Design, tasks: Sequence[Task | RefusedRun]) -> Iterator[str]:
    """Of every row a digest of all that determines its answer."""
    made_by = versions()
    seeds = []
    for task in tasks:
        if isinstance(task, RefusedRun):
            contents: dict[str, Any] = {**asdict(task), "versions": made_by}
            seeds.append(hashlib.blake2b(digest(contents), digest_size=ADDRESS))
            continue
        contents = {
            "verb": task.verb,
            "model": task.mechanism.hash,
            "start": [task.start.t, task.start.q.tolist(), task.start.u.tolist()],
            "solver": task.solver,
            "step": task.step,
            "duration": task.duration,
            "tolerance": task.tolerance,
            "versions": made_by,
        }
        if task.solver_tolerance is not None:
            contents["solver_tolerance"] = task.solver_tolerance
        seeds.append(hashlib.blake2b(digest(contents), digest_size=ADDRESS))
    # By name, so that the order of the axes does not count.
    order = sorted(range(len(design.axes)), key=lambda k: design.axes[k])
    names = "\n".join(design.axes[k] for k in order).encode()
    for seed in seeds:
        seed.update(names)
    content = np.ascontiguousarray(design.values[:, order])
    for setting, row in zip(design.setting.tolist(), content):
        hasher = seeds[setting].copy()
        hasher.update(row.tobytes())
        yield hasher.hexdigest()


@checked
@interruptible()
def sweep(
    source: ModelLike | Mapping[str, object],
    out: str | Path | None = None,
    *,
    vary: Mapping[str, object] | None = None,
    design: Mapping[str, object] | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
    scheduler: str | None = None,
    time_limit: float | None = None,
    retries: int | None = None,
    chunk: int | None = None,
    retry_failed: bool = False,
    progress: Progress | None = None,
    **options: Any,
) -> Fleet:
    """Run a grid, a list or a random design over models, parameters, initial states, solvers and steps.

    Results that are already in `out` are not computed again: a sweep that was stopped or killed continues,
    and one whose plan was changed computes only what is new. The keys of a plan:

    - `model`, `state`, `solver`, `step`, `solver_tolerance`, `duration`, `name`: common to all runs; by
      default the problem's own. `solver_tolerance` applies to adaptive solvers (1e-9)
    - `verb`: "simulate", one run per point, or "study", a study at three steps per point
    - `tolerance`: accepted energy error (1e-3)
    - ``parameter.NAME``, ``q.NAME``, ``u.NAME``: parameters, initial coordinates and speeds; SI, or "30deg"
    - ``vary.model``, ``vary.solver``, ``vary.step``, ``vary.solver_tolerance``, ``vary.duration``: lists;
      every run is made with every setting
    - ``vary.parameter.NAME``, ``vary.q.NAME``, ``vary.u.NAME``: a list, or a range {from, to, count, scale};
      NAME may be a number of the model in quotes, ``"body.shank.mass"``
    - ``design.kind``: "grid"; "list", the k-th value of everything; "latin-hypercube" or "sobol",
      ``design.points`` points with ``design.seed``
    - ``design.file``: the points of a list as CSV or Parquet, columns named after the axes (`solver`, `step`,
      ``parameter.m1``, ``q.hip``)
    - ``execution.workers``, ``.time_limit``, ``.retries``, ``.chunk``, ``.scheduler``: as the arguments

    Args:
        source: a ``.toml`` file with such a plan, the same as a mapping, or a model, or a list of models;
            `vary`, `design` and `options` then say the rest.
        out: folder of the results; by default the sweep's name with ``.sweep``, in the working directory.
        vary: axes by name: "model", "solver", "step", "solver_tolerance", "duration", "parameter.m", "q.hip",
            "u.hip"; values, an array, or {"from": …, "to": …, "count": …, "scale": "log"}.
        design: {"kind": "grid"}, "list", "latin-hypercube" or "sobol"; random ones with "points" and "seed",
            lists with the "file" of a table, if the points are there.
        workers: number of processes; by default one per core.
        executor: does the work instead; any executor of the `concurrent.futures` interface.
        scheduler: address of a Dask scheduler whose workers do the work instead.
        time_limit: seconds that a piece of work may take before its process is ended (600).
        retries: more attempts for a run whose process died or took too long (2).
        chunk: number of runs in a piece of work.
        retry_failed: try again what was set aside before.
        progress: called with the fraction done.
        **options: verb ("simulate", "study"), name, state, solver, step, solver_tolerance, duration,
            tolerance, parameter, q, u, as in the TOML file.

    Returns:
        The fleet: counts of verdicts, the worst cases, `frame` with a row for every run.

    Raises:
        InputError: the plan cannot be run, the folder belongs to another sweep or is in use, the disk
            refuses, or the cluster is gone. Results computed before are kept.
    """
    if vary is not None:
        options["vary"] = vary
    if design is not None:
        options["design"] = design
    plan = plan_sweep(source, **options)
    execution = plan.spec.execution.overridden(
        workers=workers,
        scheduler=scheduler,
        time_limit=time_limit,
        retries=retries,
        chunk=chunk,
    )
    return plan.run(out, execution, executor=executor, retry_failed=retry_failed, progress=progress)
