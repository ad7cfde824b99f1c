"""How well is a mistake told of where the code cannot be read? The check alone, on the programs of `wild`.

    make bench-blackbox [ARGS="--only slip_class --each 3 --json out.json"]

A program with a mistake is loaded and called; nothing of its text is used by the check. Which equations are
wrong, and whether what is said of them is true, is known from the text all the same:

right equation   told are the rows of A u̇ = b that the mistake changes, where the program ends with solving
                 these equations of the model; else the accelerations that it changes
right term       what is told of every equation holds at other states, and at other values of all parameters
                 that the program names: the same terms give the error there, with the same plain factors
misleading       something is told of an equation that does not hold there
whole            a cause that concerns the function as a whole is told instead (a parameter, coordinates)
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from equations.wild import CASES, Case
from wild import tasks

HERE = Path(__file__).resolve().parent


def run(case: Case, options: argparse.Namespace) -> list[dict[str, Any]]:
    """All single mistakes of one program."""
    import deltac as dc
    from deltac.diagnosis.inputs.equations import load_equations
    from deltac.errors import InputError
    from deltac.repair.tracing.program import formed, read
    from deltac.repair.tracing.samples import Target
    from deltac.repair.tracing.source import read_source

    mechanism, coordinates = case.load()
    target = Target(mechanism, coordinates)
    source = formed(read_source(case.target), target)
    reading = read(source, target)
    rows = []
    for task in tasks(case, source, reading, options.each, 0, options.seed):
        changed = source.replaced(task["text"])
        row = {"case": case.name, "style": case.style, "kind": task["kind"], "words": task["words"]}
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / f"{case.name}.py"
            file.write_text(task["text"])
            for other in HERE.glob("equations/wild/*.py"):
                if other.name != file.name:
                    (Path(folder) / other.name).symlink_to(other)
            start = time.process_time()
            try:
                function = load_equations(f"{file}:{case.function}")
                check = dc.check_equations(mechanism, function, coordinates=coordinates)
            except InputError as error:
                rows.append(row | {"raises": str(error)[:200]})
                continue
            row["cpu"] = time.process_time() - start
        if check.verdict.kind == "consistent":
            rows.append(row | {"detected": False, "same": True})
            continue
        row["detected"] = True
        row["equations"] = equations(source, changed, target, check)
        row["whole"] = [str(f) for f in check.verdict.findings if f.weight == "cause"]
        row["told"] = [str(b) for b in check.blame]
        row["terms"] = [holds(changed, target, b) for b in check.blame]
        if not check.blame:  # q̇ alone is wrong, which is said by coordinate
            row["equations"], row["terms"] = True, [True]
        rows.append(row)
        show(row)
    return rows


def equations(source: Any, changed: Any, target: Any, check: Any) -> bool | None:
    """Whether the equations told of are those that the mistake changes; None where that is unknown."""
    from deltac.errors import InputError
    from deltac.repair.tracing.program import reading

    samples = target.samples()
    try:
        before, after = (reading(s, samples) for s in (source, changed))
    except InputError:
        return None
    solved = any(b.solved for b in check.blame)
    told = {b.number - 1 for b in check.blame}
    n = len(samples.speeds)
    if not solved and all(p.solves for r in (before, after) for p in r.pieces):
        if len(before.pieces) > 1 or len(before.pieces[0]._system or ()) != n * n + n:
            return None
        A, b = (r.pieces[0] for r in (before, after))
        x, y = (p.tape.run(p._system) for p in (A, b))
        off = np.abs(x - y).max(axis=1) > 1e-9 * np.abs(x).max()
        right = {k for k in range(n) if off[k * n : (k + 1) * n].any() or off[n * n + k]}
        # Only where the program's rows are the model's own, up to a factor for each.
        if _own_rows(x, n, samples):
            return told == right
    off = (
        np.abs(before.run()[:n] - after.run()[:n]).max(axis=1)
        > 1e-9 * np.abs(before.run()[:n]).max()
    )
    wrong = {int(k) for k in np.flatnonzero(off)}
    rows = {int(k) for k in np.flatnonzero(samples.wrong_rows(after.run()[:n]))}
    return told in (wrong, rows)


def _own_rows(entries: Any, n: int, samples: Any) -> bool:
    """Whether the rows of A are those of the model's mass matrix, each with a constant factor."""
    A = entries[: n * n].reshape(n, n, -1)
    M = samples.M.transpose(1, 2, 0)
    for a, m in zip(A, M):
        k = np.argmax(np.abs(m).max(axis=1))
        ratio = a[k] / m[k]
        if (
            np.ptp(ratio) > 1e-7 * np.abs(ratio).max()
            or np.abs(a - ratio * m).max() > 1e-7 * np.abs(a).max()
        ):
            return False
    return True


