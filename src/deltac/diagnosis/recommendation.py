"""`recommend`: the cheapest solver and step that keep a tolerance, tried and verified."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from deltac.diagnosis.findings import percent
from deltac.diagnosis.models import load_model
from deltac.diagnosis.settings import families
from deltac.diagnosis.work_precision import Family, Trial, Trials, distance
from deltac.errors import InputError
from deltac.mechanism.state import State
from deltac.simulation import Controller, Equations

Progress: TypeAlias = Callable[[float, str], None]

TOLERANCE = 1e-6
"""Accepted by default: |ΔC| as a share of the energy turned over, q and u as shares of their ranges."""

TOO_DEAR = 8.0
"""A solver is given up when it needs this many times the best one's time."""

SAME_TIME = 1.2
"""Times within this factor are the same; fewer evaluations decide."""

SAFETY = 1.1
"""Margin on a step that an order predicts, so that the next trial seldom has to be repeated."""

LIMITS = (
    "errors of the model: the advice is about the integration only",
    "other motions: another start or drive may need a smaller step",
    "other machines: times are of this one, though their ratios change little",
)


@dataclass(frozen=True)
class Advice:
    """A recommended solver and its step or tolerance, with what it rests on.

    Attributes:
        solver, step: what to use; `step` is None for a solver that takes a `setting` as its tolerance.
        best: the trial of the advice, None if nothing tried keeps the tolerance.
        coarser: the next cheaper setting of that solver, which does not.
        finer: the trial at half the step (a tenth of the tolerance), which confirms it.
        runner_up: the next best solver at its own best setting; `agreement` is how far its motion is
            from the recommended one, as a share of the ranges (NaN without runner-up).
        trials: all that was tried.
        tolerance, motion_tolerance: what was asked for; duration: how long the motion was, s.
        turnover: energy turned over in it, J.
        notes: why some solvers were left out.
    """

    best: Trial | None
    coarser: Trial | None
    finer: Trial | None
    runner_up: Trial | None
    agreement: float
    trials: tuple[Trial, ...]
    tolerance: float
    motion_tolerance: float
    duration: float
    turnover: float
    notes: tuple[str, ...] = ()
    limits: tuple[str, ...] = LIMITS

    @property
    def solver(self) -> str | None:
        """The recommended solver."""
        return None if self.best is None else self.best.solver

    @property
    def step(self) -> float | None:
        """The recommended step, s; None for an adaptive solver."""
        return self.best.setting if self.best and self.best.knob == "step" else None

    @property
    def setting_tolerance(self) -> float | None:
        """The recommended relative tolerance of an adaptive solver, else None."""
        return self.best.setting if self.best and self.best.knob == "tolerance" else None

    @property
    def verified(self) -> bool:
        """Whether the runs at the setting and at the finer one both keep the tolerances."""
        asked = (self.tolerance, self.motion_tolerance)
        return (
            self.best is not None
            and self.best.passes(*asked)
            and self.finer is not None
            and self.finer.energy <= self.tolerance
        )

    @property
    def status(self) -> int:
        """Exit status: 0 a verified advice, 1 none of what was tried keeps the tolerance."""
        return 0 if self.verified else 1

    def explain(self, width: int = 96) -> str:
        """The advice in words: what, why, why not the runner-up, and what it does not cover."""
        lines = _explained(self)
        lines += [f"Note: {note}." for note in self.notes]
        lines.append(f"Not covered: {'; '.join(self.limits)}.")
        return "\n".join(textwrap.fill(line, width, subsequent_indent="  ") for line in lines)

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""

        def trial(value: Trial | None) -> dict[str, Any] | None:
            return None if value is None else value.to_dict()

        return {
            "solver": self.solver,
            "step": self.step,
            "setting_tolerance": self.setting_tolerance,
            "verified": self.verified,
            "best": trial(self.best),
            "coarser": trial(self.coarser),
            "finer": trial(self.finer),
            "runner_up": trial(self.runner_up),
            "agreement": None if math.isnan(self.agreement) else self.agreement,
            "trials": [t.to_dict() for t in self.trials],
            "tolerance": self.tolerance,
            "motion_tolerance": self.motion_tolerance
            if math.isfinite(self.motion_tolerance)
            else None,
            "duration": self.duration,
            "turnover": self.turnover,
            "notes": list(self.notes),
            "limits": list(self.limits),
        }


