"""The process in which functions are run: JSON on standard input, a line of JSON for each on output.

It imports nothing but NumPy, so that it starts quickly, and bounds its own time and memory.
"""

from __future__ import annotations

import contextlib
import json
import sys
from typing import Any

import numpy as np

MEMORY = 2 * 1024**3
"""Bytes of address space that the process may take."""


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
