"""Parquet in parts: the same values as the whole, bounded memory, the same errors."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest

from deltac.errors import InputError
from deltac.foreign.limits import free_memory
from deltac.trajectories import Provenance, Trajectory, read_trajectory, scan_trajectory


def sample(rows: int = 1000) -> Trajectory:
    rng = np.random.default_rng(rows)
    return Trajectory(
        t=np.cumsum(rng.random(rows) + 0.1),
        q=rng.random((rows, 2)),
        u=rng.random((rows, 2)),
        udot=rng.random((rows, 2)),
        forces={"damper a": rng.random((rows, 2))},
        integrals={"wang": rng.random(rows)},
        coordinates=("a", "b"),
        speeds=("a", "b"),
        provenance=Provenance("deltac", held=("damper a",)),
    )


@pytest.mark.parametrize(("rows", "overlap"), [(1, 0), (7, 3), (100, 1), (333, 400), (5000, 2)])
def test_the_cores_make_up_the_log_and_see_their_neighbours(
    rows: int, overlap: int, tmp_path: Path
) -> None:
    run = sample(200)
    run.write(tmp_path / "log.parquet")
    position = 0
    for chunk in scan_trajectory(tmp_path / "log.parquet", rows=rows, overlap=overlap):
        start, stop = chunk.first_row + chunk.core.start, chunk.first_row + chunk.core.stop
        assert start == position and chunk.rows == 200
        first, last = max(0, start - overlap), min(200, stop + overlap)
        assert (chunk.first_row, len(chunk.run)) == (first, last - first)
        part = slice(first, last)
        assert chunk.run.t.tobytes() == run.t[part].tobytes()
        assert np.array_equal(chunk.run.q, run.q[part])
        assert np.array_equal(chunk.run.forces["damper a"], run.forces["damper a"][part])
        assert np.array_equal(chunk.run.integrals["wang"], run.integrals["wang"][part])
        assert chunk.run.provenance == run.provenance
        position = stop
    assert position == 200


def test_a_foreign_log_with_a_mapping(tmp_path: Path) -> None:
    t = np.linspace(0.0, 1.0, 50)
    frame = polars.DataFrame({"ms": 1e3 * t, "angle": t, "rate": 1 + 0 * t})
    frame.write_parquet(tmp_path / "log.parquet")
    mapping = tmp_path / "m.toml"
    mapping.write_text(
        '[log]\ntime = {column = "ms", unit = "ms"}\n[coordinates]\na = "angle"\n[speeds]\na = "rate"\n'
    )
    whole = read_trajectory(tmp_path / "log.parquet", mapping)
    parts = list(scan_trajectory(tmp_path / "log.parquet", 20, 0, mapping))
    assert np.array_equal(np.concatenate([c.run.t for c in parts]), whole.t)
    assert [len(c.run) for c in parts] == [20, 20, 10]


def broken(folder: Path, **columns: Any) -> Path:
    t = np.arange(50.0)
    polars.DataFrame({"time": t, "q.a": t, "u.a": t} | columns).write_parquet(
        folder / "log.parquet"
    )
    return folder / "log.parquet"


def test_errors_name_the_part(tmp_path: Path) -> None:
    t = np.arange(50.0)
    path = broken(tmp_path, **{"q.a": np.where(t == 33, np.nan, t)})
    chunks = scan_trajectory(path, 20, 1)
    assert next(chunks).first_row == 0
    with pytest.raises(
        InputError, match=r"log\.parquet: in the part that begins at row 19: .*row 14 "
    ):
        next(chunks)
    path = broken(tmp_path, time=np.where(t >= 20, t - 1, t))  # row 20 repeats row 19
    with pytest.raises(InputError, match=r"found 19\.0 after 19\.0"):
        list(scan_trajectory(path, 20, 1))
    polars.DataFrame({"time": t, "q.a": t}).write_parquet(path)
    with pytest.raises(InputError, match=r"no column 'u\.<speed>'"):
        list(scan_trajectory(path))


def test_files_that_cannot_be_read_in_parts(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="only Parquet"):
        scan_trajectory(tmp_path / "log.csv")
    with pytest.raises(InputError, match="no such file"):
        scan_trajectory(tmp_path / "log.parquet")
    sample(9).write(tmp_path / "log.parquet")
    with pytest.raises(InputError, match="rows is 0"):
        scan_trajectory(tmp_path / "log.parquet", rows=0)
    data = (tmp_path / "log.parquet").read_bytes()
    (tmp_path / "log.parquet").write_bytes(data[:-30])
    with pytest.raises(InputError, match="truncated"):
        list(scan_trajectory(tmp_path / "log.parquet"))


MEASURE = """
import resource, sys
from deltac.trajectories import scan_trajectory
path = sys.argv[1]
def peak():  # kB of this process
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
chunks = scan_trajectory(path, rows=20_000, overlap=4)
for _ in range(3):
    next(chunks)
before = peak()
rows = sum(chunk.core.stop - chunk.core.start for chunk in chunks)
print(rows, peak() - before)
"""


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="ru_maxrss is in kB on Linux only")
def test_memory_is_bounded(tmp_path: Path) -> None:
    rows, columns = 1_500_000, 10
    t = np.arange(float(rows))
    names = ["q.a", "u.a", *(f"force.applied {i}.a" for i in range(columns - 3))]
    polars.DataFrame({"time": t} | dict.fromkeys(names, t)).write_parquet(
        tmp_path / "log.parquet", row_group_size=65_536
    )
    output = subprocess.run(
        [sys.executable, "-c", MEASURE, str(tmp_path / "log.parquet")],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    read, growth = map(int, output.split())
    assert read == rows - 60_000
    assert growth * 1024 < 0.4 * rows * columns * 8  # the whole would be 120 MB, and copies of it


def test_a_log_that_does_not_fit_into_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sample(1000).write(tmp_path / "log.parquet")
    sample(1000).write(tmp_path / "log.csv")
    monkeypatch.setattr("deltac.foreign.limits.free_memory", lambda: 1e5)
    monkeypatch.setenv("DELTAC_ISOLATION", "off")  # another process sees the memory that there is
    with pytest.raises(
        InputError, match=r"log\.parquet: the log has 1000 rows and 10 columns.*in parts"
    ):
        read_trajectory(tmp_path / "log.parquet")
    with pytest.raises(InputError, match=r"log\.csv: the log has .* GB; .*Store it as Parquet"):
        read_trajectory(tmp_path / "log.csv")
    assert sum(len(c.run) for c in scan_trajectory(tmp_path / "log.parquet", 100, 0)) == 1000


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc/meminfo")
def test_free_memory_is_plausible() -> None:
    free = free_memory()
    assert free is not None and 1e7 < free < 1e14
