"""Coordinates of the user's own choice, and how the mechanism's follow from them.

A `CoordinateMap` says it for any mechanism; `absolute_angles` makes the one in which textbooks write
planar chains of hinges.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from deltac.arrays import ROUNDED
from deltac.calls.arguments import checked
from deltac.calls.caching import FrozenDict
from deltac.errors import InputError, ModelError, check_names, shown
from deltac.mechanism.joints import Joint
from deltac.mechanism.laws import LawLike, as_law, as_text, check_symbols
from deltac.mechanism.laws import q as symbol
from deltac.mechanism.laws import u as speed_symbol
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.quantities import IDENTITY
from deltac.mechanism.scope import GROUND


@checked
@dataclass(frozen=True, eq=False)
class CoordinateMap:
    """A user's own coordinates q′ and generalized speeds u′, and how the mechanism's follow from them.

    `coordinates` and `speeds` name q′ and u′; `q` gives each free coordinate of the mechanism as a law
    of t and ``q.<own coordinate>``, `u` each free speed as a law of t, own coordinates and
    ``u.<own speed>``, linear in u′. Without `q` the mechanism's own coordinates are used; without `u` own
    speeds are the rates of own coordinates; without `speeds` they are named like the coordinates. `inverse`
    gives own coordinates as laws of t and the mechanism's ``q.<coordinate>``; it is found
    automatically when `q` is linear.

    For a mechanism with constraints, own coordinates and speeds may be fewer. Either the laws satisfy the
    constraints by themselves, or they omit what follows from the constraints: coordinates without a law are
    found by assembly, and speeds without a law from the constraint Jacobian. Names alone, or `inverse` alone,
    are enough: ``CoordinateMap(("crank",))`` describes a four-bar by the angle of its joint `crank`, and
    ``CoordinateMap(("x",), inverse={"x": "r*cos(q.crank)"})`` by a place.

    >>> absolute = CoordinateMap(
    ...     ("theta1", "theta2"), q={"joint1": "q.theta1", "joint2": "q.theta2 - q.theta1"}
    ... )
    """

    coordinates: tuple[str, ...] = ()
    speeds: tuple[str, ...] = ()
    q: Mapping[str, LawLike] = field(default_factory=dict)
    u: Mapping[str, LawLike] = field(default_factory=dict)
    inverse: Mapping[str, LawLike] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for attribute in ("q", "u", "inverse"):
            texts: Mapping[str, Any] = getattr(self, attribute)
            laws = {
                name: as_law(law, f"{attribute} of {name!r} in the coordinate map")
                for name, law in texts.items()
            }
            object.__setattr__(self, attribute, FrozenDict(laws))
        object.__setattr__(self, "coordinates", _names(self.coordinates, "coordinates"))
        object.__setattr__(self, "speeds", _names(self.speeds, "speeds") or self.coordinates)
        if not self.coordinates and not self.speeds and not self.q and not self.u:
            raise ModelError("a coordinate map needs q= (own coordinates) or u= (own speeds)")
        if self.q and not self.coordinates:
            raise ModelError("a coordinate map with q= must name its own coordinates")
        if self.u and not self.speeds:
            raise ModelError("a coordinate map with u= must name its own speeds")

    @cached_property
    def digest(self) -> str:
        """A digest of the map, to tell whether a log was made with the same one."""
        laws = [sorted(law.items()) for law in (self.q, self.u)]
        return hashlib.sha256(repr((self.coordinates, self.speeds, laws)).encode()).hexdigest()[:16]

    def laws(self) -> tuple[Mapping[str, LawLike], Mapping[str, LawLike]]:
        """`q` and `u`; where names stand alone, they are the mechanism's own."""
        q, u = self.q, self.u
        if self.coordinates and not q and not self.inverse:
            q = FrozenDict({name: symbol(name) for name in self.coordinates})
        if not self.coordinates and not u:
            u = FrozenDict({name: speed_symbol(name) for name in self.speeds})
        return q, u

    def assembled(self, mechanism: Mechanism) -> bool:
        """Whether the constraints, by assembly, say what the own coordinates leave open."""
        q, _ = self.laws()
        return bool(self.coordinates) and not q.keys() >= {*mechanism.coordinates.free_names}

    def check(self, mechanism: Mechanism) -> None:
        """InputError unless the map gives every free coordinate and speed of the mechanism.

        What a mechanism's constraints can give may be left out.
        """
        q, u = self.laws()
        parameters = tuple(mechanism.parameters)
        q_free, u_free = mechanism.coordinates.free_names, mechanism.speeds.free_names
        own_q = self.coordinates or q_free
        symbols_q = ["t", *parameters, *(f"q.{name}" for name in own_q)]
        symbols_u = [*symbols_q, *(f"u.{name}" for name in self.speeds)]
        open_ = bool(mechanism.constraints)
        assembled = self.assembled(mechanism)
        if q:
            _cover(q, q_free, "q", "coordinate", partly=open_)
        if u:
            _cover(u, u_free, "u", "speed", partly=open_)
        elif not assembled and not _fits(len(own_q), len(u_free), mechanism):
            raise ModelError(
                f"the coordinate map has {len(own_q)} coordinates for {len(u_free)} speeds: rates "
                "cannot serve as speeds; give u="
            )
        own = len(self.speeds)
        if (u or assembled) and not _fits(own, len(u_free), mechanism):
            raise ModelError(
                f"the coordinate map names {own} speeds; the mechanism has "
                f"{len(u_free)} free ones: {', '.join(u_free)}"
            )
        for name, law in q.items():
            check_symbols(law, symbols_q, f"q of {name!r} in the coordinate map")
        for name, law in u.items():
            check_symbols(law, symbols_u, f"u of {name!r} in the coordinate map")
        if self.inverse:
            _cover(self.inverse, list(self.coordinates), "inverse", "own coordinate")
        allowed = ["t", *parameters, *(f"q.{name}" for name in q_free)]
        for name, law in self.inverse.items():
            check_symbols(law, allowed, f"inverse of {name!r} in the coordinate map")

    def to_dict(self) -> dict[str, Any]:
        """The map as texts, which `CoordinateMap(**…)` takes; what a run notes of its own speeds."""
        entries: dict[str, Any] = {
            "coordinates": list(self.coordinates),
            "speeds": list(self.speeds),
        }
        for name in ("q", "u", "inverse"):
            entries[name] = {key: as_text(law) for key, law in getattr(self, name).items()}
        return entries


