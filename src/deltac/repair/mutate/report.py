"""`mutate_equations`: how well do the tests protect these equations?"""

from __future__ import annotations

import ast
import contextlib
import os
import random
import shlex
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from deltac.calls.arguments import checked
from deltac.calls.interrupts import interruptible
from deltac.calls.progress import Progress, counted, no_progress
from deltac.errors import FileError, InputError, LimitError, SourceError, UnknownName
from deltac.mechanism import CoordinateMap
from deltac.models import ModelLike, load_model
from deltac.repair.edits.running import RUN_TIME
from deltac.repair.mutate.operators import MUTANT_KINDS, Mutant, Span, mutants, span
from deltac.repair.tracing.program import ProgramReading, at, named_parameters, read
from deltac.repair.tracing.samples import RIGHT, Target
from deltac.repair.tracing.source import Source, source_of
from deltac.results import SHOWN, Report, Section, Serialisable, Table
from deltac.simulation import Equations, RightHandSide

SUITE = "your tests"

RESIDUAL, MOMENTUM_TEST, CONSTRAINTS = "coordinate residual", "momentum", "constraints"

REASONS = {
    "equivalent": "the same equations, written otherwise",
    "coincidence": "the same at the parameters' own values, not at others",
    "workless": "wrong by forces that do no work: no balance of energy sees them",
}
"""Why a mutant is not seen."""


@dataclass(frozen=True)
class MutantTrial(Serialisable, also=("missed",)):
    """A mutant and the size of what each test sees of it: relative, 0 being right.

    `reason` says why some test, or every test, does not see it (see `REASONS`); empty if all do.
    """

    mutant: Mutant
    seen: Mapping[str, float]
    reason: str = ""

    def detected(self, test: str) -> bool:
        """Whether a test sees it."""
        return not self.seen[test] < RIGHT

    @property
    def missed(self) -> tuple[str, ...]:
        """The tests that do not see it."""
        return tuple(test for test in self.seen if not self.detected(test))


@dataclass(frozen=True, repr=False)
class MutationReport(Report, also=("counts",)):
    """Which mutants of a function the tests detect.

    file, function  what was mutated
    tests           names of the tests
    trials          one for each mutant
    residual        of the function as it is; mutants of wrong equations tell little
    varied          parameters that were varied to tell equivalent mutants from coincidences
    """

    file: str
    function: str
    tests: tuple[str, ...]
    trials: tuple[MutantTrial, ...]
    residual: float
    varied: tuple[str, ...]

    @property
    def escaped(self) -> tuple[MutantTrial, ...]:
        """The mistakes that the user's own tests do not see; empty where these were not run."""
        return tuple(t for t in self.trials if SUITE in t.seen and not t.detected(SUITE))

    @property
    def exit_code(self) -> int:
        """Exit code: 1 if the function is wrong, or a mistake escapes the user's own tests; else 0."""
        return int(bool(self.escaped) or self.residual >= RIGHT)

    def counts(self) -> dict[str, dict[str, int]]:
        """For each kind of mutant: how many, how many are no mistakes, and how many each test sees."""
        rows: dict[str, dict[str, int]] = {}
        for kind in (*MUTANT_KINDS, "all"):
            some = [t for t in self.trials if kind in (t.mutant.kind, "all")]
            if some:
                wrong = [t for t in some if t.reason != "equivalent"]
                rows[kind] = {"mutants": len(some), "equivalent": len(some) - len(wrong)}
                rows[kind] |= {test: sum(t.detected(test) for t in wrong) for test in self.tests}
        return rows

    def summary(self) -> str:
        """How many mutants, and how many no test sees."""
        total = self.counts().get("all", {"mutants": 0, "equivalent": 0})
        return (
            f"{self.file}:{self.function}: {total['mutants']} mutants, of which {total['equivalent']} are no "
            "mistakes (they give the same accelerations everywhere)"
        )

    def sections(self) -> Iterator[Section]:
        """What each test sees of each kind of mutant, and what escapes."""
        counts = self.counts()
        rows: list[tuple[str, ...]] = []
        for kind, row in counts.items():
            rows += [()] if kind == "all" else []
            rows.append((kind, *map(str, row.values())))
        yield Table(
            ("mutants", "made", *(HEADS.get(t, t) for t in ("equivalent", *self.tests))),
            tuple(rows),
        )
        yield f"{self.summary()}."
        if self.residual >= RIGHT:
            wrong = f"residual {self.residual:.2g} of the terms"
            yield f"The function itself is wrong ({wrong}): repair it first."
        total = counts.get("all", {"mutants": 0, "equivalent": 0})
        mistakes = total["mutants"] - total["equivalent"]
        for test in self.tests if mistakes else ():
            share = f"{total[test]} of {mistakes} ({total[test] / mistakes:.1%})"
            yield f"- {test} {'see' if test == SUITE else 'sees'} {share}."
        for reason in ("coincidence", "workless"):
            some = [t for t in self.trials if t.reason == reason]
            if some:
                yield f"{len(some)} {reason}: {REASONS[reason]}; such as {_examples(some)}."
        if self.escaped:
            yield f"Your tests miss {len(self.escaped)}, such as {_examples(self.escaped)}."


