"""Constraints and prescribed joints of logs: ratios are told from drift, digits are no departure."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac import Trajectory

DISC: dict[str, Any] = {"mass": 1.0, "inertia": (0.1, 0.1, 0.1)}


def geared(ratio: float) -> dc.Mechanism:
    return dc.Mechanism(
        bodies=[dc.body("first", **DISC), dc.body("second", **DISC)],
        joints=[
            dc.revolute("a", "ground", "first", "z"),
            dc.revolute("b", "ground", "second", "z"),
        ],
        constraints=[dc.constraints.gear("gear", "a", "b", ratio)],
    )


def turning(ratio: float, rows: int = 100) -> Trajectory:
    """Both discs swing, b as sin t, a as ratio times that."""
    t = np.linspace(0.0, 4.0, rows)
    b, v = np.sin(t), np.cos(t)
    return Trajectory(
        t=t,
        q=np.column_stack([ratio * b, b]),
        u=np.column_stack([ratio * v, v]),
        coordinates=("a", "b"),
        speeds=("a", "b"),
        provenance=dc.Provenance("someone's"),
    )


def test_a_wrong_ratio_is_no_drift() -> None:
    kinds = {f.kind for f in dc.audit(geared(12.0), turning(11.8)).findings}
    assert "constraint-violation" in kinds and "constraint-drift" not in kinds
    kinds = {f.kind for f in dc.audit(geared(11.8), turning(11.8)).findings}
    assert not kinds & {"constraint-violation", "constraint-drift"}


@pytest.mark.parametrize("decimals", [2, 3, 4])
def test_prescribed_joints_in_logs_of_few_decimals(decimals: int) -> None:
    """Half a digit is no departure from a law; the pivot moves by 1 cm."""
    mechanism = dc.Mechanism(
        bodies=[dc.body("pivot", **DISC), dc.body("rod", **DISC, mass_centre=(0.3, 0, 0))],
        joints=[
            dc.prismatic("slide", "ground", "pivot", "x", motion="0.01*sin(3*t)"),
            dc.revolute("hinge", "pivot", "rod", "y"),
        ],
        gravity=(0, 0, -9.81),
    )
    run = dc.simulate(mechanism, mechanism.state(), duration=1.5, step=1e-3, solver="ode4")
    log = Trajectory(
        t=run.t,
        q=np.round(run.q, decimals),
        u=np.round(run.u, decimals),
        coordinates=run.coordinates,
        speeds=run.speeds,
        provenance=dc.Provenance("someone's"),
    )
    found = dc.audit(mechanism, log)
    assert found.verdict.kind != "equation-error", found.verdict.explain()
    assert not [f for f in found.findings if f.weight == "cause"]


@pytest.mark.slow
def test_a_log_at_rest_of_rods_that_have_no_inertia_about_other_axes() -> None:
    """No scheme leaves anything then, and the model with another axis of a joint cannot be evaluated."""
    problem = dc.problems.load("n-four-bar")
    run = dc.simulate(problem.mechanism, problem.state, 0.8, 0.004, "ode4")
    q = np.repeat(run.q[:1], len(run), axis=0)
    log = Trajectory(t=run.t, q=q, u=0.0 * run.u, coordinates=run.coordinates, speeds=run.speeds)
    assert dc.audit(problem, log).verdict.kind in ("equation-error", "unresolved")
