"""What can be named where a node stands, and what a tree of such names and of the source's nodes is worth."""

from __future__ import annotations

import ast
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from deltac.errors import InputError
from deltac.repair.edits.candidates import EditCandidate
from deltac.repair.tracing.library import REPLACEMENTS, NotUnderstood, arrayed, flatten, tape_of
from deltac.repair.tracing.program import Program
from deltac.repair.tracing.source import Source
from deltac.repair.tracing.tape import Slot, TapeBranch, TapeChange, TapeError
from deltac.repair.tracing.tracer import OPERATORS, Instance, fields_of

NEIGHBOURS = {"": 0, " - 1": -1, " + 1": 1}
"""Which entries of a sequence a loop has to do with, beside that of its counter."""


@dataclass(frozen=True, eq=False, repr=False)
class TextNames:
    """The names of a text whose values are not known: those that the function around a node uses."""

    source: Source

    def numbers(self, place: int) -> Sequence[str]:
        """Names and entries that the same function, or the module's statements, use as numbers."""
        names: dict[str, None] = {}
        for node in ast.walk(self.source.owner(place)):
            entry = isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant)
            if entry or isinstance(node, ast.Name):
                k = self.source.number.get(id(node))
                if k is not None and valued(self.source, k):
                    names.setdefault(self.source.segment(node))
        return list(names)

    def arrays(self, place: int) -> dict[str, tuple[int, ...]]:
        """None are known to be arrays."""
        return {}

    def shape(self, place: int) -> None:
        """It is not known."""

    def constant(self, place: int) -> bool:
        """It is not known."""
        return False


def valued(source: Source, place: int) -> bool:
    """Whether a node is evaluated for its value: no target, annotation, callee, base or index."""
    node, parent = source.nodes[place], source.nodes[source.parent.get(place, 0)]
    if not isinstance(node, ast.expr) or not isinstance(getattr(node, "ctx", ast.Load()), ast.Load):
        return False
    match parent:
        case ast.Call(func=called) if called is node:
            return False
        case ast.AnnAssign():
            return parent.value is node
    skipped = (ast.Attribute, ast.Subscript, ast.Starred, ast.arg, ast.FunctionDef, ast.ClassDef,
               ast.JoinedStr, ast.Expr, ast.Slice)  # fmt: skip
    return not isinstance(parent, skipped)


