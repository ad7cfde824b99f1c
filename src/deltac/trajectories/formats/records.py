"""JSON logs: an object of arrays, a list of records, or a record a line (.jsonl, .ndjson).

Objects in objects are joined by dots, ``joints.elbow.angle``; a list of numbers in a record is an array of
that name. JSON's NaN and Infinity, which are none, are refused.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from deltac.errors import FileError, InputError, LogError, shown
from deltac.foreign.files import read_bytes
from deltac.foreign.limits import Limits, parse_json
from deltac.trajectories.formats.arrangement import STAMPS
from deltac.trajectories.formats.raw import Collector, RawLog, entries, is_unit


def read_json(path: Path) -> RawLog:
    """The columns of an object of arrays, or of a list of records."""
    value = parse_json(read_bytes(path, "metadata"), "the log")
    if isinstance(value, Mapping):
        rows = next((v for v in value.values() if _records(v)), None)
        if rows is not None and not any(
            isinstance(v, list) and not _records(v) for v in value.values()
        ):
            units = {k: v for k, v in entries(value) if is_unit(k)}
            return _of_records(rows, units)
        return _of_object({name: _listed(item) for name, item in value.items()})
    if _records(value):
        return _of_records(value)
    raise LogError(
        f'the JSON is {shown(value)}, expected an object of arrays, {{"time": […], "q": [[…], …]}}, or a '
        "list of records"
    )


def read_json_lines(path: Path) -> RawLog:
    """The columns of records, one a line."""
    records = []
    for number, line in enumerate(read_bytes(path).split(b"\n"), 1):
        if line.strip():
            try:
                records.append(parse_json(line, "the record"))
            except InputError as error:
                raise FileError(f"line {number}: {error}") from None
            Limits.current().check("rows", len(records), "the log has")
    if not _records(records):
        raise LogError('expected one JSON object per line, such as {"time": 0.0, "q": [0.1, 0.2]}')
    return _of_records(records)


def _of_object(value: Mapping[str, Any]) -> RawLog:
    collector = Collector()
    collector.add_all({k: np.asarray(v) if _is_table(v) else v for k, v in entries(value)})
    return collector.log()


def _is_table(value: Any) -> bool:
    """Whether this is a list of equally long lists of numbers."""
    return (
        isinstance(value, list)
        and all(isinstance(row, list) and len(row) == len(value[0]) for row in value)
        and all(isinstance(x, int | float) for row in value for x in row)
    )


def _listed(value: Any) -> Any:
    """The values of an object whose keys are the numbers of rows, as pandas writes a column by default."""
    if isinstance(value, Mapping) and value and all(key.isdecimal() for key in value):
        return list(value.values())
    return value


def _records(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(v, Mapping) for v in value)


def _of_records(
    records: list[Mapping[str, Any]], extra: Mapping[str, Any] = MappingProxyType({})
) -> RawLog:
    collector = Collector()
    columns: dict[str, list[Any]] = {}
    for row, record in enumerate(records):
        for name, item in entries(record):
            column = columns.setdefault(name, [])
            if len(column) == row:  # else it was missing in a record before
                column.append(item)
    for whole, part in STAMPS:
        for name in [name for name in columns if name.rpartition(".")[2] == whole]:
            before = name.removesuffix(whole)
            pairs = list(zip(columns[name], columns.get(before + part, ())))
            if pairs and len(pairs) == len(columns[name]) and all(map(_is_stamp, pairs)):
                del columns[name], columns[before + part]
                columns = {f"{before}stamp": _seconds(pairs), **columns}
    # Names, the same in each record; numbers that never change are a column like any other.
    alike = {
        name: v[0] for name, v in columns.items() if v and _is_names(v[0]) and v == v[:1] * len(v)
    }
    tables = {name: np.asarray(v) for name, v in columns.items() if _is_table(v)}
    for name in [name for name, values in columns.items() if len(values) < len(records)]:
        row = len(columns.pop(name))
        collector.skip(name, f"is missing in record {row} (of 0 to {len(records) - 1})")
        tables.pop(name, None)
    collector.add_all({**columns, **tables, **alike, **extra})
    return collector.log()


def _is_stamp(pair: tuple[Any, Any]) -> bool:
    return all(isinstance(x, int | float) and not isinstance(x, bool) for x in pair)


def _is_names(value: Any) -> bool:
    return (
        isinstance(value, list) and bool(value) and all(isinstance(entry, str) for entry in value)
    )


def _seconds(pairs: Sequence[tuple[Any, Any]]) -> list[float]:
    """Whole seconds and nanoseconds as seconds since the first."""
    first = pairs[0][0]
    return [float(whole - first) + 1e-9 * float(part) for whole, part in pairs]
