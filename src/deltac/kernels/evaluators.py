"""What an evaluator is, and which one compiles a kernel."""

from __future__ import annotations

import importlib.util
import os
from typing import Any, Protocol

from deltac.arrays import Array
from deltac.errors import PackageError, UnknownName, closest

EVALUATORS = ("heyoka", "casadi")


class Evaluator(Protocol):
    """A function `y = f(x, p)` of columns, ready to run; arrays are contiguous float64."""

    @property
    def width(self) -> int:
        """The columns of a batch beyond the last multiple of this may differ in rounding."""

    def single(self, x: Array, out: Array, parameters: Array | None) -> None:
        """One state: x `(n_in,)`, out `(n_out,)`, parameters `(n_par,)`, None if there are none."""

    def batch(self, x: Array, out: Array, parameters: Array | None) -> None:
        """Many states: x `(n_in, B)`, out `(n_out, B)`, parameters `(n_par, B)`."""


class Loop(Protocol):
    """A function `x ← f(x, p)`, ready to be run over and over in native code."""

    def iterate(self, rows: Array, parameters: Array) -> None:
        """Write rows 1, 2, … of `(count + 1, n)`: rows[k + 1] = f(rows[k], parameters[k % period]).

        `parameters` is `(period, n_par)`; both are contiguous float64, and count is one at least.
        """


def evaluator_name() -> str:
    """The evaluator in use: `DELTAC_EVALUATOR` if set, else heyoka where installed, else casadi.

    Raises:
        InputError: an unknown name, or heyoka is asked for and is not installed.
    """
    forced = os.environ.get("DELTAC_EVALUATOR", "").strip().lower()
    if forced and forced not in EVALUATORS:
        raise UnknownName(f"DELTAC_EVALUATOR={forced!r}{closest(forced, EVALUATORS)}")
    installed = importlib.util.find_spec("heyoka") is not None
    if forced == "heyoka" and not installed:
        raise PackageError(
            "DELTAC_EVALUATOR='heyoka', and heyoka is not installed; "
            "install it, or unset the variable to use casadi"
        )
    return forced or ("heyoka" if installed else "casadi")


def compile_function(function: Any, inline: bool = False, batches: bool = True) -> Evaluator:
    """Compile a CasADi function with two dense columns in, (x, p), and one out.

    Args:
        function: the `casadi.Function`, of `SX` expressions.
        inline: write sines and cosines out in the machine code, which compiles more slowly and makes
            batches faster; for what runs millions of times (heyoka only).
        batches: for many states a call, in SIMD code, which takes three to four times as long to compile
            as code for one state (heyoka only).

    Raises:
        InputError: as `evaluator_name`; an operation that heyoka does not have.
    """
    if evaluator_name() == "heyoka":
        from deltac.kernels.heyoka_evaluator import HeyokaEvaluator

        return HeyokaEvaluator(function, inline, batches)
    from deltac.kernels.casadi_evaluator import CasadiEvaluator

    return CasadiEvaluator(function)


def compile_loop(function: Any) -> Loop:
    """Compile a CasADi function (x, p) -> x to be applied over and over; errors as `compile_function`."""
    if evaluator_name() == "heyoka":
        from deltac.kernels.heyoka_loop import HeyokaLoop

        return HeyokaLoop(function)
    from deltac.kernels.casadi_evaluator import CasadiLoop

    return CasadiLoop(function)
