"""Impacts in symbols: where bodies may hit each other, and what the testing functions make of impulses.

Over an impact q stays and u jumps: M Δu = J + D + C, with the generalized impulses of the contacts, of the
drives of prescribed joints, and of the constraints. The work of an impulse is its product with the mean
ū of the speeds before and after, exactly; and P, integrated over the impact, is the same sum of works as
P is of powers (`impulse_terms`).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from deltac.dynamics.coordinates import OwnCoordinates
from deltac.dynamics.recursions import crba
from deltac.dynamics.scene import TracedScene
from deltac.dynamics.spatial import SX
from deltac.dynamics.system import System
from deltac.dynamics.terms import Constrained, Terms, acatastatic
from deltac.mechanism.channels import ChannelName
from deltac.mechanism.events import Impact, JointStop


@dataclass(frozen=True)
class ImpactPoint:
    """A place where an impact may happen.

    `gap` g (m or rad) is negative where the parts overlap; ġ = `normal`·u + `drift`, with the drift of a
    stop that moves. An impulse P (3,; world components) on the first body and its opposite on the second
    has the generalized impulse `push` P (nu by 3), and `n` (3,) is its normal direction; a joint's stop
    has none of them, but its `normal`. `restitution` e and `friction` μ are scalars.
    """

    name: str
    label: str
    gap: SX
    normal: SX
    drift: SX
    n: SX
    push: SX
    restitution: SX
    friction: SX
    sequential: bool = False

    @property
    def channel(self) -> ChannelName:
        """The channel in which its work is booked."""
        return ChannelName("impact", self.name)


def impact_points(system: System) -> tuple[ImpactPoint, ...]:
    """All places where the mechanism's stops and impacts may happen, in an order that never changes."""
    points: list[ImpactPoint] = []
    for happening in system.mechanism.events:
        if isinstance(happening, JointStop):
            points.extend(_stop_points(system, happening))
        elif isinstance(happening, Impact):
            points.extend(_shape_points(system, happening))
    return tuple(points)


def _stop_points(system: System, stop: JointStop) -> list[ImpactPoint]:
    q, along = TracedScene(system).coordinate(stop.coordinate)
    points = []
    for label, sign, limit in (("lower", 1.0, stop.lower), ("upper", -1.0, stop.upper)):
        if limit is None:
            continue
        bound = system.number(limit)
        points.append(
            ImpactPoint(
                stop.name,
                label,
                gap=sign * (q - bound),
                normal=sign * along,
                drift=-sign * ca.jacobian(bound, system.t),
                n=ca.SX.zeros(3),
                push=ca.SX.zeros(len(system.mechanism.speeds), 3),
                restitution=system.number(stop.restitution),
                friction=ca.SX(0),
                sequential=stop.simultaneous == "sequential",
            )
        )
    return points


def _shape_points(system: System, impact: Impact) -> list[ImpactPoint]:
    scene, points = TracedScene(system), []
    for gap in scene.touches(impact.first, impact.second):
        axes = ca.horzsplit(ca.SX.eye(3))
        push = ca.horzcat(*(scene.generalized(gap.loads(axis)) for axis in axes))
        points.append(
            ImpactPoint(
                impact.name,
                gap.label,
                gap=gap.gap,
                normal=ca.mtimes(push, gap.n),
                drift=ca.SX(0),
                n=gap.n,
                push=push,
                restitution=system.number(impact.restitution),
                friction=system.number(impact.friction),
                sequential=impact.simultaneous == "sequential",
            )
        )
    return points


@dataclass(frozen=True)
class Impulses:
    """Symbols of an impact: speeds before and after, and impulses by their origin, (nu,) each."""

    before: SX
    after: SX
    contact: SX
    driving: SX
    constraint: SX

    @staticmethod
    def symbols(size: int) -> Impulses:
        """New symbols for `size` speeds."""
        names = ("before", "after", "contact", "driving", "constraint")
        return Impulses(*(ca.SX.sym(name, size) for name in names))

    def columns(self) -> dict[str, SX]:
        """The symbols by name."""
        return dict(vars(self))


def impulse_terms(
    system: System,
    impulses: Impulses,
    own: OwnCoordinates | None = None,
    constrained: Constrained | None = None,
) -> Terms:
    """The terms of P integrated over an impact (J); the energies are left zero.

    Exact where momentum is kept, M Δu = J + D + C: then a testing function's E jumps by this P.
    """
    u_t = acatastatic(system, own, constrained).u
    mean = 0.5 * (impulses.before + impulses.after)
    work = ca.dot(impulses.contact, mean)
    gained = ca.mtimes(crba(system), impulses.after - impulses.before)
    nothing = ca.SX(0)
    return Terms(
        K2=nothing,
        K1=nothing,
        K0=nothing,
        V=nothing,
        force_power=work,
        nonpotential_power=work,
        transport_power=ca.dot(impulses.contact, u_t),
        inertia_transport=ca.dot(gained, u_t),
        prescribed_power=ca.dot(impulses.driving, mean) + ca.dot(impulses.constraint, u_t),
        correction_power=ca.dot(impulses.constraint, mean - u_t),
        rate_1990=nothing,
        rate_1988=nothing,
    )
