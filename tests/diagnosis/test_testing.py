"""`deltac.testing`: the assertion and the pytest plugin."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import pytest

import deltac as dc
from deltac.testing import assert_balanced, assert_converges, assert_equations
from deltac.testing.plugin import balanced as balanced

pytest_plugins = ["pytester"]


@pytest.fixture(scope="module")
def run() -> dc.Trajectory:
    problem = dc.problems.load("simple-pendulum")
    return dc.simulate(problem.mechanism, problem.state, duration=0.5, step=1e-2, solver="ode4")


def test_a_balanced_run_passes_and_returns_its_audit(run: dc.Trajectory) -> None:
    assert assert_balanced("simple-pendulum", run).verdict.kind == "consistent"


def test_the_message_says_what_is_wrong(run: dc.Trajectory) -> None:
    problem = dc.problems.load("simple-pendulum")
    coarse = dc.simulate(problem.mechanism, problem.state, duration=0.5, step=1e-2, solver="ode1")
    with pytest.raises(AssertionError) as failure:
        assert_balanced(problem, coarse)
    first, _, rest = str(failure.value).partition("\n")
    assert re.match(r"integration-error: \|ΔC\| [0-9.]+ % > 0\.1 % of the ", first)
    assert "gravity" in rest  # the table


def test_what_cannot_be_judged_does_not_pass(run: dc.Trajectory) -> None:
    few = replace(run.every(10), works={}, integrals={}, udot=None)
    with pytest.raises(AssertionError, match="unresolved"):
        assert_balanced("simple-pendulum", few, tolerance=1e-9)


def test_the_fixture_notes_the_error(
    balanced: Callable[..., dc.Audit], run: dc.Trajectory, request: pytest.FixtureRequest
) -> None:
    found = balanced("simple-pendulum", run)
    assert dict(request.node.user_properties)["deltac_relative_energy_error"] == found.relative


@pytest.mark.long
def test_the_plugin_in_someone_elses_suite(
    pytester: pytest.Pytester,
    run: dc.Trajectory,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Warnings are errors, and the report is of the family xunit2, which has no properties of its own."""
    monkeypatch.setenv("DELTAC_CACHE_DIR", str(tmp_path / "kernels"))
    run.write(tmp_path / "run.parquet")
    pytester.makepyfile(
        f"""
        def test_good(balanced):
            balanced("simple-pendulum", {str(tmp_path / "run.parquet")!r})
        def test_bad(balanced):
            balanced("simple-pendulum", {str(tmp_path / "run.parquet")!r}, tolerance=1e-16)
        """
    )
    installed = any(e.name == "deltac" for e in entry_points(group="pytest11"))
    loaded = () if installed else ("-p", "deltac.testing.plugin")
    report = tmp_path / "report.xml"
    strict = ("-W", "error", "-o", "junit_family=xunit2", f"--junitxml={report}")
    outcome = pytester.runpytest_subprocess(*loaded, *strict)
    outcome.assert_outcomes(passed=1, failed=1)
    outcome.stdout.fnmatch_lines(
        ["E * integration-error: |*", "FAILED *test_bad - AssertionError: *"]
    )
    outcome.stdout.no_fnmatch_line("*_passing*")  # only the test's own line is shown
    assert "deltac_relative_energy_error" in report.read_text("utf-8")


@pytest.mark.long
def test_an_error_about_an_input_shows_the_lines_of_the_user_alone(
    pytester: pytest.Pytester, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DELTAC_CACHE_DIR", str(tmp_path / "kernels"))
    pytester.makepyfile(
        """
        import deltac as dc
        def too_few(t, q, u):
            return q[7]
        def test_a_name():
            dc.simulate("double-pendulum", None, 1.0, 0.01, "ode66")
        def test_a_function():
            dc.check_equations("double-pendulum", too_few)
        """
    )
    installed = any(e.name == "deltac" for e in entry_points(group="pytest11"))
    loaded = () if installed else ("-p", "deltac.testing.plugin")
    outcome = pytester.runpytest_subprocess(*loaded)
    outcome.assert_outcomes(failed=2)
    outcome.stdout.fnmatch_lines(["E *unknown solver 'ode66'*", ">*return q*7*", "E *SourceError*"])
    for ours in ("*site-packages*", "*contextlib*", "*src/deltac*", "*refuse_misfits*"):
        outcome.stdout.no_fnmatch_line(ours)
    full = pytester.runpytest_subprocess(*loaded, "--full-trace", "-k", "name")
    full.stdout.fnmatch_lines(["*def find_solver*"])


def test_equations_are_asserted() -> None:
    problem = dc.problems.load("triple-pendulum")
    assert problem.equations is not None
    assert assert_equations(problem, problem.equations).exit_code == 0
    mistaken = dc.problems.load("triple-pendulum", mistake=True).equations
    with pytest.raises(AssertionError, match="^equation-error: the residual is .* > 1.5e-8 of an"):
        assert_equations(problem, mistaken)  # type: ignore[arg-type]


def test_convergence_is_asserted() -> None:
    steps = (0.02, 0.01, 0.005)
    options: dict[str, Any] = {"duration": 0.5, "solver": "ode4"}
    found = assert_converges("simple-pendulum", steps, order=4, **options)
    assert found.relative < 1e-6
    with pytest.raises(AssertionError, match="^integration-error: "):
        assert_converges("simple-pendulum", steps, tolerance=1e-12, **options)
    with pytest.raises(AssertionError, match="expected order 6"):
        assert_converges("simple-pendulum", steps, order=6, **options)
