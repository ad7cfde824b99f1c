"""The numbers that the thesis's statements are about, read off the runs of an experiment."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import TypeAlias

import numpy as np

from deltac.arrays import Array
from deltac.problems import triple_pendulum
from deltac.problems.triple_pendulum_equations import HandEquations
from deltac.simulation.solvers import find_solver
from deltac.studies.thesis.runs import (
    PRESCRIBED,
    Outcome,
    Run,
    Tellings,
    absolute_angles,
    exactly,
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
    """Largest |ΔC| of either function over the energy exchanged."""
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


def apart(label: str) -> Measure:
    """The largest |ΔC| of one function over that of the other, whichever is larger."""

    def measure(runs: Outcomes) -> float:
        sizes = [largest(runs[label], function) for function in NAMES]
        return max(sizes) / min(sizes)

    return measure


def evaluations(first: str, second: str) -> Measure:
    """How many times as many evaluations of the accelerations the second run takes."""

    def of(run: Run) -> float:
        return run.duration / run.step * find_solver(run.solver).stages

    return lambda runs: of(runs[second].run) / of(runs[first].run)


def euler_relation(label: str) -> Measure:
    """How far LH − W/2 is from (h/4) (ṗ·u − ṗ·u at the start), beside the largest |LH − W/2|.

    Euler's method leaves u(t_k+1) = u + h u̇ without a curvature: per step K errs by h² u̇ᵀM u̇ / 2, and
    the sum h Σ P by h² Ṗ / 2. What remains between LH and half of W adds up to a difference of end
    values, to O(h²). p = M u are the generalized momenta.
    """

    def measure(runs: Outcomes) -> float:
        outcome = runs[label]
        liu, wang = (outcome.ledger.delta_c[f] for f in ("liu-huston", "wang"))
        found, power = liu - wang / 2, _momentum_power(outcome)
        expected = outcome.run.step / 4 * (power - power[0])
        return float(np.abs(found - expected).max() / np.abs(found).max())

    return measure


def _momentum_power(outcome: Outcome) -> Array:
    """ṗ·u = 2 K̇ − u·M u̇ of the undamped pendulum, by the equations on paper (W)."""
    hand = HandEquations.of(problem(outcome.run.variant).mechanism.parameters)
    theta = absolute_angles(outcome.trajectory).T
    omega = np.cumsum(outcome.trajectory.u, axis=1).T
    (M11, M12, M13, M22, M23, M33), _ = hand.terms(theta, omega)
    a1, a2, a3 = hand.free(0.0, theta, omega)
    momenta = (M11 * a1 + M12 * a2 + M13 * a3, M12 * a1 + M22 * a2 + M23 * a3)
    inertial = omega[0] * momenta[0] + omega[1] * momenta[1]
    inertial = inertial + omega[2] * (M13 * a1 + M23 * a2 + M33 * a3)
    weights = np.array([hand.g1, hand.g2, hand.g3])[:, None]
    power: Array = -2 * (weights * np.sin(theta) * omega).sum(axis=0) - inertial
    return power


def mistake_exactly(label: str) -> Measure:
    """How far Wang's ΔC is from that of the sign mistake in closed form, as a fraction of its largest.

    The wrong sign is a torque of twice the weight's: ΔC(t) = −2 g₂ (cos θ₂ − cos θ₂(0)), with
    g₂ = (m₂r₂ + m₃l₂) g; with dampers too.
    """

    def measure(runs: Outcomes) -> float:
        outcome = runs[label]
        hand = HandEquations.of(problem(outcome.run.variant).mechanism.parameters)
        cosine = np.cos(absolute_angles(outcome.trajectory)[:, 1])
        exact = -2 * hand.g2 * (cosine - cosine[0])
        found = outcome.ledger.delta_c["wang"]
        return float(np.abs(found - exact).max() / np.abs(exact).max())

    return measure


def overtaken(first: str, second: str) -> Measure:
    """The last time at which the first run's |ΔC| of Wang is the larger one (s)."""

    def measure(runs: Outcomes) -> float:
        a, b = (np.abs(runs[label].ledger.delta_c["wang"]) for label in (first, second))
        return float(runs[first].ledger.t[np.flatnonzero(a >= b)[-1]])

    return measure


def departure(label: str) -> Measure:
    """When an angle is first more than a degree off the exact motion; inf: never."""

    def measure(runs: Outcomes) -> float:
        outcome = runs[label]
        exact = absolute_angles(exactly(outcome.run))
        off = np.abs(absolute_angles(outcome.trajectory) - exact).max(axis=1) > math.radians(1.0)
        return float(outcome.trajectory.t[int(off.argmax())]) if off.any() else math.inf

    return measure


def widest(label: str) -> Measure:
    """The largest angle that a bar reaches, either way (degrees)."""
    return lambda runs: math.degrees(float(np.abs(absolute_angles(runs[label].trajectory)).max()))


def work_of(label: str, channel: str) -> Measure:
    """The work of a channel over the run (J)."""
    return lambda runs: float(runs[label].ledger.work[channel][-1])


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
    """Largest difference of ΔC told in four ways, as a fraction of the energy exchanged.

    Only a fine step shows rounding, not quadrature; so a part of the `duration` (s) must do.
    """
    return lambda runs: totals(replace(runs[label].run, duration=duration)).spread


def rates_apart(label: str) -> Measure:
    """Largest difference of ε told in four ways, as a fraction of the largest power of M1."""
    return lambda runs: rates(runs[label].trajectory).spread


def wrong_torque(label: str, told: Callable[[Tellings], np.ndarray]) -> Measure:
    """Largest change of ΔC when the logged M1 is wrong by one percent (J)."""

    def measure(runs: Outcomes) -> float:
        right, wrong = (_totals(runs[label].run, factor) for factor in (1.0, WRONG))
        return float(np.abs(told(wrong) - told(right)).max())

    return measure


@cache
def _totals(run: Run, factor: float) -> Tellings:
    return totals(run, factor)
