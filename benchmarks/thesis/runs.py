"""The runs behind the figures: variants of the triple pendulum, simulated and put in ledgers."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import numpy as np

from deltac import problems
from deltac.arrays import Array
from deltac.energy import Ledger
from deltac.mechanism.state import State
from deltac.problems import Problem
from deltac.simulation.equations import Equations
from deltac.simulation.solvers import Scipy
from deltac.simulation.step_size.energy_error import EnergyErrorWarning
from deltac.trajectories import Trajectory
from deltac.verbs import balance, residuals, simulate

_TUMBLING: dict[str, Any] = {
    "start": (math.radians(30), math.radians(60), math.radians(15)),
    "rates": (10.0, 0.0, 0.0),
    "weights": (10.0, 40.0, 10.0),
}
DAMPING = 1e-3
"""Of each joint (N·m·s/rad); the thesis states it for fig. 4.8 (l. 5042), not for fig. 4.10."""

VARIANTS: Mapping[str, Mapping[str, Any]] = {
    "standard": {},
    "fast": {"rates": (10.0, 0.0, 0.0)},
    "driven": {"drive": "motion"},
    "driven by a logged torque": {"drive": "torque"},
    "driven by a constraint": {"drive": "constraint"},
    "tumbling": _TUMBLING,
    "tumbling, damped": {**_TUMBLING, "damping": DAMPING},
    "by hand": {},
    "by hand, driven": {"drive": "motion"},
    "by hand, sign mistake": {"mistake": True},
    "by hand, sign mistake, damped": {"mistake": True, "damping": DAMPING},
    "by hand, accelerations to 1e-9": {"noise": 1e-9},
    "by hand, accelerations to 1e-10": {"noise": 1e-10},
    "by hand, driven, accelerations to 1e-9": {"drive": "motion", "noise": 1e-9},
    "by hand, driven, accelerations to 1e-10": {"drive": "motion", "noise": 1e-10},
}
"""Name -> options of the problem "triple-pendulum".

"by hand": by the equations (3.1.17)-(3.1.19), in absolute angles; the others by the mechanism's own, in the
joints' angles.
"""

DAMPERS = ("c1", "c2", "c3")
"""Inputs of the compiled code, so that a damped run needs no compilation of its own."""

SAMPLES_PER_SECOND = 1000
"""Highest rate of recording. The integrals in the loop take every step."""

PERTURBATION, SEPARATION = 1e-12, math.radians(1.0)
"""The divergence horizon is where runs whose θ2(0) differ by the first (rad) differ by the second."""


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

    @cached_property
    def rates(self) -> dict[str, Array]:
        """The functions in rate form (T,), W: Wang's is K̇ + V̇ − Q̇ (2.4.1)."""
        mechanism = problem(self.run.variant).mechanism
        return residuals(mechanism, self.trajectory, testing=("wang", "liu-huston"))


@cache
def problem(variant: str) -> Problem:
    """The triple pendulum in one of `VARIANTS`; the same object every time, so it compiles once."""
    options = dict(VARIANTS[variant])
    noise = options.pop("noise", 0.0)
    pendulum = problems.load("triple-pendulum", **options)
    if noise:
        return replace(pendulum, equations=disturbed(pendulum.equations, noise))
    if variant.startswith("by hand"):
        return pendulum
    return replace(pendulum, mechanism=pendulum.mechanism.varying(*DAMPERS))


ERRATIC = 1e9
"""Frequency of the erratic error (1/rad): a stage's change of angle takes it around many times."""


def disturbed(equations: Equations, noise: float) -> Equations:
    """Equations whose accelerations are off by up to `noise`, relatively, in a way that no two stages share.

    As an iterative solver of the accelerations leaves them. A function of the state that oscillates within
    nanoradians is as good as random, the same on every run, and can be compiled.
    """

    def rhs(t: Any, theta: Any, omega: Any) -> Any:
        return equations.rhs(t, theta, omega) * (1.0 + noise * np.sin(ERRATIC * (theta + omega)))

    return replace(equations, rhs=rhs)


def perform(run: Run) -> Outcome:
    """Simulate the run and its twin, and balance it in the loop (Wang, Liu-Huston)."""
    pendulum = problem(run.variant)
    trajectory = trajectory_of(run, pendulum.state, run.every)
    twin = trajectory_of(run, _perturbed(pendulum.state), run.every)
    distance = np.abs(absolute_angles(trajectory) - absolute_angles(twin)).max(axis=1)
    parted = distance > SEPARATION
    horizon = float(trajectory.t[int(parted.argmax())]) if parted.any() else None
    ledger = balance(pendulum.mechanism, trajectory, work="in-loop")
    return Outcome(run, trajectory, ledger, horizon)


