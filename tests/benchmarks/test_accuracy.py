"""SciPy runs unhindered in the contest of reference accuracy."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import pytest

import deltac as dc

pytest.importorskip("peers", reason="the benchmarks are not part of an installed package")

DURATION = 2.0


@pytest.mark.heyoka
def test_scipy_is_right_in_between_and_does_not_toil() -> None:
    """A derivative that changes under SciPy's hands costs it four times the evaluations, and its angles.

    The reference takes steps of a fixed length. An undisturbed DOP853 takes 12 evaluations a step, 15 where
    a whole second is interpolated, and refuses few steps at such a tolerance.
    """
    accuracy = import_module("accuracy_run")
    problem = dc.problems.load("triple-pendulum")
    found = accuracy.Rival(problem).run(DURATION)
    exact = dc.simulate(problem.mechanism, problem.state, DURATION, 2.5e-4, "ode8", ("wang",))
    seconds = np.searchsorted(exact.t, found.t - 1e-9)
    assert len(found.t) == 3
    assert np.abs(found.y[:3].T - exact.q[seconds]).max() < accuracy.APART
    assert np.abs(found.y[6] - exact.integrals["wang"][seconds]).max() < 1e-10
    assert found.nfev < 8000 * DURATION