def _fits(own: int, free: int, mechanism: Mechanism) -> bool:
    """Whether a mechanism with `free` speeds can be described by `own` ones, fewer if it has constraints."""
    return own == free or (bool(mechanism.constraints) and 0 < own < free)


def _names(value: Sequence[str], what: str) -> tuple[str, ...]:
    if isinstance(value, str):
        raise ModelError(
            f"{what} of a coordinate map: expected a sequence of names, found {value!r}"
        )
    names = tuple(value)
    if len(set(names)) != len(names):
        raise ModelError(f"{what} of a coordinate map: a name occurs twice in {names}")
    return names


def _cover(
    laws: Mapping[str, Any],
    expected: Sequence[str],
    what: str,
    noun: str,
    *,
    partly: bool = False,
) -> None:
    check_names(laws, expected, f"{what} of the coordinate map: unknown {noun}")
    missing = [name for name in expected if name not in laws]
    if missing and not partly:
        raise ModelError(f"{what} of the coordinate map: no law for {noun} {', '.join(missing)}")


NAMED = ("joint", "absolute")
"""Coordinates that have a name: the mechanism's own, and absolute angles (`absolute_angles`)."""


def own_coordinates(
    mechanism: Mechanism, coordinates: CoordinateMap | str | None
) -> CoordinateMap | None:
    """The map that an argument `coordinates` means; None for the mechanism's own coordinates.

    Raises InputError for anything but a map, "joint", "absolute" or None.
    """
    if coordinates is None or isinstance(coordinates, CoordinateMap):
        return coordinates
    if coordinates not in NAMED:
        raise _no_coordinates(coordinates)
    return absolute_angles(mechanism) if coordinates == "absolute" else None


def check_coordinates(coordinates: object) -> None:
    """InputError for what no mechanism can take for coordinates."""
    named = isinstance(coordinates, str) and coordinates in NAMED
    if not (coordinates is None or named or isinstance(coordinates, CoordinateMap)):
        raise _no_coordinates(coordinates)


def _no_coordinates(coordinates: object) -> InputError:
    return InputError(
        f"coordinates is {shown(coordinates)}; expected 'joint', 'absolute' or a CoordinateMap"
    )


@checked
def absolute_angles(mechanism: Mechanism) -> CoordinateMap:
    """A map that describes hinges in series with parallel axes by absolute angles.

    The coordinate of such a hinge (named as the joint) is the angle of its child against the ground (or
    against the first body that does not turn about that axis), rad; all other coordinates stay as
    they are. The speeds are the rates.

    Raises InputError where no two hinges follow each other with parallel axes and unturned frames, and
    for joints whose speeds are no rates.
    """
    carrier = {joint.child: joint for joint in mechanism.joints}
    laws: dict[str, Any] = {}
    names = mechanism.coordinates.free_names
    for name in names:
        joint = mechanism.joint(mechanism.coordinates[name].joint)
        before = _hinge_before(joint, carrier)
        if joint.kind != "revolute" or before is None:
            laws[name] = symbol(name)
        elif before.prescribed:
            laws[name] = symbol(name) - _angle(before, carrier)
        else:
            laws[name] = symbol(name) - symbol(before.name)
    if all(law == symbol(name) for name, law in laws.items()):
        raise ModelError(
            f"mechanism {mechanism.name!r} has no two hinges with parallel axes in series, so absolute "
            "angles are its joints' own; leave coordinates out"
        )
    if len(names) != len(mechanism.free.u):
        raise ModelError(
            f"mechanism {mechanism.name!r} has joints whose speeds are not rates of coordinates; write a "
            "CoordinateMap with u="
        )
    return CoordinateMap(tuple(names), q=laws)


def _hinge_before(joint: Joint, carrier: dict[str, Joint]) -> Joint | None:
    """The hinge that turns the joint's parent about the same axis, over rigid connections."""
    if joint.kind != "revolute" or joint.rotation != IDENTITY:
        return None
    body = joint.parent
    while body != GROUND:
        before = carrier[body]
        unturned = before.child_rotation == IDENTITY
        if before.kind == "fixed" and unturned and before.rotation == IDENTITY:
            body = before.parent
            continue
        if before.kind != "revolute" or not unturned:
            return None
        same = all(abs(a - b) < ROUNDED for a, b in zip(before.axes[0], joint.axes[0]))
        return before if same else None
    return None


def _angle(joint: Joint, carrier: dict[str, Joint]) -> Any:
    """The absolute angle of a hinge as a law: the sum of prescribed ones, up to a free one's symbol."""
    if not joint.prescribed:
        return symbol(joint.name)
    before = _hinge_before(joint, carrier)
    own = joint.motion[0]
    return own if before is None else own + _angle(before, carrier)
