"""Polynomials: what most laws and quantities of a description are, without SymPy.

A mass ``m1``, a point ``-l1/2``, an inertia ``m*l**2/12``, a coupling ``q.hip - 2*q.knee``: sums of products
of whole powers. SymPy takes longer to load than such a mechanism takes to simulate, so these are kept,
evaluated and traced here. The form is canonical: what is equal has one `repr`, which digests are made of.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from numbers import Integral, Real
from typing import Any, TypeAlias

Coefficient: TypeAlias = Fraction | float
"""Exact where whole numbers are divided, as in SymPy."""

Monomial: TypeAlias = tuple[tuple[str, int], ...]
"""Names with their exponents, of either sign and not zero, in order."""

HIGHEST = 64
"""Largest exponent that is written out; higher powers are left to SymPy."""

LARGEST_EXACT = 2**53
"""Larger integers are not exact as doubles."""


@dataclass(frozen=True, eq=False, repr=False)
class Polynomial:
    """Σ c Π nameⁿ: arithmetic stays a polynomial where it is one, else it is SymPy's.

    Whatever else is asked of it (`diff`, `free_symbols`, …) is asked of its SymPy `expression`.
    """

    terms: Mapping[Monomial, Coefficient]

    __array_ufunc__ = None  # a NumPy scalar leaves the arithmetic to us

    @staticmethod
    def symbol(name: str) -> Polynomial:
        """The symbol of that name."""
        return Polynomial({((name, 1),): Fraction(1)})

    @property
    def names(self) -> frozenset[str]:
        """The symbols that it depends on."""
        return frozenset(name for monomial in self.terms for name, _ in monomial)

    @cached_property
    def expression(self) -> Any:
        """The same as a SymPy expression of real symbols."""
        import sympy

        def number(c: Coefficient) -> Any:
            if isinstance(c, Fraction):
                return sympy.Rational(c.numerator, c.denominator)
            return sympy.Float(c)

        return sympy.Add(
            *(
                sympy.Mul(number(c), *(sympy.Symbol(name, real=True) ** n for name, n in monomial))
                for monomial, c in self.terms.items()
            )
        )

    def at(self, values: Mapping[str, Any]) -> Any:
        """Its value where the symbols have these values: numbers, arrays, CasADi's scalars, polynomials."""
        total: Any = 0
        for monomial, c in self.terms.items():
            above, below = (c.numerator, c.denominator) if isinstance(c, Fraction) else (c, 1)
            for name, n in monomial:
                if n > 0:
                    above = above * values[name] ** n
                else:
                    below = below * values[name] ** -n
            total = total + above / below
        return total

    def _sympy_(self) -> Any:
        return self.expression

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name == "terms":
            raise AttributeError(f"a polynomial has no attribute {name!r}")
        return getattr(self.expression, name)

    def __repr__(self) -> str:
        def term(monomial: Monomial, c: Coefficient) -> str:
            factors = [f"{name}**{n}" if n != 1 else name for name, n in monomial]
            return "*".join([str(c), *factors] if c != 1 or not factors else factors)

        return " + ".join(term(*entry) for entry in sorted(self.terms.items(), key=repr))

    def __eq__(self, other: object) -> bool:
        if isinstance(other, Polynomial):
            return self.terms == other.terms
        return bool(self.expression == other) if hasattr(other, "free_symbols") else False

    def __hash__(self) -> int:
        return hash(self.expression)

    def __add__(self, other: Any) -> Any:
        if (added := _terms(other)) is None:
            return NotImplemented
        terms = dict(self.terms)
        for monomial, c in added.items():
            terms[monomial] = terms.get(monomial, 0) + c
        return _simplest(terms)

    __radd__ = __add__

    def __neg__(self) -> Any:
        return self * -1

    def __pos__(self) -> Polynomial:
        return self

    def __sub__(self, other: Any) -> Any:
        return NotImplemented if _terms(other) is None else self + -other

    def __rsub__(self, other: Any) -> Any:
        return NotImplemented if _terms(other) is None else -self + other

    def __mul__(self, other: Any) -> Any:
        if (factor := _terms(other)) is None:
            return NotImplemented
        # SymPy multiplies sums out by numbers only; so that there is one form, so do we.
        if len(self.terms) > 1 < len(factor) or any(
            len(one) > 1 and set(more) != {()}
            for one, more in ((self.terms, factor), (factor, self.terms))
        ):
            return self.expression * getattr(other, "expression", other)
        return _simplest(
            {_product(a, b): c * d for a, c in self.terms.items() for b, d in factor.items()}
        )

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        if isinstance(other, Polynomial):
            inverse = other**-1
            return self * inverse if isinstance(inverse, Polynomial) else self.expression * inverse
        return NotImplemented if _terms(other) is None else self * (1 / _number(other))

    def __rtruediv__(self, other: Any) -> Any:
        return NotImplemented if _terms(other) is None else self**-1 * other

    def __pow__(self, exponent: Any) -> Any:
        ((monomial, c), *more) = self.terms.items()
        plain = isinstance(exponent, int | float | Fraction) and exponent == int(exponent)
        if more or not plain or abs(exponent) > HIGHEST:
            return self.expression ** getattr(exponent, "expression", exponent)
        exponent = int(exponent)
        return _simplest({tuple((name, n * exponent) for name, n in monomial): c**exponent})

    def __rpow__(self, base: Any) -> Any:
        return base**self.expression


