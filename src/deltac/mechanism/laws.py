"""Laws: what a user writes for a torque, a motion, a stiffness curve.

A law is a number, a SymPy expression, or a text in a small safe grammar that is read to one of the
two. It depends on the time `t`, on coordinates `q.<coordinate>`, on speeds `u.<speed>` and on
parameters, each a real SymPy symbol of exactly that name::

    3 * sin(2 * pi * t) - c * u.elbow
    k * q["left hip"] ** 3
    where(q.knee < 0, -k * q.knee, 0)  # or: -k*q.knee if q.knee < 0 else 0

Texts are read through Python's syntax tree and a list of what is allowed, never evaluated. SymPy is
loaded by the first law that needs it: numbers and `polynomials` do not.
"""

from __future__ import annotations

import difflib
import math
import numbers
import sys
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import Array
from deltac.errors import ModelError, UnknownName, WrongType
from deltac.mechanism.expressions import (
    ALLOWED,
    Expr,
    Law,
    problem_of,
    real_value,
    symbol_of,
)
from deltac.mechanism.grammar import parse
from deltac.mechanism.polynomials import Polynomial, is_finite, polynomial_of


class Expression(Protocol):
    """A SymPy expression."""

    @property
    def free_symbols(self) -> Collection[Any]:
        """Its symbols."""


LawLike: TypeAlias = float | str | Expression
"""What users may give for a number or a law: see `as_law`."""

VectorLike: TypeAlias = Sequence[LawLike] | NDArray[Any]
"""What users may give for three components."""

LawsLike: TypeAlias = LawLike | VectorLike
"""What users may give for one law, or for one of each coordinate."""


def time() -> Expr:
    """The time `t` in laws (s)."""
    return symbol_of("t")


def q(coordinate: str) -> Expr:
    """A coordinate in laws, by its name: `q("elbow")`, `q("base.x")` (rad, m, or without unit)."""
    return symbol_of(f"q.{coordinate}")


def u(speed: str) -> Expr:
    """A speed in laws, by its name: `u("elbow")`, `u("base.wx")` (rad/s or m/s)."""
    return symbol_of(f"u.{speed}")


def __getattr__(name: str) -> Expr:
    """`t`, made when first asked for: making it loads SymPy."""
    if name == "t":
        return time()
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def as_law(value: object, where: str) -> Law:
    """The law that a user's value stands for.

    Args:
        value: a real number (Python, NumPy or SymPy), a text of the grammar, or a SymPy expression;
            its symbols are taken by name, whatever their assumptions.
        where: what the law is for, as messages call it: `"law of joint torque 'motor'"`.

    Returns:
        A finite float where no symbol is left, otherwise an expression of real symbols.

    Raises:
        InputError: not a law, not finite, not real, or with functions that are not supported.
    """
    if isinstance(value, str):
        return parse(value, where)
    if isinstance(value, numbers.Real) and not isinstance(value, bool):
        return _finite(value, where)
    if isinstance(value, Polynomial):
        if not is_finite(value):
            raise ModelError(f"{where}: {value!s:.200} has a number that is not finite")
        return value
    if "sympy" in sys.modules and isinstance(value, sys.modules["sympy"].Basic):
        try:
            return _checked(_normalised(value, where), where)
        except RecursionError:
            raise ModelError(f"{where}: the expression is nested too deeply for SymPy") from None
    hint = "; write the function as a SymPy expression" if callable(value) else ""
    raise WrongType(
        f"{where}: found {type(value).__name__} {value!r:.80}, expected a number, a text or a "
        f"SymPy expression{hint}"
    )


def as_text(law: Law) -> str:
    """The law as a text of the grammar; names of coordinates and speeds in brackets, whatever they are."""
    if isinstance(law, float):
        return repr(law)
    from sympy.printing.str import StrPrinter

    class Printer(StrPrinter):  # type: ignore[misc]
        def _print_Symbol(self, expr: Any) -> str:  # noqa: N802
            kind, dot, name = expr.name.partition(".")
            return f'{kind}["{name}"]' if dot else str(expr.name)

        def _print_Float(self, expr: Any) -> str:  # noqa: N802
            return repr(float(expr))

        def _print_And(self, expr: Any) -> str:  # noqa: N802
            return " and ".join(f"({self._print(arg)})" for arg in expr.args)

        def _print_Or(self, expr: Any) -> str:  # noqa: N802
            return " or ".join(f"({self._print(arg)})" for arg in expr.args)

        def _print_Not(self, expr: Any) -> str:  # noqa: N802
            return f"not ({self._print(expr.args[0])})"

        def _print_Piecewise(self, expr: Any) -> str:  # noqa: N802
            text = str(self._print(expr.args[-1].expr))
            for part in reversed(expr.args[:-1]):
                text = f"where({self._print(part.cond)}, {self._print(part.expr)}, {text})"
            return text

    return str(Printer().doprint(law))


