"""The double pendulum of the textbooks: two particles on massless rods, released at rest."""

from __future__ import annotations

import math

import numpy as np

from deltac.arrays import Array
from deltac.bodies import point_mass
from deltac.joints import revolute
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import G, Problem, Signal, energy, instant, instants
from deltac.trajectories import Trajectory

START = (math.pi / 3, -math.pi / 4)
ANGLES = {
    1.0: (-1.015924861020, 0.718497575148),
    5.0: (-0.314659061035, 0.925045035549),
}


def problem() -> Problem:
    """Two particles of 1 kg, rods of 1 m; absolute angles of 60° and −45° from the vertical."""
    mechanism = Mechanism(
        bodies=[point_mass(f"bob{n}", f"m{n}", at=(0.0, f"-l{n}", 0.0)) for n in (1, 2)],
        joints=[
            revolute("joint1", "ground", "bob1"),
            revolute("joint2", "bob1", "bob2", position=(0.0, "-l1", 0.0)),
        ],
        gravity=(0.0, "-g", 0.0),
        parameters={"m1": 1.0, "m2": 1.0, "l1": 1.0, "l2": 1.0, "g": G},
        name="double pendulum",
    )
    start = -G * (2 * math.cos(START[0]) + math.cos(START[1]))
    reference = [instant("energy", 5.0, energy(mechanism), start, "J", "exact", 1e-14)]
    angles = {f"θ{k + 1}": _angle(k) for k in range(2)}
    reference += instants(ANGLES, angles, "rad", "calculated", 1e-12)
    return Problem(
        name="double-pendulum",
        title="Double pendulum",
        mechanism=mechanism,
        state=mechanism.state({"joint1": START[0], "joint2": START[1] - START[0]}),
        duration=5.0,
        step=1e-3,
        solver="ode8",
        source="L. D. Landau, E. M. Lifshitz, Mechanics, §5, problem 1",
        invariants={"energy": _energy},
        reference=tuple(reference),
        notes="θ are absolute angles from the downward vertical. The motion is chaotic: errors grow "
        "by orders of magnitude within seconds.",
    )


def _angle(bob: int) -> Signal:
    return lambda run: run.q[:, : bob + 1].sum(axis=1)


def _energy(run: Trajectory) -> Array:
    first, second = np.cumsum(run.q, axis=1).T
    w1, w2 = np.cumsum(run.u, axis=1).T
    kinetic = w1**2 + 0.5 * w2**2 + w1 * w2 * np.cos(first - second)
    total: Array = kinetic - G * (2 * np.cos(first) + np.cos(second))
    return total
