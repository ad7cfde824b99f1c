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
os.environ.setdefault("DELTAC_CACHE", "off")

import kernel_sizes
import ledger_run
import single_run
from measure import machine

from deltac.kernels import evaluator_name

LONG_ROUNDS = 3  # of what takes half a minute
PACKAGES = ("deltac", "numpy", "casadi", "heyoka", "mujoco")


def main() -> None:
    options = _options()
    about = machine(PACKAGES)
    about |= {"date": datetime.date.today().isoformat(), "evaluator": evaluator_name()}
    print(f"{about['processor']}, {about['cores']} cores, evaluator {about['evaluator']}")
    load = about["load_average"]
    if load is not None and load > 0.5:
        print(f"the machine is busy (load average {load}): take the numbers as provisional")
    contests = []
    for module, found in (
        (single_run, lambda: single_run.run(options.rounds)),
        (ledger_run, lambda: ledger_run.run(options.samples, min(options.rounds, LONG_ROUNDS))),
    ):
        contests.append(found())
        print(_told(contests[-1], module.told))
    kernels = kernel_sizes.run(tuple(options.dof), options.rounds)
    print(_table(kernels))
    _write(options.out, {"machine": about, "contests": contests, "kernels": kernels})
    print(f"written to {options.out}")


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=9, help="repeats of each measurement")
    parser.add_argument("--dof", type=int, nargs="*", default=[3, 10, 30], help="sizes of chains")
    parser.add_argument("--samples", type=int, default=1_000_000, help="rows of the ledger's log")
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
        f"  deltac {found['ours_s']:.3f} s, MuJoCo {found['theirs_s']:.3f} s "
        f"(medians of {found['rounds']} alternating rounds)\n"
        f"  {found['ratio']:.1f} times faster ({low:.1f} to {high:.1f}); "
        f"at least {found['target']:g} wanted: {met}\n"
        f"  {more(found)}"
    )


def _table(kernels: list[dict[str, Any]]) -> str:
    heads = ("dof", "instructions", "per dof", "kinetic", "compile s", "ns/state", "ns/dof")
    lines = ["\nrandom serial chains: accelerations (and instructions of the kinetic energy)"]
    lines.append("  " + "".join(f"{head:>13}" for head in heads))
    for k in kernels:
        dof, n, each, kinetic, compiled, ns, ns_each = k.values()
        lines.append(
            f"  {dof:13d}{n:13d}{each:13.0f}{kinetic:13d}{compiled:13.2f}{ns:13.1f}{ns_each:13.2f}"
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
