"""Many steps in one native call of heyoka: the columns of a batch, each computed from the one before.

heyoka has no loop over time, but it goes through the columns of a batch one after the other (scalar code,
one thread). Arguments and results are two views of the same memory, one column apart, so that the result of
a column is the argument of the next. heyoka refuses arrays that overlap, which would be wrong within one
column, and tells by their addresses; so the views are two mappings of the same pages.

That columns come in order is not promised by heyoka. So every column counts: it hands on the count of the one
before plus one, and all counts are NaN until they are written. The last count is right if and only if all
columns were computed in order; otherwise they are computed again, a call each.
"""

from __future__ import annotations

import math
import mmap
import os
import tempfile
from threading import local
from typing import Any

import heyoka as hy
import numpy as np

from deltac.arrays import Array
from deltac.interrupts import waiting
from deltac.kernels.cache import compiled, prepare_heyoka
from deltac.kernels.lowering import to_heyoka
from deltac.kernels.parallel import one_thread_a_call

BLOCK_BYTES = 2**18
"""Memory of the columns of one call: it stays in a core's cache while they are copied out."""

_here = local()


class HeyokaLoop:
    """`x ← f(x, p)`, over and over, compiled or read from the disk cache."""

    def __init__(self, function: Any) -> None:
        """Of a function of dense columns (x, p) to a column of the size of x."""
        source = (prepare_heyoka(), "loop", function.serialize())
        self._compiled: Any = compiled(repr(source), lambda: waiting(lambda: _made(function)))
        self._n_parameters: int = self._compiled.nparams  # up to the last that occurs

    def iterate(self, rows: Array, parameters: Array) -> None:
        """As `Loop`'s: in blocks that stay in the cache."""
        count, n = len(rows) - 1, rows.shape[1]
        period = len(parameters)
        # Whole periods, an odd number: rows a power of two apart would share few places in the cache.
        block = min(count, (BLOCK_BYTES // (8 * (n + 1) * period) | 1) * period)
        memory = _mirrored(8 * ((n + 1) * block + 1))
        p = np.tile(parameters[:, : self._n_parameters].T, -(-block // period))
        with one_thread_a_call():
            for first in range(0, count, block):
                here = rows[first : first + block + 1]
                self._block(here, p[:, : len(here) - 1], *memory)

    def _block(self, rows: Array, p: Array, given: Array, results: Array) -> None:
        """Rows 1, 2, … of these from row 0."""
        count, n = len(rows) - 1, rows.shape[1]
        size = (n + 1) * count
        x, y = given[:size].reshape(n + 1, count), results[1 : 1 + size].reshape(n + 1, count)
        x[n] = math.nan
        x[:n, 0], x[n, 0] = rows[0], 0.0
        told = {"pars": np.ascontiguousarray(p)} if self._n_parameters else {}
        if count > 1:
            self._compiled(x, outputs=y, **told)
        if count > 1 and y[n, -1] == count:
            rows[1:] = y[:n].T
            return
        after = np.empty(n + 1)
        for k in range(count):
            told = {"pars": np.ascontiguousarray(p[:, k])} if self._n_parameters else {}
            self._compiled(np.append(rows[k], 0.0), outputs=after, **told)
            rows[k + 1] = after[:n]


def _made(function: Any) -> Any:
    variables = [hy.expression(f"x{i}") for i in range(function.nnz_in(0))]
    parameters = [hy.par[i] for i in range(function.nnz_in(1))]
    (outputs,) = to_heyoka(function, [variables, parameters])
    number = hy.expression("count")
    return hy.cfunc([*outputs, number + 1.0], vars=[*variables, number], batch_size=1)


def _mirrored(size: int) -> tuple[Array, Array]:
    """Two arrays on the same memory, of so many bytes at least; a thread has one such pair."""
    found: tuple[Array, Array] | None = getattr(_here, "views", None)
    if found is None or found[0].nbytes < size:
        size = -(-size // mmap.PAGESIZE) * mmap.PAGESIZE
        with _file() as file:
            os.ftruncate(file.fileno(), size)
            maps = [mmap.mmap(file.fileno(), size) for _ in range(2)]
        found = (np.frombuffer(maps[0]), np.frombuffer(maps[1]))
        _here.views = found
    return found


def _file() -> Any:
    """An empty file without a name: in memory where the system has such files."""
    if hasattr(os, "memfd_create"):
        return os.fdopen(os.memfd_create("deltac"), "r+b")
    return tempfile.TemporaryFile()