def recommend(
    model: Any,
    state: State | None = None,
    duration: float | None = None,
    tolerance: float = TOLERANCE,
    *,
    motion_tolerance: float | None = None,
    solvers: Sequence[str] | None = None,
    equations: Equations | None = None,
    controller: Controller | None = None,
    control: Callable[[Any, Any], object] | None = None,
    progress: Progress | None = None,
) -> Advice:
    """Find the cheapest solver and step that keep a tolerance, by trying them.

    Args:
        model: a mechanism, a problem or its name, an .xml or .urdf file, file.py:callable. A MuJoCo model
            file is run by MuJoCo's integrators, unless `solvers` names ours.
        state: where the motion starts; by default the problem's start, or all zeros.
        duration: how long it is, s; by default the problem's.
        tolerance: of the largest |ΔC| (Wang's), as a share of the energy turned over.
        motion_tolerance: of q and u, each as a share of the range of what has its unit; by default
            `tolerance`. `math.inf` leaves the motion out, as for chaotic motions over long times.
        solvers: names to choose from; by default all that suit the model.
        equations: in place of the mechanism's own, as in `simulate`.
        controller: sets the motors that have no law, as in `simulate`.
        control: MuJoCo's input signal, called as control(model, data) before each step.
        progress: called with the fraction done and what is being tried.

    Returns:
        The advice; its `status` is 1 if nothing tried keeps the tolerance, and then `best` is None.

    Raises:
        InputError: as `simulate`; tolerances that are not positive; a model without start or duration.
    """
    wanted = _positive(tolerance, "tolerance")
    motion = wanted if motion_tolerance is None else _positive(motion_tolerance, "motion_tolerance")
    loaded = load_model(model)
    problem, mechanism = loaded.problem, loaded.mechanism
    if state is None:
        state = mechanism.state() if problem is None else problem.state
    if duration is None:
        if problem is None:
            raise InputError("recommend: the model tells no duration; give duration= in seconds")
        duration = problem.duration
    found, notes = families(
        model,
        mechanism,
        state,
        _positive(duration, "duration"),
        solvers,
        equations,
        controller,
        control,
    )
    trials = Trials(mechanism, motion)
    search = _Search(trials, wanted, motion, progress, len(found))
    for family in found:
        search.family(family)
    return search.advice(found, duration, (*notes, *search.notes))


@dataclass(frozen=True)
class _Bracket:
    """The coarsest setting of a family that passes, and the next coarser one, which does not."""

    family: Family
    best: Trial
    coarser: Trial | None


