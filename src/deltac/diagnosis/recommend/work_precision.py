"""Work and precision of a solver at a setting: what a run costs, and how wrong it is."""

from __future__ import annotations

import itertools
import math
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache, partial
from typing import TypeAlias, TypeVar

import numpy as np

from deltac.arrays import EPS, NEGLIGIBLE, ROUGHLY, Array, max_norm
from deltac.diagnosis.study.convergence import order_of
from deltac.diagnosis.study.curves import by_unit, common_times, one_sided
from deltac.diagnosis.verdict import LEAST_ORDER
from deltac.dynamics import equations_of, trace
from deltac.errors import DeltacError, InputError, SolverError
from deltac.mechanism import Mechanism, State
from deltac.simulation import EnergyErrorWarning, SimulationStoppedWarning, StiffStepWarning
from deltac.trajectories import Trajectory
from deltac.verbs import balance

Made = TypeVar("Made")

TIMED_RUNS = 3
"""Times a run is timed, in seconds of the processor; the least counts, because other work only adds."""

LEAST_BUDGET = 0.1
"""Seconds that every run may take: the search itself takes longer."""

BRIEF = 0.5 * LEAST_BUDGET
"""Seconds after which a run is not timed once more."""

SAME_TIME = 1.0 + ROUGHLY
"""Times within this factor are the same."""


ROUNDING = 512 * EPS
"""No run in double precision keeps the energy better than this, as a share of the energy that the system has.
What moves with less than this share of it does not move: its range is rounding."""


@dataclass(frozen=True, eq=False)
class MotionRows:
    """The rows of a run without its forces: t (T,) in s, coordinates q (T, nq), speeds u (T, nu)."""

    t: Array
    q: Array
    u: Array


Rows: TypeAlias = Trajectory | MotionRows


@dataclass(frozen=True, eq=False)
class VerifiedSpan:
    """A run as its user may record it, whole or the beginning of it, and what it is measured against.

    Attributes:
        run: makes it.
        finer: makes the same motion at the same times, with the setting divided by a number.
        divisors: of the settings, each finer than the one before. The first shows whether the error falls
            by the order, the third is the reference; where it does not, it is compared with the second, and
            further ones follow until two agree.
        gain: by what factor the reference is nearer to the exact motion than the run, by the order.
    """

    run: Callable[[], Trajectory]
    finer: Callable[[float], Rows]
    divisors: tuple[float, ...]
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
        recorder: whether recording takes much of a run's time, so that `work` is always timed apart.
        implicit: whether its steps solve systems of equations, so that stiffness does not limit them.
    """

    name: str
    order: int | None
    stages: int
    settings: tuple[float, ...]
    knob: str
    run: Callable[[float], Trajectory]
    pieces: Callable[[float], Sequence[VerifiedSpan]]
    work: Callable[[float], object] | None = None
    halved: Callable[[float], float] = field(default=lambda h: h / 2)
    recorder: bool = False
    implicit: bool = False


@dataclass(frozen=True)
class Trial:
    """A solver at a setting.

    Attributes:
        solver: its name; `knob` is "step" (s) or "tolerance", `setting` its value.
        energy: largest |ΔC| of Wang's function, corrections included, as a share of the energy turned
            over; infinite for a run that broke down.
        motion: the error of q and u: the largest at any row that is judged, as a share of the range of
            what has the same unit. In a verified trial those are all rows of the run, measured against
            one of much smaller steps, and the error of that run is added; in others it is estimated by
            the run at half the step (a tenth of the tolerance) at the rows of both. Zero where it does
            not matter, NaN where there is no run.
        doubt: of a verified trial, the part of `motion` that is the error of what it was measured
            against: by the order, where the runs were found to have it, else the difference of two such
            references.
        seconds: of one run, compiled code at hand.
        evaluations: of ẋ, 0 where they were not counted.
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
    doubt: float = 0.0

    def excess(self, tolerance: float, motion_tolerance: float) -> float:
        """By what factor the worse of the two exceeds its tolerance; infinite where there is no run."""
        motion = 0.0 if math.isnan(self.motion) else self.motion
        return max(self.energy / tolerance, motion / motion_tolerance)

    def passes(self, tolerance: float, motion_tolerance: float) -> bool:
        """Whether energy and motion are within their tolerances."""
        return self.excess(tolerance, motion_tolerance) <= 1.0


