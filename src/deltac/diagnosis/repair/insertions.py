"""Edits that put in what is missing: factors, terms, numbers, from the value that is required."""

from __future__ import annotations

import ast
import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np

from deltac.diagnosis.repair.candidates import (
    Candidate,
    combine,
    number_cost,
    product,
    short,
    slots,
    total,
    values,
    vocabulary,
)
from deltac.diagnosis.repair.monomials import Atoms, Product, Table, powers_of, products
from deltac.diagnosis.repair.program import Program
from deltac.diagnosis.repair.required import Requirement
from deltac.diagnosis.repair.source import Source
from deltac.diagnosis.repair.substitutions import callables
from deltac.diagnosis.repair.tape import Array

EXACT = 1e-9
"""A required value that differs by less than this (relative) from state to state is one number."""

TRIPLE = 40
"""Names and functions that are multiplied three at a time."""

SUMMED = 24
"""Constants of which sums and differences of two are taken as well."""

MOST = 60
"""Expressions of the source that are taken as parts of what is missing."""


@dataclass(eq=False)
class Vocabulary:
    """Atoms at the places of a program, and their products, made once for each scope."""

    program: Program
    _atoms: dict[tuple[object, ...], tuple[Atoms, Atoms]] = field(default_factory=dict)
    _tables: dict[tuple[object, ...], Table] = field(default_factory=dict)

    def atoms(self, requirement: Requirement) -> tuple[Atoms, Atoms]:
        """State-dependent and constant atoms that may stand where a node stands."""
        program = self.program
        instance = program.numbers[requirement.place]
        names = {**program.trace.scope, **instance.scope}
        owner = program.owner(requirement.place)
        later = {*program.tape.after(requirement.slot), requirement.slot}
        variables = {
            text: slot.index
            for text, slot in vocabulary(program, instance).items()
            if slot.index not in later
        }
        expressions = {
            text: slot
            for text, (slot, used) in self._expressions(owner).items()
            if slot not in later and used <= names.keys() and text not in variables
        }
        key = (id(owner), tuple(variables), tuple(expressions))
        if key not in self._atoms:
            sines = self._sines(variables, expressions)
            self._atoms[key] = (
                self._side(variables, expressions, sines, varying=True),
                self._side(variables, expressions, {}, varying=False),
            )
        return self._atoms[key]

    def _side(
        self,
        variables: dict[str, int],
        expressions: dict[str, int],
        sines: dict[str, Array],
        varying: bool,
    ) -> Atoms:
        program = self.program
        chosen = [
            {
                text: values(program, k)
                for text, k in found.items()
                if program.tape.varying[k] == varying
            }
            for found in (variables, expressions)
        ]
        names = len(chosen[0])
        together = {**chosen[0], **dict(list(chosen[1].items())[:MOST]), **sines}
        calls = sum("(" in text and text[-1] == ")" for text in together)
        width = len(program.samples.t)
        rows = np.array(list(together.values())) if together else np.empty((0, width))
        if varying:
            return Atoms(tuple(together), rows, names, len(rows), min(names + calls, TRIPLE))
        group = program.samples.group
        rows = rows[:, np.searchsorted(group, np.arange(group[-1] + 1))]
        core, texts = len(rows), list(together)
        if group[-1] > 0 and names <= SUMMED:  # at one set of numbers, sums fit too easily
            for i, j in itertools.combinations(range(names), 2):
                texts += [f"{texts[i]} + {texts[j]}", f"{texts[i]} - {texts[j]}"]
                rows = np.concatenate([rows, [rows[i] + rows[j], rows[i] - rows[j]]])
        return Atoms(tuple(texts), rows, names, min(core, TRIPLE), min(names, TRIPLE))

    def table(self, atoms: Atoms, degree: int, quotients: bool) -> Table:
        """`powers_of`, kept."""
        # Constants of the same texts have the same values; others may have been set again.
        constant = atoms.values.shape[1] < len(self.program.samples.t)
        key = (atoms.texts if constant else id(atoms), degree, quotients)
        if key not in self._tables:
            self._tables[key] = powers_of(atoms, degree, quotients)
        return self._tables[key]

    def _expressions(self, owner: ast.AST) -> dict[str, tuple[int, set[str]]]:
        """Expressions of a function with their slots and the names they use, the likeliest parts first."""
        if id(owner) in self._known:
            return self._known[id(owner)]
        program = self.program
        found: list[tuple[int, str, int, set[str]]] = []
        for place, instance in program.numbers.items():
            node = program.source.nodes[place]
            if not isinstance(node, ast.BinOp | ast.Call) or program.owner(place) is not owner:
                continue
            text = " ".join(program.source.segment(node).split())
            if text.startswith(("-", "+")) or "#" in text:
                continue
            used = {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}
            rank = 0 if isinstance(node, ast.Call) else _RANKS.get(type(node.op), 3)
            found.append((rank, text, instance.value.index, used))
        found.sort(key=lambda x: (x[0], len(x[1])))
        self._known[id(owner)] = {text: (slot, used) for _, text, slot, used in reversed(found)}
        self._known[id(owner)] = dict(reversed(self._known[id(owner)].items()))
        return self._known[id(owner)]

    _known: dict[int, dict[str, tuple[int, set[str]]]] = field(default_factory=dict)

    def _sines(self, variables: dict[str, int], expressions: dict[str, int]) -> dict[str, Array]:
        """Differences of coordinates and of speeds, and sines and cosines, that are not there yet."""
        program = self.program
        nq = 1 + len(program.samples.q)
        angles, speeds = (
            [
                (text, k)
                for text, k in variables.items()
                if any(program.tape.values[k] is program.tape.values[i] for i in inputs)
            ]
            for inputs in (program.trace.inputs[1:nq], program.trace.inputs[nq:])
        )
        made = {
            f"{text} - {other}": values(program, k) - values(program, j)
            for some in (angles, speeds)
            if len(some) <= 4
            for (other, j), (text, k) in itertools.combinations(some, 2)
        }
        for name, called in callables(program):
            function = getattr(np, name)
            for i, (text, k) in enumerate(angles):
                made[f"{called}({text})"] = function(values(program, k))
                if len(angles) <= 4:
                    for other, j in angles[i + 1 :]:
                        x = values(program, k) - values(program, j)
                        made[f"{called}({text} - {other})"] = function(x)
        return {text: x for text, x in made.items() if text not in expressions}


