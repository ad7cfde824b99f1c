"""Pendulums: Lagrange's equations by SymPy in other coordinates, and elliptic functions."""

from __future__ import annotations

import math
from typing import Any

import mpmath
import numpy as np
import sympy

from tests.oracles.common import Values, integrated, lagrange

g = sympy.Rational("9.81")
t = sympy.Symbol("t")


def double_pendulum() -> Values:
    """Absolute angles, from the particles' positions."""
    a, b = (sympy.Function(name)(t) for name in "ab")
    first = sympy.Matrix([sympy.sin(a), -sympy.cos(a)])
    second = first + sympy.Matrix([sympy.sin(b), -sympy.cos(b)])
    v1, v2 = first.diff(t), second.diff(t)
    rhs = lagrange((v1.dot(v1) + v2.dot(v2)) / 2 - g * (first[1] + second[1]), t, (a, b))
    values: Values = {"energy at 5 s": -9.81 * (2 * 0.5 + math.sqrt(0.5))}
    states = integrated(rhs, [math.pi / 3, -math.pi / 4, 0.0, 0.0], (1.0, 5.0))
    for at, y in zip((1, 5), states, strict=True):
        values |= {f"θ{k + 1} at {at} s": float(y[k]) for k in range(2)}
    return values


def elastic_pendulum() -> Values:
    """Polar coordinates: length and angle of the spring."""
    r, a = (sympy.Function(name)(t) for name in "ra")
    stretch = r - sympy.Rational("0.75")
    kinetic = (r.diff(t) ** 2 + r**2 * a.diff(t) ** 2) / 2
    potential = -g * r * sympy.cos(a) + sympy.Rational("39.24") * stretch**2 / 2
    rhs = lagrange(kinetic - potential, t, (r, a))
    start = [math.hypot(0.1, 1.2), math.atan2(0.1, 1.2), 0.0, 0.0]
    stretched = start[0] - 0.75
    values: Values = {"energy at 10 s": -9.81 * 1.2 + 19.62 * stretched**2}
    for at, y in zip((1, 10), integrated(rhs, start, (1.0, 10.0)), strict=True):
        values[f"x at {at} s"] = float(y[0] * math.sin(y[1]))
        values[f"y at {at} s"] = float(-y[0] * math.cos(y[1]))
    return values


def spherical_pendulum() -> Values:
    """ż² = 2 (E − g z)(1 − z²) − L² has roots z1 < z2 < z3; from one of them z goes as sn²."""
    with mpmath.workdps(30):
        G, start = mpmath.mpf("9.81"), mpmath.mpf(-1) / 2
        L2, E = mpmath.mpf(3), 2 - G / 2  # (2 sin 60°)², ½ 2² − g cos 60°
        cubic = [2 * G, -2 * E, -2 * G, 2 * E - L2]
        z1, z2, z3 = sorted(mpmath.re(root) for root in mpmath.polyroots(cubic, extraprec=60))
        m, rate = (z2 - z1) / (z3 - z1), mpmath.sqrt(G * (z3 - z1) / 2)
        assert min(abs(start - z1), abs(start - z2)) < 1e-25
        ahead = mpmath.mpf(0) if abs(start - z1) < 1e-25 else mpmath.ellipk(m)

        def height(at: Any) -> Any:
            return z1 + (z2 - z1) * mpmath.ellipfun("sn", rate * at + ahead, m=m) ** 2

        values: Values = {"energy at 10 s": float(E)}
        for at in (1, 10):
            pieces = mpmath.linspace(0, at, 8 * at + 1)
            turned = mpmath.quad(lambda s: mpmath.sqrt(L2) / (1 - height(s) ** 2), pieces)
            z = height(mpmath.mpf(at))
            away = mpmath.sqrt(1 - z**2)
            values[f"x at {at} s"] = float(away * mpmath.cos(turned))
            values[f"y at {at} s"] = float(away * mpmath.sin(turned))
            values[f"z at {at} s"] = float(z)
        return values


def chaotic_double_body() -> Values:
    """Lagrange's equations from rotation matrices: R = Rx(swing) Rz(turn), ω from Rᵀ Ṙ."""
    a, b = (sympy.Function(name)(t) for name in "ab")
    swing = sympy.Matrix(sympy.rot_axis1(-a))
    both = swing * sympy.Matrix(sympy.rot_axis3(-b))
    L = sympy.Integer(0)
    for R, mass, down, inertia in (
        (swing, "0.01", "0.075", ("5e-6", "5e-6", "0")),
        (both, "0.1", "0.2", ("2.5e-4", "0.5e-4", "2e-4")),
    ):
        W = R.T * R.diff(t)
        w = (W[2, 1], W[0, 2], W[1, 0])
        centre = R * sympy.Matrix([0, 0, -sympy.Rational(down)])
        v = centre.diff(t)
        m = sympy.Rational(mass)
        L += m * v.dot(v) / 2 - m * g * centre[2]
        L += sum(sympy.Rational(I) * c**2 for I, c in zip(inertia, w, strict=True)) / 2
    rhs = lagrange(sympy.trigsimp(L), t, (a, b))
    values: Values = {"energy at 4 s": 0.0}
    start = [math.pi / 2, math.radians(0.5), 0.0, 0.0]
    for at, y in zip((1, 4), integrated(rhs, start, (1.0, 4.0)), strict=True):
        values |= {f"swing at {at} s": float(y[0]), f"turn at {at} s": float(y[1])}
    return values


def chaplygin_sleigh() -> Values:
    """The closed form, its path by quadrature."""
    with mpmath.workdps(30):
        root = mpmath.sqrt(mpmath.mpf(5) / 4)
        k = 1 / root  # a ω0 √(m/(m a² + I)) with a ω0 = 1

        def heading(s: object) -> object:
            return 2 * mpmath.atan(mpmath.sinh(k * s)) / k

        values: Values = {"energy at 5 s": 2.5}
        for at in (1, 5):
            values[f"speed of the blade at {at} s"] = float(2 * root * mpmath.tanh(k * at))
            values[f"ω at {at} s"] = float(2 * mpmath.sech(k * at))
            values[f"angle at {at} s"] = float(heading(at))  # type: ignore[arg-type]
        for axis, part in (("x", mpmath.cos), ("y", mpmath.sin)):
            path = mpmath.quad(
                lambda s, f=part: 2 * root * mpmath.tanh(k * s) * f(heading(s)), [0, 1]
            )
            values[f"{axis} at 1 s"] = float(path)
        return values


def knife_edge() -> Values:
    """v̇ = g sin 30° cos 2t along the blade, whose direction turns evenly."""

    def rhs(at: float, y: np.ndarray) -> list[float]:
        c, s = math.cos(2 * at), math.sin(2 * at)
        return [4.905 * c, y[0] * c, y[0] * s]

    values: Values = {"energy at 10 s": 0.5 * 0.1 * 4}
    for at, y in zip((1, 10), integrated(rhs, [0.0, 0.0, 0.0], (1.0, 10.0)), strict=True):
        values[f"speed along the blade at {at} s"] = float(y[0])
        values |= {f"x at {at} s": float(y[1]), f"y at {at} s": float(y[2])}
    return values
