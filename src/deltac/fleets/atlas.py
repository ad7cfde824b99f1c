"""`atlas`: the models that installed packages ship, in every simulator, by every integrator, judged.

A row is a run of a model by an integrator at one step, recorded, audited, and its ΔC attributed.
"""

from __future__ import annotations

import fnmatch
import hashlib
import random
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from deltac.calls.arguments import checked
from deltac.calls.interrupts import interruptible
from deltac.calls.progress import Progress
from deltac.diagnosis.verdict import RUN_TOLERANCE
from deltac.errors import FileError, InputError, SpecificationError, UnknownName, closest
from deltac.fleets.fleet import Plan
from deltac.fleets.result import Fleet
from deltac.fleets.rows import NUMBER, TEXT, Piece, failed_outcome
from deltac.fleets.spec import Execution
from deltac.fleets.store import ADDRESS, digest, versions
from deltac.foreign.files import read_text
from deltac.foreign.isolation import Failure
from deltac.foreign.limits import parse_toml
from deltac.recorders.experiments import MOTIONS, SIMULATORS, Experiment

OUTCOME: dict[str, str] = {
    "verdict": TEXT,
    "confidence": TEXT,
    "relative": NUMBER,
    "energy_error": NUMBER,
    "energy": NUMBER,
    "exchanged": NUMBER,
    "error_bar": NUMBER,
    **{
        f"{share}{kind}": NUMBER
        for share in ("integrator", "equations", "log")
        for kind in ("", "_error", "_largest")
    },
    "speeds": NUMBER,
    "samples": NUMBER,
    "exit_code": NUMBER,
    "integrator_name": TEXT,
    "causes": TEXT,
    "findings": TEXT,
    "run_seconds": NUMBER,
    "seconds": NUMBER,
    "code": TEXT,
    "message": TEXT,
    "details": TEXT,
}
"""What the table says of every run; energies in J, see docs/atlas.md."""

Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]


