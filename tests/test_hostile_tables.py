"""Tables, folders of results and names that strangers wrote."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

import deltac as dc
from deltac.fleets.design import lay_out
from deltac.fleets.spec import make_spec
from deltac.fleets.store import HEAD

COLUMNS = "t,q.joint1,q.joint2,u.joint1,u.joint2,udot.joint1,udot.joint2"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (f"{COLUMNS},udot.joint2\n0,1,1,1,1,1,1,1\n", "appears twice"),
        (f"{COLUMNS}\n", "no rows"),
        (f"{COLUMNS}\n0,1,1,1,1,1,\0\n", "expected a number"),
        (f'{COLUMNS}\n0,1,1,1,1,1,"' + "9\n" * 100_000, "cannot be taken apart"),
    ],
)
def test_tables_of_states(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "states.csv").write_text(text)
    with pytest.raises(dc.InputError, match=words):
        dc.check_table("double-pendulum", tmp_path / "states.csv")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_pipes_do_not_make_tables_wait(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(dc.InputError, match="a named pipe"):
        dc.check_table("double-pendulum", tmp_path / "pipe.csv")
    with pytest.raises(dc.InputError, match="a named pipe"):
        dc.write_states("double-pendulum", tmp_path / "pipe.csv", count=2)


def test_a_range_of_more_values_than_there_is_memory() -> None:
    axis = {"from": 1.0, "to": 2.0, "count": 10**18}
    spec = make_spec({"model": "double-pendulum", "step": 0.01, "vary": {"parameter": {"m": axis}}})
    with pytest.raises(dc.InputError, match="more than the limit") as caught:
        lay_out(spec)
    assert caught.value.code == "E-LIMIT"


@pytest.mark.parametrize(
    "head", ['{"format": 1, "kind": "sweep", "name": "x"}', '{"format": 99, "versions": []}', "[]"]
)
def test_folders_of_results(tmp_path: Path, head: str) -> None:
    (tmp_path / HEAD).write_text(head)
    (tmp_path / "pieces").mkdir()
    (tmp_path / "pieces" / "a.parquet").write_bytes(b"PAR1" + bytes(50) + b"PAR1")
    with pytest.raises(dc.InputError):
        dc.fleet_status(tmp_path)
    with pytest.raises(dc.InputError):
        dc.compare(tmp_path, tmp_path)


def test_names_are_no_markup() -> None:
    script, picture = "<script>alert(1)</script>", "![a](http://b/c.png) <img src=x>"
    parts = [dc.rod(script, 1, 1, along="-y")], [dc.revolute(picture, "ground", script)]
    mechanism = dc.Mechanism(*parts, gravity=(0, -9.81, 0), name=picture)
    found = dc.audit(mechanism, dc.simulate(mechanism, {picture: 0.3}, 0.1, 0.01))
    for report in (found, dc.classify(mechanism, {picture: 0.3})):
        text = report.to_markdown()
        assert "](" not in text
        text += report._repr_html_()
        assert "<script" not in text and "<img" not in text
