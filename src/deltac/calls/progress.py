"""How far work has come, and until when it may go on."""

from __future__ import annotations

import math
import time
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


class Deadline:
    """When some work must end with what it has, and what was left out of it for that.

    `seconds` are counted from now. A part of the time has a deadline of its own (`part`), and tells the whole
    what it left out.
    """

    def __init__(self, seconds: float = math.inf, left_out: list[str] | None = None) -> None:
        self._start = time.monotonic()
        self._seconds = seconds
        self.left_out: list[str] = [] if left_out is None else left_out

    def part(self, share: float) -> Deadline:
        """A deadline after a share of the time that is left."""
        seconds = self._seconds - (time.monotonic() - self._start)
        return Deadline(share * max(seconds, 0.0), self.left_out)

    def beside(self, seconds: float) -> Deadline:
        """A deadline of its own, so many seconds from now, which tells this one what it left out."""
        return Deadline(seconds, self.left_out)

    @property
    def spent(self) -> float:
        """The share of the time that has gone; 0 where there is no end."""
        return (time.monotonic() - self._start) / max(self._seconds, 1e-9)

    def passed(self, what: str = "") -> bool:
        """Whether time is up; `what` is then noted as left out."""
        over = self.spent > 1.0
        if over and what and what not in self.left_out:
            self.left_out.append(what)
        return over
