"""Parquet logs: the header of the schema is in the key-value metadata, under ``deltac``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from deltac.errors import InputError
from deltac.trajectories.formats.delimited import raw_log
from deltac.trajectories.formats.raw import Header, RawLog, parse_header
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
    with damage_named():
        frame = polars.read_parquet(path, glob=False)
    return raw_log(frame, header)


def parquet_header(path: Path) -> Header:
    """The deltac metadata of a file, if it has them; InputError when it is no whole Parquet file."""
    import polars

    with path.open("rb") as file:
        start, size = file.read(4), file.seek(0, 2)
        file.seek(max(0, size - 4))
        end = file.read()
    if start != _MAGIC:
        raise InputError("this is no Parquet file; is the suffix right?")
    if size < 12 or end != _MAGIC:
        raise InputError("the Parquet file is truncated; copy or write it again")
    with damage_named():
        metadata = polars.read_parquet_metadata(path)
    return parse_header(metadata[_KEY]) if _KEY in metadata else None


def parquet_size(path: Path) -> tuple[int, int]:
    """Rows and columns, without reading them."""
    import polars

    parquet_header(path)
    with damage_named():
        columns = len(polars.read_parquet_schema(path))
        rows = polars.scan_parquet(path, glob=False).select(polars.len()).collect().item()
    return int(rows), columns


@contextmanager
def damage_named() -> Iterator[None]:
    """Turn what polars raises for a damaged file into an InputError."""
    import polars

    try:
        yield
    except (polars.exceptions.PolarsError, polars.exceptions.PanicException, OSError) as error:
        raise InputError(f"the Parquet file is damaged; write it again. {error}") from error
