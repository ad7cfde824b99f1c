"""Several logs of one machine: what none of them shows alone is certain from all, and no more.

The motions are solved by SciPy from the textbook's equation of a damped pendulum, to far below their noise.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import deltac as dc
from deltac.diagnosis.explain.result import Cause, Explanation
from deltac.diagnosis.inference.hypotheses import CERTAIN
from deltac.errors import LogError

pytestmark = pytest.mark.case_study(
    "test_an_empty_list_is_no_log",
)

DAMPING, NOISE = 0.05, 1e-3


def pendulum(damping: float = DAMPING) -> dc.Mechanism:
    """1.3 kg at 0.7 m, as a point."""
    return dc.Mechanism(
        [dc.body("bob", 1.3, (0, 0, 0), (0, -0.7, 0))],
        [dc.revolute("pivot", "ground", "bob", damping=damping)],
        gravity=(0, -9.81, 0),
    )


def log(damping: float, seed: int) -> dc.Trajectory:
    """Two seconds from a random state, with noise in angle and speed."""
    rng = np.random.default_rng(seed)

    def rates(t: float, y: Any) -> list[float]:
        return [y[1], -9.81 / 0.7 * np.sin(y[0]) - damping / (1.3 * 0.7**2) * y[1]]

    t = np.arange(401) * 5e-3
    start = [rng.uniform(0.3, 1.2), rng.uniform(-1.0, 1.0)]
    y = solve_ivp(rates, (0.0, 2.0), start, t_eval=t, rtol=1e-11, atol=1e-12).y
    y = y + NOISE * rng.standard_normal(y.shape)
    return dc.Trajectory(
        t=t, q=y[:1].T, u=y[1:].T, coordinates=("pivot",), speeds=("pivot",),  # type: ignore[arg-type]
        provenance=dc.Provenance("SciPy"),
    )  # fmt: skip


def damping_of(explanation: Explanation) -> Cause:
    """The damping among causes that explain the same: a heavier bob swings as one with less of it."""
    sets = (explanation.causes, *explanation.alternatives)
    (cause,) = next(causes for causes in sets if causes[0].kind == "damping")
    return cause


def test_a_damping_that_no_log_shows_alone_is_certain_from_all() -> None:
    logs = [log(0.05015, seed) for seed in range(8)]
    alone = [dc.explain_residual(pendulum(), one) for one in logs[:3]]
    assert not any(one.causes for one in alone)
    together = dc.explain_residual(pendulum(), logs)
    assert together.causes[0].log_odds > CERTAIN
    assert {len(logs) * one.samples for one in alone} == {together.samples}  # all are as long
    cause = damping_of(together)
    assert cause.size == pytest.approx(0.05015, abs=3.0 * cause.size_error)
    assert 0.0 < cause.size_error < 5e-5  # beside what is wrong, 1.5e-4


@pytest.mark.slow
def test_the_error_of_a_number_falls_with_the_root_of_the_logs() -> None:
    logs = [log(0.052, seed) for seed in range(8)]
    two, eight = (damping_of(dc.explain_residual(pendulum(), logs[:n])) for n in (2, 8))
    assert 1.3 < two.size_error / eight.size_error < 3.0
    assert eight.size == pytest.approx(0.052, abs=3.0 * eight.size_error)


def test_right_logs_together_have_no_cause() -> None:
    together = dc.explain_residual(pendulum(), [log(DAMPING, seed) for seed in range(10, 16)])
    assert together.kind == "nothing" and together.exit_code == 0


def test_an_empty_list_is_no_log() -> None:
    with pytest.raises(LogError, match="empty"):
        dc.explain_residual(pendulum(), [])


def test_the_steps_of_a_study_share_what_is_wrong() -> None:
    """Semi-implicit Euler by hand, at three steps, of a pendulum with more damping than the model's."""

    def run(step: float) -> dc.Trajectory:
        t = np.arange(round(1.0 / step) + 1) * step
        y = np.empty((len(t), 2))
        y[0] = 1.1, 0.4
        for k in range(len(t) - 1):
            q, u = y[k]
            u += step * (-9.81 / 0.7 * np.sin(q) - 0.07 / (1.3 * 0.7**2) * u)
            y[k + 1] = q + step * u, u
        return dc.Trajectory(
            t=t, q=y[:, :1], u=y[:, 1:], coordinates=("pivot",), speeds=("pivot",),  # type: ignore[arg-type]
            provenance=dc.Provenance("by hand", step=step),
        )  # fmt: skip

    study = dc.study(pendulum(), runs=run, steps=[8e-3, 4e-3, 2e-3], order=1)
    (cause,) = study.explanation().causes
    equal = {"damping": 0.07, "body-inertia": DAMPING / 0.07}
    assert cause.size == pytest.approx(equal[cause.kind], rel=1e-4)
