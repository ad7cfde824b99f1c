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
    """A solver: its Simulink name, its family ("fixed", "adaptive", "taylor"), its order.

    `step` advances fixed-step solvers, at the cost of `stages` evaluations of ẋ; `order` is None where
    it varies along the run.
    """

    name: str
    family: str
    order: int | None
    step: StepFunction | None
    stages: int
    aliases: tuple[str, ...]
