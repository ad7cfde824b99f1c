"""Fleets that are killed, lose their cluster, or run out of disk: nothing is lost, and nothing done twice."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import deltac as dc
from deltac.fleets.store import Store

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc"),
]

PLAN = """\
model = "double-pendulum"
duration = 1.0
step = 0.01
[vary]
solver = ["ode4", "ode5"]
parameter.m1 = { from = 0.5, to = 2.0, count = 20 }
q.joint1 = { from = 0.1, to = 0.5, count = 20 }
"""


def compared(frame: pl.DataFrame) -> pl.DataFrame:
    return frame.drop("seconds")


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("plan") / "pendulums.toml"
    path.write_text(PLAN)
    return path


@pytest.fixture(scope="module")
def undisturbed(plan: Path) -> pl.DataFrame:
    return compared(dc.sweep(plan, plan.parent / "undisturbed", workers=1).frame)


def start(*arguments: object) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "deltac", "sweep", *map(str, arguments)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    pipe = subprocess.PIPE
    return subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, env=environment)


def workers_of(pid: int) -> list[int]:
    """Of all threads of a process: the server that forks them, and those that it has forked."""
    tasks = Path(f"/proc/{pid}/task")
    found = []
    for task in tasks.iterdir() if tasks.exists() else ():
        try:
            found += [int(n) for n in (task / "children").read_text().split()]
        except OSError:
            continue
    return found + [worker for child in found for worker in workers_of(child)]


@pytest.mark.parametrize("kills", [6, 50])
def test_killed_at_any_moment(
    kills: int, plan: Path, undisturbed: pl.DataFrame, tmp_path: Path
) -> None:
    """Workers, then the main process or Ctrl-C; the table is that of an undisturbed sweep, bit for bit."""
    folder, rng = tmp_path / "out", np.random.default_rng(kills)
    killed = 0
    while killed < kills:
        process = start(plan, "--out", folder, "--chunk", 5, "--workers", 1)
        time.sleep(rng.uniform(0.5, 4.0))
        for worker in workers_of(process.pid):
            os.kill(worker, signal.SIGKILL)
            killed += 1
        time.sleep(rng.uniform(0.0, 2.0))
        interrupted = rng.random() < 0.3
        if process.poll() is None:
            killed += 1
            process.send_signal(signal.SIGINT if interrupted else signal.SIGKILL)
        process.communicate(timeout=100)
        # Before `main` takes charge of it, Python ends by the signal itself.
        assert process.returncode in (0, 130, -signal.SIGINT, -signal.SIGKILL)
        if (folder / "fleet.json").exists() and (folder / "plan.parquet").exists():
            found = dc.fleet_status(folder)
            assert found.aside == 0
            if found.done == found.total:  # begin anew
                assert compared(found.frame).equals(undisturbed)
                folder = tmp_path / f"out{killed}"
    last = start(plan, "--out", folder)
    said = last.communicate(timeout=200)
    assert last.returncode == 0, said
    assert compared(pl.read_parquet(folder / "results.parquet")).equals(undisturbed)
    assert not [p for p in folder.rglob("*") if p.name.endswith(".tmp")]


def test_workers_end_with_the_process_that_started_them(plan: Path, tmp_path: Path) -> None:
    process = start(plan, "--out", tmp_path / "out", "--chunk", 1, "--workers", 2)
    until = time.monotonic() + 60.0
    while len(workers := workers_of(process.pid)) < 3 and time.monotonic() < until:
        time.sleep(0.05)
    process.kill()
    process.communicate(timeout=30)
    while any(Path(f"/proc/{pid}").exists() for pid in workers) and time.monotonic() < until:
        time.sleep(0.05)
    assert workers and not any(Path(f"/proc/{pid}").exists() for pid in workers)


def test_poison_is_set_aside(tmp_path: Path) -> None:
    """A point that kills its process, and one that hangs: found, set aside, all others done."""
    from tests.support.poison import poisoned

    found = dc.sweep(
        "double-pendulum",
        tmp_path / "out",
        vary={"parameter.m1": np.linspace(1.0, 2.0, 16)},
        step=0.01,
        duration=0.1,
        executor=poisoned({3: "die", 11: "hang"}),
        chunk=1,
        time_limit=30.0,
        retries=1,
    )
    assert found.aside == 2 and found.verdicts == {"consistent": 14, "failed": 2}
    failed = found.frame.filter(pl.col("verdict") == "failed")
    assert failed["code"].to_list() == ["E-DIED", "E-TIME"]
    told = Store.open(tmp_path / "out").aside()
    assert all(f"--only {address}" in about["reproduce"] for address, about in told.items())
    again = dc.sweep(
        "double-pendulum",
        tmp_path / "out",
        vary={"parameter.m1": np.linspace(1.0, 2.0, 16)},
        step=0.01,
        duration=0.1,
        workers=1,
        retry_failed=True,
    )
    assert again.aside == 0 and again.verdicts == {"consistent": 16}


FULL = """\
import resource, signal, sys
import deltac as dc
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
plan, folder = sys.argv[1:]
resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000))
try:
    dc.sweep(plan, folder, workers=1, chunk=400)
