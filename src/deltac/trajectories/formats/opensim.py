"""OpenSim's motions and storages, .mot and .sto: a header, ``endheader``, a table by tabs.

Columns of states, ``/jointset/<joint>/<coordinate>/value`` and ``/speed`` (in older files
``<coordinate>`` and ``<coordinate>_u``), are read as coordinates and speeds; in a motion a plain
column is a coordinate if the mechanism has one of that name. ``inDegrees=yes`` speaks of the
rotational coordinates alone, so that their units must be known from a mechanism or a mapping.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from deltac.errors import InputError
from deltac.trajectories.formats.raw import RawLog
from deltac.trajectories.trajectory import FloatArray, row_name

_ROWS, _COLUMNS = ("nRows", "datarows"), ("nColumns", "datacolumns")
_NEWEST = 3
_STATE = {"value": "q", "speed": "u"}


def read_opensim(path: Path) -> RawLog:
    """The columns of the table, and what the header says of them."""
    try:
        lines = path.read_text("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise InputError("the file is not UTF-8 text; expected an OpenSim table") from error
    end = next((i for i, line in enumerate(lines) if line.strip().lower() == "endheader"), None)
    if end is None:
        raise InputError("no line 'endheader'; this is no OpenSim table, or it is truncated")
    header = dict(_entry(line) for line in lines[:end] if "=" in line)
    _check_kind(header)
    first = next((i for i in range(end + 1, len(lines)) if lines[i].strip()), None)
    if first is None:
        raise InputError("no column names after 'endheader'; the file is truncated")
    names = [name.strip() for name in lines[first].split("\t" if "\t" in lines[first] else None)]
    repeated = next((name for i, name in enumerate(names) if name in names[:i]), None)
    if repeated is not None:
        raise InputError(f"the column {repeated!r} appears twice; rename or remove one")
    table = _table(lines, first + 1, len(names))
    for keys, found, what in ((_ROWS, len(table), "rows"), (_COLUMNS, len(names), "columns")):
        _check_count(header, keys, found, what)
    columns = {name: table[:, index] for index, name in enumerate(names)}
    return RawLog(
        columns, meanings=_meanings(names), plain_names=True, in_degrees=_in_degrees(header)
    )


def _entry(line: str) -> tuple[str, str]:
    key, _, value = line.partition("=")
    return key.strip(), value.strip()


def _check_kind(header: dict[str, str]) -> None:
    kind = header.get("DataType", "double")
    if kind != "double":
        raise InputError(
            f"DataType={kind}: expected double. Vectors and rotations of markers or frames are no "
            "generalized coordinates; export the states or the coordinates of the motion"
        )
    version = header.get("version", "1")
    if not version.isdigit() or int(version) > _NEWEST:
        raise InputError(f"version={version}: this deltac reads OpenSim tables up to {_NEWEST}")


def _in_degrees(header: dict[str, str]) -> bool:
    value = header.get("inDegrees", "no").lower()
    if value not in ("yes", "no"):
        raise InputError(f"inDegrees={value}: expected yes or no")
    return value == "yes"


def _check_count(header: dict[str, str], keys: tuple[str, ...], found: int, what: str) -> None:
    for key in keys:
        if key in header and header[key] != str(found):
            raise InputError(
                f"the table has {found} {what}, the header says {key}={header[key]}: the file is cut "
                "off or was edited. Take the complete one, or correct the header."
            )


def _table(lines: list[str], start: int, width: int) -> FloatArray:
    rows = [(number, line.split()) for number, line in enumerate(lines[start:], start + 1) if line]
    rows = [(number, fields) for number, fields in rows if fields]
    if not rows:
        raise InputError("there are column names but no rows; expected at least one")
    for index, (number, fields) in enumerate(rows):
        if len(fields) != width:
            raise InputError(f"line {number} has {len(fields)} fields, expected {width}")
        try:
            fields[:] = map(float, fields)  # type: ignore[arg-type]
        except ValueError:
            bad = next(field for field in fields if not _is_number(field))
            raise InputError(
                f"{row_name(index, len(rows))}, line {number}: found {bad!r}, expected a number"
            ) from None
    return np.array([fields for _, fields in rows], dtype=np.float64)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _meanings(names: list[str]) -> dict[str, str]:
    """What OpenSim's conventions say: paths of states, and ``_u`` beside a coordinate."""
    meanings = {}
    for name in names:
        path = name.strip("/").split("/")
        if name.startswith("/jointset/") and len(path) == 4 and path[-1] in _STATE:
            meanings[name] = f"{_STATE[path[-1]]}.{path[-2]}"
        elif name.endswith("_u") and (base := name.removesuffix("_u")) in names:
            meanings[name], meanings[base] = f"u.{base}", f"q.{base}"
    return meanings
