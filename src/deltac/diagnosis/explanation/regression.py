"""The regression: residual + Σ θ x = 0 by least squares, kept as triangular factors of blocks in time.

[X r] of each block of consecutive rows is reduced by QR to as many rows as it has columns. All that
follows (fits, their errors, their comparison) needs no more than that, however long the log.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.diagnosis.explanation.candidates import Candidate

Array: TypeAlias = NDArray[np.float64]

STEPS = 20
"""Steps of Gauss–Newton for causes that are not linear; most converge in two or three."""

SURE = 6.0
"""Standard errors by which a cause must stand out to be named."""


@dataclass(frozen=True, eq=False)
class Regression:
    """Weighted equations [X r] (rows, P + 1), block by block.

    Attributes:
        blocks: triangular factors (B, P + 1, P + 1), padded with zero rows.
        candidates: the causes whose columns X holds.
        rows: number of equations.
        shaken: triangular factor (P + 1, P + 1) of what the log's noise does to [X r].
        precision: sum of squares of r that the log's digits and rounding account for.
        weights: place of each body's mass and first moments -> that of their weight.
    """

    blocks: Array
    candidates: tuple[Candidate, ...]
    rows: int
    shaken: Array
    precision: float
    weights: Mapping[int, int] = field(default_factory=dict)

    @cached_property
    def R(self) -> Array:
        """The triangular factor (P + 1, P + 1) of all blocks together."""
        width = self.blocks.shape[2]
        return np.asarray(np.linalg.qr(self.blocks.reshape(-1, width), mode="r"))

    @property
    def total(self) -> float:
        """|r|²."""
        return float(np.sum(self.R[:, -1] ** 2))

    def noise(self, fit: Fit) -> float:
        """The part of what a fit leaves that is noise: that of the terms with the fit's numbers in them."""
        c, _ = self._at(fit)
        return float(np.sum((self.shaken[:, :-1] @ c + self.shaken[:, -1]) ** 2))

    def floor(self, fit: Fit) -> float:
        """The part of what a fit leaves that is no mistake."""
        return self.precision + self.noise(fit)

    @property
    def nothing(self) -> Fit:
        """The fit of no cause."""
        return Fit((), (), self.total)

    @cached_property
    def directions(self) -> tuple[Array, ...]:
        """R times the tangent at θ = 0 of every candidate, (P + 1, d) each."""
        return tuple(self.R[:, list(c.columns)] @ c.linear for c in self.candidates)

    @cached_property
    def sizes(self) -> Array:
        """Norm of each candidate's directions together (C,)."""
        return np.array([np.linalg.norm(d) for d in self.directions])

    def fit(self, chosen: Sequence[int]) -> Fit:
        """Least squares by the candidates with these numbers together."""
        parts = [self.candidates[k] for k in chosen]
        edges = np.concatenate([[0], np.cumsum([c.size for c in parts])]).astype(int)
        theta = np.zeros(edges[-1])
        heavier = len(parts) > 1 and any(c.kind == "gravity" for c in parts)
        curved = heavier or _products(parts) or any(c.quadratic is not None for c in parts)
        for _ in range(STEPS if curved else 1):
            c, J = self._linearised(parts, edges, theta)
            e = self.R[:, :-1] @ c + self.R[:, -1]
            step = np.linalg.lstsq(self.R[:, :-1] @ J, -e, rcond=1e-11)[0]
            theta = theta + step
            if np.linalg.norm(step) <= 1e-12 * np.linalg.norm(theta):
                break
        c, _ = self._linearised(parts, edges, theta)
        left = float(np.sum((self.R[:, :-1] @ c + self.R[:, -1]) ** 2))
        values = tuple(theta[a:b] for a, b in zip(edges[:-1], edges[1:]))
        return Fit(tuple(chosen), values, left)

    def _linearised(
        self, parts: Sequence[Candidate], edges: Array, theta: Array
    ) -> tuple[Array, Array]:
        """Coefficients (P,) of all columns and their derivatives (P, d)."""
        width = self.R.shape[1] - 1
        c, J = np.zeros(width), np.zeros((width, len(theta)))
        for part, a, b in zip(parts, edges[:-1], edges[1:]):
            np.add.at(c, list(part.columns), part.coefficients(theta[a:b]))
            np.add.at(J[:, a:b], list(part.columns), part.tangent(theta[a:b]))
        for i, k, per in _products(parts):  # what is heavier and moved is more than both
            place, start, end = int(edges[i]), int(edges[k]), int(edges[k + 1])
            at, factor = list(parts[k].columns), per * theta[place]
            moved = parts[k].coefficients(theta[start:end])
            np.add.at(c, at, factor * moved)
            np.add.at(J[:, start:end], at, factor * parts[k].tangent(theta[start:end]))
            np.add.at(J[:, place], at, per * moved)
        for part, a in zip(parts, edges[:-1]):  # another gravity pulls at the other masses
            if part.kind == "gravity" and self.weights:
                masses, pulled = list(self.weights), list(self.weights.values())
                c[pulled] += theta[a] * c[masses]
                J[pulled] += theta[a] * J[masses]
                J[pulled, a] += c[masses]
        return c, J

    def tangents(self, fit: Fit) -> tuple[Array, Array]:
        """R times the derivatives of a fit's coefficients (P + 1, d), and what it leaves (P + 1,)."""
        c, J = self._at(fit)
        return self.R[:, :-1] @ J, self.R[:, :-1] @ c + self.R[:, -1]

    def _at(self, fit: Fit) -> tuple[Array, Array]:
        if not fit.chosen:
            width = self.R.shape[1] - 1
            return np.zeros(width), np.zeros((width, 0))
        parts = [self.candidates[k] for k in fit.chosen]
        edges = np.concatenate([[0], np.cumsum([c.size for c in parts])]).astype(int)
        return self._linearised(parts, edges, np.concatenate(fit.theta))

    def left_by_block(self, fit: Fit) -> Array:
        """What a fit leaves of the squares of each block (B,)."""
        c, _ = self._at(fit)
        e = self.blocks[:, :, :-1] @ c + self.blocks[:, :, -1]
        return np.asarray(np.sum(e**2, axis=1))

    def covariance(self, fit: Fit) -> Array:
        """Covariance (d, d) of a fit's numbers, the larger of two estimates of each variance.

        White noise: σ² (JᵀJ)⁻¹; and whatever is correlated within blocks: the sandwich of the blocks'
        scores (Liang and Zeger 1986, Biometrika 73). What is noise in q, u, u̇ is in both.
        """
        c, J = self._at(fit)
        d = J.shape[1]
        X = self.R[:, :-1] @ J
        inverse = np.linalg.pinv(X.T @ X, rcond=1e-14, hermitian=True)
        white = max(fit.left, self.precision) / max(1, self.rows - d) * inverse
        e = self.blocks[:, :, :-1] @ c + self.blocks[:, :, -1]
        scores = np.einsum("kij,ki->kj", self.blocks[:, :, :-1] @ J, e)
        blocks = len(self.blocks)
        meat = scores.T @ scores * blocks / max(1, blocks - d)
        robust = inverse @ meat @ inverse
        scale = np.sqrt(np.maximum(1.0, np.diag(robust) / np.maximum(np.diag(white), 1e-300)))
        return np.asarray(white * np.outer(scale, scale))

    def stands_out(self, fit: Fit, sure: float = SURE) -> bool:
        """Whether every cause of a fit is many times the errors of its numbers (Wald's test)."""
        if not fit.chosen:
            return False
        covariance, start = self.covariance(fit), 0
        for theta in fit.theta:
            where = slice(start, start + len(theta))
            start += len(theta)
            inverse = np.linalg.pinv(covariance[where, where], rcond=1e-12, hermitian=True)
            if not float(theta @ inverse @ theta) > len(theta) * sure**2:
                return False
        return True

    def same(self, a: Fit, b: Fit, sure: float = 3.0) -> bool:
        """Whether the data do not prefer fit a to b, which leaves more.

        Both leave no more than precision explains, or the difference of what they leave does not
        stand out of its scatter over the blocks (Vuong 1989, Econometrica 57).
        """
        if b.left <= max(4.0 * a.left, self.precision):
            if max(a.left, b.left) <= self.precision:
                return True
            difference = self.left_by_block(b) - self.left_by_block(a)
            scatter = float(np.std(difference, ddof=1)) * np.sqrt(len(difference))
            return float(np.sum(difference)) <= sure * scatter and b.left < 2.0 * a.left
        return False


@dataclass(frozen=True, eq=False)
class Fit:
    """Causes with their numbers, and the sum of squares that they leave."""

    chosen: tuple[int, ...]
    theta: tuple[Array, ...]
    left: float


def _products(parts: Sequence[Candidate]) -> list[tuple[int, int, float]]:
    """Pairs of causes whose product is in the residual: the factor, what it scales, by how much."""
    pairs = ((i, k, a.scales(b)) for i, a in enumerate(parts) for k, b in enumerate(parts))
    return [pair for pair in pairs if pair[2]]


def factored(blocks: Sequence[Array]) -> Array:
    """Triangular factors (B, n, n) of matrices (rows, n)."""
    width = blocks[0].shape[1]
    made = np.zeros((len(blocks), width, width))
    for k, block in enumerate(blocks):
        R = np.linalg.qr(block, mode="r")
        made[k, : len(R)] = R
    return made
