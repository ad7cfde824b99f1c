"""The triple pendulum's equations of motion as a person writes them, in absolute angles.

Gugaratshan, M.S.E. thesis, Western Michigan University, 2008, (3.1.17)-(3.1.19), by Lagrange's
method. The angles θ_i are measured from the downward vertical (rad), ω_i = θ̇_i (rad/s). Only
arithmetic and NumPy's elementary functions: the same lines serve numbers, batches and symbols.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class HandEquations:
    """Coefficients of M(θ) ω̇ = f(θ, ω), in the thesis's order.

    J1, J2, J3    moments of inertia on the diagonal (kg·m²)
    k21, k31, k32 coupling inertias, times the cosine of the angle between two bars (kg·m²)
    g1, g2, g3    weight moments, times the sine of the angle (N·m)
    c1, c2, c3    dampers on the relative rates (N·m·s/rad)
    A, w          amplitude (rad) and frequency (rad/s) of a specified motion θ1 = A sin wt
    """

    J1: float
    J2: float
    J3: float
    k21: float
    k31: float
    k32: float
    g1: float
    g2: float
    g3: float
    c1: float
    c2: float
    c3: float
    A: float = 0.0
    w: float = 0.0

    @classmethod
    def of(cls, p: Mapping[str, float], *, mistake: bool = False) -> HandEquations:
        """From the parameters m1…, l1…, c1…, g (and A, w); uniform bars.

        With `mistake`, the weight moment in the second equation has the wrong sign (fig. 4.7).
        """
        m1, m2, m3 = p["m1"], p["m2"], p["m3"]
        l1, l2, l3 = p["l1"], p["l2"], p["l3"]
        r1, r2, r3 = l1 / 2, l2 / 2, l3 / 2
        g2 = (m2 * r2 + m3 * l2) * p["g"]
        return cls(
            J1=m1 * l1**2 / 12 + m1 * r1**2 + (m2 + m3) * l1**2,
            J2=m2 * l2**2 / 12 + m2 * r2**2 + m3 * l2**2,
            J3=m3 * l3**2 / 12 + m3 * r3**2,
            k21=(m2 * r2 + m3 * l2) * l1,
            k31=m3 * l1 * r3,
            k32=m3 * l2 * r3,
            g1=(m1 * r1 + (m2 + m3) * l1) * p["g"],
            g2=-g2 if mistake else g2,
            g3=m3 * r3 * p["g"],
            c1=p["c1"],
            c2=p["c2"],
            c3=p["c3"],
            A=p.get("A", 0.0),
            w=p.get("w", 0.0),
        )

    def terms(self, theta: Any, omega: Any) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        """M's entries (11, 12, 13, 22, 23, 33) and f's three (N·m, without driving torques)."""
        (s1, s2, s3), (n1, n2, n3) = np.sin(theta), np.cos(theta)
        S21, S31, S32 = s2 * n1 - n2 * s1, s3 * n1 - n3 * s1, s3 * n2 - n3 * s2
        C21, C31, C32 = n2 * n1 + s2 * s1, n3 * n1 + s3 * s1, n3 * n2 + s3 * s2
        w1, w2, w3 = omega
        M1 = -self.c1 * w1
        M2 = -self.c2 * (w2 - w1)
        M3 = -self.c3 * (w3 - w2)
        M12, M13, M23 = self.k21 * C21, self.k31 * C31, self.k32 * C32
        f1 = self.k21 * S21 * w2**2 + self.k31 * S31 * w3**2 - self.g1 * s1 + M1 - M2
        f2 = -self.k21 * S21 * w1**2 + self.k32 * S32 * w3**2 - self.g2 * s2 + M2 - M3
        f3 = -self.k31 * S31 * w1**2 - self.k32 * S32 * w2**2 - self.g3 * s3 + M3
        return (self.J1, M12, M13, self.J2, M23, self.J3), (f1, f2, f3)

    def free(self, t: Any, theta: Any, omega: Any) -> Any:
        """ω̇ (3,) or (3, B) of the pendulum that swings freely (rad/s²)."""
        (M11, M12, M13, M22, M23, M33), (f1, f2, f3) = self.terms(theta, omega)
        # M = L D Lᵀ is positive definite, so no pivoting is needed.
        L21, L31 = M12 / M11, M13 / M11
        D2 = M22 - L21 * M12
        L32 = (M23 - L31 * M12) / D2
        D3 = M33 - L31 * M13 - L32 * L32 * D2
        y2 = f2 - L21 * f1
        y3 = f3 - L31 * f1 - L32 * y2
        a3 = y3 / D3
        a2 = y2 / D2 - L32 * a3
        a1 = f1 / M11 - L21 * a2 - L31 * a3
        return np.array([a1, a2, a3])

    def driven(self, t: Any, theta: Any, omega: Any) -> Any:
        """ω̇2, ω̇3 (2,) or (2, B) while bar 1 moves as specified; θ2, θ3 and ω2, ω3 are given."""
        a1, (_, M12, M13, M22, M23, M33), (_, f2, f3) = self._specified(t, theta, omega)
        f2, f3 = f2 - M12 * a1, f3 - M13 * a1
        determinant = M22 * M33 - M23 * M23
        a2 = (f2 * M33 - M23 * f3) / determinant
        a3 = (M22 * f3 - M23 * f2) / determinant
        return np.array([a2, a3])

    def driving_torque(self, t: Any, theta: Any, omega: Any) -> Any:
        """M1 (N·m), the torque that makes bar 1 move as specified, from θ2, θ3 and ω2, ω3."""
        a1, (M11, M12, M13, *_), (f1, *_) = self._specified(t, theta, omega)
        a2, a3 = self.driven(t, theta, omega)
        return M11 * a1 + M12 * a2 + M13 * a3 - f1

    def _specified(
        self, t: Any, theta: Any, omega: Any
    ) -> tuple[Any, tuple[Any, ...], tuple[Any, ...]]:
        """θ̈1, and the terms at the specified θ1 and θ̇1."""
        a, w = self.A, self.w
        sine, cosine = np.sin(w * t), np.cos(w * t)
        zero = 0.0 * theta[0]  # in the shape of a batch, and a symbol where the rest are
        first, rate = a * sine + zero, a * w * cosine + zero
        entries = self.terms(np.array([first, *theta]), np.array([rate, *omega]))
        return -a * w**2 * sine, *entries

    def energy(self, theta: Any, omega: Any) -> Any:
        """½ ωᵀ M ω − Σ g_i cos θ_i (J): K + V, V measured from the first joint."""
        (M11, M12, M13, M22, M23, M33), _ = self.terms(theta, omega)
        w1, w2, w3 = omega
        kinetic = 0.5 * (M11 * w1**2 + M22 * w2**2 + M33 * w3**2)
        kinetic = kinetic + M12 * w1 * w2 + M13 * w1 * w3 + M23 * w2 * w3
        n1, n2, n3 = np.cos(theta)
        return kinetic - self.g1 * n1 - self.g2 * n2 - self.g3 * n3
