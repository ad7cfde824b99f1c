"""The mutation campaign: how many mistakes in equations of motion are detected, and repaired.

    make bench-repair [ARGS="--only triple_pendulum --limit 100 --seed 0 --json out.json"]

Mutants come from `deltac.repair.mutate.operators`, which knows nothing of how repairs are sought, and from
the mistakes by hand in `mistakes.py`. A mutant is repaired if the first edit offered gives the right
equations: the same accelerations as the unmutated file at random states, with all named constants moved. It
is equivalent if its own accelerations are those of the unmutated file.
"""

from __future__ import annotations

import argparse
import json
import random
import statistics
import sys
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

from equations import CASES, load  # noqa: E402, its folder is on the path by now

_STATE: dict[str, Any] = {}


def prepare(case: str) -> None:
    """What a process keeps: the right source, the model, the right results."""
    from deltac.repair.tracing.samples import Target
    from deltac.repair.tracing.source import read_source

    if _STATE.get("case") == case:
        return
    mechanism, coordinates = load(case)
    source = read_source(HERE / "equations" / f"{case}.py:rhs")
    target = Target(mechanism, coordinates)
    _STATE.update(case=case, source=source, target=target)
    attempt((case, {"kind": "", "line": 0, "before": "", "after": "", "text": source.text}))


def attempt(task: tuple[str, dict[str, Any]]) -> dict[str, Any]:
    """One mutant: is it wrong, is it repaired, how long did it take."""
    from deltac.errors import InputError
    from deltac.repair.repair import repair_source

    case, mutant = task
    if _STATE.get("case") != case:
        prepare(case)
    source, target = _STATE["source"], _STATE["target"]
    start, cpu = time.perf_counter(), time.process_time()
    row = {key: mutant[key] for key in ("kind", "line", "before", "after")}
    try:
        found = repair_source(source.replaced(mutant["text"]), target)
    except InputError as error:
        return {**row, "refused": str(error), "seconds": time.perf_counter() - start}
    row |= {"seconds": time.perf_counter() - start, "cpu": time.process_time() - cpu}
    row["equivalent"] = same(source, source.replaced(mutant["text"]), target)
    row["residual"] = found.residual
    row["detected"] = not found.right
    row["certain"] = found.certain
    row["fixes"] = [str(fix) for fix in found.fixes[:3]]
    right = [same(source, source.replaced(fix.text), target) for fix in found.fixes]
    row["repaired"] = bool(right and right[0])
    row["among"] = any(right)
    row["false"] = bool(right) and found.certain and not right[0]
    return row


def same(source: Any, other: Any, target: Any) -> bool:
    """Whether two files are the same formula: at random states, with the named constants moved."""
    import numpy as np

    from deltac.errors import InputError
    from deltac.repair.tracing.tape import TapeChange
    from deltac.repair.tracing.tracer import branches

    at = target.samples((), True)
    rng = np.random.default_rng(1)
    results = []
    factors: dict[str, Any] = {}
    for text in (source, other):
        try:
            ((_, found),) = branches(text, at.t, at.q, at.u)
        except InputError:
            return False
        moved = {}
        for name, slot in sorted(found.parameters.items()):
            factor = factors.setdefault(name, rng.uniform(0.7, 1.5, len(at.t)))
            moved[slot] = TapeChange.to(found.tape.values[slot] * factor)
        results.append(found.tape.run(found.outputs, moved))
    return bool(np.abs(results[0] - results[1]).max() < 1e-7 * np.abs(results[0]).max())


def campaign(
    case: str, tasks: list[dict[str, Any]], processes: int, keep: Callable[[dict[str, Any]], None]
) -> None:
    """All mutants of one case, each handed to `keep` when it is done."""
    jobs = [(case, task) for task in tasks]
    if processes == 1:
        prepare(case)
        outcomes = map(attempt, jobs)
        for done, row in enumerate(outcomes, 1):
            keep(row)
            report(case, done, len(jobs))
        return
    with ProcessPoolExecutor(processes, initializer=prepare, initargs=(case,)) as pool:
        for done, row in enumerate(pool.map(attempt, jobs, chunksize=2), 1):
            keep(row)
            report(case, done, len(jobs))


