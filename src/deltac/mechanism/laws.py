"""Laws: what a user writes for a torque, a motion, a stiffness curve.

A law is a number, a SymPy expression, or a text in a small safe grammar that is read to one of the
two. It depends on the time `t`, on coordinates `q.<coordinate>`, on speeds `u.<speed>` and on
parameters, each a real SymPy symbol of exactly that name::

    3 * sin(2 * pi * t) - c * u.elbow
    k * q["left hip"] ** 3
    where(q.knee < 0, -k * q.knee, 0)  # or: -k*q.knee if q.knee < 0 else 0

Texts are read through Python's syntax tree and a list of what is allowed, never evaluated. SymPy is
loaded by the first law that needs it: a law that is a number does not.
"""

from __future__ import annotations

import ast
import difflib
import math
import numbers
import operator
import re
import sys
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NoReturn, TypeAlias

from deltac.errors import InputError

Expr: TypeAlias = Any
"""A SymPy expression (SymPy is untyped, and loaded lazily)."""

Law: TypeAlias = float | Expr
"""A finite number, or a SymPy expression of real symbols that `as_law` has checked."""

MAX_LENGTH = 4000
MAX_DEPTH = 40
MAX_EXPONENT = 1024  # also in bits, of the integers that a power makes: beyond the range of doubles
EXACT = 2**53  # larger integers are not exact as doubles


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

COMPARISONS: dict[type[ast.cmpop], Callable[[Expr, Expr], Expr]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}

# SymPy writes tan(pi/2 - x) as cot(x) by itself, and ITE for a condition that holds a Piecewise.
_CONDITIONS = "And Or Not ITE BooleanTrue BooleanFalse".split()
_RELATIONS = "StrictLessThan LessThan StrictGreaterThan GreaterThan Equality Unequality".split()
_STRUCTURE = "Symbol Add Mul Pow Piecewise ExprCondPair cot".split()
_SUPPORTED = frozenset(
    [*(f.sympy for f in FUNCTIONS.values()), *_STRUCTURE, *_CONDITIONS, *_RELATIONS]
)
_KINKED = frozenset(["Abs", "sign", "Min", "Max", "Piecewise", "atan2", *_RELATIONS])

_REMEDIES = {
    "Derivative": "; write u.<speed> for a rate, or differentiate with real symbols and .doit()",
    "Integral": "; integrate in closed form first",
    "Heaviside": "; write Piecewise or where(condition, a, b)",
    "DiracDelta": "; an impulse is no force, write a short pulse",
}

_ALLOWED = (
    "a law is made of numbers, pi, t, parameters, q.<coordinate>, u.<speed> (other names as in "
    'q["left hip"]), + - * / **, '
    "comparisons with and/or/not, a if condition else b, where(condition, a, b), and "
    + ", ".join(name for name in FUNCTIONS if name.islower())
)


def time() -> Expr:
    """The time `t` in laws (s)."""
    return _symbol("t")


def q(coordinate: str) -> Expr:
    """A coordinate in laws, by its name: `q("elbow")`, `q("base.x")` (rad, m, or without unit)."""
    return _symbol(f"q.{coordinate}")


def u(speed: str) -> Expr:
    """A speed in laws, by its name: `u("elbow")`, `u("base.wx")` (rad/s or m/s)."""
    return _symbol(f"u.{speed}")


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
    if "sympy" in sys.modules and isinstance(value, sys.modules["sympy"].Basic):
        try:
            return _checked(_normalised(value, where), where)
        except RecursionError:
            raise InputError(f"{where}: the expression is nested too deeply for SymPy") from None
    hint = "; write the function as a SymPy expression" if callable(value) else ""
    raise InputError(
        f"{where}: found {type(value).__name__} {value!r:.80}, expected a number, a text or a "
        f"SymPy expression{hint}"
    )


def symbol_names(law: Law) -> frozenset[str]:
    """The names of the symbols that the law depends on."""
    if isinstance(law, float):
        return frozenset()
    return frozenset(symbol.name for symbol in law.free_symbols)


def check_symbols(law: Law, allowed: Collection[str], where: str) -> None:
    """Raise an InputError if the law depends on a symbol whose name is not allowed."""
    for name in sorted(symbol_names(law) - set(allowed)):
        match = difflib.get_close_matches(name, allowed, n=1)
        hint = f"; did you mean {match[0]!r}?" if match else ""
        may = ", ".join(sorted(allowed)) or "nothing: it must be a number"
        raise InputError(f"{where}: unknown symbol {name!r}{hint}; the law may depend on {may}")


