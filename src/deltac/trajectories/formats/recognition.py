"""What columns of other programs are: `recognise`.

What is declared decides: names of joints and quantities, names and widths of arrays, the order of the model.
What is there twice is not taken. The motion, for coordinates move as their speeds say, confirms that or
objects, and tells what nothing declares: the times among several columns, the order of a state vector, frames
of a floating body, and which column is the rate of which.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from deltac.arrays import LONG_LOG, NEGLIGIBLE, ROUGHLY, Array
from deltac.trajectories.columns import QUATERNION, MechanismNames, RateNames, si_unit
from deltac.trajectories.formats.floating import (
    Floating,
    Layout,
    floating_base,
    of_vectors,
    packed,
    poses,
    vectors_of,
)
from deltac.trajectories.formats.meaning import Basis, Meaning
from deltac.trajectories.formats.raw import RawLog
from deltac.trajectories.formats.units import column_unit, converts, unit, without_unit
from deltac.trajectories.formats.words import (
    COLUMN_WORDS,
    DERIVATIVES,
    KNOWN_WORDS,
    NEUTRAL,
    RATE_WORDS,
    SKIPS,
    SLIDES,
    STEPS,
    TABLE,
    TURNS,
    UNREAL,
    arrays_of,
    key,
    kind_of,
    names_time,
    unglued,
    without,
    words_of,
)
from deltac.trajectories.motion import (
    CLEAR_RATIO,
    Movement,
    preferred,
)

_LAYOUTS: tuple[tuple[str, frozenset[str]], ...] = tuple(
    (kind, frozenset(several.split()))
    for kind, several in (
        ("q", "qpos q qs positions position pos jointpos jointpositions dofpos"),
        ("u", "qvel v vs u qd dq qdot velocities velocity vel jointvel jointvelocities dofvel"),
        ("udot", "qacc vdot qdd ddq udot qddot a accelerations acceleration"),
        ("force", "tau torque torques effort efforts jointtorques appliedtorques"),
    )
)
"""Names of arrays: of coordinates, of speeds, accelerations, forces."""

_STATES = frozenset("x xout state states yout y xs ys trajectory sol obs observations".split())
"""Names of arrays of coordinates and speeds in one."""

_OF_MUJOCO = ("qpos", "qvel", "qacc")
"""Names that say the conventions of a floating body: MuJoCo's, which are the schema's."""

_COMMANDS = frozenset("ctrl control controls action actions act u input inputs command".split())
"""Names of arrays of motor commands."""


@dataclass
class _Search:
    """What is known of a file's columns while they are recognised: `meanings` by target, and those `used`."""

    raw: RawLog
    names: MechanismNames
    meanings: dict[str, Meaning] = field(default_factory=dict)
    used: set[str] = field(default_factory=set)

    @cached_property
    def named(self) -> Named:
        """The words of each column."""
        common = _common_path(list(self.raw.columns))
        return {c: _readings(c, common) for c in self.raw.columns}

    @cached_property
    def arrays(self) -> dict[str, list[str]]:
        """The columns of each array."""
        return arrays_of(self.raw.columns)

    @cached_property
    def joints(self) -> list[_Joint]:
        """What columns may be of."""
        return list(_joints(self.names))

    @cached_property
    def floating(self) -> list[str]:
        """The joints that float."""
        return [n.removesuffix(".qw") for n in self.names.coordinates if n.endswith(".qw")]

    @cached_property
    def targets(self) -> dict[str, list[str]]:
        """The columns of the schema of each kind, in the mechanism's order."""
        of_speeds = [_of_speed(name, self.names) for name in self.names.speeds]
        return {
            "q": [f"q.{name}" for name in self.names.coordinates],
            **{kind: [of[kind] for of in of_speeds] for kind in ("u", "udot", "force")},
        }

    @cached_property
    def times(self) -> list[Meaning]:
        """Columns that are called a time."""
        return list(_times(self))

    @property
    def columns(self) -> dict[str, str]:
        """The columns that are found, by target."""
        return {one.target: one.column for one in self.meanings.values()}

    def take(self, candidates: Iterator[Meaning]) -> None:
        """Keep what is new of the candidates."""
        if "time" in self.meanings and self.raw.columns.keys() <= self.used:
            return  # no column is left to be anything
        for one in candidates:
            if one.target not in self.meanings and (one.column not in self.used or not one.column):
                self.meanings[one.target] = one
                self.used.add(one.column)

    def unit(self, column: str, si: str | None) -> str | None:
        """The unit that the file or the column's name says, if it converts to `si`."""
        text = self.raw.units.get(column) or column_unit(column, si)
        return text if text and si and converts(text, si) else None

    def values(self, column: str, si: str | None = None) -> Array:
        """The values of a column in SI units, from its unit; of any kind if `si` is None."""
        text = self.unit(column, si) if si else self.raw.units.get(column) or column_unit(column)
        return (unit(text).factor if text else 1.0) * self.raw.columns[column]

    def misfit(self, t: Array, columns: Mapping[str, str]) -> float | None:
        """How far coordinates do not move as their speeds say, as a share of how far they move.

        `columns`: of the file by target. A pair that contradicts counts alone. None where no coordinate with
        its speed is among them, or nothing moves; infinite where a quaternion is not of unit length.
        """
        rows = slice(0, LONG_LOG)
        coordinates, speeds = list(self.names.coordinates), list(self.names.speeds)
        kinematics = RateNames.of(coordinates, speeds)

        def table(targets: Sequence[str]) -> Array | None:
            if not all(columns.get(target) in self.raw.columns for target in targets):
                return None
            each = [self.values(columns[n], si_unit(n, self.names))[rows] for n in targets]
            same = {len(values) for values in each} == {len(t[rows])}
            return np.column_stack(each) if same else None

        movements = []
        for i, j in kinematics.rates:
            pair = table([f"q.{coordinates[i]}", f"u.{speeds[j]}"])
            if pair is not None:
                movements.append(Movement.of(t[rows], pair[:, :1], pair[:, 1:]))
        for _, i, j in kinematics.quaternions:
            p = table([f"q.{name}" for name in coordinates[i : i + 4]])
            w = table([f"u.{name}" for name in speeds[j : j + 3]])
            if p is None:
                continue
            if not np.nanmax(np.abs((p * p).sum(axis=1) - 1.0)) < ROUGHLY:
                return np.inf
            if w is not None:
                movements.append(Movement.turning(t[rows], p, w, "body"))
        sizes = np.array([movement.sizes() for movement in movements]).reshape(-1, 2)
        size, difference = sizes.sum(axis=0)
        if not size > 0.0:
            return None
        telling = sizes[sizes[:, 0] > NEGLIGIBLE * size]
        worst = float(np.max(telling[:, 1] / telling[:, 0], initial=0.0))
        return float(difference / size) if worst < CLEAR_RATIO else max(worst, CLEAR_RATIO)

    def agrees(self, t: Array, columns: Mapping[str, str]) -> bool:
        """Whether coordinates move as their speeds say."""
        misfit = self.misfit(t, columns)
        return misfit is not None and misfit < ROUGHLY


