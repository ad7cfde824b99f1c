"""The models that installed packages ship, in every simulator, by every integrator, judged.

A row is a run of a model by an integrator at one step, recorded, audited, and its ΔC attributed.
"""

from __future__ import annotations

import fnmatch
import hashlib
import json
import math
import random
import time
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import cache, lru_cache
from importlib.metadata import PackageNotFoundError, distribution
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

import deltac
from atlas.experiments import MOTIONS, SIMULATORS, Experiment
from deltac.calls.progress import Progress
from deltac.diagnosis import RUN_TOLERANCE
from deltac.errors import FileError, InputError, SpecificationError, UnknownName, closest
from deltac.fleets.execution import local_crew
from deltac.fleets.fleet import Plan
from deltac.fleets.result import Fleet
from deltac.fleets.rows import AUDITED, LONG_PIECE, NUMBER, TEXT, Piece, audited_row, failed_row
from deltac.fleets.spec import Execution
from deltac.fleets.store import ADDRESS, digest, versions
from deltac.foreign.files import appearing, read_text
from deltac.foreign.isolation import Failure
from deltac.foreign.limits import parse_json, parse_toml
from deltac.kernels import cache_folder, cache_wanted

OUTCOME: Mapping[str, str] = {
    **AUDITED,
    "exchanged": NUMBER,
    **{
        f"{share}{kind}": NUMBER
        for share in ("integrator", "equations", "log")
        for kind in ("", "_error", "_largest")
    },
    "speeds": NUMBER,
    "lasted": NUMBER,
    "integrator_name": TEXT,
    "causes": TEXT,
    "run_seconds": NUMBER,
    "build": TEXT,
}
"""What the table says of every run; energies in J, see docs/atlas.md."""


Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]


class AtlasSpec(BaseModel):
    """An atlas as its TOML file describes it.

    models      patterns of files, by the installed distribution that ships them; those after "!" are left
                out; "." for folders of one's own, relative to the plan
    simulators  integrators by simulator, see `atlas.experiments.SIMULATORS`
    motions     of `MOTIONS`
    duration    of each motion, s; longer for models whose own step makes it less than `rows` steps
    step        of models that name none (URDF), s
    steps       of each run, as multiples of the model's own step
    speeds      the most that a model may have: larger ones are a row that says so
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str = "atlas"
    models: dict[str, list[str]]
    simulators: dict[str, list[str]]
    motions: list[str] = list(MOTIONS)
    duration: Positive = 0.3
    rows: int = 50
    step: Positive = 0.002
    steps: list[Positive] = [2.0, 1.0, 0.5]
    speeds: int = 64
    tolerance: Positive = RUN_TOLERANCE
    audit_seconds: Positive = 60.0
    execution: Execution = Execution()


@dataclass(frozen=True)
class AtlasSetting:
    """A model's file with its label, an integrator of a simulator, a motion; None where it is not run."""

    label: str
    path: str
    simulator: str | None = None
    solver: str | None = None
    motion: str | None = None
    duration: float | None = None
    tolerance: float = RUN_TOLERANCE
    audit_seconds: float = 60.0
    failure: Failure | None = None


@lru_cache(maxsize=4)
def _experiment(path: str, motion: str, duration: float) -> Experiment:
    return Experiment.of(Path(path), motion, duration)


@dataclass(frozen=True)
class AtlasRun:
    """A setting at one step: `factor` times the model's own, s; None where it is not run."""

    setting: AtlasSetting
    factor: float | None = None
    step: float | None = None


@dataclass(frozen=True, eq=False)
class AtlasPiece(Piece):
    """Runs of one model, which is read once, as its equations are compiled once."""

    needs = ("deltac.diagnosis.audit.audit", "atlas.experiments", "llvmlite.binding")
    kinds = OUTCOME
    per_row = "runs"

    runs: tuple[AtlasRun, ...]

    def outcome(self) -> dict[str, list[Any]]:
        """Run by run; one that cannot be made is a row that says why."""
        rows = [{**_row(run), "build": build()} for run in self.runs]
        return {name: [row.get(name) for row in rows] for name in OUTCOME}

    def about(self) -> dict[str, Any]:
        """The first row."""
        own = self.runs[0].setting
        return {
            "model": own.label,
            "solver": solver_label(own),
            "motion": own.motion,
            "step": self.runs[0].step,
        }

    def point(self) -> dict[str, tuple[str, Any]]:
        """Model, solver, motion, step."""
        own = [run.setting for run in self.runs]
        return {
            "model": (TEXT, [setting.label for setting in own]),
            "solver": (TEXT, [solver_label(setting) for setting in own]),
            "motion": (TEXT, [setting.motion for setting in own]),
            "step": (NUMBER, [run.step for run in self.runs]),
            "factor": (NUMBER, [run.factor for run in self.runs]),
            "duration": (NUMBER, [setting.duration for setting in own]),
        }