class AtlasSpec(BaseModel):
    """An atlas as its TOML file describes it.

    models      patterns of files, by the installed distribution that ships them; those after "!" are left
                out; "." for folders of one's own, relative to the plan
    simulators  integrators by simulator, see `deltac.recorders.experiments.SIMULATORS`
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
class Setting:
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


@dataclass(frozen=True, eq=False)
class AtlasPiece(Piece):
    """A model by one integrator in one motion, at several `steps`, s."""

    needs = ("polars", "deltac.diagnosis.audit.audit", "deltac.recorders.experiments")
    kinds = OUTCOME
    per_row = "steps"

    setting: Setting
    steps: tuple[float | None, ...]

    def outcome(self) -> dict[str, list[Any]]:
        """Step by step; a run that cannot be made is a row that says why."""
        rows = [self._row(step) for step in self.steps]
        return {name: [row.get(name) for row in rows] for name in OUTCOME}

    def _row(self, step: float | None) -> dict[str, Any]:
        own = self.setting
        if own.failure is not None or step is None:
            return _failed(own.failure or Failure("E-MODEL", "not run"))
        try:
            return judged(own, step)
        except InputError as error:
            return _failed(Failure(error.code, str(error)))
        except (RuntimeError, ValueError, ArithmeticError, LookupError, TypeError) as error:
            # What simulators written in C++ say of a model that they do not take.
            return _failed(Failure("E-RECORDING", f"{type(error).__name__}: {error}"[:500]))

    def about(self) -> dict[str, Any]:
        """The first row."""
        own = self.setting
        return {
            "model": own.label,
            "solver": solver_label(own),
            "motion": own.motion,
            "step": self.steps[0],
        }

    def point(self) -> dict[str, tuple[str, Any]]:
        """Model, solver, motion, step."""
        own = self.setting
        texts = {"model": own.label, "solver": solver_label(own), "motion": own.motion}
        return {
            **{name: (TEXT, [value] * self.rows) for name, value in texts.items()},
            "step": (NUMBER, list(self.steps)),
            "duration": (NUMBER, [own.duration] * self.rows),
        }


def solver_label(setting: Setting) -> str | None:
    """As "mujoco:rk4"."""
    return None if setting.simulator is None else f"{setting.simulator}:{setting.solver}"


def _failed(failure: Failure) -> dict[str, Any]:
    return {name: value for name, (value,) in failed_outcome(failure).items()}


def judged(setting: Setting, step: float) -> dict[str, Any]:
    """The row of one run, made and audited now."""
    from deltac.diagnosis.audit.audit import audit

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
        "verdict": report.verdict.kind,
        "confidence": report.verdict.confidence,
        "relative": report.relative,
        "energy_error": float(np.abs(report.energy_error).max()),
        "energy": report.reference_energy,
        "exchanged": report.energy_exchanged,
        "error_bar": float(report.ledger.error_bar[report.function].max()),
        **shares,
        "speeds": float(len(experiment.model.mechanism.speeds.names)),
        "samples": float(report.samples),
        "exit_code": float(report.exit_code),
        "integrator_name": None
        if report.integrator is None
        else " or ".join(report.integrator.names) or None,
        "causes": "; ".join(map(str, report.causes)) or None,
        "findings": " ".join(f.code for f in report.findings) or None,
        "run_seconds": ran - began,
        "seconds": time.process_time() - ran,
        "message": run.provenance.message or report.summary(),
        "details": report.explain() if report.exit_code else None,
    }


# --- the plan -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class AtlasPlan(Plan):
    """The settings of an atlas, and of each row its setting and step."""

    kind = "atlas"

    spec: AtlasSpec
    source: str
    rows: tuple[tuple[Setting, float | None], ...]
    skipped: tuple[str, ...]

    def folder(self) -> Path:
        """The atlas' name with ``.atlas``."""
        return Path(f"{self.name}.atlas")

    def head(self) -> dict[str, Any]:
        """The plan, and the simulators that are not installed."""
        return {
            "plan": self.spec.model_dump(mode="json", exclude={"execution"}),
            "skipped": self.skipped,
        }

    def pieces(self, missing: Sequence[int], workers: int, chunk: int | None) -> Iterator[Piece]:
        """The steps of a setting together: the model is read and compiled once."""
        places: dict[Setting, list[int]] = {}
        for k in missing:
            places.setdefault(self.rows[k][0], []).append(k)
        for setting, rows in places.items():
            addresses = tuple(self.addresses[k] for k in rows)
            yield AtlasPiece(addresses, setting, tuple(self.rows[k][1] for k in rows))

    def command(self, piece: Piece) -> str:
        """The command with the address of the run."""
        return f"{self.source} --only {piece.addresses[0]}"

    def piece_at(self, address: str) -> AtlasPiece:
        """The piece of one run, by its address or the beginning of it; InputError if there is none."""
        place = self.place(address)
        setting, step = self.rows[place]
        return AtlasPiece((self.addresses[place],), setting, (step,))

    def write_case(self, address: str, path: Path) -> None:
        """The audit of one run, with the mechanism moving."""
        from deltac.diagnosis.audit.audit import audit

        piece = self.piece_at(address)
        own, (step,) = piece.setting, piece.steps
        if own.failure is not None or step is None:
            raise InputError(f"{own.label}: {own.failure.message if own.failure else 'not run'}")
        assert own.simulator and own.solver and own.motion and own.duration
        experiment = _experiment(own.path, own.motion, own.duration)
        run = SIMULATORS[own.simulator].run(experiment, step, own.solver)
        audit(experiment.model, run, tolerance=own.tolerance).report(path)


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
    rounds: list[list[tuple[Setting, float | None]]] = []
    for label, file in files.items():
        common = Setting(
            label, str(file), tolerance=spec.tolerance, audit_seconds=spec.audit_seconds
        )
        settings = list(_settings(spec, common, simulators))
        # In rounds over all models, so that an atlas that is not complete is a sample of all.
        random.Random(label).shuffle(settings)
        for k, (setting, steps) in enumerate(settings):
            while len(rounds) <= k:
                rounds.append([])
            rounds[k] += [(setting, step) for step in steps]
    rows = [row for one in rounds for row in one]
    versions_of = {**versions(), **_versions(simulators)}
    contents = {
        s: hashlib.blake2b(Path(s).read_bytes()).hexdigest() for s in map(str, files.values())
    }
    addresses = []
    for setting, step in rows:
        about = {
            **asdict(setting),
            "path": contents[setting.path],
            "step": step,
            "versions": versions_of,
        }
        addresses.append(hashlib.blake2b(digest(about), digest_size=ADDRESS).hexdigest())
    return AtlasPlan(
        spec.name, tuple(addresses), spec, f"deltac atlas {path}", tuple(rows), tuple(skipped)
    )


