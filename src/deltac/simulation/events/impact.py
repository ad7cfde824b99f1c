"""Impacts: from the state before to the state after, with every impulse and what it feeds.

Impulses go through the mass matrix and the constraints. Without friction: Newton's restitution, all contacts
that touch at once as one complementarity problem (J. J. Moreau, Unilateral contact and dry friction in finite
freedom dynamics, 1988), which makes no energy where their restitutions agree. Otherwise, where that would
make some, or where it is asked for, one contact after the other, the fastest approach first (C. Glocker, U.
Aeberhard, The geometry of Newton's cradle, 2006, compare both); a contact with friction by `stronge`. Which
law is right depends on how stiff the contacts are, and no rigid body has that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from deltac.arrays import ENDLESS, TINY, Array
from deltac.dynamics.constraints import ConstraintRows
from deltac.dynamics.coordinates import OwnCoordinates
from deltac.dynamics.equations_of_motion import equations_of
from deltac.dynamics.impacts import ImpactPoint, Impulses, impulse_terms
from deltac.dynamics.spatial import SX
from deltac.dynamics.testing_functions import testing_functions
from deltac.errors import DeltacError
from deltac.mechanism.channels import ChannelName
from deltac.mechanism.events import Simultaneous
from deltac.simulation.events.stronge import REST, collide
from deltac.simulation.flow import StateFlow


@dataclass(frozen=True)
class TouchingContact:
    """A contact that may receive an impulse; its normal speed is `normal`·u + `drift`, of free speeds u (n,).

    `tangents` (2 by n) and `tangent_drift` (2,) give the slip; empty rows for a stop. The first direction of
    a contact is its normal. `sequential` asks for one impact after the other.
    """

    normal: Array
    drift: float
    tangents: Array
    tangent_drift: Array
    restitution: float
    friction: float
    sequential: bool = False

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


class ContactInertia:
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


def resolve(
    inertia: ContactInertia, contacts: Sequence[TouchingContact], u: Array
) -> tuple[list[Array], Simultaneous]:
    """Impulses of the contacts by direction (1 or 3 each), so that none approaches any more; by which law."""
    if not any(contact.friction or contact.sequential for contact in contacts):
        impulses = _together(inertia, contacts, u)
        if impulses is not None:
            return impulses, "moreau"
    return _one_by_one(inertia, contacts, u), "sequential"


def _together(
    inertia: ContactInertia, contacts: Sequence[TouchingContact], u: Array
) -> list[Array] | None:
    """Newton's law for all contacts at once; None where it would make energy that no e > 1 asked for."""
    from scipy.optimize import nnls

    N = np.array([contact.normal for contact in contacts])
    v = N @ u + np.array([contact.drift for contact in contacts])
    e = np.array([contact.restitution for contact in contacts])
    C = inertia.R @ N.T
    target = v + e * np.minimum(v, 0.0)
    if len(contacts) == 1:
        return [np.array([max(0.0, -target[0] / float(C[:, 0] @ C[:, 0]))])]
    c = np.linalg.lstsq(C.T, target, rcond=None)[0]
    p, _ = nnls(C, -c)
    after = v + C.T @ (C @ p)
    work = float(p @ (0.5 * (v + after)))
    size = float(p @ np.abs(v)) + TINY
    if (e <= 1.0).all() and (work > 1e-12 * size or (after < -1e-9 * np.abs(v).max()).any()):
        return None
    return [np.array([value]) for value in p]


def _one_by_one(
    inertia: ContactInertia, contacts: Sequence[TouchingContact], u: Array
) -> list[Array]:
    total = [np.zeros(len(contact.rows)) for contact in contacts]
    u = u.copy()
    approach = [float(c.normal @ u + c.drift) for c in contacts]
    scale = max(abs(v) for v in approach)
    for _ in range(ENDLESS):
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
    plastic = [
        TouchingContact(c.normal, c.drift, c.tangents, c.tangent_drift, 0.0, 0.0) for c in contacts
    ]
    rest = _together(inertia, plastic, u)
    if rest is None:
        raise DeltacError(f"the simultaneous impacts at {len(contacts)} contacts do not converge")
    for k, impulse in enumerate(rest):
        total[k][0] += impulse[0]
    return total


