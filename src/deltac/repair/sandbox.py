"""Run functions in a process of their own, with limits of time and memory.

Only what the function needs of its module is run: the statements that set the names that it uses, and those
that these use, imports included. The process is `sandbox_worker.py`: JSON in, JSON out.
"""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from deltac.arrays import Array
from deltac.foreign.scripts import needed, statements_of
from deltac.repair.tracing.samples import StateSamples
from deltac.repair.tracing.source import Source, partial_in
from deltac.simulation.state_form import PLAIN

WORKER = Path(__file__).with_name("sandbox_worker.py")


@dataclass(frozen=True)
class SandboxTask:
    """A function to run: the text that it needs, its name there, how it takes the state, its folder."""

    text: str
    name: str
    arguments: tuple[str, ...]
    order: tuple[int, ...]
    controls: int
    column: bool
    folder: str


def task(source: Source) -> SandboxTask | None:
    """What is needed to run a source's function; None for one that only a running session has."""
    if source.root is not None and ("<locals>" in source.qualified or "." in source.qualified):
        return None
    form = source.form or PLAIN
    folder = "" if source.path is None else str(source.path.resolve().parent)
    text = ast.unparse(module_for(source.module, source.qualified.partition(".")[0]))
    partial = partial_in(source.root)
    arguments = {} if partial is None else partial.keywords
    if any(
        not isinstance(value, int | float | str | list | tuple | dict)
        for value in arguments.values()
    ):
        return None
    if arguments:
        values = ", ".join(f"{name}={value!r}" for name, value in arguments.items())
        text += f"\nimport functools\n{source.qualified} = functools.partial({source.qualified}, {values})"
    return SandboxTask(
        text, source.qualified, form.arguments, form.order, form.controls, form.column, folder
    )


def module_for(module: ast.Module, name: str) -> ast.Module:
    """What a name needs of a module; all of it where that cannot be seen."""
    chosen = needed(statements_of(module), [name])
    return module if chosen is None else ast.Module([s.node for s in chosen], [])


def run(tasks: Sequence[SandboxTask], samples: StateSamples, limit: float) -> list[Array | str]:
    """What functions return (n, B), q̇ after u̇ where they return it; or what went wrong, in words.

    They run in a process of their own; `limit` is the time (s) for all of them.
    """
    return list(stream(tasks, samples, limit))


def stream(
    tasks: Sequence[SandboxTask], samples: StateSamples, limit: float
) -> Generator[Array | str, None, None]:
    """`run`, one answer after the other, as soon as it is there; the process ends with the iterator."""
    states = {"t": samples.t.tolist(), "q": samples.q.T.tolist(), "u": samples.u.T.tolist()}
    order = json.dumps({"tasks": [vars(one) for one in tasks], "limit": limit, **states})
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    with tempfile.TemporaryFile("w+") as orders, tempfile.TemporaryFile("w+") as errors:
        orders.write(order)
        orders.seek(0)
        process = subprocess.Popen(
            [sys.executable, "-I", str(WORKER)],
            stdin=orders,
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
            env=environment,
        )
        late = threading.Timer(limit + 5.0, process.kill)
        late.start()
        answered = 0
        try:
            assert process.stdout is not None
            for line in process.stdout:
                answer: Any = json.loads(line)
                answered += 1
                yield answer if isinstance(answer, str) else np.array(answer, dtype=float).T
            process.wait()
            if answered < len(tasks):
                errors.seek(0)
                why = f"ended with status {process.returncode}: {errors.read().strip()[-200:]}"
                if not late.is_alive():
                    why = f"did not end within {limit:g} s"
                yield from [why] * (len(tasks) - answered)
        finally:
            late.cancel()
            process.kill()
            process.wait()
            assert process.stdout is not None
            process.stdout.close()
