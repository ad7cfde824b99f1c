"""Logs on disk: Parquet and CSV, both exact to the last bit.

Parquet keeps the header of the schema in its key-value metadata, under ``deltac``. CSV keeps it in
its first line, ``# deltac {json}``; other lines that start with ``#`` before the column names are
comments. Logs by other programs need no header: their column names decide.
"""

from __future__ import annotations

import csv
import io
import json
import os
import secrets
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, TypeAlias, TypeVar

from deltac.errors import InputError, closest
from deltac.trajectories.schema import from_columns, to_metadata
from deltac.trajectories.trajectory import FloatArray, Trajectory, row_name

if TYPE_CHECKING:
    import polars

Header: TypeAlias = Mapping[str, Any] | None
Handler = TypeVar("Handler", bound=Callable[..., Any])

_KEY = "deltac"
_CSV_HEADER = b"# deltac "
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"


def write_trajectory(run: Trajectory, path: str | Path) -> None:
    """Write a log, `.parquet` or `.csv` by the suffix of `path`; reading it back is bitwise equal.

    The file appears whole or not at all: it is written beside `path` and then renamed, so that an
    interrupted write leaves an older file as it was.

    Raises InputError for an unknown suffix or folder, OSError when the disk refuses.
    """
    write = _by_suffix(path, {".parquet": _write_parquet, ".csv": _write_csv})
    target = Path(os.path.realpath(path))  # through a link, not over it
    if not target.parent.is_dir():
        raise InputError(f"{path}: the folder {target.parent} does not exist; create it first")
    if target.is_dir():
        raise InputError(f"{path}: is a folder; expected the name of a file")
    frame, header = run.to_frame(), json.dumps(to_metadata(run), allow_nan=False)
    with _appearing(target) as file:
        write(frame, header, file)


def read_trajectory(path: str | Path) -> Trajectory:
    """Read a log, `.parquet` or `.csv`, of deltac or of another program (see `from_columns`).

    Raises InputError that names the file and, where it applies, column and row.
    """
    read = _by_suffix(path, {".parquet": _read_parquet, ".csv": _read_csv})
    try:
        data = Path(path).read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file{_neighbour(Path(path))}") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        if not data or data.isspace():
            raise InputError("the file is empty; expected a row of column names and samples")
        columns, header = read(data)
        return from_columns(columns, header)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _by_suffix(path: str | Path, options: Mapping[str, Handler]) -> Handler:
    suffix = Path(path).suffix.lower()
    if suffix not in options:
        raise InputError(
            f"{path}: unknown suffix {suffix!r}{closest(suffix, options)} "
            "(name the file *.parquet or *.csv)"
        )
    return options[suffix]


def _neighbour(path: Path) -> str:
    """The closest match of a missing file's name in its folder."""
    if not path.parent.is_dir():
        return f"; the folder {path.parent} does not exist"
    hint = closest(path.name, (entry.name for entry in path.parent.iterdir()))
    return hint if "did you mean" in hint else ""


