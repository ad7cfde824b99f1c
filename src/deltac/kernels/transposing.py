"""Rows into columns: the layout of logs, a row a sample, into that of kernels, a row a quantity, and back.

NumPy copies a transposed array number by number. Here squares of SIMD vectors are turned over in registers,
so that reading the log is what takes the time.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

from deltac.arrays import Array
from deltac.kernels.evaluators import evaluator_name
from deltac.kernels.native import Call, NativeCall
from deltac.kernels.simd import AVX512_WIDTH, simd_width


def transposing(source: Array, target: Array, *, moving: bool = False) -> Call:
    """A call that writes ``target[:] = source.T``, of what lies in `source` then.

    Of a `moving` source (T, n) it takes ``source[first : first + B].T``, where B is the length of the rows of
    `target` (n, B); `first` is not checked. Rows of both may be strided.
    """
    n, count = target.shape
    assert source.shape[1] == n, "each column of the source is a row of the target"
    assert moving or len(source) == count, "as many rows as columns"

    def plain(first: int) -> None:
        start = first * moving
        target[:] = source[start : start + count].T

    width, each = simd_width(), target.itemsize
    strided = all(a.shape[1] == 1 or a.strides[1] == each for a in (source, target))
    numbers = source.dtype == target.dtype == np.float64 and source.strides[0] >= 0
    if not (width > 1 and strided and numbers and target.size and evaluator_name() == "llvm"):
        return plain
    try:
        code = _compiled(width, min(count, width), min(n, width))
    except (ImportError, OSError, RuntimeError):
        return plain  # LLVM does not fit the platform, which kernels tell
    over = source.strides[0]
    arguments = (source.ctypes.data, over // each, target.ctypes.data, target.strides[0] // each)
    references = (code, source, target)
    return NativeCall(code["transpose"], (*arguments, count, n), references, over * moving)


@cache
def _compiled(width: int, rows: int, columns: int) -> Any:
    """The native function that goes by squares of so many `rows` and `columns`, at most `width`."""
    from deltac.kernels.llvm_evaluator import llvm_function

    return llvm_function("transpose", _text(width, rows, columns))


LINE = 8 * AVX512_WIDTH
"""Bytes of a line of the processor's cache, which is as wide as the widest vector of doubles."""


def aligned(*shape: int) -> Array:
    """Zeros that begin where a line of the cache does: vectors of that width then lie in one, not in two."""
    size, each = math.prod(shape), np.dtype(np.float64).itemsize
    room = np.zeros(size + LINE // each)
    start = -room.ctypes.data % LINE // each
    return room[start : start + size].reshape(shape)


def _text(width: int, rows: int, columns: int) -> str:
    """``transpose(from, across, to, along, rows, columns)``: to[c, r] = from[r, c], in LLVM's language.

    An array is gone through in squares of `rows` and `columns`, at most a vector; the last square of a row or
    a column of them begins so that it ends where the array does.
    """
    vector, whole = f"<{width} x double>", range(width)
    lines = [f"%v0.{k} = bitcast {vector} zeroinitializer to {vector}" for k in range(rows, width)]
    for k in range(rows):
        lines += [
            f"%r{k} = add i64 %row, {k}",
            f"%s{k} = mul i64 %r{k}, %across",
            f"%t{k} = add i64 %s{k}, %column",
            f"%p{k} = getelementptr double, ptr %from, i64 %t{k}",
            f"%v0.{k} = call {vector} @llvm.masked.load.v{width}f64.p0(ptr %p{k}, i32 8, "
            f"{_mask(columns, width)}, {vector} zeroinitializer)"
            if columns < width
            else f"%v0.{k} = load {vector}, ptr %p{k}, align 8",
        ]
    distance, level = 1, 0
    while distance < width:  # lanes and rows trade places, a bit of their number at a time
        for k in whole:
            a, b = k & ~distance, k | distance
            lanes = [
                ((lane & ~distance) + width * bool(lane & distance))
                if k == a
                else ((lane | distance) + width * bool(lane & distance))
                for lane in whole
            ]
            mask = ", ".join(f"i32 {lane}" for lane in lanes)
            pair = f"{vector} %v{level}.{a}, {vector} %v{level}.{b}"
            lines.append(f"%v{level + 1}.{k} = shufflevector {pair}, <{width} x i32> <{mask}>")
        distance, level = 2 * distance, level + 1
    for k in range(columns):
        lines += [
            f"%c{k} = add i64 %column, {k}",
            f"%d{k} = mul i64 %c{k}, %along",
            f"%e{k} = add i64 %d{k}, %row",
            f"%q{k} = getelementptr double, ptr %to, i64 %e{k}",
            f"call void @llvm.masked.store.v{width}f64.p0({vector} %v{level}.{k}, ptr %q{k}, i32 8, "
            f"{_mask(rows, width)})"
            if rows < width
            else f"store {vector} %v{level}.{k}, ptr %q{k}, align 8",
        ]
    square = "\n".join(lines)
    flags = f"<{width} x i1>"
    return f"""declare {vector} @llvm.masked.load.v{width}f64.p0(ptr, i32, {flags}, {vector})
declare void @llvm.masked.store.v{width}f64.p0({vector}, ptr, i32, {flags})
define void @transpose(ptr %from, i64 %across, ptr %to, i64 %along, i64 %rows, i64 %columns) {{
entry:
%lastrow = sub i64 %rows, {rows}
%lastcolumn = sub i64 %columns, {columns}
br label %down
down:
%i = phi i64 [0, %entry], [%inext, %below]
%ibeyond = icmp sgt i64 %i, %lastrow
%row = select i1 %ibeyond, i64 %lastrow, i64 %i
br label %right
right:
%j = phi i64 [0, %down], [%jnext, %right]
%jbeyond = icmp sgt i64 %j, %lastcolumn
%column = select i1 %jbeyond, i64 %lastcolumn, i64 %j
{square}
%jnext = add i64 %j, {columns}
%jmore = icmp slt i64 %jnext, %columns
br i1 %jmore, label %right, label %below
below:
%inext = add i64 %i, {rows}
%imore = icmp slt i64 %inext, %rows
br i1 %imore, label %down, label %done
done:
ret void
}}"""


def _mask(count: int, width: int) -> str:
    """The first lanes of a vector."""
    lanes = ", ".join(f"i1 {int(k < count)}" for k in range(width))
    return f"<{width} x i1> <{lanes}>"
