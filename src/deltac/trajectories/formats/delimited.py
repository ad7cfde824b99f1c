"""CSV logs: the header of the schema is in the first line, ``# deltac {json}``.

Other lines that start with ``#`` before the column names are comments. Numbers are written so that
they read back bitwise. Tables of other programs are read in the forms that spreadsheets, NumPy, pandas and
measuring programs write, see `read_csv`.
"""

from __future__ import annotations

import codecs
import contextlib
import csv
import io
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from deltac.arrays import Array
from deltac.errors import FileError, InputError, LogError, WrongType, shown
from deltac.foreign.files import read_bytes
from deltac.foreign.limits import Limits, require_memory
from deltac.trajectories.formats.arrangement import arranged
from deltac.trajectories.formats.raw import (
    Budget,
    Collector,
    Header,
    RawLog,
    is_unit,
    parse_header,
    seconds_of,
)
from deltac.trajectories.formats.units import unit
from deltac.trajectories.trajectory import Trajectory, row_name

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
    """Every column, as numbers.

    Of other programs' tables commas, semicolons, tabs and blanks separate columns, decimals may have
    commas, and text may stand before the table; names may take several lines, of which the last may hold
    units.
    """
    data = _in_utf8(read_bytes(path))
    if b"\r" in data and b"\n" not in data:  # as of old on the Macintosh
        data = data.replace(b"\r", b"\n")
    own = data.removeprefix(_BYTE_ORDER_MARK).startswith(_CSV_HEADER)
    table = None if own else _foreign(data)
    if table is None:
        header, line, lines, rest = _head(data)
        names = _column_names(line, exact=header is not None)
        table = _Table(names, {}, lines, rest, Dialect())
    else:
        header = None
    frame = table_of_numbers(table.rest, table.dialect, table.names, table.lines)
    log = raw_log(frame, header, table.lines + 1)
    return replace(log, units={**table.units, **log.units})


def table_of_numbers(
    rest: bytes, dialect: Dialect, names: list[str], lines: int
) -> polars.DataFrame:
    """The fields of a table's rows, which stand after so many `lines`, as texts.

    Only so can a bad one be named with its row. Blanks separate columns together.
    """
    if not rest or rest.isspace():
        raise LogError("there are column names but no rows; expected at least one")
    import polars

    size, separator = len(rest), dialect.separator
    if separator == " ":
        rest = b"\n".join(_BLANKS.sub(b"\t", line.strip()) for line in rest.splitlines()).rstrip()
        separator = "\t"
    rows = rest.count(b"\n") + 1
    Limits.current().check("rows", rows, "the log has")
    Budget(size).take(rows * len(names) * 8)  # a short row has empty fields, also of numbers
    require_memory(rows * len(names) * 32.0, f"{rows} rows and {len(names)} columns")
    keys = [str(index) for index in range(len(names))]
    try:
        frame = polars.read_csv(
            rest,
            has_header=False,
            infer_schema=False,
            separator=separator,
            schema=dict.fromkeys(keys, polars.String),
        )
    except _polars_errors() as error:
        raise _malformed(rest, len(names), lines, separator, error) from error
    frame.columns = names
    if dialect.decimal == ",":
        frame = frame.with_columns(polars.all().str.replace_all(",", ".", literal=True))
    return frame


def _polars_errors() -> tuple[type[BaseException], ...]:
    import polars

    return polars.exceptions.PolarsError, polars.exceptions.PanicException


# --- tables of other programs ------------------------------------------------------------------


SEPARATORS = (",", ";", "\t", "|", " ")


