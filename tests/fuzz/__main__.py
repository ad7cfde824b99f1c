"""`python -m tests.fuzz SECONDS [TARGET …]`: mutate the corpora, keep what breaks a parser, count."""

from __future__ import annotations

import argparse
import hashlib
import json
import random
import signal
import sys
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path

from tests.fuzz.mutations import mutated
from tests.fuzz.targets import TARGETS, corpus, run

SLOW = 5.0  # s for one input of some kilobytes
FINDINGS = Path(__file__).parent / "findings"


def fuzz(name: str, seconds: float, seed: int, most: int = 10**9) -> Counter[str]:
    """Inputs by what became of them; those that broke the target are written to `findings`."""
    rng = random.Random(f"{name} {seed}")
    pool = corpus(name)
    counts: Counter[str] = Counter()
    end = time.monotonic() + seconds
    while time.monotonic() < end and counts.total() < most and not _stop:
        data = mutated(rng, pool)
        start = time.process_time()  # other work on the machine does not count
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")  # which would leak to the user
                outcome = run(name, data)
            if (taken := time.process_time() - start) > SLOW:
                raise TimeoutError(f"{taken:.1f} s")
        except Exception:
            outcome = "broken"
            FINDINGS.mkdir(exist_ok=True)
            file = FINDINGS / f"{name}-{hashlib.sha1(data).hexdigest()[:12]}"
            file.write_bytes(data)
            print(f"{file}\n{traceback.format_exc()[-1500:]}", file=sys.stderr)
        counts[outcome] += 1
        # What is read, and differs, is as good a start as the corpus.
        if outcome == "read" and len(data) < 20_000 and rng.random() < 0.05:
            pool[len(corpus_of(name)) :] = pool[-40:][len(corpus_of(name)) :] + [data]
    return counts


def corpus_of(name: str) -> list[bytes]:
    """The corpus, made once."""
    if name not in _made:
        _made[name] = corpus(name)
    return _made[name]


_made: dict[str, list[bytes]] = {}
_stop: list[bool] = []


def main() -> None:
    """Run, print a table as JSON, and exit with 1 if something broke."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seconds", type=float)
    parser.add_argument("targets", nargs="*", default=list(TARGETS))
    parser.add_argument("--seed", type=int, default=int(time.time()))
    options = parser.parse_args()
    signal.signal(signal.SIGINT, lambda *_: _stop.append(True))  # the table is printed all the same
    start = time.monotonic()
    table: dict[str, Counter[str]] = {name: Counter() for name in options.targets}
    turns = max(1, round(options.seconds / 60 / len(table)))
    for turn in range(turns):  # in turns, so that a run that is stopped has seen all of them
        for name, counts in table.items():
            counts += fuzz(name, options.seconds / turns / len(table), options.seed + turn)
    seconds = round(time.monotonic() - start)
    total = sum(counts.total() for counts in table.values())
    print(json.dumps({"seed": options.seed, "seconds": seconds, "total": total, "inputs": table}))
    sys.exit(any("broken" in counts for counts in table.values()))


if __name__ == "__main__":
    main()
