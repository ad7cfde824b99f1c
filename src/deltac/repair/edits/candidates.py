"""A candidate edit: one node of the source replaced by another text; and the names that texts may use."""

from __future__ import annotations

import ast
import difflib
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from deltac.arrays import Array
from deltac.repair.tracing.library import flatten
from deltac.repair.tracing.program import Program
from deltac.repair.tracing.source import Source
from deltac.repair.tracing.tape import Change, Operation, Slot, identity
from deltac.repair.tracing.tracer import Instance, fields_of


@dataclass(frozen=True, eq=False, repr=False)
class Candidate:
    """An edit that may be the repair.

    place    the node that it replaces, by its place in `source.nodes`
    text     what it is replaced by
    words    the edit in words, after "eom.py:24: "
    kind     sign, operator, name, index, function, power, number, factor, term, order
    cost     how much is changed: 1 for one sign, operator or name; more for what is put in
    changes  what becomes of the tape; None if it must be read again
    """

    place: int
    text: str
    words: str
    kind: str
    cost: float
    changes: Mapping[int, Change] | None


def compose(program: Program, place: int, after: Operation) -> dict[int, Change]:
    """Apply an operation to the value of a node, at each of its evaluations."""
    changes = {}
    for k in slots(program, place):
        changes[k] = Change(_after(after, program, k), program.tape.inputs[k])
    return changes


def _after(after: Operation, program: Program, k: int) -> Operation:
    operation = program.tape.operations[k]
    if operation is None:
        value = program.tape.values[k]
        return lambda: after(value)
    return lambda *inputs: after(operation(*inputs))


def combine(
    program: Program, place: int, operation: Operation, others: list[Any]
) -> dict[int, Change]:
    """Put operation(value, other) in place of the values of a node; `others` are one for each evaluation.

    Empty where one of them is no number, or depends on the node.
    """
    changes: dict[int, Change] = {}
    for instance, other in zip(program.trace.instances[place], others):
        owned = list(flatten(instance.value))
        paired = list(flatten(other)) if isinstance(other, np.ndarray) else [other] * len(owned)
        for own, one in zip(owned, paired):
            if not (isinstance(own, Slot) and isinstance(one, Slot)) or one.index >= own.index:
                return {}
            if program.tape.nodes[own.index] == place:
                changes[own.index] = _combined(program, own.index, operation, one.index)
    return changes


def _combined(program: Program, k: int, operation: Operation, other: int) -> Change:
    old, inputs = program.tape.operations[k], program.tape.inputs[k]
    if old is None:
        value = program.tape.values[k]
        return Change(lambda y: operation(value, y), (other,))
    return Change(lambda *xs: operation(old(*xs[:-1]), xs[-1]), (*inputs, other))


def slots(program: Program, place: int) -> list[int]:
    """All slots that hold values of a node."""
    found = []
    for instance in program.trace.instances.get(place, []):
        for entry in flatten(instance.value):
            if isinstance(entry, Slot) and program.tape.nodes[entry.index] == place:
                found.append(entry.index)
    return found


def instead(program: Program, place: int, others: list[Any]) -> dict[int, Change] | None:
    """Other values (slots or arrays of slots, one an instance) in place of a node's; None if unlike."""
    changes = {}
    for instance, other in zip(program.trace.instances[place], others):
        if np.shape(_array(instance.value)) != np.shape(_array(other)):
            return None
        for old, new in zip(flatten(instance.value), flatten(other)):
            if not (isinstance(new, Slot) and isinstance(old, Slot)):
                return None
            if program.tape.nodes[old.index] != place or new.index == old.index:
                return None
            changes[old.index] = Change(identity, (new.index,))
    return changes


def _array(value: Any) -> Any:
    return value if isinstance(value, np.ndarray) else np.float64(0.0)


# --- names ----------------------------------------------------------------------------------------