class OutOfTime(DeltacError):
    """The time limit of a search passed while a run was under way."""


class OverBudget(DeltacError):
    """A run took longer than what would make its solver the best."""


class Deadline:
    """When a search is to end, and a run of it, by the monotonic clock; runs under way ask it."""

    def __init__(self, seconds: float = math.inf) -> None:
        """So many seconds from now."""
        self._end = time.monotonic() + seconds
        self._budget = self._run_end = math.inf

    def check(self, _: float = 0.0) -> None:
        """Raise OutOfTime or OverBudget when it has passed (as the `progress` of a run, too)."""
        now = time.monotonic()
        if now > self._end:
            raise OutOfTime
        if math.isinf(self._run_end):  # the run's first step: what was to be compiled is compiled
            self._run_end = now + self._budget
        if now > self._run_end:
            raise OverBudget(f"it takes longer than {self._budget:.2g} s")

    def allow(self, seconds: float = math.inf) -> None:
        """Each run may take so long from its first step on."""
        self._budget = seconds

    def begin(self) -> None:
        """A run begins."""
        self._run_end = math.inf

    def lift(self) -> None:
        """The search is over: its result may be confirmed in peace."""
        self._end = math.inf


class _Stopped(DeltacError):
    """A run that another one was to be measured against ended early."""


class RefusedSolver(SolverError):
    """A solver that cannot do what the model asks for, whatever its step."""


@contextmanager
def quietly() -> Iterator[None]:
    """Without warnings of runs that stop or are inaccurate: that is what is being found out."""
    with warnings.catch_warnings():
        for category in (SimulationStoppedWarning, StiffStepWarning, EnergyErrorWarning):
            warnings.simplefilter("ignore", category)
        yield


