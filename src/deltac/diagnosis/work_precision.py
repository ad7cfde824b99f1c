"""Work and precision of a solver at a setting: what a run costs, and how wrong it is."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.energy import balance
from deltac.errors import DeltacError, InputError
from deltac.mechanism.mechanism import Mechanism
from deltac.simulation.simulate import SimulationStopped
from deltac.simulation.stiffness import StiffStep
from deltac.trajectories import Trajectory

if TYPE_CHECKING:
    from deltac.mechanism.coordinates import Entry

Array: TypeAlias = NDArray[np.float64]

REPEATS = 3
"""Times a run is timed; the least counts, because other work on the machine only adds."""

BRIEF = 0.25
"""A run that takes longer than this (s) is timed once."""

COMMON = 1e-9
"""Times that differ by this share of a run's length are the same."""


@dataclass(frozen=True, eq=False)
class Family:
    """A solver whose setting is to be chosen: a number of steps, or a tolerance.

    Attributes:
        name: of the solver, "ode5" or "mujoco:rk4".
        order: in the state, None where it varies.
        stages: evaluations of ẋ a step, 0 where that is not known beforehand.
        settings: coarse to fine: steps in s, or tolerances.
        knob: "step" or "tolerance".
        run: makes the trajectory of a setting, sampled finely enough to judge it.
        work: does the same without more recording than a user needs; it is timed. None: `run` is.
        halved: the setting that is to be compared with one, to tell how far its motion has converged.
    """

    name: str
    order: int | None
    stages: int
    settings: tuple[float, ...]
    knob: str
    run: Callable[[float], Trajectory]
    work: Callable[[float], object] | None = None
    halved: Callable[[float], float] = field(default=lambda h: h / 2)


@dataclass(frozen=True)
class Trial:
    """A solver at a setting.

    Attributes:
        solver: its name; `knob` is "step" (s) or "tolerance", `setting` its value.
        energy: largest |ΔC| of Wang's function, corrections included, as a share of the energy turned
            over; infinite for a run that broke down.
        motion: how far q and u are from the converged ones, estimated by the run at half the step (a
            tenth of the tolerance), as a share of the range of what has the same unit; NaN if not
            measured because the energy already fails.
        seconds: measured, compiled code at hand; evaluations: of ẋ, 0 where they were not counted.
        message: why the run ended early, or "".
    """

    solver: str
    knob: str
    setting: float
    energy: float
    motion: float
    seconds: float
    evaluations: int
    message: str = ""

    def passes(self, tolerance: float, motion_tolerance: float) -> bool:
        """Whether energy and motion are within their tolerances."""
        return self.energy <= tolerance and self.motion <= motion_tolerance

    def excess(self, tolerance: float, motion_tolerance: float) -> float:
        """By what factor the worse of the two exceeds its tolerance."""
        motion = 0.0 if math.isnan(self.motion) else self.motion
        return max(self.energy / tolerance, motion / motion_tolerance)

    def to_dict(self) -> dict[str, Any]:
        """For JSON; what is not finite becomes None."""
        values: dict[str, Any] = dict(vars(self))
        for name in ("energy", "motion"):
            values[name] = values[name] if math.isfinite(values[name]) else None
        return values


class Refused(InputError):
    """A solver that cannot do what the model asks for, whatever its step."""


