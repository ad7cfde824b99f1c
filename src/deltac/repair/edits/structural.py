"""Edits of structure: what a tape of numbers cannot show, so that the text is read again for each.

Slices, indices and bounds of loops; matrices transposed or inverted, products in another order; assignments
that should add; arguments and statements exchanged; parentheses elsewhere; sine and cosine exchanged in a
whole statement. They are few for each node, and reading a function takes milliseconds.
"""

from __future__ import annotations

import ast
import copy
import itertools
from collections.abc import Iterator

import numpy as np

from deltac.repair.edits.candidates import Candidate, array_names, short
from deltac.repair.tracing.program import Program

SUPERFLUOUS = {"inv", "pinv", "transpose", "radians", "deg2rad", "degrees", "rad2deg", "diag"}
"""Functions that are called where they should not be."""

LONGEST = 400
"""Characters of a node that is written anew."""


def structural(program: Program) -> Iterator[Candidate]:
    """All edits of structure of the nodes that the function evaluates, the plainest kinds first."""
    source = program.source
    read = set(program.trace.instances)
    statements = {source.number[id(source.statement(place))] for place in read}
    for place in sorted(statements):
        node = source.nodes[place]
        if isinstance(node, ast.stmt):
            yield from _statements(program, place, node)
    for place, node in enumerate(source.nodes):
        if not isinstance(node, ast.expr) or not hasattr(node, "lineno"):
            continue
        if not _within(program, place, statements):
            continue
        if isinstance(getattr(node, "ctx", None), ast.Store) and not isinstance(
            node, ast.Subscript
        ):
            continue
        yield from _expressions(program, place, node)


def _within(program: Program, place: int, statements: set[int]) -> bool:
    """Whether a node is in one of the statements that are read, loops' heads and conditions included."""
    source = program.source
    statement = source.statement(place)
    if source.number[id(statement)] in statements:
        return True
    return isinstance(statement, ast.For | ast.If | ast.While) and any(
        source.number[id(inner)] in statements
        for inner in ast.walk(statement)
        if isinstance(inner, ast.stmt) and inner is not statement
    )


def _rewritten(
    program: Program,
    place: int,
    node: ast.AST,
    new: ast.AST,
    kind: str,
    cost: float,
    words: str = "",
) -> Candidate | None:
    """A node written anew; its parts keep the text that they have where they are not changed."""
    text = ast.unparse(ast.fix_missing_locations(new))
    own = program.source.segment(node)
    if len(text) > LONGEST or text == own:
        return None
    return Candidate(
        place, text, words or f"{short(own)} should be {short(text)}", kind, cost, None
    )


# --- statements -----------------------------------------------------------------------------------


def _statements(program: Program, place: int, node: ast.stmt) -> Iterator[Candidate]:
    source = program.source
    own = source.segment(node)
    if len(own) > LONGEST:
        return
    if isinstance(node, ast.Assign) and len(node.targets) == 1:
        target = source.segment(node.targets[0])
        value = source.segment(node.value)
        if isinstance(node.targets[0], ast.Name | ast.Subscript | ast.Attribute):
            for symbol in ("+", "-"):
                words = f"{target} = should be {target} {symbol}="
                yield Candidate(place, f"{target} {symbol}= {value}", words, "operator", 1.1, None)
    if isinstance(node, ast.AugAssign):
        target, value = source.segment(node.target), source.segment(node.value)
        for text in (f"{target} = {value}", f"{target} = -({value})"):
            words = f"{target} is added to, and should be set: {text}"
            yield Candidate(place, text, words, "operator", 1.15, None)
    sines = [n for n in ast.walk(node) if isinstance(n, ast.Call) and _name(n) in ("sin", "cos")]
    if len(sines) > 1:
        swapped = copy.deepcopy(node)
        for n in ast.walk(swapped):
            if isinstance(n, ast.Call) and _name(n) in ("sin", "cos"):
                _rename(n, "cos" if _name(n) == "sin" else "sin")
        words = f"{short(own)}: sin and cos should be exchanged"
        found = _rewritten(program, place, node, swapped, "function", 1.4, words)
        if found is not None:
            yield found


# --- expressions ----------------------------------------------------------------------------------


