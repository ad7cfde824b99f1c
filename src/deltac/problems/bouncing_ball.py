"""A ball that bounces on the floor: infinitely many impacts in a finite time, all in closed form."""

from __future__ import annotations

import math

import numpy as np

from deltac import shapes
from deltac.arrays import Array
from deltac.bodies import point_mass
from deltac.errors import InputError
from deltac.events import event, impact
from deltac.joints import prismatic
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import G, Measure, Problem, Reference
from deltac.trajectories import Trajectory

BOUNCES = (1, 5, 10)


def problem(restitution: float = 0.8, height: float = 1.0) -> Problem:
    """A ball of 1 kg dropped from a `height` (m), until shortly before its bounces come to an end.

    `restitution` e lies between 0.1 and 0.95.
    """
    if not (isinstance(restitution, int | float) and 0.1 <= restitution <= 0.95):
        raise InputError(f"restitution is {restitution!r}, expected a number from 0.1 to 0.95")
    if not (isinstance(height, int | float) and 0.1 <= height <= 100.0):
        raise InputError(f"height is {height!r}, expected a number from 0.1 to 100 (m)")
    e = float(restitution)
    mechanism = Mechanism(
        bodies=[point_mass("ball", "m")],
        joints=[prismatic("height", "ground", "ball", axis="z")],
        gravity=(0.0, 0.0, "-g"),
        parameters={"m": 1.0, "g": G},
        events=[
            impact("floor", shapes.point("ball"), shapes.half_space(), restitution=e),
            event("apex", "u.height", direction="falling"),
        ],
        name="bouncing ball",
    )
    fall = math.sqrt(2.0 * height / G)
    rest = fall * (1.0 + e) / (1.0 - e)
    step = 0.01
    # Bounce k begins at fall (1 + 2 e + … + 2 e^(k−1)); the run is to hold as many as it can.
    duration = step * math.floor(0.985 * rest / step)
    begins = [fall * (1.0 + 2.0 * sum(e**j for j in range(1, k))) for k in range(1, 11)]
    bounces = [k for k in BOUNCES if begins[k - 1] + fall * e**k < duration]
    reference = [_exact("time of rest", rest, "s", _rest(e))]
    for k in bounces:
        reference += [
            _exact(f"time of impact {k}", begins[k - 1], "s", _impact(k, "t")),
            _exact(f"height of bounce {k}", height * e ** (2 * k), "m", _height(k)),
            _exact(
                f"loss of impact {k}",
                (1.0 - e**2) * G * height * e ** (2 * (k - 1)),
                "J",
                _impact(k, "energy_lost"),
            ),
        ]
    return Problem(
        name="bouncing-ball",
        title="Bouncing ball",
        mechanism=mechanism,
        state=mechanism.state({"height": height}),
        duration=duration,
        step=step,
        solver="ode5",
        source="Newton's law of restitution; a textbook example of accumulating events (Zeno)",
        invariants={"energy and losses": _energy_and_losses},
        reference=tuple(reference),
        notes="Each impact takes 1 − e² of the energy; heights are e^(2k) h0, and all bounces together "
        "last √(2 h0/g) (1 + e)/(1 − e). A longer run stops there, and says when.",
    )


def _exact(quantity: str, value: float, unit: str, measure: Measure) -> Reference:
    return Reference(
        quantity=quantity, value=value, unit=unit, kind="exact", accuracy=1e-14, measure=measure
    )


def _impact(k: int, what: str) -> Measure:
    """A number of the k-th impact."""
    return lambda run: float(
        getattr([event for event in run.events if "impact floor" in event.names][k - 1], what)
    )


def _height(k: int) -> Measure:
    """The height of the k-th bounce."""
    return lambda run: float([e for e in run.events if "event apex" in e.names][k - 1].q[0])


def _rest(e: float) -> Measure:
    """When the bounces end, from the last impact on: flights of 2 v/g, each e times the one before."""

    def measure(run: Trajectory) -> float:
        last = [event for event in run.events if "impact floor" in event.names][-1]
        return last.t + 2.0 * float(last.u_after[0]) / G / (1.0 - e)

    return measure


def losses(run: Trajectory) -> Array:
    """Energy that the impacts have taken out up to each row (J)."""
    times = [event.t for event in run.events]
    lost = np.concatenate([[0.0], np.cumsum([event.energy_lost for event in run.events])])
    return np.asarray(lost[np.searchsorted(times, run.t, "right")])


def _energy_and_losses(run: Trajectory) -> Array:
    u, z = run.speed("height"), run.coordinate("height")
    return 0.5 * u**2 + G * z + losses(run)
