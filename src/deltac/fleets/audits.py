"""`audit_many`: a folder of logs, or one log of many episodes, against one model: a verdict for each."""

from __future__ import annotations

import contextlib
import glob as globbing
import hashlib
import itertools
import os
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from deltac.calls.arguments import checked
from deltac.calls.interrupts import interruptible
from deltac.calls.progress import Progress
from deltac.diagnosis import RUN_TOLERANCE, check_tolerance
from deltac.errors import FileError, InputError, check_names, listed
from deltac.fleets.episodes import episode_names, file_system, read_episodes
from deltac.fleets.fleet import Plan
from deltac.fleets.result import Fleet
from deltac.fleets.rows import (
    AUDITED,
    LONG_PIECE,
    NUMBER,
    PIECES_A_WORKER,
    TEXT,
    Piece,
    audited_row,
    failed_row,
)
from deltac.fleets.spec import Execution
from deltac.fleets.store import ADDRESS, digest, versions
from deltac.foreign.files import read_text
from deltac.foreign.isolation import Failure
from deltac.kernels import compiled_rows
from deltac.models import Model, ModelLike, load_model
from deltac.trajectories import FORMATS, LogMapping, Trajectory, as_mapping, is_log_folder, read_raw

AUDIT_OUTCOME: Mapping[str, str] = {**AUDITED, "duration": NUMBER}
"""What the table says of every log or episode; see docs/fleets.md."""

AMBIGUOUS = (".txt", ".dat", ".tab", ".asc", ".json", ".jsonl", ".ndjson")
"""Suffixes that other things than logs have as well."""

SMALL_TABLE = 1 << 20
"""Size (bytes) up to which files of such suffixes are looked into."""

EPISODES_TOGETHER = 32
"""Episodes that are judged side by side: what is known of each takes a megabyte or so of memory."""

EPISODES = LONG_PIECE * EPISODES_TOGETHER
"""Logs, and episodes of a log, in a piece, at most."""


@dataclass(frozen=True)
class LogEntry:
    """A log, or an episode of one: where it is, and by what it is known whether it has changed."""

    source: str
    fingerprint: str
    episode: str | None = None


@dataclass(frozen=True, eq=False)
class AuditTask:
    """What the audits of a fleet share."""

    model: Model
    tolerance: float
    work: str | None
    mapping: LogMapping | None
    strict: bool


@dataclass(frozen=True, eq=False)
class AuditPiece(Piece):
    """Some logs, or some episodes of one log."""

    needs = ("deltac.diagnosis.audit.audit", "llvmlite.binding")
    kinds = AUDIT_OUTCOME
    per_row = "logs"

    task: AuditTask
    logs: tuple[LogEntry, ...]

    def outcome(self) -> dict[str, list[Any]]:
        """Log by log."""
        rows: list[Mapping[str, Any]] = []
        for source in dict.fromkeys(log.source for log in self.logs):
            own = [log.episode for log in self.logs if log.source == source]
            rows += verdicts(self.task, source, own)
        return {name: [row.get(name) for row in rows] for name in AUDIT_OUTCOME}

    def about(self) -> dict[str, Any]:
        """The first log."""
        return {"log": self.logs[0].source, "episode": self.logs[0].episode}

    def point(self) -> dict[str, tuple[str, Any]]:
        """Log and episode."""
        return {
            name: (TEXT, [getattr(log, of) for log in self.logs]) for name, of in LOG_POINT.items()
        }


LOG_POINT = {"log": "source", "episode": "episode"}


def verdicts(
    task: AuditTask, source: str, episodes: Sequence[str | None]
) -> Iterator[dict[str, Any]]:
    """What came of each episode (None: of the whole log), in order."""
    runs = read_episodes(source, episodes, task.mapping, task.model.mechanism)
    batched = list(episodes) != [None]
    # Compiled is the same for all episodes, so that they all pay for it.
    with compiled_rows() if batched else contextlib.nullcontext():
        for first in range(0, len(runs), EPISODES_TOGETHER):
            yield from _judged(task, runs[first : first + EPISODES_TOGETHER])


def _judged(task: AuditTask, runs: Sequence[Trajectory | InputError]) -> list[dict[str, Any]]:
    from deltac.diagnosis import audit_together

    began = time.process_time()
    good = [run for run in runs if not isinstance(run, InputError)]
    audits = iter(
        audit_together(
            task.model, good, tolerance=task.tolerance, work=task.work, strict=task.strict
        )
    )
    results = [run if isinstance(run, InputError) else next(audits) for run in runs]
    seconds = (time.process_time() - began) / max(len(good), 1)
    return [
        failed_row(Failure(one.code, str(one)))
        if isinstance(one, InputError)
        else {**audited_row(one, seconds), "duration": one.run.duration}
        for one in results
    ]


