"""A published problem: what moves, how it starts, what must stay constant, what must come out.

A signal has a value for every row of a trajectory, a measure one for the whole of it. They read invariants
and references off a run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Literal, TypeAlias, get_args

import numpy as np

from deltac import rotations
from deltac.arrays import Array
from deltac.errors import InputError, LogError
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.state import State
from deltac.trajectories import Trajectory

if TYPE_CHECKING:
    from deltac.energy import Ledger
    from deltac.simulation.equations import Equations

ReferenceKind = Literal["exact", "published", "calculated"]
Signal: TypeAlias = Callable[[Trajectory], Array]
Measure: TypeAlias = Callable[[Trajectory], float]


G = 9.81
"""Acceleration of free fall (m/s²) in problems that name no other."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Reference:
    """A number that a right simulation must reproduce.

    quantity  what it is, for people: "θ(1 s)"
    value     its value, in `unit`
    kind      "exact" (a closed form), "published" (in the literature), or "calculated" (once, at
              high accuracy, by two independent routes)
    accuracy  how well the value itself is known: an absolute bound in `unit`
    at        the time it belongs to (s), None if it describes the whole motion
    measure   takes it from a trajectory; the trajectory must have a row at that time
    """

    quantity: str
    value: float
    unit: str
    kind: ReferenceKind
    accuracy: float
    measure: Measure
    at: float | None = None

    def __post_init__(self) -> None:
        if self.kind not in get_args(ReferenceKind):
            raise InputError(
                f"reference {self.quantity!r}: kind is {self.kind!r}, expected one of "
                f"{', '.join(get_args(ReferenceKind))}"
            )
        if not (math.isfinite(self.value) and math.isfinite(self.accuracy) and self.accuracy >= 0):
            raise InputError(
                f"reference {self.quantity!r}: value {self.value!r} ± {self.accuracy!r}; expected "
                "finite numbers, the accuracy zero or positive"
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """A problem of the library.

    name, title     what `load` knows it by; what it is, in a few words
    mechanism       what the machine is
    state           where the motion starts
    duration        how long it lasts (s)
    step, solver    a fixed step (s) and a solver that resolve the reference numbers; the step of an
                    adaptive solver is the spacing of its samples
    tolerance       relative, of an adaptive solver
    source          who published it
    freedom         degrees of freedom: independent speeds (without constraints, those that are free)
    invariants      name -> the constant quantity (T,) along a trajectory, written out by hand;
                    "energy" is always K + V, with V measured from the ground's origin
    reference       the numbers that must come out
    equations       equations of motion written by hand, where the source has them
    coordinates     the source's own generalized speeds for the testing functions, if they matter
    notes           what is worth knowing

    Raises InputError for impossible times, references outside the duration, and constraints without
    a word on the freedom that they leave.
    """

    name: str
    title: str
    mechanism: Mechanism
    state: State
    duration: float
    step: float
    solver: str
    source: str
    freedom: int | None = None
    invariants: Mapping[str, Signal] = field(default_factory=dict)
    reference: tuple[Reference, ...] = ()
    equations: Equations | None = None
    coordinates: CoordinateMap | None = None
    notes: str = ""
    tolerance: float | None = None

    def __post_init__(self) -> None:
        if not 0.0 < self.step <= self.duration < math.inf:
            raise InputError(
                f"problem {self.name!r}: step {self.step!r} s and duration {self.duration!r} s; "
                "expected 0 < step <= duration"
            )
        if self.freedom is None:
            if self.mechanism.constraints:
                raise InputError(
                    f"problem {self.name!r} has constraints; say how many degrees of freedom they "
                    "leave: freedom="
                )
            object.__setattr__(self, "freedom", len(self.mechanism.free.u))
        for reference in self.reference:
            if reference.at is not None and not 0.0 <= reference.at - self.state.t <= self.duration:
                raise InputError(
                    f"problem {self.name!r}: {reference.quantity} belongs to t = {reference.at} s, "
                    f"outside the duration of {self.duration} s"
                )

    @property
    def conserved(self) -> tuple[str, ...]:
        """The names of what stays constant."""
        return tuple(self.invariants)


# --- numbers of a run ------------------------------------------------------------------------------


def instant(
    quantity: str,
    at: float,
    signal: Signal,
    value: float,
    unit: str,
    kind: ReferenceKind,
    accuracy: float,
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


def instants(
    table: Mapping[float, Sequence[float]],
    signals: Mapping[str, Signal],
    unit: str,
    kind: ReferenceKind,
    accuracy: float,
) -> list[Reference]:
    """References for some signals by name: at each time (s) of the table, its value of each of them."""
    return [
        instant(quantity, at, signal, value, unit, kind, accuracy)
        for at, values in table.items()
        for (quantity, signal), value in zip(signals.items(), values, strict=True)
    ]


def whole(
    quantity: str, measure: Measure, value: float, unit: str, kind: ReferenceKind, accuracy: float
) -> Reference:
    """A reference for a number of the whole motion."""
    return Reference(
        quantity=quantity, value=value, unit=unit, kind=kind, accuracy=accuracy, measure=measure
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


def forward(joint: str) -> Signal:
    """The speed along the x axis of a body on a planar joint (m/s)."""

    def along(run: Trajectory) -> Array:
        angle = run.coordinate(f"{joint}.angle")
        return run.speed(f"{joint}.x") * np.cos(angle) + run.speed(f"{joint}.y") * np.sin(angle)

    return along


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


def _root(t: Array, q: Array, u: Array) -> float:
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


def rotated(quaternion: Array, vector: Array) -> Array:
    """Vectors (T, 3) or (3,) of a body in world components, by quaternions (T, 4), scalar first."""
    turned: Array = (rotations.matrices(quaternion) @ np.asarray(vector)[..., None])[..., 0]
    return turned


# --- from the ledger ------------------------------------------------------------------------------


def energy(mechanism: Mechanism) -> Signal:
    """Kinetic and potential energy by the ledger (J)."""

    def signal(run: Trajectory) -> Array:
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
