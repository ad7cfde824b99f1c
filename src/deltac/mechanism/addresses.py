"""The plain numbers of a mechanism by name, such as those of an imported model: `numbers`, `opened`.

A name is the part, its own name, and the field: ``body.thigh.mass``, ``body.thigh.mass_centre.z``,
``body.thigh.inertia.xx``, ``joint.hip.armature``, ``force.cord.stiffness``. A spring or damper of a joint is
the joint's: ``joint.hip.damping``. Of several numbers the speed's counts from 0: ``joint.ball.damping.2``.
``gravity`` is its magnitude, ``gravity.z`` a component.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

from deltac.errors import check_names
from deltac.mechanism.polynomials import Polynomial

NUMBERED_PARTS = {
    "bodies": "body",
    "joints": "joint",
    "forces": "force",
    "constraints": "constraint",
}
"""The parts of a mechanism whose numbers have names, and how these begin."""

ADDRESSED = (*NUMBERED_PARTS.values(), "gravity")
"""What the names begin with."""

_DIRECTIONS = ("axis", "axes", "normal", "lateral", "rotation")
"""How the names of fields end that hold directions, which are no free numbers."""


@dataclass(frozen=True)
class _Place:
    """Where a number is: in which group, of which part, and the indices in its field."""

    group: str
    part: int
    field: str
    path: tuple[int, ...]
    value: float


def numbers(mechanism: Any) -> dict[str, float]:
    """The plain numbers of a mechanism by name, and its parameters; expressions follow from those."""
    values = dict(mechanism.parameters)
    values |= {name: places[0].value for name, places in _places(mechanism).items()}
    for component, value in zip("xyz", mechanism.gravity):
        if isinstance(value, float):
            values[f"gravity.{component}"] = value
    if len(size := _gravity(mechanism)) == 3:
        values["gravity"] = math.hypot(*size)
    return values


def opened(mechanism: Any, names: Iterable[str], where: str = "") -> Any:
    """The same mechanism with these of its numbers as parameters of those names.

    Raises UnknownName, with near ones, for a name of no number; the message begins with `where`.
    """
    addresses = [name for name in dict.fromkeys(names) if name not in mechanism.parameters]
    if not addresses:
        return mechanism
    available, places = numbers(mechanism), _places(mechanism)
    groups = {group: list(getattr(mechanism, group)) for group in NUMBERED_PARTS}
    gravity = list(mechanism.gravity)
    check_names(addresses, available, f"{where}unknown parameter")
    for name in addresses:
        symbol = Polynomial.symbol(name)
        for place in places.get(name, ()):
            part = groups[place.group][place.part]
            value = _put(getattr(part, place.field), place.path, symbol)
            groups[place.group][place.part] = replace(part, **{place.field: value})
        if name == "gravity":
            gravity = [value / available[name] * symbol if value else 0.0 for value in gravity]
        elif name.startswith("gravity."):
            gravity["xyz".index(name[-1])] = symbol
    parameters = {**mechanism.parameters, **{name: available[name] for name in addresses}}
    return replace(mechanism, gravity=tuple(gravity), parameters=parameters, **groups)


def _gravity(mechanism: Any) -> Sequence[float]:
    """The components of gravity, if all are plain numbers, and not all zero."""
    plain = all(isinstance(value, float) for value in mechanism.gravity)
    return tuple(mechanism.gravity) if plain and any(mechanism.gravity) else ()


def _places(mechanism: Any) -> Mapping[str, list[_Place]]:
    """The places of each number: of a product of inertia there are two."""
    places: dict[str, list[_Place]] = {}
    owners: dict[str, tuple[str, int]] = {}
    for group, prefix in NUMBERED_PARTS.items():
        for k, part in enumerate(getattr(mechanism, group)):
            joint = getattr(part, "joint", None) if group == "forces" else None
            for field in fields(part):
                if not _free(part, field.name):
                    continue
                for after, path, value in _numbers(getattr(part, field.name)):
                    name = f"{prefix}.{part.name}.{field.name}{after}"
                    shared = f"joint.{joint}.{field.name}{after}"
                    if joint is not None and owners.setdefault(shared, (group, k)) == (group, k):
                        name = shared
                    place = _Place(group, k, field.name, path, value)
                    if owners.setdefault(name, (group, k)) == (group, k):
                        places.setdefault(name, []).append(place)
    return places


def _free(part: Any, field: str) -> bool:
    """Whether a field's numbers may be chosen: no directions, and no pitch but that of a screw."""
    pitch = field == "pitch" and part.kind != "screw"
    return not pitch and not field.rstrip("12").endswith(_DIRECTIONS)


def _numbers(value: Any) -> Iterator[tuple[str, tuple[int, ...], float]]:
    """The numbers of a field: what of the name says which, the indices, and the value."""
    if isinstance(value, float):
        yield "", (), value
    elif isinstance(value, tuple) and len(value) == 3 and all(isinstance(v, tuple) for v in value):
        for i, row in enumerate(value):
            for j, entry in enumerate(row):
                if isinstance(entry, float):
                    yield "." + "".join(sorted("xyz"[i] + "xyz"[j])), (i, j), entry
    elif isinstance(value, tuple):
        letters = "xyz" if len(value) == 3 else "".join(map(str, range(min(len(value), 10))))
        for k, (letter, entry) in enumerate(zip(letters, value)):
            if isinstance(entry, float):
                yield ("" if len(value) == 1 else f".{letter}"), (k,), entry


def _put(value: Any, path: Sequence[int], entry: Any) -> Any:
    """The same value, nested tuples, with another entry."""
    if not path:
        return entry
    parts = list(value)
    parts[path[0]] = _put(parts[path[0]], path[1:], entry)
    return tuple(parts)
