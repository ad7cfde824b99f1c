"""Kernels as machine code, by LLVM: SIMD over the batch, object code kept on disk."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Callable, Sequence
from functools import cache, lru_cache, partial
from itertools import count
from typing import Any

import llvmlite
import llvmlite.binding as llvm

from deltac.arrays import Array
from deltac.errors import InputError
from deltac.interrupts import waiting
from deltac.kernels.cache import compiled, our_code
from deltac.kernels.llvm_ir import LIBRARY, PREFIX, llvm_ir
from deltac.kernels.simd import AVX512_WIDTH, simd_width

OPTIMISATION = 1
"""LLVM's level for making machine code: at 2 the code is not faster, at 0 it takes 1.4 times as long."""

_FUNCTIONS = ("evaluate", "iterate", "call")
_POINTER, _COUNT = ctypes.c_void_p, ctypes.c_int64
_EVALUATE = ctypes.CFUNCTYPE(None, _POINTER, _POINTER, _POINTER, _COUNT, _COUNT)
_ITERATE = ctypes.CFUNCTYPE(None, _POINTER, _POINTER, _COUNT, _COUNT)
_CALL = ctypes.PYFUNCTYPE(None, _POINTER)  # keeps the GIL: giving it up takes longer than the call


class LlvmEvaluator:
    """`f(x, p) -> y`, compiled, or read from the disk cache."""

    def __init__(self, function: Any, batches: bool = True) -> None:
        """Compile a function of dense columns (x, p): for many states at a time, or for one."""
        self.width = simd_width() if batches else 1
        self._sizes = (function.nnz_in(0), function.nnz_out(0), function.nnz_in(1))
        source = (our_code(), _target(), self.width, batches, function.serialize())
        code = compiled(repr(source), lambda: waiting(lambda: _made(function, self.width, batches)))
        self._code = _loaded(code, _FUNCTIONS)
        self._evaluate = _EVALUATE(self._code["evaluate"])
        self._iterate = _ITERATE(self._code["iterate"])
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

    def bound_batch(self, x: Array, out: Array, parameters: Array | None) -> Callable[[], object]:
        """`batch` of these arrays, without arguments."""
        kept = (self, x, out, parameters)  # as long as the function that is handed out
        columns = x.shape[1]
        p = 0 if parameters is None else parameters.ctypes.data
        arguments = (x.ctypes.data, out.ctypes.data, p, columns, columns - columns % self.width)
        evaluate = self._evaluate

        def call() -> object:
            if arguments[-1]:
                evaluate(*arguments)
            return kept

        return call

    def iterate(self, rows: Array, parameters: Array) -> None:
        """rows[k + 1] = f(rows[k], parameters[k modulo their number]), from the first row on."""
        assert self.width == 1 and self._sizes[0] == self._sizes[1], "f is to make its own input"
        count = len(rows) - 1
        if count > 0:
            self._iterate(rows.ctypes.data, parameters.ctypes.data, count, len(parameters))


def _machine() -> Any:
    """The processor that this runs on, for LLVM."""
    features = llvm.get_host_cpu_features()
    if features.get(
        "avx512f"
    ):  # LLVM would halve our vectors, as suits the first of these processors
        features["prefer-256-bit"] = False
    return _native().create_target_machine(
        cpu=llvm.get_host_cpu_name(),
        features=features.flatten(),
        opt=OPTIMISATION,
        reloc="pic",
        codemodel="small",
    )


@cache
def _native() -> Any:
    """LLVM's target, prepared once in a process."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.Target.from_triple(llvm.get_process_triple())


def _c_library() -> Any:
    """The C library with its elementary functions."""
    if os.name == "nt":
        return ctypes.CDLL("ucrtbase")
    if sys.platform == "linux":  # glibc keeps them in a library of their own
        try:
            return ctypes.CDLL("libm.so.6")
        except OSError:
            pass
    return ctypes.CDLL(None)


@cache
def _target() -> str:
    """What decides, beside the instructions, what is compiled."""
    machine = (llvm.get_process_triple(), llvm.get_host_cpu_name(), str(AVX512_WIDTH))
    features = llvm.get_host_cpu_features().flatten()
    version = f"llvmlite {llvmlite.__version__}, LLVM {llvm.llvm_version_info}"
    return repr((version, *machine, features))


def native(name: str, text: str) -> int:
    """The address of a function written in LLVM's language; it stays for good."""
    code = _loaded(compiled(repr((_target(), text)), lambda: _assembled(text)), (name,))
    _kept.append(code)
    return int(code[name])


_kept: list[Any] = []


def _made(function: Any, width: int, strided: bool) -> bytes:
    """The object code of a function."""
    return _assembled(llvm_ir(function, width, strided))


def _assembled(text: str) -> bytes:
    """The object code of a module."""
    machine = _machine()
    module = llvm.parse_assembly(text, context=llvm.create_context())
    module.triple = machine.triple
    module.data_layout = str(machine.target_data)
    return bytes(machine.emit_object(module))


_loads = count()

LOADS = 64
"""Kernels that one linker loads. It keeps 9 kB of each, even of those that are gone, as long as it lives."""


def _loaded(code: bytes, functions: Sequence[str]) -> Any:
    """Object code in memory, ready to run: symbols -> addresses. It stays as long as this object."""
    library = llvm.JITLibraryBuilder().add_object_img(code)
    for name, address in _called().items():
        library.import_symbol(PREFIX + name, address)
    for name in functions:
        library.export_symbol(name)
    number = next(_loads)
    return library.link(_linker(number // LOADS), f"kernel {number}")


@lru_cache(maxsize=1)
def _linker(generation: int) -> Any:
    """LLVM's linker in memory. It places code and constants of a kernel side by side; these keep it alive."""
    return llvm.create_lljit_compiler(_machine(), use_jit_link=True)


@cache
def _called() -> dict[str, int]:
    """Addresses of the C library's functions that code may call."""
    library = _c_library()
    names = (*LIBRARY, "malloc", "free")
    return {name: int(ctypes.cast(getattr(library, name), _POINTER).value or 0) for name in names}
