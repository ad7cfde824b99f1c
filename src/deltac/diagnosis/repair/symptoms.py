"""What can be said of a mistake for which no edit was found: lines, terms, numbers that are none."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from deltac.diagnosis.localisation_terms import explain_residual
from deltac.diagnosis.repair.candidates import short
from deltac.diagnosis.repair.program import Program
from deltac.diagnosis.repair.samples import RIGHT, Target
from deltac.diagnosis.repair.source import Source


def suspects(source: Source, places: Iterable[int]) -> list[str]:
    """The lines of some nodes, in order, each with the widest of their expressions."""
    widest: dict[int, str] = {}
    for place in places:
        line = source.statement(place).lineno
        own = source.segment(source.nodes[place])
        if len(own) > len(widest.get(line, "")):
            widest[line] = own
    return [f"{source.name}:{line}: {short(text)}" for line, text in sorted(widest.items())]


def terms(program: Program, target: Target) -> tuple[str, ...]:
    """What each wrong equation's residual consists of, at the model's own parameters."""
    test = target.test()
    udot = program.run()[:, program.samples.group == 0]
    if not np.isfinite(udot).all():
        return ()
    found = []
    residual = test.residual(udot)
    for row in np.flatnonzero(~(np.abs(test.relative(udot)).max(axis=1) < RIGHT)):
        matches = explain_residual(test, residual[row], udot, int(row))
        if matches:
            said = " and ".join(map(str, matches))
            found.append(f"equation {row + 1} ({test.speeds[row]}): {said}")
    return tuple(found)


def undefined(program: Program, target: Target) -> str:
    """The first expression that is not a finite number in some state, with that state; else empty."""
    trace, tape, samples = program.trace, program.tape, program.samples
    for k in sorted(tape.before(trace.outputs)):
        finite = np.isfinite(tape.values[k])
        if finite.ndim > 1:  # the solution of linear equations
            finite = finite.all(axis=0)
        finite = np.broadcast_to(finite, samples.t.shape)
        if finite.all():
            continue
        at = int(np.flatnonzero(~finite)[0])
        place = tape.nodes[k]
        states = target.test().states
        names = (
            *(f"q.{name}" for name in states.coordinates),
            *(f"u.{name}" for name in states.speeds),
        )
        entries = zip(names, (*samples.q[:, at], *samples.u[:, at]))
        state = ", ".join(f"{name} = {value:.4g}" for name, value in entries)
        where = "its result"
        if place is not None:
            node = trace.source.nodes[place]
            line = getattr(node, "lineno", trace.source.statement(place).lineno)
            where = f"line {line}: {short(trace.source.segment(node))}"
        return f"{where} is not a finite number where {state}"
    return ""
