"""How a number is read off a trajectory, for references and invariants.

A signal has a value for every row of a trajectory, a measure one for the whole of it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac import rotations
from deltac.errors import LogError
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import Kind, Reference
from deltac.trajectories import Trajectory

if TYPE_CHECKING:
    from deltac.energy import Ledger

FloatArray: TypeAlias = NDArray[np.float64]
Signal: TypeAlias = Callable[[Trajectory], FloatArray]
Measure: TypeAlias = Callable[[Trajectory], float]


def instant(
    quantity: str, at: float, signal: Signal, value: float, unit: str, kind: Kind, accuracy: float
) -> Reference:
    """A reference for the value of a signal at the time `at` (s)."""
    return Reference(
        quantity=f"{quantity} at {at:g} s",
        value=value,
        unit=unit,
        kind=kind,
        accuracy=accuracy,
        at=at,
        measure=lambda run: float(signal(run)[row_at(run, at)]),
    )


def row_at(run: Trajectory, t: float) -> int:
    """The row whose time is `t` up to rounding; InputError if there is none."""
    row = int(np.abs(run.t - t).argmin())
    if abs(run.t[row] - t) > 1e-9 * max(1.0, abs(t)):
        raise LogError(
            f"the trajectory has no row at t = {t} s (the nearest is at {run.t[row]} s); simulate "
            "long enough, with a step that divides that time"
        )
    return row


def coordinate(name: str) -> Signal:
    """A coordinate along the trajectory."""
    return lambda run: run.coordinate(name)


def speed(name: str) -> Signal:
    """A speed along the trajectory."""
    return lambda run: run.speed(name)


def period(name: str) -> Measure:
    """The time between the first two upward passages of a coordinate through zero (s).

    Between rows the coordinate is the cubic that its values and rates define.
    """

    def measure(run: Trajectory) -> float:
        t, q, u = run.t, run.coordinate(name), run.speed(name)
        upward = np.flatnonzero((q[:-1] < 0.0) & (q[1:] >= 0.0))
        if len(upward) < 2:
            raise LogError(f"coordinate {name!r} does not pass upward through zero twice")
        first, second = (_root(t[k : k + 2], q[k : k + 2], u[k : k + 2]) for k in upward[:2])
        return second - first

    return measure


def largest(signal: Signal, sign: int = 1) -> Measure:
    """The largest value of a signal (the least, with `sign` −1).

    Between evenly spaced rows the signal is the quartic through the five around the largest one.
    """

    def measure(run: Trajectory) -> float:
        values = sign * signal(run)
        k = int(values.argmax())
        if not 2 <= k < len(values) - 2:
            return sign * float(values[k])
        quartic = np.polynomial.Polynomial.fit(np.arange(-2, 3), values[k - 2 : k + 3], 4)
        turning = quartic.deriv().roots()
        inside = turning.real[(abs(turning.imag) < 1e-9) & (abs(turning.real) <= 1.0)]
        return sign * float(np.max(quartic(inside), initial=values[k]))

    return measure


def _root(t: FloatArray, q: FloatArray, u: FloatArray) -> float:
    """Where the cubic through two values and rates is zero, by Newton from the secant's root."""
    h = t[1] - t[0]
    slope = q[1] - q[0]
    cubic = np.polynomial.Polynomial(
        [q[0], h * u[0], 3 * slope - h * (2 * u[0] + u[1]), h * (u[0] + u[1]) - 2 * slope]
    )
    s = -q[0] / slope
    for _ in range(4):
        s -= cubic(s) / cubic.deriv()(s)
    return float(t[0] + h * s)


def rotated(quaternion: FloatArray, vector: FloatArray) -> FloatArray:
    """Vectors (T, 3) or (3,) of a body in world components, by quaternions (T, 4), scalar first."""
    turned: FloatArray = (rotations.matrices(quaternion) @ np.asarray(vector)[..., None])[..., 0]
    return turned


# --- from the ledger ------------------------------------------------------------------------------


def energy(mechanism: Mechanism) -> Signal:
    """Kinetic and potential energy by the ledger (J)."""

    def signal(run: Trajectory) -> FloatArray:
        ledger = _ledger(mechanism, run)
        return ledger.kinetic + ledger.potential_energy

    return signal


def kinetic(mechanism: Mechanism) -> Signal:
    """Kinetic energy by the ledger (J)."""
    return lambda run: _ledger(mechanism, run).kinetic


def work(mechanism: Mechanism, channel: str) -> Signal:
    """The work that has entered through a channel, by the ledger (J)."""
    return lambda run: _ledger(mechanism, run).work[channel]


def delta_c_range(
    mechanism: Mechanism, coordinates: CoordinateMap | None, function: str
) -> Measure:
    """How far ΔC of a testing function spreads, largest minus smallest, by the ledger (J)."""

    def measure(run: Trajectory) -> float:
        return float(np.ptp(_ledger(mechanism, run, coordinates).delta_c[function]))

    return measure


@lru_cache(maxsize=4)
def _ledger(
    mechanism: Mechanism, run: Trajectory, coordinates: CoordinateMap | None = None
) -> Ledger:
    from deltac.energy import balance

    return balance(mechanism, run, work="samples", coordinates=coordinates)