def _row(run: AtlasRun) -> dict[str, Any]:
    own = run.setting
    if own.failure is not None or run.step is None:
        return failed_row(own.failure or Failure("E-MODEL", "not run"))
    try:
        return judged(own, run.step)
    except InputError as error:
        return failed_row(Failure(error.code, str(error)))
    except (RuntimeError, ValueError, ArithmeticError, LookupError, TypeError) as error:
        # What simulators written in C++ say of a model that they do not take.
        return failed_row(Failure("E-RECORDING", f"{type(error).__name__}: {error}"[:500]))
    except SystemExit:
        return failed_row(
            Failure("E-RECORDING", "the simulator ends the process; its output says why")
        )


def solver_label(setting: AtlasSetting) -> str | None:
    """As "mujoco:rk4"."""
    return None if setting.simulator is None else f"{setting.simulator}:{setting.solver}"


def judged(setting: AtlasSetting, step: float) -> dict[str, Any]:
    """The row of one run, made and audited now."""
    from deltac import audit

    assert setting.simulator and setting.solver and setting.motion and setting.duration
    experiment = _experiment(setting.path, setting.motion, setting.duration)
    began = time.process_time()
    run = SIMULATORS[setting.simulator].run(experiment, step, setting.solver)
    ran = time.process_time()
    report = audit(
        experiment.model, run, tolerance=setting.tolerance, time_limit=setting.audit_seconds
    )
    shares: dict[str, Any] = {}
    if report.attribution is not None:
        for name in ("integrator", "equations", "log"):
            share = getattr(report.attribution, name)
            shares |= {name: share.energy, f"{name}_error": share.error}
            shares[f"{name}_largest"] = share.largest[0]
    return {
        **audited_row(report, time.process_time() - ran),
        "exchanged": report.energy_exchanged,
        **shares,
        "speeds": float(len(experiment.model.mechanism.speeds.names)),
        "lasted": float(run.t[-1] - run.t[0]) + step,
        "integrator_name": None
        if report.integrator is None
        else " or ".join(report.integrator.names) or None,
        "causes": "; ".join(map(str, report.causes)) or None,
        "run_seconds": ran - began,
        "message": run.provenance.message or report.summary(),
    }


# --- the plan -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class AtlasPlan(Plan):
    """The settings of an atlas, and of each row its setting and step."""

    kind = "atlas"

    spec: AtlasSpec
    rows: tuple[AtlasRun, ...]
    skipped: tuple[str, ...]

    def head(self) -> dict[str, Any]:
        """The plan, and the simulators that are not installed."""
        return {
            "plan": self.spec.model_dump(mode="json", exclude={"execution"}),
            "skipped": self.skipped,
        }

    def pieces(self, rows: Sequence[int], workers: int, chunk: int | None) -> Iterator[Piece]:
        """Runs of a model in a simulator that follow each other, at most `chunk`.

        One that hangs or crashes costs few others; the next piece finds the model's equations compiled.
        """

        def group(k: int) -> tuple[str, str | None]:
            return self.rows[k].setting.label, self.rows[k].setting.simulator

        for _, own in groupby(rows, group):
            for some in _batched(list(own), chunk or LONG_PIECE):
                yield AtlasPiece(
                    tuple(self.addresses[k] for k in some), tuple(self.rows[k] for k in some)
                )

    def piece_at(self, address: str) -> AtlasPiece:
        """The piece of one run, by its address or the beginning of it; InputError if there is none."""
        place = self.place(address)
        return AtlasPiece((self.addresses[place],), (self.rows[place],))

    def write_case(self, address: str, path: Path) -> None:
        """The audit of one run, with the mechanism moving."""
        from deltac import audit

        (run,) = self.piece_at(address).runs
        own, step = run.setting, run.step
        if own.failure is not None or step is None:
            raise InputError(f"{own.label}: {own.failure.message if own.failure else 'not run'}")
        assert own.simulator and own.solver and own.motion and own.duration
        experiment = _experiment(own.path, own.motion, own.duration)
        motion = SIMULATORS[own.simulator].run(experiment, step, own.solver)
        audit(experiment.model, motion, tolerance=own.tolerance).report(path)


def _batched(places: list[int], most: int) -> Iterator[list[int]]:
    for start in range(0, len(places), most):
        yield places[start : start + most]


