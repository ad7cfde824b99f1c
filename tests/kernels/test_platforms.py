"""Machine code for systems that the tests do not run on, made and run here.

Code for Windows is called by Windows' convention, from a function compiled for this system; what it calls
is handed over the same way. Code for macOS on x86 is called as it is. Of code for other processors it is
looked at which names it leaves open.
"""

from __future__ import annotations

import ctypes
import mmap
import platform
import sys
from collections.abc import Iterator

import casadi as ca
import numpy as np
import pytest

from deltac.kernels import Kernel

llvm = pytest.importorskip("llvmlite.binding")
from deltac.kernels import llvm_evaluator as ours  # noqa: E402
from deltac.kernels import native  # noqa: E402
from deltac.kernels.llvm_ir import llvm_ir  # noqa: E402
from deltac.kernels.lowering import LIBRARY, PREFIX  # noqa: E402
from tests.support.slow import repeated  # noqa: E402

pytestmark = [
    pytest.mark.heyoka,
    pytest.mark.skipif(
        (sys.platform, platform.machine()) != ("linux", "x86_64"), reason="runs x86 code from Linux"
    ),
]
AGREE = 1e-10
"""Sums of 700 products, of some 1000 altogether: worst rounding of the sines' angles."""
X = np.random.default_rng(5).normal(size=(12, 64))


def kernel() -> Kernel:
    """Of more variables at a time than fit into a page of the stack, with calls of the C library."""
    x = ca.SX.sym("x", 12)
    values = [x[0]]
    for k in range(700):
        values.append(0.5 * values[-1] * x[k % 12] + ca.cos(1.0 * (k % 7)))
    mixed = sum(a * b for a, b in zip(values, reversed(values)))
    return Kernel({"x": x}, {"y": ca.sin(mixed * x), "z": ca.exp(-ca.fabs(x)) + ca.atan2(mixed, x)})


def expected() -> np.ndarray:
    function = kernel().function
    return np.array(function.map(X.shape[1])(X, np.zeros((0, X.shape[1]))))


def through_windows(addresses: dict[str, int]) -> dict[str, int]:
    """Functions of the C library as Windows' code calls them, and `call` for calling `evaluate`."""
    given = "ptr %x, ptr %y, ptr %p, i64 %s, i64 %n"
    lines = [f"define void @call(ptr %f, {given}) {{\ncall win64cc void %f({given})\nret void\n}}"]
    kinds = {name: ("double", ["double"] * count) for name, count in LIBRARY.items()}
    for name, (kind, takes) in {
        **kinds,
        "malloc": ("ptr", ["i64"]),
        "free": ("void", ["ptr"]),
    }.items():
        a = ", ".join(f"{one} %a{k}" for k, one in enumerate(takes))
        result, back = ("", "ret void") if kind == "void" else ("%r = ", f"ret {kind} %r")
        lines.append(
            f"define win64cc {kind} @{PREFIX}{name}({a}) {{\n"
            f"%f = inttoptr i64 {addresses[PREFIX + name]} to ptr\n{result}call {kind} %f({a})\n{back}\n}}"
        )
    machine = ours._machine()
    module = llvm.parse_assembly("\n".join(lines), context=llvm.create_context())
    module.triple, module.data_layout = machine.triple, str(machine.target_data)
    library = llvm.JITLibraryBuilder().add_object_img(machine.emit_object(module))
    names = ["call", *addresses]
    for name in names:
        library.export_symbol(name)
    kept = library.link(ours._linker(0), "through windows")
    KEPT.append(kept)
    return {name: kept[name] for name in names}


KEPT: list[object] = []


@pytest.fixture
def windows(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Code is made, linked and called as on Windows; yields the address of `call`."""
    found = through_windows(ours._called())
    call = found.pop("call")
    page = mmap.mmap(-1, mmap.PAGESIZE, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC)
    page[:1] = b"\xc3"  # the stack of Linux grows by itself: there is nothing to touch, so return
    found["__chkstk"] = ctypes.addressof(ctypes.c_char.from_buffer(page))
    KEPT.append(page)
    monkeypatch.setenv("DELTAC_EVALUATOR", "llvm")
    monkeypatch.setenv("DELTAC_CACHE", "off")
    monkeypatch.setattr(ours, "_triple", lambda: "x86_64-pc-windows-msvc-elf")
    monkeypatch.setattr(ours, "_called", lambda: found)
    caches = (ours._native, ours._target, ours._linker)
    for one in caches:
        one.cache_clear()
    yield call
    monkeypatch.undo()
    for one in caches:
        one.cache_clear()


@pytest.mark.long
@pytest.mark.parametrize("width", repeated(("1", "4"), "4"))
def test_code_for_windows(windows: int, width: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DELTAC_SIMD", width)
    function = kernel().function
    assert b"__chkstk" in ours._made(function, 4, True)
    made = ours.llvm_evaluator(function)
    pointer, count = ctypes.c_void_p, ctypes.c_int64
    call = ctypes.CFUNCTYPE(None, *[pointer] * 4, count, count)(windows)
    y = np.empty((24, X.shape[1]))
    columns = X.shape[1]
    call(made._code["evaluate"], X.ctypes.data, y.ctypes.data, None, columns, columns)
    np.testing.assert_allclose(y, expected(), rtol=0, atol=AGREE)


def object_code(triple: str, processor: str, width: int) -> bytes:
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    target = llvm.Target.from_triple(triple)
    machine = target.create_target_machine(cpu=processor, opt=1, reloc="pic", codemodel="small")
    text = llvm_ir(kernel().function, width)
    module = llvm.parse_assembly(text, context=llvm.create_context())
    module.triple, module.data_layout = triple, str(machine.target_data)
    return bytes(machine.emit_object(module))


def test_code_for_macos() -> None:
    """Names begin with an underscore there, which the linker of a Mac adds by itself."""
    library = llvm.JITLibraryBuilder()
    library.add_object_img(object_code("x86_64-apple-macosx12", "x86-64", 2))
    for name, address in ours._called().items():
        library.import_symbol(f"_{name}", address)
    code = library.export_symbol("_evaluate").link(ours._linker(0), "macos")
    y = np.empty((24, X.shape[1]))
    evaluate = native._EVALUATE(code["_evaluate"])
    evaluate(X.ctypes.data, y.ctypes.data, None, X.shape[1], X.shape[1])
    np.testing.assert_allclose(y, expected(), rtol=0, atol=AGREE)


@pytest.mark.long
@pytest.mark.parametrize("triple", ["arm64-apple-macosx12", "aarch64-unknown-linux-gnu"])
def test_code_for_other_processors_is_linked(triple: str) -> None:
    """Nothing is left open but what is handed over: linked here, not run."""
    library = llvm.JITLibraryBuilder()
    library.add_object_img(object_code(triple, "generic", 2))
    before = "_" if "apple" in triple else ""
    for name, address in ours._called().items():
        library.import_symbol(before + name, address)
    code = library.export_symbol(f"{before}evaluate").link(ours._linker(0), triple)
    assert code[f"{before}evaluate"]
