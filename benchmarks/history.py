"""What the benchmarks gave from one time to the next, on one kind of processor: a loss of speed is seen.

`python benchmarks/history.py --add results/benchmarks.json` puts the figures of a run of `run.py` into
history.json, with date, commit and processor; `python benchmarks/history.py` tells what each figure was there
when it was last measured, and before that on the same kind of processor, and says `LOST` where
it got worse by more than a quarter. Ratios to other programs in one run hold up under load; seconds do not.
"""

from __future__ import annotations

import argparse
import json
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

HISTORY = Path(__file__).with_name("history.json")
LOST = 1.25
"""A figure this many times worse than before is told as lost: what remains of noise in ratios is less."""


def figures(found: dict[str, Any]) -> Iterator[tuple[str, float, bool]]:
    """What a run of the benchmarks gave: name, number, and whether more is better."""
    clock = found.get("machine", {}).get("clock", "wall time")
    by = "" if clock == "wall time" else f", {clock}"
    for one in found.get("contests", ()):
        if "ratio" in one:
            yield one["name"] + by, one["ratio"], True
    for one in found.get("one_trajectory", ()):
        if "ratio" in one and "target" not in one:
            yield one["name"] + by, one["ratio"], True
    for one in found.get("limits", ()):
        if "ratio" in one:
            yield one["name"] + by, one["ratio"], False
    for one in found.get("kernels", ()):
        what = f"chain of {one['dof']}"
        yield f"{what}: ns per state and dof", one["udot_ns_per_state_and_dof"], False
        yield f"{what}: compiling, s", one["compile_s"], False
    startup = found.get("startup", {})
    for cache, taken in startup.get("verdict_s", {}).items():
        yield f"first verdict, cache {cache}, s", taken, False
    for one in startup.get("kernels", ()):
        yield f"chain of {one['dof']}: from the cache, s", one["loaded_s"], False
    audit = found.get("audit", {})
    if "ratio" in audit:
        rows = audit["rows"]
        yield f"audit of {rows} rows / its ledger", audit["ratio"], False
        yield f"ledger of {rows} rows, some kept / one read", audit["kept_reads"], False
        yield f"ledger of {rows} rows, all columns / one read", audit["ledger_reads"], False


def add(results: Path) -> None:
    """Put the figures of a run into the history."""
    found = json.loads(results.read_text(encoding="utf-8"))
    about = found["machine"]
    command = ["git", "log", "-1", "--format=%h"]
    commit = subprocess.run(command, capture_output=True, text=True, cwd=HISTORY.parent)
    entry = {
        "date": about["date"],
        "commit": commit.stdout.strip(),
        "processor": about["processor"],
        "cores": about["cores"],
    }
    told = {
        name: [float(f"{value:.3g}"), "more" if more else "less"]
        for name, value, more in figures(found)
    }
    entries = _entries()
    if not entries or any(entries[-1][key] != value for key, value in entry.items()):
        entries.append({**entry, "figures": {}})
    entries[-1]["figures"] |= told  # parts that were run one by one are one entry
    HISTORY.write_text(json.dumps(entries, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def table(entries: list[dict[str, Any]]) -> str:
    """Each figure's last two values on one kind of processor, in Markdown."""
    lines = ["| figure | before | last | |", "|---|--:|--:|---|"]
    seen: dict[tuple[str, str], list[tuple[float, str, str]]] = {}
    for entry in entries:
        for name, (value, better) in entry["figures"].items():
            place = (entry["processor"], name)
            seen.setdefault(place, []).append((value, better, entry["commit"]))
    for (_, name), values in seen.items():
        last, better, commit = values[-1]
        if len(values) == 1:
            lines.append(f"| {name} | | {last:g} ({commit}) | |")
            continue
        before, _, then = values[-2]
        worse = before / last if better == "more" else last / before
        lines.append(
            f"| {name} | {before:g} ({then}) | {last:g} ({commit}) | {'LOST' if worse > LOST else ''} |"
        )
    return "\n".join(lines)


def _entries() -> list[dict[str, Any]]:
    return json.loads(HISTORY.read_text(encoding="utf-8")) if HISTORY.exists() else []


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--add", type=Path, metavar="RESULTS", help="a file written by run.py")
    options = parser.parse_args()
    if options.add:
        add(options.add)
    print(table(_entries()))
