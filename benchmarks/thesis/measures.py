"""The numbers that the thesis's statements are about, read off one run or two."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from operator import attrgetter

import numpy as np

from deltac import solvers
from deltac.arrays import Array
from deltac.problems import triple_pendulum
from deltac.problems.triple_pendulum_equations import HandEquations
from thesis.runs import (
    CONSTRAINT,
    PRESCRIBED,
    DriveForms,
    Outcome,
    Run,
    absolute_angles,
    exactly,
    problem,
    rates,
    totals,
)

NAMES = {"wang": "Wang", "liu-huston": "Liu–Huston"}

WRONG = 1.01
"""The factor by which a logged torque is made wrong."""

START = 2.0
"""Seconds of the initial error of 4.9 (l. 5146), and of the run in which the four forms of the drive are
compared: only a fine step shows rounding, not quadrature."""

WINDOW = 10.0
"""Seconds at the start and at the end whose mean kinetic energies are compared."""


@dataclass(frozen=True)
class Measure:
    """A number `of` the outcomes of one run or two: the `quantity` and its `unit`."""

    quantity: str
    unit: str
    of: Callable[..., float]


def final(outcome: Outcome, function: str = "wang") -> float:
    """|ΔC| at the end (J)."""
    return abs(float(outcome.ledger.delta_c[function][-1]))


def largest(outcome: Outcome, function: str = "wang") -> float:
    """Largest |ΔC| (J)."""
    return float(np.abs(outcome.ledger.delta_c[function]).max())


def relative(outcome: Outcome) -> float:
    """Largest |ΔC| of either function over the energy exchanged."""
    return max(outcome.ledger.relative(function) for function in NAMES)


def ratio(first: Outcome, second: Outcome) -> float:
    """How many times larger the largest |ΔC| is in the first run: the smaller ratio of the two functions."""
    return min(largest(first, function) / largest(second, function) for function in NAMES)


def ratio_at_first(first: Outcome, second: Outcome) -> float:
    """As `ratio`, of the first seconds."""

    def initial(outcome: Outcome, function: str) -> float:
        ledger = outcome.ledger
        early = ledger.t <= START + 0.5 * outcome.run.step
        return float(np.abs(ledger.delta_c[function][early]).max())

    return min(initial(first, function) / initial(second, function) for function in NAMES)


def farthest(first: Outcome, second: Outcome) -> float:
    """As `ratio`, the larger of the two functions' ratios, whichever run is larger."""
    pairs = [(largest(first, function), largest(second, function)) for function in NAMES]
    return max(max(pair) / min(pair) for pair in pairs)


def functions_apart(outcome: Outcome) -> float:
    """The largest |ΔC| of one function over that of the other, whichever is larger."""
    sizes = [largest(outcome, function) for function in NAMES]
    return max(sizes) / min(sizes)


def evaluations(first: Outcome, second: Outcome) -> float:
    """How many times as many evaluations of the accelerations the second run takes."""

    def of(run: Run) -> float:
        return run.duration / run.step * solvers.by_name(run.solver).solver.stages

    return of(second.run) / of(first.run)


def euler_relation(outcome: Outcome) -> float:
    """How far LH − W/2 is from (h/4) (ṗ·u − ṗ·u at the start), beside the largest |LH − W/2|.

    Euler's method leaves u(t_k+1) = u + h u̇ without a curvature: per step K errs by h² u̇ᵀM u̇ / 2, and
    the sum h Σ P by h² Ṗ / 2. What remains between LH and half of W adds up to a difference of end
    values, to O(h²). p = M u are the generalized momenta.
    """
    liu, wang = (outcome.ledger.delta_c[f] for f in ("liu-huston", "wang"))
    excess, power = liu - wang / 2, _momentum_power(outcome)
    expected = outcome.run.step / 4 * (power - power[0])
    return float(np.abs(excess - expected).max() / np.abs(excess).max())


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


