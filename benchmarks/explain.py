"""How often the explanation of a log's residual is right: faults planted in MuJoCo runs.

Prints a table fault × noise, the coverage of the stated uncertainties, and every wrong answer.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from explain_models import Fault, faults, model_of, noisy, simulate

import deltac as dc

NOISE = (0.0, 1e-6, 1e-4)


def outcome(fault: Fault, found: dc.Explanation) -> str:
    """ "right", "equal" (named among causes that explain the same), "unsaid" or "wrong"."""

    def names(causes: Sequence[dc.Cause]) -> bool:
        if fault.second is not None:
            wanted = {(fault.kinds[0], fault.element), (fault.second[0], fault.element)}
            return len(causes) == 2 and {(c.kind, c.element) for c in causes} == wanted
        return bool(causes) and causes[0].kind in fault.kinds and causes[0].element == fault.element

    if found.kind in ("nothing", "unexplained"):
        return "unsaid"
    if names(found.causes):
        return "right"
    return "equal" if any(names(other) for other in found.alternatives) else "wrong"


def covered(fault: Fault, found: dc.Explanation) -> bool | None:
    """Whether the planted value is within two standard errors; None for causes of several numbers."""
    truths = {kind: float(np.ravel(fault.truth)[0]) for kind in fault.kinds}
    truths |= dict([fault.second]) if fault.second else {}
    told = found.causes if fault.second else found.causes[:1]
    if any(len(c.values) != 1 or c.kind == "body-moment" for c in told):
        return None
    return all(
        abs(c.values[0] - truths[c.kind]) <= 2.0 * c.errors[0] + 1e-9 * abs(c.values[0])
        for c in told
    )


def main() -> None:
    """Run all faults, or every n-th."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--every", type=int, default=1, help="take every n-th fault")
    parser.add_argument("--only", default="", help="faults whose label has this in it")
    parser.add_argument("--without-accelerations", action="store_true")
    parser.add_argument("--verbose", action="store_true")
    given = parser.parse_args()
    planted = [f for f in faults(given.seed) if given.only in f"{f.model} {f.name} {f.element}"]
    planted = planted[:: given.every]
    counts: dict[tuple[str, float], dict[str, int]] = defaultdict(lambda: defaultdict(int))
    inside: dict[float, list[bool]] = defaultdict(list)
    seconds: list[float] = []
    told: list[str] = []
    for number, fault in enumerate(planted):
        run = simulate(fault, fault.model)
        model = model_of(fault.model)
        for level in NOISE:
            log = noisy(run, level, 1000 * given.seed + number)
            if given.without_accelerations:
                log = replace(log, udot=None)
            start = time.perf_counter()
            found = dc.explain_residual(model, log)
            seconds.append(time.perf_counter() - start)
            what = outcome(fault, found)
            counts[fault.name, level][what] += 1
            if what == "right":
                within = covered(fault, found)
                if within is not None:
                    inside[level].append(within)
            label = f"{fault.model} {fault.name} {fault.element} {np.round(fault.truth, 6)}"
            if given.verbose or what != "right":
                print(f"{number + 1}/{len(planted)}", what, label, file=sys.stderr, flush=True)
                told.append(f"{level:g} {what}: {label}: {found}")
    print("\n".join(told))
    _table(counts, [f.name for f in planted])
    for level in NOISE:
        both = inside[level]
        print(
            f"noise {level:g}: {np.mean(both):.0%} of {len(both)} values within ±2 standard errors"
        )
    print(f"{len(planted)} faults, median {np.median(seconds):.2f} s an explanation")


def _table(counts: dict[tuple[str, float], dict[str, int]], names: list[str]) -> None:
    outcomes = ("right", "equal", "unsaid", "wrong")
    totals = {(w, level): 0 for w in outcomes for level in NOISE}

    def line(name: str, counts: dict[tuple[str, float], int]) -> str:
        cells = ("".join(f"{counts[w, level]:7d}" for w in outcomes) for level in NOISE)
        return f"{name:10}" + "  ".join(cells)

    print(f"{'fault':10}" + "  ".join(f"{f'noise {level:g}':>28}" for level in NOISE))
    print(f"{'':10}" + "  ".join(["".join(f"{w:>7}" for w in outcomes)] * len(NOISE)))
    for name in dict.fromkeys(names):
        row = {(w, level): counts[name, level][w] for w in outcomes for level in NOISE}
        totals = {key: totals[key] + row[key] for key in row}
        print(line(name, row))
    print(line("all", totals))


if __name__ == "__main__":
    main()
