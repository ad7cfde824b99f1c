"""The search for edits: what each expression must be, then the edits that make it so."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import HALF_DIGITS, SIX_DIGITS, Array
from deltac.errors import InputError
from deltac.repair.edits.candidates import EditCandidate, apply
from deltac.repair.edits.insertions import Vocabulary, insertions, sums
from deltac.repair.edits.names import Names, TracedNames
from deltac.repair.edits.required import EDIT_ITERATIONS, Requirement, Requirements, sizes
from deltac.repair.edits.single import additions, edits
from deltac.repair.edits.unsolved_form import unsolved_form
from deltac.repair.tracing.program import Program, at, formed
from deltac.repair.tracing.samples import RIGHT, Target
from deltac.repair.tracing.source import Source
from deltac.repair.tracing.tape import TapeChange

OPERATIONS = 20_000_000
"""Operations of a function that a search of one kind runs, about."""

SIMPLE = 1.25
"""With an edit as simple as one name or small number in hand, exchanges of two are not looked for."""

EditKind: TypeAlias = Callable[[Source, int, Names], Iterator[EditCandidate]]


@dataclass(eq=False, repr=False)
class EditSearch:
    """One program, and what is known of its expressions."""

    program: Program
    target: Target
    deadline: float = np.inf

    def __post_init__(self) -> None:
        self.names = TracedNames(self.program)
        self.vocabulary = Vocabulary(self.program, self.names)
        self.requirements = Requirements(self.program)

    def require(self) -> None:
        """Find what each expression must be."""
        for place in self.program.numbers:
            if time.monotonic() > self.deadline:
                break
            self.requirements.find(place)

    @property
    def sufficient(self) -> list[Requirement]:
        """The expressions any one of which could be the only mistake."""
        return [r for r in self.requirements.solved.values() if r.sufficient]

    def single(self) -> list[EditCandidate]:
        """Single edits that seem to make the function right, cheapest first."""
        right = [c for r in self.sufficient for c in self.edits(r)]
        numbers = self.program.numbers
        # Arrays, and what is evaluated more than once, have no one value that they must have.
        others = [place for place in self.program.trace.instances if place not in numbers]
        undecided = [*others, *self.requirements.undecided]
        right += self.passing(undecided, edits)
        if not any(c.cost <= SIMPLE for c in right):
            right += self.passing([p for p in others if self.names.shape(p)], additions)
        if not right:
            right += [c for r in self.sufficient for c in sums(self.program, r, self.vocabulary)]
        if not right:
            right += self.passing(undecided, additions)
        return sorted(right, key=_plainness)

    def edits(self, r: Requirement) -> Iterator[EditCandidate]:
        """Edits of one expression that give it the value it must have."""
        yield from (c for c, changes in self.tried([r.place], edits) if self._meets(r, changes))
        yield from insertions(self.program, r, self.vocabulary)
        if not r.unique:
            joined = self.tried([r.place], additions)
            yield from (c for c, changes in joined if self._meets(r, changes))

    def _meets(self, r: Requirement, changes: Mapping[int, TapeChange]) -> bool:
        """Whether an edit gives an expression its required value; by running it where there may be others."""
        if not r.unique:
            residual = self.program.residual(changes)
            return bool(np.abs(residual[list(r.rows)]).max() < RIGHT)
        if r.slot not in changes:
            return False
        change = changes[r.slot]
        with np.errstate(all="ignore"):
            x = change.operation(*(self.program.tape.values[k] for k in change.inputs))
        size = (r.weight * (np.abs(r.required) + np.abs(r.value))).max()
        return bool((r.weight * np.abs(x - r.required)).max() <= HALF_DIGITS * size)

    def tried(
        self, places: Iterable[int], kind: EditKind
    ) -> Iterator[tuple[EditCandidate, Mapping[int, TapeChange]]]:
        """Edits of some nodes with what they do to the tape, where it shows that."""
        for place in places:
            for candidate in kind(self.program.source, place, self.names):
                if time.monotonic() > self.deadline:
                    return
                changes = self.names.changes(candidate)
                if changes:
                    yield candidate, changes

    def passing(self, places: Iterable[int], kind: EditKind) -> list[EditCandidate]:
        """The edits of some nodes with which all equations are right."""
        return [c for c, changes in self.tried(places, kind) if self.program.passes(changes)]


def confirmed(
    source: Source, target: Target, edits: Sequence[EditCandidate], varied: tuple[str, ...]
) -> Source | None:
    """The edited source if it is right at states that the search has not seen, else None.

    Where the search varied parameters, they are varied again; an edit must not hide one.
    """
    changed = apply(source, edits)
    if changed is None:
        return None
    try:
        changed = formed(changed, target)
        again = at(changed, target, varied, fresh=True)
    except InputError:
        return None
    return changed if again.wrong < RIGHT else None


@dataclass(frozen=True, eq=False, repr=False)
class FirstEdit:
    """An edit that may be one of two: what it does to the residual (n, B), by which changes of the tape."""

    candidate: EditCandidate
    effect: Array
    changes: Mapping[int, TapeChange]


def pairs(
    search: EditSearch, plain: bool = False
) -> Iterator[Iterator[tuple[EditCandidate, EditCandidate]]]:
    """Pairs of edits that seem to make the function right, one kind after the other, cheapest first.

    `plain`: those only that are found without a second search.
    """
    rows = unsolved_form(search.program)
    searches = [search]
    if rows is not None:
        searches.insert(0, EditSearch(rows, search.target, search.deadline))
    pools = []
    for one in searches:
        pools.append(_first_edits(one))
        yield _adding_up(one, pools[-1])
    if plain:
        return
    for one, pool in zip(searches, pools):
        pool += _row_closings(one)
        yield _adding_up(one, pool)
        yield _followed(one, pool)


def _first_edits(search: EditSearch) -> list[FirstEdit]:
    """All edits of one node that put something else in its place, or a name beside it."""
    program = search.program
    base = program.original_residual
    pool: list[FirstEdit] = []
    places = [*program.numbers, *(p for p in program.trace.instances if p not in program.numbers)]
    varying = [place for place in places if not search.names.constant(place)]
    trials = itertools.chain(search.tried(places, edits), search.tried(varying, additions))
    for candidate, changes in itertools.islice(trials, OPERATIONS // 1000):
        effect = program.residual(changes) - base
        size = np.abs(effect).max()
        if np.isfinite(size) and size > RIGHT:
            pool.append(FirstEdit(candidate, effect, changes))
    return pool


def _adding_up(
    search: EditSearch, pool: list[FirstEdit]
) -> Iterator[tuple[EditCandidate, EditCandidate]]:
    """Two edits whose effects on the residual add up to what is needed.

    Where neither changes what the other acts on, R(both) = R(one) + R(other) − R(none), which must be zero;
    with all sums on a line (a random projection), partners are found by sorting.
    """
    base = search.program.original_residual
    if len(pool) < 2:
        return
    E = np.array([first.effect.ravel() for first in pool])
    effect = -base.ravel()
    line = np.random.default_rng(0).standard_normal(len(effect))
    place_on_line, goal = E @ line, float(effect @ line)
    order = np.argsort(place_on_line)
    sorted_places = place_on_line[order]
    matches = []
    width = HALF_DIGITS * (np.abs(effect).sum() + 1e-3)
    for i in range(len(pool)):
        need = goal - place_on_line[i]
        lo, hi = np.searchsorted(sorted_places, (need - width, need + width))
        for j in order[lo:hi]:
            if j <= i or pool[i].candidate.place == pool[j].candidate.place:
                continue
            if np.abs(E[i] + E[j] - effect).max() < HALF_DIGITS * np.abs(effect).max():
                matches.append((pool[i].candidate, pool[int(j)].candidate))
    matches.sort(key=lambda pair: pair[0].cost + pair[1].cost)
    yield from matches


def _row_closings(search: EditSearch) -> list[FirstEdit]:
    """What is missing from one of the wrong equations: single edits that make this one right."""
    program = search.program
    firsts: list[FirstEdit] = []
    right = np.abs(program.original_residual).max(axis=1) < RIGHT
    closings = itertools.product(program.numbers, np.flatnonzero(~right).tolist())
    for place, row in itertools.islice(closings, _turns(program, EDIT_ITERATIONS)):
        if time.monotonic() > search.deadline:
            break
        r = search.requirements.closing(place, row)
        if r is not None:
            changes = {r.slot: TapeChange.to(r.required)}
            effect = program.residual(changes) - program.original_residual
            terms = insertions(program, r, search.vocabulary)
            candidates = list(terms) or sums(program, r, search.vocabulary)
            firsts += [FirstEdit(candidate, effect, changes) for candidate in candidates]
    return firsts


def _turns(program: Program, runs: int) -> int:
    """How many of what runs a program so many times are within `OPERATIONS`."""
    return 1 + OPERATIONS // max(runs * len(program.tape), 1)


def _followed(
    search: EditSearch, firsts: list[FirstEdit]
) -> Iterator[tuple[EditCandidate, EditCandidate]]:
    """A first edit, and a second one of an expression that may have caused all that the first leaves.

    At each state an expression moves the residual along one direction, whatever its value. So a first edit
    is followed only where it leaves a residual along the direction of some expression.
    """
    program = search.program
    if len(program.original_residual) < 2:
        return  # one direction is all there is
    _, along = _directions(program)
    likely = (
        first
        for first in sorted(firsts, key=lambda f: (f.candidate.cost, f.candidate.place))
        if _explained(along, program.original_residual + first.effect).any()
    )
    for first in itertools.islice(likely, _turns(program, len(program.numbers))):
        if time.monotonic() > search.deadline:
            return
        for second in _second_edits(search, program.changed(first.changes)):
            yield first.candidate, second


def _plainness(candidate: EditCandidate) -> tuple[float, int, int]:
    return candidate.cost, len(candidate.text), candidate.place


def _directions(program: Program) -> tuple[NDArray[np.intp], Array]:
    """The places of the numbers of a program, and in which direction (n, B) each moves the residual."""
    places, along = [], []
    base = program.original_residual
    for place, instance in program.numbers.items():
        slot = instance.value.index
        value = program.values(slot)
        with np.errstate(all="ignore"):
            step = 1e-4 * sizes(value)
            slope = (program.residual({slot: TapeChange.to(value + step)}) - base) / step
            length = np.sqrt(np.sum(slope**2, axis=0))
        if np.isfinite(length).all() and length.max() > 0.0:
            places.append(place)
            along.append(slope / np.where(length > 1e-9 * length.max(), length, np.inf))
    return np.array(places, dtype=np.intp), np.array(along)


def _explained(along: Array, residual: Array) -> NDArray[np.bool_]:
    """Of which expressions (P,) a residual has the direction at all states."""
    if not len(along) or not np.isfinite(residual).all():
        return np.zeros(len(along), dtype=bool)
    share = np.einsum("pnb,nb->pb", along, residual)
    rest = np.sum((residual - share[:, None] * along) ** 2, axis=1)
    return np.asarray(np.sqrt(rest.max(axis=1)) < SIX_DIGITS * np.abs(residual).max())


def _second_edits(search: EditSearch, program: Program) -> list[EditCandidate]:
    """Edits of expressions that may have caused all that is wrong with a program after a first edit."""
    then = EditSearch(program, search.target, search.deadline)
    places, along = _directions(program)
    for place in places[_explained(along, program.original_residual)]:
        then.requirements.find(int(place))
    return sorted((c for r in then.sufficient for c in then.edits(r)), key=_plainness)
