"""Which constraints are independent: a numeric rank study at and near a configuration."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deltac.arrays import ASSEMBLED, ROOT_EPS, Array, max_norm
from deltac.calls.caching import LRUCache
from deltac.dynamics.admissible import onto_positions
from deltac.dynamics.constraints import ConstraintRows
from deltac.dynamics.equations_of_motion import EquationsOfMotion
from deltac.dynamics.kkt import without_rounding
from deltac.dynamics.singular_inertia import regular_least_squares

RANK_TOLERANCE = ROOT_EPS
"""Rows whose part not explained by others is smaller than this (relative, mass metric) depend on them."""


@dataclass(frozen=True)
class Independence:
    """Independent and redundant rows, and the degrees of freedom left, here and in general (nearby).

    `singular` tells that the position rows have a smaller rank than in the neighbourhood: motion may branch.
    Motion rows may depend on the others here alone (a car on four wheels whose body does not lean): then they
    are redundant for as long as the motion keeps them. `margin` is the share of the least independent row
    that the others do not explain: 1 at right angles in the mass metric.
    """

    independent: tuple[int, ...]
    redundant: tuple[int, ...]
    freedom: int
    generic: int
    singular: bool
    margin: float = 1.0


def independence(
    equations: EquationsOfMotion, t: float, q: Array, p: ArrayLike = ()
) -> Independence:
    """Find independent rows at the free coordinates `q`, and whether q is a singular configuration.

    The rank is taken at q and at two configurations nearby that satisfy the constraints; the larger one
    is the generic rank, on whose rows equations of motion can be built. The last few answers are kept with
    the equations: a study starts many runs from one state.

    Raises ModelError for a singular mass matrix, naming the speeds that move no inertia.
    """
    cache = equations.system.once("independence", lambda: LRUCache[Independence](16))
    place = (t, q.tobytes(), np.asarray(p, dtype=float).tobytes())
    return cache.get(place, lambda: _studied(equations, t, q, p))


def dependent_speeds(equations: EquationsOfMotion, t: float, q: Array) -> bool:
    """Whether constraints at q make the free speeds depend on each other, and leave them some freedom."""
    return bool(len(equations.rows)) and independence(equations, t, q).freedom > 0


def _studied(equations: EquationsOfMotion, t: float, q: Array, p: ArrayLike) -> Independence:
    rows, n = equations.rows, len(equations.system.free_u)
    if not len(rows):
        return Independence((), (), n, n, singular=False)
    still = np.zeros(n)

    def at(place: Array) -> tuple[Array, Array, Array]:
        M, phi, _, G, _ = equations.ties(t, place, still, p)
        return M, G, phi

    M, _, _, G, W = equations.ties(t, q, still, p)
    tied = regular_least_squares(equations.system.mechanism, M, G)
    positions = np.array(rows.holonomic)
    at_state, level, margin = _independent(M, G, positions)
    chosen, singular = at_state, False
    rng = np.random.default_rng(1)
    for _ in range(2):
        # Along a direction that the constraints leave free (to first order), then back onto them.
        kernel = rng.standard_normal(n)
        kernel += tied.least(G @ kernel)
        kernel /= max(1.0, max_norm(kernel))
        near = onto_positions(equations, t, q + 1e-2 * W @ kernel, p, tolerance=1e-12, most=20)
        M_near, G_near, phi_near = at(near)
        if np.isfinite(near).all() and max_norm(phi_near) < ASSEMBLED:
            try:
                nearby, level_there, _ = _independent(M_near, G_near, positions)
            except np.linalg.LinAlgError:
                continue  # without inertia, to rounding: it tells nothing of the rank
            singular |= level_there > level
            chosen = nearby if len(nearby) > len(chosen) else chosen
    generic, chosen = n - len(chosen), chosen if singular else at_state
    redundant = tuple(k for k in range(len(rows)) if k not in chosen)
    return Independence(chosen, redundant, n - len(chosen), generic, singular, margin)


def _independent(
    M: Array, G: Array, positions: NDArray[np.bool_]
) -> tuple[tuple[int, ...], int, float]:
    """Rows of G that span its range, in their own order; how many are of positions; what the last one adds.

    Rows of positions go first: of motion rows that say the same as a position's rate, none takes its place,
    so that no drift of positions goes unseen. In either group by QR with column pivoting in the mass
    metric: it takes the row first that is explained least by those taken before, so that a small diagonal
    entry means that *all* rows left are nearly dependent.
    """
    from scipy.linalg import qr, solve_triangular

    scaled = solve_triangular(np.linalg.cholesky(M), without_rounding(G).T, lower=True)
    length = np.linalg.norm(scaled, axis=0)
    present = length > RANK_TOLERANCE * max(1e-300, length.max(initial=0.0))
    scaled = np.where(present, scaled / np.where(present, length, 1.0), 0.0)
    chosen: list[int] = []
    level, margin, basis = 0, 1.0, np.zeros((len(M), 0))
    for group in (positions, ~positions):
        level, own = len(chosen), scaled[:, group]
        for _ in range(2):  # twice is enough: rounding of the first time is of what is left
            own = own - basis @ (basis.T @ own)
        Q, R, order = qr(own, mode="economic", pivoting=True)
        added = np.abs(np.diag(R))
        rank = int((added > RANK_TOLERANCE).sum())
        chosen += np.flatnonzero(group)[order[:rank]].tolist()
        margin = min(margin, float(added[:rank].min(initial=1.0)))
        basis = np.hstack([basis, Q[:, :rank]])
    return tuple(sorted(chosen)), level, margin


def row_names(rows: ConstraintRows, places: Sequence[int]) -> str:
    """ConstraintRows in words: how many of which constraint."""
    counts = Counter(rows.names[k] for k in places)
    return ", ".join(f"{n} of {name!r}" for name, n in counts.items())