def _expressions(program: Program, place: int, node: ast.expr) -> Iterator[Candidate]:
    match node:
        case ast.Subscript():
            yield from _subscripts(program, place, node)
        case ast.Call():
            yield from _calls(program, place, node)
        case ast.BinOp():
            yield from _products(program, place, node)
            yield from _parentheses(program, place, node)
        case ast.Compare():
            yield from _comparisons(program, place, node)
        case ast.Attribute() if node.attr == "T":
            own = program.source.segment(node.value)
            yield Candidate(
                place, own, f"{short(own)} should not be transposed", "order", 1.0, None
            )
    yield from _arrays(program, place, node)


def _arrays(program: Program, place: int, node: ast.expr) -> Iterator[Candidate]:
    """What stands for a matrix: transposed, inverted, or another array of this scope."""
    instances = program.trace.instances.get(place, [])
    if not instances or not isinstance(instances[0].value, np.ndarray):
        return
    value, own = instances[0].value, program.source.segment(node)
    simple = isinstance(node, ast.Name | ast.Attribute | ast.Subscript | ast.Call)
    if value.ndim == 2 and simple:
        yield Candidate(place, f"{own}.T", f"{short(own)} should be transposed", "order", 1.1, None)
        if value.shape[0] == value.shape[1]:
            inverse = _inverse(program)
            if inverse is not None:
                text = f"{inverse}({own})"
                words = f"{short(own)} should be inverted: {short(text)}"
                yield Candidate(place, text, words, "function", 1.4, None)
    if value.ndim == 1 and simple:
        inverse = _inverse(program)
        for text, matrix in array_names(program, instances[0]).items():
            if matrix.shape == (len(value), len(value)):
                inverted = [f"{inverse}({text})"] if inverse is not None else []
                for factor in (text, *inverted):
                    words = f"{short(own)} lacks the factor {factor}"
                    yield Candidate(place, f"{factor} @ {own}", words, "factor", 1.35, None)
    if simple and not isinstance(node, ast.Call):
        for callee in _mapping(program, value.shape):
            text = f"{callee}({own})"
            yield Candidate(place, text, f"{own} should be {text}", "function", 1.35, None)
    if value.ndim == 1 and isinstance(node, ast.BinOp | ast.Name | ast.UnaryOp):
        for text in _forgotten(program):
            for symbol in "-+":
                words = f"{short(own)} lacks the term {'−' if symbol == '-' else '+'} {text}"
                yield Candidate(place, f"{own} {symbol} {text}", words, "term", 1.5, None)
    if isinstance(node, ast.Name | ast.Attribute | ast.Subscript):
        for text, other in array_names(program, instances[0]).items():
            if text != own and other.shape in (value.shape, value.shape[::-1]):
                words = f"{short(own)} should be {short(text)}"
                yield Candidate(place, text, words, "name", 1.1, None)


def _mapping(program: Program, shape: tuple[int, ...]) -> list[str]:
    """Functions of one argument that this source applies to an array of a shape, and that keep it."""
    source, instances = program.source, program.trace.instances
    found: dict[str, None] = {}
    for place, node in enumerate(source.nodes):
        if isinstance(node, ast.Call) and len(node.args) == 1 and not node.keywords:
            parts = [instances.get(k, ()) for k in (place, source.number[id(node.args[0])])]
            if all(some and np.shape(some[0].value) == shape for some in parts):
                found[source.segment(node.func)] = None
    return [name for name in found if name.rpartition(".")[2] not in ("array", "asarray", "copy")]


def _forgotten(program: Program) -> Iterator[str]:
    """Calls of functions and methods of the source that nothing calls, with arguments of their own names."""
    source = program.source
    called = {_name(n) for n in source.nodes if isinstance(n, ast.Call)}
    for place, node in enumerate(source.nodes):
        if (
            not isinstance(node, ast.FunctionDef)
            or node.name in {*called, *source.qualified.split(".")}
            or node.name.startswith("__")
        ):
            continue
        inside = isinstance(source.nodes[source.parent[place]], ast.ClassDef)
        names = [a.arg for a in node.args.args]
        if inside and names:
            yield f"{names[0]}.{node.name}({', '.join(names[1:])})"
        elif not inside:
            yield f"{node.name}({', '.join(names)})"


