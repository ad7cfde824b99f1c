"""Edits enumerated by the text alone: signs, operators, functions, powers, numbers, names, factors, terms.

They serve where nothing can be solved for: in functions that cannot be read (derived by SymPy, differentiated
by JAX, built as a CasADi graph), which are run with one edit after the other; and where operations that were
read are those of a class of the user's.
"""

from __future__ import annotations

import ast
import itertools
import time
from collections.abc import Iterator

from deltac.errors import InputError
from deltac.repair import sandbox
from deltac.repair.edits.candidates import (
    Candidate,
    apply,
    family,
    negated,
    number_cost,
    product,
    short,
    total,
    written,
)
from deltac.repair.edits.structural import regrouped
from deltac.repair.edits.substitutions import FAMILIES, SYMBOLS
from deltac.repair.tracing.samples import RIGHT, Samples
from deltac.repair.tracing.source import Source

MOST = 4000
"""Edits that are tried."""

AT_ONCE = 200
"""Edits that one process tries: what it imports is loaded once."""

NAMES = 24
"""Names and entries that are tried as others, or as factors."""

MARGIN = 0.25
"""Edits that cost this much more than the least one that is right are not tried."""

NEAR = 3
"""How far from an index others are tried."""

NUMBERS = (2, 3, 4, 0.5)
"""Factors that are forgotten."""


def found_by_running(
    source: Source, samples: Samples, deadline: float
) -> list[tuple[tuple[Candidate, ...], Source]]:
    """Single edits that make the function right where it is run, cheapest first, with what they make."""
    statements = sandbox.module_for(source.module, source.qualified.partition(".")[0]).body
    candidates = sorted(text_edits(source, statements), key=lambda c: (c.cost, c.place))
    found: list[tuple[tuple[Candidate, ...], Source]] = []
    tasks = _tasks(source, candidates)
    while some := list(itertools.islice(tasks, AT_ONCE)):
        limit = max(deadline - time.monotonic(), 1.0)
        answers = sandbox.stream([one for _, _, one in some], samples, limit)
        for (candidate, changed, _), answer in zip(some, answers):
            if time.monotonic() > deadline or (
                found and candidate.cost > found[0][0][0].cost + MARGIN
            ):
                answers.close()
                return found
            if isinstance(answer, str) or not samples.fits(answer):
                continue
            if samples.wrong(answer) < RIGHT:
                found.append(((candidate,), changed))
    return found


def _tasks(
    source: Source, candidates: list[Candidate]
) -> Iterator[tuple[Candidate, Source, sandbox.Task]]:
    """Each candidate with the source that it makes and what is run; those of one text once."""
    seen = {source.text}
    for candidate in candidates:
        changed = apply(source, [candidate])
        if changed is None or changed.text in seen:
            continue
        seen.add(changed.text)
        try:
            one = sandbox.task(changed)
        except InputError:  # no Python any more
            continue
        if one is not None and len(seen) <= MOST:
            yield candidate, changed, one


def text_edits(source: Source, statements: list[ast.stmt]) -> Iterator[Candidate]:
    """All single edits of some statements, in no order."""
    for statement in statements:
        if isinstance(statement, ast.Import | ast.ImportFrom):
            continue
        for node in ast.walk(statement):
            place = source.number.get(id(node))
            if place is None:
                continue
            if isinstance(node, ast.AugAssign):
                edits = _updates(source, node)
            elif isinstance(node, ast.expr) and _counts(source, place, node):
                edits = _edits(source, place, node)
            else:
                continue
            for text, words, kind, cost in edits:
                yield Candidate(place, text, words, kind, cost, None)


Edit = tuple[str, str, str, float]


def _counts(source: Source, place: int, node: ast.AST) -> bool:
    """Whether a node is an expression that is evaluated for its value: no target, annotation or callee."""
    if not isinstance(node, ast.expr) or isinstance(getattr(node, "ctx", None), ast.Store):
        return False
    parent = source.nodes[source.parent[place]]
    if isinstance(parent, ast.Call) and parent.func is node:
        return False
    if isinstance(parent, ast.Attribute | ast.Subscript | ast.keyword | ast.Starred):
        return isinstance(parent, ast.keyword)
    skipped = (ast.arg, ast.AnnAssign, ast.FunctionDef, ast.ClassDef, ast.JoinedStr, ast.Expr)
    return not isinstance(parent, skipped) or (
        isinstance(parent, ast.AnnAssign) and parent.value is node
    )


