"""Parquet logs: the header of the schema is in the key-value metadata, under ``deltac``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from deltac.errors import FileError
from deltac.files import opened
from deltac.limits import Limits, require_memory
from deltac.trajectories.formats.delimited import raw_log
from deltac.trajectories.formats.raw import Budget, Header, RawLog, damage_named, parse_header
from deltac.trajectories.trajectory import Trajectory

_KEY = "deltac"
_MAGIC = b"PAR1"
_GROUP = 65_536  # rows that a reader of parts must decode at once


def write_parquet(run: Trajectory, header: str, file: BinaryIO) -> None:
    """Write the columns of the schema, as float64."""
    run.to_frame().write_parquet(file, metadata={_KEY: header}, row_group_size=_GROUP)


def read_parquet(path: Path) -> RawLog:
    """Every column, as numbers."""
    import polars

    header = parquet_header(path)
    rows, columns = parquet_size(path)
    Limits.current().check("rows", rows, "the log has")
    require_memory(rows * columns * 32.0, f"{rows} rows and {columns} columns")
    Budget(path.stat().st_size).take(rows * columns * 8)
    with damaged():
        frame = polars.read_parquet(path, glob=False)
    return raw_log(frame, header)


def parquet_header(path: Path) -> Header:
    """The deltac metadata of a file, if it has them; InputError when it is no whole Parquet file."""
    import polars

    limits = Limits.current()
    with opened(path) as file:
        start, size = file.read(4), file.seek(0, 2)
        file.seek(max(0, size - 8))
        length, end = file.read(4), file.read()
    if start != _MAGIC:
        raise FileError("this is no Parquet file; is the suffix right?")
    if size < 12 or end != _MAGIC:
        raise FileError("the Parquet file is truncated; copy or write it again")
    footer = int.from_bytes(length, "little")
    limits.check("metadata", footer, "the footer of the Parquet file is of")
    with damaged():
        metadata = polars.read_parquet_metadata(path)
    return parse_header(metadata[_KEY]) if _KEY in metadata else None


def parquet_size(path: Path) -> tuple[int, int]:
    """Rows and columns, without reading them."""
    import polars

    parquet_header(path)
    with damaged():
        columns = len(polars.read_parquet_schema(path))
    Limits.current().check("columns", columns, "the log has")
    with damaged():
        rows = polars.scan_parquet(path, glob=False).select(polars.len()).collect().item()
    return int(rows), columns


@contextmanager
def damaged() -> Iterator[None]:
    """Turn what polars raises for a damaged file into an InputError."""
    import polars

    with damage_named("Parquet"):
        try:
            yield
        except polars.exceptions.PanicException as error:  # no Exception, but of Rust
            raise ValueError(error) from error
