"""Linear algebra on one thread, while a verb works on many small matrices.

OpenBLAS starts as many threads as there are cores, also for a matrix of a hundred rows. On such matrices they
mostly wait for each other, and they wait by spinning: where other programs used the cores too, an audit of a
humanoid took 5 to 30 s of processor time in place of 2.
"""

from __future__ import annotations

import ctypes
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import NamedTuple

_NAMES = (
    "scipy_openblas_{}_num_threads64_",  # NumPy's wheels
    "scipy_openblas_{}_num_threads",  # SciPy's wheels
    "openblas_{}_num_threads64_",
    "openblas_{}_num_threads",
    "MKL_{}_Num_Threads",
)
_EXTENSIONS = ("numpy.linalg._umath_linalg", "scipy.linalg._flapack", "scipy.linalg._fblas")
"""Compiled modules that link to the libraries; a symbol is looked up in what they link to."""

_lock = threading.Lock()
_users: list[object] = []
_before: list[tuple[_Threads, int]] = []


class _Threads(NamedTuple):
    """How many threads a library uses: read and set."""

    get: Callable[[], int]
    set: Callable[[int], object]


@contextmanager
def one_thread_per_matrix() -> Iterator[None]:
    """The linear algebra of NumPy and SciPy on one thread each; as it was, when the last user has ended.

    Libraries that are not known here keep their threads. The number is the process's: matrices of other
    threads are one thread's meanwhile too.
    """
    user = object()
    with _lock:
        _users.append(user)
        if len(_users) == 1:
            # SciPy may be loaded later than this: it is small.
            import scipy.linalg.lapack  # noqa: F401

            _before[:] = [(library, library.get()) for library in _libraries()]
            for library, _ in _before:
                library.set(1)
    try:
        yield
    finally:
        with _lock:
            _users.remove(user)
            if not _users:
                for library, count in _before:
                    library.set(count)


@cache
def _libraries() -> tuple[_Threads, ...]:
    """The libraries that count their threads."""
    libraries = []
    for name in _EXTENSIONS:
        file = getattr(sys.modules.get(name), "__file__", None)
        library = None if file is None else _threads(file)
        if library is not None:
            libraries.append(library)
    return tuple(libraries)


def _threads(file: str) -> _Threads | None:
    """Of the library that a compiled module links to; None where it is not known."""
    extension = ctypes.CDLL(file)
    for name in _NAMES:
        get, set_ = (
            getattr(extension, name.format(verb.title() if name.startswith("MKL") else verb), None)
            for verb in ("get", "set")
        )
        if get is not None and set_ is not None:
            return _Threads(get, set_)
    return None
