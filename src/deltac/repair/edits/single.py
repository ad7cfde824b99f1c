"""All single edits of a node: what else could stand in its place.

One list for functions that are traced and for those that can only be run: signs, operators, functions,
powers, numbers, names, indices; matrices transposed, inverted, or multiplied by others.
Whether an edit is right is seen on the tape; of functions that are not traced, by running the text again.
"""

from __future__ import annotations

import ast
import itertools
from collections.abc import Collection, Iterator
from functools import partial
from typing import TypeAlias

from deltac.foreign.scripts import called
from deltac.repair.edits.candidates import (
    EditCandidate,
    EditSet,
    family,
    functions_used,
    negated,
    number_cost,
    product,
    short,
    stem,
    total,
    variable,
)
from deltac.repair.edits.names import Names
from deltac.repair.tracing.source import Source

FAMILIES = (
    ("sin", "cos", "tan"),
    ("arcsin", "arccos", "arctan"),
    ("asin", "acos", "atan"),
    ("sinh", "cosh", "tanh"),
    ("sqrt", "square", "abs", "exp", "log", "sign"),
    ("maximum", "minimum"),
)
"""Functions that are mistaken for each other."""

NOT_IN_MATH = ("square", "abs", "sign")

SYMBOLS: dict[type[ast.operator], str] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**",
}  # fmt: skip

SIGNS = {"+": "+", "-": "−"}


Edits: TypeAlias = Iterator[EditCandidate]


def edits(source: Source, place: int, names: Names) -> Edits:
    """Edits of an expression that is evaluated."""
    node = source.nodes[place]
    edit = partial(EditCandidate, source, place)
    own = short(source.segment(node))
    match node:
        case ast.UnaryOp(op=ast.USub()):
            operand = short(source.segment(node.operand))
            yield edit(node.operand, "sign", 1.0, f"{operand} enters with −, should be +")
        case ast.expr() if not isinstance(node, ast.Constant | ast.List | ast.Tuple):
            cost = 1.1 + _oddity(source, place, node, names)
            yield edit(negated(node), "sign", cost, f"{own} enters with +, should be −")
    match node:
        case ast.BinOp():
            yield from _operators(source, place, node)
        case ast.Call():
            yield from _functions(source, place, node)
        case ast.Constant(value=int() | float()) if not isinstance(node.value, bool):
            yield from _numbers(source, place, node, names)
        case ast.Attribute(attr="T"):
            text = short(source.segment(node.value))
            yield edit(node.value, "order", 1.0, f"{text} should not be transposed")
    if isinstance(node, ast.Name | ast.Attribute | ast.Subscript):
        shape = names.shape(place)
        others = [text for text, other in names.arrays(place).items() if other == shape]
        for text in others if shape else names.numbers(place):
            if text != source.segment(node):
                alike = family(text) == family(source.segment(node))
                cost = 1.0 if alike else 1.15 if stem(text) == stem(own) else 1.3
                entry = alike and isinstance(node, ast.Subscript)
                yield edit(variable(text), "index" if entry else "name", cost)
    if isinstance(node, ast.Name | ast.Attribute | ast.Subscript | ast.Call | ast.BinOp):
        yield edit(ast.BinOp(node, ast.Pow(), ast.Constant(2)), "power", 1.2)
        yield from _applied(source, place, node)
    if isinstance(node, ast.Name | ast.Attribute | ast.Subscript | ast.Call):
        yield from _arrays(source, place, node, names)


def smaller_indices(source: Source, lines: Collection[int]) -> Iterator[EditSet]:
    """Smaller numbers for the indices in lines where one is out of range, one at a time."""
    for place, node in enumerate(source.nodes):
        if not isinstance(node, ast.Subscript):
            continue
        if any(node.lineno <= line <= (node.end_lineno or 0) for line in lines):
            entries = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
            for k, entry in enumerate(entries):
                own = entry.value if isinstance(entry, ast.Constant) else None
                for index in range(own) if isinstance(own, int) else ():
                    some: list[ast.expr] = [*entries[:k], ast.Constant(index), *entries[k + 1 :]]
                    new = some[0] if len(some) == 1 else ast.Tuple(some, ast.Load())
                    tree = ast.Subscript(node.value, new, node.ctx)
                    yield (EditCandidate(source, place, tree, "index", 1.0),)


