"""The grammar of laws: texts read through Python's syntax tree, node by node, never evaluated."""

from __future__ import annotations

import ast
import difflib
import math
import operator
import re
import warnings
from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import Any, NoReturn

from deltac.errors import FileError, ModelError
from deltac.mechanism.expressions import (
    ALLOWED,
    FUNCTIONS,
    Expr,
    Law,
    problem_of,
    real_value,
    symbol_of,
)
from deltac.mechanism.polynomials import (
    LARGEST_EXACT,
    Polynomial,
    is_finite,
    path_of,
    polynomial_in,
    polynomial_of,
)

MAX_LENGTH = 4000
MAX_DEPTH = 40
MAX_EXPONENT = 1024  # also in bits, of the integers that a power makes: beyond the range of doubles

RESERVED = frozenset([*FUNCTIONS, "where", "q", "u", "pi"])
"""Names that stand for no symbol."""

COMPARISON_OPERATORS: dict[type[ast.cmpop], Callable[[Expr, Expr], Expr]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}


@lru_cache(maxsize=1024)
def parse(text: str, where: str) -> Law:
    """The law that a text of the grammar says; see the module's docstring and `as_law`.

    Raises:
        InputError: shows the text, with a caret under what is wrong.
    """
    return _Reader(text, where).law()