def is_smooth(law: Law) -> bool:
    """Whether the law is analytic where it is defined, as far as its form shows.

    Abs, sign, Min, Max, Piecewise, comparisons and atan2 (which jumps by 2 pi) are not. The base of
    a power that is not an integer counts as positive: sqrt(x) is smooth, sqrt(x**2) is Abs(x).
    """
    return isinstance(law, float) or not any(type(node).__name__ in _KINKED for node in _nodes(law))


def evaluate(law: Law, values: Mapping[str, float]) -> float:
    """The law's value where its symbols have the given values, by name.

    Raises:
        InputError: a symbol has no value, or the law is not finite and real there.
    """
    if isinstance(law, float):
        return law
    import sympy

    check_symbols(law, values.keys(), "value of a law")
    point = {symbol: sympy.Float(values[symbol.name]) for symbol in law.free_symbols}
    value = _real(law.xreplace(point))
    if not math.isfinite(value):
        at = ", ".join(f"{symbol} = {float(x):g}" for symbol, x in point.items())
        raise InputError(f"the law {law} has no finite real value at {at}")
    return value


def rate(law: Law) -> Law:
    """The law's partial derivative by t: exact, except that jumps of the law leave no impulse.

    At a kink it is finite: the slope of one of the sides, or between them.

    Raises:
        InputError: the derivative has functions that laws do not have.
    """
    if isinstance(law, float):
        return 0.0
    import sympy

    derivative = law.diff(time())
    # Of Min and Max: SymPy's step function; of sign: an impulse, which almost everywhere is zero.
    step = lambda x, *_: sympy.Piecewise((0, x < 0), (1, True))  # noqa: E731
    derivative = derivative.replace(sympy.DiracDelta, lambda *_: sympy.S.Zero)
    return _checked(derivative.replace(sympy.Heaviside, step), f"derivative of {law}")


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
        raise InputError(
            f"{self.where}: {problem}\n"
            f"    {before}{self.text[first:last]}{after}\n"
            f"    {' ' * (len(before) + at - first)}^\n"
            f"{_ALLOWED}"
        )

    def index(self, offset: int) -> int:
        """Place in the text; Python's syntax tree counts bytes of UTF-8."""
        return len(self.text.encode()[:offset].decode())

    def law(self) -> Law:
        if not self.text:
            raise InputError(f"{self.where}: the text is empty; write a number or an expression")
        if len(self.text) > MAX_LENGTH:
            raise InputError(
                f"{self.where}: the text has {len(self.text)} characters, at most {MAX_LENGTH} are "
                "read; build long laws as SymPy expressions"
            )
        root = self.tree()
        for node, depth in _depths(root):
            if depth > MAX_DEPTH:
                self.fail(node, f"more than {MAX_DEPTH} levels deep; build it with SymPy")
        expr = self.number(root)
        return expr if expr.free_symbols else _real(expr)

    def tree(self) -> ast.expr:
        # A comment would hide the lines after it.
        bare = re.sub(r"'[^']*'|\"[^\"]*\"", lambda quoted: "_" * len(quoted[0]), self.text)
        if "#" in bare:
            self.fail(bare.index("#"), "a law has no comments")
        try:
            return ast.parse(self.text, mode="eval").body
        except SyntaxError as error:
            at = min(max((error.offset or 1) - 1, 0), len(self.text))
            self.fail(at, f"this is not an expression ({error.msg})")
        except (ValueError, RecursionError, MemoryError) as error:
            raise InputError(f"{self.where}: the text cannot be read ({error})") from None

    def number(self, node: ast.expr) -> Expr:
        """The expression that a syntax node says, checked."""
        expr = self.expression(node)
        if problem := _problem(expr, self.seen):
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
        if isinstance(value, int) and value <= EXACT:
            return sympy.Integer(value)
        return self.double(node, float, value)

    def symbol(self, node: ast.expr) -> Expr:
        import sympy

        if not isinstance(node, ast.Name):
            return _symbol(self.path(node))
        if node.id in FUNCTIONS or node.id == "where":
            self.fail(node, f"{node.id} is a function: write {node.id}(…)")
        if node.id in ("q", "u"):
            kind = "coordinate" if node.id == "q" else "speed"
            self.fail(node, f"which {kind}? write {node.id}.<{kind}>")
        return sympy.pi if node.id == "pi" else _symbol(node.id)

    def path(self, node: ast.expr) -> str:
        match node:
            case ast.Attribute():
                return f"{self.path(node.value)}.{node.attr}"
            case ast.Subscript(slice=ast.Constant(value=str(name))):
                return f"{self.path(node.value)}.{name}"
            case ast.Name(id="q" | "u"):
                return node.id
        self.fail(node, 'names with parts start with q or u: q.base.x, u["left hip"]')

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
        least, found = function.arguments, len(arguments)
        if found < least or (found > least and not function.variadic):
            expected = f"at least {least}" if function.variadic else str(least)
            self.fail(node, f"the number of arguments of {name} is {found}, expected {expected}")
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
            if type(comparison) not in COMPARISONS:
                self.fail(self.operator(operands[k]), "compare with < <= > >=")
            try:
                parts.append(COMPARISONS[type(comparison)](values[k], values[k + 1]))
            except TypeError as error:
                self.fail(operands[k], f"these cannot be compared ({error})")
        return sympy.And(*parts)

    def operator(self, left: ast.expr) -> int:
        """Where the operator after an operand stands: past blanks and closing parentheses."""
        end = self.index(left.end_col_offset or 0)
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


