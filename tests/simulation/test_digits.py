"""Accelerations with few digits are told, those without any refused, and honest ones left alone."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import deltac as dc
from deltac.dynamics.digits import acceleration_error, condition
from deltac.dynamics.equations_of_motion import equations_of_motion
from deltac.errors import InputError
from deltac.problems import load


def carried(light: float, apart: float = 1e-6) -> dc.Mechanism:
    """Two hinges close to each other: a body of `light` kg between the ground and one of a kilogram."""
    bodies = [
        dc.body("light", light, mass_centre=(0.3, 0.1, 0.0), inertia=(light, light, light)),
        dc.body("heavy", 1.3, mass_centre=(0.2, -0.4, 0.0), inertia=(0.1, 0.2, 0.3)),
    ]
    joints = [
        dc.revolute("j", "ground", "light", axis="z"),
        dc.revolute("k", "light", "heavy", position=(apart, 0.0, 0.0), axis="z"),
    ]
    return dc.Mechanism(bodies, joints, gravity=(0.0, -9.81, 0.0))


def error(light: float) -> float:
    motion = equations_of_motion(carried(light))
    return acceleration_error(motion, (), 0.0, np.array([0.3, 0.4]), np.array([1.0, 2.0]))


def test_the_condition_is_that_of_the_scaled_matrices() -> None:
    M = np.diag([1e-12, 1.0, 1e9])
    assert condition(M, np.zeros((0, 3))) == pytest.approx(1.0)
    tied = np.array([[1e6, 0.0, 0.0], [0.0, 1.0, 0.0]])  # at right angles in the mass metric
    assert condition(M, tied) == pytest.approx(1.0)
    # Rows at an angle ε have the Gram matrix [[1, cos ε], [cos ε, 1]], of condition 4/ε².
    close = np.array([[1.0, 0.0], [np.cos(1e-2), np.sin(1e-2)]])
    assert condition(np.eye(2), close) == pytest.approx(4e4, rel=1e-3)


def test_errors_are_looked_at_where_the_condition_is_large() -> None:
    assert error(1.0) == 0.0
    assert 0.0 < error(1e-9) < 1e-6 < condition_of(1e-9) * 2.0**-53 * 1e3


def condition_of(light: float) -> float:
    motion = equations_of_motion(carried(light))
    M, _, _, G, _ = motion.ties(0.0, np.array([0.3, 0.4]), np.zeros(2), ())
    return condition(M, G)


def test_it_is_told_and_then_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    mechanism = carried(1e-15)
    start = mechanism.state({"j": 0.3, "k": 0.4}, {"j": 1.0, "k": 2.0})
    # The recursions lose few digits of so small a mechanism; the campaign has worse ones.
    monkeypatch.setattr("deltac.simulation.arguments.INACCURATE", 1e-13)
    with pytest.warns(dc.IllConditionedWarning, match="'j'"):
        dc.simulate(mechanism, start, 1e-3, 1e-3)
    found = dc.study(mechanism, start, 2e-3, [1e-3, 5e-4])
    assert [f.weight for f in found.findings if f.code == "F-ILL-CONDITIONED"] == ["doubt"]
    monkeypatch.setattr("deltac.simulation.arguments.LOST", 1e-13)
    with pytest.raises(InputError, match="No run of it has a digit") as caught:
        dc.simulate(mechanism, start, 1e-3, 1e-3)
    assert caught.value.code == "E-STATE"


def test_honest_mechanisms_are_left_alone() -> None:
    for name in ("triple-pendulum", "n-four-bar"):
        problem = load(name)
        with warnings.catch_warnings():
            warnings.simplefilter("error", dc.IllConditionedWarning)
            dc.simulate(problem.mechanism, problem.state, 1e-3, 1e-3)


def test_an_equilibrium_has_its_digits() -> None:
    """There the accelerations vanish, and rounding alone is left of them."""
    motion = equations_of_motion(carried(1e-12))
    found = acceleration_error(motion, (), 0.0, np.zeros(2), np.zeros(2))
    assert found < 1e-6
