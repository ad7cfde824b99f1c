"""Units of other programs' logs: what to multiply by to get SI, and what kind of quantity it is."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from deltac.errors import InputError, UnknownName, closest


@dataclass(frozen=True)
class Unit:
    """`factor` times a number in this unit is the number in SI units.

    `dimension` holds the powers of length, mass, time and angle; angles are told apart from plain
    numbers, so that degrees are not taken for millimetres.
    """

    factor: float
    dimension: tuple[int, int, int, int]


_NUMBER, _LENGTH, _MASS, _TIME, _ANGLE = (
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
        ("1", 1.0, _NUMBER),
        ("m meter meters metre metres", 1.0, _LENGTH),
        ("cm", 1e-2, _LENGTH),
        ("mm millimeter millimeters", 1e-3, _LENGTH),
        ("km", 1e3, _LENGTH),
        ("in inch", 0.0254, _LENGTH),
        ("ft", 0.3048, _LENGTH),
        ("g", 1e-3, _MASS),
        ("kg", 1.0, _MASS),
        ("s sec second seconds", 1.0, _TIME),
        ("ms", 1e-3, _TIME),
        ("us µs μs", 1e-6, _TIME),
        ("ns", 1e-9, _TIME),
        ("min", 60.0, _TIME),
        ("h", 3600.0, _TIME),
        ("rad radian radians", 1.0, _ANGLE),
        ("mrad", 1e-3, _ANGLE),
        ("deg degree degrees °", math.pi / 180.0, _ANGLE),
        ("rev turn", _TURN, _ANGLE),
        ("rpm", _TURN / 60.0, (0, 0, -1, 1)),
        ("Hz", 1.0, (0, 0, -1, 0)),
        ("N", 1.0, _FORCE),
        ("mN", 1e-3, _FORCE),
        ("kN", 1e3, _FORCE),
        ("lbf", _LBF, _FORCE),
        ("kgf", 9.80665, _FORCE),
        ("Nm", 1.0, _TORQUE),
        ("Nmm", 1e-3, _TORQUE),
        ("mNm", 1e-3, _TORQUE),
        ("kNm", 1e3, _TORQUE),
        ("J", 1.0, _TORQUE),
        ("mJ", 1e-3, _TORQUE),
        ("kJ", 1e3, _TORQUE),
        ("W", 1.0, _POWER),
    )
    for name in names.split()
}

_SUPERSCRIPTS = str.maketrans("⁻¹²³⁴", "-1234")
_FACTOR = re.compile(r"([*/]?)([^\W\d_]+|°|1)(?:\^(-?\d))?")


def unit(text: str) -> Unit:
    """The unit that `text` writes: names joined by `*`, `·` or `/`, with powers: ``rad/s^2``, ``N·m``.

    >>> unit("rpm").factor == unit("rev/min").factor
    True

    Raises InputError for what it does not know.
    """
    written = re.sub(r"([⁻¹²³⁴]+)", r"^\1", text.strip()).translate(_SUPERSCRIPTS)
    written = re.sub(r"\s*([*/^])\s*", r"\1", written.replace("**", "^"))
    written = re.sub(r"[·⋅. ]", "*", written) or "1"
    factor, dimension, end = 1.0, _NUMBER, 0
    for match in _FACTOR.finditer(written):
        sign, name, power = match.groups()
        if match.start() != end or (sign == "") != (end == 0):
            break
        if name not in _ATOMS:
            raise UnknownName(f"unknown unit {name!r} in {text!r}{closest(name, _ATOMS)}")
        exponent = int(power or 1) * (-1 if sign == "/" else 1)
        factor *= _ATOMS[name].factor ** exponent
        a, b, c, d = (x + exponent * y for x, y in zip(dimension, _ATOMS[name].dimension))
        dimension, end = (a, b, c, d), match.end()
    if end != len(written):
        raise InputError(f"cannot take the unit {text!r} apart; write it like 'deg/s' or 'N*mm'")
    return Unit(factor, dimension)


def named_unit(column: str) -> str | None:
    """The unit that a column's name gives in brackets, as in ``elbow [deg]``; None without one."""
    match = re.search(r"[\[(]([^\[\]()]*)[\])]\s*$", column)
    if match is None or not match[1].strip() or match[1].strip().isdigit():
        return None
    try:
        unit(match[1])
    except InputError:
        return None  # an index, a remark
    return match[1].strip()
