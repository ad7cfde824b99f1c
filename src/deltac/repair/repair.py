"""`repair_equations`: which edit of the source makes equations of motion right."""

from __future__ import annotations

import contextlib
import itertools
import math
import re
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from deltac.arrays import HALF_DIGITS, SIX_DIGITS, Array
from deltac.calls.arguments import checked
from deltac.calls.interrupts import interruptible
from deltac.calls.progress import TIME_LIMIT
from deltac.diagnosis import Caller, States, blame
from deltac.errors import InputError
from deltac.mechanism import CoordinateMap
from deltac.models import ModelLike, load_model
from deltac.repair.edits.candidates import EditCandidate, EditedSource, EditSet, unified_diff
from deltac.repair.edits.insertions import FEWEST_STATES
from deltac.repair.edits.running import RUN_TIME, right_edits
from deltac.repair.edits.search import EditSearch, confirmed, pairs
from deltac.repair.edits.single import smaller_indices
from deltac.repair.outcome import Fix, Repair, blamed_terms, suspects
from deltac.repair.sandbox import sandbox, task
from deltac.repair.tracing.program import (
    Program,
    ProgramReading,
    formed,
    moved,
    named_parameters,
    read,
    reading,
)
from deltac.repair.tracing.samples import RIGHT, VALUE_RANGES, StateSamples, Target
from deltac.repair.tracing.source import Source, innermost, partial_in, read_source, source_of
from deltac.repair.tracing.tape import Tape
from deltac.repair.tracing.tracer import Endless, Trace, TracingRefused
from deltac.results import SHOWN
from deltac.simulation import PLAIN_FORM, Equations, RightHandSide, as_equations

MOST_VALIDATED = 120
"""Edits that are tried on fresh states, cheapest first."""

DEARER = 1.6
"""Edits that cost this much more than the cheapest are not reported."""

MORE = MOST_VALIDATED // 3
"""Edits that are tried for other ways when a repair is found."""

TWO = 2.5
"""A single edit that costs more than this is compared with pairs of plain edits; of a pair it is in doubt."""

BRANCHES = math.isqrt(MOST_VALIDATED)
"""Edits of one branch that are combined with those of another: no more pairs are tried."""

WRITTEN_DIGITS = 1 - round(math.log10(SIX_DIGITS))
"""Decimals of more digits are fitted: nobody wrote them, so such a repair is not certain."""

DECIMAL = re.compile(r"(?<![\w.])\d+\.\d+")

AS_RUN, AS_RUN_TO = 4, 1e-5
"""States at which what was read is compared with what runs, and how close they are: single precision."""

ONLY_LIVE = "only the running session has it"
"""Why Python cannot run an edited function in another process."""