def recognise(raw: RawLog, names: MechanismNames) -> dict[str, Meaning]:
    """What the columns of a file are for a mechanism: at most one for each column of the schema."""
    search = _Search(raw, names)
    for rule in _RULES:
        search.take(rule(search))
    meanings = search.meanings
    frames = {one.frame for one in meanings.values() if one.target.startswith(("u.", "udot."))}
    rates = search.targets["udot"]
    whole = all(target in meanings for target in rates)
    if not whole or (frames > {""} and not any(meanings[target].frame for target in rates)):
        return {n: one for n, one in meanings.items() if not n.startswith("udot.")}
    return meanings


Named: TypeAlias = "Mapping[str, tuple[tuple[str, ...], ...]]"
"""Column -> its words, with and without what may be a unit at its end."""


def _readings(column: str, common: str) -> tuple[tuple[str, ...], ...]:
    column = column.removeprefix(common)
    return tuple(dict.fromkeys((words_of(without_unit(column)), words_of(column))))


def _common_path(columns: Sequence[str]) -> str:
    """What all names with a path have before them: the name of a variable, a topic, or a model."""
    paths = [column for column in columns if re.search(r"[^./][./]|: ", column)]
    common = os.path.commonprefix(paths) if len(paths) > 1 else ""
    return common[: max(map(common.rfind, ".:/")) + 1]


# --- time ----------------------------------------------------------------------------------------


def _times(s: _Search) -> Iterator[Meaning]:
    """Columns that are called a time and increase: one that is sure, or those that may be."""
    times = [
        column
        for column, words in s.named.items()
        if any(map(names_time, (*words, _last_part(column)))) and _increases(s.raw.columns[column])
    ]
    exact = [c for c in times if {("time",), ("t",), ("tout",)} & set(s.named[c])]
    several = exact or times
    if several:
        first = s.raw.columns[several[0]]
        same = all(np.array_equal(s.raw.columns[other], first) for other in several)
        for column in several[:1] if same or len(exact) == 1 else several:
            sure = same or len(exact) == 1
            yield Meaning(
                "time", column, "its name is that of a time", "declared" if sure else "guess"
            )


