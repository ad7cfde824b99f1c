"""The process in which functions are run: JSON on standard input, a line of JSON for each on output.

It imports nothing but NumPy, so that it starts quickly, and bounds its own time and memory.
"""

from __future__ import annotations

import contextlib
import inspect
import json
import sys
import types
from collections.abc import Callable
from typing import Any

import numpy as np

MEMORY = 4 * 1024**3
"""Bytes of address space that the process may take."""


def _limits(seconds: float) -> None:
    """Bound the time and memory of this process, where the system can."""
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        cpu = int(seconds) + 2
        resource.setrlimit(resource.RLIMIT_CPU, (cpu, cpu + 1))
        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        memory = MEMORY if hard == resource.RLIM_INFINITY else min(MEMORY, hard)
        resource.setrlimit(resource.RLIMIT_AS, (memory, hard))


def function_named(namespace: dict[str, Any], name: str) -> Callable[..., Any]:
    """What a name with dots means; a class stands for an object, what needs no argument is asked."""
    parts = [part for part in name.split(".") if part != "<locals>"]
    value = namespace[parts[0]]
    for part in parts[1:]:
        if isinstance(value, type) and inspect.isfunction(
            inspect.getattr_static(value, part, None)
        ):
            value = value()
        value = getattr(value, part)
    if isinstance(value, type):
        value = value()
    with contextlib.suppress(TypeError, ValueError):
        parameters = inspect.signature(value).parameters.values()
        if all(p.default is not p.empty for p in parameters):
            result = value()
            value = result if callable(result) else value
    function: Callable[..., Any] = getattr(value, "rhs", value)
    return function


def _arguments(task: dict[str, Any], t: float, q: list[float], u: list[float]) -> list[Any]:
    entries = [*q, *u]
    values: dict[str, Any] = {
        "t": t,
        "q": np.array(q),
        "u": np.array(u),
        "state": np.array([entries[k] for k in task["order"]]),
        "augmented": np.array([entries[k] for k in task["order"]] + [0.0] * task["controls"]),
        "control": np.zeros(task["controls"]) if task["controls"] else 0.0,
    }
    arguments = [values[what] for what in task["arguments"]]
    return [x.reshape(-1, 1) if task["column"] and np.ndim(x) else x for x in arguments]


def _sorted(value: Any, task: dict[str, Any], nq: int, nu: int) -> list[float]:
    """u̇, then q̇ where it is returned."""
    parts = value if isinstance(value, tuple | list) else [value]
    rates = np.concatenate([np.asarray(p, dtype=float).ravel() for p in parts])
    if "augmented" in task["arguments"]:
        rates = rates[: nq + nu]
    if len(rates) != nq + nu:
        return [float(x) for x in rates]
    back = np.empty(nq + nu)
    back[task["order"] or np.arange(nq + nu)] = rates
    return [float(x) for x in (*back[nq:], *back[:nq])]


def _answer(task: dict[str, Any], states: dict[str, Any]) -> list[list[float]] | str:
    module = types.ModuleType("equations")
    sys.modules["equations"] = module  # dataclasses look their module up
    namespace = vars(module)
    if task["folder"]:
        sys.path.insert(0, task["folder"])
    try:
        with np.errstate(all="ignore"):
            exec(compile(task["text"], "equations", "exec"), namespace)
            function = function_named(namespace, task["name"])
            return [
                _sorted(function(*_arguments(task, t, q, u)), task, len(q), len(u))
                for t, q, u in zip(states["t"], states["q"], states["u"])
            ]
    except BaseException as error:  # whatever a function raises, exits included, is its answer
        return f"{type(error).__name__}: {error}"
    finally:
        if task["folder"]:
            sys.path.remove(task["folder"])


def main() -> None:
    """Read a task, answer line by line."""
    order = json.load(sys.stdin)
    _limits(order["limit"])
    out, sys.stdout = sys.stdout, sys.stderr
    for task in order["tasks"]:
        print(json.dumps(_answer(task, order)), file=out, flush=True)


if __name__ == "__main__":
    main()
