"""An impact of a run: from the state before to the state after, with every impulse and what it feeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from deltac.arrays import Array
from deltac.dynamics.coordinates import OwnCoordinates
from deltac.dynamics.impacts import ImpactPoint, Impulses, impulse_terms
from deltac.dynamics.recursions import crba
from deltac.dynamics.spatial import SX
from deltac.dynamics.testing_functions import testing_functions
from deltac.simulation.events.impact_law import Contact, Inertia, resolve
from deltac.simulation.flow import Flow


@dataclass(frozen=True, eq=False)
class Collider:
    """Impacts of a mechanism at a state of its flow."""

    flow: Flow
    points: tuple[ImpactPoint, ...]
    _at: ca.Function
    _fed: ca.Function

    @staticmethod
    def of(flow: Flow, points: tuple[ImpactPoint, ...], split: OwnCoordinates | None) -> Collider:
        """Write out what impacts need; `split` as for the testing functions of the flow."""
        system, bound = flow.system, flow.bound
        none = ca.SX.zeros(0, len(system.mechanism.speeds))
        outputs: list[SX] = [
            crba(system),
            none if bound is None else bound.rows.G_all,
            system.u_all,
        ]
        for point in points:
            outputs += [point.normal, point.drift, point.n, point.push]
            outputs += [point.restitution, point.friction]
        here = [flow.t, flow.x, flow.p]
        impulses = Impulses.symbols(len(system.mechanism.speeds))
        known = impulse_terms(system, impulses, split, bound)
        functions = testing_functions(flow.testing)
        fed = ca.vertcat(ca.SX(0, 1), *(function.P(known) for function in functions))
        columns = list(impulses.columns().values())
        return Collider(
            flow,
            points,
            ca.Function("impact", here, outputs),
            ca.Function("fed", [*here, *columns], [fed]),
        )

    def collide(
        self, touching: Sequence[int], t: float, x: Array, p: Array
    ) -> tuple[Array, dict[str, Array]]:
        """The state after an impact of the points that touch, and the impulses by channel."""
        system, bound = self.flow.system, self.flow.bound
        free = system.free_u
        M, G_all, u_all, *rest = (np.array(value) for value in self._at(t, x, p))
        u_all = u_all.ravel()
        inertia = Inertia(M[np.ix_(free, free)], G_all[:, free])
        numbers = [rest[6 * k : 6 * k + 6] for k in touching]
        frames = [
            _directions(n.ravel(), push, normal.ravel()) for normal, _, n, push, _, _ in numbers
        ]
        contacts = []
        for rows, (_, drift, _, _, e, mu) in zip(frames, numbers):
            # What prescribed joints give the contact belongs to its drift.
            drifts = rows @ u_all - rows[:, free] @ u_all[free]
            drifts[0] += float(drift.item())
            contacts.append(
                Contact(
                    rows[0, free],
                    float(drifts[0]),
                    rows[1:, free],
                    drifts[1:],
                    float(e.item()),
                    float(mu.item()) if len(rows) > 1 else 0.0,
                )
            )
        found = resolve(inertia, contacts, u_all[free])
        impulses: dict[str, Array] = {}
        total = np.zeros(len(u_all))
        for k, rows, impulse in zip(touching, frames, found):
            pushed = rows[: len(impulse)].T @ impulse
            total += pushed
            channel = self.points[k].channel
            impulses[channel] = impulses.get(channel, 0.0) + pushed
        change = np.zeros(len(u_all))
        change[free] = inertia.response(total[free])
        tied = np.zeros(len(u_all))
        if bound is not None:
            needed = M[np.ix_(free, free)] @ change[free] - total[free]
            multipliers = np.linalg.lstsq(G_all[:, free].T, needed, rcond=None)[0]
            for name in dict.fromkeys(bound.rows.names):
                places = bound.rows.places(name)
                impulses[f"constraint {name}"] = G_all[places].T @ multipliers[places]
                tied += impulses[f"constraint {name}"]
        driving = np.zeros(len(u_all))
        driven = system.driven_u
        driving[driven] = (M @ change - total - tied)[driven]
        for joint in system.mechanism.joints:
            if joint.prescribed:
                place = system.mechanism.speeds.of(joint.name)
                impulses[f"prescribed {joint.name}"] = _only(driving, place)
        after = x.copy()
        _, u_part, _ = self.flow.parts
        after[u_part] += change[free]
        after[self._integrals] += self._fed_by(t, x, p, u_all, change, total, driving, tied)
        return after, impulses

    @property
    def _integrals(self) -> slice:
        """Where the testing functions' integrals lie in x."""
        start = self.flow.parts[2].start
        return slice(start, start + len(self.flow.testing))

    def _fed_by(
        self,
        t: float,
        x: Array,
        p: Array,
        u: Array,
        change: Array,
        contact: Array,
        driving: Array,
        tied: Array,
    ) -> Array:
        fed = self._fed(t, x, p, u, u + change, contact, driving, tied)
        return np.array(fed).ravel()


def _directions(n: Array, push: Array, normal: Array) -> Array:
    """Rows (1 or 3 by nu): the normal, and two tangents where there is a surface."""
    if not n.any():
        return normal[None, :]
    first = np.cross(n, np.eye(3)[int(np.argmin(np.abs(n)))])
    first /= np.linalg.norm(first)
    frame = np.array([n, first, np.cross(n, first)])
    return frame @ push.T


def _only(vector: Array, place: slice) -> Array:
    kept = np.zeros_like(vector)
    kept[place] = vector[place]
    return kept
