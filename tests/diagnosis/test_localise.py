"""Where a motion departs from its model: equation, time, joint, body, term."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import deltac as dc
from tests.systems.hand_equations import CASES


@pytest.fixture(scope="module")
def mistaken() -> tuple[dc.problems.Problem, dc.Trajectory]:
    """The motion of fig. 4.7's wrong equations."""
    p = dc.problems.load("triple-pendulum", mistake=True)
    run = dc.simulate(
        p.mechanism, p.state, duration=1.0, step=2e-3, equations=p.equations, record=()
    )
    return p, run


def test_the_mistake_of_the_thesis_in_its_motion(
    mistaken: tuple[dc.problems.Problem, dc.Trajectory],
) -> None:
    p, run = mistaken
    assert p.equations is not None
    found = dc.localise(p.mechanism, run, coordinates=p.equations.coordinates)
    (departure,) = found.departures
    assert (departure.number, departure.speed) == (2, "theta2")
    (term,) = departure.terms
    assert term.part == "gravity" and term.factor == pytest.approx(-1.0, abs=1e-9)
    # 2 (m2 r2 + m3 l2) g sin θ2 by hand
    moment = 2 * (30 * 0.125 + 20 * 0.25)
    expected = -moment * np.sin(np.cumsum(run.q, axis=1)[:, 1])
    rows = np.searchsorted(run.t, found.t)
    assert np.abs(found.residual[:, 1] - expected[rows]).max() < 1e-11 * moment
    assert np.abs(found.residual[:, [0, 2]]).max() < 1e-11 * moment
    # that moment's power on bar 2 is what joints 1 and 2 take: θ̇2 = u1 + u2
    rate = np.cumsum(run.u, axis=1)[rows, 1]
    total = found.joints["joint1"] + found.joints["joint2"]
    assert np.abs(total + expected[rows] * rate).max() < 1e-9
    assert np.abs(found.joints["joint3"]).max() < 1e-9
    assert "equation 2 (theta2)" in found.explain()
    assert found.to_dict()["departures"][0]["number"] == 2


def test_a_right_motion_departs_nowhere() -> None:
    p = dc.problems.load("triple-pendulum", damping=0.01)
    run = dc.simulate(p.mechanism, p.state, duration=0.5, step=1e-2)
    found = dc.localise(p.mechanism, run)
    assert found.departures == ()
    assert "obeys the model" in found.explain()


def test_when_it_happens() -> None:
    """A damper that the model does not have, at work while the pendulum passes through."""
    model = dc.problems.load("triple-pendulum")
    wrong = dc.problems.load("triple-pendulum", damping=(0.0, 0.0, 0.2))
    run = dc.simulate(wrong.mechanism, wrong.state, duration=0.2, step=1e-3)
    assert run.udot is not None
    rest = dc.simulate(model.mechanism, model.state, duration=0.2, step=1e-3)
    assert rest.udot is not None
    both = replace(
        run,
        t=np.concatenate([run.t, run.t[-1] + 1e-3 + rest.t]),
        q=np.concatenate([run.q, rest.q]),
        u=np.concatenate([run.u, rest.u]),
        udot=np.concatenate([run.udot, rest.udot]),
        forces={},
        works={},
        integrals={},
    )
    found = dc.localise(model.mechanism, both)
    (departure,) = found.departures
    assert departure.speed == "joint3" and departure.span is not None
    assert 0.0 < departure.span[0] < departure.span[1] <= 0.2
    damped = dc.localise(model.mechanism, replace(run, forces={}, works={}, integrals={}))
    assert [str(t) for t in damped.departures[0].terms] == ["0.2·u.joint3"]


def test_a_violated_loop_is_projected_out() -> None:
    """Constraint forces are no residual: a four-bar's own motion departs nowhere."""
    p = dc.problems.load("n-four-bar")
    run = dc.simulate(p.mechanism, p.state, duration=0.1, step=1e-2)
    assert dc.localise(p.mechanism, run).departures == ()


def test_bad_input(mistaken: tuple[dc.problems.Problem, dc.Trajectory]) -> None:
    p, run = mistaken
    with pytest.raises(dc.InputError, match="coordinate"):
        dc.localise(dc.problems.load("heavy-top").mechanism, run)
    case = CASES["spherical_pendulum"]()
    problem = dc.problems.load("spherical-pendulum")
    motion = dc.simulate(problem.mechanism, problem.state, duration=0.1, step=1e-2)
    with pytest.raises(dc.InputError, match="inverse"):
        dc.localise(problem.mechanism, motion, coordinates=case.coordinates)


def test_accelerations_that_a_run_lacks_are_those_of_its_speeds(
    mistaken: tuple[dc.problems.Problem, dc.Trajectory],
) -> None:
    p, run = mistaken
    assert p.equations is not None
    with_udot = dc.localise(p.mechanism, run, coordinates=p.equations.coordinates)
    found = dc.localise(p.mechanism, replace(run, udot=None), coordinates=p.equations.coordinates)
    (departure,) = found.departures
    assert (departure.number, departure.speed) == (2, "theta2")
    (term,) = departure.terms
    assert str(term).endswith("enters with the wrong sign")
    inner = slice(3, -3)  # a spline knows its derivatives least at its ends
    assert np.abs(found.residual - with_udot.residual)[inner].max() < 1e-2
    for joint, power in with_udot.joints.items():
        assert np.abs(found.joints[joint] - power)[inner].max() < 1e-3 * 296
    right = dc.simulate("triple-pendulum", duration=0.5, step=1e-3, record=())
    assert dc.localise("triple-pendulum", replace(right, udot=None)).departures == ()


@pytest.mark.long
def test_an_audit_names_the_equations_that_depart(
    mistaken: tuple[dc.problems.Problem, dc.Trajectory],
) -> None:
    """The mistake turns bar 2 about the ground: in joint angles the first two equations, not the third."""
    p, run = mistaken
    audit = dc.audit(p.mechanism, run)
    (departing,) = (f for f in audit.findings if f.code == "F-EQUATION-DEPARTS")
    assert departing.element in ("joint1", "joint2")
    momenta = audit.momenta()
    assert all(momenta[name]["relative"] > 0.1 for name in ("joint1", "joint2"))
    assert momenta["joint3"]["relative"] < 1e-6
    coarse = dc.simulate("triple-pendulum", duration=1.0, step=2e-3, solver="ode1", record=())
    assert all(
        m["delta_p"] > m["error_bar"] for m in dc.audit(p.mechanism, coarse).momenta().values()
    )
    assert "F-EQUATION-DEPARTS" not in [f.code for f in dc.audit(p.mechanism, coarse).findings]


@pytest.mark.long
def test_columns_in_another_order_are_the_same_motion(
    mistaken: tuple[dc.problems.Problem, dc.Trajectory],
) -> None:
    p, run = mistaken
    assert run.udot is not None
    other = replace(
        run,
        q=run.q[:, ::-1],
        u=run.u[:, ::-1],
        udot=run.udot[:, ::-1],
        forces={n: f[:, ::-1] for n, f in run.forces.items()},
        coordinates=run.coordinates[::-1],
        speeds=run.speeds[::-1],
    )
    assert dc.localise(p.mechanism, other).explain() == dc.localise(p.mechanism, run).explain()
