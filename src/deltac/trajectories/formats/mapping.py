"""The mapping file: which columns of another program's log are what, in TOML.

    [log]
    simulator = "Simscape"
    time = { column = "t", unit = "ms" }   # or { step = 0.02 }, s: rows that are equally far apart
    angles = ["elbow"]                     # which one-coordinate joints are angles, without a model

    [units]                                # where a column does not say otherwise
    angle = "deg"
    angular_speed = "rpm"

    [coordinates]
    elbow = "Elbow position"
    slide = { column = "x", unit = "mm", sign = -1, offset = 2.5 }
    table = { constant = 0.0 }

    [quaternions]
    base = { columns = ["a", "b", "c", "d"], order = "xyzw" }

    [speeds]
    elbow = { column = "Elbow speed", unit = "deg/s" }

    "base.vx" = { column = "v_b[0]", frame = "body" }   # components of a floating body's velocity

    [accelerations]

    [forces."actuator elbow"]              # a channel: the generalized force on each speed
    elbow = { column = "torque", unit = "N*mm" }

A number x of a column means sign·x + offset, in `unit`. What the mapping does not name keeps its
name if that is one of the log schema, and is ignored otherwise.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias

from deltac.errors import InputError, LogError, WrongType, closest, shown
from deltac.foreign.files import read_text
from deltac.foreign.limits import line_of, parse_toml
from deltac.mechanism.channels import ChannelName
from deltac.trajectories.columns import QUATERNION, MechanismNames
from deltac.trajectories.formats.meaning import Meaning
from deltac.trajectories.formats.units import unit

DIMENSIONS: Mapping[str, str] = {
    "time": "s",
    "length": "m",
    "angle": "rad",
    "speed": "m/s",
    "angular_speed": "rad/s",
    "acceleration": "m/s^2",
    "angular_acceleration": "rad/s^2",
    "force": "N",
    "torque": "N*m",
    "energy": "J",
}
"""Keys of the table ``[units]`` and the SI unit that each replaces."""

TABLES = {
    "q": "coordinates",
    "u": "speeds",
    "udot": "accelerations",
    "work": "works",
    "integral": "integrals",
}
"""Kind of a column -> the table of a mapping that holds it."""

_KNOWN = ("log", "units", "quaternions", "forces", *TABLES.values())
_SOURCE_KEYS = ("column", "constant", "step", "unit", "sign", "offset", "frame")
_COMPONENTS = ("world", "body")
_ORDERS = ("wxyz", "xyzw")
_BECAUSE = "the mapping says so"


@dataclass(frozen=True)
class LogMapping:
    """A mapping file as read: schema column -> source, default units, which names are angles."""

    sources: Mapping[str, Meaning]
    units: Mapping[str, str] = field(default_factory=dict)
    angles: tuple[str, ...] | None = None
    simulator: str = "unknown"
    where: str = "the mapping"

    def names(self, names: MechanismNames | None) -> MechanismNames | None:
        """The names with units: the mechanism's, or what `angles` says of the mapping's own."""
        if names is not None or self.angles is None:
            return names
        own = [key.removeprefix("q.") for key in self.sources if key.startswith("q.")]
        plain = [n for n in dict.fromkeys([*own, *self.angles]) if not n.endswith(QUATERNION)]
        units = {name: "rad" if name in self.angles else "m" for name in plain}
        return MechanismNames(units, {name: f"{u}/s" for name, u in units.items()})


def read_mapping(path: str | Path) -> LogMapping:
    """Read a mapping file; InputError names the file, the line and the key."""
    if not os.path.exists(path):
        raise LogError(f"{path}: no such mapping file")
    try:
        text = read_text(path)
        document = parse_toml(text)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return _Parser(document, str(path), text).mapping()


MappingLike: TypeAlias = LogMapping | str | Path | None
"""What every verb takes for the mapping of a log's columns: see `as_mapping`."""


