"""`recommend`: the cheapest solver and step that keep a tolerance, tried and verified.

Search and verification differ: the search compares rows that are at hand, of runs at neighbouring
settings; what it finds is then measured at every row that a user of the advice gets.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Unpack

from deltac.calls.arguments import checked
from deltac.calls.interrupts import interruptible
from deltac.calls.progress import Progress
from deltac.diagnosis.inputs.channels import not_simulated
from deltac.diagnosis.recommend.families import families
from deltac.diagnosis.recommend.result import SAME_TIME, Recommendation, failing, setting_of
from deltac.diagnosis.recommend.work_precision import (
    ROUNDING,
    Deadline,
    Family,
    OutOfTime,
    Refused,
    Trial,
    Trials,
)
from deltac.diagnosis.study.simulators import (
    MUJOCO,
    SimulationOptions,
    handed_on,
    starting,
)
from deltac.diagnosis.verdict import REFINED_TOLERANCE
from deltac.errors import NO_NUMBER, InputError, SolverError
from deltac.models import ModelLike, StateLike, load_model

TOO_DEAR = 8.0
"""A solver is given up when it needs this many times the best one's time."""

TIME_LIMIT = 120.0
"""A search ends after so many seconds with the best that it has, and says what it left out."""

SAFETY = 1.1
"""Margin on a step that an order predicts, so that the next trial seldom has to be repeated."""