def vocabulary(program: Program, instance: Instance, numbers: bool = True) -> dict[str, Any]:
    """What can be named where a node stands, by the text that names it: numbers, or arrays.

    Variables, and the entries of those arrays and dictionaries whose entries the source uses. One value
    has one name, a variable's before an entry's.
    """
    found: dict[str, Any] = {}
    seen: set[int] = set()

    def add(text: str, value: Any) -> None:
        if numbers and isinstance(value, Slot):
            marker = id(program.tape.values[value.index])
            if marker not in seen and not _count(program, value):
                seen.add(marker)
                found[text] = value
        elif not numbers and isinstance(value, np.ndarray):
            found[text] = value

    # What the function calls its own goes before what the module has.
    scope = {**instance.scope, **program.trace.scope, **instance.scope}
    for name, value in scope.items():
        if name.isidentifier():
            add(name, value)
    for name, value in scope.items():
        for attribute, held in _attributes(value):
            add(f"{name}.{attribute}", held)
    if not numbers:
        return found
    indexed = _indexed(program.source)
    # s["x1"] tells more than y[0].
    for name, value in sorted(scope.items(), key=lambda entry: not isinstance(entry[1], dict)):
        if name not in indexed and not _of_the_state(program, value):
            continue
        if isinstance(value, np.ndarray) and value.ndim in (1, 2) and value.size <= 36:
            for k in np.ndindex(value.shape):
                add(f"{name}[{', '.join(map(str, k))}]", value[k])
            for counter, k in scope.items():
                inside = type(k) is int and value.ndim == 1 and 0 <= k < len(value)
                if inside and isinstance(value[k], Slot):
                    found.setdefault(f"{name}[{counter}]", value[k])
        elif isinstance(value, list) and all(isinstance(x, Slot) for x in value):
            for counter, k in scope.items():
                if type(k) is int and 0 <= k < len(value):
                    found.setdefault(f"{name}[{counter}]", value[k])
        elif isinstance(value, dict):
            for key, entry in value.items():
                add(f"{name}[{key!r}]".replace("'", '"'), entry)
    for place, instances in program.trace.instances.items():
        node = program.source.nodes[place]
        value = instances[0].value
        entry = isinstance(node, ast.Attribute | ast.Subscript) and isinstance(value, Slot)
        if entry and not program.tape.varying[value.index]:
            add(program.source.segment(node), value)
    return found


def _of_the_state(program: Program, value: Any) -> bool:
    """Whether an array has coordinates or speeds alone: entries that nothing uses may be forgotten."""
    if not isinstance(value, np.ndarray) or value.ndim != 1:
        return False
    state = {id(program.tape.values[k]) for k in program.trace.inputs[1:]}
    return all(isinstance(x, Slot) and id(program.tape.values[x.index]) in state for x in value)


def _count(program: Program, value: Slot) -> bool:
    """Whether a number counts things: an integer that is none of the parameters that were varied."""
    slot, group = value.index, program.samples.group
    whole = type(program.tape.exact[slot]) is int
    return whole and bool(group[-1] > 0) and float(np.ptp(program.tape.values[slot])) == 0.0


def _attributes(value: Any, deep: bool = True) -> Iterator[tuple[str, Any]]:
    """Attributes of an object of the user's, and of its parts, that hold numbers or arrays."""
    for name, one in fields_of(value).items():
        if isinstance(one, Slot | np.ndarray) and name.isidentifier():
            yield name, one
        elif deep:
            yield from ((f"{name}.{inner}", x) for inner, x in _attributes(one, deep=False))


def array_names(program: Program, instance: Instance) -> dict[str, Any]:
    """Arrays that can be named where a node stands, by the text that names them."""
    scope = {**program.trace.scope, **instance.scope}
    found = {name: value for name, value in scope.items() if name.isidentifier()}
    for name, value in scope.items():
        found.update({f"{name}.{a}": held for a, held in _attributes(value)})
    return {
        text: value
        for text, value in found.items()
        if isinstance(value, np.ndarray) and value.ndim in (1, 2) and value.size <= 64
    }


def _indexed(source: Source) -> set[str]:
    return {
        node.value.id
        for node in source.nodes
        if isinstance(node, ast.Subscript)
        and isinstance(node.value, ast.Name)
        and isinstance(node.ctx, ast.Load)
    }


def family(text: str) -> str:
    """What names of one family share: l1 and l3, len_a and len_b, q[0] and q[2], p["m1"] and p["m2"]."""
    return re.sub(r"\d+|(?<=_)[A-Za-z]\b", "#", text)


def number_cost(number: float) -> float:
    """How unlikely it is that this number was meant: more than a name or a sign, small whole ones least."""
    negative = 0.25 if number < 0 else 0.0
    if float(number).is_integer() and abs(number) <= 12:
        return 1.25 + negative
    return (1.4 if float(f"{number:.4g}") == number else 1.5) + negative


def stem(text: str) -> str:
    """What names of one index share: S21 and C21, th1 and w1."""
    return re.sub(r"[^\d]+", "", text)


# --- texts ----------------------------------------------------------------------------------------


def parsed(text: str) -> ast.expr:
    """The expression that a text means."""
    return ast.parse(f"({text})", mode="eval").body


