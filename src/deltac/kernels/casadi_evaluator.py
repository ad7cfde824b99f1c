"""Kernels on CasADi's own virtual machine: slower by far, and at home on every platform."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from threading import Lock
from typing import Any

import numpy as np

from deltac.arrays import Array
from deltac.errors import InputError

_COLUMNS = 256
"""Columns per call: enough to hide the cost of a call, few enough for the processor's cache."""


def on_arrays(
    function: Any, inputs: Sequence[Array], outputs: Sequence[Array]
) -> tuple[object, Callable[[], object]]:
    """What has to be kept, and a call that reads the arrays `given` and writes those `made`.

    One for each input and output, contiguous float64, of the right sizes. Much faster than calls
    with arrays, which CasADi copies number by number.
    """
    buffer, evaluate = function.buffer()
    for place, arrays in ((buffer.set_arg, inputs), (buffer.set_res, outputs)):
        for k, array in enumerate(arrays):
            if array.size:
                place(k, array.data)
    return (buffer, inputs, outputs), evaluate


class CasadiEvaluator:
    """`f(x, p) -> y`, interpreted by calls on fixed buffers (hence the lock), on one core.

    CasADi's `map` over threads was no faster than this.
    """

    width = 1

    def __init__(self, function: Any) -> None:
        """Of a function of dense columns (x, p)."""
        self._function = function
        self._lock = Lock()
        self._buffer, self._evaluate = function.buffer()
        self._bound: tuple[Array | None, Array | None, Array | None] = (None, None, None)
        self._column = _Block(function, 1)
        self._block: _Block | None = None  # built for the first large batch

    def single(self, x: Array, out: Array, parameters: Array | None) -> None:
        """One state; the arrays of the last call stay bound, so that using them again is fast."""
        with self._lock:
            bound = self._bound
            if not (x is bound[0] and out is bound[1] and parameters is bound[2]):
                self._bind(x, out, parameters)
            self._evaluate()

    def bound(self, x: Array, out: Array, parameters: Array | None) -> Callable[[], object]:
        """`single` of these arrays, without arguments."""
        with self._lock:
            self._bind(x, out, parameters)
        return partial(self.single, x, out, parameters)

    def batch(self, x: Array, out: Array, parameters: Array | None) -> None:
        """Many states, block by block."""
        n = x.shape[1]
        whole = n - n % _COLUMNS
        with self._lock:
            if whole and self._block is None:
                self._block = _Block(self._function.map(_COLUMNS), _COLUMNS)
            for start in range(0, whole, _COLUMNS):
                assert self._block is not None
                self._block.run(slice(start, start + _COLUMNS), x, out, parameters)
            for start in range(whole, n):
                self._column.run(slice(start, start + 1), x, out, parameters)

    def bound_batch(self, x: Array, out: Array, parameters: Array | None) -> Callable[[], None]:
        """`batch` of these arrays, without arguments."""
        return partial(self.batch, x, out, parameters)

    def _bind(self, x: Array, out: Array, parameters: Array | None) -> None:
        """Point the buffers at these arrays; CasADi would read past the end of short ones."""
        f = self._function
        sizes = (f.nnz_in(0), f.nnz_out(0), f.nnz_in(1))
        for array, size in zip((x, out, parameters), sizes, strict=True):
            if array is None:
                continue
            if array.shape != (size,) or array.dtype != np.float64 or not array.flags.c_contiguous:
                raise InputError(
                    f"{f.name()}: an array of shape {array.shape} and type {array.dtype}, "
                    f"expected contiguous float64 of shape ({size},)"
                )
        self._bound = (None, None, None)
        self._buffer.set_arg(0, x.data)
        if parameters is not None:
            self._buffer.set_arg(1, parameters.data)
        self._buffer.set_res(0, out.data)
        self._bound = (x, out, parameters)  # keeps the memory alive


class _Block:
    """A function of a block of columns, with the memory it reads and writes (transposed)."""

    def __init__(self, function: Any, columns: int) -> None:
        self._x = np.zeros((columns, function.size1_in(0)))
        self._parameters = np.zeros((columns, function.size1_in(1)))
        self._y = np.zeros((columns, function.size1_out(0)))
        inputs = (self._x, self._parameters)
        self._kept, self._evaluate = on_arrays(function, inputs, (self._y,))

    def run(self, columns: slice, x: Array, out: Array, parameters: Array | None) -> None:
        self._x[...] = x[:, columns].T
        if parameters is not None:
            self._parameters[...] = parameters[:, columns].T
        self._evaluate()
        out[:, columns] = self._y.T


class CasadiLoop:
    """`x ← f(x, p)`, over and over: CasADi's `mapaccum`, so many rows to a call."""

    def __init__(self, function: Any) -> None:
        """Of a function of dense columns (x, p) to a column of the size of x."""
        self._function = function
        self._accumulated: dict[int, Any] = {}

    def iterate(self, rows: Array, parameters: Array) -> None:
        """As `Loop`'s."""
        count, period = len(rows) - 1, len(parameters)
        block = -(-_COLUMNS // period) * period
        whole = count - count % block
        # Buffers are a run's own: threads may iterate the same function.
        if whole:
            accumulated = self._accumulated.get(block)
            if accumulated is None:
                accumulated = self._accumulated[block] = self._function.mapaccum(block)
            buffer, evaluate = accumulated.buffer()
            p = np.tile(parameters, (block // period, 1))
            for k in range(0, whole, block):
                _take(buffer, evaluate, rows[k], p, rows[k + 1 : k + 1 + block])
        buffer, evaluate = self._function.buffer()
        for k in range(whole, count):
            _take(buffer, evaluate, rows[k], parameters[k % period], rows[k + 1])


def _take(buffer: Any, evaluate: Any, x: Array, p: Array, out: Array) -> None:
    """One call on contiguous arrays."""
    buffer.set_arg(0, x.data)
    if p.size:
        buffer.set_arg(1, p.data)
    buffer.set_res(0, out.data)
    evaluate()
