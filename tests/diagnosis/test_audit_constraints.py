"""Constraints and prescribed joints of logs: ratios are told from drift, digits are no departure."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac import Trajectory
from deltac.arrays import Array
from deltac.diagnosis.inference.model import LogModel, Rows

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


@pytest.mark.long
def test_a_wrong_ratio_is_no_drift() -> None:
    kinds = {f.kind for f in dc.audit(geared(12.0), turning(11.8)).findings}
    assert "constraint-violation" in kinds and "constraint-drift" not in kinds
    kinds = {f.kind for f in dc.audit(geared(11.8), turning(11.8)).findings}
    assert not kinds & {"constraint-violation", "constraint-drift"}


MASSES, LENGTH, G = np.array([1.5, 1.0]), 0.8, 9.81
"""A bead on a massless rod, in a carriage: kg along x and along y; m; m/s²."""


def on_a_rod(by_masses: bool, steps: int = 600, h: float = 4e-3) -> Trajectory:
    """The bead by semi-implicit Euler, put back onto the circle after each step.

    To the nearest point, as by a pseudoinverse, or to that which is nearest by the masses as metric.
    """
    q, u = np.array([0.6, -np.sqrt(LENGTH**2 - 0.36)]), np.zeros(2)
    rows, weight = [np.concatenate([q, u])], np.array([0.0, -MASSES[1] * G])

    def back(q: Array) -> Array:
        along = q / MASSES if by_masses else q
        return along / (q @ along)

    for _ in range(steps):
        tension = -(q @ (weight / MASSES) + u @ u) / (q @ (q / MASSES))
        u = u + h * (weight + q * tension) / MASSES
        q = q + h * u
        for _ in range(5):
            q = q - back(q) * (q @ q - LENGTH**2) / 2.0
        u = u - back(q) * (q @ u)
        rows.append(np.concatenate([q, u]))
    x = np.array(rows)
    return Trajectory(
        t=h * np.arange(steps + 1.0), q=x[:, :2], u=x[:, 2:], coordinates=("x", "y"), speeds=("x", "y"),
        provenance=dc.Provenance("someone's"),
    )  # fmt: skip


def bead() -> dc.Mechanism:
    return dc.Mechanism(
        [dc.body("carriage", 0.5, inertia=(0.1, 0.1, 0.1)), dc.point_mass("bead", 1.0)],
        [dc.prismatic("x", "ground", "carriage", "x"), dc.prismatic("y", "carriage", "bead", "y")],
        constraints=[dc.constraints.distance("rod", "ground", "bead", LENGTH)],
        gravity=(0.0, -G, 0.0),
    )


@pytest.mark.long
@pytest.mark.parametrize("by_masses", [True, False])
@pytest.mark.parametrize(("decimals", "every"), [(16, 1), (5, 1), (4, 5)])
def test_what_keeps_a_constraint_is_a_part_of_the_step(
    decimals: int, every: int, by_masses: bool
) -> None:
    """Steps add several times as much energy as projections leave of it; both are the solver's."""
    run = on_a_rod(by_masses)
    log = replace(
        run.take(slice(None, None, every)),
        q=np.round(run.q[::every], decimals),
        u=np.round(run.u[::every], decimals),
    )
    audit = dc.audit(bead(), log)
    assert audit.verdict.kind == "integration-error" and not audit.causes
    energy = 0.5 * run.u**2 @ MASSES + MASSES[1] * G * run.q[:, 1]
    assert audit.attribution is not None and audit.integrator is not None
    share = audit.attribution.integrator
    assert abs(share.energy - (energy[-1] - energy[0])) < 2.0 * share.error
    # The map of the step with its projection closes rows of all digits; a tenth tells whose joules they are.
    exact = decimals == 16
    assert share.error < (1e-6 if exact else 0.15) * abs(share.energy)
    assert not exact or audit.integrator.names == ("semi-implicit-euler",)


def test_projections_of_states_onto_a_rod() -> None:
    """The nearest point of a circle is along its radius; a state that ran away is left out, or not finite."""
    run = on_a_rod(False, 20)
    model = LogModel(bead(), run)
    near = Rows(run.t[1:], run.q[1:], run.u[1:], np.zeros((20, 0)))
    projected = model.projections(near, np.zeros((20, 4)))
    off = replace(near, q=1.01 * near.q, u=near.u + 0.1 * near.q)
    by_masses, nearest = projected(off)
    # Two of Newton's steps: (1 %)⁴, and the constraint along a chord is exact, as it is quadratic.
    assert nearest.q == pytest.approx(near.q, abs=1e-8)
    assert nearest.u == pytest.approx(near.u, abs=1e-8)
    assert np.linalg.norm(by_masses.q, axis=1) == pytest.approx(LENGTH, abs=1e-8)
    assert np.abs(by_masses.q - near.q).max() > 1e-4
    for away in (np.nan, np.inf, 1e300):
        with np.errstate(all="ignore"):
            assert not any(np.isfinite(x.q).all() for x in projected(replace(off, q=away * near.q)))


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
