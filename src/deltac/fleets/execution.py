"""The loop of a fleet: pieces of work to an executor, answers to the store; nothing is lost or done twice.

The executor is anything that follows `concurrent.futures`: threads of this process (each with a worker
process of its own, see `isolation`) on all cores, a Dask cluster, a user's own. Only this loop writes.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from typing import Any

from deltac.errors import ProcessLost, requirement
from deltac.fleets.rows import Piece
from deltac.foreign.isolation import Failure, Workers, isolated
from deltac.kernels import cores

TICK = 0.5
"""Seconds between two looks at the cluster and the clock."""

IN_FLIGHT = 2
"""Pieces in flight for each worker: one in work, the next at hand. More would only take memory."""


@dataclass(frozen=True, eq=False)
class WorkAttempt:
    """A piece of work, and how often it has failed."""

    work: Piece
    failed: int = 0


class SchedulerLost(Exception):
    """The cluster does not answer any more."""


@dataclass(frozen=True, eq=False)
class Crew:
    """Who does the work.

    executor  runs `call`, in a thread or process of its own
    size      how many calls it runs at a time
    call      does a piece of work within a time limit, in a process that may die
    check     raises `SchedulerLost` where nobody will answer
    """

    executor: Executor
    size: int
    call: Callable[[Callable[[], Any], float], Any] = isolated
    check: Callable[[], None] = field(default=lambda: None)


@contextlib.contextmanager
def local_crew(workers: int | None) -> Iterator[Crew]:
    """Worker processes of this machine, by default one a core."""
    size, own = workers or cores(), Workers()
    executor = ThreadPoolExecutor(size, "deltac-fleet")
    try:
        yield Crew(executor, size, own)
    finally:
        # A thread may be about to start another process: these are ended until all threads are gone.
        executor.shutdown(wait=False, cancel_futures=True)
        leaving = threading.Thread(target=executor.shutdown)
        leaving.start()
        while leaving.is_alive():
            own.end()
            leaving.join(0.05)
        own.end()


@contextlib.contextmanager
def dask_crew(address: str) -> Iterator[Crew]:
    """The workers of a Dask cluster, by the address of its scheduler.

    Raises PackageError without dask.distributed, InputError where no scheduler answers.
    """
    with requirement(
        "--scheduler needs dask.distributed: pip install 'deltac[dask]', here and on every worker"
    ):
        from distributed import Client
    # Its messages about lost connections are replaced by one of ours.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        client = Client(address, timeout="10s")
    except (OSError, TimeoutError, ValueError) as error:
        raise ProcessLost(
            f"scheduler {address!r} does not answer: {error}. Start one by 'dask scheduler' and its workers "
            "by 'dask worker ADDRESS', or leave --scheduler out to use the cores of this machine"
        ) from error

    def check() -> None:
        if client.status != "running":
            raise SchedulerLost(f"the scheduler {address} is gone")

    try:
        threads = sum(client.nthreads().values())
        yield Crew(client.get_executor(pure=False), max(1, threads), check=check)
    finally:
        with contextlib.suppress(Exception):
            client.close(timeout=2)


def execute(
    crew: Crew,
    pieces: Iterable[Piece],
    keep: Callable[[Piece, Any], None],
    set_aside: Callable[[Piece, Failure], None],
    *,
    time_limit: float,
    retries: int,
    done: Callable[[int], None],
) -> None:
    """Do all pieces.

    A piece that fails is halved, down to the single row that fails; a row whose process died, or that took
    too long, gets `retries` more attempts. What fails still is set aside. At most `IN_FLIGHT` pieces a worker
    are in flight, so memory is that of these. `keep` and `set_aside` are called in this thread; `done` with
    the number of rows that either has taken.

    Raises SchedulerLost; KeyboardInterrupt, upon which work in flight is given up.
    """
    waiting = iter(pieces)
    again: deque[WorkAttempt] = deque()
    flying: dict[Future[Any], WorkAttempt] = {}

    def next_attempt() -> WorkAttempt | None:
        if again:
            return again.popleft()
        work = next(waiting, None)
        return None if work is None else WorkAttempt(work)

    def fail(attempt: WorkAttempt, failure: Failure) -> None:
        work = attempt.work
        if work.rows > 1:
            again.extend(WorkAttempt(half) for half in work.halves())
        elif failure.transient and attempt.failed < retries:
            again.append(WorkAttempt(work, attempt.failed + 1))
        else:
            set_aside(work, failure)
            done(1)

    try:
        while True:
            while len(flying) < IN_FLIGHT * crew.size:
                attempt = next_attempt()
                if attempt is None:
                    break
                future = crew.executor.submit(crew.call, attempt.work, time_limit)
                flying[future] = attempt
            if not flying:
                return
            finished, _ = wait(flying, TICK, FIRST_COMPLETED)
            crew.check()
            for future in finished:
                attempt = flying.pop(future)
                answer = _answer(future, crew)
                if isinstance(answer, Failure):
                    fail(attempt, answer)
                else:
                    keep(attempt.work, answer)
                    done(attempt.work.rows)
    except BaseException:
        for future in flying:
            future.cancel()
        raise


def _answer(future: Future[Any], crew: Crew) -> Any:
    """What a future came to; what the executor itself raises is a failure of the piece."""
    try:
        return future.result()
    except Exception as error:  # a worker of the cluster that died with the piece in it
        crew.check()
        return Failure("E-DIED", f"{type(error).__name__}: {error}")


class Pace:
    """Rate and time left, from the fractions that `progress` is called with; the first was there before."""

    def __init__(self, total: int) -> None:
        self.total = total
        self._first: tuple[float, float] | None = None

    def progress_line(self, fraction: float) -> str:
        """Such as "1024 of 4096, 512/s, 6 s left"."""
        now = time.monotonic()
        if self._first is None:
            self._first = now, fraction
        began, before = self._first
        done = f"{round(fraction * self.total)} of {self.total}"
        if fraction <= before or now <= began:
            return done
        rate = (fraction - before) / (now - began)
        return f"{done}, {rate * self.total:.3g}/s, {_seconds((1.0 - fraction) / rate)} left"


def _seconds(value: float) -> str:
    if value < 120.0:
        return f"{value:.0f} s"
    return f"{value / 60.0:.0f} min" if value < 7200.0 else f"{value / 3600.0:.1f} h"
