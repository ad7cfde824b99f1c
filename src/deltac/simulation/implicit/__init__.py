"""Implicit fixed-step solvers: equations of motion unsolved, one step as equations, Newton's method."""

from __future__ import annotations

from deltac.simulation.implicit.stepper import DEFAULT_RADIUS, ImplicitStepper, check_radius

__all__ = ["DEFAULT_RADIUS", "ImplicitStepper", "check_radius"]
