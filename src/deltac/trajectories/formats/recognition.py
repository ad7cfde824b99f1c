"""What columns of other programs are, by how people name them, and by what they do: `recognise`.

A name is taken apart into words, as in ``/joint_states/Elbow.position [deg]``. The words of a coordinate of
the mechanism say what the column belongs to; of what is left every word must be known as one for positions,
velocities, accelerations or forces, or as one that says nothing. So ``elbow_pos_desired`` is nothing that
happened. Arrays are known by their name and their width. What is there twice is not taken.

Where names leave it open, the motion tells: coordinates move as their speeds say. That finds the times among
several columns, the order of a state vector, and which column is the rate of which.
"""

from __future__ import annotations

import difflib
import os
import re
import unicodedata
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import TypeAlias

import numpy as np

from deltac.trajectories.columns import ANGULAR, Kinematics, MechanismNames, si_unit
from deltac.trajectories.formats.floating import AGREES, Floating, floating_base, moving_poses
from deltac.trajectories.formats.raw import RawLog
from deltac.trajectories.formats.units import column_unit, converts, unit, without_unit
from deltac.trajectories.trajectory import FloatArray

WORDS: Mapping[str, frozenset[str]] = {
    "q": frozenset(
        "q qpos pos position positions angle angles value theta th phi psi disp displacement p "
        "winkel drehwinkel weg lage".split()
    ),
    "u": frozenset(
        "qd dq qdot qvel vel vels velocity velocities speed speeds rate omega w v angvel "
        "geschwindigkeit winkelgeschwindigkeit drehzahl".split()
    ),
    "udot": frozenset(
        "qdd ddq qddot qacc acc accel acceleration accelerations vdot udot alpha a b "
        "beschleunigung winkelbeschleunigung".split()
    ),
    "force": frozenset("tau torque torques trq effort efforts moment".split()),
}
"""Words that say what of a joint a column is. Single letters are those of Simscape's primitives: q, w, b,
p, v."""

TURNS = frozenset(
    "angle angles theta th phi psi omega w angular angvel winkel drehwinkel "
    "winkelgeschwindigkeit drehzahl rpm".split()
)
SLIDES = frozenset("x y z s disp displacement weg v linear".split())
"""Words of quantities of joints that turn, and that slide."""

_DERIVATIVES = {"dot": 1, "d": 1, "prime": 1, "ddot": 2, "dd": 2, "dt": 0}
"""Words that differentiate what stands beside them, and how often."""

NEUTRAL = frozenset(
    "joint joints jnt coord coordinate coordinates state states data robot sim simulated meas measured "
    "actual real "
    "signal signals values series simlog simout logsout out log jointset rx ry rz px py pz linear sensor "
    "jointstates "
    "jointstate body link motor dof dofs lin".split()
)
"""Words that say nothing of it."""

PLACES = frozenset("position pos translation trans location origin xyz".split())
"""Words of where a body is, without which three columns beside a quaternion are no position."""

TIMES = frozenset(
    "time t ts times tout datetime timestamp timestamps stamp sec secs seconds clock zeit tiempo "
    "temps".split()
)
NO_TIMES = frozenset(
    "wall cpu solve compute real delta dt step d duration sampling scheduled plan".split()
)
"""Words of columns that are times, but not of the samples."""

STEPS = frozenset("dt timestep ts h sampletime samplingtime sample period deltat".split())
RATES = frozenset("fs hz rate frequency freq samplerate samplingrate fps".split())
"""Names of single numbers that are the time between rows, s, and rows in a second."""

SKIPS = frozenset("frameskip nsubsteps substeps decimation actionrepeat controldecimation".split())
"""Names of single numbers that say how many such times lie between two rows."""

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
        ("q", "qpos q qs positions position pos jointpos jointpositions dofpos"),
        ("u", "qvel v vs u qd dq qdot velocities velocity vel jointvel jointvelocities dofvel"),
        ("udot", "qacc vdot qdd ddq udot qddot a accelerations acceleration"),
        ("force", "tau torque torques effort efforts jointtorques appliedtorques"),
    )
)
"""Names of arrays: of coordinates, of speeds, accelerations, forces."""

_STATES = frozenset("x xout state states yout y xs ys trajectory sol obs observations".split())
"""Names of arrays of coordinates and speeds in one."""

_COMMANDS = frozenset("ctrl control controls action actions act u input inputs command".split())
"""Names of arrays of what motors were told."""

_BASES = ("base", "root", "torso", "trunk", "pelvis", "floating base", "free", "")
"""What people call the one body that floats."""

CLOSE, ALMOST = 0.75, 0.85
"""Similarity of two names, and of whole columns, from which on one may be a slip of the other."""


@dataclass(frozen=True)
class Recognised:
    """A column that is taken for `target`, a column of the log schema, and why.

    A guess, which is not `certain`, is only written into a draft. `step` (s): the time between rows, where
    the times follow from that. `frame`: "world" or "body", whose components a floating body's velocity has,
    where it is not the schema's.
    """

    target: str
    column: str
    why: str
    certain: bool = True
    step: float | None = None
    frame: str = ""


