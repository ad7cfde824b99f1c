"""The mutation campaign on programs as people write them: what is read, detected, repaired, and how fast.

    make bench-repair-wild [ARGS="--only slip_class --each 5 --json out.json"]
    make bench-repair-wild ARGS="--programs blind"

The programs are those of `equations/wild`, `blind` or `cold`. Single mistakes are enumerated
(`deltac.repair.mutate`, a draw of each program's) or by hand (`mistakes.py`); double ones are two of these,
drawn by a seed. A mistake is repaired if the first edit offered gives the right equations: those of the
original program at random states, with all its named constants moved.

Programs of `blind` are loaded and repaired as the command does; what cannot be loaded here (Numba) is read.
Of those that cannot be read only the mistakes by hand are taken, and an edit counts as right if it is where
it is run.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import random
import statistics
import sys
import tempfile
import time
from collections import defaultdict
from importlib import import_module
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

from equations.wild import Case  # noqa: E402, its folder is on the path by now


def programs(name: str) -> tuple[tuple[Case, ...], tuple[str, ...]]:
    """The programs of a folder, and the names of those that edits were not tuned on."""
    suite = import_module(f"equations.{name}")
    return suite.CASES, getattr(suite, "UNSEEN", ())


def tasks(
    case: Case, source: Any, reading: Any, each: int, doubles: int, seed: int
) -> list[dict[str, Any]]:
    """The mistakes of a program: by hand, enumerated where it was read, and double."""
    from deltac.repair.mutate.operators import mutants
    from deltac.repair.mutate.report import spans

    text = source.text
    made: list[dict[str, Any]] = []
    for words, old, new in import_module(f"{case.suite}.mistakes").MISTAKES.get(case.name, ()):
        assert old in text, f"{case.name}: {old!r} is not there"
        made.append(
            {
                "kind": "by hand",
                "words": words,
                "edit": (old, new),
                "text": text.replace(old, new, 1),
            }
        )
    draw = random.Random(f"{case.name} {seed}")
    found = [] if reading is None else mutants(text, "", names=1, seed=seed, read=spans(reading))
    by_kind = defaultdict(list)
    for m in found:
        by_kind[m.kind].append(m)
    kinds = sorted(by_kind)
    chosen: list[Any] = []
    while len(chosen) < each and kinds:
        kind = kinds[len(chosen) % len(kinds)] if len(chosen) < len(kinds) else draw.choice(kinds)
        m = draw.choice(by_kind[kind])
        if m not in chosen:
            chosen.append(m)
        elif len(chosen) >= len(found):
            break
    draw.shuffle(chosen)
    for m in chosen:
        made.append({"kind": m.kind, "words": f"{m.line}: {m.before} → {m.after}", "text": m.text})
    hand = [m for m in made if m["kind"] == "by hand"]
    pairs = [(a, b) for a in hand for b in hand if a is not b]
    draw.shuffle(pairs)
    taken = 0
    for a, b in pairs:
        (old, new), (old2, new2) = a["edit"], b["edit"]
        once = text.replace(old, new, 1)
        if taken == doubles or once.count(old2) < 1 or old in new2 or old2 in new:
            continue
        both = once.replace(old2, new2, 1)
        made.append({"kind": "two by hand", "words": f"{a['words']}; {b['words']}", "text": both})
        taken += 1
    return made


def run(case: Case, options: argparse.Namespace) -> list[dict[str, Any]]:
    """All mistakes of one program."""
    from deltac.errors import InputError
    from deltac.repair.repair import repair_source
    from deltac.repair.tracing.program import formed, read
    from deltac.repair.tracing.samples import Target
    from deltac.repair.tracing.source import read_source

    mechanism, coordinates = case.load()
    target = Target(mechanism, coordinates)
    try:
        source = formed(read_source(case.target), target)
        reading = read(source, target)
        assert reading.wrong < 1e-8, case.name
    except InputError as error:
        print(f"{case.name} is not read: {error}"[:200], file=sys.stderr)
        source, reading = read_source(case.target), None
    rows = []
    for task in tasks(case, source, reading, options.each, options.doubles, options.seed):
        if options.kind and options.kind not in task["kind"]:
            continue
        if options.again is not None and (case.name, task["words"]) not in options.again:
            continue
        # The form is found out anew: a mistake may hide it.
        changed = read_source(case.target).replaced(task["text"])
        row = {"case": case.name, "style": case.style, "kind": task["kind"], "words": task["words"]}
        row["unseen"] = case.name in options.unseen
        start, cpu = time.perf_counter(), time.process_time()
        try:
            if options.programs == "wild":
                found = repair_source(changed, target, options.time_limit)
            else:
                found = as_the_command(case, task["text"], mechanism, coordinates, options)
        except InputError as error:
            rows.append(row | {"refused": str(error)})
            show(rows[-1])
            continue
        row |= {"seconds": time.perf_counter() - start, "cpu": time.process_time() - cpu}
        row["ran"] = reading is None or bool(found.unread)
        row["equivalent"] = not row["ran"] and same(source, source.replaced(task["text"]), target)
        row["detected"] = not found.right
        row["certain"] = found.certain
        row["fixes"] = [str(f) for f in found.fixes[:3]]
        right = [row["ran"] or same(source, source.replaced(f.text), target) for f in found.fixes]
        row["repaired"] = bool(right and right[0])
        row["among"] = any(right)
        row["false"] = bool(right) and found.certain and not right[0]
        row["suspects"] = list(found.suspects)
        rows.append(row)
        show(row)
    return rows


def as_the_command(case: Case, text: str, mechanism: Any, coordinates: Any, options: Any) -> Any:
    """The repair of a program with a mistake, loaded from a file as `deltac check --repair` does."""
    from deltac.diagnosis.inputs.equations import load_equations
    from deltac.errors import InputError
    from deltac.repair.repair import repair_equations, repair_source
    from deltac.repair.tracing.samples import Target
    from deltac.repair.tracing.source import read_source

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"{case.name}.py"
        file.write_text(text)
        target = f"{file}:{case.function}"
        try:
            with contextlib.redirect_stdout(io.StringIO()):
                function = load_equations(target)
        except InputError as error:
            if "ModuleNotFoundError" not in str(error):
                raise
            model = Target(mechanism, coordinates)
            return repair_source(read_source(target), model, options.time_limit)
        return repair_equations(
            mechanism,
            target,
            function=function,
            coordinates=coordinates,
            time_limit=options.time_limit,
        )


def show(row: dict[str, Any]) -> None:
    """One line on standard error."""
    if "refused" in row:
        state = "REFUSED"
    elif row["equivalent"]:
        state = "equal"
    else:
        state = (
            "ok"
            if row["repaired"]
            else "among"
            if row["among"]
            else "FALSE"
            if row["false"]
            else "lost"
        )
        state = state if row["detected"] else "MISSED"
    first = row.get("refused", (row.get("fixes") or ["-"])[0])
    said = f"{row['case']} | {row['kind']} | {row['words']} | {first}"
    print(f"{state:8s}{row.get('cpu', 0):6.1f} {said}"[:330], file=sys.stderr, flush=True)


def same(source: Any, other: Any, target: Any) -> bool:
    """Whether two programs are the same formula: at random states, with the named constants moved."""
    import numpy as np

    from deltac.errors import InputError
    from deltac.repair.tracing.program import moved

    at = target.samples((), True)
    rng = np.random.default_rng(1)
    factors: dict[str, Any] = {}
    results = []
    for one in (source, other):
        try:
            results.append(
                moved(one, at, lambda name: factors.setdefault(name, rng.uniform(0.8, 1.25)))
            )
        except InputError:
            return False
    a, b = results
    return a.shape == b.shape and bool(np.abs(a - b).max() < 1e-7 * np.abs(a).max())


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Counts over rows."""
    accepted = [r for r in rows if "refused" not in r]
    wrong = [r for r in accepted if not r["equivalent"]]
    n = max(len(wrong) + len(rows) - len(accepted), 1)
    return {
        "mistakes": len(wrong) + len(rows) - len(accepted),
        "refused": len(rows) - len(accepted),
        "detected": sum(r["detected"] for r in wrong),
        "repaired": sum(r["repaired"] for r in wrong),
        "share": f"{sum(r['repaired'] for r in wrong) / n:.1%}",
        "among": sum(r["among"] for r in wrong),
        "false": sum(r["false"] for r in wrong),
        "median s": round(statistics.median(r["cpu"] for r in wrong), 2) if wrong else 0.0,
    }


