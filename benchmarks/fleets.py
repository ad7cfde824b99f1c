"""What a fleet costs beside the bare calls: processor time, memory, storage. `make bench-fleets`.

Processor times of this process and its children, so that a busy machine does not matter; both sides do
the same work in one run, one after the other.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import deltac as dc
from deltac.foreign.forking import end_server


def processor() -> float:
    """Seconds of this process and of its children, which are ended so that they count."""
    end_server()
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
            record=steps // records,
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


def batched_beside_single_audits(episodes: int, samples: int, dof: int, digits: str) -> None:
    """Episodes of a chain without accelerations, as semi-implicit Euler of an engine leaves them."""
    from check_chain import chain

    mechanism, rng = chain(dof), np.random.default_rng(1)
    starts = rng.uniform(-0.5, 0.5, (2, episodes, dof))
    motion = dc.simulate_ensemble(
        mechanism, tuple(starts), 2e-3 * (samples - 1), 2e-3, "semi-implicit-euler", record=1
    )
    q, u = (x.astype(digits) for x in (motion.q, motion.u))
    arrays = {"t": motion.t, "qpos": q, "qvel": u}
    names = {"coordinates": motion.coordinates, "speeds": motion.speeds}
    few = min(episodes, 20)
    runs = [dc.Trajectory(t=motion.t, q=q[:, k], u=u[:, k], **names) for k in range(few)]
    dc.audit(mechanism, runs[0])
    before = processor()
    alone = [dc.audit(mechanism, run) for run in runs]
    single = (processor() - before) / few
    folder = Path(tempfile.mkdtemp())
    try:
        np.savez(folder / "batch.npz", **arrays)
        np.savez(folder / "one.npz", t=motion.t, qpos=q[:, 0], qvel=u[:, 0])
        of_chain = f"from check_chain import chain\n\n\ndef model():\n    return chain({dof})\n"
        (folder / "model.py").write_text(of_chain)
        command = [sys.executable, "-m", "deltac", "audit", f"{folder}/model.py:model"]
        path = os.pathsep.join((str(Path(__file__).parent), *sys.path))
        processes = []
        for _ in range(2):  # the first compiles
            before = processor()
            subprocess.run(
                [*command, folder / "one.npz"],
                env={**os.environ, "PYTHONPATH": path},
                stdout=subprocess.DEVNULL,
            )
            processes.append(processor() - before)
        before = processor()
        fleet = dc.audit_many(mechanism, folder / "batch.npz", folder / "out", workers=1)
        batched = (processor() - before) / episodes
        walls = []
        for workers in (1, 2):
            before, began = processor(), time.perf_counter()
            out = folder / f"out{workers}"
            again = dc.audit_many(mechanism, folder / "batch.npz", out, workers=workers)
            walls.append(time.perf_counter() - began)
            if workers == 1:
                warm = (processor() - before) / episodes
        own = 1e3 * float(again.frame["seconds"].mean())
        kinds = fleet.frame["verdict"].to_list()
    finally:
        shutil.rmtree(folder)
    assert kinds[:few] == [audit.verdict.kind for audit in alone] and again.done == episodes
    print(f"{episodes} episodes of {samples} samples, {dof} degrees of freedom: {fleet.summary()}")
    print(f"single audits, warm     {1e3 * single:8.1f} ms of processor time each")
    print(f"a process for each log  {1e3 * processes[1]:8.1f} ms, kernels in the cache")
    print(f"batched, cold cache     {1e3 * batched:8.1f} ms each, starting and compiling included")
    print(
        f"batched                 {1e3 * warm:8.1f} ms each, starting included; audit alone {own:.1f}"
    )
    print(f"ratio to single, warm   {single / warm:8.1f}")
    print(f"ratio to processes      {processes[1] / warm:8.1f}")
    print(f"wall, 2 workers over 1  {walls[0] / walls[1]:8.2f} times the throughput")


def dask_workers(runs: int, steps: int) -> None:
    """The same sweep on a local Dask cluster of one worker, then of two: wall times, on a quiet machine."""
    from distributed import LocalCluster

    count = round(runs**0.5)
    axes = {"parameter.m1": np.linspace(0.5, 2.0, count), "q.joint1": np.linspace(0.1, 1.0, count)}
    folder, times = Path(tempfile.mkdtemp()), []
    try:
        for size in (1, 2):
            with LocalCluster(
                n_workers=size, threads_per_worker=1, dashboard_address=None
            ) as cluster:
                for name, many in (("warm", 8), ("out", steps)):
                    began = time.perf_counter()
                    dc.sweep(
                        "double-pendulum",
                        folder / f"{name}{size}",
                        vary=axes,
                        solver="ode5",
                        step=1e-2,
                        duration=1e-2 * many,
                        scheduler=cluster.scheduler_address,
                        chunk=4096,
                    )
                    last = time.perf_counter() - began
                times.append(last)
    finally:
        shutil.rmtree(folder)
    print(
        f"{count**2} runs of {steps} steps on Dask: 1 worker {times[0]:.1f} s, 2 {times[1]:.1f} s"
    )
    print(f"throughput, 2 over 1 {times[0] / times[1]:8.2f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=100_000)
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--episodes", type=int, default=0, help="batched audits instead")
    parser.add_argument(
        "--float32", action="store_true", help="logs of single precision, as of GPUs"
    )
    parser.add_argument("--dask", action="store_true", help="one and two workers of a Dask cluster")
    given = parser.parse_args()
    if given.dask:
        dask_workers(given.runs, given.steps)
    elif given.episodes:
        batched_beside_single_audits(
            given.episodes, 1000, 10, "float32" if given.float32 else "float64"
        )
    else:
        sweep_beside_ensemble(given.runs, given.steps, given.workers)
