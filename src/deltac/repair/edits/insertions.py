"""Edits that put in what is missing: factors, terms, numbers, from the value that is required."""

from __future__ import annotations

import ast
import itertools
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import HALF_DIGITS, SAME, Array
from deltac.repair.edits.candidates import (
    ATOMS,
    EditCandidate,
    functions_used,
    negated,
    number_cost,
    product,
    short,
    total,
    variable,
)
from deltac.repair.edits.names import TracedNames
from deltac.repair.edits.required import Requirement
from deltac.repair.tracing.program import Program
from deltac.repair.tracing.source import Source
from deltac.results import SHOWN

TRIPLE = 40
"""Names and functions that are multiplied three at a time."""

SUMMED = 24
"""Constants of which sums and differences of two are taken as well."""

SUM_TRIPLE = SUMMED // 2
"""Names and functions that are multiplied three at a time where two products are added."""

MOST_SUMMED, MOST_PAIRS = 3000, 40
"""Products of which two are added, and pairs of them that are tried."""

FEWEST_STATES = 6
"""States that tell chance from a formula of two numbers, or of none."""

MOST_EXPRESSIONS = 60
"""Expressions of the source that are taken as parts of what is missing."""


@dataclass(eq=False, repr=False)
class Vocabulary:
    """Atoms at the places of a program, and their products, made once for each scope."""

    program: Program
    names: TracedNames
    _atoms: dict[tuple[object, ...], tuple[Atoms, Atoms]] = field(default_factory=dict)
    _tables: dict[tuple[object, ...], TermTable] = field(default_factory=dict)
    _known: dict[int, dict[str, tuple[int, set[str]]]] = field(default_factory=dict)

    def atoms(self, requirement: Requirement) -> tuple[Atoms, Atoms]:
        """State-dependent and constant atoms that may stand where a node stands."""
        program = self.program
        instances = program.trace.instances[requirement.place]
        names = {**program.trace.scope, **instances[0].scope}
        owner = program.source.owner(requirement.place)
        later = {requirement.slot, *program.tape.after(requirement.slot)}
        first, *others = (
            {text: slot.index for text, slot in self.names.scope(instance)[0].items()}
            for instance in instances
        )
        variables = {  # one name must hold one value at all evaluations
            text: k
            for text, k in first.items()
            if k not in later and all(scope.get(text) == k for scope in others)
        }
        expressions = {
            text: slot
            for text, (slot, used) in self._expressions(owner).items()
            if slot not in later and used <= names.keys() and text not in variables
        }
        key = (id(owner), tuple(variables), tuple(expressions))
        if key not in self._atoms:
            self._atoms[key] = (
                self._side(variables, expressions, varying=True),
                self._side(variables, expressions, varying=False),
            )
        return self._atoms[key]

    def _side(self, variables: dict[str, int], expressions: dict[str, int], varying: bool) -> Atoms:
        program = self.program

        def chosen(slots: dict[str, int]) -> dict[str, Array]:
            alike = (text for text, k in slots.items() if program.tape.varying[k] == varying)
            return {text: program.values(slots[text]) for text in alike}

        named = chosen(variables)
        parts = dict(itertools.islice(chosen(expressions).items(), MOST_EXPRESSIONS))
        sines = self._sines(variables, expressions) if varying else {}
        names, together = len(named), {**named, **parts, **sines}
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

    def products(
        self, requirement: Requirement, value: Array, node: Array | None = None
    ) -> list[Product]:
        """Products of three atoms that equal `value` (B,); or of two, or quotients, that times `node` do."""
        state, constant = self.atoms(requirement)
        degree, weight = (3, requirement.weight) if node is None else (2, requirement.weight * node)
        terms = self.table(state, degree, node is not None).times(weight)
        constants, group = self.table(constant, degree, True), self.program.samples.group
        matches = [
            _product(number, terms, k, constants, row)
            for k, coefficient in _coefficients(requirement.weight * value, group, terms)
            for number, row in _numbers(coefficient, constants)
        ]
        return sorted(matches, key=_plainness)[:SHOWN]

    def table(self, atoms: Atoms, degree: int, quotients: bool, triple: int = TRIPLE) -> TermTable:
        """`powers_of`, kept; of three at a time, the first `triple` at most."""
        # Constants of the same texts have the same values; others may have been set again.
        constant = atoms.values.shape[1] < len(self.program.samples.t)
        triple = min(atoms.triple, triple)
        key = (atoms.texts if constant else atoms, degree, quotients, triple)
        if key not in self._tables:
            self._tables[key] = powers_of(replace(atoms, triple=triple), degree, quotients)
        return self._tables[key]

    def _expressions(self, owner: ast.AST) -> dict[str, tuple[int, set[str]]]:
        """Expressions of a function with their slots and the names they use, the likeliest parts first."""
        if id(owner) in self._known:
            return self._known[id(owner)]
        program = self.program
        ranked: list[tuple[int, str, int, set[str]]] = []
        for place, instance in program.numbers.items():
            node = program.source.nodes[place]
            if isinstance(node, ast.BinOp | ast.Call) and program.source.owner(place) is owner:
                text = " ".join(program.source.segment(node).split())
                used = {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}
                rank = 0 if isinstance(node, ast.Call) else _RANKS.get(type(node.op), 3)
                if not text.startswith(("-", "+")) and "#" not in text:
                    ranked.append((rank, text, instance.value.index, used))
        parts = self._known[id(owner)] = {}
        for _, text, slot, used in sorted(ranked, key=lambda x: (x[0], len(x[1]))):
            parts.setdefault(text, (slot, used))
        return parts

    def _sines(self, variables: dict[str, int], expressions: dict[str, int]) -> dict[str, Array]:
        """Sines and cosines of coordinates that the source does not have yet."""
        program = self.program
        inputs = program.trace.inputs[1 : 1 + len(program.samples.q)]
        coordinates = [program.tape.values[k] for k in inputs]
        terms = {
            f"{called}({text})": getattr(np, name)(program.values(k))
            for name, called in functions_used(program.source).items()
            for text, k in variables.items()
            if any(program.tape.values[k] is value for value in coordinates)
        }
        return {text: value for text, value in terms.items() if text not in expressions}