class Trials:
    """Trials of a mechanism, each run made once."""

    def __init__(self, mechanism: Mechanism, state: State, motion_tolerance: float) -> None:
        """Start without any; the motion is not measured if its tolerance is infinite."""
        self.mechanism = mechanism
        self._inertia = _inertia_by_unit(mechanism, state)
        self._tolerance, self._motion_matters = motion_tolerance, math.isfinite(motion_tolerance)
        self._runs: dict[tuple[str, float], _Run | str] = {}
        self.reference_energy = 0.0
        self.still = False  # whether the motion of the run that was judged last is rounding

    def distance(self, run: Rows, other: Rows) -> float:
        """As `distance`, what does not move measured beside what could."""
        return distance(self.mechanism, run, other, self._spans(other))

    def _spans(self, run: Rows) -> Array:
        """Ranges by unit; at least what a share `ROUNDING` of that energy would make of them.

        A body in free fall does not turn: angles of 1e-34 rad have no range to be right within.
        """
        energy = ROUNDING * self.reference_energy
        speed = {unit: math.sqrt(2.0 * energy / m) for unit, m in self._inertia.items() if m > 0.0}
        span = float(run.t[-1] - run.t[0])
        rates = [f"{'rad' if e.unit == '1' else e.unit}/s" for e in self.mechanism.coordinates]
        least = [span * speed.get(rate, 0.0) for rate in rates]
        least += [speed.get(entry.unit, 0.0) for entry in self.mechanism.speeds]
        return np.maximum(ranges(self.mechanism, run), least)

    def of(self, family: Family, setting: float) -> Trial:
        """A trial, its motion beside that of the run at half the step.

        Raises Refused where the solver cannot be used at all.
        """
        run = self._run(family, setting, judged=True)
        if isinstance(run, str):
            return _failure(family, setting, run)
        energies = run.energies
        assert energies is not None
        motion = 0.0
        if self._motion_matters:
            finer = self._run(family, family.halved(setting), judged=False)
            if isinstance(finer, str):
                return _failure(family, setting, f"at half the step: {finer}")
            ratio = 2.0 ** (family.order or 1) if family.knob == "step" else 10.0
            motion = self.distance(run.motion, finer.motion) * ratio / (ratio - 1.0)
        self.reference_energy, self.still = energies.reference_energy, energies.still
        t = run.motion.t
        steps = round((t[-1] - t[0]) / setting) if family.knob == "step" else 0
        seconds = self.seconds(family, setting)
        return Trial(
            family.name,
            family.knob,
            setting,
            _share(energies.error, energies.reference_energy),
            motion,
            seconds,
            family.stages * steps,
        )

    def verified(self, family: Family, trial: Trial) -> Trial:
        """The trial measured anew: at every row that its user may have, against much smaller steps."""
        energy, reference_energy, motion = 0.0, 0.0, (0.0, 0.0)
        spans: Array | None = None
        for piece in family.pieces(trial.setting):
            run = _completed(piece.run)
            energies = run if isinstance(run, str) else _energies(self.mechanism, run)
            if isinstance(run, str) or isinstance(energies, str):
                return _failure(family, trial.setting, str(energies))
            reference_energy = reference_energy or energies.reference_energy
            energy = max(energy, _share(energies.error, reference_energy))
            if not self._motion_matters:
                continue
            try:
                error, spans = self._error(piece, run, spans)
            except _Stopped as stopped:
                return _failure(family, trial.setting, f"at much smaller steps: {stopped}")
            motion = max(motion, error)
        self.reference_energy = reference_energy
        return replace(trial, energy=energy, motion=motion[0], doubt=motion[1], verified=True)

    def _error(
        self, piece: VerifiedSpan, run: Trajectory, spans: Array | None
    ) -> tuple[tuple[float, float], Array]:
        """The motion error of a run with the part that is its reference's; the ranges that it is a share of.

        Differences of three runs show the gain from one setting to the next. Where it is the order's, the
        reference's error is that of the run over the gain between them, and the sum is Richardson's
        estimate. Kinks leave errors of no order, each as its steps happen to meet them: two references that
        agree did not meet them alike, so that their difference bounds the error of the finer one.
        """

        @cache
        def finer(divisor: float) -> Rows:
            other = _completed(partial(piece.finer, divisor))
            if isinstance(other, str):
                raise _Stopped(other)
            return other

        check, divisors = piece.divisors[0], piece.divisors[1:] or piece.divisors
        first = divisors[min(1, len(divisors) - 1)]
        spans = self._spans(finer(first)) if spans is None else spans
        difference = partial(distance, self.mechanism, spans=spans)
        error = doubt = difference(run, finer(first))
        if first != check:
            rest = difference(finer(check), finer(first))
            gain = first ** order_of((1.0, 1.0 / check, 1.0 / first), error - rest, rest)
            if gain >= piece.gain**LEAST_ORDER:
                doubt = error / (min(gain, piece.gain) - 1.0)
        for coarser, finest in itertools.pairwise(divisors):
            if doubt <= NEGLIGIBLE * max(error, self._tolerance):
                break
            error, doubt = difference(run, finer(finest)), difference(finer(coarser), finer(finest))
        return (error + doubt, doubt), spans

    def seconds(self, family: Family, setting: float) -> float:
        """The least time of a few runs, s; what there is to compile was compiled by an earlier one.

        Of long runs the time is known, where those at a step and at its half took times in their ratio.
        """
        earlier = [(self._runs.get((family.name, setting / k)), k) for k in (1.0, 2.0)]
        spans = [run.seconds / k for run, k in earlier if isinstance(run, _Run)]
        if not family.recorder and len(spans) > 1 and BRIEF < max(spans) <= SAME_TIME * min(spans):
            return min(spans)
        work: Callable[[float], object] = family.work or family.run
        times: list[float] = []
        with quietly():
            while len(times) < TIMED_RUNS and sum(times) < BRIEF:
                start = time.process_time()
                work(setting)
                times.append(time.process_time() - start)
        return min(times)

    def _run(self, family: Family, setting: float, *, judged: bool) -> _Run | str:
        """A run, made once; again if it is `judged` by its energies, of which it had none."""
        key = (family.name, setting)
        cached = self._runs.get(key)
        if cached is None or (judged and isinstance(cached, _Run) and cached.energies is None):
            self._runs[key] = self._made(family, setting, judged=judged)
        return self._runs[key]

    def _made(self, family: Family, setting: float, *, judged: bool) -> _Run | str:
        compiled = any(name == family.name for name, _ in self._runs)
        start = time.process_time()
        run = _completed(lambda: family.run(setting))
        seconds = time.process_time() - start if compiled else math.inf
        if isinstance(run, str):
            return run
        energies = _energies(self.mechanism, run) if judged else None
        if isinstance(energies, str):
            return energies
        return _Run(MotionRows(run.t, run.q, run.u), seconds, energies)