def _last_part(column: str) -> tuple[str, ...]:
    """The last part of a path, where it is a time whatever stands before."""
    parts = map(words_of, reversed(re.split(r"[./]", column)))
    words = next((words for words in parts if not set(words) <= NEUTRAL), ())
    return words if words in (("t",), ("time",)) else ()


def _increases(values: Array) -> bool:
    finite = values[~np.isnan(values)]
    return bool(len(finite) and np.all(np.diff(finite) > 0.0))


def _clock(s: _Search) -> Iterator[Meaning]:
    """The times by which coordinates move as their speeds say, whatever they are called; else a guess."""
    if "time" in s.meanings:
        return
    columns = s.columns
    fitting = [
        one for one, t in _clocks(s) if one.column not in columns.values() and s.agrees(t, columns)
    ]
    times = [s.raw.columns[one.column] for one in fitting if one.column]
    deviations = [np.ptp(t - times[0]) if len(t) == len(times[0]) else np.inf for t in times]
    if fitting and (not fitting[0].column or max(deviations) <= 1e-3 * np.ptp(times[0])):
        yield fitting[0]
        return
    yield from (replace(one, basis="guess") for one in fitting)
    yield from s.times
    for word, step in _steps(s)[1::-1]:  # physics' own steps are the least likely
        yield Meaning("time", "", f"{word!r} says that rows are {step:g} s apart", "guess", step)


def _clocks(s: _Search) -> Iterator[tuple[Meaning, Array]]:
    """The times that rows may have: the known ones, else by single numbers, or columns that increase."""
    if "time" in s.meanings:
        yield s.meanings["time"], s.values(s.meanings["time"].column, "s")
        return
    lengths = [len(values) for values in s.raw.columns.values()]
    rows = max(set(lengths), key=lengths.count, default=0)
    steps = _steps(s)
    for word, step in steps:
        why = f"{word!r} and the motion say that rows are {step:g} s apart"
        basis: Basis = "motion" if len(steps) > 1 else "declared"
        yield Meaning("time", "", why, basis, step), step * np.arange(float(rows))
    why = "by it coordinates move as their speeds say"
    for column in dict.fromkeys([*(one.column for one in s.times), *s.raw.columns]):
        if _increases(s.raw.columns[column]):
            yield Meaning("time", column, why, "motion"), s.values(column, "s")


def _steps(s: _Search) -> list[tuple[str, float]]:
    """What single numbers say of the time between rows (s), and their names.

    Steps of physics may be so many times shorter as another number says.
    """
    plain = [(words_of(name.rpartition(".")[2]), value) for name, value in s.raw.scalars.items()]
    skips = [value for words, value in plain if value > 1.0 and "".join(words) in SKIPS]
    steps = []
    for words, value in plain:
        ends = {"".join(words[k:]) for k in range(len(words))}  # sim_dt, control_freq
        step = value if ends & STEPS else 1.0 / value if ends & RATE_WORDS and value > 0.0 else 0.0
        if 0.0 < step < np.inf:
            steps += [("_".join(words), many * step) for many in (1.0, *skips)]
    return steps


# --- names of joints -----------------------------------------------------------------------------


@dataclass(frozen=True)
class _Joint:
    """A coordinate or a speed of the mechanism: its name, its words, and its columns by kind."""

    words: tuple[str, ...]
    targets: Mapping[str, str]


def _joints(names: MechanismNames) -> Iterator[_Joint]:
    coordinates, speeds = list(names.coordinates), list(names.speeds)
    speed_of = {coordinates[i]: speeds[j] for i, j in RateNames.of(coordinates, speeds).rates}
    for name in coordinates:
        rates = _of_speed(speed_of[name], names) if name in speed_of else {}
        yield _Joint(words_of(name), {"q": f"q.{name}", **rates})
    for name in speeds:
        if name not in names.coordinates:
            yield _Joint(words_of(name), {"q": f"u.{name}", **_of_speed(name, names)})


def _of_speed(speed: str, names: MechanismNames) -> dict[str, str]:
    return {
        "u": f"u.{speed}",
        "udot": f"udot.{speed}",
        "force": f"force.{force_channel(speed, names)}.{speed}",
    }


def force_channel(speed: str, names: MechanismNames) -> str:
    """The channel of a motor's force on a speed: that of the model's motor there, if it has one."""
    return names.motors.get(speed, f"actuator {speed}")


def _by_words(named: Named, joints: Sequence[_Joint]) -> Iterator[Meaning]:
    """Columns that name a coordinate and what of it, with how many words of them agree."""
    for column, readings in named.items():
        matches = [
            (len(joint.words), joint.targets[kind])
            for words in readings
            for joint in joints
            if (rest := without(words, joint.words)) is not None
            if (kind := kind_of(rest)) is not None and kind in joint.targets
        ]
        most = max((count for count, _ in matches), default=0)
        targets = {target for count, target in matches if count == most}
        if len(targets) == 1:
            yield Meaning(targets.pop(), column, "their names say so")


