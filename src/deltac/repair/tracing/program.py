"""The function on its tape at samples of the model: what it gives, and what any change of it would."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from deltac.arrays import Array
from deltac.errors import InputError, SourceError
from deltac.repair.tracing.interpreter import Instance, Trace, trace
from deltac.repair.tracing.samples import RIGHT, Samples, Target
from deltac.repair.tracing.source import Source
from deltac.repair.tracing.tape import Change, Row, Slot, Solve, Tape, identity

SAME = 1e-9
"""A constant of the function that is within this (relative) of a parameter of its name is that one."""


@dataclass(frozen=True, eq=False)
class Program:
    """A function read onto a tape at samples, the model's parameters that it names varied with them."""

    trace: Trace
    samples: Samples

    @property
    def source(self) -> Source:
        """The text."""
        return self.trace.source

    @property
    def tape(self) -> Tape:
        """The operations."""
        return self.trace.tape

    def run(
        self, changes: Mapping[int, Change] | None = None, values: Mapping[int, Any] | None = None
    ) -> Array:
        """Accelerations (n, B) with some operations changed, or slots given other values."""
        return self.tape.run(self.trace.outputs, changes, values)

    def residual(
        self, changes: Mapping[int, Change] | None = None, values: Mapping[int, Any] | None = None
    ) -> Array:
        """How far the equations are from the model (n, B), 1 being the size of an equation's terms.

        Where the function ends with solving A u̇ = b, it is A u̇ − b at the model's accelerations: linear in
        every entry of A and b, and each mistake stays in its own row. Else the residual of its results.
        """
        if self._system is None:
            return self.samples.residual(self.run(changes, values))
        entries = self.tape.run(self._system, changes, values)
        n = len(self.samples.acceleration)
        A = entries[: n * n].reshape(n, n, -1)
        with np.errstate(all="ignore"):
            left = np.einsum("ijb,jb->ib", A, self.samples.acceleration) - entries[n * n :]
        return np.asarray(left / self._rows[:, None])

    @cached_property
    def _system(self) -> tuple[int, ...] | None:
        """Slots of A and b, where what is returned is the solution of A u̇ = b."""
        tape, wholes = self.tape, set()
        for place, slot in enumerate(self.trace.outputs):
            while tape.operations[slot] is identity:
                (slot,) = tape.inputs[slot]
            if tape.operations[slot] != Row(place):
                return None
            wholes.add(tape.inputs[slot][0])
        whole = wholes.pop()
        return tape.inputs[whole] if tape.operations[whole] == Solve(place + 1) else None

    @property
    def solves(self) -> bool:
        """Whether the function ends with solving A u̇ = b."""
        return self._system is not None

    @cached_property
    def _rows(self) -> Array:
        """Typical size of the terms of each row (n,)."""
        assert self._system is not None
        n = len(self.samples.acceleration)
        entries = np.abs(self.tape.run(self._system))
        A = entries[: n * n].reshape(n, n, -1)
        size = np.einsum("ijb,jb->ib", A, np.abs(self.samples.acceleration)) + entries[n * n :]
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

    def passes(self, changes: Mapping[int, Change]) -> bool:
        """Whether the function is right with these changes."""
        return self.samples.wrong(self.run(changes)) < RIGHT

    @cached_property
    def numbers(self) -> dict[int, Instance]:
        """Nodes evaluated once, to a number of their own slot: those a single value can stand for."""
        found = {}
        for place, instances in self.trace.instances.items():
            value = instances[0].value
            if len(instances) != 1 or not isinstance(value, Slot):
                continue
            if self.tape.nodes[value.index] == place and self.matters(value.index):
                found[place] = instances[0]
        return found

    def matters(self, slot: int) -> bool:
        """Whether the accelerations depend on a slot."""
        return slot in self.tape.before(self.trace.outputs)

    def owner(self, place: int) -> ast.AST:
        """The function definition, or the module, that a node is in."""
        nodes, parent = self.source.nodes, self.source.parent
        while place in parent:
            place = parent[place]
            if isinstance(nodes[place], ast.FunctionDef | ast.Lambda | ast.Module):
                break
        return nodes[place]


def read(source: Source, target: Target, *, vary: bool = True, fresh: bool = False) -> Program:
    """The program at samples of a target; with `vary`, at other parameters too where it names them.

    Raises:
        InputError: what `trace` refuses.
    """
    samples = target.samples((), fresh)
    first = trace(source, samples.t, samples.q, samples.u)
    if not vary:
        return Program(first, samples)
    varied = named_parameters(first, target)
    if varied:
        try:
            target.samples(varied, fresh)
        except InputError:  # the mechanism allows no other values, or no states at them
            varied = ()
    if not varied:
        return Program(first, samples)
    return at(source, target, varied, fresh)


def named_parameters(found: Trace, target: Target) -> tuple[str, ...]:
    """The mechanism's parameters that the function has under the same name, with the same value."""
    known = target.mechanism.parameters
    return tuple(
        name
        for name in sorted(found.parameters)
        if name in known
        and known[name] != 0.0
        and abs(float(np.ravel(found.tape.values[found.parameters[name]])[0]) - known[name])
        <= SAME * abs(known[name])
    )


def at(source: Source, target: Target, varied: tuple[str, ...], fresh: bool = False) -> Program:
    """The program at samples in which the parameters `varied` take other values too.

    Raises InputError where the function does not have them all, with the model's values.
    """
    samples = target.samples(varied, fresh)
    found = trace(source, samples.t, samples.q, samples.u)
    missing = set(varied) - set(named_parameters(found, target))
    if missing:
        raise SourceError(f"{source.name}: no constant {min(missing)!r} with the model's value")
    if not varied:
        return Program(found, samples)
    tape = found.tape
    given = {found.parameters[name]: samples.parameters[name] for name in varied}
    changed = set(given)
    for k in given:
        changed.update(tape.after(k))
    with np.errstate(all="ignore"):
        for k in sorted(changed):
            operation = tape.operations[k]
            if k in given:
                tape.values[k] = given[k]
            elif operation is not None:
                tape.values[k] = operation(*(tape.values[i] for i in tape.inputs[k]))
    return Program(found, samples)
