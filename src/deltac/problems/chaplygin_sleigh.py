"""Chaplygin's sleigh: a blade that cannot slip sideways, and a mass centre ahead of it."""

from __future__ import annotations

import math

import numpy as np

from deltac.arrays import Array
from deltac.bodies import body
from deltac.constraints import skate
from deltac.joints import planar
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import Problem, coordinate, energy, forward, instant, instants, speed
from deltac.trajectories import Trajectory

MASS, INERTIA, ARM, SPIN = 1.0, 1.0, 0.5, 2.0
ABOUT_BLADE = MASS * ARM**2 + INERTIA
RATE = ARM * SPIN * math.sqrt(MASS / ABOUT_BLADE)
POSITION = (0.2794261686425750, 0.7668740494644343)  # of the blade at 1 s


def problem() -> Problem:
    """A sleigh of 1 kg and 1 kg·m² that turns at 2 rad/s about its resting blade, for 5 s."""
    mechanism = Mechanism(
        bodies=[body("sleigh", "m", ("I", "I", "I"), ("a", 0.0, 0.0))],
        joints=[planar("ice", "ground", "sleigh")],
        constraints=[skate("blade", "sleigh", lateral="y")],
        parameters={"m": MASS, "I": INERTIA, "a": ARM},
        name="Chaplygin's sleigh",
    )
    top = SPIN * math.sqrt(ABOUT_BLADE / MASS)
    kinetic = 0.5 * ABOUT_BLADE * SPIN**2
    reference = [instant("energy", 5.0, energy(mechanism), kinetic, "J", "exact", 1e-15)]
    for t in (1.0, 5.0):
        v, w = top * math.tanh(RATE * t), SPIN / math.cosh(RATE * t)
        reference += [
            instant("speed of the blade", t, forward("ice"), v, "m/s", "exact", 1e-15),
            instant("ω", t, speed("ice.angle"), w, "rad/s", "exact", 1e-15),
            instant("angle", t, coordinate("ice.angle"), _heading(t), "rad", "exact", 1e-15),
        ]
    position = {axis: coordinate(f"ice.{axis}") for axis in "xy"}
    reference += instants({1.0: POSITION}, position, "m", "exact", 1e-15)
    return Problem(
        name="chaplygin-sleigh",
        title="Chaplygin's sleigh",
        mechanism=mechanism,
        state=mechanism.state(speeds={"ice.angle": SPIN}),
        duration=5.0,
        step=2e-3,
        solver="ode8",
        source="S. A. Chaplygin, On the theory of motion of nonholonomic systems, Math. Sb. 28 "
        "(1911); A. M. Bloch, Nonholonomic Mechanics and Control, §1.7",
        freedom=2,
        invariants={"energy": _energy, "lateral velocity of the blade": _lateral},
        reference=tuple(reference),
        notes="All turning becomes running: v = ω0 √((m a² + I)/m) tanh kt and ω = ω0 sech kt with "
        "k = a ω0 √(m/(m a² + I)). Energy is conserved, and yet the motion settles.",
    )


def _heading(t: float) -> float:
    """∫ ω0 sech kt dt, by the Gudermannian."""
    return 2 * SPIN / RATE * math.atan(math.tanh(0.5 * RATE * t))


def _lateral(run: Trajectory) -> Array:
    angle = run.coordinate("ice.angle")
    return run.speed("ice.y") * np.cos(angle) - run.speed("ice.x") * np.sin(angle)


def _energy(run: Trajectory) -> Array:
    """½m v_G² + ½Iω², the mass centre at `ARM` ahead of the blade."""
    angle, w = run.coordinate("ice.angle"), run.speed("ice.angle")
    vx = run.speed("ice.x") - ARM * w * np.sin(angle)
    vy = run.speed("ice.y") + ARM * w * np.cos(angle)
    total: Array = 0.5 * MASS * (vx**2 + vy**2) + 0.5 * INERTIA * w**2
    return total
