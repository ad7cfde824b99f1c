"""The command line: what it prints and where, and its exit status."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from deltac import __version__, cli, problems
from deltac.errors import InputError
from deltac.problems import simple_pendulum
from tests.support.commands import command as run


def test_version_and_help_by_typers_runner() -> None:
    runner = CliRunner()
    version = runner.invoke(cli.application(), ["--version"])
    assert (version.exit_code, version.output) == (0, f"deltac {__version__}\n")
    shown = runner.invoke(cli.application(), ["--help"])
    assert shown.exit_code == 0
    for name in ("problems", "cache"):
        assert name in shown.output


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["bogus"], "bogus"),
        (["cache", "--bogus"], "--bogus"),
        (["problems", "tripel-pendulum"], "triple-pendulum"),
        (["problems", "n-four-bar", "--set", "m=4"], "no option 'm'; known: n"),
        (["problems", "n-four-bar", "--set", "4"], "--set n=40"),
    ],
)
def test_bad_input_is_status_2_with_a_message_on_stderr(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    status, out, err = run(*arguments, capsys=capsys)
    assert (status, out) == (2, "")
    assert said in err
    assert "Traceback" not in err


def test_an_unexpected_error_is_status_70_and_asks_for_a_report(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise RuntimeError("the impossible happened")

    monkeypatch.setattr(problems, "names", broken)
    monkeypatch.delenv("DELTAC_DEBUG", raising=False)
    status, out, err = run("problems", capsys=capsys)
    assert (status, out) == (70, "")
    assert "the impossible happened" in err and "report" in err
    assert "Traceback" not in err
    monkeypatch.setenv("DELTAC_DEBUG", "1")
    status, _, err = run("problems", capsys=capsys)
    assert status == 70 and "Traceback" in err


def test_interrupting_is_neither_success_nor_an_internal_error(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(problems, "names", interrupted)
    status, out, _ = run("problems", capsys=capsys)
    assert (status, out) == (130, "")


# --- problems, cache ------------------------------------------------------------------------------


def test_problems_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run("problems", capsys=capsys)
    assert status == 0
    assert all(name in out for name in problems.names())
    assert max(map(len, out.splitlines())) <= 100
    status, out, _ = run("problems", "--json", capsys=capsys)
    listed = {entry["name"]: entry for entry in json.loads(out)["problems"]}
    assert status == 0 and tuple(sorted(listed)) == problems.names()
    assert listed["triple-pendulum"]["dof"] == 3
    assert listed["driven-triple-pendulum"]["dof"] == 2
    assert listed["triple-pendulum"]["conserved"] == ["energy"]


def test_a_variant_of_a_problem_is_chosen(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run("problems", "n-four-bar", "--set", "n=1", "--json", capsys=capsys)
    told = json.loads(out)
    assert status == 0
    assert told["title"].startswith("1 four-bars")
    drift = next(r for r in told["reference"] if r["quantity"] == "largest energy error")
    assert drift["measured"] < 1e-3  # the community's threshold, J


def test_a_problem_is_compared_with_its_references(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run("problems", "simple-pendulum", "--json", capsys=capsys)
    found = json.loads(out)
    assert status == 0
    assert all(entry["agrees"] for entry in found["reference"])
    status, out, _ = run("problems", "simple-pendulum", capsys=capsys)
    assert status == 0 and "2.367841948" in out


def test_a_reference_that_is_not_met_is_status_1(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(simple_pendulum.POSITIONS, 1.0, (0.9, -0.2))
    status, out, _ = run("problems", "simple-pendulum", capsys=capsys)
    assert status == 1 and "NO" in out


def test_cache_is_shown_and_cleared(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    cleared: list[bool] = []
    monkeypatch.setattr("deltac.kernels.cache.clear_cache", lambda: cleared.append(True))
    monkeypatch.setenv("DELTAC_CACHE_DIR", str(tmp_path))
    status, out, _ = run("cache", "--json", capsys=capsys)
    assert status == 0
    info = json.loads(out)
    assert info["path"] == str(tmp_path) and info["size_bytes"] == 0
    assert not cleared
    status, out, _ = run("cache", "--clear", capsys=capsys)
    assert status == 0 and cleared == [True]
    assert str(tmp_path) in out


def test_a_wrong_setting_is_bad_input(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DELTAC_CACHE", "maybe")
    status, out, err = run("cache", capsys=capsys)
    assert (status, out) == (2, "")
    assert "DELTAC_CACHE" in err
    with pytest.raises(InputError):  # what the command raises, main() reports
        CliRunner().invoke(cli.application(), ["cache"], catch_exceptions=False)


def test_the_module_in_a_process_of_its_own() -> None:
    code = "from deltac.cli import main; main()"
    good = subprocess.run(
        [sys.executable, "-c", code, "--version"], capture_output=True, text=True, check=False
    )
    assert (good.returncode, good.stdout, good.stderr) == (0, f"deltac {__version__}\n", "")
    bad = subprocess.run(
        [sys.executable, "-c", code, "problems", "no-such"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (bad.returncode, bad.stdout) == (2, "")
    assert "no-such" in bad.stderr


def test_the_package_runs_as_a_module() -> None:
    found = subprocess.run(
        [sys.executable, "-m", "deltac", "--version"], capture_output=True, text=True, check=False
    )
    assert (found.returncode, found.stdout) == (0, f"deltac {__version__}\n")


def test_models_are_completed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the shells' own protocol: problems, files of models, folders on the way; no other files."""
    monkeypatch.chdir(tmp_path)
    for name in ("tri.urdf", "tri.csv"):
        (tmp_path / name).touch()
    (tmp_path / "tricycle").mkdir()
    environment = os.environ | {
        "_DELTAC_COMPLETE": "complete_bash",
        "COMP_WORDS": "deltac audit tri",
        "COMP_CWORD": "2",
    }
    told = subprocess.run(
        [Path(sys.executable).with_name("deltac")],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert told.stdout.split() == ["triple-pendulum", "tri.urdf", "tricycle/"]
