"""Edits that put something else in the place of what is there: signs, operators, names, functions."""

from __future__ import annotations

import ast
import copy
from collections.abc import Iterator
from typing import Any

import numpy as np

from deltac.repair.edits.candidates import (
    Candidate,
    compose,
    family,
    instead,
    negated,
    number_cost,
    short,
    slots,
    stem,
    values,
    vocabulary,
    written,
)
from deltac.repair.tracing.program import Program
from deltac.repair.tracing.tape import BINARY, ELEMENTARY, Change, Slot, identity

SYMBOLS: dict[type[ast.operator], tuple[str, str]] = {
    ast.Add: ("+", "add"),
    ast.Sub: ("-", "sub"),
    ast.Mult: ("*", "mul"),
    ast.Div: ("/", "truediv"),
    ast.Pow: ("**", "pow"),
}

FAMILIES = (
    ("sin", "cos", "tan"),
    ("arcsin", "arccos", "arctan"),
    ("asin", "acos", "atan"),
    ("sinh", "cosh", "tanh"),
    ("sqrt", "square", "abs", "exp", "log", "sign"),
    ("maximum", "minimum"),
)


def substitutions(program: Program, place: int) -> Iterator[Candidate]:
    """All edits of one node that put something else in its place."""
    node = program.source.nodes[place]
    if not slots(program, place):
        return
    yield from _signs(program, place, node)
    match node:
        case ast.BinOp() if type(node.op) in SYMBOLS:
            yield from _operators(program, place, node)
        case ast.AugAssign() if type(node.op) in SYMBOLS:
            yield from _updates(program, place, node)
        case ast.Call():
            yield from _functions(program, place, node)
        case ast.Name() | ast.Attribute() | ast.Subscript():
            yield from _transposed(program, place, node)
            yield from _names(program, place, node)
        case ast.Constant():
            yield from _constants(program, place, node)
            if not isinstance(program.owner(place), ast.Module):
                yield from _name_for_number(program, place, node)
    if isinstance(node, ast.Name | ast.Attribute | ast.Subscript | ast.Call | ast.BinOp):
        yield from _more(program, place, node)


def _signs(program: Program, place: int, node: ast.AST) -> Iterator[Candidate]:
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        own = program.source.segment(node.operand)
        text = written(node.operand, own)
        words = f"{short(own)} enters with −, should be +"
        yield Candidate(place, text, words, "sign", 1.0, compose(program, place, np.negative))
    elif isinstance(node, ast.expr) and not isinstance(node, ast.Constant):
        own = program.source.segment(node)
        words = f"{short(own)} enters with +, should be −"
        text = negated(program.source, node)
        cost = 1.1 + _odd_to_negate(program, place, node)
        yield Candidate(place, text, words, "sign", cost, compose(program, place, np.negative))


def _odd_to_negate(program: Program, place: int, node: ast.expr) -> float:
    """How odd a minus is here: a factor's sign is that of its product, and a length's is not forgotten."""
    source = program.source
    parent = source.nodes[source.parent[place]]
    factor = isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.Mult | ast.Div)
    constant = not any(program.tape.varying[k] for k in slots(program, place))
    first = factor and parent.left is node  # type: ignore[attr-defined]
    return 0.02 * factor + 0.05 * (factor and not first) + 0.15 * constant


def _operators(program: Program, place: int, node: ast.BinOp) -> Iterator[Candidate]:
    """Another operator, its operands exchanged, one of them left out."""
    source, tape = program.source, program.tape
    own = slots(program, place)
    symbol, name = SYMBOLS[type(node.op)]
    if any(tape.operations[k] is not BINARY[name] for k in own):
        return
    left, right = source.segment(node.left), source.segment(node.right)

    def change(operation: Any, order: tuple[int, ...]) -> dict[int, Change]:
        return {k: Change(operation, tuple(tape.inputs[k][i] for i in order)) for k in own}

    for kind, (other, operation) in SYMBOLS.items():
        if kind is type(node.op) or (kind is ast.Pow and not isinstance(node.right, ast.Constant)):
            continue
        signs = {symbol, other} == {"+", "-"}
        if signs:
            had, due = ("+", "−") if symbol == "+" else ("−", "+")
            words = f"{short(right)} enters with {had}, should be {due}"
        else:
            words = f"{short(source.segment(node))}: {symbol} should be {other}"
        yield Candidate(
            place,
            _with_operator(program, node, symbol, other, kind()),
            words,
            "sign" if signs else "operator",
            1.0,
            change(BINARY[operation], (0, 1)),
        )
    if symbol in ("-", "/"):
        swapped = ast.BinOp(node.right, node.op, node.left)
        text = written(swapped, f"{right} {symbol} {left}", f"({right}) {symbol} ({left})")
        words = f"{short(source.segment(node))} should be {short(text)}"
        yield Candidate(place, text, words, "order", 1.0, change(BINARY[name], (1, 0)))
    kept, dropped = ("term", "term") if symbol in "+-" else ("factor", "factor")
    for k, (keep, drop) in enumerate(((node.left, node.right), (node.right, node.left))):
        text, gone = source.segment(keep), source.segment(drop)
        noun = "exponent" if symbol == "**" else kept
        words = f"the {noun} {short(gone)} should not be there"
        if symbol == "**" and k == 1:
            continue
        yield Candidate(place, text, words, dropped, 1.3, change(identity, (k,)))
    if symbol == "-":
        text = negated(source, node.right)
        words = f"the term {short(left)} should not be there"
        yield Candidate(place, text, words, "term", 1.4, change(np.negative, (1,)))