def as_mapping(mapping: MappingLike) -> LogMapping | None:
    """A mapping from its file, or as it is."""
    if isinstance(mapping, str | Path):
        return read_mapping(mapping)
    if mapping is not None and not isinstance(mapping, LogMapping):
        raise WrongType(
            f"mapping: found {type(mapping).__name__}, expected a LogMapping or the path of a TOML file. The "
            "order of arguments is read_trajectory(log, mapping, mechanism)"
        )
    return mapping


def with_step(mapping: MappingLike, step: float) -> LogMapping:
    """The mapping, or none, for rows that are `step` (s) apart whatever times the log has.

    Raises InputError for a step that is not positive and finite.
    """
    if not 0.0 < step < math.inf:
        raise InputError(
            f"step is {step!r}; expected the time from row to row, a positive number of seconds"
        )
    columns = as_mapping(mapping) or LogMapping({}, where="the step")
    clock = Meaning("time", "", "the step between rows is given", step=step, where="the step")
    return replace(columns, sources={**columns.sources, "time": clock})


@dataclass(frozen=True)
class _Parser:
    document: Mapping[str, Any]
    path: str
    text: str

    def mapping(self) -> LogMapping:
        for key in self.document:
            if key not in _KNOWN:
                raise self.error(key, f"unknown table{closest(key, _KNOWN)}")
        log = self.table("log")
        for key in log:
            if key not in (keys := ("simulator", "time", "angles")):
                raise self.error(f"log.{key}", f"unknown key{closest(key, keys)}")
        simulator = log.get("simulator", "unknown")
        if not isinstance(simulator, str) or not simulator:
            raise self.error("log.simulator", f"found {shown(simulator)}, expected a name")
        angles = log.get("angles")
        if angles is not None and not _texts(angles):
            raise self.error("log.angles", f"found {shown(angles)}, expected a list of names")
        sources: dict[str, Meaning] = {}
        for source in self.sources(log):
            target = source.target
            if target in sources:
                raise LogError(f"{source.where}: {target!r} is given twice; remove one")
            sources[target] = source
        return LogMapping(
            sources,
            self.units(),
            None if angles is None else tuple(angles),
            simulator,
            self.path,
        )

    def sources(self, log: Mapping[str, Any]) -> Iterator[Meaning]:
        if "time" in log:
            yield self.source("time", "log.time", log["time"])
        for prefix, table in TABLES.items():
            for name, value in self.table(table).items():
                yield self.source(f"{prefix}.{name}", f"{table}.{name}", value)
        for joint, value in self.table("quaternions").items():
            yield from self.quaternion(joint, value)
        for channel, speeds in self.table("forces").items():
            where = f"forces.{channel}"
            try:
                ChannelName.parse(channel)
            except InputError as error:
                raise self.error(where, str(error)) from None
            if not isinstance(speeds, dict):
                raise self.error(where, f"found {shown(speeds)}, expected a table: speed = column")
            for speed, value in speeds.items():
                yield self.source(f"force.{channel}.{speed}", f"{where}.{speed}", value)

    def quaternion(self, joint: str, value: Any) -> Iterator[Meaning]:
        key = f"quaternions.{joint}"
        if isinstance(value, str):  # the columns have the schema's names, but another order
            value = {"columns": [f"q.{joint}.{part}" for part in QUATERNION], "order": value}
        if not isinstance(value, dict) or set(value) != {"columns", "order"}:
            raise self.error(
                key, f"found {shown(value)}, expected {{ columns = [four], order = 'xyzw' }}"
            )
        columns, order = value["columns"], value["order"]
        if order not in _ORDERS:
            raise self.error(f"{key}.order", f"found {shown(order)}, expected 'wxyz' or 'xyzw'")
        if not _texts(columns) or len(columns) != 4:
            raise self.error(
                f"{key}.columns", f"found {shown(columns)}, expected four names of columns"
            )
        for letter, column in zip(order, columns, strict=True):
            target, where = f"q.{joint}.q{letter}", self.where(key)
            yield Meaning(target, column, _BECAUSE, unit="1", where=where)

    def source(self, target: str, key: str, value: Any) -> Meaning:
        where = self.where(key)
        if isinstance(value, str):
            return Meaning(target, value, _BECAUSE, where=where)
        if not isinstance(value, dict):
            raise self.error(
                key, f"found {shown(value)}, expected a column's name or {{ column = … }}"
            )
        for name in value:
            if name not in _SOURCE_KEYS:
                raise self.error(f"{key}.{name}", f"unknown key{closest(name, _SOURCE_KEYS)}")
        if sum(name in value for name in ("column", "constant", "step")) != 1:
            raise self.error(
                key, "expected either 'column' or 'constant' (or 'step', for the time)"
            )
        step = self.number(key, value, "step", 0.0) if "step" in value else None
        if step is not None and (key != "log.time" or step <= 0.0):
            raise self.error(
                key, "'step' is the time from row to row (s), above zero, and of time alone"
            )
        if not isinstance(value.get("column", ""), str):
            raise self.error(f"{key}.column", f"found {shown(value['column'])}, expected a name")
        written = value.get("unit")
        if written is not None:
            self.check_unit(f"{key}.unit", written)
        sign = self.number(key, value, "sign", 1.0)
        if abs(sign) != 1.0:
            raise self.error(f"{key}.sign", f"found {sign}, expected 1 or -1")
        constant = self.number(key, value, "constant", 0.0) if "constant" in value else None
        offset = self.number(key, value, "offset", 0.0)
        frame = value.get("frame", "")
        if frame and (
            frame not in _COMPONENTS or not key.startswith(("speeds.", "accelerations."))
        ):
            raise self.error(
                f"{key}.frame",
                f"found {shown(frame)}, expected 'world' or 'body', of speeds or accelerations",
            )
        return Meaning(
            target,
            value.get("column", ""),
            _BECAUSE,
            step=step,
            frame=frame,
            constant=constant,
            unit=written,
            sign=sign,
            offset=offset,
            where=where,
        )

    def units(self) -> dict[str, str]:
        units = self.table("units")
        for key, written in units.items():
            if key not in DIMENSIONS:
                raise self.error(f"units.{key}", f"unknown key{closest(key, DIMENSIONS)}")
            unit_text = self.check_unit(f"units.{key}", written)
            if unit_text != unit(DIMENSIONS[key]).dimension:
                raise self.error(
                    f"units.{key}", f"{written!r} is not a unit of {key.replace('_', ' ')}"
                )
        return {DIMENSIONS[key]: written for key, written in units.items()}

    def check_unit(self, key: str, written: Any) -> tuple[int, int, int, int]:
        if not isinstance(written, str):
            raise self.error(key, f"found {shown(written)}, expected a unit such as 'deg'")
        try:
            return unit(written).dimension
        except InputError as error:
            raise self.error(key, str(error)) from None

    def number(self, key: str, value: Mapping[str, Any], name: str, default: float) -> float:
        entry = value.get(name, default)
        if isinstance(entry, bool) or not isinstance(entry, int | float) or not abs(entry) < 1e300:
            raise self.error(f"{key}.{name}", f"found {shown(entry)}, expected a finite number")
        return float(entry)

    def table(self, name: str) -> Mapping[str, Any]:
        entries = self.document.get(name, {})
        if not isinstance(entries, dict):
            raise self.error(name, f"found {shown(entries)}, expected a table [{name}]")
        return entries

    def error(self, key: str, message: str) -> InputError:
        return LogError(f"{self.where(key)}: {message}")

    def where(self, key: str) -> str:
        line = line_of(self.text, key)
        return f"{self.path}{f', line {line}' if line else ''}, {key}"


def _texts(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(item, str) for item in value)
