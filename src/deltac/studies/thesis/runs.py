"""The runs behind the figures: variants of the triple pendulum, simulated and put in ledgers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from deltac import problems
from deltac.arrays import Array
from deltac.energy import Ledger, balance, residuals
from deltac.mechanism import Mechanism, State
from deltac.problems import Problem
from deltac.simulation.simulate import simulate
from deltac.trajectories import Trajectory

_TUMBLING: dict[str, Any] = {
    "start": (math.radians(30), math.radians(60), math.radians(15)),
    "rates": (10.0, 0.0, 0.0),
    "weights": (10.0, 40.0, 10.0),
}
DAMPING = 1e-3
"""Of each joint (N·m·s/rad); the thesis states it for fig. 4.8 and not for fig. 4.10."""

VARIANTS: Mapping[str, Mapping[str, Any]] = {
    "standard": {},
    "fast": {"rates": (10.0, 0.0, 0.0)},
    "driven": {"drive": "motion"},
    "driven by a logged torque": {"drive": "torque"},
    "tumbling": _TUMBLING,
    "tumbling, damped": {**_TUMBLING, "damping": DAMPING},
    "by hand": {},
    "by hand, sign mistake": {"mistake": True},
    "by hand, sign mistake, damped": {"mistake": True, "damping": DAMPING},
}
"""Name -> options of the problem "triple-pendulum". "by hand": by the equations (3.1.17)-(3.1.19)."""

DAMPERS = ("c1", "c2", "c3")
"""Stay parameters of the compiled code, so that a damped run needs no compilation of its own."""

SAMPLES_PER_SECOND = 1000
"""At most: finer steps are not all recorded. The integrals in the loop take every step."""

PERTURBATION, PARTED = 1e-12, math.radians(1.0)
"""The divergence horizon: when do two runs whose θ2(0) differ by the one (rad) part by the other?"""


@dataclass(frozen=True)
class Run:
    """A variant of the pendulum, a fixed-step solver, its step (s) and the duration (s)."""

    variant: str
    solver: str
    step: float
    duration: float = 10.0

    @property
    def by_hand(self) -> bool:
        """Whether the hand-written equations move it, instead of the mechanism's own."""
        return self.variant.startswith("by hand")

    @property
    def every(self) -> int:
        """How many steps there are between recorded samples."""
        return max(1, round(1.0 / (self.step * SAMPLES_PER_SECOND)))


@dataclass(frozen=True, eq=False)
class Outcome:
    """A run, its trajectory, its ledger in the loop, and its divergence horizon.

    `horizon` (s) is the first sample at which a twin, started with θ2 larger by 1e-12 rad, has an
    angle that differs by more than one degree; None if there is none. Beyond it, digits of the
    angles depend on the machine: the motion is chaotic.
    """

    run: Run
    trajectory: Trajectory
    ledger: Ledger
    horizon: float | None


@cache
def problem(variant: str) -> Problem:
    """The triple pendulum in one of `VARIANTS`; the same object every time, so it compiles once."""
    return problems.load("triple-pendulum", **VARIANTS[variant])


def perform(run: Run) -> Outcome:
    """Simulate the run and its twin, and balance it in the loop (Wang, Liu-Huston)."""
    chosen = problem(run.variant)
    trajectory = trajectory_of(run, chosen.state, run.every)
    twin = trajectory_of(run, _perturbed(chosen.state), run.every)
    apart = np.abs(absolute_angles(trajectory) - absolute_angles(twin)).max(axis=1) > PARTED
    horizon = float(trajectory.t[int(apart.argmax())]) if apart.any() else None
    ledger = balance(chosen.mechanism, trajectory, work="in-loop")
    return Outcome(run, trajectory, ledger, horizon)


def trajectory_of(run: Run, state: State, every: int = 1) -> Trajectory:
    """The motion of a run from a state, every so many steps recorded."""
    chosen = problem(run.variant)
    return simulate(
        chosen.mechanism,
        state,
        run.duration,
        run.step,
        run.solver,
        equations=chosen.equations if run.by_hand else None,
        record_every=every,
        vary=() if run.by_hand else DAMPERS,
    )


def absolute_angles(run: Trajectory) -> Array:
    """θ (T, 3) of the bars from the downward vertical (rad); joints hold relative angles."""
    return np.cumsum(run.q, axis=1)


def _perturbed(state: State) -> State:
    """θ2 larger by the perturbation, θ1 and θ3 as they were."""
    return replace(state, q=state.q + np.array([0.0, PERTURBATION, -PERTURBATION]))


# --- the driven pendulum's torque M1 told three ways (3.2.24)-(3.2.44) ---------------------------
# 1. As an applied force: bar 1 is free, and the logged M1 acts on it; Q̇ = vᵀF_D.
# 2. As the multiplier of the motion constraint θ̇1 − Aω cos ωt = 0: Q̇ = −bᵀλ_m, λ_m being M1.
# 3. From accelerations: no torque is needed, Q̇ = v_tᵀF′ with F′ = −(F + F*).
# All three give Wang's function the same total. The first two believe the log: they see a torque
# that is wrong. The third does not look at it.

PRESCRIBED, APPLIED = "prescribed joint1", "actuator M1"


@dataclass(frozen=True, eq=False)
class ThreeWays:
    """The same quantity (T,) told three ways, and the scale that its rounding is judged by."""

    applied: Array
    multiplier: Array
    accelerations: Array
    scale: float

    @property
    def torque_spread(self) -> float:
        """Largest difference of the two that use the torque, as a fraction of the scale."""
        return float(np.abs(self.applied - self.multiplier).max()) / self.scale

    @property
    def spread(self) -> float:
        """Largest difference of any two, as a fraction of the scale."""
        told = np.array([self.applied, self.multiplier, self.accelerations])
        return float(np.ptp(told, axis=0).max()) / self.scale


def totals(run: Run, factor: float = 1.0) -> ThreeWays:
    """Wang's ΔC (J) along the samples, M1 logged at every step and multiplied by `factor`.

    Its scale is the energy turned over (J).
    """
    free, driven = _mechanisms()
    applied, multiplier = _told(trajectory_of(run, problem(run.variant).state), factor)
    first = balance(free, applied, work="samples", testing=("wang",))
    others = balance(driven, multiplier, work="samples", testing=("wang",))
    return ThreeWays(
        first.delta_c["wang"],
        others.delta_c["wang"],
        others.delta_c["wang-inertial"],
        others.turnover,
    )


def rates(trajectory: Trajectory) -> ThreeWays:
    """Wang's ε (W) at every sample: no quadrature, so that the solver does not matter.

    Its scale is the largest power of M1 (W).
    """
    free, driven = _mechanisms()
    applied, multiplier = _told(trajectory, 1.0)
    first = residuals(free, applied, testing=("wang",))
    others = residuals(driven, multiplier, testing=("wang",))
    power = np.abs(trajectory.forces[PRESCRIBED] * trajectory.u).sum(axis=1)
    return ThreeWays(
        first["wang"], others["wang"], others["wang-inertial"], scale=float(power.max())
    )


def _mechanisms() -> tuple[Mechanism, Mechanism]:
    return problem("driven by a logged torque").mechanism, problem("driven").mechanism


def _told(trajectory: Trajectory, factor: float) -> tuple[Trajectory, Trajectory]:
    """The motion with M1 as the log of a motor, and as that of the prescribed joint."""
    torque = factor * trajectory.forces[PRESCRIBED]
    bare = replace(trajectory, forces={}, integrals={})
    return replace(bare, forces={APPLIED: torque}), replace(bare, forces={PRESCRIBED: torque})
