"""The work of an audit fleet: logs, or episodes of one log, judged."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from deltac.errors import InputError
from deltac.fleets.episodes import read_episodes
from deltac.fleets.rows import FAILED
from deltac.kernels.rows import compiled
from deltac.models import Model
from deltac.trajectories.formats.mapping import LogMapping
from deltac.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from deltac.diagnosis.audit.audit import Audit


TOGETHER = 32
"""Episodes that are judged side by side: what is known of each takes a megabyte or so of memory."""


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
    batched = list(episodes) != [None]
    # Compiled is the same for all episodes, so that they all pay for it.
    with compiled() if batched else contextlib.nullcontext():
        for first in range(0, len(runs), TOGETHER):
            yield from _judged(task, runs[first : first + TOGETHER])


def _judged(task: AuditTask, runs: Sequence[Trajectory | InputError]) -> list[dict[str, Any]]:
    from deltac.diagnosis.audit.audit import audit_together

    began = time.process_time()
    good = [run for run in runs if not isinstance(run, InputError)]
    audits = iter(
        audit_together(
            task.model, good, tolerance=task.tolerance, work=task.work, strict=task.strict
        )
    )
    found = [run if isinstance(run, InputError) else next(audits) for run in runs]
    seconds = (time.process_time() - began) / max(len(good), 1)
    return [_failed(one) if isinstance(one, InputError) else _told(one, seconds) for one in found]


def _failed(error: InputError) -> dict[str, Any]:
    return {"verdict": FAILED, "code": error.code, "message": str(error), "exit_code": 2.0}


def _told(found: Audit, seconds: float) -> dict[str, Any]:
    """The row of an audit that took so many seconds."""
    return {
        "verdict": found.verdict.kind,
        "confidence": found.verdict.confidence,
        "relative": found.relative,
        "energy_error": float(np.abs(found.energy_error).max()),
        "energy": found.beside,
        "error_bar": float(found.ledger.error_bar[found.function].max()),
        "samples": float(found.samples),
        "duration": found.run.duration,
        "exit_code": float(found.exit_code),
        "findings": " ".join(f.code for f in found.findings) or None,
        "seconds": seconds,
        "message": found.summary(),
        "details": found.explain() if found.exit_code else None,
    }
