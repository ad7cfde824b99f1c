"""The function on its tape at samples of the model: what it gives, and what any change of it would."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import SAME, Array
from deltac.errors import InputError, SourceError
from deltac.repair.tracing.library import flatten
from deltac.repair.tracing.samples import RIGHT, StateSamples, Target
from deltac.repair.tracing.source import Source
from deltac.repair.tracing.tape import Slot, Solve, Tape, TapeChange, matrix_and_rest
from deltac.repair.tracing.tracer import IndexOutOfRange, Instance, Trace, branches, signature_of
from deltac.simulation import StateForm, candidate_forms, likeliest

PLAIN_COUNTS = 12
"""Whole numbers up to this are nobody's parameter by their value alone."""


@dataclass(frozen=True, eq=False, repr=False)
class Program:
    """A function read onto a tape at samples, the model's parameters that it names varied with them."""

    trace: Trace
    samples: StateSamples

    @property
    def source(self) -> Source:
        """The text."""
        return self.trace.source

    @property
    def tape(self) -> Tape:
        """The operations."""
        return self.trace.tape

    def run(self, changes: Mapping[int, TapeChange] | None = None) -> Array:
        """Accelerations (n, B) with some operations changed.

        Then q̇ (nq, B), where the function returns it.
        """
        return self.tape.run(self.outputs, changes)

    @property
    def outputs(self) -> tuple[int, ...]:
        """Slots of the accelerations, then of the rates q̇."""
        return (*self.trace.outputs, *self.trace.rates)

    def residual(self, changes: Mapping[int, TapeChange] | None = None) -> Array:
        """How far the equations are from the model (n, B), 1 being the size of an equation's terms.

        Where the function ends with solving A u̇ = b, it is A u̇ − b at the model's accelerations: linear in
        every entry of A and b, and each mistake stays in its own row. Else the residual of its results.
        """
        if not self.solves:
            return self.samples.residual(self.run(changes))
        A, b = self.system(changes)
        with np.errstate(all="ignore"):
            residual = np.einsum("bij,jb->ib", A, self.samples.acceleration) - b
            residual /= self._rows[:, None]
        if not self.trace.rates:
            return np.asarray(residual)
        rates = self.tape.run(self.trace.rates, changes)
        return np.concatenate([residual, (rates - self.samples.rates) / self.samples.rate_size])

    def system(self, changes: Mapping[int, TapeChange] | None = None) -> tuple[Array, Array]:
        """A (B, n, n) and b (n, B), where what is returned is the solution of A u̇ = b."""
        assert self._system is not None
        entries = self.tape.run(self._system, changes)
        return matrix_and_rest(entries, len(self.samples.acceleration))

    @cached_property
    def _system(self) -> tuple[int, ...] | None:
        """Slots of A and b, where what is returned is the solution of A u̇ = b."""
        whole = self.tape.whole(self.trace.outputs)
        if whole is None or self.tape.operations[whole] != Solve(len(self.trace.outputs)):
            return None
        return self.tape.inputs[whole]

    @property
    def solves(self) -> bool:
        """Whether the residual is that of A u̇ = b."""
        return self._system is not None

    @cached_property
    def _rows(self) -> Array:
        """Typical size of the terms of each row (n,)."""
        A, b = self.system()
        size = np.einsum("bij,jb->ib", np.abs(A), np.abs(self.samples.acceleration)) + np.abs(b)
        rms = np.sqrt(np.mean(size**2, axis=1))
        return np.asarray(np.maximum(rms, 1e-9 * rms.max()))

    @cached_property
    def original_residual(self) -> Array:
        """The residual (n, B) of the function as it stands."""
        return self.residual()

    @cached_property
    def wrong(self) -> float:
        """How wrong the function is as it stands."""
        return self.samples.wrong(self.run())

    def changed(self, changes: Mapping[int, TapeChange]) -> Program:
        """The program with some operations changed for good."""
        return replace(self, trace=replace(self.trace, tape=self.tape.changed(changes)))

    def passes(self, changes: Mapping[int, TapeChange]) -> bool:
        """Whether the function is right with these changes."""
        return self.samples.wrong(self.run(changes)) < RIGHT

    @cached_property
    def numbers(self) -> dict[int, Instance]:
        """Nodes of one number in one slot: those that a single value can stand for."""
        numbers = {}
        for place, instances in self.trace.instances.items():
            slot, *others = {i.value.index if isinstance(i.value, Slot) else -1 for i in instances}
            own = not others and slot >= 0 and self.tape.nodes[slot] == place
            if own and self.matters(slot):
                numbers[place] = instances[0]
        return numbers

    def values(self, slot: int) -> Array:
        """The values (B,) of a slot."""
        return np.broadcast_to(self.tape.values[slot], self.samples.t.shape).astype(float)

    def matters(self, slot: int) -> bool:
        """Whether the accelerations depend on a slot."""
        return slot in self.tape.before(self.outputs)

    def slots(self, place: int) -> list[Slot]:
        """The numbers, on the tape, of all evaluations of a node."""
        instances = self.trace.instances.get(place, [])
        return [entry for i in instances for entry in flatten(i.value) if isinstance(entry, Slot)]