@dataclass
class _Search:
    """What is known of a file's columns while they are recognised: those `found` by target, those `taken`."""

    raw: RawLog
    names: MechanismNames
    found: dict[str, Recognised] = field(default_factory=dict)
    taken: set[str] = field(default_factory=set)

    @cached_property
    def named(self) -> Named:
        """The words of each column."""
        common, parts = _common_path(list(self.raw.columns)), _components(self)
        return {c: _readings(parts.get(c, c), common) for c in self.raw.columns}

    @cached_property
    def groups(self) -> dict[str, list[str]]:
        """The columns of each array."""
        return _groups(self.raw)

    @cached_property
    def joints(self) -> list[_Joint]:
        """What columns may be of."""
        return list(_joints(self.names))

    @cached_property
    def targets(self) -> dict[str, list[str]]:
        """The columns of the schema of each kind, in the mechanism's order."""
        of_speeds = [_of_speed(name, self.names) for name in self.names.speeds]
        return {
            "q": [f"q.{name}" for name in self.names.coordinates],
            **{kind: [of[kind] for of in of_speeds] for kind in ("u", "udot", "force")},
        }

    @cached_property
    def times(self) -> list[Recognised]:
        """Columns that are called a time."""
        return list(_times(self))

    @property
    def columns(self) -> dict[str, str]:
        """The columns that are found, by target."""
        return {one.target: one.column for one in self.found.values()}

    def take(self, candidates: Iterator[Recognised]) -> None:
        """Keep what is new of the candidates."""
        if "time" in self.found and self.raw.columns.keys() <= self.taken:
            return  # no column is left to be anything
        for one in candidates:
            if one.target not in self.found and (one.column not in self.taken or not one.column):
                self.found[one.target] = one
                self.taken.add(one.column)

    def told(self, column: str, si: str | None) -> str | None:
        """The unit that the file or the column's name says, if it converts to `si`."""
        told = self.raw.units.get(column) or column_unit(column, si)
        return told if told and si and converts(told, si) else None

    def in_si(self, column: str, si: str | None) -> FloatArray:
        """The values of a column, from its unit."""
        told = self.told(column, si)
        return (unit(told).factor if told else 1.0) * self.raw.columns[column]


def recognise(raw: RawLog, names: MechanismNames) -> list[Recognised]:
    """What the columns of a file are for a mechanism: at most one for each column of the schema."""
    search = _Search(raw, names)
    for rule in _RULES:
        search.take(rule(search))
    found = search.found
    frames = {one.frame for one in found.values() if one.target.startswith(("u.", "udot."))}
    rates = search.targets["udot"]
    known = all(target in found for target in rates)
    if not known or (frames > {""} and not any(found[target].frame for target in rates)):
        return [one for one in found.values() if not one.target.startswith("udot.")]
    return list(found.values())


Named: TypeAlias = "Mapping[str, tuple[tuple[str, ...], ...]]"
"""Column -> its words, with and without what may be a unit at its end."""


def _readings(column: str, common: str) -> tuple[tuple[str, ...], ...]:
    column = column.removeprefix(common)
    return tuple(dict.fromkeys((_words(without_unit(column)), _words(column))))


def _components(s: _Search) -> dict[str, str]:
    """Columns of arrays of three or four numbers, by the letters of their components."""
    letters = {3: "xyz", 4: "wxyz"}
    return {
        column: f"{group}_{letter}"
        for group, columns in s.groups.items()
        if len(columns) in letters
        and (len(columns) == 3 or "quat" in group.lower() or "rot" in group.lower())
        for column, letter in zip(columns, letters[len(columns)])
    }


def _common_path(columns: Sequence[str]) -> str:
    """What all names with a path have before them: the name of a variable, a topic, or a model."""
    paths = [column for column in columns if re.search(r"[^./][./]|: ", column)]
    common = os.path.commonprefix(paths) if len(paths) > 1 else ""
    return common[: max(map(common.rfind, ".:/")) + 1]


@lru_cache(4096)
def _words(name: str) -> tuple[str, ...]:
    """The words of a name, in small letters."""
    text = unicodedata.normalize("NFC", re.sub(r"['′]", " prime ", name.replace("(t)", "")))
    text = "".join(str(unicodedata.digit(c, c)) for c in text)  # θ₁
    plain = []
    for letter in text:
        parts = unicodedata.normalize("NFD", letter)
        base, marks = parts[:1], parts[1:]
        # ẋ has a dot; ü has two, and is no second derivative.
        dots = "".join(_DOTS.get(m, "") for m in marks if base.lower() not in "aeiou")
        plain.append(f" {_GREEK[base]} {dots}" if base in _GREEK else _DOTS.get(base, base) + dots)
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", "".join(plain))
    return tuple(re.findall(r"[^\W\d_]+|\d+", spaced.lower()))


# --- time ----------------------------------------------------------------------------------------


def _times(s: _Search) -> Iterator[Recognised]:
    """Columns that are called a time and increase: one that is sure, or those that may be."""
    times = [
        column
        for column, words in s.named.items()
        if any(map(_is_time, (*words, _last_part(column)))) and _increases(s.raw.columns[column])
    ]
    exact = [c for c in times if {("time",), ("t",), ("tout",)} & set(s.named[c])]
    several = exact or times
    if several:
        first = s.raw.columns[several[0]]
        same = all(np.array_equal(s.raw.columns[other], first) for other in several)
        for column in several[:1] if same or len(exact) == 1 else several:
            sure = same or len(exact) == 1
            yield Recognised("time", column, "called a time", certain=sure)


def _increases(values: FloatArray) -> bool:
    known = values[~np.isnan(values)]
    return bool(len(known) and np.all(np.diff(known) > 0.0))


