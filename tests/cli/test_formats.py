"""Forms for other programs: GitHub's annotations, JUnit, SARIF, and several logs in one call."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree

import pytest

import deltac as dc
from deltac.cli.formats import Case, github, junit, sarif
from deltac.errors import LogError
from deltac.results import worst_code
from tests.support.commands import command

WRONG = """\
import numpy as np

g, l = 9.81, 2.0


def rhs(t, q, u):
    return [g / l * np.sin(q[0])]
"""

MODEL = """\
import deltac as dc


def pendulum():
    return dc.Mechanism(
        bodies=[dc.point_mass("bob", 1.0, at=(0.0, "-l", 0.0))],
        joints=[dc.revolute("pin", "ground", "bob")],
        gravity=(0.0, "-g", 0.0),
        parameters={"g": 9.81, "l": 2.0},
    )
"""


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("logs")
    problem = dc.problems.load("simple-pendulum")
    for solver in ("ode1", "ode5"):
        run = dc.simulate(problem.mechanism, problem.state, 0.5, 1e-2, solver, record=())
        run.write(folder / f"{solver}.csv")
    return folder


def test_several_logs_the_worst_decides(
    logs: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(logs)
    status, out, _ = command("audit", "simple-pendulum", "ode5.csv", "ode1.csv", capsys=capsys)
    assert status == 1 and "ode5.csv" in out and "\node1.csv\n" in out
    assert "\node5.csv\n" not in out  # what is consistent is told in a line
    status, out, _ = command(
        "audit", "simple-pendulum", "ode5.csv", "none.csv", "ode1.csv", "--json", capsys=capsys
    )
    told = json.loads(out)
    assert (status, told["exit_code"], told["report"]) == (2, 2, "Audits")
    assert [entry["exit_code"] for entry in told["audits"]] == [0, 2, 1]
    assert told["audits"][1]["error"]["code"] == "E-FILE"


def test_annotations_and_the_summary_of_a_job(
    logs: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(logs)
    summary = tmp_path / "summary.md"
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(summary))
    status, out, _ = command(
        "audit", "simple-pendulum", "ode1.csv", "--format", "github", capsys=capsys
    )
    (line,) = (line for line in out.splitlines() if line.startswith("::"))
    assert status == 1 and line.startswith("::error file=ode1.csv,title=deltac%3A ode1.csv::")
    assert "%25" in line and " % " not in line
    told = summary.read_text("utf-8")
    assert told.startswith("## ode1.csv\n") and "| gravity |" in told


def test_junit_counts_failures_and_errors(logs: Path) -> None:
    good, bad = (dc.audit("simple-pendulum", logs / f"{name}.csv") for name in ("ode5", "ode1"))
    cases = [
        Case("good", "a.csv", good),
        Case("bad", "b.csv", bad),
        Case("unread", "c.csv", LogError("no column \x00 'time'")),
    ]
    root = ElementTree.fromstring(junit("suite", cases).partition("\n")[2])
    assert (root.get("tests"), root.get("failures"), root.get("errors")) == ("3", "1", "1")
    found = [[(child.tag, child.get("type")) for child in case] for case in root.iter("testcase")]
    assert found == [[], [("failure", "integration-error")], [("error", "E-LOG")]]
    codes = [case.exit_code for case in cases]
    assert worst_code(codes) == 2 and worst_code(codes[:2]) == 1 and worst_code([]) == 0
    assert github(cases[2:]).startswith("::error file=c.csv,")


def test_sarif_has_the_line_and_the_edit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("model.py").write_text(MODEL, "utf-8")
    Path("eom.py").write_text(WRONG, "utf-8")
    status, out, _ = command(
        "check", "model.py:pendulum", "eom.py:rhs", "--repair", "--format", "sarif", capsys=capsys
    )
    (run,) = json.loads(out)["runs"]
    (result,) = run["results"]
    assert (status, result["ruleId"]) == (1, "F-WRONG-EXPRESSION")
    place = result["locations"][0]["physicalLocation"]
    assert place == {"artifactLocation": {"uri": "eom.py"}, "region": {"startLine": 7}}
    # the replacement, applied, is the repaired file
    (change,) = result["fixes"][0]["artifactChanges"]
    (edit,) = change["replacements"]
    region, lines = edit["deletedRegion"], WRONG.splitlines(keepends=True)
    new = edit["insertedContent"]["text"]
    repaired = "".join([*lines[: region["startLine"] - 1], new, *lines[region["endLine"] - 1 :]])
    namespace: dict[str, object] = {}
    exec(repaired, namespace)
    assert namespace["rhs"](0.0, [1.0], [0.0])[0] < 0.0  # type: ignore[operator]


def test_sarif_of_an_error_and_of_a_verdict_without_findings(logs: Path) -> None:
    bad = dc.audit("simple-pendulum", logs / "ode1.csv")
    told = sarif([Case("a", "a.csv", LogError("no time")), Case("b", "b.csv", bad)])
    results = told["runs"][0]["results"]
    assert [r["ruleId"] for r in results] == ["E-LOG", "F-VERDICT"]
    assert {r["id"] for r in told["runs"][0]["tool"]["driver"]["rules"]} == {"E-LOG", "F-VERDICT"}
