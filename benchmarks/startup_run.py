"""How long one waits: for a verdict in a fresh process, and for kernels that were compiled before.

A process each, with a cache folder of its own: cold is the first in an empty folder, warm the next one there.
`python benchmarks/startup_run.py DOF` is such a process: it compiles a chain's accelerations.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from kernel_sizes import accelerations, chain
from measure import seconds

from deltac.kernels import evaluator_name

STUDY = ("study", "triple-pendulum", "--steps", "0.02,0.01,0.005", "--json")
SHORT = {
    "import deltac": (["-c", "import deltac"], 0.1),
    "deltac --help": (["-m", "deltac", "--help"], 0.2),
}
"""What answers at once: its command, and how long it may take beyond Python's own start (s)."""
VERDICT_WITHIN = {"cold": 2.0, "warm": 1.0}  # s
SIZES = (30, 100)
LOADED_WITHIN = 0.3  # s
CHECKED = {3: 2.0, 30: 10.0}
"""Joints of a chain whose equations are checked -> how long that may take with an empty cache (s)."""


def run(rounds: int) -> dict[str, Any]:
    """Seconds, cold and warm, of the first verdict and of the kernels of chains."""
    verdicts: dict[str, list[float]] = {"cold": [], "warm": []}
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as folder:
            for kind in verdicts:
                verdicts[kind].append(_first_verdict(folder))
    return {
        "command": "deltac " + " ".join(STUDY),
        "verdict_s": {kind: statistics.median(taken) for kind, taken in verdicts.items()},
        "verdict_wanted_s": VERDICT_WITHIN,
        # CasADi's evaluator compiles nothing, and keeps nothing.
        "kernels": [_loaded(dof, rounds) for dof in SIZES if evaluator_name() == "llvm"],
        "loaded_wanted_s": LOADED_WITHIN,
        "short": {name: _short(command, rounds) for name, (command, _) in SHORT.items()},
        "checks": [_checked(dof, rounds) for dof in CHECKED],
        "rounds": rounds,
    }


def told(found: dict[str, Any]) -> str:
    """All of it in words."""
    lines = [f"\nwaiting, fresh processes (medians of {found['rounds']})"]
    for kind, taken in found["verdict_s"].items():
        wanted = found["verdict_wanted_s"][kind]
        lines.append(
            f"  {found['command']}, cache {kind}: {taken:.2f} s; "
            f"less than {wanted:g} s wanted: {_met(taken, wanted)}"
        )
    for kernel in found["kernels"]:
        loaded, wanted = kernel["loaded_s"], found["loaded_wanted_s"]
        lines.append(
            f"  accelerations of a chain of {kernel['dof']}: written out in {kernel['trace_s']:.2f} s, "
            f"compiled in {kernel['compiled_s']:.2f} s, from the cache in {loaded:.3f} s; "
            f"less than {wanted:g} s wanted: {_met(loaded, wanted)}"
        )
    for name, taken in found["short"].items():
        wanted = SHORT[name][1]
        lines.append(
            f"  {name}: {taken:.2f} s of processor time beyond Python's own; "
            f"less than {wanted:g} s wanted: {_met(taken, wanted)}"
        )
    for check in found["checks"]:
        lines.append(
            f"  deltac check of a chain of {check['dof']}, cache cold: {check['wall_s']:.2f} s, processor "
            f"{check['processor_s']:.2f} s; less than {check['wanted_s']:g} s wanted: "
            f"{_met(check['wall_s'], check['wanted_s'])}"
        )
    return "\n".join(lines)


def kernel_times(dof: int) -> dict[str, float]:
    """Seconds to write out the accelerations of a chain, and to compile them or find them in the cache."""
    import llvmlite.binding  # noqa: F401  # its import is no part of either

    kernels: list[Any] = []
    traced = seconds(lambda: kernels.append(accelerations(chain(dof))))
    return {"trace_s": traced, "compile_s": seconds(kernels[0].compile)}


def _met(taken: float, wanted: float) -> str:
    return "met" if taken < wanted else "MISSED"


def _first_verdict(folder: str) -> float:
    """Wall time of the whole process (s); its verdict must be right."""
    start = time.perf_counter()
    said = _process(["-m", "deltac", *STUDY], folder)
    taken = time.perf_counter() - start
    kind = json.loads(said)["verdict"]
    assert kind == "consistent", f"{' '.join(STUDY)}: the verdict is {kind!r}"
    return taken


def _short(command: list[str], rounds: int) -> float:
    """Median processor time of a process (s), less that of Python alone."""
    taken = []
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(rounds):
            bare, whole = (_spent(one, folder)[0] for one in (["-c", "pass"], command))
            taken.append(whole - bare)
    return statistics.median(taken)


def _spent(arguments: list[str], folder: str) -> tuple[float, str]:
    """Processor time of a process (s), and what it says."""
    before = os.times()
    said = _process(arguments, folder)
    after = os.times()
    spent = after.children_user - before.children_user
    return spent + after.children_system - before.children_system, said


def _checked(dof: int, rounds: int) -> dict[str, float]:
    """Wall and processor time of whole processes, each with an empty cache; the verdict must be right."""
    file = Path(__file__).with_name("check_chain.py")
    command = ["-m", "deltac", "check", f"{file}:chain_{dof}", f"{file}:equations_{dof}", "--json"]
    walls, processors = [], []
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as folder:
            start = time.perf_counter()
            spent, said = _spent(command, folder)
            walls.append(time.perf_counter() - start)
        processors.append(spent)
        kind = json.loads(said)["verdict"]
        assert kind == "consistent", f"check of a chain of {dof}: the verdict is {kind!r}"
    medians = {"wall_s": statistics.median(walls), "processor_s": statistics.median(processors)}
    return {"dof": dof, **medians, "wanted_s": CHECKED[dof]}


def _loaded(dof: int, rounds: int) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as folder:
        times = [json.loads(_process([__file__, str(dof)], folder)) for _ in range(1 + rounds)]
    return {
        "dof": dof,
        "trace_s": statistics.median(one["trace_s"] for one in times),
        "compiled_s": times[0]["compile_s"],
        "loaded_s": statistics.median(one["compile_s"] for one in times[1:]),
    }


def _process(arguments: list[str], folder: str) -> str:
    """What a Python process says, which has this folder as its cache."""
    environment = {**os.environ, "DELTAC_CACHE": "on", "DELTAC_CACHE_DIR": folder}
    command = [sys.executable, *arguments]
    return subprocess.run(
        command, env=environment, check=True, stdout=subprocess.PIPE, text=True
    ).stdout


if __name__ == "__main__":
    print(json.dumps(kernel_times(int(sys.argv[1]))))
