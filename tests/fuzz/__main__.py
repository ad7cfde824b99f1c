"""`python -m tests.fuzz SECONDS [TARGET …]`: mutate the corpora, keep what breaks a parser, count.

``--log FILE`` adds a line of JSON for each turn of a target, so that a campaign may be stopped, killed and
continued; ``--total FILE`` adds the lines up. ``--coverage`` measures which branches of our parsers are
taken. An input that killed the process is the file `last` in the folder that the campaign works in.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import re
import signal
import sys
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

from tests.fuzz.mutations import mutated

SLOW = 5.0  # s for one input of some kilobytes
TURN = 20.0  # s that a target has before it is the next one's turn
MOST = 300
"""Inputs that are mutated further, beside the corpus."""

FINDINGS = Path(__file__).parent / "findings"
MEASURED = ("trajectories/formats", "importers", "mechanism/laws", "mechanism/grammar", "limits")
"""Where the parsers are, in src/deltac; the report names those that a target reached."""

_SPECIAL = re.compile(r"'[^']*'|\"[^\"]*\"|[\d.]+|\s+")
_stop: list[bool] = []
_pools: dict[str, tuple[list[bytes], int, set[str]]] = {}
"""Of each target: inputs to mutate, how many of them are the corpus, and what refusals have been heard."""


def fuzz(name: str, seconds: float, seed: int, most: int = 10**9) -> Counter[str]:
    """Inputs by what became of them; those that broke the target are written to `findings`."""
    from tests.fuzz.targets import FOLDER, corpus, run

    rng = random.Random(f"{name} {seed}")
    if name not in _pools:
        start_from = corpus(name)
        _pools[name] = (start_from, len(start_from), set())
    pool, fixed, heard = _pools[name]
    counts: Counter[str] = Counter()
    end = time.monotonic() + seconds
    with open(FOLDER / "last", "wb", buffering=0) as last, warnings.catch_warnings():
        warnings.simplefilter("error")  # which would leak to the user
        while time.monotonic() < end and counts.total() < most and not _stop:
            data = mutated(rng, pool[:fixed] if rng.random() < 0.5 else pool)
            os.ftruncate(last.fileno(), os.pwrite(last.fileno(), data, 0))
            start = time.process_time()  # other work on the machine does not count
            try:
                said = run(name, data)
                if (taken := time.process_time() - start) > SLOW:
                    raise TimeoutError(f"{taken:.1f} s")
            except Exception as error:
                counts["broken"] += 1
                _keep(name, data, error)
                continue
            outcome = "InputError" if said else "read"
            counts[outcome] += 1
            # What is read, and differs, or is refused in new words, went where none had been.
            new = (reason := _SPECIAL.sub("", said)[:80]) not in heard
            heard.add(reason)
            if len(data) < 20_000 and (new or (not said and rng.random() < 0.05)):
                if len(pool) >= fixed + MOST:
                    del pool[rng.randrange(fixed, len(pool))]
                pool.append(data)
    return counts


def _keep(name: str, data: bytes, error: Exception) -> None:
    """Write a finding, once for each place where it breaks."""
    where = traceback.extract_tb(error.__traceback__)[-1]
    place = f"{type(error).__name__} {where.filename} {where.lineno}"
    file = FINDINGS / f"{name}-{hashlib.sha1(place.encode()).hexdigest()[:12]}"
    if file.exists():
        return
    FINDINGS.mkdir(exist_ok=True)
    file.write_bytes(data)
    text = "".join(traceback.format_exception(error))[-1500:]
    print(f"{file}\n{text}", file=sys.stderr, flush=True)


def campaign(
    targets: list[str], seconds: float, seed: int, log: Path | None
) -> dict[str, dict[str, int]]:
    """Fuzz the targets in turns, so that a run that is stopped has seen all of them."""
    table: dict[str, Counter[str]] = {name: Counter() for name in targets}
    turns = max(1, round(seconds / TURN / len(table)))
    for turn in range(turns):
        for name, counts in table.items():
            start = os.times()
            found = fuzz(name, seconds / turns / len(table), seed + turn)
            counts += found
            if log is not None:
                used = sum(os.times()[:4]) - sum(start[:4])
                line = {"target": name, "seed": seed + turn, "cpu": round(used, 2), **found}
                with open(log, "a", encoding="utf-8") as file:
                    file.write(json.dumps(line) + "\n")
    return {name: dict(counts) for name, counts in table.items()}


def totals(log: Path) -> dict[str, dict[str, float]]:
    """The lines of a log, added up by target, and all of them."""
    table: dict[str, Counter[str]] = {}
    for line in log.read_text("utf-8").splitlines():
        entry = json.loads(line)
        name = entry.pop("target")
        del entry["seed"]
        for key in (name, "all"):
            table.setdefault(key, Counter()).update(entry)
    for counts in table.values():
        counts["inputs"] = sum(counts[k] for k in ("read", "InputError", "broken"))
    return {name: dict(counts) for name, counts in table.items()}


def covered(targets: list[str], seconds: float, seed: int) -> dict[str, Any]:
    """Branches of each parser that the targets took together, as a share of all; decoders in this process."""
    import coverage

    import deltac

    os.environ["DELTAC_ISOLATION"] = "off"
    root = Path(deltac.__file__).parent
    measure = coverage.Coverage(branch=True, data_file=None, include=[f"{root}/*"])
    with measure.collect():
        counts = campaign(targets, seconds, seed, None)
    found = {}
    for file in sorted(measure.get_data().measured_files()):
        name = str(Path(file).relative_to(root))
        if name.startswith(MEASURED):
            numbers = measure._analyze(file).numbers
            if numbers.n_executed_branches:
                found[name] = [numbers.n_executed_branches, numbers.n_branches]
    taken, all_of_them = (sum(v[k] for v in found.values()) for k in (0, 1))
    return {"inputs": counts, "branches": found, "share": round(taken / max(all_of_them, 1), 3)}


def main() -> None:
    """Run, print a table as JSON, and exit with 1 if something broke."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seconds", type=float, nargs="?", default=60.0)
    parser.add_argument("targets", nargs="*")
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--log", type=Path)
    parser.add_argument("--total", type=Path)
    parser.add_argument("--coverage", action="store_true")
    options = parser.parse_args()
    if options.total is not None:
        print(json.dumps(totals(options.total), indent=1))
        return
    from tests.fuzz.targets import TARGETS

    targets = options.targets or list(TARGETS)
    signal.signal(signal.SIGINT, lambda *_: _stop.append(True))  # the table is printed all the same
    if options.coverage:
        print(json.dumps(covered(targets, options.seconds, options.seed), indent=1))
        return
    start = time.process_time()
    table = campaign(targets, options.seconds, options.seed, options.log)
    seconds = round(time.process_time() - start)
    total = sum(sum(counts.values()) for counts in table.values())
    print(
        json.dumps({"seed": options.seed, "cpu_seconds": seconds, "total": total, "inputs": table})
    )
    sys.exit(any("broken" in counts for counts in table.values()))


if __name__ == "__main__":
    main()