def additions(source: Source, place: int, names: Names) -> Edits:
    """What is forgotten beside a node: a name or 2 as a factor or a divisor, or a term."""
    node = source.nodes[place]
    if not isinstance(node, ast.expr) or isinstance(node, ast.Constant):
        return
    edit = partial(EditCandidate, source, place)
    parent = source.nodes[source.parent[place]]
    outer = type(parent.op) if isinstance(parent, ast.BinOp) else None
    own, shape, arrays = short(source.segment(node)), names.shape(place), names.arrays(place)
    alike = [text for text, other in arrays.items() if other == shape]
    if outer not in (ast.Mult, ast.Div, ast.Pow):
        factors = {text: variable(text) for text in (*names.numbers(place), *alike)}
        for text, factor in {**factors, "2": ast.Constant(2)}.items():
            yield edit(product(node, factor), "factor", 1.6, f"{own} lacks the factor {text}")
            divided = f"{own} must be divided by {text}"
            yield edit(product(node, factor, True), "factor", 1.6, divided)
    if outer not in (ast.Add, ast.Sub):
        terms: list[ast.expr] = [variable(t) for t in (alike if shape else names.numbers(place))]
        if shape and len(shape) == 1:
            terms += [
                ast.BinOp(variable(matrix), ast.MatMult(), variable(vector))
                for (matrix, size), (vector, other) in itertools.product(arrays.items(), repeat=2)
                if size == (*shape, *other)
            ]
        for term, (subtract, sign) in itertools.product(terms, ((False, "+"), (True, "−"))):
            words = f"{own} lacks the term {sign} {ast.unparse(term)}"
            yield edit(total(node, term, subtract), "term", 1.5 if shape else 1.75, words)


# --- expressions ----------------------------------------------------------------------------------


def _oddity(source: Source, place: int, node: ast.expr, names: Names) -> float:
    """How odd a minus is here: a factor's sign is that of its product, and a length's is not forgotten."""
    parent = source.nodes[source.parent[place]]
    factor = isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.Mult | ast.Div)
    first = factor and parent.left is node  # type: ignore[attr-defined]
    return 0.02 * factor + 0.05 * (factor and not first) + 0.15 * names.constant(place)


def _operators(source: Source, place: int, node: ast.BinOp) -> Edits:
    """Another operator, operands exchanged, one of them left out."""
    edit = partial(EditCandidate, source, place)
    first, second = (short(source.segment(part)) for part in (node.left, node.right))
    own, symbol = short(source.segment(node)), SYMBOLS.get(type(node.op), "")
    if isinstance(node.op, ast.MatMult):
        words = f"{own}: the factors should be exchanged"
        yield edit(ast.BinOp(node.right, node.op, node.left), "order", 1.1, words)
    if not symbol:
        return
    for op, other in SYMBOLS.items():
        if other == symbol or (other == "**" and not isinstance(node.right, ast.Constant)):
            continue
        kind, words = "operator", f"{own}: {symbol} should be {other}"
        if symbol in SIGNS and other in SIGNS:
            kind = "sign"
            words = f"{second} enters with {SIGNS[symbol]}, should be {SIGNS[other]}"
        yield edit(ast.BinOp(node.left, op(), node.right), kind, 1.0, words)
    if symbol in "-/":
        yield edit(ast.BinOp(node.right, node.op, node.left), "order", 1.0)
    part = "term" if symbol in SIGNS else "factor"
    noun = "exponent" if symbol == "**" else part
    yield edit(node.left, part, 1.3, f"the {noun} {second} should not be there")
    if symbol == "-":
        yield edit(negated(node.right), part, 1.4, f"the term {first} should not be there")
    if symbol != "**":
        yield edit(node.right, part, 1.3, f"the {noun} {first} should not be there")


