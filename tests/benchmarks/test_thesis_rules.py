"""The rules alone: each accepts and refuses by hand-made numbers."""

from __future__ import annotations

import math

import pytest
from thesis.experiments import (
    EVERYTHING,
    POWER_OF_TEN,
    REPORTED,
    Reported,
    agrees,
)

DIGITS = "the thesis's number to the digits given (± {})"

CASES: list[tuple[str, Reported, list[float], list[float]]] = [
    (POWER_OF_TEN, 1e-7, [3.2e-8, 1e-7, 3.1e-7], [3.1e-8, 3.2e-7, -1e-7, 0.0]),
    (DIGITS.format("0.05"), 7.7, [7.66, 7.74], [7.6, 3.83, 15.3]),
    (DIGITS.format("0.0005"), 2.721, [2.721, 2.7206, 2.7214], [2.722, 2.72]),
    ("falls with h: above 1", "more than one", [1.1, math.inf], [1.0, -2.0]),
    ("below 10", None, [9.9, 0.0], [10.0, math.inf]),
    ("within ± 15", None, [-15.0, 0.0, 15.0], [15.1, -15.1]),
    ("not seen: within ± 0", None, [0.0], [1e-300, -1e-300]),
]


@pytest.mark.parametrize(
    ("rule", "thesis", "accepted", "refused"), CASES, ids=[case[0] for case in CASES]
)
def test_a_rule_accepts_and_refuses(
    rule: str, thesis: Reported, accepted: list[float], refused: list[float]
) -> None:
    for value in accepted:
        assert agrees(rule, value, thesis) is True, value
    for value in [*refused, math.nan]:
        assert agrees(rule, value, thesis) is False, value


def test_what_is_only_reported_neither_agrees_nor_disagrees() -> None:
    assert agrees(REPORTED, 1.0, 2.0) is None


def test_every_rule_of_the_table_is_one() -> None:
    for claim in (claim for experiment in EVERYTHING for claim in experiment.claims):
        assert agrees(claim.rule, math.nan, claim.thesis) in (False, None)
    with pytest.raises(ValueError, match="unknown rule"):
        agrees("about 3", 3.0, None)
