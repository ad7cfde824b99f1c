"""Points of bodies in symbols: place, velocity, and what forces there are to the bodies' links."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import casadi as ca

from deltac.dynamics.recursions import link_velocities
from deltac.dynamics.spatial import SX, cross
from deltac.dynamics.system import System


def rotation(system: System, body: str) -> SX:
    """R of a body frame: body to world components."""
    k = system.index[body]
    if k < 0:
        return ca.SX.eye(3)
    return ca.mtimes(system.poses[k].E.T, system.links[k].to_body.E.T)


@dataclass(frozen=True, eq=False)
class PlacedPoint:
    """A material point of a link (−1: the ground): `own` (3,) in the link frame, or in the world's."""

    system: System
    link: int
    own: SX

    @staticmethod
    def at(system: System, link: int, place: SX) -> PlacedPoint:
        """The point that is at a place (3,) in the world now."""
        if link < 0:
            return PlacedPoint(system, link, place)
        pose = system.poses[link]
        return PlacedPoint(system, link, ca.mtimes(pose.E, place - pose.r))

    @property
    def place(self) -> SX:
        """Where it is (3,), world components, m."""
        if self.link < 0:
            return self.own
        pose = self.system.poses[self.link]
        return pose.r + ca.mtimes(pose.E.T, self.own)

    @property
    def velocity(self) -> SX:
        """Its velocity (3,), world components, m/s."""
        if self.link < 0:
            return ca.SX.zeros(3)
        V = link_velocities(self.system)[self.link]
        return ca.mtimes(self.system.poses[self.link].E.T, V[3:] + cross(V[:3], self.own))


def wrenches(loads: Iterable[tuple[Any, ...]]) -> dict[int, SX]:
    """Force vectors at links (link frames) of loads: (point, force) or (point, force, moment) in the world.

    What acts on the ground is left out.
    """
    total: dict[int, SX] = {}
    for point, force, *moment in loads:
        k = point.link
        if k < 0:
            continue
        E = point.system.poses[k].E
        f = ca.mtimes(E, force)
        n = cross(point.own, f)
        wrench = ca.vertcat(ca.mtimes(E, moment[0]) + n if moment else n, f)
        total[k] = total[k] + wrench if k in total else wrench
    return total
