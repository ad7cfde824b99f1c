"""Every verb once, on a small case: what it found as bytes, to be compared to the last bit."""

from __future__ import annotations

import asyncio
import hashlib
import multiprocessing
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np

import deltac as dc
from deltac import problems


def digest(*arrays: object) -> str:
    """Of arrays by their bytes, of anything else by its text."""
    found = hashlib.blake2b(digest_size=16)
    for a in arrays:
        found.update(a.tobytes() if isinstance(a, np.ndarray) else repr(a).encode())
    return found.hexdigest()


def _run(solver: str, name: str = "double-pendulum") -> dc.Trajectory:
    problem = problems.load(name)
    return dc.simulate(problem.mechanism, problem.state, 0.5, 0.01, solver)


def _simulate() -> str:
    runs = [_run(s) for s in ("ode4", "DOP853", "implicit-midpoint")] + [_run("ode4", "n-four-bar")]
    return digest(*(a for r in runs for a in (r.q, r.u, r.udot, *r.integrals.values())))


def _ensemble() -> str:
    problem = problems.load("double-pendulum")
    states = [problem.mechanism.state(problem.state.q, k * problem.state.u) for k in range(9)]
    found = dc.simulate_ensemble(problem.mechanism, states, 0.5, 0.01, "ode4")
    return digest(found.q, found.u)


def _balance() -> str:
    ledger = dc.balance("double-pendulum", _run("ode4"))
    return digest(*ledger.delta_c.values(), *ledger.work.values())


def _audit() -> str:
    run = _run("ode4")
    found = dc.audit("double-pendulum", run)
    return digest(found.verdict, [f.code for f in found.findings])


def _study() -> str:
    found = dc.study("double-pendulum", duration=0.5, steps=[0.02, 0.01, 0.005], solver="ode4")
    return digest(found.verdict)


def wrong(t: float, q: np.ndarray, u: np.ndarray) -> list[float]:
    """A pendulum of 0.7 m, with a wrong factor."""
    return [-9.0 * np.sin(q[0]) / 0.7]


def _check() -> str:
    found = dc.check_equations("simple-pendulum", wrong)
    return digest(found.verdict, [f.code for f in found.findings])


def _evaluate() -> str:
    found = dc.evaluate("n-four-bar", problems.load("n-four-bar").state)
    return digest(found.udot, found.M, found.multipliers)


VERBS: dict[str, Callable[[], str]] = {
    "simulate": _simulate,
    "simulate_ensemble": _ensemble,
    "balance": _balance,
    "audit": _audit,
    "study": _study,
    "check_equations": _check,
    "evaluate": _evaluate,
}


def call(name: str) -> str:
    """One verb, by name, as processes are told."""
    return VERBS[name]()


TWICE = [*VERBS, *VERBS]


def _threads() -> list[str]:
    with ThreadPoolExecutor(4) as pool:
        return list(pool.map(call, TWICE))


def _processes(method: str) -> list[str]:
    context = multiprocessing.get_context(method)
    with ProcessPoolExecutor(2, mp_context=context) as pool:
        return list(pool.map(call, TWICE))


async def _tasks() -> list[str]:
    return await asyncio.gather(*(asyncio.to_thread(call, name) for name in TWICE))


WAYS: dict[str, Callable[[], list[str]]] = {
    "threads": _threads,
    "fork": lambda: _processes("fork"),
    "spawn": lambda: _processes("spawn"),
    "asyncio": lambda: asyncio.run(_tasks()),
}

if __name__ == "__main__":
    together = WAYS[sys.argv[1]]
    if sys.argv[1] == "fork":  # after work of its own, so that all that a fork inherits is there
        alone = [call(name) for name in TWICE]
        found = together()
    else:
        found = together()
        alone = [call(name) for name in TWICE]
    different = sorted({name for name, a, b in zip(TWICE, found, alone, strict=True) if a != b})
    print(different)
    sys.exit(bool(different))
