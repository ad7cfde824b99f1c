"""Crashes, full disks, many processes: every output is whole under its name, and nothing else is left."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from deltac.errors import InputError
from deltac.report.files import write_json
from deltac.trajectories import Trajectory, read_trajectory, write_trajectory

pytest.importorskip("resource", reason="needs processes as POSIX has them")

SUFFIXES = (".csv", ".parquet", ".npz", ".h5", ".mat")

# Imports once; then for each line forks a process that writes, over and over, until it is killed.
WRITER = """
import os, sys
import numpy as np, polars, h5py, scipy.io
from pathlib import Path
from deltac.kernels import compiled
from deltac.report.files import write_json
from deltac.trajectories import Trajectory, write_trajectory

def write(folder):
    k = 0
    while True:
        k += 1
        t = np.arange(100.0 + k % 7)
        run = Trajectory(t=t, q=np.full((len(t), 40), float(k)), u=np.full((len(t), 40), float(k)),
                         coordinates=[f"a{i}" for i in range(40)], speeds=[f"a{i}" for i in range(40)])
        for suffix in (".csv", ".parquet", ".npz", ".h5", ".mat"):
            write_trajectory(run, folder / f"run{suffix}")
        write_json({"k": k, "list": [k] * 2000}, folder / "run.json")
        compiled(f"kernel {k % 5}", lambda: [k % 5] * 2000, folder / "cache")

for line in sys.stdin:
    child = os.fork()
    if child == 0:
        write(Path(line.strip()))
    print(child, flush=True)
    os.waitpid(child, 0)
    print("gone", flush=True)
"""


@contextmanager
def writer(code: str = WRITER) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "POLARS_MAX_THREADS": "1"},
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def read(folder: Path) -> dict[str, float]:
    """What the files hold; each is whole, and of one run."""
    found = {}
    for suffix in SUFFIXES:
        if (path := folder / f"run{suffix}").exists():
            run = read_trajectory(path)
            assert np.ptp(run.q) == np.ptp(run.u) == 0.0
            found[suffix] = run.q[0, 0]
    if (path := folder / "run.json").exists():
        value = json.loads(path.read_text())
        assert set(value["list"]) == {value["k"]}
        found[".json"] = value["k"]
    return found


def unfinished(folder: Path) -> list[str]:
    return [name for name in os.listdir(folder) if name.endswith((".tmp", ".part"))]


@pytest.mark.parametrize("kills", [10, pytest.param(200, marks=pytest.mark.slow)])
def test_a_process_killed_at_any_moment(kills: int, tmp_path: Path) -> None:
    rng, kept, seen = random.Random(kills), set[str](), 0
    with writer() as process:
        assert process.stdin is not None and process.stdout is not None
        for _ in range(kills):
            process.stdin.write(f"{tmp_path}\n")
            process.stdin.flush()
            child = int(process.stdout.readline())
            time.sleep(rng.uniform(0.0, 0.3))
            os.kill(child, signal.SIGKILL)
            assert process.stdout.readline() == "gone\n"
            found = read(tmp_path)
            assert kept <= found.keys(), "a file that was there is gone"
            kept = set(found)
            seen += len(unfinished(tmp_path))
    if kills >= 200:
        assert kept == {*SUFFIXES, ".json"}
        assert seen > 0, "no kill fell into a write"
    write_json({}, tmp_path / "run.json")  # the next run
    assert not unfinished(tmp_path)
    from deltac.kernels import compiled

    for k in range(5):  # whatever the cache holds is what was put there
        assert compiled(f"kernel {k}", lambda: [], tmp_path / "cache") in ([k] * 2000, [])
    compiled("another", lambda: 1, tmp_path / "cache")
    assert not unfinished(tmp_path / "cache")


def sample(rows: int) -> Trajectory:
    t, x = np.arange(float(rows)), np.random.default_rng(1).random((rows, 1))
    return Trajectory(t=t, q=x, u=x, coordinates=("a",), speeds=("a",))


LIMITED = """
import resource, signal, sys
from pathlib import Path
from tests.test_torture import sample
from deltac.errors import InputError
from deltac.report.files import write_json
from deltac.trajectories import write_trajectory
import polars, h5py, scipy.io
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (16384, 16384))
folder = Path(sys.argv[1])
for suffix in (".csv", ".parquet", ".npz", ".h5", ".mat"):
    try:
        write_trajectory(sample(50_000), folder / f"run{suffix}")
    except OSError:
        print("OSError", suffix)
try:
    write_json([0] * 50_000, folder / "run.json")
except InputError:
    print("InputError .json")
