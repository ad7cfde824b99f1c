"""Rolling by Newton and Euler: a body, its contact force, and no slip, in world components."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mpmath
import numpy as np

from tests.oracles.common import Values, integrated

UP = np.array([0.0, 0.0, 1.0])
Field = Callable[[float, Any, Any], tuple[Any, Any]]


@dataclass(frozen=True)
class Roller:
    """A disc or a ball (`thin` or not) with an axis of symmetry: moments `across`, `along` (kg·m²).

    `surface` gives the velocity of the ground at a point, and its rate as the contact moves.
    """

    mass: float
    across: float
    along: float
    radius: float
    thin: bool
    surface: Field

    def contact(self, axis: Any, w: Any) -> tuple[Any, Any]:
        """From the centre to the contact point, and the rate of that vector."""
        if not self.thin:
            return -self.radius * UP, np.zeros(3)
        turn = np.cross(w, axis)
        lean, lean_rate = UP @ axis, UP @ turn
        flat, flat_rate = UP - lean * axis, -lean_rate * axis - lean * turn
        size = math.sqrt(1 - lean**2)
        size_rate = -lean * lean_rate / size
        return -self.radius * flat / size, -self.radius * (
            flat_rate / size - flat * size_rate / size**2
        )

    def solved(self, t: float, y: Any) -> tuple[Any, Any, Any]:
        """v̇, ω̇ and the contact force, of y = (x, axis, v, ω): nine equations for nine unknowns."""
        x, axis, v, w = y[:3], y[3:6], y[6:9], y[9:12]
        I = self.across * np.eye(3) + (self.along - self.across) * np.outer(axis, axis)
        turn = np.cross(w, axis)
        L_rate = (self.along - self.across) * (axis * (w @ turn) + turn * (w @ axis))  # İ ω
        arm, arm_rate = self.contact(axis, w)
        _, surface_rate = self.surface(t, x + arm, v + arm_rate)

        def cross(vector: Any) -> Any:
            a, b, c = vector
            return np.array([[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]])

        A, right = np.zeros((9, 9)), np.zeros(9)
        A[:3, :3], A[:3, 6:] = self.mass * np.eye(3), -np.eye(3)
        right[:3] = -9.81 * self.mass * UP
        A[3:6, 3:6], A[3:6, 6:] = I, -cross(arm)
        right[3:6] = -L_rate
        A[6:, :3], A[6:, 3:6] = np.eye(3), -cross(arm)
        right[6:] = surface_rate - np.cross(w, arm_rate)
        found = np.linalg.solve(A, right)
        return found[:3], found[3:6], found[6:]

    def run(self, start: Any, times: Any) -> Any:
        """States (x, axis, v, ω, work of the contact force) at times."""

        def rhs(t: float, y: Any) -> Any:
            a, alpha, force = self.solved(t, y)
            arm, arm_rate = self.contact(y[3:6], y[9:12])
            surface, _ = self.surface(t, y[:3] + arm, y[6:9] + arm_rate)
            turn = np.cross(y[9:12], y[3:6])
            return np.concatenate([y[6:9], turn, a, alpha, [force @ surface]])

        return integrated(rhs, [*start, 0.0], times)

    def kinetic(self, y: Any) -> float:
        """½mv² + ½ω·Iω."""
        v, w = y[6:9], y[9:12]
        spin = w @ y[3:6]
        turning = self.across * (w @ w) + (self.along - self.across) * spin**2
        return float(0.5 * self.mass * (v @ v) + 0.5 * turning)


def resting(t: float, x: Any, v: Any) -> tuple[Any, Any]:
    return np.zeros(3), np.zeros(3)


def shaken(t: float, x: Any, v: Any) -> tuple[Any, Any]:
    """The plane at 0.1 sin 5t along x."""
    return 0.5 * math.cos(5 * t) * np.eye(3)[0], -2.5 * math.sin(5 * t) * np.eye(3)[0]


def table(rising: bool) -> Field:
    """A plane that turns at 7 rad/s, and goes up and down by 0.1 (1 − cos 3t)."""

    def surface(t: float, x: Any, v: Any) -> tuple[Any, Any]:
        lift = (0.3 * math.sin(3 * t), 0.9 * math.cos(3 * t)) if rising else (0.0, 0.0)
        return np.cross(7 * UP, x) + lift[0] * UP, np.cross(7 * UP, v) + lift[1] * UP

    return surface


def rolling_disc() -> Values:
    """The steady circle: the published rates, and the whole motion by Newton and Euler from there."""
    m, r, R, tilt = 0.3048, 0.05, 0.5, math.radians(5)
    precession, spin = -1.07364981632612, 10.7364981632612
    disc = Roller(m, m * r**2 / 4, m * r**2 / 2, r, True, resting)
    out = R - r * math.sin(tilt)
    axis = np.array([0.0, -math.cos(tilt), math.sin(tilt)])
    w = precession * UP + spin * axis
    start = [0.0, -out, r * math.cos(tilt), *axis, precession * out, 0.0, 0.0, *w]
    energy = disc.kinetic(np.array(start)) + m * 9.81 * r * math.cos(tilt)
    values: Values = {"energy at 8 s": energy, "period": 5.852173782956319}
    for t, y in zip((1, 8), disc.run(start, (1.0, 8.0)), strict=True):
        values |= {f"centre {c} at {t} s": float(y[k]) for k, c in enumerate("xyz")}
        turn = np.cross(y[9:12], y[3:6])
        rate = float((y[3] * turn[1] - y[4] * turn[0]) / (y[3] ** 2 + y[4] ** 2))
        values[f"precession α̇ at {t} s"] = rate
        values[f"spin γ̇ at {t} s"] = float(y[9:12] @ y[3:6]) - rate * float(y[5])
    return values


def disc_on_moving_plane() -> Values:
    m, r, lean = 1.0, 0.2, 0.2
    disc = Roller(m, m * r**2 / 4, m * r**2 / 2, r, True, shaken)
    axis = [0.0, math.cos(lean), math.sin(lean)]
    start = [0.0, 0.0, r * math.cos(lean), *axis, 0.5 + 10 * r, 0.0, 0.0, *(10 * np.array(axis))]
    values: Values = {
        "energy at 0 s": disc.kinetic(np.array(start)) + m * 9.81 * r * math.cos(lean)
    }
    for t, y in zip((1, 3), disc.run(start, (1.0, 3.0)), strict=True):
        values |= {f"{c} at {t} s": float(y[k]) for k, c in enumerate("xyz")}
        values[f"work of the plane at {t} s"] = float(y[12])
        gained = disc.kinetic(y) + m * 9.81 * y[2] - values["energy at 0 s"]
        assert abs(gained - y[12]) < 1e-10
    return values


def _ball(rising: bool) -> Values:
    m, r = 0.2, 0.1
    ball = Roller(m, 0.4 * m * r**2, 0.4 * m * r**2, r, False, table(rising))
    slip = np.array([0.1, 0.2 - 7 * 0.3, 0.0])
    start = [0.3, 0.0, r, *np.eye(3)[2], 0.1, 0.2, 0.0, *(np.cross(UP, slip) / r)]
    values: Values = {}
    for t, y in zip((1, 5), ball.run(start, (1.0, 5.0)), strict=True):
        values |= {f"{c} at {t} s": float(y[k]) for k, c in enumerate("xyz")}
        values[f"K of the ball at {t} s"] = ball.kinetic(y)
        values[f"work of the table at {t} s"] = float(y[12])
    return values


def ball_on_table() -> Values:
    return _ball(rising=False)


def ball_on_rising_table() -> Values:
    return _ball(rising=True)


def bicycle_matrices() -> tuple[Any, Any, Any, Any]:
    """M, C1, K0, K2 from the parameters: Meijaard et al. 2007, appendix A."""
    w, c, tilt = 1.02, 0.08, math.pi / 10
    rR, mR, (IRxx, IRyy) = 0.3, 2.0, (0.0603, 0.12)
    xB, zB, mB, (IBxx, IBxz, IBzz) = 0.3, -0.9, 85.0, (9.2, 2.4, 2.8)
    xH, zH, mH, (IHxx, IHxz, IHzz) = 0.9, -0.7, 4.0, (0.05892, -0.00756, 0.00708)
    rF, mF, (IFxx, IFyy) = 0.35, 3.0, (0.1405, 0.28)
    cosine, sine = math.cos(tilt), math.sin(tilt)
    mT = mR + mB + mH + mF
    xT = (xB * mB + xH * mH + w * mF) / mT
    zT = (-rR * mR + zB * mB + zH * mH - rF * mF) / mT
    ITxx = IRxx + IBxx + IHxx + IFxx + mR * rR**2 + mB * zB**2 + mH * zH**2 + mF * rF**2
    ITxz = IBxz + IHxz - mB * xB * zB - mH * xH * zH + mF * w * rF
    ITzz = IRxx + IBzz + IHzz + IFxx + mB * xB**2 + mH * xH**2 + mF * w**2
    mA = mH + mF
    xA, zA = (xH * mH + w * mF) / mA, (zH * mH - rF * mF) / mA
    IAxx = IHxx + IFxx + mH * (zH - zA) ** 2 + mF * (rF + zA) ** 2
    IAxz = IHxz - mH * (xH - xA) * (zH - zA) + mF * (w - xA) * (rF + zA)
    IAzz = IHzz + IFxx + mH * (xH - xA) ** 2 + mF * (w - xA) ** 2
    uA = (xA - w - c) * cosine - zA * sine
    IAll = mA * uA**2 + IAxx * sine**2 + 2 * IAxz * sine * cosine + IAzz * cosine**2
    IAlx = -mA * uA * zA + IAxx * sine + IAxz * cosine
    IAlz = mA * uA * xA + IAxz * sine + IAzz * cosine
    mu = c / w * cosine
    SF = IFyy / rF
    ST = IRyy / rR + SF
    SA = mA * uA + mu * mT * xT
    M12 = IAlx + mu * ITxz
    M = np.array([[ITxx, M12], [M12, IAll + 2 * mu * IAlz + mu**2 * ITzz]])
    K0 = np.array([[mT * zT, -SA], [-SA, -SA * sine]])
    K2 = np.array([[0.0, (ST - mT * zT) / w * cosine], [0.0, (SA + SF * sine) / w * cosine]])
    C12 = mu * ST + SF * cosine + ITxz / w * cosine - mu * mT * zT
    C22 = IAlz / w * cosine + mu * (SA + ITzz / w * cosine)
    C1 = np.array([[0.0, C12], [-(mu * ST + SF * cosine), C22]])
    return M, C1, K0, K2


def bicycle() -> Values:
    """Exponents of the linear equations at 5 m/s, and their motion from a unit lean rate."""
    M, C1, K0, K2 = bicycle_matrices()
    A = np.zeros((4, 4))
    A[:2, 2:] = np.eye(2)
    A[2:] = -np.linalg.solve(M, np.hstack([9.81 * K0 + 25 * K2, 5 * C1]))
    exponents = np.linalg.eigvals(A).astype(complex)
    caster, weave, _, capsize = sorted(exponents, key=lambda s: s.real)
    values: Values = {
        "eigenvalue, weave, real part": weave.real,
        "eigenvalue, weave, imaginary part": abs(weave.imag),
        "eigenvalue, capsize": capsize.real,
        "eigenvalue, caster": caster.real,
    }
    for t in (0.5, 2.0):
        exact = mpmath.expm(mpmath.matrix((A * t).tolist()))
        values[f"lean per nudge at {t:g} s"] = float(exact[0, 2])
        values[f"steer per nudge at {t:g} s"] = float(exact[1, 2])
    return values
