"""The log schema: a trajectory as named columns and a JSON header, and back.

    time                        s
    q.<coordinate>              m, rad; quaternion components 1
    u.<speed>                   m/s, rad/s
    udot.<speed>                m/s², rad/s²
    force.<channel>.<speed>     generalized force, N or N·m
    stage<k>.<speed>            N or N·m: all forces but those of springs and dampers, at the k-th stage
                                of the step from the row, k = 2, 3, …
    work.<channel>              J
    integral.<testing function> J

Names may hold dots and spaces. The header lists them, so that its columns are known before any
name is taken apart; without it (a log by another program) the lists are derived from the columns.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from deltac.arrays import Array
from deltac.errors import (
    FileError,
    InputError,
    LogError,
    UnknownName,
    check_names,
    closest,
    listed,
    shown,
)
from deltac.mechanism.channels import ChannelName
from deltac.results import plain
from deltac.trajectories.numbers import as_numbers
from deltac.trajectories.occurrences import Occurrence
from deltac.trajectories.trajectory import MAPPINGS, Provenance, Trajectory

SCHEMA_VERSION = 1
"""Raised whenever a reader of the version before would misread or refuse the new one."""

UNITS: Mapping[str, str] = {
    "time": "s",
    "length": "m",
    "angle": "rad",
    "force": "N",
    "torque": "N·m",
    "energy": "J",
}
"""The units of every log; a log that declares others is refused."""

_STAGES = tuple(f"stage{k}." for k in range(2, 17))
_PREFIXES = ("q.", "u.", "udot.", "force.", "work.", "integral.", *_STAGES)


@dataclass(frozen=True)
class _ColumnLayout:
    """Which columns a log has."""

    coordinates: tuple[str, ...]
    speeds: tuple[str, ...]
    accelerations: bool
    channels: tuple[str, ...]
    works: tuple[str, ...]
    integrals: tuple[str, ...]
    stages: int = 0

    @staticmethod
    def of(run: Trajectory) -> _ColumnLayout:
        """That of a trajectory."""
        return _ColumnLayout(
            run.coordinates,
            run.speeds,
            run.udot is not None,
            tuple(run.forces),
            tuple(run.works),
            tuple(run.integrals),
            0 if run.stages is None else run.stages.shape[1],
        )

    def columns(self) -> Iterator[str]:
        """The columns in the order of the schema."""
        yield "time"
        yield from (f"q.{name}" for name in self.coordinates)
        yield from (f"u.{name}" for name in self.speeds)
        if self.accelerations:
            yield from (f"udot.{name}" for name in self.speeds)
        yield from (f"force.{c}.{name}" for c in self.channels for name in self.speeds)
        yield from (f"{prefix}{name}" for prefix in _STAGES[: self.stages] for name in self.speeds)
        yield from (f"work.{name}" for name in self.works)
        yield from (f"integral.{name}" for name in self.integrals)


def is_schema_name(column: str) -> bool:
    """Whether a column's name is one that the log schema could give it."""
    return column == "time" or (column.startswith(_PREFIXES) and not column.endswith("."))


def to_columns(run: Trajectory) -> dict[str, Array]:
    """The columns (T,) of a trajectory, in the order of the schema.

    Raises InputError in the rare case that two forces would share one column, as channel
    ``applied a`` on speed ``b.c`` and channel ``applied a.b`` on speed ``c`` do.
    """
    tables = [run.q, run.u, *([] if run.udot is None else [run.udot]), *run.forces.values()]
    tables += [] if run.stages is None else [*run.stages.transpose(1, 0, 2)]
    columns = [run.t, *(column for table in tables for column in table.T)]
    columns += [*run.works.values(), *run.integrals.values()]
    return dict(zip(_distinct(_ColumnLayout.of(run).columns()), columns, strict=True))


def to_metadata(run: Trajectory) -> dict[str, Any]:
    """The JSON header of a trajectory: plain dicts, lists, numbers and text."""
    events = {"events": [event.to_dict() for event in run.events]} if run.events else {}
    layout = plain(_ColumnLayout.of(run))
    if run.stages is None:
        del layout["stages"]
    return {
        "schema_version": SCHEMA_VERSION,
        **events,
        "rows": len(run),
        "units": dict(UNITS),
        **layout,
        "provenance": _provenance_fields(run.provenance),
    }


