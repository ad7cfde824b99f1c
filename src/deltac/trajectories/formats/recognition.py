"""What columns of other programs are, by how people name them: `recognise`.

A name is taken apart into words, as in ``/joint_states/Elbow.position [deg]``. The words of a coordinate of
the mechanism say what the column belongs to; of what is left every word must be known as one for positions,
velocities, accelerations or forces, or as one that says nothing. So ``elbow_pos_desired`` is nothing that
happened. Arrays are known by their name and their width. What is there twice is not taken.
"""

from __future__ import annotations

import difflib
import os
import re
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from deltac.trajectories.columns import ANGULAR, Kinematics, MechanismNames, si_unit
from deltac.trajectories.formats.raw import RawLog
from deltac.trajectories.formats.units import column_unit, converts, without_unit
from deltac.trajectories.trajectory import FloatArray

WORDS: Mapping[str, frozenset[str]] = {
    "q": frozenset(
        "q qpos pos position positions angle angles value theta disp displacement p".split()
    ),
    "u": frozenset(
        "qd dq qdot qvel vel vels velocity velocities speed speeds rate omega w v dot angvel".split()
    ),
    "udot": frozenset(
        "qdd ddq qddot qacc acc accel acceleration accelerations vdot udot alpha a b ddot".split()
    ),
    "force": frozenset("tau torque torques trq effort efforts moment".split()),
}
"""Words that say what of a joint a column is. Single letters are those of Simscape's primitives: q, w, b,
p, v."""

NEUTRAL = frozenset(
    "joint joints jnt coord coordinate coordinates state states data robot sim simulated meas measured "
    "actual real "
    "signal signals values series simlog simout logsout out log jointset rx ry rz px py pz linear sensor "
    "jointstates "
    "jointstate body link motor dof".split()
)
"""Words that say nothing of it."""

TIMES = frozenset(
    "time t tout datetime timestamp timestamps stamp sec secs seconds clock zeit tiempo temps".split()
)
NO_TIMES = frozenset(
    "wall cpu solve compute real delta dt step d duration sampling scheduled plan".split()
)
"""Words of columns that are times, but not of the samples."""

STEPS = frozenset("dt timestep ts h sampletime samplingtime sample period deltat".split())
RATES = frozenset("fs hz rate frequency freq samplerate samplingrate fps".split())
"""Names of single numbers that are the time between rows, s, and rows in a second."""

_GREEK = {
    "θ": "theta",
    "ϑ": "theta",
    "φ": "phi",
    "ϕ": "phi",
    "ω": "omega",
    "α": "alpha",
    "τ": "tau",
    "ψ": "psi",
}
_DOTS = {"\u0307": " dot ", "\u0308": " ddot "}
_LAYOUTS: tuple[tuple[str, frozenset[str]], ...] = tuple(
    (kind, frozenset(several.split()))
    for kind, several in (
        ("q", "qpos q positions position pos jointpos jointpositions dofpos"),
        ("u", "qvel v u qd dq qdot velocities velocity vel jointvel jointvelocities dofvel"),
        ("udot", "qacc vdot qdd ddq udot qddot a accelerations acceleration"),
        ("force", "tau torque torques effort efforts jointtorques appliedtorques"),
        ("x", "x xout state states yout y xs ys trajectory sol"),
    )
)
"""Names of arrays: of coordinates, speeds, accelerations, forces, and of coordinates and speeds in one."""

CLOSE, ALMOST = 0.75, 0.85
"""Similarity of two names, and of whole columns, from which on one may be a slip of the other."""


@dataclass(frozen=True)
class Recognised:
    """A column that is taken for `target`, a column of the log schema, and why.

    A guess, which is not `certain`, is only written into a draft. `step` (s): the time between rows, where
    the times follow from that.
    """

    target: str
    column: str
    why: str
    certain: bool = True
    step: float | None = None


def recognise(raw: RawLog, names: MechanismNames) -> list[Recognised]:
    """What the columns of a file are for a mechanism: at most one for each column of the schema."""
    found: dict[str, Recognised] = {}
    taken: set[str] = set()

    def take(candidates: Iterator[Recognised]) -> None:
        for one in candidates:
            if one.target not in found and (one.column not in taken or not one.column):
                found[one.target] = one
                taken.add(one.column)

    common = _common_path(list(raw.columns))
    named = {column: _readings(column, common) for column in raw.columns}
    take(_time(raw, named))
    take(_unique(_by_words(named, names)))
    take(_by_width(raw, names))
    take(_numbered(named, names))
    take(_unique(_by_unit(raw, named, names, taken)))
    take(_slips(named, names, found, taken))
    take(_in_order(raw, names, found))
    take(_step(raw, found))
    return list(found.values())


