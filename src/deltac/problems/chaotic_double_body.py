"""A plate that turns about the rod it hangs from: two hinges at right angles, and chaos."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from deltac.arrays import Array
from deltac.bodies import body
from deltac.joints import revolute
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import G, Problem, coordinate, energy, instant, instants
from deltac.trajectories import Trajectory

LA, LB = 0.075, 0.2  # from the support to the mass centres
MA, MB = 0.01, 0.1
IA, IB = 5e-6, (2.5e-4, 0.5e-4, 2.0e-4)
START = (math.pi / 2, math.radians(0.5))
INERTIA = IA + MA * LA**2 + MB * LB**2  # of both about the support's axis, the plate's own apart
MOMENT = (MA * LA + MB * LB) * G
ANGLES = {
    1.0: (1.422421297815, 0.017333465497),
    4.0: (-0.270708669864, 4.129924426533),
}


def problem() -> Problem:
    """The swinging "babyboot": a rod of 10 g and a plate of 100 g, let go from the horizontal."""
    from deltac.simulation.equations import Equations

    mechanism = Mechanism(
        bodies=[
            body("rod", "mA", ("IA", "IA", 0.0), (0.0, 0.0, "-LA")),
            body("plate", "mB", ("Ix", "Iy", "Iz"), (0.0, 0.0, "-LB")),
        ],
        joints=[
            revolute("swing", "ground", "rod", "x"),
            revolute("turn", "rod", "plate", "z"),
        ],
        gravity=(0.0, 0.0, "-g"),
        parameters={"mA": MA, "mB": MB, "LA": LA, "LB": LB, "IA": IA, "g": G}
        | dict(zip(("Ix", "Iy", "Iz"), IB, strict=True)),
        name="chaotic double body",
    )
    reference = [instant("energy", 4.0, energy(mechanism), 0.0, "J", "exact", 1e-16)]
    angles = {name: coordinate(name) for name in ("swing", "turn")}
    reference += instants(ANGLES, angles, "rad", "calculated", 1e-11)
    return Problem(
        name="chaotic-double-body",
        title="Chaotic double body (the swinging babyboot)",
        mechanism=mechanism,
        state=mechanism.state(START),
        duration=4.0,
        step=1e-3,
        solver="ode8",
        source="T. R. Kane, P. C. Mitiguy, The swinging babyboot (the motivating example of Autolev "
        "and MotionGenesis)",
        invariants={"energy": _energy},
        reference=tuple(reference),
        equations=Equations(_rhs, name="the published equations of the babyboot"),
        notes="The hinge of the plate lies along the rod, at right angles to the support's. From a "
        "start near the horizontal the turning of the plate is chaotic.",
    )


def _rhs(t: Any, q: Any, u: Any) -> Any:
    """The two accelerations (2,) or (2, B) as published (rad/s²)."""
    (swing, turn), (a, b) = q, u
    sine, cosine = np.sin(turn), np.cos(turn)
    Ix, Iy, Iz = IB
    first = 2 * a * b * sine * cosine * (Ix - Iy) - MOMENT * np.sin(swing)
    first = first / (INERTIA + Ix * cosine**2 + Iy * sine**2)
    return np.array([first, -(a**2) * sine * cosine * (Ix - Iy) / Iz])


def _energy(run: Trajectory) -> Array:
    (swing, turn), (a, b) = run.q.T, run.u.T
    Ix, Iy, Iz = IB
    inertia = INERTIA + Ix * np.cos(turn) ** 2 + Iy * np.sin(turn) ** 2
    total: Array = 0.5 * inertia * a**2 + 0.5 * Iz * b**2 - MOMENT * np.cos(swing)
    return total
