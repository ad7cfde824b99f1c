"""Friction and compliant contact in symbols: the channels of their elements."""

from __future__ import annotations

import casadi as ca

from deltac.dynamics.channel import Channel
from deltac.dynamics.gaps import Gap, all_velocities, gaps
from deltac.dynamics.recursions import gather
from deltac.dynamics.spatial import SX
from deltac.dynamics.system import System
from deltac.mechanism.channels import ChannelName
from deltac.mechanism.contact import Contact
from deltac.mechanism.friction import FrictionLaw, JointFriction, PointFriction

TINY = 1e-8
"""Slip speeds are softened by this part of the width: the direction of no slip is then no 0/0.

The force errs by less than 10⁻¹⁶ of itself above a hundred-millionth of the width.
"""


def joint_friction(system: System, element: JointFriction) -> list[Channel]:
    """−f(|u|) sign u on each speed of the joint."""
    where = system.mechanism.speeds.of(element.joint)
    force = ca.SX.zeros(len(system.mechanism.speeds))
    for k, law in zip(range(where.start, where.stop), element.laws):
        u = system.u_all[k]
        # Odd in u already: tanh changes sign, and the excess is even.
        force[k] = -_strength(system, law, u**2) * ca.tanh(u / system.number(law.width))
        force[k] -= system.number(law.viscous) * u
    return [Channel(ChannelName("friction", element.name), force)]


def point_friction(system: System, element: PointFriction) -> list[Channel]:
    """−N f(|v_t|) v_t/|v_t| at the body's point, its opposite on the body beneath."""
    touch = rubbing_point(system, element)
    velocity = touch.relative_velocity(system, all_velocities(system))
    strength = ca.fmax(system.number(element.normal_force), 0)
    force = _slip_force(system, element.law, strength, touch.n, velocity)
    return [Channel(ChannelName("friction", element.name), touch.generalized(system, force))]


def rubbing_point(system: System, element: PointFriction) -> Gap:
    """Where a point rubs on a plane, as a contact point that is always closed."""
    k, point = system.point(element.body, element.point)
    place = point
    if k >= 0:
        place = system.poses[k].r + ca.mtimes(system.poses[k].E.T, point)
    on = system.index[element.on]
    n = ca.SX(ca.DM(list(element.normal)))
    if on >= 0:
        turned = ca.mtimes(system.poses[on].E.T, system.links[on].to_body.E.T)
        n = ca.mtimes(turned, n)
    return Gap("", ca.SX(0), n, place, place, (k, on))


def contact(system: System, element: Contact) -> list[Channel]:
    """Elastic forces, dissipation and friction at every contact point of a pair of shapes."""
    V = all_velocities(system)
    elastic: dict[int, SX] = {}
    dissipative: dict[int, SX] = {}
    rubbing: dict[int, SX] = {}
    potential = ca.SX(0)
    for gap in gaps(system, element.first, element.second):
        velocity = gap.relative_velocity(system, V)
        energy, f_e, f_n = normal_force(system, element, gap.gap, -ca.dot(gap.n, velocity))
        potential += energy
        _add(elastic, gap.wrenches(system, f_e * gap.n))
        _add(dissipative, gap.wrenches(system, (f_n - f_e) * gap.n))
        if element.friction is not None:
            force = _slip_force(system, element.friction, f_n, gap.n, velocity)
            _add(rubbing, gap.wrenches(system, force))
    made = [Channel(ChannelName("spring", element.name), gather(system, elastic), potential)]
    if not (isinstance(element.dissipation, float) and element.dissipation == 0.0):
        made.append(Channel(ChannelName("contact", element.name), gather(system, dissipative)))
    if element.friction is not None:
        made.append(Channel(ChannelName("friction", element.name), gather(system, rubbing)))
    return made


def normal_force(system: System, element: Contact, gap: SX, closing: SX) -> tuple[SX, SX, SX]:
    """V (J), the elastic force f_e and the normal force f_n >= 0 (N) of a gap that closes at a speed."""
    k, d = system.number(element.stiffness), system.number(element.dissipation)
    touching = gap < 0
    # Powers of an overlap of 0 have no derivative; apart, a value that has one stands in.
    x = ca.if_else(touching, -gap, 1)
    power = _power(system, element.exponent, x)
    n = system.number(element.exponent)
    energy = ca.if_else(touching, k * power * x / (n + 1), 0)
    f_e = ca.if_else(touching, k * power, 0)
    if element.model == "hunt-crossley":
        return energy, f_e, f_e * ca.fmax(1 + d * closing, 0)
    return energy, f_e, ca.if_else(touching, ca.fmax(k * power + d * closing, 0), 0)


def _power(system: System, exponent: object, x: SX) -> SX:
    """xⁿ, continued to x < 0 as x |x|ⁿ⁻¹.

    A solver that looks for the instant of touch tries states beyond it. |x| is √(x² + tiny), which has no
    branch of its own and a derivative everywhere. Half integers go by roots, much faster than a power.
    """
    if isinstance(exponent, float) and exponent == 1.0:
        return x
    square = x * x + 1e-300
    if isinstance(exponent, float) and exponent in (1.5, 2.0):
        root = ca.sqrt(square)
        return x * (ca.sqrt(root) if exponent == 1.5 else root)
    return x * square ** (0.5 * (system.number(exponent) - 1))


def _strength(system: System, law: FrictionLaw, square: SX) -> SX:
    """The strength c + (s − c) e^{−(v/v_S)²} at the squared slip speed."""
    c = system.number(law.coulomb)
    if law.stribeck is None:
        return c
    s = system.number(law.static)
    return c + (s - c) * ca.exp(-square / system.number(law.stribeck) ** 2)


def _slip_force(system: System, law: FrictionLaw, normal_force: SX, n: SX, velocity: SX) -> SX:
    """−N f(|v_t|) v_t/|v_t| (3,), v_t the part of the velocity across n."""
    slip = velocity - ca.dot(n, velocity) * n
    square = ca.dot(slip, slip)
    width = system.number(law.width)
    speed = ca.sqrt(square + (TINY * width) ** 2)
    per_speed = _strength(system, law, square) * ca.tanh(speed / width) / speed
    return -normal_force * (per_speed + system.number(law.viscous)) * slip


def _add(total: dict[int, SX], wrenches: dict[int, SX]) -> None:
    for k, wrench in wrenches.items():
        total[k] = total[k] + wrench if k in total else wrench
