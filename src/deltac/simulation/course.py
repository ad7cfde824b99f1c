"""What a run of fixed steps is, and what comes of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from deltac.arrays import Array

Progress = Callable[[float], None]
"""Told the fraction of a run that is done."""


@dataclass(frozen=True)
class Motion:
    """Samples of a run: times (T,), states x (T, n), motors' values (T, m), and where it stopped."""

    t: Array
    x: Array
    inputs: Array
    message: str = ""


@dataclass(frozen=True, eq=False)
class Course:
    """Fixed steps to be taken: `steps` of length h (s) from the state x0 at t0, every `every`-th kept.

    `p` are the values of the parameters; `progress` is told the fraction done.
    """

    p: Array
    x0: Array
    t0: float
    h: float
    steps: int
    every: int = 1
    progress: Progress | None = None