class _Reader:
    """Reads one text, node by node of Python's syntax tree, into SymPy.

    Numbers stay small whatever the text says: functions and powers of numbers are taken in double
    precision, the exponents of other powers are bounded, and every result is checked at once.
    """

    def __init__(self, text: str, where: str) -> None:
        self.text = re.sub(r"\s", " ", text).strip()
        self.where = where
        self.seen: set[Expr] = set()

    def fail(self, place: ast.AST | int, problem: str) -> NoReturn:
        """Raise the error that shows where: a syntax node, or an index into the text."""
        at = place if isinstance(place, int) else self.index(getattr(place, "col_offset", 0))
        first, last = max(0, at - 60), at + 60
        before, after = "…" * (first > 0), "…" * (last < len(self.text))
        raise ModelError(
            f"{self.where}: {problem}\n"
            f"    {before}{self.text[first:last]}{after}\n"
            f"    {' ' * (len(before) + at - first)}^\n"
            f"{ALLOWED}"
        )

    def index(self, offset: int) -> int:
        """Place in the text; Python's syntax tree counts bytes of UTF-8."""
        return len(self.text.encode()[:offset].decode())

    def law(self) -> Law:
        if not self.text:
            raise ModelError(f"{self.where}: the text is empty; write a number or an expression")
        if len(self.text) > MAX_LENGTH:
            raise ModelError(
                f"{self.where}: the text has {len(self.text)} characters, at most {MAX_LENGTH} are "
                "read; build long laws as SymPy expressions"
            )
        root = self.tree()
        for node, depth in _depths(root):
            if depth > MAX_DEPTH:
                self.fail(node, f"more than {MAX_DEPTH} levels deep; build it with SymPy")
        if (short := polynomial_in(root, RESERVED)) is not None and is_finite(short):
            return short if isinstance(short, Polynomial) else float(short)
        expr = self.number(root)
        return polynomial_of(expr) if expr.free_symbols else real_value(expr)

    def tree(self) -> ast.expr:
        # A comment would hide the lines after it.
        bare = re.sub(r"'[^']*'|\"[^\"]*\"", lambda quoted: "_" * len(quoted[0]), self.text)
        if "#" in bare:
            self.fail(bare.index("#"), "a law has no comments")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", SyntaxWarning)  # what it warns of is no law either
                return ast.parse(self.text, mode="eval").body
        except SyntaxError as error:
            at = min(max((error.offset or 1) - 1, 0), len(self.text))
            self.fail(at, f"this is not an expression ({error.msg})")
        except (ValueError, RecursionError, MemoryError) as error:
            raise FileError(f"{self.where}: the text cannot be read ({error})") from None

    def number(self, node: ast.expr) -> Expr:
        """The expression that a syntax node says, checked."""
        expr = self.expression(node)
        if problem := problem_of(expr, self.seen):
            self.fail(node, problem)
        return expr

    def expression(self, node: ast.expr) -> Expr:
        match node:
            case ast.Constant():
                return self.literal(node)
            case ast.Name() | ast.Attribute() | ast.Subscript():
                return self.symbol(node)
            case ast.UnaryOp(op=ast.USub()):
                return -self.number(node.operand)
            case ast.UnaryOp(op=ast.UAdd()):
                return self.number(node.operand)
            case ast.BinOp(op=ast.Add() | ast.Sub()):
                return self.sum(node)
            case ast.BinOp(op=ast.Mult() | ast.Div()):
                return self.product(node)
            case ast.BinOp(op=ast.Pow()):
                return self.power(node)
            case ast.BinOp():
                hint = "; a power is written **" if isinstance(node.op, ast.BitXor) else ""
                self.fail(self.operator(node.left), f"this operator is not supported{hint}")
            case ast.Call():
                return self.call(node)
            case ast.IfExp():
                return self.choice(node.test, node.body, node.orelse)
            case ast.Compare() | ast.BoolOp() | ast.UnaryOp(op=ast.Not()):
                self.fail(node, "a condition where a number is expected; where(condition, 1, 0)?")
        self.fail(node, f"this ({type(node).__name__}) is not part of a law")

    def literal(self, node: ast.Constant) -> Expr:
        import sympy

        value = node.value
        if isinstance(value, str):
            self.fail(node, 'quotes are for names, as in q["left hip"]')
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.fail(node, f"{value!r} is not a real number")
        if isinstance(value, int) and value <= LARGEST_EXACT:
            return sympy.Integer(value)
        return self.double(node, float, value)

    def symbol(self, node: ast.expr) -> Expr:
        import sympy

        if not isinstance(node, ast.Name):
            if (path := path_of(node)) is None:
                self.fail(node, 'names with parts start with q or u: q.base.x, u["left hip"]')
            return symbol_of(path)
        if node.id in FUNCTIONS or node.id == "where":
            self.fail(node, f"{node.id} is a function: write {node.id}(…)")
        if node.id in ("q", "u"):
            kind = "coordinate" if node.id == "q" else "speed"
            self.fail(node, f"which {kind}? write {node.id}.<{kind}>")
        return sympy.pi if node.id == "pi" else symbol_of(node.id)

    def sum(self, node: ast.expr) -> Expr:
        import sympy

        terms = []
        while isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
            term = self.number(node.right)
            terms.append(-term if isinstance(node.op, ast.Sub) else term)
            node = node.left
        return sympy.Add(self.number(node), *reversed(terms))

    def product(self, node: ast.expr) -> Expr:
        import sympy

        factors = []
        while isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult | ast.Div):
            factor = self.number(node.right)
            if isinstance(node.op, ast.Div):
                if not factor.free_symbols and float(factor) == 0.0:
                    self.fail(node.right, "division by zero")
                factor = 1 / factor
            factors.append(factor)
            node = node.left
        return sympy.Mul(self.number(node), *reversed(factors))

    def power(self, node: ast.BinOp) -> Expr:
        import sympy

        base, exponent = self.number(node.left), self.number(node.right)
        bits = max((_bits(n) for n in base.atoms(sympy.Rational)), default=0)
        if not exponent.free_symbols:
            size = abs(float(exponent)) * max(bits, 1)
            if not base.free_symbols:
                # Small powers such as 2**3 stay exact.
                exact = base.is_Rational and exponent.is_Integer and size <= 53 and base != 0
                return base**exponent if exact else self.double(node, math.pow, base, exponent)
        elif not base.free_symbols:
            if float(base) < 0.0:
                self.fail(node, "a power of a negative number is not real for all exponents")
            return sympy.Float(float(base)) ** exponent
        else:
            # SymPy may bring out the numbers of such an exponent when powers meet.
            size = max((abs(float(n)) for n in exponent.atoms(sympy.Number)), default=0.0)
        if size > MAX_EXPONENT:
            self.fail(node, "this power is too large for double precision")
        return base**exponent

    def call(self, node: ast.Call) -> Expr:
        import sympy

        if not isinstance(node.func, ast.Name):
            if re.match(r"np\.\w+\(", self.text[self.index(node.col_offset) :]):
                self.fail(
                    node,
                    "this is how NumPy 2 shows a number; where the text is made, write float(x): "
                    "f'{float(x)}*t'",
                )
            self.fail(node, "only the functions of the grammar can be called")
        name, arguments = node.func.id, node.args
        if node.keywords or any(isinstance(argument, ast.Starred) for argument in arguments):
            self.fail(node, f"{name} takes plain arguments only")
        if name == "where":
            if len(arguments) != 3:
                self.fail(node, "where takes a condition and two values: where(condition, a, b)")
            return self.choice(*arguments)
        if name not in FUNCTIONS:
            match = difflib.get_close_matches(name, [*FUNCTIONS, "where"], n=1)
            hint = f"; did you mean {match[0]!r}?" if match else ""
            self.fail(node, f"unknown function {name!r}{hint}")
        function = FUNCTIONS[name]
        least, count = function.arguments, len(arguments)
        if count < least or (count > least and not function.variadic):
            expected = f"at least {least}" if function.variadic else str(least)
            self.fail(node, f"the number of arguments of {name} is {count}, expected {expected}")
        values = [self.number(argument) for argument in arguments]
        if not any(value.free_symbols for value in values):
            return self.double(node, function.value, *values)
        # SymPy's own simplification of Min and Max compares all pairs, at length.
        options = {"evaluate": False} if function.variadic else {}
        return getattr(sympy, function.sympy)(*values, **options)

    def double(self, node: ast.expr, function: Callable[..., float], *arguments: Any) -> Expr:
        """A function of numbers, in double precision."""
        import sympy

        try:
            value = function(*(float(argument) for argument in arguments))
        except OverflowError:
            value = math.inf
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            what = "has no real value" if math.isnan(value) else "is too large"
            self.fail(node, f"this number {what} in double precision")
        return sympy.Float(value)

    def choice(self, test: ast.expr, body: ast.expr, otherwise: ast.expr) -> Expr:
        import sympy

        condition, a, b = self.condition(test), self.number(body), self.number(otherwise)
        if condition in (sympy.true, sympy.false):
            return a if condition else b
        # Evaluation would try to solve the condition for its symbols.
        return sympy.Piecewise((a, condition), (b, True), evaluate=False)

    def condition(self, node: ast.expr) -> Expr:
        import sympy

        match node:
            case ast.Compare():
                return self.comparison(node)
            case ast.BoolOp():
                join = sympy.And if isinstance(node.op, ast.And) else sympy.Or
                return join(*(self.condition(value) for value in node.values))
            case ast.UnaryOp(op=ast.Not()):
                return sympy.Not(self.condition(node.operand))
        self.fail(node, "a condition is expected here, such as q.elbow > 0")

    def comparison(self, node: ast.Compare) -> Expr:
        import sympy

        operands = [node.left, *node.comparators]
        values = [self.number(operand) for operand in operands]
        for operand, value in zip(operands, values, strict=True):
            if value.has(sympy.Piecewise):
                self.fail(operand, "a condition inside a condition; join them with and/or")
        parts = []
        for k, comparison in enumerate(node.ops):
            if type(comparison) not in COMPARISON_OPERATORS:
                self.fail(self.operator(operands[k]), "compare with < <= > >=")
            try:
                parts.append(COMPARISON_OPERATORS[type(comparison)](values[k], values[k + 1]))
            except TypeError as error:
                self.fail(operands[k], f"these cannot be compared ({error})")
        return sympy.And(*parts)

    def operator(self, operand: ast.expr) -> int:
        """Where the operator after an operand stands: past blanks and closing parentheses."""
        end = self.index(operand.end_col_offset or 0)
        return len(self.text) - len(self.text[end:].lstrip(" )"))


def _depths(root: ast.expr) -> Iterator[tuple[ast.expr, int]]:
    """Each node with its depth; a chain like a + b - c is one level."""
    stack: list[tuple[ast.expr, int]] = [(root, 1)]
    while stack:
        node, depth = stack.pop()
        yield node, depth
        chain = node.left if isinstance(node, ast.BinOp) and _same_chain(node, node.left) else None
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.expr):
                stack.append((child, depth if child is chain else depth + 1))


def _same_chain(node: ast.BinOp, operand: ast.expr) -> bool:
    return isinstance(operand, ast.BinOp) and any(
        isinstance(node.op, chain) and isinstance(operand.op, chain)
        for chain in (ast.Add | ast.Sub, ast.Mult | ast.Div)
    )


def _bits(number: Expr) -> int:
    """Bits of a rational's numerator or denominator, whichever is larger."""
    return int(max(abs(number.p), number.q)).bit_length()