def _functions(source: Source, place: int, node: ast.Call) -> Edits:
    """Another function of the same family, or none."""
    edit = partial(EditCandidate, source, place)
    name, arguments = called(node), node.args
    own = short(source.segment(node))
    if node.keywords or any(isinstance(a, ast.Starred) for a in arguments) or name == "range":
        return
    for other in next((group for group in FAMILIES if name in group), ()):
        callee = _callee(source, node.func, other)
        if other != name and callee is not None:
            new = ast.Call(callee, arguments, [])
            yield edit(new, "function", 1.0, f"{own}: {name} should be {other}")
    nothing = f"{own}: {name} should not be there"
    if len(arguments) == 1:
        yield edit(arguments[0], "function", 1.2, nothing)


def _callee(source: Source, like: ast.expr, name: str) -> ast.expr | None:
    """How a function is called beside another: np.cos where there is np.sin; None where it cannot be."""
    if isinstance(like, ast.Attribute):
        math = isinstance(like.value, ast.Name) and like.value.id == "math"
        return None if math and name in NOT_IN_MATH else ast.Attribute(like.value, name, ast.Load())
    return variable(name) if name in source.user_module.setters else None


def _applied(source: Source, place: int, node: ast.expr) -> Edits:
    """A sine, a cosine, a root, or another unit of what is there."""
    functions = functions_used(source)
    for name in ("sin", "cos", "tan", "tanh", "sqrt", "radians", "degrees") if functions else ():
        like = ast.parse(functions.get(name) or next(iter(functions.values())), mode="eval").body
        callee = variable(functions[name]) if name in functions else _callee(source, like, name)
        if callee is not None:
            yield EditCandidate(source, place, ast.Call(callee, [node], []), "function", 1.3)


def _numbers(source: Source, place: int, node: ast.Constant, names: Names) -> Edits:
    """Other small numbers (any other is found from the value that is required), or a name."""
    own = node.value
    assert isinstance(own, int | float)
    others = (0, 1, 2, 3, 4, 0.5, own + 1, own - 1, 2 * own, own / 2, -own)
    for other in dict.fromkeys(others):
        if other != own:
            cost = number_cost(float(other))
            new = ast.Constant(other) if other >= 0 else negated(ast.Constant(-other))
            yield EditCandidate(source, place, new, "number", cost)
    if not isinstance(source.owner(place), ast.Module):
        for text in names.numbers(place):
            yield EditCandidate(source, place, variable(text), "name", 1.4)


# --- arrays ---------------------------------------------------------------------------------------


def _arrays(source: Source, place: int, node: ast.expr, names: Names) -> Edits:
    """What stands for an array: transposed, inverted, turned by a matrix or a function in scope."""
    edit = partial(EditCandidate, source, place)
    shape, own = names.shape(place), short(source.segment(node))
    if not shape:
        return
    inverse = _inverse(source)
    if len(shape) == 2:
        transposed = ast.Attribute(node, "T", ast.Load())
        yield edit(transposed, "order", 1.0, f"{own} should be transposed")
    if len(shape) == 2 and shape[0] == shape[1] and inverse is not None:
        yield edit(ast.Call(inverse, [node], []), "function", 1.4, f"{own} should be inverted")
    for text, other in names.arrays(place).items():
        if other == (shape[0], shape[0]):
            inverted = [] if inverse is None else [ast.Call(inverse, [variable(text)], [])]
            for matrix in (variable(text), *inverted):
                words = f"{own} lacks the factor {ast.unparse(matrix)}"
                yield edit(ast.BinOp(matrix, ast.MatMult(), node), "factor", 1.35, words)


def _inverse(source: Source) -> ast.expr | None:
    """How this source calls the inverse of a matrix."""
    for node in source.nodes:
        if isinstance(node, ast.Attribute) and node.attr in ("inv", "solve"):
            return ast.Attribute(node.value, "inv", ast.Load())
    return None