@dataclass(frozen=True, eq=False, repr=False)
class ProgramReading:
    """A function read at samples: a program for each way through its branches, that of most states first.

    `places` are the states that take each way.
    """

    pieces: tuple[Program, ...]
    places: tuple[NDArray[np.intp], ...]

    def run(self) -> Array:
        """What the function returns (n, B) at all states: u̇, then q̇ where every way returns it."""
        parts = [piece.run() for piece in self.pieces]
        result = np.empty((min(map(len, parts)), sum(len(which) for which in self.places)))
        for which, part in zip(self.places, parts):
            result[:, which] = part[: len(result)]
        return result

    @property
    def source(self) -> Source:
        """The text."""
        return self.pieces[0].source

    @property
    def varied(self) -> tuple[str, ...]:
        """The model's parameters that were varied with the function's."""
        return tuple(self.pieces[0].samples.parameters)

    @cached_property
    def wrong(self) -> float:
        """How wrong the function is, wherever it is worst."""
        return max(piece.wrong for piece in self.pieces)

    @property
    def faulty(self) -> tuple[Program, ...]:
        """The programs that are wrong, that of most states first."""
        return tuple(piece for piece in self.pieces if not piece.wrong < RIGHT)

    @property
    def worst(self) -> Program:
        """The wrong program of most states; where all are right, that of most states."""
        return (*self.faulty, *self.pieces)[0]


def read(
    source: Source, target: Target, *, vary: bool = True, fresh: bool = False
) -> ProgramReading:
    """The function at samples of a target; with `vary`, at other parameters too where it names them.

    Raises:
        InputError: what `trace` refuses.
    """
    source = formed(source, target)
    samples = target.samples((), fresh)
    first = reading(source, samples)
    if not vary:
        return first
    right = first.wrong < RIGHT
    for by_value in (True, False):
        varied = tuple(sorted(set(named_parameters(first, target, by_value).values())))
        if not varied:
            return first
        try:
            varied_reading = at(source, target, varied, fresh)
        except InputError:  # the mechanism allows no other values, or no states at them
            continue
        if not right or varied_reading.wrong < RIGHT or not by_value:
            return varied_reading  # else constants of one value were not what they seemed to be
    return first


def formed(source: Source, target: Target) -> Source:
    """The source with the form in which it takes the state, found by trying.

    Raises InputError where no form fits.
    """
    if source.form is not None:
        return source
    parameters, test = signature_of(source), target.test()
    names = test.kane.user_names, test.states.speeds
    candidates = candidate_forms(parameters, *source.declared, *names, len(target.mechanism.motors))
    samples = target.samples()
    some = samples.at(np.arange(min(len(samples.t), 4)))
    failures: list[InputError] = []

    def evaluate(form: StateForm) -> tuple[Array, Array]:
        try:
            parts = branches(replace(source, form=form), some.t, some.q, some.u)
        except InputError as error:
            failures.append(error)
            raise
        rates, accelerations = np.full_like(some.q, np.nan), np.full_like(some.u, np.nan)
        for which, trace in parts:
            accelerations[:, which] = trace.tape.run(trace.outputs)
            rates[:, which] = trace.tape.run(trace.rates) if trace.rates else np.nan
        return rates if parts[0][1].rates else rates[:0], accelerations

    form = likeliest(candidates, evaluate, some.rates, some.acceleration)
    if form is None:
        if failures:
            raise failures[0]
        arguments = ", ".join(parameters[0]) if parameters else "*arguments"
        raise SourceError(
            f"{source.name}: {source.qualified} takes the arguments ({arguments}); expected a function of "
            "(t, q, u), of (t, y) or of (y, t)"
        )
    lines = frozenset(f.line for f in failures if isinstance(f, IndexOutOfRange))
    return replace(source, form=form, outside_range=lines)


