"""Kernels as machine code, by LLVM: SIMD over the batch, object code kept on disk."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Sequence
from functools import cache, lru_cache
from itertools import count
from typing import Any

import llvmlite
import llvmlite.binding as llvm

from deltac.calls.interrupts import waiting
from deltac.kernels.cache import compiled, our_code
from deltac.kernels.lowering import LIBRARY, PREFIX, simplified
from deltac.kernels.native import NATIVE_FUNCTIONS, NativeEvaluator
from deltac.kernels.simd import AVX512_WIDTH, simd_width

OPTIMISATION = 1
"""LLVM's level for making machine code: at 2 the code is not faster, at 0 it takes 1.4 times as long."""


def llvm_evaluator(function: Any, batches: bool = True) -> NativeEvaluator:
    """A function of dense columns (x, p), for many states at a time or for one; compiled, or cached."""
    width = simd_width() if batches else 1
    source = (our_code(), _target(), width, batches, function.serialize())

    def make() -> bytes:
        simple = simplified(function)
        return waiting(lambda: _made(simple, width, batches))

    code = compiled(repr(source), make)
    return NativeEvaluator(function, _loaded(code, NATIVE_FUNCTIONS), width)


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
        codemodel="large" if _windows() else "small",
    )


def _triple() -> str:
    """Processor, system and format of the object code, as LLVM writes them.

    On Windows the format is Linux's. LLVM's linkers in memory fail at constants in Windows' own (COFF); the
    calling convention, which matters, is Windows' by the rest of the name.
    """
    triple: str = llvm.get_process_triple()
    return f"{triple}-elf" if os.name == "nt" else triple


def _windows() -> bool:
    """Whether code is made for Windows.

    There llvmlite has the older linker only (JITLink is refused). It may place constants too far
    from code for what the small code model allows, so the large one is taken: batches take 1.3 times as long.
    """
    return "windows" in _triple()


@cache
def _native() -> Any:
    """LLVM's target, prepared once in a process."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.Target.from_triple(_triple())


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
    machine = (_triple(), llvm.get_host_cpu_name(), str(AVX512_WIDTH))
    features = llvm.get_host_cpu_features().flatten()
    version = f"llvmlite {llvmlite.__version__}, LLVM {llvm.llvm_version_info}"
    return repr((version, *machine, features))


def _made(function: Any, width: int, strided: bool) -> bytes:
    """The object code of a function."""
    from deltac.kernels.llvm_ir import llvm_ir

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
        library.import_symbol(name, address)
    for name in functions:
        library.export_symbol(name)
    number = next(_loads)
    return library.link(_linker(number // LOADS), f"kernel {number}")


@lru_cache(maxsize=1)
def _linker(generation: int) -> Any:
    """LLVM's linker in memory. It places code and constants of a kernel side by side; these keep it alive."""
    return llvm.create_lljit_compiler(_machine(), use_jit_link=not _windows())


@cache
def _called() -> dict[str, int]:
    """Addresses of the C library's functions that code may call, by the names that it calls them."""
    library = _c_library()
    addresses = {PREFIX + name: _address(library, name) for name in (*LIBRARY, "malloc", "free")}
    if os.name == "nt":  # called by functions whose variables take more than a page of the stack
        addresses["__chkstk"] = _address(ctypes.CDLL("ntdll"), "__chkstk")
    return addresses


def _address(library: Any, name: str) -> int:
    return int(ctypes.cast(getattr(library, name), ctypes.c_void_p).value or 0)
