"""States brought onto their constraints: the nearest in the mass metric, at one state or at many at once.

Coordinates by damped Newton steps Δq = W δ, G δ = −φ, speeds by the linear G δ = −ψ; in both, δ is the
least change of speeds in the mass metric, found by least squares, so that redundant rows do no harm.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deltac.arrays import ASSEMBLED, EPS, NEWTON_STEPS, ROOT_EPS, Array
from deltac.dynamics.equations_of_motion import EquationsOfMotion
from deltac.dynamics.kkt import least_squares

Mask: TypeAlias = NDArray[np.bool_]

AT_ROUNDING = 4 * EPS
"""Newton's steps go on until the violation (m or rad) is below this, or falls no more."""


def onto_positions(
    equations: EquationsOfMotion,
    t: ArrayLike,
    q: Array,
    p: ArrayLike = (),
    *,
    movable: Mask | None = None,
    dependent: float = 1e-8,
    tolerance: float = AT_ROUNDING,
    most: int = NEWTON_STEPS,
    further: Callable[[Array], tuple[Array, Array]] | None = None,
) -> Array:
    """Coordinates with φ = 0 near `q`, (nq,) or (nq, B); some may not arrive: look at φ.

    Args:
        equations: of the mechanism.
        t: time, or times (B,).
        q: free coordinates.
        p: values of the parameters that the equations keep symbolic.
        movable: speeds (p,) whose directions may move; all by default.
        dependent: share of a row below which it counts as redundant (`least_squares`).
        tolerance: violation (m or rad) at which a state is left alone.
        most: Newton steps at most.
        further: values (k, B) at coordinates (nq, B) that are to vanish too, and their slopes (B, k, p) by
            the speeds.
    """
    rows = np.array(equations.rows.holonomic, dtype=bool)
    if not rows.any() and further is None:
        return q.copy()
    single, q = q.ndim == 1, np.array(q[:, None] if q.ndim == 1 else q, dtype=float)
    still = np.zeros((len(equations.system.free_u), q.shape[1]))
    mobile = np.ones(len(still), dtype=bool) if movable is None else movable

    def at(q: Array) -> tuple[Array, Array, Array, Array, Array]:
        with np.errstate(all="ignore"):
            M, phi, _, G, W = equations.ties(t, q, still, p)
            phi, G = phi[rows], G[:, rows]
            if further is not None:
                values, slopes = further(q)
                phi, G = np.concatenate([phi, values]), np.concatenate([G, slopes], axis=1)
            return M, phi, G, W, np.abs(phi).max(axis=0)

    M, phi, G, W, size = at(q)
    active = size > tolerance
    for _ in range(most):
        if not active.any():
            break
        delta = _least(M, G, phi, mobile, active, dependent)
        step = np.einsum("bij,jb->ib", W, delta)
        share = np.ones(q.shape[1])
        while True:
            trial = _unit(equations, q + share * step)
            terms = at(trial)
            short = active & ~(terms[-1] < (1.0 - 0.1 * share) * size)
            short &= (share >= ROOT_EPS) & (size > ASSEMBLED)
            if not short.any():
                break
            share[short] *= 0.5
        took = active & (terms[-1] < size)
        q[:, took] = trial[:, took]
        M[took], G[took], W[took] = terms[0][took], terms[2][took], terms[3][took]
        phi[:, took], size = terms[1][:, took], np.where(took, terms[-1], size)
        active = took & (size > tolerance)
    return q[:, 0] if single else q


def onto_speeds(
    equations: EquationsOfMotion,
    t: ArrayLike,
    q: Array,
    u: Array,
    p: ArrayLike = (),
    *,
    movable: Mask | None = None,
    dependent: float = 1e-8,
    passes: int = 3,
) -> Array:
    """Speeds with ψ = 0 at `q`, nearest to `u` in the mass metric; arguments as for `onto_positions`.

    One pass solves the linear equation; the others remove its rounding.
    """
    if not len(equations.rows):
        return u.copy()
    single, u = u.ndim == 1, np.array(u[:, None] if u.ndim == 1 else u, dtype=float)
    q = q[:, None] if q.ndim == 1 else q
    mobile = np.ones(len(u), dtype=bool) if movable is None else movable
    everywhere = np.ones(u.shape[1], dtype=bool)
    for _ in range(passes):
        M, _, psi, G, _ = equations.ties(t, q, u, p)
        u = u + _least(M, G, psi, mobile, everywhere, dependent)
    return u[:, 0] if single else u


def _least(
    M: Array, G: Array, violation: Array, mobile: Mask, active: Mask, dependent: float
) -> Array:
    """The least change (p, B) of the moving speeds that removes a violation (nc, B) at active states."""
    change = np.zeros((len(mobile), len(active)))
    usable = active & np.isfinite(M).all(axis=(1, 2)) & np.isfinite(G).all(axis=(1, 2))
    usable &= np.isfinite(violation).all(axis=0)
    if usable.any() and mobile.any():
        at = np.flatnonzero(usable)
        inertia = M[at][:, mobile][:, :, mobile]
        rows, error = G[at][:, :, mobile], violation[:, at].T
        try:
            change[np.ix_(mobile, at)] = least_squares(inertia, rows, dependent).least(error).T
        except np.linalg.LinAlgError:  # a mass matrix among them is singular: that state stays
            for k, place in enumerate(at):
                with suppress(np.linalg.LinAlgError):
                    steps = least_squares(inertia[k], rows[k], dependent)
                    change[mobile, place] = steps.least(error[k])
    return change


def _unit(equations: EquationsOfMotion, q: Array) -> Array:
    """Coordinates (nq, B) whose quaternions are of unit length."""
    for place in equations.quaternions:
        q[place] /= np.linalg.norm(q[place], axis=0)
    return q
