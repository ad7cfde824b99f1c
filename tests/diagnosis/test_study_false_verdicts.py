"""Verdicts that were false on the bench, one test a class: right motions accused, wrong ones acquitted."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac import Provenance, Study, Trajectory
from deltac.diagnosis.residuals.at_samples import run_residual
from deltac.diagnosis.residuals.kane import Kane
from deltac.diagnosis.study.convergence import observed_order
from deltac.diagnosis.study.runs import before_blow_up
from tests.support.slow import repeated
from tests.systems.machines import pendulum

STEPS = (0.01, 0.005, 0.0025)


def kinds(study: Study) -> set[str]:
    return {f.kind for f in study.findings}


def log(run: Trajectory, udot: bool) -> Trajectory:
    """What another program would have written; corrections are known, for they are no guess."""
    kept = {n: x for n, x in run.integrals.items() if n.startswith("correction")}
    source = Provenance("another program", step=run.provenance.step)
    return replace(
        run, udot=run.udot if udot else None, works={}, integrals=kept, provenance=source
    )


def of_runs(mechanism: Any, make: Any, udot: bool, order: int | None = 4) -> Study:
    return dc.study(mechanism, runs=lambda h: log(make(h), udot), steps=STEPS, order=order)


# --- errors that a projection mends ---------------------------------------------------------------


def tension(squares: str) -> dc.Equations:
    """The spherical pendulum with the rod's force worked out from some of the squares of the speed."""

    def rhs(t: float, q: Any, u: Any) -> Any:
        r = np.array(q)
        pull = sum(u["xyz".index(axis)] ** 2 for axis in squares) - 9.81 * r[2]
        return -pull * r - np.array([0.0, 0.0, 9.81])

    return dc.Equations(rhs)


@pytest.mark.parametrize(
    ("squares", "udot", "expected"),
    [
        ("xyz", True, "integration-error"),
        ("xyz", False, "integration-error"),
        ("yz", True, "equation-error"),
        ("yz", False, "unresolved"),
    ],
)
def test_a_wrong_force_of_a_constraint(squares: str, udot: bool, expected: str) -> None:
    """It is along Gᵀ: projected, the motion tends to the right one, and Kane's equations close."""
    problem = dc.problems.load("spherical-pendulum")

    def run(step: float) -> Trajectory:
        return dc.simulate(
            problem.mechanism, problem.state, 1.0, step, "ode2", (), tension(squares)
        )

    found = of_runs(problem.mechanism, run, udot, order=2)
    assert found.verdict.kind == expected, found.verdict.explain()
    blamed = {f.element for f in found.findings if f.kind == "constraint-acceleration"}
    assert blamed == ({"rod"} if expected == "equation-error" else set())


def test_a_wrong_force_of_a_constraint_is_no_log_in_millimetres() -> None:
    """The rod fixes the length, so a thousandth of the coordinates is no reading."""
    problem = dc.problems.load("spherical-pendulum")

    def rhs(t: float, q: Any, u: Any) -> Any:
        r, v = np.array(q), np.array(u)
        pull = v @ v - 9.81 * r[2]
        return pull * r * [1.0, -1.0, -1.0] - np.array([0.0, 0.0, 9.81])  # one sign is wrong

    def run(step: float) -> Trajectory:
        equations = dc.Equations(rhs)
        return dc.simulate(problem.mechanism, problem.state, 1.0, step, "ode2", (), equations)

    found = of_runs(problem.mechanism, run, True, order=2)
    assert "millimetres" not in kinds(found)
    assert found.verdict.kind == "equation-error", found.verdict.explain()


@pytest.mark.parametrize("constraints", ["projection", None, dc.Baumgarte(20.0, 20.0)])
@pytest.mark.parametrize("coarser", [4, 64])
@pytest.mark.parametrize(
    "name", repeated(["ball-on-rising-table", "disc-on-moving-plane"], "disc-on-moving-plane")
)
def test_no_stabilisation_is_taken_for_a_mistake(name: str, coarser: int, constraints: Any) -> None:
    """Baumgarte asks for ψ̇ = −2αψ − β²φ, a fifth of the terms at the coarse step, and is right to do so."""
    problem = dc.problems.load(name)
    step = coarser * problem.step
    run = dc.simulate(
        problem.mechanism, problem.state, 40 * step, step, "ode3", constraints=constraints
    )
    for values in (run, replace(run, **{n: single(getattr(run, n)) for n in ("q", "u", "udot")})):
        rates = run_residual(Kane(problem.mechanism), values).constraints
        assert set(rates.values()) == {0.0}


def single(values: Any) -> Any:
    return values.astype(np.float32).astype(float)


# --- runs that blow up ----------------------------------------------------------------------------


def stiff(wrong: bool, udot: bool) -> Study:
    """ω h = 5 to 20, where ode4 is stable below 2.8: every run blows up."""
    mechanism = dc.Mechanism(
        [dc.point_mass("block", 1.0)],
        [dc.prismatic("x", "ground", "block", "x", stiffness=4e6)],
        gravity=[0, 0, 0],
    )
    state = mechanism.state({"x": 0.1})
    pull = 3e6 if wrong else 4e6
    by_hand = dc.Equations(lambda t, q, u: -pull * q)

    def run(step: float) -> Trajectory:
        return dc.simulate(mechanism, state, 40 * step, step, "ode4", (), by_hand)

    return of_runs(mechanism, run, udot)