def _with_operator(program: Program, node: ast.BinOp, old: str, new: str, op: ast.operator) -> str:
    """The node's text with another operator, everything else as the user wrote it."""
    source = program.source
    (start, end), a, b = source.span(node), source.span(node.left)[1], source.span(node.right)[0]
    between = source.text[a:b]
    meant = copy.copy(node)
    meant.op = op
    spaced = between if " " in between or new in "*/**" else between.replace(old, f" {old} ")
    text = source.text[start:a] + spaced.replace(old, new, 1) + source.text[b:end]
    return written(meant, text)


def _updates(program: Program, place: int, node: ast.AugAssign) -> Iterator[Candidate]:
    """Another operator in an update, x += y for x -= y; the whole statement is replaced."""
    source, tape = program.source, program.tape
    symbol, name = SYMBOLS[type(node.op)]
    own = slots(program, place)
    if any(tape.operations[k] is not BINARY[name] for k in own):
        return
    target, value = source.segment(node.target), source.segment(node.value)
    for kind, (other, operation) in SYMBOLS.items():
        if kind is type(node.op) or kind is ast.Pow:
            continue
        changes = {k: Change(BINARY[operation], tape.inputs[k]) for k in own}
        words = f"{target} {symbol}= should be {target} {other}="
        if {symbol, other} == {"+", "-"}:
            had, due = ("+", "−") if symbol == "+" else ("−", "+")
            words = f"{short(value)} enters with {had}, should be {due}"
        text = f"{target} {other}= {value}"
        yield Candidate(
            place, text, words, "sign" if "enters" in words else "operator", 1.0, changes
        )


def _functions(program: Program, place: int, node: ast.Call) -> Iterator[Candidate]:
    """Another function of the same family, no function, its arguments exchanged."""
    source, tape = program.source, program.tape
    own = slots(program, place)
    callee = source.segment(node.func)
    prefix, _, name = callee.rpartition(".")
    if name not in ELEMENTARY or any(tape.operations[k] is not ELEMENTARY[name][0] for k in own):
        return
    arguments = [source.segment(a) for a in node.args]
    for others in FAMILIES:
        if name not in others:
            continue
        for other in others:
            if other == name or (prefix in ("math", "") and other in ("square", "abs", "sign")):
                continue
            called = f"{prefix}.{other}" if prefix else other
            if not prefix and other not in _scope(program, place):
                continue
            operation = ELEMENTARY[other][0]
            changes = {k: Change(operation, tape.inputs[k]) for k in own}
            text = f"{called}({', '.join(arguments)})"
            words = f"{short(source.segment(node))}: {name} should be {other}"
            yield Candidate(place, text, words, "function", 1.0, changes)
    if len(arguments) == 1:
        changes = {k: Change(identity, tape.inputs[k]) for k in own}
        words = f"{short(source.segment(node))}: {name} should not be there"
        yield Candidate(place, arguments[0], words, "function", 1.2, changes)
    if len(arguments) == 2:
        changes = {k: Change(ELEMENTARY[name][0], tape.inputs[k][::-1]) for k in own}
        text = f"{callee}({arguments[1]}, {arguments[0]})"
        words = f"{short(source.segment(node))}: the arguments should be exchanged"
        yield Candidate(place, text, words, "order", 1.0, changes)


def _names(program: Program, place: int, node: ast.expr) -> Iterator[Candidate]:
    """Another name or entry in scope."""
    source = program.source
    instances = program.trace.instances[place]
    own = source.segment(node)
    numbers = isinstance(instances[0].value, Slot)
    scopes = [vocabulary(program, instance, numbers) for instance in instances]
    for text in scopes[0]:
        if text == own or not all(text in scope for scope in scopes):
            continue
        changes = instead(program, place, [scope[text] for scope in scopes])
        if not changes:
            continue
        near = family(text) == family(own)
        cost = 1.0 if near else 1.15 if stem(text) == stem(own) else 1.3
        kind = "index" if near and isinstance(node, ast.Subscript) else "name"
        yield Candidate(place, text, f"{own} should be {text}", kind, cost, changes)


