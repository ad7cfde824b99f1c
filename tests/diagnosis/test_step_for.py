"""`Audit.step_for`: the step for a tolerance from one log, against a run at that step."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import deltac as dc
from deltac.problems.problem import Problem
from tests.support.slow import repeated


def log_of(problem: Problem, solver: str, step: float) -> dc.Trajectory:
    """A run as another program would log it: t, q and u alone."""
    run = dc.simulate(problem, None, 1.0, step, solver)
    return replace(run, udot=None, forces={}, works={}, integrals={})


CASES = [
    ("double-pendulum", "semi-implicit-euler"),
    ("simple-pendulum", "ode1be"),
    ("bead-on-hoop", "ode2"),
    ("torque-free-box", "ode1"),
    # Each row is that of the method to the last bit: no noise is left to judge causes by but digits.
    ("bead-on-hoop", "semi-implicit-euler"),
]


@pytest.mark.long
@pytest.mark.parametrize("case", repeated(CASES, *CASES[1:]))
def test_a_run_at_that_step_has_that_error(case: tuple[str, str]) -> None:
    problem = dc.problems.load(case[0])
    audit = dc.audit(problem, log_of(problem, case[1], 2e-3))
    tolerance = audit.relative / 4.0
    steps = math.ceil(1.0 / audit.step_for(tolerance))
    run = log_of(problem, case[1], 1.0 / steps)
    ledger = dc.balance(problem.mechanism, run, testing=("wang",))
    error = float(np.abs(ledger.delta_c["wang"]).max()) / audit.reference_energy
    assert error == pytest.approx(tolerance, rel=0.3)


@pytest.mark.long
def test_it_is_refused_where_nothing_is_known() -> None:
    pendulum = dc.problems.load("simple-pendulum")
    with pytest.raises(dc.InputError, match="within their error"):
        dc.audit(pendulum, log_of(pendulum, "ode8", 2e-3)).step_for(1e-6)
    disc = dc.problems.load("rolling-disc")
    with pytest.raises(dc.InputError, match="constraints"):
        dc.audit(disc, log_of(disc, "implicit-midpoint", 4e-3)).step_for(1e-6)


@pytest.mark.parametrize("rated", [True, False])
@pytest.mark.parametrize("name", ["bead-on-hoop", "driven-pendulum"])
def test_joules_of_the_integrator_where_joints_are_driven(name: str, rated: bool) -> None:
    """ΔC of a right model is all of the integrator: by the ledger, and by the error of each step."""
    problem = dc.problems.load(name)
    run = dc.simulate(problem, None, 1.0, 2e-3, "ode1")
    log = replace(run, udot=run.udot if rated else None, forces={}, works={}, integrals={})
    audit = dc.audit(problem, log)
    assert audit.attribution is not None
    delta_c = audit.ledger.delta_c["wang"]
    apart = np.abs(audit.attribution.integrator.curve - delta_c)
    assert apart.max() < 0.04 * np.abs(delta_c).max()


@pytest.mark.long
def test_what_an_audit_says_of_steps() -> None:
    pendulum = dc.problems.load("double-pendulum")
    audit = dc.audit(pendulum, log_of(pendulum, "semi-implicit-euler", 2e-3))
    step = audit.step_for(audit.tolerance)
    assert 0.0002 < step < 0.00025
    assert f"{1e3 * step:.2g} ms" in audit.explain() and "not run" in audit.explain()
    # A method whose joules at order two cancel, so that those of the third rule.
    box = dc.problems.load("torque-free-box")
    audit = dc.audit(box, log_of(box, "ode2", 2e-3))
    assert audit.step_for(audit.relative / 8.0) == pytest.approx(1e-3, rel=0.05)
    assert audit.step_for(0.5) == pytest.approx(10 * 2e-3)
    disc = dc.problems.load("rolling-disc")
    assert "constraints" in dc.audit(disc, log_of(disc, "implicit-midpoint", 4e-3)).explain()


@pytest.mark.long
def test_more_than_a_tenth_of_the_energy_is_not_predicted() -> None:
    """A heavy top loses 5 % at 2 ms and all at 4 ms: the rows of the first tell nothing of the second."""
    top = dc.problems.load("heavy-top")
    audit = dc.audit(top, log_of(top, "ode2", 2e-3))
    assert 0.04 < audit.relative < 0.06
    assert audit.step_for(0.2) == audit.step_for(0.1) < 3e-3


@pytest.mark.long
def test_noise_forbids_a_prediction() -> None:
    pendulum = dc.problems.load("double-pendulum")
    log = log_of(pendulum, "ode2", 2e-3)
    rng = np.random.default_rng(1)
    noisy = replace(
        log,
        q=log.q + 1e-4 * rng.standard_normal(log.q.shape),
        u=log.u + 1e-3 * rng.standard_normal(log.u.shape),
    )
    with pytest.raises(dc.InputError) as refused:
        dc.audit(pendulum, noisy).step_for(1e-6)
    assert refused.value.code == "E-SOLVER"


@pytest.mark.long
def test_a_log_that_contradicts_itself_is_refused_with_what_does() -> None:
    top = dc.problems.load("heavy-top")
    with pytest.raises(dc.InputError, match="contradicts itself.*clock-scale"):
        dc.audit(top, log_of(top, "ode1be", 2e-3)).step_for(1e-4)


def test_the_trapezoidal_rule_takes_the_forces_of_both_ends() -> None:
    """A driven pendulum by the rule, written out here: four times ΔC is at twice the step."""
    mechanism = dc.Mechanism(
        [dc.point_mass("bob", 1.0, (0, 0, -1))],
        [dc.revolute("hinge", "ground", "bob", axis="y")],
        forces=[dc.forces.joint_torque("motor", "hinge")],
        gravity=(0, 0, -9.81),
    )

    def torque(t: float) -> float:
        return 2.0 * math.sin(5.0 * t)

    h, rows = 2e-3, [(0.0, 0.5, 1.0)]
    for k in range(500):
        t, q, u = rows[-1]
        first, after, speed = torque(t) - 9.81 * math.sin(q), q + h * u, u
        for _ in range(30):
            last = torque(h * (k + 1)) - 9.81 * math.sin(after)
            speed = u + 0.5 * h * (first + last)
            after = q + 0.5 * h * (u + speed)
        rows.append((h * (k + 1), after, speed))
    t, q, u = np.array(rows).T
    log = dc.Trajectory(
        t=t, q=q[:, None], u=u[:, None], forces={"actuator motor": np.vectorize(torque)(t)[:, None]},
        coordinates=("hinge",), speeds=("hinge",), provenance=dc.Provenance("own rule", step=h),
    )  # fmt: skip
    audit = dc.audit(mechanism, log)
    assert audit.step_for(4.0 * audit.relative) == pytest.approx(2.0 * h, rel=0.05)
    assert audit.step_for(audit.relative / 4.0) == pytest.approx(0.5 * h, rel=0.05)
