"""Bags of ROS: joint states from ``.mcap`` files, ``.bag`` files of ROS 1, and folders of ROS 2.

Read are messages of type ``sensor_msgs/JointState``: a column a joint, ``position.<joint>``,
``velocity.<joint>``, ``effort.<joint>``, and ``time``, the header's stamp (where that is zero, the time of
the recording) in seconds since the first message. Of several topics, or several sets of joints on one topic,
each has its own columns, ``<topic>.position.<joint>``, since their messages come at times of their own.
Other types are skipped by name. Nothing of a bag is run: definitions of messages are data.
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from deltac.errors import FileError, LogError, PackageError
from deltac.isolation import apart
from deltac.limits import Limits
from deltac.trajectories.formats.raw import Budget, Collector, RawLog, damage_named

JOINT_STATE = ("sensor_msgs/msg/JointState", "sensor_msgs/JointState")
_PARTS = ("position", "velocity", "effort")


@dataclass
class _Series:
    """Messages of one topic about the same joints."""

    topic: str
    joints: tuple[str, ...]
    stamps: list[int] = field(default_factory=list)
    values: dict[str, list[Any]] = field(default_factory=lambda: {part: [] for part in _PARTS})


def is_bag_folder(path: Path) -> bool:
    """Whether a folder is a bag of ROS 2."""
    return os.path.isfile(path / "metadata.yaml")


@apart
def read_bag(path: Path) -> RawLog:
    """The joint states of a bag: a .mcap or .bag file, or a folder of ROS 2."""
    # Readers print what they stumble over; a command's standard output is its own.
    with damage_named("bag"), redirect_stdout(io.StringIO()):
        messages = _of_mcap(path) if path.suffix.lower() == ".mcap" else _of_rosbags(path)
        return _log(messages, _size(path))


def _size(path: Path) -> int:
    files = path.iterdir() if path.is_dir() else [path]
    size = sum(file.stat().st_size for file in files if file.is_file())
    Limits.current().check("bytes", size, "the bag has")
    return size


def _of_mcap(path: Path) -> Iterator[tuple[str, str, int, Any]]:
    """Topic, type, time of recording (ns) and decoded message (None for other types)."""
    try:
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory
    except ImportError as error:
        raise _needs_package(error) from None
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()], validate_crcs=True)
        summary = reader.get_summary()
        topics = {c.topic: s.name for c, s in _channels(summary)} if summary is not None else {}
        wanted = [topic for topic, kind in topics.items() if kind in JOINT_STATE]
        yield from (
            (topic, kind, 0, None) for topic, kind in topics.items() if kind not in JOINT_STATE
        )
        if topics and not wanted:
            return
        for schema, channel, message, decoded in reader.iter_decoded_messages(
            topics=wanted or None
        ):
            kind = schema.name if schema is not None else ""
            yield channel.topic, kind, message.log_time, decoded if kind in JOINT_STATE else None


def _channels(summary: Any) -> Iterator[tuple[Any, Any]]:
    for channel in summary.channels.values():
        if channel.schema_id in summary.schemas:
            yield channel, summary.schemas[channel.schema_id]


def _of_rosbags(path: Path) -> Iterator[tuple[str, str, int, Any]]:
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise _needs_package(error) from None
    store = get_typestore(Stores.ROS2_HUMBLE)  # for bags that hold no definitions
    with AnyReader([path], default_typestore=store) as reader:
        for connection in reader.connections:
            if connection.msgtype not in JOINT_STATE:
                yield connection.topic, connection.msgtype, 0, None
        wanted = [c for c in reader.connections if c.msgtype in JOINT_STATE]
        if not wanted:
            return
        for connection, time, data in reader.messages(connections=wanted):
            yield (
                connection.topic,
                connection.msgtype,
                time,
                reader.deserialize(data, connection.msgtype),
            )


def _needs_package(error: ImportError) -> PackageError:
    return PackageError(
        f'bags of ROS need further packages ({error}); run: pip install "deltac[ros]"'
    )


def _log(messages: Iterator[tuple[str, str, int, Any]], size: int) -> RawLog:
    collector, budget = Collector(), Budget(size)
    series: dict[tuple[str, tuple[str, ...]], _Series] = {}
    count = 0
    for topic, kind, time, message in messages:
        if message is None:
            if topic not in collector.skipped:
                collector.skip(topic, f"has messages of type {kind}; joint states are read")
            continue
        joints = tuple(message.name)
        one = series.setdefault((topic, joints), _Series(topic, joints))
        stamp = message.header.stamp
        nanoseconds = getattr(stamp, "nanosec", getattr(stamp, "nsec", 0))
        one.stamps.append(int(stamp.sec) * 10**9 + int(nanoseconds) or int(time))
        for part in _PARTS:
            one.values[part].append(np.asarray(getattr(message, part), dtype=np.float64))
        count += 1
        Limits.current().check("rows", count, "the bag has")
        budget.take(8 * (1 + 3 * len(joints)))
    if not series:
        raise LogError(
            "the bag has no messages of type sensor_msgs/JointState. Topics: "
            + ("; ".join(collector.skipped.values()) or "none")
        )
    if any(len(set(one.joints)) < len(one.joints) for one in series.values()):
        raise FileError("a joint state names a joint twice")
    start = min(min(one.stamps) for one in series.values())
    for one in series.values():
        prefix = "" if len(series) == 1 else f"{one.topic.strip('/')}"
        if sum(other.topic == one.topic for other in series.values()) > 1:
            prefix += f"({', '.join(one.joints[:2])}{', …' if len(one.joints) > 2 else ''})"
        _add(collector, one, f"{prefix}." if prefix else "", start)
    return collector.log()


def _add(collector: Collector, one: _Series, prefix: str, start: int) -> None:
    """The columns of one series, in the order of its stamps; a message that is sent again stands once."""
    order = np.argsort(np.array(one.stamps), kind="stable")
    stamps = np.array(one.stamps)[order]
    new = np.concatenate([[True], np.diff(stamps) > 0])
    rows = order[new]
    collector.add(f"{prefix}time", (stamps[new] - start) / 1e9, "s")
    for part in _PARTS:
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
