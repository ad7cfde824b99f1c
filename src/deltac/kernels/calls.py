"""Calls of native code on arrays that stay, many of them by one call from Python.

A pass over a long log calls the same few functions for every block of rows. A call from Python takes about a
microsecond, as long as some of these functions take: so machine code goes through a list of them.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from deltac.kernels.evaluators import evaluator_name
from deltac.kernels.native import Call, NativeCall

ARGUMENTS = 6
"""Of a native function at most."""


def in_turn(calls: Sequence[Call]) -> Call:
    """All of them one after the other, as one call: of native code where all of them are."""
    native = [call for call in calls if isinstance(call, NativeCall)]
    if len(native) == len(calls) and evaluator_name() == "llvm" and (code := _walk()) is not None:
        table = np.zeros((len(native), ARGUMENTS + 2), dtype=np.int64)
        for row, call in zip(table, native):
            row[0], row[1] = call.address, call.step
            row[2 : 2 + len(call.arguments)] = call.arguments
        walk = ctypes.CFUNCTYPE(None, *(ctypes.c_int64,) * 3)(code["walk"])
        start, count, references = table.ctypes.data, len(table), (table, code, native)

        def at_once(first: int) -> object:
            walk(start, count, first)
            return references

        return at_once

    def one_by_one(first: int) -> None:
        for call in calls:
            call(first)

    return one_by_one


@cache
def _walk() -> Any:
    """The native code; None where LLVM does not fit the platform, which kernels tell."""
    try:
        from deltac.kernels.llvm_evaluator import llvm_function

        return llvm_function("walk", _TEXT)
    except (ImportError, OSError, RuntimeError):
        return None


_GIVEN = range(ARGUMENTS)
_TEXT = f"""define void @walk(ptr %table, i64 %count, i64 %first) {{
entry:
%any = icmp sgt i64 %count, 0
br i1 %any, label %next, label %done
next:
%k = phi i64 [0, %entry], [%more, %next]
%row = getelementptr [{ARGUMENTS + 2} x i64], ptr %table, i64 %k
%function = load ptr, ptr %row
%pstep = getelementptr i64, ptr %row, i64 1
%step = load i64, ptr %pstep
{"".join(f"%p{k} = getelementptr i64, ptr %row, i64 {k + 2}{chr(10)}" for k in _GIVEN)}
{"".join(f"%a{k} = load i64, ptr %p{k}{chr(10)}" for k in _GIVEN)}
%further = mul i64 %step, %first
%start = add i64 %a0, %further
call void %function(i64 %start, {", ".join(f"i64 %a{k}" for k in _GIVEN[1:])})
%more = add i64 %k, 1
%again = icmp slt i64 %more, %count
br i1 %again, label %next, label %done
done:
ret void
}}"""
"""``walk(table, count, first)``: rows are a function's address, the step, and `ARGUMENTS` numbers.

A function that takes fewer leaves the rest unread, as the calling conventions of C allow.
"""
