"""Closed loops by other derivations than the library's: no trees, no recursions, no symbols."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np

from tests.oracles.common import Values, constrained, integrated

# --- planar bars as arrows in the complex plane ----------------------------------------------------


class Arrows:
    """A point Σ ℓ exp(i c·q) of the plane: complex lengths ℓ, integer combinations c of the angles."""

    def __init__(self, base: complex, *arrows: tuple[complex, Any]) -> None:
        self.base = base
        self.lengths = np.array([length for length, _ in arrows], dtype=complex)
        self.turns = np.array([turns for _, turns in arrows], dtype=float)

    def at(self, q: Any, w: Any) -> tuple[complex, Any, complex]:
        """Position, Jacobian (n,), and acceleration at q̈ = 0."""
        arms = self.lengths * np.exp(1j * (self.turns @ q))
        return self.base + arms.sum(), 1j * arms @ self.turns, -arms @ (self.turns @ w) ** 2


def andrews_squeezer() -> Values:
    """The seven bars of the test set: M q̈ = f − Gᵀλ with g̈ = 0, integrated as it stands (index 1)."""
    A, B, C = -0.06934 - 0.00227j, -0.03635 + 0.03273j, 0.014 + 0.072j
    d, da, e, ea, rr, ra = 0.028, 0.0115, 0.02, 0.01421, 0.007, 0.00092
    ss, sa, sb, sc, sd = 0.035, 0.01874, 0.01043, 0.018, 0.02
    ta, tb, u, ua, ub, zf, zt, fa = 0.02308, 0.00916, 0.04, 0.01228, 0.00449, 0.02, 0.04, 0.01421
    b, bt, g, pd, de, oe, ep = np.array(
        [
            [1, 0, 0, 0, 0, 0, 0],
            [1, 1, 0, 0, 0, 0, 0],
            [0, 0, 1, 0, 0, 0, 0],
            [0, 0, 0, 1, 1, 0, 0],
            [0, 0, 0, 0, 1, 0, 0],
            [0, 0, 0, 0, 0, 1, 1],
            [0, 0, 0, 0, 0, 0, 1],
        ]
    )
    # (sin, −cos) of an angle is −i exp(i angle).
    bars = [
        (0.04325, 2.194e-6, b, Arrows(0, (ra, b))),
        (0.00365, 4.410e-7, bt, Arrows(0, (rr, b), (-da, bt))),
        (0.02373, 5.255e-6, g, Arrows(B, (sb - 1j * sa, g))),
        (0.00706, 5.667e-7, pd, Arrows(A, (zt, de), (-1j * (e - ea), pd))),
        (0.07050, 1.169e-5, de, Arrows(A, (ta + 1j * tb, de))),
        (0.00706, 5.667e-7, oe, Arrows(A, (-1j * u, ep), (zf - fa, oe))),
        (0.05498, 1.912e-5, ep, Arrows(A, (-ub - 1j * ua, ep))),
    ]
    hook = Arrows(B, (sd - 1j * sc, g))
    end = Arrows(0, (rr, b), (-d, bt))
    others = (
        Arrows(B, (-1j * ss, g)),
        Arrows(A, (zt, de), (-1j * e, pd)),
        Arrows(A, (-1j * u, ep), (zf, oe)),
    )

    def solved(y: Any) -> tuple[Any, Any]:
        q, w = y[:7], y[7:14]
        M, f = np.zeros((7, 7)), 0.033 * b.astype(float)
        for mass, inertia, turns, centre in bars:
            _, J, a = centre.at(q, w)
            M += mass * np.outer(J.conj(), J).real + inertia * np.outer(turns, turns)
            f -= mass * (J.conj() * a).real
        D, J, _ = hook.at(q, w)
        f -= 4530.0 * (abs(D - C) - 0.07785) * (J.conj() * (D - C)).real / abs(D - C)
        rows, gamma = [], []
        for other in others:
            (_, J1, a1), (_, J2, a2) = end.at(q, w), other.at(q, w)
            rows += [(J1 - J2).real, (J1 - J2).imag]
            gamma += [(a1 - a2).real, (a1 - a2).imag]
        return constrained(M, f, np.array(rows), np.array(gamma))

    start = [-0.0617138900142764496, 0.0, 0.455279819163070380, 0.222668390165885885]
    start += [0.487364979543842550, -0.222668390165885885, 1.23054744454982120, *[0.0] * 7]
    final = integrated(lambda t, y: np.concatenate([y[7:], solved(y)[0]]), start, [0.03])[0]
    values: Values = {"K + V − V0 − ∫τβ̇ at 0.03 s": 0.0}
    for t, y in ((0.0, np.array(start)), (0.03, final)):
        a, lam = solved(y)
        for k, symbol in enumerate("βΘγΦδΩε"):
            values[f"{symbol} at {t:g} s"] = float(y[k])
            values[f"{symbol}̇ at {t:g} s"] = float(y[7 + k])
            values[f"{symbol}̈ at {t:g} s"] = float(a[k])
        values |= {f"λ{k + 1} at {t:g} s": float(value) for k, value in enumerate(lam)}
    return values


def n_four_bar(n: int = 2) -> Values:
    """One pendulum with I θ̈ = −Mc sinθ that goes round: θ/2 = am(½ω_b t + K(m)), θ from below."""
    with mpmath.workdps(30):
        I = mpmath.mpf(n + 1) / 3 + n
        Mc = (mpmath.mpf(n + 1) / 2 + n) * mpmath.mpf("9.81")
        bottom = mpmath.sqrt(1 + 4 * Mc / I)  # rate at the bottom; 1 rad/s at the top
        m = 4 * Mc / I / bottom**2
        # The force is that of a potential, so exact motion keeps the energy.
        values: Values = {"energy at 10 s": float(I / 2 + Mc), "largest energy error": 0.0}
        for t in (1, 5, 10):
            phase = bottom * t / 2 + mpmath.ellipk(m)
            sine, cosine = (mpmath.ellipfun(kind, phase, m=m) for kind in ("sn", "cn"))
            # The tip is at (sinθ, −cosθ) when turning to the left; it turns to the right.
            values[f"tip x at {t} s"] = float(-2 * sine * cosine)
            values[f"tip y at {t} s"] = float(sine**2 - cosine**2)
    return values


# --- Bricard, in natural coordinates ---------------------------------------------------------------


def bricard() -> Values:
    """Vertices v and hinge axes a as the unknowns: constant masses and quadratic constraints.

    A rod from v to v′ holds the hinge axes a and a′ of its ends, at right angles to it and to each
    other. With the cross section w by w its kinetic energy is
    ½ [m/3 (v̇² + v̇·v̇′ + v̇′²) + m w²/12 (ȧ² + ȧ′²)].
    """
    vertices = np.array(
        [(0, 0, 0), (1, 0, 0), (1, -1, 0), (1, -1, 1), (0, -1, 1), (0, 0, 1)], dtype=float
    )
    axes = np.eye(3)[[1, 2, 0, 1, 2, 0]]
    free = slice(1, 5)  # the others are fixed in the ground
    M, f = np.zeros((12, 12)), np.zeros((12, 3))
    for k in range(5):
        M[k, k] += 1 / 3
        M[k + 1, k + 1] += 1 / 3
        M[k, k + 1] += 1 / 6
        M[k + 1, k] += 1 / 6
        M[6 + k, 6 + k] += 0.01 / 12
        M[7 + k, 7 + k] += 0.01 / 12
        f[k : k + 2, 1] -= 9.81 / 2
    moving = np.r_[1:5, 7:11]
    mass = np.kron(M[np.ix_(moving, moving)], np.eye(3))
    force = f[moving].ravel()
    # Each constraint is a product of two differences of the twelve vectors.
    identity = np.eye(12)
    pairs = []
    for k in range(5):
        edge, a, b = identity[k + 1] - identity[k], identity[6 + k], identity[7 + k]
        pairs += [(edge, edge), (edge, a), (edge, b), (a, b)]
    pairs += [(identity[6 + k], identity[6 + k]) for k in range(1, 5)]
    left, right = (np.array(side) for side in zip(*pairs, strict=True))

    def whole(y: Any, fixed: bool) -> Any:
        full = np.zeros((12, 3))
        if fixed:
            full[:6], full[6:] = vertices, axes
        full[moving] = y.reshape(8, 3)
        return full

    def rhs(t: float, y: Any) -> Any:
        x, v = whole(y[:24], True), whole(y[24:], False)
        G = left[:, :, None] * (right @ x)[:, None, :] + right[:, :, None] * (left @ x)[:, None, :]
        gamma = 2 * ((left @ v) * (right @ v)).sum(axis=1)
        a, _ = constrained(mass, force, G[:, moving].reshape(len(pairs), 24), gamma)
        return np.concatenate([y[24:], a])

    start = np.concatenate([vertices[free].ravel(), axes[free].ravel(), np.zeros(24)])
    values: Values = {"energy at 10 s": -29.43}
    times = (1.0, 2.0, 10.0)
    for t, y in zip(times, integrated(rhs, start, times), strict=True):  # type: ignore[arg-type]
        for k, axis in enumerate("xyz"):
            values[f"third vertex {axis} at {t:g} s"] = float(y[3 + k])
    return values
