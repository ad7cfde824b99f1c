"""Rules: a statement of the thesis in words, together with the code that checks it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

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
