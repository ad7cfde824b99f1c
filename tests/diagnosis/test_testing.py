"""`deltac.testing`: the assertion and the pytest plugin."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import entry_points
from pathlib import Path

import pytest

import deltac as dc
from deltac.testing import assert_balanced
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
    message = str(failure.value)
    assert "integration-error" in message
    assert "The step was 0.01 s" in message
    assert "gravity" in message  # the table


def test_what_cannot_be_judged_does_not_pass(run: dc.Trajectory) -> None:
    few = replace(run.every(10), works={}, integrals={}, udot=None)
    with pytest.raises(AssertionError, match="unresolved"):
        assert_balanced("simple-pendulum", few, tolerance=1e-9)


def test_the_fixture_notes_the_error(
    balanced: Callable[..., dc.Audit], run: dc.Trajectory, request: pytest.FixtureRequest
) -> None:
    found = balanced("simple-pendulum", run)
    assert dict(request.node.user_properties)["deltac_relative_energy_error"] == found.relative


def test_the_plugin_in_someone_elses_suite(
    pytester: pytest.Pytester, run: dc.Trajectory, tmp_path: Path
) -> None:
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
    outcome = pytester.runpytest_subprocess(*(() if installed else ("-p", "deltac.testing.plugin")))
    outcome.assert_outcomes(passed=1, failed=1)
    outcome.stdout.fnmatch_lines(["*energy balance does not hold*"])
