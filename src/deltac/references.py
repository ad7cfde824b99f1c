"""A problem of the library against its own reference numbers, each with a tolerance that follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from deltac.arrays import ROUNDED
from deltac.problems import Problem, Reference
from deltac.simulation.solvers import solver_options
from deltac.trajectories import Trajectory
from deltac.verbs import simulate

MARGIN = 10.0
"""Halving the step removes the share 1 − 2⁻ᵖ of the error, so the difference underestimates it by little."""


@dataclass(frozen=True)
class ReferenceCheck:
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


def solved(
    problem: Problem,
    *,
    finer: bool = False,
    testing: Sequence[str] = ("wang", "liu-huston"),
) -> Trajectory:
    """A run of a problem by its own solver and step; or by half the step and a hundredth of the tolerance."""
    tolerance = problem.tolerance
    if finer and tolerance is not None:
        tolerance = max(0.01 * tolerance, 1e-13)
    return simulate(
        problem.mechanism,
        problem.state,
        problem.duration,
        problem.step / 2 if finer else problem.step,
        solver_options(problem.solver, tolerance),
        testing,
    )


def compare(problem: Problem) -> tuple[ReferenceCheck, ...]:
    """Simulate a problem by its own solver and step, and compare with its references."""
    run, finer = solved(problem), solved(problem, finer=True)
    comparisons = []
    for reference in problem.reference:
        value = reference.measure(run)
        error = abs(value - reference.measure(finer))
        rounding = ROUNDED * max(1.0, abs(reference.value))
        tolerance = reference.accuracy + MARGIN * error + rounding
        comparisons.append(ReferenceCheck(reference, value, error, tolerance))
    return tuple(comparisons)
