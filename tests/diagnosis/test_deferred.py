"""Deferred correction of logs, against exact motions; and where it is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import deltac as dc
from deltac.problems.problem import Problem
from tests.support.slow import repeated

pytestmark = pytest.mark.case_study(
    "test_what_the_noise_of_the_first_row_makes_of_the_motion_is_told[1e-08]",
    "test_an_error_that_is_not_seen_is_not_corrected[0.0]",
)


def log_of(problem: Problem, solver: str, duration: float, step: float) -> dc.Trajectory:
    """A run as another program would log it: t, q and u alone."""
    run = dc.simulate(problem, None, duration, step, solver)
    return replace(run, udot=None, forces={}, works={}, integrals={})


CASES = [
    ("double-pendulum", "semi-implicit-euler", 0.6, 2e-3),
    ("simple-pendulum", "ode1be", 1.0, 4e-3),
    ("torque-free-box", "ode2", 1.0, 4e-3),
    ("rolling-disc", "implicit-midpoint", 0.8, 4e-3),
]


@pytest.mark.parametrize("case", repeated(CASES, *CASES[1:3]))
def test_a_corrected_log_is_the_exact_motion(case: tuple[str, str, float, float]) -> None:
    """Of ode8 in a quarter of the step; and far better than the solver itself at a 64th of the step."""
    name, solver, duration, step = case
    problem = dc.problems.load(name)
    log = log_of(problem, solver, duration, step)
    exact = dc.simulate(problem, None, duration, step / 4, "ode8", dc.Record([], every=4))
    correction = dc.correct_trajectory(problem, log)
    assert len(correction.run) == len(log)
    error, corrected = (np.abs(r.q - exact.q).max() for r in (log, correction.run))
    finer = dc.simulate(problem, None, duration, step / 64, solver, dc.Record([], every=64))
    assert corrected < 0.1 * np.abs(finer.q - exact.q).max()
    assert corrected < 1e-6 * error
    assert corrected <= correction.remaining.max() < 1e-6
    assert np.abs(correction.log_error).max() >= 0.5 * error
    assert correction.delta_c < 1e-4 * correction.log_delta_c or correction.delta_c < 1e-9


def test_wrong_equations_are_not_corrected_away() -> None:
    wrong = dc.problems.load("triple-pendulum", mistake=True)
    run = dc.simulate(wrong, duration=1.0, step=2e-3, equations=wrong.equations)
    log = replace(run, udot=None, forces={}, works={}, integrals={})
    with pytest.raises(dc.InputError, match="contradicts the equations"):
        dc.correct_trajectory("triple-pendulum", log)


def test_a_motion_that_cannot_be_followed_is_cut_or_refused() -> None:
    """A heavy top that spins fast, by a method of first order: its log has nothing to do with the motion."""
    top = dc.problems.load("heavy-top")
    log = log_of(top, "ode1be", 1.0, 4e-3)
    try:
        correction = dc.correct_trajectory(top, log)
    except dc.InputError as error:
        assert "correct_trajectory" in str(error)
    else:
        count = len(correction.run)
        assert count < len(log)
        exact = dc.simulate(top, None, 1.0, 1e-3, "ode8", dc.Record([], every=4))
        off = np.abs(correction.run.q - exact.q[:count]).max()
        assert off <= 10.0 * correction.remaining.max() + 1e-6


@pytest.mark.parametrize("noise", [1e-8, 1e-6, 1e-4])
def test_what_the_noise_of_the_first_row_makes_of_the_motion_is_told(noise: float) -> None:
    pendulum = dc.problems.load("double-pendulum")
    log = log_of(pendulum, "semi-implicit-euler", 0.6, 2e-3)
    exact = dc.simulate(pendulum, None, 0.6, 5e-4, "ode8", dc.Record([], every=4))
    rng = np.random.default_rng(3)
    q, u = (
        x + size * rng.standard_normal(x.shape) for x, size in ((log.q, noise), (log.u, 10 * noise))
    )
    correction = dc.correct_trajectory(pendulum, replace(log, q=q, u=u))
    n = pendulum.mechanism.coordinates
    left = np.abs(correction.run.q - exact.q).max(axis=0)
    assert np.all(left <= correction.remaining[: len(n)])
    assert correction.remaining.max() < 500.0 * noise
    assert left.max() < 0.2 * np.abs(log.q - exact.q).max()


@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_an_error_that_is_not_seen_is_not_corrected(noise: float) -> None:
    """ode8 leaves less than the digits of the rows, and less than their noise: the log is as good."""
    pendulum = dc.problems.load("double-pendulum")
    log = log_of(pendulum, "ode8", 0.6, 2e-3)
    rng = np.random.default_rng(4)
    q, u = (
        x + size * rng.standard_normal(x.shape) for x, size in ((log.q, noise), (log.u, 10 * noise))
    )
    with pytest.raises(dc.InputError, match="not seen"):
        dc.correct_trajectory(pendulum, replace(log, q=q, u=u))
