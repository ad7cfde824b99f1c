"""Mutants of a function: small mistakes made on purpose, after published mutation operators.

The operators are those of DeMillo, Lipton and Sayward, Computer 11 (1978) 34-41, and of the Mothra system
(King, Offutt, Software: Practice and Experience 21 (1991) 685-718), adapted to expressions of equations of
motion, with the deletion operators of Delamaro, Offutt and Ammann (ICST 2014). Nothing here knows how
repairs are sought.
"""

from __future__ import annotations

import ast
import copy
import itertools
import random
from collections.abc import Container, Iterator
from dataclasses import dataclass

from deltac.foreign.scripts import called
from deltac.repair.sandbox import module_for
from deltac.repair.tracing.source import Source
from deltac.results import Serialisable

MUTANT_KINDS: dict[str, str] = {
    "operator": "arithmetic operator replaced (AOR)",
    "sign": "unary minus inserted or deleted (UOI, UOD)",
    "name": "variable replaced by another in scope (SVR)",
    "index": "array reference replaced (AAR)",
    "constant": "constant changed (CRP)",
    "power": "exponent changed, square inserted (CRP)",
    "function": "elementary function replaced or deleted",
    "dropped factor": "factor or divisor deleted (ODL)",
    "dropped term": "term deleted (ODL)",
    "statement": "update of a variable deleted or changed (SDL, ASR)",
}
"""Kinds of mutants, and the operators that they stand for."""

_ARITHMETIC = (ast.Add, ast.Sub, ast.Mult, ast.Div)
_DELETIONS: dict[type[ast.operator], str] = {
    ast.Mult: "dropped factor", ast.Div: "dropped factor", ast.Pow: "power",
    ast.Add: "dropped term", ast.Sub: "dropped term",
}  # fmt: skip
"""What kind of mutant an operator leaves that has lost an operand."""

_RELATED = (
    {"sin", "cos", "tan"},
    {"arcsin", "arccos", "arctan", "asin", "acos", "atan"},
    {"sinh", "cosh", "tanh"},
    {"sqrt", "exp", "log"},
)


@dataclass(frozen=True)
class Mutant(Serialisable, omit=("text",)):
    """A function with one mistake: `before` became `after` on `line`; `text` is the whole module."""

    kind: str
    line: int
    before: str
    after: str
    text: str


Span = tuple[int, int, int, int]
"""Where a node begins and ends: line, column, line, column."""


def mutants(
    text: str, function: str, names: int = 2, seed: int = 0, *, read: Container[Span] | None = None
) -> list[Mutant]:
    """All single mutants of a function and of the module's constants that it uses.

    Args:
        text: the module.
        function: its name.
        names: how many other names take the place of each use of a name (drawn by `seed`; all of
            them would be thousands, most of them alike).
        seed: of that draw.
        read: the expressions that are evaluated when the equations are: with it, mutants are made of these,
            in whatever functions, methods and constants of the module they stand, and `function` is not used.
    """
    source = Source("mutant", text, function)
    module = source.module
    draw = random.Random(seed)
    unique: dict[str, Mutant] = {}
    siblings = _siblings(module, read) if read is not None else {}
    for scope in _scopes(module, function if read is None else None):
        counts = _known(module, scope)
        for parent, field, node in _slots(scope):
            if read is not None and not _evaluated(node, read):
                continue
            changes = itertools.chain(
                _changes(parent, field, node, counts, names, draw),
                _other_entries(node, siblings, names, draw),
            )
            for kind, new in changes:
                mutant = _write(source, kind, node, new)
                if mutant is not None:
                    unique.setdefault(mutant.text, mutant)
    return list(unique.values())


def _scopes(module: ast.Module, function: str | None) -> list[ast.stmt]:
    """What a function needs of its module; without one, all functions, constants and fields."""
    if function is not None:
        return module_for(module, function).body
    functions = [n for n in ast.walk(module) if isinstance(n, ast.FunctionDef)]
    classes = [c for c in module.body if isinstance(c, ast.ClassDef)]
    fields = [s for c in classes for s in c.body if not isinstance(s, ast.FunctionDef)]
    return [*functions, *_assignments(module), *fields]


def _assignments(module: ast.Module) -> list[ast.stmt]:
    return [s for s in module.body if isinstance(s, ast.Assign | ast.AnnAssign)]


def _evaluated(node: ast.AST, read: Container[Span]) -> bool:
    """Whether an expression is read, or a statement has one that is."""
    if isinstance(node, ast.expr):
        return span(node) in read
    return any(span(n) in read for n in ast.walk(node) if isinstance(n, ast.expr))


def span(node: ast.expr) -> Span:
    """Where an expression stands."""
    return (node.lineno, node.col_offset, node.end_lineno or 0, node.end_col_offset or 0)


def _siblings(module: ast.Module, read: Container[Span]) -> dict[str, list[ast.expr]]:
    """Attributes and entries by strings of one object that are read, by the object's text."""
    groups: dict[str, list[ast.expr]] = {}
    for node in ast.walk(module):
        entry = isinstance(node, ast.Attribute) or (
            isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant)
        )
        if entry and isinstance(node, ast.expr) and span(node) in read:
            group = groups.setdefault(ast.unparse(node.value), [])  # type: ignore[attr-defined]
            if ast.unparse(node) not in map(ast.unparse, group):
                group.append(node)
    return groups


def _other_entries(
    node: ast.AST, siblings: dict[str, list[ast.expr]], names: int, draw: random.Random
) -> Iterator[tuple[str, ast.AST]]:
    """Another attribute, or another entry, of the same object."""
    if not isinstance(node, ast.Attribute | ast.Subscript) or not isinstance(node.ctx, ast.Load):
        return
    others = [
        n for n in siblings.get(ast.unparse(node.value), []) if ast.unparse(n) != ast.unparse(node)
    ]
    for other in draw.sample(others, min(names, len(others))):
        yield "name" if isinstance(node, ast.Attribute) else "index", other


