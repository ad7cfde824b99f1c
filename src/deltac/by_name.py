"""Values by name: a mapping that cannot be changed, and that says what it has."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

from deltac.errors import UnknownName, closest

Name = TypeVar("Name", bound=str)
Value = TypeVar("Value", covariant=True)


class ByName(Mapping[Name, Value]):
    """A read-only copy of `values`; UnknownName, a KeyError too, for a name that is not there.

    `what` is what the values are of, for the message: "channel".
    """

    __slots__ = ("_values", "_what")

    def __init__(self, what: str, values: Mapping[Name, Value]) -> None:
        self._what, self._values = what, dict(values)

    def __getitem__(self, name: Any) -> Value:
        """The value of a name."""
        try:
            return self._values[name]
        except KeyError:
            raise UnknownName(
                f"unknown {self._what} {name!r}{closest(str(name), self._values)}"
            ) from None

    def __contains__(self, name: object) -> bool:
        return name in self._values

    def __iter__(self) -> Iterator[Name]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __repr__(self) -> str:
        return repr(self._values)
