"""Units of other programs' logs: what to multiply by to get SI, and what kind of quantity it is."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

from deltac.errors import InputError, UnknownName, closest, shown


@dataclass(frozen=True)
class Unit:
    """`factor` times a number in this unit is the number in SI units.

    `dimension` holds the powers of length, mass, time and angle; angles are told apart from plain
    numbers, so that degrees are not taken for millimetres.
    """

    factor: float
    dimension: tuple[int, int, int, int]


_DIMENSIONS, _LENGTH, _MASS, _TIME, _ANGLE = (
    (0, 0, 0, 0),
    (1, 0, 0, 0),
    (0, 1, 0, 0),
    (0, 0, 1, 0),
    (0, 0, 0, 1),
)
_FORCE, _TORQUE, _POWER = (1, 1, -2, 0), (2, 1, -2, 0), (2, 1, -3, 0)
_TURN, _LBF = 2.0 * math.pi, 4.4482216152605

_ATOMS: dict[str, Unit] = {
    name: Unit(factor, dimension)
    for names, factor, dimension in (
        ("1", 1.0, _DIMENSIONS),
        ("m meter meters metre metres", 1.0, _LENGTH),
        ("cm centimeter centimeters centimetre centimetres", 1e-2, _LENGTH),
        ("mm millimeter millimeters millimetre millimetres", 1e-3, _LENGTH),
        ("km", 1e3, _LENGTH),
        ("in inch inches", 0.0254, _LENGTH),
        ("ft foot feet", 0.3048, _LENGTH),
        ("g", 1e-3, _MASS),
        ("kg", 1.0, _MASS),
        ("s sec second seconds", 1.0, _TIME),
        ("ms millisecond milliseconds", 1e-3, _TIME),
        ("us µs μs microsecond microseconds", 1e-6, _TIME),
        ("ns nanosecond nanoseconds", 1e-9, _TIME),
        ("min", 60.0, _TIME),
        ("h", 3600.0, _TIME),
        ("rad radian radians", 1.0, _ANGLE),
        ("mrad", 1e-3, _ANGLE),
        ("deg degree degrees °", math.pi / 180.0, _ANGLE),
        ("rev turn", _TURN, _ANGLE),
        ("rpm", _TURN / 60.0, (0, 0, -1, 1)),
        ("Hz", 1.0, (0, 0, -1, 0)),
        ("N newton newtons", 1.0, _FORCE),
        ("mN", 1e-3, _FORCE),
        ("kN", 1e3, _FORCE),
        ("lbf", _LBF, _FORCE),
        ("kgf", 9.80665, _FORCE),
        ("Nm", 1.0, _TORQUE),
        ("Nmm", 1e-3, _TORQUE),
        ("mNm", 1e-3, _TORQUE),
        ("kNm", 1e3, _TORQUE),
        ("J joule joules", 1.0, _TORQUE),
        ("mJ", 1e-3, _TORQUE),
        ("kJ", 1e3, _TORQUE),
        ("W", 1.0, _POWER),
    )
    for name in names.split()
}

_SUPERSCRIPTS = str.maketrans("⁻¹²³⁴", "-1234")
_FACTOR = re.compile(r"([*/]?)([^\W\d_]+|°|1)(?:\^?(-?\d))?")


def unit(text: str) -> Unit:
    """The unit that `text` writes: names joined by `*`, `·` or `/`, with powers: ``rad/s^2``, ``N·m``.

    >>> unit("rpm").factor == unit("rev/min").factor
    True

    Raises InputError for what it does not know.
    """
    written = re.sub(r"([⁻¹²³⁴]+)", r"^\1", text.strip()).translate(_SUPERSCRIPTS)
    written = re.sub(r"\s*([*/^])\s*", r"\1", written.replace("**", "^"))
    written = re.sub(r"\s+per\s+", "/", written, flags=re.IGNORECASE)
    written = re.sub(r"[·⋅. ]", "*", written) or "1"
    factor, dimension, end = 1.0, _DIMENSIONS, 0
    for match in _FACTOR.finditer(written):
        sign, name, power = match.groups()
        if match.start() != end or (sign == "") != (end == 0):
            break
        if name not in _ATOMS and len(name) > 2:
            name = name.lower()  # Radians
        if name not in _ATOMS:
            raise UnknownName(f"unknown unit {shown(name)} in {shown(text)}{closest(name, _ATOMS)}")
        exponent = int(power or 1) * (-1 if sign == "/" else 1)
        factor *= _ATOMS[name].factor ** exponent
        a, b, c, d = (x + exponent * y for x, y in zip(dimension, _ATOMS[name].dimension))
        dimension, end = (a, b, c, d), match.end()
    if end != len(written):
        raise InputError(f"cannot parse the unit {shown(text)}; write it like 'deg/s' or 'N*mm'")
    return Unit(factor, dimension)


_MEASURES = {
    word: written
    for written, several in {
        "deg": "deg degree degrees grad",
        "rad": "rad radian radians",
        "m": "m meter meters metre metres",
        "mm": "mm millimeter millimeters millimetre millimetres",
        "cm": "cm centimeter centimeters centimetre centimetres",
        "rpm": "rpm",
        "N": "n newton newtons",
        "N*m": "nm",
        "N*mm": "nmm",
        "s": "s sec secs second seconds",
        "ms": "ms msec msecs millis millisecond milliseconds",
        "us": "us usec usecs micros microsecond microseconds",
        "ns": "ns nsec nsecs nanos nanosecond nanoseconds",
    }.items()
    for word in several.split()
}
_RATES = {
    f"{short}{rate}": f"{written}/s{power}"
    for short, written in (("deg", "deg"), ("d", "deg"), ("rad", "rad"), ("m", "m"), ("mm", "mm"))
    for rate, power in (("ps", ""), ("s", ""), ("ps2", "^2"), ("s2", "^2"), ("pss", "^2"))
    if f"{short}{rate}" not in ("ds", "ms", "mms", "ds2", "ms2")
}
"""``degps``, ``dps``, ``rads``, ``mps2``."""

_PER_SECOND = re.compile(r"(\w+?)(?: (?:per )?(?:s|sec|second)(?: ?(2|squared))?)?")


def _in_words(words: str) -> str | None:
    """The unit that the last words of a name write: ``deg s``, ``radians per second``, ``m s2``, ``n m``."""
    if words in ("n m", "n mm"):
        return words.replace("n ", "N*")
    if words in _RATES:
        return _RATES[words]
    match = _PER_SECOND.fullmatch(words)
    measure = _MEASURES.get(match[1]) if match else None
    if match is None or measure is None or match[1] == words:
        return measure
    return f"{measure}/s^2" if match[2] else f"{measure}/s"


_BRACKETS = re.compile(r"\s*[\[({]([^\[\](){}]*)[\])}]\s*$")
_AFTER = re.compile(r"(?:\s*,\s*|\s+/\s*|\s+in\s+)(\S+)\s*$")


@lru_cache(4096)
def column_unit(column: str, si: str | None = None) -> str | None:
    """The unit that a column's name gives: ``elbow [deg]``, ``elbow, deg``, ``elbow / deg``, ``elbow_deg``.

    A unit without brackets must convert to `si`, the unit of what the column means. None without a unit.
    """
    if match := _BRACKETS.search(column):
        return match[1].strip() if is_known(match[1]) else None
    if si is None:
        return None
    if si == "s" and (whole := _MEASURES.get(column.strip().lower())) and converts(whole, si):
        return whole
    if (match := _AFTER.search(column)) and converts(match[1], si):
        return match[1]
    for _, written in _suffixes(column):
        if converts(written, si):
            return written
    return None


def without_unit(column: str) -> str:
    """The name of a column without the unit that stands behind it, if one does."""
    if match := _BRACKETS.search(column):
        return column[: match.start()] if is_known(match[1]) else column
    if (match := _AFTER.search(column)) and is_known(match[1]):
        return column[: match.start()]
    for rest, _ in _suffixes(column):
        return rest
    return column


def _suffixes(column: str) -> Iterator[tuple[str, str]]:
    """What stands before units in words at the end of a name, and these, the longest first."""
    words = list(re.finditer(r"[^\W_]+", column))
    for count in (4, 3, 2, 1):
        if len(words) > count:
            tail = words[-count:]
            written = _in_words(" ".join(word[0].lower() for word in tail))
            if written is not None:
                yield column[: tail[0].start()].rstrip("_ .-/"), written


def is_known(text: str) -> bool:
    """Whether a text is a unit."""
    text = text.strip()
    if not text or text.isdigit():
        return False  # an index
    try:
        unit(text)
    except InputError:
        return False  # a remark
    return True


def converts(text: str, si: str) -> bool:
    """Whether a text is a unit of the kind of the unit `si`."""
    return is_known(text) and unit(text).dimension == unit(si).dimension
