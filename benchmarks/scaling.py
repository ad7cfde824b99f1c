"""How time grows with the size of the work: degrees of freedom, members of an ensemble, samples of a log.

`python benchmarks/scaling.py` writes `results/scaling.json` and `docs/images/scaling.svg`: processor time
over size, both logarithmic, with the slope of the last sizes. ``--only members`` measures one of the three
anew, ``--quick`` ends a decade earlier with samples. Processor time, since what else runs on the machine
changes it less than a clock's.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from kernel_sizes import accelerations, chain

import deltac as dc
from deltac.energy.accumulator import OVERLAP, balance_chunks
from deltac.trajectories import Chunk

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]  # a module elsewhere

ROOT = Path(__file__).resolve().parents[1]
DOF = (3, 10, 30, 100, 300)
MEMBERS = (1, 10, 100, 1000, 10_000, 100_000, 1_000_000)
SAMPLES = (1000, 10_000, 100_000, 1_000_000, 10_000_000, 100_000_000)
BATCH, STEPS, CHUNK = 1032, 100, 100_000


def processor_seconds(work: Callable[[], Any]) -> float:
    """Of all threads of this process, for one call."""
    start = time.process_time()
    work()
    return time.process_time() - start


def by_dof(sizes: Sequence[int]) -> dict[str, list[float]]:
    """Accelerations of random chains: instructions, compiling, and one state of a batch."""
    found: dict[str, list[float]] = {"size": [], "instructions": [], "compile": [], "state": []}
    for dof in sizes:
        kernel = accelerations(chain(dof))
        found["size"].append(dof)
        found["instructions"].append(kernel.instructions)
        found["compile"].append(processor_seconds(kernel.compile))
        x = np.random.default_rng(1).standard_normal((kernel.n_in, BATCH))
        out = np.empty((kernel.n_out, BATCH))
        repeats = max(3, 3000 // dof)
        kernel.flat(x, out=out)
        taken = processor_seconds(partial(_repeat, partial(kernel.flat, x, out=out), repeats))
        found["state"].append(taken / repeats / BATCH)
    return found


def _repeat(work: Callable[[], Any], times: int) -> None:
    for _ in range(times):
        work()


def by_members(sizes: Sequence[int]) -> dict[str, list[float]]:
    """Ensembles of the triple pendulum, ode4, 100 steps, two testing functions, the ends recorded."""
    problem = dc.problems.load("triple-pendulum")
    rng = np.random.default_rng(2)
    found: dict[str, list[float]] = {"size": [], "run": []}
    for count in sizes:
        Q = rng.uniform(-1.0, 1.0, (count, 3))
        start = (Q, np.zeros_like(Q))

        def run(start: Any = start) -> Any:
            return dc.simulate_ensemble(
                problem.mechanism, start, STEPS * 1e-3, 1e-3, "ode4", record=STEPS
            )

        if count == sizes[0]:
            run()  # compiles
        found["size"].append(count)
        found["run"].append(processor_seconds(run))
    return found


def by_samples(sizes: Sequence[int]) -> dict[str, list[float]]:
    """The ledger of logs of the triple pendulum, streamed in chunks of 10⁵ rows."""
    problem = dc.problems.load("triple-pendulum")
    rows = CHUNK + 2 * OVERLAP
    run = dc.simulate(problem.mechanism, problem.state, rows * 1e-5, 1e-5, "ode4")
    found: dict[str, list[float]] = {"size": [], "ledger": []}
    for count in (sizes[0], *sizes):  # the first compiles
        parts = _chunks(run, count)
        taken = processor_seconds(partial(balance_chunks, problem.mechanism, parts, "samples"))
        found["size"].append(count)
        found["ledger"].append(taken)
    return {key: values[1:] for key, values in found.items()}


def _chunks(run: dc.Trajectory, count: int) -> Iterator[Chunk]:
    """A motion over and over, as the chunks of a log that nobody has room for."""
    for first in range(0, count, CHUNK):
        core = min(CHUNK, count - first)
        here = slice(0, core + 2 * OVERLAP)
        part = replace(
            run,
            t=run.t[here] + first * 1e-5,
            q=run.q[here],
            u=run.u[here],
            udot=None if run.udot is None else run.udot[here],
            forces={name: force[here] for name, force in run.forces.items()},
            works={},
            integrals={},
        )
        yield Chunk(part, first - OVERLAP, slice(OVERLAP, OVERLAP + core), count)


def slope(sizes: Sequence[float], values: Sequence[float]) -> float:
    """Of log values over log sizes, between the last size and the one two decades or so before."""
    first = max(0, len(sizes) - 3)
    return math.log(values[-1] / values[first]) / math.log(sizes[-1] / sizes[first])


def draw(found: dict[str, dict[str, list[float]]], file: Path) -> None:
    """Three log–log plots side by side."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 3.4), layout="constrained")
    titles = {
        "dof": ("degrees of freedom", ("compile", "state")),
        "members": ("members, 100 steps", ("run",)),
        "samples": ("samples, streamed", ("ledger",)),
    }
    for axes, (kind, (label, curves)) in zip(figure.subplots(1, 3), titles.items(), strict=True):
        sizes = found[kind]["size"]
        for name in curves:
            grows = slope(sizes, found[kind][name])
            axes.loglog(sizes, found[kind][name], "o-", label=f"{name}, slope {grows:.2f}")
        axes.set_xlabel(label)
        axes.legend(frameon=False)
        axes.grid(alpha=0.3)
    figure.supylabel("processor time in s")
    figure.savefig(file, metadata={"Date": None})


def main() -> None:
    """Measure, tell, write and draw."""
    measures = {"dof": by_dof, "members": by_members, "samples": by_samples}
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="samples up to 10 million only")
    parser.add_argument("--only", nargs="*", choices=measures, default=list(measures))
    options = parser.parse_args()
    sizes = {"dof": DOF, "members": MEMBERS, "samples": SAMPLES[: -1 if options.quick else None]}
    file = ROOT / "results" / "scaling.json"
    file.parent.mkdir(exist_ok=True)
    found = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    for kind in options.only:
        found[kind] = measures[kind](sizes[kind])
        for name, values in found[kind].items():
            print(f"{kind}, {name}: " + ", ".join(f"{value:.3g}" for value in values), flush=True)
        if resource is not None:  # the largest so far of this process
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
            print(f"{kind}: {peak:.2f} GB of memory", flush=True)
        file.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    if found.keys() == measures.keys():
        draw(found, ROOT / "docs" / "images" / "scaling.svg")


if __name__ == "__main__":
    main()
