"""A problem of the library against its own reference numbers, each with a tolerance that follows."""

from __future__ import annotations

from dataclasses import dataclass

from deltac.problems import Problem, Reference
from deltac.simulation import simulate

MARGIN = 10.0
"""Halving the step takes (1 − 2⁻ᵖ) of the error away; where only rounding is left, both runs have it."""

ROUNDING = 1e-12
"""What many steps leave of machine precision, relative."""


@dataclass(frozen=True)
class Comparison:
    """A reference number and ours (its unit is the reference's).

    `error` is how far the run is from the one with half the step; `tolerance` adds up the accuracy
    of the reference, that error with a margin, and rounding.
    """

    reference: Reference
    value: float
    error: float
    tolerance: float

    @property
    def agrees(self) -> bool:
        """Whether the two differ by no more than the tolerance."""
        return abs(self.value - self.reference.value) <= self.tolerance


def compare(problem: Problem) -> tuple[Comparison, ...]:
    """Simulate a problem by its own solver and step, and compare with its references."""
    run, finer = (
        simulate(
            problem.mechanism, problem.state, problem.duration, problem.step / k, problem.solver
        )
        for k in (1, 2)
    )
    found = []
    for reference in problem.reference:
        value = reference.measure(run)
        error = abs(value - reference.measure(finer))
        rounding = ROUNDING * max(1.0, abs(reference.value))
        tolerance = reference.accuracy + MARGIN * error + rounding
        found.append(Comparison(reference, value, error, tolerance))
    return tuple(found)