def is_time(column: str) -> bool:
    """Whether a column is called a time of the samples."""
    return any(map(_is_time, _readings(column, "")))


def _is_time(words: tuple[str, ...]) -> bool:
    if not words or NO_TIMES & set(words[:-1]):
        return False
    return words[-1] in ("time", "times", "timestamp", "timestamps", "tout", "stamp") or (
        set(words) <= TIMES | NEUTRAL and bool(set(words) & (TIMES - {"sec"}))
    )


def _step(s: _Search) -> Iterator[Recognised]:
    """A single number that is the time between rows, where no column is the time.

    It is sure if the motion agrees; steps of physics may be so many times shorter as another number says.
    """
    steps = [] if "time" in s.found else _steps(s)
    if not steps:
        return
    columns = s.columns
    rows = len(s.raw.columns[next(iter(columns.values()))]) if columns else 0
    for word, step in steps:
        misfit = _misfit(step * np.arange(float(rows)), columns, s)
        if misfit is not None and misfit < AGREES:
            yield _counted(word, step)
            return
    word, step = steps[min(1, len(steps) - 1)]
    yield Recognised("time", "", f"rows are {step:g} s apart, by {word!r}", False, step)


def _counted(word: str, step: float) -> Recognised:
    why = f"rows are {step:g} s apart, by {word!r} and how the coordinates move"
    return Recognised("time", "", why, True, step)


def _steps(s: _Search) -> list[tuple[str, float]]:
    """What single numbers say of the time between rows (s), and their names.

    Steps of physics may be so many times shorter as another number says.
    """
    plain = [(_words(name.rpartition(".")[2]), value) for name, value in s.raw.scalars.items()]
    skips = [value for words, value in plain if value > 1.0 and "".join(words) in SKIPS]
    steps = []
    for words, value in plain:
        ends = {"".join(words[k:]) for k in range(len(words))}  # sim_dt, control_freq
        step = value if ends & STEPS else 1.0 / value if ends & RATES and value > 0.0 else 0.0
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
            for alias in ("angular", "ang", "angvel", "gyro"):
                turning = {"q": f"u.{name}", **_of_speed(name, names)}
                yield _Joint((*_words(joint), alias, part[1]), turning)


def _of_speed(speed: str, names: MechanismNames) -> dict[str, str]:
    return {
        "u": f"u.{speed}",
        "udot": f"udot.{speed}",
        "force": f"force.{force_channel(speed, names)}.{speed}",
    }


def force_channel(speed: str, names: MechanismNames) -> str:
    """The channel of a motor's force on a speed: that of the model's motor there, if it has one."""
    return names.motors.get(speed, f"actuator {speed}")


def _aliases(names: MechanismNames) -> Iterator[_Joint]:
    """Other names of coordinates: of the one joint that floats; of the body that a joint carries."""
    floating = [n.removesuffix(".qw") for n in names.coordinates if n.endswith(".qw")]
    for joint in _joints(names):
        first = _words(floating[0]) if len(floating) == 1 else ()
        if first and joint.words[: len(first)] == first:
            for base in _BASES:
                yield _Joint((*_words(base), *joint.words[len(first) :]), joint.targets)
        body = names.bodies.get(joint.targets.get("q", "").removeprefix("q."))
        if body:
            yield _Joint(_words(body), joint.targets)


def _by_words(named: Named, joints: Sequence[_Joint], certain: bool = True) -> Iterator[Recognised]:
    """Columns that name a coordinate and what of it, with how many words of them agree."""
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
            why = "by its name" if certain else "by another name of the joint or its body"
            yield Recognised(targets.pop(), column, why, certain)


_ACTUATION = frozenset("force forces actuation actuator motor".split())
"""Words beside the name of a motor that say no more than that it acts."""


def _of_motors(s: _Search) -> Iterator[Recognised]:
    """Columns that name a motor of the model and say, by a word or their unit, that they are its force."""
    for speed, channel in s.names.motors.items():
        motor = _words(channel.removeprefix("actuator "))
        si = "N*m" if si_unit(f"u.{speed}", s.names) == "rad/s" else "N"
        for column, readings in s.named.items():
            known = _ACTUATION | WORDS["force"] | NEUTRAL
            if in_unit := s.told(column, si) is not None:
                known |= {"t", "f", "m"}  # T, F and M of a torque or force
            for words in readings:
                left = _without(words, motor)
                acts = in_unit or set(words) & (_ACTUATION | WORDS["force"])
                if left is not None and acts and set(left) <= known:
                    target = f"force.{channel}.{speed}"
                    yield Recognised(target, column, "the motor's name")
                    break


@lru_cache(1 << 16)
def _without(words: tuple[str, ...], part: tuple[str, ...]) -> tuple[str, ...] | None:
    """The words that are left without those of a joint, which must be there in their order."""
    left, at = [], 0
    for word in words:
        if at < len(part) and word == part[at]:
            at += 1
        else:
            left.append(word)
    return tuple(left) if at == len(part) and part else None