def table(title: str, groups: dict[str, list[dict[str, Any]]]) -> None:
    """A table in Markdown."""
    columns = list(summary([]))
    print(f"\n| {title} | " + " | ".join(columns) + " |\n" + "|---" * (len(columns) + 1) + "|")
    for name, rows in groups.items():
        print(f"| {name} | " + " | ".join(str(v) for v in summary(rows).values()) + " |")


def main() -> None:
    """Run the campaign and print its tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--programs", choices=("wild", "blind", "cold"), default="wild")
    parser.add_argument("--only", nargs="*", default=(), help="names of programs")
    parser.add_argument("--seen", action="store_true", help="without the programs kept unseen")
    parser.add_argument("--each", type=int, default=5, help="enumerated mistakes of a program")
    parser.add_argument("--doubles", type=int, default=2, help="double mistakes of a program")
    parser.add_argument("--kind", default="", help="only kinds with this in their name")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--time-limit", type=float, default=60.0)
    parser.add_argument("--json", type=Path)
    parser.add_argument(
        "--again", type=Path, help="only what an earlier run (its JSON) did not repair"
    )
    options = parser.parse_args()
    if options.again is not None:
        before = json.loads(options.again.read_text())
        options.again = {(r["case"], r["words"]) for r in before if not r.get("repaired")}
    cases, options.unseen = programs(options.programs)
    unknown = set(options.only) - {case.name for case in cases}
    if unknown:
        parser.error(f"no such programs: {', '.join(sorted(unknown))}")
    rows: list[dict[str, Any]] = []
    for case in cases:
        wanted = not options.only or case.name in options.only
        if wanted and not (options.seen and case.name in options.unseen):
            rows += run(case, options)
            if options.json:
                options.json.write_text(json.dumps(rows, indent=1))
    single = [r for r in rows if r["kind"] != "two by hand"]
    double = [r for r in rows if r["kind"] == "two by hand"]

    def by(key: str, some: list[dict[str, Any]]) -> dict[str, list[dict[str, Any]]]:
        return {k: [r for r in some if r[key] == k] for k in dict.fromkeys(r[key] for r in some)}

    table("singles, style", {**by("style", single), "all": single})
    table("kind", by("kind", rows))
    table("part", {
        "singles, seen": [r for r in single if not r["unseen"]],
        "singles, unseen": [r for r in single if r["unseen"]],
        "doubles, seen": [r for r in double if not r["unseen"]],
        "doubles, unseen": [r for r in double if r["unseen"]],
    })  # fmt: skip


if __name__ == "__main__":
    main()