def _inverse(program: Program) -> str | None:
    """How this source writes the inverse of a matrix."""
    for node in program.source.nodes:
        if isinstance(node, ast.Attribute) and node.attr in ("inv", "solve"):
            return f"{program.source.segment(node.value)}.inv"
    names = {n.id for n in program.source.nodes if isinstance(n, ast.Name)}
    return next((f"{name}.linalg.inv" for name in ("np", "jnp", "numpy") if name in names), None)


def _subscripts(program: Program, place: int, node: ast.Subscript) -> Iterator[Candidate]:
    """Other bounds of a slice, other indices, other variables of loops in them; a sum for one entry."""
    counters = _counters(program, place)
    if (
        isinstance(node.slice, ast.Name)
        and node.slice.id in counters
        and isinstance(node.ctx, ast.Load)
    ):
        own, k = program.source.segment(node.value), node.slice.id
        for text in (f"sum({own}[{k}:])", f"sum({own}[: {k} + 1])", f"sum({own}[{k} + 1 :])"):
            words = f"{program.source.segment(node)} should be {text}"
            yield Candidate(place, text, words, "term", 1.4, None)
    yield from _permuted(program, place, node)
    own = program.source.segment(node)
    for text in (*_other_slices(program, node), *_other_bases(program, place, node)):
        if text != own:
            yield Candidate(place, text, f"{own} should be {text}", "index", 1.05, None)
    for spot, kind in _index_parts(node.slice):
        for new in _other_indices(program, place, spot, kind):
            changed = copy.deepcopy(node)
            _put(changed, _path(node, spot), new)
            found = _rewritten(program, place, node, changed, "index", _index_cost(spot, new))
            if found is not None:
                yield found


def _permuted(program: Program, place: int, node: ast.Subscript) -> Iterator[Candidate]:
    """The variables that index an array in another order: D[i][k][j] or D[i, k, j] for D[i][j][k]."""
    parent = program.source.nodes[program.source.parent[place]]
    if isinstance(parent, ast.Subscript) and parent.value is node:
        return
    changed = copy.deepcopy(node)
    names: list[ast.Name] = []
    inner: ast.expr = changed
    while isinstance(inner, ast.Subscript):
        part = inner.slice
        names += [e for e in (part.elts if isinstance(part, ast.Tuple) else [part])
                  if isinstance(e, ast.Name)]  # fmt: skip
        inner = inner.value
    own = [n.id for n in names]
    if not 2 <= len(own) <= 3:
        return
    for order in dict.fromkeys(itertools.permutations(own)):
        for name, meant in zip(names, order):
            name.id = meant
        found = _rewritten(program, place, node, changed, "index", 1.1)
        if found is not None:
            yield found


def _other_slices(program: Program, node: ast.Subscript) -> list[str]:
    """Other slices of the same array that this source takes."""
    source = program.source
    if not isinstance(node.slice, ast.Slice | ast.Tuple):
        return []
    base = source.segment(node.value)
    found = [
        source.segment(other)
        for other in source.nodes
        if isinstance(other, ast.Subscript)
        and isinstance(other.slice, ast.Slice | ast.Tuple)
        and source.segment(other.value) == base
    ]
    return list(dict.fromkeys(found))


def _other_bases(program: Program, place: int, node: ast.Subscript) -> Iterator[str]:
    """The same part of other arrays of this scope."""
    instances = program.trace.instances.get(place, [])
    base, own = program.source.segment(node.value), program.source.segment(node)
    if instances and isinstance(instances[0].value, np.ndarray):
        arrays = array_names(program, instances[0])
        for text, other in arrays.items():
            if text != base and base in arrays and other.shape == arrays[base].shape:
                yield text + own[len(base) :]


def _index_parts(node: ast.expr) -> Iterator[tuple[ast.expr, str]]:
    """The parts of an index, with what each is: an index, or an end of a slice."""
    parts = node.elts if isinstance(node, ast.Tuple) else [node]
    for part in parts:
        if isinstance(part, ast.Slice):
            for end in (part.lower, part.upper):
                if end is not None:
                    yield end, "end"
        elif not (isinstance(part, ast.Constant) and not isinstance(part.value, int)):
            yield part, "index"


