"""The benchmark bicycle: two rolling wheels close a loop through frame, fork and ground."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from deltac.arrays import Array
from deltac.bodies import body
from deltac.constraints import rolling
from deltac.joints import free, revolute
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import G, Measure, Problem, Signal, energy, instants, whole
from deltac.trajectories import Trajectory

SPEED, NUDGE = 5.0, 1e-5
WHEELBASE, TRAIL, TILT = 1.02, 0.08, math.pi / 10
REAR, FRONT = 0.3, 0.35  # radii
# Published for 5 m/s, with 14 decimals.
EIGENVALUES: Mapping[str, float] = {
    "weave, real part": -0.77534188219585,
    "weave, imaginary part": 4.46486771378823,
    "capsize": -0.32286642900409,
    "caster": -14.07838969279822,
}
MASS = np.array([[80.81722, 2.31941332208709], [2.31941332208709, 0.29784188199686]])
DAMPING = np.array([[0.0, 33.86641391492494], [-0.85035641456978, 1.68540397397560]])
STIFFNESS = np.array([[-80.95, -2.59951685249872], [-2.59951685249872, -0.80329488458618]])
GYRO = np.array([[0.0, 76.59734589573222], [0.0, 2.65431523794604]])


def problem(speed: float = SPEED, nudge: float = NUDGE) -> Problem:
    """The Whipple bicycle of Meijaard et al. at 5 m/s, upright, tipped over at 1e-5 rad/s; 2 s.

    Args:
        speed: forward (m/s); the eigenvalues are references at 5 m/s.
        nudge: the lean rate at the start (rad/s); the linear references belong to 1e-5 rad/s.
    """
    axis = (math.sin(TILT), 0.0, math.cos(TILT))
    mechanism = Mechanism(
        bodies=[
            body("rear wheel", 2.0, (0.0603, 0.12, 0.0603)),
            body("rear frame", 85.0, ((9.2, 0, 2.4), (0, 11, 0), (2.4, 0, 2.8)), (0.3, 0, -0.9)),
            body(
                "fork",
                4.0,
                ((0.05892, 0, -0.00756), (0, 0.06, 0), (-0.00756, 0, 0.00708)),
                (0.9 - WHEELBASE - TRAIL, 0.0, -0.7),
            ),
            body("front wheel", 3.0, (0.1405, 0.28, 0.1405)),
        ],
        joints=[
            free("frame", "rear frame"),
            revolute("rear axle", "rear frame", "rear wheel", "y", position=(0, 0, -REAR)),
            revolute("steer", "rear frame", "fork", axis, position=(WHEELBASE + TRAIL, 0, 0)),
            revolute("front axle", "fork", "front wheel", "y", position=(-TRAIL, 0, -FRONT)),
        ],
        constraints=[
            rolling("rear contact", "rear wheel", REAR, axis="y", normal="-z"),
            rolling("front contact", "front wheel", FRONT, axis="y", normal="-z"),
        ],
        gravity=(0.0, 0.0, "g"),
        parameters={"g": G},
        name="benchmark bicycle",
    )
    reference = []
    if (speed, nudge) == (SPEED, NUDGE):
        reference = [
            # A motion of this size is linear to 1e-8, no better.
            whole(f"eigenvalue, {name}", _eigenvalue(name), value, "1/s", "published", 1e-8)
            for name, value in EIGENVALUES.items()
        ]
        per_nudge: dict[str, Signal] = {
            "lean per nudge": lambda run: _lean(run) / NUDGE,
            "steer per nudge": lambda run: run.coordinate("steer") / NUDGE,
        }
        motion = {t: linear(t, speed) for t in (0.5, 2.0)}
        reference += instants(motion, per_nudge, "s", "exact", 1e-9)
    return Problem(
        name="bicycle",
        title="Benchmark bicycle",
        mechanism=mechanism,
        state=mechanism.state(
            speeds={
                "frame.vx": speed,
                "frame.wx": nudge,
                "rear axle": -speed / REAR,
                "front axle": -speed / FRONT,
            }
        ),
        duration=2.0,
        step=5e-3,
        solver="ode8",
        source="J. P. Meijaard, J. M. Papadopoulos, A. Ruina, A. L. Schwab, Linearized dynamics "
        "equations for the balance and steer of a bicycle: a benchmark and review, Proc. R. Soc. A 463 "
        "(2007) 1955-1982",
        freedom=3,
        invariants={"energy": energy(mechanism)},
        reference=tuple(reference),
        notes="Axes as published: x forward, y to the right, z down. Lean φ and steer δ of a small "
        "motion obey M q̈ + v C1 q̇ + (g K0 + v² K2) q = 0; at 5 m/s the bicycle keeps itself upright.",
    )


def linear(t: float, v: float) -> tuple[float, float]:
    """Lean and steer (s) of the published linear equations after a unit lean rate, at speed v."""
    from scipy.linalg import expm

    A = np.zeros((4, 4))
    A[:2, 2:] = np.eye(2)
    A[2:, :2] = -np.linalg.solve(MASS, G * STIFFNESS + v**2 * GYRO)
    A[2:, 2:] = -np.linalg.solve(MASS, v * DAMPING)
    lean, steer = (expm(A * t) @ np.array([0.0, 0.0, 1.0, 0.0]))[:2]
    return float(lean), float(steer)


def _lean(run: Trajectory) -> Array:
    """The angle of the frame's lateral axis below the horizontal (rad)."""
    w, x, y, z = run.q[:, 3:7].T
    return np.asarray(np.arcsin(2 * (y * z + w * x)))


def _eigenvalue(name: str) -> Measure:
    """One of the four exponents of lean and steer, from how their states follow each other."""

    def measure(run: Trajectory) -> float:
        state = np.stack(
            [_lean(run), run.coordinate("steer"), run.speed("frame.wx"), run.speed("steer")]
        )
        rows = round(0.05 / (run.t[1] - run.t[0]))
        scale = np.abs(state).max(axis=1, keepdims=True)
        before, after = state[:, :-rows] / scale, state[:, rows:] / scale
        step = np.linalg.lstsq(before.T, after.T, rcond=None)[0]
        exponents = np.log(np.linalg.eigvals(step).astype(complex)) / (rows * (run.t[1] - run.t[0]))
        caster, *others = sorted(exponents, key=lambda s: s.real)
        weave = max(others, key=lambda s: s.imag)
        capsize = min(others, key=lambda s: abs(s.imag))
        parts = {
            "weave, real part": weave.real,
            "weave, imaginary part": weave.imag,
            "capsize": capsize.real,
            "caster": caster.real,
        }
        return float(parts[name])

    return measure