HEADS = {
    "equivalent": "equal",
    "kane-levinson-1988": "kane\n1988",
    "kane-levinson-1990": "kane\n1990",
    "liu-huston": "liu",
    "momentum": "mom.",
    "coordinate residual": "F + F*",
    "constraints": "ties",
}
"""Short heads of the table's columns."""


def _examples(trials: Sequence[MutantTrial]) -> str:
    """Some mutants in words, of different kinds first."""
    by_kind = {t.mutant.kind: t.mutant for t in trials}
    some = [*by_kind.values(), *(t.mutant for t in trials)]
    texts = [f"line {m.line}, {m.before} → {m.after or 'nothing'}" for m in some]
    return "; ".join(list(dict.fromkeys(texts))[:SHOWN])


@checked
@interruptible()
def mutate_equations(
    model: ModelLike,
    equations: str | Path | RightHandSide | Equations,
    *,
    coordinates: CoordinateMap | str | None = None,
    names: int = 2,
    seed: int = 0,
    tests: str | None = None,
    most: int = 40,
    progress: Progress | None = None,
) -> MutationReport:
    """Make every small change to equations of motion, and see which tests detect it.

    The tests are the testing functions in rate form, the momentum balances, and the coordinate residual
    F_r + F*_r, at random states of the model. A mutant with no coordinate residual is equivalent. The
    function is traced, as `repair_equations` does.

    Args:
        model: a Mechanism, a Problem or a problem's name, a model file.
        equations: ``"FILE.py:FUNCTION"``, a function of (t, q, u) that returns u̇, or `dc.Equations`.
        coordinates: the function's own coordinates, as for `check_equations`.
        names: number of other names to try in place of each use of a name.
        seed: random seed, of the states and of the names drawn.
        tests: a command that runs your own tests, such as ``"pytest tests/"``; it is run on some of the
            mutants, in a copy of the project.
        most: with `tests`, the number of mutants at most.
        progress: called with the fraction done.

    Raises:
        InputError: no source, or one that is not understood, as for `repair_equations`; tests that fail on
            the function as it is, or do not load it.
    """
    for name, value, least in (("names", names, 0), ("most", most, 1)):
        if value < least:
            raise InputError(f"{name} is {value}; expected {least} or more")
    loaded = load_model(model)
    chosen = loaded.coordinate_map(coordinates, equations)
    target = Target(loaded.mechanism, chosen, seed, loaded.first)
    source = source_of(equations)
    program = read(source, target)
    varied = program.varied
    source = program.source
    mutants = mutants_of(program, names, seed)
    progress = progress or no_progress
    trials = tuple(_tried(source, one, target, varied) for one in counted(mutants, progress))
    names_of_tests = tuple(_blank(target))
    report = MutationReport(
        source.name, source.qualified, names_of_tests, trials, program.wrong, varied
    )
    return report if tests is None else _with_suite(report, source, tests, most, seed, progress)


