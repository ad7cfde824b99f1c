"""The spherical pendulum: a particle held by a rod, its height an elliptic function of time."""

from __future__ import annotations

import math

import numpy as np

from deltac.arrays import Array
from deltac.bodies import frame, point_mass
from deltac.constraints import distance
from deltac.joints import prismatic
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import G, Problem, coordinate, energy, instant, instants
from deltac.trajectories import Trajectory

ANGLE, SPEED = math.pi / 3, 2.0
POSITIONS = {
    1.0: (-0.6997754042350554, -0.4928963794660763, -0.5170759545143232),
    10.0: (0.0457825633984610, -0.7377486044706622, -0.6735213088613132),
}


def problem() -> Problem:
    """A particle of 1 kg on a rod of 1 m, 60° from the vertical, pushed sideways at 2 m/s."""
    mechanism = Mechanism(
        bodies=[frame("bridge"), frame("trolley"), point_mass("bob", "m")],
        joints=[
            prismatic("x", "ground", "bridge", "x"),
            prismatic("y", "bridge", "trolley", "y"),
            prismatic("z", "trolley", "bob", "z"),
        ],
        constraints=[distance("rod", "ground", "bob", "l")],
        gravity=(0.0, 0.0, "-g"),
        parameters={"m": 1.0, "l": 1.0, "g": G},
        name="spherical pendulum",
    )
    start = 0.5 * SPEED**2 - G * math.cos(ANGLE)
    reference = [instant("energy", 10.0, energy(mechanism), start, "J", "exact", 1e-14)]
    position = {axis: coordinate(axis) for axis in "xyz"}
    reference += instants(POSITIONS, position, "m", "exact", 1e-15)
    return Problem(
        name="spherical-pendulum",
        title="Spherical pendulum",
        mechanism=mechanism,
        state=mechanism.state((math.sin(ANGLE), 0.0, -math.cos(ANGLE)), (0.0, SPEED, 0.0)),
        duration=10.0,
        step=2e-3,
        solver="ode8",
        source="E. T. Whittaker, Analytical Dynamics of Particles and Rigid Bodies, §55",
        freedom=2,
        invariants={"energy": _energy, "angular momentum z": _vertical_momentum},
        reference=tuple(reference),
        notes="Described by Cartesian coordinates and the rod's constraint, which no position makes "
        "singular; the height goes as sn² of the time.",
    )


def _energy(run: Trajectory) -> Array:
    total: Array = 0.5 * (run.u**2).sum(axis=1) + G * run.q[:, 2]
    return total


def _vertical_momentum(run: Trajectory) -> Array:
    momentum: Array = run.q[:, 0] * run.u[:, 1] - run.q[:, 1] * run.u[:, 0]
    return np.asarray(momentum)