def _edits(source: Source, place: int, node: ast.expr) -> Iterator[Edit]:
    own = source.segment(node)
    match node:
        case ast.UnaryOp(op=ast.USub()):
            text = written(node.operand, source.segment(node.operand))
            yield text, f"{short(text)} enters with −, should be +", "sign", 1.0
        case ast.BinOp() if type(node.op) in SYMBOLS:
            yield from _binary(source, node)
        case ast.BinOp(op=ast.MatMult()):
            left, right = source.segment(node.left), source.segment(node.right)
            words = f"{short(own)}: the factors should be exchanged"
            yield f"({right}) @ ({left})", words, "order", 1.1
        case ast.Call():
            yield from _calls(source, node)
        case ast.Constant(value=(int() | float()) as value) if not isinstance(value, bool):
            for other in (0, 1, 2, 3, 4, 0.5, value + 1, value - 1, 2 * value, value / 2, -value):
                if other != value:
                    cost = number_cost(float(other))
                    yield repr(other), f"{own} should be {other!r}", "number", cost
        case ast.Constant(value=complex() as turned):
            for factor in (2, 0.5, -1):
                text = repr(turned * factor)
                yield text, f"{own} should be {text}", "number", 1.25
        case ast.Attribute(attr="T"):
            text = source.segment(node.value)
            yield text, f"{short(text)} should not be transposed", "order", 1.1
    if isinstance(node, ast.Name | ast.Attribute | ast.Subscript):
        yield from _names(source, place, node)
    if isinstance(node, ast.Subscript):
        yield from _indices(source, node)
    if not isinstance(node, ast.Constant | ast.List | ast.Tuple | ast.Dict | ast.Lambda):
        words = f"{short(own)} enters with +, should be −"
        yield negated(source, node), words, "sign", 1.1 + 0.1 * isinstance(node, ast.Name)
    if isinstance(node, ast.Name | ast.Attribute | ast.Subscript | ast.Call | ast.BinOp):
        square = written(ast.BinOp(node, ast.Pow(), ast.Constant(2)), f"{own}**2", f"({own})**2")
        yield square, f"{short(own)} should be {short(square)}", "power", 1.25
        yield from _factors(source, place, node)


def _updates(source: Source, node: ast.AugAssign) -> Iterator[Edit]:
    """Another operator in an update: x += y for x -= y, x *= y for x /= y, and the other way round."""
    others = {"+": ("-", "−"), "-": ("+", "+"), "*": ("/", "/"), "/": ("*", "*")}
    own = SYMBOLS.get(type(node.op), ("", ""))[0]
    if own in others:
        target, value = source.segment(node.target), source.segment(node.value)
        symbol, shown = others[own]
        words = f"{target} {own}= should be {target} {symbol}="
        if own in "+-":
            words = f"{short(value)} enters with {'+' if own == '+' else '−'}, should be {shown}"
        yield f"{target} {symbol}= {value}", words, "sign" if own in "+-" else "operator", 1.0


def _binary(source: Source, node: ast.BinOp) -> Iterator[Edit]:
    left, right = source.segment(node.left), source.segment(node.right)
    symbol = SYMBOLS[type(node.op)][0]
    for kind, (other, _) in SYMBOLS.items():
        if kind is type(node.op) or kind is ast.Pow:
            continue
        meant = ast.BinOp(node.left, kind(), node.right)
        text = written(meant, f"{left} {other} {right}", f"{left} {other} ({right})")
        signs = {symbol, other} == {"+", "-"}
        words = f"{short(source.segment(node))}: {symbol} should be {other}"
        yield text, words, "sign" if signs else "operator", 1.0 if signs else 1.1
    if symbol in "-/":
        swapped = ast.BinOp(node.right, node.op, node.left)
        text = written(swapped, f"{right} {symbol} {left}", f"({right}) {symbol} ({left})")
        yield text, f"{short(source.segment(node))} should be {short(text)}", "order", 1.1
    noun = "term" if symbol in "+-" else "factor"
    yield left, f"the {noun} {short(right)} should not be there", noun, 1.2
    if symbol in "+*":
        yield right, f"the {noun} {short(left)} should not be there", noun, 1.2
    for tree in regrouped(node):
        text = ast.unparse(ast.fix_missing_locations(tree))
        yield text, f"{short(source.segment(node))} should be {short(text)}", "order", 1.3


