"""The entries of q and u: names, units, places."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, overload

from deltac.errors import UnknownName, closest

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Entry:
    """One entry of q or u: its name, joint, unit and place.

    `prescribed`: its motion is a given law of time. `quaternion`: it is a component of a unit quaternion.
    """

    name: str
    joint: str
    unit: str
    index: int
    prescribed: bool
    quaternion: bool = False

    @property
    def slice(self) -> slice:
        """Its place in q or u as a slice."""
        return slice(self.index, self.index + 1)


@dataclass(frozen=True)
class Entries:
    """The entries of q (or of u) in order; indexed by position or by name."""

    entries: tuple[Entry, ...]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """All names, in order."""
        return tuple(entry.name for entry in self.entries)

    @cached_property
    def free_names(self) -> tuple[str, ...]:
        """The names of those that are not prescribed, in order."""
        return tuple(entry.name for entry in self.entries if not entry.prescribed)

    @overload
    def __getitem__(self, key: int | str) -> Entry: ...
    @overload
    def __getitem__(self, key: slice) -> tuple[Entry, ...]: ...
    def __getitem__(self, key: int | str | slice) -> Entry | tuple[Entry, ...]:
        if isinstance(key, str):
            for entry in self.entries:
                if entry.name == key:
                    return entry
            raise UnknownName(f"unknown coordinate or speed {key!r}{closest(key, self.names)}")
        return self.entries[key]

    def of(self, joint: str) -> slice:
        """The places of a joint's entries."""
        return self._of_joints.get(joint, slice(0, 0))

    @cached_property
    def _of_joints(self) -> dict[str, slice]:
        places = dict[str, slice]()
        for entry in self.entries:
            start = places.get(entry.joint, entry.slice).start
            places[entry.joint] = slice(start, entry.index + 1)
        return places

    def __iter__(self) -> Iterator[Entry]:
        return iter(self.entries)

    def __len__(self) -> int:
        return len(self.entries)


@dataclass(frozen=True, eq=False)
class Free:
    """Indices of the coordinates `q` and speeds `u` that a solver integrates (not prescribed)."""

    q: NDArray[np.intp]
    u: NDArray[np.intp]
