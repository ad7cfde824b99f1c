"""Parquet logs: the header of the schema is in the key-value metadata, under ``deltac``."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from deltac.errors import FileError
from deltac.foreign.files import opened
from deltac.foreign.isolation import apart
from deltac.foreign.limits import Limits, require_memory
from deltac.trajectories.formats.delimited import raw_log
from deltac.trajectories.formats.raw import Budget, Header, RawLog, damage_named, parse_header
from deltac.trajectories.trajectory import Trajectory

_KEY = "deltac"
_MAGIC = b"PAR1"
_GROUP = 65_536  # rows that a reader of parts must decode at once


def write_parquet(run: Trajectory, header: str, file: BinaryIO) -> None:
    """Write the columns of the schema, as float64."""
    run.to_frame().write_parquet(file, metadata={_KEY: header}, row_group_size=_GROUP)


@apart
def read_parquet(path: Path) -> RawLog:
    """Every column, as numbers."""
    import polars

    header, rows, columns = parquet_facts(path)
    Limits.current().check("rows", rows, "the log has")
    require_memory(rows * columns * 32.0, f"{rows} rows and {columns} columns")
    Budget(path.stat().st_size).take(rows * columns * 8)
    with damaged():
        frame = polars.read_parquet(path, glob=False)
    return raw_log(frame, header)


@apart
def read_parquet_part(path: Path, first: int, rows: int, header: Header) -> RawLog:
    """So many rows from the row `first` on."""
    import polars

    with damaged():
        frame = polars.scan_parquet(path, glob=False).slice(first, rows).collect()
    return raw_log(frame, header)


@apart
def read_parquet_groups(
    path: Path, keys: Sequence[str], values: Collection[str] | None
) -> dict[str, RawLog] | None:
    """Other programs' rows by the text of their value in the first column of `keys` that is there, or None.

    Those of the `values`, in the order of the file; of all of them the names alone if that is None.
    """
    import polars

    _check(path)
    with damaged():
        table = polars.scan_parquet(path, glob=False)
        schema = table.collect_schema()
        key = next((name for name in keys if name in schema), None)
        if key is None:
            return None
        text = polars.col(key).cast(polars.String)
        if values is None:
            groups = table.select(text).unique(maintain_order=True).collect()[key]
            return {str(value): RawLog({}) for value in groups}
        frame = table.filter(text.is_in(list(values))).collect()
        parts = frame.partition_by(key, maintain_order=True)
    return {str(part[key][0]): raw_log(part.drop(key), None) for part in parts}


@apart
def parquet_facts(path: Path) -> tuple[Header, int, int]:
    """The deltac metadata of a file, if it has them, its rows and columns, without reading them.

    Raises InputError when it is no whole Parquet file.
    """
    import polars

    _check(path)
    with damaged():
        metadata = polars.read_parquet_metadata(path)
        table = polars.scan_parquet(path, glob=False)
        columns = len(table.collect_schema())
    header = parse_header(metadata[_KEY]) if _KEY in metadata else None
    Limits.current().check("columns", columns, "the log has")
    with damaged():
        rows = table.select(polars.len()).collect().item()
    return header, int(rows), columns


def _check(path: Path) -> None:
    """Raise InputError when it is no whole Parquet file."""
    limits = Limits.current()
    with opened(path) as file:
        start, size = file.read(4), file.seek(0, 2)
        file.seek(max(0, size - 8))
        length, end = file.read(4), file.read()
    if start != _MAGIC:
        raise FileError("this is not a Parquet file; is the suffix right?")
    if size < 12 or end != _MAGIC:
        raise FileError("the Parquet file is truncated; copy or write it again")
    footer = int.from_bytes(length, "little")
    limits.check("metadata", footer, "the footer of the Parquet file is of")


@contextmanager
def damaged() -> Iterator[None]:
    """Turn what polars raises for a damaged file into an InputError."""
    import polars

    with damage_named("Parquet"):
        try:
            yield
        except polars.exceptions.PanicException as error:  # no Exception, but of Rust
            raise ValueError(error) from error