@checked
@interruptible()
def recommend(
    model: ModelLike,
    state: StateLike = None,
    duration: float | None = None,
    tolerance: float = REFINED_TOLERANCE,
    *,
    motion_tolerance: float | None = None,
    solvers: Sequence[str] | None = None,
    time_limit: float = TIME_LIMIT,
    progress: Progress | None = None,
    **simulation: Unpack[SimulationOptions],
) -> Recommendation:
    """Find the cheapest solver and step that keep a tolerance, by trying them.

    The motion error of the advice is the largest error of any q or u at any row that its user gets, as a
    share of the range of what has its unit: at every step of a fixed-step solver, measured against a run of
    a sixteenth of the step; of an adaptive solver at a thousand samples of the motion, and of its first
    10th, 100th, … 10⁻⁶, against a run of a thousandth of the tolerance.

    Args:
        model: a mechanism, a problem or its name, an .xml or .urdf file, file.py:callable. A MuJoCo model
            file is run by MuJoCo's integrators, unless `solvers` names ours.
        state: where the motion starts; by default the model's own start, or all zeros.
        duration: how long it is, s; by default the problem's.
        tolerance: of the largest |ΔC| (Wang's), as a fraction of the energy that the system has (max K +
            range of V).
        motion_tolerance: accepted error of q and u, each as a share of the range of what has its unit; by
            default `tolerance`. `inf` leaves the motion out, as for chaotic motions over long times.
        solvers: names of the solvers to try; by default all that suit the model.
        time_limit: seconds that the search may take. It then ends with the best that was found, and the
            notes say which solvers were not tried to the end.
        progress: called with the fraction done.
        **simulation: `equations`, `controller` and `constraints`, as for `simulate`. For MuJoCo the
            controller is a function, called as controller(model, data) before each step.

    Returns:
        The recommendation. Its `exit_code` is 1 if nothing tried keeps the tolerance, and 3 (unresolved)
        if next to no energy is exchanged, so that there is nothing to judge a step by; `best` is then None.

    Raises:
        InputError: as `simulate`; tolerances that are not positive; a model without start or duration.
    """
    wanted = _positive(tolerance, "tolerance")
    if wanted >= 1.0:
        raise InputError(
            f"recommend: tolerance is {tolerance!r}; expected a number between 0 and 1"
        )
    if wanted < ROUNDING:
        raise InputError(
            f"recommend: tolerance is {tolerance:g}; below {ROUNDING:g} of the energy exchanged there is "
            "nothing but rounding. Ask for more than that"
        )
    motion = wanted if motion_tolerance is None else _positive(motion_tolerance, "motion_tolerance")
    loaded = load_model(model)
    mechanism = loaded.mechanism
    state = starting(loaded, state)
    duration = loaded.lasting(duration)
    deadline = Deadline(_positive(time_limit, "time_limit"))
    found, notes = families(
        model,
        mechanism,
        state,
        _positive(duration, "duration"),
        solvers,
        handed_on(recommend, simulation, own=("record",)),
        deadline,
    )
    trials = Trials(mechanism, state, motion)
    search = _Search(trials, wanted, motion, progress, len(found))
    for family in found:
        search.family(family, deadline)
        if trials.still:
            break
    deadline.lift()
    if len(search.refused) == len(found):
        raise SolverError(f"recommend: no solver can be used. {'. '.join(search.refused)}")
    found_advice = search.advice(duration, notes)
    lacking = not_simulated(loaded.import_report)
    if lacking and found_advice.solver and not found_advice.solver.startswith(MUJOCO):
        note = f"{lacking[0].what} ({lacking[0].evidence}). {lacking[0].remedy}"
        found_advice = replace(found_advice, notes=(note, *found_advice.notes))
    return replace(found_advice, import_report=loaded.import_report)


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
        self.refused: list[str] = []

    def family(self, family: Family, deadline: Deadline) -> None:
        """Find a family's bracket, or note why the solver is left out."""
        try:
            deadline.check()
            self._bisect(family)
        except Refused as refusal:
            self.refused.append(f"{family.name} was left out: {refusal}")
        except OutOfTime:
            self.notes.append(f"{family.name} was not tried to the end: the time limit passed")
        self._done += 1

    def _bisect(self, family: Family, low: int = -1, *, verifying: bool = False) -> None:
        """Find a family's bracket by bisection of its settings, led by its order.

        Only what would lead is verified; if that fails, the search goes on above it and verifies all.
        """
        settings = family.settings
        high = len(settings)  # what passes; `low` fails
        place = min(len(settings) // 4, len(settings) - 1)
        if low >= 0:
            place = self._next(family, self._kept[family.name, settings[low]], low, low, high)
        while high - low > 1:
            trial = self._trial(family, settings[place], verifying=verifying)
            if self._trials.still:
                return
            if trial.passes(*self._asked):
                high = place
            else:
                low = place
                if self._dear(family, trial):
                    self.notes.append(self._given_up(family, trial))
                    return
            place = self._next(family, trial, place, low, high)
        if high == len(settings):
            last = self._kept[family.name, settings[-1]]
            self.notes.append(
                f"{family.name} does not keep the tolerance at {setting_of(last)}, the finest tried"
                + (f" ({last.message})" if last.message else "")
            )
            return
        best = self._kept[family.name, settings[high]]
        if not self._found or best.seconds <= SAME_TIME * self._least:
            best = self._trial(family, settings[high], verifying=True)
        if not best.passes(*self._asked):
            self._bisect(family, high, verifying=True)
            return
        coarser = self._kept.get((family.name, settings[low])) if low >= 0 else None
        self._found.append(_Bracket(family, best, coarser))

    def advice(self, duration: float, notes: tuple[str, ...]) -> Recommendation:
        """Rank the brackets by measured time; the best is verified, and its energy by a finer run too."""
        ranked = sorted(self._found, key=lambda b: b.best.seconds)
        close = [b for b in ranked if _same_time(b.best, ranked[0].best)]
        close.sort(key=lambda b: b.best.evaluations or math.inf)
        ranked = [*close, *(b for b in ranked if b not in close)]
        while ranked:
            first = ranked[0]
            trial = self._trial(first.family, first.best.setting, verifying=True)
            if trial.passes(*self._asked):
                ranked[0] = replace(first, best=trial)
                break
            self.notes.append(
                f"{first.family.name} fails at some of its rows: it {failing(trial, *self._asked)}"
            )
            del ranked[0]
        best = ranked[0] if ranked else None
        second = ranked[1] if len(ranked) > 1 else None
        finer, agreement = None, math.nan
        if best is not None:
            half = best.family.halved(best.best.setting)
            finer = self._trial(best.family, half)
            if second is not None:
                agreement = self._agreement(best, second)
        return Recommendation(
            best=None if best is None else best.best,
            coarser=None if best is None else best.coarser,
            finer=finer,
            runner_up=None if second is None else second.best,
            agreement=agreement,
            trials=tuple(self._kept.values()),
            tolerance=self._asked[0],
            motion_tolerance=self._asked[1],
            duration=duration,
            reference_energy=self._trials.reference_energy,
            still=self._trials.still,
            notes=(*notes, *self.refused, *self.notes),
        )

    def _trial(self, family: Family, setting: float, *, verifying: bool = False) -> Trial:
        key = (family.name, setting)
        if key not in self._kept:
            self._tell()
            self._kept[key] = self._trials.of(family, setting, self._asked[0])
        trial = self._kept[key]
        if verifying and not trial.verified and trial.passes(*self._asked):
            self._tell()
            self._kept[key] = self._trials.verified(family, trial)
        return self._kept[key]

    def _tell(self) -> None:
        if self._progress is not None:
            self._progress(self._done / self._count)

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
            f"{family.name} was given up at {setting_of(trial)}, where it {failing(trial, *self._asked)}: "
            f"{about} would take {'at least ' if about == 'it' else 'about '}{times:.2g} times as long as "
            "the best"
        )

    def _agreement(self, best: _Bracket, second: _Bracket) -> float:
        a = self._trials.run(best.family, best.best.setting)
        b = self._trials.run(second.family, second.best.setting)
        if a is None or b is None:
            return math.nan
        apart = self._trials.distance(a, b)
        return apart if math.isfinite(apart) else math.nan


def _same_time(trial: Trial, quickest: Trial) -> bool:
    """Whether two times differ by less than what is noise, or by less than what matters."""
    return trial.seconds - trial.spread <= SAME_TIME * (quickest.seconds + quickest.spread)


def _positive(value: float, what: str) -> float:
    try:
        number = float(value)
    except NO_NUMBER:
        number = math.nan
    if not number > 0.0:
        raise InputError(f"recommend: {what} is {value!r}; expected a positive number")
    return number