_RANKS: dict[type[ast.operator], int] = {ast.Add: 1, ast.Sub: 1, ast.Pow: 1, ast.Mult: 2}
"""Sums and powers before products, which are made of names anyway."""


def insertions(
    program: Program, requirement: Requirement, vocabulary: Vocabulary
) -> Iterator[EditCandidate]:
    """Edits that give a node the value it must have by a factor, a term or a number."""
    source, place = program.source, requirement.place
    node = source.nodes[place]
    if not isinstance(node, ast.expr):
        return
    parent = source.nodes[source.parent[place]]
    if isinstance(node, ast.UnaryOp) and isinstance(node.operand, ast.Constant):
        yield from _number(program, requirement, node)  # a number with its sign
    if isinstance(node, ast.Constant):
        yield from _number(program, requirement, node)
        return
    outer = type(parent.op) if isinstance(parent, ast.BinOp) else None
    # A factor of a product that is one number is put in there.
    inner = outer in (ast.Mult, ast.Div) and source.parent[place] in program.numbers
    factor = not inner and not isinstance(parent, ast.UnaryOp)
    term = outer not in (ast.Add, ast.Sub)
    edit = partial(EditCandidate, source, place)
    if factor:
        factors = vocabulary.products(requirement, requirement.required, requirement.value)
        yield from _factors(program, place, factors)
    if term:
        difference = requirement.required - requirement.value
        for p in vocabulary.products(requirement, difference):
            new = total(node, variable(p.text), subtract=p.number < 0)
            words = f"{_named(source, node)} lacks the term {'−' if p.number < 0 else '+'} {p.text}"
            outside = 0.0 if isinstance(node, ast.BinOp) else 0.05
            yield edit(new, "term", 1.5 + p.cost + outside, words)


