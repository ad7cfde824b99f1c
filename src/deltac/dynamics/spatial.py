"""Spatial vector algebra (Featherstone 2008, chapter 2) on CasADi matrices.

A motion vector is V = (ω; v), a force vector F = (n; f): angular part first, v and n taken at the
frame's origin. `Transform` carries them between frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import casadi as ca

SX: TypeAlias = Any
"""A CasADi SX matrix (CasADi has no type stubs)."""


def skew(a: SX) -> SX:
    """The matrix a× with a× b = cross(a, b)."""
    return ca.skew(a)


def cross(a: SX, b: SX) -> SX:
    """The vector product of two 3-vectors."""
    return ca.vertcat(
        a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    )


def cross_motion(V: SX, W: SX) -> SX:
    """V × W of two motion vectors: the rate of W when it is fixed in a frame that moves with V."""
    return ca.vertcat(cross(V[:3], W[:3]), cross(V[:3], W[3:]) + cross(V[3:], W[:3]))


def cross_force(V: SX, F: SX) -> SX:
    """V ×* F: the rate of a force vector that is fixed in a frame that moves with V."""
    return ca.vertcat(cross(V[:3], F[:3]) + cross(V[3:], F[3:]), cross(V[:3], F[3:]))


def axis_rotation(axis: Sequence[float], angle: SX) -> SX:
    """R whose columns are axes turned by `angle` about the unit vector `axis` (Rodrigues).

    Written as a aᵀ + c (1 − a aᵀ) + s a×, so that zeros and ones of a coordinate axis stay constants.
    """
    a = ca.DM(list(axis))
    along = ca.mtimes(a, a.T)
    return along + ca.cos(angle) * (ca.DM.eye(3) - along) + ca.sin(angle) * ca.skew(a)


def quaternion_rotation(q: SX) -> SX:
    """R of the quaternion q/|q|, scalar first; body to parent components."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    s = 2 / ca.dot(q, q)
    return ca.vertcat(
        ca.horzcat(1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)),
        ca.horzcat(s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x)),
        ca.horzcat(s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y)),
    )


def quaternion_rates(q: SX) -> SX:
    """The matrix W (4 by 3) of q̇ = W ω, ω in body components."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    return 0.5 * ca.vertcat(
        ca.horzcat(-x, -y, -z), ca.horzcat(w, -z, y), ca.horzcat(z, w, -x), ca.horzcat(-y, x, w)
    )


@dataclass(frozen=True)
class Transform:
    """From a frame A to a frame B: `E` turns A's components into B's, `r` is B's origin in A."""

    E: SX
    r: SX

    def __matmul__(self, V: SX) -> SX:
        """Motion vectors (6 by any number): X V."""
        w, v = V[:3, :], V[3:, :]
        return ca.vertcat(
            ca.mtimes(self.E, w), ca.mtimes(self.E, v - ca.mtimes(ca.skew(self.r), w))
        )

    def then(self, after: Transform) -> Transform:
        """The transform from A to C, `after` being the one from B to C."""
        return Transform(ca.mtimes(after.E, self.E), self.r + ca.mtimes(self.E.T, after.r))

    def force_back(self, F: SX) -> SX:
        """A force vector from B back to A: Xᵀ F."""
        n, f = ca.mtimes(self.E.T, F[:3]), ca.mtimes(self.E.T, F[3:])
        return ca.vertcat(n + cross(self.r, f), f)

    def inertia_back(self, inertia: Inertia) -> Inertia:
        """A (possibly articulated) inertia from B back to A: Xᵀ I X (Featherstone 2008, table 2.2)."""
        E, r = self.E, ca.skew(self.r)
        J = _symmetric(ca.mtimes(E.T, ca.mtimes(inertia.J, E)))
        H = ca.mtimes(E.T, ca.mtimes(inertia.H, E))
        M = _symmetric(ca.mtimes(E.T, ca.mtimes(inertia.M, E)))
        H_moved = H + ca.mtimes(r, M)
        return Inertia(_symmetric(J - ca.mtimes(H_moved, r) + ca.mtimes(r, H.T)), H_moved, M)


@dataclass(frozen=True)
class Inertia:
    """A symmetric spatial inertia in 3 by 3 blocks: n = J ω + H v, f = Hᵀ ω + M v."""

    J: SX
    H: SX
    M: SX

    def __matmul__(self, V: SX) -> SX:
        """The force (momentum) vectors I V, 6 by any number."""
        w, v = V[:3, :], V[3:, :]
        return ca.vertcat(
            ca.mtimes(self.J, w) + ca.mtimes(self.H, v),
            ca.mtimes(self.H.T, w) + ca.mtimes(self.M, v),
        )

    def __add__(self, other: Inertia) -> Inertia:
        return Inertia(self.J + other.J, self.H + other.H, self.M + other.M)

    def minus_outer(self, U: SX, V: SX) -> Inertia:
        """I − U Vᵀ for 6 by n factors whose product is symmetric."""
        return Inertia(
            _symmetric(self.J - ca.mtimes(U[:3, :], V[:3, :].T)),
            self.H - ca.mtimes(U[:3, :], V[3:, :].T),
            _symmetric(self.M - ca.mtimes(U[3:, :], V[3:, :].T)),
        )


def rigid_inertia(mass: SX, centre: SX, central: SX) -> Inertia:
    """Inertia of a rigid body about the origin; `centre` its mass centre, `central` about that."""
    c = ca.skew(centre)
    return Inertia(central + mass * ca.mtimes(c, c.T), mass * c, mass * ca.SX.eye(3))


def spd_solve(D: SX, B: SX) -> SX:
    """D⁻¹ B by LDLᵀ without pivoting, traced; D symmetric positive definite, n by n."""
    n = D.shape[0]
    if n == 1:
        return B / D
    L: list[list[Any]] = [[0.0] * n for _ in range(n)]
    d: list[Any] = []
    for j in range(n):
        d.append(D[j, j] - sum((L[j][k] ** 2 * d[k] for k in range(j)), start=ca.SX(0)))
        for i in range(j + 1, n):
            dot = sum((L[i][k] * L[j][k] * d[k] for k in range(j)), start=ca.SX(0))
            L[i][j] = (D[i, j] - dot) / d[j]
    rows = [B[i, :] for i in range(n)]
    for i in range(n):
        for k in range(i):
            rows[i] = rows[i] - L[i][k] * rows[k]
    rows = [row / d[i] for i, row in enumerate(rows)]
    for i in reversed(range(n)):
        for k in range(i + 1, n):
            rows[i] = rows[i] - L[k][i] * rows[k]
    return ca.vertcat(*rows)


def _symmetric(A: SX) -> SX:
    """The upper triangle mirrored: the lower one is never computed."""
    return ca.triu2symm(ca.triu(ca.densify(A)))
