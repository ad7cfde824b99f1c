"""`recommend`: the cheapest solver and step that keep a tolerance, predicted and verified.

A coarse run of each solver and its order predict the setting that keeps the tolerance, and its time. The
cheapest prediction is made true: run, then measured at every row that a user of the advice gets. What
this teaches may make another solver the cheapest; the search ends when the cheapest is verified. A solver
that was not run yet has a bound on its time, by its order and by how fast the motion was found to be, so that
it is neither compiled nor run where it cannot be the cheapest.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Unpack

from deltac.arrays import EPS, ROUGHLY
from deltac.calls.arguments import checked
from deltac.calls.interrupts import interruptible
from deltac.calls.linear_algebra import one_thread_per_matrix
from deltac.calls.progress import TIME_LIMIT, Progress, no_progress
from deltac.diagnosis.inputs.channels import not_simulated
from deltac.diagnosis.recommend.families import LADDER, families
from deltac.diagnosis.recommend.result import (
    Prospect,
    Recommendation,
    failing,
    setting_of,
)
from deltac.diagnosis.recommend.work_precision import (
    LEAST_BUDGET,
    ROUNDING,
    SAME_TIME,
    Deadline,
    Family,
    OutOfTime,
    OverBudget,
    RefusedSolver,
    Trial,
    Trials,
)
from deltac.diagnosis.study.simulators import (
    MUJOCO,
    SimulationOptions,
    handed_on,
    starting,
)
from deltac.diagnosis.verdict import LEAST_ORDER, REFINED_TOLERANCE, check_tolerance
from deltac.errors import InputError, SolverError, number_or_nan
from deltac.models import ModelLike, StateLike, load_model

TOO_DEAR = 8.0
"""A run may take this many times as long as the best prediction, then its solver is given up."""

SLACK = 2.0
"""Factor by which a solver with a small error constant may exceed the step that the motion suggests."""

REFINEMENT = 4.0
"""By what factor a step is divided that has no order yet, because the run broke down."""


@checked
@interruptible()
@one_thread_per_matrix()
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
    """Find the cheapest solver and step that keep a tolerance: predicted from coarse runs, then verified.

    The motion error is the largest error of any q or u at any row of the recommended run, as a fraction
    of the largest range among the quantities of the same unit: at every step of a fixed-step solver,
    compared with a run of a sixteenth of the step; of an adaptive solver at a thousand samples of the motion,
    and of its first 10th, 100th, … 10⁻⁶, compared with a run of a thousandth of the tolerance.

    Args:
        model: a mechanism, a problem or its name, an .xml or .urdf file, file.py:callable. A MuJoCo model
            file is run by MuJoCo's integrators, unless `solvers` names ours.
        state: where the motion starts; by default the model's own start, or all zeros.
        duration: how long it is, s; by default the problem's.
        tolerance: of the largest |ΔC| (Wang's), as a fraction of the energy that the system has (max K +
            range of V).
        motion_tolerance: accepted motion error; by default `tolerance`. `inf` ignores the motion, as for
            chaotic motions over long times.
        solvers: names of the solvers to try; by default all that suit the model.
        time_limit: seconds that the search may take. It then ends with the best so far, and a note.
        progress: called with the fraction done.
        **simulation: `equations`, `controller` and `constraints`, as for `simulate`. For MuJoCo the
            controller is a function, called as controller(model, data) before each step.

    Returns:
        The recommendation. Its `exit_code` is 1 if nothing tried keeps the tolerance, and 3 (unresolved)
        if the system has next to no energy, so that there is nothing to judge a step by; `best` is then None.

    Raises:
        InputError: as `simulate`; tolerances that are not positive; a model without start or duration.
    """
    accepted = check_tolerance(tolerance)
    if accepted < ROUNDING:
        raise InputError(
            f"recommend: tolerance is {tolerance:g}; below {ROUNDING:g} of the energy there is "
            "nothing but rounding. Ask for more than that"
        )
    of_motion = (
        accepted if motion_tolerance is None else _positive(motion_tolerance, "motion_tolerance")
    )
    loaded = load_model(model)
    mechanism = loaded.mechanism
    state = starting(loaded, state)
    duration = _positive(loaded.lasting(duration), "duration")
    deadline = Deadline(_positive(time_limit, "time_limit"))
    choice, notes = families(
        model,
        mechanism,
        state,
        duration,
        solvers,
        handed_on(recommend, simulation, own=("record",)),
        deadline,
    )
    trials = Trials(mechanism, state, of_motion)
    tolerances = (accepted, of_motion)
    candidates = [SolverCandidate(family, tolerances, duration) for family in choice]
    search = Search(candidates, trials, tolerances, deadline, progress)
    best = search.cheapest()
    refused = [c.reason for c in search.candidates if c.refused]
    if len(refused) == len(choice):
        raise SolverError(f"recommend: no solver can be used. {'. '.join(refused)}")
    missing = not_simulated(loaded.import_report)
    if missing and best is not None and not best.family.name.startswith(MUJOCO):
        notes = (f"{missing[0].what} ({missing[0].evidence}). {missing[0].remedy}", *notes)
    return Recommendation(
        best=None if best is None else best.trials[best.passing],
        coarser=None if best is None else best.trials.get(best.passing - 1),
        prospects=search.prospects(best),
        trials=tuple(trial for c in search.candidates for trial in c.trials.values()),
        tolerance=accepted,
        motion_tolerance=of_motion,
        duration=duration,
        reference_energy=trials.reference_energy,
        still=trials.still,
        notes=(*notes, *search.notes, *_reasons(search.candidates)),
        import_report=loaded.import_report,
    )


def _reasons(candidates: Sequence[SolverCandidate]) -> list[str]:
    """Why solvers were not run, or not to the end."""
    dearer = [c.family.name for c in candidates if not (c.trials or c.reason or c.given_up)]
    reasons = [c.reason or c.given_up for c in candidates if c.reason or c.given_up]
    if dearer:
        reasons.append(f"not run, as they need more time at their order: {', '.join(dearer)}")
    return reasons


class SolverCandidate:
    """A solver, its trials by their place among its settings, and what these let expect."""

    def __init__(self, family: Family, tolerances: tuple[float, float], duration: float) -> None:
        """Without trials."""
        self.family, self.tolerances, self._duration = family, tolerances, duration
        self.trials: dict[int, Trial] = {}
        self.times: dict[int, float] = {}  # s, of runs at a place
        self.bias = 1.0  # by what factor an error was found larger than it was estimated
        self.reason, self.refused = "", False
        self.waited = 0.0  # s, for its latest trial
        self.floor = 0.0  # s, that a run was found to exceed
        self.given_up = ""  # why it was ended there

    def _excess(self, place: int) -> float:
        trial = self.trials[place]
        return trial.excess(*self.tolerances) * (1.0 if trial.verified else self.bias)

    def _resolved(self, place: int) -> bool:
        """Whether the order can be relied on: a trial's error is a small part of the motion."""
        return self.trials[place].excess(1.0, 1.0) <= ROUGHLY

    @property
    def resolved(self) -> bool:
        """Whether a trial has the order of the solver."""
        return any(map(self._resolved, self.trials))

    @property
    def rate(self) -> float:
        """How fast the motion changes as its errors tell, 1/s: error = (rate × step)^order; 0 if unknown.

        Only errors of motion above the tolerance tell it: smaller ones may be those of steps that stability
        limits, and then tell nothing of the steps that accuracy needs.
        """
        family, errors = self.family, {k: t.motion for k, t in self.trials.items()}
        telling = [k for k, error in errors.items() if self.tolerances[1] < error <= ROUGHLY]
        if family.knob != "step" or not telling:
            return 0.0
        order = family.order or 1
        return max(float(errors[k] ** (1.0 / order)) / family.settings[k] for k in telling)

    def fewest(self, rate: float) -> float:
        """Evaluations of ẋ that it needs at least for a motion of this rate."""
        order = self.family.order or 1
        steps = self._duration * rate / float(self.tolerances[1] ** (1.0 / order))
        return max(self.family.stages, 1) * steps / SLACK

    def seconds_each(self, overhead: float) -> float:
        """Of an evaluation of ẋ, s; infinite where it is not known."""
        place = max(self.times, default=0)
        evaluations = self.family.stages * self._steps(self.family.settings[place])
        if self.family.knob != "step" or not self.times or not evaluations:
            return math.inf
        return max(self.times[place] - overhead, 0.0) / evaluations

    @property
    def order(self) -> float:
        """Power of the setting by which the error falls: the solver's, or less where trials say so.

        At kinks it is less; what converges does so by the first order at least.
        """
        nominal = float(self.family.order or 1) if self.family.knob == "step" else 1.0
        resolved = sorted(k for k in self.trials if self._excess(k) > 0.0 and self._resolved(k))
        observed = list(itertools.starmap(self._observed, itertools.pairwise(resolved)))
        if not observed:
            return nominal
        # The first trials may still be coarser than what is fastest in the motion.
        trusted = LEAST_ORDER * nominal
        lower = len(observed) > 1 and max(observed[-2:]) < trusted
        return min(max(observed[-1], 1.0 if lower else trusted), nominal)

    def _observed(self, coarse: int, fine: int) -> float:
        ratio = self.family.settings[coarse] / self.family.settings[fine]
        return math.log(self._excess(coarse) / self._excess(fine)) / math.log(ratio)

    @property
    def place(self) -> int:
        """The setting to be run next: the one that is expected to do, or a finer one that shows the order."""
        return self._within(self._expected(first=True))

    @property
    def goal(self) -> int:
        """The coarsest setting that is expected to keep the tolerances; behind the last one if none does."""
        return self._within(self._expected(first=False))

    def _bracket(self) -> tuple[int, int]:
        """The finest setting that fails, -1 for none, and the next finer trial: the coarsest that passes."""
        fails = max((k for k in self.trials if self._excess(k) > 1.0), default=-1)
        return fails, min((k for k in self.trials if k > fails), default=len(self.family.settings))

    @property
    def passing(self) -> int:
        """Where the coarsest trial is that keeps the tolerances, as do all finer ones; else behind all."""
        return self._bracket()[1]

    def _expected(self, *, first: bool) -> float:
        """The setting that keeps the tolerances by the order, or the `first` one towards it."""
        settings = self.family.settings
        if not self.trials:
            return settings[0]
        fails, passes = self._bracket()
        nearest = passes if passes < len(settings) else fails
        excess, setting = self._excess(nearest), settings[nearest]
        if math.isinf(excess):
            return setting / REFINEMENT
        if self._resolved(nearest):
            return setting / float(max(excess, EPS) ** (1.0 / self.order))
        # Coarser than anything that has an order: the error has still to fall from `ROUGHLY`.
        rest = 1.0 if first else float((ROUGHLY / min(self.tolerances)) ** (1.0 / self.order))
        return setting / (2.0 * max(rest, 1.0))

    def _within(self, setting: float) -> int:
        """The place of the coarsest setting from this one on, in the bracket."""
        settings = self.family.settings
        guess = next((k for k, h in enumerate(settings) if h <= setting * (1 + EPS)), len(settings))
        fails, passes = self._bracket()
        return min(max(guess, fails + 1), passes)

    def _steps(self, setting: float) -> float:
        return self._duration / setting if self.family.knob == "step" else math.inf

    def seconds(self, place: int, overhead: float) -> float:
        """The time of a run (s), by its number of steps; of an adaptive solver by the order of these."""
        if place in self.times:
            return self.times[place]
        if not self.times:
            return 0.0
        settings = self.family.settings
        place = min(place, len(settings) - 1)
        timed = max(self.times)
        work = max(self.times[timed] - overhead, 0.0)
        power = 1.0 if self.family.knob == "step" else 1.0 / ((self.family.order or 4) + 1)
        return overhead + work * float((settings[timed] / settings[place]) ** power)

    def prospect(self, place: int, overhead: float = 0.0) -> Prospect:
        """What is expected of a setting."""
        family, setting = self.family, self.family.settings[place]
        evaluations = family.stages * round(self._steps(setting)) if family.stages else 0
        return Prospect(
            family.name, family.knob, setting, self.seconds(place, overhead), evaluations
        )


