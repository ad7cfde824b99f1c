"""`repair_equations`: which edit of the source makes equations of motion right."""

from __future__ import annotations

import ast
import contextlib
import re
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from deltac.arrays import Array
from deltac.calls.arguments import checked
from deltac.calls.interrupts import interruptible
from deltac.diagnosis.residuals.function import Caller
from deltac.errors import InputError, SourceError
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.models import ModelLike, chosen_map, load_model
from deltac.repair import sandbox
from deltac.repair.edits.candidates import Candidate, apply, unified_diff
from deltac.repair.edits.running import right_edits, text_edits
from deltac.repair.edits.search import Search, confirmed, pairs
from deltac.repair.outcome import Fix, Repair, suspects, terms, undefined
from deltac.repair.tracing.library import flatten
from deltac.repair.tracing.program import (
    Program,
    Reading,
    formed,
    named_parameters,
    read,
    reading,
)
from deltac.repair.tracing.samples import RIGHT, Target
from deltac.repair.tracing.source import Source, innermost, partial_in, read_source, source_of
from deltac.repair.tracing.tape import ELEMENTARY, Slot, Tape
from deltac.repair.tracing.tracer import Endless, Failed, Refused, branches
from deltac.simulation.equations import Equations
from deltac.simulation.state_form import PLAIN

Found: TypeAlias = Sequence[tuple[tuple[Candidate, ...], Source]]

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

FAILING_TIME = 8.0
"""Time of the processor for edits of a statement that raises an error (s)."""

MORE_TIME = 3.0
"""Time of the processor in which other ways are looked for when a repair is found (s)."""

AGREE = 1e-7
"""Two results that differ by less than this (relative) are the same: rounding is amplified by solving."""

TWO = 2.5
"""Edits that cost more than this are compared with two plain ones."""

BRANCHES = 12
"""Edits of one branch that are combined with those of another."""

DIGITS = 6
"""A number of more digits than these is none that anybody writes."""

NUMBER = re.compile(r"(?<![\w.])\d+\.\d+")

AS_RUN, AS_RUN_TO = 4, 1e-5
"""States at which what was read is compared with what runs, and how close they are: single precision."""

RUN_AT = 4
"""States at which edits of functions that cannot be read are tried; what is right there is run at all."""

PERTURBED = 0.37
"""By up to this share, named constants are moved to tell formulas apart that agree at one set of numbers."""


@checked
@interruptible()
def repair_equations(
    model: ModelLike,
    equations: str | Path | Callable[..., Any] | Equations,
    *,
    coordinates: CoordinateMap | str | None = None,
    seed: int = 0,
    time_limit: float = TIME_LIMIT,
) -> Repair:
    """Find the edit of a function's source that makes its equations of motion right.

    The function is traced: Python runs it at random states of the mechanism, rewritten so that every
    expression records its value; then the value is computed that each expression should have had. Edits
    (signs, operators, names, indices, functions, powers, numbers, missing or superfluous factors and terms;
    two of them where one does not suffice) that produce these values are searched for. All that pass are
    tested at fresh states, at other parameters where the function names its constants as the mechanism does,
    and by running the edited function in a process of its own. The file is left as it is.

    Args:
        model: a Mechanism, a Problem or a problem's name, a model file.
        equations: ``"FILE.py:FUNCTION"``, a function of (t, q, u) that returns u̇, or `dc.Equations`.
        coordinates: the function's own coordinates, as for `check_equations`.
        seed: of the random states.
        time_limit: of the search (s).

    Raises:
        InputError: no source, no Python, or a function with too many branches on the state, side effects,
            endless loops, or calls that cannot be traced; file and line are named.
    """
    found = load_model(model)
    chosen = chosen_map(found, coordinates, equations)
    return repair_source(
        source_of(equations), Target(found.mechanism, chosen, seed, found.first), time_limit
    )


