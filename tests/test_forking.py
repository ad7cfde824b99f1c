"""Workers forked from a server: loaded, apart from each other, told of their ends, never left behind."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import pytest

from deltac.foreign import forking
from deltac.foreign.isolation import Failure, Workers

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="workers are forked on Linux")


@dataclass(frozen=True)
class Work:
    """What a worker is, or its end."""

    needs: ClassVar[tuple[str, ...]] = ("colorsys", "no_such_module")

    end: str = ""

    def __call__(self) -> dict[str, Any]:
        if self.end == "abort":
            os.abort()
        if self.end == "exit":
            os._exit(7)
        if self.end == "sleep":
            time.sleep(60.0)
        return {
            "pid": os.getpid(),
            "parent": os.getppid(),
            "loaded": "colorsys" in sys.modules,
            "folder": os.getcwd(),
            "variable": os.environ.get("DELTAC_OF_A_TEST"),
        }


@dataclass(frozen=True)
class Threaded(Work):
    """Work that needs a module which starts a thread."""

    needs = ("tests.support.threaded",)


@pytest.fixture
def workers() -> Iterator[Workers]:
    made = Workers()
    yield made
    made.end()


def gone(pid: int, seconds: float = 10.0) -> bool:
    until = time.monotonic() + seconds
    while Path(f"/proc/{pid}").exists():
        if time.monotonic() > until:
            return False
        time.sleep(0.01)
    return True


def at_once(workers: Workers, works: list[Callable[[], Any]], limit: float = 60.0) -> list[Any]:
    answers: list[Any] = [None] * len(works)

    def ask(k: int) -> None:
        answers[k] = workers(works[k], limit)

    threads = [threading.Thread(target=ask, args=(k,)) for k in range(len(works))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return answers


def test_workers_have_the_modules_and_are_those_of_one_server(workers: Workers) -> None:
    first, second = workers(Work(), 60.0), Workers()(Work(), 60.0)
    assert first["loaded"] and second["loaded"]
    assert first["pid"] != second["pid"]
    assert first["parent"] == second["parent"] != os.getpid()


def test_environment_and_folder_are_those_of_the_call(
    workers: Workers, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = workers(Work(), 60.0)
    assert before["variable"] is None
    monkeypatch.setenv("DELTAC_OF_A_TEST", "1")
    monkeypatch.chdir(tmp_path)
    others = Workers()
    after = others(Work(), 60.0)
    others.end()
    assert (after["variable"], after["folder"]) == ("1", str(tmp_path))
    assert after["parent"] == before["parent"]


@pytest.mark.parametrize(("end", "said"), [("abort", "by signal 6"), ("exit", "with status 7")])
def test_how_a_worker_ended_is_told_and_the_next_works(
    workers: Workers, end: str, said: str
) -> None:
    failure = workers(Work(end), 60.0)
    assert isinstance(failure, Failure) and failure.code == "E-DIED" and said in failure.message
    assert workers(Work(), 60.0)["loaded"]


def test_one_that_takes_too_long_ends_alone(workers: Workers) -> None:
    slow, quick = at_once(workers, [Work("sleep"), Work()], 3.0)
    assert isinstance(slow, Failure) and slow.code == "E-TIME"
    assert quick["loaded"]


def test_ended_workers_are_gone(workers: Workers) -> None:
    pids = [one["pid"] for one in at_once(workers, [Work(), Work()])]
    workers.end()
    assert all(map(gone, pids))


def test_workers_end_with_a_server_that_is_killed(workers: Workers) -> None:
    there = workers(Work(), 60.0)
    os.kill(there["parent"], signal.SIGKILL)
    assert gone(there["pid"])
    died = workers(Work(), 60.0)
    assert isinstance(died, Failure) and died.transient
    again = workers(Work(), 60.0)
    assert again["loaded"] and again["parent"] not in (there["parent"], os.getpid())


def test_where_threads_run_nothing_is_forked(workers: Workers) -> None:
    try:
        assert workers(Threaded(), 60.0)["parent"] == os.getpid()
    finally:
        forking.end_server()
    assert Workers()(Work(), 60.0)["parent"] != os.getpid()


def test_a_forked_process_leaves_the_server_alone(workers: Workers) -> None:
    before = workers(Work(), 60.0)
    child = os.fork()
    if not child:
        os._exit(1 if forking._servers else 0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    others = Workers()
    after = others(Work(), 60.0)
    others.end()
    assert after["parent"] == before["parent"]


def test_a_long_environment_is_not_sent(workers: Workers, monkeypatch: pytest.MonkeyPatch) -> None:
    for k in range(3):
        monkeypatch.setenv(f"DELTAC_LONG_{k}", "x" * 60_000)
    assert workers(Work(), 60.0)["parent"] == os.getpid()
