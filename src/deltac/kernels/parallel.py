"""Work on all cores: one pool of threads, in which kernels run without threads of their own."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from threading import Event, local
from typing import TypeVar

from deltac.errors import InputError

T = TypeVar("T")


def cores() -> int:
    """The cores that this process may use: `DELTAC_THREADS` if that is set, else those it may run on.

    Raises InputError for a `DELTAC_THREADS` that is no whole number above zero.
    """
    if chosen := os.environ.get("DELTAC_THREADS", "").strip():
        if not chosen.isdecimal() or int(chosen) < 1:
            raise InputError(f"DELTAC_THREADS={chosen!r}: expected a whole number above zero")
        return int(chosen)
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Cancelled(Exception):
    """Raised in a worker whose result nobody waits for any more."""


_here = local()


def check_cancelled() -> None:
    """Raise `Cancelled` in a worker of a `spread` that has failed or was interrupted.

    Long work calls it between its kernel calls; it takes a tenth of a microsecond.
    """
    stop: Event | None = getattr(_here, "stop", None)
    if stop is not None and stop.is_set():
        raise Cancelled


WORTH = 1 << 17
"""Numbers from which on threads for arrays of them save more time than they take."""


def spread(
    work: Callable[[T], object],
    items: Iterable[T],
    threads: int | None = None,
    *,
    numbers: int = WORTH,
) -> None:
    """Call `work` on every item, on `threads` cores (all by default; one for few `numbers` to work on).

    The first error, or an interrupt of the caller (Ctrl-C), is raised: no further items are begun, and those
    under way end at their next `check_cancelled`. NumPy and compiled kernels let go of Python's lock while
    they work.
    """
    chosen = list(items)
    few = len(chosen) <= 1 or numbers < WORTH
    count = 1 if few else min(threads or cores(), len(chosen))
    if count <= 1:
        for item in chosen:
            work(item)
        return
    stop, errors = Event(), list[BaseException]()

    def one(item: T) -> None:
        _here.stop = stop
        try:
            check_cancelled()
            work(item)
        except Cancelled:
            pass
        except BaseException as error:
            errors.append(error)
            stop.set()

    with ThreadPoolExecutor(count) as pool:
        try:
            for _ in pool.map(one, chosen):
                pass
        except BaseException:
            stop.set()
            raise
    if errors:
        raise errors.pop(0)
