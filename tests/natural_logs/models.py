"""The machines whose runs the logs hold: a double pendulum of two bodies, and the same in MuJoCo's
language."""

from __future__ import annotations

import deltac as dc

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
