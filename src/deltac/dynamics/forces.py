"""Forces in symbols: the generalized force, potential and power of every channel."""

from __future__ import annotations

import casadi as ca

from deltac.dynamics.scene import TracedScene
from deltac.dynamics.spatial import SX
from deltac.dynamics.system import System
from deltac.mechanism.channels import Channel, ChannelName


def channels(system: System) -> tuple[Channel, ...]:
    """All channels of the mechanism's forces: gravity first, then the elements in their order.

    The driving forces of prescribed joints are not among them: they follow from the motion.
    """
    return channels_on(TracedScene(system))


def channels_on(scene: TracedScene) -> tuple[Channel, ...]:
    """The same, of forces that are stated on any scene."""
    channels: list[Channel] = []
    # An expression may be zero only by the present values of parameters that vary.
    if any(g != 0.0 for g in scene.system.mechanism.gravity):
        channels.append(_gravity(scene))
    for element in scene.system.mechanism.elements:
        channels.extend(element.channels(scene))
    return tuple(channels)


def total_force(system: System, parts: tuple[Channel, ...]) -> SX:
    """Sum of the generalized forces of channels (nu,)."""
    return sum((part.force for part in parts), start=ca.SX.zeros(len(system.mechanism.speeds)))


def _gravity(scene: TracedScene) -> Channel:
    """V = −Σ m g·x_G; the force m g acts at each mass centre."""
    bodies = [link.joint.child for link in scene.system.links]
    massive = [name for name in bodies if not scene.system.mechanism.body(name).massless]
    loads = [(scene.mass_centre(name), scene.weight(name)) for name in massive]
    potential = -sum((ca.dot(weight, centre.place) for centre, weight in loads), start=ca.SX(0))
    return Channel(ChannelName("gravity"), scene.generalized(loads), potential)