# --- where ------------------------------------------------------------------------------------------


def _known(module: ast.Module, scope: ast.stmt) -> dict[str, int]:
    """Names of numbers that may be used in a scope, with the line from which each is known."""
    counts: dict[str, int] = {}
    bodies = [s for s in module.body if isinstance(s, ast.Assign)]
    if isinstance(scope, ast.FunctionDef):
        bodies += [s for s in ast.walk(scope) if isinstance(s, ast.Assign)]
    arrays = {
        n.value.id
        for n in ast.walk(scope)
        if isinstance(n, ast.Subscript) and isinstance(n.value, ast.Name)
    }
    for statement in bodies:
        if isinstance(statement.value, ast.Call) and called(statement.value) in ("array", "zeros"):
            continue
        for element in statement.targets:
            for n in ast.walk(element):
                if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store) and n.id not in arrays:
                    counts.setdefault(n.id, statement.end_lineno or statement.lineno)
    return counts


def _slots(root: ast.AST) -> Iterator[tuple[ast.AST, str, ast.AST]]:
    """Every expression and statement below a root, with its parent and the field it is in."""
    for parent in ast.walk(root):
        for field, value in ast.iter_fields(parent):
            skipped = ("args", "ctx", "op", "annotation", "returns")
            if field in skipped and not isinstance(parent, ast.Call):
                continue
            for node in value if isinstance(value, list) else [value]:
                if isinstance(node, ast.expr | ast.stmt):
                    yield parent, field, node


# --- what -------------------------------------------------------------------------------------------


def _changes(
    parent: ast.AST,
    field: str,
    node: ast.AST,
    counts: dict[str, int],
    names: int,
    draw: random.Random,
) -> Iterator[tuple[str, ast.AST | None]]:
    if isinstance(node, ast.expr) and isinstance(getattr(node, "ctx", None), ast.Store):
        return
    if field in ("func", "slice") or isinstance(parent, ast.Subscript | ast.Attribute):
        return
    match node:
        case ast.BinOp():
            yield from _binary(node)
        case ast.UnaryOp(op=ast.USub()):
            yield "sign", node.operand
        case ast.Name() if node.id in counts:
            yield "sign", ast.UnaryOp(ast.USub(), node)
            others = [n for n, line in counts.items() if n != node.id and line < node.lineno]
            for other in draw.sample(others, min(names, len(others))):
                yield "name", ast.Name(other, ast.Load())
            if not (isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.Pow)):
                yield "power", ast.BinOp(node, ast.Pow(), ast.Constant(2))
        case ast.Constant() if isinstance(node.value, int | float) and not isinstance(
            node.value, bool
        ):
            exponent = isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.Pow)
            for value in _other_constants(node.value):
                yield "power" if exponent else "constant", ast.Constant(value)
        case ast.Subscript(slice=ast.Constant(value=int() as index)):
            for place in (int(index) - 1, int(index) + 1):
                if place >= 0:
                    yield "index", ast.Subscript(node.value, ast.Constant(place), ast.Load())
        case ast.Call():
            yield from _called_otherwise(node)
        case ast.AugAssign():
            yield "statement", ast.Pass()
            for op in (ast.Add, ast.Sub):
                if not isinstance(node.op, op):
                    changed = copy.copy(node)
                    changed.op = op()
                    yield "statement", changed
        case ast.Assign(targets=[ast.Name(id=name)]) if any(
            isinstance(n, ast.Name) and n.id == name for n in ast.walk(node.value)
        ):
            yield "statement", ast.Pass()


def _binary(node: ast.BinOp) -> Iterator[tuple[str, ast.AST]]:
    """Another operator, or one of the operands left out."""
    for op in _ARITHMETIC if isinstance(node.op, _ARITHMETIC) else ():
        if not isinstance(node.op, op):
            yield "operator", ast.BinOp(node.left, op(), node.right)
    kind = _DELETIONS.get(type(node.op))
    if kind is None:
        return
    yield kind, node.left
    if isinstance(node.op, ast.Mult | ast.Add):
        yield kind, node.right
    elif isinstance(node.op, ast.Sub):
        yield kind, ast.UnaryOp(ast.USub(), node.right)


def _other_constants(value: float) -> list[float]:
    others = [value + 1, value - 1, value * 2]
    return [c for c in dict.fromkeys(others) if c not in (value, 0)]


def _called_otherwise(node: ast.Call) -> Iterator[tuple[str, ast.AST]]:
    name = called(node)
    for family in _RELATED:
        if name not in family or len(node.args) != 1:
            continue
        if isinstance(node.func, ast.Attribute):
            for other in sorted(family - {name}):
                if name.startswith("arc") == other.startswith("arc"):
                    func = ast.Attribute(node.func.value, other, ast.Load())
                    yield "function", ast.Call(func, node.args, [])
        yield "function", node.args[0]


# --- writing ----------------------------------------------------------------------------------------


def _write(source: Source, kind: str, node: ast.AST, new: ast.AST | None) -> Mutant | None:
    """The module with a node's text replaced; the rest stays as it was written."""
    before = ast.unparse(node)
    after = ast.unparse(new) if new is not None else ""
    if before == after:
        return None
    assert isinstance(node, ast.expr | ast.stmt)
    start, end = source.span(node)
    put = after if isinstance(node, ast.stmt) else f"({after})"
    changed = source.text[:start] + put + source.text[end:]
    try:
        ast.parse(changed)
    except SyntaxError:
        return None
    return Mutant(kind, node.lineno, before, after, changed)
