"""The names in a log against those of a model: the first thing that goes wrong."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias, cast

import numpy as np

from deltac.arrays import PHYSICAL
from deltac.calls.progress import Progress, no_progress
from deltac.diagnosis.measurements.cleaning import cleaned
from deltac.diagnosis.verdict import Finding
from deltac.energy import Ledger, balance
from deltac.energy.accumulator import OVERLAP, balance_chunks
from deltac.errors import ArgumentsError, LogError, closest, listed
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.coordinates import Entries
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory
from deltac.trajectories.columns import MechanismNames
from deltac.trajectories.trajectory import BY_LAW, FRAMES, LEFT_OUT, row_name

if TYPE_CHECKING:
    from deltac.trajectories import Chunk
    from deltac.trajectories.formats.mapping import MappingLike
    from deltac.trajectories.formats.objects import LogSource
    from deltac.trajectories.trajectory import SolverResult


def in_model_order(mechanism: Mechanism, run: Trajectory) -> tuple[Trajectory, list[Finding]]:
    """The log with its columns in the mechanism's order, and a finding if they were in another.

    Raises InputError, comparing the joints, for a log of another mechanism.
    """
    places_q = _places("coordinate", mechanism.name, mechanism.coordinates, run.coordinates)
    places_u = _places("speed", mechanism.name, mechanism.speeds, run.speeds)
    ordered = (run.coordinates, run.speeds) == (
        mechanism.coordinates.names,
        mechanism.speeds.names,
    )
    if ordered:
        return run, []
    ours, theirs = mechanism.coordinates.names, run.coordinates
    if ours == theirs:
        ours, theirs = mechanism.speeds.names, run.speeds
    moved = replace(
        run,
        q=run.q[:, places_q],
        u=run.u[:, places_u],
        udot=None if run.udot is None else run.udot[:, places_u],
        forces={name: force[:, places_u] for name, force in run.forces.items()},
        coordinates=mechanism.coordinates.names,
        speeds=mechanism.speeds.names,
        events=tuple(event.reordered(places_q, places_u) for event in run.events),
    )
    finding = Finding(
        "order",
        "the log's columns are in a different order from the model's and were reordered by name",
        f"log: {listed(theirs)}; model: {listed(ours)}",
        "If the log's names are right, nothing needs to be done",
    )
    return moved, [finding]


def _places(what: str, model: str, ours: Entries, theirs: Sequence[str]) -> np.ndarray:
    unknown = [name for name in theirs if name not in ours.names]
    missing = [name for name in ours.names if name not in theirs]
    if unknown or missing:
        lines = [f"the log is not of model {model!r}: their {what}s differ"]
        if unknown:
            hints = (closest(name, missing or ours.names) for name in unknown[:4])
            hinted = (
                repr(name) + (hint if "did you mean" in hint else "")
                for name, hint in zip(unknown, hints, strict=False)
            )
            lines.append("in the log only: " + ", ".join(hinted) + _more(unknown))
        if missing:
            lines.append("in the model only: " + ", ".join(map(repr, missing[:4])) + _more(missing))
        lines.append("Rename the columns with a mapping file, or use the model of this log")
        raise LogError(". ".join(lines))
    return np.array([theirs.index(name) for name in ours.names], dtype=np.intp)


def _more(names: Sequence[str]) -> str:
    return f" and {len(names) - 4} more" if len(names) > 4 else ""


# --- what a user calls a log ---------------------------------------------------------------------

LARGE_LOG = 128 * 10**6 // np.dtype(float).itemsize
"""Numbers in a log (128 MB; a ledger of all rows takes several times that) above which an audit's ledger
keeps some rows, and a Parquet file is read in parts."""


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


LogLike: TypeAlias = "Trajectory | LogSource | SolverResult"
"""What every verb takes for a log: a run, a file, a table, or what an ODE solver returned."""


def read_run(
    mechanism: Mechanism,
    source: LogLike,
    mapping: MappingLike,
    coordinates: CoordinateMap | None = None,
) -> Trajectory:
    """The run that `source` means, by its joints; its columns may be own `coordinates` and speeds.

    Raises InputError for a log that cannot be read, or is of another model.
    """
    # Runs that were simulated need no reader of files.
    if isinstance(source, Trajectory):
        if mapping is not None:
            raise ArgumentsError("mapping= is for log files; this log is a Trajectory already")
        run = source
    else:
        from deltac.trajectories import read_trajectory
        from deltac.trajectories.formats.objects import is_table

        if not (isinstance(source, str | Path) or is_table(source)):
            result = cast("SolverResult", source)
            return Trajectory.from_scipy(result, mechanism, coordinates=coordinates)
        names = MechanismNames.of(mechanism)
        if coordinates is not None:
            names = names.renamed(coordinates.coordinates, coordinates.speeds)
        run = read_trajectory(source, mapping, names)
    if coordinates is None:
        return run
    from deltac.recorders.state_vectors import in_joint_coordinates

    return in_joint_coordinates(run, mechanism, coordinates)


def read_log(
    mechanism: Mechanism,
    source: LogLike,
    work: str | None,
    mapping: MappingLike,
    *,
    measured: bool = True,
    keep: int | None = None,
    progress: Progress = no_progress,
) -> Log:
    """Read and balance what `source` means: a Trajectory, or a file of a run of `mechanism`.

    What an ODE solver returned (see `Trajectory.from_scipy`) is taken as a log, and so is a table.
    `work` is as for `balance`, by default as the log's engine took it. `mapping` says what the columns of
    another program's file are: a path, or a `LogMapping`. A run that is not `measured`, since it was just
    computed here, is not searched for slips of its columns. Of a log of more than `LARGE_LOG`
    numbers the ledger may `keep` about so many rows, as `balance` does. `progress` is told the share
    of the rows that are read, where they are read in parts.

    Raises InputError for a log that cannot be read, or is of another model.
    """
    if isinstance(source, str | Path):
        path = Path(source)
        rows, columns = _size(path)
        if rows * columns > LARGE_LOG:
            part = max(4, LARGE_LOG // 4 // columns // 4 * 4)
            return _in_parts(mechanism, path, work, mapping, part, progress)
    run = read_run(mechanism, source, mapping)
    return _whole(mechanism, run, work, measured=measured, keep=keep)


def _size(path: Path) -> tuple[int, int]:
    """Rows and columns of a Parquet file; others are read as a whole."""
    from deltac.trajectories.formats.parquet import parquet_facts

    with suppress(Exception):  # damaged: reading it says how
        if path.suffix.lower() == ".parquet" and os.path.isfile(path):
            return parquet_facts(path)[1:]
    return 0, 1


NOTES = {
    "left-out": (
        LEFT_OUT,
        "the parts of the log in which values are missing were left out",
        "Nothing, if samples were lost",
    ),
    "frames": (
        FRAMES,
        "velocities of a floating body are in other components than deltac's, and were transformed",
        "Nothing, if these are the components of the log",
    ),
    "by-law": (
        BY_LAW,
        "columns that the log lacks are computed from the laws of prescribed joints at its times",
        "Nothing, if the time of the first row, t = {t:.9g} s, is the time of the model",
    ),
}
"""Kind of finding -> the reader's note that it tells of, what it is, what to do."""