@contextmanager
def _appearing(target: Path) -> Iterator[BinaryIO]:
    """A file that takes the place of `target` only once it is complete and on the disk."""
    temporary = target.with_name(f".deltac-{secrets.token_hex(6)}.tmp")
    try:
        with open(temporary, "xb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


# -- Parquet -------------------------------------------------------------------------------------


def _write_parquet(frame: polars.DataFrame, header: str, file: BinaryIO) -> None:
    frame.write_parquet(file, metadata={_KEY: header})


def _read_parquet(data: bytes) -> tuple[dict[str, FloatArray], Header]:
    import polars

    magic = b"PAR1"
    if not data.startswith(magic):
        raise InputError("this is no Parquet file; is the suffix right?")
    if len(data) < 12 or not data.endswith(magic):
        raise InputError("the Parquet file is truncated; copy or write it again")
    try:
        metadata = polars.read_parquet_metadata(io.BytesIO(data))
        frame = polars.read_parquet(io.BytesIO(data))
    except (polars.exceptions.PolarsError, polars.exceptions.PanicException) as error:
        raise InputError(f"the Parquet file is damaged; write it again. {error}") from error
    header = _parse_header(metadata[_KEY]) if _KEY in metadata else None
    return {name: _numbers(name, frame[name]) for name in frame.columns}, header


# -- CSV -----------------------------------------------------------------------------------------


def _write_csv(frame: polars.DataFrame, header: str, file: BinaryIO) -> None:
    names = io.StringIO()
    csv.writer(names, lineterminator="\n").writerow(frame.columns)
    file.write(_CSV_HEADER + header.encode() + b"\n" + names.getvalue().encode())
    frame.write_csv(file, include_header=False)


def _read_csv(data: bytes) -> tuple[dict[str, FloatArray], Header]:
    import polars

    header: Header = None
    line, lines, rest = b"#", 0, data.removeprefix(_BYTE_ORDER_MARK)
    while line.startswith(b"#"):
        line, _, rest = rest.partition(b"\n")
        lines += 1
        if header is None and line.startswith(_CSV_HEADER):
            header = _parse_header(line.removeprefix(_CSV_HEADER))
    names = _column_names(line, exact=header is not None)
    if not rest or rest.isspace():
        raise InputError("there are column names but no rows; expected at least one")

    # Fields are read as text first: only so can a bad one be named with its row.
    keys = [str(index) for index in range(len(names))]
    try:
        frame = polars.read_csv(
            rest,
            has_header=False,
            infer_schema=False,
            schema=dict.fromkeys(keys, polars.String),
        )
    except polars.exceptions.PolarsError as error:
        raise _malformed(rest, len(names), lines, error) from error
    columns = {
        name: _numbers(name, frame[key], lines + 1) for name, key in zip(names, keys, strict=True)
    }
    return columns, header


def _column_names(line: bytes, exact: bool) -> list[str]:
    """The names of the columns; those of other programs may be padded with spaces."""
    try:
        rows = list(csv.reader([line.decode().rstrip("\r")], strict=True))
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"the column names cannot be read ({error}); write UTF-8") from error
    names = rows[0] if rows else []
    if not names:
        raise InputError("no column names; expected 'time,q.<coordinate>,…,u.<speed>,…'")
    if len(names) == 1 and (";" in names[0] or "\t" in names[0]):
        raise InputError(
            f"the column names {names[0]!r} are not separated by commas; write the log with "
            "commas between columns and points in numbers"
        )
    if not exact:
        names = [name.strip() for name in names]
    for index, name in enumerate(names):
        if name in names[:index]:
            raise InputError(f"the column {name!r} appears twice; rename or remove one")
    return names


def _malformed(body: bytes, width: int, lines: int, error: Exception) -> InputError:
    """What is wrong with a body that polars refuses with `error`, and on which line."""
    try:
        text = body.decode()
    except UnicodeDecodeError as undecodable:
        line = lines + 1 + body.count(b"\n", 0, undecodable.start)
        return InputError(f"line {line} is not UTF-8 text; expected numbers")
    reader = csv.reader(io.StringIO(text), strict=True)
    try:
        for fields in reader:
            if len(fields) != width:
                return InputError(
                    f"line {lines + reader.line_num} has {len(fields)} fields, expected {width}, "
                    "one for each column name. Write numbers with decimal points, not commas."
                )
    except csv.Error as stray:
        return InputError(f"line {lines + reader.line_num} cannot be taken apart: {stray}")
    return InputError(f"the rows cannot be taken apart: {error}")


# -- both ----------------------------------------------------------------------------------------


def _parse_header(text: str | bytes) -> Header:
    try:
        header = json.loads(text)
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise InputError(
            f"the deltac metadata are damaged ({error}); write the log again, or remove them to "
            "let the column names decide"
        ) from error
    if not isinstance(header, dict):
        raise InputError(f"the deltac metadata are {header!r}, expected a JSON object")
    return header


def _numbers(name: str, series: polars.Series, first_line: int | None = None) -> FloatArray:
    """A column as float64; InputError names the first row that holds no number."""
    import polars

    if series.dtype == polars.String:
        numbers = series.cast(polars.Float64, strict=False)
        if numbers.null_count():  # padded with spaces, perhaps; stripping is slow
            numbers = series.str.strip_chars().cast(polars.Float64, strict=False)
    elif series.dtype.is_numeric() or series.dtype == polars.Null:
        numbers = series.cast(polars.Float64)
    else:
        raise InputError(
            f"column {name!r}: found values of type {series.dtype}, expected numbers in SI units "
            "(times in seconds)"
        )
    if numbers.null_count():
        row = numbers.is_null().arg_max() or 0
        found = "nothing" if series[row] is None else repr(series[row])
        where = row_name(row, len(series))
        if first_line is not None:
            where += f", line {first_line + row}"
        raise InputError(
            f"column {name!r}, {where}: found {found}, expected a number. Repair or drop the row."
        )
    result: FloatArray = numbers.to_numpy()
    return result
