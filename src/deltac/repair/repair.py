"""`repair_equations`: which edit of the source makes equations of motion right."""

from __future__ import annotations

import ast
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from deltac.arrays import Array
from deltac.diagnosis.check.check import chosen_map
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.models import ModelLike, load_model
from deltac.repair import sandbox
from deltac.repair.edits.candidates import Candidate, unified_diff
from deltac.repair.edits.search import Search, confirmed, pairs
from deltac.repair.outcome import Fix, Repair, suspects, terms, undefined
from deltac.repair.tracing.interpreter import trace
from deltac.repair.tracing.library import flatten
from deltac.repair.tracing.program import Program, named_parameters, read
from deltac.repair.tracing.samples import RIGHT, Target
from deltac.repair.tracing.source import Source, read_source
from deltac.repair.tracing.tape import ELEMENTARY, Slot
from deltac.simulation.equations import Equations

TIME_LIMIT = 60.0
"""Time for a search (s)."""

GROUPS = 8
"""Statements in which repairs are reported."""

TRIED = 120
"""Edits that are tried on fresh states, cheapest first."""

ALIKE = 4
"""Ways to write a repair that are reported for one statement."""

DEARER = 1.6
"""Edits that cost this much more than the least one are not reported."""

AGREE = 1e-7
"""Two results that differ by less than this (relative) are the same: rounding is amplified by solving."""

PERTURBED = 0.37
"""By up to this share, named constants are moved to tell formulas apart that agree at one set of numbers."""


def repair_equations(
    model: ModelLike,
    rhs: str | Path | Callable[..., Any] | Equations,
    *,
    coordinates: CoordinateMap | str | None = None,
    seed: int = 0,
    time_limit: float = TIME_LIMIT,
) -> Repair:
    """Find the edit of a function's source that makes its equations of motion right.

    The source is read, not run: every operation is followed at random states of the mechanism, and for every
    expression the value is found that it must have had. Edits (signs, operators, names, indices,
    functions, powers, numbers, missing or superfluous factors and terms; two of them where one does not
    suffice) are sought that give these values. All that pass are tested at fresh states, at other parameters
    where the function names its constants as the mechanism does, and by running the edited function in a
    process of its own. The file is left as it is.

    Args:
        model: a Mechanism, a Problem or a problem's name, a model file.
        rhs: ``"FILE.py:FUNCTION"``, a function of (t, q, u) that returns u̇, or `dc.Equations`.
        coordinates: the function's own coordinates, as for `check_equations`.
        seed: of the random states.
        time_limit: of the search (s).

    Raises:
        InputError: no source, no Python, or a function with branches on the state, side effects, endless
            loops, classes, or calls that are not understood; file and line are named.
    """
    found = load_model(model)
    if isinstance(rhs, Equations):
        chosen = rhs.coordinates if coordinates is None else chosen_map(found, coordinates)
        rhs = rhs.rhs
    else:
        chosen = chosen_map(found, coordinates)
    return repair_source(read_source(rhs), Target(found.mechanism, chosen, seed), time_limit)


def repair_source(source: Source, target: Target, time_limit: float = TIME_LIMIT) -> Repair:
    """`repair_equations` for a source and a target at hand."""
    start = time.monotonic()
    deadline = start + time_limit
    program = read(source, target)
    if program.wrong < RIGHT:
        return _report(program, target, [], start, deadline)
    found, suspected = _search(program, target, deadline)
    coincidence = False
    if not found and program.samples.parameters:
        # Its numbers may hold for the model's parameters only; then an edit may fit these by chance.
        plain = read(source, target, vary=False)
        found, more = _search(plain, target, deadline)
        if found or not suspected:
            program, suspected, coincidence = plain, more, True
    return _report(program, target, found, start, deadline, suspected, coincidence)


def _search(
    program: Program, target: Target, deadline: float
) -> tuple[list[tuple[tuple[Candidate, ...], Source]], list[str]]:
    """Edits with the sources they make, confirmed, cheapest first; and the suspects."""
    search = Search(program, deadline)
    search.require()
    found = _confirm(program, target, ((c,) for c in search.single()), deadline)
    if not found:
        found = _confirm(program, target, pairs(search, target), deadline)
    return found, suspects(program.source, [r.place for r in search.whole])


def _confirm(
    program: Program,
    target: Target,
    candidates: Iterable[tuple[Candidate, ...]],
    deadline: float,
) -> list[tuple[tuple[Candidate, ...], Source]]:
    varied = tuple(program.samples.parameters)
    found: list[tuple[tuple[Candidate, ...], Source]] = []
    seen: set[str] = set()
    places: dict[tuple[int, ...], int] = {}
    cheapest = np.inf
    for tried, edits in enumerate(candidates):
        cost = sum(e.cost for e in edits)
        if tried >= TRIED or time.monotonic() > deadline or cost > cheapest + DEARER:
            break
        where = tuple(program.source.statement(e.place).lineno for e in edits)
        if places.get(where, 0) >= ALIKE:
            continue
        changed = confirmed(program.source, target, edits, varied)
        if changed is not None and changed.text not in seen:
            seen.add(changed.text)
            places[where] = places.get(where, 0) + 1
            cheapest = min(cheapest, cost)
            found.append((edits, changed))
    return found


