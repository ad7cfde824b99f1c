"""The machines whose runs the logs hold: a double pendulum of two bodies (also in MuJoCo's language), a
pendulum, a pole on a cart, and a trunk that floats with one leg."""

from __future__ import annotations

import deltac as dc

STARTS = {
    "arm": (1.1, 0.6),
    "pendulum": (0.8,),
    "cart": (0.1, 1.0),
    "walker": (0.3, -0.2, 1.1, 0.5, -0.1, 0.7, 0.5, 0.4, -0.6),
}
"""Where the coordinates of each start."""

LENGTH, MASS, INERTIA, GRAVITY = 0.5, 1.2, 0.03, 9.81


def arm() -> dc.Mechanism:
    """Two bodies, hinged about z, that swing under gravity along −y."""
    bodies = [
        dc.body(name, mass=MASS, inertia=(INERTIA, 0.001, INERTIA), mass_centre=(0, -LENGTH / 2, 0))
        for name in ("upper", "lower")
    ]
    joints = [
        dc.revolute("shoulder", "ground", "upper"),
        dc.revolute("elbow", "upper", "lower", position=(0, -LENGTH, 0)),
    ]
    return dc.Mechanism(bodies, joints, gravity=(0, -GRAVITY, 0), name="arm")


def pendulum() -> dc.Mechanism:
    """A bob on a rod."""
    bob = dc.point_mass("bob", mass=1.0, at=(0, -0.7, 0))
    pivot = dc.revolute("pivot", "ground", "bob")
    return dc.Mechanism([bob], [pivot], gravity=(0, -GRAVITY, 0), name="pendulum")


def cart() -> dc.Mechanism:
    """A pole on a cart."""
    bodies = [
        dc.body("cart", mass=1.0, inertia=(1e-3, 1e-3, 1e-3)),
        dc.point_mass("pole", mass=0.2, at=(0, -0.5, 0)),
    ]
    joints = [dc.prismatic("slider", "ground", "cart", "x"), dc.revolute("hinge", "cart", "pole")]
    return dc.Mechanism(bodies, joints, gravity=(0, -GRAVITY, 0), name="cart")


def walker() -> dc.Mechanism:
    """A trunk that floats, with a hip and a knee."""
    bodies = [
        dc.body("trunk", mass=8.0, inertia=(0.1, 0.25, 0.3)),
        dc.body("thigh", mass=1.0, inertia=(0.01, 0.01, 0.002), mass_centre=(0, 0, -0.1)),
        dc.body("shank", mass=0.5, inertia=(0.005, 0.005, 0.001), mass_centre=(0, 0, -0.1)),
    ]
    joints = [
        dc.free("floating", "trunk"),
        dc.revolute("hip", "trunk", "thigh", "y", position=(0, 0.1, -0.05)),
        dc.revolute("knee", "thigh", "shank", "y", position=(0, 0, -0.2)),
    ]
    return dc.Mechanism(bodies, joints, gravity=(0, 0, -GRAVITY), name="walker")
