"""Linear algebra on one thread while a verb works, as many as before when the last one has ended."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Iterator

import pytest

from deltac.calls import linear_algebra
from deltac.calls.linear_algebra import one_thread_per_matrix


@pytest.fixture
def counts() -> Iterator[list[int]]:
    """A library of three threads, in place of those that are loaded; its number after each change."""
    history = [3]
    library = linear_algebra._Threads(lambda: history[-1], history.append)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(linear_algebra, "_libraries", lambda: (library,))
        yield history


def test_one_thread_within_and_the_number_before_after_it(counts: list[int]) -> None:
    with one_thread_per_matrix(), one_thread_per_matrix():
        assert counts == [3, 1]
    assert counts == [3, 1, 3]


def test_an_error_restores_the_number(counts: list[int]) -> None:
    with pytest.raises(ValueError), one_thread_per_matrix():
        raise ValueError
    assert counts[-1] == 3


def test_verbs_on_two_threads_end_in_any_order(counts: list[int]) -> None:
    inside, ended = threading.Event(), threading.Event()

    def first() -> None:
        with one_thread_per_matrix():
            inside.set()
            ended.wait()

    other = threading.Thread(target=first)
    other.start()
    inside.wait()
    with one_thread_per_matrix():
        ended.set()
        other.join()
        assert counts[-1] == 1  # the first has ended, this one works on
    assert counts == [3, 1, 3]


def test_the_libraries_of_numpy_and_scipy_obey() -> None:
    """In a process where neither is told by its environment; LAPACK's numbers are read back from it."""
    said = subprocess.run(
        [sys.executable, "-c", _PROGRAM], stdout=subprocess.PIPE, text=True, check=True
    ).stdout.split()
    if not said:
        pytest.skip("one core, or a BLAS that is not known")
    assert said == ["2", "1", "2"]


_PROGRAM = """
import os
os.environ["OPENBLAS_NUM_THREADS"] = os.environ["MKL_NUM_THREADS"] = "2"
import scipy.linalg
from deltac.calls.linear_algebra import _libraries, one_thread_per_matrix
if os.cpu_count() > 1:
    for library in _libraries()[:1]:
        print(library.get())
        with one_thread_per_matrix():
            print(*{other.get() for other in _libraries()})
        print(library.get())
"""
