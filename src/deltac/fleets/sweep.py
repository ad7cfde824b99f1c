"""`sweep`: one plan, many runs; whatever stops it, the next call goes on."""

from __future__ import annotations

import contextlib
import hashlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from deltac.errors import InputError, UnknownName, closest
from deltac.fleets.design import Design, Setting, lay_out
from deltac.fleets.execution import Crew, SchedulerLost, Work, dask_crew, execute, local_crew
from deltac.fleets.isolation import Failure
from deltac.fleets.result import Fleet, summarise
from deltac.fleets.runs import RunPiece, Task, failed_row
from deltac.fleets.spec import Execution, SweepSpec, make_spec, read_spec
from deltac.fleets.store import ADDRESS, RESULTS, Store, digest, versions
from deltac.interrupts import interruptible
from deltac.mechanism.state import State
from deltac.models import Model, ModelLike, load_model

if TYPE_CHECKING:
    import polars

LARGEST = 16384
"""Runs in a piece, at most: their records and states take some MB."""

SHARES = 4
"""Pieces of each setting for a worker, at least, so that none waits long for the last one."""

STUDIES = 4
"""Studies in a piece: each takes seconds."""


@dataclass(frozen=True, eq=False)
class Plan:
    """A sweep before it is run: its points, what the runs of each setting share, the address of every row."""

    spec: SweepSpec
    design: Design
    tasks: tuple[Task, ...]
    addresses: tuple[str, ...]

    def piece(self, rows: Sequence[int]) -> RunPiece:
        """The piece of these rows, all of one setting."""
        chosen = np.asarray(rows)
        return RunPiece(
            self.tasks[int(self.design.setting[chosen[0]])],
            self.design.values[chosen],
            tuple(self.addresses[k] for k in rows),
        )


def plan_sweep(
    source: ModelLike | Mapping[str, Any],
    models: Mapping[str, ModelLike] | None = None,
    **options: Any,
) -> Plan:
    """Read, validate and lay out a sweep; nothing is run. See `sweep` for the arguments.

    Raises InputError for whatever cannot be run in any of its points.
    """
    spec, named = _spec(source, options)
    named = {**named, **(models or {})}
    design = lay_out(spec)
    loaded: dict[str, Model] = {}
    tasks = []
    for setting in design.settings:
        if setting.model is None:
            raise InputError("model: say what is swept, model = … or vary.model = [ … ]")
        if setting.model not in loaded:
            loaded[setting.model] = load_model(named.get(setting.model, setting.model))
        tasks.append(_task(spec, setting, loaded[setting.model], design.axes))
    return Plan(spec, design, tuple(tasks), tuple(_addresses(design, tasks)))


