"""Ctrl-C ends the work, wherever it arrives.

Python raises KeyboardInterrupt in whatever Python code runs when the signal is handled. That code may be a
function which a library calls back and whose exceptions it drops. CasADi asks `DM_from_array` and its like
whether an argument can be converted, and takes any exception for a no; SUNDIALS takes one for an equation
that is not defined; NumPy makes a SystemError of one in a method `__array__`. So the verbs run under
`interruptible`, which knows that an interrupt was asked for. It is put off where it would be dropped, and
raised again by the next `check_interrupted`, at the latest at the end of the verb.
"""

from __future__ import annotations

import _thread
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TypeVar

T = TypeVar("T")

DROPPED = ("_from_array", "_from_csc")
"""Endings of the functions that CasADi calls back to convert arguments."""

_asked = threading.Event()


@contextmanager
def interruptible() -> Iterator[None]:
    """Work that an interrupt ends; in the main thread, and unless the user handles interrupts otherwise."""
    main = threading.current_thread() is threading.main_thread()
    handler = signal.getsignal(signal.SIGINT)
    if not main or handler not in (signal.default_int_handler, _interrupt):
        yield
        return
    try:
        signal.signal(signal.SIGINT, _interrupt)
        check_interrupted()
        try:
            yield
        finally:
            check_interrupted()  # also in place of what a library made of it: NumPy a SystemError
    finally:
        signal.signal(signal.SIGINT, handler)
        if handler is not _interrupt:
            _asked.clear()


def check_interrupted() -> None:
    """Raise KeyboardInterrupt if one was asked for and dropped on its way here."""
    if _asked.is_set() and threading.current_thread() is threading.main_thread():
        raise KeyboardInterrupt


def waiting(make: Callable[[], T]) -> T:
    """The result of a long call into a library that lets other threads run meanwhile.

    An interrupt of the main thread is raised at once; the call goes on by itself to its end, which nobody
    waits for.
    """
    if threading.current_thread() is not threading.main_thread():
        return make()
    results: list[T] = []
    errors: list[BaseException] = []

    def work() -> None:
        try:
            results.append(make())
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=work, name="deltac-compile")
    thread.start()
    thread.join()
    if errors:
        raise errors[0]
    return results[0]


def _interrupt(number: int, frame: FrameType | None) -> None:
    """The handler of SIGINT while work is under way."""
    _asked.set()
    if _dropped(frame):
        # Sent again when the code that drops it has had its turns.
        timer = threading.Timer(2.0 * sys.getswitchinterval(), _thread.interrupt_main)
        timer.daemon = True
        timer.start()
        return
    raise KeyboardInterrupt


def _dropped(frame: FrameType | None) -> bool:
    """Whether what is raised in this frame is dropped on its way out."""
    while frame is not None:
        code = frame.f_code
        if code.co_name.endswith(DROPPED) and code.co_filename.endswith("casadi.py"):
            return True
        frame = frame.f_back
    return False
