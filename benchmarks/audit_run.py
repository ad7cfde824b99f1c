"""The ledger of a long log of a humanoid beside one read of it, and a whole audit beside its ledger.

All in processor time of all threads, after a first call each; the verdict must be right.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import humanoid
from ledger_run import KEPT, read_once

import deltac as dc

WANTED = 2.0
READS = 6.0


def run(rows: int, rounds: int) -> dict[str, Any]:
    """Seconds of each; {"skipped": why} without MuJoCo, whose model it is."""
    if find_spec("mujoco") is None:
        return {"skipped": "MuJoCo is not installed (the extra 'mujoco' brings it)"}
    from deltac.importers import read_mechanism

    log = humanoid.log(rows)
    mechanism, _ = read_mechanism(humanoid.model())

    def audit() -> None:
        verdict = dc.audit(mechanism, log).verdict
        assert verdict.kind == "consistent", f"the verdict is {verdict.kind!r}"

    def ledger(keep: int | None = None) -> Callable[[], object]:
        return lambda: dc.balance(mechanism, log, work="samples", keep=keep)

    work = {
        "read": lambda: read_once(log),
        "kept": ledger(KEPT),
        "ledger": ledger(),
        "audit": audit,
    }
    found: dict[str, Any] = {f"{n}_s": _processor_seconds(w, rounds) for n, w in work.items()}
    reads = {f"{n}_reads": found[f"{n}_s"] / found["read_s"] for n in ("kept", "ledger")}
    ratio = found["audit_s"] / found["ledger_s"]
    return {**found, **reads, "rows": rows, "rounds": rounds, "ratio": ratio, "wanted": WANTED}


def told(found: dict[str, Any]) -> str:
    """All of it in words."""
    if "skipped" in found:
        return f"\naudit: skipped: {found['skipped']}"
    lines = [
        f"\n{found['rows']} rows of a 27-dof humanoid, processor time (medians of {found['rounds']})",
        f"  one read of q, u and the forces {found['read_s']:.3f} s",
    ]
    for name, what in (("kept", f"with {KEPT} rows kept"), ("ledger", "of all rows")):
        reads = found[f"{name}_reads"]
        lines.append(
            f"  ledger {what} {found[f'{name}_s']:.2f} s: {reads:.1f} reads; "
            f"at most {READS:g} wanted: {_met(reads, READS)}"
        )
    lines.append(
        f"  audit {found['audit_s']:.2f} s: {found['ratio']:.1f} times the ledger of all rows; "
        f"at most {found['wanted']:g} wanted: {_met(found['ratio'], found['wanted'])}"
    )
    return "\n".join(lines)


def _met(found: float, wanted: float) -> str:
    return "met" if found <= wanted else "MISSED"


def _processor_seconds(work: Callable[[], object], rounds: int) -> float:
    work()
    taken = []
    for _ in range(rounds):
        start = time.process_time()
        work()
        taken.append(time.process_time() - start)
    return statistics.median(taken)
