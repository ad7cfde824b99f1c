"""The judge's bench: its true joules against closed forms, and its oracle."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from judge.bench import prepared
from judge.oracle import OFFSET, log_odds
from judge.plants import pendulum
from judge.truth import advanced, joules, simulated

import deltac as dc


def _pendulum() -> tuple[Any, dict[str, float]]:
    system = pendulum(np.random.default_rng(0))
    return system, {**system.numbers, "c": 0.0}


def _still(k: int, x: np.ndarray) -> np.ndarray:
    return np.zeros(1)


@pytest.mark.parametrize(
    "scheme", ["explicit-euler", "semi-implicit-euler", "leapfrog", "heun", "rk4"]
)
def test_the_integrators_joules_are_the_energy_gained(scheme: str) -> None:
    system, numbers = _pendulum()
    plant = system.plant(numbers)
    motion = simulated(plant, scheme, np.array([1.0, 0.5]), 0.002, 300, _still, "held")
    found = joules(plant, plant, motion, True)
    energy = plant.energy(motion.x)
    assert (
        np.abs(found.integrator - (energy - energy[0])).max()
        <= found.integrator_slack.max() + 1e-11
    )
    assert not found.mistake.any()


def test_the_joules_of_too_much_gravity_are_those_of_its_fall() -> None:
    system, numbers = _pendulum()
    plant, model = system.plant({**numbers, "g": 9.91}), system.plant(numbers)
    motion = simulated(plant, "rk4", np.array([1.0, 0.5]), 0.001, 500, _still, "held")
    found = joules(plant, model, motion, False)
    q = motion.x[:, 0]
    fallen = numbers["m"] * 0.1 * numbers["L"] * (np.cos(q) - np.cos(q[0]))
    assert found.mistake == pytest.approx(fallen, abs=1e-6)
    assert np.abs(found.integrator).max() < 1e-10


@pytest.mark.parametrize("share", [0.0, 0.003])
def test_the_oracle_sees_a_damper_that_is_off_through_noise(share: float) -> None:
    system = pendulum(np.random.default_rng(0))
    numbers = dict(system.numbers)
    plant = system.plant({**numbers, "c": numbers["c"] * (1 + 20 * share)})
    motion = simulated(plant, "rk4", np.array([1.0, 0.5]), 0.002, 1000, _still, "held")
    level = 1e-4 * motion.x.std(axis=0)
    rows = motion.x + level * np.random.default_rng(1).standard_normal(motion.x.shape)

    def step(name: str, k: int, x: np.ndarray) -> np.ndarray:
        changed = {**numbers, name: numbers[name] + OFFSET} if name else numbers
        return np.asarray(advanced(system.plant(changed), "rk4", k, x, motion.torque, 0.002))

    odds = log_odds(step, rows, np.arange(1001), np.tile(level, (1001, 1)), ("m", "c"))
    assert (odds["c"] > 20) if share else (max(odds.values()) < 0)


@pytest.mark.slow
def test_causes_that_all_rows_refuse_leave_a_log_that_follows_without_causes() -> None:
    """A rolling disc by RK4 with noise: of a sample a few causes explain more than the noise."""
    case = prepared(1044, 449, "right", with_truth=False)
    assert case is not None
    audit = dc.audit(case.model, case.log)
    assert audit.verdict.kind == "consistent" and audit.attribution is not None
    # RK4's own are 7e-11 J; of methods that the noise does not exclude, those of order two have 1e-7 J.
    assert audit.attribution.integrator.error < 1e-6


@pytest.mark.long
def test_causes_that_some_rows_suggest_and_all_rows_refute_are_none() -> None:
    """A four-bar by generalized-α: some rows had late forces beside a method that closes all of them."""
    case = prepared(1046, 1424, "right", "", False)
    assert case is not None
    audit = dc.audit(case.model, case.log)
    assert audit.verdict.kind != "equation-error" and not audit.causes