def mutants_of(program: ProgramReading, names: int, seed: int) -> list[Mutant]:
    """The mutants of what is read: of one function of a module, or of all that it uses."""
    source = program.source
    definition = source.definition
    used = {source.owner(place) for piece in program.pieces for place in piece.trace.instances}
    alone = {node for node in used if not isinstance(node, ast.Module)} == {definition}
    if definition is not None and "." not in source.qualified and alone:
        return mutants(source.text, definition.name, names, seed)
    return mutants(source.text, "", names, seed, read=spans(program))


def spans(reading: ProgramReading) -> set[Span]:
    """Where the expressions stand that the function evaluates."""
    nodes = (p.source.nodes[place] for p in reading.pieces for place in p.trace.instances)
    return {span(node) for node in nodes if isinstance(node, ast.expr)}


def _with_suite(
    report: MutationReport,
    source: Source,
    command: str,
    most: int,
    seed: int,
    progress: Progress,
) -> MutationReport:
    """The report with what the user's own tests see of some of the mistakes."""
    if source.path is None:
        raise FileError(f"{source.name} is no file: there is nothing that tests could load")
    wrong = [
        k for k, t in enumerate(report.trials) if t.reason not in ("equivalent", "coincidence")
    ]
    chosen = sorted(random.Random(seed).sample(wrong, min(most, len(wrong))))
    trials = []
    with copied(command, source.path, source.qualified) as suite:
        for k in counted(chosen, progress):
            trial = report.trials[k]
            value = 0.0 if suite.passes(trial.mutant.text) else np.inf
            trials.append(replace(trial, seen={**trial.seen, SUITE: value}))
    return replace(report, trials=tuple(trials), tests=(*report.tests, SUITE))


def _blank(target: Target) -> dict[str, float]:
    """Each test that applies, with what it sees of something that cannot be evaluated."""
    test = target.test()
    tests = dict.fromkeys(test.powers(test.acceleration), np.inf)
    if test.momenta(test.acceleration):
        tests[MOMENTUM_TEST] = np.inf
    if len(test.gamma):
        tests[CONSTRAINTS] = np.inf
    tests[RESIDUAL] = np.inf
    return tests


def _tried(source: Source, mutant: Mutant, target: Target, varied: tuple[str, ...]) -> MutantTrial:
    """What the tests see of one mutant."""
    changed = source.replaced(mutant.text)
    samples, test = target.samples(), target.test()
    sizes = _blank(target)
    try:
        again = read(changed, target, vary=False)
    except InputError:
        return MutantTrial(mutant, sizes)  # it cannot even be evaluated
    result = again.run()
    udot = result[: len(samples.acceleration)]
    if not np.isfinite(udot).all():
        return MutantTrial(mutant, sizes)
    residuals = test(udot)
    sizes |= {name: float(x.max()) for name, x in residuals.power.items()}
    if MOMENTUM_TEST in sizes:
        sizes[MOMENTUM_TEST] = max(float(x.max()) for x in residuals.momentum.values())
    if CONSTRAINTS in sizes:
        sizes[CONSTRAINTS] = float(residuals.violation.max(initial=0.0))
    sizes[RESIDUAL] = samples.wrong(result)
    return MutantTrial(
        mutant, sizes, _reason(changed, sizes, target, varied, named_parameters(again, target))
    )


def _reason(
    changed: Source,
    sizes: Mapping[str, float],
    target: Target,
    varied: tuple[str, ...],
    named: Mapping[str, str],
) -> str:
    if sizes[RESIDUAL] < RIGHT:
        common = tuple(name for name in varied if name in named.values())
        try:
            same = set(common) == set(varied) and at(changed, target, common).wrong < RIGHT
        except InputError:
            same = False
        return "equivalent" if same else "coincidence"
    powers = [v for k, v in sizes.items() if k not in (RESIDUAL, MOMENTUM_TEST, CONSTRAINTS)]
    return "workless" if max(powers, default=np.inf) < RIGHT else ""


# --- the user's own tests, run on mutants --------------------------------------------------------