class _Search:
    """Looks for each family's coarsest setting that passes, and gives up on what is too dear."""

    def __init__(
        self,
        trials: Trials,
        tolerance: float,
        motion: float,
        progress: Progress | None,
        count: int,
    ) -> None:
        self._trials, self._progress, self._count = trials, progress, count
        self._asked = (tolerance, motion)
        self._kept: dict[tuple[str, float], Trial] = {}
        self._found: list[_Bracket] = []
        self._done = 0
        self.notes: list[str] = []

    def family(self, family: Family) -> None:
        """Find a family's bracket by bisection of its settings, led by its order."""
        settings = family.settings
        low, high = -1, len(settings)  # what fails, what passes
        place = min(len(settings) // 4, len(settings) - 1)
        while high - low > 1:
            trial = self._trial(family, settings[place])
            if trial.passes(*self._asked):
                high = place
            else:
                low = place
                if self._dear(family, trial):
                    self.notes.append(self._given_up(family, trial))
                    break
            place = self._next(family, trial, place, low, high)
        else:
            if high < len(settings):
                best = self._kept[family.name, settings[high]]
                coarser = self._kept.get((family.name, settings[low])) if low >= 0 else None
                self._found.append(_Bracket(family, best, coarser))
            else:
                last = self._kept[family.name, settings[-1]]
                self.notes.append(
                    f"{family.name} does not keep the tolerance at {_setting(last)}, the finest tried"
                    + (f" ({last.message})" if last.message else "")
                )
        self._done += 1

    def advice(self, found: Sequence[Family], duration: float, notes: tuple[str, ...]) -> Advice:
        """Rank the brackets by measured time, and verify the best by a finer run."""
        ranked = sorted(self._found, key=lambda b: b.best.seconds)
        close = [b for b in ranked if b.best.seconds <= SAME_TIME * ranked[0].best.seconds]
        close.sort(key=lambda b: b.best.evaluations or math.inf)
        ranked = [*close, *ranked[len(close) :]]
        best = ranked[0] if ranked else None
        second = ranked[1] if len(ranked) > 1 else None
        finer, agreement = None, math.nan
        if best is not None:
            half = best.family.halved(best.best.setting)
            finer = self._trial(best.family, half)
            if second is not None:
                agreement = self._agreement(best, second)
        return Advice(
            best=None if best is None else best.best,
            coarser=None if best is None else best.coarser,
            finer=finer,
            runner_up=None if second is None else second.best,
            agreement=agreement,
            trials=tuple(self._kept.values()),
            tolerance=self._asked[0],
            motion_tolerance=self._asked[1],
            duration=duration,
            turnover=self._trials.turnover,
            notes=notes,
        )

    def _trial(self, family: Family, setting: float) -> Trial:
        key = (family.name, setting)
        if key not in self._kept:
            if self._progress is not None:
                what = f"{family.name}, {family.knob} {setting:.3g}"
                self._progress(self._done / self._count, what)
            self._kept[key] = self._trials.of(family, setting, self._asked[0])
        return self._kept[key]

    def _next(self, family: Family, trial: Trial, place: int, low: int, high: int) -> int:
        """Where to look next: where the order says that the tolerance is just kept, else halfway."""
        settings = family.settings
        middle = (low + high) // 2
        if not math.isfinite(trial.energy):
            return min(max(place + 3, middle), high - 1) if high == len(settings) else middle
        order = family.order or 4
        excess = max(trial.excess(*self._asked), 1e-6)
        shrink = excess ** (1.0 / order) if family.knob == "step" else excess
        wanted = trial.setting / (SAFETY * shrink)
        guess = next((k for k, s in enumerate(settings) if s <= wanted), len(settings) - 1)
        return min(max(guess, low + 1), high - 1)

    def _dear(self, family: Family, trial: Trial) -> bool:
        """Whether what this failing trial lets expect costs far more than what passes elsewhere."""
        if not self._found or not math.isfinite(trial.seconds):
            return False
        return self._expected(family, trial) > TOO_DEAR * self._least

    def _expected(self, family: Family, trial: Trial) -> float:
        """Time (s) of the setting that would pass, from the order; at least that of the trial."""
        if family.knob != "step" or family.order is None:
            return trial.seconds
        # An error of more than all the energy is none from which an order could extrapolate.
        excess = min(trial.excess(*self._asked), 1.0 / min(self._asked))
        per_evaluation = max(trial.seconds - self._overhead, 0.0)
        return self._overhead + per_evaluation * float(max(excess, 1.0) ** (1.0 / family.order))

    @property
    def _least(self) -> float:
        """Time of the cheapest trial that passes, s."""
        return min(b.best.seconds for b in self._found)

    @property
    def _overhead(self) -> float:
        """What any run costs, however few its steps, s."""
        return 0.9 * min(t.seconds for t in self._kept.values())

    def _given_up(self, family: Family, trial: Trial) -> str:
        times = self._expected(family, trial) / self._least
        about = "by its order it" if times > trial.seconds / self._least else "it"
        return (
            f"{family.name} was given up at {_setting(trial)}, where it {_failing(trial, *self._asked)}: "
            f"{about} would take {'at least ' if about == 'it' else 'about '}{times:.2g} times as long as "
            "the best"
        )

    def _agreement(self, best: _Bracket, second: _Bracket) -> float:
        a = self._trials.run(best.family, best.best.setting)
        b = self._trials.run(second.family, second.best.setting)
        if a is None or b is None:
            return math.nan
        apart = distance(self._trials.mechanism, a, b)
        return apart if math.isfinite(apart) else math.nan


def _explained(advice: Advice) -> list[str]:
    best, asked = advice.best, (advice.tolerance, advice.motion_tolerance)
    if best is None:
        tried = [t for t in advice.trials if math.isfinite(t.energy)]
        line = f"Nothing that was tried keeps a tolerance of {advice.tolerance:g}"
        if tried:
            nearest = min(tried, key=lambda t: t.excess(*asked))
            line += f"; nearest comes {nearest.solver} at {_setting(nearest)}, which "
            line += _failing(nearest, *asked)
        return [
            line + ". Ask for less, or for a shorter motion (a chaotic one loses every accuracy)."
        ]
    lines = [
        f"Use {best.solver} with {best.knob} {_value(best)}: |ΔC| stays within {_share(best.energy)} of the "
        f"{advice.turnover:.4g} J turned over in {advice.duration:g} s"
        + (
            ""
            if math.isinf(asked[1])
            else f", q and u within {_share(best.motion)} of their ranges"
        )
        + f" (asked for: {advice.tolerance:g}). It takes {_seconds(best.seconds)}"
        + (f", {best.evaluations} evaluations of the accelerations." if best.evaluations else ".")
    ]
    if advice.finer is not None:
        half = "half the step" if best.knob == "step" else "a tenth of the tolerance"
        found = "confirms it" if advice.verified else "does not confirm it"
        lines.append(
            f"- A run at {half} {found}: |ΔC| {_share(advice.finer.energy)} of the turnover."
        )
    if advice.coarser is not None:
        lines.append(
            f"- The next cheaper {best.knob}, {_value(advice.coarser)}, {_failing(advice.coarser, *asked)}."
        )
    second = advice.runner_up
    if second is not None:
        line = (
            f"- Runner-up: {second.solver} with {second.knob} {_value(second)}, which takes "
            + _longer(second.seconds / best.seconds)
        )
        if second.evaluations and best.evaluations:
            line += f" ({second.evaluations} evaluations against {best.evaluations})"
        if not math.isnan(advice.agreement):
            line += f"; its motion agrees to {_share(advice.agreement)} of the ranges"
        lines.append(line + ".")
    return lines


def _longer(ratio: float) -> str:
    return f"{ratio:.2g} times as long" if ratio > SAME_TIME else "as long"


def _failing(trial: Trial, tolerance: float, motion: float) -> str:
    """In words, what a trial misses."""
    if trial.message:
        return f"breaks down ({trial.message})"
    if trial.energy > tolerance:
        return f"leaves |ΔC| at {_share(trial.energy)} of the turnover"
    return f"leaves q and u {_share(trial.motion)} of their ranges from the converged motion"


def _setting(trial: Trial) -> str:
    return f"{trial.knob} {_value(trial)}"


def _value(trial: Trial) -> str:
    return f"{trial.setting:.6g}{' s' if trial.knob == 'step' else ''}"


def _share(value: float) -> str:
    return percent(value) if value >= 1e-4 else f"{value:.1e}"


def _seconds(value: float) -> str:
    return f"{1e3 * value:.3g} ms" if value < 1.0 else f"{value:.3g} s"


def _positive(value: float, what: str) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not number > 0.0:
        raise InputError(f"recommend: {what} is {value!r}; expected a positive number")
    return number