def _settings(
    spec: AtlasSpec, common: Setting, simulators: dict[str, list[str]]
) -> Iterator[tuple[Setting, list[float | None]]]:
    """The settings of one model, with their steps; one that says why for a model that is not run."""
    try:
        experiment = Experiment.of(Path(common.path), spec.motions[0], spec.duration)
        count = len(experiment.model.mechanism.speeds.names)
        if count > spec.speeds:
            raise InputError(f"{count} speeds, more than the {spec.speeds} of this atlas")
        step = experiment.own_step or spec.step
        duration = max(spec.duration, spec.rows * step)
    except InputError as error:
        yield replace(common, failure=Failure(error.code, str(error))), [None]
        return
    for motion in spec.motions:
        for name, solvers in simulators.items():
            if SIMULATORS[name].mjcf or experiment.is_urdf:
                for solver in solvers:
                    own = replace(
                        common, simulator=name, solver=solver, motion=motion, duration=duration
                    )
                    yield own, [step * factor for factor in spec.steps]


def _versions(simulators: dict[str, list[str]]) -> dict[str, str]:
    """Versions of the simulators' distributions."""
    names = {"drake": "drake", "pinocchio": "pin"}
    found = {}
    for name in simulators:
        try:
            found[name] = distribution(names.get(name, name)).version
        except PackageNotFoundError:
            continue
    return found


@checked
@interruptible()
def atlas(
    plan: str | Path,
    out: str | Path | None = None,
    *,
    workers: int | None = None,
    executor: Executor | None = None,
    scheduler: str | None = None,
    time_limit: float | None = None,
    retries: int | None = None,
    retry_failed: bool = False,
    progress: Progress | None = None,
) -> Fleet:
    """Run the models of installed packages in every simulator, and judge every run.

    Results that are already in `out` are not computed again: an atlas that was stopped or killed continues.

    Args:
        plan: a ``.toml`` file that names models, simulators, motions and steps (see docs/atlas.md).
        out: folder of the results; by default the plan's name with ``.atlas``.
        workers: number of processes; by default one per core.
        executor: does the work instead; any executor of the `concurrent.futures` interface.
        scheduler: address of a Dask scheduler whose workers do the work instead.
        time_limit: seconds that the runs and audits of one setting may take before their process is ended.
        retries: more attempts for a run whose process died or took too long.
        retry_failed: try again what was set aside before.
        progress: called with the fraction done.

    Returns:
        The fleet: counts of verdicts, the worst cases, `frame` with a row for every run.

    Raises:
        InputError: the plan cannot be read, or the folder belongs to another fleet or is in use.
    """
    made = plan_atlas(Path(plan))
    execution = made.spec.execution.overridden(
        workers=workers, scheduler=scheduler, time_limit=time_limit, retries=retries
    )
    return made.run(out, execution, executor=executor, retry_failed=retry_failed, progress=progress)
