"""Logs as other people hand them over: held controls, slow sensors, encoders with another zero, filters.

The oracle is a cart-pole with hand-written equations and integrators.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import deltac as dc
from deltac.diagnosis.audit import audit as audits
from deltac.diagnosis.explain.regression import Regression, factored
from deltac.diagnosis.residuals.one_step import OneStep, one_step, stairs
from deltac.kernels.rows import at_rows
from deltac.progress import Deadline
from tests.systems.cart_pole import CartPole, generalized_alpha, log

RIGHT = CartPole()
MECHANISM = RIGHT.mechanism()
WRONG = CartPole(gravity=9.81 * 1.02)


def codes(found: dc.Audit) -> set[str]:
    return {f.code for f in found.findings}


def test_functions_at_rows_are_those_at_each() -> None:
    x, y = ca.SX.sym("x", 3), ca.SX.sym("y", 2)
    function = ca.Function("f", [x, y], [ca.densify(x @ y.T), ca.densify(ca.sum1(ca.sin(x)))])
    rng = np.random.default_rng(0)
    X, Y = rng.standard_normal((7, 3)), rng.standard_normal((7, 2))
    outer, sums = at_rows(function, [X, Y])
    products = X[:, :, None] * Y[:, None, :]
    np.testing.assert_array_equal(outer.reshape(7, 2, 3).transpose(0, 2, 1), products)
    np.testing.assert_allclose(sums[:, 0], np.sin(X).sum(axis=1), rtol=0, atol=1e-14)


def test_a_deadline_notes_what_it_left_out() -> None:
    whole = Deadline(0.0)
    assert whole.part(0.5).passed("three causes") and whole.left_out == ["three causes"]
    assert not Deadline().passed("nothing")


def test_an_audit_without_time_says_what_it_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """A verdict comes all the same."""
    run = log(WRONG, "rk4", accelerations=False).every(2)
    assert "F-SEARCH-ENDED" not in codes(dc.audit(MECHANISM, run))
    monkeypatch.setattr(audits, "SECONDS", 0.0)
    found = dc.audit(MECHANISM, run)
    assert "F-SEARCH-ENDED" in codes(found)
    assert found.verdict.kind in ("equation-error", "unresolved")


def test_what_is_left_of_a_mistake_is_reproducible() -> None:
    """A combination of columns is predicted from other parts of the log; noise is not."""
    rng = np.random.default_rng(2)
    X = rng.standard_normal((1600, 5))
    for r, low, high in ((X @ np.ones(5), 0.99, 1.0), (rng.standard_normal(1600), 0.0, 0.05)):
        blocks = np.array_split(np.column_stack([X, r]), 16)
        made = Regression(factored(blocks), (), len(r), np.zeros((6, 6)), 0.0)
        assert low <= made.predicted <= high


def held(system: CartPole, rows: int) -> dc.Trajectory:
    """Heun's method with controls that jump at random and are held over some rows."""
    rng = np.random.default_rng(7)
    h, count = 0.002, 600
    forces = np.repeat(rng.uniform(-8.0, 8.0, count // rows + 1), rows)[:count]
    q, u, made = np.array([0.1, 0.4]), np.array([0.2, -0.5]), []
    for k, force in enumerate(forces):
        made.append([k * h, *q, *u, force])
        a = system.acceleration(0.0, q, u, force)
        v, x = u + h * a, q + h * u
        q, u = q + h / 2 * (u + v), u + h / 2 * (a + system.acceleration(0.0, x, v, force))
    rows_ = np.array(made)
    names = ("slide", "hinge")
    return dc.Trajectory(
        t=rows_[:, 0], q=rows_[:, 1:3], u=rows_[:, 3:5], coordinates=names, speeds=names,
        forces={"actuator motor": rows_[:, 5:] * [1.0, 0.0]}, provenance=dc.Provenance("own loop"),
    )  # fmt: skip


def stepped(run: dc.Trajectory) -> OneStep:
    found = one_step(MECHANISM, run)
    assert found is not None
    return found


@pytest.mark.parametrize("every", [1, 2])
def test_forces_that_rest_are_known(every: int) -> None:
    """Jumps of 8 N between the rows leave no error bar where the controls are held."""
    run = held(RIGHT, 10).every(every)
    assert stairs(run.forces["actuator motor"]).held
    right = stepped(run)
    assert float(right.ratio.max()) < 1.0
    assert np.all(right.bars["forces between rows"] < 1e-3 * right.scale)
    assert stepped(held(CartPole(gravity=9.81 * 1.1), 10).every(every)).significant.any()


def test_forces_that_do_not_rest_are_not_held() -> None:
    """Smooth ones change from row to row; what rests only while it is zero tells nothing of a gear."""
    smooth = log(RIGHT, "rk4").forces["actuator motor"]
    half = np.where(np.arange(len(smooth))[:, None] < len(smooth) // 2, 0.0, smooth)
    assert not stairs(smooth).held and not stairs(half).held


def test_controls_two_rows_late_accuse_nobody() -> None:
    run = held(RIGHT, 10)
    force = run.forces["actuator motor"]
    late = replace(run, forces={"actuator motor": np.vstack([force[:1], force[:1], force[:-2]])})
    assert dc.audit(MECHANISM, late).verdict.kind != "equation-error"


def test_speeds_of_a_slower_sensor() -> None:
    """Thinned to the rows in which they are new, the log is judged as one of that pace."""
    for system, accused in ((RIGHT, False), (WRONG, True)):
        run = log(system, "rk4", accelerations=False)
        slow = replace(run, u=np.repeat(run.u[::4], 4, axis=0)[: len(run)])
        found = dc.audit(MECHANISM, slow)
        assert "F-HELD-COLUMNS" in codes(found)
        assert abs(len(found.run) - len(run) / 4) <= 1
        assert (found.verdict.kind == "equation-error") == accused


def test_a_mistake_together_with_a_two_step_method() -> None:
    """Generalized-α and 2 % of gravity are found together; methods that leave as little are not named."""
    found = dc.audit(MECHANISM, replace(generalized_alpha(WRONG), udot=None))
    first = found.findings[0]
    assert first.code == "F-GRAVITY" and first.factor == pytest.approx(1.02, abs=1e-4)
    assert found.step is not None and found.step.scheme is not None
    assert found.step.scheme.name in ("generalized-alpha", "")


def test_an_encoder_with_another_zero_is_a_doubt_of_the_log() -> None:
    run = log(RIGHT, "rk4", accelerations=False)
    found = dc.audit(MECHANISM, replace(run, q=run.q + [0.0, 0.02]))
    assert found.verdict.kind == "unresolved"
    zero = next(f for f in found.findings if f.code == "F-ZERO-OFFSET")
    assert zero.weight == "doubt" and zero.element == "hinge"
    assert zero.factor == pytest.approx(
        0.02, rel=2e-3
    )  # the third order is δ²/6 of it, about the error
