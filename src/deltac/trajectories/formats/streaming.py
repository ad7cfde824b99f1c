"""Logs larger than memory: Parquet read in parts that overlap."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from deltac.calls.arguments import checked
from deltac.errors import FileError, InputError, LogError
from deltac.foreign.files import opened
from deltac.trajectories.columns import MechanismNames, NamesLike
from deltac.trajectories.formats.files import naming
from deltac.trajectories.formats.mapping import LogMapping, MappingLike, as_mapping
from deltac.trajectories.formats.parquet import parquet_facts, read_parquet_part
from deltac.trajectories.formats.reading import LogReading
from deltac.trajectories.trajectory import Trajectory


@dataclass(frozen=True)
class Chunk:
    """A part of a log.

    run        its rows, with up to `overlap` rows of the neighbours before and after
    first_row  the row of the log that ``run`` begins with
    core       the rows of ``run`` that are this chunk's own; the cores of all chunks follow each
               other and make up the log
    rows       how many rows the whole log has
    """

    run: Trajectory
    first_row: int
    core: slice
    rows: int


@checked
def scan_trajectory(
    path: str | Path,
    rows: int = 100_000,
    overlap: int = 1,
    mapping: MappingLike = None,
    model: NamesLike | None = None,
) -> Iterator[Chunk]:
    """Read a Parquet log in chunks of `rows` rows that see `overlap` rows of their neighbours.

    Memory is bounded by the rows of a chunk and of one row group of the file (deltac writes 65 536).
    Values are those of `read_trajectory`; speeds that are missing are not derived. With an overlap
    of at least one, times are checked across the borders too.

    Raises InputError as `read_trajectory` does, and for a file that is not Parquet; rows in its
    messages are counted from the first of the chunk, which the message names.
    """
    if Path(path).suffix.lower() != ".parquet":
        raise FileError(f"{path}: only Parquet is read in parts; store the log as .parquet")
    if rows < 1 or overlap < 0:
        raise InputError(f"rows is {rows}, overlap {overlap}; expected 1 or more, 0 or more")
    with naming(path), opened(path):
        pass
    names = None if model is None else MechanismNames.of(model)
    return _chunks(Path(path), rows, overlap, as_mapping(mapping), names)


def _chunks(
    path: Path, rows: int, overlap: int, mapping: LogMapping | None, names: MechanismNames | None
) -> Iterator[Chunk]:
    with naming(path):
        header, total, _ = parquet_facts(path)
        if header is not None and header.get("rows", total) != total:
            raise FileError(
                f"found {total} rows, the metadata say {header['rows']}: the log is cut off or was "
                "edited. Take the complete one."
            )
        if not total:
            raise LogError("the log has no rows")
    for start in range(0, total, rows):
        first = max(0, start - overlap)
        stop = min(total, start + rows)
        last = min(total, stop + overlap)
        with naming(path):
            part = None if header is None else {**header, "rows": last - first}
            try:
                raw = read_parquet_part(path, first, last - first, part)
                run = LogReading.of(raw, mapping, names).trajectory(derive=False)
            except InputError as error:
                raise InputError(f"in the part that begins at row {first}: {error}") from error
        yield Chunk(run, first, slice(start - first, stop - first), total)
