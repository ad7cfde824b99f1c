"""Coordinates: the entries of q and u, and maps to coordinates of the user's own choice."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, overload

from deltac.errors import InputError, closest
from deltac.mechanism.laws import as_law, check_symbols

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from deltac.mechanism.mechanism import Mechanism


@dataclass(frozen=True)
class Entry:
    """One entry of q or u: its name, joint, unit, place, and whether its motion is prescribed."""

    name: str
    joint: str
    unit: str
    index: int
    prescribed: bool

    @property
    def slice(self) -> slice:
        """Its place in q or u as a slice."""
        return slice(self.index, self.index + 1)


@dataclass(frozen=True)
class Entries:
    """The entries of q (or of u) in order; indexed by position or by name."""

    entries: tuple[Entry, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """All names, in order."""
        return tuple(entry.name for entry in self.entries)

    @overload
    def __getitem__(self, key: int | str) -> Entry: ...
    @overload
    def __getitem__(self, key: slice) -> tuple[Entry, ...]: ...
    def __getitem__(self, key: int | str | slice) -> Entry | tuple[Entry, ...]:
        if isinstance(key, str):
            for entry in self.entries:
                if entry.name == key:
                    return entry
            raise InputError(f"unknown coordinate or speed {key!r}{closest(key, self.names)}")
        return self.entries[key]

    def of(self, joint: str) -> slice:
        """The places of a joint's entries."""
        places = [entry.index for entry in self.entries if entry.joint == joint]
        return slice(places[0], places[-1] + 1) if places else slice(0, 0)

    def __iter__(self) -> Iterator[Entry]:
        return iter(self.entries)

    def __len__(self) -> int:
        return len(self.entries)


@dataclass(frozen=True, eq=False)
class Free:
    """Indices of the coordinates `q` and speeds `u` that a solver integrates (not prescribed)."""

    q: NDArray[np.intp]
    u: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class CoordinateMap:
    """A user's own coordinates q′ and generalized speeds u′, and how the mechanism's follow.

    `coordinates` and `speeds` name q′ and u′; `q` gives each free coordinate of the mechanism as a law
    of t and ``q.<own coordinate>``, `u` each free speed as a law of t, own coordinates and
    ``u.<own speed>``, linear in u′. Left out: `q` (the mechanism's own coordinates are used), `u`
    (own speeds are the rates of own coordinates), `speeds` (named like the coordinates). `inverse`
    gives own coordinates as laws of t and the mechanism's ``q.<coordinate>``; it is found
    automatically when `q` is linear. Of a mechanism with constraints, fewer own coordinates and speeds
    than it has may satisfy them by themselves.

    >>> absolute = CoordinateMap(
    ...     ("theta1", "theta2"), q={"joint1": "q.theta1", "joint2": "q.theta2 - q.theta1"}
    ... )
    """

    coordinates: tuple[str, ...] = ()
    speeds: tuple[str, ...] = ()
    q: Mapping[str, Any] = field(default_factory=dict)
    u: Mapping[str, Any] = field(default_factory=dict)
    inverse: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for attribute in ("q", "u", "inverse"):
            given: Mapping[str, Any] = getattr(self, attribute)
            laws = {
                name: as_law(law, f"{attribute} of {name!r} in the coordinate map")
                for name, law in given.items()
            }
            object.__setattr__(self, attribute, laws)
        object.__setattr__(self, "coordinates", _names(self.coordinates, "coordinates"))
        object.__setattr__(self, "speeds", _names(self.speeds, "speeds") or self.coordinates)
        if not self.q and not self.u:
            raise InputError("a coordinate map needs q= (own coordinates) or u= (own speeds)")
        if self.q and not self.coordinates:
            raise InputError("a coordinate map with q= must name its own coordinates")
        if self.u and not self.speeds:
            raise InputError("a coordinate map with u= must name its own speeds")

    def check(self, mechanism: Mechanism) -> None:
        """InputError unless the map gives every free coordinate and speed of the mechanism."""
        parameters = tuple(mechanism.parameters)
        q_free = [mechanism.coordinates[int(i)].name for i in mechanism.free.q]
        u_free = [mechanism.speeds[int(i)].name for i in mechanism.free.u]
        own_q = self.coordinates if self.q else tuple(q_free)
        symbols_q = ["t", *parameters, *(f"q.{name}" for name in own_q)]
        symbols_u = [*symbols_q, *(f"u.{name}" for name in self.speeds)]
        if self.q:
            _cover(self.q, q_free, "q", "coordinate")
        if self.u:
            _cover(self.u, u_free, "u", "speed")
        elif not _fits(len(own_q), len(u_free), mechanism):
            raise InputError(
                f"the coordinate map has {len(own_q)} coordinates for {len(u_free)} speeds: rates "
                "cannot serve as speeds; give u="
            )
        if self.u and not _fits(len(self.speeds), len(u_free), mechanism):
            raise InputError(
                f"the coordinate map names {len(self.speeds)} speeds; the mechanism has "
                f"{len(u_free)} free ones: {', '.join(u_free)}"
            )
        for name, law in self.q.items():
            check_symbols(law, symbols_q, f"q of {name!r} in the coordinate map")
        for name, law in self.u.items():
            check_symbols(law, symbols_u, f"u of {name!r} in the coordinate map")
        if self.inverse:
            _cover(self.inverse, list(self.coordinates), "inverse", "own coordinate")
        allowed = ["t", *parameters, *(f"q.{name}" for name in q_free)]
        for name, law in self.inverse.items():
            check_symbols(law, allowed, f"inverse of {name!r} in the coordinate map")


def _fits(own: int, free: int, mechanism: Mechanism) -> bool:
    """Whether a mechanism with `free` speeds can be told by `own` ones, fewer if it has constraints."""
    return own == free or (bool(mechanism.constraints) and 0 < own < free)


def _names(value: Sequence[str], what: str) -> tuple[str, ...]:
    if isinstance(value, str):
        raise InputError(
            f"{what} of a coordinate map: expected a sequence of names, found {value!r}"
        )
    names = tuple(value)
    if len(set(names)) != len(names):
        raise InputError(f"{what} of a coordinate map: a name occurs twice in {names}")
    return names


def _cover(laws: Mapping[str, Any], expected: Sequence[str], what: str, noun: str) -> None:
    for name in laws:
        if name not in expected:
            raise InputError(
                f"{what} of the coordinate map: unknown {noun} {name!r}{closest(name, expected)}"
            )
    missing = [name for name in expected if name not in laws]
    if missing:
        raise InputError(f"{what} of the coordinate map: no law for {noun} {', '.join(missing)}")
