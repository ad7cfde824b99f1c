"""Run functions in a process of their own, with limits of time and memory.

Only what the reader has understood is run: the function, and the constants and functions of its module
that it uses. As a module (``python -m deltac.diagnosis.repair.runner``) it is that process: JSON in, JSON
out.
"""

from __future__ import annotations

import ast
import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from deltac.diagnosis.repair.interpreter import Trace
from deltac.diagnosis.repair.samples import Samples
from deltac.diagnosis.repair.tape import Array

MEMORY = 2 * 1024**3
"""Bytes of address space that the process may take, beyond what it starts with."""


def extract(trace: Trace) -> tuple[str, str] | None:
    """A module with what the function needs, and the function's name; None for methods and closures."""
    source = trace.source
    if "." in source.qualified:
        return None
    own = source.function
    body = [
        s
        for s in source.module.body
        if s is own or s.lineno in trace.statements or _future(s)
    ]
    return ast.unparse(ast.Module(body=body, type_ignores=[])), own.name


def _future(statement: ast.stmt) -> bool:
    return isinstance(statement, ast.ImportFrom) and statement.module == "__future__"


def run(modules: Sequence[tuple[str, str]], samples: Samples, limit: float) -> list[Array | str]:
    """Accelerations (n, B) that functions return, or what went wrong, in a process of their own.

    `limit` is the time (s) for all of them.
    """
    states = {"t": samples.t.tolist(), "q": samples.q.T.tolist(), "u": samples.u.T.tolist()}
    task = json.dumps({"modules": list(modules), "limit": limit, **states})
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    environment["PYTHONPATH"] = os.pathsep.join(p for p in sys.path if p)
    try:
        done = subprocess.run(
            [sys.executable, "-m", "deltac.diagnosis.repair.runner"],
            input=task,
            capture_output=True,
            text=True,
            timeout=limit + 5.0,
            env=environment,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return [f"did not end within {limit:g} s"] * len(modules)
    answers: list[Array | str] = []
    for line in done.stdout.splitlines():
        answer = json.loads(line)
        answers.append(answer if isinstance(answer, str) else np.array(answer, dtype=float).T)
    while len(answers) < len(modules):
        answers.append(f"ended with status {done.returncode}: {done.stderr.strip()[-200:]}")
    return answers


def _limits(seconds: float) -> None:
    """Bound the time and memory of this process, where the system can."""
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        cpu = int(seconds) + 2
        resource.setrlimit(resource.RLIMIT_CPU, (cpu, cpu + 1))
        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        wanted = MEMORY if hard == resource.RLIM_INFINITY else min(MEMORY, hard)
        resource.setrlimit(resource.RLIMIT_AS, (wanted, hard))


def _answer(module: tuple[str, str], task: dict[str, Any]) -> list[list[float]] | str:
    text, name = module
    namespace: dict[str, Any] = {"__name__": "equations"}
    try:
        with np.errstate(all="ignore"):
            exec(compile(text, "equations", "exec"), namespace)
            function = namespace[name]
            rows = []
            for t, q, u in zip(task["t"], task["q"], task["u"]):
                value = function(t, np.array(q), np.array(u))
                rows.append(np.asarray(value, dtype=float).ravel().tolist())
            return rows
    except Exception as error:  # whatever a function raises is its answer
        return f"{type(error).__name__}: {error}"


def main() -> None:
    """Read a task, answer line by line."""
    task = json.load(sys.stdin)
    _limits(task["limit"])
    out, sys.stdout = sys.stdout, sys.stderr
    for module in task["modules"]:
        print(json.dumps(_answer(tuple(module), task)), file=out, flush=True)


if __name__ == "__main__":
    main()
