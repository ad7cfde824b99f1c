"""Edits of functions that cannot be traced: derived by SymPy or JAX, or built as a CasADi graph."""

from __future__ import annotations

import ast
import itertools
import time
from collections.abc import Iterable, Iterator

from deltac.errors import InputError
from deltac.repair import sandbox
from deltac.repair.edits.candidates import EditCandidate, apply
from deltac.repair.edits.names import TextNames, valued
from deltac.repair.edits.single import additions, edits, structure
from deltac.repair.tracing.samples import RIGHT, StateSamples
from deltac.repair.tracing.source import Source

MOST_RUNS = 4000
"""Edits that are tried."""

RUNS_EACH = 200
"""Edits that one process tries: what it imports is loaded once."""

COST_MARGIN = 0.25
"""Edits that cost this much more than the least one that is right are not tried."""


def text_edits(source: Source, statements: Iterable[ast.stmt]) -> list[EditCandidate]:
    """All single edits of some statements, cheapest first."""
    names = TextNames(source)
    candidates: list[EditCandidate] = []
    for statement in statements:
        if isinstance(statement, ast.Import | ast.ImportFrom):
            continue
        for node in ast.walk(statement):
            place = source.number.get(id(node))
            if place is None or not isinstance(node, ast.expr | ast.stmt):
                continue
            candidates += structure(source, place, names)
            if isinstance(node, ast.AugAssign) or valued(source, place):
                candidates += edits(source, place, names)
                candidates += additions(source, place, names)
    return sorted(candidates, key=lambda c: (c.cost, c.place))


def right_edits(
    source: Source, samples: StateSamples, deadline: float
) -> list[tuple[tuple[EditCandidate, ...], Source]]:
    """Single edits that make the function right where it is run, cheapest first, with what they make."""
    statements = sandbox.module_for(source.module, source.qualified.partition(".")[0]).body
    right: list[tuple[tuple[EditCandidate, ...], Source]] = []
    tasks = _tasks(source, text_edits(source, statements))
    while some := list(itertools.islice(tasks, RUNS_EACH)):
        limit = max(deadline - time.monotonic(), 1.0)
        answers = sandbox.stream([one for _, _, one in some], samples, limit)
        for (candidate, changed, _), answer in zip(some, answers):
            late = time.monotonic() > deadline
            if late or (right and candidate.cost > right[0][0][0].cost + COST_MARGIN):
                answers.close()
                return right
            if isinstance(answer, str) or not samples.fits(answer):
                continue
            if samples.wrong(answer) < RIGHT:
                right.append(((candidate,), changed))
    return right


def _tasks(
    source: Source, candidates: Iterable[EditCandidate]
) -> Iterator[tuple[EditCandidate, Source, sandbox.SandboxTask]]:
    """Each candidate with the source that it makes and what is run; those of one text once."""
    texts = {source.text}
    for candidate in candidates:
        changed = apply(source, [candidate])
        if changed is None or changed.text in texts:
            continue
        texts.add(changed.text)
        try:
            one = sandbox.task(changed)
        except InputError:  # no Python any more
            continue
        if one is not None and len(texts) <= MOST_RUNS:
            yield candidate, changed, one
