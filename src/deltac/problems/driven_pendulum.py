"""A pendulum whose pivot is shaken up and down: prescribed motion that feeds and drains energy."""

from __future__ import annotations

import math

from deltac.bodies import frame, point_mass
from deltac.joints import prismatic, revolute
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import Problem, coordinate, instant

ANGLES = {1.0: 3.398461709635, 5.0: 11.697030464488}


def problem() -> Problem:
    """A particle on a massless rod of 1 m, almost upright; the pivot moves by 0.05 sin 60t (m)."""
    mechanism = Mechanism(
        bodies=[frame("slider"), point_mass("bob", "m", at=(0.0, "-l", 0.0))],
        joints=[
            prismatic("shaker", "ground", "slider", "y", motion="A*sin(w*t)"),
            revolute("pivot", "slider", "bob"),
        ],
        gravity=(0.0, "-g", 0.0),
        parameters={"m": 1.0, "l": 1.0, "g": 9.81, "A": 0.05, "w": 60.0},
        name="driven pendulum",
    )
    return Problem(
        name="driven-pendulum",
        title="Pendulum with a vertically driven pivot",
        mechanism=mechanism,
        state=mechanism.state({"pivot": math.pi - 0.2}),
        duration=5.0,
        step=1e-3,
        solver="ode8",
        source="A. Stephenson, On induced stability, Phil. Mag. 15 (1908); P. L. Kapitza 1951",
        reference=tuple(
            instant("angle", t, coordinate("pivot"), angle, "rad", "calculated", 1e-11)
            for t, angle in ANGLES.items()
        ),
        notes="The angle is measured from the downward vertical. At the start the pivot moves at "
        "3 m/s, so the kinetic energy is 4.5 J while the rod does not turn. (A ω)² = 9 is below "
        "2 g l = 19.6, so the upright position is not stable yet and the pendulum falls.",
    )