def repair_loaded(
    model: Any,
    text: str,
    function: Callable[..., Any] | Equations,
    *,
    coordinates: CoordinateMap | str | None = None,
    seed: int = 0,
    time_limit: float = TIME_LIMIT,
) -> Repair:
    """`repair_equations` of ``FILE.py:NAME``, which has been loaded: `function` is what it gave.

    The text is read; live values stand in only for what the text does not say.
    """
    found = load_model(model)
    equations = function if isinstance(function, Equations) else Equations(function)
    plain, told = equations.rhs, (equations.form, equations.order)
    chosen = chosen_map(found, coordinates, function)
    target = Target(found.mechanism, chosen, seed, found.first)
    python = innermost(plain)
    test = target.test()
    caller = Caller(plain, text, test.kane)
    with contextlib.suppress(InputError):  # the search says what cannot be called
        caller.find_form(test, equations, len(found.mechanism.motors))
    if caller.form.momenta:
        raise SourceError(
            f"{text} is written in momenta ∂K/∂u; an edit is sought in functions of coordinates and speeds"
        )
    try:
        source = replace(
            read_source(partial_in(plain) or (text if ".py:" in text else plain)), told=told
        )
        if python is not None:
            source = replace(source, outside=dict(python.__globals__))
        _as_run(source, plain, target)
        return repair_source(source, target, time_limit)
    except Refused as refused:
        if isinstance(refused, Endless):
            raise
        if python is not None:
            with contextlib.suppress(InputError):
                source = replace(read_source(plain), told=told)
                _as_run(source, plain, target)
                return repair_source(source, target, time_limit)
        failed = isinstance(refused, Failed)
        ran = None
        with contextlib.suppress(*([InputError] if failed else [])):
            ran = _by_running(read_source(text), equations, target, time_limit, str(refused))
        if ran is None and failed:  # raised again where no edit of its line helps
            return repair_source(replace(read_source(text), told=told), target, time_limit)
        if ran is None:
            raise
        return ran


def _as_run(source: Source, function: Callable[..., Any], target: Target) -> None:
    """Raise Refused if a function, as it was read, gives something else than when it is called."""
    source = formed(source, target)
    samples = target.samples()
    some = samples.at(np.arange(min(AS_RUN, len(samples.t))))
    states = target.test().states.take(np.arange(len(some.t)))
    kane = target.test().kane
    called = Caller(function, source.qualified, kane, False, form=source.form or PLAIN)
    rates, accelerations = called.whole(states)
    read_so = reading(source, some).run()
    right = np.concatenate([accelerations, rates])[: len(read_so)]
    size = np.abs(right).max(initial=1e-300)
    if not np.allclose(
        read_so[: len(right)], right, rtol=0.0, atol=AS_RUN_TO * size, equal_nan=True
    ):
        raise Refused(f"{source.name}: {source.qualified} gives something else than its text says")


def _by_running(
    source: Source, equations: Equations, target: Target, time_limit: float, why: str
) -> Repair | None:
    """Repair a function that cannot be read (`why`) by running edits of it; None if it does not run."""
    start = time.monotonic()
    deadline = start + time_limit
    test = target.test()
    caller = Caller(equations.rhs, source.qualified, test.kane)
    caller.find_form(test, equations, len(target.mechanism.motors))
    source = replace(source, form=caller.form)
    every = target.samples()
    samples = every.at(np.arange(min(RUN_AT, len(every.t))))
    one = sandbox.task(source)
    (answer,) = ("",) if one is None else sandbox.run([one], every, time_limit)
    if isinstance(answer, str) or not every.fits(answer):
        return None
    wrong = every.wrong(answer)
    found = [] if wrong < RIGHT else right_edits(source, samples, deadline)
    tasks = [sandbox.task(changed) for _, changed in found]
    answers = sandbox.run([t for t in tasks if t is not None], every, time_limit) if found else []
    found = [
        edit
        for edit, said in zip(found, answers)
        if not isinstance(said, str) and every.fits(said) and every.wrong(said) < RIGHT
    ]
    fixes = [
        replace(_fix(source, members), ran=True)
        for members in _groups(source, found, [0] * len(found))
    ]
    off = every.wrong_rows(answer)
    names = (*every.speeds, *(f"q̇ of {name}" for name in test.kane.told_names))
    return Repair(
        file=source.name,
        function=source.qualified,
        residual=wrong,
        equations=tuple(name for name, wrong in zip(names, off) if wrong),
        fixes=tuple(fixes),
        certain=False,
        varied=(),
        suspects=(),
        complete=time.monotonic() <= deadline,
        seconds=time.monotonic() - start,
        unread=why.partition(". The function is traced")[0],
    )


