"""The thesis's experiments 4.1-4.10, read from `experiments.toml`, and the rules by which they are judged."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from typing import Any, Literal, TypeAlias

from deltac.studies.thesis.measures import MEASURES, Measure
from deltac.studies.thesis.runs import Run

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
    found = _BOUND.search(rule)
    if found is None:
        raise ValueError(f"unknown rule {rule!r}")
    kind, bound = found[1], float(found[2])
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
    its words. `difference` is not empty where we are known to differ: it says why.
    """

    run: str
    measure: Measure
    thesis: Reported
    rule: str
    difference: str = ""


@dataclass(frozen=True)
class Experiment:
    """What a figure of the thesis shows; `runs` are labelled as in its legend.

    `assumed` says what the thesis leaves open and we had to choose.
    """

    figure: str
    title: str
    shows: Literal["testing functions", "torque", "angles", "numbers"]
    runs: Mapping[str, Run]
    claims: tuple[Claim, ...]
    assumed: str = ""


def _read() -> tuple[Experiment, ...]:
    table: dict[str, Any] = tomllib.loads(
        files("deltac.studies.thesis").joinpath("experiments.toml").read_text("utf-8")
    )
    made = []
    for entry in table["experiments"]:
        runs = {label: Run(*values) for label, values in entry.pop("runs").items()}
        claims = tuple(
            Claim(run, MEASURES[measure], thesis or None, rule, *map(table["differences"].get, why))
            for run, measure, thesis, rule, *why in entry.pop("claims")
        )
        made.append(Experiment(**entry, runs=runs, claims=claims))
    return tuple(made)


EVERYTHING = _read()

EXPERIMENTS = EVERYTHING[:-1]
"""The ten figures. The last of all, "floor", is none of the thesis's: an erratic error of 1e-9 in the
accelerations makes the rows agree in which the thesis and we differ, one of 1e-10 not all of them."""
