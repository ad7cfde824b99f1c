"""Implicit fixed-step solvers: equations of motion unsolved, one step as equations, Newton's method."""
