"""The benchmarks: `make bench`. Prints the ratios and writes results/benchmarks.json."""

from __future__ import annotations

import argparse
import datetime
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

# Times of compilation mean something only when nothing was compiled before.
os.environ["DELTAC_CACHE"] = "off"
# Exudyn's build without range checks, where the processor has what it needs.
os.environ.setdefault("EXUDYN_MODULE", "fast")

import accuracy_run
import audit_run
import ensemble_run
import hardware
import humanoid_run
import kernel_sizes
import ledger_run
import limits_run
import single_run
import squeezer_run
import startup_run
from counts import counts
from measure import machine, use_processor_time
from peers import PENDULUMS

from deltac.kernels import evaluator_name

LONG_ROUNDS = 3  # of what takes half a minute
PACKAGES = (
    *("deltac", "numpy", "scipy", "casadi", "heyoka", "sympy"),
    *("mujoco", "pin", "exudyn", "drake", "pydy"),
)


def main() -> None:
    options = _options()
    about = machine(PACKAGES)
    about |= {"date": datetime.date.today().isoformat(), "evaluator": evaluator_name()}
    about["clock"] = "processor time" if options.processor_time else "wall time"
    if options.processor_time:
        use_processor_time()
    print(f"{about['processor']}, {about['cores']} cores, evaluator {about['evaluator']}")
    load = about["load_average"]
    if load is not None and load > 0.5:
        print(f"the machine is busy (load average {load}): take the numbers as provisional")
    allowed = hardware.run(min(options.rounds, LONG_ROUNDS))
    print(
        f"peak {allowed['gflops']:.0f} Gflop/s ({allowed['gflops_one_core']:.0f} on one core), "
        f"{allowed['gbytes_per_s']:.1f} GB/s copying"
    )
    content: dict[str, Any] = {"machine": about, "hardware": allowed, "contests": []}
    for part in options.only or PARTS:
        PARTS[part](options, allowed, content)
    content["instructions"] = counts()
    _write(options.out, content)
    print(f"written to {options.out}")


def _trajectory(options: argparse.Namespace, allowed: dict[str, Any], content: Any) -> None:
    adapters = [f"{name}_pendulum" for name in options.beside]
    rows = single_run.run(options.rounds, min(options.rounds, LONG_ROUNDS), adapters)
    for one in rows:
        if "target" in one:
            content["contests"].append(one)
            print(_told(one, single_run.told))
    print(single_run.table(rows), flush=True)
    content["one_trajectory"] = rows


def _limits(options: argparse.Namespace, allowed: dict[str, Any], content: Any) -> None:
    content["limits"] = limits_run.run(min(options.rounds, LONG_ROUNDS))
    print(limits_run.table(content["limits"]), flush=True)


def _contests(
    module: Any, measured: Callable[[argparse.Namespace, int], list[dict[str, Any]]]
) -> Callable[[argparse.Namespace, dict[str, Any], Any], None]:
    """A part that is contests alone; `measured` takes the options and how often what takes long is run."""

    def run(options: argparse.Namespace, allowed: dict[str, Any], content: Any) -> None:
        for one in measured(options, min(options.rounds, LONG_ROUNDS)):
            content["contests"].append(one)
            print(_told(one, module.told), flush=True)

    return run


def _kernels(options: argparse.Namespace, allowed: dict[str, Any], content: Any) -> None:
    few = min(options.rounds, LONG_ROUNDS)
    found = kernel_sizes.run(tuple(options.dof), few, allowed["gflops"])
    print(_table(found))
    print(f"  {kernel_sizes.growth(found)}", flush=True)
    content["kernels"] = found


def _audit(options: argparse.Namespace, allowed: dict[str, Any], content: Any) -> None:
    content["audit"] = audit_run.run(options.samples, min(options.rounds, LONG_ROUNDS))
    print(audit_run.told(content["audit"]), flush=True)


def _startup(options: argparse.Namespace, allowed: dict[str, Any], content: Any) -> None:
    content["startup"] = startup_run.run(min(options.rounds, LONG_ROUNDS))
    print(startup_run.told(content["startup"]))


