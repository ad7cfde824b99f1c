"""How far work has come, and what of it is left out when its time has passed."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TypeAlias, TypeVar

from deltac.errors import ArgumentsError, shown

T = TypeVar("T")
TIME_LIMIT = 60.0
"""Seconds that a search may take where its user says nothing: it ends with the best that it has."""

Progress: TypeAlias = Callable[[float], None]


def no_progress(fraction: float) -> None:
    """Progress that nobody asked for."""


class Parts:
    """Progress of the parts of some work as that of the whole.

    `shares` is what each part takes of the time, about; together they are 1. Of parts that are left out the
    share is taken for done.
    """

    def __init__(self, progress: Progress | None, shares: Mapping[str, float]) -> None:
        self._progress, self._shares = progress or no_progress, shares
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


class TimeLimit:
    """So many seconds from now by the monotonic clock; None for no end.

    Attributes:
        skipped: names of the work that was left out, each once.

    Raises InputError for what is no positive number of seconds.
    """

    def __init__(self, seconds: float | None = None) -> None:
        if seconds is not None and not seconds > 0.0:
            raise ArgumentsError(f"time_limit: found {shown(seconds)}, expected seconds above 0")
        self.seconds = math.inf if seconds is None else float(seconds)
        self._end = time.monotonic() + self.seconds
        self.skipped: tuple[str, ...] = ()

    def passed(self, work: str, seconds: float = 0.0) -> bool:
        """Whether `work`, which takes about so many seconds, would end too late; it is then `skipped`."""
        late = time.monotonic() + seconds > self._end
        if late and work not in self.skipped:
            self.skipped += (work,)
        return late
