"""Which constraints are independent: a numeric rank study at and near a configuration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from deltac.arrays import Array
from deltac.dynamics.constraints import Rows
from deltac.dynamics.recursions import crba
from deltac.dynamics.system import System

RANK_TOLERANCE = 1e-8
"""Rows whose part not explained by others is smaller than this (relative, mass metric) depend on them."""

ROUNDING = 1e-12
"""Entries of G smaller than this (m or 1) are what rounding leaves of zero."""


@dataclass(frozen=True)
class Independence:
    """Independent and redundant rows, and the degrees of freedom left.

    `singular` tells that the configuration has a smaller rank than its neighbourhood.
    """

    independent: tuple[int, ...]
    redundant: tuple[int, ...]
    freedom: int
    singular: bool


def independence(system: System, rows: Rows, t: float, q: Array, p: Array) -> Independence:
    """Find independent rows at the free coordinates `q`, and whether q is a singular configuration.

    The rank is taken at q and at two configurations nearby that satisfy the constraints; the larger one
    is the generic rank, on whose rows equations of motion can be built.
    """
    free = system.free_u
    if not len(rows):
        return Independence((), (), len(free), singular=False)
    point = [system.t, system.q, system.p]
    M = crba(system)[free, free]
    W = ca.jacobian(system.qdot, system.u)
    evaluate = ca.Function("rank", point, [M, rows.G, rows.phi, W])

    def at(place: Array) -> tuple[Array, Array, Array, Array]:
        M_, G_, phi_, W_ = (np.array(value) for value in evaluate(t, place, p))
        return M_, G_, phi_.ravel(), W_

    here = _independent(*at(q)[:2])
    rng = np.random.default_rng(1)
    chosen = here
    for _ in range(2):
        M_, G_, _, W_ = at(q)
        kernel = rng.standard_normal(len(free))
        kernel -= np.linalg.lstsq(G_, G_ @ kernel, rcond=1e-10)[0]
        near = q + 1e-2 * W_ @ kernel
        for _ in range(20):
            _, G_near, phi_near, W_near = at(near)
            near = near - W_near @ np.linalg.lstsq(G_near, phi_near, rcond=1e-10)[0]
        if np.isfinite(near).all() and np.abs(at(near)[2]).max(initial=0.0) < 1e-9:
            there = _independent(*at(near)[:2])
            chosen = there if len(there) > len(chosen) else chosen
    redundant = tuple(k for k in range(len(rows)) if k not in chosen)
    return Independence(chosen, redundant, len(free) - len(chosen), len(chosen) > len(here))


def _independent(M: Array, G: Array) -> tuple[int, ...]:
    """Rows of G that span its range, found by pivoted QR in the mass metric, in their own order."""
    from scipy.linalg import qr, solve_triangular

    scaled = solve_triangular(np.linalg.cholesky(M), without_rounding(G).T, lower=True)
    length = np.linalg.norm(scaled, axis=0)
    present = length > RANK_TOLERANCE * max(1e-300, length.max(initial=0.0))
    scaled = np.where(present, scaled / np.where(present, length, 1.0), 0.0)
    _, R, order = qr(scaled, mode="economic", pivoting=True)
    rank = int((np.abs(np.diag(R)) > RANK_TOLERANCE).sum())
    return tuple(sorted(int(k) for k in order[:rank]))


def without_rounding(G: Array) -> Array:
    """A Jacobian whose entries at rounding level are zero: a row of such entries asks for nothing."""
    return np.where(np.abs(G) > ROUNDING, G, 0.0)


def row_names(rows: Rows, places: Sequence[int]) -> str:
    """Rows in words: how many of which constraint."""
    counts: dict[str, int] = {}
    for k in places:
        counts[rows.names[k]] = counts.get(rows.names[k], 0) + 1
    return ", ".join(f"{n} of {name!r}" for name, n in counts.items())
