"""Bags of ROS: messages from ``.mcap`` files, ``.bag`` files of ROS 1, and folders of ROS 2.

Joint states (``sensor_msgs/JointState``) are a column a joint, ``position.<joint>``,
``velocity.<joint>``, ``effort.<joint>``, and ``time``, the header's stamp (where that is zero, the time of
the recording) in seconds since the first message. Of several topics, or several sets of joints on one topic,
each has its own columns, ``<topic>.position.<joint>``, since their messages come at times of their own.

Of every other small message with a stamp, such as odometry, poses and transforms, each number is a column,
``<topic>.pose.pose.position.x``; a transform is named by its frames, ``tf.odom>base_link.rotation.w``. They
are interpolated to the times of the joint states, by cubic splines, unless they are of these times, and
missing where the topic paused. Nothing of a bag is run: definitions of messages are data.
"""

from __future__ import annotations

import io
import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import redirect_stdout, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from deltac.arrays import ROUGHLY, Array
from deltac.errors import FileError, LogError, requirement
from deltac.foreign.isolation import apart
from deltac.foreign.limits import Limits
from deltac.trajectories.formats.raw import WIDEST, Budget, Collector, RawLog, damage_named
from deltac.trajectories.rates import FEWEST_ROWS, GAP, continuous

JOINT_STATE = ("sensor_msgs/msg/JointState", "sensor_msgs/JointState")
_JOINT_PARTS = ("position", "velocity", "effort")
_LONGEST_MESSAGE = 8 * WIDEST
"""Bytes of a message: larger ones have more numbers than a log has columns: pictures, clouds of points."""

_MOST_ENTRIES = 32
"""Entries of an array in a message that are a column each; covariances have 36."""

Message: TypeAlias = tuple[str, str, int, "Callable[[], Any] | None"]
"""Topic, type, time of recording (ns), and what decodes it (None where it is too large)."""


@dataclass
class _Joints:
    """Messages of one topic about the same joints."""

    topic: str
    joints: tuple[str, ...]
    stamps: list[int] = field(default_factory=list)
    values: dict[str, list[Any]] = field(
        default_factory=lambda: {part: [] for part in _JOINT_PARTS}
    )


@dataclass
class _Numbers:
    """The numbers of a topic's messages, or of one transform, by their paths in it."""

    stamps: list[int] = field(default_factory=list)
    rows: list[dict[str, float]] = field(default_factory=list)

    def table(self) -> tuple[npt.NDArray[np.int64], dict[str, Array]]:
        """Stamps that increase (T,), ns, and the columns that are in all messages."""
        stamps, first = np.unique(np.array(self.stamps, dtype=np.int64), return_index=True)
        names = [name for name in self.rows[0] if all(name in row for row in self.rows)]
        values = np.array([[self.rows[k][name] for name in names] for k in first])
        return stamps, dict(zip(names, values.T, strict=True))


def is_bag_folder(path: Path) -> bool:
    """Whether a folder is a bag of ROS 2."""
    return os.path.isfile(path / "metadata.yaml")


@apart
def read_bag(path: Path) -> RawLog:
    """Joint states, odometry, poses, transforms of a bag: a .mcap or .bag file, or a folder of ROS 2."""
    # Readers print what they stumble over; a command's standard output is its own.
    with damage_named("bag"), redirect_stdout(io.StringIO()):
        messages = _of_mcap(path) if path.suffix.lower() == ".mcap" else _of_rosbags(path)
        return _log(messages, _size(path))


def _size(path: Path) -> int:
    files = path.iterdir() if path.is_dir() else [path]
    size = sum(file.stat().st_size for file in files if file.is_file())
    Limits.current().check("bytes", size, "the bag has")
    return size


def _of_mcap(path: Path) -> Iterator[Message]:
    with requirement(_PACKAGES):
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory
    decoders = DecoderFactory()

    def decoded(channel: Any, schema: Any, data: bytes) -> Any:
        if channel.message_encoding == "json":
            return json.loads(data, object_hook=lambda fields: SimpleNamespace(**fields))
        decode = decoders.decoder_for(channel.message_encoding, schema)
        if decode is None:
            raise LogError(f"messages encoded as {channel.message_encoding!r} are not read")
        return decode(data)

    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            kind, data = schema.name if schema is not None else "", message.data
            small = kind in JOINT_STATE or len(data) <= _LONGEST_MESSAGE
            decode = (lambda c=channel, s=schema, d=data: decoded(c, s, d)) if small else None
            yield channel.topic, kind, message.log_time, decode


