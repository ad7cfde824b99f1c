"""Machine code as an evaluator: three functions at known addresses."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

from deltac.arrays import Array
from deltac.errors import InputError

NATIVE_FUNCTIONS = ("evaluate", "iterate", "call")
"""What code has to hold.

``evaluate(x, y, p, stride, n)``: n columns, rows `stride` numbers apart. Of code for one state:
``iterate(rows, p, count, period)``: row k + 1 of row k, with the parameters of row k modulo period;
``call(arrays)``: one state, x, y and p being the three pointers that lie there.
"""

_POINTER, _COUNT = ctypes.c_void_p, ctypes.c_int64
_EVALUATE = ctypes.CFUNCTYPE(None, _POINTER, _POINTER, _POINTER, _COUNT, _COUNT)
_ITERATE = ctypes.CFUNCTYPE(None, _POINTER, _POINTER, _COUNT, _COUNT)
_CALL = ctypes.PYFUNCTYPE(None, _POINTER)  # keeps the GIL: giving it up takes longer than the call


class Code(Protocol):
    """Addresses of `NATIVE_FUNCTIONS` by name; what lies there stays as long as this object."""

    def __getitem__(self, name: str, /) -> int:
        """The address of a function."""


class NativeEvaluator:
    """`f(x, p) -> y` by machine code, for `width` states at a time."""

    def __init__(self, function: Any, code: Code, width: int) -> None:
        """Of a function of dense columns (x, p), compiled to this code."""
        self.width = width
        self._sizes = (function.nnz_in(0), function.nnz_out(0), function.nnz_in(1))
        self._code = code
        self._evaluate = _EVALUATE(code["evaluate"])
        self._iterate = _ITERATE(code["iterate"])
        self._bound: tuple[Any, ...] = (None, None, None, ())

    def single(self, x: Array, out: Array, parameters: Array | None) -> None:
        """One state; the arrays of the last call are known, so that using them again is fast."""
        bound = self._bound  # read once: another thread may call too
        if not (x is bound[0] and out is bound[1] and parameters is bound[2]):
            bound = self._bind(x, out, parameters)
        self._evaluate(*bound[3])

    def _bind(self, x: Array, out: Array, parameters: Array | None) -> tuple[Any, ...]:
        self._bound = bound = (x, out, parameters, (*self._places(x, out, parameters), 1, 1))
        return bound

    def bound(self, x: Array, out: Array, parameters: Array | None) -> Callable[[], object]:
        """`single` of these arrays, without arguments."""
        assert self.width == 1, "a vector of states would be written"
        pointers: Any = (_POINTER * 3)(*self._places(x, out, parameters))
        pointers.kept = (self, x, out, parameters)
        return partial(_CALL(self._code["call"]), pointers)

    def _places(self, *arrays: Array | None) -> list[int]:
        """Where the arrays lie; 0 for one that there is not."""
        places = []
        for array, size in zip(arrays, self._sizes, strict=True):
            if array is None:
                places.append(0)
                continue
            if array.shape != (size,) or array.dtype != float or not array.flags.c_contiguous:
                raise InputError(
                    f"kernel: an array of shape {array.shape} and type {array.dtype}, "
                    f"expected contiguous float64 of shape ({size},)"
                )
            places.append(array.ctypes.data)
        return places

    def batch(self, x: Array, out: Array, parameters: Array | None) -> None:
        """Many states; columns beyond the last whole vector are left out."""
        columns = x.shape[1]
        if whole := columns - columns % self.width:
            p = 0 if parameters is None else parameters.ctypes.data
            self._evaluate(x.ctypes.data, out.ctypes.data, p, columns, whole)

    def bound_batch(self, x: Array, out: Array, parameters: Array | None) -> Callable[[], None]:
        """`batch` of these arrays, without arguments; it keeps them."""
        arrays = [a for a in (x, out, parameters) if a is not None]
        places = [0 if a is None else a.ctypes.data for a in (x, out, parameters)]
        stride = max(a.strides[0] for a in arrays) // out.itemsize
        arguments = (*places, stride, out.shape[1] - out.shape[1] % self.width)

        def call(_kept: object = arrays) -> None:
            self._evaluate(*arguments)

        return call

    def iterate(self, rows: Array, parameters: Array) -> None:
        """rows[k + 1] = f(rows[k], parameters[k modulo their number]), from the first row on."""
        assert self.width == 1 and self._sizes[0] == self._sizes[1], "f is to make its own input"
        count = len(rows) - 1
        if count > 0:
            self._iterate(rows.ctypes.data, parameters.ctypes.data, count, len(parameters))
