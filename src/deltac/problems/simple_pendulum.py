"""The simple pendulum, IFToMM benchmark A01: swings between the horizontals, in closed form."""

from __future__ import annotations

import math

import numpy as np

from deltac.arrays import Array
from deltac.bodies import point_mass
from deltac.joints import revolute
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import G, Problem, Signal, energy, instant, instants, period, whole
from deltac.trajectories import Trajectory

POSITIONS = {
    1.0: (0.986291751131875, -0.165010853125541),
    5.0: (-0.942305435043757, -0.334754338414001),
    10.0: (-0.275087462576117, -0.961419205099125),
}


def problem() -> Problem:
    """A particle of 1 kg on a massless rod of 1 m, released from (−1, 0) at rest, for 10 s."""
    mechanism = Mechanism(
        bodies=[point_mass("bob", "m", at=(0.0, "-l", 0.0))],
        joints=[revolute("pivot", "ground", "bob")],
        gravity=(0.0, "-g", 0.0),
        parameters={"m": 1.0, "l": 1.0, "g": G},
        name="simple pendulum",
    )
    reference = [
        # 4 K(k² = ½)/√g
        whole("period", period("pivot"), 2.36784194757623745, "s", "exact", 1e-15),
        instant("energy", 10.0, energy(mechanism), 0.0, "J", "exact", 0.0),
    ]
    bob: dict[str, Signal] = {
        "x": lambda run: np.sin(run.coordinate("pivot")),
        "y": lambda run: -np.cos(run.coordinate("pivot")),
    }
    reference += instants(POSITIONS, bob, "m", "exact", 5e-16)
    return Problem(
        name="simple-pendulum",
        title="Simple pendulum (IFToMM A01)",
        mechanism=mechanism,
        state=mechanism.state({"pivot": -math.pi / 2}),
        duration=10.0,
        step=1e-3,
        solver="ode8",
        source="IFToMM Technical Committee for Multibody Dynamics, Library of Computational "
        "Benchmark Problems, A01 Simple Pendulum",
        invariants={"energy": _energy},
        reference=tuple(reference),
        notes="The community's threshold is an energy error below 5e-5 J. At the start only the "
        "Taylor coefficients of order 2, 6, 10, … of the angle are not zero: a step control that "
        "looks at two neighbouring orders alone is misled.",
    )


def _energy(run: Trajectory) -> Array:
    return 0.5 * run.speed("pivot") ** 2 - G * np.cos(run.coordinate("pivot"))