def _spec(source: Any, options: Mapping[str, Any]) -> tuple[SweepSpec, dict[str, ModelLike]]:
    """The plan as validated values, and the models that were handed over as objects."""
    if isinstance(source, str | Path) and Path(source).suffix.lower() == ".toml":
        if options:
            raise InputError(
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
                raise InputError(f"two models are called {label!r}; give them different names")
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
    from deltac.simulation.arguments import whole_steps
    from deltac.simulation.solvers import find_solver

    mechanism = model.mechanism.with_parameters(**spec.parameter)
    known = {
        "parameter": list(mechanism.parameters),
        "q": list(mechanism.coordinates.names),
        "u": list(mechanism.speeds.names),
    }
    for axis in axes:
        group, _, name = axis.partition(".")
        if name not in known[group]:
            raise UnknownName(
                f"vary.{axis}: model {setting.model!r} has none{closest(name, known[group])}"
            )
    start = model.start(spec.state)
    if spec.parameter and spec.state is None and model.problem is None:
        start = Model(mechanism, model.starts).start(None)
    q, u = start.q.copy(), start.u.copy()
    for values, given, names in ((q, spec.q, known["q"]), (u, spec.u, known["u"])):
        for name, value in given.items():
            if name not in names:
                raise UnknownName(
                    f"{name!r}: model {setting.model!r} has none{closest(name, names)}"
                )
            values[names.index(name)] = value
    duration = model.lasting(setting.duration)
    problem = model.problem
    solver = find_solver(setting.solver or (problem.solver if problem else "ode5"))
    step = setting.step
    if step is None and problem is not None and solver.takes_steps:
        step = problem.step
    if solver.takes_steps:
        if step is None:
            raise InputError(f"step: say which step (s) solver {solver.name!r} takes, step = …")
        whole_steps(duration, step, 1)
    return Task(
        verb=spec.verb,
        label=setting.model,
        mechanism=mechanism,
        start=State(start.t, q, u),
        solver=solver.name,
        step=step,
        duration=duration,
        tolerance=spec.tolerance,
        axes=axes,
    )


def _addresses(design: Design, tasks: Sequence[Task]) -> Iterator[str]:
    """Of every row a digest of all that determines its answer."""
    made_by = versions()
    seeds = []
    for task in tasks:
        told = {
            "verb": task.verb,
            "model": task.mechanism.hash,
            "start": [task.start.t, task.start.q.tolist(), task.start.u.tolist()],
            "solver": task.solver,
            "step": task.step,
            "duration": task.duration,
            "tolerance": task.tolerance,
            "versions": made_by,
        }
        seeds.append(hashlib.blake2b(digest(told), digest_size=ADDRESS))
    # By name, so that the order of the axes does not count.
    order = sorted(range(len(design.axes)), key=lambda k: design.axes[k])
    names = "\n".join(design.axes[k] for k in order).encode()
    for seed in seeds:
        seed.update(names)
    content = np.ascontiguousarray(design.values[:, order])
    for setting, row in zip(design.setting.tolist(), content):
        found = seeds[setting].copy()
        found.update(row.tobytes())
        yield found.hexdigest()


@interruptible()
def sweep(
    source: ModelLike | Mapping[str, Any],
    out: str | Path | None = None,
    *,
    vary: Mapping[str, Any] | None = None,
    design: Mapping[str, Any] | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
    scheduler: str | None = None,
    time_limit: float | None = None,
    retries: int | None = None,
    chunk: int | None = None,
    retry_failed: bool = False,
    progress: Callable[[float], None] | None = None,
    **options: Any,
) -> Fleet:
    """Run a grid, a list or a random design over models, parameters, initial states, solvers and steps.

    What is there already in `out` is not done again: a sweep that was stopped or killed goes on, and one
    whose plan was changed computes what is new.

    Args:
        source: a ``.toml`` file that describes the sweep (see docs/fleets.md), the same as a mapping, or a
            model, or a list of models; `vary`, `design` and `options` then say the rest.
        out: folder of the results; by default the sweep's name with ``.sweep``, in the working directory.
        vary: axes by name: "model", "solver", "step", "duration", "parameter.m", "q.hip", "u.hip"; values,
            an array, or {"from": …, "to": …, "count": …, "scale": "log"}.
        design: {"kind": "grid"}, "list", "latin-hypercube" or "sobol"; random ones with "points" and "seed".
        workers: processes; by default one a core.
        executor: who does the work instead: any that follows `concurrent.futures`.
        scheduler: address of a Dask scheduler whose workers do the work instead.
        time_limit: seconds that a piece may take until its process is ended (600).
        retries: more attempts for a run whose process died or took too long (2).
        chunk: runs in a piece.
        retry_failed: try again what was set aside before.
        progress: called with the fraction done.
        **options: verb ("simulate", "study"), name, state, solver, step, duration, tolerance, parameter, q,
            u, as in the TOML file.

    Returns:
        The fleet: counts of verdicts, the worst cases, `frame` with a row for every run.

    Raises:
        InputError: the plan cannot be run, the folder is another sweep's or in use, the disk refuses,
            the cluster is gone; what was done before is kept.
    """
    if vary is not None:
        options["vary"] = vary
    if design is not None:
        options["design"] = design
    plan = plan_sweep(source, **options)
    given = {"workers": workers, "time_limit": time_limit, "retries": retries, "chunk": chunk}
    asked = {name: value for name, value in given.items() if value is not None}
    execution = Execution.model_validate({**plan.spec.execution.model_dump(), **asked})
    if executor is not None and scheduler is not None:
        raise InputError("give executor= or scheduler=, not both")
    return run_plan(
        plan,
        folder_of(plan, out),
        replace_scheduler(execution, scheduler),
        executor=executor,
        retry_failed=retry_failed,
        progress=progress,
        reproducer=f"deltac sweep {source}" if isinstance(source, str | Path) else "dc.sweep(…)",
    )


def replace_scheduler(execution: Execution, scheduler: str | None) -> Execution:
    """The same on another cluster."""
    if scheduler is None:
        return execution
    return execution.model_copy(update={"scheduler": scheduler})


def folder_of(plan: Plan, out: str | Path | None) -> Path:
    """Where the results of a plan go."""
    name = plan.spec.name.replace("/", "-").replace(":", "-")
    return Path(f"{name}.sweep") if out is None else Path(out)


def run_plan(
    plan: Plan,
    folder: Path,
    execution: Execution,
    *,
    executor: Executor | None = None,
    retry_failed: bool = False,
    progress: Callable[[float], None] | None = None,
    reproducer: str = "",
) -> Fleet:
    """Do what of a plan is not there, and make the table."""
    told = plan.spec.model_dump(mode="json", by_alias=True, exclude={"execution"})
    store = Store.make(folder, "sweep", plan.spec.name, told)
    with store.locked():
        done = store.done()
        if retry_failed:
            failed = store.aside()
            store.take_back(failed)
            store.forget(failed)
            done -= failed.keys()
        store.plan(plan.addresses)
        missing = [k for k, address in enumerate(plan.addresses) if address not in done]
        total = len(plan.addresses)
        count = total - len(missing)
        if progress is not None:
            progress(count / total)

        def advance(rows: int) -> None:
            nonlocal count
            count += rows
            if progress is not None:
                progress(count / total)

        def keep(work: Any, content: bytes) -> None:
            store.keep(content, work.addresses)

        def set_aside(work: Any, failure: Failure) -> None:
            (address,) = work.addresses
            values = dict(zip(work.task.axes, work.values[0].tolist()))
            about = {
                "model": work.task.label,
                "solver": work.task.solver,
                "step": work.task.step,
                **values,
            }
            command = f"{reproducer} --only {address}"
            store.set_aside(address, {"run": about, "reproduce": command}, failure)
            store.keep(
                failed_row(work, failure.code, failure.message, failure.details), work.addresses
            )

        if missing:
            with crew_of(execution, executor, folder) as crew:
                execute(
                    crew,
                    pieces(plan, missing, crew.size, execution.chunk),
                    keep,
                    set_aside,
                    time_limit=execution.time_limit,
                    retries=execution.retries,
                    done=advance,
                )
        frame = store.table()
        store.write_frame(RESULTS, frame)
        return summarise(store, frame, total)


@contextlib.contextmanager
def crew_of(execution: Execution, executor: Executor | None, folder: Path) -> Iterator[Crew]:
    """Who does the work; InputError when the cluster is lost meanwhile."""
    if executor is not None:
        size = execution.workers or getattr(executor, "_max_workers", None) or 1
        yield Crew(executor, size)
    elif execution.scheduler is None:
        with local_crew(execution.workers) as crew:
            yield crew
    else:
        try:
            with dask_crew(execution.scheduler) as crew:
                yield crew
        except SchedulerLost as lost:
            raise InputError(
                f"{lost}. What was done is in {folder}; run it again, with a scheduler or without, and it "
                "goes on there"
            ) from None


def pieces(plan: Plan, missing: Sequence[int], workers: int, chunk: int | None) -> Iterator[Work]:
    """What is missing, in pieces of one setting; every row once, though points may be alike."""
    seen: set[str] = set()
    groups: dict[int, list[int]] = {}
    for k in missing:
        address = plan.addresses[k]
        if address not in seen:
            seen.add(address)
            groups.setdefault(int(plan.design.setting[k]), []).append(k)
    for rows in groups.values():
        most = STUDIES if plan.spec.verb == "study" else LARGEST
        share = math.ceil(len(rows) / (SHARES * workers))
        # Whole vectors of any machine, and not so few that calls cost more than they do.
        size = chunk or max(1, min(most, max(64, -(-share // 64) * 64)))
        for first in range(0, len(rows), size):
            yield plan.piece(rows[first : first + size])


def run_only(plan: Plan, address: str) -> polars.DataFrame:
    """The row of one address, made in this process, where a debugger and a traceback reach it.

    Raises InputError if the plan has no such row, and whatever the run raises.
    """
    import io

    import polars

    found = [k for k, other in enumerate(plan.addresses) if other.startswith(address)]
    if not address or not found:
        raise InputError(f"--only {address}: the sweep has no run of this address; see the table")
    return polars.read_parquet(io.BytesIO(plan.piece(found[:1])()))
