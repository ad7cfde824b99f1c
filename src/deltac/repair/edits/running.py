"""Edits of functions that cannot be traced: derived by SymPy or JAX, or built as a CasADi graph."""

from __future__ import annotations

import ast
import time

from deltac.errors import InputError
from deltac.repair.edits.candidates import EditCandidate, EditedSource, apply
from deltac.repair.edits.names import TextNames, valued
from deltac.repair.edits.single import additions, edits
from deltac.repair.sandbox import module_for, sandbox, task
from deltac.repair.tracing.samples import StateSamples
from deltac.repair.tracing.source import Source

MOST_RUNS = 4000
"""Edits that are tried."""

RUN_TIME = 10.0
"""Time in which Python runs an edited function (s)."""


def right_edits(source: Source, samples: StateSamples, deadline: float) -> list[EditedSource]:
    """Single edits that make the function right where it is run, cheapest first."""
    right: list[EditedSource] = []
    texts = {source.text}
    own = task(source)
    with sandbox() as run:
        if own is None or isinstance(run(own, samples, RUN_TIME), str):
            return []  # nor do its edits run
        for candidate in _text_edits(source):
            seconds = deadline - time.monotonic()
            if seconds < 0.0 or len(texts) > MOST_RUNS:
                break
            if right and candidate.cost > right[0][0][0].cost:
                break
            changed = apply(source, [candidate])
            if changed is None or changed.text in texts:
                continue
            texts.add(changed.text)
            try:
                one = task(changed)
            except InputError:  # no Python any more
                continue
            answer = "" if one is None else run(one, samples, min(seconds, RUN_TIME))
            if samples.right(answer):
                right.append(((candidate,), changed))
    return right


def _text_edits(source: Source) -> list[EditCandidate]:
    """All single edits of what a function needs of its module, cheapest first."""
    names = TextNames(source)
    candidates: list[EditCandidate] = []
    for statement in module_for(source.module, source.qualified.partition(".")[0]).body:
        if isinstance(statement, ast.Import | ast.ImportFrom):
            continue
        for node in ast.walk(statement):
            place = source.number.get(id(node))
            if place is not None and valued(source, place):
                candidates += edits(source, place, names)
                candidates += additions(source, place, names)
    return sorted(candidates, key=lambda c: (c.cost, c.place))
