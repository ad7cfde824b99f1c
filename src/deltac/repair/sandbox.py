"""Run functions in a process of their own, with limits of time and memory.

Only what the function needs of its module is run: the statements that set the names that it uses, and those
that these use, imports included.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial

import numpy as np

from deltac.arrays import Array
from deltac.foreign.isolation import Failure, Workers
from deltac.foreign.scripts import needed, returned, statements_of
from deltac.repair.tracing.samples import StateSamples
from deltac.repair.tracing.source import Source, partial_in
from deltac.simulation import PLAIN_FORM, StateForm


@dataclass(frozen=True)
class SandboxTask:
    """A function to run: the text that it needs, its name there, its folder, how it takes the state."""

    text: str
    name: str
    folder: str
    form: StateForm


@contextmanager
def sandbox() -> Iterator[Callable[[SandboxTask, StateSamples, float], Array | str]]:
    """What runs tasks at states within so many seconds each, in a process that ends with the context."""
    workers = Workers(quiet=True)
    try:
        yield partial(_run, workers)
    finally:
        workers.end()


def _run(workers: Workers, one: SandboxTask, samples: StateSamples, limit: float) -> Array | str:
    """What a function returns (n, B), q̇ after u̇ where it returns it; or what went wrong, in words."""
    states = zip(samples.t, samples.q.T, samples.u.T)
    calls = [one.form.given(float(t), q, u, np.array, 0.0) for t, q, u in states]
    answer = workers(partial(returned, one.text, one.name, one.folder, calls), limit)
    if isinstance(answer, Failure):
        return answer.message
    try:
        parts = [one.form.split(numbers, len(samples.q), len(samples.u)) for numbers in answer]
    except ValueError as error:
        return str(error)
    return np.array([[*accelerations, *rates] for rates, accelerations in parts]).T


def task(source: Source) -> SandboxTask | None:
    """What is needed to run a source's function; None for one that only a running session has."""
    if source.root is not None and ("<locals>" in source.qualified or "." in source.qualified):
        return None
    folder = "" if source.path is None else str(source.path.resolve().parent)
    text = ast.unparse(module_for(source.module, source.qualified.partition(".")[0]))
    partial_function = partial_in(source.root)
    arguments = {} if partial_function is None else partial_function.keywords
    if any(
        not isinstance(value, int | float | str | list | tuple | dict)
        for value in arguments.values()
    ):
        return None
    if arguments:
        values = ", ".join(f"{name}={value!r}" for name, value in arguments.items())
        text += f"\nimport functools\n{source.qualified} = functools.partial({source.qualified}, {values})"
    return SandboxTask(text, source.qualified, folder, source.form or PLAIN_FORM)


def module_for(module: ast.Module, name: str) -> ast.Module:
    """What a name needs of a module; all of it where that cannot be seen."""
    chosen = needed(statements_of(module), [name])
    return module if chosen is None else ast.Module([s.node for s in chosen], [])