@checked
@interruptible()
def repair_equations(
    model: ModelLike,
    equations: str | Path | RightHandSide | Equations,
    *,
    function: RightHandSide | Equations | None = None,
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

    Of a text alone, the function and the statements that it needs are executed while they are traced; see
    SECURITY.md. A function that is given itself and cannot be traced, as it calls compiled code, is run: with
    single edits of its text where it has one, else to say which terms are wrong.

    What can be traced: the function may be a method, a closure returned by a factory, a partial function or
    a callable object; the text may have dots (``eom.py:CartPole.dynamics``). A class is instantiated
    without arguments, and a function without parameters is called to return the equations. It may take the
    state as (t, q, u), (t, y), (y, t), (y) or (y, control) and return u̇ or the rates of the whole state;
    the layout of y is found by trial, and q̇ is repaired as well. Classes, generators, `match`, star
    imports and helpers of your own modules need no special support. NumPy works wherever it accepts arrays
    of objects, besides `linalg.solve`, `inv`, `det`, `norm`, `lstsq` and SciPy's factorizations. Decorators
    of JAX and Numba change nothing. Where a branch depends on the state, each way through it is followed
    with the states that take it.

    Not traced are loops whose end depends on the state, external side effects, more than twelve paths through
    branches, and computations of other packages: a Lagrangian that SymPy or JAX differentiates, a CasADi
    graph, complex numbers, `np.matrix`, ``out=``.

    Args:
        model: a Mechanism, a Problem or a problem's name, a model file.
        equations: ``"FILE.py:FUNCTION"``, a function of (t, q, u) that returns u̇, or `dc.Equations`.
        function: what the text ``"FILE.py:FUNCTION"`` means, where it has been loaded: its live values stand
            in for what the text does not say.
        coordinates: the function's own coordinates, as for `check_equations`.
        seed: of the random states.
        time_limit: of the search (s).

    Raises:
        InputError: no source, no Python, or endless loops; of ``"FILE.py:FUNCTION"`` also too many branches
            on the state, side effects, or calls that cannot be traced; file and line are named.
    """
    start = time.monotonic()
    loaded = load_model(model)
    live = function if function is not None or isinstance(equations, str | Path) else equations
    own = loaded.coordinate_map(coordinates, equations if live is None else live)
    target = Target(loaded.mechanism, own, seed, loaded.first)
    if live is None:
        return repair_source(source_of(equations), target, time_limit)
    live = as_equations(live)
    name = str(equations)
    if function is None:
        name = ":".join(getattr(live.rhs, k, "") for k in ("__module__", "__qualname__"))
    caller = _caller(name, live, target)
    if caller.form.momenta:
        why = f"{name} is written in momenta ∂K/∂u"
        return _by_running(name, caller, target, start, time_limit, why)
    failures: list[InputError] = []
    for read_text in _sources("" if function is None else name, live):
        try:
            source = read_text()
            _as_run(source, live.rhs, target)
            return repair_source(source, target, time_limit)
        except Endless:
            raise
        except InputError as error:
            if function is None and not isinstance(error, TracingRefused):
                raise
            failures.append(error)
    return _by_running(name, caller, target, start, time_limit, str(failures[0]))


def _caller(name: str, equations: Equations, target: Target) -> Caller:
    """A function as it is called, in its own form where one is found."""
    caller = Caller(equations.rhs, name, target.test().kane)
    with contextlib.suppress(InputError):  # the search says what cannot be called
        caller.find_form(target.test(), equations)
    return caller


def _sources(text: str, equations: Equations) -> Iterator[Callable[[], Source]]:
    """How to read a function that has been loaded: by the text that names it, then as what it is."""
    function, declared = equations.rhs, (equations.form, equations.order)
    python = innermost(function)
    outside = {} if python is None else dict(python.__globals__)
    first = partial_in(function) or text or function
    yield lambda: replace(read_source(first), declared=declared, outside=outside)
    if python is not None:
        yield lambda: replace(read_source(function), declared=declared)


def _as_run(source: Source, function: Callable[..., Any], target: Target) -> None:
    """Raise Refused if a function, as it was read, gives something else than when it is called."""
    source = formed(source, target)
    samples = target.samples()
    some = samples.at(np.arange(min(AS_RUN, len(samples.t))))
    states = target.test().states.take(np.arange(len(some.t)))
    caller = Caller(function, source.qualified, target.test().kane, form=source.form or PLAIN_FORM)
    traced, called = reading(source, some).run(), _called(caller, states)
    rows = min(len(traced), len(called))
    close = AS_RUN_TO * np.abs(called[: len(traced)]).max(initial=1e-300)
    if not np.allclose(traced[:rows], called[:rows], rtol=0.0, atol=close, equal_nan=True):
        raise TracingRefused(
            f"{source.name}: {source.qualified} gives something else than its text says"
        )


def _called(caller: Caller, states: States) -> Array:
    """What a function gives when it is called: u̇, then q̇ where it returns it."""
    rates, accelerations = caller.whole(states)
    return np.concatenate([accelerations, rates])


def _by_running(
    text: str, caller: Caller, target: Target, start: float, time_limit: float, why: str
) -> Repair:
    """Run edits of a function that cannot be read (`why`); where none helps, say which terms are wrong."""
    deadline = start + time_limit
    test, samples = target.test(), target.samples()
    result = _called(caller, test.states)
    right: Sequence[EditedSource] = []
    fixes: list[Fix] = []
    if ".py:" in text and not caller.form.momenta and not samples.wrong(result) < RIGHT:
        source = replace(read_source(text), form=caller.form)
        some = samples.at(np.arange(min(FEWEST_STATES, len(samples.t))))
        right = right_edits(source, some, deadline)
        right = [edit for edit, answer in zip(right, _ran(right, samples)) if samples.right(answer)]
        groups = _groups(source, right, [0] * len(right))
        fixes = [replace(_fix(source, group), ran=True) for group in groups]
    wrong = samples.wrong_rows(result)
    terms = _terms(target, result, caller) if wrong.any() and not right else ()
    file, _, function = text.rpartition(":")
    return Repair(
        file=file,
        function=function,
        residual=samples.wrong(result),
        equations=tuple(itertools.compress(_rows(target), wrong)),
        fixes=tuple(fixes),
        complete=time.monotonic() <= deadline,
        seconds=time.monotonic() - start,
        terms=terms,
        unread=why.partition(". The function is traced")[0],
    )


def _rows(target: Target) -> tuple[str, ...]:
    """What each row of a result is of: an equation, by its speed; then q̇."""
    test = target.test()
    return (*test.speeds, *(f"q̇ of {name}" for name in test.kane.user_names))


def _terms(target: Target, result: Array, caller: Caller | None = None) -> tuple[str, ...]:
    """Which terms are wrong with a result at the model's own parameters, in words."""
    test = target.test()
    udot = result[: len(test.speeds)]
    return blamed_terms(blame(test, udot, np.full(len(test.speeds), RIGHT), caller))


def repair_source(source: Source, target: Target, time_limit: float = TIME_LIMIT) -> Repair:
    """`repair_equations` for a source and a target at hand."""
    start = time.monotonic()
    deadline = start + time_limit
    program = read(source, target)
    if program.wrong < RIGHT:
        return _report(program, target, [], start, deadline)
    # With a smaller index the arguments may be others, too.
    indices = smaller_indices(source, program.source.outside_range)
    right = _confirm(program.varied, target, deadline, indices)
    if right:
        return _report(program, target, right, start, deadline)
    right, suspected = _search(program, target, deadline)
    # Zeros of a control that is none may make room for an index; q̇ would tell that the form is right.
    controls = (program.source.form or PLAIN_FORM).controls
    padded = controls > 0 and bool(program.source.outside_range)
    coincidence = padded and not program.worst.trace.rates
    if not right and program.varied:
        # Its numbers may hold for the model's parameters only; then an edit may fit these by chance.
        nominal = read(source, target, vary=False)
        right, more = _search(nominal, target, deadline)
        if right or not suspected:
            program, suspected, coincidence = nominal, more, True
    return _report(program, target, right, start, deadline, suspected, coincidence)


def _search(
    reading: ProgramReading, target: Target, deadline: float
) -> tuple[list[EditedSource], list[str]]:
    """Edits that are confirmed, cheapest first; and the suspects.

    Where the function branches on the state, each wrong branch is searched; where none of their edits
    makes all branches right, one of each branch is combined.
    """
    suspected: dict[str, None] = {}
    alone: list[list[EditCandidate]] = []
    searches = []

    confirm = partial(_confirm, reading.varied, target, deadline)

    def confirmed_first(kinds: Iterable[Iterable[EditSet]]) -> list[EditedSource]:
        return next(filter(None, map(confirm, kinds)), [])

    for program in reading.faulty:
        search = EditSearch(program, target, deadline)
        search.require()
        singles = search.single()
        right = confirm((c,) for c in singles)
        suspected |= dict.fromkeys(suspects(program.source, [r.place for r in search.sufficient]))
        if right and right[0][0][0].cost > TWO:
            right += confirmed_first(pairs(search, True))
            right.sort(key=lambda edited: _total_cost(edited[0]))
        if right:
            return right, list(suspected)
        searches.append(search)
        alone.append(singles[:BRANCHES])
    both = [(a, b) for a in alone[0] for b in alone[-1] if a.place != b.place]
    one_each = [sorted(both, key=_total_cost)] if len(alone) == 2 else []
    kinds = (kind for search in searches for kind in pairs(search))
    return confirmed_first(itertools.chain(one_each, kinds)), list(suspected)


def _total_cost(edits: EditSet) -> float:
    return sum(e.cost for e in edits)


def _confirm(
    varied: tuple[str, ...], target: Target, deadline: float, candidates: Iterable[EditSet]
) -> list[EditedSource]:
    """Those of some edits that are right at fresh states, cheapest first."""
    right: list[EditedSource] = []
    texts: set[str] = set()
    places: Counter[tuple[int, ...]] = Counter()
    cheapest, most = np.inf, MOST_VALIDATED
    for count, edits in enumerate(candidates):
        cost = _total_cost(edits)
        if count >= most or time.monotonic() > deadline or cost > cheapest + DEARER:
            break
        source = edits[0].source
        lines = tuple(source.statement(e.place).lineno for e in edits)
        if places[lines] >= SHOWN:
            continue
        changed = confirmed(source, target, edits, varied)
        if changed is not None and changed.text not in texts:
            texts.add(changed.text)
            places[lines] += 1
            cheapest = min(cheapest, cost)
            most = min(most, count + MORE)
            right.append((edits, changed))
    return right


def _report(
    reading: ProgramReading,
    target: Target,
    right: Sequence[EditedSource],
    start: float,
    deadline: float,
    suspected: Sequence[str] = (),
    coincidence: bool = False,
) -> Repair:
    source, program, test = reading.source, reading.worst, target.test()
    names = _rows(target)
    wrong = np.zeros(len(names), dtype=bool)
    for piece in reading.pieces:
        rows = piece.samples.wrong_rows(piece.run())
        wrong[: len(rows)] |= rows
    formulas, varied = _formulas(target, [changed for _, changed in right])
    fixes, contradicted = _fixes(source, target, _groups(source, right, formulas))
    terms: tuple[str, ...] = ()
    nominal = program.run()[: len(test.speeds), program.samples.group == 0]
    if not fixes and nominal.shape == test.acceleration.shape and np.isfinite(nominal).all():
        terms = _terms(target, nominal)
    return Repair(
        file=source.name,
        function=source.qualified,
        residual=reading.wrong,
        equations=tuple(itertools.compress(names, wrong)),
        fixes=fixes,
        certain=bool(fixes)
        and not contradicted
        and len(set(formulas)) == 1
        and not coincidence
        and (varied or _about_the_state(program, right))
        and not _odd_number(right[0][0])
        and (len(right[0][0]) == 1 or max(e.cost for e in right[0][0]) <= TWO),
        varied=reading.varied,
        suspects=tuple(suspected),
        complete=time.monotonic() <= deadline,
        seconds=time.monotonic() - start,
        terms=terms,
        contradicted=contradicted,
    )


def _odd_number(edits: Sequence[EditCandidate]) -> bool:
    """Whether an edit puts in a decimal of many digits: a number that fits is none that was meant."""
    return any(
        len(m.group().replace(".", "").strip("0")) > WRITTEN_DIGITS
        for e in edits
        for m in DECIMAL.finditer(e.text)
    )


def _groups(
    source: Source, right: Sequence[EditedSource], formulas: Sequence[int]
) -> list[list[EditedSource]]:
    """Edits of the same statements that come to the same formula, together."""
    groups: dict[tuple[int, ...], list[EditedSource]] = {}
    for edited, formula in zip(right, formulas):
        lines = (source.statement(e.place).lineno for e in edited[0])
        groups.setdefault((formula, *lines), []).append(edited)
    return list(groups.values())[:SHOWN]


def _fixes(
    source: Source, target: Target, groups: Sequence[Sequence[EditedSource]]
) -> tuple[tuple[Fix, ...], tuple[str, ...]]:
    """One fix for each group, after Python has run it; and, in words, those that give something else then."""
    samples = target.samples()
    fixes = []
    for group, answer in zip(groups, _ran([group[0] for group in groups], samples)):
        outcome = {"not_run": answer} if isinstance(answer, str) else {"ran": samples.right(answer)}
        fixes.append(replace(_fix(source, group), **outcome))
    contradicted = tuple(str(fix) for fix in fixes if fix.ran is False)
    return tuple(fix for fix in fixes if fix.ran is not False), contradicted


def _ran(edited: Iterable[EditedSource], samples: StateSamples) -> Iterator[Array | str]:
    """What Python gives of edited sources, or why it gives nothing."""
    with sandbox() as run:
        for _, changed in edited:
            one = task(changed)
            yield ONLY_LIVE if one is None else run(one, samples, RUN_TIME)


def _fix(source: Source, group: Sequence[EditedSource]) -> Fix:
    """The first of some edits that come to the same, with the others beside it."""
    edits, changed = group[0]
    return Fix(
        file=source.name,
        lines=tuple(getattr(source.nodes[e.place], "lineno", 0) for e in edits),
        words=tuple(e.words for e in edits),
        kinds=tuple(e.kind for e in edits),
        cost=round(_total_cost(edits), 3),
        diff=unified_diff(source, changed),
        text=changed.text,
        others=tuple("; ".join(e.words for e in other) for other, _ in group[1:]),
    )


STATE_KINDS = ("sign", "order", "function", "name", "index", "power")


def _about_the_state(program: Program, right: Sequence[EditedSource]) -> bool:
    """Whether the least edit changes how the result depends on the state, not on constants alone.

    States are drawn at random, so that nothing that depends on them fits by chance; constants can.
    """
    edits, _ = right[0]
    tape = program.tape

    return all(
        e.kind in STATE_KINDS and any(tape.varying[s.index] for s in program.slots(e.place))
        for e in edits
    )


def _formulas(target: Target, sources: Sequence[Source]) -> tuple[list[int], bool]:
    """Which repaired functions are one formula, and whether all their constants are the model's.

    Functions are one formula if they stay equal when their named constants are moved.
    """
    if not sources:
        return [], False
    samples = target.samples()
    traces = [piece.trace for s in sources for piece in reading(s, samples).pieces]
    names = set.intersection(*(set(trace.parameters) for trace in traces))
    rng = np.random.default_rng(0)
    factors = {name: rng.uniform(*VALUE_RANGES[0]) for name in sorted(names)}
    kinds: list[Array] = []
    formulas = []
    for source in sources:
        result = moved(source, samples, lambda name: factors.get(name, 1.0))
        size = np.abs(result).max() + 1e-300
        same = (
            k
            for k, other in enumerate(kinds)
            if other.shape == result.shape and np.abs(other - result).max() <= HALF_DIGITS * size
        )
        formulas.append(next(same, len(kinds)))
        if formulas[-1] == len(kinds):
            kinds.append(result)
    return formulas, not any(_of_its_own(trace, target) for trace in traces)


def _of_its_own(trace: Trace, target: Target) -> bool:
    """Whether a number that counts was not varied: an edit may fit it by chance."""
    links = named_parameters(trace, target)
    linked = {slot for name, slot in trace.parameters.items() if name in links}
    used = trace.tape.before((*trace.outputs, *trace.rates))
    return any(slot not in linked and _own_number(trace.tape, slot) for slot in used)


def _own_number(tape: Tape, slot: int) -> bool:
    """Whether a slot is a constant whose value is the user's: no small whole number, simple fraction or π."""
    value = tape.exact[slot]
    constant = tape.operations[slot] is None and not tape.varying[slot]
    if not constant or not isinstance(value, int | float):
        return False
    plain = abs(value) <= 12 and any(float(value * k).is_integer() for k in (1, 2, 3))
    return not plain and value != np.pi
