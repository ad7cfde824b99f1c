"""The whole study: every run once, its ledger, and the results with the thesis beside them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import PurePath
from typing import Any

from deltac.calls.progress import Progress
from deltac.errors import InputError, UnknownName
from deltac.results import Report, Section, Serialisable, Table, number
from thesis.experiments import (
    EVERYTHING,
    EXPERIMENTS,
    REPORTED,
    PublishedExperiment,
    Reported,
    agrees,
)
from thesis.measures import NAMES, final, largest
from thesis.runs import Outcome, Run, absolute_angles, perform


@dataclass(frozen=True)
class Result(Serialisable):
    """A number of ours beside what the thesis says of it, and at which lines or equations (`source`).

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
    source: str = ""

    @property
    def judged(self) -> bool:
        """Whether a rule was applied: the number belongs in a summary."""
        return self.agrees is not None

    @property
    def reported(self) -> str:
        """What the thesis says, as text."""
        if self.thesis is None:
            return "–"
        statement = self.thesis if isinstance(self.thesis, str) else number(self.thesis, self.unit)
        return f"{statement} ({self.source})"

    @property
    def measured(self) -> str:
        """What we measure, as text."""
        return f"{self.run}: {self.quantity} = {number(self.value, self.unit)}"

    def verdict(self, reasons: Sequence[str]) -> str:
        """Whether it agrees, with the number of the reason where we are known to differ."""
        if self.agrees:
            return "yes"
        return f"no [{reasons.index(self.difference) + 1}]" if self.difference else "NO"


@dataclass(frozen=True, eq=False, repr=False)
class Reproduction(Report, omit=("experiments", "outcomes"), also=("agrees", "assumed")):
    """The experiments that were run, what came out of each run, and the results.

    `outcomes` maps a `Run` to its trajectory and ledger; runs that serve several figures are there
    once. `results` holds the statements of every figure first, then what is only reported.
    """

    experiments: tuple[PublishedExperiment, ...]
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

    @property
    def exit_code(self) -> int:
        """Exit code: 0 if all agrees but the known differences, else 1."""
        return 0 if self.agrees else 1

    def summary(self) -> str:
        """How many statements of the thesis were checked, and how many agree."""
        judged = [row for row in self.results if row.judged]
        agree = sum(row.agrees is True for row in judged)
        explained = sum(bool(row.difference) for row in self.differences)
        return f"{agree} of {len(judged)} statements agree, {explained} differ for a known reason"

    def assumed(self) -> dict[str, str]:
        """What the thesis does not say and we chose, by figure."""
        return {e.figure: e.assumed for e in self.experiments if e.assumed}

    def sections(self) -> Iterator[Section]:
        """Every statement of the thesis beside our number; then why some are known to differ."""
        reasons = list(dict.fromkeys(r.difference for r in self.differences if r.difference))
        rows: list[tuple[str, ...]] = []
        for experiment in self.experiments:
            name, statement = f"{experiment.figure}  {experiment.title}", ""
            rows += [()] if rows else []
            for row in self.results:
                if row.figure == experiment.figure and row.judged:
                    previous, statement = statement, row.reported
                    cell = "" if statement == previous else statement
                    rows.append((name, cell, row.measured, row.verdict(reasons)))
                    name = ""
        yield Table(("experiment", "the thesis reports", "we measure", "agrees?"), tuple(rows))
        yield from (f"[{k}] {reason}" for k, reason in enumerate(reasons, 1))
        yield from (f"{figure}: we chose {what}." for figure, what in self.assumed().items())

    def report(self, path: str | PurePath, *more: Report, **keywords: Any) -> None:
        """The ten figures as live panels beside the statements; see `Report.report`."""
        import_module("thesis.page")  # which says how
        super().report(path, *more, **keywords)

    def of(self, experiment: PublishedExperiment, *, compared: bool = False) -> dict[str, Outcome]:
        """What came out of an experiment's runs, by their labels; with those that it is compared with."""
        runs = experiment.all_runs if compared else experiment.runs
        return {label: self.outcomes[run] for label, run in runs.items()}


def reproduce(only: Iterable[str] | None = None, progress: Progress | None = None) -> Reproduction:
    """Run the thesis's experiments again.

    Args:
        only: the figures to reproduce, "4.1" to "4.10", all of them without it; or "floor", which
            repeats three of them with accelerations as inexact as an iterative solver makes them, and
            "rate", K̇ + V̇ − Q̇ of the runs of 4.7.
        progress: called with the fraction done.

    Raises:
        InputError: an unknown figure.
    """
    experiments = _experiments(only)
    runs = list(dict.fromkeys(run for e in experiments for run in e.all_runs.values()))
    stages = len(runs) + len(experiments)

    def say(done: int) -> None:
        if progress is not None:
            progress(done / stages)

    outcomes: dict[Run, Outcome] = {}
    for run in runs:
        say(len(outcomes))
        outcomes[run] = perform(run)
    reproduction = Reproduction(experiments, outcomes, ())
    results: list[Result] = []
    for k, experiment in enumerate(experiments):
        say(len(runs) + k)
        results.extend(_results(experiment, reproduction))
    say(stages)
    return Reproduction(experiments, outcomes, tuple(results))


def _experiments(only: Iterable[str] | None) -> tuple[PublishedExperiment, ...]:
    names = [experiment.figure for experiment in EVERYTHING]
    if only is None:
        return EXPERIMENTS
    figures = [only] if isinstance(only, str) else list(only)
    for figure in figures:
        if figure not in names:
            raise UnknownName(f"unknown figure {figure!r} of the thesis; known: {', '.join(names)}")
    if not figures:
        raise InputError(f"no figure of the thesis was named; known: {', '.join(names)}")
    return tuple(experiment for experiment in EVERYTHING if experiment.figure in figures)


def _results(experiment: PublishedExperiment, reproduction: Reproduction) -> Iterator[Result]:
    """The claims of an experiment, then what every run of it reports besides."""
    outcomes = reproduction.of(experiment, compared=True)
    for claim in experiment.claims:
        value = claim.measure.of(*(outcomes[label] for label in claim.run.split(" / ")))
        yield Result(
            experiment.figure,
            claim.run,
            claim.measure.quantity,
            claim.thesis,
            value,
            claim.measure.unit,
            claim.rule,
            agrees(claim.rule, value, claim.thesis),
            claim.difference,
            claim.source,
        )
    claimed = {(claim.run, claim.measure.quantity) for claim in experiment.claims}
    for label, outcome in reproduction.of(experiment).items():
        for quantity, value, unit in _reported(experiment, outcome):
            if (label, quantity) not in claimed:
                yield Result(experiment.figure, label, quantity, None, value, unit, REPORTED, None)


def _reported(
    experiment: PublishedExperiment, outcome: Outcome
) -> Iterator[tuple[str, float, str]]:
    """(quantity, value, unit) of every run: its testing functions, and where it ends."""
    end = f"{outcome.run.duration:g} s"
    if experiment.shows in ("testing functions", "numbers"):
        for function, name in NAMES.items():
            yield f"{name} |ΔC| at {end}", final(outcome, function), "J"
            yield f"max {name} |ΔC|", largest(outcome, function), "J"
    if outcome.horizon is not None:
        yield "divergence horizon", outcome.horizon, "s"
        return
    for bar, angle in enumerate(absolute_angles(outcome.trajectory)[-1], 1):
        yield f"θ{bar} at {end}", math.degrees(angle), "deg"