def _report(
    program: Program,
    target: Target,
    found: Sequence[tuple[tuple[Candidate, ...], Source]],
    start: float,
    deadline: float,
    suspected: Sequence[str] = (),
    coincidence: bool = False,
) -> Repair:
    source = program.source
    names = program.samples.speeds
    wrong = ~(np.abs(program.samples.residual(program.run())).max(axis=1) < RIGHT)
    formulas, varied = _formulas(program, target, [changed for _, changed in found])
    fixes = _fixes(program, _groups(program, found, formulas))
    return Repair(
        file=source.name,
        function=source.qualified,
        residual=program.wrong,
        equations=tuple(name for name, off in zip(names, wrong) if off),
        fixes=fixes,
        certain=bool(fixes)
        and len(set(formulas)) == 1
        and not coincidence
        and (varied or _about_the_state(program, found)),
        varied=tuple(program.samples.parameters),
        suspects=tuple(suspected),
        complete=time.monotonic() <= deadline,
        seconds=time.monotonic() - start,
        terms=() if fixes else terms(program, target),
        undefined=undefined(program, target),
    )


Found: TypeAlias = Sequence[tuple[tuple[Candidate, ...], Source]]


def _groups(program: Program, found: Found, formulas: Sequence[int]) -> Sequence[Found]:
    """Edits of the same statements that come to the same formula, together."""
    groups: dict[tuple[int, ...], list[tuple[tuple[Candidate, ...], Source]]] = {}
    for (edits, changed), formula in zip(found, formulas):
        lines = tuple(program.source.statement(e.place).lineno for e in edits)
        groups.setdefault((formula, *lines), []).append((edits, changed))
    return list(groups.values())[:GROUPS]


def _fixes(program: Program, groups: Sequence[Found]) -> tuple[Fix, ...]:
    """One fix for each group, with what else could be written there."""
    source = program.source
    fixes = []
    for members in groups:
        edits, changed = members[0]
        fixes.append(
            Fix(
                file=source.name,
                lines=tuple(getattr(source.nodes[e.place], "lineno", 0) for e in edits),
                words=tuple(e.words for e in edits),
                kinds=tuple(e.kind for e in edits),
                cost=round(sum(e.cost for e in edits), 3),
                diff=unified_diff(source, changed),
                text=changed.text,
                others=tuple("; ".join(e.words for e in other) for other, _ in members[1:]),
            )
        )
    return _tried(program, fixes, [members[0][1] for members in groups])


def _tried(program: Program, fixes: Sequence[Fix], sources: Sequence[Source]) -> tuple[Fix, ...]:
    """The fixes after Python has run them; those that give something else then are left out."""
    samples = program.samples
    at = samples.at(samples.group == 0)
    kept = list(fixes)
    modules, places = [], []
    for k, changed in enumerate(sources[: len(fixes)]):
        module = sandbox.extract(changed, program.trace.statements)
        if module is not None and _nothing_new(program.source, changed):
            modules.append(module)
            places.append(k)
    if not modules:
        return tuple(kept)
    answers = sandbox.run(modules, at, limit=10.0)
    for k, answer in zip(places, answers):
        right = not isinstance(answer, str) and answer.shape == at.acceleration.shape
        kept[k] = replace(kept[k], ran=bool(right and at.wrong(np.asarray(answer)) < RIGHT))
    return tuple(fix for fix in kept if fix.ran is not False)


def _nothing_new(source: Source, changed: Source) -> bool:
    """Whether an edit brings no import and no call other than of elementary functions."""

    def used(tree: ast.Module) -> tuple[list[str], set[str]]:
        nodes = list(ast.walk(tree))
        imports = [ast.unparse(n) for n in nodes if isinstance(n, ast.Import | ast.ImportFrom)]
        called = {ast.unparse(n.func) for n in nodes if isinstance(n, ast.Call)}
        return imports, called

    before, after = used(source.module), used(changed.module)
    new = {name.rpartition(".")[2] for name in after[1] - before[1]}
    return before[0] == after[0] and new <= ELEMENTARY.keys()


STATE_KINDS = ("sign", "order", "function", "name", "index", "power")


def _about_the_state(program: Program, found: Found) -> bool:
    """Whether the least edit changes how the result depends on the state, not on constants alone.

    States are drawn at random, so that nothing that depends on them fits by chance; constants can.
    """
    edits, _ = found[0]
    tape = program.tape

    def varies(place: int) -> bool:
        instances = program.trace.instances.get(place, [])
        slots = [s for i in instances for s in flatten(i.value) if isinstance(s, Slot)]
        return any(tape.varying[slot.index] for slot in slots)

    return all(e.kind in STATE_KINDS and varies(e.place) for e in edits)


def _formulas(
    program: Program, target: Target, sources: Sequence[Source]
) -> tuple[list[int], bool]:
    """Which repaired functions are one formula, and whether all their constants are the model's.

    Functions are one formula if they stay equal when their named constants are moved.
    """
    if not sources:
        return [], False
    at = program.samples.at(program.samples.group == 0)
    traces = [trace(source, at.t, at.q, at.u) for source in sources]
    names = set.intersection(*(set(found.parameters) for found in traces))
    rng = np.random.default_rng(0)
    factors = {name: 1.0 + PERTURBED * rng.uniform(-1.0, 1.0) for name in sorted(names)}
    kinds: list[Array] = []
    formulas = []
    varied = True
    for found in traces:
        moved = {
            slot: found.tape.values[slot] * factors[name]
            for name, slot in found.parameters.items()
            if name in factors
        }
        result = found.tape.run(found.outputs, values=moved)
        size = np.abs(result).max() + 1e-300
        same = (k for k, other in enumerate(kinds) if np.abs(other - result).max() <= AGREE * size)
        formulas.append(next(same, len(kinds)))
        if formulas[-1] == len(kinds):
            kinds.append(result)
        matters = found.tape.before(found.outputs)
        used = {name for name, slot in found.parameters.items() if slot in matters}
        # Of the model's names and values, those that were not varied are what the edit sets right.
        varied = varied and used <= set(named_parameters(found, target))
    return formulas, varied
