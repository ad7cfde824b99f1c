"""Solvers with options of their own: `simulate(..., solver=deltac.solvers.GeneralizedAlpha(0.5))`.

A solver without options, or with its default ones, goes by its name: `solver="ode5"`. Where the name is a
variable, `by_name(name, tolerance)` finds the object.
"""

from __future__ import annotations

from deltac.simulation.solvers import (
    FixedStep,
    GeneralizedAlpha,
    Scipy,
    Sundials,
    Taylor,
    solver_names,
)
from deltac.simulation.solvers import solver_options as by_name

__all__ = [
    "FixedStep",
    "GeneralizedAlpha",
    "Scipy",
    "Sundials",
    "Taylor",
    "by_name",
    "solver_names",
]
