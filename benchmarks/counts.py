"""Instruction counts of kernels: the measure of speed that is the same on every machine.

`python benchmarks/counts.py` writes them to instructions.json; a test compares, so that a change that makes
kernels larger shows as a difference of that file. `python benchmarks/counts.py --since REF` tells, as a table
in Markdown, what changed since a commit; continuous integration puts it into the summary of a pull request.
"""

from __future__ import annotations

import json
import subprocess
import sys
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


def since(ref: str) -> str:
    """A table of the counts that differ from those kept at a commit, with the ratio."""
    command = ["git", "show", f"{ref}:./{SNAPSHOT.name}"]
    before = json.loads(subprocess.check_output(command, cwd=SNAPSHOT.parent, text=True))
    rows = [
        f"| {name} | {kernel} | {was} | {now[kernel]} | {now[kernel] / was:.2f} |"
        for name, now in counts().items()
        for kernel, was in before.get(name, {}).items()
        if now[kernel] != was
    ]
    if not rows:
        return f"Instructions of kernels: none changed since {ref}."
    head = ["| mechanism | kernel | before | now | ratio |", "|---|---|--:|--:|--:|"]
    return "\n".join([f"Instructions of kernels since {ref}:", "", *head, *rows])


if __name__ == "__main__":
    if sys.argv[1:2] == ["--since"]:
        print(since(sys.argv[2]))
    else:
        SNAPSHOT.write_text(json.dumps(counts(), indent=2) + "\n", encoding="utf-8")
        print(f"written to {SNAPSHOT}")
