"""How far work has come."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TypeAlias, TypeVar

T = TypeVar("T")
Progress: TypeAlias = Callable[[float], None]


def untold(fraction: float) -> None:
    """Progress that nobody asked for."""


class Parts:
    """Progress of the parts of some work as that of the whole.

    `shares` is what each part takes of the time, about; together they are 1. Of parts that are left out the
    share is taken for done.
    """

    def __init__(self, progress: Progress | None, shares: Mapping[str, float]) -> None:
        self._progress, self._shares = progress or untold, shares
        self._done = self._share = 0.0

    def part(self, name: str) -> Progress:
        """A part begins, and all before it are done: what to tell the fraction done of it."""
        names = list(self._shares)
        self._done = sum(self._shares[n] for n in names[: names.index(name)])
        self._share = self._shares[name]
        self(0.0)
        return self

    def __call__(self, fraction: float) -> None:
        """Tell the fraction done of the part that is under way."""
        self._progress(min(1.0, self._done + self._share * fraction))


def counted(items: Sequence[T], progress: Progress) -> Iterator[T]:
    """The items one by one; `progress` is told how many of them are done."""
    for k, item in enumerate(items):
        progress(k / len(items))
        yield item
