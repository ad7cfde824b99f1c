"""The scope against which the parts of a mechanism check themselves: names, and values of parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from deltac.errors import ModelError, WrongType, check_names, shown
from deltac.mechanism.coordinates import Entries, Entry
from deltac.mechanism.laws import check_symbols, evaluate, symbol_names
from deltac.mechanism.quantities import Quantity, require_positive

GROUND = "ground"
"""The name of the inertial frame, to which joints and forces attach like to a body."""


@dataclass(frozen=True)
class Scope:
    """The names that a part of a mechanism may refer to, and the values of the parameters."""

    bodies: tuple[str, ...]
    joints: tuple[str, ...]
    coordinates: Entries
    speeds: Entries
    parameters: Mapping[str, float]

    # What a law may depend on, from the least to the most.

    @cached_property
    def constants(self) -> tuple[str, ...]:
        """Symbols of what keeps still: parameters."""
        return tuple(self.parameters)

    @cached_property
    def in_time(self) -> tuple[str, ...]:
        """Symbols of laws of time: t and parameters."""
        return ("t", *self.constants)

    @cached_property
    def on_surface(self) -> tuple[str, ...]:
        """Symbols of laws of time and of a place x, y, z in the frame of a body."""
        return (*"xyz", *self.in_time)

    @cached_property
    def in_place(self) -> tuple[str, ...]:
        """Symbols of laws of t and q."""
        return (*self.in_time, *(f"q.{name}" for name in self.coordinates.names))

    @cached_property
    def in_motion(self) -> tuple[str, ...]:
        """Symbols of laws of t, q and u."""
        return (*self.in_place, *(f"u.{name}" for name in self.speeds.names))

    @cached_property
    def in_field(self) -> tuple[str, ...]:
        """Symbols of laws of motion and of a point's place x, y, z and velocity vx, vy, vz."""
        return (*"xyz", "vx", "vy", "vz", *self.in_motion)

    def number(self, quantity: Quantity) -> float:
        """The value of a quantity at the parameters' values."""
        return evaluate(quantity, self.parameters)

    def is_constant(self, quantity: Quantity) -> bool:
        """Whether it depends on parameters alone."""
        return symbol_names(quantity) <= self.parameters.keys()

    # Checks: each raises an InputError that begins with `where`.

    def laws(self, laws: Sequence[Any], allowed: Sequence[str], where: str) -> None:
        """InputError for a law (None: there is none) with symbols other than the allowed ones."""
        for law in laws:
            if law is not None:
                check_symbols(law, allowed, where)

    def body(self, name: str, where: str, *, ground: bool = True) -> None:
        """There is such a body; the ground counts if it may."""
        require_name(name, "body", where)
        names = (GROUND, *self.bodies) if ground else self.bodies
        check_names([name], names, f"{where}: unknown body")

    def joint(self, name: str, where: str) -> tuple[tuple[Entry, ...], tuple[Entry, ...]]:
        """There is such a joint and it moves: its coordinates and speeds."""
        require_name(name, "joint", where)
        check_names([name], self.joints, f"{where}: unknown joint")
        speeds = self.speeds[self.speeds.of(name)]
        if not speeds:
            raise ModelError(f"{where}: joint {name!r} is fixed, so no force of a joint acts there")
        return self.coordinates[self.coordinates.of(name)], speeds

    def rate_is_speed(self, coordinate: str) -> bool:
        """Whether the coordinate's rate is the speed in the same place: no quaternion in its joint."""
        entries = self.coordinates
        return not any(e.quaternion for e in entries[entries.of(entries[coordinate].joint)])

    def positive(self, quantity: Quantity, where: str, *, allow_zero: bool = False) -> None:
        """Its value is positive (or zero, if allowed)."""
        require_positive(self.number(quantity), where, allow_zero=allow_zero)

    def takes_energy(self, strength: Quantity, where: str) -> None:
        """A strength that must not be negative, or it would create energy, is not."""
        value = self.number(strength)
        if value < 0.0:
            raise ModelError(
                f"{where} is {value:g}: below zero it would create energy. If that is meant, say "
                "allow_energy_source=True; what it gives is then booked in its channel"
            )


def require_name(name: object, what: str, where: str) -> None:
    """InputError unless a body or joint is given by its name; a part itself is not."""
    if isinstance(name, str):
        return
    remedy = f"; write {name.name!r}" if hasattr(name, "name") else ""
    raise WrongType(f"{where}: found {shown(name)}, expected the name of a {what}{remedy}")
