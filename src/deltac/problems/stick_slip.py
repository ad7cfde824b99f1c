"""A block on a belt, held by a spring: it sticks, is carried along, and slips back."""

from __future__ import annotations

import numpy as np

from deltac.arrays import Array
from deltac.bodies import frame, point_mass
from deltac.forces import friction_law, point_friction
from deltac.joints import prismatic
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import G, Problem, period, whole
from deltac.trajectories import Trajectory

MASS, STIFFNESS, BELT = 1.0, 100.0, 0.1
STATIC, KINETIC = 0.4, 0.3
STRIBECK, WIDTH = 5e-3, 2e-4


def problem(stribeck: float = STRIBECK, width: float = WIDTH) -> Problem:
    """Three cycles on a belt of 0.1 m/s; x is measured from where the spring holds kinetic friction."""
    weight = MASS * G
    mechanism = Mechanism(
        bodies=[frame("belt"), point_mass("block", "m")],
        joints=[
            prismatic("belt", "ground", "belt", "x", motion=f"{BELT}*t"),
            prismatic(
                "x", "ground", "block", "x", stiffness="k", rest=-KINETIC * weight / STIFFNESS
            ),
        ],
        forces=[
            point_friction(
                "rub",
                "block",
                weight,
                friction_law(KINETIC, static=STATIC, stribeck=stribeck, width=width),
                on="belt",
            )
        ],
        parameters={"m": MASS, "k": STIFFNESS},
        name="stick-slip oscillator",
    )
    reference = [
        whole(
            "spread of x² + (ẋ/ω)² along each slip, against its mean",
            lambda run: slip_spread(run, stribeck),
            0.0,
            "1",
            "exact",
            1e-12,
        )
    ]
    if (stribeck, width) == (STRIBECK, WIDTH):
        reference.append(whole("period", period("x"), 0.6851449658, "s", "calculated", 1e-9))
    return Problem(
        name="stick-slip",
        title="Stick-slip oscillator on a belt",
        mechanism=mechanism,
        state=mechanism.state({"x": 0.0}, {"x": BELT}),
        duration=2.0,
        step=5e-5,
        solver="ode5",
        source="the classic block on a belt; two-level friction: period 2 D/V + (2/ω)(π − arctan(D ω/V)), "
        "D = (μ_s − μ_k) m g/k, V the belt's speed",
        reference=tuple(reference),
        notes="While it slips fast against the Stribeck speed, friction is constant and the motion is an arc "
        "of a circle in (x, ẋ/ω). The period tends to that of two-level friction (0.66936 s) as the "
        "Stribeck speed and the width go to zero. The belt's drive is the channel 'prescribed belt'.",
    )


def slip_spread(run: Trajectory, stribeck: float = STRIBECK) -> float:
    """The largest spread of x² + (ẋ/ω)² within one slip, relative to its mean.

    A slip is where the slip speed is above 6.1 Stribeck speeds: there the excess is below 10⁻¹⁶.
    """
    x, v = run.coordinate("x"), run.speed("x")
    square: Array = x**2 + v**2 * (MASS / STIFFNESS)
    slipping = BELT - v > 6.1 * stribeck
    edges = np.flatnonzero(np.diff(slipping.astype(int)))
    spreads = [
        float(np.ptp(part) / part.mean())
        for part, slips in zip(np.split(square, edges + 1), np.split(slipping, edges + 1))
        if slips[0] and len(part) > 2
    ]
    return max(spreads)