PARTS: dict[str, Callable[[argparse.Namespace, dict[str, Any], Any], None]] = {
    "trajectory": _trajectory,
    "humanoid": _contests(humanoid_run, lambda options, few: [humanoid_run.run(options.rounds)]),
    "limits": _limits,
    "ensembles": _contests(
        ensemble_run, lambda options, few: ensemble_run.run(few, options.members)
    ),
    "accuracy": _contests(accuracy_run, lambda options, few: [accuracy_run.run(options.rounds)]),
    "squeezer": _contests(squeezer_run, lambda options, few: squeezer_run.run(options.rounds, few)),
    "ledger": _contests(ledger_run, lambda options, few: [ledger_run.run(options.samples, few)]),
    "audit": _audit,
    "kernels": _kernels,
    "startup": _startup,
}
"""What can be measured by itself (`--only`), in the order of a whole run."""


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=9, help="repeats of each measurement")
    parser.add_argument("--dof", type=int, nargs="*", default=[10, 30, 100], help="sizes of chains")
    parser.add_argument("--samples", type=int, default=1_000_000, help="rows of the ledger's log")
    parser.add_argument("--members", type=int, default=4096, help="of the ensembles")
    parser.add_argument("--only", nargs="*", choices=PARTS, help="these parts alone")
    beside = [name.removesuffix("_pendulum") for name in PENDULUMS]
    parser.add_argument(
        "--beside", nargs="*", choices=beside, default=beside, help="programs of one trajectory"
    )
    parser.add_argument(
        "--processor-time", action="store_true", help="of all threads, where others use the machine"
    )
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks.json"))
    options = parser.parse_args()
    if options.rounds < 1:
        parser.error("--rounds must be 1 or more")
    if options.samples < 1000:
        parser.error("--samples must be 1000 or more")
    if any(dof < 1 for dof in options.dof):
        parser.error("--dof: a chain has at least one degree of freedom")
    return options


def _told(found: dict[str, Any], more: Callable[[dict[str, Any]], str]) -> str:
    if "skipped" in found:
        return f"\n{found['name']}\n  skipped: {found['skipped']}"
    low, high = found["ratio_range"]
    met = "met" if found["ratio"] >= found["target"] else "MISSED"
    return (
        f"\n{found['name']}\n"
        f"  deltac {found['ours_s']:.4g} s, the other {found['theirs_s']:.4g} s "
        f"(medians of {found['rounds']} alternating rounds)\n"
        f"  {found['ratio']:.1f} times faster ({low:.1f} to {high:.1f}); "
        f"at least {found['target']:g} wanted: {met}\n"
        f"  {more(found)}"
    )


def _table(kernels: list[dict[str, Any]]) -> str:
    """The numbers that all sizes have, a line each."""
    heads = (
        "dof",
        "instructions",
        "per dof",
        "trace s",
        "compile s",
        "ns/state",
        "ns/dof",
        "of peak",
    )
    lines = ["\nrandom serial chains: accelerations by articulated bodies, a batch on all cores"]
    lines.append("  " + "".join(f"{head:>13}" for head in heads))
    for k in kernels:
        ns, peak = k["udot_ns_per_state"], k["of_peak"]
        lines.append(
            f"  {k['dof']:13d}{k['udot_instructions']:13d}{k['udot_instructions_per_dof']:13.0f}"
            f"{k['trace_s']:13.2f}{k['compile_s']:13.2f}{ns:13.1f}"
            f"{k['udot_ns_per_state_and_dof']:13.2f}{peak:13.0%}"
        )
        if "pinocchio_ns" in k:
            batch = k.get("pinocchio_batch_ns")
            lines.append(
                f"{'':15}Pinocchio's aba: a call from Python {k['pinocchio_ns']:.0f} ns"
                + (f", a state of a batch on all cores {batch:.0f} ns" if batch else "")
            )
    return "\n".join(lines)


def _write(path: Path, content: dict[str, Any]) -> None:
    """The file appears whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_suffix(".tmp")
    temporary.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", "utf-8")
    temporary.replace(path)


if __name__ == "__main__":
    main()
