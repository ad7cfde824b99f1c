"""What an impact does: impulses of contacts, through the mass matrix and the constraints.

Without friction: Newton's restitution, all contacts that touch at once as one complementarity problem
(J. J. Moreau, Unilateral contact and dry friction in finite freedom dynamics, 1988), which makes no energy
where their restitutions agree. Otherwise, or where that would make some, one contact after the other, the
fastest approach first. A contact with friction follows E. J. Routh and J. B. Keller (Impact with friction,
J. Appl. Mech. 53 (1986) 1-4): the normal impulse grows from zero, slip and stick change on the way, and
the impact ends by W. J. Stronge's energetic restitution (Rigid body collisions with friction, Proc. R.
Soc. A 431 (1990) 169-181): normal work of restitution = −e² that of compression. Newton's ratio of speeds
would make energy where the slip reverses (T. R. Kane, Stanford Mechanics Alumni Newsletter, 1984);
Stronge's never does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deltac.errors import DeltacError

Array = NDArray[np.float64]
REST = 1e-13
"""Speeds below this fraction of the first approach are rounding."""

MOST_IMPACTS = 2000
TURN = 2e-3
"""Largest turn (rad) of the slip in one piece of an impact."""


@dataclass(frozen=True)
class Contact:
    """A contact that may receive an impulse, in free speeds u (n,): approach speed v_n = `normal`·u + `drift`.

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
        return np.append(self.drift, self.tangent_drift) if self.friction else np.array([self.drift])


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


def collide(W: Array, v: Array, e: float, mu: float) -> Array:
    """The impulse of one contact: normal first, then two tangents if there is friction.

    Args:
        W: (1, 1) or (3, 3), relative velocity gained by unit impulse.
        v: relative velocity before, the approach v[0] < 0.
        e: Stronge's restitution; mu: Coulomb's friction.
    """
    if len(v) == 1 or mu == 0.0:
        impulse = np.zeros(len(v))
        impulse[0] = -(1.0 + e) * v[0] / W[0, 0]
        return impulse
    scale = float(np.abs(v).max())
    v, impulse = v.copy(), np.zeros(3)
    compressed = restored = 0.0  # normal works, both positive
    compressing = True
    for _ in range(200_000):
        force, straight = _force(W, v, mu, scale)
        rate = W @ force
        slip = float(np.hypot(v[1], v[2]))
        if compressing:
            length = -v[0] / rate[0] if rate[0] > 0.0 else np.inf
        else:
            length = _until(v[0], rate[0], e * e * compressed - restored)
        last = True
        if slip > REST * scale:
            along = float(rate[1:] @ v[1:]) / slip
            stops = -slip / along if along < 0.0 and straight else np.inf
            if not straight:
                across = float(np.hypot(*(rate[1:] - along * v[1:] / slip)))
                stops = TURN * slip / max(across, abs(along))
            if stops < length:
                length, last = stops, False
        if not np.isfinite(length):
            raise DeltacError(
                "an impact with friction jams: its normal speed is not brought to zero; lower the friction"
            )
        if not straight:  # the force at the middle of the piece
            middle, _ = _force(W, v + 0.5 * length * rate, mu, scale)
            rate = W @ middle
            force = middle
        work = length * (v[0] + 0.5 * length * rate[0])
        v = v + length * rate
        impulse = impulse + length * force
        if not last and straight:
            v[1:] = 0.0
        if compressing:
            compressed -= work
        else:
            restored += work
        if last and straight or (compressing and v[0] >= 0.0) or _over(
            compressing, restored, e * e * compressed
        ):
            if compressing and v[0] >= -REST * scale:
                compressing = False
                v[0] = max(v[0], 0.0)
                if e == 0.0:
                    return impulse
            elif not compressing:
                return impulse
    raise DeltacError("an impact with friction comes to no end; its slip turns too often")


def _over(compressing: bool, restored: float, wanted: float) -> bool:
    return not compressing and restored >= wanted * (1.0 - 1e-12)


def _until(v: float, rate: float, work: float) -> float:
    """How much impulse does that work at normal speed v + rate p; until the speed vanishes if none does."""
    root = v * v + 2.0 * rate * max(work, 0.0)
    if root <= 0.0:
        return -v / rate if rate < 0.0 else 0.0
    return 2.0 * max(work, 0.0) / (v + float(np.sqrt(root))) if v + np.sqrt(root) > 0.0 else 0.0


def _force(W: Array, v: Array, mu: float, scale: float) -> tuple[Array, bool]:
    """Impulse per normal impulse, and whether the slip keeps its direction under it."""
    slip = float(np.hypot(v[1], v[2]))
    if slip > REST * scale:
        d = v[1:] / slip
        force = np.array([1.0, -mu * d[0], -mu * d[1]])
        rate = (W @ force)[1:]
        across = rate - (rate @ d) * d
        return force, bool(np.hypot(*across) <= 1e-12 * float(np.abs(W).max()))
    stick = np.linalg.solve(W[1:, 1:], -W[1:, 0])
    grip = float(np.hypot(*stick))
    if grip <= mu:
        return np.array([1.0, *stick]), True
    # Slip begins against the force that would hold, in the direction that it then keeps.
    d = -stick / grip
    for _ in range(100):
        pulled = W[1:, 0] - mu * W[1:, 1:] @ d
        d = pulled / float(np.hypot(*pulled))
    return np.array([1.0, -mu * d[0], -mu * d[1]]), True