@pytest.mark.filterwarnings("ignore")
def test_runs_that_blow_up() -> None:
    right, blind = stiff(wrong=False, udot=True), stiff(wrong=False, udot=False)
    assert right.verdict.kind == "integration-error", right.verdict.explain()
    assert "blows up" in right.verdict.meaning
    assert blind.verdict.kind == "unresolved"
    wrong = stiff(wrong=True, udot=True)
    assert wrong.verdict.kind == "equation-error", wrong.verdict.explain()
    assert "blown-up" in kinds(wrong)


def test_where_a_blow_up_begins() -> None:
    t = 0.01 * np.arange(60)

    def grown(u: Any) -> Trajectory:
        u = np.asarray(u)[:, None]
        return Trajectory(t=t, q=u, u=u, coordinates=("x",), speeds=("x",))  # type: ignore[arg-type]

    away = np.where(np.arange(60) < 50, 1.0, 1e3 ** (np.arange(60) - 49.0))
    assert len(before_blow_up(grown(away))) == 51  # 1e3 times as fast as usual is the last
    falling = grown(1e-12 * np.exp(0.5 * np.arange(60)))  # from an unstable rest: nothing blows up
    assert before_blow_up(falling) is falling


# --- limits without an order ----------------------------------------------------------------------


def test_values_that_do_not_move_are_the_limit() -> None:
    """The differences, 1e-4 of the value, fall at no order; whatever they are of, the value stays."""
    found = observed_order(STEPS, [0.39, 0.39 + 2e-5, 0.39 - 3e-5], floor=1e-9)
    assert found.trend == "tends to a limit"
    assert found.limit == pytest.approx(0.39, rel=1e-3)
    assert observed_order(STEPS, [0.39, 0.35, 0.44], floor=1e-9).trend != "tends to a limit"


def test_a_mistake_that_costs_the_method_its_order() -> None:
    """A sleigh pushed aside: projected, ode4 moves it at first order, and 0.35 J are missing throughout."""
    problem = dc.problems.load("chaplygin-sleigh")

    def rhs(t: float, q: Any, u: Any) -> Any:
        c, s = np.cos(q[2]), np.sin(q[2])
        v, w = u[0] * c + u[1] * s, u[2]
        ahead = 0.5 * w**2
        return np.array([ahead * c - v * w * s, s + v * w * c, -0.5 * v * w / 1.25])

    def run(step: float) -> Trajectory:
        return dc.simulate(
            problem.mechanism, problem.state, 2.0, step, "ode4", (), dc.Equations(rhs)
        )

    found = of_runs(problem.mechanism, run, udot=False)
    assert found.observed_order["state"].order == pytest.approx(1.0, abs=0.15)
    assert found.verdict.kind == "equation-error", found.verdict.explain()


# --- nothing moves, or nothing is exchanged -------------------------------------------------------


def test_what_hangs_in_the_air_is_seen_by_momentum() -> None:
    """A pendulum that stays where it is: no energy flows at all, but its weight must turn it."""
    mechanism = pendulum()
    state = mechanism.state({"hinge": 1.0})
    weightless = mechanism.with_parameters(g=0.0)

    def run(step: float) -> Trajectory:
        return dc.simulate(weightless, state, 1.0, step, "ode4", ())

    found = of_runs(mechanism, run, udot=False)
    assert found.verdict.kind == "equation-error", found.verdict.explain()
    assert "momentum" in found.verdict.meaning
    down = weightless.state({"hinge": 0.0})
    found = dc.study(
        mechanism,
        runs=lambda h: log(dc.simulate(weightless, down, 1.0, h, "ode4", ()), False),
        steps=STEPS,
    )
    assert found.verdict.kind == "unresolved", "at rest straight down nothing can be told"
    assert "hardly anything moves" in found.verdict.meaning


def test_a_motion_that_runs_away_is_not_one_row_old() -> None:
    """Its last row outweighs all others: leaving it out is no proof that rows are shifted."""
    mechanism = dc.Mechanism(
        [dc.point_mass("block", 1.0)],
        [dc.prismatic("x", "ground", "block", "x", stiffness=4.0)],
        gravity=[0, 0, 0],
    )
    state = mechanism.state({"x": 1e-9})
    away = dc.Equations(lambda t, q, u: 2.25e6 * q)

    def run(step: float) -> Trajectory:
        return dc.simulate(mechanism, state, 7 * step, step, "ode4", (), away)

    found = of_runs(mechanism, run, udot=True)
    assert "stale-stage" not in kinds(found), found.verdict.explain()


# --- impacts that nobody wrote down ---------------------------------------------------------------


@pytest.mark.parametrize("coarse", [0.64, 0.01])
@pytest.mark.parametrize("udot", [True, False])
def test_impacts_that_the_runs_do_not_tell_of(coarse: float, udot: bool) -> None:
    """Between rows far apart no speed is seen to jump; but the model says that a ball may bounce."""
    ball = dc.problems.load("bouncing-ball")

    def bare(step: float) -> Trajectory:
        run = dc.simulate(ball.mechanism, ball.state, 3.84, step, "ode4")
        return log(replace(run, forces={}, events=()), udot)

    steps = (coarse, coarse / 2, coarse / 4)
    study = dc.study(ball.mechanism, runs=bare, steps=steps, order=4)
    assert study.verdict.kind == "unresolved"
    assert "impacts" in kinds(study)