_ACTUATION = frozenset("force forces actuation actuator motor".split())
"""Words beside the name of a motor that say no more than that it acts."""


def _of_motors(s: _Search) -> Iterator[Meaning]:
    """Columns that name a motor of the model and say, by a word or their unit, that they are its force."""
    for speed, channel in s.names.motors.items():
        motor = words_of(channel.removeprefix("actuator "))
        si = "N*m" if si_unit(f"u.{speed}", s.names) == "rad/s" else "N"
        for column, readings in s.named.items():
            vocabulary = _ACTUATION | COLUMN_WORDS["force"] | NEUTRAL
            if in_unit := s.unit(column, si) is not None:
                vocabulary |= {"t", "f", "m"}  # T, F and M of a torque or force
            for words in readings:
                rest = without(words, motor)
                acts = in_unit or set(words) & (_ACTUATION | COLUMN_WORDS["force"])
                if rest is not None and acts and set(rest) <= vocabulary:
                    target = f"force.{channel}.{speed}"
                    yield Meaning(target, column, "the name is that of the motor")
                    break


def _alike(s: _Search) -> Iterator[Meaning]:
    """Columns that name a coordinate beside words that all of these have, which then tell nothing.

    They are sure where the coordinates move as their speeds say.
    """
    parts = {
        column: tuple(part for word in readings[0] for part in unglued(word))
        for column, readings in s.named.items()
        if any(without(readings[0], joint.words) is not None for joint in s.joints)
    }
    if len(parts) < 2:
        return
    several = {word for joint in s.joints for word in joint.words}
    common = set.intersection(*map(set, parts.values())) - KNOWN_WORDS - UNREAL - several
    plain: Named = {
        column: (tuple(word for word in words if word not in common),)
        for column, words in parts.items()
    }
    several_found = list(_unique(s, _by_words(plain, s.joints)))
    columns = {
        one.target: one.column for one in (*several_found, *s.meanings.values()) if one.certain
    }
    t = s.values(columns["time"], "s") if columns.get("time") else None
    sure = t is not None and s.agrees(t, columns)
    for one in several_found:
        yield one if sure else replace(one, basis="guess")


def _unique(s: _Search, candidates: Iterator[Meaning]) -> Iterator[Meaning]:
    """Of the columns for one target the first, as a guess if several say different things."""
    by_target: dict[str, list[Meaning]] = {}
    for one in candidates:
        by_target.setdefault(one.target, []).append(one)
    for target, several in by_target.items():
        first = several[0]
        values = [s.values(one.column, si_unit(target, s.names)) for one in several]
        same = all(
            len(v) == len(values[0]) and np.allclose(v, values[0], rtol=1e-4, atol=0.0)
            for v in values[1:]
        )
        if same or not first.certain:
            yield first
        else:
            others = ", ".join(repr(one.column) for one in several[1:4])
            yield Meaning(target, first.column, f"its name says so; or {others}", "guess")


def _sole(s: _Search) -> Iterator[Meaning]:
    """Columns that say only what they are: of the one joint, or of the one that turns, or slides."""
    joints = [j for j in s.joints if "q" in j.targets and "u" in j.targets]
    joints = [j for j in joints if j.targets["q"].startswith("q.")]
    letters = {
        word for readings in s.named.values() for word in readings[0] if word in ("x", "y", "z")
    }
    places = letters if len(letters) > 1 else set()  # of a point, not of a joint
    for column, readings in s.named.items():
        parts = [part for word in readings[0] for part in unglued(word)]
        kind = kind_of(
            tuple(part if part not in ("x", "y", "z", "s") else "displacement" for part in parts)
        )
        telling = set(parts)
        if kind == "udot" and all(len(part) == 1 for part in telling):
            continue  # Simscape's letters beside names of joints; alone they are anything
        if column in s.used or kind is None or not telling - NEUTRAL - DERIVATIVES.keys():
            continue
        unit_text = _told_unit(s, column)
        turns, slides = (bool(telling & vocabulary) for vocabulary in (TURNS, SLIDES))
        if unit_text is not None:
            turns, slides = unit_text == "rad", unit_text == "m"
        sole_kind = (
            {"rad"} if turns and not slides else {"m"} if slides and not turns else {"rad", "m"}
        )
        fitting = [
            j for j in joints if kind in j.targets and si_unit(j.targets["q"], s.names) in sole_kind
        ]
        if len(fitting) != 1 and len(joints) == 1 and unit_text is None and "v" in telling:
            fitting = joints
        of_point = unit_text is None and bool(telling & places)
        if of_point and "rad" in {si_unit(joint.targets["q"], s.names) for joint in fitting}:
            continue
        sure = len(fitting) == 1
        if len(joints) == 1 and unit_text is None and not of_point:
            fitting = joints  # a pendulum's x may be its angle, or how far its bob is
        if len(fitting) == 1:
            what = "the joint" if len(joints) == 1 else "the joint that turns or slides so"
            yield Meaning(
                fitting[0].targets[kind],
                column,
                f"its name says so, of {what}",
                "declared" if sure else "guess",
            )


