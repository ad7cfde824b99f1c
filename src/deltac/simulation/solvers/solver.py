"""What a solver is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

Rate: TypeAlias = Callable[[Any, Any], Any]
"""ẋ = f(t, x): symbols or arrays."""


@dataclass(frozen=True)
class Parts:
    """Which entries of x are coordinates, speeds and integrals: three masks of zeros and ones."""

    q: Any
    u: Any
    z: Any


StepFunction: TypeAlias = Callable[[Rate, Any, Any, Any, Parts], Any]
"""(f, t, x, h, parts) -> x one step later; the same lines serve symbols and arrays."""


@dataclass(frozen=True)
class Solver:
    """A solver: its Simulink name, its family ("fixed", "implicit", "adaptive", "taylor"), its order.

    `step` advances the explicit solvers of family "fixed", at the cost of `stages` evaluations of ẋ; the
    implicit ones are in `simulation.implicit`. `order` is None where it varies along the run.
    """

    name: str
    family: str
    order: int | None
    step: StepFunction | None
    stages: int
    aliases: tuple[str, ...]

    @property
    def takes_steps(self) -> bool:
        """Whether its steps are all of one length, which the user chooses."""
        return self.family in ("fixed", "implicit")
