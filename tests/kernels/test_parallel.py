"""Work on all cores: the first error is raised, and what nobody waits for ends."""

from __future__ import annotations

import signal
import threading
import time
from threading import Event

import pytest

from deltac.kernels.parallel import Cancelled, check_cancelled, spread

LONG = 60.0
"""Seconds after which a wait gives up: far beyond what any of these takes."""


def wait_for_cancellation() -> None:
    """Work that ends by nothing else."""
    started = time.monotonic()
    while time.monotonic() - started < LONG:
        check_cancelled()
        time.sleep(0.001)
    raise AssertionError("never cancelled")


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_every_item_is_worked_on_once(threads: int) -> None:
    done: list[int] = []
    spread(done.append, range(100), threads)
    assert sorted(done) == list(range(100))


def test_nothing_is_cancelled_outside() -> None:
    check_cancelled()
    spread(lambda _: check_cancelled(), range(4), 2)
    check_cancelled()


@pytest.mark.parametrize("threads", [1, 2])
def test_an_error_ends_the_work(threads: int) -> None:
    """The error of item 1 is raised although item 0 is still under way; no item after it is begun."""
    begun, first = list[int](), Event()

    def work(item: int) -> None:
        begun.append(item)
        if item == 0:
            first.set()
            if threads > 1:
                wait_for_cancellation()
        else:
            assert first.wait(LONG)
            raise ZeroDivisionError("item 1")

    with pytest.raises(ZeroDivisionError, match="item 1"):
        spread(work, range(20), threads)
    assert sorted(begun) == [0, 1]


def test_the_first_error_in_time_is_raised() -> None:
    """Not that of the first item: what fails because it was cancelled tells nothing."""
    first = Event()

    def work(item: int) -> None:
        if item == 1:
            assert first.wait(LONG)
            raise ZeroDivisionError("earlier")
        first.set()
        try:
            wait_for_cancellation()
        except Cancelled:
            raise KeyError("later") from None

    with pytest.raises(ZeroDivisionError, match="earlier"):
        spread(work, range(2), 2)


@pytest.mark.skipif(not hasattr(signal, "pthread_kill"), reason="interrupts need POSIX signals")
def test_an_interrupt_ends_the_work() -> None:
    main, begun, first = threading.main_thread(), list[int](), Event()
    assert main.ident is not None and threading.current_thread() is main
    ident = main.ident

    def work(item: int) -> None:
        begun.append(item)
        if item == 0:
            first.set()
        else:
            assert first.wait(LONG)
            signal.pthread_kill(ident, signal.SIGINT)
        wait_for_cancellation()

    with pytest.raises(KeyboardInterrupt):
        spread(work, range(20), 2)
    assert sorted(begun) == [0, 1]