def _told_unit(s: _Search, column: str) -> str | None:
    """Whether a column's unit is one of turning ("rad") or sliding ("m")."""
    for si in ("rad", "rad/s", "rad/s^2", "m", "m/s", "m/s^2"):
        if s.unit(column, si):
            return si.partition("/")[0]
    return None


# --- arrays --------------------------------------------------------------------------------------


def _by_width(s: _Search) -> Iterator[Meaning]:
    """Arrays that are called so, where just one has as many columns as the mechanism has entries.

    Arrays of joints may leave out the one that floats; where the mechanism branches their order is then any.
    """
    motors = [f"force.{channel}.{speed}" for speed, channel in s.names.motors.items()]
    for kind, keys in _LAYOUTS:
        widths = _widths(s, kind)
        for targets in [*widths, *([motors] if kind == "force" and motors else [])]:
            fitting = [
                (array, columns)
                for array, columns in s.arrays.items()
                if len(columns) == len(targets) and _is_of(array, columns, kind, keys)
            ]
            if len(fitting) != 1:
                continue
            ((array, columns),) = fitting
            declared = dict(zip(targets, columns, strict=True))
            rest = targets is not widths[0] and len(targets) > 1 and kind != "force"
            why = f"{array!r} has the model's width, and is taken in its order"
            basis: Basis = "declared"
            if rest and s.names.branches:
                why += "; the model branches, and nothing says the joints' order"
                basis = "open"
            elif s.misfit(np.arange(float(len(s.raw.columns[columns[0]]))), declared) == np.inf:
                why += "; but four of its columns are no unit quaternion"
                basis = "open"
            elif s.floating and targets is widths[0] and key(array) not in _OF_MUJOCO:
                why += "; the motion does not tell the floating body's convention"
                basis = "guess"
            for target, column in declared.items():
                yield Meaning(target, column, why, basis)
            break


def _is_of(array: str, columns: Sequence[str], kind: str, keys: frozenset[str]) -> bool:
    """Whether an array is one of a kind by its name."""
    if key(array) in keys:
        return list(columns) != ["a"]  # alone it is anything
    if columns[0] == array:
        return False
    for name in (re.split(r"[./]", array)[-1], array):
        words = words_of(name)
        telling = set(words) - NEUTRAL or not columns[0].endswith("]")
        if telling and (word_kind := kind_of(words)):
            return word_kind == kind
    return False


def _commands(s: _Search) -> Iterator[Meaning]:
    """Arrays of commands, as many as the model has motors: their forces, unless the motors have gears."""
    for array, columns in s.arrays.items():
        free = not s.used & set(columns)
        if free and key(array) in _COMMANDS and len(columns) == len(s.names.motors):
            for (speed, channel), column in zip(s.names.motors.items(), columns):
                why = (
                    "there are as many commands as motors; forces if a command of 1 is 1 N·m or 1 N"
                )
                yield Meaning(f"force.{channel}.{speed}", column, why, "guess")


def _widths(s: _Search, kind: str) -> list[list[str]]:
    """All columns of a kind, and those without the one joint that floats."""
    every = s.targets[kind]
    rest = [t for t in every if not any(f".{joint}." in t for joint in s.floating)]
    return [every, rest] if len(s.floating) == 1 and rest else [every]


def arrays_named(columns: Mapping[str, Array], names: Sequence[str], width: int) -> list[Array]:
    """Arrays (T, n) that are called one of the names, the first that is there, and have so many columns."""
    for name in names:
        fitting = [c for n, c in arrays_of(columns).items() if key(n) == name and len(c) == width]
        if fitting:
            return [np.column_stack([columns[column] for column in c]) for c in fitting]
    return []


def columns_of(columns: Iterable[str], element: str, kinds: Sequence[str]) -> list[str]:
    """Columns that name an element and one of some kinds of its quantities: ``slide_ctrl``."""
    part = words_of(element)
    each = ((column, without(words_of(column), part)) for column in columns)
    return [c for c, rest in each if rest and set() < set(rest) - NEUTRAL <= set(kinds)]