@dataclass(frozen=True, eq=False, repr=False)
class TracedNames:
    """The names of a traced program, with their values on its tape."""

    program: Program
    _scopes: dict[int, tuple[dict[str, Slot], dict[str, Any]]] = field(default_factory=dict)

    def numbers(self, place: int) -> Sequence[str]:
        """Numbers that every evaluation of the node has under the same name."""
        first, *others = map(self.scope, self.program.trace.instances[place])
        return [text for text in first[0] if all(text in scope[0] for scope in others)]

    def arrays(self, place: int) -> dict[str, tuple[int, ...]]:
        """Arrays in scope at the first evaluation of the node."""
        instances = self.program.trace.instances.get(place, [])
        return {t: x.shape for t, x in self.scope(instances[0])[1].items()} if instances else {}

    def shape(self, place: int) -> tuple[int, ...] | None:
        """The shape of the node's value."""
        instances = self.program.trace.instances.get(place, [])
        return np.shape(_array(instances[0].value)) if instances else None

    def constant(self, place: int) -> bool:
        """Whether the node depends on constants alone."""
        slots = self.program.slots(place)
        return bool(slots) and not any(self.program.tape.varying[s.index] for s in slots)

    def scope(self, instance: Instance) -> tuple[dict[str, Slot], dict[str, Any]]:
        """The numbers, and the arrays, that can be named at an evaluation, by the texts that name them.

        Variables, and the entries of those arrays and dictionaries whose entries the source uses. One number
        has one name, a variable's before an entry's.
        """
        key = id(instance.scope)
        if key not in self._scopes:
            self._scopes[key] = self._scope(instance)
        return self._scopes[key]

    def _scope(self, instance: Instance) -> tuple[dict[str, Slot], dict[str, Any]]:
        program = self.program
        numbers: dict[str, Slot] = {}
        values: set[int] = set()

        def add(text: str, value: Any) -> None:
            if isinstance(value, Slot):
                marker = id(program.tape.values[value.index])
                if marker not in values and not _count(program, value):
                    values.add(marker)
                    numbers[text] = value

        # What the function calls its own goes before what the module has.
        scope = {**instance.scope, **program.trace.scope, **instance.scope}
        names = {name: value for name, value in scope.items() if name.isidentifier()}
        for name, value in scope.items():
            names.update({f"{name}.{part}": x for part, x in _attributes(value)})
        for name, value in names.items():
            add(name, value)
        # s["x1"] tells more than y[0].
        for name, value in sorted(scope.items(), key=lambda entry: not isinstance(entry[1], dict)):
            if name in self._indexed or _of_the_state(program, value):
                for text, entry in _entries(name, value):
                    add(text, entry)
                for text, entry in _counted(name, value, scope):
                    numbers.setdefault(text, entry)
        for text, value in self._constant_entries.items():
            add(text, value)
        arrays = {
            name: value
            for name, value in names.items()
            if isinstance(value, np.ndarray) and value.ndim in (1, 2) and value.size <= 64
        }
        return numbers, arrays

    @cached_property
    def _indexed(self) -> set[str]:
        """Names whose entries the source reads."""
        return {
            node.value.id
            for node in self.program.source.nodes
            if isinstance(node, ast.Subscript)
            and isinstance(node.value, ast.Name)
            and isinstance(node.ctx, ast.Load)
        }

    @cached_property
    def _constant_entries(self) -> dict[str, Slot]:
        """Entries and attributes that the source reads, and that are constants."""
        program = self.program
        return {
            program.source.segment(program.source.nodes[place]): instances[0].value
            for place, instances in program.trace.instances.items()
            if isinstance(program.source.nodes[place], ast.Attribute | ast.Subscript)
            and isinstance(instances[0].value, Slot)
            and not program.tape.varying[instances[0].value.index]
        }

    # --- what an edit does to the tape ------------------------------------------------------------

    def changes(self, candidate: EditCandidate) -> dict[int, TapeChange]:
        """What an edit does to the tape; empty if it cannot be made, or the tape does not show it."""
        program, place = self.program, candidate.place
        tape, instances = program.tape, program.trace.instances.get(place, [])
        changes: dict[int, TapeChange] = {}
        for k, instance in enumerate(instances):
            shared = tape_of(instance.value)
            if shared is None:
                return {}
            with shared.aside() as first, np.errstate(all="ignore"):
                try:
                    new = self._value(candidate.new, k, len(instances), instance)
                    if np.shape(_array(new)) != np.shape(_array(instance.value)):
                        return {}
                    entries = [x for x in flatten(instance.value) if isinstance(x, Slot)]
                    own = {entry.index for entry in entries}
                    replacements = {
                        entry.index: shared.spliced(shared.slot(value), first, own)
                        for entry, value in zip(entries, flatten(new), strict=True)
                    }
                except (TapeBranch, InputError, TapeError, NotUnderstood, ArithmeticError, AttributeError,
                        LookupError, TypeError, ValueError):  # fmt: skip
                    return {}
            for index, change in replacements.items():
                # An array that only its name stands for is none of this node's.
                if tape.nodes[index] != place or max(change.inputs, default=-1) > index:
                    return {}
                if (index,) != change.inputs:
                    changes[index] = change
        return changes

    def _value(self, tree: ast.AST | str, k: int, count: int, instance: Instance) -> Any:
        """What a tree is worth at the evaluation k of `count`; LookupError where that is not known."""
        program = self.program
        place = program.source.number.get(id(tree))
        recorded = program.trace.instances.get(place, []) if place is not None else []
        if len(recorded) == count:
            return recorded[k].value

        def value(part: ast.AST) -> Any:
            return arrayed(self._value(part, k, count, instance))

        match tree:
            case ast.Constant(value=int() | float() as number):
                return number
            case ast.Name(id=text) if place is None:
                numbers, arrays = self.scope(instance)
                return numbers[text] if text in numbers else arrays[text]
            case ast.Name(id=text):  # a list, which acts as an array beside one
                return {**program.trace.scope, **instance.scope}[text]
            case ast.BinOp():
                return OPERATORS[type(tree.op).__name__](value(tree.left), value(tree.right))
            case ast.UnaryOp():
                return OPERATORS[type(tree.op).__name__](value(tree.operand))
            case ast.Attribute(attr="T"):
                return value(tree.value).T
            case ast.Call(keywords=[]):
                name = ast.unparse(tree.func).rpartition(".")[2]
                return REPLACEMENTS[name](*map(value, tree.args))
        raise LookupError


Names: TypeAlias = TextNames | TracedNames
"""What may be written where a node stands."""


def _array(value: Any) -> Any:
    return value if isinstance(value, np.ndarray) else np.float64(0.0)


def _entries(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """The entries of an array or a dictionary, by the texts that name them."""
    if isinstance(value, np.ndarray) and value.ndim in (1, 2) and value.size <= 36:
        for k in np.ndindex(value.shape):
            yield f"{name}[{', '.join(map(str, k))}]", value[k]
    elif isinstance(value, dict):
        for key, entry in value.items():
            yield f"{name}[{key!r}]".replace("'", '"'), entry


def _counted(name: str, value: Any, scope: dict[str, Any]) -> Iterator[tuple[str, Slot]]:
    """Entries of a sequence that a variable of a loop counts, and those before and after them."""
    if isinstance(value, list) or (isinstance(value, np.ndarray) and value.ndim == 1):
        for (counter, count), (text, k) in itertools.product(scope.items(), NEIGHBOURS.items()):
            place = count + k if type(count) is int else -1
            if 0 <= place < len(value) and isinstance(value[place], Slot):
                yield f"{name}[{counter}{text}]", value[place]


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
