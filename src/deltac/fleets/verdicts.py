"""The work of an audit fleet: logs, or episodes of one log, judged."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from deltac.errors import InputError
from deltac.fleets.episodes import read_episodes
from deltac.fleets.rows import FAILED
from deltac.models import Model
from deltac.trajectories.formats.mapping import LogMapping
from deltac.trajectories.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class AuditTask:
    """What the audits of a fleet share."""

    model: Model
    tolerance: float
    work: str | None
    mapping: LogMapping | None
    strict: bool


def verdicts(
    task: AuditTask, source: str, episodes: Sequence[str | None]
) -> Iterator[dict[str, Any]]:
    """What came of each episode (None: of the whole log), in order."""
    runs = read_episodes(source, episodes, task.mapping, task.model.mechanism)
    if list(episodes) == [None]:
        yield from (_of(task, run) for run in runs)
        return
    from deltac.kernels.rows import compiled

    with compiled():  # the same for all episodes, so that they all pay for it
        found = [_of(task, run) for run in runs]
    yield from found


def _of(task: AuditTask, run: Trajectory | InputError) -> dict[str, Any]:
    return _failed(run) if isinstance(run, InputError) else _audited(task, run)


def _failed(error: InputError) -> dict[str, Any]:
    return {"verdict": FAILED, "code": error.code, "message": str(error), "exit_code": 2.0}


def _audited(task: AuditTask, run: Trajectory) -> dict[str, Any]:
    """The whole audit of one run."""
    from deltac.diagnosis.audit.audit import audit

    began = time.process_time()
    try:
        found = audit(task.model, run, tolerance=task.tolerance, work=task.work, strict=task.strict)
    except InputError as error:
        return _failed(error)
    return {
        "verdict": found.verdict.kind,
        "confidence": found.verdict.confidence,
        "relative": found.relative,
        "energy_error": float(np.abs(found.energy_error).max()),
        "energy": found.beside,
        "error_bar": float(found.ledger.error_bar[found.function].max()),
        "samples": float(len(run)),
        "duration": run.duration,
        "exit_code": float(found.exit_code),
        "findings": " ".join(f.code for f in found.findings) or None,
        "seconds": time.process_time() - began,
        "message": found.summary(),
        "details": found.explain() if found.exit_code else None,
    }
