"""A clutch: two discs brought to one speed by friction; the heat is the same whatever the torque."""

from __future__ import annotations

import math

from deltac.bodies import disc
from deltac.forces import joint_friction
from deltac.joints import revolute
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import Problem, instant, speed, whole, work

DRIVING, DRIVEN = 0.5, 0.3
"""Moments of inertia about the axis, kg·m²."""

TORQUE, CLOSING, WIDTH, START = 12.0, 0.2, 0.5, 40.0


def problem() -> Problem:
    """One disc turns at 40 rad/s, the other rests; the clutch closes over some 0.2 s."""
    mechanism = Mechanism(
        bodies=[disc("driving", 2 * DRIVING, 1.0, "z"), disc("driven", 2 * DRIVEN, 1.0, "z")],
        joints=[
            revolute("shaft", "ground", "driving", "z"),
            revolute("slip", "driving", "driven", "z"),
        ],
        forces=[
            joint_friction("clutch", "slip", f"T*(1 - exp(-t/{CLOSING}))", width=WIDTH),
        ],
        parameters={"T": TORQUE},
        name="clutch",
    )
    reduced = DRIVING * DRIVEN / (DRIVING + DRIVEN)
    lost = 0.5 * reduced * START**2
    together = DRIVING * START / (DRIVING + DRIVEN)
    slipping = [
        instant("slip", t, speed("slip"), -_slip(t), "rad/s", "exact", 1e-13)
        for t in (0.2, 0.4, 0.5, 0.6)
    ]
    return Problem(
        name="clutch",
        title="Clutch: two discs brought to one speed by friction",
        mechanism=mechanism,
        state=mechanism.state(None, {"shaft": START, "slip": -START}),
        duration=1.0,
        step=1e-3,
        solver="ode5",
        source="momentum and energy of two discs; of tanh friction: d/dt ln sinh(r/w) = −T/(I w), r the "
        "slip speed, I the reduced moment of inertia",
        invariants={
            "angular momentum": lambda run: (
                (DRIVING + DRIVEN) * run.speed("shaft") + DRIVEN * run.speed("slip")
            ),
        },
        reference=(
            *slipping,
            instant("speed", 1.0, speed("shaft"), together, "rad/s", "exact", 1e-9),
            whole(
                "heat of the clutch",
                lambda run: -float(work(mechanism, "friction clutch")(run)[-1]),
                lost,
                "J",
                "exact",
                1e-9,
            ),
        ),
        notes="The heat ½ I (ω1 − ω2)², I = I1 I2/(I1 + I2), depends neither on the torque nor on its width. "
        "Slip dies out as e^(−T t/(I w)); an ideal clutch would lock.",
    )


def _slip(t: float) -> float:
    """Slip speed by the closed form, rad/s."""
    reduced = DRIVING * DRIVEN / (DRIVING + DRIVEN)
    impulse = TORQUE * (t + CLOSING * math.expm1(-t / CLOSING))
    x = START / WIDTH
    # ln sinh x without overflow
    level = x - math.log(2.0) + math.log1p(-math.exp(-2.0 * x)) - impulse / (reduced * WIDTH)
    return WIDTH * (level + math.log(2.0) if level > 40.0 else math.asinh(math.exp(level)))