def report(case: str, done: int, total: int) -> None:
    """Progress on standard error."""
    print(f"\r{case}: {done} of {total}", end="" if done < total else "\n", file=sys.stderr)


def drawn(case: str, limit: int, seed: int) -> list[dict[str, Any]]:
    """Mutants of a case, at most `limit`, each kind with its share."""
    from deltac.repair.mutate.operators import mutants

    text = (HERE / "equations" / f"{case}.py").read_text("utf-8")
    found = [vars(m) for m in mutants(text, "rhs", seed=seed)]
    if limit and len(found) > limit:
        draw = random.Random(seed)
        by_kind: dict[str, list[Any]] = {}
        for m in found:
            by_kind.setdefault(m["kind"], []).append(m)
        found = [
            m
            for kind in by_kind.values()
            for m in draw.sample(kind, max(1, round(limit * len(kind) / len(found))))
        ]
    return found


def by_hand(case: str) -> list[dict[str, Any]]:
    """Mistakes of the kinds that people make."""
    from mistakes import MISTAKES

    text = (HERE / "equations" / f"{case}.py").read_text("utf-8")
    tasks = []
    for words, edits in MISTAKES.get(case, ()):
        changed = text
        for old, new in edits:
            assert changed.count(old) >= 1, f"{case}: {old!r} is not there"
            changed = changed.replace(old, new, 1)
        kind = "by hand, one place" if len(edits) == 1 else "by hand, two places"
        tasks.append({"kind": kind, "line": 0, "before": words, "after": "", "text": changed})
    return tasks


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Counts over rows."""
    accepted = [r for r in rows if "refused" not in r]
    wrong = [r for r in accepted if not r["equivalent"]]
    return {
        "mutants": len(rows),
        "refused": len(rows) - len(accepted),
        "equivalent": len(accepted) - len(wrong),
        "wrong": len(wrong),
        "detected": sum(r["detected"] for r in wrong),
        "repaired": sum(r["repaired"] for r in wrong),
        "among the edits": sum(r["among"] for r in wrong),
        "false, as certain": sum(r["false"] for r in wrong),
        "median s": statistics.median(r["seconds"] for r in wrong) if wrong else 0.0,
    }


def main() -> None:
    """Run the campaign and print its tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", default=list(CASES), choices=list(CASES))
    parser.add_argument(
        "--limit", type=int, default=500, help="mutants of a problem at most; 0: all"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    results: dict[str, Any] = {}
    for case in options.only:
        tasks = drawn(case, options.limit, options.seed)
        rows: list[dict[str, Any]] = []
        results[case] = rows

        def keep(row: dict[str, Any], rows: list[dict[str, Any]] = rows) -> None:
            rows.append(row)
            if options.json and len(rows) % 10 == 0:
                options.json.write_text(json.dumps(results, indent=1))

        campaign(case, [*by_hand(case), *tasks], options.processes, keep)
        show(case, rows)
        if options.json:
            options.json.write_text(json.dumps(results, indent=1))


def show(case: str, rows: list[dict[str, Any]]) -> None:
    """A table of kinds."""
    print(f"\n{case}")
    columns = list(summary(rows))
    print("| kind | " + " | ".join(columns) + " |")
    print("|---|" + "---|" * len(columns))
    for kind in [*Counter(r["kind"] for r in rows), None]:
        some = [r for r in rows if kind is None or r["kind"] == kind]
        cells = [f"{v:.2g}" if isinstance(v, float) else str(v) for v in summary(some).values()]
        print(f"| {kind or 'all'} | " + " | ".join(cells) + " |")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
