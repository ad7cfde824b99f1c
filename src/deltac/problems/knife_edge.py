"""A turning knife edge on an incline: it slides back and forth, and never comes down."""

from __future__ import annotations

import math

from deltac.arrays import Array
from deltac.bodies import body
from deltac.constraints import skate
from deltac.joints import planar
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import G, Problem, coordinate, energy, forward, instant, instants
from deltac.trajectories import Trajectory

MASS, INERTIA, SLOPE, SPIN = 1.0, 0.1, math.pi / 6, 2.0
PULL = G * math.sin(SLOPE)


def problem() -> Problem:
    """A blade on a slope of 30°, pointing downhill at rest, turning at 2 rad/s; 10 s."""
    mechanism = Mechanism(
        bodies=[body("blade", "m", ("I", "I", "I"))],
        joints=[planar("slope", "ground", "blade")],
        constraints=[skate("edge", "blade", lateral="y")],
        gravity=("g*sin(alpha)", 0.0, "-g*cos(alpha)"),
        parameters={"m": MASS, "I": INERTIA, "g": G, "alpha": SLOPE},
        name="knife edge on an incline",
    )
    kinetic = 0.5 * INERTIA * SPIN**2
    reference = [instant("energy", 10.0, energy(mechanism), kinetic, "J", "exact", 1e-15)]
    position = {axis: coordinate(f"slope.{axis}") for axis in "xy"}
    for t in (1.0, 10.0):
        x, y, v = _exact(t)
        reference += instants({t: (x, y)}, position, "m", "exact", 1e-14)
        reference.append(
            instant("speed along the blade", t, forward("slope"), v, "m/s", "exact", 1e-14)
        )
    return Problem(
        name="knife-edge",
        title="Knife edge on an incline",
        mechanism=mechanism,
        state=mechanism.state(speeds={"slope.angle": SPIN}),
        duration=10.0,
        step=5e-3,
        solver="ode8",
        source="Ju. I. Neimark, N. A. Fufaev, Dynamics of Nonholonomic Systems, chapter III; A. M. "
        "Bloch, Nonholonomic Mechanics and Control, §1.6",
        freedom=2,
        invariants={"energy": _energy, "ω": lambda run: run.speed("slope.angle")},
        reference=tuple(reference),
        notes="x points downhill and z out of the plane. v = (g sin α/ω) sin ωt; the blade draws a "
        "cycloid across the slope, without any net descent.",
    )


def _exact(t: float) -> tuple[float, float, float]:
    """Position x, y (m) and speed along the blade (m/s)."""
    phase = SPIN * t
    size = PULL / (2 * SPIN**2)
    x = size * math.sin(phase) ** 2
    y = size * (phase - 0.5 * math.sin(2 * phase))
    return x, y, PULL / SPIN * math.sin(phase)


def _energy(run: Trajectory) -> Array:
    vx, vy, w = run.u.T
    total: Array = (
        0.5 * MASS * (vx**2 + vy**2)
        + 0.5 * INERTIA * w**2
        - MASS * PULL * run.coordinate("slope.x")
    )
    return total