def repair_source(source: Source, target: Target, time_limit: float = TIME_LIMIT) -> Repair:
    """`repair_equations` for a source and a target at hand."""
    start = time.monotonic()
    deadline = start + time_limit
    try:
        reading = read(source, target)
    except Failed as failed:
        repaired = _failing(source, target, failed, start, deadline)
        if repaired is None:
            raise
        return repaired
    if reading.wrong < RIGHT:
        return _report(reading, target, [], start, deadline)
    found, suspected = _search(reading, target, deadline)
    coincidence = False
    if not found and reading.varied:
        # Its numbers may hold for the model's parameters only; then an edit may fit these by chance.
        plain = read(source, target, vary=False)
        found, more = _search(plain, target, deadline)
        if found or not suspected:
            reading, suspected, coincidence = plain, more, True
    return _report(reading, target, found, start, deadline, suspected, coincidence)


def _failing(
    source: Source, target: Target, failed: Failed, start: float, deadline: float
) -> Repair | None:
    """Repair a function that raises an error of Python's, by an edit of the statement where it does."""
    statements = [n for n in source.nodes if isinstance(n, ast.stmt)]
    within = {
        line: [n for n in statements if n.lineno <= line <= (n.end_lineno or n.lineno)]
        for line in failed.lines
    }
    if failed.file != source.name:
        return None
    found: list[tuple[tuple[Candidate, ...], Source]] = []
    end = time.process_time() + FAILING_TIME
    innermost_ones = [covering[-1] for covering in within.values() if covering]
    for candidate in text_edits(source, innermost_ones):
        late = time.monotonic() > deadline or time.process_time() > end
        if late or (found and candidate.cost > found[0][0][0].cost):
            break
        changed = apply(source, [candidate])
        with contextlib.suppress(InputError):
            changed = None if changed is None else formed(changed, target)
            if changed is not None and read(changed, target, vary=False).wrong < RIGHT:
                found.append(((candidate,), changed))
    formulas, _ = _formulas(target, [changed for _, changed in found])
    fixes, contradicted = _fixes(source, target, _groups(source, found, formulas))
    if not fixes:
        return None
    return Repair(
        file=source.name,
        function=source.qualified,
        residual=np.inf,
        equations=(),
        fixes=fixes,
        certain=False,
        varied=(),
        suspects=(),
        complete=time.monotonic() <= deadline,
        seconds=time.monotonic() - start,
        undefined=str(failed).partition(". The function is traced")[0],
        contradicted=contradicted,
    )


def _search(reading: Reading, target: Target, deadline: float) -> tuple[Found, list[str]]:
    """Edits with the sources they make, confirmed, cheapest first; and the suspects.

    Where the function branches on the state, each wrong branch is searched; where none of their edits
    makes all branches right, one of each branch is combined.
    """
    suspected: list[str] = []
    alone: list[list[Candidate]] = []
    searches = []
    for program in reading.faulty:
        search = Search(program, target, deadline)
        search.require()
        singles = search.single()
        found = _confirm(reading, target, ((c,) for c in singles), deadline)
        suspected += suspects(program.source, [r.place for r in search.whole])
        if found and found[0][0][0].cost > TWO:
            kinds = (_confirm(reading, target, kind, deadline) for kind in pairs(search, True))
            two = next(filter(None, kinds), [])
            found = sorted([*found, *two], key=lambda f: sum(e.cost for e in f[0]))
        if found:
            return found, list(dict.fromkeys(suspected))
        searches.append(search)
        alone.append(singles[:BRANCHES])
    if len(alone) == 2:
        both = sorted(
            ((a, b) for a in alone[0] for b in alone[1] if a.place != b.place),
            key=lambda pair: pair[0].cost + pair[1].cost,
        )
        found = _confirm(reading, target, both, deadline)
        if found:
            return found, list(dict.fromkeys(suspected))
    for search in searches:
        for kind in pairs(search):
            found = _confirm(reading, target, kind, deadline)
            if found:
                return found, list(dict.fromkeys(suspected))
    return [], list(dict.fromkeys(suspected))