@dataclass(frozen=True)
class Dialect:
    """What separates the columns of a table, and marks the decimals of its numbers."""

    separator: str = ","
    decimal: str = "."

    def fields(self, line: str) -> list[str]:
        """The fields of a line, without blanks around them; none where quotes are out of place."""
        if self.separator == " ":
            return [a or b for a, b in re.findall(r'"([^"]*)"|(\S+)', line)]
        try:
            row = next(csv.reader([line.rstrip("\r\n")], delimiter=self.separator), [])
        except csv.Error:
            return []
        return [field.strip() for field in row]

    def numbers(self, fields: Sequence[str]) -> int:
        """How many of the fields are numbers; 0 where these are less than half, so that it is no row."""
        if any(field in SEPARATORS for field in fields):
            return 0
        pattern = _NUMBERS[self.decimal]
        count = sum(pattern.fullmatch(field) is not None for field in fields)
        return count if 2 * count >= sum(map(bool, fields)) else 0


_NUMBERS = {
    mark: re.compile(
        rf"[-+]?(\d+([{mark}]\d*)?|[{mark}]\d+)([ed][-+]?\d+)?|[-+]?(inf|nan)", re.IGNORECASE
    )
    for mark in ".,"
}
DIALECTS = tuple(Dialect(separator, decimal) for decimal in ".," for separator in SEPARATORS)


@dataclass(frozen=True)
class _Table:
    """A table: names and units of its columns, how many lines come before its rows, and these."""

    names: list[str]
    units: dict[str, str]
    lines: int
    rest: bytes
    dialect: Dialect


_LOOKED_AT = 2**18
"""Bytes at the start of a table in which its form is looked for."""
_MOST_HEADERS = 4
_BLANKS = re.compile(rb"[ \t]+")
_COMMENTS = re.compile(rb"^[ \t]*(#|%|//)", re.MULTILINE)


