"""A disc that rolls in a steady circle, leaning inwards: closed form."""

from __future__ import annotations

import math

import numpy as np

from deltac.arrays import Array
from deltac.bodies import disc
from deltac.constraints import rolling
from deltac.joints import free
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import (
    G,
    Problem,
    coordinate,
    energy,
    instant,
    instants,
    rotated,
    whole,
)
from deltac.trajectories import Trajectory

MASS, RADIUS, PATH, TILT = 0.3048, 0.05, 0.5, math.radians(5)
SINE, COSINE = math.sin(TILT), math.cos(TILT)
ACROSS, ALONG = MASS * RADIUS**2 / 4, MASS * RADIUS**2 / 2
PRECESSION = -math.sqrt(G * math.tan(TILT) / (1.5 * PATH - 1.25 * RADIUS * SINE))
SPIN = -PRECESSION * PATH / RADIUS
CENTRE = PATH - RADIUS * SINE  # radius of the centre's circle


def problem() -> Problem:
    """A disc of 5 cm, 5° from the vertical; its contact point runs on a circle of 0.5 m; 8 s."""
    mechanism = Mechanism(
        bodies=[disc("disc", "m", "r", axis="y")],
        joints=[free("motion", "disc")],
        constraints=[rolling("contact", "disc", "r", axis="y")],
        gravity=(0.0, 0.0, "-g"),
        parameters={"m": MASS, "r": RADIUS, "g": G},
        name="rolling disc",
    )
    total = MASS * G * RADIUS * COSINE + 0.5 * MASS * (PRECESSION * CENTRE) ** 2
    total += (
        0.5 * ALONG * (SPIN + PRECESSION * SINE) ** 2 + 0.5 * ACROSS * (PRECESSION * COSINE) ** 2
    )
    reference = [
        whole("period", _period, 2 * math.pi / abs(PRECESSION), "s", "exact", 1e-15),
        instant("energy", 8.0, energy(mechanism), total, "J", "exact", 1e-15),
    ]
    centre = {f"centre {axis}": coordinate(f"motion.{axis}") for axis in "xyz"}
    for t in (1.0, 8.0):
        phase = PRECESSION * t - math.pi / 2
        position = (CENTRE * math.cos(phase), CENTRE * math.sin(phase), RADIUS * COSINE)
        reference += instants({t: position}, centre, "m", "exact", 1e-14)
        reference += [
            instant("precession α̇", t, _precession, PRECESSION, "rad/s", "exact", 1e-14),
            instant("spin γ̇", t, _spin, SPIN, "rad/s", "exact", 1e-14),
        ]
    return Problem(
        name="rolling-disc",
        title="Rolling disc in a steady circle",
        mechanism=mechanism,
        state=mechanism.state(
            {
                "motion.y": -CENTRE,
                "motion.z": RADIUS * COSINE,
                "motion.qw": math.cos(TILT / 2),
                "motion.qx": -math.sin(TILT / 2),
            },
            {
                "motion.vx": PRECESSION * CENTRE,
                "motion.wy": -SPIN - PRECESSION * SINE,
                "motion.wz": PRECESSION * COSINE,
            },
        ),
        duration=8.0,
        step=2e-3,
        solver="ode8",
        source="C. Le Saux, R. I. Leine, C. Glocker, Dynamics of a rolling disk in the presence of "
        "dry friction, J. Nonlinear Sci. 15 (2005) 27-61",
        freedom=3,
        invariants={
            "energy": _energy,
            "height": lambda run: run.coordinate("motion.z"),
            "precession": _precession,
            "spin": _spin,
        },
        reference=tuple(reference),
        notes="α̇² = g tan β/(3R/2 − 5 r sin β/4) and γ̇ = −α̇ R/r for a tilt β and a contact circle of "
        "radius R. The contact's force does no work.",
    )


def _period(run: Trajectory) -> float:
    """The time of a round, by the mean rate of the centre's azimuth (s)."""
    azimuth = np.unwrap(np.arctan2(run.coordinate("motion.y"), run.coordinate("motion.x")))
    return float(2 * math.pi * (run.t[-1] - run.t[0]) / abs(azimuth[-1] - azimuth[0]))


def _precession(run: Trajectory) -> Array:
    """Rate of the azimuth of the disc's axis (rad/s): the upward part of ω that is not spin."""
    axis = rotated(run.q[:, 3:], np.array([0.0, 1.0, 0.0]))
    w = rotated(run.q[:, 3:], run.u[:, 3:])
    rate = np.cross(w, axis)
    horizontal: Array = axis[:, 0] ** 2 + axis[:, 1] ** 2
    return (axis[:, 0] * rate[:, 1] - axis[:, 1] * rate[:, 0]) / horizontal


def _spin(run: Trajectory) -> Array:
    """Rate about the axis on top of the precession, positive along the outward axis (rad/s)."""
    upward = rotated(run.q[:, 3:], np.array([0.0, 1.0, 0.0]))[:, 2]
    return -(run.speed("motion.wy") - _precession(run) * upward)


def _energy(run: Trajectory) -> Array:
    v, w = run.u[:, :3], run.u[:, 3:]
    total: Array = 0.5 * MASS * (v**2).sum(axis=1) + MASS * G * run.coordinate("motion.z")
    total += 0.5 * (np.array([ACROSS, ALONG, ACROSS]) * w**2).sum(axis=1)
    return total