# --- which logs -----------------------------------------------------------------------------------


def find_logs(logs: Iterable[str | Path] | str | Path) -> tuple[list[str], list[str]]:
    """The logs that are meant: paths, folders, patterns (``logs/**/*.parquet``), URLs that fsspec knows.

    A path that is not there is a log, too: its row says so. Whatever is named, or matches a pattern, is one;
    other files in a folder are named as well. Raises InputError where a pattern matches none.
    """
    many = [logs] if isinstance(logs, str | Path) else list(logs)
    logs_found: list[str] = []
    skipped: list[str] = []
    for one in map(str, many):
        if "://" in one:
            logs_found += _remote(one)
        elif _is_folder(one):
            for path in sorted(p for p in Path(one).iterdir() if p.name[0] != "."):
                if _is_log(path):
                    logs_found.append(str(path))
                else:
                    skipped.append(f"{path}/" if path.is_dir() else str(path))
        elif _is_pattern(one):
            matches = sorted(globbing.glob(one, recursive=True))
            if not matches:
                raise FileError(f"{one}: no file matches; quote the pattern, and check its folder")
            logs_found += [n for n in matches if os.path.isfile(n) or is_log_folder(Path(n))]
        else:
            logs_found.append(one)
    if not logs_found:
        raise FileError(
            f"{', '.join(map(str, many))}: no logs there; expected files {', '.join(FORMATS)}"
            + (f"; found {listed(skipped)}" if skipped else "")
        )
    return list(dict.fromkeys(logs_found)), list(dict.fromkeys(skipped))


def _is_log(path: Path) -> bool:
    """Whether an entry of a folder claims to be a log: by its suffix, or by a table of numbers in it."""
    suffix = path.suffix.lower()
    if path.is_dir():
        return is_log_folder(path)
    if suffix not in AMBIGUOUS or not path.exists() or path.stat().st_size > SMALL_TABLE:
        return suffix in FORMATS
    try:
        columns = read_raw(path).columns.values()
    except InputError:
        return False
    return len(columns) > 1 and all(len(column) > 1 for column in columns)


def is_fleet(logs: Sequence[str]) -> bool:
    """Whether these are a folder of logs, a pattern, or in a store, and so a fleet even if they are few."""
    return any("://" in one or _is_folder(one) or _is_pattern(one) for one in logs)


def _is_folder(one: str) -> bool:
    return os.path.isdir(one) and not is_log_folder(Path(one))


def _is_pattern(one: str) -> bool:
    return globbing.has_magic(one) and not os.path.exists(one)


def _remote(url: str) -> list[str]:
    system, path = file_system(url)
    system.invalidate_cache()  # what this process saw of the store before may have changed
    if not globbing.has_magic(path):
        return [url]
    matches = sorted(system.glob(path))
    if not matches:
        raise FileError(f"{url}: no object matches")
    return [system.unstrip_protocol(name) for name in matches]


def _fingerprint(source: str) -> str:
    """By what it is noticed that a log has changed: its size and time, or what its store tells."""
    try:
        if "://" in source:
            system, path = file_system(source)
            return str(system.ukey(path))
        about = Path(source).stat()
    except (OSError, InputError):
        return "missing"
    return f"{about.st_size} {about.st_mtime_ns}"


# --- the fleet -------------------------------------------------------------------------------------


@checked
@interruptible()
def audit_many(
    model: ModelLike,
    logs: Iterable[str | Path] | str | Path,
    out: str | Path | None = None,
    *,
    tolerance: float = RUN_TOLERANCE,
    work: str | None = None,
    mapping: str | Path | None = None,
    strict: bool = False,
    workers: int | None = None,
    executor: Executor | None = None,
    scheduler: str | None = None,
    time_limit: float | None = None,
    retries: int | None = None,
    retry_failed: bool = False,
    progress: Progress | None = None,
) -> Fleet:
    """Audit many logs, or the episodes of batched logs, against one model.

    Every log is accounted for: one that cannot be read, or is not of this model, is a row with the verdict
    "failed" and the reason. Results that are already in `out` are not computed again unless their log has
    changed.

    A batched log has a column ``episode`` (Parquet, CSV), or arrays (T, N, n) of N episodes at common times
    (NPZ, HDF5). The equations are compiled once for all of its episodes.

    Args:
        model: as for `audit`.
        logs: paths, folders, patterns, or URLs that fsspec knows (``s3://…``).
        out: folder of the results; by default the model's name with ``.audits``.
        tolerance: accepted |ΔC| as a fraction of the energy that the system has (max K + range of V).
        work: as for `audit`.
        mapping: path of a mapping file, for all logs.
        strict: as for `audit`.
        workers: number of processes; by default one per core.
        executor: does the work instead; any executor of the `concurrent.futures` interface.
        scheduler: address of a Dask scheduler whose workers do the work instead.
        time_limit: seconds that a piece of work (8 logs, or 256 episodes) may take before its process is
            ended (600).
        retries: more attempts for a log whose process died or took too long (2).
        retry_failed: try again what was set aside before.
        progress: called with the fraction done.

    Returns:
        The fleet: counts of verdicts, the worst cases, and `frame` with a row for every log or episode.

    Raises:
        InputError: no such model, no log, or the folder belongs to another fleet or is in use.
    """
    plan = plan_audits(model, logs, tolerance=tolerance, work=work, mapping=mapping, strict=strict)
    execution = Execution().overridden(
        workers=workers, scheduler=scheduler, time_limit=time_limit, retries=retries
    )
    return plan.run(out, execution, executor=executor, retry_failed=retry_failed, progress=progress)


