"""A free particle described in a turning frame: where the testing function of 1988 goes wrong."""

from __future__ import annotations

from deltac.arrays import Array
from deltac.bodies import frame, point_mass
from deltac.joints import prismatic
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import Problem, coordinate, delta_c_range, instants, whole
from deltac.trajectories import Trajectory

MASS, SPIN = 1.3, 0.7
POSITION, VELOCITY = (1.0, 0.2), (0.3, -0.5)


def problem() -> Problem:
    """Uniform motion in the plane for 3 s; generalized speeds u = q̇ − Ω J q along fixed axes."""
    mechanism = Mechanism(
        bodies=[frame("carriage"), point_mass("particle", "m")],
        joints=[
            prismatic("x", "ground", "carriage", "x"),
            prismatic("y", "carriage", "particle", "y"),
        ],
        parameters={"m": MASS, "Omega": SPIN},
        name="free particle",
    )
    coordinates = CoordinateMap(
        speeds=("along_x", "along_y"),
        u={"x": "u.along_x - Omega*q.y", "y": "u.along_y + Omega*q.x"},
    )
    duration = 3.0
    # What the form of 1988 adds, ∫ −m Ω² q·u dt = −½ m Ω² (|q|² − |q(0)|²), grows all the time.
    end = tuple(x + v * duration for x, v in zip(POSITION, VELOCITY, strict=True))
    growth = sum(x**2 for x in end) - sum(x**2 for x in POSITION)
    return Problem(
        name="free-particle",
        title="Free particle in turning coordinates",
        mechanism=mechanism,
        state=mechanism.state(POSITION, VELOCITY),
        duration=duration,
        step=1e-2,
        solver="ode4",
        source="T. R. Kane, D. A. Levinson, J. Appl. Mech. 55 (1988) 711-715 and 57 (1990) 248-249 "
        "(the smallest case in which they differ)",
        invariants={
            "energy": _energy,
            "linear momentum x": lambda run: MASS * run.speed("x"),
            "linear momentum y": lambda run: MASS * run.speed("y"),
            "angular momentum": _angular_momentum,
            "K2 − K0": _generalized_energy,
        },
        reference=(
            *instants({duration: end}, {a: coordinate(a) for a in "xy"}, "m", "exact", 1e-15),
            whole(
                "range of ΔC by Kane and Levinson 1988",
                delta_c_range(mechanism, coordinates, "kane-levinson-1988"),
                0.5 * MASS * SPIN**2 * growth,
                "J",
                "exact",
                1e-15,
            ),
        ),
        coordinates=coordinates,
        notes="u is the velocity relative to a frame that turns at Ω, resolved along fixed axes. "
        "Kane and Levinson 1988 fails; their form of 1990, Liu and Huston's and Wang's hold.",
    )


def _energy(run: Trajectory) -> Array:
    vx, vy = run.speed("x"), run.speed("y")
    return 0.5 * MASS * (vx**2 + vy**2)


def _angular_momentum(run: Trajectory) -> Array:
    x, y = run.coordinate("x"), run.coordinate("y")
    vx, vy = run.speed("x"), run.speed("y")
    return MASS * (x * vy - y * vx)


def _generalized_energy(run: Trajectory) -> Array:
    """½m|u|² − ½mΩ²|q|² with u = q̇ − Ω J q, J the turn by a right angle."""
    x, y = run.coordinate("x"), run.coordinate("y")
    vx, vy = run.speed("x"), run.speed("y")
    relative = (vx + SPIN * y) ** 2 + (vy - SPIN * x) ** 2
    return 0.5 * MASS * (relative - SPIN**2 * (x**2 + y**2))
