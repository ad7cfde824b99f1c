"""Worker processes forked from a server that has loaded their modules: they start in milliseconds.

On Linux only: on macOS, system libraries do not outlive a fork, and Windows has none. The server imports
modules, in one thread, for a fork copies no other; where a module starts threads, it does not fork.
A worker that it forks is its child: the server waits for it, and takes it along when it ends.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import weakref
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import IO, Any

SERVER = "--server"

PROGRAM = (sys.executable, "-P", "-m", "deltac.foreign.worker")
"""The command of a worker. -P: what lies in the folder where deltac is called is not imported."""

LONGEST_MESSAGE = 1 << 17
"""Bytes of a message, most of which are environment variables."""

PARENT_DEATH = 1
"""PR_SET_PDEATHSIG of prctl(2)."""


def load(modules: Sequence[str]) -> None:
    """Import modules, those that are installed."""
    for name in modules:
        with contextlib.suppress(ImportError):
            import_module(name)


class ForkedWorker:
    """A worker, with what `subprocess.Popen` offers of one."""

    def __init__(self, server: ForkServer, pid: int, stdin: IO[bytes], stdout: IO[bytes]) -> None:
        self.pid, self.stdin, self.stdout = pid, stdin, stdout
        self.returncode: int | None = None
        self._server, self._lock = server, threading.Lock()

    def kill(self) -> None:
        """End it. Nobody waited for it so far, so the number is still that of this process."""
        with self._lock:
            if self.returncode is None and self._server.alive:
                os.kill(self.pid, signal.SIGKILL)

    def wait(self, timeout: float | None = None) -> int:
        """Its exit status, once it has ended; the server, if it is gone, has killed it."""
        with self._lock:
            if self.returncode is None:
                answer = self._server.ask({"wait": self.pid})
                self.returncode = answer["status"] if answer else -signal.SIGKILL
            return self.returncode


class ForkServer:
    """A process that forks workers; it ends when nobody refers to it any more."""

    def __init__(self, environment: Mapping[str, str]) -> None:
        self.path = environment["PYTHONPATH"]
        self._lock = threading.Lock()
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._process = subprocess.Popen(
                [*PROGRAM, SERVER],
                stdin=theirs.fileno(),
                stdout=subprocess.DEVNULL,
                env=dict(environment),
                start_new_session=True,
            )
        self._end = weakref.finalize(self, _ended, self._socket, self._process)

    @property
    def alive(self) -> bool:
        """Whether it has not ended."""
        return self._end.alive and self._process.poll() is None

    def fork(self, modules: Sequence[str], environment: Mapping[str, str]) -> ForkedWorker | None:
        """A worker that has these modules; None where there can be none."""
        work, stdin = os.pipe()
        stdout, answers = os.pipe()
        pipes = os.fdopen(stdin, "wb"), os.fdopen(stdout, "rb")
        request: dict[str, Any] = {"modules": list(modules), "environment": dict(environment)}
        with contextlib.suppress(OSError):  # it may be removed
            request["folder"] = os.getcwd()
        try:
            answer = self.ask(request, (work, answers))
        finally:
            os.close(work)
            os.close(answers)
        if answer and answer["pid"]:
            return ForkedWorker(self, answer["pid"], *pipes)
        for pipe in pipes:
            pipe.close()
        return None

    def ask(self, request: Mapping[str, Any], files: Sequence[int] = ()) -> dict[str, Any] | None:
        """Its answer to a request; None if it is gone."""
        content = json.dumps(request).encode()
        if len(content) > LONGEST_MESSAGE:
            return None
        with self._lock:
            try:
                socket.send_fds(self._socket, [content], files)
                answer = self._socket.recv(LONGEST_MESSAGE)
            except OSError:
                return None
            except (
                BaseException
            ):  # an interrupt: its answer would be taken for that of the next request
                self._end()
                raise
        return json.loads(answer) if answer else None


def _ended(control: socket.socket, process: subprocess.Popen[bytes]) -> None:
    control.close()
    with contextlib.suppress(Exception):
        process.kill()
        process.wait(10.0)


_servers: list[ForkServer] = []
"""The server of this process, if it has one."""

_lock = threading.Lock()


def forked_worker(modules: Sequence[str], environment: Mapping[str, str]) -> ForkedWorker | None:
    """A worker forked from the server of this process; None where there is none, or it cannot fork."""
    if sys.platform != "linux":
        return None
    with _lock:
        if not _servers or not _servers[0].alive or _servers[0].path != environment["PYTHONPATH"]:
            _servers[:] = [ForkServer(environment)]
        server = _servers[0]
    return server.fork(modules, environment)


def end_server() -> None:
    """End the server of this process, and the workers that it has forked; the next worker has another."""
    with _lock:
        _servers.clear()


def serve(work: Callable[[], None]) -> None:
    """Fork processes that do the work, on request of whoever holds the other end of standard input."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the affair of whoever asks
    control = socket.socket(fileno=os.dup(0))
    own = os.getpid()
    while True:
        message, files, _, _ = socket.recv_fds(control, LONGEST_MESSAGE, 2)
        if not message:
            os._exit(0)
        request = json.loads(message)
        if "wait" in request:
            _, status = os.waitpid(request["wait"], 0)
            answer: dict[str, int | None] = {"status": os.waitstatus_to_exitcode(status)}
        else:
            load(request["modules"])
            gc.freeze()  # a collection in a worker would copy what it shares with the server
            pid = os.fork() if len(os.listdir("/proc/self/task")) == 1 else None
            if pid == 0:
                control.close()
                _become_worker(own, request, files)
                work()
            answer = {"pid": pid}
        for file in files:
            os.close(file)
        control.send(json.dumps(answer).encode())


def _become_worker(server: int, request: Mapping[str, Any], files: Sequence[int]) -> None:
    """Take pipes, environment and folder of the one that asked, and end with the server."""
    ctypes.CDLL(None).prctl(PARENT_DEATH, signal.SIGKILL)
    if os.getppid() != server:  # it has ended in between
        os._exit(0)
    for file, standard in zip(files, (0, 1), strict=True):
        os.dup2(file, standard)
        os.close(file)
    os.environ.clear()
    os.environ.update(request["environment"])
    with contextlib.suppress(KeyError, OSError):
        os.chdir(request["folder"])


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_servers.clear)