class Search:
    """Makes the cheapest prediction true, until the cheapest is verified."""

    def __init__(
        self,
        candidates: Sequence[SolverCandidate],
        trials: Trials,
        tolerances: tuple[float, float],
        deadline: Deadline,
        progress: Progress | None,
    ) -> None:
        """Of candidates without trials."""
        self.candidates = list(candidates)
        self.notes: list[str] = []
        self._trials, self._deadline = trials, deadline
        self._progress = progress or no_progress
        self._tolerances = tolerances
        self._first_wait = 0.0  # s, for the first trial of a solver, the longest so far

    def cheapest(self) -> SolverCandidate | None:
        """The candidate whose setting is verified, and expected to be the cheapest; None if there is none."""
        try:
            while (candidate := self._next()) is not None:
                place = candidate.place
                if place == len(candidate.family.settings):
                    finest = candidate.trials[max(candidate.trials)]
                    candidate.reason = (
                        f"{candidate.family.name} is not expected to keep the tolerance at any setting: at "
                        f"{setting_of(finest)} it {failing(finest, *self._tolerances)}"
                    )
                elif place not in candidate.trials:
                    self._try(candidate, place)
                elif not candidate.trials[place].verified:
                    self._verify(candidate, place)
                elif place and place - 1 not in candidate.trials:
                    self._try(candidate, place - 1)  # a longer step is to fail
                else:
                    return candidate
        except OutOfTime:
            self.notes.append("the time limit passed before all solvers were tried to the end")
        return None if self._trials.still else self._at_hand()

    def _at_hand(self) -> SolverCandidate | None:
        """The cheapest of those that a trial has found to keep the tolerances, verified."""
        self._deadline.lift()
        while passing := [c for c in self._alive if c.passing in c.trials]:
            best = min(passing, key=lambda c: c.times[c.passing])
            if best.trials[best.passing].verified:
                return best
            self._verify(best, best.passing)
        return None

    @property
    def _alive(self) -> list[SolverCandidate]:
        return [c for c in self.candidates if not c.reason]

    @property
    def _overhead(self) -> float:
        """What any run costs, however few its steps, s."""
        times = [t for c in self.candidates for t in c.times.values()]
        return 0.9 * min(times, default=0.0)

    def _next(self) -> SolverCandidate | None:
        """The candidate with the least expected time; among equals that with the fewest evaluations.

        Until a trial has an order, that whose next trial will be over first.
        """
        alive = self._alive
        if not alive or self._trials.still:
            return None
        if not any(c.resolved for c in alive):
            return min(alive, key=self._wait)
        times = {id(c): self._least(c) for c in alive}
        least = min(times.values())
        equals = [c for c in alive if times[id(c)] <= SAME_TIME * least]
        return min(equals, key=self._evaluations)

    def _wait(self, candidate: SolverCandidate) -> float:
        """For the next trial, s; the first one includes what is to be compiled."""
        if not candidate.trials:
            return self._first_wait
        return REFINEMENT * candidate.waited if len(candidate.trials) > 1 else 0.0

    def _least(self, candidate: SolverCandidate) -> float:
        """The expected time of a run, s; of a solver without trials no more than a bound.

        By its order, where it takes steps of one length, with evaluations as fast as those that were timed.
        Where accuracy limits such steps the motion is not stiff, and implicit adaptive solvers gain nothing
        over explicit ones.
        """
        alive, overhead = self._alive, self._overhead
        if candidate.trials or candidate.given_up:
            return max(candidate.seconds(candidate.goal, overhead), candidate.floor)
        rate = min((c.rate for c in alive if c.rate), default=0.0)
        if candidate.family.knob == "step":
            each = min(c.seconds_each(overhead) for c in alive)
            return overhead + candidate.fewest(rate) * each if rate and math.isfinite(each) else 0.0
        explicit = [
            c.seconds(c.goal, overhead)
            for c in alive
            if c.trials and c.family.knob == "tolerance" and not c.family.implicit
        ]
        return min(explicit, default=0.0) if rate and candidate.family.implicit else 0.0

    def _evaluations(self, candidate: SolverCandidate) -> float:
        if not candidate.trials or candidate.given_up:
            return math.inf
        place = min(candidate.goal, len(candidate.family.settings) - 1)
        return candidate.prospect(place).evaluations or math.inf

    def _budget(self, candidate: SolverCandidate) -> float:
        """Seconds after which a run cannot be that of the best, as far as it is known."""
        times = [c.seconds(c.place, self._overhead) for c in self._alive if c.resolved]
        return max(TOO_DEAR * max(min(times, default=math.inf), candidate.floor), LEAST_BUDGET)

    def _try(self, candidate: SolverCandidate, place: int) -> None:
        """Run a setting; of the first run that has an order, measure what more steps cost as well."""
        family, settings = candidate.family, candidate.family.settings
        self._progress(sum(bool(c.trials) for c in self.candidates) / (len(self.candidates) + 1))
        budget = self._budget(candidate)
        self._deadline.allow(budget)
        began, first = time.monotonic(), not candidate.trials
        try:
            trial = self._trials.of(family, settings[place])
            candidate.trials[place], candidate.given_up = trial, ""
            if not trial.message:
                candidate.times[place] = trial.seconds
            longer = place + len(LADDER)  # ten times as many steps: what they cost shows there
            brief = 10.0 * trial.seconds < LEAST_BUDGET and longer < len(settings)
            if brief and family.knob == "step" and place == max(candidate.times, default=0):
                candidate.times[longer] = self._trials.seconds(family, settings[longer])
        except RefusedSolver as refusal:
            candidate.reason, candidate.refused = f"{family.name} was left out: {refusal}", True
        except OverBudget as excess:
            candidate.floor = budget
            candidate.given_up = (
                f"{family.name} was given up at {family.knob} {settings[place]:g}: {excess}, "
                f"{TOO_DEAR:g} times what the best is expected to take"
            )
        candidate.waited = time.monotonic() - began
        if first:
            self._first_wait = max(self._first_wait, candidate.waited)

    def _verify(self, candidate: SolverCandidate, place: int) -> None:
        self._deadline.allow()
        estimate = candidate.trials[place]
        trial = self._trials.verified(candidate.family, estimate)
        excess, estimated = (t.excess(*self._tolerances) for t in (trial, estimate))
        if excess > 1.0 and estimated > 0.0 and math.isfinite(excess):
            candidate.bias = max(candidate.bias, excess / estimated)
        seconds = self._trials.seconds(candidate.family, trial.setting)
        candidate.trials[place] = replace(trial, seconds=seconds)
        candidate.times[place] = seconds

    def prospects(self, best: SolverCandidate | None) -> tuple[Prospect, ...]:
        """What was expected of every solver in the end, the cheapest first, the best before all."""
        candidates = [c for c in self._alive if c.trials and c.goal < len(c.family.settings)]
        rows = {id(c): c.prospect(c.goal, self._overhead) for c in candidates if not c.given_up}
        ranked = sorted(rows, key=lambda key: (key != id(best), rows[key].seconds))
        return tuple(rows[key] for key in ranked)


def _positive(value: float, what: str) -> float:
    number = number_or_nan(value)
    if not number > 0.0:
        raise InputError(f"recommend: {what} is {value!r}; expected a positive number")
    return number