def _of_rosbags(path: Path) -> Iterator[Message]:
    with requirement(_PACKAGES):
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    store = get_typestore(Stores.ROS2_HUMBLE)  # for bags that hold no definitions
    with AnyReader([path], default_typestore=store) as reader:
        for connection, time, data in reader.messages():
            kind = connection.msgtype
            small = kind in JOINT_STATE or len(data) <= _LONGEST_MESSAGE
            decode = (lambda d=data, k=kind: reader.deserialize(d, k)) if small else None
            yield connection.topic, kind, time, decode


_PACKAGES = 'bags of ROS need further packages: pip install "deltac[ros]"'


def _log(messages: Iterator[Message], size: int) -> RawLog:
    collector, budget = Collector(), Budget(size)
    joints: dict[tuple[str, tuple[str, ...]], _Joints] = {}
    others: dict[str, _Numbers] = {}
    for count, (topic, kind, time, decode) in enumerate(messages, 1):
        Limits.current().check("rows", count, "the bag has")
        if topic in collector.skipped:
            continue
        message = None
        if decode is None:
            collector.skip(
                topic, f"has messages of type {kind} of more than {_LONGEST_MESSAGE} bytes"
            )
        elif kind in JOINT_STATE:
            message = decode()
            names = tuple(message.name)
            one = joints.setdefault((topic, names), _Joints(topic, names))
            one.stamps.append(_stamp(message) or int(time))
            for part in _JOINT_PARTS:
                one.values[part].append(np.asarray(getattr(message, part), dtype=np.float64))
            budget.take(8 * (1 + 3 * len(names)))
        else:
            with suppress(Exception):  # types that the bag does not define
                message = decode()
            stamped = list(_stamped(topic, message))
            if not stamped:
                collector.skip(topic, f"has messages of type {kind}, without a stamp or numbers")
            for name, stamp, numbers in stamped:
                series = others.setdefault(name, _Numbers())
                series.stamps.append(stamp or int(time))
                series.rows.append(numbers)
                budget.take(100 * (1 + len(numbers)))
    if any(len(set(one.joints)) < len(one.joints) for one in joints.values()):
        raise FileError("a joint state names a joint twice")
    tables = {name: one.table() for name, one in others.items() if len(one.stamps) > 3}
    if not joints and not tables:
        raise LogError(
            "the bag has no joint states, odometry, poses or other stamped numbers. Topics: "
            + ("; ".join(collector.skipped.values()) or "none")
        )
    if len(joints) != 1:
        return _apart(collector, joints, tables)
    (one,) = joints.values()
    return _merged(collector, _add(collector, one, "", min(one.stamps)), one.topic, tables)


Tables: TypeAlias = Mapping[str, tuple[npt.NDArray[np.int64], dict[str, Array]]]
"""Topic -> stamps, ns, and columns."""


def _apart(
    collector: Collector, joints: Mapping[tuple[str, tuple[str, ...]], _Joints], tables: Tables
) -> RawLog:
    """Several sets of joints, each at times of its own; or none, but the topic with the most numbers."""
    if not joints:
        main = max(tables, key=lambda name: len(tables[name][1]))
        stamps, columns = tables[main]
        collector.add("time", (stamps - stamps[0]) / 1e9, "s")
        for name, values in columns.items():
            collector.add(f"{main}.{name}", values)
        rest = {name: table for name, table in tables.items() if name != main}
        return _merged(collector, stamps, main, rest)
    start = min(min(one.stamps) for one in joints.values())
    for one in joints.values():
        prefix = one.topic.strip("/")
        if sum(other.topic == one.topic for other in joints.values()) > 1:
            prefix += f"({', '.join(one.joints[:2])}{', …' if len(one.joints) > 2 else ''})"
        _add(collector, one, f"{prefix}.", start)
    for topic in tables:
        collector.skip(topic, "is read beside one set of joints; there are several")
    return collector.log()


def _merged(
    collector: Collector, stamps: npt.NDArray[np.int64], main: str, tables: Tables
) -> RawLog:
    """The log with other topics at the times of the main one, which ends where these end."""
    fitting: dict[str, tuple[npt.NDArray[np.int64], dict[str, Array]]] = {}
    resampled: dict[str, str] = {}
    first, last = 0, len(stamps)
    for topic, (times, columns) in tables.items():
        a, b = np.searchsorted(stamps, times[0]), np.searchsorted(stamps, times[-1], side="right")
        if b - a < max(FEWEST_ROWS, (1.0 - ROUGHLY) * len(stamps)):
            collector.skip(topic, f"covers {b - a} of the {len(stamps)} times of {main}")
            continue
        first, last = max(first, int(a)), min(last, int(b))
        if columns:
            fitting[topic] = times, columns
        if not np.isin(stamps[a:b], times).all():
            how = f"{topic}: interpolated to the times of {main}"
            resampled |= {f"{topic}.{name}": how for name in columns}
    for name, array in collector.arrays.items():
        collector.arrays[name] = array[first:last]
    at = stamps[first:last]
    for topic, (times, columns) in fitting.items():
        for name, values in _interpolated(times, columns, at).items():
            collector.add(f"{topic}.{name}", values)
    log = collector.log()
    return RawLog(log.columns, units=log.units, skipped=log.skipped, resampled=resampled)