@lru_cache(4096)
def _kind(left: tuple[str, ...]) -> str | None:
    """What of a joint the other words of a column mean: "q", "u", "udot", "force"; None for nothing known."""
    words = [part for word in left if word not in NEUTRAL for part in _unglued(word)]
    if len(words) > 1 and words[0] == "angular":
        words = words[1:]
    times = sum(_DERIVATIVES.get(word, 0) for word in words)
    telling = [word for word in words if word not in _DERIVATIVES]
    kinds = [{kind for kind, known in WORDS.items() if word in known} for word in telling]
    common = set.intersection(*kinds) if kinds else {"q"}
    if times > 2 or (telling and times and not common & {"q", "u"}):
        return None
    if len(common) != 1:
        return None
    kind = common.pop()
    orders = ["q", "u", "udot"]
    place = orders.index(kind) + times if kind in orders else 0
    if not times:
        return kind
    return orders[place] if place < len(orders) else None


_KNOWN = frozenset().union(*WORDS.values(), _DERIVATIVES)
_GLUED = re.compile(r"(d{0,2})([^\W\d_]+?)(dot|ddot|dotdot|d|dd|p|pp|prime)?")


def _unglued(word: str) -> list[str]:
    """A word with what differentiates it apart: ``thetadot``, ``dtheta``, ``thdd``, ``xp``."""
    if word in _KNOWN or not (match := _GLUED.fullmatch(word)):
        return [word]
    before, stem, after = match.groups()
    if stem not in WORDS["q"] | SLIDES - {"v"}:
        return [word]
    dots = len(before) + {"dot": 1, "d": 1, "p": 1, "prime": 1, None: 0}.get(after, 2)
    return [stem, *["dot"] * dots]


UNREAL = frozenset(
    "desired des ref reference target targets cmd command commanded setpoint goal plan planned error err std "
    "var cov covariance min max limit limits prev previous next last offset bias".split()
)
"""Words of columns that are nothing that happened."""


def _alike(s: _Search) -> Iterator[Recognised]:
    """Columns that name a coordinate beside words that all of these have, which then tell nothing.

    They are sure where the coordinates move as their speeds say.
    """
    parts = {
        column: tuple(part for word in readings[0] for part in _unglued(word))
        for column, readings in s.named.items()
        if any(_without(readings[0], joint.words) is not None for joint in s.joints)
    }
    if len(parts) < 2:
        return
    several = {word for joint in s.joints for word in joint.words}
    common = set.intersection(*map(set, parts.values())) - _KNOWN - UNREAL - several
    plain: Named = {
        column: (tuple(word for word in words if word not in common),)
        for column, words in parts.items()
    }
    several_found = list(_unique(s, _by_words(plain, s.joints)))
    columns = {one.target: one.column for one in (*several_found, *s.found.values()) if one.certain}
    t = s.in_si(columns["time"], "s") if columns.get("time") else None
    misfit = _misfit(t, columns, s) if t is not None else None
    sure = misfit is not None and misfit < AGREES
    for one in several_found:
        yield replace(one, certain=one.certain and sure)


def _unique(s: _Search, candidates: Iterator[Recognised]) -> Iterator[Recognised]:
    """Of the columns for one target the first, as a guess if several say different things."""
    by_target: dict[str, list[Recognised]] = {}
    for one in candidates:
        by_target.setdefault(one.target, []).append(one)
    for target, several in by_target.items():
        first = several[0]
        values = [s.in_si(one.column, si_unit(target, s.names)) for one in several]
        same = all(
            len(v) == len(values[0]) and np.allclose(v, values[0], rtol=1e-4, atol=0.0)
            for v in values[1:]
        )
        if same or not first.certain:
            yield first
        else:
            others = ", ".join(repr(one.column) for one in several[1:4])
            yield Recognised(target, first.column, f"by its name; or {others}", certain=False)


def _sole(s: _Search) -> Iterator[Recognised]:
    """Columns that say only what they are: of the one joint, or of the one that turns, or slides."""
    joints = [j for j in s.joints if "q" in j.targets and "u" in j.targets]
    joints = [j for j in joints if j.targets["q"].startswith("q.")]
    letters = {
        word for readings in s.named.values() for word in readings[0] if word in ("x", "y", "z")
    }
    places = letters if len(letters) > 1 else set()  # of a point, not of a joint
    for column, readings in s.named.items():
        parts = [part for word in readings[0] for part in _unglued(word)]
        kind = _kind(
            tuple(part if part not in ("x", "y", "z", "s") else "displacement" for part in parts)
        )
        telling = set(parts)
        if kind == "udot" and all(len(part) == 1 for part in telling):
            continue  # Simscape's letters beside names of joints; alone they are anything
        if column in s.taken or kind is None or not telling - NEUTRAL - _DERIVATIVES.keys():
            continue
        told = _told_unit(s, column)
        turns, slides = (bool(telling & known) for known in (TURNS, SLIDES))
        if told is not None:
            turns, slides = told == "rad", told == "m"
        wanted = (
            {"rad"} if turns and not slides else {"m"} if slides and not turns else {"rad", "m"}
        )
        fitting = [
            j for j in joints if kind in j.targets and si_unit(j.targets["q"], s.names) in wanted
        ]
        if len(fitting) != 1 and len(joints) == 1 and told is None and "v" in telling:
            fitting = joints
        if (
            places
            and telling & places
            and told is None
            and "rad" in {si_unit(joint.targets["q"], s.names) for joint in fitting}
        ):
            continue
        sure = len(fitting) == 1
        if len(joints) == 1 and told is None and not (places and telling & places):
            fitting = joints  # a pendulum's x may be its angle, or how far its bob is
        if len(fitting) == 1:
            what = "the joint" if len(joints) == 1 else "the joint that turns or slides so"
            yield Recognised(fitting[0].targets[kind], column, f"of {what}, by its name", sure)