def read_atlas(path: Path) -> AtlasSpec:
    """The plan of a TOML file; InputError names the key, the distribution or the simulator."""
    try:
        document = parse_toml(read_text(path))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    try:
        spec = AtlasSpec.model_validate(document)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(map(str, first["loc"]))
        raise SpecificationError(f"{path}: {place}: {first['msg']}") from None
    for motion in spec.motions:
        if motion not in MOTIONS:
            raise UnknownName(f"{path}: motions: {motion!r}{closest(motion, MOTIONS)}")
    for name, solvers in spec.simulators.items():
        if name not in SIMULATORS:
            raise UnknownName(f"{path}: simulators: {name!r}{closest(name, list(SIMULATORS))}")
        for solver in solvers:
            orders = SIMULATORS[name].orders
            if solver not in orders:
                raise UnknownName(
                    f"{path}: simulators.{name}: {solver!r}{closest(solver, list(orders))}"
                )
    return spec


def model_files(models: dict[str, list[str]], folder: Path) -> tuple[dict[str, Path], list[str]]:
    """Label -> file of all models, and the distributions that are not installed."""
    files: dict[str, Path] = {}
    missing: list[str] = []
    for package, patterns in models.items():
        if package == ".":
            for pattern in patterns:
                files |= {str(p.relative_to(folder)): p for p in sorted(folder.glob(pattern))}
            continue
        try:
            shipped = distribution(package).files or []
        except PackageNotFoundError:
            missing.append(package)
            continue
        taken, left_out = (
            [p.lstrip("!") for p in patterns if p.startswith("!") is out] for out in (False, True)
        )
        for file in sorted(shipped):
            name = file.as_posix()
            if _matches(name, taken) and not _matches(name, left_out):
                files[name.removeprefix("cmeel.prefix/share/")] = Path(str(file.locate()))
    return files, missing


def _matches(name: str, patterns: Sequence[str]) -> bool:
    return any(fnmatch.fnmatch(name, pattern) for pattern in patterns)


def plan_atlas(path: Path) -> AtlasPlan:
    """Find the models and the simulators of a plan; nothing is run.

    Models are read in worker processes, so one that brings MuJoCo down is a row. What was found of models
    of installed packages is kept in the user's cache.

    Raises InputError where the plan cannot be read, or no model or simulator of it is installed.
    """
    spec = read_atlas(path)
    files, missing = model_files(spec.models, path.parent)
    skipped = [f"package {name}" for name in missing]
    skipped += [f"simulator {n}" for n in spec.simulators if not SIMULATORS[n].installed]
    simulators = {n: s for n, s in spec.simulators.items() if SIMULATORS[n].installed}
    if not files or not simulators:
        lacking = f"; not installed: {', '.join(skipped)}" if skipped else ""
        raise FileError(
            f"{path}: no {'model' if not files else 'simulator'} of it is there{lacking}"
        )
    sizes = model_sizes(files, spec.execution)
    rounds: dict[int, list[AtlasRun]] = {}
    for label in random.Random(0).sample(sorted(files), len(files)):
        common = AtlasSetting(
            label,
            str(files[label]),
            tolerance=spec.tolerance,
            audit_seconds=spec.audit_seconds,
        )
        for k, run in _runs(spec, common, sizes[label], simulators):
            rounds.setdefault(k, []).append(run)
    rows = [run for k in sorted(rounds) for run in rounds[k]]
    versions_of = {**versions(), **_versions(simulators)}
    contents = {label: _content(file) for label, file in files.items()}
    addresses = []
    for run in rows:
        about = {
            **asdict(run.setting),
            "path": contents[run.setting.label],
            "step": run.step,
            "versions": versions_of,
        }
        addresses.append(hashlib.blake2b(digest(about), digest_size=ADDRESS).hexdigest())
    return AtlasPlan(
        spec.name,
        tuple(addresses),
        f"python benchmarks/atlas/run.py {path}",
        spec,
        tuple(rows),
        tuple(skipped),
    )


