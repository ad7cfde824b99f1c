"""Two edits, one after the other: the first makes one equation right, the second the whole function."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deltac.diagnosis.repair.candidates import Candidate
from deltac.diagnosis.repair.program import Program, at
from deltac.diagnosis.repair.rows import in_rows
from deltac.diagnosis.repair.samples import RIGHT, Target
from deltac.diagnosis.repair.search import Search
from deltac.diagnosis.repair.source import Source
from deltac.diagnosis.repair.texts import apply
from deltac.errors import InputError

FIRST = 24
"""First edits after which a second is looked for, cheapest first."""

TIME = 15.0
"""Time for it (s): nearly all that can be found is found early."""


def in_turn(search: Search, target: Target) -> Iterator[tuple[Candidate, Candidate]]:
    """Pairs of edits, found by reading the function again after each first one."""
    program = search.program
    wrong = _wrong(program)
    deadline = min(search.deadline, time.monotonic() + TIME)
    followed = 0
    for first in _closing(search, wrong, deadline):
        if followed == FIRST or time.monotonic() > deadline:
            return
        changed = apply(program.source, [first])
        if changed is None:
            continue
        try:
            again = at(changed, target, tuple(program.samples.parameters))
        except InputError:
            continue
        left = _wrong(in_rows(again) or again)
        if (left & ~wrong).any() or not (wrong & ~left).any():
            continue
        followed += 1
        then = Search(again, deadline)
        then.require()
        for second in then.single():
            place = _before(program.source, first, changed, second.place)
            if place is not None:
                yield first, replace(second, place=place, changes=None)


def _wrong(program: Program) -> NDArray[np.bool_]:
    """The equations that are not right."""
    return np.asarray(~(np.abs(program.original_residual).max(axis=1) < RIGHT))


def _closing(search: Search, wrong: NDArray[np.bool_], deadline: float) -> list[Candidate]:
    """Single edits that make one of the wrong equations right, cheapest first."""
    found: list[Candidate] = []
    for place in search.program.numbers:
        for row in np.flatnonzero(wrong):
            if time.monotonic() > deadline:
                break
            requirement = search.requirements.closing(place, int(row))
            if requirement is not None:
                found += search.edits(requirement)
    return sorted(found, key=lambda c: (c.cost, len(c.text), c.place))


def _before(source: Source, first: Candidate, changed: Source, place: int) -> int | None:
    """The place in the source of a node of the edited one; None where it is part of the edit."""
    _, end = source.span(source.nodes[first.place])
    shift = len(changed.text) - len(source.text)
    wanted = changed.nodes[place]
    a, b = changed.span(wanted)
    start, _ = source.span(source.nodes[first.place])
    if a >= end + shift:
        a, b = a - shift, b - shift
    elif b > start:
        return None
    for k, node in enumerate(source.nodes):
        if type(node) is type(wanted) and hasattr(node, "lineno") and source.span(node) == (a, b):
            return k
    return None