def written(meant: ast.expr, *texts: str) -> str:
    """The first of some texts that means an expression, else its canonical text."""
    dump = ast.dump(meant)
    for text in texts:
        try:
            if ast.dump(parsed(text)) == dump:
                return text
        except SyntaxError:
            continue
    return ast.unparse(meant)


def product(source: Source, node: ast.expr, factor: str, divide: bool = False) -> str:
    """The text of a node times (or by) a factor."""
    symbol, op = ("/", ast.Div()) if divide else ("*", ast.Mult())
    own = source.segment(node)
    bare = written(
        ast.BinOp(node, op, ast.Name("x", ast.Load())), f"{own} {symbol} x", f"({own}) {symbol} x"
    )
    return f"{bare[:-1]}{factor}"


def total(source: Source, node: ast.expr, term: str, subtract: bool = False) -> str:
    """The text of a node plus (or minus) a term."""
    symbol, op = ("-", ast.Sub()) if subtract else ("+", ast.Add())
    meant = ast.BinOp(node, op, parsed(term))
    own = source.segment(node)
    return written(meant, f"{own} {symbol} {term}", f"({own}) {symbol} {term}")


def negated(source: Source, node: ast.expr) -> str:
    """The text of a node with a minus."""
    own = source.segment(node)
    return written(ast.UnaryOp(ast.USub(), node), f"-{own}", f"-({own})")


def short(text: str, limit: int = 70) -> str:
    """A text on one line, its middle left out where it is long."""
    line = " ".join(text.split())
    return line if len(line) <= limit else f"{line[: limit // 2]} … {line[-limit // 2 + 3 :]}"


def values(program: Program, slot: int) -> Array:
    """The values (B,) of a slot."""
    return np.broadcast_to(program.tape.values[slot], program.samples.t.shape).astype(float)


def apply(source: Source, edits: Sequence[Candidate]) -> Source | None:
    """The source with edits of different places applied; None where they overlap.

    An edit within what another one replaces is made in that one's text, if its own stands there once.
    """
    if len(edits) == 2:
        for outer, inner in (edits, edits[::-1]):
            (a, b), (c, d) = (source.span(source.nodes[e.place]) for e in (outer, inner))
            if a <= c and d <= b and outer.place != inner.place:
                return _nested(source, outer, inner, source.text[c:d])
    spans = sorted(
        ((source.span(source.nodes[e.place]), e) for e in edits), key=lambda x: x[0], reverse=True
    )
    text = source.text
    last = len(text) + 1
    for (start, end), edit in spans:
        if end > last:
            return None
        last = start
        node = source.nodes[edit.place]
        bare = text[:start] + edit.text + text[end:]
        if isinstance(node, ast.stmt):
            text = bare
            continue
        safe = f"{text[:start]}({edit.text}){text[end:]}"
        text = bare if _same(bare, safe) else safe
    return source.replaced(text)


def _nested(source: Source, outer: Candidate, inner: Candidate, own: str) -> Source | None:
    """The source with one edit made, and another in its text where `own` stands there once."""
    found = list(re.finditer(rf"(?<![\w.]){re.escape(own)}(?!\w)", outer.text))
    if len(found) != 1:
        return None
    start, end = found[0].span()
    return apply(
        source, [replace(outer, text=f"{outer.text[:start]}({inner.text}){outer.text[end:]}")]
    )


def _same(bare: str, safe: str) -> bool:
    """Whether parentheses make no difference to what a text means."""
    try:
        return ast.dump(ast.parse(bare)) == ast.dump(ast.parse(safe))
    except SyntaxError:
        return False


def unified_diff(source: Source, changed: Source) -> str:
    """A patch that `git apply` and `patch -p1` take: in the root of the repository, or where we are."""
    name = _patch_name(source)
    lines = difflib.unified_diff(
        source.text.splitlines(keepends=True),
        changed.text.splitlines(keepends=True),
        f"a/{name}",
        f"b/{name}",
    )
    text = ""
    for line in lines:
        text += line if line.endswith("\n") else f"{line}\n\\ No newline at end of file\n"
    return text


def _patch_name(source: Source) -> str:
    """The file's path from the root of its repository, else from the working folder, else its name."""
    if source.path is None:
        return source.name.rpartition("/")[2]
    path = source.path.resolve()
    roots = [folder for folder in path.parents if (folder / ".git").exists()][:1]
    for root in (*roots, Path.cwd().resolve()):
        if path.is_relative_to(root):
            return path.relative_to(root).as_posix()
    return path.name