def _whole(
    mechanism: Mechanism,
    source: Trajectory,
    work: str | None,
    *,
    measured: bool = True,
    keep: int | None = None,
) -> Log:
    run, findings = in_model_order(mechanism, source)
    notes = source.provenance.notes
    findings += [
        Finding(kind, what, notes[note], remedy.format(t=run.t[0]))
        for kind, (note, what, remedy) in NOTES.items()
        if notes.get(note)
    ]
    _refuse_garbage(run)
    numbers = len(run) * (run.q.shape[1] + (2 + len(run.forces)) * run.u.shape[1])
    keep = keep if numbers > LARGE_LOG else None
    if not measured:
        return balanced(mechanism, run, work, tuple(findings), keep=keep)
    clean = cleaned(mechanism, run)
    return balanced(mechanism, clean.run, work, (*findings, *clean.findings), keep=keep)


def balanced(
    mechanism: Mechanism,
    run: Trajectory,
    work: str | None,
    findings: tuple[Finding, ...] = (),
    *,
    keep: int | None = None,
) -> Log:
    """A run in memory with its ledger, at all rows or as many as it is to `keep`."""
    ledger = balance(mechanism, run, work or work_of(run), keep=keep)
    _refuse_undefined(ledger)
    return Log(run, run, ledger, findings)