# --- units of names ------------------------------------------------------------------------------


def _by_unit(s: _Search) -> Iterator[Meaning]:
    """Columns called as a joint in a unit that says what of it: ``elbow_rad_s``."""
    units = {"rad": ("rad", "rad/s", "rad/s^2", "N*m"), "m": ("m", "m/s", "m/s^2", "N")}
    for joint in s.joints:
        si = units.get(si_unit(joint.targets["q"], s.names) or "", ("",) * 4)
        for column, readings in s.named.items():
            rest = without(readings[0], joint.words)
            if rest is None or set(rest) - NEUTRAL:
                continue
            for kind, of_kind in zip(("q", "u", "udot", "force"), si):
                if kind in joint.targets and (text := s.unit(column, of_kind)):
                    why = f"its name and its unit {text} say so"
                    yield Meaning(joint.targets[kind], column, why)


# --- the body that floats ------------------------------------------------------------------------


def _floating(s: _Search) -> Iterator[Meaning]:
    """The one body that floats, by names, widths and how it moves, and the joints in the same arrays."""
    if len(s.floating) != 1 or f"{s.floating[0]}.vx" not in s.names.speeds:
        return
    joint = s.floating[0]
    for clock, t in _clocks(s):
        columns = [
            c
            for c, x in s.raw.columns.items()
            if len(x) == len(t) and c not in (s.used | {clock.column})
        ]
        rows = slice(0, LONG_LOG)
        table = {c: s.values(c)[rows] for c in columns}
        if not table:
            continue
        complete = ~np.isnan(np.column_stack(list(table.values()))).any(axis=1)
        table = {c: values[complete] for c, values in table.items()}
        arrays = {n: c for n, c in s.arrays.items() if set(c) <= set(columns)}
        vectors = vectors_of(arrays, columns, [joint, s.names.bodies.get(joint, joint)])
        layouts = [*_packed(s, clock.column), *of_vectors(vectors)]
        layouts = [one for one in layouts if {*one.position, *one.quaternion} <= set(columns)]
        layouts = [one for one in layouts if {*one.linear, *one.angular} <= set(columns)]
        places = [replace(one, q=(), u=()) for one in layouts]
        # Whole milliseconds and the like are told once the log is read.
        distinct = list(dict.fromkeys(places))
        bases = (floating_base(f * t[rows][complete], table, distinct) for f in _SECONDS)
        base = next((base for base in bases if base is not None), None)
        if base is not None:
            alike = [one for one, place in zip(layouts, places) if place == base.layout]
            yield clock
            first = base.layout == places[0]
            yield from _of_floating(s, replace(base, usual=base.usual and first), joint, alike, t)
            return
        pose_columns = list(poses(table, vectors))
        if len(pose_columns) == 1:
            parts = (*QUATERNION, *"xyz")
            for part, column in zip(parts, pose_columns[0], strict=True):
                yield Meaning(
                    f"q.{joint}.{part}", column, "this is the one pose that moves", "motion"
                )
            return


def _packed(s: _Search, clock: str) -> Iterator[Layout]:
    """Layouts in arrays, the most declared first: a pair of coordinates and speeds, a state, a root state."""
    i = list(s.targets["q"]).index(f"q.{s.floating[0]}.x")
    j = list(s.targets["u"]).index(f"u.{s.floating[0]}.vx")
    nq, nu = len(s.targets["q"]), len(s.targets["u"])
    arrays = {n: [c for c in columns if c != clock] for n, columns in s.arrays.items()}
    for a, b, at in ((nq, nu, (i, j)), (7, 6, (0, 0))):
        q, u = (_arrays_of(arrays, kind, width) for kind, width in (("q", a), ("u", b)))
        for one in q:
            for other in u:
                if one != other:
                    yield from packed(one, other, *at)
    for width in dict.fromkeys((nq + nu, 13)):
        for columns in arrays.values():
            if len(columns) != width:
                continue
            if width == nq + nu:
                yield from packed(columns[:nq], columns[nq:], i, j)
                yield from packed(columns[nu:], columns[:nu], i, j)
            root, rest = columns[:13], columns[13:]
            joints = s.targets["q"][7:], s.targets["u"][6:]
            for _, order in _orders(*joints) if i == j == 0 else [("", [])]:
                place = dict(zip(order, rest))
                of_q, of_u = (tuple(place[n] for n in of if n in place) for of in joints)
                for pose, twist in ((root[:7], root[7:]), (root[6:], root[:6])):
                    yield from packed([*pose, *of_q], [*twist, *of_u])