Named: TypeAlias = "Mapping[str, tuple[tuple[str, ...], ...]]"
"""Column -> its words, with and without what may be a unit at its end."""


def _readings(column: str, common: str) -> tuple[tuple[str, ...], ...]:
    column = column.removeprefix(common)
    return tuple(dict.fromkeys((_words(without_unit(column)), _words(column))))


def _common_path(columns: Sequence[str]) -> str:
    """What all names with a path have before them: the name of a variable, a topic, or a model."""
    paths = [column for column in columns if re.search(r"[^./][./]", column)]
    common = os.path.commonprefix(paths) if len(paths) > 1 else ""
    return common[: max(common.rfind("."), common.rfind("/")) + 1]


def _words(name: str) -> tuple[str, ...]:
    """The words of a name, in small letters."""
    text = unicodedata.normalize("NFC", name)
    plain = []
    for letter in text:
        parts = unicodedata.normalize("NFD", letter)
        base, marks = parts[:1], parts[1:]
        # ẋ has a dot; ü has two, and is no second derivative.
        dots = "".join(_DOTS.get(m, "") for m in marks if base.lower() not in "aeiou")
        plain.append(f" {_GREEK[base]} {dots}" if base in _GREEK else base + dots)
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", "".join(plain))
    return tuple(re.findall(r"[^\W\d_]+|\d+", spaced.lower()))


# --- time ----------------------------------------------------------------------------------------


def _time(raw: RawLog, named: Named) -> Iterator[Recognised]:
    """Columns that are called a time and increase; the first where all are the same."""
    times = [
        column
        for column, words in named.items()
        if any(map(_is_time, words))
        and len(raw.columns[column])
        and np.all(np.diff(raw.columns[column]) > 0.0)
    ]
    exact = [c for c in times if {("time",), ("t",), ("tout",)} & set(named[c])]
    several = exact or times
    if several:
        first = raw.columns[several[0]]
        same = all(np.array_equal(raw.columns[other], first) for other in several)
        yield Recognised("time", several[0], "called a time", certain=same or len(exact) == 1)


def _is_time(words: tuple[str, ...]) -> bool:
    if not words or NO_TIMES & set(words[:-1]):
        return False
    return words[-1] in ("time", "times", "timestamp", "timestamps", "tout", "stamp") or (
        set(words) <= TIMES | NEUTRAL and bool(set(words) & (TIMES - {"sec"}))
    )


def _step(raw: RawLog, found: Mapping[str, Recognised]) -> Iterator[Recognised]:
    """A single number that is the time between rows, where no column is the time."""
    if "time" in found:
        return
    for name, value in raw.scalars.items():
        word = "".join(_words(name))
        for known, step in ((STEPS, value), (RATES, 1.0 / value if value > 0.0 else 0.0)):
            if word in known and step > 0.0:
                yield Recognised("time", "", f"rows are {step:g} s apart, by {name!r}", False, step)
                return


# --- names of joints -----------------------------------------------------------------------------


@dataclass(frozen=True)
class _Joint:
    """A coordinate or a speed of the mechanism: its name, its words, and its columns by kind."""

    words: tuple[str, ...]
    targets: Mapping[str, str]


def _joints(names: MechanismNames) -> Iterator[_Joint]:
    coordinates, speeds = list(names.coordinates), list(names.speeds)
    speed_of = {coordinates[i]: speeds[j] for i, j in Kinematics.of(coordinates, speeds).rates}
    for name in coordinates:
        targets = {"q": f"q.{name}"}
        if name in speed_of:
            targets |= _of_speed(speed_of[name], names)
        yield _Joint(_words(name), targets)
        joint, _, part = name.rpartition(".")
        if part in ("qw", "qx", "qy", "qz"):
            for alias in ("quat", "quaternion", "orientation", "rotation", "q"):
                yield _Joint((*_words(joint), alias, part[1]), targets)
    for name in speeds:
        if name in names.coordinates:
            continue
        yield _Joint(_words(name), {"q": f"u.{name}", **_of_speed(name, names)})  # its bare name
        joint, _, part = name.rpartition(".")
        if part in ANGULAR:
            for alias in ("angular", "gyro"):
                yield _Joint((*_words(joint), alias, part[1]), _of_speed(name, names))


