"""The thesis's driven triple pendulum: the first bar moves as specified, θ1 = A sin wt."""

from __future__ import annotations

from collections.abc import Sequence

from deltac.problems import triple_pendulum
from deltac.problems.problem import Problem


def problem(
    start: Sequence[float] = triple_pendulum.START,
    rates: Sequence[float] = triple_pendulum.REST,
    weights: Sequence[float] = triple_pendulum.WEIGHTS,
    damping: float | Sequence[float] = 0.0,
    mistake: bool = False,
) -> Problem:
    """`triple_pendulum.problem` with `drive="motion"`; the other options mean the same."""
    return triple_pendulum.problem(start, rates, weights, damping, "motion", mistake)
