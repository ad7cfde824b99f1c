"""A ball that rolls on a turning table: its centre runs on a circle at 2/7 of the table's rate."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np

from deltac.arrays import Array
from deltac.bodies import disc, frame, sphere
from deltac.constraints import rolling
from deltac.errors import UnknownName
from deltac.joints import free, prismatic, revolute
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import G, Problem, Signal, coordinate, instant, instants, rotated, work
from deltac.trajectories import Trajectory

MASS, RADIUS, TURN = 0.2, 0.1, 7.0
INERTIA = 0.4 * MASS * RADIUS**2
RATE = 2 * TURN / 7  # of the ball's centre on its circle
START, VELOCITY = (0.3, 0.0), (0.1, 0.2)
CENTRE = (START[0] - VELOCITY[1] / RATE, START[1] + VELOCITY[0] / RATE)
RISE, BEAT = 0.1, 3.0
BALL = "ball.x ball.y ball.z".split()

Table = Literal["laws", "body"]


def problem(table: Table = "laws") -> Problem:
    """A ball of 0.2 kg on a table that turns at 7 rad/s, 0.3 m from its axis; 5 s.

    Args:
        table: "laws": the table is a velocity field of the ground's surface; "body": it is a body with
            inertia of its own, turned by a motor.
    """
    return make(table, rising=False)


def make(table: Table, *, rising: bool) -> Problem:
    """The problem, on a table that may rise and sink by h = A (1 − cos wt) while it turns."""
    if table not in ("laws", "body"):
        raise UnknownName(f"ball on a table: table is {table!r}; known: 'laws', 'body'")
    mechanism = _mechanism(table, rising)
    start = _kinetic(0.0)
    reference = []
    centre = {axis: coordinate(f"ball.{axis}") for axis in "xyz"}
    for t in (1.0, 5.0):
        height, lift = _lift(t) if rising else (0.0, 0.0)
        x, y = _circle(t)
        gain = _kinetic(t) - start
        reference += instants({t: (x, y, RADIUS + height)}, centre, "m", "exact", 1e-15)
        kinetic_energy = _kinetic(t) + 0.5 * MASS * lift**2
        reference.append(
            instant("K of the ball", t, _ball_kinetic, kinetic_energy, "J", "exact", 1e-15)
        )
        if table == "laws":
            total = gain + 0.5 * MASS * lift**2 + MASS * G * height
            done = work(mechanism, "constraint contact")
            reference.append(instant("work of the table", t, done, total, "J", "exact", 1e-14))
        else:
            done = work(mechanism, "prescribed turntable")
            reference.append(instant("work of the motor", t, done, gain, "J", "exact", 1e-14))
            if rising:
                mass = MASS + mechanism.parameters["m_table"]
                lifted = 0.5 * mass * lift**2 + mass * G * height
                done = work(mechanism, "prescribed lift")
                reference.append(instant("work of the lift", t, done, lifted, "J", "exact", 1e-14))
    spin = {
        "ball.wx": -(VELOCITY[1] - TURN * START[0]) / RADIUS,
        "ball.wy": (VELOCITY[0] + TURN * START[1]) / RADIUS,
    }
    return Problem(
        name="ball-on-rising-table" if rising else "ball-on-table",
        title="Ball on a table that turns and rises" if rising else "Ball on a turning table",
        mechanism=mechanism,
        state=mechanism.state(
            dict(zip(BALL, (*START, RADIUS), strict=True)),
            {"ball.vx": VELOCITY[0], "ball.vy": VELOCITY[1], **spin},
        ),
        duration=5.0,
        step=1e-3,
        solver="ode8",
        source="K. Weltner, Stable circular orbits of freely moving balls on rotating discs, Am. J. "
        "Phys. 47 (1979) 984-986"
        + ("; the table that also rises: Ju. I. Neimark, N. A. Fufaev 1972" if rising else ""),
        freedom=3,
        invariants={"ω about the vertical": _drilling, **_circular()},
        reference=tuple(reference),
        notes="The table's velocity is b of the rolling constraint: K + V is not constant unless the "
        "circle is centred on the axis, and the constraint's force works."
        + (" The lift is f_t: its force works too." if rising else ""),
    )


def _mechanism(table: Table, rising: bool) -> Mechanism:
    parameters = {"m": MASS, "r": RADIUS, "g": G, "Omega": TURN}
    lift = "A*(1 - cos(w*t))"
    if rising:
        parameters |= {"A": RISE, "w": BEAT}
    bodies, joints = [sphere("ball", "m", "r")], [free("ball", "ball")]
    plane: dict[str, Any]
    if table == "laws":
        plane = {"surface_velocity": ("-Omega*y", "Omega*x", 0.0)}
        if rising:
            plane["point"] = (0.0, 0.0, lift)
    else:
        plane = {"on": "table"}
        parameters |= {"m_table": 2.0, "r_table": 0.6}
        bodies.append(disc("table", "m_table", "r_table"))
        carrier = "ground"
        if rising:
            carrier = "column"
            bodies.append(frame(carrier))
            joints.append(prismatic("lift", "ground", carrier, "z", motion=lift))
        joints.append(revolute("turntable", carrier, "table", "z", motion="Omega*t"))
    return Mechanism(
        bodies=bodies,
        joints=joints,
        constraints=[rolling("contact", "ball", tube="r", **plane)],
        gravity=(0.0, 0.0, "-g"),
        parameters=parameters,
        name="ball on a table that turns" + (" and rises" if rising else ""),
    )


# --- the closed form ------------------------------------------------------------------------------


def _circle(t: float) -> tuple[float, float]:
    """Where the centre is above the table (m)."""
    c, s = math.cos(RATE * t), math.sin(RATE * t)
    x, y = START[0] - CENTRE[0], START[1] - CENTRE[1]
    return CENTRE[0] + c * x - s * y, CENTRE[1] + s * x + c * y


def _kinetic(t: float) -> float:
    """Kinetic energy of the ball without the lift: it rolls on what moves with Ω × r (J)."""
    x, y = _circle(t)
    vx, vy = -RATE * (y - CENTRE[1]), RATE * (x - CENTRE[0])
    slip2 = (vx + TURN * y) ** 2 + (vy - TURN * x) ** 2
    return 0.5 * MASS * (vx**2 + vy**2) + 0.5 * INERTIA * slip2 / RADIUS**2


def _lift(t: float) -> tuple[float, float]:
    """Height (m) and vertical velocity (m/s) of the table."""
    return RISE * (1 - math.cos(BEAT * t)), RISE * BEAT * math.sin(BEAT * t)


def _ball_kinetic(run: Trajectory) -> Array:
    v, w = _ball(run)
    total: Array = 0.5 * MASS * (v**2).sum(axis=1) + 0.5 * INERTIA * (w**2).sum(axis=1)
    return total


def _ball(run: Trajectory) -> tuple[Array, Array]:
    """Velocity of the centre and angular velocity, body components."""
    first = run.speeds.index("ball.vx")
    return run.u[:, first : first + 3], run.u[:, first + 3 : first + 6]


def _drilling(run: Trajectory) -> Array:
    """The vertical component of the angular velocity (rad/s): nothing turns the ball so."""
    first = run.coordinates.index("ball.qw")
    return rotated(run.q[:, first : first + 4], _ball(run)[1])[:, 2]


def _circular() -> dict[str, Signal]:
    """The centre of the circle, from where the ball is and how it moves."""
    return {
        "circle's centre x": lambda run: run.coordinate("ball.x") - run.speed("ball.vy") / RATE,
        "circle's centre y": lambda run: run.coordinate("ball.y") + run.speed("ball.vx") / RATE,
        "horizontal speed": lambda run: np.hypot(run.speed("ball.vx"), run.speed("ball.vy")),
    }
