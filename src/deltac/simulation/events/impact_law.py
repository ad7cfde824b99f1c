"""What an impact does: impulses of contacts, through the mass matrix and the constraints.

Without friction: Newton's restitution, all contacts that touch at once as one complementarity problem
(J. J. Moreau, Unilateral contact and dry friction in finite freedom dynamics, 1988), which makes no energy
where their restitutions agree. Otherwise, or where that would make some, one contact after the other, the
fastest approach first; a contact with friction by `rubbing`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deltac.arrays import Array
from deltac.errors import DeltacError
from deltac.simulation.events.rubbing import REST, collide

MOST_IMPACTS = 2000
"""Impacts of single contacts at one instant, before the rest of them is taken as plastic."""


@dataclass(frozen=True)
class Contact:
    """A contact that may receive an impulse; its normal speed is `normal`·u + `drift`, of free speeds u (n,).

    `tangents` (2 by n) and `tangent_drift` (2,) give the slip; empty rows for a stop. The first direction of
    a contact is its normal.
    """

    normal: Array
    drift: float
    tangents: Array
    tangent_drift: Array
    restitution: float
    friction: float

    @property
    def rows(self) -> Array:
        """Directions (1 or 3 by n)."""
        return np.vstack([self.normal, self.tangents]) if self.friction else self.normal[None, :]

    @property
    def drifts(self) -> Array:
        """Relative velocity of the contact at u = 0, by direction."""
        return (
            np.append(self.drift, self.tangent_drift) if self.friction else np.array([self.drift])
        )


class Inertia:
    """M⁻¹ of a mechanism whose constraints, G Δu = 0, are kept: A = RᵀR."""

    def __init__(self, M: Array, G: Array) -> None:
        """`M` (n, n) of the free speeds, `G` (nc, n) independent rows."""
        root = np.linalg.cholesky(M)
        R = np.linalg.solve(root, np.eye(len(M)))
        if len(G):
            basis, _ = np.linalg.qr(R @ G.T)
            R = R - basis @ (basis.T @ R)
        self.R = R

    def response(self, impulse: Array) -> Array:
        """Δu of a generalized impulse (n,)."""
        return self.R.T @ (self.R @ impulse)


def resolve(inertia: Inertia, contacts: Sequence[Contact], u: Array) -> list[Array]:
    """Impulses of the contacts by direction (1 or 3 each), so that none approaches any more."""
    smooth = all(not contact.friction for contact in contacts)
    if smooth:
        found = _together(inertia, contacts, u)
        if found is not None:
            return found
    return _one_by_one(inertia, contacts, u)


def _together(inertia: Inertia, contacts: Sequence[Contact], u: Array) -> list[Array] | None:
    """Newton's law for all contacts at once; None where it would make energy that no e > 1 asked for."""
    from scipy.optimize import nnls

    N = np.array([contact.normal for contact in contacts])
    v = N @ u + np.array([contact.drift for contact in contacts])
    e = np.array([contact.restitution for contact in contacts])
    C = inertia.R @ N.T
    wanted = v + e * np.minimum(v, 0.0)
    if len(contacts) == 1:
        return [np.array([max(0.0, -wanted[0] / float(C[:, 0] @ C[:, 0]))])]
    c = np.linalg.lstsq(C.T, wanted, rcond=None)[0]
    p, _ = nnls(C, -c)
    after = v + C.T @ (C @ p)
    made = float(p @ (0.5 * (v + after)))
    size = float(p @ np.abs(v)) + np.finfo(float).tiny
    if (e <= 1.0).all() and (made > 1e-12 * size or (after < -1e-9 * np.abs(v).max()).any()):
        return None
    return [np.array([value]) for value in p]


def _one_by_one(inertia: Inertia, contacts: Sequence[Contact], u: Array) -> list[Array]:
    total = [np.zeros(len(contact.rows)) for contact in contacts]
    u = u.copy()
    approach = [float(c.normal @ u + c.drift) for c in contacts]
    scale = max(abs(v) for v in approach)
    for _ in range(MOST_IMPACTS):
        approach = [float(c.normal @ u + c.drift) for c in contacts]
        k = int(np.argmin(approach))
        if approach[k] >= -REST * scale:
            return total
        contact = contacts[k]
        D = contact.rows
        C = inertia.R @ D.T
        impulse = collide(C.T @ C, D @ u + contact.drifts, contact.restitution, contact.friction)
        total[k] += impulse
        u = u + inertia.R.T @ (C @ impulse)
    # What is left after so many is a plastic impact of all at once.
    plastic = [Contact(c.normal, c.drift, c.tangents, c.tangent_drift, 0.0, 0.0) for c in contacts]
    rest = _together(inertia, plastic, u)
    if rest is None:
        raise DeltacError(f"the impacts of {len(contacts)} contacts at once come to no end")
    for k, impulse in enumerate(rest):
        total[k][0] += impulse[0]
    return total