def _same_chain(node: ast.BinOp, left: ast.expr) -> bool:
    return isinstance(left, ast.BinOp) and any(
        isinstance(node.op, chain) and isinstance(left.op, chain)
        for chain in (ast.Add | ast.Sub, ast.Mult | ast.Div)
    )


def _nodes(expr: Expr, seen: set[Expr] | None = None) -> Iterator[Expr]:
    """Each distinct node of an expression that is not in `seen`, which grows."""
    seen = set() if seen is None else seen
    stack = [expr]
    while stack:
        node = stack.pop()
        if node not in seen:
            seen.add(node)
            yield node
            stack.extend(node.args)


def _problem(expr: Expr, seen: set[Expr]) -> str:
    """Why an expression is no law, or an empty text; skips, and adds to, the nodes in `seen`."""
    import sympy
    from sympy.core.function import AppliedUndef

    nodes = list(_nodes(expr, seen))
    for node in nodes:
        name = type(node).__name__
        if isinstance(node, AppliedUndef):
            return f"the function {node} is not defined; write q.<coordinate>, u.<speed> or t"
        if node is sympy.I:
            return "the expression is complex; laws are real"
        if node is sympy.zoo:
            return "division by zero"
        if not (node.is_Number or node.is_NumberSymbol or name in _SUPPORTED):
            return f"{name} is not supported in a law{_REMEDIES.get(name, '')}"
        if name == "Piecewise" and node.args[-1].cond != sympy.true:
            return f"{node} says nothing where no condition holds; add a last branch (value, True)"
    # Inner numbers before those that they make: of a tower, only the first storeys are evaluated.
    for node in reversed(nodes):
        if node.is_number and not math.isfinite(_real(node)):
            return f"{node!s:.80} is not a finite real number in double precision"
    return ""


def _checked(expr: Expr, where: str) -> Law:
    import sympy

    if not isinstance(expr, sympy.Expr):
        raise InputError(f"{where}: found {expr!s:.80}, expected an expression with a real value")
    if problem := _problem(expr, set()):
        raise InputError(f"{where}: {problem}\n    in {expr!s:.200}\n{_ALLOWED}")
    return expr if expr.free_symbols else _real(expr)


def _normalised(expr: Expr, where: str) -> Expr:
    """The expression in our symbols, which go by name: real, whatever the user declared."""
    import sympy

    ours = {}
    for symbol in expr.free_symbols:
        if not isinstance(symbol, sympy.Symbol) or isinstance(symbol, sympy.Dummy | sympy.Wild):
            raise InputError(f"{where}: {type(symbol).__name__} {symbol} is not a plain symbol")
        if symbol.is_extended_real is False or not symbol.is_commutative:
            raise InputError(f"{where}: the symbol {symbol} is not declared as a real number")
        if symbol != _symbol(symbol.name):
            ours[symbol] = _symbol(symbol.name)
    # Rebuilding costs time and may change the form: only where there is something to replace.
    try:
        return expr.xreplace(ours) if ours else expr
    except (TypeError, ValueError) as error:
        raise InputError(f"{where}: {expr!s:.200} is no real expression ({error})") from None


def _symbol(name: str) -> Expr:
    import sympy

    return sympy.Symbol(name, real=True)


def _finite(number: Any, where: str) -> float:
    try:
        value = float(number)
    except OverflowError:
        value = math.inf
    if not math.isfinite(value):
        raise InputError(f"{where}: found {number!s:.80}, expected a finite number")
    return value


def _real(expr: Expr) -> float:
    """The double nearest to an expression without symbols; NaN if it is not real."""
    try:
        return float(expr.evalf(17))
    except (TypeError, OverflowError):
        return math.nan


def _bits(number: Expr) -> int:
    """Bits of a rational's numerator or denominator, whichever is larger."""
    return int(max(abs(number.p), number.q)).bit_length()