def sums(
    program: Program, requirement: Requirement, vocabulary: Vocabulary
) -> Iterator[EditCandidate]:
    """Edits that give a node its value by two terms: both are missing, or should stand there alone."""
    source, place = program.source, requirement.place
    node = source.nodes[place]
    if not isinstance(node, ast.expr) or isinstance(node, ast.Constant):
        return
    state, constant = vocabulary.atoms(requirement)
    group, weight = program.samples.group, requirement.weight
    few = vocabulary.table(state, 3, False, triple=SUM_TRIPLE).times(weight)
    constants = vocabulary.table(constant, 3, True)
    for missing in (True, False):
        old = requirement.value * missing
        value, but = (requirement.required - old) * weight, -old * weight
        matches = two_products(value, group, few, constants, but)
        matches.sort(key=lambda pair: (pair[0].cost + pair[1].cost, pair[0].text))
        for p, q in matches[:SHOWN]:
            p, q = (p, q) if p.number > 0 else (q, p)
            both = f"{'-' if p.number < 0 else ''}{p.text} {'-' if q.number < 0 else '+'} {q.text}"
            new: ast.expr | str = both
            words = ""
            if missing:
                new = total(node, variable(p.text), p.number < 0)
                new = total(new, variable(q.text), q.number < 0)
                words = f"{_named(source, node)} lacks the terms {both}"
            yield EditCandidate(source, place, new, "term", 2.0 + p.cost + q.cost, words)


def _named(source: Source, node: ast.expr) -> str:
    """What an expression is called in words: the variable that it is assigned to, or its text."""
    parent = source.nodes[source.parent[source.number[id(node)]]]
    if isinstance(parent, ast.Assign) and isinstance(parent.targets[0], ast.Name):
        return parent.targets[0].id
    return short(source.segment(node))


def _factors(program: Program, place: int, factors: Iterable[Product]) -> Iterator[EditCandidate]:
    """A node times products; what is a sign alone is no insertion."""
    node: Any = program.source.nodes[place]
    own = short(program.source.segment(node))
    for p in factors:
        divisors, negative = p.divisors, p.number < 0
        if p.above or abs(p.number.numerator) != 1:
            new = product(node, variable(p.text))
            words = f"{own} lacks the factor {p.text}"
        elif divisors:
            divisor = divisors[0] if len(divisors) == 1 else f"({' * '.join(divisors)})"
            new = product(node, variable(divisor), divide=True)
            words = f"{own} must be divided by {' and '.join(divisors)}"
        else:
            continue
        if negative:
            new, words = negated(new), f"{words}, and has the wrong sign"
        kind = "factor" if p.above or p.below else "number"
        yield EditCandidate(program.source, place, new, kind, 1.25 + p.cost + 0.5 * negative, words)


def _number(program: Program, requirement: Requirement, node: ast.expr) -> Iterator[EditCandidate]:
    """Another number, where one number serves at all states and parameters."""
    x = requirement.required
    mean = float(np.mean(x))
    if not np.isfinite(mean) or np.ptp(x) > SAME * abs(mean):
        return
    digits = float(f"{mean:.6g}")
    simple = Fraction(mean).limit_denominator(60)
    if abs(digits - mean) <= SAME * abs(mean):
        text = repr(int(digits) if digits.is_integer() else digits)
        cost = number_cost(digits)
    elif abs(float(simple) - mean) <= SAME * abs(mean):
        text, cost = f"{simple.numerator} / {simple.denominator}", 1.6
    else:
        text, cost = repr(mean), 1.9
    yield EditCandidate(program.source, requirement.place, text, "number", cost)


PLAIN_FACTORS = tuple(
    sorted({Fraction(a, b) for a in range(1, 13) for b in (1, 2, 3, 4, 5, 6, 8, 12)}, key=float)
)
"""Numbers that occur as factors in equations of motion."""


Powers = tuple[tuple[int, int], ...]


@dataclass(frozen=True, eq=False)
class Atoms:
    """Texts and their values, (A, B), or (A, G) of constants; simple ones first.

    The first `names` are single names; the first `core` are multiplied with every other, the first `triple`
    with each other three at a time.
    """

    texts: tuple[str, ...]
    values: Array
    names: int
    core: int
    triple: int

    def __len__(self) -> int:
        return len(self.texts)


@dataclass(frozen=True)
class Product:
    """number × Π above / Π below; `cost` counts its parts."""

    number: Fraction
    above: tuple[str, ...]
    below: tuple[str, ...]
    cost: float

    @property
    def divisors(self) -> list[str]:
        """All that it is divided by."""
        bottom = self.number.denominator
        return [*([str(bottom)] if bottom != 1 else []), *self.below]

    @property
    def text(self) -> str:
        """As Python writes it, without its sign."""
        top = abs(self.number.numerator)
        factors = ([str(top)] if top != 1 or not self.above else []) + list(self.above)
        return " / ".join([" * ".join(factors), *self.divisors])


