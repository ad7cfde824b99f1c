"""Kernels as machine code: heyoka expressions, compiled by LLVM, SIMD over the batch, all cores."""

from __future__ import annotations

import ctypes
import sys
from itertools import count
from typing import Any

import heyoka as hy

from deltac.arrays import Array
from deltac.interrupts import waiting
from deltac.kernels.cache import compiled, prepare_heyoka
from deltac.kernels.lowering import to_heyoka
from deltac.kernels.simd import simd_width

TRIM = 100
"""Kernels between two times that freed memory is given back: LLVM leaves it in many small pieces."""

_made = count(1)


def _give_back() -> None:
    """To the operating system, where the C library is glibc; others do it by themselves."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(0)


class HeyokaEvaluator:
    """`f(x, p) -> y`, compiled, or read from the disk cache.

    heyoka cuts large batches into blocks of whole SIMD vectors and spreads them over threads. The
    columns left over at the end (`width` is the size of a vector) it puts through scalar code.
    """

    def __init__(self, function: Any, inline: bool = False, batches: bool = True) -> None:
        """Compile a function of dense columns (x, p); scalar code alone unless it is for batches."""
        self.width = simd_width() if batches else 1
        source = (prepare_heyoka(), self.width, inline, function.serialize())
        self._compiled: Any = compiled(
            repr(source), lambda: waiting(lambda: self._made(function, inline))
        )
        # heyoka counts parameters up to the last one that occurs, and takes no more than that.
        self._n_parameters: int = self._compiled.nparams
        self._uses_all = self._n_parameters == function.nnz_in(1)

    def _made(self, function: Any, inline: bool) -> Any:
        variables = [hy.expression(f"x{i}") for i in range(function.nnz_in(0))]
        parameters = [hy.par[i] for i in range(function.nnz_in(1))]
        (outputs,) = to_heyoka(function, [variables, parameters], inline)
        if next(_made) % TRIM == 0:
            _give_back()
        return hy.cfunc(
            outputs,
            vars=variables,
            batch_size=self.width,
            force_avx512=self.width > hy.recommended_simd_size(),
        )

    def single(self, x: Array, out: Array, parameters: Array | None) -> None:
        """One state, or (heyoka goes by the number of dimensions) many."""
        if parameters is None or self._n_parameters == 0:
            self._compiled(x, outputs=out)
        elif self._uses_all:
            self._compiled(x, outputs=out, pars=parameters)
        else:
            self._compiled(x, outputs=out, pars=parameters[: self._n_parameters])

    batch = single
