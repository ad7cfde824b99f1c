"""Equations of motion as textbooks have them, for tests: right ones, each with its source.

A function of (t, q, u) each, with NumPy's functions only, for arrays (n,) and (n, B).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

import deltac as dc
from deltac.problems.triple_pendulum_equations import HandEquations

G = 9.81


@dataclass(frozen=True, eq=False)
class Case:
    """A mechanism and right equations of it, in `coordinates` (None: its own)."""

    mechanism: dc.Mechanism
    rhs: Callable[..., Any]
    coordinates: dc.CoordinateMap | None = None


def triple_pendulum() -> Case:
    """Gugaratshan's thesis, (3.1.17)-(3.1.19), dampers included."""
    p = dc.problems.load("triple-pendulum", damping=(0.01, 0.02, 0.03))
    assert p.equations is not None
    return Case(p.mechanism, p.equations.rhs, p.equations.coordinates)  # type: ignore[arg-type]


def driven_triple_pendulum() -> Case:
    """The same with the first bar's motion specified."""
    p = dc.problems.load("driven-triple-pendulum")
    assert p.equations is not None
    return Case(p.mechanism, p.equations.rhs, p.equations.coordinates)  # type: ignore[arg-type]


def relative_triple_pendulum() -> Case:
    """The same in the joints' relative angles."""
    p = dc.problems.load("triple-pendulum", damping=(0.01, 0.02, 0.03))
    hand = HandEquations.of(p.mechanism.parameters)

    def rhs(t: Any, q: Any, u: Any) -> Any:
        a = hand.free(t, np.cumsum(q, axis=0), np.cumsum(u, axis=0))
        return np.diff(a, axis=0, prepend=np.zeros_like(a[:1]))

    return Case(p.mechanism, rhs)


def free_box() -> Case:
    """Euler's equations in body components; the mass centre falls (Goldstein, section 5.6)."""
    p = dc.problems.load("torque-free-box")
    I1, I2, I3 = 10.0 / 12 * np.array([0.97, 0.82, 0.17])

    def rhs(t: Any, q: Any, u: Any) -> Any:
        w1, w2, w3 = u[3:]
        zero = 0.0 * w1
        return np.array(
            [zero, zero, zero - 9.8,
             (I2 - I3) / I1 * w2 * w3, (I3 - I1) / I2 * w3 * w1, (I1 - I2) / I3 * w1 * w2]
        )  # fmt: skip

    return Case(p.mechanism, rhs)


def lagrange_top() -> Case:
    """Lagrange's top in Euler's angles φ, θ, ψ (3-1-3; Goldstein, section 5.7), on a ball joint."""
    m, length, A, C = 2.0, 0.5, 0.7, 0.11  # A, C about the fixed point
    mechanism = dc.Mechanism(
        bodies=[dc.body("top", m, (A - m * length**2,) * 2 + (C,), (0, 0, length))],
        joints=[dc.joints.spherical("tip", "ground", "top")],
        gravity=(0, 0, -G),
    )
    c, s = "cos(q.theta/2)", "sin(q.theta/2)"
    plus, minus = "(q.phi+q.psi)/2", "(q.phi-q.psi)/2"
    quaternion = {
        "tip.qw": f"{c}*cos({plus})",
        "tip.qx": f"{s}*cos({minus})",
        "tip.qy": f"{s}*sin({minus})",
        "tip.qz": f"{c}*sin({plus})",
    }
    euler = dc.CoordinateMap(
        ("phi", "theta", "psi"),
        ("phi", "theta", "psi"),
        q=quaternion,
        u={
            "tip.wx": "u.phi*sin(q.theta)*sin(q.psi) + u.theta*cos(q.psi)",
            "tip.wy": "u.phi*sin(q.theta)*cos(q.psi) - u.theta*sin(q.psi)",
            "tip.wz": "u.phi*cos(q.theta) + u.psi",
        },
    )

    def rhs(t: Any, q: Any, u: Any) -> Any:
        _, theta, _ = q
        phi_, theta_, psi_ = u
        s, c = np.sin(theta), np.cos(theta)
        spin = psi_ + phi_ * c
        nutation = (A * phi_**2 * s * c - C * spin * phi_ * s + m * G * length * s) / A
        precession = (C * spin * theta_ - 2 * A * phi_ * theta_ * c) / (A * s)
        return np.array([precession, nutation, phi_ * theta_ * s - precession * c])

    return Case(mechanism, rhs, euler)


