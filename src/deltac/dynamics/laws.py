"""Laws printed to CasADi: a SymPy expression becomes nodes of the traced mechanics."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from functools import reduce
from typing import Any, TypeAlias

import casadi as ca

from deltac.errors import ModelError, check_names
from deltac.mechanism.expressions import Law
from deltac.mechanism.polynomials import HIGHEST, Polynomial

SX: TypeAlias = Any
"""A CasADi SX scalar (CasADi is untyped)."""

Expr: TypeAlias = Any
"""A node of a SymPy expression."""

# By SymPy's class names, so that a law that is a number needs no SymPy.
CASADI_FUNCTIONS: dict[str, Callable[..., SX]] = {
    "sin": ca.sin,
    "cos": ca.cos,
    "tan": ca.tan,
    "cot": lambda x: ca.cos(x) / ca.sin(x),
    "asin": ca.asin,
    "acos": ca.acos,
    "atan": ca.atan,
    "atan2": ca.atan2,
    "sinh": ca.sinh,
    "cosh": ca.cosh,
    "tanh": ca.tanh,
    "exp": ca.exp,
    "log": ca.log,
    "Abs": ca.fabs,
    "sign": ca.sign,
    "Min": lambda *x: reduce(ca.fmin, x),
    "Max": lambda *x: reduce(ca.fmax, x),
    "Add": lambda *x: reduce(operator.add, x),
    "StrictLessThan": operator.lt,
    "LessThan": operator.le,
    "StrictGreaterThan": operator.gt,
    "GreaterThan": operator.ge,
    "Equality": operator.eq,
    "Unequality": operator.ne,
    "And": lambda *x: reduce(ca.logic_and, x),
    "Or": lambda *x: reduce(ca.logic_or, x),
    "Not": ca.logic_not,
    "ITE": ca.if_else,
    "BooleanTrue": lambda: ca.SX(1),
    "BooleanFalse": lambda: ca.SX(0),
}


class Varied(float):
    """A number of a description that is traced as a symbol; its value decides where a law has branches."""

    symbol: SX

    @staticmethod
    def of(value: float, symbol: SX) -> Varied:
        """The number with its symbol."""
        varied = Varied(value)
        varied.symbol = symbol
        return varied


_FORMS = ("Mul", "Pow", "Piecewise", "ExprCondPair")  # printed by functions of their own


def to_casadi(law: Law, values: Mapping[str, SX]) -> SX:
    """The law as a CasADi scalar, its symbols replaced by the values of their names.

    Equal parts of the law become one node. Comparisons are 1 or 0; the branches of a Piecewise that
    do not hold add nothing to the value, but a NaN in one reaches the derivatives.

    Raises:
        InputError: a symbol without a value, a function that is not supported, or a Piecewise
            without a last branch that always holds.
    """
    if isinstance(law, Varied):
        return law.symbol
    if isinstance(law, int | float):
        return _constant(law)
    if isinstance(law, Polynomial):
        check_names(sorted(law.names), values, "a law depends on")
        return ca.SX(law.at(values))
    printed: dict[Expr, SX] = {}
    # Parts before the whole, on a stack of our own: laws may be nested deeply.
    stack = [law]
    while stack:
        node = stack.pop()
        if node in printed:
            continue
        _check_supported(node)
        waiting = [part for part in node.args if part not in printed]
        if waiting:
            stack += [node, *waiting]
        else:
            printed[node] = _print(node, printed, values)
    return printed[law]


def _check_supported(node: Expr) -> None:
    name = type(node).__name__
    if not (_is_number(node) or node.is_Symbol or name in _FORMS or name in CASADI_FUNCTIONS):
        raise ModelError(f"the function {name} of the law's part {node!s:.200} is not supported")


def _is_number(node: Expr) -> bool:
    return bool(node.is_Number or getattr(node, "is_NumberSymbol", False))


def _print(node: Expr, printed: Mapping[Expr, SX], values: Mapping[str, SX]) -> SX:
    """One node, its parts being printed already."""
    if node.is_Symbol:
        check_names([node.name], values, "a law depends on")
        return values[node.name]
    if _is_number(node):
        return _constant(node)
    match type(node).__name__:
        case "Mul":
            return _product(node, printed)
        case "Pow":
            return _power(printed[node.base], node.exp, printed)
        case "Piecewise":
            return _piecewise(node, printed)
        case "ExprCondPair":
            return printed[node.expr]
        case name:
            return CASADI_FUNCTIONS[name](*(printed[part] for part in node.args))


def _constant(number: Any) -> SX:
    value = float(number)
    if not math.isfinite(value):
        raise ModelError(f"the number {number!s:.80} of a law is not a finite number")
    return ca.SX(value)


def _product(node: Expr, printed: Mapping[Expr, SX]) -> SX:
    """A product, with one division by all factors of negative power."""
    above, below = [], []
    for factor in node.args:
        if factor.is_Pow and factor.exp.is_Number and factor.exp.is_negative:
            below.append(_power(printed[factor.base], -factor.exp, printed))
        else:
            above.append(printed[factor])
    numerator = reduce(operator.mul, above, ca.SX(1))
    return numerator / reduce(operator.mul, below) if below else numerator


def _power(base: SX, exponent: Expr, printed: Mapping[Expr, SX]) -> SX:
    """A power; of a half-integer exponent by products, a square root and a reciprocal."""
    if not exponent.is_Number:
        return base ** printed[exponent]
    halves = 2.0 * float(exponent)
    if not halves.is_integer() or abs(halves) > 2 * HIGHEST:
        return base ** float(exponent)
    count, half = divmod(int(abs(halves)), 2)
    result = _integer_power(base, count)
    if half:
        result = ca.sqrt(base) * result
    return 1 / result if halves < 0 else result


def _integer_power(base: SX, count: int) -> SX:
    """base**count by repeated squaring."""
    result = ca.SX(1)
    square = base
    while count:
        if count % 2:
            result = square * result
        count //= 2
        if count:
            square = square * square
    return result


def _piecewise(node: Expr, printed: Mapping[Expr, SX]) -> SX:
    *pairs, (otherwise, always) = node.args
    if always != True:  # noqa: E712  SymPy's true is not Python's
        raise ModelError(
            f"{node!s:.200} has no value where no condition holds; add a last branch (value, True)"
        )
    result = printed[otherwise]
    for value, condition in reversed(pairs):
        result = ca.if_else(printed[condition], printed[value], result)
    return result
