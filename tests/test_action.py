"""The GitHub Action's script: what its inputs become, its outputs, pages and exit codes."""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
import yaml

import deltac as dc

ROOT = Path(__file__).parents[1]
ACTION = yaml.safe_load((ROOT / "action.yml").read_text("utf-8"))

pytestmark = pytest.mark.skipif(
    sys.platform == "win32" or shutil.which("bash") is None, reason="the action runs in bash"
)


@dataclass(frozen=True)
class Outcome:
    """A run of the script: its exit code, what it printed, its outputs."""

    code: int
    printed: str
    outputs: dict[str, str]


def run(folder: Path, **inputs: str) -> Outcome:
    """The script, with the inputs as action.yml hands them over."""
    script = folder / "bin" / "deltac"
    script.parent.mkdir(exist_ok=True)
    script.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m deltac "$@"\n')
    script.chmod(script.stat().st_mode | stat.S_IXUSR)
    step = next(step for step in ACTION["runs"]["steps"] if step.get("id") == "judge")
    known = {name: value.split()[1].split(".")[1] for name, value in step["env"].items()}
    values = {
        name: inputs.get(source, str(ACTION["inputs"][source].get("default", "")))
        for name, source in known.items()
    }
    output = folder / "output"
    output.write_text("")
    environment = {
        **os.environ,
        **values,
        "PATH": f"{script.parent}:{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT / "src"),
        "GITHUB_OUTPUT": str(output),
        "TMPDIR": str(folder),
    }
    environment.pop("GITHUB_STEP_SUMMARY", None)
    done = subprocess.run(
        ["bash", str(ROOT / ".ci" / "action")],
        cwd=folder, env=environment, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    lines = output.read_text("utf-8").splitlines()
    return Outcome(
        done.returncode, done.stdout + done.stderr, dict(line.split("=", 1) for line in lines)
    )


@pytest.mark.long
def test_logs_with_blanks_in_their_names_are_judged_each_with_a_page(tmp_path: Path) -> None:
    logs = tmp_path / "my logs"
    logs.mkdir()
    problem = dc.problems.load("simple-pendulum")
    for name, solver in (("good run", "ode5"), ("coarse run", "ode1")):
        motion = dc.simulate(problem, duration=1.0, step=0.01, solver=solver)
        motion.write(logs / f"{name}.csv")
    found = run(tmp_path, model="simple-pendulum", logs="my logs/*.csv\n", options="--strict\n")
    assert found.code == 1, found.printed
    assert found.outputs["exit-code"] == "1"
    assert found.outputs["verdict"] == "integration-error"
    pages = {page.name for page in (tmp_path / "deltac-report").iterdir()}
    assert pages == {"my-logs-good-run.csv.html", "my-logs-coarse-run.csv.html"}
    assert "::error file=my logs/coarse run.csv" in found.printed
    assert "::notice file=my logs/good run.csv" in found.printed


@pytest.mark.long
def test_equations_are_checked_and_no_input_is_run(tmp_path: Path) -> None:
    (tmp_path / "eom.py").write_text(
        "import numpy as np\n\ndef rhs(t, q, u):\n    return 9.81 * np.sin(q)\n"
    )
    found = run(tmp_path, command="check", model="simple-pendulum", equations="eom.py:rhs")
    assert (found.code, found.outputs["verdict"]) == (1, "equation-error"), found.printed
    assert found.outputs["findings"].startswith("F-")
    odd = run(tmp_path, command="audit", model="simple-pendulum", logs="$(touch planted); x.csv")
    assert odd.code == 2 and odd.outputs == {"exit-code": "2"}
    assert not (tmp_path / "planted").exists()


def test_a_study_and_what_is_missing(tmp_path: Path) -> None:
    study = run(
        tmp_path, command="study", model="simple-pendulum", steps="0.02,0.01,0.005",
        options="--duration=1\n--solver=ode4", tolerance="1e-4", report="",
    )  # fmt: skip
    assert (study.code, study.outputs["verdict"]) == (0, "consistent"), study.printed
    assert run(tmp_path, model="simple-pendulum").code == 2
    assert "expected audit, check or study" in run(tmp_path, command="tset", model="m").printed


def test_every_input_and_output_is_documented() -> None:
    page = (ROOT / "docs" / "ci.md").read_text("utf-8")
    assert "](../action.yml)" in page  # of which the site makes a table
    entries = [*ACTION["inputs"].values(), *ACTION["outputs"].values()]
    assert all(entry["description"].strip() for entry in entries)