@dataclass(frozen=True, eq=False)
class TermTable:
    """Products of atoms: values (K, ·), and blocks of (indices of atoms (k, degree), their powers)."""

    atoms: Atoms
    values: Array
    blocks: tuple[tuple[NDArray[np.intp], tuple[int, ...]], ...]

    def times(self, weight: Array) -> TermTable:
        """The products times a number (B,)."""
        with np.errstate(all="ignore"):
            return replace(self, values=self.values * weight)

    def powers(self, k: int) -> Powers:
        """Which atoms the product k is of."""
        for indices, powers in self.blocks:
            if k < len(indices):
                return tuple((int(i), power) for i, power in zip(indices[k], powers))
            k -= len(indices)
        raise IndexError(k)


def powers_of(atoms: Atoms, degree: int, quotients: bool) -> TermTable:
    """Products of at most `degree` atoms, with quotients and reciprocals of names if wanted."""
    A, n, V = len(atoms), atoms.names, atoms.values
    blocks: list[tuple[NDArray[np.intp], tuple[int, ...]]] = [(np.empty((1, 0), dtype=np.intp), ())]
    if A:
        blocks.append((np.arange(A)[:, None], (1,)))
        i, j = np.triu_indices(A)
        keep = (i < atoms.core) | (i == j)
        blocks.append((np.stack([i[keep], j[keep]], axis=1), (1, 1)))
        if degree >= 3:
            blocks.append((_triples(atoms.triple), (1, 1, 1)))
        if quotients:
            blocks.append((np.arange(A)[:, None], (-1,)))
            blocks.append((np.stack(np.triu_indices(n), axis=1), (-1, -1)))
            blocks.append((_triples(min(n, SUM_TRIPLE)), (-1, -1, -1)))  # 1/(m l²)
            i, j = (x.ravel() for x in np.indices((n, n)))
            blocks.append((np.stack([i, j], axis=1)[i != j], (1, -1)))
            blocks.append((np.stack([i, j, j], axis=1)[i != j], (1, -1, -1)))  # I/r², k/r²
    with np.errstate(all="ignore"):
        columns = []
        for indices, powers in blocks:
            product = np.ones((len(indices), V.shape[1]))
            for column, power in zip(indices.T, powers):
                product = product * V[column] if power > 0 else product / V[column]
            columns.append(product)
    return TermTable(atoms, np.concatenate(columns), tuple(blocks))


@lru_cache(maxsize=64)
def _triples(count: int) -> NDArray[np.intp]:
    """Three of `count`, repetitions allowed, each once."""
    triples = list(itertools.combinations_with_replacement(range(count), 3))
    return np.array(triples, dtype=np.intp).reshape(-1, 3)


def _coefficients(
    value: Array, group: NDArray[np.intp], state: TermTable
) -> Iterator[tuple[int, Array]]:
    """Products of what depends on the state, each with the constants (G,) that make it equal `value` (B,)."""
    S, starts = state.values, np.searchsorted(group, np.arange(group[-1] + 1))
    with np.errstate(all="ignore"):
        squares = np.add.reduceat(S * S, starts, axis=1)
        coefficients = np.add.reduceat(S * value, starts, axis=1) / squares
        error = np.maximum.reduceat(np.abs(value - coefficients[:, group] * S), starts, axis=1)
        fits = error <= HALF_DIGITS * np.maximum.reduceat(np.abs(value), starts)
    for k in np.flatnonzero(fits.all(axis=1) & coefficients.any(axis=1)):
        yield int(k), coefficients[k]


