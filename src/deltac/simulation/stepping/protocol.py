"""What a solver is to the loop that runs it: it takes steps, and can take part of one again.

A stepper belongs to one run and owns its buffers, factors and memory. What it shares with other runs
(compiled kernels, traced equations) holds no numbers.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from deltac.arrays import Array

CHUNK = 64
"""Samples taken in one call of a solver that chooses its steps."""


class StepFailed(Exception):
    """A step has no end; the text says why and what to do, and ends up in the run's message."""


@dataclass(frozen=True)
class StepGrid:
    """The times start + k step, k = 0 … count, of which the last is `end`; every `every`-th is a sample."""

    start: float
    step: float
    count: int
    end: float
    every: int = 1

    def time(self, k: int) -> float:
        """The k-th time, s."""
        return self.end if k >= self.count else self.start + k * self.step

    def times(self, first: int, count: int) -> Array:
        """So many times, from the first-th on."""
        times: Array = self.start + self.step * np.arange(first, first + count, dtype=np.float64)
        if first + count > self.count:
            times[self.count - first :] = self.end
        return times

    def sample(self, after: int) -> int:
        """The number of the first sample after the time of that number."""
        return min((after // self.every + 1) * self.every, self.count)


@dataclass(frozen=True)
class Motion:
    """Samples of a run: times (T,), states x (T, n), motors' values (T, m), and where it stopped."""

    t: Array
    x: Array
    inputs: Array
    message: str = ""


@dataclass(frozen=True, eq=False)
class Step:
    """A step from (t0, x0) to (t1, x1), as the solver leaves it.

    `exact` gives states within it by the solver itself, in a step to that time; `near`, where steps are of
    the solver's own choice, by its dense output.
    """

    t0: float
    x0: Array
    t1: float
    x1: Array
    exact: Callable[[float], Array]
    near: Callable[[float], Array] | None = None


@dataclass(frozen=True)
class FinishedStates:
    """States (m, n) at the next m times of the grid, finished.

    `singular` says that the step after them met dependent constraints and is not to be trusted.
    """

    states: Array
    singular: bool = False


class Stepper(ABC):
    """What takes the steps of one run.

    The loop finishes every state that it is given: unit quaternions, projection, correction of the energy.
    Only `ahead` returns states that are finished already.
    """

    on_grid: bool = True
    """Whether its steps end at the times of the grid; else it chooses them, and has dense output."""

    _p: Array
    """The parameters, sides of laws that switch included."""

    @abstractmethod
    def attempt(self, t: float, x: Array, until: float) -> Step:
        """The next step, to `until`, or off the grid to anywhere before it; StepFailed if there is none."""

    def accept(self, t: float, x: Array) -> None:  # noqa: B027
        """Go on from the end of the last attempt, finished to x; or from one of the states ahead."""

    def restart(self, t: float, x: Array, p: Array) -> None:
        """Go on from another state, forgetting what was before, with other parameters."""
        self._p = p

    def ahead(self, grid: StepGrid, k: int, x: Array, most: int) -> FinishedStates | None:
        """As many of the next steps as are cheaply taken at once; None where steps go one by one."""
        return None