def _in_utf8(data: bytes) -> bytes:
    """The text in UTF-8: spreadsheets also write UTF-16 and Windows' own encodings of one byte."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        try:
            return data.decode("utf-16").encode()
        except UnicodeDecodeError as error:
            raise FileError(
                f"the text is not UTF-16, contrary to its first bytes ({error})"
            ) from error
    head = data[:_LOOKED_AT]
    try:
        head.decode()
    except UnicodeDecodeError as error:
        if error.start < len(head) - 3 and b"\0" not in head:
            start = head.find(b"\n", error.start)
            if start >= 0 and data[start:].isascii():  # in names and units only
                with contextlib.suppress(UnicodeDecodeError):
                    text = data[:start].decode("cp1252")
                    if all(c.isprintable() or c.isspace() for c in text):
                        return text.encode() + data[start:]
    return data


def _foreign(data: bytes) -> _Table | None:
    """The table of another program; None where its first lines show none, so that the usual one is read."""
    text = data.removeprefix(_BYTE_ORDER_MARK)[:_LOOKED_AT]
    if len(text) == _LOOKED_AT:
        text = text[: text.rfind(b"\n") + 1]
    try:
        lines = text.decode().splitlines(keepends=True)
    except UnicodeDecodeError:
        return None
    shape = _shape(lines)
    if shape is None:
        return None
    dialect, width = shape
    split = [dialect.fields(line) for line in lines]
    first = next(k for k, row in enumerate(split) if len(row) == width and dialect.numbers(row))
    headers: list[list[str]] = []
    k = first - 1
    short = not split[first][-1]  # rows that end with a separator which the names lack
    while k >= 0 and len(headers) < _MOST_HEADERS:
        fields = split[k]
        if len(fields) != width:  # names may be separated otherwise than numbers
            ways = (other.fields(lines[k]) for other in DIALECTS)
            fields = next((way for way in ways if len(way) == width), fields)
        if len(fields) == width + 1 and fields[-1] == "Comment":  # LabVIEW's, which rows leave out
            fields = fields[:-1]
        wide = len(fields) == width or (short and len(fields) == width - 1)
        if not wide or any(map(_is_number, fields)) or _comment(lines[k]):
            break
        headers.insert(0, fields + [""] * (width - len(fields)))
        k -= 1
    if not headers and first and lines[first - 1].strip() and not _comment(lines[first - 1]):
        names = dialect.fields(lines[first - 1])  # of another number than the rows have fields
        headers = [names if len(names) > 1 else _fields_of_any(lines[first - 1])]
    if not headers:
        headers = _in_comments(lines[:first], dialect, width)
    names, units = _names_and_units(headers, len(headers[0]) if headers else width)
    start = len("".join(lines[:first]).encode())
    rest = data.removeprefix(_BYTE_ORDER_MARK)[start:]
    head = lines[first - 1].strip().encode() if first else b""
    if (head and head in rest) or _COMMENTS.search(
        rest
    ):  # names said again, remarks among the rows
        rows = (row for row in rest.split(b"\n") if row.strip() != head or not head)
        rest = b"\n".join(row for row in rows if not _COMMENTS.match(row))
    Limits.current().check("columns", width, "the log has")
    Limits.current().check("header", start, f"line {first + 1}: the lines before the rows are of")
    return _Table(distinct(names), units, first, rest.rstrip(), dialect)


def _shape(lines: Sequence[str]) -> tuple[Dialect, int] | None:
    """The dialect that explains the lines best, and its number of columns.

    That is the one with most numbers, less what it leaves beside them: split at its decimal commas,
    ``0,01;57,25`` would be two numbers and a rest.
    """
    best: tuple[int, int, int] = (0, 0, 0)
    shape = None
    lines = [line for line in lines if not _comment(line)]
    for k, dialect in enumerate(DIALECTS):
        widths, surplus = Counter[int](), Counter[int]()
        for fields in map(dialect.fields, lines):
            if len(fields) > 1 and (count := dialect.numbers(fields)):
                widths[len(fields)] += 1
                surplus[len(fields)] += 2 * count - sum(map(bool, fields))
        if widths:
            width, rows = widths.most_common(1)[0]
            if (score := (surplus[width], rows, -k)) > best or shape is None:
                best, shape = score, (dialect, width)
    return shape


_FORTRAN = re.compile(r"(\d\.\d*)[dD]([+-]\d)")
"""The exponent of a number in double precision, as Fortran writes it: 1.5D-03."""


def _fields_of_any(line: str) -> list[str]:
    """The fields of a line by the separator that makes most."""
    return max((dialect.fields(line) for dialect in DIALECTS), key=len)


def _is_number(text: str) -> bool:
    return any(pattern.fullmatch(text) for pattern in _NUMBERS.values())


def _comment(line: str) -> bool:
    return line.lstrip().startswith(("#", "%", "//"))


def _in_comments(lines: Sequence[str], dialect: Dialect, width: int) -> list[list[str]]:
    """Names in the last comment before the rows, as `numpy.savetxt` writes them, if there are as many."""
    for line in reversed(lines):
        text = line.strip().lstrip("#%/").strip()
        if not text:
            continue
        for candidate in (dialect, *DIALECTS):
            fields = candidate.fields(text)
            if len(fields) == width and not any(map(_is_number, fields)):
                return [fields]
        break
    return []


def _names_and_units(headers: list[list[str]], width: int) -> tuple[list[str], dict[str, str]]:
    """Names from one line or several (joined by dots), and units where the last line holds such."""
    units = [""] * width
    for row in [row for row in headers[1:] if _declares(row)]:  # Simulink's Data Inspector
        headers.remove(row)
        if any(cell.lower().startswith("unit") for cell in row):
            units = [cell.partition(":")[2].strip() for cell in row]
    if len(headers) > 1 and _all_units(headers[-1]):
        units = [text.strip("[]()") for text in headers.pop()]
    index = ""
    if (
        len(headers) > 1 and headers[-1][0] and not any(headers[-1][1:])
    ):  # pandas names the index so
        index = headers.pop()[0]
    for upper in headers[:-1]:  # merged cells stand in the first column
        for k in range(1, width):
            upper[k] = upper[k] or (upper[k - 1] if headers[-1][k] else "")
    names = []
    for k in range(width):
        parts = dict.fromkeys(row[k] for row in headers if row[k] and row[k] != "Unnamed")
        names.append(".".join(parts) or f"column {k + 1}")
    if index:
        names[0] = index
    return names, {name: unit for name, unit in zip(names, units) if unit and unit != "-"}


def _declares(fields: Sequence[str]) -> bool:
    """Whether a line says the same of all columns: ``Unit: rad,Unit: rad/s``."""
    heads = {field.partition(": ")[0] for field in fields if field}
    return len(heads) == 1 and sum(": " in field for field in fields) > 1


def _all_units(fields: Sequence[str]) -> bool:
    texts = [field.strip("[]() ") for field in fields if field not in ("", "-")]
    for text in texts:
        try:
            unit(text)
        except InputError:
            return False
    return bool(texts)


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
    """The columns of a frame as numbers; what holds none is skipped, for it may not be needed.

    In other programs' tables, times may be texts or whole numbers since 1970, and values missing (NaN).
    """
    import polars

    columns: dict[str, Array] = {}
    skipped: dict[str, str] = {}
    units: dict[str, str] = {}
    for series in (frame if header is not None else arranged(frame)).get_columns():
        name = series.name
        seconds = None if header is not None else _instants(series)
        if seconds is not None:
            columns[name], units[name] = seconds, "s"
            continue
        try:
            columns[name] = numbers(name, series, first_line, missing=header is None)
        except InputError as error:
            skipped[name] = str(error)
    declared: dict[str, str] = {}
    if header is None:
        collector = Collector()
        for (
            series
        ) in frame.get_columns():  # before they are arranged, which drops what never changes
            if is_unit(series.name) and series.dtype == polars.String:
                texts = series.drop_nulls().str.strip_chars().unique(maintain_order=True)
                if texts.cast(polars.Float64, strict=False).is_null().all():
                    collector.add(series.name, texts.to_list())
        declared = collector.declare(columns, units)
    return RawLog(columns, header, skipped=skipped, units=units, declared=declared)


def _instants(series: polars.Series) -> Array | None:
    """Dates, durations and whole numbers since 1970, as seconds since the first; None for anything else."""
    import polars

    if series.dtype == polars.String:
        first = str(series[0]).strip()
        with contextlib.suppress(*_polars_errors()):
            if _DATE.match(first):
                series = series.str.to_datetime(time_unit="ns", strict=True)
            elif _DAY.match(first):
                texts = series.str.strip_chars().str.replace(",", ".", literal=True)
                forms = [
                    texts.str.to_datetime(f"{day} %H:%M:%S%.f", time_unit="ns", strict=False)
                    for day in _DAYS
                ]
                whole = [form for form in forms if not form.null_count()]
                # 3/4 may be of March or of April: the day that changes least with the rows is right.
                series = min(whole, key=lambda form: form.max() - form.min(), default=series)  # type: ignore[operator]
            elif _CLOCK.fullmatch(first):
                parts = series.str.strip_chars().str.split(":").list
                each = [parts.get(k).cast(polars.Float64) for k in (0, 1, 2)]
                return _array(each[0] * 3600.0 + each[1] * 60.0 + each[2])
            elif duration := _DURATION.fullmatch(first):
                values = series.str.strip_chars().str.strip_suffix(duration[2]).str.strip_chars()
                return _array(values.cast(polars.Float64)) * unit(duration[2]).factor
            elif _STAMP.fullmatch(first):
                series = series.str.strip_chars().cast(polars.Int64)
    if series.dtype.is_integer() and not series.null_count():
        return seconds_of(series.to_numpy())
    if not isinstance(series.dtype, polars.Datetime | polars.Duration) or series.null_count():
        return None
    since = (series - series[0]).dt.total_nanoseconds()
    return _array(since.cast(polars.Float64)) / 1e9


def _array(series: polars.Series) -> Array:
    values: Array = series.to_numpy()
    return values


_DATE = re.compile(r"\s*\d{4}-\d\d-\d\d[T ]\d\d:\d\d")
_DAY = re.compile(r"\s*(\d{4}[/.]\d\d?[/.]\d\d?|\d\d?[/.-]\d\d?[/.-]\d{4})[T ]+\d\d?:\d\d:\d\d")
_DAYS = ("%Y/%m/%d", "%Y.%m.%d", "%d.%m.%Y", "%d/%m/%Y", "%m/%d/%Y", "%d-%m-%Y", "%m-%d-%Y")
_CLOCK = re.compile(r"\d+:\d\d:\d\d(\.\d*)?")
_DURATION = re.compile(r"([-+.\de]*\d) *(s|sec|ms|us|ns|min)")  # as MATLAB writes durations
_STAMP = re.compile(r"\d{12,19}")


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
    if not exact:
        names = [name.strip() for name in names]
    return distinct(names)


def distinct(names: list[str]) -> list[str]:
    """The names of columns; InputError for one that stands there twice, or is too long."""
    limits = Limits.current()
    names_so_far: set[str] = set()
    for name in names:
        if len(name) > limits.name:
            limits.check("name", len(name), f"the name of column {shown(name)} has")
        if name in names_so_far:
            raise LogError(f"the column {name!r} appears twice; rename or remove one")
        names_so_far.add(name)
    return names


def _malformed(
    body: bytes, width: int, lines: int, separator: str, error: BaseException
) -> InputError:
    """What is wrong with a body that polars refuses with `error`, and on which line."""
    try:
        text = body.decode()
    except UnicodeDecodeError as undecodable:
        line = lines + 1 + body.count(b"\n", 0, undecodable.start)
        return FileError(f"line {line} is not UTF-8 text; expected numbers")
    hint = ". Write numbers with decimal points, not commas." if separator == "," else ""
    reader = csv.reader(io.StringIO(text), strict=True, delimiter=separator)
    try:
        for fields in reader:
            if len(fields) != width:
                return LogError(
                    f"line {lines + reader.line_num} has {len(fields)} fields, expected {width}, "
                    f"one for each column name{hint}"
                )
    except csv.Error as stray:
        return LogError(f"line {lines + reader.line_num} cannot be taken apart: {stray}")
    return LogError(f"the rows cannot be taken apart: {error}")


_MISSING = ("", "nan", "na", "n/a", "null", "none", "-", "--")
"""How tables say, in any case, that a value is missing."""


def numbers(
    name: str, series: polars.Series, first_line: int | None = None, *, missing: bool = False
) -> Array:
    """A column as float64; InputError names the first row that holds no number.

    Where values may be `missing`, they are NaN, but not up to the end.
    """
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
        if numbers.null_count():  # padded with spaces, or by Fortran, perhaps; this is slow
            texts = series.str.strip_chars().str.replace(_FORTRAN.pattern, "${1}e${2}")
            numbers = texts.cast(polars.Float64, strict=False)
    elif series.dtype.is_numeric() or series.dtype == polars.Null:
        numbers = series.cast(polars.Float64)
    else:
        raise WrongType(
            f"column {name!r}: found values of type {series.dtype}, expected numbers in SI units "
            "(times in seconds)"
        )
    if missing and numbers.null_count() and numbers[-1] is not None:
        empty = series.is_null()
        if series.dtype == polars.String:
            texts = series.str.strip_chars().str.to_lowercase()
            empty = empty | texts.is_in(list(_MISSING)).fill_null(True)
        if (empty | numbers.is_not_null()).all():
            numbers = numbers.fill_null(float("nan"))
    if numbers.null_count():
        row = numbers.is_null().arg_max() or 0
        value = "nothing" if series[row] is None else shown(series[row])
        where = row_name(row, len(series))
        if first_line is not None:
            where += f", line {first_line + row}"
        raise LogError(
            f"column {name!r}, {where}: found {value}, expected a number. Repair or drop the row."
        )
    result: Array = numbers.to_numpy()
    return result