def _interpolated(
    times: npt.NDArray[np.int64], columns: Mapping[str, Array], at: npt.NDArray[np.int64]
) -> dict[str, Array]:
    """Columns at other times, by cubic splines; as they are at times of their own.

    They are missing (NaN) where the topic paused: a spline knows nothing of what happened there.
    """
    if np.isin(at, times).all():
        rows = np.searchsorted(times, at)
        return {name: values[rows] for name, values in columns.items()}
    from scipy.interpolate import CubicSpline

    smooth = dict(columns)
    for name in columns:  # quaternions p and −p are one turn
        stem = name.removesuffix(".w")
        parts = [f"{stem}.{letter}" for letter in "wxyz"]
        if stem != name and all(part in columns for part in parts):
            p = continuous(np.column_stack([columns[part] for part in parts]))
            smooth |= dict(zip(parts, p.T, strict=True))
    seconds, targets = (times - times[0]) / 1e9, (at - times[0]) / 1e9
    values: Array = CubicSpline(seconds, np.column_stack(list(smooth.values())))(targets)
    steps = np.diff(times)
    before = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(steps) - 1)
    values[(steps[before] > GAP * np.median(steps)) & ~np.isin(at, times)] = np.nan
    return dict(zip(smooth, values.T, strict=True))


def _stamped(topic: str, message: Any) -> Iterator[tuple[str, int, dict[str, float]]]:
    """Name, stamp (ns) and numbers of a message with a header, or of each transform in one."""
    name = topic.strip("/")
    for transform in getattr(message, "transforms", ()):
        frames = f"{transform.header.frame_id}>{transform.child_frame_id}"
        numbers = dict(_numbers(transform.transform, ""))
        yield f"{name}.{frames}", _stamp(transform), numbers
    if hasattr(message, "header") and (numbers := dict(_numbers(message, ""))):
        yield name, _stamp(message), numbers


def _stamp(message: Any) -> int:
    stamp = message.header.stamp
    nanoseconds = getattr(stamp, "nanosec", getattr(stamp, "nsec", 0))
    return int(stamp.sec) * 10**9 + int(nanoseconds)


def _numbers(message: Any, path: str) -> Iterator[tuple[str, float]]:
    """The numbers of a message by their paths: fields joined by dots, entries of short arrays by places."""
    fields = [*getattr(type(message), "__slots__", ()), *getattr(message, "__dict__", {})]
    for name in dict.fromkeys(fields):
        value, where = getattr(message, name), f"{path}.{name}" if path else name
        if name in ("header", "stamp") or "covariance" in name:
            continue
        if isinstance(value, bool | int | float | np.number):
            yield where, float(value)
        elif isinstance(value, list | tuple | np.ndarray) and len(value) <= _MOST_ENTRIES:
            for k, entry in enumerate(value):
                if isinstance(entry, int | float | np.number):
                    yield f"{where}[{k}]", float(entry)
                else:
                    yield from _numbers(entry, f"{where}[{k}]")
        elif hasattr(value, "__dict__") or hasattr(type(value), "__slots__"):
            yield from _numbers(value, where)


def _add(collector: Collector, one: _Joints, prefix: str, start: int) -> npt.NDArray[np.int64]:
    """The columns of one set of joints, in the order of its stamps, which it returns.

    A message that is sent again stands once.
    """
    stamps, rows = np.unique(np.array(one.stamps, dtype=np.int64), return_index=True)
    collector.add(f"{prefix}time", (stamps - start) / 1e9, "s")
    for part in _JOINT_PARTS:
        values = one.values[part]
        lengths = {len(values[row]) for row in rows}
        if lengths == {0}:
            continue
        if lengths != {len(one.joints)}:
            collector.skip(f"{prefix}{part}", "has not as many entries as there are joints")
            continue
        table = np.array([values[row] for row in rows])
        for joint, column in zip(one.joints, table.T, strict=True):
            collector.add(f"{prefix}{part}.{joint}", column)
    return stamps