def _of_speed(speed: str, names: MechanismNames) -> dict[str, str]:
    return {
        "u": f"u.{speed}",
        "udot": f"udot.{speed}",
        "force": f"force.{force_channel(speed, names)}.{speed}",
    }


def force_channel(speed: str, names: MechanismNames) -> str:
    """The channel of a motor's force on a speed: that of the model's motor there, if it has one."""
    return names.motors.get(speed, f"actuator {speed}")


def _by_words(named: Named, names: MechanismNames) -> Iterator[tuple[int, Recognised]]:
    """Columns that name a coordinate and what of it, with how many words of them agree."""
    joints = list(_joints(names))
    for column, readings in named.items():
        found = [
            (len(joint.words), joint.targets[kind])
            for words in readings
            for joint in joints
            if (left := _without(words, joint.words)) is not None
            if (kind := _kind(left)) is not None and kind in joint.targets
        ]
        most = max((count for count, _ in found), default=0)
        targets = {target for count, target in found if count == most}
        if len(targets) == 1:
            yield most, Recognised(targets.pop(), column, "by its name")


def _without(words: tuple[str, ...], part: tuple[str, ...]) -> list[str] | None:
    """The words that are left without those of a joint, which must be there in their order."""
    left, at = [], 0
    for word in words:
        if at < len(part) and word == part[at]:
            at += 1
        else:
            left.append(word)
    return left if at == len(part) and part else None


def _kind(left: Sequence[str]) -> str | None:
    """What of a joint the other words of a column mean: "q", "u", "udot", "force"; None for nothing known."""
    telling = [word for word in left if word not in NEUTRAL]
    if telling in (["d", "dt"], ["d"]):
        return "u"
    if telling in (["dot", "dot"], ["d", "d"], ["dd"]):
        return "udot"
    if telling == ["angular", "velocity"]:
        return "u"
    if telling == ["angular", "acceleration"]:
        return "udot"
    if not telling:
        return "q"
    kinds = [{kind for kind, known in WORDS.items() if word in known} for word in telling]
    common = set.intersection(*kinds)
    if telling[0] in WORDS["q"] and common == set() and telling[1:] in (["dot"], ["ddot"]):
        return "u" if telling[1] == "dot" else "udot"
    return common.pop() if len(common) == 1 else None


def _unique(candidates: Iterator[tuple[int, Recognised]]) -> Iterator[Recognised]:
    """Of the columns for one target the only one; of several the first, as a guess."""
    by_target: dict[str, list[Recognised]] = {}
    for _, one in candidates:
        by_target.setdefault(one.target, []).append(one)
    for target, several in by_target.items():
        first = several[0]
        if len(several) == 1 or not first.certain:
            yield first
        else:
            others = ", ".join(repr(one.column) for one in several[1:4])
            yield Recognised(target, first.column, f"by its name; or {others}", certain=False)


# --- arrays and numbers --------------------------------------------------------------------------


def _targets(names: MechanismNames) -> dict[str, list[str]]:
    q = [f"q.{name}" for name in names.coordinates]
    u = [f"u.{name}" for name in names.speeds]
    return {
        "q": q,
        "u": u,
        "udot": [f"udot.{name}" for name in names.speeds],
        "force": [f"force.{force_channel(name, names)}.{name}" for name in names.speeds],
        "x": [*q, *u],
    }


def _by_width(raw: RawLog, names: MechanismNames) -> Iterator[Recognised]:
    """Arrays that are called so, where just one has as many columns as the mechanism has entries."""
    groups = _groups(raw)
    targets = _targets(names)
    meant: set[str] = set()
    for kind, keys in _LAYOUTS:
        fitting = [
            (group, columns)
            for group, columns in groups.items()
            if _key(group) in keys and len(columns) == len(targets[kind])
        ]
        if len(fitting) == 1 and not meant & set(targets[kind]):
            group, columns = fitting[0]
            meant |= set(targets[kind])
            for target, column in zip(targets[kind], columns, strict=True):
                yield Recognised(target, column, f"in the model's order, by the width of {group!r}")


def _groups(raw: RawLog) -> dict[str, list[str]]:
    """The columns of each array, by its name; columns with numbers at their end are an array as well."""
    groups: dict[str, list[str]] = {}
    for column in raw.columns:
        found = re.fullmatch(r"(.+)\[\d+\]", column)
        groups.setdefault(found[1] if found else column, []).append(column)
    return groups


