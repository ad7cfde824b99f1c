"""What a user calls a log, read, put in the model's order, and balanced: whole or in parts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from deltac.diagnosis.findings import Finding
from deltac.diagnosis.names import in_model_order
from deltac.energy import Ledger, balance
from deltac.energy.stream import OVERLAP, balance_chunks
from deltac.errors import InputError
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Chunk, Trajectory, read_trajectory, scan_trajectory
from deltac.trajectories.parquet import parquet_size

LARGE = 50_000_000
"""Numbers in a Parquet log (400 MB) above which it is read in parts."""

PART = 8_000_000
"""Numbers in such a part, about."""


@dataclass(frozen=True, eq=False)
class Log:
    """A log and its ledger.

    `run` are its rows, or some of them where it was read in parts; `consecutive` rows that follow each
    other: all, or those of the first part.
    """

    run: Trajectory
    consecutive: Trajectory
    ledger: Ledger
    findings: tuple[Finding, ...]


def read_log(mechanism: Mechanism, source: Any, work: str | None, mapping: Any) -> Log:
    """Read and balance what `source` means: a Trajectory, or a file of a run of `mechanism`.

    `work` is as for `balance`, by default as the log's engine took it. `mapping` says what the columns of
    another program's file are: a path, or a `LogMapping`.

    Raises InputError for a log that cannot be read, or is of another model.
    """
    if isinstance(source, Trajectory):
        if mapping is not None:
            raise InputError("mapping= is for log files; this log is a Trajectory already")
        return _whole(mechanism, source, work)
    if not isinstance(source, str | Path):
        raise InputError(f"log: found {type(source).__name__}, expected a Trajectory or a path")
    path = Path(source)
    if path.suffix.lower() == ".parquet" and path.is_file():
        rows, columns = _size(path)
        if rows * columns > LARGE:
            return _in_parts(mechanism, path, work, mapping, max(4, PART // columns // 4 * 4))
    return _whole(mechanism, read_trajectory(path, mapping, mechanism), work)


def _size(path: Path) -> tuple[int, int]:
    try:
        return parquet_size(path)
    except Exception:  # damaged: reading it says how
        return 0, 1


def _whole(mechanism: Mechanism, given: Trajectory, work: str | None) -> Log:
    run, findings = in_model_order(mechanism, given)
    ledger = balance(mechanism, run, work or _work(run))
    return Log(run, run, ledger, tuple(findings))


def _in_parts(mechanism: Mechanism, path: Path, work: str | None, mapping: Any, rows: int) -> Log:
    def chunks() -> Iterator[Chunk]:
        for chunk in scan_trajectory(path, rows, OVERLAP, mapping, mechanism):
            yield replace(chunk, run=in_model_order(mechanism, chunk.run)[0])

    given = next(scan_trajectory(path, rows, OVERLAP, mapping, mechanism)).run
    first, findings = in_model_order(mechanism, given)
    ledger, kept = balance_chunks(mechanism, chunks(), work or _work(first))
    note = Finding(
        "read-in-parts",
        "the log is large and was balanced in parts; statistics other than works and ΔC are of some rows",
        f"{len(kept)} rows were kept",
        "Nothing is to be done",
    )
    return Log(kept, first, ledger, (*findings, note))


def _work(run: Trajectory) -> str | None:
    """How an engine's own scheme takes the work, where the log tells; else what `balance` chooses."""
    step = run.provenance.step
    held = set(run.provenance.notes.get("held", "").split(";"))
    if run.integrals or not run.forces or step is None or not held.issuperset(run.forces):
        return None
    every_step = np.allclose(np.diff(run.t), step, rtol=1e-6, atol=0.0)
    return "discrete" if every_step else None