def _arrays_of(arrays: Mapping[str, Sequence[str]], kind: str, width: int) -> list[Sequence[str]]:
    """Arrays of a width, those whose names are of the kind where any are."""
    keys = dict(_LAYOUTS)[kind]
    every = {name: columns for name, columns in arrays.items() if len(columns) == width}
    named = [columns for name, columns in every.items() if _is_of(name, columns, kind, keys)]
    return named or list(every.values())


_SECONDS = (1.0, 1e-3, 1e-6, 1e-9)
"""Units that times without a unit may have, s."""


def _of_floating(
    s: _Search, base: Floating, joint: str, alike: Sequence[Layout], t: Array
) -> Iterator[Meaning]:
    """Columns of a floating body, and those of the joints that stand in its arrays.

    Of layouts that are `alike` but for the joints that one is right in which these move as their speeds say.
    """
    rest = [[n for n in s.targets[kind] if f".{joint}." not in n] for kind in ("q", "u")]
    orders = [dict(zip(rest[0], one.q)) | dict(zip(rest[1], one.u)) for one in alike]
    misses = [s.misfit(t, joints) or 0.0 for joints in orders]
    joints = orders[int(np.argmin(misses))]
    layout = base.layout
    array_of = {column: array for array, several in s.arrays.items() for column in several}
    of_q, of_u = (array_of[columns[0]] for columns in (layout.quaternion, layout.angular))
    named = layout.order and layout.linear_frame and layout.angular_frame
    states = of_q == of_u and key(of_q) not in _STATES and len(s.arrays[of_q]) > 13
    declared = base.usual and (named or (bool(joints) and not states))
    basis: Basis = "declared" if declared else "motion"
    basis_text = "names and widths say so, and" if declared else "only so"
    why = f"{basis_text} the body moves as its speeds say: {base}"
    frames = {
        "v": "body" if base.linear_frame == "body" else "",
        "w": "world" if base.angular_frame == "world" else "",
    }
    targets = {
        **dict(zip((f"q.{joint}.{c}" for c in "xyz"), layout.position)),
        **dict(zip((f"q.{joint}.{c}" for c in QUATERNION), base.quaternion)),
        **dict(zip((f"u.{joint}.v{c}" for c in "xyz"), layout.linear)),
        **dict(zip((f"u.{joint}.w{c}" for c in "xyz"), layout.angular)),
    }
    of_speed = {n[2:]: frames[n[-2]] for n in targets if n.startswith("u.")}
    for target, column in {**targets, **joints}.items():
        frame = of_speed.get(target.removeprefix("u."), "")
        yield Meaning(target, column, why, basis, frame=frame)
    inverse = {column: target for target, column in {**targets, **joints}.items()}
    speeds = [inverse.get(column, "") for column in s.arrays[of_u]]
    if of_u == of_q or not all(speed.startswith("u.") for speed in speeds):
        return
    for kind in ("udot", "force"):  # arrays of the speeds' width are in their order
        keys = dict(_LAYOUTS)[kind]
        same = [g for g, c in s.arrays.items() if key(g) in keys and len(c) == len(speeds)]
        for column, target in zip(s.arrays[same[0]] if len(same) == 1 else (), speeds):
            speed = target.removeprefix("u.")
            of = _of_speed(speed, s.names)[kind]
            if kind == "force" and speed.startswith(f"{joint}."):  # a wrench is one channel
                of = f"force.applied {joint}.{speed}"
            because = f"they are as many as the speeds, and {why}"
            yield Meaning(of, column, because, basis, frame=of_speed.get(speed, ""))


# --- what the motion tells -----------------------------------------------------------------------

_MOST_PAIRED = 60
"""Columns among which rates are searched for."""


def _orders(
    q: Sequence[str], u: Sequence[str], udot: Sequence[str] = ()
) -> Iterator[tuple[str, list[str]]]:
    """The usual orders of a state vector."""
    yield "coordinates and speeds", [*q, *u]
    if len(q) == len(u):
        if udot:
            yield "coordinates, speeds and accelerations", [*q, *u, *udot]
        yield "each coordinate with its speed", [x for pair in zip(q, u) for x in pair]
        yield "speeds and coordinates", [*u, *q]


@dataclass(frozen=True)
class _StateVector:
    """An array read as a state vector: columns by target; how far they miss; whether it is called one."""

    columns: Mapping[str, str]
    because: str
    miss: float | None
    named: bool
    usual: bool


