"""What forces of the textbook are: channels of forces at mass centres, and what they depend on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from deltac.mechanism.joints import Joint
from deltac.mechanism.laws import evaluate
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.scope import GROUND
from tests.oracles.textbook.kinematics import Array, Tree, numbers


@dataclass(frozen=True)
class ChannelForce:
    """One channel: `F` (rows of the stacked F), and its potential energy (J) if it has one.

    `explicit` (W) is the power ∂V/∂t of a potential whose law depends on time.
    """

    name: str
    F: Array
    potential: float | None = None
    explicit: float = 0.0


@dataclass(frozen=True)
class Situation:
    """What forces depend on: the mechanism at (t, q, u), its bodies, and values of motors by name."""

    mechanism: Mechanism
    t: float
    q: Array
    u: Array
    tree: Tree
    inputs: Mapping[str, Sequence[float]]

    @property
    def known(self) -> dict[str, float]:
        """Values of the symbols that laws use."""
        m = self.mechanism
        q = {f"q.{e.name}": float(self.q[e.index]) for e in m.coordinates}
        u = {f"u.{e.name}": float(self.u[e.index]) for e in m.speeds}
        return {**m.parameters, "t": self.t, **q, **u}

    def values(self, laws: Sequence[Any]) -> Array:
        """The laws' values now."""
        known = self.known
        return np.array([evaluate(law, known) for law in laws])

    def place(self, body: str, point: Sequence[Any]) -> Array:
        """Where a point of a body is."""
        return self.tree.frames[body].place(numbers(self.mechanism, point))

    def velocity(self, body: str, place: Array) -> Array:
        """Velocity of the body's point at `place`."""
        velocity: Array = self.tree.frames[body].partial_velocity(place) @ self.u
        return velocity

    def stack(self, acting: Sequence[tuple[str, Array, Array, Array]]) -> Array:
        """F of (body, place, force, moment), world components, all acting together.

        Six rows a body: force at the mass centre (world), moment (body components); then a zero for
        each speed, where a rotor's inertia torque stands in F*.
        """
        m = self.mechanism
        F = np.zeros(6 * len(m.bodies) + len(m.speeds))
        rows = {body.name: 6 * k for k, body in enumerate(m.bodies)}
        for body, place, force, moment in acting:
            if body == GROUND:
                continue
            centre = self.place(body, m.body(body).mass_centre)
            about_centre = moment + np.cross(place - centre, force)
            k = rows[body]
            F[k : k + 3] += force
            F[k + 3 : k + 6] += self.tree.frames[body].turned.T @ about_centre
        return F


def between(now: Situation, joint: Joint, tau: Array) -> Array:
    """F of a joint's generalized forces `tau` (n,): equal and opposite on child and parent.

    Among the wrenches at the joint that do the power τ·u this is the smallest in the joint's own
    directions; any other differs from it by an ideal reaction, which does no work.
    """
    hinge, G_v, G_w = now.tree.moved[joint.name]
    G = np.vstack([G_v, G_w])
    wrench = G @ np.linalg.solve(G.T @ G, tau)
    force, moment = wrench[:3], wrench[3:]
    return now.stack([(joint.child, hinge, force, moment), (joint.parent, hinge, -force, -moment)])
