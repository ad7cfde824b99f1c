"""Friction and contact by hand: blocks, discs, a ball and a box after Newton, integrated by SciPy."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from tests.oracles.common import Values, integrated

g = 9.81


def block_on_incline() -> Values:
    """States (s, v, heat); m = 2, μ = 0.5, 15°, width 5 mm/s."""
    slope, w = math.radians(15.0), 5e-3
    pull, hold = g * math.sin(slope), 0.5 * g * math.cos(slope)

    def rhs(t: float, y: Any) -> list[float]:
        rub = hold * math.tanh(y[1] / w)
        return [y[1], pull - rub, 2.0 * rub * y[1]]

    early, late, end = integrated(rhs, (0.0, 2.0, 0.0), (0.5, 0.9, 1.5))
    return {
        "s at 0.5 s": early[0],
        "heat at 0.5 s": early[2],
        "speed at 0.9 s": late[1],
        "creep at last, instead of rest": end[1],
        "heat missing from μ m g cos α s": 2.0 * hold * end[0] - end[2],
    }


def clutch() -> Values:
    """States (ω1, ω2, heat) of two discs, the torque on each written out."""
    driving, driven = 0.5, 0.3

    def rhs(t: float, y: Any) -> list[float]:
        slip = y[0] - y[1]
        torque = 12.0 * (1 - math.exp(-5.0 * t)) * math.tanh(slip / 0.5)
        return [-torque / driving, torque / driven, torque * slip]

    times = (0.2, 0.4, 0.5, 0.6, 1.0)
    states = integrated(rhs, (40.0, 0.0, 0.0), times)
    values = {f"slip at {t} s": y[1] - y[0] for t, y in zip(times, states, strict=True)}
    return values | {"speed at 1 s": states[-1][0], "heat of the clutch": states[-1][2]}


def stick_slip() -> Values:
    """x from the spring's end of rest this time; the period between passages of the middle."""
    k, belt, middle = 100.0, 0.1, 0.3 * g / 100.0

    def rhs(t: float, y: Any) -> list[float]:
        r = belt - y[1]
        rub = g * (0.3 + 0.1 * math.exp(-((r / 5e-3) ** 2))) * math.tanh(r / 2e-4)
        return [y[1], rub - k * y[0]]

    def passage(t: float, y: Any) -> float:
        return float(y[0] - middle)

    passage.direction = 1  # type: ignore[attr-defined]
    found = solve_ivp(
        rhs,
        (0.0, 1.5),
        (middle, belt),
        method="DOP853",
        rtol=1e-12,
        atol=1e-15,
        max_step=1e-3,
        events=passage,
        dense_output=True,
    )
    first, second = found.t_events[0][-2:]
    x, v = found.sol(np.linspace(first, second, 2000))
    slipping = belt - v > 6.2 * 5e-3
    squares = ((x - middle) ** 2 + v**2 / k)[slipping]
    return {
        "period": second - first,
        "spread of x² + (ẋ/ω)² along each slip, against its mean": float(
            np.ptp(squares) / squares.mean()
        ),
    }


def ball_on_compliant_floor() -> Values:
    """Flight and contact in turn, each integrated to where it ends."""
    k, values = 2e3, {}

    def flight(t: float, y: Any) -> list[float]:
        return [y[1], -g]

    def touching(t: float, y: Any) -> list[float]:
        return [y[1], -g - k * y[0]]

    def surface(t: float, y: Any) -> float:
        return float(y[0])

    def turning(t: float, y: Any) -> float:
        return float(y[1])

    surface.terminal = True  # type: ignore[attr-defined]
    t, y, down = 0.0, np.array([0.5, 0.0]), True
    while t < 2.0:
        surface.direction = -1 if down else 1  # type: ignore[attr-defined]
        found = solve_ivp(
            flight if down else touching,
            (t, 2.0),
            y,
            method="DOP853",
            rtol=1e-13,
            atol=1e-15,
            events=(surface, turning),
            dense_output=True,
        )
        for at in (0.3, 0.36, 0.7, 1.0, 2.0):
            if t <= at <= found.t[-1]:
                values[f"height at {at:g} s"] = float(found.sol(at)[0])
        if not down and "deepest overlap" not in values:
            values["deepest overlap"] = -float(found.y_events[1][0][0])
        t, y, down = found.t[-1], found.y[:, -1], not down
        y[0] = 0.0
    return values


def tumbling_box() -> Values:
    """Newton and Euler with quaternions, eight corners at once; state (x, q, v, ω), ω in the body."""
    size, k, d = np.array([0.3, 0.2, 0.1]), 5e4, 2.0
    I = (size @ size - size**2) / 12
    signs = np.array([[a, b, c] for a in (1, -1) for b in (1, -1) for c in (1, -1)])
    corners = signs * size / 2

    def turned(q: Any) -> Any:
        w, x, y, z = q / math.sqrt(q @ q)
        return np.array(
            [
                [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
            ]
        )

    def rhs(t: float, y: Any) -> Any:
        x, q, v, w = y[:3], y[3:7], y[7:10], y[10:]
        A = turned(q)
        # The contact is halfway between a corner and the plane below it.
        place = x + corners @ A.T
        depth = -place[:, 2]
        hit = depth > 0
        force, moment = np.array([0.0, 0.0, -g]), np.zeros(3)
        if hit.any():
            depth, arms = depth[hit], place[hit] - x
            arms[:, 2] += depth / 2
            velocity = v + np.cross(A @ w, arms)
            normal = k * depth * np.maximum(1 - d * velocity[:, 2], 0)
            slip = np.hypot(velocity[:, 0], velocity[:, 1])
            drag = 0.4 * normal * np.tanh(slip / 0.02) / np.maximum(slip, 1e-300)
            forces = np.column_stack([-drag[:, None] * velocity[:, :2], normal])
            force = force + forces.sum(axis=0)
            moment = A.T @ np.cross(arms, forces).sum(axis=0)
        a, b = q[0], q[1:]
        q_dot = 0.5 * np.concatenate([[-b @ w], a * w + np.cross(b, w)])
        w_dot = (moment - np.cross(w, I * w)) / I
        return np.concatenate([v, q_dot, force, w_dot])

    axis = np.array([1.0, 2.0, 0.5])
    quaternion = [math.cos(0.35), *(math.sin(0.35) * axis / np.linalg.norm(axis))]
    start = np.array([0, 0, 0.5, *quaternion, 1.0, 0, 0, 3.0, 6.0, 1.0])

    def energy(y: Any) -> float:
        depth = np.maximum(-(y[2] + (corners @ turned(y[3:7]).T)[:, 2]), 0)
        return float(kinetic(y) + g * y[2] + 0.5 * k * depth @ depth)

    def kinetic(y: Any) -> float:
        return float(0.5 * y[7:10] @ y[7:10] + 0.5 * I @ y[10:] ** 2)

    # Longer steps would be tried through the floor.
    found = solve_ivp(rhs, (0.0, 2.0), start, method="DOP853", rtol=1e-7, atol=1e-9, max_step=1e-3)
    end = found.y[:, -1]
    return {
        "height at 2 s": end[2],
        "kinetic energy at 2 s": kinetic(end),
        "energy lost until it lies still": energy(start) - energy(end),
    }


ORACLES: dict[str, tuple[Callable[[], Values], float]] = {
    "block-on-incline": (block_on_incline, 1e-11),
    "clutch": (clutch, 1e-11),
    "stick-slip": (stick_slip, 1e-9),
    "ball-on-compliant-floor": (ball_on_compliant_floor, 1e-11),
    "tumbling-box": (tumbling_box, 1e-7),  # the tolerance of its integration
}