def spherical_pendulum() -> Case:
    """Angles from the downward vertical and about it (Landau and Lifshitz, section 14, problem 1).

    The mechanism has three slides and a rod: two coordinates satisfy its constraint by themselves.
    """
    angles = dc.CoordinateMap(
        ("theta", "phi"),
        q={"x": "l*sin(q.theta)*cos(q.phi)", "y": "l*sin(q.theta)*sin(q.phi)", "z": "-l*cos(q.theta)"},
    )  # fmt: skip

    def rhs(t: Any, q: Any, u: Any) -> Any:
        s, c = np.sin(q[0]), np.cos(q[0])
        return np.array([u[1] ** 2 * s * c - G * s, -2 * u[0] * u[1] * c / s])

    return Case(dc.problems.load("spherical-pendulum").mechanism, rhs, angles)


def four_bar() -> Case:
    """Two parallelograms of unit rods are one pendulum: I q̈ = −M g cos q (the problem's own note)."""
    mechanism = dc.problems.load("n-four-bar").mechanism
    laws = {
        n: "q.angle" if n.startswith("crank") else "-q.angle" for n in mechanism.coordinates.names
    }

    def rhs(t: Any, q: Any, u: Any) -> Any:
        return -(3 / 2 + 2) * G / (3 / 3 + 2) * np.cos(q)

    return Case(mechanism, rhs, dc.CoordinateMap(("angle",), q=laws))


def chaplygin_sleigh() -> Case:
    """Quasi-velocities v, ω (Bloch, Nonholonomic Mechanics and Control, section 1.7)."""
    p = dc.problems.load("chaplygin-sleigh")
    m, inertia, a = (p.mechanism.parameters[k] for k in ("m", "I", "a"))
    quasi = dc.CoordinateMap(
        speeds=("v", "w"),
        u={"ice.x": dc.laws.u("v") * _cos("ice.angle"), "ice.y": dc.laws.u("v") * _sin("ice.angle"),
           "ice.angle": dc.laws.u("w")},
    )  # fmt: skip

    def rhs(t: Any, q: Any, u: Any) -> Any:
        v, w = u
        return np.array([a * w**2, -m * a * v * w / (inertia + m * a**2)])

    return Case(p.mechanism, rhs, quasi)


def sleigh_in_joint_coordinates() -> Case:
    """The same with ẋ, ẏ as speeds: the accelerations must satisfy the blade's constraint."""
    case = chaplygin_sleigh()

    def rhs(t: Any, q: Any, u: Any) -> Any:
        c, s, w = np.cos(q[2]), np.sin(q[2]), u[2]
        v = u[0] * c + u[1] * s
        v_dot, w_dot = case.rhs(t, q, (v, w))
        return np.array([v_dot * c - v * s * w, v_dot * s + v * c * w, w_dot])

    return Case(case.mechanism, rhs)


def _cos(name: str) -> Any:
    import sympy

    return sympy.cos(dc.laws.q(name))


def _sin(name: str) -> Any:
    import sympy

    return sympy.sin(dc.laws.q(name))


CASES: dict[str, Callable[[], Case]] = {
    f.__name__: f
    for f in (
        triple_pendulum,
        driven_triple_pendulum,
        relative_triple_pendulum,
        free_box,
        lagrange_top,
        spherical_pendulum,
        four_bar,
        chaplygin_sleigh,
        sleigh_in_joint_coordinates,
    )
}