def _confirm(
    reading: Reading,
    target: Target,
    candidates: Iterable[tuple[Candidate, ...]],
    deadline: float,
) -> Found:
    found: list[tuple[tuple[Candidate, ...], Source]] = []
    seen: set[str] = set()
    places: dict[tuple[int, ...], int] = {}
    cheapest, end = np.inf, np.inf
    for tried, edits in enumerate(candidates):
        cost = sum(e.cost for e in edits)
        late = time.monotonic() > deadline or time.process_time() > end
        if tried >= TRIED or late or cost > cheapest + DEARER:
            break
        where = tuple(reading.source.statement(e.place).lineno for e in edits)
        if places.get(where, 0) >= ALIKE:
            continue
        changed = confirmed(reading.source, target, edits, reading.varied)
        if changed is not None and changed.text not in seen:
            seen.add(changed.text)
            places[where] = places.get(where, 0) + 1
            cheapest = min(cheapest, cost)
            end = min(end, time.process_time() + MORE_TIME)
            found.append((edits, changed))
    return found


def _report(
    reading: Reading,
    target: Target,
    found: Found,
    start: float,
    deadline: float,
    suspected: Sequence[str] = (),
    coincidence: bool = False,
) -> Repair:
    source, program = reading.source, reading.worst
    names = (
        *program.samples.speeds,
        *(f"q̇ of {name}" for name in target.test().kane.told_names),
    )
    wrong = np.zeros(len(names), dtype=bool)
    for piece in reading.pieces:
        off = ~(np.abs(piece.samples.residual(piece.run())).max(axis=1) < RIGHT)
        wrong[: len(off)] |= off
    formulas, varied = _formulas(target, [changed for _, changed in found])
    fixes, contradicted = _fixes(source, target, _groups(source, found, formulas))
    return Repair(
        file=source.name,
        function=source.qualified,
        residual=reading.wrong,
        equations=tuple(name for name, off in zip(names, wrong) if off),
        fixes=fixes,
        certain=bool(fixes)
        and not contradicted
        and len(set(formulas)) == 1
        and not coincidence
        and (varied or _about_the_state(program, found))
        and not _odd_number(found[0][0]),
        varied=reading.varied,
        suspects=tuple(suspected),
        complete=time.monotonic() <= deadline,
        seconds=time.monotonic() - start,
        terms=() if fixes else terms(program, target),
        undefined=undefined(program, target),
        contradicted=contradicted,
    )


def _odd_number(edits: Sequence[Candidate]) -> bool:
    """Whether an edit puts in a decimal of many digits: a number that fits is none that was meant."""
    return any(
        len(m.group().replace(".", "").strip("0")) > DIGITS
        for e in edits
        for m in NUMBER.finditer(e.text)
    )


def _groups(source: Source, found: Found, formulas: Sequence[int]) -> Sequence[Found]:
    """Edits of the same statements that come to the same formula, together."""
    groups: dict[tuple[int, ...], list[tuple[tuple[Candidate, ...], Source]]] = {}
    for (edits, changed), formula in zip(found, formulas):
        lines = tuple(source.statement(e.place).lineno for e in edits)
        groups.setdefault((formula, *lines), []).append((edits, changed))
    return list(groups.values())[:GROUPS]


def _fixes(
    source: Source, target: Target, groups: Sequence[Found]
) -> tuple[tuple[Fix, ...], tuple[str, ...]]:
    """One fix for each group, with what else could be written there; and edits that Python contradicts."""
    fixes = [_fix(source, members) for members in groups]
    return _tried(source, target, fixes, [members[0][1] for members in groups])