def _number(value: Any) -> Coefficient:
    if isinstance(value, Fraction | float):
        return value
    return Fraction(int(value)) if isinstance(value, Integral) else float(value)


def _terms(value: Any) -> Mapping[Monomial, Coefficient] | None:
    """The terms of a polynomial or a number; None for anything else, such as a SymPy expression."""
    if isinstance(value, Polynomial):
        return value.terms
    plain = isinstance(value, Real) and not isinstance(value, bool)
    return {(): _number(value)} if plain and not hasattr(value, "free_symbols") else None


def _product(a: Monomial, b: Monomial) -> Monomial:
    exponents = dict(a)
    for name, n in b:
        exponents[name] = exponents.get(name, 0) + n
    return tuple(sorted((name, n) for name, n in exponents.items() if n))


def _simplest(terms: Mapping[Monomial, Coefficient]) -> Polynomial | float:
    """A polynomial, or the number that is left where no symbol is."""
    terms = {monomial: c for monomial, c in terms.items() if c != 0}
    return Polynomial(terms) if set(terms) - {()} else float(terms.get((), 0.0))


def polynomial_of(expression: Any) -> Any:
    """A SymPy expression as a polynomial, if it is one; else itself."""
    total: Any = 0.0
    for term in expression.as_ordered_terms():
        c, rest = term.as_coeff_Mul()
        if not (c.is_Rational or c.is_Float):
            return expression
        value: Any = Fraction(int(c.p), int(c.q)) if c.is_Rational else float(c)
        for factor in rest.as_ordered_factors() if rest != 1 else ():
            base, n = factor.as_base_exp()
            if not (base.is_Symbol and n.is_Integer and abs(n) <= HIGHEST):
                return expression
            value = Polynomial.symbol(base.name) ** int(n) * value
        total = value + total
    return total


_OPERATORS: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}


def polynomial_in(
    tree: ast.expr, reserved: Collection[str]
) -> Polynomial | Fraction | float | None:
    """What a syntax tree says, if that is a number or a polynomial; None if it may be something else.

    Names in `reserved` stand for no symbol by themselves.
    """
    match tree:
        case ast.Constant(value=bool()):
            return None
        case ast.Constant(value=int(value)) if value <= LARGEST_EXACT:
            return Fraction(value)
        case ast.Constant(value=float(value)):
            return value
        case ast.Name(id=name):
            return None if name in reserved else Polynomial.symbol(name)
        case ast.Attribute() | ast.Subscript():
            return Polynomial.symbol(path) if (path := path_of(tree)) else None
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            inner = polynomial_in(operand, reserved)
            return None if inner is None else -inner
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
            a, b = polynomial_in(left, reserved), polynomial_in(right, reserved)
            if a is None or b is None:
                return None
            if isinstance(op, ast.Pow) and not (
                isinstance(a, Polynomial) and isinstance(b, Fraction)
            ):
                return None  # towers of numbers, and powers that are no whole numbers
            try:
                result = _OPERATORS[type(op)](a, b)
            except ArithmeticError:  # which the grammar tells with its place
                return None
            return result if isinstance(result, Polynomial | Fraction | float) else None
    return None


def path_of(node: ast.expr) -> str | None:
    """The name ``q.base.x`` that ``q.base.x`` or ``q["base.x"]`` says; None for anything else."""
    match node:
        case ast.Attribute(value=value, attr=attribute):
            return f"{before}.{attribute}" if (before := path_of(value)) else None
        case ast.Subscript(value=value, slice=ast.Constant(value=str(name))):
            return f"{before}.{name}" if (before := path_of(value)) else None
        case ast.Name(id="q" | "u" as kind):
            return kind
    return None


def is_finite(value: Polynomial | Fraction | float) -> bool:
    """Whether all numbers of a polynomial, or a number, are within the range of doubles."""
    try:
        return all(math.isfinite(float(c)) for c in (_terms(value) or {}).values())
    except OverflowError:
        return False
