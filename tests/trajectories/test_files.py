"""Logs on disk: exact round trips, foreign files, and files that cannot be used."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import hypothesis.strategies as st
import numpy as np
import polars
import pytest
from hypothesis import assume, example, given
from hypothesis.extra import numpy as arrays

from deltac.errors import InputError
from deltac.mechanism.channels import CHANNEL_KINDS
from deltac.trajectories import (
    FORMATS,
    Provenance,
    Trajectory,
    read_trajectory,
    to_columns,
    to_metadata,
    write_trajectory,
)

SUFFIXES = tuple({form: suffix for suffix, form in FORMATS.items() if form.write}.values())
"""One suffix of every format that is written: what is listed is tested."""

# Any text but control characters, lone surrogates and line separators; dots, commas, quotes and
# the like often.
characters = st.characters(exclude_categories=("Cc", "Cs", "Zl", "Zp"))
names = st.text(st.sampled_from("ab.. ,\"';#=é漢") | characters, min_size=1, max_size=6).filter(
    lambda name: bool(name.strip())
)
channels = st.builds("{} {}".format, st.sampled_from(CHANNEL_KINDS), names) | st.just("gravity")
# Hypothesis favours extremes: denormals, -0.0, the largest and smallest normal floats.
finite = st.floats(allow_nan=False, allow_infinity=False)
text = st.text(max_size=8)


@st.composite
def trajectories(draw: st.DrawFn) -> Trajectory:
    t = sorted(draw(st.sets(finite, min_size=1, max_size=4)))
    coordinates = draw(st.lists(names, max_size=3, unique=True))
    speeds = draw(st.lists(names, max_size=3, unique=True))

    def table(*shape: int) -> Any:
        return draw(arrays.arrays(np.float64, (len(t), *shape), elements=finite))

    positive = st.floats(min_value=0.0, exclude_min=True, allow_infinity=False)
    return Trajectory(
        t=t,  # type: ignore[arg-type]
        q=table(len(coordinates)),
        u=table(len(speeds)),
        udot=table(len(speeds)) if draw(st.booleans()) else None,
        forces={c: table(len(speeds)) for c in draw(st.lists(channels, max_size=2, unique=True))},
        integrals={name: table() for name in draw(st.lists(names, max_size=2, unique=True))},
        coordinates=tuple(coordinates),
        speeds=tuple(speeds),
        provenance=Provenance(
            draw(st.text(min_size=1, max_size=8)),
            solver=draw(st.none() | text),
            step=draw(st.none() | positive),
            tolerance=draw(st.none() | positive),
            model=draw(st.none() | text),
            completed=draw(st.booleans()),
            message=draw(text),
            notes=draw(st.dictionaries(text, text, max_size=2)),
        ),
    )


def assert_same_bits(a: Trajectory, b: Trajectory) -> None:
    assert a.coordinates == b.coordinates and a.speeds == b.speeds
    assert a.provenance == b.provenance
    assert list(a.forces) == list(b.forces) and list(a.integrals) == list(b.integrals)
    assert (a.udot is None) == (b.udot is None)
    pairs = [(a.t, b.t), (a.q, b.q), (a.u, b.u)]
    if a.udot is not None and b.udot is not None:
        pairs.append((a.udot, b.udot))
    pairs += [(a.forces[name], b.forces[name]) for name in a.forces]
    pairs += [(a.integrals[name], b.integrals[name]) for name in a.integrals]
    for x, y in pairs:  # bytes, for == takes -0.0 for 0.0
        assert x.shape == y.shape and x.tobytes() == y.tobytes()


def sample(rows: int = 3, **changes: Any) -> Trajectory:
    t = np.arange(float(rows))
    base: dict[str, Any] = dict(
        t=t,
        q=np.column_stack([t / 3, -t]),
        u=np.column_stack([t * 1e-310, 0.0 * -t]),
        udot=np.full((rows, 2), np.pi),
        forces={"damper left hip.y": np.full((rows, 2), 1e300), "gravity": np.zeros((rows, 2))},
        integrals={"wang": t, "liu-huston": -t},
        coordinates=("base.x", 'say "knee", 漢'),
        speeds=("base.vx", "#knee"),
        provenance=Provenance("deltac", solver="ode5", step=1e-3, notes={"line": "two\nlines"}),
    )
    return Trajectory(**(base | changes))


@pytest.mark.parametrize("suffix", SUFFIXES)
@given(run=trajectories())
@example(run=sample())
def test_read_after_write_is_bitwise_equal(suffix: str, run: Trajectory) -> None:
    try:
        to_columns(run)
    except InputError:  # two forces in one column: see test_schema
        assume(False)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"log{suffix}"
        run.write(path)
        assert_same_bits(read_trajectory(path), run)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_bit_pattern_of_a_float_survives(suffix: str, tmp_path: Path) -> None:
    bits = np.random.default_rng(1).integers(0, 2**64, size=20_000, dtype=np.uint64)
    values = bits.view(np.float64)
    values = values[np.isfinite(values)]
    rows = len(values)
    run = Trajectory(
        t=np.arange(rows) / 7,
        q=values[:, None],
        u=-values[:, None],
        coordinates=("x",),
        speeds=("x",),
    )
    path = tmp_path / f"log{suffix}"
    write_trajectory(run, path)
    assert_same_bits(read_trajectory(path), run)


def test_the_schema_as_another_program_sees_it(tmp_path: Path) -> None:
    run = sample()
    write_trajectory(run, tmp_path / "log.csv")
    write_trajectory(run, tmp_path / "log.parquet")
    first, header = (tmp_path / "log.csv").read_text("utf-8").splitlines()[:2]
    assert json.loads(first.removeprefix("# deltac ")) == to_metadata(run)
    assert header.startswith('time,q.base.x,"q.say ""knee"", 漢",u.base.vx,u.#knee,udot.base.vx')
    table = polars.read_parquet(tmp_path / "log.parquet")
    assert table.columns == list(to_columns(run))
    assert set(table.dtypes) == {polars.Float64}
    stored = polars.read_parquet_metadata(tmp_path / "log.parquet")["deltac"]
    assert json.loads(stored) == to_metadata(run)
    assert np.array_equal(np.loadtxt(tmp_path / "log.csv", delimiter=",", skiprows=2)[:, 0], run.t)


# -- logs of other programs ----------------------------------------------------------------------


def csv_log(folder: Path, content: str | bytes) -> Path:
    path = folder / "log.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize(
    "content",
    [
        "time,q.a,u.a\n0,1,2\n0.5,3,-4e0\n",
        "\ufefftime,q.a,u.a\r\n0,1,2\r\n0.5,3,-4\r\n",
        "# made by hand\n#\n time , q.a, u.a\n 0, 1, 2\n0.5 , +3,-4.",
        'u.a,"time",q.a\n2,0,"1"\n-4,.5,3\n',
    ],
    ids=["plain", "byte-order mark and CRLF", "comments and spaces", "quotes and another order"],
)
def test_a_foreign_csv(content: str, tmp_path: Path) -> None:
    run = read_trajectory(csv_log(tmp_path, content))
    assert np.array_equal(run.t, [0, 0.5])
    assert np.array_equal(run.q, [[1], [3]])
    assert np.array_equal(run.u, [[2], [-4]])
    assert run.provenance == Provenance("unknown")


def test_a_foreign_parquet(tmp_path: Path) -> None:
    path = tmp_path / "LOG.PARQUET"
    table = {"time": [0, 1], "q.a": [1.5, 2.5], "u.a": ["3", " 4"]}
    polars.DataFrame(table, schema_overrides={"q.a": polars.Float32}).write_parquet(path)
    run = read_trajectory(str(path))
    assert np.array_equal(np.column_stack([run.t, run.q, run.u]), [[0, 1.5, 3], [1, 2.5, 4]])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "the file is empty"),
        (" \n\n", "the file is empty"),
        ("# only a comment\n", "no column names"),
        ("time,q.a,u.a\n", "no rows"),
        ("time,q.a,u.a\n\n", "no rows"),
        ("t,q.a,u.a\n0,1,2\n", "no column 'time'; known: t, q.a, u.a"),
        ("time,q.a,u.a,u.a\n0,1,2,3\n", "'u.a' appears twice"),
        ("time,q.a,u.a,v.a\n0,1,2,3\n", "unknown column 'v.a'; did you mean"),
        ("time,q.a\n0,1\n", "no column 'u.<speed>'"),
        ("time,u.a\n0,1\n", "no column 'q.<coordinate>'"),
        ("time;q.a;u.a\n0;1\n", "line 2 has 2 fields, expected 3"),
        ("time,q.a,u.a\n0,1,2\n1,2,x1\n", "'u.a', row 1 (of 0 to 1), line 3: found 'x1'"),
        ("# hi\ntime,q.a,u.a\n0,1,2\n1,,3\n", "'q.a', row 1 (of 0 to 1), line 4: found nothing"),
        ("time,q.a,u.a\n0,1,2\n1,2\n", "'u.a', row 1 (of 0 to 1), line 3: found nothing"),
        ("time,q.a,u.a\n0,1,2\n\n2,2,3\n", "'time', row 1 (of 0 to 2): found nan"),
        ("time,q.a,u.a\n0,1,2\n0,5,1,2\n", "line 3 has 4 fields, expected 3"),
        ("time,q.a,u.a\n0,1,2\n1,nan,2\n", "'q.a', row 1 (of 0 to 1), t = 1.0 s: found nan"),
        ("time,q.a,u.a\n0,1,2\n1,1,-Inf\n", "'u.a', row 1 (of 0 to 1), t = 1.0 s: found -inf"),
        ("time,q.a,u.a\n0,1,2\n1,1,1e999\n", "found inf"),
        ("time,q.a,u.a\nNaN,1,2\n", "'time', row 0 (of 0 to 0): found nan"),
        ("time,q.a,u.a\n0,1,2\n0,1,2\n", "'time', row 1 (of 0 to 1): found 0.0 after 0.0"),
        ("time,q.a,u.a\n0,1,2\n1,1,2\n3,1,2\n2,1,2\n", "Sort the rows"),
        (
            "time,q.a,u.a\n0,1,2\n1,1,2\n2,1,2\n0,1,2\n1,1,2\n",
            "row 3 (of 0 to 4): found 0.0 after 2.0",
        ),
        ("time,q.a,u.a\n0,1,2\n1,1,2\n2,1,2\n1,1,2\n2,1,2\n", "give each episode a log of its own"),
        ('time,q.a,u.a\n0,1,2\n1,"1,2\n', "line 3 cannot be taken apart"),
        ("time,q.a,u.a\n0,1\n1,2\n", "line 2 has 2 fields, expected 3"),
        (b"time,q.\x81,u.a\n0,1,2\n", "column names cannot be read"),
        (b"time,q.a,u.a\n0,1,2\n1,2,\xff\n", "line 3 is not UTF-8"),
        ("# deltac {oops\ntime,q.a,u.a\n0,1,2\n", "damage in the deltac metadata"),
        ("# deltac []\ntime,q.a,u.a\n0,1,2\n", "expected a JSON object"),
        ('# deltac {"schema_version": 9}\ntime,q.a,u.a\n0,1,2\n', "version 9"),
        ("# deltac {}\ntime,q.a,u.a\n0,1,2\n", "no entry 'schema_version'"),
    ],
)
def test_a_csv_that_cannot_be_used(content: str | bytes, message: str, tmp_path: Path) -> None:
    path = csv_log(tmp_path, content)
    with pytest.raises(InputError) as caught:
        read_trajectory(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)


def test_a_csv_that_lost_its_last_rows_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    write_trajectory(sample(9), path)
    path.write_bytes(path.read_bytes().rsplit(b"\n", 2)[0] + b"\n")
    with pytest.raises(InputError, match="found 8 rows, the metadata say 9"):
        read_trajectory(path)


@pytest.mark.parametrize("kept", [0, 3, 4, 0.2, 0.5, 0.9, -1])
def test_a_truncated_parquet(kept: float, tmp_path: Path) -> None:
    path = tmp_path / "log.parquet"
    write_trajectory(sample(), path)
    data = path.read_bytes()
    path.write_bytes(data[: int(kept * len(data)) if isinstance(kept, float) else kept])
    with pytest.raises(InputError, match=r"log\.parquet: .*(empty|truncated|not a Parquet)"):
        read_trajectory(path)


def test_a_parquet_with_a_damaged_footer(tmp_path: Path) -> None:
    path = tmp_path / "log.parquet"
    write_trajectory(sample(), path)
    data = bytearray(path.read_bytes())
    length = int.from_bytes(data[-8:-4], "little")
    data[-8 - length : -8] = bytes(length)
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"log\.parquet: the Parquet file is damaged"):
        read_trajectory(path)


@pytest.mark.parametrize(
    ("column", "message"),
    [
        ([None, 1.0], r"'u\.a', row 0 \(of 0 to 1\), .*found nan"),
        ([None, None], r"'u\.a', row 0 \(of 0 to 1\): found nothing"),
        (["1", "two"], r"'u\.a', row 1 \(of 0 to 1\): found 'two'"),
        ([True, False], r"'u\.a': found values of type Boolean"),
        ([0.0, float("nan")], r"'u\.a', row 1 .*found nan"),
    ],
)
def test_a_parquet_whose_columns_are_no_numbers(
    column: list[Any], message: str, tmp_path: Path
) -> None:
    path = tmp_path / "log.parquet"
    polars.DataFrame({"time": [0, 1], "q.a": [1, 2], "u.a": column}).write_parquet(path)
    with pytest.raises(InputError, match=message):
        read_trajectory(path)


def test_paths_that_cannot_be_used(tmp_path: Path) -> None:
    run = sample()
    with pytest.raises(InputError, match=r"unknown suffix '\.cvs'; did you mean '\.csv'"):
        write_trajectory(run, tmp_path / "log.cvs")
    with pytest.raises(InputError, match="unknown suffix ''"):
        read_trajectory(tmp_path / "log")
    with pytest.raises(InputError, match="the folder .*nowhere does not exist"):
        write_trajectory(run, tmp_path / "nowhere" / "log.csv")
    with pytest.raises(InputError, match="the folder .*nowhere does not exist"):
        read_trajectory(tmp_path / "nowhere" / "log.csv")
    write_trajectory(run, tmp_path / "walking.csv")
    with pytest.raises(InputError, match=r"no such file; did you mean 'walking\.csv'"):
        read_trajectory(tmp_path / "walkin.csv")
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(InputError, match="cannot be read"):
        read_trajectory(tmp_path / "folder.csv")
    with pytest.raises(InputError, match="is a folder"):
        write_trajectory(run, tmp_path / "folder.csv")


# -- writing -------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("trouble", [OSError("disk full"), KeyboardInterrupt()])
def test_an_interrupted_write_leaves_the_old_file(
    suffix: str, trouble: BaseException, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"log{suffix}"
    write_trajectory(sample(3), path)
    before = path.read_bytes()
    written = []

    def interrupted(descriptor: int) -> None:
        written.append(os.fstat(descriptor).st_size)
        raise trouble

    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(type(trouble)):
        write_trajectory(sample(99), path)
    assert written[0] > 0  # the new file was on its way
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == [path.name]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_write_replaces_the_file_and_goes_through_a_link(suffix: str, tmp_path: Path) -> None:
    path, link = tmp_path / f"log{suffix}", tmp_path / f"link{suffix}"
    write_trajectory(sample(3), path)
    link.symlink_to(path)
    write_trajectory(sample(5), link)
    assert link.is_symlink()
    assert len(read_trajectory(path)) == 5
    assert sorted(os.listdir(tmp_path)) == sorted([path.name, link.name])


def test_polars_is_loaded_only_when_it_is_needed() -> None:
    code = "import sys, deltac.trajectories; sys.exit('polars' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
