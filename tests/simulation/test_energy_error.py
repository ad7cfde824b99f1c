"""What a run says of itself at its end: its energy error in the loop, and the step that would do."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np
import pytest

import deltac as dc
from deltac import shapes

E0 = 0.5 * 2.0 * 10.0**2 * 0.3**2


def oscillator() -> tuple[dc.Mechanism, dc.State]:
    """2 kg on a spring, ω = 10 rad/s, at rest 0.3 m from equilibrium: K + V = E0."""
    mechanism = dc.Mechanism(
        [dc.point_mass("mass", 2.0)],
        [dc.prismatic("x", "ground", "mass", "x", stiffness=200.0)],
    )
    return mechanism, mechanism.state({"x": 0.3})


def recommended(warning: str) -> float:
    (value,) = re.findall(r"(?:steps|tolerance) of (\S+)", warning)[:1]
    return float(value)


def test_euler_s_energy_is_that_of_theory() -> None:
    """K + V grows by 1 + (hω)² a step; K, V and what flows between them by quarter periods."""
    mechanism, state = oscillator()
    h, n = 2e-3, 900
    gained = E0 * ((1 + (h * 10.0) ** 2) ** n - 1)
    with pytest.warns(dc.EnergyErrorWarning, match=re.escape(f"{gained:.3g} J, ")):
        run = dc.simulate(mechanism, state, n * h, h, "ode1")
    assert run.provenance.energy_error == pytest.approx(gained, rel=1e-9)


@pytest.mark.parametrize(
    ("solver", "h"), [("ode1", 4e-3), ("ode1", 1e-2), ("ode2", 0.03), ("ode2", 0.04)]
)
def test_the_step_that_is_recommended_does(solver: str, h: float) -> None:
    mechanism, state = oscillator()
    with pytest.warns(dc.EnergyErrorWarning) as caught:
        dc.simulate(mechanism, state, 500 * h, h, solver)
    steps = np.ceil(500 * h / recommended(str(caught[0].message)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        better = dc.simulate(mechanism, state, 500 * h, 500 * h / steps, solver)
    assert better.provenance.energy_error is not None
    assert 1e-5 < better.provenance.energy_error / E0 < 1e-2


def test_a_box_that_tumbles_through_stiff_contacts() -> None:
    """Finite to the end, and wrong: the step that is named is one that follows the impacts."""
    corners = [(x, y, z) for x in (-0.2, 0.2) for y in (-0.15, 0.15) for z in (-0.05, 0.05)]
    box = dc.Mechanism(
        bodies=[dc.bodies.box("box", 5.0, (0.4, 0.3, 0.1))],
        joints=[dc.free("base", "box")],
        forces=[
            dc.forces.contact(
                f"corner {k}",
                shapes.sphere("box", 0.01, position=corner),
                shapes.half_space("ground", normal="z"),
                stiffness=1e6,
                dissipation=0.3,
            )
            for k, corner in enumerate(corners)
        ],
        gravity=(0, 0, -9.81),
    )
    start = box.state({"base.z": 0.3}, {"base.wx": 3.0, "base.wy": 1.0})
    with pytest.warns(dc.EnergyErrorWarning) as caught:
        run = dc.simulate(box, start, 0.5, 5e-3, "ode4")
    assert run.provenance.completed
    energy = 5.0 * 9.81 * 0.3
    assert run.provenance.energy_error is not None
    assert run.provenance.energy_error > 0.1 * energy
    step = min(recommended(str(w.message)) for w in caught if w.category is dc.EnergyErrorWarning)
    better = dc.simulate(box, start, 0.5, 0.5 / np.ceil(0.5 / step), "ode4")
    assert better.provenance.energy_error is not None
    assert better.provenance.energy_error < 1e-2 * energy


def test_a_run_that_was_stopped_says_how_far_its_rows_are_off() -> None:
    p = dc.problems.load("triple-pendulum")
    with pytest.warns(dc.SimulationStoppedWarning, match="Do not trust the rows"):
        run = dc.simulate(p.mechanism, p.state, 10.0, 0.1, "ode4")
    assert run.provenance.energy_error is not None
    assert run.provenance.energy_error > 1e3  # J, of a pendulum with 12


def test_steady_and_resting_motions_are_not_blamed_for_rounding() -> None:
    """A pendulum that hangs, and a disc that rolls in a circle: nothing is exchanged."""
    hanging = dc.problems.load("simple-pendulum").mechanism
    rolling = dc.problems.load("rolling-disc")
    with warnings.catch_warnings():
        warnings.simplefilter("error", dc.EnergyErrorWarning)
        still = dc.simulate(hanging, hanging.state(), 1.0, 1e-3)
        disc = dc.simulate(rolling.mechanism, rolling.state, 1.0, 2e-3)
        twice = dc.simulate(rolling.mechanism, rolling.state, 1.0, 1e-3, record=1000)
    assert max(r.provenance.energy_error or 0.0 for r in (still, disc, twice)) < 1e-6


def test_runs_without_testing_functions_say_nothing_of_their_energy() -> None:
    mechanism, state = oscillator()
    assert dc.simulate(mechanism, state, 0.1, 0.01, record=[]).provenance.energy_error is None
    only_1988 = dc.simulate(mechanism, state, 0.1, 0.01, record=["kane-levinson-1988"])
    assert only_1988.provenance.energy_error is None


def test_a_log_keeps_it(tmp_path: Path) -> None:
    mechanism, state = oscillator()
    run = dc.simulate(mechanism, state, 0.1, 0.01, "ode4")
    at_rest = dc.simulate(mechanism, mechanism.state(), 0.1, 0.01, "ode4")
    assert at_rest.provenance.energy_error == 0.0
    for k, log in enumerate((run, at_rest)):
        dc.write_trajectory(log, tmp_path / f"{k}.csv")
        back = dc.read_trajectory(tmp_path / f"{k}.csv")
        assert back.provenance.energy_error == log.provenance.energy_error


def test_equations_by_hand_that_are_wrong() -> None:
    """A sign slip in the spring: no step helps, and the warning names the check of equations."""
    mechanism, state = oscillator()
    with pytest.warns(dc.EnergyErrorWarning, match="check_equations"):
        dc.simulate(mechanism, state, 0.2, 1e-3, equations=lambda t, q, u: 100.0 * q)
