"""A whole audit of a long log of a humanoid, verdict included, beside its ledger alone.

Both in processor time of all threads, after a first call each; the verdict must be right.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import humanoid

import deltac as dc

WANTED = 2.0


def run(rows: int, rounds: int) -> dict[str, Any]:
    """Seconds of both; {"skipped": why} without MuJoCo, whose model it is."""
    if find_spec("mujoco") is None:
        return {"skipped": "MuJoCo is not installed (the extra 'mujoco' brings it)"}
    from deltac.importers import read_mechanism

    log = humanoid.log(rows)
    mechanism, _ = read_mechanism(humanoid.model())

    def audit() -> None:
        verdict = dc.audit(mechanism, log).verdict
        assert verdict.kind == "consistent", f"the verdict is {verdict.kind!r}"

    found = {
        "audit_s": _processor_seconds(audit, rounds),
        "ledger_s": _processor_seconds(lambda: dc.balance(mechanism, log, work="samples"), rounds),
    }
    ratio = found["audit_s"] / found["ledger_s"]
    return {**found, "rows": rows, "rounds": rounds, "ratio": ratio, "wanted": WANTED}


def told(found: dict[str, Any]) -> str:
    """All of it in words."""
    if "skipped" in found:
        return f"\naudit: skipped: {found['skipped']}"
    met = "met" if found["ratio"] <= found["wanted"] else "MISSED"
    return (
        f"\naudit of {found['rows']} rows of a 27-dof humanoid, processor time "
        f"(medians of {found['rounds']})\n"
        f"  {found['audit_s']:.2f} s, the ledger alone {found['ledger_s']:.2f} s: "
        f"{found['ratio']:.1f} times; at most {found['wanted']:g} wanted: {met}"
    )


def _processor_seconds(work: Callable[[], object], rounds: int) -> float:
    work()
    taken = []
    for _ in range(rounds):
        start = time.process_time()
        work()
        taken.append(time.process_time() - start)
    return statistics.median(taken)