"""


def test_a_disk_that_is_full(tmp_path: Path) -> None:
    for suffix in SUFFIXES:
        write_trajectory(sample(3), tmp_path / f"run{suffix}")
    write_json([1], tmp_path / "run.json")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([os.getcwd(), *sys.path])},
    )
    assert done.stdout.split() == [
        *(word for suffix in SUFFIXES for word in ("OSError", suffix)),
        *("InputError", ".json"),
    ], done.stderr
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize("size", ["200k", "ro"])
def test_a_small_or_read_only_file_system(size: str, tmp_path: Path) -> None:
    place = tmp_path / "disk"
    place.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=200k", "tmpfs", str(place)], capture_output=True
    )
    if mounted.returncode:
        pytest.skip("this user may mount nothing")
    try:
        for suffix in SUFFIXES:
            write_trajectory(sample(3), place / f"run{suffix}")
        write_json([1], place / "run.json")
        before = {path.name: path.read_bytes() for path in place.iterdir()}
        if size == "ro":
            subprocess.run(["mount", "-o", "remount,ro", str(place)], check=True)
        for suffix in SUFFIXES:
            with pytest.raises(OSError):
                write_trajectory(sample(50_000), place / f"run{suffix}")
        with pytest.raises(InputError, match=r"run\.json cannot be written"):
            write_json([0] * 500_000, place / "run.json")
        assert {path.name: path.read_bytes() for path in place.iterdir()} == before
    finally:
        subprocess.run(["umount", str(place)], check=True)


TOGETHER = """
import sys
import deltac as dc
from pathlib import Path
from deltac.report.files import write_json
folder = Path(sys.argv[1])
problem = dc.problems.load("triple-pendulum")
run = dc.simulate(problem.mechanism, problem.state, 0.1, step=0.01, solver="ode4")
ledger = dc.balance(problem.mechanism, run)
for suffix in (".csv", ".parquet", ".npz", ".h5", ".mat"):
    run.write(folder / f"run{suffix}")
write_json(float(ledger.delta_c["wang"][-1]), folder / "delta.json")
print(run.q.tobytes().hex())
"""


@pytest.mark.slow
def test_twenty_processes_with_a_cold_cache_and_the_same_outputs(tmp_path: Path) -> None:
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(sys.path),
        "DELTAC_CACHE": "on",
        "DELTAC_CACHE_DIR": str(tmp_path / "cache"),
        "XDG_STATE_HOME": str(tmp_path / "state"),  # the key is made by one of them
    }
    (tmp_path / "out").mkdir()
    processes = [
        subprocess.Popen(
            [sys.executable, "-W", "error::UserWarning", "-c", TOGETHER, str(tmp_path / "out")],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for _ in range(20)
    ]
    outputs = [process.communicate(timeout=500) for process in processes]
    assert [process.returncode for process in processes] == [0] * 20, outputs
    assert len({said for said, _ in outputs}) == 1, "the same bits from all"
    (said, _), *_ = outputs
    for suffix in SUFFIXES:
        assert read_trajectory(tmp_path / "out" / f"run{suffix}").q.tobytes().hex() == said.strip()
    assert not unfinished(tmp_path / "out") and not unfinished(tmp_path / "cache")


# -- readers from several threads, processes and tasks -------------------------------------------


def logs(folder: Path) -> list[Path]:
    for suffix in SUFFIXES:
        write_trajectory(sample(500), folder / f"run{suffix}")
    return [folder / f"run{suffix}" for suffix in SUFFIXES] * 4


def content(path: Path) -> bytes:
    return read_trajectory(path).q.tobytes()


def by_threads(paths: list[Path]) -> list[bytes]:
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(8) as pool:
        return list(pool.map(content, paths))


def by_spawn(paths: list[Path]) -> list[bytes]:
    import multiprocessing

    with multiprocessing.get_context("spawn").Pool(2) as pool:
        return pool.map(content, paths)


def by_tasks(paths: list[Path]) -> list[bytes]:
    import asyncio

    async def all_of_them() -> list[bytes]:
        return await asyncio.gather(*(asyncio.to_thread(content, path) for path in paths))

    return asyncio.run(all_of_them())


@pytest.mark.parametrize(
    "way", [by_threads, by_tasks, pytest.param(by_spawn, marks=pytest.mark.slow)]
)
def test_logs_are_read_at_once(way: Callable[[list[Path]], list[bytes]], tmp_path: Path) -> None:
    paths = logs(tmp_path)
    assert way(paths) == [content(path) for path in paths]


def test_limits_belong_to_a_thread(tmp_path: Path) -> None:
    from concurrent.futures import ThreadPoolExecutor

    from deltac.foreign.limits import Limits

    path = logs(tmp_path)[0]
    with ThreadPoolExecutor(1) as pool, Limits(rows=10).applied():
        assert pool.submit(content, path).result()  # another thread's are the usual ones
        with pytest.raises(InputError, match="rows"):
            content(path)
