"""Expressions of laws: their functions, what they may be made of, and why one is no law."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, TypeAlias

Expr: TypeAlias = Any
"""A SymPy expression (SymPy is untyped, and loaded lazily)."""

Law: TypeAlias = float | Expr
"""A finite number, or a SymPy expression of real symbols that `as_law` has checked."""


@dataclass(frozen=True)
class Function:
    """A function of the grammar: its SymPy name, how many arguments, and its value on numbers."""

    sympy: str
    value: Callable[..., float]
    arguments: int = 1
    variadic: bool = False


FUNCTIONS = {
    "sin": Function("sin", math.sin),
    "cos": Function("cos", math.cos),
    "tan": Function("tan", math.tan),
    "asin": Function("asin", math.asin),
    "acos": Function("acos", math.acos),
    "atan": Function("atan", math.atan),
    "atan2": Function("atan2", math.atan2, arguments=2),
    "sinh": Function("sinh", math.sinh),
    "cosh": Function("cosh", math.cosh),
    "tanh": Function("tanh", math.tanh),
    "exp": Function("exp", math.exp),
    "log": Function("log", math.log),
    "sqrt": Function("sqrt", math.sqrt),
    "abs": Function("Abs", abs),
    "Abs": Function("Abs", abs),
    "sign": Function("sign", lambda x: float((x > 0) - (x < 0))),
    "min": Function("Min", min, arguments=2, variadic=True),
    "Min": Function("Min", min, arguments=2, variadic=True),
    "max": Function("Max", max, arguments=2, variadic=True),
    "Max": Function("Max", max, arguments=2, variadic=True),
}
"""The grammar's functions; `where(condition, a, b)` comes on top."""

# SymPy writes tan(pi/2 - x) as cot(x) by itself, and ITE for a condition that holds a Piecewise.
_CONDITIONS = "And Or Not ITE BooleanTrue BooleanFalse".split()

RELATIONS = "StrictLessThan LessThan StrictGreaterThan GreaterThan Equality Unequality".split()

_STRUCTURE = "Symbol Add Mul Pow Piecewise ExprCondPair cot".split()

_SUPPORTED = frozenset(
    [*(f.sympy for f in FUNCTIONS.values()), *_STRUCTURE, *_CONDITIONS, *RELATIONS]
)

_SYMPY_REMEDIES = {
    "Derivative": "; write u.<speed> for a rate, or differentiate with real symbols and .doit()",
    "Integral": "; integrate in closed form first",
    "Heaviside": "; write Piecewise or where(condition, a, b)",
    "DiracDelta": "; an impulse is not a force; write a short pulse",
}

ALLOWED = (
    "a law is made of numbers, pi, t, parameters, q.<coordinate>, u.<speed> (other names as in "
    'q["left hip"]), + - * / **, '
    "comparisons with and/or/not, a if condition else b, where(condition, a, b), and "
    + ", ".join(name for name in FUNCTIONS if name.islower())
)


def nodes_of(expr: Expr, visited: set[Expr] | None = None) -> Iterator[Expr]:
    """Each distinct node of an expression that is not in `visited`, which grows."""
    visited = set() if visited is None else visited
    stack = [expr]
    while stack:
        node = stack.pop()
        if node not in visited:
            visited.add(node)
            yield node
            stack.extend(node.args)


def problem_of(expr: Expr, visited: set[Expr]) -> str:
    """Why an expression is no law, or an empty text; skips, and adds to, the nodes in `visited`."""
    import sympy
    from sympy.core.function import AppliedUndef

    nodes = list(nodes_of(expr, visited))
    for node in nodes:
        name = type(node).__name__
        if isinstance(node, AppliedUndef):
            return f"the function {node} is not defined; write q.<coordinate>, u.<speed> or t"
        if node is sympy.I:
            return "the expression is complex; laws are real"
        if node is sympy.zoo:
            return "division by zero"
        if not (node.is_Number or node.is_NumberSymbol or name in _SUPPORTED):
            return f"{name} is not supported in a law{_SYMPY_REMEDIES.get(name, '')}"
        if name == "Piecewise" and node.args[-1].cond != sympy.true:
            return f"{node} says nothing where no condition holds; add a last branch (value, True)"
    # Inner numbers before those that they make: of a tower, only the first storeys are evaluated.
    for node in reversed(nodes):
        if node.is_number and not math.isfinite(real_value(node)):
            return f"{node!s:.80} is not a finite real number in double precision"
    return ""


def symbol_of(name: str) -> Expr:
    """The symbol of that name: real, so that |x| and x² behave."""
    import sympy

    return sympy.Symbol(name, real=True)


def real_value(expr: Expr) -> float:
    """The double nearest to an expression without symbols; NaN if it is not real."""
    try:
        return float(expr.evalf(17))
    except (TypeError, OverflowError):
        return math.nan
