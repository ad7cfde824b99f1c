"""Mass matrices that are singular: which motions have no kinetic energy, and the error that says so."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import Array
from deltac.dynamics.kkt import LeastSquares, least_squares, mass_rounding
from deltac.errors import ModelError
from deltac.mechanism.mechanism import Mechanism


def unit_diagonal(A: Array) -> tuple[Array, Array]:
    """Symmetric matrices (…, p, p) in units in which their diagonals are 1, and these units (…, p)."""
    size = np.sqrt(np.maximum(np.diagonal(A, axis1=-2, axis2=-1), 0.0))
    size = np.where(size > 0.0, size, 1.0)
    return A / (size[..., :, None] * size[..., None, :]), size


def without_inertia(M: Array) -> NDArray[np.intp]:
    """Speeds that take part in motions without kinetic energy, of one mass matrix (p, p).

    None where it is positive definite by more than rounding, whatever the units of the speeds.
    """
    if not np.isfinite(M).all():
        return np.zeros(0, dtype=np.intp)
    (scaled, _), least = unit_diagonal(M), mass_rounding(len(M))
    if np.linalg.eigvalsh(scaled).min(initial=1.0) > least:
        return np.zeros(0, dtype=np.intp)
    energies, motions = np.linalg.eigh(scaled)
    still = motions[:, energies <= least]
    return np.flatnonzero(np.abs(still).max(axis=1, initial=0.0) > 1e-6)


def singular_inertia(mechanism: Mechanism, M: Array) -> ModelError | None:
    """The error that names speeds and bodies of the first singular mass matrix of M (…, p, p), or None."""
    for one in M.reshape(-1, *M.shape[-2:]) if M.size else ():  # all joints may be prescribed
        if len(places := without_inertia(one)):
            entries = [mechanism.speeds[int(mechanism.free.u[k])] for k in places]
            joints = [mechanism.joint(name) for name in dict.fromkeys(e.joint for e in entries)]
            carried = ", ".join(f"joint {j.name!r}, which carries body {j.child!r}" for j in joints)
            return ModelError(
                f"the mass matrix of {mechanism.name!r} is singular: a motion along "
                f"{', '.join(repr(e.name) for e in entries)} moves no inertia ({carried}), and no constraint "
                "determines it. A slender rod has none about its axis, a point mass none about itself: give "
                "the body that inertia or the joint an armature, take a joint without that freedom, or "
                "determine its coordinates by constraints"
            )
    return None


def regular_least_squares(mechanism: Mechanism, M: Array, G: Array) -> LeastSquares:
    """`least_squares` of the free speeds; ModelError, as `singular_inertia` words it, for a singular M."""
    try:
        return least_squares(M, G)
    except np.linalg.LinAlgError:
        if error := singular_inertia(mechanism, M):
            raise error from None
        raise
