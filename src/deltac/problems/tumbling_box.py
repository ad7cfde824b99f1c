"""A box that tumbles onto a plane and comes to rest by compliant contact with friction."""

from __future__ import annotations

import math

from deltac import shapes
from deltac.bodies import box
from deltac.forces import contact, friction_law
from deltac.joints import free
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import G, Problem, energy, instant, kinetic, whole
from deltac.trajectories import Trajectory

MASS, SIZE = 1.0, (0.3, 0.2, 0.1)
HEIGHT, VELOCITY, SPIN = 0.5, 1.0, (3.0, 6.0, 1.0)
AXIS, ANGLE, STIFFNESS = (1.0, 2.0, 0.5), 0.7, 5e4


def problem() -> Problem:
    """Thrown from 0.5 m, it falls on an edge, turns over and comes to lie on its largest face."""
    mechanism = Mechanism(
        bodies=[box("box", MASS, SIZE)],
        joints=[free("base", "box")],
        forces=[
            contact(
                "floor",
                shapes.box("box", SIZE),
                shapes.half_space(),
                STIFFNESS,
                dissipation=2.0,
                friction=friction_law(0.4, width=0.02),
            )
        ],
        gravity=(0, 0, -G),
        name="tumbling box",
    )
    length = math.hypot(*AXIS)
    turned = [math.sin(ANGLE / 2) * a / length for a in AXIS]
    state = mechanism.state(
        {"base": [0, 0, HEIGHT, math.cos(ANGLE / 2), *turned]},
        {"base": [VELOCITY, 0, 0, *SPIN]},
    )
    # At last the weight rests on four corners of the largest face.
    sunk = MASS * G / (4 * STIFFNESS)
    rest = SIZE[2] / 2 - sunk
    a, b, c = SIZE
    inertia = [
        MASS * (b * b + c * c) / 12,
        MASS * (a * a + c * c) / 12,
        MASS * (a * a + b * b) / 12,
    ]
    start = 0.5 * MASS * VELOCITY**2 + 0.5 * sum(I * w**2 for I, w in zip(inertia, SPIN))
    lost = start + MASS * G * (HEIGHT - rest) - 4 * 0.5 * STIFFNESS * sunk**2

    def dissipated(run: Trajectory) -> float:
        values = energy(mechanism)(run)
        return float(values[0] - values[-1])

    return Problem(
        name="tumbling-box",
        title="Box that tumbles to rest on a plane",
        mechanism=mechanism,
        state=state,
        duration=2.0,
        step=1e-3,
        solver="DOP853",
        tolerance=1e-11,
        source="Hunt and Crossley, J. Appl. Mech. 42 (1975) 440-445, at eight corners, with friction; "
        "at rest: weight on four springs",
        reference=(
            instant(
                "height",
                2.0,
                lambda run: run.coordinate("base.z"),
                rest,
                "m",
                "exact",
                1e-9,
            ),
            instant("kinetic energy", 2.0, kinetic(mechanism), 0.0, "J", "exact", 1e-12),
            whole("energy lost until it lies still", dissipated, lost, "J", "exact", 1e-8),
        ),
        notes="What is lost is heat of 'contact floor' and 'friction floor'; what remains bent is in the "
        "potential 'spring floor'.",
    )
