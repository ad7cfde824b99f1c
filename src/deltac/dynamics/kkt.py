"""The constrained equations M u̇ − Gᵀλ = r, G u̇ = −γ solved two ways: by sparse LDLᵀ, and by least squares.

With M = L D Lᵀ and Y = L⁻¹Gᵀ the multipliers solve S λ = −γ − G M⁻¹r with the Schur complement
S = Yᵀ D⁻¹ Y. Both matrices are symmetric positive definite when the constraints are independent, so LDLᵀ
needs no pivoting: the order of operations is fixed, straight code can be compiled from it, and structural
zeros cost nothing (`Schur`). Where constraints are redundant or dependent its pivots vanish, which it
tells; there numeric least squares by singular values take its place (`LeastSquares`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from deltac.arrays import EPS, ROUNDED, SAME, Array
from deltac.dynamics.spatial import SX

LEAST_PIVOT = 16 * ROUNDED
"""Smallest pivot below which a compiled factorisation is not trusted, a digit above rounding.

Numeric least squares take over there.
"""

VANISHED = SAME
"""A row of the constraints whose square is this fraction of the largest one's has vanished.

The stages of a step are off the constraints by its local error, and a row near a singular position
turns with that: far above rounding, it points anywhere. A four-bar passed flat at 150 step sizes near
1e-3 s keeps its tip to 8e-6 m with this bound, and with 1e-10 in all but a few.
"""

Entry = Any  # a scalar SX, or None where a structural zero is


@dataclass(frozen=True)
class Factor:
    """L D Lᵀ of a symmetric positive definite matrix: rows of L below its unit diagonal, pivots d.

    `diagonal` is that of the matrix: d/diagonal is near 0 where a row depends on those before it.
    `inverse` is 1/d: a division takes as long as ten multiplications.
    """

    L: list[dict[int, SX]]
    d: list[SX]
    diagonal: list[SX]
    inverse: list[SX]

    def forward(self, column: Sequence[Entry]) -> list[Entry]:
        """L⁻¹ b."""
        x = list(column)
        for i, row in enumerate(self.L):
            for k, entry in row.items():
                if x[k] is not None:
                    x[i] = _minus(x[i], entry * x[k])
        return x

    def backward(self, column: Sequence[Entry]) -> list[Entry]:
        """L⁻ᵀ b."""
        x = list(column)
        for i in reversed(range(len(self.L))):
            if x[i] is None:
                continue
            for k, entry in self.L[i].items():
                x[k] = _minus(x[k], entry * x[i])
        return x

    def solve(self, column: Sequence[Entry]) -> list[Entry]:
        """A⁻¹ b."""
        y = self.forward(column)
        return self.backward([None if e is None else e * w for e, w in zip(y, self.inverse)])

    @property
    def smallest_pivot(self) -> SX:
        """The least d/diagonal: near 0 where the matrix is nearly singular."""
        ratio = ca.SX(1)
        for d, a in zip(self.d, self.diagonal):
            ratio = ca.fmin(ratio, d / a)
        return ratio


def factorise(A: SX) -> Factor:
    """L D Lᵀ of a symmetric positive definite SX matrix, skipping structural zeros."""
    n = A.shape[0]
    rows: list[dict[int, SX]] = [{} for _ in range(n)]
    d: list[SX] = []
    inverse: list[SX] = []
    for i in range(n):
        row: dict[int, SX] = {}
        for j in range(i):
            value = _entry(A, i, j)
            for k, entry in rows[j].items():
                if k in row:
                    value = _minus(value, row[k] * entry)
            if value is not None:
                row[j] = value  # L_ij d_j, divided below
        pivot = A[i, i]
        for j, scaled in row.items():
            row[j] = scaled * inverse[j]
            pivot = pivot - row[j] * scaled
        rows[i] = row
        d.append(pivot)
        inverse.append(1 / pivot)
    return Factor(rows, d, [A[i, i] for i in range(n)], inverse)


def spd_solve(A: SX, B: SX) -> SX:
    """A⁻¹ B of a symmetric positive definite matrix."""
    factor = factorise(A)
    return ca.horzcat(*(_vector(factor.solve(_column(column))) for column in ca.horzsplit(B)))


@dataclass(frozen=True)
class Schur:
    """A constrained system, factorised: mass matrix, Y = L⁻¹ Gᵀ (by rows of G), and S.

    What is factorised may be M + Gᵀμ G instead of M, where G must complete a singular M. G u̇ = −γ makes
    r − Gᵀμ γ the right side then: the solution for r has the same u̇, and multipliers less by μ γ.
    """

    mass: Factor
    Y: list[list[Entry]]
    S: Factor
    weights: SX

    def solve(self, r: SX, gamma: SX) -> tuple[SX, SX]:
        """u̇ (p,) and λ (nc,) of M u̇ − Gᵀλ = r, G u̇ = −γ."""
        lam = self._least_multipliers(r, gamma)
        return self.free_response(r) + self.response(lam), lam + self.weights * gamma

    def multipliers(self, r: SX, gamma: SX) -> SX:
        """λ (nc,) alone."""
        return self._least_multipliers(r, gamma) + self.weights * gamma

    def _least_multipliers(self, r: SX, gamma: SX) -> SX:
        y = self.mass.forward(_column(r))
        right = []
        for k, row in enumerate(self.Y):
            flow = _dot(row, y, self.mass.inverse)
            right.append(-gamma[k] if flow is None else -gamma[k] - flow)
        return _vector(self.S.solve(right))

    def free_response(self, r: SX) -> SX:
        """M⁻¹ r."""
        return _vector(self.mass.solve(_column(r)))

    def response(self, lam: SX) -> SX:
        """M⁻¹ Gᵀ λ."""
        n = len(self.mass.d)
        total: list[Entry] = [None] * n
        for k, row in enumerate(self.Y):
            for i, entry in enumerate(row):
                if entry is not None:
                    total[i] = _minus(total[i], -entry * lam[k])
        scaled = [None if e is None else e * w for e, w in zip(total, self.mass.inverse)]
        return _vector(self.mass.backward(scaled))

    def least(self, violation: SX) -> SX:
        """The change of speeds, least in the mass metric, that G maps to −violation."""
        lam = _vector(self.S.solve([-violation[k] for k in range(violation.shape[0])]))
        return self.response(lam)

    @property
    def smallest_pivot(self) -> SX:
        """How near the constraints are to being dependent: 1 independent, 0 dependent.

        A row that vanishes (its d and diagonal together) shows by its size against the largest row.
        """
        ratio, largest = self.S.smallest_pivot, ca.SX(0)
        for a in self.S.diagonal:
            largest = ca.fmax(largest, a)
        for a in self.S.diagonal:
            ratio = ca.fmin(ratio, a / (VANISHED * largest) * LEAST_PIVOT)
        return ratio


def schur(M: SX, G: SX, weights: SX | None = None) -> Schur:
    """Factorise the constrained system of a mass matrix, or of M + Gᵀμ G with `weights` μ, and a Jacobian."""
    mass = factorise(M)
    Y = [mass.forward([_entry(G, k, i) for i in range(G.shape[1])]) for k in range(G.shape[0])]
    n = G.shape[0]
    S = ca.SX(n, n)
    for i in range(n):
        for j in range(i + 1):
            value = _dot(Y[i], Y[j], mass.inverse)
            if value is not None:
                S[i, j] = value
                S[j, i] = value
    return Schur(mass, Y, factorise(S), ca.SX(n, 1) if weights is None else weights)


def _dot(a: Sequence[Entry], b: Sequence[Entry], weights: Sequence[SX]) -> Any:
    """Σ w a b over entries that are there; None if none are."""
    total: Any = None
    for x, y, weight in zip(a, b, weights):
        if x is not None and y is not None:
            total = _minus(total, -(x * y) * weight)
    return total


def _minus(a: Entry, b: SX) -> SX:
    return -b if a is None else a - b


def _entry(A: SX, i: int, j: int) -> Entry:
    """An entry, or None if it is zero by structure."""
    value = A[i, j]
    return None if value.nnz() == 0 or value.is_zero() else value


def _column(v: SX) -> list[Entry]:
    return [_entry(v, k, 0) for k in range(v.shape[0])]


def _vector(entries: Sequence[Entry]) -> SX:
    return ca.vertcat(ca.SX(0, 1), *(ca.SX(0) if e is None else e for e in entries))


# --- by least squares ------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class LeastSquares:
    """The constrained system at one state or at B states, any rows: the numeric twin of `Schur`.

    With M = L Lᵀ and A = D G L⁻ᵀ, whose rows D brings to unit length (vanished ones to zero), all that is
    wanted follows from the pseudo-inverse A⁺. It is found from A itself: singular values of S = G M⁻¹ Gᵀ
    are squares, whose small ones drown in rounding twice as early.
    """

    root: Array
    G: Array
    scale: Array
    inverse: Array

    def least(self, violation: Array) -> Array:
        """The change of speeds (p,), least in the mass metric, that G maps nearest to −violation (nc,)."""
        change = self.inverse @ (self.scale * violation)[..., None]
        return -np.asarray(np.linalg.solve(np.swapaxes(self.root, -1, -2), change))[..., 0]

    def combinations(self, dependent: float) -> tuple[Array, Array]:
        """Columns (nc, ·) that combine rows at one state: into independent ones, and into what is no row.

        The latter are smaller than the share `dependent` of the largest, in the mass metric.
        """
        size = np.where(self.scale > 0.0, self.scale, 1.0)
        A = self.scale[:, None] * np.linalg.solve(self.root, self.G.T).T
        columns, values, _ = np.linalg.svd(A)
        rank = int((values > dependent * values.max(initial=1e-300)).sum())
        combined = size[:, None] * columns
        return combined[:, :rank], combined[:, rank:]

    @property
    def schur_inverse(self) -> Array:
        """S⁺ (nc, nc): the least multipliers of an acceleration of the constraints."""
        half = self.inverse * self.scale[..., None, :]
        return np.asarray(np.swapaxes(half, -1, -2) @ half)

    @property
    def response(self) -> Array:
        """M⁻¹Gᵀ (p, nc)."""
        return self.solved(np.swapaxes(self.G, -1, -2))

    def multipliers(self, r: Array, gamma: Array) -> Array:
        """The least λ (nc,) of M u̇ − Gᵀλ = r, G u̇ = −γ, as far as that can be met."""
        target = -gamma - (self.G @ self.free_response(r)[..., None])[..., 0]
        return np.asarray((self.schur_inverse @ target[..., None])[..., 0])

    def free_response(self, r: Array) -> Array:
        """M⁻¹ r (p,)."""
        return self.solved(r[..., None])[..., 0]

    def solved(self, right: Array) -> Array:
        """M⁻¹ of columns (p, ·)."""
        half = np.linalg.solve(self.root, right)
        return np.asarray(np.linalg.solve(np.swapaxes(self.root, -1, -2), half))


def mass_rounding(n: int) -> float:
    """A pivot or eigenvalue below this share of the diagonal is what rounding makes of zero, of n speeds."""
    return 8.0 * n * EPS


def least_squares(M: Array, G: Array, dependent: float = 1e-8) -> LeastSquares:
    """Factorise mass matrices (…, p, p) and constraint Jacobians (…, nc, p).

    Rows of which no more than the share `dependent` is independent of others count as redundant.
    Raises LinAlgError for a mass matrix that is not positive definite by more than rounding.
    """
    root = np.linalg.cholesky(M)
    pivots = np.diagonal(root, axis1=-2, axis2=-1) ** 2
    if (pivots <= mass_rounding(M.shape[-1]) * np.diagonal(M, axis1=-2, axis2=-1)).any():
        raise np.linalg.LinAlgError("a mass matrix is singular to rounding")
    G = without_rounding(G)
    A = np.swapaxes(np.linalg.solve(root, np.swapaxes(G, -1, -2)), -1, -2)
    length = np.linalg.norm(A, axis=-1)
    present = length > np.sqrt(VANISHED) * length.max(axis=-1, keepdims=True, initial=1e-300)
    scale = np.where(present, 1.0 / np.where(present, length, 1.0), 0.0)
    inverse = np.linalg.pinv(A * scale[..., None], rcond=dependent)
    return LeastSquares(np.asarray(root), G, scale, np.asarray(inverse))


def without_rounding(G: Array) -> Array:
    """A Jacobian whose entries at rounding level are zero: a row of such entries asks for nothing."""
    return np.where(np.abs(G) > ROUNDED, G, 0.0)
