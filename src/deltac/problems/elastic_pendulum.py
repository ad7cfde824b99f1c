"""The elastic pendulum at its resonance: bouncing turns into swinging and back."""

from __future__ import annotations

import numpy as np

from deltac.arrays import Array
from deltac.bodies import frame, point_mass
from deltac.forces import spring_damper
from deltac.joints import prismatic
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import G, Problem, coordinate, energy, instant, instants
from deltac.trajectories import Trajectory

MASS, STIFFNESS, REST = 1.0, 39.24, 0.75  # k = 4 m g/l at the hanging length l = 1 m
START = (0.1, -1.2)
POSITIONS = {
    1.0: (-0.111549626906, -1.196599086874),
    10.0: (0.015278870740, -0.797282431375),
}


def problem() -> Problem:
    """A particle of 1 kg on a spring that bounces twice as fast as it swings, released at rest."""
    mechanism = Mechanism(
        bodies=[frame("carriage"), point_mass("bob", "m")],
        joints=[
            prismatic("x", "ground", "carriage", "x"),
            prismatic("y", "carriage", "bob", "y"),
        ],
        forces=[spring_damper("spring", "ground", "bob", stiffness="k", length="l0")],
        gravity=(0.0, "-g", 0.0),
        parameters={"m": MASS, "g": G, "k": STIFFNESS, "l0": REST},
        name="elastic pendulum",
    )
    stretch = float(np.hypot(*START)) - REST
    start = MASS * G * START[1] + 0.5 * STIFFNESS * stretch**2
    reference = [instant("energy", 10.0, energy(mechanism), start, "J", "exact", 1e-14)]
    position = {axis: coordinate(axis) for axis in "xy"}
    reference += instants(POSITIONS, position, "m", "calculated", 1e-12)
    return Problem(
        name="elastic-pendulum",
        title="Elastic pendulum at 2:1 resonance",
        mechanism=mechanism,
        state=mechanism.state(START),
        duration=10.0,
        step=2e-3,
        solver="ode8",
        source="A. Vitt, G. Gorelik, Oscillations of an elastic pendulum as an example of the "
        "oscillations of two parametrically coupled linear systems, J. Tech. Phys. 3 (1933)",
        invariants={"energy": _energy},
        reference=tuple(reference),
    )


def _energy(run: Trajectory) -> Array:
    kinetic = 0.5 * MASS * (run.u**2).sum(axis=1)
    stretch = np.hypot(*run.q.T) - REST
    total: Array = kinetic + MASS * G * run.q[:, 1] + 0.5 * STIFFNESS * stretch**2
    return total
