"""What ends an audit early leaves its answer: with each shortcut blocked, the long way says the same."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import deltac as dc
from deltac.diagnosis.explain import by_integrator
from deltac.diagnosis.measurements import kinematics
from deltac.diagnosis.residuals import schemes

SHORTCUTS: dict[str, tuple[object, str, object]] = {
    "columns that a scheme moves": (kinematics, "_of_a_scheme", lambda *_: []),
    "integrators ruled out by a few steps": (schemes, "EVERY", 10**6),
    "mistakes below the digits": (by_integrator, "_below_digits", lambda *_: False),
}


def log(solver: str, step: float = 5e-3, heavier: float = 1.0) -> dc.Trajectory:
    problem = dc.problems.load("double-pendulum")
    mechanism = problem.mechanism.with_parameters(
        m2=heavier * problem.mechanism.number(problem.mechanism.parameters["m2"])
    )
    run = dc.simulate(mechanism, problem.state, 2.0, step, solver)
    return dc.Trajectory(t=run.t, q=run.q, u=run.u, coordinates=run.coordinates, speeds=run.speeds)


def rounded(run: dc.Trajectory) -> dc.Trajectory:
    """As GPUs write it."""
    return replace(
        run, q=run.q.astype(np.float32).astype(float), u=run.u.astype(np.float32).astype(float)
    )


LOGS: dict[str, Callable[[], dc.Trajectory]] = {
    "semi-implicit": lambda: log("semi-implicit-euler"),
    "rk4": lambda: log("ode4"),
    "single precision": lambda: rounded(log("semi-implicit-euler")),
    "wrong mass": lambda: log("semi-implicit-euler", heavier=1.2),
    "wrong mass in single precision": lambda: rounded(log("semi-implicit-euler", heavier=1.2)),
}


@pytest.fixture(scope="module")
def logs() -> dict[str, dc.Trajectory]:
    return {name: made() for name, made in LOGS.items()}


def told(run: dc.Trajectory) -> tuple[object, ...]:
    found = dc.audit("double-pendulum", run)
    scheme = None if found.step is None else found.step.scheme
    name = None if scheme is None else (scheme.name, scheme.among, scheme.forces)
    causes = [(f.kind, f.element, f.weight) for f in found.findings]
    return found.verdict.kind, found.verdict.confidence, causes, name, found.relative


@pytest.mark.parametrize(
    "kind", [pytest.param(k, marks=[pytest.mark.slow] * k.startswith("wrong")) for k in LOGS]
)
def test_the_long_way_says_the_same(
    kind: str, logs: dict[str, dc.Trajectory], monkeypatch: pytest.MonkeyPatch
) -> None:
    short = told(logs[kind])
    for where, name, blocked in SHORTCUTS.values():
        with monkeypatch.context() as patch:
            patch.setattr(where, name, blocked)
            assert told(logs[kind]) == short
    expected = "equation-error" if kind.startswith("wrong") else ("integration-error", "consistent")
    assert short[0] in expected


def test_the_comparison_of_a_scheme_is_that_of_splines(
    logs: dict[str, dc.Trajectory], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Semi-implicit Euler moves q by the speed after: half a row late, and by nothing else."""
    mechanism = dc.problems.load("double-pendulum").mechanism
    short = kinematics.coordinates_against_speeds(mechanism, logs["semi-implicit"])
    monkeypatch.setattr(kinematics, "_of_a_scheme", lambda *_: [])
    long = kinematics.coordinates_against_speeds(mechanism, logs["semi-implicit"])
    assert short.keys() == long.keys() and len(short) == 2
    for name, own in short.items():
        other = long[name]
        assert own.late == 0.5 and other.late == pytest.approx(0.5, abs=1e-6)
        assert own.ratio == 1.0 and other.ratio == pytest.approx(1.0, abs=1e-8)
        assert own.instant == other.instant and not own.scaled and not other.scaled
        assert own.off < kinematics.EXACT and not other.outliers.any()