@dataclass(frozen=True, eq=False)
class Collider:
    """Impacts of a mechanism at a state of its flow."""

    flow: StateFlow
    points: tuple[ImpactPoint, ...]
    _at: ca.Function
    _fed: ca.Function

    @staticmethod
    def of(
        flow: StateFlow, points: tuple[ImpactPoint, ...], split: OwnCoordinates | None
    ) -> Collider:
        """Write out what impacts need; `split` as for the testing functions of the flow."""
        system, bound = flow.system, flow.bound
        equations, free = equations_of(system), system.free_u
        rows = ConstraintRows.none(system) if bound is None else bound.rows
        M = ca.SX(equations.M_all)
        M[free, free] = equations.completed(rows)[0]
        outputs: list[SX] = [M, rows.G_all, system.u_all]
        for point in points:
            outputs += [point.normal, point.drift, point.n, point.push]
            outputs += [point.restitution, point.friction]
        inputs = [flow.t, flow.x, flow.p]
        impulses = Impulses.symbols(len(system.mechanism.speeds))
        all_terms = impulse_terms(system, impulses, split, bound)
        functions = testing_functions(flow.testing)
        fed = ca.vertcat(ca.SX(0, 1), *(function.P(all_terms) for function in functions))
        columns = list(impulses.columns().values())
        if (own := flow.own) is not None:  # x holds coordinates of their own
            replaced = [system.q, system.u], [own.q, own.u]
            *outputs, fed = ca.substitute([*outputs, fed], *replaced)
        return Collider(
            flow,
            points,
            ca.Function("impact", inputs, outputs),
            ca.Function("fed", [*inputs, *columns], [fed]),
        )

    def collide(
        self, touching: Sequence[int], t: float, x: Array, p: Array
    ) -> tuple[Array, dict[ChannelName, Array], Simultaneous | None]:
        """The state after an impact of the points that touch, and the impulses by channel.

        The law where several received an impulse, which may then be another's by another law; else None.
        """
        system, bound = self.flow.system, self.flow.bound
        free = system.free_u
        M, G_all, u_all, inertia, frames, contacts = self._meeting(touching, t, x, p)
        pushes, law = resolve(inertia, contacts, u_all[free])
        impulses: dict[ChannelName, Array] = {}
        total = np.zeros(len(u_all))
        for k, rows, impulse in zip(touching, frames, pushes):
            pushed = rows[: len(impulse)].T @ impulse
            total += pushed
            channel = self.points[k].channel
            impulses[channel] = impulses.get(channel, np.zeros(len(u_all))) + pushed
        change = np.zeros(len(u_all))
        change[free] = inertia.response(total[free])
        tied = np.zeros(len(u_all))
        if bound is not None:
            needed = M[np.ix_(free, free)] @ change[free] - total[free]
            multipliers = np.linalg.lstsq(G_all[:, free].T, needed, rcond=None)[0]
            for name in dict.fromkeys(bound.rows.names):
                places = bound.rows.places(name)
                reaction = G_all[places].T @ multipliers[places]
                impulses[ChannelName("constraint", name)] = reaction
                tied += reaction
        driving = np.zeros(len(u_all))
        driven = system.driven_u
        driving[driven] = (M @ change - total - tied)[driven]
        for joint in system.mechanism.joints:
            if joint.prescribed:
                place = system.mechanism.speeds.of(joint.name)
                own = impulses[ChannelName("prescribed", joint.name)] = np.zeros(len(u_all))
                own[place] = driving[place]
        after = x.copy()
        _, u_part, _ = self.flow.parts
        after[u_part] += change[free]
        fed = self._fed(t, x, p, u_all, u_all + change, total, driving, tied)
        after[self.flow.tested] += np.array(fed).ravel()
        several = sum(bool(push.any()) for push in pushes) > 1
        return after, impulses, law if several else None

    def _meeting(
        self, touching: Sequence[int], t: float, x: Array, p: Array
    ) -> tuple[Array, Array, Array, ContactInertia, list[Array], list[TouchingContact]]:
        """M, G, u of all joints; what resists impulses; directions and contacts of points that touch."""
        free = self.flow.system.free_u
        M, G_all, u_all, *rest = (np.array(value) for value in self._at(t, x, p))
        u_all = u_all.ravel()
        inertia = ContactInertia(M[np.ix_(free, free)], G_all[:, free])
        numbers = [rest[6 * k : 6 * k + 6] for k in touching]
        frames = [
            _directions(n.ravel(), push, normal.ravel()) for normal, _, n, push, _, _ in numbers
        ]
        contacts = []
        for k, rows, (_, drift, _, _, e, mu) in zip(touching, frames, numbers):
            # What prescribed joints give the contact belongs to its drift.
            drifts = rows @ u_all - rows[:, free] @ u_all[free]
            drifts[0] += float(drift.item())
            contacts.append(
                TouchingContact(
                    rows[0, free],
                    float(drifts[0]),
                    rows[1:, free],
                    drifts[1:],
                    float(e.item()),
                    float(mu.item()) if len(rows) > 1 else 0.0,
                    self.points[k].sequential,
                )
            )
        return M, G_all, u_all, inertia, frames, contacts

    def paradox(self, k: int, t: float, x: Array, p: Array) -> float | None:
        """The friction from which the sliding contact k has no lasting motion (Painlevé 1895), if it is met.

        A normal force N of a contact that slips along s gives its normal the acceleration
        (W_nn − μ W_ns) N. Where that is not positive, no N ≥ 0 keeps the bodies apart, or more than one does.
        """
        _, _, u_all, inertia, _, [contact] = self._meeting([k], t, x, p)
        slip = contact.tangents @ u_all[self.flow.system.free_u] + contact.tangent_drift
        if not contact.friction or not slip.any():
            return None
        along = (slip / np.linalg.norm(slip)) @ contact.tangents
        response = inertia.response(contact.normal)
        normal, skew = float(contact.normal @ response), float(along @ response)
        return normal / skew if normal <= contact.friction * skew else None


def _directions(n: Array, push: Array, normal: Array) -> Array:
    """ConstraintRows (1 or 3 by nu): the normal, and two tangents where there is a surface."""
    if not n.any():
        return normal[None, :]
    first = np.cross(n, np.eye(3)[int(np.argmin(np.abs(n)))])
    first /= np.linalg.norm(first)
    frame = np.array([n, first, np.cross(n, first)])
    return frame @ push.T