except dc.InputError as error:
    print(error.code, error)
"""


def test_a_disk_that_is_full(plan: Path, undisturbed: pl.DataFrame, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [sys.executable, "-c", FULL, str(plan), str(folder)],
        capture_output=True,
        text=True,
        timeout=200,
        env=environment,
    )
    assert done.stdout.startswith("E-FILE"), (done.stdout, done.stderr)
    assert not [p for p in folder.rglob("*") if p.name.endswith(".tmp")]
    assert compared(dc.sweep(plan, folder, workers=1).frame).equals(undisturbed)


# --- Dask ------------------------------------------------------------------------------------------

CLUSTER = """\
import sys, time
from distributed import LocalCluster
if __name__ == "__main__":
    with LocalCluster(n_workers=int(sys.argv[1]), threads_per_worker=1, dashboard_address=None) as cluster:
        print(cluster.scheduler_address, *(w.pid for w in cluster.workers.values()), flush=True)
        time.sleep(600)
"""


@contextmanager
def cluster(folder: Path, workers: int) -> Iterator[tuple[str, int, list[int]]]:
    """Address of the scheduler, its process, those of the workers."""
    pytest.importorskip("distributed")
    script = folder / "cluster.py"
    script.write_text(CLUSTER)
    process = subprocess.Popen(
        [sys.executable, str(script), str(workers)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert process.stdout is not None
    address, *pids = process.stdout.readline().split()
    try:
        yield address, process.pid, [int(pid) for pid in pids]
    finally:
        process.kill()
        process.communicate()
        for pid in map(int, pids):  # whose nanny is gone
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                continue


def after_pieces(folder: Path, count: int) -> None:
    until = time.monotonic() + 100.0
    while len(list((folder / "pieces").glob("*.parquet"))) < count and time.monotonic() < until:
        time.sleep(0.02)


@pytest.mark.parametrize("lost", ["nothing", "worker", "scheduler"])
def test_dask(lost: str, plan: Path, undisturbed: pl.DataFrame, tmp_path: Path) -> None:
    """The same table by a cluster; a killed worker costs its pieces, a lost scheduler ends with words."""
    folder = tmp_path / "out"
    with cluster(tmp_path, 2) as (address, scheduler, workers):
        process = start(plan, "--out", folder, "--scheduler", address, "--chunk", 2)
        if lost != "nothing":
            after_pieces(folder, 20)
            os.kill(scheduler if lost == "scheduler" else workers[0], signal.SIGKILL)
        said = process.communicate(timeout=200)
    if lost == "scheduler":
        assert process.returncode == 2 and "E-DIED" in said[1] and "is gone" in said[1], said
        process = start(plan, "--out", folder)
        said = process.communicate(timeout=200)
    assert process.returncode == 0, said
    assert compared(pl.read_parquet(folder / "results.parquet")).equals(undisturbed)


def test_a_scheduler_that_is_not_there(plan: Path, tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    with pytest.raises(dc.InputError, match="does not answer"):
        dc.sweep(plan, tmp_path / "out", scheduler="tcp://127.0.0.1:9")