def from_columns(
    columns: Mapping[str, npt.ArrayLike], metadata: Mapping[str, Any] | None = None
) -> Trajectory:
    """The trajectory of named columns (T,), the inverse of `to_columns` and `to_metadata`.

    Without metadata the names decide: coordinates, speeds and channels stand in the order of
    their columns, a force that a logged channel does not list for a speed is zero, and the
    simulator is "unknown". With metadata every column must be there, and as many rows as it says.

    Raises InputError, naming the column, for what is missing, unknown, ambiguous or unusable.
    """
    if metadata is None:
        layout, provenance, sparse = _derive_layout(columns), Provenance("unknown"), True
    else:
        layout, provenance, sparse = _read_layout(metadata), _read_provenance(metadata), False
    expected = _distinct(layout.columns())
    _require(expected, columns, sparse)

    arrays = {name: as_numbers(f"column {name!r}", columns[name]) for name in columns}
    rows = arrays["time"].shape
    for name, array in arrays.items():
        if array.ndim != 1 or array.shape != rows:
            raise LogError(f"column {name!r}: found shape {array.shape}, time has {rows}")
    if metadata is not None and metadata.get("rows", rows[0]) != rows[0]:
        raise FileError(
            f"found {rows[0]} rows, the metadata say {metadata['rows']}: the log is cut off or was "
            "edited. Take the complete one, or remove its deltac metadata to use it as it is."
        )

    def table(prefix: str, names: tuple[str, ...]) -> Array:
        result = np.zeros((*rows, len(names)))
        for index, name in enumerate(names):
            if (column := arrays.get(f"{prefix}.{name}")) is not None:
                result[:, index] = column
        return result

    return Trajectory(
        t=arrays["time"],
        q=table("q", layout.coordinates),
        u=table("u", layout.speeds),
        udot=table("udot", layout.speeds) if layout.accelerations else None,
        forces={
            ChannelName.parse(name): table(f"force.{name}", layout.speeds)
            for name in layout.channels
        },
        works={ChannelName.parse(name): arrays[f"work.{name}"] for name in layout.works},
        stages=np.stack([table(p[:-1], layout.speeds) for p in _STAGES[: layout.stages]], axis=1)
        if layout.stages
        else None,
        integrals={name: arrays[f"integral.{name}"] for name in layout.integrals},
        coordinates=layout.coordinates,
        speeds=layout.speeds,
        provenance=provenance,
        events=_read_events(metadata, arrays["time"]),
    )


def _distinct(names: Iterable[str]) -> list[str]:
    names_so_far: dict[str, None] = {}
    for name in names:
        if name in names_so_far:
            raise LogError(
                f"two columns would be named {name!r}; rename an element or a joint so that "
                "'<channel>.<speed>' tells the forces apart"
            )
        names_so_far[name] = None
    return list(names_so_far)


def _require(expected: list[str], columns: Mapping[str, Any], sparse: bool) -> None:
    """Every expected column is there (but for zero forces, if sparse), and no other."""
    expected_names = set(expected)
    extra = [name for name in columns if name not in expected_names]
    for name in expected:
        if name not in columns and not (sparse and name.startswith("force.")):
            hint = closest(name, extra) if extra else ""
            raise LogError(f"no column {name!r}{hint} (add or rename the column)")
    if extra:
        raise UnknownName(
            f"column {extra[0]!r} is not among those that the metadata list"
            f"{closest(extra[0], expected)} (remove or rename the column)"
        )


# -- without metadata: the names decide ----------------------------------------------------------


def _derive_layout(columns: Mapping[str, Any]) -> _ColumnLayout:
    if "time" not in columns:
        raise UnknownName(
            f"no column 'time'{closest('time', columns)} (the column of times, in seconds, "
            "is named 'time')"
        )
    for name in columns:
        if name != "time" and not name.startswith(_PREFIXES):
            raise _unknown(name, columns)
    coordinates = _strip("q.", columns)
    speeds = _strip("u.", columns)
    for prefix, entries, what in (("q", coordinates, "coordinate"), ("u", speeds, "speed")):
        if not entries:
            raise LogError(
                f"no column '{prefix}.<{what}>'; expected one for each {what} of the mechanism, "
                f"for example '{prefix}.elbow'. Columns: {listed(columns)}"
            )
    stages = [prefix for prefix in _STAGES if any(name.startswith(prefix) for name in columns)]
    for own, prefix in zip(stages, _STAGES):
        if own != prefix:
            raise LogError(
                f"columns '{own}<speed>': there is none of '{prefix}<speed>'; stages are counted from 2 on"
            )
    speed_names = set(speeds)
    for prefix in ("udot.", *stages):
        for name in _strip(prefix, columns):
            if name not in speed_names:
                raise UnknownName(
                    f"column {prefix + name!r}: no speed 'u.{name}'{closest(name, speeds)}"
                )
    speed_order, lengths = dict.fromkeys(speeds), sorted({len(speed) for speed in speeds})
    channels = dict.fromkeys(_channel(n, speed_order, lengths) for n in _strip("force.", columns))
    return _ColumnLayout(
        coordinates,
        speeds,
        bool(_strip("udot.", columns)),
        tuple(channels),
        _strip("work.", columns),
        _strip("integral.", columns),
        len(stages),
    )


def _strip(prefix: str, columns: Iterable[str]) -> tuple[str, ...]:
    return tuple(name.removeprefix(prefix) for name in columns if name.startswith(prefix))