LARGEST_PROJECT = 200 * 1024**2
"""Bytes of a project that is copied."""

NOT_COPIED = tuple(
    ".git .hg .venv venv node_modules __pycache__ .mypy_cache .ruff_cache .tox .pytest_cache".split()
)

PROJECT_MARKS = (".git", ".hg", "pyproject.toml", "setup.py", "setup.cfg", "tox.ini", "pytest.ini")
"""What stands in the root of a project."""


@dataclass(frozen=True)
class Suite:
    """A command that runs tests in a copy of a project; `file` is the copy of the file with the equations."""

    command: tuple[str, ...]
    folder: Path
    file: Path
    environment: dict[str, str]
    seconds: float = 300.0

    def passes(self, text: str) -> bool:
        """Whether the tests pass with this text in place of the file's; a run that does not end fails."""
        self.file.write_text(text, encoding="utf-8")
        with subprocess.Popen(
            self.command,
            cwd=self.folder,
            env=self.environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        ) as process:
            try:
                return process.wait(self.seconds) == 0
            except BaseException as error:
                with contextlib.suppress(ProcessLookupError, PermissionError):
                    os.killpg(process.pid, signal.SIGKILL)
                if isinstance(error, subprocess.TimeoutExpired):
                    return False
                raise


@contextlib.contextmanager
def copied(command: str, file: Path, function: str) -> Iterator[Suite]:
    """The suite that a command runs, in a copy of the project that a file belongs to.

    Raises InputError where the tests fail on the file as it is, or pass on one that cannot even be loaded:
    then they do not load this file.
    """
    words = tuple(shlex.split(command))
    if not words or shutil.which(words[0]) is None:
        raise UnknownName(
            f"tests {command!r}: no such command; expected one such as 'pytest tests/'"
        )
    path = file.resolve()
    root = next(
        (p for p in path.parents if any((p / m).exists() for m in PROJECT_MARKS)), path.parent
    )
    size = sum(p.stat().st_size for p in _files(root))
    if size > LARGEST_PROJECT:
        raise LimitError(
            f"the project {root} has {size / 1024**2:.0f} MB, more than the {LARGEST_PROJECT // 1024**2} "
            "that are copied; run the command where the equations and their tests are alone"
        )
    folder = Path.cwd().resolve()
    with tempfile.TemporaryDirectory(prefix="deltac-mutate-") as name:
        copy = Path(name).resolve() / root.name
        shutil.copytree(root, copy, ignore=shutil.ignore_patterns(*NOT_COPIED), symlinks=True)
        folder = copy / folder.relative_to(root) if folder.is_relative_to(root) else copy
        suite = Suite(words, folder, copy / path.relative_to(root), _environment(root, copy))
        text = path.read_text(encoding="utf-8")
        start = time.monotonic()
        if not suite.passes(text):
            raise SourceError(
                f"tests {command!r}: they fail on {file.name} as it is; let them pass first"
            )
        seconds = 3.0 * (time.monotonic() - start) + RUN_TIME
        suite = Suite(words, folder, suite.file, suite.environment, seconds)
        if suite.passes("raise ImportError('not to be loaded')\n" + text):
            raise SourceError(
                f"tests {command!r}: they pass although {file.name} cannot be loaded: they do not use "
                "it, or use an installed copy. Run them from the project's own files"
            )
        yield suite


def _files(root: Path) -> Iterator[Path]:
    for folder, inner, files in os.walk(root):
        inner[:] = [name for name in inner if name not in NOT_COPIED]
        yield from (p for p in (Path(folder) / name for name in files) if p.is_file())


def _environment(root: Path, copy: Path) -> dict[str, str]:
    """The environment, in which imports find the copy before the project itself."""
    paths = [Path(p).resolve() for p in os.environ.get("PYTHONPATH", "").split(os.pathsep) if p]
    moved = [copy / p.relative_to(root) if p.is_relative_to(root) else p for p in paths]
    path = os.pathsep.join(map(str, (copy, copy / "src", *moved)))
    return {**os.environ, "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"}