def _transposed(program: Program, place: int, node: ast.expr) -> Iterator[Candidate]:
    """A square matrix transposed: each entry is read where its mirror image was."""
    tape = program.tape
    changes: dict[int, Change] = {}
    for instance in program.trace.instances[place]:
        held = instance.value
        if not isinstance(held, np.ndarray) or held.ndim != 2 or held.shape[0] != held.shape[1]:
            return
        for (i, j), entry in np.ndenumerate(held):
            mirror = held[j, i]
            if not (isinstance(entry, Slot) and isinstance(mirror, Slot)):
                return
            if tape.operations[mirror.index] is not identity or tape.nodes[entry.index] != place:
                return
            if i != j:
                changes[entry.index] = Change(identity, tape.inputs[mirror.index])
    own = program.source.segment(node)
    yield Candidate(place, f"{own}.T", f"{own} should be transposed", "order", 1.0, changes)


def _constants(program: Program, place: int, node: ast.Constant) -> Iterator[Candidate]:
    """Other small numbers; any other is found from the value that is required."""
    if isinstance(node.value, bool) or not isinstance(node.value, int | float):
        return
    own = node.value
    for other in (0, 1, 2, 3, 4, 0.5, own + 1, own - 1, 2 * own, own / 2, -own):
        if other == own:
            continue
        number = float(other)
        changes = {k: Change(_given(number), ()) for k in slots(program, place)}
        text = repr(other)
        words = f"{own!r} should be {text}"
        yield Candidate(place, text, words, "number", number_cost(number), changes)


def _name_for_number(program: Program, place: int, node: ast.Constant) -> Iterator[Candidate]:
    """A name where a number stands, such as a forgotten entry of a matrix."""
    instances = program.trace.instances[place]
    scopes = [vocabulary(program, instance) for instance in instances]
    for text in scopes[0]:
        if all(text in scope for scope in scopes):
            changes = instead(program, place, [scope[text] for scope in scopes])
            if changes:
                yield Candidate(
                    place, text, f"{node.value!r} should be {text}", "name", 1.4, changes
                )


def _given(number: float) -> Any:
    return lambda: np.float64(number)


def _more(program: Program, place: int, node: ast.expr) -> Iterator[Candidate]:
    """A square, a sine or a cosine of what is there."""
    source = program.source
    own = source.segment(node)
    square = ast.BinOp(node, ast.Pow(), ast.Constant(2))
    text = written(square, f"{own}**2", f"({own})**2")
    words = f"{short(own)} should be {short(text)}"
    yield Candidate(place, text, words, "power", 1.2, compose(program, place, np.square))
    own_slots = slots(program, place)
    varies = any(program.tape.varying[k] for k in own_slots)
    calls = dict(callables(program))
    for name in ("sin", "cos", "sqrt", "radians", "degrees") if calls else ():
        if name in ("sin", "cos") and not varies:
            continue
        called = calls.get(name) or _beside(program, place, calls, name)
        if called is None or (
            name == "sqrt" and any(values(program, k).min() < 0.0 for k in own_slots)
        ):
            continue
        text = f"{called}({own})"
        words = f"{short(own)} should be {short(text)}"
        changes = compose(program, place, ELEMENTARY[name][0])
        yield Candidate(place, text, words, "function", 1.3, changes)


def _scope(program: Program, place: int) -> set[str]:
    """The names that are known where a node stands."""
    return {*program.trace.scope, *program.trace.instances[place][0].scope}


def _beside(program: Program, place: int, calls: dict[str, str], name: str) -> str | None:
    """How a function is called beside sine and cosine: np.sqrt where there is np.sin."""
    prefix, _, _ = next(iter(calls.values())).rpartition(".")
    if prefix:
        return f"{prefix}.{name}"
    return name if name in _scope(program, place) else None


def callables(program: Program) -> list[tuple[str, str]]:
    """The names by which this source calls sin and cos."""
    found = {}
    for node in program.source.nodes:
        if isinstance(node, ast.Call):
            called = program.source.segment(node.func)
            prefix, _, name = called.rpartition(".")
            if name in ("sin", "cos"):
                found[name] = called
                if prefix:
                    other = "cos" if name == "sin" else "sin"
                    found.setdefault(other, f"{prefix}.{other}")
    return sorted(found.items())
