"""Readers in a process of their own: bounded, told, and answering again after a crash."""

from __future__ import annotations

import os
import signal
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from deltac.errors import FileError, InputError, LimitError, UnknownName
from deltac.foreign import isolation
from deltac.foreign.isolation import apart
from deltac.foreign.limits import Limits
from deltac.trajectories import read_trajectory


@apart
def read(path: Path, what: str) -> object:
    """A reader that does what it is told."""
    if what == "abort":
        os.abort()
    if what == "sleep":
        time.sleep(60.0)
    if what == "eat":
        return bytearray(64 * 2**30)
    if what == "refuse":
        raise UnknownName("no column")
    if what == "fail":
        raise ZeroDivisionError
    if what == "limits":
        return Limits.current().columns
    return {"pid": os.getpid(), "path": path, "array": np.arange(5.0)}


HERE = Path(__file__)


def test_readers_run_in_one_process_that_is_not_this_one() -> None:
    first, second = read(HERE, "read"), read(HERE, "read")
    assert isinstance(first, dict) and isinstance(second, dict)
    assert first["pid"] == second["pid"] != os.getpid()
    assert first["path"] == HERE.absolute()
    np.testing.assert_array_equal(first["array"], np.arange(5.0))
    first["array"][0] = 1.0  # its own memory, and writable


def test_what_readers_raise_has_its_code() -> None:
    with pytest.raises(UnknownName, match="no column") as caught:
        read(HERE, "refuse")
    assert caught.value.code == "E-NAME"
    with pytest.raises(RuntimeError, match="ZeroDivisionError"):  # an error of ours stays one
        read(HERE, "fail")


@pytest.mark.skipif(os.name == "nt", reason="signals")
def test_a_crash_is_told_and_the_next_file_is_read() -> None:
    with pytest.raises(FileError, match="signal 6") as caught:
        read(HERE, "abort")
    assert caught.value.code == "E-FILE"
    assert isinstance(read(HERE, "read"), dict)


def test_limits_hold_there_and_bound_time() -> None:
    with Limits(columns=7).applied():
        assert read(HERE, "limits") == 7
    start = time.monotonic()
    with Limits(seconds=1).applied(), pytest.raises(LimitError, match="seconds"):
        read(HERE, "sleep")
    assert time.monotonic() - start < 20.0


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory is limited on Linux")
def test_memory_is_bounded() -> None:
    with pytest.raises(LimitError):
        read(HERE, "eat")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_forked_process_has_a_worker_of_its_own() -> None:
    before = read(HERE, "read")
    assert isinstance(before, dict)
    child = os.fork()
    if not child:
        try:
            there = read(HERE, "read")
            os._exit(0 if isinstance(there, dict) and there["pid"] != before["pid"] else 1)
        except BaseException:
            os._exit(2)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    after = read(HERE, "read")
    assert isinstance(after, dict) and after["pid"] == before["pid"]


@pytest.mark.skipif(os.name == "nt", reason="signals")
def test_an_interrupt_leaves_no_answer_behind() -> None:
    threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        read(HERE, "sleep")
    assert isinstance(read(HERE, "read"), dict)


def test_it_can_be_switched_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(isolation.ISOLATION_VARIABLE, "off")
    found = read(HERE, "read")
    assert isinstance(found, dict) and found["pid"] == os.getpid()


def test_what_lies_in_the_folder_is_not_imported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A folder with logs may have a `json.py`, too."""
    (tmp_path / "json.py").write_text("import pathlib\npathlib.Path('ran').touch()\n")
    monkeypatch.chdir(tmp_path)
    workers = isolation.Workers()
    try:
        assert workers(os.getpid, 60.0) != os.getpid()
    finally:
        workers.end()
    assert not (tmp_path / "ran").exists()


def test_all_errors_come_back_as_what_they_were() -> None:
    for code in InputError.codes():
        assert InputError.of(code, "x").code == code


def test_a_file_that_keeps_its_decoder_busy_for_ever() -> None:
    """Found by mutation: the HDF5 library reads a text of it without end."""
    pytest.importorskip("h5py")
    path = HERE.parent / "trajectories" / "hostile" / "endless-text.h5"
    with Limits(seconds=1).applied(), pytest.raises(InputError) as caught:
        read_trajectory(path)
    assert caught.value.code in ("E-LIMIT", "E-FILE")  # E-FILE where another release of it refuses
