"""Instruction counts of kernels: the measure of speed that is the same on every machine.

`python benchmarks/counts.py` writes them to instructions.json; a test compares, so that a change that makes
kernels larger shows as a difference of that file.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path

from kernel_sizes import chain

import deltac as dc
from deltac.dynamics.forces import channels
from deltac.dynamics.system import trace
from deltac.dynamics.terms import forward, terms
from deltac.kernels import Kernel

SNAPSHOT = Path(__file__).with_name("instructions.json")


def _problem(name: str) -> dc.Mechanism:
    return dc.problems.load(name).mechanism


def counts() -> dict[str, dict[str, int]]:
    """By mechanism: instructions of the accelerations, and of the energies and powers."""
    makers: dict[str, Callable[[], dc.Mechanism]] = {
        f"random chain of {dof}": partial(chain, dof) for dof in (3, 10, 30)
    }
    for name in ("simple-pendulum", "triple-pendulum", "heavy-top", "bricard", "andrews-squeezer"):
        makers[name] = partial(_problem, name)
    return {name: _of(make()) for name, make in makers.items()}


def _of(mechanism: dc.Mechanism) -> dict[str, int]:
    system = trace(mechanism)
    parts = channels(system)
    columns = {
        name: column
        for name, column in {"t": system.t, "q": system.q, "u": system.u}.items()
        if column.shape[0]
    }
    motion = Kernel(columns, {"udot": forward(system, parts).udot})
    known = terms(system, system.udot_all, parts)
    outputs = {"K": known.K, "V": known.V, "P": known.force_power}
    return {
        "accelerations": motion.instructions,
        "energies": Kernel(columns, outputs).instructions,
    }


if __name__ == "__main__":
    SNAPSHOT.write_text(json.dumps(counts(), indent=2) + "\n", encoding="utf-8")
    print(f"written to {SNAPSHOT}")
