"""OpenSim's motions and storages, .mot and .sto: a header, ``endheader``, a table by tabs.

Columns of states, ``/jointset/<joint>/<coordinate>/value`` and ``/speed`` (in older files
``<coordinate>`` and ``<coordinate>_u``), are read as coordinates and speeds; in a motion a plain
column is a coordinate if the mechanism has one of that name. ``inDegrees=yes`` speaks of the
rotational coordinates alone, so that their units must be known from a mechanism or a mapping.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from deltac.errors import FileError, LogError
from deltac.foreign.files import read_bytes
from deltac.foreign.limits import Limits
from deltac.trajectories.formats.delimited import Dialect, distinct, numbers, table_of_numbers
from deltac.trajectories.formats.raw import RawLog

_ROWS, _HEADER_COUNTS = ("nRows", "datarows"), ("nColumns", "datacolumns")
_NEWEST = 3
_END = re.compile(rb"^[ \t]*endheader[ \t\r]*$", re.IGNORECASE | re.MULTILINE)
_STATE = {"value": "q", "speed": "u"}


def read_opensim(path: Path) -> RawLog:
    """The columns of the table, and what the header says of them."""
    content = read_bytes(path)
    end = _header_lines(content)
    try:
        lines = content.decode("utf-8-sig").split("\n")
    except UnicodeDecodeError as error:
        raise FileError("the file is not UTF-8 text; expected an OpenSim table") from error
    header = dict(_entry(line) for line in lines[:end] if "=" in line)
    _check_kind(header)
    first = next((i for i in range(end + 1, len(lines)) if lines[i].strip()), None)
    if first is None:
        raise FileError("no column names after 'endheader'; the file is truncated")
    limits = Limits.current()
    limits.check("header", len(lines[first]), f"line {first + 1}: the column names are of")
    names = [name.strip() for name in lines[first].split("\t" if "\t" in lines[first] else None)]
    limits.check("columns", len(names), "the log has")
    distinct(names)
    rest = "\n".join(lines[first + 1 :]).encode()
    frame = table_of_numbers(rest, Dialect(" "), names, first + 1)
    for keys, count, what in (
        (_ROWS, frame.height, "rows"),
        (_HEADER_COUNTS, len(names), "columns"),
    ):
        _check_count(header, keys, count, what)
    columns = {s.name: numbers(s.name, s, first + 2) for s in frame.get_columns()}
    return RawLog(
        columns, meanings=_meanings(names), plain_names=True, in_degrees=_in_degrees(header)
    )


def is_opensim_folder(path: Path) -> bool:
    """Whether a folder holds the files of one run: one of its motion, others of what belongs to it."""
    return os.path.isdir(path) and len(parts := _parts(path)) > 1 and len(_motions(parts)) == 1


def read_opensim_folder(path: Path) -> RawLog:
    """The files of one run of OpenSim: states, or the kinematics of an analysis, beside forces and controls.

    Columns of the kinematics are coordinates, speeds and accelerations by their file; those of other files
    are ``<file>/<column>``, and must be at the times of the motion.
    """
    parts = _parts(path)
    motion = _motions(parts)[0]
    log = read_opensim(parts[motion])
    time = log.columns["time"]
    columns, meanings, skipped = dict(log.columns), dict(log.meanings), dict(log.skipped)
    if kind := _KINEMATICS.get(motion):
        meanings |= {name: f"{kind}.{name}" for name in columns if name != "time"}
    for ending, file in parts.items():
        kind = _KINEMATICS.get(ending)
        if ending == motion or (kind and motion not in _KINEMATICS):
            continue  # the states say it as well
        try:
            part = read_opensim(file)
        except LogError as error:  # the controls of a model without actuators have no rows
            skipped[file.name] = f"{file.name!r}: {error}"
            continue
        if not np.array_equal(part.columns.get("time", []), time):
            skipped[file.name] = f"{file.name!r} has other times than {parts[motion].name!r}"
            continue
        for name, values in part.columns.items():
            if name != "time":
                columns[f"{ending}/{name}"] = values
                if kind:
                    meanings[f"{ending}/{name}"] = f"{kind}.{name}"
    return replace(log, columns=columns, meanings=meanings, skipped=skipped)


_KINEMATICS = {"kinematics_q": "q", "kinematics_u": "u", "kinematics_dudt": "udot"}
_ENDINGS = ("states", *_KINEMATICS, "controls", "actuation_force", "forces", "inverse_dynamics")
"""Endings of the names of files that the tools of OpenSim write of one run."""


def _parts(folder: Path) -> dict[str, Path]:
    """The files of a run by the endings of their names; none where two have the same."""
    parts: dict[str, Path] = {}
    for file in sorted(folder.iterdir()):
        stem = re.sub(r"[ -]", "_", file.stem.lower()).replace("forcereporter_", "")
        ending = next((e for e in _ENDINGS if stem == e or stem.endswith(f"_{e}")), None)
        if file.suffix.lower() in (".sto", ".mot") and ending:
            if ending in parts:
                return {}
            parts[ending] = file
    return parts


def _motions(parts: dict[str, Path]) -> Sequence[str]:
    return [ending for ending in ("states", "kinematics_q") if ending in parts][:1]


def _header_lines(content: bytes) -> int:
    """How many lines the header has; InputError for one beyond the limit, before all is taken apart."""
    limits = Limits.current()
    end = _END.search(content, 0, limits.header)
    if end is None:
        limits.check("header", len(content), "no line 'endheader' is found: the header is of")
        raise FileError("no line 'endheader'; this is not an OpenSim table, or it is truncated")
    return content.count(b"\n", 0, end.start())


def _entry(line: str) -> tuple[str, str]:
    key, _, value = line.partition("=")
    return key.strip(), value.strip()


def _check_kind(header: dict[str, str]) -> None:
    kind = header.get("DataType", "double")
    if kind != "double":
        raise LogError(
            f"DataType={kind[:80]}: expected double. Vectors and rotations of markers or frames are not "
            "generalized coordinates; export the states or the coordinates of the motion"
        )
    version = header.get("version", "1")
    if version not in map(str, range(_NEWEST + 1)):
        raise LogError(f"version={version[:80]}: this deltac reads OpenSim tables up to {_NEWEST}")


def _in_degrees(header: dict[str, str]) -> bool:
    value = header.get("inDegrees", "no").lower()
    if value not in ("yes", "no"):
        raise LogError(f"inDegrees={value[:80]}: expected yes or no")
    return value == "yes"


def _check_count(header: dict[str, str], keys: tuple[str, ...], count: int, what: str) -> None:
    for key in keys:
        if key in header and header[key] != str(count):
            raise FileError(
                f"the table has {count} {what}, the header says {key}={header[key][:80]}: the file is cut "
                "off or was edited. Take the complete one, or correct the header."
            )


def _meanings(names: list[str]) -> dict[str, str]:
    """What OpenSim's conventions say: paths of states, and ``_u`` beside a coordinate."""
    meanings, columns = {}, set(names)
    for name in names:
        path = name.strip("/").split("/")
        joint = path[1:] if name.startswith("/jointset/") else path  # version 4, and before
        if len(joint) == 3 and path[-1] in _STATE:
            meanings[name] = f"{_STATE[path[-1]]}.{path[-2]}"
        elif name.endswith("_u") and (base := name.removesuffix("_u")) in columns:
            meanings[name], meanings[base] = f"u.{base}", f"q.{base}"
    return meanings
