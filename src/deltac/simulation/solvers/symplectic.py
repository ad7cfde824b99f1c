"""Semi-implicit (symplectic) Euler: speeds first, then coordinates with the new speeds."""

from __future__ import annotations

from typing import Any

from deltac.simulation.solvers.solver import Parts, Rate


def semi_implicit_euler_step(f: Rate, t: Any, x: Any, h: Any, parts: Parts) -> Any:
    """u₊ = u + h u̇(t, q, u), then q₊ = q + h q̇(t, q, u₊); integrals take P at the step's start.

    First order; symplectic for separable systems, which keeps energy errors bounded, not small.
    """
    rates = f(t, x)
    x = x + h * (parts.u * rates)
    return x + h * (parts.q * f(t, x) + parts.z * rates)