def named_parameters(
    reading: ProgramReading | Trace, target: Target, by_value: bool = True
) -> dict[str, str]:
    """The mechanism's parameters that the function has, by the function's names for them.

    They have the same name (m1 is m[1] and m_1 as well) and the same value; or, `by_value`, a value that
    only one constant of the function and one parameter of the mechanism have.
    """
    model = {name: value for name, value in target.mechanism.parameters.items() if value != 0.0}
    traces = [reading] if isinstance(reading, Trace) else [piece.trace for piece in reading.pieces]
    own = {
        name: float(one.tape.exact[slot])
        for one in traces
        for name, slot in one.parameters.items()
        if one.tape.exact[slot] is not None
    }
    bare = {_bare(name): name for name in model}
    links = {}
    for name, value in own.items():
        meant = name if name in model else bare.get(_bare(name))
        if meant is not None and abs(value - model[meant]) <= SAME * abs(model[meant]):
            links[name] = meant
    if by_value:
        free = {name: value for name, value in model.items() if name not in links.values()}
        for name, value in own.items():
            # A name of another parameter with this one's value is a mistake, no other name for it.
            known_name = name in model or _bare(name) in bare
            if known_name or (value.is_integer() and abs(value) <= PLAIN_COUNTS):
                continue
            alike = [n for n, v in free.items() if abs(v - value) <= SAME * abs(v)]
            twins = [n for n, v in own.items() if abs(v - value) <= SAME * abs(v)]
            if len(alike) == 1 == len(twins):
                links[name] = alike[0]
    return dict(sorted(links.items()))


def _bare(name: str) -> str:
    """A name without brackets and underscores."""
    return re.sub(r"[\W_]", "", name)


def at(
    source: Source, target: Target, varied: tuple[str, ...], fresh: bool = False
) -> ProgramReading:
    """The function at samples in which the parameters `varied` take other values too.

    Raises InputError where the function does not have them all, with the model's values.
    """
    source = formed(source, target)
    samples = target.samples(varied, fresh)
    if not varied:
        return reading(source, samples)
    nominal = target.samples((), fresh)
    first = reading(source, nominal, {})
    links = named_parameters(first, target)
    missing = set(varied) - set(links.values())
    if missing:
        raise SourceError(f"{source.name}: no constant {min(missing)!r} with the model's value")
    origins = {name: key for piece in first.pieces for name, key in piece.trace.origins.items()}
    chosen = {name: meant for name, meant in links.items() if meant in varied}
    override = {origins[name]: samples.parameters[meant] for name, meant in chosen.items()}
    return reading(source, samples, override)


def moved(source: Source, samples: StateSamples, factor: Callable[[str], float]) -> Array:
    """What a function returns with each of its named constants multiplied by a factor of its own."""
    traces = branches(source, samples.t, samples.q, samples.u)
    override = {}
    for _, part in traces:
        for name, slot in sorted(part.parameters.items()):
            if part.tape.exact[slot] is not None:
                value = float(part.tape.exact[slot]) * factor(name)
                override[part.origins[name]] = np.full(len(samples.t), value)
    return reading(source, samples, override).run()


def reading(
    source: Source, samples: StateSamples, override: Mapping[Any, Array] | None = None
) -> ProgramReading:
    """The function at samples; `override` has values that constants take instead of their own."""
    parts = branches(source, samples.t, samples.q, samples.u, override)
    return ProgramReading(
        tuple(Program(trace, samples.at(which)) for which, trace in parts),
        tuple(which for which, _ in parts),
    )
