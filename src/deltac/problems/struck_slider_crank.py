"""A slider-crank whose slider strikes a stop: impacts that go through a closed loop."""

from __future__ import annotations

import math

import numpy as np

from deltac.arrays import Array
from deltac.bodies import point_mass, rod
from deltac.constraints import loop_spherical
from deltac.events import joint_stop
from deltac.joints import prismatic, revolute
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.bouncing_ball import losses
from deltac.problems.problem import Measure, Problem, whole
from deltac.trajectories import Trajectory

CRANK, ROD, SLIDER = 1.0, 2.0, 1.5  # kg
RADIUS, LENGTH = 0.1, 0.3  # m
IMPACTS = (
    0.0972703876481528952,
    0.698023190924855503,
    1.55624148132014498,
    2.78226761045627280,
)


def problem() -> Problem:
    """A crank of 0.1 m and 1 kg, a rod of 0.3 m and 2 kg, a slider of 1.5 kg; no gravity, for 3 s.

    It starts at a right angle with 10 rad/s towards the stop, 2 cm before the outer dead centre.
    """
    restitution, rate = 0.7, 10.0  # rad/s
    tilt = -math.asin(RADIUS / LENGTH)
    mechanism = Mechanism(
        bodies=[
            rod("crank", CRANK, RADIUS),
            rod("rod", ROD, LENGTH),
            point_mass("slider", SLIDER),
        ],
        joints=[
            revolute("crank", "ground", "crank"),
            revolute("pin", "crank", "rod", position=(RADIUS, 0.0, 0.0)),
            prismatic("slide", "ground", "slider", axis="x"),
        ],
        constraints=[loop_spherical("wrist", "rod", "slider", point1=(LENGTH, 0.0, 0.0))],
        events=[joint_stop("stop", "slide", upper=0.38, restitution=restitution)],
        name="struck slider-crank",
    )
    state = mechanism.state(
        {"crank": math.pi / 2, "pin": tilt - math.pi / 2, "slide": LENGTH * math.cos(tilt)},
        speeds={"crank": -rate, "pin": rate, "slide": RADIUS * rate},
    )
    # At the start everything but the crank translates: ½ (1/3 · 0.1² + (2 + 1.5) 0.1²) 10² J.
    energy = 0.5 * (CRANK / 3.0 + ROD + SLIDER) * (RADIUS * rate) ** 2
    reference = []
    for k, t in enumerate(IMPACTS):
        reference += [
            whole(f"time of impact {k + 1}", _impact(k, "t"), t, "s", "calculated", 1e-14),
            whole(
                f"loss of impact {k + 1}",
                _impact(k, "energy_lost"),
                (1.0 - restitution**2) * energy * restitution ** (2 * k),
                "J",
                "exact",
                1e-14,
            ),
        ]
    return Problem(
        name="struck-slider-crank",
        title="Slider-crank that strikes a stop",
        mechanism=mechanism,
        state=state,
        duration=3.0,
        step=2e-3,
        solver="ode8",
        source="One degree of freedom: between impacts √A(θ) θ̇ is constant, and each impact multiplies it "
        "by −e; the times are quadratures of √A (by mpmath, 30 digits)",
        freedom=1,
        invariants={"energy and losses": _energy_and_losses},
        reference=tuple(reference),
        notes="The impulse of the stop acts on the slider, and through the rod on the crank: the "
        "constraint's impulse answers, and does no work.",
    )


def _impact(k: int, what: str) -> Measure:
    """A number of the impact with index k."""
    return lambda run: float(getattr(run.events[k], what))


def _energy_and_losses(run: Trajectory) -> Array:
    """½ I θ̇² of the crank; m (v² + v·w + w²)/6 of the rod between points with v and w; the slider's."""
    angle, rate = run.coordinate("crank"), run.speed("crank")
    pin = RADIUS * rate * 1j * np.exp(1j * angle)
    slider = run.speed("slide")
    bar = ROD * (np.abs(pin) ** 2 + (pin * slider).real + slider**2) / 6.0
    kinetic = CRANK * (RADIUS * rate) ** 2 / 6.0 + bar + 0.5 * SLIDER * slider**2
    return np.asarray(kinetic + losses(run))
