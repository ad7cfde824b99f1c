"""An elastic ball on a floor that gives way: free fall and half a swing on the floor, in turn."""

from __future__ import annotations

import math

from deltac import shapes
from deltac.arrays import Array
from deltac.bodies import sphere
from deltac.forces import contact
from deltac.joints import prismatic
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import G, Problem, Reference, coordinate, instant, largest
from deltac.trajectories import Trajectory

MASS, RADIUS, HEIGHT = 1.0, 0.1, 0.5  # of its lowest point at the start

LINEAR, HERTZ = 2e3, 5e3


def problem(exponent: float = 1.0) -> Problem:
    """Dropped from 0.5 m. `exponent` 1: a linear floor, exact throughout; 1.5: Hertz's contact."""
    k = LINEAR if exponent == 1.0 else HERTZ
    mechanism = Mechanism(
        bodies=[sphere("ball", "m", RADIUS)],
        joints=[prismatic("z", "ground", "ball", "z", position=(0, 0, RADIUS))],
        forces=[
            contact(
                "floor",
                shapes.sphere("ball", RADIUS),
                shapes.half_space(),
                "k",
                exponent=exponent,
            )
        ],
        gravity=(0, 0, -G),
        parameters={"m": MASS, "k": k},
        name="ball on a compliant floor",
    )
    deepest = Reference(
        quantity="deepest overlap",
        value=deepest_overlap(k, exponent),
        unit="m",
        kind="exact",
        accuracy=1e-8,
        measure=largest(lambda run: -run.coordinate("z")),
    )
    heights = tuple(
        instant("height", t, coordinate("z"), height(t), "m", "exact", 1e-9)
        for t in (0.3, 0.36, 0.7, 1.0, 2.0)
        if exponent == 1.0
    )

    def energy(run: Trajectory) -> Array:
        z, v = run.coordinate("z"), run.speed("z")
        overlap = (-z).clip(0.0)
        bent: Array = k * overlap ** (exponent + 1) / (exponent + 1)
        return 0.5 * MASS * v**2 + MASS * G * (z + RADIUS) + bent

    return Problem(
        name="ball-on-compliant-floor",
        title="Elastic ball on a compliant floor",
        mechanism=mechanism,
        state=mechanism.state({"z": HEIGHT}),
        duration=2.0,
        step=1e-3,
        solver="DOP853",
        tolerance=1e-11,
        source="closed form: in contact x = (g/ω²)(1 − cos ω t) + (v/ω) sin ω t, ω² = k/m, for "
        "(2/ω)(π − arctan(ω v/g)); of any exponent: k xⁿ⁺¹/(n + 1) = m g (h + x) at the deepest x",
        invariants={"energy": energy},
        reference=(deepest, *heights),
        notes="Nothing is lost: the elastic energy is the potential 'spring floor'.",
    )


def height(t: float) -> float:
    """The height z of the lowest point (m) at the time t (s), on the linear floor."""
    omega = math.sqrt(LINEAR / MASS)
    v = math.sqrt(2 * G * HEIGHT)
    fall = v / G
    touch = 2 / omega * (math.pi - math.atan(omega * v / G))
    s = math.fmod(t, 2 * fall + touch)
    if fall < s < fall + touch:
        a = omega * (s - fall)
        return -(G / omega**2 * (1 - math.cos(a)) + v / omega * math.sin(a))
    s = s if s <= fall else s - 2 * fall - touch
    return HEIGHT - 0.5 * G * s * s


def deepest_overlap(k: float, exponent: float) -> float:
    """The overlap (m) at which the floor has taken up all energy, by bisection."""
    low, high = 0.0, 1.0
    for _ in range(200):
        x = 0.5 * (low + high)
        if k * x ** (exponent + 1) / (exponent + 1) < MASS * G * (HEIGHT + x):
            low = x
        else:
            high = x
    return low