def _in_parts(
    mechanism: Mechanism,
    path: Path,
    work: str | None,
    mapping: MappingLike,
    rows: int,
    progress: Progress,
) -> Log:
    from deltac.trajectories import scan_trajectory

    def chunks() -> Iterator[Chunk]:
        for chunk in scan_trajectory(path, rows, OVERLAP, mapping, mechanism):
            progress(chunk.first_row / chunk.rows)
            _refuse_garbage(chunk.run, chunk.first_row, chunk.rows)
            yield replace(chunk, run=in_model_order(mechanism, chunk.run)[0])

    sample = next(scan_trajectory(path, rows, OVERLAP, mapping, mechanism)).run
    first, findings = in_model_order(mechanism, sample)
    ledger, rows_of_ledger = balance_chunks(mechanism, chunks(), work or work_of(first))
    _refuse_undefined(ledger)
    note = Finding(
        "read-in-parts",
        "the log is large and was balanced in parts; only works and ΔC are of all its rows",
        f"{len(rows_of_ledger)} rows were kept",
        "",
    )
    return Log(rows_of_ledger, first, ledger, (*findings, note))


def _refuse_garbage(run: Trajectory, first: int = 0, rows: int | None = None) -> None:
    """InputError, naming column and row, for a number that is no measurement."""
    columns = [("q", run.q, run.coordinates), ("u", run.u, run.speeds)]
    columns += [("udot", run.udot, run.speeds)] if run.udot is not None else []
    columns += [(f"force.{name}", force, run.speeds) for name, force in run.forces.items()]
    for what, values, names in columns:
        absurd = np.argwhere(np.abs(values) > PHYSICAL)
        if len(absurd):
            row, k = absurd[0]
            raise LogError(
                f"column '{what}.{names[k]}', {row_name(first + int(row), rows or len(run))}, t = "
                f"{run.t[row]:g} s: found {values[row, k]:.4g}, which is beyond any physical quantity. The "
                "file is damaged, or the run blew up: keep only the rows before it, or repair the source"
            )


def _refuse_undefined(ledger: Ledger) -> None:
    """InputError, naming the time, where the energies of the logged states are not finite."""
    groups = (ledger.potential, ledger.power, ledger.work, ledger.delta_c, ledger.error_bar)
    named = {"K": ledger.kinetic, **{n: values for group in groups for n, values in group.items()}}
    for name, values in named.items():
        undefined = np.flatnonzero(~np.isfinite(values))
        if undefined.size:
            raise LogError(
                f"the energy of {name!r} is {values[undefined[0]]} at t = {ledger.t[undefined[0]]:g} s: the "
                "model has no energy in the state logged there (a quaternion of length zero, a singular "
                "configuration, or forces out of all bounds). Repair or cut the log there"
            )


def work_of(run: Trajectory) -> str | None:
    """How an engine's own scheme takes the work, where the log tells; else what `balance` chooses."""
    step = run.provenance.step
    channels = set(run.provenance.held or ())
    if (
        run.integrals
        or run.works
        or not run.forces
        or step is None
        or not channels.issuperset(run.forces)
    ):
        return None
    every_step = np.allclose(np.diff(run.t), step, rtol=1e-6, atol=0.0)
    return "discrete" if every_step else None