def holds(changed: Any, target: Any, blame: Any) -> bool | None:
    """Whether what is told of an equation is so elsewhere; None where nothing is told."""
    from deltac.diagnosis.check.matching import acceleration_parts, own_parts, plain_parts
    from deltac.errors import InputError
    from deltac.repair.tracing.program import read

    told = blame.solved or blame.terms
    if not told:
        return None
    try:
        elsewhere = read(changed, target, fresh=True)
    except InputError:
        return None
    udot = elsewhere.run()
    samples = target.samples(elsewhere.varied, True)
    k = blame.number - 1
    for group in range(int(samples.group[-1]) + 1):
        some = samples.group == group
        test = target.test(group, True, elsewhere.varied)
        given = udot[: len(test.speeds), some]
        if blame.solved:
            parts = acceleration_parts(test, k)
            residual = test.acceleration[k] - given[k]
        else:
            every = range(len(test.states.coordinates))
            parts = [*own_parts(test, given, k), *plain_parts(test.states, given, every)]
            residual = test.residual(given)[k]
        left = residual.copy()
        columns = []
        for match in told:
            named = [p for p in parts if p.name == match.part]
            exact = [p for p in named if p.symbols and _shape(p.symbols) == _shape(match.symbols)]
            part = next(iter([*exact, *(p for p in named if not p.symbols)]), None)
            if part is None:
                return False
            if match.ratio:
                return _ratio_holds(test, part, residual, match)
            plain = (
                match.factor is not None
                and min(abs(match.factor - f) for f in (-1, 0, 0.5, 2)) < 1e-5
            )
            if plain:
                left = left - match.coefficient * part.values
            else:
                columns.append(part.values)
        if columns:
            B = np.array(columns).T
            left = left - B @ np.linalg.lstsq(B, left, rcond=None)[0]
        if np.linalg.norm(left) > 1e-6 * np.linalg.norm(residual):
            return False
    return True


def _shape(term: str) -> str:
    """A term whatever its numbers: radii that the model has as numbers have other values there."""
    return re.sub(r"\b\d+(\.\d+)?\b", "#", term)


def _ratio_holds(test: Any, part: Any, residual: Any, match: Any) -> bool:
    from deltac.diagnosis.check.matching import ratios

    texts, F = ratios(test)
    if match.ratio not in texts:
        return False
    Z = F[texts.index(match.ratio)] * part.values
    stands = part.values - residual
    c = Z @ stands / (Z @ Z)
    return bool(np.linalg.norm(stands - c * Z) <= 1e-6 * np.linalg.norm(residual))


def show(row: dict[str, Any]) -> None:
    """One line on standard error."""
    terms = row["terms"]
    state = "MISLEADS" if False in terms else "silent" if None in terms else "ok"
    state = "whole" if row["whole"] else state
    where = {True: "", False: "WRONG ROW", None: "?"}[row["equations"]]
    said = f"{row['case']} | {row['kind']} | {row['words']} | {' // '.join(row['told'])} {row['whole'] or ''}"
    print(f"{state:9s}{where:10s}{row['cpu']:5.1f} {said}"[:700], file=sys.stderr, flush=True)


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Counts over rows."""
    ran = [r for r in rows if "raises" not in r and not r.get("same")]
    known = [r for r in ran if r["equations"] is not None]
    right = [r for r in ran if r["whole"] or all(t is True for t in r["terms"])]
    return {
        "mistakes": len(ran),
        "right equations": f"{sum(r['equations'] for r in known)} of {len(known)}",
        "all terms right": f"{len(right)} ({len(right) / max(len(ran), 1):.0%})",
        "of these, as a whole": sum(bool(r["whole"]) for r in ran),
        "silent": sum(
            None in r["terms"] and False not in r["terms"] and not r["whole"] for r in ran
        ),
        "misleading": sum(False in r["terms"] and not r["whole"] for r in ran),
        "median s": round(float(np.median([r["cpu"] for r in ran])), 2) if ran else 0.0,
    }


def main() -> None:
    """Run and print tables."""
    names = [case.name for case in CASES]
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", default=names, choices=names)
    parser.add_argument("--each", type=int, default=3, help="enumerated mistakes of a program")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for case in CASES:
        if case.name in options.only:
            rows += run(case, options)
            if options.json:
                options.json.write_text(json.dumps(rows, indent=1, default=bool))
    groups: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for r in rows:
        groups[r["kind"]].append(r)
    groups["all"] = rows
    columns = list(summary([]))
    print("| kind | " + " | ".join(columns) + " |\n" + "|---" * (len(columns) + 1) + "|")
    for name, some in groups.items():
        print(f"| {name} | " + " | ".join(str(v) for v in summary(some).values()) + " |")


if __name__ == "__main__":
    main()