def _unknown(name: str, columns: Iterable[str]) -> InputError:
    """What a column with no prefix of the schema may have been meant to be."""
    rest = name.partition(".")[2]
    meant = ["time", *(prefix + rest for prefix in _PREFIXES)] if rest else ["time"]
    hint = closest(name, meant)
    if "did you mean" not in hint:
        hint = "; known: time, q.<coordinate>, u.<speed>, udot.<speed>, force.<channel>.<speed>, "
        hint += "work.<channel>, integral.<testing function>"
    return UnknownName(
        f"unknown column {name!r}{hint} (rename or remove the column, or say in a mapping what it is)"
    )


def _channel(name: str, speeds: Mapping[str, None], lengths: list[int]) -> str:
    """The channel of ``<channel>.<speed>``; exactly one way to take it apart must make sense."""
    column = f"column {f'force.{name}'!r}"
    endings = [name[-n:] for n in lengths if name[-n - 1 : -n] == "." and name[-n:] in speeds]
    if not endings:
        raise UnknownName(
            f"{column}: expected 'force.<channel>.<speed>' and the name of a speed at its end"
            f"{closest(name.rpartition('.')[2], speeds)}"
        )
    channels = []
    problem: InputError | None = None
    for speed in sorted(endings, key=len):
        channel = name.removesuffix(f".{speed}")
        try:
            ChannelName.parse(channel)
        except InputError as error:
            problem = problem or error
        else:
            channels.append(channel)
    if not channels:
        raise LogError(f"{column}: {problem}")
    if len(channels) > 1:
        raise LogError(
            f"{column} is ambiguous: its channel may be {' or '.join(map(repr, channels))}. "
            "Rename the element or the joint, or add deltac metadata to the log."
        )
    return channels[0]


# -- with metadata -------------------------------------------------------------------------------


def _read_layout(metadata: Mapping[str, Any]) -> _ColumnLayout:
    version = _entry(metadata, "schema_version", int)
    if version > SCHEMA_VERSION:
        raise LogError(
            f"the log has schema version {version}, this deltac reads up to {SCHEMA_VERSION}. "
            "Update deltac."
        )
    if version < 1:
        raise LogError(f"metadata: schema_version is {version}, expected 1 or more")
    for quantity, unit in _entry(metadata, "units", dict).items():
        if unit != UNITS.get(quantity, unit):
            raise LogError(
                f"the log has {quantity} in {shown(unit)}, expected {UNITS[quantity]!r}. "
                "Convert its columns."
            )
    return _ColumnLayout(
        _texts(metadata, "coordinates"),
        _texts(metadata, "speeds"),
        _entry(metadata, "accelerations", bool),
        _texts(metadata, "channels"),
        _texts(metadata, "works"),
        _texts(metadata, "integrals"),
        _entry(metadata, "stages", int) if "stages" in metadata else 0,
    )


def _read_provenance(metadata: Mapping[str, Any]) -> Provenance:
    entries = _entry(metadata, "provenance", dict)
    check_names(entries, [f.name for f in fields(Provenance)], "metadata: unknown provenance")
    return Provenance(**{"simulator": "unknown", **entries})


def _read_events(metadata: Mapping[str, Any] | None, t: Array) -> tuple[Occurrence, ...]:
    """The events of the header within the rows that are there: a log may be read in parts."""
    if metadata is None or "events" not in metadata or not t.size:
        return ()
    events = (Occurrence.from_dict(entry) for entry in _entry(metadata, "events", list))
    return tuple(event for event in events if t[0] <= event.t <= t[-1])


def _provenance_fields(provenance: Provenance) -> dict[str, Any]:
    values = {f.name: getattr(provenance, f.name) for f in fields(provenance)}
    values |= {name: dict(values[name]) for name in MAPPINGS}
    # What is unknown is left out, so that headers stay short; that nothing was held or lost is written.
    unsaid = {
        n for n, v in values.items() if v is None or (not v and n not in ("held", "energy_error"))
    }
    return {n: v for n, v in values.items() if n in _ALWAYS or n not in unsaid}


_ALWAYS = (
    *("simulator", "solver", "step", "tolerance", "model", "model_hash", "completed", "message"),
    "notes",
)
"""Entries of the provenance that every header has."""


def _entry(metadata: Mapping[str, Any], key: str, kind: type) -> Any:
    check_names([key], metadata, "metadata: no entry")
    value = metadata[key]
    if type(value) is not kind:  # bool is no int here
        raise LogError(f"metadata: {key} is {shown(value)}, expected {kind.__name__}")
    return value


def _texts(metadata: Mapping[str, Any], key: str) -> tuple[str, ...]:
    values = _entry(metadata, key, list)
    if not all(isinstance(value, str) for value in values):
        raise LogError(f"metadata: {key} is {shown(values)}, expected a list of names")
    return tuple(values)
