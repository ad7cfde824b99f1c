"""The next step of an adaptive solver, from what the last one left: local error, and the change of ΔC.

A step is accepted where both are within the tolerance. The local error, from an embedded method, is relative
to the state. ΔC is known at no cost, since the powers of testing functions are integrated with the motion;
what it may change in a step is the step's share of the run. So |ΔC| at the end is within the tolerance, as a
fraction of the energy that takes part: the largest kinetic energy so far and the range of the potential one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deltac.arrays import Array

SAFETY, LEAST, MOST = 0.9, 0.2, 5.0
"""Factors on the step that would just do, and between one step and the next (Hairer, Nørsett, Wanner)."""

ABSOLUTE = 1e-3
"""Absolute tolerance of a coordinate or speed near zero, as a share of the relative one."""

ROUNDED = 64 * float(np.finfo(np.float64).eps)
"""Change of ΔC, as a share of the energies, that rounding makes."""


@dataclass
class StepControl:
    """What is accepted of a step, by the energies that a run has shown so far.

    `tolerance` is that of `solvers.Adaptive`, `duration` the run's (s); `order` is the method's, `embedded`
    that of the embedded one. `kinetic` is the largest K, `low` and `high` the range of V, J.
    """

    tolerance: float
    duration: float
    order: int
    embedded: int
    kinetic: float = 0.0
    low: float = np.inf
    high: float = -np.inf

    def see(self, K: float, V: float) -> None:
        """Energies of a state that a step ended at."""
        self.kinetic = max(self.kinetic, K)
        self.low, self.high = min(self.low, V), max(self.high, V)

    def local(self, x0: Array, x1: Array, error: Array) -> float:
        """The local error of coordinates and speeds, 1 where it is just accepted."""
        size = np.maximum(np.abs(x0), np.abs(x1))
        allowed = self.tolerance * (ABSOLUTE + size)
        return float(np.sqrt(np.mean((error / allowed) ** 2))) if error.size else 0.0

    def energy(self, change: float, K: float, V: float, h: float) -> float:
        """The change of ΔC in a step, 1 where it is just accepted."""
        low, high = min(self.low, V), max(self.high, V)
        taking_part = max(self.kinetic, K) + high - low
        allowed = self.tolerance * taking_part * h / self.duration
        rounding = ROUNDED * (abs(K) + max(abs(low), abs(high)))
        return float(abs(change) / (allowed + rounding + 1e-300))

    def next(self, h: float, local: float, energy: float) -> float:
        """The length of the next step, or of the same one again."""
        factors = [
            SAFETY * max(error, 1e-10) ** (-1.0 / power)
            # ΔC over a step is of order p + 1, and what it may be is in proportion to the step.
            for error, power in ((local, self.embedded + 1), (energy, self.order))
        ]
        return float(h * min(MOST, max(LEAST, min(factors))))
