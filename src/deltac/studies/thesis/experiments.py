"""Rules: a statement of the thesis in words, together with the code that checks it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from deltac.studies.thesis import measures as m
from deltac.studies.thesis.runs import Run

Reported: TypeAlias = float | str | None
"""What the thesis says: a number, words, or nothing."""


@dataclass(frozen=True)
class Rule:
    """`words` say what `holds` checks of (our value, the thesis's); None: nothing is checked.

    A value that is not a number satisfies no rule.
    """

    words: str
    holds: Callable[[float, Reported], bool] | None

    def agrees(self, value: float, thesis: Reported) -> bool | None:
        """Whether the value satisfies the rule; None where the value is reported only."""
        return None if self.holds is None else self.holds(value, thesis)


REPORTED = Rule("reported", None)


def within_factor(factor: float) -> Rule:
    """The value is the thesis's number up to a factor."""

    def holds(value: float, thesis: Reported) -> bool:
        assert isinstance(thesis, float)
        return thesis / factor <= value <= thesis * factor

    return Rule(f"within a factor {factor:g} of the thesis's number", holds)


def rounded(half_digit: float) -> Rule:
    """The value rounds to the thesis's number."""

    def holds(value: float, thesis: Reported) -> bool:
        assert isinstance(thesis, float)
        return abs(value - thesis) <= half_digit

    return Rule(f"the thesis's number to the digits given (± {half_digit:g})", holds)


def above(bound: float, meaning: str = "") -> Rule:
    """The value is larger than a bound."""
    return Rule(_said(meaning, f"above {bound:g}"), lambda value, _: value > bound)


def below(bound: float, meaning: str = "") -> Rule:
    """The value is smaller than a bound."""
    return Rule(_said(meaning, f"below {bound:g}"), lambda value, _: value < bound)


def within(bound: float, meaning: str = "") -> Rule:
    """The value's size is at most a bound."""
    return Rule(_said(meaning, f"within ± {bound:g}"), lambda value, _: abs(value) <= bound)


def _said(meaning: str, bound: str) -> str:
    return f"{meaning}: {bound}" if meaning else bound


# --- the thesis's experiments 4.1-4.10 as a table ------------------------------------------------
# Words such as "suitable" are given a number once, here. Where the rule fails because the
# thesis's number is another one than exact arithmetic gives, the claim says why: a known
# difference.


@dataclass(frozen=True)
class Claim:
    """A statement of the thesis about one run or a comparison of several, and how it is checked.

    `run` and `quantity` name what is measured, in `unit`; `thesis` is its number or its words.
    `difference` is not empty where we are known to differ: it says why.
    """

    run: str
    quantity: str
    unit: str
    thesis: Reported
    rule: Rule
    measure: m.Measure
    difference: str = ""


@dataclass(frozen=True)
class Experiment:
    """What a figure of the thesis shows; `runs` are labelled as in its legend."""

    figure: str
    title: str
    shows: Literal["testing functions", "torque", "angles"]
    runs: Mapping[str, Run]
    claims: tuple[Claim, ...]


SUITABLE, SIGNIFICANT = 1e-6, 1e-3
"""Largest |ΔC| as a fraction of the energy turned over: good enough, and an error that matters."""

ROUNDING = 1e-13
"""What 10⁵ steps leave of machine precision in sums told in different ways, relative."""

FLOOR = (
    "In the thesis |ΔC| does not fall below a floor. With exact accelerations it falls to rounding, "
    "decades lower: the thesis solved its accelerations by iterative algebraic-constraint blocks, "
    "whose tolerance is a likely floor."
)
TRUNCATION = (
    "With exact accelerations, the truncation error of ode5 at h = 0.001 s leaves 1.8e-9 J, some "
    "twenty times the thesis's number."
)

H2, H3, H4 = "h = 0.01 s", "h = 0.001 s", "h = 0.0001 s"
STEPS = {H2: 1e-2, H3: 1e-3, H4: 1e-4}
SOLVERS = ("ode1", "ode4", "ode5")


def _steps(variant: str) -> dict[str, Run]:
    return {label: Run(variant, "ode5", step) for label, step in STEPS.items()}


def _solvers(variant: str) -> dict[str, Run]:
    return {solver: Run(variant, solver, 1e-3) for solver in SOLVERS}


def _falls(coarse: str, fine: str, words: str) -> Claim:
    rule = above(1.0, "falls with h")
    return Claim(
        f"{coarse} / {fine}",
        "ratio of max |ΔC|",
        "1",
        words,
        rule,
        m.ratio(coarse, fine),
    )


def _alike(first: str, second: str, words: str) -> tuple[Claim, Claim]:
    pair = f"{first} / {second}"
    return (
        Claim(
            pair,
            "difference of final angles",
            "deg",
            words,
            below(0.01, "the same motion"),
            m.angles_apart(first, second),
        ),
        Claim(
            pair,
            "ratio of max |ΔC|",
            "1",
            words,
            below(10.0, "less than a decade apart"),
            m.farthest(first, second),
            FLOOR,
        ),
    )


DRIVEN = "ode5, h = 0.001 s"
UNDAMPED, DAMPED = "no dampers", "dampers"
RIGHT, MISTAKE, MISTAKE_DAMPED = "right equations", "sign mistake", "sign mistake, dampers"
ACCOUNTS = "the same total either way (3.2.24–3.2.44)"
SEEN = above(1e-3, "seen")

EXPERIMENTS: tuple[Experiment, ...] = (
    Experiment(
        "4.1",
        "Step size, from rest, ode5",
        "testing functions",
        _steps("standard"),
        (
            _falls(H2, H3, "ΔC falls with h"),
            _falls(H3, H4, "ΔC falls with h"),
            Claim(
                f"{H2} / {H3}",
                "observed order of ΔC",
                "1",
                None,
                REPORTED,
                m.order(H2, H3),
            ),
            Claim(
                H3,
                "max |ΔC| / energy turned over",
                "1",
                "0.001 s is suitable",
                below(SUITABLE, "suitable"),
                m.relative_of(H3),
            ),
            Claim(
                f"{H3} / {H4}",
                "ratio of max |ΔC|",
                "1",
                "0.0001 s brings no remarkable gain",
                below(10.0, "less than a decade"),
                m.ratio(H3, H4),
                FLOOR,
            ),
        ),
    ),
    Experiment(
        "4.2",
        "Solver, from rest, h = 0.001 s",
        "testing functions",
        _solvers("standard"),
        (
            Claim("ode1", "Wang |ΔC| at 10 s", "J", 7.7, within_factor(3), m.final_of("ode1")),
            Claim("ode4", "Wang |ΔC| at 10 s", "J", 1e-7, within_factor(3), m.final_of("ode4")),
            Claim(
                "ode5",
                "Wang |ΔC| at 10 s",
                "J",
                1e-10,
                within_factor(3),
                m.final_of("ode5"),
                TRUNCATION,
            ),
        ),
    ),
    Experiment(
        "4.3",
        "Step size, bar 1 started at 10 rad/s, ode5",
        "testing functions",
        _steps("fast"),
        (
            Claim(H3, "K(0)", "J", 2.721, rounded(5e-4), m.kinetic_at_start(H3)),
            _falls(H2, H3, "0.001 s better than 0.01 s"),
            _falls(H2, H4, "0.0001 s better than 0.01 s"),
        ),
    ),
    Experiment(
        "4.4",
        "Step size, bar 1 driven as θ1 = sin 0.75t, ode5",
        "testing functions",
        _steps("driven"),
        (
            Claim(H3, "K(0)", "J", 0.0153, rounded(5e-5), m.kinetic_at_start(H3)),
            _falls(H2, H3, "ΔC falls with h"),
            _falls(H3, H4, "ΔC falls with h"),
            *_alike(H3, H4, "0.001 s and 0.0001 s very similar"),
            Claim(
                H4,
                "ΔC over 2 s told three ways, spread / energy turned over",
                "1",
                ACCOUNTS,
                below(ROUNDING, "equal to rounding"),
                m.totals_apart(H4, duration=2.0),
            ),
        ),
    ),
    Experiment(
        "4.5",
        "Torque M1 that drives bar 1 as θ1 = sin 0.75t",
        "torque",
        {DRIVEN: Run("driven", "ode5", 1e-3)},
        (
            Claim(
                DRIVEN, "least M1", "N·m", "within ±15 N·m", within(15.0), m.torque(DRIVEN, np.min)
            ),
            Claim(
                DRIVEN,
                "largest M1",
                "N·m",
                "within ±15 N·m",
                within(15.0),
                m.torque(DRIVEN, np.max),
            ),
            Claim(
                DRIVEN,
                "difference from M1 by the hand-written equations",
                "N·m",
                None,
                REPORTED,
                m.torque_by_hand(DRIVEN),
            ),
            Claim(
                DRIVEN,
                "change of ΔC by a log of M1 × 1.01, as applied force",
                "J",
                None,
                SEEN,
                m.wrong_torque(DRIVEN, lambda told: told.applied),
            ),
            Claim(
                DRIVEN,
                "change of ΔC by a log of M1 × 1.01, as multiplier",
                "J",
                None,
                SEEN,
                m.wrong_torque(DRIVEN, lambda told: told.multiplier),
            ),
            Claim(
                DRIVEN,
                "change of ΔC by a log of M1 × 1.01, from accelerations",
                "J",
                None,
                within(0.0, "not seen"),
                m.wrong_torque(DRIVEN, lambda told: told.accelerations),
            ),
        ),
    ),
    Experiment(
        "4.6",
        "Solver, bar 1 driven, h = 0.001 s",
        "testing functions",
        _solvers("driven"),
        (
            Claim(
                "ode1",
                "max |ΔC| / energy turned over",
                "1",
                "ode1: significant error",
                above(SIGNIFICANT, "significant"),
                m.relative_of("ode1"),
            ),
            *_alike("ode4", "ode5", "ode4 ≈ ode5"),
            *(
                Claim(
                    solver,
                    "ε told three ways, spread / largest power of M1",
                    "1",
                    ACCOUNTS,
                    below(ROUNDING, "equal to rounding"),
                    m.rates_apart(solver),
                )
                for solver in SOLVERS
            ),
        ),
    ),
    Experiment(
        "4.7",
        "Sign mistake in the second equation, ode5, h = 0.001 s",
        "testing functions",
        {RIGHT: Run("by hand", "ode5", 1e-3), MISTAKE: Run("by hand, sign mistake", "ode5", 1e-3)},
        (
            Claim(MISTAKE, "max Wang |ΔC|", "J", "above 1 J", above(1.0), m.largest_of(MISTAKE)),
            Claim(
                MISTAKE,
                "max Liu–Huston |ΔC|",
                "J",
                "above 1 J",
                above(1.0),
                m.largest_of(MISTAKE, "liu-huston"),
            ),
            Claim(
                RIGHT,
                "Wang |ΔC| at 10 s",
                "J",
                1e-10,
                within_factor(3),
                m.final_of(RIGHT),
                TRUNCATION,
            ),
        ),
    ),
    Experiment(
        "4.8",
        "Tumbling, ode5, h = 0.01 s; dampers of 0.001 N·m·s/rad",
        "angles",
        {
            UNDAMPED: Run("tumbling", "ode5", 1e-2, 50.0),
            DAMPED: Run("tumbling, damped", "ode5", 1e-2, 50.0),
        },
        (
            Claim(
                UNDAMPED,
                "divergence horizon",
                "s",
                "erratic without dampers",
                below(50.0, "chaotic within the run"),
                m.horizon(UNDAMPED),
            ),
            Claim(
                UNDAMPED,
                "mean K, last 10 s / first 10 s",
                "1",
                "erratic without dampers",
                above(0.5, "moves on"),
                m.calmed(UNDAMPED),
            ),
            Claim(
                DAMPED,
                "mean K, last 10 s / first 10 s",
                "1",
                "calm with dampers",
                below(0.5, "calms down"),
                m.calmed(DAMPED),
            ),
        ),
    ),
    Experiment(
        "4.9",
        "Tumbling, ode5, h = 0.01 s; dampers of 0.001 N·m·s/rad",
        "testing functions",
        {
            UNDAMPED: Run("tumbling", "ode5", 1e-2, 50.0),
            DAMPED: Run("tumbling, damped", "ode5", 1e-2, 50.0),
        },
        (
            Claim(
                f"{UNDAMPED} / {DAMPED}",
                "ratio of max |ΔC|",
                "1",
                "much smaller with dampers",
                above(10.0, "a decade or more"),
                m.ratio(UNDAMPED, DAMPED),
            ),
        ),
    ),
    Experiment(
        "4.10",
        "Sign mistake, with and without dampers of 0.001 N·m·s/rad",
        "testing functions",
        {
            RIGHT: Run("by hand", "ode5", 1e-3),
            MISTAKE: Run("by hand, sign mistake", "ode5", 1e-3),
            MISTAKE_DAMPED: Run("by hand, sign mistake, damped", "ode5", 1e-3),
        },
        (
            Claim(
                f"{MISTAKE_DAMPED} / {RIGHT}",
                "ratio of max |ΔC|",
                "1",
                "dampers do not hide the mistake",
                above(1e6, "six decades or more"),
                m.ratio(MISTAKE_DAMPED, RIGHT),
            ),
            Claim(
                MISTAKE_DAMPED,
                "max Wang |ΔC|",
                "J",
                "dampers do not hide the mistake",
                above(1.0),
                m.largest_of(MISTAKE_DAMPED),
            ),
        ),
    ),
)
