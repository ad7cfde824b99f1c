"""CSV logs: the header of the schema is in the first line, ``# deltac {json}``.

Other lines that start with ``#`` before the column names are comments. Numbers are written so that
they read back bitwise.
"""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from deltac.errors import InputError
from deltac.trajectories.formats.raw import Header, RawLog, parse_header
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

    data = path.read_bytes()
    header: Header = None
    line, lines, rest = b"#", 0, data.removeprefix(_BYTE_ORDER_MARK)
    while line.startswith(b"#"):
        line, _, rest = rest.partition(b"\n")
        lines += 1
        if header is None and line.startswith(_CSV_HEADER):
            header = parse_header(line.removeprefix(_CSV_HEADER))
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
    frame.columns = names
    return raw_log(frame, header, lines + 1)


def raw_log(frame: polars.DataFrame, header: Header, first_line: int | None = None) -> RawLog:
    """The columns of a frame as numbers; what holds none is skipped, for it may not be needed."""
    columns: dict[str, FloatArray] = {}
    skipped: dict[str, str] = {}
    for name in frame.columns:
        try:
            columns[name] = numbers(name, frame[name], first_line)
        except InputError as error:
            skipped[name] = str(error)
    return RawLog(columns, header, skipped=skipped)


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


def numbers(name: str, series: polars.Series, first_line: int | None = None) -> FloatArray:
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