def _fix(source: Source, members: Found) -> Fix:
    """The first of some edits that come to the same, with the others beside it."""
    edits, changed = members[0]
    return Fix(
        file=source.name,
        lines=tuple(getattr(source.nodes[e.place], "lineno", 0) for e in edits),
        words=tuple(e.words for e in edits),
        kinds=tuple(e.kind for e in edits),
        cost=round(sum(e.cost for e in edits), 3),
        diff=unified_diff(source, changed),
        text=changed.text,
        others=tuple("; ".join(e.words for e in other) for other, _ in members[1:]),
    )


def _tried(
    source: Source, target: Target, fixes: Sequence[Fix], sources: Sequence[Source]
) -> tuple[tuple[Fix, ...], tuple[str, ...]]:
    """The fixes after Python has run them; and, in words, those left out that give something else then."""
    samples = target.samples()
    kept = list(fixes)
    tasks, places = [], []
    for k, changed in enumerate(sources):
        one = sandbox.task(changed)
        if one is None:
            kept[k] = replace(kept[k], not_run="only the running session has it")
        elif not _nothing_new(source, changed):
            kept[k] = replace(kept[k], not_run="the edit calls what the function did not call")
        else:
            tasks.append(one)
            places.append(k)
    answers = sandbox.run(tasks, samples, limit=10.0) if tasks else []
    for k, answer in zip(places, answers):
        if isinstance(answer, str):
            kept[k] = replace(kept[k], not_run=answer)
        else:
            kept[k] = replace(kept[k], ran=samples.wrong(answer) < RIGHT)
    contradicted = tuple(str(fix) for fix in kept if fix.ran is False)
    return tuple(fix for fix in kept if fix.ran is not False), contradicted


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


def _formulas(target: Target, sources: Sequence[Source]) -> tuple[list[int], bool]:
    """Which repaired functions are one formula, and whether all their constants are the model's.

    Functions are one formula if they stay equal when their named constants are moved.
    """
    if not sources:
        return [], False
    at = target.samples()
    readings = [branches(source, at.t, at.q, at.u) for source in sources]
    traces = [parts[0][1] for parts in readings]
    names = set.intersection(*(set(found.parameters) for found in traces))
    rng = np.random.default_rng(0)
    factors = {name: 1.0 + PERTURBED * rng.uniform(-1.0, 1.0) for name in sorted(names)}
    kinds: list[Array] = []
    formulas = []
    varied = True
    for parts in readings:
        result = np.full((len(at.u) + len(at.q), len(at.t)), 0.0)
        for which, found in parts:
            moved = {
                slot: found.tape.values[slot] * factors[name]
                for name, slot in found.parameters.items()
                if name in factors
            }
            outputs = (*found.outputs, *found.rates)
            result[: len(outputs), which] = found.tape.run(outputs, values=moved)
        size = np.abs(result).max() + 1e-300
        same = (k for k, other in enumerate(kinds) if np.abs(other - result).max() <= AGREE * size)
        formulas.append(next(same, len(kinds)))
        if formulas[-1] == len(kinds):
            kinds.append(result)
        for _, found in parts:
            links = named_parameters(found, target)
            linked = {slot for name, slot in found.parameters.items() if name in links}
            # Of the numbers that count, those that were not varied are what the edit may fit by chance.
            varied = varied and not any(
                slot not in linked and _own_number(found.tape, slot)
                for slot in found.tape.before((*found.outputs, *found.rates))
            )
    return formulas, varied


def _own_number(tape: Tape, slot: int) -> bool:
    """Whether a slot is a constant whose value is the user's: no small whole number, simple fraction or π."""
    value = tape.exact[slot]
    if (
        tape.operations[slot] is not None
        or tape.varying[slot]
        or not isinstance(value, int | float)
    ):
        return False
    return (
        not any(float(value * k).is_integer() and abs(value) <= 12 for k in (1, 2, 3))
        and value != np.pi
    )
