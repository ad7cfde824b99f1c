"""Edits that put in what is missing: factors, terms, numbers, from the value that is required."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np

from deltac.diagnosis.repair.candidates import Candidate, product, short, total, values, vocabulary
from deltac.diagnosis.repair.interpreter import Instance
from deltac.diagnosis.repair.monomials import Atoms, Product, Table, powers_of, products
from deltac.diagnosis.repair.program import Program
from deltac.diagnosis.repair.required import Requirement
from deltac.diagnosis.repair.substitutions import callables
from deltac.diagnosis.repair.tape import Array

EXACT = 1e-9
"""A required value that differs by less than this (relative) from state to state is one number."""

MOST = 60
"""Expressions of the source that are taken as parts of what is missing."""


@dataclass(eq=False)
class Vocabulary:
    """Atoms at the places of a program, made once for each scope."""

    program: Program
    _known: dict[tuple[frozenset[str], int], tuple[Atoms, Atoms]] = field(default_factory=dict)
    _tables: dict[tuple[int, int, bool], Table] = field(default_factory=dict)

    def atoms(self, requirement: Requirement) -> tuple[Atoms, Atoms]:
        """State-dependent and constant atoms that may stand where a node stands."""
        program = self.program
        instance = program.numbers[requirement.place]
        names = {**program.trace.scope, **instance.scope}
        owner = program.owner(requirement.place)
        later = set(program.tape.after(requirement.slot)) | {requirement.slot}
        found = vocabulary(program, instance)
        state: list[tuple[str, Array]] = []
        constant: list[tuple[str, Array]] = []
        for text, slot in found.items():
            if slot.index not in later:
                side = state if program.tape.varying[slot.index] else constant
                side.append((text, values(program, slot.index)))
        counts = (len(state), len(constant))
        for text, slot_index in self._expressions(names, owner, later):
            side = state if program.tape.varying[slot_index] else constant
            if all(text != known for known, _ in side):
                side.append((text, values(program, slot_index)))
        state += self._sines(instance, state)
        return _atoms(state, counts[0]), _atoms(constant, counts[1])

    def _expressions(
        self, names: dict[str, object], owner: ast.AST, later: set[int]
    ) -> Iterator[tuple[str, int]]:
        """Expressions of the same function, written with names that are in scope."""
        program, count = self.program, 0
        for place, instance in program.numbers.items():
            node = program.source.nodes[place]
            if not isinstance(node, ast.BinOp | ast.Call) or count >= MOST:
                continue
            used = {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}
            if instance.value.index in later or not used <= names.keys():
                continue
            if program.owner(place) is owner and _worth(node):
                count += 1
                yield " ".join(program.source.segment(node).split()), instance.value.index

    def _sines(
        self, instance: Instance, state: list[tuple[str, Array]]
    ) -> list[tuple[str, Array]]:
        """sin and cos of the coordinates, and of their differences, that are not there yet."""
        program = self.program
        known = {text for text, _ in state}
        count = len(program.samples.q)
        inputs = program.trace.inputs[1 : 1 + count]
        angles = [
            (text, slot.index)
            for text, slot in vocabulary(program, instance).items()
            if any(program.tape.values[slot.index] is program.tape.values[k] for k in inputs)
        ]
        made = []
        for name, called in callables(program):
            function = getattr(np, name)
            for i, (text, slot) in enumerate(angles):
                if f"{called}({text})" not in known:
                    made.append((f"{called}({text})", function(values(program, slot))))
                for other, other_slot in angles[i + 1 :]:
                    difference = f"{called}({text} - {other})"
                    x = values(program, slot) - values(program, other_slot)
                    if difference not in known and len(angles) <= 4:
                        made.append((difference, function(x)))
        return made


def _worth(node: ast.expr) -> bool:
    """Whether an expression is a likely part: a sum, a call, a power; products are made anyway."""
    if isinstance(node, ast.Call):
        return True
    return isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub | ast.Pow | ast.Mult)


def _atoms(found: list[tuple[str, Array]], names: int) -> Atoms:
    if not found:
        return Atoms((), np.empty((0, 1)), 0)
    return Atoms(tuple(text for text, _ in found), np.array([v for _, v in found]), names)


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
    width = len(requirement.value)
    state_terms = powers_of(_wide(state, width), 3, quotients=False)
    constant_terms = powers_of(_wide(constant, width), 3, quotients=False)
    group = program.samples.group
    own = source.segment(node)
    if factor:
        with np.errstate(all="ignore"):
            wanted = requirement.required / requirement.value
        few = powers_of(_wide(state, width), 2, quotients=True)
        constants = powers_of(_wide(constant, width), 2, quotients=True)
        for p in products(wanted, group, (state, few), (constant, constants)):
            yield _with_factor(program, place, node, own, p)
    if term:
        wanted = requirement.required - requirement.value
        for p in products(wanted, group, (state, state_terms), (constant, constant_terms)):
            negative = p.number < 0
            text = total(source, node, p.text, subtract=negative)
            sign = "−" if negative else "+"
            said = f"{short(own)} lacks the term {sign} {p.text}"
            yield Candidate(place, text, said, "term", 1.5 + p.cost, None)
        for p in products(requirement.required, group, (state, few_of(state, width)), (constant, constant_terms)):
            sign = "-" if p.number < 0 else ""
            said = f"{short(own)} should be {sign}{p.text}"
            yield Candidate(place, f"{sign}{p.text}", said, "term", 2.0 + p.cost, None)


def few_of(state: Atoms, width: int) -> Table:
    """Products of at most two state-dependent atoms."""
    return powers_of(_wide(state, width), 2, quotients=False)


def _with_factor(
    program: Program, place: int, node: ast.expr, own: str, p: Product
) -> Candidate:
    source = program.source
    negative = p.number < 0
    divisors = [*([str(p.number.denominator)] if p.number.denominator != 1 else []), *p.below]
    only_below = not p.above and abs(p.number.numerator) == 1
    if only_below and divisors:
        divisor = divisors[0] if len(divisors) == 1 else f"({' * '.join(divisors)})"
        text = product(source, node, divisor, divide=True)
        said = f"{short(own)} must be divided by {' and '.join(divisors)}"
    elif not p.above and not divisors and abs(p.number) == 1:
        text, said = own, f"{short(own)} is right up to its sign"
    else:
        text = product(source, node, p.text)
        said = f"{short(own)} lacks the factor {p.text}"
    if negative:
        text = f"-({text})" if not only_below else f"-({text})"
        said += ", and has the wrong sign"
    kind = "number" if not p.above and not p.below else "factor"
    return Candidate(place, text, said, kind, 1.25 + p.cost + 0.5 * negative, None)


def _wide(atoms: Atoms, width: int) -> Atoms:
    if len(atoms):
        return atoms
    return Atoms((), np.empty((0, width)), 0)


def _number(
    program: Program, requirement: Requirement, node: ast.Constant
) -> Iterator[Candidate]:
    """Another number, where one number serves at all states and parameters."""
    x = requirement.required
    mean = float(np.mean(x))
    if not np.isfinite(mean) or np.ptp(x) > EXACT * abs(mean) or isinstance(node.value, bool):
        return
    digits = float(f"{mean:.6g}")
    simple = Fraction(mean).limit_denominator(60)
    if abs(digits - mean) <= EXACT * abs(mean):
        text, cost = repr(int(digits) if digits.is_integer() else digits), 1.0
    elif abs(float(simple) - mean) <= EXACT * abs(mean):
        text, cost = f"{simple.numerator} / {simple.denominator}", 1.1
    else:
        text, cost = repr(mean), 1.8
    said = f"{program.source.segment(node)} should be {text}"
    yield Candidate(requirement.place, text, said, "number", cost, None)
