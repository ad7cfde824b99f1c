"""Kernels as C, written by CasADi and compiled by the C compiler of the machine: `DELTAC_EVALUATOR=c`.

For machines without llvmlite. Batches go one state after the other: only LLVM's code is SIMD.
"""

from __future__ import annotations

import ctypes
import os
import shlex
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import casadi

from deltac.calls.interrupts import waiting
from deltac.errors import PackageError
from deltac.kernels.cache import compiled, our_code
from deltac.kernels.lowering import simplified
from deltac.kernels.native import FUNCTIONS, NativeEvaluator

OPTIONS = "-O2 -march=native -fPIC -shared"
"""At -O1 the code of a chain of 30 joints takes 1.2 times as long to run; at -O3 it is as fast as at -O2."""

LOOPS = """
typedef const double *in;

CASADI_SYMBOL_EXPORT void evaluate(in x, double *y, in p, long long stride, long long n) {
  static const int inputs = %(inputs)d, outputs = %(outputs)d, parameters = %(parameters)d;
  double a[%(inputs)d + 1], b[%(outputs)d + 1], c[%(parameters)d + 1];
  for (long long k = 0; k < n; ++k) {
    for (int j = 0; j < inputs; ++j) a[j] = x[j * stride + k];
    for (int j = 0; j < parameters; ++j) c[j] = p[j * stride + k];
    in given[2] = {a, c};
    double *found[1] = {b};
    %(name)s(given, found, 0, 0, 0);
    for (int j = 0; j < outputs; ++j) y[j * stride + k] = b[j];
  }
}

CASADI_SYMBOL_EXPORT void iterate(double *rows, in p, long long count, long long period) {
  for (long long k = 0; k < count; ++k) {
    in given[2] = {rows + k * %(inputs)d, p + k %% period * %(parameters)d};
    double *found[1] = {rows + (k + 1) * %(inputs)d};
    %(name)s(given, found, 0, 0, 0);
  }
}

CASADI_SYMBOL_EXPORT void call(double **arrays) {
  in given[2] = {arrays[0], arrays[2]};
  %(name)s(given, arrays + 1, 0, 0, 0);
}
"""


def c_evaluator(function: Any) -> NativeEvaluator:
    """A function of dense columns (x, p), compiled by the C compiler, or read from the disk cache.

    Raises PackageError where there is no C compiler, or it fails.
    """
    source = (our_code(), _compiler(), OPTIONS, function.serialize())

    def make() -> bytes:
        simple = simplified(function)
        return waiting(lambda: _made(simple))

    code = compiled(repr(source), make)
    return NativeEvaluator(function, _loaded(code), 1)


def _made(function: Any) -> bytes:
    """The shared library of a function."""
    generator = casadi.CodeGenerator("kernel")
    generator.add(function)
    sizes = {
        "name": function.name(),
        "inputs": function.nnz_in(0),
        "outputs": function.nnz_out(0),
        "parameters": function.nnz_in(1),
    }
    with tempfile.TemporaryDirectory() as folder:
        source, library = Path(folder, "kernel.c"), Path(folder, "kernel.so")
        source.write_text(generator.dump() + LOOPS % sizes, encoding="utf-8")
        command = [*_command(), *OPTIONS.split(), str(source), "-o", str(library), "-lm"]
        done = subprocess.run(command, capture_output=True, text=True, errors="replace")
        if done.returncode or not library.exists():
            raise PackageError(
                f"DELTAC_EVALUATOR='c': {shlex.join(command[:-4])} failed: {done.stderr.strip():.500}"
            )
        return library.read_bytes()


def _loaded(code: bytes) -> dict[str, int]:
    """A library in memory: symbols -> addresses. It stays until the process ends."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "kernel.so")
        file.write_bytes(code)
        library = ctypes.CDLL(str(file))
    return {
        name: int(ctypes.cast(getattr(library, name), ctypes.c_void_p).value or 0)
        for name in FUNCTIONS
    }


def _command() -> list[str]:
    """The C compiler: `CC` if set, else cc."""
    return shlex.split(os.environ.get("CC", "")) or ["cc"]


def _compiler() -> str:
    """Which C compiler it is, in its own words."""
    return _version(tuple(_command()))


@cache
def _version(command: tuple[str, ...]) -> str:
    if shutil.which(command[0]) is None:
        raise PackageError(
            f"DELTAC_EVALUATOR='c', and there is no C compiler {command[0]!r}; install one, name it in CC, "
            "or unset the variable"
        )
    done = subprocess.run([*command, "--version"], capture_output=True, text=True, errors="replace")
    return " ".join([*command, done.stdout])
