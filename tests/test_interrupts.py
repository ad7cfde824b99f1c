"""Ctrl-C: an interrupt ends the work within a second, also where a library would drop the exception."""

from __future__ import annotations

import contextlib
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import casadi
import numpy as np
import pytest

from deltac.calls.interrupts import check_interrupted, interruptible, waiting

pytestmark = pytest.mark.skipif(
    not hasattr(signal, "pthread_kill"), reason="interrupts need POSIX signals"
)
SECOND = 1.0


def interrupting(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """CasADi's conversion of arguments, as if Ctrl-C were pressed in it; when that was."""
    pressed: list[float] = []
    known: dict[str, Any] = {"original": casadi.DM_from_array, "press": lambda: press()}

    def press() -> None:
        if not pressed:
            pressed.append(time.monotonic())
            signal.raise_signal(signal.SIGINT)

    source = (
        "def DM_from_array(m, check_only=True):\n    press()\n    return original(m, check_only)\n"
    )
    exec(
        compile(source, "casadi/casadi.py", "exec"), known
    )  # a function of that file, to the handler
    monkeypatch.setattr(casadi, "DM_from_array", known["DM_from_array"])
    return pressed


def converted(until: Callable[[], bool]) -> None:
    """Arguments that CasADi converts by its Python function."""
    while not until():
        casadi.vertcat(np.eye(2), casadi.DM.ones(1, 2))


def test_casadi_drops_an_interrupt_of_its_conversions(monkeypatch: pytest.MonkeyPatch) -> None:
    """What this module is for: without it nothing is raised. If this fails, CasADi has been mended."""
    pressed = interrupting(monkeypatch)
    limit = time.monotonic() + 10.0
    with contextlib.suppress(NotImplementedError):  # "wrong arguments": what it was taken for
        converted(lambda: bool(pressed) or time.monotonic() > limit)
    assert pressed


def test_an_interrupt_in_a_conversion_is_raised_all_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pressed = interrupting(monkeypatch)
    limit = time.monotonic() + 10.0
    with pytest.raises(KeyboardInterrupt), interruptible():
        converted(lambda: time.monotonic() > limit)
    assert time.monotonic() - pressed[0] < SECOND
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_an_interrupt_that_a_library_drops_ends_the_work_at_the_next_check() -> None:
    reached = []
    with pytest.raises(KeyboardInterrupt), interruptible():
        try:
            signal.raise_signal(signal.SIGINT)
        except BaseException:
            reached.append("dropped")
        check_interrupted()
        reached.append("beyond")
    assert reached == ["dropped"]
    with pytest.raises(KeyboardInterrupt), interruptible():  # at the latest at its end
        try:
            signal.raise_signal(signal.SIGINT)
        except BaseException:
            reached.append("dropped")
    check_interrupted()  # it is over


def test_a_handler_of_the_user_is_left_alone() -> None:
    told: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: told.append(number))
    try:
        with interruptible():
            signal.raise_signal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)
    assert told == [signal.SIGINT]


def test_other_threads_take_no_part() -> None:
    """Signals belong to the main thread; a verb in another one changes nothing."""
    found: list[Any] = []

    def work() -> None:
        with interruptible():
            found.append(signal.getsignal(signal.SIGINT))
            found.append(waiting(lambda: threading.current_thread()))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert found == [signal.default_int_handler, thread]


def test_a_long_call_is_not_waited_for() -> None:
    """Compilation goes on in a thread of its own; its errors are those of the call."""
    go_on = threading.Event()
    main = threading.main_thread().ident
    assert main is not None
    threading.Timer(0.1, lambda: signal.pthread_kill(main, signal.SIGINT)).start()
    begun = time.monotonic()
    try:
        with pytest.raises(KeyboardInterrupt), interruptible():
            waiting(lambda: go_on.wait(20.0))
        assert time.monotonic() - begun < 0.1 + SECOND
    finally:
        go_on.set()
    assert waiting(lambda: 3) == 3
    with pytest.raises(ZeroDivisionError):
        waiting(lambda: 1 // 0)


STUDY = """
import signal, sys, time
import deltac as dc
problem = dc.problems.load("n-four-bar")
pressed = []
def told(done):
    if not pressed:
        print("begun", flush=True)
        pressed.append(1)
try:
    while True:
        dc.simulate(problem.mechanism, problem.state, 1.0, 0.01, {solver!r}, progress=told)
        dc.balance(problem.mechanism, dc.simulate(problem.mechanism, problem.state, 0.1, 0.01, {solver!r}))
except KeyboardInterrupt:
    print("ended", time.monotonic(), flush=True)
"""


def test_what_a_library_makes_of_an_interrupt_is_one() -> None:
    """NumPy: SystemError, "<function DM.__array__> returned a result with an exception set"."""
    with pytest.raises(KeyboardInterrupt), interruptible():
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt as error:
            raise SystemError("returned a result with an exception set") from error


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["ode5", "IDAS", "generalized-alpha"])
def test_interrupts_at_random_moments_end_a_run(solver: str) -> None:
    rng = np.random.default_rng(13)
    for _ in range(10):
        command = [sys.executable, "-c", STUDY.format(solver=solver)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            assert process.stdout.readline() == "begun\n"
            time.sleep(float(rng.uniform(0.0, 1.0)))
            sent = time.monotonic()
            process.send_signal(signal.SIGINT)
            word, when = process.stdout.readline().split()
            assert word == "ended" and float(when) - sent < SECOND
