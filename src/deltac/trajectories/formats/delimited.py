"""CSV logs: the header of the schema is in the first line, ``# deltac {json}``.

Other lines that start with ``#`` before the column names are comments. Numbers are written so that
they read back bitwise.
"""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from deltac.errors import FileError, InputError, LogError, WrongType, shown
from deltac.files import read_bytes
from deltac.limits import Limits, require_memory
from deltac.trajectories.formats.raw import Budget, Header, RawLog, parse_header
from deltac.trajectories.trajectory import FloatArray, Trajectory, row_name

if TYPE_CHECKING:
    import polars

_CSV_HEADER = b"# deltac "
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"


def write_csv(run: Trajectory, header: str, file: BinaryIO) -> None:
    """Write the columns of the schema."""
    frame = run.to_frame()
    names = io.StringIO()
    csv.writer(names, lineterminator="\n").writerow(frame.columns)
    file.write(_CSV_HEADER + header.encode() + b"\n" + names.getvalue().encode())
    frame.write_csv(file, include_header=False)


def read_csv(path: Path) -> RawLog:
    """Every column, as numbers."""
    import polars

    data = read_bytes(path)
    header, line, lines, rest = _head(data)
    names = _column_names(line, exact=header is not None)
    if not rest or rest.isspace():
        raise LogError("there are column names but no rows; expected at least one")
    rows = rest.count(b"\n") + 1
    Limits.current().check("rows", rows, "the log has")
    Budget(len(data)).take(rows * len(names) * 8)  # a short row has empty fields, also of numbers
    require_memory(rows * len(names) * 32.0, f"{rows} rows and {len(names)} columns")

    # Fields are read as text first: only so can a bad one be named with its row.
    keys = [str(index) for index in range(len(names))]
    try:
        frame = polars.read_csv(
            rest,
            has_header=False,
            infer_schema=False,
            schema=dict.fromkeys(keys, polars.String),
        )
    except (polars.exceptions.PolarsError, polars.exceptions.PanicException) as error:
        raise _malformed(rest, len(names), lines, error) from error
    frame.columns = names
    return raw_log(frame, header, lines + 1)


def _head(data: bytes) -> tuple[Header, bytes, int, bytes]:
    """Deltac's metadata, the line of column names, its number, and what follows."""
    limits = Limits.current()
    header: Header = None
    at, lines = len(_BYTE_ORDER_MARK) * data.startswith(_BYTE_ORDER_MARK), 0
    comments = 0
    while True:
        end = data.find(b"\n", at)
        end = len(data) if end < 0 else end
        lines += 1
        if not data.startswith(b"#", at):
            break
        if header is None and data.startswith(_CSV_HEADER, at):
            header = parse_header(data[at + len(_CSV_HEADER) : end])
        else:
            comments += end + 1 - at
            if comments > limits.header:
                limits.check("header", comments, f"line {lines}: the comments up to here are of")
        at = min(end + 1, len(data))
    limits.check("header", end - at, f"line {lines}: the column names are of")
    return header, data[at:end], lines, data[end + 1 :]


def raw_log(frame: polars.DataFrame, header: Header, first_line: int | None = None) -> RawLog:
    """The columns of a frame as numbers; what holds none is skipped, for it may not be needed."""
    columns: dict[str, FloatArray] = {}
    skipped: dict[str, str] = {}
    for series in frame.get_columns():
        name = series.name
        try:
            columns[name] = numbers(name, series, first_line)
        except InputError as error:
            skipped[name] = str(error)
    return RawLog(columns, header, skipped=skipped)


def _column_names(line: bytes, exact: bool) -> list[str]:
    """The names of the columns; those of other programs may be padded with spaces."""
    limits = Limits.current()
    limits.check("columns", line.count(b",") + 1, "the log has")
    try:
        rows = list(csv.reader([line.decode().rstrip("\r")], strict=True))
    except (UnicodeDecodeError, csv.Error) as error:
        raise FileError(f"the column names cannot be read ({error}); write UTF-8") from error
    names = rows[0] if rows else []
    if not names:
        raise LogError("no column names; expected 'time,q.<coordinate>,…,u.<speed>,…'")
    if len(names) == 1 and (";" in names[0] or "\t" in names[0]):
        raise LogError(
            f"the column names {shown(names[0])} are not separated by commas; write the log with "
            "commas between columns and points in numbers"
        )
    if not exact:
        names = [name.strip() for name in names]
    return distinct(names)


def distinct(names: list[str]) -> list[str]:
    """The names of columns; InputError for one that stands there twice, or is too long."""
    limits = Limits.current()
    seen: set[str] = set()
    for name in names:
        if len(name) > limits.name:
            limits.check("name", len(name), f"the name of column {shown(name)} has")
        if name in seen:
            raise LogError(f"the column {name!r} appears twice; rename or remove one")
        seen.add(name)
    return names


def _malformed(body: bytes, width: int, lines: int, error: Exception) -> InputError:
    """What is wrong with a body that polars refuses with `error`, and on which line."""
    try:
        text = body.decode()
    except UnicodeDecodeError as undecodable:
        line = lines + 1 + body.count(b"\n", 0, undecodable.start)
        return FileError(f"line {line} is not UTF-8 text; expected numbers")
    reader = csv.reader(io.StringIO(text), strict=True)
    try:
        for fields in reader:
            if len(fields) != width:
                return LogError(
                    f"line {lines + reader.line_num} has {len(fields)} fields, expected {width}, "
                    "one for each column name. Write numbers with decimal points, not commas."
                )
    except csv.Error as stray:
        return LogError(f"line {lines + reader.line_num} cannot be taken apart: {stray}")
    return LogError(f"the rows cannot be taken apart: {error}")


def numbers(name: str, series: polars.Series, first_line: int | None = None) -> FloatArray:
    """A column as float64; InputError names the first row that holds no number."""
    import polars

    if series.dtype == polars.String:
        long = series.str.len_bytes() > Limits.current().name
        if long.any():
            row = long.arg_max() or 0
            raise LogError(
                f"column {name!r}, {row_name(row, len(series))}: found a text of "
                f"{len(series[row])} characters, expected a number"
            )
        numbers = series.cast(polars.Float64, strict=False)
        if numbers.null_count():  # padded with spaces, perhaps; stripping is slow
            numbers = series.str.strip_chars().cast(polars.Float64, strict=False)
    elif series.dtype.is_numeric() or series.dtype == polars.Null:
        numbers = series.cast(polars.Float64)
    else:
        raise WrongType(
            f"column {name!r}: found values of type {series.dtype}, expected numbers in SI units "
            "(times in seconds)"
        )
    if numbers.null_count():
        row = numbers.is_null().arg_max() or 0
        found = "nothing" if series[row] is None else shown(series[row])
        where = row_name(row, len(series))
        if first_line is not None:
            where += f", line {first_line + row}"
        raise LogError(
            f"column {name!r}, {where}: found {found}, expected a number. Repair or drop the row."
        )
    result: FloatArray = numbers.to_numpy()
    return result