def _other_indices(program: Program, place: int, spot: ast.expr, kind: str) -> Iterator[ast.expr]:
    own = ast.unparse(spot)
    texts: list[str] = []
    if isinstance(spot, ast.Constant) and isinstance(spot.value, int):
        texts += [str(k) for k in range(max(spot.value - 3, 0), spot.value + 4)]
    names = _counters(program, place)
    for name in names:
        texts += [name, f"{name} + 1", f"{name} - 1"]
    if isinstance(spot, ast.Name | ast.BinOp):
        texts += [f"{own} + 1", f"{own} - 1"]
        if isinstance(spot, ast.BinOp):
            texts.append(ast.unparse(spot.left))
    for text in dict.fromkeys(texts):
        if text != own:
            yield ast.parse(text, mode="eval").body


def _index_cost(spot: ast.expr, new: ast.expr) -> float:
    plain = isinstance(new, ast.Constant) == isinstance(spot, ast.Constant)
    return (1.0 if plain else 1.15) + 0.1 * isinstance(new, ast.BinOp)


def _counters(program: Program, place: int) -> list[str]:
    """Variables of the loops and comprehensions around a node."""
    source = program.source
    found: list[str] = []
    while place in source.parent:
        place = source.parent[place]
        node = source.nodes[place]
        targets = [node.target] if isinstance(node, ast.For) else []
        if isinstance(node, ast.ListComp | ast.GeneratorExp):
            targets = [g.target for g in node.generators]
        found += [n.id for t in targets for n in ast.walk(t) if isinstance(n, ast.Name)]
    return list(dict.fromkeys(found))


def _calls(program: Program, place: int, node: ast.Call) -> Iterator[Candidate]:
    """Arguments in another order, other bounds of a range, a transformation left out."""
    source = program.source
    name = _name(node)
    if name == "range":
        yield from _ranges(program, place, node)
        return
    arguments = [source.segment(a) for a in node.args]
    callee = source.segment(node.func)
    for i, j in itertools.combinations(range(min(len(arguments), 6)), 2):
        if arguments[i] == arguments[j] or node.keywords or isinstance(node.args[j], ast.Starred):
            continue
        swapped = list(arguments)
        swapped[i], swapped[j] = swapped[j], swapped[i]
        both = f"{short(arguments[i], 30)} and {short(arguments[j], 30)}"
        words = f"{short(source.segment(node))}: {both} should be exchanged"
        yield Candidate(place, f"{callee}({', '.join(swapped)})", words, "order", 1.1, None)
    if name in SUPERFLUOUS and len(arguments) == 1:
        words = f"{short(source.segment(node))}: {name} should not be there"
        yield Candidate(place, arguments[0], words, "function", 1.1, None)
    if name == "solve" and len(arguments) == 2:
        text = f"{callee}({arguments[0]}.T, {arguments[1]})"
        words = f"{short(arguments[0])} should be transposed"
        yield Candidate(place, text, words, "order", 1.2, None)
    for k, argument in enumerate(node.args):
        if isinstance(argument, ast.Constant | ast.Name) and len(arguments) <= 6:
            yield from _other_arguments(program, place, node, k)


def _other_arguments(program: Program, place: int, node: ast.Call, k: int) -> Iterator[Candidate]:
    """Another of the call's own arguments in the place of one: f(a, a) for f(a, b)."""
    source = program.source
    arguments = [source.segment(a) for a in node.args]
    if node.keywords or any(isinstance(a, ast.Starred) for a in node.args):
        return
    for other in dict.fromkeys(arguments):
        if other != arguments[k]:
            changed = [*arguments[:k], other, *arguments[k + 1 :]]
            text = f"{source.segment(node.func)}({', '.join(changed)})"
            words = f"{arguments[k]} should be {short(other)}"
            yield Candidate(place, text, words, "name", 1.2, None)


def _ranges(program: Program, place: int, node: ast.Call) -> Iterator[Candidate]:
    source = program.source
    own = [source.segment(a) for a in node.args]
    ends = own if len(own) >= 2 else ["0", *own]
    first, last, *step = ends
    counters = _counters(program, source.parent[place])
    used = [n.id for n in ast.walk(node) if isinstance(n, ast.Name)]
    texts = []
    near = [*counters, *(f"{c} + 1" for c in counters)]
    for low in dict.fromkeys([first, "0", "1", f"{first} + 1", *near, *used]):
        for high in dict.fromkeys([last, f"{last} - 1", f"{last} + 1", *near]):
            parts = [low, high, *step] if low != "0" or step else [high]
            texts.append(f"range({', '.join(parts)})")
    pairs = [(i, j) for i, j in itertools.permutations(dict.fromkeys([*counters, *used]), 2)]
    texts += [f"range(max({i}, {j}), {last})" for i, j in pairs]
    for text in dict.fromkeys(texts):
        if text != source.segment(node):
            words = f"{source.segment(node)} should be {text}"
            yield Candidate(place, text, words, "index", 1.2 + 0.005 * len(text), None)


