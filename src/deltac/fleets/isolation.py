"""Work in a process of its own: what crashes, hangs or eats all memory ends that process alone.

Each thread that calls `isolated` has a worker process, started at its first call and used again. Work and
answers go through pipes; a worker ends by itself when the process that started it is gone, killed or not.
Since a call is an ordinary function of picklable arguments, any executor can make it: threads of this
process, processes, workers of a cluster.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import pickle
import struct
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import IO, Any

from deltac.errors import InputError


@dataclass(frozen=True)
class Failure:
    """Work that gave no answer.

    code: that of an InputError, "E-TIME" (it took too long), "E-DIED" (its process ended), or "E-INTERNAL"
        (an error of ours or of a library).
    message: for a reader; `details`: the traceback, where there is one.
    """

    code: str
    message: str
    details: str = ""

    @property
    def transient(self) -> bool:
        """Whether another attempt may succeed: a process may be killed for other reasons than its work."""
        return self.code in ("E-DIED", "E-TIME")


class Workers:
    """Worker processes, one for each thread that calls this."""

    def __init__(self) -> None:
        self._own = threading.local()
        self._all: set[_Worker] = set()

    def __call__(self, work: Callable[[], Any], time_limit: float) -> Any:
        """What `work()` returns in the worker process of this thread, or a `Failure`.

        Args:
            work: picklable, and what it returns.
            time_limit: seconds after which the process is ended, from when it has started.
        """
        worker: _Worker | None = getattr(self._own, "worker", None)
        if worker is None or worker.ended:
            if worker is not None:
                self._all.discard(worker)
            worker = self._own.worker = _Worker()
            self._all.add(worker)
            worker.ask(_started, STARTING)  # the limit is of the work alone
        return worker.ask(work, time_limit)

    def end(self) -> None:
        """End all of them at once; calls that wait for them return a `Failure`."""
        for worker in list(self._all):
            worker.end()


STARTING = 300.0
"""Seconds that a worker process may take to start, on a machine that is busy."""


def _started() -> None:
    """What workers load in any case."""
    for name in ("polars", "deltac.simulation.simulate"):
        import_module(name)


_of_this_process = Workers()
atexit.register(_of_this_process.end)


def isolated(work: Callable[[], Any], time_limit: float) -> Any:
    """As `Workers`, of this process: the call that executors of others make."""
    return _of_this_process(work, time_limit)


SIZE = struct.Struct("<Q")


def send(file: IO[bytes], content: bytes) -> None:
    """Write a message: its length, then its bytes."""
    file.write(SIZE.pack(len(content)))
    file.write(content)
    file.flush()


def receive(file: IO[bytes]) -> bytes | None:
    """The next message, or None where there is none: the other end is gone."""
    head = file.read(SIZE.size)
    if len(head) < SIZE.size:
        return None
    (size,) = SIZE.unpack(head)
    content = file.read(size)
    return content if len(content) == size else None


class _Worker:
    """A worker process. In a session of its own, so that Ctrl-C in a terminal is the parent's alone."""

    def __init__(self) -> None:
        threads = dict.fromkeys(
            ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "POLARS_MAX_THREADS"), "1"
        )
        path = os.pathsep.join(p for p in sys.path if p)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "deltac.fleets.worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**threads, **os.environ, "DELTAC_THREADS": "1", "PYTHONPATH": path},
            start_new_session=True,
        )
        self.ended = False

    def ask(self, work: Callable[[], Any], time_limit: float) -> Any:
        assert self._process.stdin is not None and self._process.stdout is not None
        late = threading.Event()

        def end() -> None:
            late.set()
            self.end()

        timer = threading.Timer(time_limit, end)
        timer.daemon = True
        timer.start()
        try:
            send(self._process.stdin, pickle.dumps(work, pickle.HIGHEST_PROTOCOL))
            answer = receive(self._process.stdout)
        except (OSError, ValueError):  # a broken pipe, or one closed by `end`
            answer = None
        finally:
            timer.cancel()
        if answer is not None:
            return pickle.loads(answer)
        self.end()
        if late.is_set():
            return Failure("E-TIME", f"it took more than {time_limit:g} s, and was ended")
        return Failure("E-DIED", f"its process ended {_ending(self._process.returncode)}")

    def end(self) -> None:
        """End the process, whatever it does."""
        self.ended = True
        with contextlib.suppress(OSError):
            self._process.kill()
        with contextlib.suppress(Exception):
            self._process.wait(10.0)
        for pipe in (self._process.stdin, self._process.stdout):
            with contextlib.suppress(Exception):
                if pipe is not None:
                    pipe.close()


def _ending(code: int | None) -> str:
    if code is not None and code < 0:
        return f"by signal {-code}"
    return f"with status {code}"


def answered(work: Callable[[], Any]) -> Any:
    """What `work()` returns, or the `Failure` that it ends in."""
    try:
        return work()
    except InputError as error:
        return Failure(error.code, str(error))
    except MemoryError:
        return Failure("E-LIMIT", "the memory does not suffice")
    except Exception as error:
        import traceback

        return Failure("E-INTERNAL", f"{type(error).__name__}: {error}", traceback.format_exc())