def arrays_named(raw: RawLog, names: Sequence[str], width: int) -> list[FloatArray]:
    """Arrays (T, n) that are called one of the names, the first that is there, and have so many columns."""
    groups = _groups(raw)
    for column in raw.columns:
        if found := re.fullmatch(r"(.+?)_?\d+", column):
            groups.setdefault(found[1], []).append(column)
    for name in names:
        fitting = [c for group, c in groups.items() if _key(group) == name and len(c) == width]
        if fitting:
            return [np.column_stack([raw.columns[column] for column in c]) for c in fitting]
    return []


def _key(group: str) -> str:
    return re.sub(r"[_\s]", "", re.split(r"[./]", group)[-1].lower())


def _numbered(named: Named, names: MechanismNames) -> Iterator[Recognised]:
    """Columns with consecutive numbers, as many as the mechanism has entries, such as q1 and q2."""
    groups: dict[tuple[str, ...], dict[int, str]] = {}
    for column, (words, *_) in named.items():
        places = [k for k, word in enumerate(words) if word.isdigit()]
        if len(places) == 1 and len(words) > 1:
            k = places[0]
            groups.setdefault((*words[:k], "#", *words[k + 1 :]), {})[int(words[k])] = column
    targets = _targets(names)
    by_kind: dict[str, list[dict[int, str]]] = {}
    for words, columns in groups.items():
        kind = _kind([word for word in words if word != "#"])
        first = min(columns)
        if kind is None or first > 1 or sorted(columns) != list(range(first, first + len(columns))):
            continue
        if len(columns) == len(targets[kind]):
            by_kind.setdefault(kind, []).append(columns)
    for kind, several in by_kind.items():
        if len(several) == 1:
            ordered = [several[0][number] for number in sorted(several[0])]
            for target, column in zip(targets[kind], ordered, strict=True):
                yield Recognised(target, column, "in the model's order, by its number")


# --- guesses -------------------------------------------------------------------------------------


def _by_unit(
    raw: RawLog, named: Named, names: MechanismNames, taken: set[str]
) -> Iterator[tuple[int, Recognised]]:
    """Columns that name a joint beside words nobody knows, but have the unit of its position or speed."""
    for column, readings in named.items():
        if column in taken:
            continue
        for joint in _joints(names):
            if _without(readings[0], joint.words) is None:
                continue
            for kind in ("q", "u"):
                target = joint.targets.get(kind, "")
                si = si_unit(target, names) if target else None
                told = raw.units.get(column) or column_unit(column, si)
                if told and si and converts(told, si):
                    yield (
                        len(joint.words),
                        Recognised(target, column, f"names the joint, and is in {told}", False),
                    )


def _slips(
    named: Named, names: MechanismNames, found: Mapping[str, Recognised], taken: set[str]
) -> Iterator[Recognised]:
    """Columns whose names almost fit what is missing."""
    free = [column for column in named if column not in taken]
    for kind in ("q", "u"):
        for target in _targets(names)[kind]:
            if target not in found:
                name = target.partition(".")[2]
                scores = [
                    (_likeness(column, named[column][0], target, name, kind), column)
                    for column in free
                ]
                best = max(scores, default=(0.0, ""))
                if best[0] >= CLOSE:
                    yield Recognised(target, best[1], "its name is close", certain=False)


def _likeness(column: str, words: Sequence[str], target: str, name: str, kind: str) -> float:
    """How much a column's name is like that of a coordinate or speed, 0 to 1."""
    whole = difflib.SequenceMatcher(None, column.lower(), target.lower()).ratio()
    best = whole if whole > ALMOST else 0.0
    telling = [word for word in words if word not in NEUTRAL]
    for k, word in enumerate(telling):
        if _kind([*telling[:k], *telling[k + 1 :]]) == kind:
            ratio = difflib.SequenceMatcher(None, "".join(_words(name)), word).ratio()
            best = max(best, ratio)
    return best


def _in_order(
    raw: RawLog, names: MechanismNames, found: Mapping[str, Recognised]
) -> Iterator[Recognised]:
    """A table without names that is as wide as time, coordinates and speeds."""
    columns = list(raw.columns)
    targets = ["time", *_targets(names)["x"]]
    if found or len(columns) != len(targets) or not all(map(_NAMELESS.fullmatch, columns)):
        return
    first = raw.columns[columns[0]]
    if np.all(np.diff(first) > 0.0):
        for target, column in zip(targets, columns, strict=True):
            yield Recognised(
                target, column, "by the order time, coordinates, speeds", certain=False
            )


_NAMELESS = re.compile(r"column \d+|.*\[\d+\]")
