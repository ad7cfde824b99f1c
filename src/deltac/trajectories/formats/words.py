"""The words by which columns of other programs are named, and what they mean.

- A name is split into words, as in `elbow_pos`, `Elbow.Rz.q`, `/joint_states/Elbow.position [deg]` or
  `θ elbow`; Greek letters, dots and primes count as words. The words of a coordinate must occur. Every
  other word must denote a position, a speed, an acceleration or a motor's force, be neutral, or occur
  in every column of a joint. So `elbow_pos_desired` is not read, nor are two columns with the same
  meaning and different values.
- `theta`, `omega`, `x`, `xdot` suffice if the model has one joint, or one that turns and one that
  slides. Names that differ in one number alone are an array: as many `q1, q2, …` as the model has are
  in its order.
- Forces of motors are named after the joint, or after the model's motor with a word or unit of force:
  `lift_torque`, `T_lift (Nm)`. Commands (`ctrl`, `action`, `u`) are only guessed in the draft of a
  mapping, since with a gear they are not forces.
- Times are columns, dates, durations, integers since 1970, or seconds and nanoseconds in two columns;
  or a single `dt`, `fps`, or `timestep` with `frame_skip`.
- Units stand in brackets, after a comma or a slash, at the end (`elbow_deg_s`), or in a row below the
  names; for arrays in an entry `units` (`{"q": "deg"}`, `{"angle": "deg", "rate": "deg/s"}`) or
  `q_unit`. Otherwise SI is assumed. An unknown unit, two for one kind, and degrees of angles without a
  unit of their rates are refused.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Mapping
from functools import lru_cache

from deltac.trajectories.formats.units import without_unit

COLUMN_WORDS: Mapping[str, frozenset[str]] = {
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

DERIVATIVES = {"dot": 1, "d": 1, "prime": 1, "ddot": 2, "dd": 2, "dt": 0}
"""Words that differentiate what stands beside them, and how often."""

NEUTRAL = frozenset(
    "joint joints jnt coord coordinate coordinates state states data robot sim simulated meas measured "
    "actual real "
    "signal signals values series simlog simout logsout out log jointset rx ry rz px py pz linear sensor "
    "jointstates "
    "jointstate body link motor dof dofs lin".split()
)
"""Words that say nothing of it."""

PLACE_WORDS = frozenset("position pos translation trans location origin xyz".split())
"""Words of where a body is, without which three columns beside a quaternion are no position."""

TIME_WORDS = frozenset(
    "time t ts times tout datetime timestamp timestamps stamp sec secs seconds clock zeit tiempo "
    "temps ms millis us ns".split()
)
NO_TIMES = frozenset(
    "wall cpu solve compute real delta dt step d duration sampling scheduled plan".split()
)
"""Words of columns that are times, but not of the samples."""

STEPS = frozenset("dt timestep ts h sampletime samplingtime sample period deltat".split())
RATE_WORDS = frozenset("fs hz rate frequency freq samplerate samplingrate fps".split())
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
UNREAL = frozenset(
    "desired des ref reference target targets cmd command commanded setpoint goal plan planned error err std "
    "var cov covariance min max limit limits prev previous next last offset bias".split()
)
"""Words of columns that are nothing that happened."""


@lru_cache(4096)
def words_of(name: str) -> tuple[str, ...]:
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


def is_time(column: str) -> bool:
    """Whether a column is called a time of the samples."""
    return any(map(names_time, (words_of(without_unit(column)), words_of(column))))


def names_time(words: tuple[str, ...]) -> bool:
    """Whether words name a time of the samples."""
    if not words or NO_TIMES & set(words[:-1]):
        return False
    return words[-1] in ("time", "times", "timestamp", "timestamps", "tout", "stamp") or (
        set(words) <= TIME_WORDS | NEUTRAL and bool(set(words) & (TIME_WORDS - {"sec"}))
    )


@lru_cache(1 << 16)
def without(words: tuple[str, ...], part: tuple[str, ...]) -> tuple[str, ...] | None:
    """The words that are left without those of a joint, which must be there in their order."""
    rest, at = [], 0
    for word in words:
        if at < len(part) and word == part[at]:
            at += 1
        else:
            rest.append(word)
    return tuple(rest) if at == len(part) and part else None


@lru_cache(4096)
def kind_of(rest: tuple[str, ...]) -> str | None:
    """What of a joint the other words of a column mean: "q", "u", "udot", "force"; None for nothing known."""
    words = [part for word in rest if word not in NEUTRAL for part in unglued(word)]
    if len(words) > 1 and words[0] == "angular":
        words = words[1:]
    times = sum(DERIVATIVES.get(word, 0) for word in words)
    telling = [word for word in words if word not in DERIVATIVES]
    kinds = [
        {kind for kind, vocabulary in COLUMN_WORDS.items() if word in vocabulary}
        for word in telling
    ]
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


KNOWN_WORDS = frozenset().union(*COLUMN_WORDS.values(), DERIVATIVES)
_GLUED = re.compile(r"(d{0,2})([^\W\d_]+?)(dot|ddot|dotdot|d|dd|p|pp|prime)?")


def unglued(word: str) -> list[str]:
    """A word with what differentiates it apart: ``thetadot``, ``dtheta``, ``thdd``, ``xp``."""
    if word in KNOWN_WORDS or not (match := _GLUED.fullmatch(word)):
        return [word]
    before, stem, after = match.groups()
    if stem not in COLUMN_WORDS["q"] | SLIDES - {"v"}:
        return [word]
    dots = len(before) + {"dot": 1, "d": 1, "p": 1, "prime": 1, None: 0}.get(after, 2)
    return [stem, *["dot"] * dots]


_BRACKETED = re.compile(r"(.+?)\[(\d+)\]")


@lru_cache(1 << 14)
def _numbered(column: str) -> tuple[str, int] | None:
    """The name of a column without its one number, and this; None where there is none, or more than one."""
    if match := _BRACKETED.fullmatch(column):
        return match[1], int(match[2])
    plain = "".join(str(unicodedata.digit(c, c)) for c in without_unit(column))
    numbers = list(re.finditer(r"[\[(]?(\d+)[\])]?", plain))
    if len(numbers) != 1 or not re.search(r"[^\W\d_]", plain):
        return None
    before, after = plain[: numbers[0].start()], plain[numbers[0].end() :]
    return before.rstrip("_ .-/") + after if after else before.rstrip("_ .-/"), int(numbers[0][1])


TABLE = "column"
"""The array that columns without names, ``column 1``, are of."""


def arrays_of(columns: Iterable[str]) -> dict[str, list[str]]:
    """The columns of each array, in the order of their numbers from 0 or 1 on; other columns alone."""
    arrays: dict[str, dict[int, str]] = {}
    for column in columns:
        stem, number = _numbered(column) or (column, 0)
        if number in arrays.get(stem, {}):  # q_0 beside q0
            stem = column
        arrays.setdefault(stem, {})[number] = column
    result: dict[str, list[str]] = {}
    for stem, members in arrays.items():
        first, ordered = min(members), [members[number] for number in sorted(members)]
        whole = first <= 1 and sorted(members) == list(range(first, first + len(members)))
        result |= {stem: ordered} if whole or stem == TABLE else {c: [c] for c in ordered}
    return result


def key(array: str) -> str:
    """The name of an array as `LAYOUTS` have it: the last part of its path, in small letters."""
    return re.sub(r"[_\s]", "", re.split(r"[./]", array)[-1].lower())
