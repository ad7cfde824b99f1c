"""A bead on a hoop that a motor turns: K + V swings, the Jacobi integral does not."""

from __future__ import annotations

import math

import numpy as np

from deltac.arrays import Array
from deltac.bodies import frame, point_mass
from deltac.joints import revolute
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import G, Problem, energy, instant, work
from deltac.trajectories import Trajectory

SPIN, START = 5.0, 1.0
START_ENERGY = 0.5 * (SPIN * math.sin(START)) ** 2 - G * math.cos(START)
ENERGY = {1.0: 7.259194270796, 10.0: 6.693511361376}


def problem() -> Problem:
    """A bead of 1 kg slides on a hoop of 1 m that turns at 5 rad/s about its vertical diameter."""
    mechanism = Mechanism(
        bodies=[frame("hoop"), point_mass("bead", "m", at=(0.0, 0.0, "-R"))],
        joints=[
            revolute("shaft", "ground", "hoop", "z", motion="Omega*t"),
            revolute("slide", "hoop", "bead", "x"),
        ],
        gravity=(0.0, 0.0, "-g"),
        parameters={"m": 1.0, "R": 1.0, "g": G, "Omega": SPIN},
        name="bead on a turning hoop",
    )
    jacobi = -0.5 * (SPIN * math.sin(START)) ** 2 - G * math.cos(START)
    total, motor = energy(mechanism), work(mechanism, "prescribed shaft")
    reference = [
        instant("energy", 0.0, total, START_ENERGY, "J", "exact", 1e-14),
        instant("Jacobi integral", 10.0, _jacobi_integral, jacobi, "J", "exact", 1e-14),
    ]
    for t, value in ENERGY.items():
        gain = value - START_ENERGY
        reference += [
            instant("energy", t, total, value, "J", "calculated", 1e-12),
            instant("motor work", t, motor, gain, "J", "calculated", 1e-12),
        ]
    return Problem(
        name="bead-on-hoop",
        title="Bead on a hoop turned by a motor",
        mechanism=mechanism,
        state=mechanism.state({"slide": START}),
        duration=10.0,
        step=1e-3,
        solver="ode8",
        source="H. Goldstein, Classical Mechanics, chapter 2 (an energy function that is not the "
        "energy)",
        invariants={"Jacobi integral": _jacobi_integral},
        reference=tuple(reference),
        notes="K + V is not constant: the motor works. K + V − Q is, and so is K2 − K0 + V.",
    )


def _jacobi_integral(run: Trajectory) -> Array:
    """K2 − K0 + V = ½θ̇² − ½Ω² sin²θ − g cosθ for a mass and radius of one (J)."""
    angle, rate = run.coordinate("slide"), run.speed("slide")
    return 0.5 * rate**2 - 0.5 * (SPIN * np.sin(angle)) ** 2 - G * np.cos(angle)
