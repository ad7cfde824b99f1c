"""Implicit fixed-step solvers: equations of motion unsolved, one step as equations, Newton's method."""

from __future__ import annotations

from deltac.simulation.stepping.implicit.stepper import (
    DEFAULT_RADIUS,
    ImplicitMethod,
    ImplicitSteps,
    check_radius,
)

__all__ = ["DEFAULT_RADIUS", "ImplicitMethod", "ImplicitSteps", "check_radius"]
