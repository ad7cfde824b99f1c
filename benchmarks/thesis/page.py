"""The page of the thesis's study: its ten figures as live panels beside its statements."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from deltac.arrays import EPS, Array
from deltac.report.page.content import Beside, page_of
from deltac.report.page.parts import Chapter, Grid, Page, Part, Words
from deltac.report.page.scene import scene
from deltac.report.panels import Guide, Line, TimePlot
from deltac.results import Table
from thesis.experiments import PublishedExperiment
from thesis.reproduction import Reproduction
from thesis.runs import PRESCRIBED, Outcome, absolute_angles, problem

NAMES = {"liu-huston": "Liu–Huston", "wang": "Wang"}


@page_of.register
def _(report: Reproduction, beside: Beside) -> Page:
    judged = [row for row in report.results if row.judged]
    agree = sum(row.agrees is True for row in judged)
    explained = sum(bool(row.difference) for row in report.differences)
    reasons = list(dict.fromkeys(r.difference for r in report.differences if r.difference))
    first = report.experiments[0]
    label, outcome = next(iter(report.of(first).items()))
    mechanism = problem(outcome.run.variant).mechanism
    chapters = [Chapter(e.heading, tuple(_panels(report, e, reasons))) for e in report.experiments]
    if reasons:
        lines = tuple(f"[{k}] {reason}" for k, reason in enumerate(reasons, 1))
        chapters.append(Chapter("Where we are known to differ", (Words("", lines),)))
    return Page(
        title="The study of the thesis",
        asked="Do the energy testing functions show what the thesis says they do?",
        tone="good" if report.agrees else "bad",
        word=f"{agree} of {len(judged)} statements agree",
        sentence=f"{explained} differ for a known reason." if explained else "",
        numbers=(
            ("figures", str(len(report.experiments))),
            ("runs", str(len(report.outcomes))),
            ("statements that were checked", str(len(judged))),
        ),
        chapters=tuple(chapters),
        scene=scene(mechanism, [(f"fig. {first.figure}, {label}", outcome.trajectory)]),
        data=report.to_dict(),
    )


def _panels(
    report: Reproduction, experiment: PublishedExperiment, reasons: list[str]
) -> Iterator[Part]:
    outcomes = report.of(experiment)
    if experiment.shows == "testing functions":
        yield _functions(outcomes, "wang", tall=True)
        yield _functions(outcomes, "liu-huston")
    if experiment.shows == "torque":
        outcome = next(iter(outcomes.values()))
        t, torque = outcome.trajectory.t, outcome.trajectory.forces[PRESCRIBED][:, 0]
        yield TimePlot("The driving torque M1", t, (Line("M1", torque),), "N·m", tall=True)
    if experiment.shows == "rates":
        t = _longest(outcomes)
        lines = tuple(
            Line(label, _at(t, outcome, outcome.rates["wang"]), colour=k)
            for k, (label, outcome) in enumerate(outcomes.items())
        )
        yield TimePlot("K̇ + V̇ − Q̇", t, lines, "W", tall=True)
    if experiment.shows in ("testing functions", "angles"):
        yield from _angles(outcomes)
    rows = tuple(
        (row.reported, row.measured, row.rule, row.verdict(reasons))
        for row in report.results
        if row.figure == experiment.figure and row.judged
    )
    if rows:
        heads = ("the thesis reports", "we measure", "the rule", "agrees?")
        yield Grid.of("The statements", Table(heads, rows))
    if experiment.assumed:
        yield Words("", (f"We chose {experiment.assumed}.",))


def _functions(outcomes: Mapping[str, Outcome], function: str, tall: bool = False) -> TimePlot:
    """|ΔC| of a testing function in all runs of a figure."""
    t = _longest(outcomes)
    exchanged = max(outcome.ledger.energy_exchanged for outcome in outcomes.values())
    lines = []
    for k, (label, outcome) in enumerate(outcomes.items()):
        size = np.maximum(np.abs(outcome.ledger.delta_c[function]), EPS * exchanged)
        lines.append(Line(label, _at(t, outcome, size), colour=k))
    return TimePlot(
        f"|ΔC| of {NAMES[function]}'s function",
        t,
        tuple(lines),
        "J",
        log=True,
        guides=(Guide("energy exchanged", exchanged),),
        note="What is smaller than rounding of the energy exchanged is drawn there.",
        tall=tall,
    )


def _angles(outcomes: Mapping[str, Outcome]) -> Iterator[TimePlot]:
    """The angles from the vertical, a plot for each bar; the finest or last run is in front."""
    t = _longest(outcomes)
    angles = {label: np.degrees(absolute_angles(o.trajectory)) for label, o in outcomes.items()}
    for bar in range(next(iter(angles.values())).shape[1]):
        yield TimePlot(
            f"θ{bar + 1} from the vertical",
            t,
            tuple(
                Line(label, _at(t, outcomes[label], values[:, bar]), colour=k)
                for k, (label, values) in enumerate(angles.items())
            ),
            "deg",
        )


def _longest(outcomes: Mapping[str, Outcome]) -> Array:
    """The times of the run with the most rows."""
    times: Array = max((outcome.trajectory.t for outcome in outcomes.values()), key=len)
    return times


def _at(t: Array, outcome: Outcome, values: Array) -> Array:
    """A curve of a run at other times; none after its end."""
    own = outcome.trajectory.t
    if len(own) == len(t) and np.array_equal(own, t):
        return values
    interpolated: Array = np.interp(t, own, values, right=np.nan)
    return interpolated
