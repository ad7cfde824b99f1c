"""Work and precision of a solver at a setting: what a run costs, and how wrong it is."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import Array
from deltac.energy import balance
from deltac.errors import DeltacError, InputError
from deltac.mechanism.mechanism import Mechanism
from deltac.simulation.simulate import SimulationStopped
from deltac.simulation.stiffness import StiffStep
from deltac.trajectories import Trajectory

if TYPE_CHECKING:
    from deltac.mechanism.coordinates import Entry

Made = TypeVar("Made")

REPEATS = 3
"""Times a run is timed; the least counts, because other work on the machine only adds."""

BRIEF = 0.25
"""A run that takes longer than this (s) is timed once."""

COMMON = 1e-9
"""Times that differ by this share of a run's length are the same."""


class Rows(Protocol):
    """Times t (T,) in s, coordinates q (T, nq) and speeds u (T, nu): a trajectory, or a `Motion`."""

    @property
    def t(self) -> Array:
        """Times, s."""

    @property
    def q(self) -> Array:
        """Coordinates."""

    @property
    def u(self) -> Array:
        """Speeds."""


@dataclass(frozen=True, eq=False)
class Motion:
    """The rows of a run without its forces."""

    t: Array
    q: Array
    u: Array


@dataclass(frozen=True, eq=False)
class Piece:
    """A run as its user may record it, whole or the beginning of it, and what it is measured against.

    Attributes:
        run: makes it.
        reference: makes the same motion, far finer, at the same times.
        gain: by what factor the reference is expected to be nearer to the exact motion.
    """

    run: Callable[[], Trajectory]
    reference: Callable[[], Rows]
    gain: float


@dataclass(frozen=True, eq=False)
class Family:
    """A solver whose setting is to be chosen: a number of steps, or a tolerance.

    Attributes:
        name: of the solver, "ode5" or "mujoco:rk4".
        order: in the state, None where it varies.
        stages: evaluations of ẋ a step, 0 where that is not known beforehand.
        settings: coarse to fine: steps in s, or tolerances.
        knob: "step" or "tolerance".
        run: makes the trajectory of a setting, sampled finely enough to judge it in a search.
        pieces: what a setting's trial is verified on: the whole run, every row kept, comes first.
        work: does the same without more recording than a user needs; it is timed. None: `run` is.
        halved: the setting that is to be compared with one, to tell how far its motion has converged.
    """

    name: str
    order: int | None
    stages: int
    settings: tuple[float, ...]
    knob: str
    run: Callable[[float], Trajectory]
    pieces: Callable[[float], Sequence[Piece]]
    work: Callable[[float], object] | None = None
    halved: Callable[[float], float] = field(default=lambda h: h / 2)


@dataclass(frozen=True)
class Trial:
    """A solver at a setting.

    Attributes:
        solver: its name; `knob` is "step" (s) or "tolerance", `setting` its value.
        energy: largest |ΔC| of Wang's function, corrections included, as a share of the energy turned
            over; infinite for a run that broke down.
        motion: the error of q and u: the largest at any row that is judged, as a share of the range of
            what has the same unit. In a verified trial those are all rows of the run, measured against
            one of much smaller steps; in others it is estimated by the run at half the step (a tenth of
            the tolerance) at the rows kept of both. NaN if not measured because the energy already fails.
        seconds: measured, compiled code at hand; evaluations: of ẋ, 0 where they were not counted.
        message: why the run ended early, or "".
        verified: whether energy and motion were measured at all rows.
    """

    solver: str
    knob: str
    setting: float
    energy: float
    motion: float
    seconds: float
    evaluations: int
    message: str = ""
    verified: bool = False

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
        self._runs: dict[tuple[str, float], _Judged | str] = {}
        self.turnover = 0.0

    def of(self, family: Family, setting: float, tolerance: float) -> Trial:
        """A trial; the run at half the step is made only if the energy is within its tolerance.

        Raises Refused where the solver cannot be used at all.
        """
        run = self._run(family, setting)
        if isinstance(run, str):
            return self._failed(family, setting, run)
        motion = math.nan if self._wants_motion else 0.0
        if run.energy <= tolerance and self._wants_motion:
            finer = self._run(family, family.halved(setting))
            if isinstance(finer, str):
                return self._failed(family, setting, f"at half the step: {finer}")
            ratio = 2.0 ** (family.order or 1) if family.knob == "step" else 10.0
            motion = distance(self.mechanism, run.motion, finer.motion) * ratio / (ratio - 1.0)
        t = run.motion.t
        return Trial(
            family.name,
            family.knob,
            setting,
            run.energy,
            motion,
            self._seconds(family, setting),
            family.stages * round((t[-1] - t[0]) / setting) if family.knob == "step" else 0,
        )

    def verified(self, family: Family, trial: Trial) -> Trial:
        """The trial measured anew: at every row that its user may have, against much smaller steps."""
        energy, motion, turnover, spans = 0.0, 0.0, 0.0, None
        for piece in family.pieces(trial.setting):
            run = _made(piece.run)
            left = run if isinstance(run, str) else _energy_left(self.mechanism, run)
            if isinstance(run, str) or isinstance(left, str):
                return self._failed(family, trial.setting, str(left))
            turnover = turnover or left[1]
            energy = max(energy, _share(left[0], turnover))
            if not self._wants_motion:
                continue
            reference = _made(piece.reference)
            if isinstance(reference, str):
                return self._failed(family, trial.setting, f"at much smaller steps: {reference}")
            spans = spans or ranges(self.mechanism, reference)
            off = distance(self.mechanism, run, reference, spans)
            motion = max(motion, off * piece.gain / (piece.gain - 1.0))
        self.turnover = turnover
        return replace(trial, energy=energy, motion=motion, verified=True)

    def run(self, family: Family, setting: float) -> Motion | None:
        """The motion of a trial, None if it failed."""
        run = self._run(family, setting)
        return None if isinstance(run, str) else run.motion

    def _failed(self, family: Family, setting: float, message: str) -> Trial:
        return Trial(family.name, family.knob, setting, math.inf, math.nan, math.inf, 0, message)

    def _run(self, family: Family, setting: float) -> _Judged | str:
        key = (family.name, setting)
        if key not in self._runs:
            self._runs[key] = self._judged(_made(lambda: family.run(setting)))
        return self._runs[key]

    def _judged(self, run: Trajectory | str) -> _Judged | str:
        left = run if isinstance(run, str) else _energy_left(self.mechanism, run)
        if isinstance(run, str) or isinstance(left, str):
            return str(left)
        self.turnover = left[1]
        return _Judged(Motion(run.t, run.q, run.u), _share(*left))

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


