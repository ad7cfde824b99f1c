"""The search for edits: what each expression must be, then the edits that make it so."""

from __future__ import annotations

import ast
import itertools
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from deltac.diagnosis.repair.candidates import Candidate, short
from deltac.diagnosis.repair.insertions import Vocabulary, additions, insertions
from deltac.diagnosis.repair.interpreter import trace
from deltac.diagnosis.repair.program import Program, at
from deltac.diagnosis.repair.required import Requirement, Requirements
from deltac.diagnosis.repair.samples import RIGHT, Target
from deltac.diagnosis.repair.source import Source
from deltac.diagnosis.repair.substitutions import substitutions
from deltac.diagnosis.repair.tape import Change
from deltac.diagnosis.repair.texts import apply
from deltac.errors import InputError

SIMPLE = 1.25
"""With an edit as simple as one name or small number in hand, exchanges of two are not looked for."""


@dataclass(eq=False)
class Search:
    """One program, and what was found out about its expressions."""

    program: Program
    deadline: float = np.inf

    def __post_init__(self) -> None:
        self.vocabulary = Vocabulary(self.program)
        self.requirements = Requirements(self.program)

    def require(self) -> None:
        """Find what each expression must be."""
        for place in self.program.numbers:
            if time.monotonic() > self.deadline:
                break
            self.requirements.find(place)

    @property
    def whole(self) -> list[Requirement]:
        """The expressions any one of which could be the only mistake."""
        return [r for r in self.requirements.found.values() if r.whole]

    @property
    def partial(self) -> list[Requirement]:
        """The expressions that could be the mistake in some of the equations that are wrong."""
        return [r for r in self.requirements.found.values() if not r.whole]

    def single(self) -> list[Candidate]:
        """Single edits that seem to make the function right, cheapest first."""
        found = [c for r in self.whole for c in self.edits(r)]
        numbers = self.program.numbers
        # Arrays, and what is evaluated more than once, have no one value that they must have.
        others = [place for place in self.program.trace.instances if place not in numbers]
        found += self.tried([*others, *self.requirements.undecided])
        if not any(c.cost <= SIMPLE for c in found):
            found += self.exchanged()
        return sorted(found, key=lambda c: (c.cost, len(c.text), c.place))

    def tried(self, places: Iterable[int]) -> list[Candidate]:
        """Substitutions at some nodes that make the function right, found by running every one."""
        found: list[Candidate] = []
        for place in places:
            for candidate in itertools.chain(
                substitutions(self.program, place), additions(self.program, place)
            ):
                if time.monotonic() > self.deadline:
                    return found
                if candidate.changes and self.program.passes(candidate.changes):
                    found.append(candidate)
        return found

    def edits(self, r: Requirement) -> Iterator[Candidate]:
        """Edits of one expression that give it the value it must have."""
        for candidate in substitutions(self.program, r.place):
            if candidate.changes and self.meets(r, candidate.changes):
                yield candidate
        yield from insertions(self.program, r, self.vocabulary)
        if not r.unique:
            yield from (
                c for c in additions(self.program, r.place) if self.meets(r, c.changes or {})
            )

    def meets(self, r: Requirement, changes: Mapping[int, Change]) -> bool:
        """Whether an edit gives an expression its required value; by running it where there may be others."""
        if not r.unique:
            residual = self.program.residual(changes)
            return bool(np.abs(residual[list(r.rows)]).max() < RIGHT)
        change = changes[r.slot]
        with np.errstate(all="ignore"):
            x = change.operation(*(self.program.tape.values[k] for k in change.inputs))
        size = np.abs(r.required).max() + np.abs(r.value).max()
        return bool(np.abs(x - r.required).max() <= 1e-7 * size)

    def exchanged(self) -> list[Candidate]:
        """Two elements of a list or of an unpacking exchanged: found by reading the text again."""
        source = self.program.source
        found: list[Candidate] = []
        for place, node in enumerate(source.nodes):
            if not isinstance(node, ast.Tuple | ast.List) or not 2 <= len(node.elts) <= 6:
                continue
            if isinstance(source.nodes[source.parent[place]], ast.Subscript):
                continue
            for i in range(len(node.elts)):
                for j in range(i + 1, len(node.elts)):
                    if time.monotonic() > self.deadline:
                        return found
                    candidate = _exchange(source, place, node, i, j)
                    if candidate is not None and self._right(candidate):
                        found.append(candidate)
        return found

    def _right(self, candidate: Candidate) -> bool:
        changed = apply(self.program.source, [candidate])
        if changed is None:
            return False
        samples = self.program.samples
        nominal = samples.group == 0
        try:
            found = trace(changed, samples.t[nominal], samples.q[:, nominal], samples.u[:, nominal])
        except InputError:
            return False
        off = found.tape.run(found.outputs) - samples.acceleration[:, nominal]
        r = np.einsum("bij,jb->ib", samples.M[nominal], off) / samples.typical[:, nominal]
        return bool(np.abs(r).max() < RIGHT)


def _exchange(
    source: Source, place: int, node: ast.Tuple | ast.List, i: int, j: int
) -> Candidate | None:
    first, second = source.segment(node.elts[i]), source.segment(node.elts[j])
    if first == second or len(first) + len(second) > 200:
        return None
    start, end = source.span(node)
    (a, b), (c, d) = source.span(node.elts[i]), source.span(node.elts[j])
    text = source.text[start:a] + second + source.text[b:c] + first + source.text[d:end]
    words = f"{short(first, 40)} and {short(second, 40)} should be exchanged"
    return Candidate(place, text, words, "order", 1.2, None)


def confirmed(
    source: Source, target: Target, edits: Sequence[Candidate], varied: tuple[str, ...]
) -> Source | None:
    """The edited source if it is right at states that the search has not seen, else None.

    Where the search varied parameters, they are varied again; an edit must not hide one.
    """
    changed = apply(source, edits)
    if changed is None:
        return None
    try:
        program = at(changed, target, varied, fresh=True)
    except InputError:
        return None
    return changed if program.wrong < RIGHT else None