def mistake_exactly(outcome: Outcome) -> float:
    """How far Wang's ΔC is from that of the sign mistake in closed form, as a fraction of its largest.

    The wrong sign is a torque of twice the weight's: ΔC(t) = −2 g₂ (cos θ₂ − cos θ₂(0)), with
    g₂ = (m₂r₂ + m₃l₂) g = 8.75 N·m, so that |ΔC| is at most 26.25 J; with dampers too.
    """
    hand = HandEquations.of(problem(outcome.run.variant).mechanism.parameters)
    cosine = np.cos(absolute_angles(outcome.trajectory)[:, 1])
    exact = -2 * hand.g2 * (cosine - cosine[0])
    error = outcome.ledger.delta_c["wang"] - exact
    return float(np.abs(error).max() / np.abs(exact).max())


def largest_rate(outcome: Outcome) -> float:
    """Largest |K̇ + V̇ − Q̇| over the largest power of the weights."""
    power = np.abs(outcome.ledger.power["gravity"]).max()
    return float(np.abs(outcome.rates["wang"]).max() / power)


def mistaken_rate(outcome: Outcome) -> float:
    """How far K̇ + V̇ − Q̇ is from that of the sign mistake, 2 g₂ θ̇₂ sin θ₂, as a fraction of its largest."""
    hand = HandEquations.of(problem(outcome.run.variant).mechanism.parameters)
    theta = absolute_angles(outcome.trajectory)[:, 1]
    omega = np.cumsum(outcome.trajectory.u, axis=1)[:, 1]
    exact = 2 * hand.g2 * omega * np.sin(theta)
    return float(np.abs(outcome.rates["wang"] - exact).max() / np.abs(exact).max())


def departure(outcome: Outcome) -> float:
    """When an angle is first more than a degree off the exact motion; inf: never."""
    exact = absolute_angles(exactly(outcome.run))
    deviations = np.abs(absolute_angles(outcome.trajectory) - exact).max(axis=1) > math.radians(1.0)
    return float(outcome.trajectory.t[int(deviations.argmax())]) if deviations.any() else math.inf


def widest(outcome: Outcome) -> float:
    """The largest angle that a bar reaches, either way (degrees)."""
    return math.degrees(float(np.abs(absolute_angles(outcome.trajectory)).max()))


def order(coarse: Outcome, fine: Outcome) -> float:
    """The order of convergence of Wang's largest |ΔC| that two steps show."""
    return math.log(largest(coarse) / largest(fine)) / math.log(coarse.run.step / fine.run.step)


def angles_apart(first: Outcome, second: Outcome) -> float:
    """Largest difference of the final angles of two runs (degrees)."""
    a, b = (absolute_angles(outcome.trajectory)[-1] for outcome in (first, second))
    return math.degrees(float(np.abs(a - b).max()))


def calmed(outcome: Outcome) -> float:
    """Mean kinetic energy over the last seconds, as a fraction of that over the first."""
    t, kinetic = outcome.ledger.t, outcome.ledger.kinetic
    late, early = kinetic[t >= t[-1] - WINDOW], kinetic[t <= t[0] + WINDOW]
    return float(late.mean() / early.mean())


def torque(outcome: Outcome) -> Array:
    """The driving torque M1 (T,), N·m."""
    return outcome.trajectory.forces[PRESCRIBED][:, 0]


def torque_by_hand(outcome: Outcome) -> float:
    """Largest difference of M1 from that of the hand-written equations (N·m)."""
    mechanism = problem(outcome.run.variant).mechanism
    by_hand = triple_pendulum.driving_torque(mechanism, outcome.trajectory)
    return float(np.abs(torque(outcome) - by_hand).max())


def wrong_torque(outcome: Outcome, form: Callable[[DriveForms], Array]) -> float:
    """Largest change of ΔC when the logged M1 is wrong by one percent (J)."""
    right, wrong = (_totals(outcome.run, factor) for factor in (1.0, WRONG))
    return float(np.abs(form(wrong) - form(right)).max())


@cache
def _totals(run: Run, factor: float) -> DriveForms:
    return totals(run, factor)