def _told_unit(s: _Search, column: str) -> str | None:
    """Whether a column's unit is one of turning ("rad") or sliding ("m")."""
    for si in ("rad", "rad/s", "rad/s^2", "m", "m/s", "m/s^2"):
        if s.told(column, si):
            return si.partition("/")[0]
    return None


# --- arrays and numbers --------------------------------------------------------------------------


def _by_width(s: _Search) -> Iterator[Recognised]:
    """Arrays that are called so, where just one has as many columns as the mechanism has entries.

    Arrays of joints may leave out the one that floats.
    """
    motors = [f"force.{channel}.{speed}" for speed, channel in s.names.motors.items()]
    for kind, keys in _LAYOUTS:
        for targets in [*_widths(s, kind), *([motors] if kind == "force" and motors else [])]:
            fitting = [
                (group, columns)
                for group, columns in s.groups.items()
                if len(columns) == len(targets)
                and columns != ["a"]  # alone it is anything
                and (_key(group) in keys or (len(columns) > 1 and _array_kind(group) == kind))
            ]
            if len(fitting) == 1:
                group, columns = fitting[0]
                for target, column in zip(targets, columns, strict=True):
                    yield Recognised(
                        target, column, f"in the model's order, by the width of {group!r}"
                    )
                break


def _commands(s: _Search) -> Iterator[Recognised]:
    """Arrays of commands, as many as the model has motors: their forces, unless the motors have gears."""
    for group, columns in s.groups.items():
        free = not s.taken & set(columns)
        if free and _key(group) in _COMMANDS and len(columns) == len(s.names.motors):
            for (speed, channel), column in zip(s.names.motors.items(), columns):
                why = "commands, as many as motors; forces if a command of 1 is 1 N·m or 1 N"
                yield Recognised(f"force.{channel}.{speed}", column, why, certain=False)


def _widths(s: _Search, kind: str) -> list[list[str]]:
    """All columns of a kind, and those without the one joint that floats."""
    every = s.targets[kind]
    floating = [n.removesuffix("qw") for n in s.names.coordinates if n.endswith(".qw")]
    rest = [t for t in every if not any(f".{joint}" in t for joint in floating)]
    return [every, rest] if len(floating) == 1 and rest else [every]


def _array_kind(group: str) -> str | None:
    """What an array of all joints is by the words of its name: ``dofs_position``."""
    words = _words(re.split(r"[./]", group)[-1])
    return _kind(words) if set(words) - NEUTRAL else None


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


def _numbered(s: _Search) -> Iterator[Recognised]:
    """Columns with consecutive numbers, as many as the mechanism has entries, such as q1 and q2."""
    groups: dict[tuple[str, ...], dict[int, str]] = {}
    for column, (words, *_) in s.named.items():
        places = [k for k, word in enumerate(words) if word.isdecimal()]
        if len(places) == 1 and len(words) > 1:
            k = places[0]
            groups.setdefault((*words[:k], "#", *words[k + 1 :]), {})[int(words[k])] = column
    by_kind: dict[str, list[tuple[list[str], dict[int, str]]]] = {}
    for words, columns in groups.items():
        kind = _kind(tuple(word for word in words if word != "#"))
        first = min(columns)
        if kind is None or first > 1 or sorted(columns) != list(range(first, first + len(columns))):
            continue
        fitting = [targets for targets in _widths(s, kind) if len(targets) == len(columns)]
        if fitting:
            by_kind.setdefault(kind, []).append((fitting[0], columns))
    for several in by_kind.values():
        if len(several) == 1:
            targets, columns = several[0]
            ordered = [columns[number] for number in sorted(columns)]
            for target, column in zip(targets, ordered, strict=True):
                yield Recognised(target, column, "in the model's order, by its number")


# --- guesses -------------------------------------------------------------------------------------


def _by_name_and_unit(s: _Search) -> Iterator[Recognised]:
    """Columns called as a joint, and nothing else, in a unit that says what of it: ``elbow_rad_s``."""
    units = {"rad": ("rad", "rad/s", "rad/s^2", "N*m"), "m": ("m", "m/s", "m/s^2", "N")}
    for joint in s.joints:
        si = units.get(si_unit(joint.targets["q"], s.names) or "", ("",) * 4)
        for column, readings in s.named.items():
            left = _without(readings[0], joint.words)
            if left is None or set(left) - NEUTRAL:
                continue
            for kind, of_kind in zip(("q", "u", "udot", "force"), si):
                if kind in joint.targets and (told := s.told(column, of_kind)):
                    why = f"by its name and its unit {told}"
                    yield Recognised(joint.targets[kind], column, why)


def _by_unit(s: _Search) -> Iterator[Recognised]:
    """Columns that name a joint beside words nobody knows, but have the unit of its position or speed."""
    for column, readings in s.named.items():
        if column in s.taken:
            continue
        for joint in s.joints:
            if _without(readings[0], joint.words) is None:
                continue
            for kind in ("q", "u"):
                target = joint.targets.get(kind, "")
                si = si_unit(target, s.names) if target else None
                if told := s.told(column, si):
                    why = f"names the joint, and is in {told}"
                    yield Recognised(target, column, why, certain=False)


