"""Recorders and formats of logs that another package registers by entry points."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import deltac as dc

MODULE = """
import json
import numpy as np
from deltac.recorders import Recorder, TrajectoryBuilder
from deltac.trajectories import Format, Provenance, RawLog


def read(path):
    return RawLog({n: np.asarray(x, float) for n, x in json.loads(path.read_text()).items()})


def write(run, header, file):
    table = {"time": run.t, "q.pivot": run.q[:, 0], "u.pivot": run.u[:, 0]}
    file.write(json.dumps({n: x.tolist() for n, x in table.items()}).encode())


FORMAT = Format(read, write)
READ_ONLY = Format(read)


def record_swing(t, q, u):
    rows = TrajectoryBuilder(("pivot",), ("pivot",))
    for row in zip(t, q, u):
        rows.add(row[0], [row[1]], [row[2]])
    return rows.trajectory(Provenance("Swing"))
"""

ENTRIES = """[deltac.formats]
.swing = their_swing:FORMAT
.swingin = their_swing:READ_ONLY
.zarr = their_swing:READ_ONLY

[deltac.recorders]
record_swing = their_swing:record_swing
"""


@pytest.fixture
def theirs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package that is installed, as far as Python's metadata tell."""
    (tmp_path / "their_swing.py").write_text(MODULE)
    facts = tmp_path / "their_swing-1.0.dist-info"
    facts.mkdir()
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: their-swing\nVersion: 1.0\n")
    (facts / "entry_points.txt").write_text(ENTRIES)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "their_swing", raising=False)
    return tmp_path


def test_a_recorder_and_a_format_of_another_package(theirs: Path) -> None:
    t = np.linspace(0.0, 1.0, 11)
    run = dc.recorders.record_swing(t, np.sin(t), np.cos(t))  # type: ignore[attr-defined]
    dc.write_trajectory(run, theirs / "run.swing")
    again = dc.read_trajectory(theirs / "run.swing")
    assert np.array_equal(again.q, run.q) and np.array_equal(again.t, run.t)
    with pytest.raises(dc.InputError, match="does not write|unknown suffix"):
        dc.write_trajectory(run, theirs / "run.swingin")
    for name in ("run.swingin", "run.zarr"):  # also where deltac by itself refuses the suffix
        (theirs / name).write_bytes((theirs / "run.swing").read_bytes())
        assert np.array_equal(dc.read_trajectory(theirs / name).u, run.u)


def test_names_that_nobody_registers(theirs: Path) -> None:
    with pytest.raises(AttributeError, match="record_chrono"):
        _ = dc.recorders.record_chrono  # type: ignore[attr-defined]
    (theirs / "run.chrono").write_text("1")
    with pytest.raises(dc.InputError, match="unknown suffix '.chrono'"):
        dc.read_trajectory(theirs / "run.chrono")