@dataclass(frozen=True, eq=False)
class _Run:
    """What a search needs of a run.

    Attributes:
        motion: its rows.
        seconds: that it took; infinite where code may have been compiled for it.
        energies: where it is judged by them.
    """

    motion: MotionRows
    seconds: float
    energies: _Energies | None


def _failure(family: Family, setting: float, message: str) -> Trial:
    return Trial(family.name, family.knob, setting, math.inf, math.nan, math.inf, 0, message)


def _completed(make: Callable[[], Made]) -> Made | str:
    """A completed run, or why there is none; Refused where its solver cannot be used at all."""
    try:
        with quietly():
            run = make()
    except InputError as error:
        raise RefusedSolver(str(error)) from error
    except (OutOfTime, OverBudget):
        raise
    except DeltacError as error:
        return str(error)
    if isinstance(run, Trajectory) and not run.provenance.completed:
        return run.provenance.message
    return run


@dataclass(frozen=True)
class _Energies:
    """Of a run: its largest |ΔC| and the energy that the system has, J; whether that is rounding."""

    error: float
    reference_energy: float
    still: bool


def _energies(mechanism: Mechanism, run: Trajectory) -> _Energies | str:
    """The energies that judge a run; or why there are none."""
    try:
        ledger = balance(mechanism, run, testing=("wang",))
    except DeltacError as error:
        return str(error)
    delta_c = ledger.uncorrected("wang")
    if not np.isfinite(delta_c).all():
        return "the energies are not finite"
    return _Energies(max_norm(delta_c), ledger.reference_energy, ledger.still)


def _share(energy: float, reference_energy: float) -> float:
    return energy / reference_energy if reference_energy else 0.0


def distance(mechanism: Mechanism, run: Rows, other: Rows, spans: Array | None = None) -> float:
    """Largest difference of two runs at common times, as a share of the range of its unit.

    Coordinates of one unit share a scale, the largest range among them; speeds likewise. The ranges are
    those of the other run, or `spans` as `ranges` gives them. Infinite without common times, and for
    values that are not finite.
    """
    _, (rows, others) = common_times([run.t, other.t])
    if not rows.size:
        return math.inf
    common = MotionRows(other.t[others], other.q[others], other.u[others])
    q = one_sided(mechanism, np.array(run.q[rows]), common.q)
    error = np.abs(np.hstack([q - common.q, run.u[rows] - common.u])).max(axis=0)
    with np.errstate(all="ignore"):
        shares = error / (ranges(mechanism, common) if spans is None else spans)
    shares = np.where(error == 0.0, 0.0, np.where(np.isfinite(shares), shares, np.inf))
    return float(shares.max(initial=0.0))


def ranges(mechanism: Mechanism, run: Rows) -> Array:
    """For each coordinate and speed the largest range among those of its unit (nq + nu,)."""
    pairs = ((mechanism.coordinates, run.q), (mechanism.speeds, run.u))
    return np.concatenate(
        [by_unit(np.ptp(rows, axis=0), [e.unit for e in entries]) for entries, rows in pairs]
    )


def _inertia_by_unit(mechanism: Mechanism, state: State) -> dict[str, float]:
    """The largest diagonal entry of M among the free speeds of each unit (kg, kg·m²)."""
    free = mechanism.free
    if not len(free.u):
        return {}
    terms = equations_of(trace(mechanism)).terms(state.t, state.q[free.q], state.u[free.u])
    units = [mechanism.speeds[int(k)].unit for k in free.u]
    return dict(zip(units, map(float, by_unit(np.diag(terms.M), units))))
