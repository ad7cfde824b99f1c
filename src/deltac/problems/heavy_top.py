"""The heavy top of Brüls and Cardona: a fast rotor on a long arm, on a fixed point."""

from __future__ import annotations

import numpy as np

from deltac.arrays import Array
from deltac.bodies import body
from deltac.joints import spherical
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import (
    G,
    Problem,
    Signal,
    coordinate,
    energy,
    instant,
    instants,
    rotated,
)
from deltac.trajectories import Trajectory

MASS, ARM = 15.0, (0.0, 1.0, 0.0)
CENTRAL = (0.234375, 0.46875, 0.234375)
TIP_INERTIA = np.array([15.234375, 0.46875, 15.234375])  # about the tip: m·1² added across the arm
RATE = (0.0, 150.0, -4.61538)
EULER = (-0.708279152974, 0.438781088127, 0.545728396145, 0.089399752824)  # at 0.2 s
MASS_CENTRE = (0.173343964098, 0.640088592071, -0.748490791134)  # at 1 s


def problem() -> Problem:
    """A top of 15 kg with its mass centre 1 m from the tip, horizontal at 150 rad/s, for 1 s."""
    mechanism = Mechanism(
        bodies=[body("top", "m", CENTRAL, ARM)],
        joints=[spherical("tip", "ground", "top")],
        gravity=(0.0, 0.0, "-g"),
        parameters={"m": MASS, "g": G},
        name="heavy top",
    )
    reference = [
        instant("energy", 1.0, energy(mechanism), 5435.696790865547, "J", "exact", 5e-13),
        instant("Lz", 1.0, _vertical_momentum, -70.3124296875, "kg·m²/s", "exact", 1e-14),
    ]
    euler = {f"Euler parameter {part}": coordinate(f"tip.q{part}") for part in "wxyz"}
    reference += instants({0.2: EULER}, euler, "1", "calculated", 1e-12)
    centre = {f"mass centre {axis}": _mass_centre(k) for k, axis in enumerate("xyz")}
    reference += instants({1.0: MASS_CENTRE}, centre, "m", "calculated", 1e-12)
    return Problem(
        name="heavy-top",
        title="Heavy top (Brüls and Cardona)",
        mechanism=mechanism,
        state=mechanism.state(speeds={"tip": RATE}),
        duration=1.0,
        step=5e-4,
        solver="ode8",
        source="O. Brüls, A. Cardona, On the use of Lie group time integrators in multibody "
        "dynamics, J. Comput. Nonlinear Dyn. 5 (2010) 031002",
        invariants={
            "energy": _energy,
            "angular momentum z": _vertical_momentum,
            "spin": lambda run: run.speed("tip.wy"),
        },
        reference=tuple(reference),
        notes="Euler parameters go on continuously from the identity, so that both signs of a "
        "quaternion are not the same here.",
    )


def _mass_centre(axis: int) -> Signal:
    return lambda run: rotated(run.q, np.array(ARM))[:, axis]


def _energy(run: Trajectory) -> Array:
    total: Array = 0.5 * (TIP_INERTIA * run.u**2).sum(axis=1) + MASS * G * _mass_centre(2)(run)
    return total


def _vertical_momentum(run: Trajectory) -> Array:
    """The vertical component of the angular momentum about the tip (kg·m²/s)."""
    return rotated(run.q, TIP_INERTIA * run.u)[:, 2]
