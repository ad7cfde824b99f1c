"""What a contest knows of the program it runs beside, and of the run that both are to make."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

import deltac as dc

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Rival:
    """A program with one of its methods, set up and ready to run.

    name         the program and its method
    run          makes the whole run, keeping the state after every step; hands back the joint angles
                 (steps, 3), rad
    steps        of a run
    order        of the method
    evaluations  of the accelerations in a step
    note         how it runs and what it keeps, in a few words
    target       how many times faster we want to be, where that is asked for
    """

    name: str
    run: Callable[[], Array]
    steps: int
    order: int
    evaluations: int
    note: str
    target: float | None = None


@dataclass(frozen=True)
class Absent:
    """A program that is not installed, and what to do about it."""

    name: str
    why: str


@dataclass(frozen=True)
class Pendulum:
    """A run of the triple pendulum: three slender bars on pins, y upwards, angles relative.

    duration and step are in s; all other numbers are those of the problem's mechanism.
    """

    problem: dc.problems.Problem
    duration: float
    step: float

    def lasting(self, most: float) -> Pendulum:
        """The same run, stopped after `most` seconds: for what would take too long."""
        return replace(self, duration=min(self.duration, most))

    @property
    def steps(self) -> int:
        """How many."""
        return round(self.duration / self.step)

    @property
    def masses(self) -> tuple[float, ...]:
        """Of the three bars (kg)."""
        return self._parameters("m")

    @property
    def lengths(self) -> tuple[float, ...]:
        """Of the three bars (m); the centre of mass is half-way down."""
        return self._parameters("l")

    @property
    def inertias(self) -> tuple[float, ...]:
        """Of the three bars about their centres, across the bar (kg·m²)."""
        return tuple(m * l**2 / 12 for m, l in zip(self.masses, self.lengths))

    @property
    def offsets(self) -> tuple[float, ...]:
        """How far each pin is below the one above (m)."""
        return (0.0, *self.lengths[:-1])

    @property
    def gravity(self) -> float:
        """Downwards (m/s²)."""
        return float(self.problem.mechanism.parameters["g"])

    @property
    def q(self) -> Array:
        """Angles at the start (3,), rad."""
        return self.problem.state.q

    @property
    def u(self) -> Array:
        """Rates at the start (3,), rad/s."""
        return self.problem.state.u

    def _parameters(self, letter: str) -> tuple[float, ...]:
        values = self.problem.mechanism.parameters
        return tuple(float(values[f"{letter}{n}"]) for n in (1, 2, 3))


ALONG = 1e-9
"""Moment of inertia about a bar's own axis (kg·m²): it plays no part, but no program takes a zero."""