def _slips(s: _Search) -> Iterator[Recognised]:
    """Columns whose names almost fit what is missing."""
    free = [column for column in s.named if column not in s.taken]
    for kind in ("q", "u"):
        for target in s.targets[kind]:
            if target not in s.found:
                name = target.partition(".")[2]
                scores = [
                    (_likeness(column, s.named[column][0], target, name, kind), column)
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
        if _kind((*telling[:k], *telling[k + 1 :])) == kind:
            ratio = difflib.SequenceMatcher(None, "".join(_words(name)), word).ratio()
            best = max(best, ratio)
    return best


# --- what the motion tells -------------------------------------------------------------------------

_LOOKED_AT = 4000
"""Rows that this is looked at in."""
_MOST_PAIRED = 60
"""Columns among which rates are searched for."""


def _misfit(t: FloatArray, columns: Mapping[str, str], s: _Search) -> float | None:
    """How far coordinates do not move as their speeds say, as a fraction of how far they move.

    None where no coordinate with its speed is among the columns (target -> column), or nothing moves.
    """
    rows = slice(0, _LOOKED_AT)
    change = apart = 0.0
    coordinates, speeds = list(s.names.coordinates), list(s.names.speeds)
    kinematics = Kinematics.of(coordinates, speeds)
    for i, j in kinematics.rates:
        pair = [f"q.{coordinates[i]}", f"u.{speeds[j]}"]
        if not all(target in columns and columns[target] in s.raw.columns for target in pair):
            continue
        q, u = (s.in_si(columns[target], si_unit(target, s.names))[rows] for target in pair)
        if not len(q) == len(u) == len(t[rows]):
            return None
        dq, integral = np.diff(q), 0.5 * np.diff(t[rows]) * (u[1:] + u[:-1])
        change += float(np.nansum(np.abs(dq)) + np.nansum(np.abs(integral)))
        apart += float(np.nansum(np.abs(dq - integral)))
    for _, first, _ in kinematics.quaternions:
        parts = [columns.get(f"q.{name}", "") for name in coordinates[first : first + 4]]
        if all(part in s.raw.columns for part in parts):
            norm = sum(s.raw.columns[part][rows] ** 2 for part in parts)
            if not np.nanmax(np.abs(norm - 1.0)) < AGREES:
                return np.inf
    return apart / change if change > 0.0 else None


def _floating(s: _Search) -> Iterator[Recognised]:
    """The one body that floats, by how it moves, and the joints in the same arrays."""
    joints = [name.removesuffix(".qw") for name in s.names.coordinates if name.endswith(".qw")]
    if len(joints) != 1 or f"{joints[0]}.vx" not in s.names.speeds:
        return
    for clock, t in _clocks(s):
        columns = [c for c, x in s.raw.columns.items() if len(x) == len(t) and c != clock.column]
        rows = slice(0, _LOOKED_AT)
        table = np.column_stack([_factor(s, c) * s.raw.columns[c][rows] for c in columns])
        known = ~np.isnan(table).any(axis=1)
        letters = [_last_letter(c) for c in columns]
        places = {k for k, c in enumerate(columns) if PLACES & set(_words(without_unit(c)))}
        vectors = _vectors(columns, letters)
        scaled = (  # whole milliseconds and the like are told once the log is read
            floating_base(factor * t[rows][known], table[known], vectors) for factor in _SECONDS
        )
        base = next((one for one in scaled if one is not None), None)
        if base is not None:
            yield clock
            yield from _of_floating(base, joints[0], columns, t, s)
            return
        poses = list(moving_poses(table[known], letters, places))
        if len(poses) == 1:
            why = "the one pose that moves"
            parts = (*(f"q{c}" for c in "wxyz"), *"xyz")
            for part, place in zip(parts, poses[0], strict=True):
                yield Recognised(f"q.{joints[0]}.{part}", columns[place], why)
            return


def _vectors(columns: Sequence[str], letters: Sequence[str]) -> list[range]:
    """Three consecutive columns that are a vector by their names: of an array, or by x, y and z."""
    arrays = [re.sub(r"\[\d+\]$", "", column) for column in columns]
    found = []
    for k in range(len(columns) - 2):
        array = arrays[k]
        whole = arrays[k : k + 3] == [array] * 3 and arrays.count(array) == 3
        if whole or list(letters[k : k + 3]) == ["x", "y", "z"]:
            found.append(range(k, k + 3))
    return found


def _last_part(column: str) -> tuple[str, ...]:
    """The last part of a path, where it is a time whatever stands before."""
    parts = map(_words, reversed(re.split(r"[./]", column)))
    words = next((words for words in parts if not set(words) <= NEUTRAL), ())
    return words if words in (("t",), ("time",)) else ()


_SECONDS = (1.0, 1e-3, 1e-6, 1e-9)
"""Units that times without a unit may have, s."""


def _last_letter(column: str) -> str:
    words = _words(without_unit(column))
    return words[-1][-1] if words else ""


def _clocks(s: _Search) -> Iterator[tuple[Recognised, FloatArray]]:
    """The times that rows may have: the known ones, else by single numbers, or columns that increase."""
    if "time" in s.found:
        yield s.found["time"], s.in_si(s.found["time"].column, "s")
        return
    lengths = [len(values) for values in s.raw.columns.values()]
    rows = max(set(lengths), key=lengths.count, default=0)
    for word, step in _steps(s):
        yield _counted(word, step), step * np.arange(float(rows))
    why = "by it the floating body moves as its speeds say"
    for column in dict.fromkeys([*(one.column for one in s.times), *s.raw.columns]):
        if _increases(s.raw.columns[column]):
            yield Recognised("time", column, why), s.in_si(column, "s")


def _of_floating(
    base: Floating, joint: str, columns: Sequence[str], t: FloatArray, s: _Search
) -> Iterator[Recognised]:
    """Columns of a floating body, and those of the joints that stand in its arrays."""
    why = f"as the body moves: {base}"
    frames = {
        "v": "body" if base.linear_frame == "body" else "",
        "w": "world" if base.angular_frame == "world" else "",
    }
    places = {
        **{f"q.{joint}.{c}": k for c, k in zip("xyz", base.position)},
        **{f"q.{joint}.q{c}": k for c, k in zip("wxyz", base.quaternion)},
        **{f"u.{joint}.v{c}": k for c, k in zip("xyz", base.linear)},
        **{f"u.{joint}.w{c}": k for c, k in zip("xyz", base.angular)},
    }
    targets = {target: columns[k] for target, k in places.items()}
    of_speed = {
        target.removeprefix("u."): frames[target.rpartition(".")[2][0]]
        for target in targets
        if target.startswith("u.")
    }
    nameless = all(re.fullmatch(r"column \d+", column) for column in columns)
    groups = {"the table": list(columns)} if nameless else s.groups
    group_of = {column: group for group, several in groups.items() for column in several}
    first_q, first_u = (group_of[columns[k]] for k in (base.quaternion[0], base.angular.start))
    taken = set(targets.values())
    rest_q, rest_u = (
        [c for c in groups[group] if c not in taken and c in columns]
        for group in (first_q, first_u)
    )
    every = s.targets
    q, u = ([t for t in every[kind] if t not in targets] for kind in ("q", "u"))
    if first_q == first_u:
        orders = ([*q, *u], [x for pair in zip(q, u) for x in pair], [*u, *q])
        options = [dict(zip(order, rest_q)) for order in orders if len(order) == len(rest_q)]
    else:
        fits = len(q) == len(rest_q) and len(u) == len(rest_u)
        options = [dict(zip([*q, *u], [*rest_q, *rest_u]))] if fits else []
    misses = [_misfit(t, option, s) for option in options]
    for option, miss in zip(options, misses):
        if miss is None or miss < AGREES:
            targets |= option
            break
    for target, column in targets.items():
        frame = of_speed.get(target.removeprefix("u."), "")
        yield Recognised(target, column, why, frame=frame)
    inverse = {column: target for target, column in targets.items()}
    speeds = [inverse.get(column, "") for column in groups[first_u]]
    if first_u == first_q or not all(speed.startswith("u.") for speed in speeds):
        return
    for kind in ("udot", "force"):  # arrays of the speeds' width are in their order
        keys = dict(_LAYOUTS)[kind]
        same = [g for g, c in groups.items() if _key(g) in keys and len(c) == len(speeds)]
        for column, target in zip(groups[same[0]] if len(same) == 1 else (), speeds):
            speed = target.removeprefix("u.")
            of = _of_speed(speed, s.names)[kind]
            yield Recognised(
                of, column, f"in the order of the speeds; {why}", frame=of_speed.get(speed, "")
            )


def _orders(s: _Search) -> Iterator[tuple[str, list[str]]]:
    """The usual orders of a state vector."""
    q, u = s.targets["q"], s.targets["u"]
    yield "coordinates and speeds", [*q, *u]
    if len(q) == len(u):
        yield "coordinates, speeds and accelerations", [*q, *u, *s.targets["udot"]]
        yield "each coordinate with its speed", [t for pair in zip(q, u) for t in pair]
        yield "speeds and coordinates", [*u, *q]


def _state_vectors(s: _Search) -> Iterator[Recognised]:
    """An array, or a table without names, of coordinates and speeds, perhaps after the time.

    Its order is the one in which coordinates move as their speeds say; the name decides only between arrays,
    and where nothing moves, or the times are not known.
    """
    if any(target.startswith(("q.", "u.")) for target in s.found):
        return
    groups = dict(s.groups)
    for column in s.raw.columns:  # y1, y2; y(1), y(2)
        if not column.endswith("]") and (match := _NUMBERED.fullmatch(column)):
            groups.setdefault(match[1].strip(), []).append(column)
    nameless = [column for column in s.raw.columns if _NAMELESS.fullmatch(column)]
    if nameless and len(nameless) == len(s.raw.columns):
        groups = {"the table": nameless, **groups}
    time = s.found["time"].column if "time" in s.found else None
    times = [time] if time else [c for c, values in s.raw.columns.items() if _increases(values)]
    agreeing: list[tuple[dict[str, str], str, str]] = []
    named: list[tuple[dict[str, str], str, str]] = []
    guessed: list[tuple[dict[str, str], str, str]] = []
    for group, columns in groups.items():
        for name, targets in _orders(s):
            after = len(columns) - len(targets)
            first = s.raw.columns[columns[0]]
            if after not in (0, 1) or (after and not _increases(first)):
                continue
            mapped = dict(zip(["time", *targets] if after else targets, columns, strict=True))
            why = f"in the model's order, {name}, by the width of {group!r}"
            found_misfits = [
                m
                for c in ([columns[0]] if after else times)
                if (m := _misfit(s.in_si(c, "s"), mapped, s)) is not None
            ]
            misfit = min(found_misfits, default=None)
            if misfit is not None and "udot" in targets[-1]:  # speeds must move so, too
                rates = {t: mapped[_next(t)] for t in mapped if t.startswith(("q.", "u."))}
                clock = s.in_si(columns[0] if after else times[0], "s")
                misfit = max(misfit, _misfit(clock, rates, s) or 0.0)
            if misfit is not None and misfit < AGREES:
                agreeing.append((mapped, f"{why} and how they move", group))
            elif name == "coordinates and speeds" and misfit != np.inf:
                (named if _key(group) in _STATES and not after else guessed).append(
                    (mapped, why, group)
                )
    by_name = [one for one in agreeing if _key(one[2]) in _STATES]
    sure = by_name if by_name else agreeing
    if not agreeing and len(named) == 1:
        sure = named
    for mapped, why, _ in (sure or named or guessed)[:1]:
        # of two orders that fit, the first is usual; an array alone in its file is the table as well
        same = all(set(one[0].values()) == set(mapped.values()) for one in sure)
        for target, column in mapped.items():
            yield Recognised(target, column, why, certain=bool(sure) and same)


def _next(target: str) -> str:
    """The column of the rate of a coordinate or a speed of its name."""
    kind, _, name = target.partition(".")
    return f"u.{name}" if kind == "q" else f"udot.{name}"


def _moving_times(s: _Search) -> Iterator[Recognised]:
    """The one increasing column by which the coordinates move as their speeds say, whatever its name."""
    if "time" in s.found:
        return
    columns = s.columns
    fitting = [
        column
        for column, values in s.raw.columns.items()
        if column not in columns.values() and _increases(values)
        if (misfit := _misfit(s.in_si(column, "s"), columns, s)) is not None and misfit < AGREES
    ]
    if fitting:
        first = s.raw.columns[fitting[0]]
        shifts = [
            np.ptp(s.raw.columns[c] - first) if len(s.raw.columns[c]) == len(first) else np.inf
            for c in fitting
        ]
        same = bool(np.max(shifts) <= 1e-3 * np.ptp(first))
        yield Recognised("time", fitting[0], "by it coordinates move as their speeds say", same)


def _moving(s: _Search) -> Iterator[Recognised]:
    """Columns of unknown names that are rates of others: as many pairs as coordinates are missing."""
    coordinates, speeds = list(s.names.coordinates), list(s.names.speeds)
    pairs = [
        (f"q.{coordinates[i]}", f"u.{speeds[j]}")
        for i, j in Kinematics.of(coordinates, speeds).rates
    ]
    missing = [pair for pair in pairs if pair[0] not in s.found and pair[1] not in s.found]
    time = s.raw.columns.get(s.found["time"].column) if "time" in s.found else None
    if not missing or time is None:
        return
    rows = slice(0, _LOOKED_AT)
    free = [
        c
        for c, values in s.raw.columns.items()
        if c not in s.taken and len(values) == len(time) and np.ptp(values[rows]) > 0.0
    ][:_MOST_PAIRED]
    values = {c: s.in_si(c, None)[rows] * _factor(s, c) for c in free}
    h = np.diff(time[rows])
    changes = {c: np.diff(v) for c, v in values.items()}
    integrals = {c: 0.5 * h * (v[1:] + v[:-1]) for c, v in values.items()}

    def follows(a: str, b: str) -> bool:
        apart = float(np.nansum(np.abs(changes[a] - integrals[b])))
        size = float(np.nansum(np.abs(changes[a])) + np.nansum(np.abs(integrals[b])))
        return a != b and apart < 0.5 * AGREES * size

    rates = {a: [b for b in free if follows(a, b)] for a in free}
    found_pairs = [(a, several[0]) for a, several in rates.items() if len(several) == 1]
    seconds = {b for _, b in found_pairs}
    found_pairs = [(a, b) for a, b in found_pairs if a not in seconds]
    if len(found_pairs) == len(missing):
        for (q, u), (a, b) in zip(missing, found_pairs):
            why = f"in the order of the file; {b!r} is the rate of {a!r}"
            yield Recognised(q, a, why, certain=False)
            yield Recognised(u, b, why, certain=False)


def _factor(s: _Search, column: str) -> float:
    """The factor to SI of the unit in brackets, or that the file says."""
    told = s.raw.units.get(column) or column_unit(column)
    return unit(told).factor if told else 1.0


_NAMELESS = re.compile(r"column \d+|.*\[\d+\]")
_NUMBERED = re.compile(r"(.*?[^\W\d_])[ _]?[(\[]?\d+[)\]]?")

_RULES: Sequence[Callable[[_Search], Iterator[Recognised]]] = (
    lambda s: iter(s.times if len(s.times) == 1 else ()),
    _floating,
    lambda s: _unique(s, _by_name_and_unit(s)),
    lambda s: _unique(s, _by_words(s.named, s.joints)),
    lambda s: _unique(s, _of_motors(s)),
    _by_width,
    _numbered,
    _alike,
    lambda s: _unique(s, _sole(s)),
    _state_vectors,
    _moving_times,
    lambda s: iter(s.times),
    _step,
    lambda s: _unique(s, _by_unit(s)),
    lambda s: _unique(s, _by_words(s.named, list(_aliases(s.names)), certain=False)),
    _slips,
    _moving,
    _commands,
)
"""What recognises columns, the surest first."""