@contextmanager
def quietly() -> Iterator[None]:
    """Without warnings of runs that stop or step too far: that is what is being found out."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SimulationStopped)
        warnings.simplefilter("ignore", StiffStep)
        yield


class Trials:
    """Trials of a mechanism, each run made once."""

    def __init__(self, mechanism: Mechanism, motion_tolerance: float) -> None:
        """Start without any; the motion is not measured if its tolerance is infinite."""
        self.mechanism = mechanism
        self._wants_motion = math.isfinite(motion_tolerance)
        self._runs: dict[tuple[str, float], Trajectory | str] = {}
        self.turnover = 0.0

    def of(self, family: Family, setting: float, tolerance: float) -> Trial:
        """A trial; the run at half the step is made only if the energy is within its tolerance.

        Raises Refused where the solver cannot be used at all.
        """
        run = self._run(family, setting)
        if isinstance(run, str):
            return self._failed(family, setting, run)
        energy = self._energy(run)
        if isinstance(energy, str):
            return self._failed(family, setting, energy)
        motion = math.nan if self._wants_motion else 0.0
        if energy <= tolerance and self._wants_motion:
            finer = self._run(family, family.halved(setting))
            if isinstance(finer, str):
                return self._failed(family, setting, f"at half the step: {finer}")
            ratio = 2.0 ** (family.order or 1) if family.knob == "step" else 10.0
            motion = distance(self.mechanism, run, finer) * ratio / (ratio - 1.0)
        return Trial(
            family.name,
            family.knob,
            setting,
            energy,
            motion,
            self._seconds(family, setting),
            family.stages * round((run.t[-1] - run.t[0]) / setting) if family.knob == "step" else 0,
        )

    def run(self, family: Family, setting: float) -> Trajectory | None:
        """The run of a trial, None if it failed."""
        run = self._run(family, setting)
        return None if isinstance(run, str) else run

    def _failed(self, family: Family, setting: float, message: str) -> Trial:
        return Trial(family.name, family.knob, setting, math.inf, math.nan, math.inf, 0, message)

    def _run(self, family: Family, setting: float) -> Trajectory | str:
        key = (family.name, setting)
        if key not in self._runs:
            try:
                with quietly():
                    run = family.run(setting)
                self._runs[key] = run if run.provenance.completed else run.provenance.message
            except InputError as error:
                raise Refused(str(error)) from error
            except DeltacError as error:
                self._runs[key] = str(error)
        return self._runs[key]

    def _energy(self, run: Trajectory) -> float | str:
        """Largest |ΔC| as a share of the turnover, or why there is none."""
        try:
            ledger = balance(self.mechanism, run, testing=("wang",))
        except DeltacError as error:
            return str(error)
        left = ledger.uncorrected("wang")
        self.turnover = ledger.turnover
        if not np.isfinite(left).all():
            return "the energies are not finite"
        return float(np.abs(left).max()) / ledger.turnover if ledger.turnover else 0.0

    def _seconds(self, family: Family, setting: float) -> float:
        """The least time of a few runs; the first one compiled what there is to compile."""
        work: Callable[[float], object] = family.work or family.run
        taken: list[float] = []
        with quietly():
            for _ in range(REPEATS):
                begun = time.perf_counter()
                work(setting)
                taken.append(time.perf_counter() - begun)
                if taken[-1] > BRIEF:
                    break
        return min(taken)


def distance(mechanism: Mechanism, run: Trajectory, other: Trajectory) -> float:
    """Largest difference of two runs at common times, as a share of the range of its unit.

    Coordinates of one unit share a scale, the largest range among them; speeds likewise. Infinite
    without common times.
    """
    rows, others = common(run.t, other.t)
    if not rows.size:
        return math.inf
    shares = [0.0]
    for entries, a, b in (
        (mechanism.coordinates, run.q[rows], other.q[others]),
        (mechanism.speeds, run.u[rows], other.u[others]),
    ):
        for places in _by_unit(entries):
            scale = float(np.ptp(b[:, places], axis=0).max())
            off = float(np.abs(a[:, places] - b[:, places]).max())
            if off > 0.0:
                shares.append(off / scale if scale > 0.0 else math.inf)
    return max(shares)


def common(t: Array, other: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows of the times that two runs share."""
    place = np.clip(np.searchsorted(other, t), 1, len(other) - 1)
    nearest = place - (np.abs(other[place - 1] - t) < np.abs(other[place] - t))
    same = np.abs(other[nearest] - t) <= COMMON * (t[-1] - t[0])
    return np.flatnonzero(same), nearest[same].astype(np.int64)


def _by_unit(entries: Iterable[Entry]) -> list[list[int]]:
    groups: dict[str, list[int]] = {}
    for entry in entries:
        groups.setdefault(entry.unit, []).append(entry.index)
    return list(groups.values())
