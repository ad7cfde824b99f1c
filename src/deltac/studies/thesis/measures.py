"""The numbers that the thesis's statements are about, read off the runs of an experiment."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import TypeAlias

import numpy as np

from deltac.problems import triple_pendulum
from deltac.studies.thesis.runs import (
    PRESCRIBED,
    Outcome,
    Run,
    ThreeWays,
    absolute_angles,
    problem,
    rates,
    totals,
)

Outcomes: TypeAlias = Mapping[str, Outcome]
"""What came out of an experiment's runs, by their labels."""

Measure: TypeAlias = Callable[[Outcomes], float]

NAMES = {"wang": "Wang", "liu-huston": "Liu–Huston"}

WRONG = 1.01
"""The factor by which a logged torque is made wrong."""


def final(outcome: Outcome, function: str) -> float:
    """|ΔC| at the end (J)."""
    return abs(float(outcome.ledger.delta_c[function][-1]))


def largest(outcome: Outcome, function: str) -> float:
    """Largest |ΔC| (J)."""
    return float(np.abs(outcome.ledger.delta_c[function]).max())


def final_of(label: str, function: str = "wang") -> Measure:
    """|ΔC| of a run at its end (J)."""
    return lambda runs: final(runs[label], function)


def largest_of(label: str, function: str = "wang") -> Measure:
    """Largest |ΔC| of a run (J)."""
    return lambda runs: largest(runs[label], function)


def relative_of(label: str) -> Measure:
    """Largest |ΔC| of either function over the energy turned over."""
    return lambda runs: max(runs[label].ledger.relative(function) for function in NAMES)


def ratio(first: str, second: str) -> Measure:
    """How many times larger the largest |ΔC| is in the first run: the smaller ratio of the two functions."""
    return lambda runs: min(
        largest(runs[first], function) / largest(runs[second], function) for function in NAMES
    )


def farthest(first: str, second: str) -> Measure:
    """As `ratio`, the larger of the two functions' ratios, whichever run is larger."""

    def measure(runs: Outcomes) -> float:
        pairs = [(largest(runs[first], f), largest(runs[second], f)) for f in NAMES]
        return max(max(pair) / min(pair) for pair in pairs)

    return measure


def order(coarse: str, fine: str) -> Measure:
    """The order of convergence of Wang's largest |ΔC| that two steps show."""

    def measure(runs: Outcomes) -> float:
        finer = math.log(runs[coarse].run.step / runs[fine].run.step)
        return math.log(largest(runs[coarse], "wang") / largest(runs[fine], "wang")) / finer

    return measure


def kinetic_at_start(label: str) -> Measure:
    """K(0) (J)."""
    return lambda runs: float(runs[label].ledger.kinetic[0])


def angles_apart(first: str, second: str) -> Measure:
    """Largest difference of the final angles of two runs (degrees)."""

    def measure(runs: Outcomes) -> float:
        ends = [absolute_angles(runs[label].trajectory)[-1] for label in (first, second)]
        return math.degrees(float(np.abs(ends[0] - ends[1]).max()))

    return measure


def calmed(label: str, window: float = 10.0) -> Measure:
    """Mean kinetic energy over the last `window` seconds, as a fraction of that over the first."""

    def measure(runs: Outcomes) -> float:
        t, kinetic = runs[label].ledger.t, runs[label].ledger.kinetic
        late, early = kinetic[t >= t[-1] - window], kinetic[t <= t[0] + window]
        return float(late.mean() / early.mean())

    return measure


def horizon(label: str) -> Measure:
    """The divergence horizon (s); infinite where there is none."""

    def measure(runs: Outcomes) -> float:
        found = runs[label].horizon
        return math.inf if found is None else found

    return measure


def torque(label: str, extreme: Callable[[np.ndarray], float]) -> Measure:
    """An extreme of the driving torque M1 (N·m)."""
    return lambda runs: float(extreme(runs[label].trajectory.forces[PRESCRIBED][:, 0]))


def torque_by_hand(label: str) -> Measure:
    """Largest difference of M1 from that of the hand-written equations (N·m)."""

    def measure(runs: Outcomes) -> float:
        trajectory = runs[label].trajectory
        mechanism = problem(runs[label].run.variant).mechanism
        by_hand = triple_pendulum.driving_torque(mechanism, trajectory)
        return float(np.abs(trajectory.forces[PRESCRIBED][:, 0] - by_hand).max())

    return measure


def totals_apart(label: str, duration: float) -> Measure:
    """Largest difference of ΔC told three ways, as a fraction of the energy turned over.

    Only a fine step shows rounding, not quadrature; so a part of the `duration` (s) must do.
    """
    return lambda runs: totals(replace(runs[label].run, duration=duration)).spread


def rates_apart(label: str) -> Measure:
    """Largest difference of ε told three ways, as a fraction of the largest power of M1."""
    return lambda runs: rates(runs[label].trajectory).spread


def wrong_torque(label: str, told: Callable[[ThreeWays], np.ndarray]) -> Measure:
    """Largest change of ΔC when the logged M1 is wrong by one percent (J)."""

    def measure(runs: Outcomes) -> float:
        right, wrong = (_totals(runs[label].run, factor) for factor in (1.0, WRONG))
        return float(np.abs(told(wrong) - told(right)).max())

    return measure


@cache
def _totals(run: Run, factor: float) -> ThreeWays:
    return totals(run, factor)