_RANKS: dict[type[ast.operator], int] = {ast.Add: 1, ast.Sub: 1, ast.Pow: 1, ast.Mult: 2}
"""Sums and powers before products, which are made of names anyway."""


def insertions(
    program: Program, requirement: Requirement, words: Vocabulary
) -> Iterator[Candidate]:
    """Edits that give a node the value it must have by a factor, a term or a number."""
    source, place = program.source, requirement.place
    node = source.nodes[place]
    if not isinstance(node, ast.expr):
        return
    parent = source.nodes[source.parent[place]]
    if isinstance(node, ast.Constant):
        yield from _number(program, requirement, node)
        return
    operation = type(parent.op) if isinstance(parent, ast.BinOp) else None
    factor = operation not in (ast.Mult, ast.Div) and not isinstance(parent, ast.UnaryOp)
    term = operation not in (ast.Add, ast.Sub)
    if not (factor or term):
        return
    state, constant = words.atoms(requirement)
    group = program.samples.group
    own = source.segment(node)
    if factor:
        with np.errstate(all="ignore"):
            wanted = requirement.required / requirement.value
        few = (state, words.table(state, 2, True)), (constant, words.table(constant, 2, True))
        for p in products(wanted, group, *few):
            candidate = _with_factor(program, place, node, own, p)
            if candidate is not None:
                yield candidate
    if term:
        many = (state, words.table(state, 3, False)), (constant, words.table(constant, 3, False))
        for p in products(requirement.required - requirement.value, group, *many):
            text = total(source, node, p.text, subtract=p.number < 0)
            said = f"{_named(source, node)} lacks the term {'−' if p.number < 0 else '+'} {p.text}"
            place_cost = 0.0 if isinstance(node, ast.BinOp) else 0.05
            yield Candidate(place, text, said, "term", 1.5 + p.cost + place_cost, None)
        if factor:
            for p in products(requirement.required, group, *many):
                sign = "-" if p.number < 0 else ""
                said = f"{short(own)} should be {sign}{p.text}"
                yield Candidate(place, f"{sign}{p.text}", said, "term", 2.0 + p.cost, None)


