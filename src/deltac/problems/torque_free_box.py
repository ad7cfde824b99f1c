"""A box thrown up, spinning about its middle axis: it tumbles, momentum and energy stay."""

from __future__ import annotations

import numpy as np

from deltac.arrays import Array
from deltac.bodies import box
from deltac.joints import free
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import Problem, Signal, energy, instant, instants, rotated, speed
from deltac.trajectories import Trajectory

MASS, SIZE, G = 10.0, (0.1, 0.4, 0.9), 9.8
VELOCITY, RATE = (-2.0, 2.0, 8.0), (0.1, 5.0, 0.1)
INERTIA = MASS / 12 * np.array([0.97, 0.82, 0.17])  # (b² + c², a² + c², a² + b²)
RATES = {
    1.0: (3.423798441555, 2.819185438398, 3.928384449467),
    10.0: (2.755840405147, -3.735963519216, -3.161809003468),
}


def problem() -> Problem:
    """A box of 0.1 × 0.4 × 0.9 m and 10 kg in free flight for 10 s."""
    mechanism = Mechanism(
        bodies=[box("box", "m", SIZE)],
        joints=[free("flight", "box")],
        gravity=(0.0, 0.0, "-g"),
        parameters={"m": MASS, "g": G},
        name="torque-free box",
    )
    reference = [
        instant("energy", 1.0, energy(mechanism), 368.546416666667, "J", "exact", 5e-13),
        instant("height", 1.0, lambda run: run.coordinate("flight.z"), 3.1, "m", "exact", 1e-15),
    ]
    momentum = {f"L{axis}": _angular_momentum(k) for k, axis in enumerate("xyz")}
    start = (INERTIA * RATE).tolist()
    reference += instants({10.0: start}, momentum, "kg·m²/s", "exact", 1e-15)
    spin = {f"ω{axis}": speed(f"flight.w{axis}") for axis in "xyz"}
    for t, rates in RATES.items():
        accuracy = 1e-12 if t < 10.0 else 1e-11
        reference += instants({t: rates}, spin, "rad/s", "calculated", accuracy)
    return Problem(
        name="torque-free-box",
        title="Torque-free box, tumbling about its middle axis",
        mechanism=mechanism,
        state=mechanism.state(speeds={"flight": (*VELOCITY, *RATE)}),
        duration=10.0,
        step=2e-3,
        solver="ode8",
        source="L. D. Landau, E. M. Lifshitz, Mechanics, §37 (the asymmetrical top, in Jacobi's "
        "elliptic functions)",
        invariants={
            "energy": _energy,
            "horizontal momentum x": lambda run: MASS * run.speed("flight.vx"),
            "horizontal momentum y": lambda run: MASS * run.speed("flight.vy"),
            **{f"angular momentum {c}": _angular_momentum(k) for k, c in enumerate("xyz")},
        },
        reference=tuple(reference),
        notes="Angular momentum about the mass centre. The potential energy is zero at the start.",
    )


def _energy(run: Trajectory) -> Array:
    v, w = run.u[:, :3], run.u[:, 3:]
    total: Array = (
        0.5 * MASS * (v**2).sum(axis=1)
        + 0.5 * (INERTIA * w**2).sum(axis=1)
        + MASS * G * run.coordinate("flight.z")
    )
    return total


def _angular_momentum(axis: int) -> Signal:
    """A world component of the angular momentum about the mass centre (kg·m²/s)."""
    return lambda run: rotated(run.q[:, 3:], INERTIA * run.u[:, 3:])[:, axis]
