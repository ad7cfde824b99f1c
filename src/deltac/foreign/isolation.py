"""Work in a process of its own: what crashes, hangs or eats all memory ends that process alone.

Two parts of deltac need it. Fleets do rows that may do any of this (`isolated`). Logs in Parquet, HDF5 and
bags of ROS are decoded by libraries in C, C++ and Rust, which a damaged file can bring to end their process
(`apart`).

A worker process is started at the first call and used again; calls at the same time have one each. Work and
answers go through pipes; a worker ends by itself when the process that started it is gone, killed or not.
Those of fleets are forked, on Linux, from a process that has loaded what they need (`forking`).
Since a call is an ordinary function of picklable arguments, any executor can make it: threads of this
process, processes, workers of a cluster.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import os
import pickle
import struct
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Concatenate, ParamSpec, TypeVar

from deltac.errors import FileError, InputError
from deltac.foreign.forking import PROGRAM, ForkedWorker, forked_worker, load
from deltac.foreign.limits import SMALL_FILE, Limits, free_memory

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

P = ParamSpec("P")
T = TypeVar("T")

ISOLATION_VARIABLE = "DELTAC_ISOLATION"
"""Environment variable; "off" has logs decoded in the process that asks for them."""


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
    """Worker processes, as many as there are calls at the same time; what the `quiet` print goes nowhere."""

    def __init__(self, quiet: bool = False) -> None:
        self._quiet = quiet
        self._idle: list[_Worker] = []
        self._busy: set[_Worker] = set()

    def __call__(self, work: Callable[[], Any], time_limit: float) -> Any:
        """What `work()` returns in a worker process, or a `Failure`.

        Args:
            work: picklable, and what it returns. The modules that it `needs` are loaded when a process
                starts, which is no part of the work.
            time_limit: seconds after which the process is ended, from when it has started.
        """
        try:
            worker = self._idle.pop()
        except IndexError:
            modules = getattr(work, "needs", ())
            forked = None if self._quiet else forked_worker(modules, worker_environment())
            worker = _Worker(_spawned(self._quiet) if forked is None else forked)
            self._busy.add(worker)
            worker.ask(functools.partial(load, modules), STARTING)
        else:
            self._busy.add(worker)
        try:
            return worker.ask(work, time_limit)
        finally:
            if not worker.ended:
                self._idle.append(worker)
            self._busy.discard(worker)

    def end(self) -> None:
        """End all of them at once; calls that wait for them return a `Failure`."""
        for worker in [*self._busy, *self._idle]:
            worker.end()
        self._idle.clear()

    def forget(self) -> None:
        """Leave them to the process that they belong to, after a fork."""
        for worker in [*self._busy, *self._idle]:
            worker.forget()
        self._idle, self._busy = [], set()


STARTING = 300.0
"""Seconds that a worker process may take to start, on a machine that is busy."""


_of_fleets, _of_readers = Workers(), Workers(quiet=True)
for _workers in (_of_fleets, _of_readers):
    atexit.register(_workers.end)
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=_workers.forget)


def isolated(work: Callable[[], Any], time_limit: float) -> Any:
    """As `Workers`, of this process: the call that executors of others make."""
    return _of_fleets(work, time_limit)


# -- files that are decoded by native code --------------------------------------------------------


def apart(
    read: Callable[Concatenate[Path, P], T],
) -> Callable[Concatenate[Path, P], T]:
    """A reader of files, called in a worker process that is bounded in memory and time.

    The memory is what the file may unpack to by the limits ``bytes`` and ``expansion``, as often as decoders
    hold it, at most what is free; the time is the limit ``seconds`` and a second more for each 5 MB.

    Raises what the reader raises, as an InputError with its code; FileError for a file that ends the worker,
    LimitError for one that takes too long.
    """

    @functools.wraps(read)
    def reading(path: Path, *args: P.args, **kwargs: P.kwargs) -> T:
        if not _isolating():
            return read(path, *args, **kwargs)
        limits = Limits.current()
        size = os.stat(path).st_size if os.path.isfile(path) else 0  # a bag of ROS 2 is a folder
        seconds = limits.seconds + size / 5e6
        work = functools.partial(
            _bounded, limits, size, reading, Path(os.path.abspath(path)), args, kwargs
        )
        answer = _of_readers(work, seconds)
        if not isinstance(answer, Failure):
            return answer  # type: ignore[no-any-return]
        match answer.code:
            case "E-TIME":
                limits.refuse("seconds", f"decoding takes {seconds:.0f} s and")
            case "E-DIED":
                raise FileError(
                    "the file is damaged such that its decoder crashes "
                    f"({answer.message}); write it again"
                )
            case "E-INTERNAL":
                raise RuntimeError(f"{answer.message}\n{answer.details}")
        raise InputError.of(answer.code, answer.message)

    return reading  # type: ignore[return-value]


def _isolating() -> bool:
    """Whether this process starts workers: it is none itself, and runs an interpreter that can be started."""
    return (
        not INSIDE
        and os.environ.get(ISOLATION_VARIABLE, "") != "off"
        and sys.platform not in ("emscripten", "wasi")
        # Of a program that embeds Python, `executable` is the program.
        and "python" in os.path.basename(sys.executable or "").lower()
    )


INSIDE: list[bool] = []
"""Not empty in a worker process."""


def _bounded(
    limits: Limits,
    size: int,
    read: Callable[..., Any],
    path: Path,
    args: Sequence[Any],
    kwargs: dict[str, Any],
) -> Any:
    most = DECODER_COPIES * min(limits.bytes, max(SMALL_FILE, limits.expansion * size)) + ROOM
    with limits.applied(), more_memory(min(most, free_memory() or most)):
        return read(path, *args, **kwargs)


DECODER_COPIES, ROOM = 4, 2**30
"""How often decoders hold what they unpack, and bytes that they take beside it."""


@contextlib.contextmanager
def more_memory(more: float) -> Iterator[None]:
    """At most so many bytes more than this process has now, where the system can limit them."""
    if resource is None or sys.platform != "linux":  # others do not keep the limit
        yield
        return
    pages = int(Path("/proc/self/statm").read_text("ascii").split()[0])
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    limit = pages * resource.getpagesize() + int(more)
    others = [n for n in (soft, hard) if n != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_AS, (min([limit, *others]), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


# -- the pipes ------------------------------------------------------------------------------------

SIZE = struct.Struct("<Q")


def send(file: IO[bytes], value: Any) -> None:
    """Write a message: the value, pickled, and the memory of its arrays as it is."""
    arrays: list[pickle.PickleBuffer] = []
    content = pickle.dumps(value, pickle.HIGHEST_PROTOCOL, buffer_callback=arrays.append)
    parts = [memoryview(content), *(array.raw() for array in arrays)]
    file.write(SIZE.pack(len(parts)) + b"".join(SIZE.pack(part.nbytes) for part in parts))
    for part in parts:
        file.write(part)
    file.flush()


def receive(file: IO[bytes]) -> tuple[bytearray, list[bytearray]] | None:
    """The next message, for `loaded`, or None where there is none: the other end is gone."""
    count = _taken(file, SIZE.size)
    sizes = None if count is None else _taken(file, SIZE.size * SIZE.unpack(count)[0])
    if sizes is None:
        return None
    parts = [_taken(file, size) for (size,) in SIZE.iter_unpack(sizes)]
    whole = [part for part in parts if part is not None]
    return (whole[0], whole[1:]) if len(whole) == len(parts) else None


def loaded(message: tuple[bytearray, list[bytearray]]) -> Any:
    """The value of a message."""
    return pickle.loads(message[0], buffers=message[1])


def _taken(file: IO[bytes], size: int) -> bytearray | None:
    content = bytearray(size)
    view, got = memoryview(content), 0
    while got < size:
        more = file.readinto(view[got:])  # type: ignore[attr-defined]
        if not more:
            return None
        got += more
    return content


def worker_environment() -> dict[str, str]:
    """Environment variables of workers: one thread each, and the modules that this process finds."""
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "POLARS_MAX_THREADS"), "1")
    path = os.pathsep.join(p for p in sys.path if p)
    return {**threads, **os.environ, "DELTAC_THREADS": "1", "PYTHONPATH": path}


def _spawned(quiet: bool) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [*PROGRAM],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL if quiet else None,
        env=worker_environment(),
        start_new_session=True,
    )


class _Worker:
    """A worker process. In a session of its own, so that Ctrl-C in a terminal is the parent's alone."""

    def __init__(self, process: subprocess.Popen[bytes] | ForkedWorker) -> None:
        self._process, self.ended = process, False

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
            send(self._process.stdin, work)
            answer = receive(self._process.stdout)
        except (OSError, ValueError):  # a broken pipe, or one closed by `end`
            answer = None
        except BaseException:  # an interrupt: its answer would be taken for that of the next call
            self.end()
            raise
        finally:
            timer.cancel()
        if answer is not None:
            return loaded(answer)
        self.end()
        if late.is_set():
            return Failure("E-TIME", f"it took more than {time_limit:g} s, and was ended")
        return Failure("E-DIED", f"its process ended {_ending(self._process.returncode)}")

    def forget(self) -> None:
        """It is the child of another process, which waits for it."""
        self._process.returncode, self.ended = 0, True

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