@dataclass(frozen=True, eq=False)
class _Judged:
    """What is kept of a run: its rows, and the largest |ΔC| as a share of the turnover."""

    motion: Motion
    energy: float


def _made(make: Callable[[], Made]) -> Made | str:
    """A completed run, or why there is none; Refused where its solver cannot be used at all."""
    try:
        with quietly():
            run = make()
    except InputError as error:
        raise Refused(str(error)) from error
    except DeltacError as error:
        return str(error)
    if isinstance(run, Trajectory) and not run.provenance.completed:
        return run.provenance.message
    return run


def _energy_left(mechanism: Mechanism, run: Trajectory) -> tuple[float, float] | str:
    """Largest |ΔC| and the energy turned over, J; or why there is none."""
    try:
        ledger = balance(mechanism, run, testing=("wang",))
    except DeltacError as error:
        return str(error)
    left = ledger.uncorrected("wang")
    if not np.isfinite(left).all():
        return "the energies are not finite"
    return float(np.abs(left).max()), ledger.turnover


def _share(energy: float, turnover: float) -> float:
    return energy / turnover if turnover else 0.0


def distance(
    mechanism: Mechanism, run: Rows, other: Rows, spans: Sequence[float] | None = None
) -> float:
    """Largest difference of two runs at common times, as a share of the range of its unit.

    Coordinates of one unit share a scale, the largest range among them; speeds likewise. The ranges are
    those of the other run, or `spans` as `ranges` gives them. Infinite without common times, and for
    values that are not finite.
    """
    rows, others = common(run.t, other.t)
    if not rows.size:
        return math.inf
    kept = Motion(other.t[others], other.q[others], other.u[others])
    shares = [0.0]
    scales = ranges(mechanism, kept) if spans is None else spans
    for a, b, scale in zip(
        _groups(mechanism, run.q[rows], run.u[rows]), _groups(mechanism, kept.q, kept.u), scales
    ):
        off = float(np.abs(a - b).max())
        if off != 0.0:
            share = off / scale if scale > 0.0 else math.inf
            shares.append(share if math.isfinite(share) else math.inf)
    return max(shares)


def ranges(mechanism: Mechanism, run: Rows) -> list[float]:
    """The largest range among the coordinates, and among the speeds, of each unit."""
    return [float(np.ptp(part, axis=0).max()) for part in _groups(mechanism, run.q, run.u)]


def _groups(mechanism: Mechanism, q: Array, u: Array) -> list[Array]:
    """Columns of one unit together: of the coordinates, then of the speeds."""
    pairs = ((mechanism.coordinates, q), (mechanism.speeds, u))
    return [rows[:, places] for entries, rows in pairs for places in _by_unit(entries)]


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
