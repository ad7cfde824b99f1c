"""The whole study: every run once, its ledger, and the results with the thesis beside them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from deltac.errors import InputError
from deltac.studies.thesis.experiments import EXPERIMENTS, REPORTED, Experiment, Reported
from deltac.studies.thesis.measures import NAMES, final, largest
from deltac.studies.thesis.runs import Outcome, Run, absolute_angles, perform

Progress: TypeAlias = Callable[[float, str], None]
"""Told the fraction that is done, and what is being done."""


@dataclass(frozen=True)
class Result:
    """A number of ours beside what the thesis says of it.

    `rule` is the statement that was checked, in words; `agrees` its outcome, None where the number
    is only reported. `difference` says why, where we are known to differ from the thesis.
    """

    figure: str
    run: str
    quantity: str
    thesis: Reported
    value: float
    unit: str
    rule: str
    agrees: bool | None
    difference: str = ""

    @property
    def judged(self) -> bool:
        """Whether a rule was applied: the number belongs in a summary."""
        return self.agrees is not None

    def to_dict(self) -> dict[str, Reported | bool]:
        """The entry of results.json; a value that is not finite is null there."""
        names = ("figure", "run", "quantity", "thesis", "value", "unit", "rule", "agrees")
        entry = {name: getattr(self, name) for name in names}
        return entry if math.isfinite(self.value) else {**entry, "value": None}


@dataclass(frozen=True, eq=False)
class Reproduction:
    """The experiments that were run, what came out of each run, and the results.

    `outcomes` maps a `Run` to its trajectory and ledger; runs that serve several figures are there
    once. `results` holds the statements of every figure first, then what is only reported.
    """

    experiments: tuple[Experiment, ...]
    outcomes: Mapping[Run, Outcome]
    results: tuple[Result, ...]

    @property
    def agrees(self) -> bool:
        """Whether all statements hold but those declared as known differences."""
        return not any(row.agrees is False and not row.difference for row in self.results)

    @property
    def differences(self) -> tuple[Result, ...]:
        """The results that do not agree, known or not."""
        return tuple(row for row in self.results if row.agrees is False)

    def of(self, experiment: Experiment) -> dict[str, Outcome]:
        """What came out of an experiment's runs, by their labels."""
        return {label: self.outcomes[run] for label, run in experiment.runs.items()}


def reproduce(only: Iterable[str] | None = None, progress: Progress | None = None) -> Reproduction:
    """Run the thesis's experiments again.

    Args:
        only: the figures to reproduce, "4.1" to "4.10"; all of them without it.
        progress: called with the fraction done and what is being done.

    Raises:
        InputError: an unknown figure.
    """
    chosen = _chosen(only)
    runs = list(dict.fromkeys(run for e in chosen for run in e.runs.values()))
    stages = len(runs) + len(chosen)

    def say(done: int, what: str) -> None:
        if progress is not None:
            progress(done / stages, what)

    outcomes: dict[Run, Outcome] = {}
    for run in runs:
        say(len(outcomes), f"{run.variant}, {run.solver}, h = {run.step:g} s")
        outcomes[run] = perform(run)
    reproduction = Reproduction(chosen, outcomes, ())
    results: list[Result] = []
    for k, experiment in enumerate(chosen):
        say(len(runs) + k, f"results of fig. {experiment.figure}")
        results.extend(_results(experiment, reproduction.of(experiment)))
    say(stages, "done")
    return Reproduction(chosen, outcomes, tuple(results))


def _chosen(only: Iterable[str] | None) -> tuple[Experiment, ...]:
    known = [experiment.figure for experiment in EXPERIMENTS]
    if only is None:
        return EXPERIMENTS
    wanted = [only] if isinstance(only, str) else list(only)
    for figure in wanted:
        if figure not in known:
            raise InputError(f"unknown figure {figure!r} of the thesis; known: {', '.join(known)}")
    if not wanted:
        raise InputError(f"no figure of the thesis was named; known: {', '.join(known)}")
    return tuple(experiment for experiment in EXPERIMENTS if experiment.figure in wanted)


def _results(experiment: Experiment, outcomes: Mapping[str, Outcome]) -> Iterator[Result]:
    """The claims of an experiment, then what every run of it reports besides."""
    for claim in experiment.claims:
        value = claim.measure(outcomes)
        yield Result(
            experiment.figure,
            claim.run,
            claim.quantity,
            claim.thesis,
            value,
            claim.unit,
            claim.rule.words,
            claim.rule.agrees(value, claim.thesis),
            claim.difference,
        )
    claimed = {(claim.run, claim.quantity) for claim in experiment.claims}
    for label, outcome in outcomes.items():
        for quantity, value, unit in _reported(experiment, outcome):
            if (label, quantity) not in claimed:
                yield Result(
                    experiment.figure, label, quantity, None, value, unit, REPORTED.words, None
                )


def _reported(experiment: Experiment, outcome: Outcome) -> Iterator[tuple[str, float, str]]:
    """(quantity, value, unit) of every run: its testing functions, and where it ends."""
    end = f"{outcome.run.duration:g} s"
    if experiment.shows == "testing functions":
        for function, name in NAMES.items():
            yield f"{name} |ΔC| at {end}", final(outcome, function), "J"
            yield f"max {name} |ΔC|", largest(outcome, function), "J"
    if outcome.horizon is not None:
        yield "divergence horizon", outcome.horizon, "s"
        return
    for bar, angle in enumerate(absolute_angles(outcome.trajectory)[-1], 1):
        yield f"θ{bar} at {end}", math.degrees(angle), "deg"