def two_products(
    value: Array, group: NDArray[np.intp], state: TermTable, constant: TermTable, but: Array
) -> list[tuple[Product, Product]]:
    """Pairs of products whose sum equals `value` (B,), none of them equal to `but` (B,).

    A term that takes off what stands there is no missing one: the other stands in its place. By least squares
    over the states of the first set of parameters, for all pairs at once from the Gram
    matrix; those that fit are tried at the others.
    """
    values, nominal = state.values, group == 0
    if nominal.sum() < FEWEST_STATES or len(values) > MOST_SUMMED:
        return []
    S, y = values[:, nominal], value[nominal]
    with np.errstate(all="ignore"):
        S = S / np.linalg.norm(S, axis=1, keepdims=True)
    usable = np.isfinite(S).all(axis=1)
    S = np.where(usable[:, None], S, 0.0)
    c, G = S @ y, S @ S.T
    independence = 1.0 - G**2
    independence[:, ~usable] = independence[~usable] = 0.0
    with np.errstate(all="ignore"):
        squares = y @ y - (c[:, None] ** 2 + c**2 - 2.0 * np.outer(c, c) * G) / independence
    near = np.argwhere(np.triu((independence > 1e-6) & (squares < 1e-8 * (y @ y)), 1))
    matches = []
    for i, j in near[:MOST_PAIRS]:
        columns = values[[i, j]]
        coefficients = np.empty((2, group[-1] + 1))
        for g in range(group[-1] + 1):
            some = group == g
            coefficients[:, g] = np.linalg.lstsq(columns[:, some].T, value[some], rcond=None)[0]
        terms = coefficients[:, group] * columns
        size = np.abs(terms).max(axis=1)
        if (
            np.abs(value - terms.sum(axis=0)).max() > HALF_DIGITS * np.abs(value).max()
            or size.min() < 1e-6 * np.abs(y).max()  # one of them is not needed
            or (np.abs(terms - but).max(axis=1) <= HALF_DIGITS * size).any()
        ):
            continue
        sides = [
            [_product(x, state, int(k), constant, row) for x, row in _numbers(numbers, constant)]
            for k, numbers in zip((i, j), coefficients)
        ]
        if all(sides):
            first, second = (min(side, key=_plainness) for side in sides)
            matches.append((first, second))
    return matches


def _numbers(coefficient: Array, table: TermTable) -> list[tuple[Fraction, int]]:
    """Fractions times products of constants that equal a coefficient in every group."""
    with np.errstate(all="ignore"):
        ratio = coefficient / table.values
        middle = ratio[:, 0]
        same = np.abs(ratio - middle[:, None]).max(axis=1) <= HALF_DIGITS * np.abs(middle)
        place, near = _plain_factors(middle)
    return [(_signed(place[k], middle[k]), int(k)) for k in np.flatnonzero(same & near)]


def _plain_factors(numbers: Array) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Which plain factors come nearest to the sizes of some numbers, and whether they are these sizes."""
    factors, sizes = np.array([float(f) for f in PLAIN_FACTORS]), np.abs(numbers)
    place = np.clip(np.searchsorted(factors, sizes), 1, len(factors) - 1)
    place = np.where(sizes - factors[place - 1] < factors[place] - sizes, place - 1, place)
    return place, np.abs(factors[place] - sizes) <= HALF_DIGITS * factors[place]


def _signed(place: int, number: float) -> Fraction:
    """A plain factor with the sign of a number."""
    return PLAIN_FACTORS[place] * (1 if number > 0.0 else -1)


def _plainness(product: Product) -> tuple[float, str]:
    return product.cost, product.text


def _product(number: Fraction, state: TermTable, k: int, constant: TermTable, row: int) -> Product:
    """A number times a product of constants times one of what depends on the state."""
    above: list[str] = []
    below: list[str] = []
    cost = 0.0 if abs(number) == 1 else 0.35 + 0.05 * (number.denominator not in (1, 2))
    for table, entry in ((constant, row), (state, k)):
        for (place, power), times in Counter(table.powers(entry)).items():
            text = table.atoms.texts[place]
            single = place < table.atoms.names
            bound = _binding(text)
            cost += 0.25 * (1 + 0.5 * (times - 1)) + (0.0 if single else 0.1 if bound else 0.3)
            if power < 0 and table is state:
                cost += 0.35  # nobody forgets to divide by a speed
            side = above if power > 0 else below
            own = text if bound >= (3 if times > 1 else 2 if power < 0 else 1) else f"({text})"
            side.append(own if times == 1 else f"{own}**{times}")
    return Product(number, tuple(above), tuple(below), cost)


@lru_cache(maxsize=4096)
def _binding(text: str) -> int:
    """How tightly a text holds together: 3 a name or call, 2 a power, 1 a product, 0 a sum."""
    node = ast.parse(text, mode="eval").body
    if isinstance(node, ATOMS):
        return 3
    return {ast.Pow: 2, ast.Mult: 1}.get(type(node.op), 0) if isinstance(node, ast.BinOp) else 0