@dataclass(frozen=True, eq=False)
class AuditPlan(Plan):
    """The logs of a fleet, the settings that their audits share, and other files that lie beside them."""

    kind = "audit"

    settings: dict[str, Any]
    task: AuditTask
    logs: tuple[LogEntry, ...]
    skipped: tuple[str, ...]

    def folder(self) -> Path:
        """The model's name with ``.audits``."""
        return Path(f"{Path(self.name.replace(':', '-')).name}.audits")

    def head(self) -> dict[str, Any]:
        """What the audits share, and what was left out."""
        models = {self.name: self.settings["model"]}
        return {"plan": self.settings, "models": models, "skipped": self.skipped}

    def pieces(self, rows: Sequence[int], workers: int, chunk: int | None) -> Iterator[Piece]:
        """Logs in small pieces, episodes in larger ones of one log."""
        most = chunk or max(1, min(LONG_PIECE, len(rows) // (PIECES_A_WORKER * workers)))

        def together(k: int) -> Any:
            """Logs go with each other, episodes with those of their log."""
            return None if self.logs[k].episode is None else self.logs[k].source

        for source, group in itertools.groupby(rows, together):
            of_source = list(group)
            size = most if source is None else EPISODES
            for some in (of_source[k : k + size] for k in range(0, len(of_source), size)):
                logs, addresses = ([of[k] for k in some] for of in (self.logs, self.addresses))
                yield AuditPiece(tuple(addresses), self.task, tuple(logs))  # type: ignore[arg-type]

    def command(self, piece: Piece) -> str:
        """The command that audits one log, or one episode."""
        about = piece.about()
        episode = "" if about["episode"] is None else f" --episode {about['episode']}"
        return f"{self.command_line} {about['log']}{episode}"

    def write_case(self, address: str, path: Path) -> None:
        """The audit of one log, or of one episode."""
        from deltac import audit

        task, log = self.task, self.logs[self.place(address)]
        (run,) = read_episodes(log.source, [log.episode], task.mapping, task.model.mechanism)
        if isinstance(run, InputError):
            raise run
        report = audit(
            task.model, run, tolerance=task.tolerance, work=task.work, strict=task.strict
        )
        report.report(path)


def plan_audits(
    model: ModelLike,
    logs: Iterable[str | Path] | str | Path,
    *,
    tolerance: float = RUN_TOLERANCE,
    work: str | None = None,
    mapping: str | Path | None = None,
    strict: bool = False,
) -> AuditPlan:
    """Find the logs and their episodes; nothing is audited. See `audit_many`."""
    check_tolerance(tolerance)
    if work is not None:
        check_names([work], ("in-loop", "samples", "discrete"), "unknown rule for works,")
    loaded = load_model(model)
    columns = as_mapping(mapping)  # first: one that is none is no error of a log
    text = None if mapping is None else read_text(mapping)
    name = str(model) if isinstance(model, str | Path) else loaded.mechanism.name
    # What problems carry besides (equations, measures) is not needed, and may not travel.
    bare = Model(loaded.mechanism, loaded.starts, None, loaded.import_report)
    task = AuditTask(bare, float(tolerance), work, columns, strict)
    of_source: list[LogEntry] = []
    sources, skipped = find_logs(logs)
    for source in sources:
        fingerprint = _fingerprint(source)
        names = episode_names(source)
        of_source += [
            LogEntry(source, fingerprint, one) for one in ([None] if names is None else names)
        ]
    head = {
        "model": loaded.mechanism.hash,
        "tolerance": task.tolerance,
        "work": work,
        "mapping": text,
        "strict": strict,
    }
    seed = hashlib.blake2b(digest({**head, "versions": versions()}), digest_size=ADDRESS)
    addresses = []
    for log in of_source:
        own = seed.copy()
        own.update(f"{log.source}\n{log.fingerprint}\n{log.episode}".encode())
        addresses.append(own.hexdigest())
    return AuditPlan(
        name, tuple(addresses), f"deltac audit {name}", head, task, tuple(of_source), tuple(skipped)
    )