def _runs(
    spec: AtlasSpec, common: AtlasSetting, size: Size | Failure, simulators: dict[str, list[str]]
) -> Iterator[tuple[int, AtlasRun]]:
    """The runs of one model, each with its round; one that says why for a model that is not run.

    An atlas that is not complete is a fair sample: the first round has every model in every simulator, by
    one of its integrators and in one motion, by turns, at the own step; the second the other steps of these;
    then the other integrators, then the other motions.
    """
    if isinstance(size, Size) and size.speeds > spec.speeds:
        size = Failure(
            "E-MODEL", f"{size.speeds} speeds, more than the {spec.speeds} of this atlas"
        )
    if isinstance(size, Failure):
        yield 0, AtlasRun(replace(common, failure=size))
        return
    step = size.step or spec.step
    duration = max(spec.duration, spec.rows * step)
    urdf = Path(common.path).suffix.lower() == ".urdf"
    turn = zlib.crc32(common.label.encode())
    integrators = [
        (name, solver, (k + turn) % len(solvers) > 0)
        for name, solvers in simulators.items()
        if SIMULATORS[name].mjcf or urdf
        for k, solver in enumerate(solvers)
    ]
    first = turn % len(spec.motions)
    middle = min(spec.steps, key=lambda factor: abs(math.log(factor)))
    for k, motion in enumerate(spec.motions[first:] + spec.motions[:first]):
        for name, solver, later in integrators:
            own = replace(common, simulator=name, solver=solver, motion=motion, duration=duration)
            for factor in spec.steps:
                yield 4 * k + 2 * later + (factor != middle), AtlasRun(own, factor, step * factor)


# --- models -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Size:
    """How many speeds a model has, and the step that it names, s."""

    speeds: int
    step: float | None


@dataclass(frozen=True)
class ModelReading:
    """The call that finds the size of a model, in a worker process."""

    needs: ClassVar[tuple[str, ...]] = ("atlas.experiments",)

    path: str

    def __call__(self) -> Size:
        """Read it; InputError where that cannot be."""
        experiment = Experiment.of(Path(self.path), MOTIONS[0], 1.0)
        return Size(len(experiment.model.mechanism.speeds.names), experiment.own_step)


def model_sizes(
    files: dict[str, Path], execution: Execution, time_limit: float = 120.0
) -> dict[str, Size | Failure]:
    """The sizes of all models, or why one cannot be read within so many seconds.

    They are kept by content and what reads it.
    """
    place = cache_folder() if cache_wanted() else None
    store = None if place is None else place / "models.json"
    kept: dict[str, Any] = {}
    if store is not None:
        with suppress(OSError, InputError):
            kept = parse_json(store.read_bytes(), "the cache of models")
    reader = "".join([build("importers"), build("recorders"), *_versions(["mujoco"]).values()])
    keys = {label: f"{reader} {file} {_content(file)}" for label, file in files.items()}
    sizes: dict[str, Size | Failure] = {}
    for label, key in keys.items():
        if isinstance(entry := kept.get(key), dict):
            sizes[label] = Failure(**entry) if "code" in entry else Size(**entry)
    if missing := [label for label in files if label not in sizes]:
        with local_crew(execution.workers) as crew:
            answers = {
                label: crew.executor.submit(crew.call, ModelReading(str(files[label])), time_limit)
                for label in missing
            }
            sizes |= {label: answer.result() for label, answer in answers.items()}
        if store is not None:
            transient = {k for k, s in sizes.items() if isinstance(s, Failure) and s.transient}
            kept = {k: entry for k, entry in kept.items() if k.startswith(reader)}
            kept |= {keys[k]: asdict(s) for k, s in sizes.items() if k not in transient}
            with suppress(OSError):
                store.parent.mkdir(parents=True, exist_ok=True)
                with appearing(store) as file:
                    file.write(json.dumps(kept).encode())
    return sizes


def _content(file: Path) -> str:
    """A digest of a model's file."""
    return hashlib.blake2b(file.read_bytes(), digest_size=16).hexdigest()


@cache
def build(*packages: str) -> str:
    """The version of deltac with a digest of its sources, or of those of some of its packages."""
    root = Path(deltac.__file__).parent
    sources = [path for name in packages or (".",) for path in (root / name).rglob("*.py")]
    state = hashlib.blake2b(digest_size=4)
    for path in sorted(sources):
        state.update(path.read_bytes())
    return f"{deltac.__version__}+{state.hexdigest()}"


def _versions(simulators: Iterable[str]) -> dict[str, str]:
    """Versions of the simulators' distributions."""
    names = {"drake": "drake", "pinocchio": "pin"}
    found = {}
    for name in simulators:
        try:
            found[name] = distribution(names.get(name, name)).version
        except PackageNotFoundError:
            continue
    return found


def atlas(
    plan: Path,
    out: Path | None = None,
    *,
    retry_failed: bool = False,
    progress: Progress | None = None,
    **execution: Any,
) -> Fleet:
    """Do what a plan lacks, in the folder `out`; InputError where the plan cannot be read.

    `execution` overrides that of the plan: `workers`, `scheduler`, `time_limit`, `retries`.
    """
    made = plan_atlas(plan)
    return made.run(
        out,
        made.spec.execution.overridden(**execution),
        retry_failed=retry_failed,
        progress=progress,
    )