_WRONG_LOG = f"change of ΔC by a log of M1 × {WRONG:g}"
_FOUR_FORMS = "with the drive in four forms, spread"

MEASURES = {
    "Wang": Measure("max Wang |ΔC|", "J", largest),
    "Wang, bounded": Measure("max Wang |ΔC|, bounded", "J", largest),
    "Liu–Huston": Measure("max Liu–Huston |ΔC|", "J", partial(largest, function="liu-huston")),
    "Wang at the end": Measure("Wang |ΔC| at 10 s", "J", final),
    "Liu–Huston at the end": Measure(
        "Liu–Huston |ΔC| at 10 s", "J", partial(final, function="liu-huston")
    ),
    "relative": Measure("max |ΔC| / energy exchanged", "1", relative),
    "ratio": Measure("ratio of max |ΔC|", "1", ratio),
    "ratio, either way": Measure("ratio of max |ΔC|", "1", farthest),
    "either ratio": Measure("ratio of max |ΔC|, larger over smaller", "1", farthest),
    "functions apart": Measure(
        "larger of the functions' max |ΔC| over the smaller", "1", functions_apart
    ),
    "order": Measure("observed order of ΔC", "1", order),
    "evaluations": Measure("evaluations of the accelerations, ratio", "1", evaluations),
    "Euler's relation": Measure("LH − W/2 from (h/4) Δ(ṗ·u), relative", "1", euler_relation),
    "sign mistake exactly": Measure(
        "Wang's ΔC from −2 g₂ (cos θ₂ − cos θ₂(0)), relative", "1", mistake_exactly
    ),
    "ratio at first": Measure(f"ratio of max |ΔC| over 0–{START:g} s", "1", ratio_at_first),
    "rate": Measure("max |K̇ + V̇ − Q̇| / largest power of the weights", "1", largest_rate),
    "rate of the mistake": Measure("K̇ + V̇ − Q̇ from 2 g₂ θ̇₂ sin θ₂, relative", "1", mistaken_rate),
    "K(0)": Measure("K(0)", "J", lambda outcome: float(outcome.ledger.kinetic[0])),
    "calmed": Measure("mean K, last 10 s / first 10 s", "1", calmed),
    "angles apart": Measure("difference of final angles", "deg", angles_apart),
    "widest angle": Measure("largest angle of a bar", "deg", widest),
    "horizon": Measure(
        "divergence horizon",
        "s",
        lambda outcome: math.inf if outcome.horizon is None else outcome.horizon,
    ),
    "departure": Measure("a degree off the exact motion, from", "s", departure),
    "least M1": Measure("least M1", "N·m", lambda outcome: float(torque(outcome).min())),
    "largest M1": Measure("largest M1", "N·m", lambda outcome: float(torque(outcome).max())),
    "M1 by hand": Measure(
        "difference from M1 by the hand-written equations", "N·m", torque_by_hand
    ),
    "work of the drive": Measure(
        "work of the constraint θ̇1 − Aω cos ωt = 0",
        "J",
        lambda outcome: float(outcome.ledger.work[CONSTRAINT][-1]),
    ),
    "totals apart": Measure(
        f"ΔC over {START:g} s {_FOUR_FORMS} / energy exchanged",
        "1",
        lambda outcome: totals(replace(outcome.run, duration=START)).spread,
    ),
    "rates apart": Measure(
        f"ε {_FOUR_FORMS} / largest power of M1",
        "1",
        lambda outcome: rates(outcome.trajectory).spread,
    ),
    **{
        f"wrong log, {name}": Measure(
            f"{_WRONG_LOG}, {words}", "J", partial(wrong_torque, form=attrgetter(name))
        )
        for name, words in (
            ("applied", "as applied force"),
            ("multiplier", "as multiplier"),
            ("prescribed", "as force of the prescribed joint"),
            ("accelerations", "from accelerations"),
        )
    },
}
"""What the claims in `experiments.toml` measure, by the names that they use."""
