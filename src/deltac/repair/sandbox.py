"""Run functions in a process of their own, with limits of time and memory.

Only what the reader has understood is run: the function, and the constants and functions of its module
that it uses. The process is `sandbox_worker.py`: JSON in, JSON out.
"""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from deltac.arrays import Array
from deltac.repair.tracing.samples import Samples
from deltac.repair.tracing.source import Source

CHILD = Path(__file__).with_name("sandbox_worker.py")


def extract(source: Source, statements: frozenset[int]) -> tuple[str, str] | None:
    """A module with what the function needs (the module's statements on these lines), and its name.

    None for methods and closures, which cannot be had without their surroundings.
    """
    if "." in source.qualified:
        return None
    own = source.function
    body = [s for s in source.module.body if s is own or s.lineno in statements or _future(s)]
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
    try:
        done = subprocess.run(
            [sys.executable, "-I", str(CHILD)],
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