def _state_vectors(s: _Search) -> Iterator[Meaning]:
    """An array, or a table without names, of coordinates and speeds, perhaps after the time.

    Its order is the one in which coordinates move as their speeds say; the name decides between arrays, and
    where nothing moves.
    """
    if any(target.startswith(("q.", "u.")) for target in s.meanings):
        return
    states = [state for name in s.arrays for state in _states(s, name)]
    agreeing = [one for one in states if one.miss is not None and one.miss < ROUGHLY]
    still = [one for one in states if one.miss is None and one.usual and one.named]
    sure = [one for one in agreeing if one.named] or agreeing or (still if len(still) == 1 else [])
    tested = [one for one in states if one.miss is not None]
    if not sure and (best := preferred(tested, lambda one: one.miss or 0.0)) is not None:
        sure = [best]
    for one in (sure or [one for one in states if one.usual and one.miss != np.inf])[:1]:
        # of two orders that fit, the first is usual; an array alone in its file is the table as well
        same = all(set(other.columns.values()) == set(one.columns.values()) for other in sure)
        # An order that the motion confirms, and in which alone it moves so, is no guess.
        confirmed = one in agreeing or (one.named and one.usual)
        basis: Basis = "declared" if confirmed else "motion"
        if not (sure and same):
            basis = "guess" if one.miss is None or sure else "open"
        for target, column in one.columns.items():
            yield Meaning(target, column, one.because, basis)


def _states(s: _Search, name: str) -> Iterator[_StateVector]:
    """An array in each order that its width allows."""
    array = s.arrays[name]
    for order, targets in _orders(*(s.targets[kind] for kind in ("q", "u", "udot"))):
        after = len(array) - len(targets)
        if after not in (0, 1) or (after and not _increases(s.raw.columns[array[0]])):
            continue
        columns = dict(zip(["time", *targets] if after else targets, array, strict=True))
        clocks = [s.values(array[0], "s")] if after else [t for _, t in _clocks(s)]
        rates = {
            n: columns[_next(n)] for n in columns if n[:2] in ("q.", "u.") and "udot" in targets[-1]
        }
        misses = [  # speeds must move as accelerations say, too
            max(miss, (s.misfit(t, rates) or 0.0) if rates else 0.0)
            for t in clocks
            if (miss := s.misfit(t, columns)) is not None
        ]
        what = "the table" if name == TABLE else repr(name)
        why = f"{what} has the width of {order} in the model's order"
        miss = min(misses, default=None)
        if miss is not None and miss < ROUGHLY:
            why += ", and they move so"
        usual = order == "coordinates and speeds"
        yield _StateVector(columns, why, miss, key(name) in _STATES and not after, usual)


def _next(target: str) -> str:
    """The column of the rate of a coordinate or a speed of its name."""
    kind, _, name = target.partition(".")
    return f"u.{name}" if kind == "q" else f"udot.{name}"


def _moving(s: _Search) -> Iterator[Meaning]:
    """Columns of unknown names that are rates of others: as many pairs as coordinates are missing."""
    coordinates, speeds = list(s.names.coordinates), list(s.names.speeds)
    pairs = [
        (f"q.{coordinates[i]}", f"u.{speeds[j]}")
        for i, j in RateNames.of(coordinates, speeds).rates
    ]
    missing = [pair for pair in pairs if pair[0] not in s.meanings and pair[1] not in s.meanings]
    time = s.raw.columns.get(s.meanings["time"].column) if "time" in s.meanings else None
    if not missing or time is None:
        return
    rows = slice(0, LONG_LOG)
    free = [
        c
        for c, values in s.raw.columns.items()
        if c not in s.used and len(values) == len(time) and np.ptp(values[rows]) > 0.0
    ][:_MOST_PAIRED]
    values = {c: s.values(c)[rows, None] for c in free}

    def follows(a: str, b: str) -> bool:
        size, difference = Movement.of(time[rows], values[a], values[b]).sizes()
        return a != b and difference < 0.5 * ROUGHLY * size

    rates = {a: [b for b in free if follows(a, b)] for a in free}
    single = [(a, several[0]) for a, several in rates.items() if len(several) == 1]
    seconds = {b for _, b in single}
    single = [(a, b) for a, b in single if a not in seconds]
    if len(single) == len(missing):
        for (q, u), (a, b) in zip(missing, single):
            why = f"{b!r} is the rate of {a!r}, and this their order in the file"
            yield Meaning(q, a, why, "guess")
            yield Meaning(u, b, why, "guess")


_RULES: Sequence[Callable[[_Search], Iterator[Meaning]]] = (
    lambda s: iter(s.times if len(s.times) == 1 else ()),
    _floating,
    lambda s: _unique(s, _by_unit(s)),
    lambda s: _unique(s, _by_words(s.named, s.joints)),
    lambda s: _unique(s, _of_motors(s)),
    _by_width,
    _alike,
    lambda s: _unique(s, _sole(s)),
    _state_vectors,
    _clock,
    _moving,
    _commands,
)
"""What recognises columns, the surest first."""
