"""The pages of the verbs that have their own, and `deltac view`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac import cli
from tests.report.test_page import plots
from tests.support.pages import data_of

WRONG = """
import numpy as np

def rhs(t, q, u):
    return 9.81 * np.sin(q)
"""


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as stop:
        cli.main([str(a) for a in arguments])
    return int(stop.value.code or 0)


def read(path: Path) -> dict[str, Any]:
    return data_of(path.read_text("utf-8"))


def test_wrong_equations_move_beside_the_models(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, page = tmp_path / "eom.py", tmp_path / "page.html"
    source.write_text(WRONG)
    assert run("check", "simple-pendulum", f"{source}:rhs", "--repair", "--report", page) == 1
    assert f"report: {page}" in capsys.readouterr().out
    contents = read(page)
    assert contents["tone"] == "bad"
    moving = contents["scene"]
    assert moving["side_by_side"] and [r["name"] for r in moving["runs"]] == ["the model", "rhs"]
    bodies = len(moving["bodies"])
    right, wrong = (np.reshape(r["poses"], (-1, bodies, 7)) for r in moving["runs"])
    np.testing.assert_array_equal(right[0], wrong[0])
    assert np.abs(right[-1] - wrong[-1]).max() > 0.1
    kinds = [p["kind"] for c in contents["chapters"] for p in c["parts"]]
    assert "code" in kinds and "bars" in kinds  # the diff, and the residuals


def test_the_recommended_setting_is_marked(tmp_path: Path) -> None:
    found = dc.recommend("simple-pendulum", tolerance=1e-6, solvers=("ode4", "ode5"))
    found.report(tmp_path / "page.html", model="simple-pendulum")
    contents = read(tmp_path / "page.html")
    front = next(p for c in contents["chapters"] for p in c["parts"] if p["kind"] == "points")
    (cloud,) = (c for c in front["clouds"] if c["mark"] is not None)
    assert found.best is not None and cloud["name"] == found.best.solver
    assert cloud["y"][cloud["mark"]] == found.best.energy
    assert len(contents["scene"]["runs"]) == 1


def test_view_shows_a_problem_and_a_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert run("view", "simple-pendulum", "--no-open", "--step", "0") == 2
    assert run("view", "simple-pendulum", "--no-open", "--duration", "0") == 2
    assert run("view", "simple-pendulum", "--no-open", "--duration", "1") == 0
    contents = read(tmp_path / "simple-pendulum.html")
    assert contents["tone"] == "plain" and contents["scene"]["runs"][0]["t"][-1] == 1.0
    problem = dc.problems.load("simple-pendulum")
    motion = dc.simulate(problem.mechanism, problem.state, 0.5, 0.01)
    motion.write(tmp_path / "log.csv")
    assert run("view", "simple-pendulum", "log.csv", "--no-open", "--out", "a.html") == 0
    assert len(read(tmp_path / "a.html")["scene"]["runs"][0]["t"]) == len(motion)
    assert run("view", "log.csv", "--no-open", "--out", "b.html") == 0
    alone = read(tmp_path / "b.html")
    assert alone["scene"] is None
    np.testing.assert_allclose(plots(alone)[0]["lines"][0]["y"], motion.q[:, 0], rtol=1e-6)


def test_what_cannot_be_written_is_said_before_the_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("study", "triple-pendulum", "--report", tmp_path / "page.pdf", "--json") == 2
    assert json.loads(capsys.readouterr().out)["error"]["code"] == "E-FILE"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_the_thesis_has_its_figures(tmp_path: Path) -> None:
    from thesis import reproduce

    found = reproduce(["4.7"])
    found.report(tmp_path / "page.html")
    contents = read(tmp_path / "page.html")
    assert contents["chapters"][0]["heading"].startswith("Fig. 4.7")
    assert contents["scene"]["bodies"][1]["name"]
