"""A leaning disc rolls on a plane that is shaken to and fro."""

from __future__ import annotations

import math

import numpy as np

from deltac.arrays import Array
from deltac.bodies import disc
from deltac.constraints import rolling
from deltac.joints import free
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import G, Problem, coordinate, energy, instant, instants, speed, work
from deltac.trajectories import Trajectory

MASS, RADIUS, SPIN, LEAN = 1.0, 0.2, 10.0, 0.2
SHAKE, BEAT = 0.1, 5.0
POSITIONS = {
    1.0: (2.146861319021, -0.745602323604, 0.194432622053),
    3.0: (3.365951239995, -4.931208675435, 0.196593584328),
}
WORK = {1.0: (0.057644107428,), 3.0: (-0.140762999189,)}


def problem(lean: float = LEAN) -> Problem:
    """A disc of 1 kg and 0.2 m that spins at 10 rad/s; the plane moves by 0.1 sin 5t (m) along x.

    Args:
        lean: of the disc at the start, from the vertical (rad); an upright disc stays upright.
    """
    mechanism = Mechanism(
        bodies=[disc("disc", "m", "r", axis="y")],
        joints=[free("motion", "disc")],
        constraints=[
            rolling("contact", "disc", "r", axis="y", surface_velocity=("A*w*cos(w*t)", 0.0, 0.0))
        ],
        gravity=(0.0, 0.0, "-g"),
        parameters={"m": MASS, "r": RADIUS, "g": G, "A": SHAKE, "w": BEAT},
        name="disc on a moving plane",
    )
    start = SHAKE * BEAT + RADIUS * SPIN
    total = 0.5 * MASS * start**2 + 0.25 * MASS * RADIUS**2 * SPIN**2
    total += MASS * G * RADIUS * math.cos(lean)
    reference = [instant("energy", 0.0, energy(mechanism), total, "J", "exact", 1e-14)]
    if lean == 0.0:
        for t in POSITIONS:
            v = start + SHAKE * BEAT * (math.cos(BEAT * t) - 1) / 3
            reference.append(instant("velocity", t, speed("motion.vx"), v, "m/s", "exact", 1e-14))
    elif lean == LEAN:
        position = {axis: coordinate(f"motion.{axis}") for axis in "xyz"}
        reference += instants(POSITIONS, position, "m", "calculated", 1e-11)
        done = {"work of the plane": work(mechanism, "constraint contact")}
        reference += instants(WORK, done, "J", "calculated", 1e-11)
    return Problem(
        name="disc-on-moving-plane",
        title="Disc rolling on a shaken plane",
        mechanism=mechanism,
        state=mechanism.state(
            {
                "motion.z": RADIUS * math.cos(lean),
                "motion.qw": math.cos(lean / 2),
                "motion.qx": math.sin(lean / 2),
            },
            {"motion.vx": start, "motion.wy": SPIN},
        ),
        duration=3.0,
        step=1e-3,
        solver="ode8",
        source="Ju. I. Neimark, N. A. Fufaev, Dynamics of Nonholonomic Systems, chapter III (the disc); "
        "the plane's motion is added",
        freedom=3,
        invariants={"lowest point": _lowest},
        reference=tuple(reference),
        notes="In the plane's own frame gravity is inclined by the plane's acceleration. An upright disc "
        "takes a third of the plane's velocity.",
    )


def _lowest(run: Trajectory) -> Array:
    """Height of the disc's lowest point (m): centre less r times the sine of the axis' polar angle."""
    w, x, y, z = run.q[:, 3:].T
    upward = 2 * (y * z + w * x)
    values: Array = run.coordinate("motion.z") - RADIUS * np.sqrt(1 - upward**2)
    return values