def symbol_names(law: Law) -> frozenset[str]:
    """The names of the symbols that the law depends on."""
    if isinstance(law, float):
        return frozenset()
    if isinstance(law, Polynomial):
        return law.names
    return frozenset(symbol.name for symbol in law.free_symbols)


def check_symbols(law: Law, allowed: Collection[str], where: str) -> None:
    """Raise an InputError if the law depends on a symbol whose name is not allowed."""
    for name in sorted(symbol_names(law) - set(allowed)):
        match = difflib.get_close_matches(name, allowed, n=1)
        hint = f"; did you mean {match[0]!r}?" if match else ""
        may = ", ".join(sorted(allowed)) or "nothing: it must be a number"
        raise UnknownName(f"{where}: unknown symbol {name!r}{hint}; the law may depend on {may}")


def evaluate(law: Law, values: Mapping[str, float]) -> float:
    """The law's value where its symbols have the given values, by name.

    Raises:
        InputError: a symbol has no value, or the law is not finite and real there.
    """
    if isinstance(law, float):
        return law
    check_symbols(law, values.keys(), "value of a law")
    value = math.nan
    if isinstance(law, Polynomial):
        with suppress(ArithmeticError):
            value = float(law.at(values))
    else:
        import sympy

        point = {symbol: sympy.Float(values[symbol.name]) for symbol in law.free_symbols}
        value = real_value(law.xreplace(point))
    if not math.isfinite(value):
        at = ", ".join(f"{name} = {float(values[name]):g}" for name in sorted(symbol_names(law)))
        raise ModelError(f"the law {law} has no finite real value at {at}")
    return value


def with_values(law: Law, values: Mapping[str, float]) -> Law:
    """The law with numbers in place of the symbols that have the given names."""
    if isinstance(law, float):
        return law
    if isinstance(law, Polynomial):
        symbols = {name: values.get(name, Polynomial.symbol(name)) for name in law.names}
        return as_law(law.at(symbols), str(law))
    import sympy

    numbers = {s: sympy.Float(values[s.name]) for s in law.free_symbols if s.name in values}
    return _checked(law.xreplace(numbers), str(law))


def at_times(law: Law, t: Array) -> Array:
    """The values (T,) of a law of t alone at the times `t` (T,)."""
    if isinstance(law, float):
        return np.full(len(t), law)
    if isinstance(law, Polynomial):
        return np.broadcast_to(np.asarray(law.at({"t": t}), dtype=float), t.shape)
    import sympy

    return np.broadcast_to(
        np.asarray(sympy.lambdify(time(), law, "numpy")(t), dtype=float), t.shape
    )


@lru_cache(maxsize=512)
def rate(law: Law) -> Law:
    """The law's partial derivative by t: exact, except that jumps of the law leave no impulse.

    At a kink it is finite: the slope of one of the sides, or between them.

    Raises:
        InputError: the derivative has functions that laws do not have.
    """
    if isinstance(law, float) or "t" not in symbol_names(law):
        return 0.0
    import sympy

    derivative = law.diff(time())
    # Of Min and Max: SymPy's step function; of sign: an impulse, which almost everywhere is zero.
    step = lambda x, *_: sympy.Piecewise((0, x < 0), (1, True))  # noqa: E731
    derivative = derivative.replace(sympy.DiracDelta, lambda *_: sympy.S.Zero)
    return _checked(derivative.replace(sympy.Heaviside, step), f"derivative of {law}")


def _checked(expr: Expr, where: str) -> Law:
    import sympy

    if not isinstance(expr, sympy.Expr):
        raise ModelError(f"{where}: found {expr!s:.80}, expected an expression with a real value")
    if problem := problem_of(expr, set()):
        raise ModelError(f"{where}: {problem}\n    in {expr!s:.200}\n{ALLOWED}")
    return polynomial_of(expr) if expr.free_symbols else real_value(expr)


def _normalised(expr: Expr, where: str) -> Expr:
    """The expression in our symbols, which go by name: real, whatever the user declared."""
    import sympy

    ours = {}
    for symbol in expr.free_symbols:
        if not isinstance(symbol, sympy.Symbol) or isinstance(symbol, sympy.Dummy | sympy.Wild):
            raise ModelError(f"{where}: {type(symbol).__name__} {symbol} is not a plain symbol")
        if symbol.is_extended_real is False or not symbol.is_commutative:
            raise ModelError(f"{where}: the symbol {symbol} is not declared as a real number")
        if symbol != symbol_of(symbol.name):
            ours[symbol] = symbol_of(symbol.name)
    # Rebuilding costs time and may change the form: only where there is something to replace.
    try:
        return expr.xreplace(ours) if ours else expr
    except (TypeError, ValueError) as error:
        raise ModelError(f"{where}: {expr!s:.200} is no real expression ({error})") from None


def _finite(number: Any, where: str) -> float:
    try:
        value = float(number)
    except OverflowError:
        value = math.inf
    if not math.isfinite(value):
        raise ModelError(f"{where}: found {number!s:.80}, expected a finite number")
    return value
