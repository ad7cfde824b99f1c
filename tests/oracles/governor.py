"""The governor by Lagrange's equations written by hand, its two arms taken to move alike."""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import solve_ivp

from tests.oracles.common import Values

g, k, c, rest = 9.81, 8e5, 4e4, 0.5
bar, slider, ball, offset = 0.3, 3.0, 5.0, 0.05
along, across = bar * 2 * 0.01**2 / 12, bar * (1 + 0.01**2) / 12
still = along + slider * 2 * 0.1**2 / 12  # shaft and slider about the axis
swing = 2 * (bar / 4 + across + ball)  # both arms about their hinges


def moment(a: float) -> tuple[float, float]:
    """Moment of inertia about the axis at the arms' angle a below the horizontal, and its slope."""
    C, S = math.cos(a), math.sin(a)
    half, whole = offset + C / 2, offset + C
    J = still + 2 * (bar * half**2 + along * S**2 + across * C**2 + ball * whole**2)
    slope = -bar * half * S + 2 * (along - across) * S * C - 2 * ball * whole * S
    return J, 2 * slope


def coupler(s: float, a: float) -> tuple[float, float, float]:
    """Length of a coupler, and its slopes along the slider's height s and the angle a."""
    x, z = math.cos(a) / 2, 1 - math.sin(a) / 2 - s
    d = math.hypot(x, z)
    return d, -z / d, (-x * math.sin(a) - z * math.cos(a)) / (2 * d)


def stiff_governor() -> Values:
    a0 = math.pi / 6
    L = moment(a0)[0] * 2 * math.pi

    def rhs(t: float, y: np.ndarray) -> list[float]:
        s, a, s_dot, a_dot = y
        J, slope = moment(a)
        d, d_s, d_a = coupler(s, a)
        tension = k * (d - rest) + c * (d_s * s_dot + d_a * a_dot)
        pull = 2 * (bar / 2 + ball) * g * math.cos(a)
        spin = L / J
        return [
            s_dot,
            a_dot,
            -g - 2 * tension * d_s / slider,
            (0.5 * slope * spin**2 + pull - 2 * tension * d_a) / swing,
        ]

    values: Values = {}
    times = (1.0, 5.0, 10.0)
    found = solve_ivp(rhs, (0, 10), [0.5, a0, 0, 0], "Radau", times, rtol=1e-11, atol=1e-12)
    for t, (s, a, s_dot, a_dot) in zip(times, found.y.T, strict=True):
        J, _ = moment(a)
        values |= {
            f"slider at {t:g} s": s,
            f"arms at {t:g} s": a,
            f"other arm at {t:g} s": a,
            f"rate of the shaft at {t:g} s": L / J,
        }
        kinetic = (L**2 / J + swing * a_dot**2 + slider * s_dot**2) / 2
        weight = g * (bar / 2 + slider * s + 2 * (bar * (1 - math.sin(a) / 2)))
        weight += g * 2 * ball * (1 - math.sin(a))
        values[f"energy at {t:g} s"] = kinetic + weight + k * (coupler(s, a)[0] - rest) ** 2
    return values
