"""The driven pendulum's torque M1 told three ways (3.2.24)-(3.2.44), and a wrong log of it.

1. As an applied force: bar 1 is free, and the logged M1 acts on it; Q̇ = vᵀF_D.
2. As the multiplier of the motion constraint θ̇1 − Aω cos ωt = 0: Q̇ = −bᵀλ_m, λ_m being M1.
3. From accelerations: no torque is needed, Q̇ = v_tᵀF′ with F′ = −(F + F*).

All three give Wang's function the same total. The first two believe the log: they see a torque
that is wrong. The third does not look at it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from deltac.energy import balance, residuals
from deltac.mechanism import Mechanism
from deltac.studies.thesis.runs import Array, Run, problem, trajectory_of
from deltac.trajectories import Trajectory

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
        others.energy_exchanged,
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
    bare = replace(trajectory, forces={}, works={}, integrals={})
    return replace(bare, forces={APPLIED: torque}), replace(bare, forces={PRESCRIBED: torque})