def _calls(source: Source, node: ast.Call) -> Iterator[Edit]:
    callee = source.segment(node.func)
    prefix, _, name = callee.rpartition(".")
    own = source.segment(node)
    arguments = [source.segment(a) for a in node.args]
    for others in FAMILIES:
        for other in others if name in others and prefix else ():
            if other != name:
                words = f"{short(own)}: {name} should be {other}"
                yield f"{prefix}.{other}({', '.join(arguments)})", words, "function", 1.05
    if len(arguments) == 1 and not node.keywords:
        yield arguments[0], f"{short(own)}: {name} should not be there", "function", 1.25
    if len(arguments) == 2 and not node.keywords:
        text = f"{callee}({arguments[1]}, {arguments[0]})"
        yield text, f"{short(own)}: the arguments should be exchanged", "order", 1.1
    if isinstance(node.func, ast.Attribute) and not arguments:
        text = source.segment(node.func.value)
        yield text, f"{short(own)}: {name} should not be there", "function", 1.2


def _names(source: Source, place: int, node: ast.expr) -> Iterator[Edit]:
    own = source.segment(node)
    for text in _known(source, place):
        if text != own:
            cost = 1.05 if family(text) == family(own) else 1.3
            yield text, f"{own} should be {text}", "name", cost


def _indices(source: Source, node: ast.Subscript) -> Iterator[Edit]:
    """Another whole number for an index, where the source does not have that entry elsewhere."""
    match node.slice:
        case ast.Constant(value=int() as own):
            for k in range(max(own - NEAR, 0), own + NEAR + 1):
                if k != own:
                    text = f"{source.segment(node.value)}[{k}]"
                    yield text, f"{source.segment(node)} should be {text}", "index", 1.1


def _factors(source: Source, place: int, node: ast.expr) -> Iterator[Edit]:
    """What is forgotten: a number or a name as a factor, a divisor or a term; of whole terms alone."""
    parent = source.nodes[source.parent[place]]
    if isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.Mult | ast.Div | ast.Pow):
        return
    own = short(source.segment(node))
    for number in NUMBERS:
        text = product(source, node, repr(number))
        yield text, f"{own} lacks the factor {number!r}", "factor", number_cost(number) + 0.1
    for name in _known(source, place):
        for divide, word in ((False, "factor"), (True, "divisor")):
            text = product(source, node, name, divide)
            yield text, f"{own} lacks the {word} {name}", "factor", 1.45
    if isinstance(parent, ast.BinOp):
        return
    known = _known(source, place)
    for term in (*known, *(f"{n}.{f}({n})" for f in _methods(source, place) for n in known)):
        for subtract, sign in ((False, "+"), (True, "−")):
            text = total(source, node, term, subtract)
            yield text, f"{own} lacks the term {sign} {term}", "term", 1.6


def _methods(source: Source, place: int) -> list[str]:
    """Methods of one argument that a statement calls: products of vectors of a class of the user's."""
    found = [
        n.func.attr
        for n in ast.walk(source.statement(place))
        if isinstance(n, ast.Call) and isinstance(n.func, ast.Attribute) and len(n.args) == 1
        if isinstance(n.func.value, ast.Name) and isinstance(n.args[0], ast.Name)
    ]
    return list(dict.fromkeys(found))


def _known(source: Source, place: int) -> list[str]:
    """Names and entries that the same function, or the module's statements, use as numbers."""
    parent = source.nodes[place]
    while place in source.parent:
        place = source.parent[place]
        parent = source.nodes[place]
        if isinstance(parent, ast.FunctionDef | ast.Lambda):
            break
    found: dict[str, None] = {}
    for node in ast.walk(parent):
        plain = isinstance(node, ast.Name | ast.Attribute) or (
            isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant)
        )
        if not plain or not isinstance(getattr(node, "ctx", None), ast.Load):
            continue
        k = source.number.get(id(node))
        if k is None or not _counts(source, k, node) or isinstance(node, ast.Attribute):
            continue
        found.setdefault(source.segment(node))
    return list(found)[:NAMES]
