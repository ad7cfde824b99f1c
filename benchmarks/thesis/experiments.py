"""The thesis's experiments 4.1-4.10, read from `experiments.toml`, and the rules by which they are judged."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from typing import Any, Literal, TypeAlias

from thesis.measures import MEASURES, Measure
from thesis.runs import Run

Reported: TypeAlias = float | str | None
"""What the thesis says: a number, words, or nothing."""

REPORTED, POWER_OF_TEN = "reported", "the thesis's power of ten"

_BOUND = re.compile(r"(above|below|within ±|to the digits given \(±) ([^ )]+)\)?$")


def agrees(rule: str, value: float, thesis: Reported) -> bool | None:
    """Whether a value satisfies a rule; None for what is only reported. NaN satisfies none.

    Rules are words that end in what is checked: "above 1", "below 1e-06", "within ± 15", "the thesis's number
    to the digits given (± 0.05)", "the thesis's power of ten" (rounded on a logarithmic axis), "reported".
    """
    if rule == REPORTED:
        return None
    if rule == POWER_OF_TEN:
        assert isinstance(thesis, float)
        return value > 0.0 and round(math.log10(value)) == round(math.log10(thesis))
    match = _BOUND.search(rule)
    if match is None:
        raise ValueError(f"unknown rule {rule!r}")
    kind, bound = match[1], float(match[2])
    if kind == "above":
        return value > bound
    if kind == "below":
        return value < bound
    if kind == "within ±":
        return abs(value) <= bound
    assert isinstance(thesis, float)
    return abs(value - thesis) <= bound


@dataclass(frozen=True)
class Claim:
    """A statement of the thesis about one run or a comparison of several, and how it is checked.

    `run` names one run, or two with " / " between them; `measure` is taken of them; `thesis` is its number or
    its words, and `source` the lines or equations where they are. `difference` is not empty where we are
    known to differ: it says why.
    """

    run: str
    measure: Measure
    thesis: Reported
    source: str
    rule: str
    difference: str = ""


@dataclass(frozen=True)
class PublishedExperiment:
    """What a figure of the thesis shows; `runs` are labelled as in its legend.

    `compared` are further runs that claims refer to. `axes` are (from, to, every) of the thesis's panels.
    `assumed` says what the thesis leaves open and we had to choose.
    """

    figure: str
    title: str
    shows: Literal["testing functions", "torque", "angles", "rates", "numbers"]
    runs: Mapping[str, Run]
    claims: tuple[Claim, ...]
    compared: Mapping[str, Run] = field(default_factory=dict)
    axes: Mapping[str, Sequence[Sequence[float]]] = field(default_factory=dict)
    assumed: str = ""

    @property
    def heading(self) -> str:
        """The title of its figure."""
        return f"Fig. {self.figure}  {self.title}" if self in EXPERIMENTS else self.title

    @property
    def all_runs(self) -> dict[str, Run]:
        """The runs that are drawn, and those that claims refer to."""
        return {**self.runs, **self.compared}


def _read() -> tuple[PublishedExperiment, ...]:
    table: dict[str, Any] = tomllib.loads(
        files("thesis").joinpath("experiments.toml").read_text("utf-8")
    )
    experiments = []
    for entry in table["experiments"]:
        runs, compared = (
            {label: Run(*values) for label, values in entry.pop(name, {}).items()}
            for name in ("runs", "compared")
        )
        claims = tuple(
            Claim(
                run,
                MEASURES[measure],
                thesis or None,
                source,
                rule,
                *(table["differences"][reason] for reason in reasons),
            )
            for run, measure, thesis, source, rule, *reasons in entry.pop("claims")
        )
        experiments.append(
            PublishedExperiment(**entry, runs=runs, compared=compared, claims=claims)
        )
    return tuple(experiments)


EVERYTHING = _read()

EXPERIMENTS = tuple(experiment for experiment in EVERYTHING if experiment.figure.startswith("4."))
"""The ten figures. The others of `EVERYTHING` are none of the thesis's: "floor", an erratic error of 1e-9 in
the accelerations that makes the rows agree in which the thesis and we differ, one of 1e-10 not all of them;
"rate", the rate form of the runs of 4.7."""
