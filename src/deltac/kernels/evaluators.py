"""What an evaluator is, and which one compiles a kernel."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any, Protocol

from deltac.arrays import Array
from deltac.errors import PackageError, UnknownName, closest, warn_user
from deltac.kernels.lowering import simplified

if TYPE_CHECKING:
    from deltac.kernels.native import NativeEvaluator

EVALUATORS = ("llvm", "casadi")


class Evaluator(Protocol):
    """A function `y = f(x, p)` of columns, ready to run; arrays are contiguous float64."""

    @property
    def width(self) -> int:
        """The columns of a batch beyond the last multiple of this are left out, or differ in rounding."""

    def single(self, x: Array, out: Array, parameters: Array | None) -> None:
        """One state: x `(n_in,)`, out `(n_out,)`, parameters `(n_par,)`, None if there are none."""

    def bound(self, x: Array, out: Array, parameters: Array | None) -> Callable[[], object]:
        """`single` of these arrays, without arguments; it keeps them."""

    def batch(self, x: Array, out: Array, parameters: Array | None) -> None:
        """Many states: x `(n_in, B)`, out `(n_out, B)`, parameters `(n_par, B)`."""

    def bound_batch(self, x: Array, out: Array, parameters: Array | None) -> Callable[[], None]:
        """`batch` of these arrays, without arguments; it keeps them.

        Rows are contiguous, and as far apart in all of them; no column is to be left out.
        """


class NativeLoop(Protocol):
    """A function `x ← f(x, p)`, ready to be run over and over in native code."""

    def iterate(self, rows: Array, parameters: Array) -> None:
        """Write rows 1, 2, … of `(count + 1, n)`: rows[k + 1] = f(rows[k], parameters[k % period]).

        `parameters` is `(period, n_par)`; both are contiguous float64, and count is one at least.
        """


def evaluator_name() -> str:
    """The evaluator in use: `DELTAC_EVALUATOR` if set, else llvm where llvmlite is installed, else casadi.

    Raises:
        InputError: an unknown name, or llvm is asked for and llvmlite is not installed.
    """
    forced = os.environ.get("DELTAC_EVALUATOR", "").strip().lower()
    if forced and forced not in EVALUATORS:
        raise UnknownName(f"DELTAC_EVALUATOR={forced!r}{closest(forced, EVALUATORS)}")
    installed = importlib.util.find_spec("llvmlite") is not None
    if forced == "llvm" and not installed:
        raise PackageError(
            "DELTAC_EVALUATOR='llvm', and llvmlite is not installed; "
            "install it, or unset the variable to use casadi"
        )
    return forced or ("llvm" if installed else "casadi")


class EvaluatorWarning(UserWarning):
    """Kernels are interpreted, for want of a compiler that was not declined."""


def compile_function(function: Any, batches: bool = True) -> Evaluator:
    """Compile a CasADi function with two dense columns in, (x, p), and one out.

    Args:
        function: the `casadi.Function`, of `SX` expressions; simplified where it is compiled: code that is
            read from the cache needs none of that.
        batches: for many states a call, in SIMD code, else for one state (llvm only).

    Raises:
        InputError: as `evaluator_name`; an operation that machine code does not have.
    """
    if (native := _machine_code(function, batches)) is not None:
        return native
    from deltac.kernels.casadi_evaluator import CasadiEvaluator

    return CasadiEvaluator(simplified(function))


def compile_loop(function: Any) -> NativeLoop:
    """Compile a CasADi function (x, p) -> x to be applied over and over; errors as `compile_function`."""
    if (native := _machine_code(function, batches=False)) is not None:
        return native
    from deltac.kernels.casadi_evaluator import CasadiLoop

    return CasadiLoop(simplified(function))


def _machine_code(function: Any, batches: bool) -> NativeEvaluator | None:
    """The function compiled, as an `Evaluator` and a `NativeLoop`; None where it is to be interpreted."""
    chosen = bool(os.environ.get("DELTAC_EVALUATOR", "").strip())
    if evaluator_name() == "casadi":
        if not chosen:
            _interpreting("llvmlite is not installed")
        return None
    try:
        from deltac.kernels.llvm_evaluator import llvm_evaluator

        return llvm_evaluator(function, batches)
    except (
        ImportError,
        OSError,
        RuntimeError,
    ) as error:  # of LLVM on a platform that it does not fit
        if chosen:
            raise
        _interpreting(f"LLVM does not work here ({error!s:.300})")
        return None


@cache
def _interpreting(why: str) -> None:
    """Say, once in a process, that kernels are slow."""
    warn_user(
        f"{why}: kernels are interpreted by CasADi, which takes some ten times as long as machine code. "
        "Install llvmlite; DELTAC_EVALUATOR=casadi says that it is meant so",
        EvaluatorWarning,
    )