def _products(program: Program, place: int, node: ast.BinOp) -> Iterator[Candidate]:
    """A matrix product in another order, or with one factor transposed."""
    if not isinstance(node.op, ast.MatMult):
        return
    source = program.source
    left, right = source.segment(node.left), source.segment(node.right)
    words = f"{short(source.segment(node))}: the factors should be exchanged"
    yield Candidate(place, f"({right}) @ ({left})", words, "order", 1.1, None)


def _parentheses(program: Program, place: int, node: ast.BinOp) -> Iterator[Candidate]:
    """The same with parentheses elsewhere: (a + b) c for a + b c, a / (b c) for a / b c, (a b)² for a b²."""
    for other in regrouped(node):
        found = _rewritten(program, place, node, other, "order", 1.25)
        if found is not None:
            yield found


def regrouped(node: ast.BinOp) -> Iterator[ast.expr]:
    """Other trees over the same operands and operators in the same order."""
    left, right = node.left, node.right
    if isinstance(left, ast.BinOp):
        yield ast.BinOp(left.left, left.op, ast.BinOp(left.right, node.op, right))
        if isinstance(left.left, ast.BinOp):
            inner = left.left
            tail = ast.BinOp(ast.BinOp(inner.right, left.op, left.right), node.op, right)
            yield ast.BinOp(inner.left, inner.op, tail)
    if isinstance(right, ast.BinOp):
        yield ast.BinOp(ast.BinOp(left, node.op, right.left), right.op, right.right)
        if isinstance(right.left, ast.BinOp):
            inner = right.left
            head = ast.BinOp(ast.BinOp(left, node.op, inner.left), inner.op, inner.right)
            yield ast.BinOp(head, right.op, right.right)
    for side, other in ((left, right), (right, left)):
        if isinstance(side, ast.UnaryOp) and isinstance(side.op, ast.USub):
            operands = (side.operand, other) if side is left else (other, side.operand)
            yield ast.UnaryOp(ast.USub(), ast.BinOp(operands[0], node.op, operands[1]))
    if isinstance(node.op, ast.Pow) and isinstance(left, ast.BinOp):
        yield ast.BinOp(left.left, left.op, ast.BinOp(left.right, ast.Pow(), right))


def _comparisons(program: Program, place: int, node: ast.Compare) -> Iterator[Candidate]:
    if len(node.ops) != 1:
        return
    own = type(node.ops[0])
    for op in (ast.Lt, ast.LtE, ast.Gt, ast.GtE, ast.Eq, ast.NotEq):
        if op is not own:
            changed = ast.Compare(node.left, [op()], node.comparators)
            found = _rewritten(program, place, node, changed, "operator", 1.0)
            if found is not None:
                yield found


# --- helpers --------------------------------------------------------------------------------------


def _name(node: ast.Call) -> str:
    return node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")


def _rename(node: ast.Call, name: str) -> None:
    if isinstance(node.func, ast.Attribute):
        node.func.attr = name
    elif isinstance(node.func, ast.Name):
        node.func.id = name


def _path(root: ast.AST, wanted: ast.AST) -> list[tuple[str, int | None]]:
    """The fields that lead from a node to one below it."""
    for field, value in ast.iter_fields(root):
        for k, child in enumerate(value) if isinstance(value, list) else [(None, value)]:
            if child is wanted:
                return [(field, k)]
            if isinstance(child, ast.AST):
                below = _path(child, wanted)
                if below:
                    return [(field, k), *below]
    return []


def _put(root: ast.AST, path: list[tuple[str, int | None]], new: ast.expr) -> None:
    """Put a node in the place that a path leads to."""
    for field, k in path[:-1]:
        root = getattr(root, field) if k is None else getattr(root, field)[k]
    field, k = path[-1]
    if k is None:
        setattr(root, field, new)
    else:
        getattr(root, field)[k] = new
