"""The rules alone: each accepts and refuses by hand-made numbers, and says in words what it does."""

from __future__ import annotations

import math

import pytest

from deltac.studies.thesis.experiments import (
    REPORTED,
    Reported,
    Rule,
    above,
    below,
    power_of_ten,
    rounded,
    within,
)

CASES: list[tuple[Rule, Reported, list[float], list[float]]] = [
    (power_of_ten(), 1e-7, [3.2e-8, 1e-7, 3.1e-7], [3.1e-8, 3.2e-7, -1e-7, 0.0]),
    (rounded(0.05), 7.7, [7.66, 7.74], [7.6, 3.83, 15.3]),
    (rounded(5e-4), 2.721, [2.721, 2.7206, 2.7214], [2.722, 2.72]),
    (above(1.0), "more than one", [1.1, math.inf], [1.0, -2.0]),
    (below(10.0), None, [9.9, 0.0], [10.0, math.inf]),
    (within(15.0), None, [-15.0, 0.0, 15.0], [15.1, -15.1]),
    (within(0.0), None, [0.0], [1e-300, -1e-300]),
]


@pytest.mark.parametrize(
    ("rule", "thesis", "accepted", "refused"), CASES, ids=[case[0].words for case in CASES]
)
def test_a_rule_accepts_and_refuses(
    rule: Rule, thesis: Reported, accepted: list[float], refused: list[float]
) -> None:
    for value in accepted:
        assert rule.agrees(value, thesis) is True, value
    for value in [*refused, math.nan]:
        assert rule.agrees(value, thesis) is False, value


def test_words_state_the_bound() -> None:
    assert above(1.0, "falls with h").words == "falls with h: above 1"
    assert below(10.0).words == "below 10"


def test_what_is_only_reported_neither_agrees_nor_disagrees() -> None:
    assert REPORTED.words == "reported"
    assert REPORTED.agrees(1.0, 2.0) is None
