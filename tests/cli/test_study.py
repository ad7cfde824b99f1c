"""`deltac study`: what it prints, and its exit status."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import deltac as dc
from deltac import cli
from tests.support.commands import command

SHORT = ("triple-pendulum", "--duration", "1")

EQUATIONS = """
import deltac as dc

wrong = dc.problems.load("triple-pendulum", mistake=True).equations


def frozen(t, q, u):
    return 0.0 * u
"""


def run(*arguments: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    status, out, err = command("study", *arguments, capsys=capsys)
    return status, " ".join(out.split()), err


@pytest.fixture
def equations(tmp_path: Path) -> Path:
    path = tmp_path / "equations.py"
    path.write_text(EQUATIONS)
    return path


def test_a_right_run(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = run(*SHORT, "--steps", "4e-3,2e-3,1e-3", "--solver", "ode4", capsys=capsys)
    assert (status, err) == (0, "")
    assert "The error is the integrator's; it falls at order" in out
    assert "Not visible to this test" in out
    assert "step (s)" in out and "|ΔC| wang (J)" in out


def test_a_coarse_run(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run(*SHORT, "--steps", "4e-3,2e-3,1e-3", "--solver", "ode1", capsys=capsys)
    assert status == 1
    assert "integration-error" in out


def test_wrong_equations_as_json_with_a_figure(
    equations: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    figure = tmp_path / "study.png"
    with pytest.raises(SystemExit) as stop:
        cli.main(
            ["study", *SHORT, "--steps", "1e-2,5e-3,2.5e-3", "--equations", f"{equations}:wrong"]
            + ["--figure", str(figure), "--json"]
        )
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert (stop.value.code, err) == (1, "")
    assert found["verdict"] == "equation-error"
    assert found["findings"][0]["element"] == "theta2"
    assert found["observed_order"]["wang"]["trend"] == "tends to a limit"
    assert [row["step"] for row in found["rows"]] == [0.01, 0.005, 0.0025]
    assert figure.read_bytes().startswith(b"\x89PNG")


def test_equations_as_a_function(equations: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run(
        *SHORT, "--steps", "1e-2,5e-3", "--equations", f"{equations}:frozen", capsys=capsys
    )
    assert status == 1
    assert "equation-error" in out


def test_logs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    problem = dc.problems.load("triple-pendulum")
    options = []
    for k, h in enumerate((4e-3, 2e-3, 1e-3)):
        path = tmp_path / f"{k}.csv"
        dc.simulate(problem.mechanism, problem.state, 1.0, h, "ode1", record=()).write(path)
        options += ["--logs", str(path)]
    status, out, _ = run("triple-pendulum", *options, capsys=capsys)
    assert status == 1
    assert "integration-error" in out and "(nominal order 1)" in out


def test_unresolved(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    model = tmp_path / "still.py"
    model.write_text(
        "import deltac as dc\n"
        "def still():\n"
        "    return dc.Mechanism([dc.point_mass('b', 1.0)],\n"
        "        [dc.prismatic('x', 'ground', 'b', 'x', stiffness=1.0)], gravity=[0, 0, 0])\n"
    )
    status, out, _ = run(
        f"{model}:still", "--duration", "1", "--steps", "0.1,0.05,0.025", capsys=capsys
    )
    assert status == 3
    assert "The runs do not decide: hardly anything moves" in out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--steps", "a,b"), "expected numbers with commas"),
        (("--steps", "1e-2", "--solver", "mujoco:rk4"), "MuJoCo cannot read"),
        (("--steps", "0.013"), "does not divide the duration"),
        (("--steps", "1e-2", "--equations", "x"), "expected FILE.py:FUNCTION"),
        (("--steps", "1e-2", "--figure", "x.gif"), "written as .pdf or .svg"),
        (("--steps", "1e-2", "--tolerance", "7"), "between 0 and 1"),
    ],
)
def test_bad_input(
    arguments: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    status, _, err = run(*SHORT, *arguments, capsys=capsys)
    assert status == 2
    assert said in err
