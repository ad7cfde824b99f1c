"""What happened between the rows of a trajectory: impacts, switches, events.

A trajectory keeps strictly increasing times, so the two states at an instant at which speeds jump are no
rows of it: each such instant is an `Occurrence`, with the states before and after. A row at exactly that
time holds the state after. Integrals over samples are taken in pieces, from one occurrence to the next.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from deltac.arrays import Array
from deltac.errors import LogError, check_names, listed, shown
from deltac.mechanism.channels import ByChannel, ChannelName
from deltac.trajectories.numbers import as_numbers


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Occurrence:
    """An event of a run: an impact, a switch, or an event of the user's.

    t            when (s)
    names        what: ``"impact floor"``, ``"switch actuator motor"``, ``"event apex"``; several if they
                 happened together
    q            (nq,) coordinates
    u_before, u_after        (nu,) speeds; equal but at impacts
    udot_before, udot_after  (nu,) accelerations, None if the run has none
    forces_before, forces_after  channel -> (nu,) generalized force, of the channels that the run logs
    impulses     channel -> (nu,) generalized impulse (N·s or N·m·s): ``"impact floor"``, and what the
                 constraints and the drives of prescribed joints answered

    Raises InputError for arrays of other sizes or values that are not finite.
    """

    t: float
    names: tuple[str, ...]
    q: Array
    u_before: Array
    u_after: Array
    udot_before: Array | None = None
    udot_after: Array | None = None
    forces_before: ByChannel = field(default_factory=dict)
    forces_after: ByChannel = field(default_factory=dict)
    impulses: ByChannel = field(default_factory=dict)

    def __post_init__(self) -> None:
        if isinstance(self.names, str) or not isinstance(self.names, Iterable):
            raise LogError(f"occurrence: names is {shown(self.names)}, expected a list of names")
        names = tuple(self.names)
        if not all(isinstance(name, str) for name in names):
            raise LogError(f"occurrence: names is {shown(names)}, expected a list of names")
        where = f"occurrence {listed(names)!r} at t = {shown(self.t)}"
        real = isinstance(self.t, int | float | np.number) and not isinstance(self.t, bool)
        if not real or not abs(self.t) <= sys.float_info.max:
            raise LogError(f"{where}: expected a finite time in seconds")
        object.__setattr__(self, "names", names)
        object.__setattr__(self, "t", float(self.t))
        object.__setattr__(self, "q", _array(self.q, None, f"q of {where}"))
        object.__setattr__(self, "u_before", _array(self.u_before, None, f"u_before of {where}"))
        nu = len(self.u_before)
        for name in ("u_before", "u_after", "udot_before", "udot_after"):
            value = getattr(self, name)
            if value is not None or name.startswith("u_"):
                object.__setattr__(self, name, _array(value, nu, f"{name} of {where}"))
        for name in ("forces_before", "forces_after", "impulses"):
            arrays, values = {}, getattr(self, name)
            if not isinstance(values, Mapping):
                raise LogError(f"{where}: {name} is {shown(values)}, expected arrays by channel")
            for channel, value in values.items():
                if not isinstance(channel, str):
                    raise LogError(f"{where}: {name} has the channel {shown(channel)}, no text")
                arrays[ChannelName.parse(channel)] = _array(
                    value, nu, f"{name} of {channel!r} of {where}"
                )
            object.__setattr__(self, name, MappingProxyType(arrays))

    @property
    def work(self) -> dict[str, float]:
        """Work of each impulse on the system (J): its product with the mean of both speeds."""
        mean = 0.5 * (self.u_before + self.u_after)
        return {channel: float(impulse @ mean) for channel, impulse in self.impulses.items()}

    @property
    def energy_lost(self) -> float:
        """Kinetic energy that the impacts took out (J); negative where they put some in."""
        mean = 0.5 * (self.u_before + self.u_after)
        return -sum(float(j @ mean) for name, j in self.impulses.items() if name.kind == "impact")

    def reordered(self, places_q: npt.ArrayLike, places_u: npt.ArrayLike) -> Occurrence:
        """With coordinates and speeds in another order: those at these places now."""
        q, u = np.asarray(places_q), np.asarray(places_u)

        changes: dict[str, Any] = {"q": self.q[q]}
        for name in _ARRAYS[1:]:
            value = getattr(self, name)
            changes[name] = None if value is None else value[u]
        for name in _MAPPINGS:
            changes[name] = {c: value[u] for c, value in getattr(self, name).items()}
        return replace(self, **changes)

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers and lists, for JSON; `from_dict` is the inverse."""
        return {
            "t": self.t,
            "names": list(self.names),
            **{name: _listed(getattr(self, name)) for name in _ARRAYS},
            **{
                name: {channel: value.tolist() for channel, value in getattr(self, name).items()}
                for name in _MAPPINGS
            },
        }

    @staticmethod
    def from_dict(values: Mapping[str, Any]) -> Occurrence:
        """The occurrence that `to_dict` wrote; InputError for entries that are missing or unknown."""
        keys = ("t", "names", *_ARRAYS, *_MAPPINGS)
        if not isinstance(values, Mapping):
            raise LogError(
                f"metadata: an event is {shown(values)}, expected a mapping of its entries"
            )
        check_names(values, keys, "metadata: an event has an unknown entry")
        for name in keys:
            if name not in values:
                raise LogError(f"metadata: an event has no entry {name!r}")
        return Occurrence(**values)

    def __reduce__(self) -> tuple[Any, ...]:
        return Occurrence.from_dict, (self.to_dict(),)

    def __repr__(self) -> str:
        lost = f", {self.energy_lost:.6g} J lost" if self.impulses else ""
        return f"Occurrence({', '.join(self.names)} at t = {self.t:.9g} s{lost})"


_ARRAYS = ("q", "u_before", "u_after", "udot_before", "udot_after")
_MAPPINGS = ("forces_before", "forces_after", "impulses")


def _array(value: Any, size: int | None, where: str) -> Array:
    array = as_numbers(where, value)
    if array.ndim != 1 or (size is not None and array.size != size):
        expected = "a list of numbers" if size is None else f"{size} numbers"
        raise LogError(f"{where}: found shape {array.shape}, expected {expected}")
    if not np.isfinite(array).all():
        raise LogError(f"{where}: found {shown(array.tolist())}, expected finite numbers")
    return array


def _listed(value: Array | None) -> list[float] | None:
    return None if value is None else [float(entry) for entry in value]