def _named(source: Source, node: ast.expr) -> str:
    """What an expression is called in words: the variable that it is assigned to, or its text."""
    parent = source.nodes[source.parent[source.number[id(node)]]]
    if isinstance(parent, ast.Assign) and isinstance(parent.targets[0], ast.Name):
        return parent.targets[0].id
    return short(source.segment(node))


def additions(program: Program, place: int) -> Iterator[Candidate]:
    """A name added, subtracted, multiplied or divided by: to be tried where a value is not unique."""
    source, node = program.source, program.source.nodes[place]
    if place not in program.numbers or not isinstance(node, ast.expr):
        return
    parent = source.nodes[source.parent[place]]
    inside = isinstance(parent, ast.BinOp) and type(parent.op) in (ast.Mult, ast.Div)
    if (
        isinstance(node, ast.Constant)
        or inside
        or not program.tape.varying[slots(program, place)[0]]
    ):
        return
    own = short(source.segment(node))
    for name, slot in vocabulary(program, program.numbers[place]).items():
        if slot.index >= program.numbers[place].value.index:
            continue
        changes = {
            symbol: combine(program, place, operation, slot.index)
            for symbol, operation in zip("+-*/", (np.add, np.subtract, np.multiply, np.true_divide))
        }
        for symbol, subtract in (("+", False), ("-", True)):
            said = f"{own} lacks the term {'−' if subtract else '+'} {name}"
            text = total(source, node, name, subtract)
            yield Candidate(place, text, said, "term", 1.75, changes[symbol])
        for symbol, divide in (("*", False), ("/", True)):
            said = (
                f"{own} must be divided by {name}" if divide else f"{own} lacks the factor {name}"
            )
            text = product(source, node, name, divide)
            yield Candidate(place, text, said, "factor", 1.6, changes[symbol])


def _with_factor(
    program: Program, place: int, node: ast.expr, own: str, p: Product
) -> Candidate | None:
    source = program.source
    negative = p.number < 0
    divisors = [*([str(p.number.denominator)] if p.number.denominator != 1 else []), *p.below]
    only_below = not p.above and abs(p.number.numerator) == 1
    if only_below and divisors:
        divisor = divisors[0] if len(divisors) == 1 else f"({' * '.join(divisors)})"
        text = product(source, node, divisor, divide=True)
        said = f"{short(own)} must be divided by {' and '.join(divisors)}"
    elif not p.above and not divisors and abs(p.number) == 1:
        return None  # a sign: not an insertion
    else:
        text = product(source, node, p.text)
        said = f"{short(own)} lacks the factor {p.text}"
    if negative:
        text = f"-({text})"
        said += ", and has the wrong sign"
    kind = "number" if not p.above and not p.below else "factor"
    return Candidate(place, text, said, kind, 1.25 + p.cost + 0.5 * negative, None)


def _number(program: Program, requirement: Requirement, node: ast.Constant) -> Iterator[Candidate]:
    """Another number, where one number serves at all states and parameters."""
    x = requirement.required
    mean = float(np.mean(x))
    if not np.isfinite(mean) or np.ptp(x) > EXACT * abs(mean) or isinstance(node.value, bool):
        return
    digits = float(f"{mean:.6g}")
    simple = Fraction(mean).limit_denominator(60)
    if abs(digits - mean) <= EXACT * abs(mean):
        text = repr(int(digits) if digits.is_integer() else digits)
        cost = number_cost(digits)
    elif abs(float(simple) - mean) <= EXACT * abs(mean):
        text, cost = f"{simple.numerator} / {simple.denominator}", 1.6
    else:
        text, cost = repr(mean), 1.9
    said = f"{program.source.segment(node)} should be {text}"
    yield Candidate(requirement.place, text, said, "number", cost, None)
