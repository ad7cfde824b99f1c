"""What a fleet costs beside the bare calls: processor time, memory, storage. `make bench-fleets`.

Processor times of this process and its children, so that a busy machine does not matter; both sides do
the same work in one run, one after the other.
"""

from __future__ import annotations

import argparse
import resource
import shutil
import tempfile
import time
from pathlib import Path

import numpy as np

import deltac as dc


def processor() -> float:
    """Seconds of this process and of its children that have ended."""
    own, theirs = (resource.getrusage(w) for w in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return own.ru_utime + own.ru_stime + theirs.ru_utime + theirs.ru_stime


def sweep_beside_ensemble(runs: int, steps: int, workers: int) -> None:
    problem = dc.problems.load("double-pendulum")
    duration, step = 1e-2 * steps, 1e-2
    count = round(runs**0.5)
    m, q = np.linspace(0.5, 2.0, count), np.linspace(0.1, 1.0, count)
    M, Q1 = (x.ravel() for x in np.meshgrid(m, q, indexing="ij"))
    Q = np.tile(problem.state.q, (len(M), 1))
    U = np.tile(problem.state.u, (len(M), 1))
    Q[:, 0] = Q1
    records = max(k for k in range(1, 9) if steps % k == 0)

    def bare(members: int) -> dc.Ensemble:
        return dc.simulate_ensemble(
            problem,
            (Q[:members], U[:members]),
            duration,
            step,
            "ode5",
            vary={"m1": M[:members]},
            record_every=steps // records,
            threads=workers,
        )

    bare(8)  # compiled
    before, wall = processor(), time.perf_counter()
    bare(len(M))
    ensemble, ensemble_wall = processor() - before, time.perf_counter() - wall
    folder = Path(tempfile.mkdtemp())
    try:
        before, wall = processor(), time.perf_counter()
        fleet = dc.sweep(
            "double-pendulum",
            folder / "out",
            vary={"parameter.m1": m, "q.joint1": q},
            solver="ode5",
            step=step,
            duration=duration,
            workers=workers,
        )
        swept, swept_wall = processor() - before, time.perf_counter() - wall
        sizes = [p.stat().st_size for p in (folder / "out" / "pieces").iterdir()]
        before = processor()
        dc.sweep(
            "double-pendulum",
            folder / "out",
            vary={"parameter.m1": m, "q.joint1": q},
            solver="ode5",
            step=step,
            duration=duration,
        )
        again = processor() - before
    finally:
        shutil.rmtree(folder)
    peak = [
        resource.getrusage(w).ru_maxrss / 1024
        for w in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    ]
    print(
        f"{len(M)} runs of {steps} steps (double pendulum, ode5), {workers} workers: {fleet.summary()}"
    )
    print(f"bare ensemble      {ensemble:8.2f} s processor time {ensemble_wall:8.2f} s wall time")
    print(f"sweep              {swept:8.2f} s processor time {swept_wall:8.2f} s wall time")
    print(
        f"ratio              {swept / ensemble:8.2f}                {swept_wall / ensemble_wall:8.2f}"
    )
    print(f"sweep, all there   {again:8.2f} s processor time")
    print(f"storage            {sum(sizes) / len(M):8.0f} bytes a run, {len(sizes)} pieces")
    print(f"memory, largest    {peak[0]:8.0f} MB main process, {peak[1]:.0f} MB worker")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=100_000)
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    sweep_beside_ensemble(given.runs, given.steps, given.workers)