def trajectory_of(run: Run, state: State, every: int = 1) -> Trajectory:
    """The motion of a run from a state, every so many steps recorded."""
    pendulum = problem(run.variant)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EnergyErrorWarning)  # some runs are wrong on purpose
        return simulate(
            pendulum.mechanism,
            state,
            run.duration,
            run.step,
            run.solver,
            equations=pendulum.equations if run.by_hand else None,
            record=every,
        )


def exactly(run: Run) -> Trajectory:
    """The exact motion of a run at the same times: SciPy's DOP853, to 4e-12 rad (Taylor's method)."""
    pendulum = problem(run.variant)
    interval = run.step * run.every
    solver = Scipy("DOP853", tolerance=1e-13)
    return simulate(pendulum.mechanism, pendulum.state, run.duration, interval, solver)


def absolute_angles(run: Trajectory) -> Array:
    """θ (T, 3) of the bars from the downward vertical (rad); joints hold relative angles."""
    return np.cumsum(run.q, axis=1)


def _perturbed(state: State) -> State:
    """θ2 larger by the perturbation, θ1 and θ3 as they were."""
    return replace(state, q=state.q + np.array([0.0, PERTURBATION, -PERTURBATION]))


# --- the drive M1 in four forms (3.2.24)-(3.2.44) -------------------------------------------------
# 1. An applied force: bar 1 is free, and the logged M1 acts on it; Q̇ = vᵀF_D. So the thesis reads it:
#    M1 is part of F̂_D, b̂ᵀ(F̂ + F̂*) = 0 (3.2.35) and Q̇ = q̇ᵀF̂_D (3.2.36).
# 2. The multiplier of the motion constraint θ̇1 − Aω cos ωt = 0 (3.2.26): Q̇ = −bᵀλ_m, λ_m being M1.
# 3. The force that drives a prescribed joint: Q̇ = v_tᵀF′.
# 4. The inertia forces: no torque is needed, Q̇ = v_tᵀF′ with F′ = −(F + F*).
# All four give Wang's function the same total. The first three use the logged torque, so they see
# a wrong one. The fourth does not look at it.

PRESCRIBED, APPLIED, CONSTRAINT = "prescribed joint1", "actuator M1", "constraint drive"


@dataclass(frozen=True, eq=False)
class DriveForms:
    """The same quantity (T,) with the drive in four forms, and the scale of its rounding."""

    applied: Array
    multiplier: Array
    prescribed: Array
    accelerations: Array
    scale: float

    @property
    def torque_spread(self) -> float:
        """Largest difference of those that use the torque, as a fraction of the scale."""
        forms = np.array([self.applied, self.multiplier, self.prescribed])
        return float(np.ptp(forms, axis=0).max()) / self.scale

    @property
    def spread(self) -> float:
        """Largest difference of any two, as a fraction of the scale."""
        forms = np.array([self.applied, self.multiplier, self.prescribed, self.accelerations])
        return float(np.ptp(forms, axis=0).max()) / self.scale


def totals(run: Run, factor: float = 1.0) -> DriveForms:
    """Wang's ΔC (J) along the samples, M1 logged at every step and multiplied by `factor`.

    Its scale is the energy exchanged (J).
    """
    logs = _logs(trajectory_of(run, problem(run.variant).state), factor)
    ledgers = {
        variant: balance(problem(variant).mechanism, log, work="samples", testing=("wang",))
        for variant, log in logs.items()
    }
    free, constrained, driven = ledgers.values()
    return DriveForms(
        free.delta_c["wang"],
        constrained.delta_c["wang"],
        driven.delta_c["wang"],
        driven.delta_c["wang-inertial"],
        driven.energy_exchanged,
    )


def rates(trajectory: Trajectory) -> DriveForms:
    """Wang's ε (W) at every sample: no quadrature, so that the solver does not matter.

    Its scale is the largest power of M1 (W).
    """
    free, constrained, driven = (
        residuals(problem(variant).mechanism, log, testing=("wang",))
        for variant, log in _logs(trajectory, 1.0).items()
    )
    power = np.abs(trajectory.forces[PRESCRIBED] * trajectory.u).sum(axis=1)
    return DriveForms(
        free["wang"],
        constrained["wang"],
        driven["wang"],
        driven["wang-inertial"],
        scale=float(power.max()),
    )


def _logs(trajectory: Trajectory, factor: float) -> dict[str, Trajectory]:
    """The motion with M1 as the log of a motor, of the constraint, and of the prescribed joint."""
    torque = factor * trajectory.forces[PRESCRIBED]
    bare = replace(trajectory, forces={}, works={}, integrals={})
    channels = {
        "driven by a logged torque": APPLIED,
        "driven by a constraint": CONSTRAINT,
        "driven": PRESCRIBED,
    }
    return {variant: replace(bare, forces={name: torque}) for variant, name in channels.items()}
