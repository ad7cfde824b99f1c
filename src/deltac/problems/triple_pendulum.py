"""The triple pendulum of the thesis: three pinned bars, free, damped or driven (chapter 4)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np

from deltac.arrays import Array
from deltac.bodies import rod
from deltac.constraints import motion_constraint
from deltac.errors import InputError, UnknownName
from deltac.forces import joint_torque
from deltac.joints import revolute
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import (
    Problem,
    Reference,
    Signal,
    energy,
    instant,
    instants,
    kinetic,
    largest,
    work,
)
from deltac.problems.triple_pendulum_equations import HandEquations
from deltac.trajectories import Trajectory

if TYPE_CHECKING:
    from deltac.simulation.equations import Equations

G = 9.8
LENGTHS = (0.1, 0.25, 0.5)
WEIGHTS = (10.0, 30.0, 20.0)
START = (0.0, math.radians(60), math.radians(15))
REST = (0.0, 0.0, 0.0)
AMPLITUDE, FREQUENCY = 1.0, 0.75
DRIVES = ("torque", "motion", "constraint")

ANGLES = {
    1.0: (-0.442202449807, -0.113570311274, -0.484708067247),
    10.0: (0.173835751447, 0.171289392334, -0.750730237236),
}
FAST_ANGLES = {1.0: (0.220530649209, -0.599235042811, -1.283383316285)}
DRIVEN_ANGLES = {
    1.0: (-0.436525347726, -0.186881114173),
    10.0: (-0.061950429755, 1.196305502971),
}


def problem(
    start: Sequence[float] = START,
    rates: Sequence[float] = REST,
    weights: Sequence[float] = WEIGHTS,
    damping: float | Sequence[float] = 0.0,
    drive: Literal["torque", "motion", "constraint"] | None = None,
    mistake: bool = False,
) -> Problem:
    """The pendulum of fig. 4.1, or another of the thesis's experiments.

    Args:
        start: absolute angles θ of the three bars from the downward vertical (rad).
        rates: their rates (rad/s).
        weights: of the three bars (N), at g = 9.8 m/s².
        damping: of the three joints' dampers, on relative rates (N·m·s/rad); one value serves all.
        drive: "motion": bar 1 moves as θ1 = A sin wt, and what drives it follows (figs. 4.4-4.6);
            "torque": bar 1 is free, and a controller or a log supplies the joint torque "M1";
            "constraint": bar 1 is free but for the motion constraint θ̇1 − Aw cos wt = 0.
        mistake: the hand-written equations have the sign mistake of fig. 4.7.

    With a drive, the first angle and rate are those of its motion at t = 0: leave them at zero.

    Raises InputError for an unknown drive, a wrong number of values, and a start against the drive.
    """
    if drive not in (None, *DRIVES):
        raise UnknownName(
            f"triple pendulum: drive is {drive!r}; known: None, {', '.join(map(repr, DRIVES))}"
        )
    theta, omega = _three(start, "start"), _three(rates, "rates")
    loads = _three(weights, "weights")
    dampers = _three((damping,) * 3 if isinstance(damping, int | float) else damping, "damping")
    if drive is not None:
        if theta[0] != 0.0 or omega[0] != 0.0:
            raise InputError(
                f"triple pendulum: bar 1 starts by its drive, found start[0] = {theta[0]:g} and "
                f"rates[0] = {omega[0]:g}; leave them at zero"
            )
        omega = (AMPLITUDE * FREQUENCY, *omega[1:])
    mechanism = _mechanism(loads, dampers, drive)
    hand = HandEquations.of(mechanism.parameters, mistake=mistake)
    right = HandEquations.of(mechanism.parameters)
    conservative = drive is None and not any(dampers)
    return Problem(
        name="driven-triple-pendulum" if drive == "motion" else "triple-pendulum",
        title="Triple pendulum" if drive is None else f"Triple pendulum, driven by a {drive}",
        mechanism=mechanism,
        state=mechanism.state(_relative(theta), _relative(omega)),
        duration=10.0,
        step=1e-3,
        solver="ode5",
        source="K. Gugaratshan, Investigative study on an energy theorem for developing testing "
        "functions for numerical simulations of multibody dynamic systems, M.S.E. thesis, Western "
        "Michigan University, 2008, chapters 3 and 4",
        invariants={"energy": _energy(right)} if conservative else {},
        reference=_reference(mechanism, right, drive, (theta, omega, loads, dampers)),
        equations=_equations(hand, drive),
        freedom=2 if drive == "constraint" else None,
        notes="The mechanism's coordinates are relative angles; the equations written by hand use "
        "absolute ones." + (" They have the sign mistake of fig. 4.7." if mistake else ""),
    )


def driving_torque(mechanism: Mechanism, run: Trajectory) -> Array:
    """M1 (T,) of fig. 4.5 by the hand-written equations: it makes bar 1 move as specified (N·m)."""
    hand = HandEquations.of(mechanism.parameters)
    theta, omega = _absolute(run)
    torque: Array = hand.driving_torque(run.t, theta[1:], omega[1:])
    return torque


# --- the parts ------------------------------------------------------------------------------------


def _mechanism(weights: Sequence[float], damping: Sequence[float], drive: str | None) -> Mechanism:
    parameters = {"g": G}
    for k in range(3):
        n = k + 1
        parameters |= {f"m{n}": weights[k] / G, f"l{n}": LENGTHS[k], f"c{n}": damping[k]}
    if drive is not None:
        parameters |= {"A": AMPLITUDE, "w": FREQUENCY}
    bodies = [rod(f"bar{n}", f"m{n}", f"l{n}", along="-y") for n in (1, 2, 3)]
    motion = "A*sin(w*t)" if drive == "motion" else None
    joints = [revolute("joint1", "ground", "bar1", damping="c1", motion=motion)]
    for n in (2, 3):
        above, end = f"bar{n - 1}", (0.0, f"-l{n - 1}", 0.0)
        joints.append(revolute(f"joint{n}", above, f"bar{n}", position=end, damping=f"c{n}"))
    return Mechanism(
        bodies=bodies,
        joints=joints,
        forces=[joint_torque("M1", "joint1")] if drive == "torque" else [],
        constraints=[motion_constraint("drive", "u.joint1 - A*w*cos(w*t)")]
        if drive == "constraint"
        else [],
        gravity=(0.0, "-g", 0.0),
        parameters=parameters,
        name="triple pendulum",
    )


def _equations(hand: HandEquations, drive: str | None) -> Equations | None:
    """The hand-written equations; with a torque from outside there is nothing to write down."""
    from deltac.simulation.equations import Equations

    third = "q.theta3 - q.theta2"
    if drive is None:
        absolute = CoordinateMap(
            ("theta1", "theta2", "theta3"),
            q={"joint1": "q.theta1", "joint2": "q.theta2 - q.theta1", "joint3": third},
        )
        return Equations(hand.free, absolute, name="Lagrange's equations (3.1.17)-(3.1.19)")
    if drive == "motion":
        absolute = CoordinateMap(
            ("theta2", "theta3"), q={"joint2": "q.theta2 - A*sin(w*t)", "joint3": third}
        )
        return Equations(hand.driven, absolute, name="Lagrange's equations (3.1.18)-(3.1.19)")
    return None


def _reference(
    mechanism: Mechanism,
    hand: HandEquations,
    drive: str | None,
    run: tuple[tuple[float, ...], ...],
) -> tuple[Reference, ...]:
    """The numbers known of a run: the energy of any, and more of the thesis's own."""
    theta, omega, weights, damping = run
    start = float(hand.energy(np.array(theta), np.array(omega)))
    references = [instant("energy", 0.0, energy(mechanism), start, "J", "exact", 1e-14)]
    if weights != WEIGHTS or theta != START or any(damping):
        return tuple(references)
    if drive is None and omega == REST:
        references += _angles(ANGLES, 0)
    elif drive is None and omega == (10.0, 0.0, 0.0):
        references.append(instant("K", 0.0, kinetic(mechanism), 2.721, "J", "published", 5e-4))
        references += _angles(FAST_ANGLES, 0)
    elif drive in ("motion", "constraint") and omega[1:] == (0.0, 0.0):
        inertia = sum(weights[1:]) / G + weights[0] / G / 3  # bars 2 and 3 ride on the end of bar 1
        riding = 0.5 * inertia * (LENGTHS[0] * AMPLITUDE * FREQUENCY) ** 2
        references.append(instant("K", 0.0, kinetic(mechanism), riding, "J", "exact", 1e-14))
        references += _angles(DRIVEN_ANGLES, 1)
        driver = "prescribed joint1" if drive == "motion" else "constraint drive"
        motor = work(mechanism, driver)
        references.append(
            instant("motor work Q", 10.0, motor, 2.291822080477, "J", "calculated", 1e-12)
        )
        references.append(_extreme_torque("least", -10.954016230, -1, driver))
        references.append(_extreme_torque("largest", 12.152178548, 1, driver))
    return tuple(references)


def _angles(values: Mapping[float, Sequence[float]], first: int) -> list[Reference]:
    signals = {f"θ{k + 1}": _angle(k) for k in range(first, 3)}
    return instants(values, signals, "rad", "calculated", 1e-12)


def _angle(bar: int) -> Signal:
    return lambda run: _absolute(run)[0][bar]


def _energy(hand: HandEquations) -> Signal:
    def signal(run: Trajectory) -> Array:
        values: Array = hand.energy(*_absolute(run))
        return values

    return signal


def _extreme_torque(which: str, value: float, sign: int, driver: str) -> Reference:
    return Reference(
        quantity=f"{which} driving torque M1",
        value=value,
        unit="N·m",
        kind="calculated",
        accuracy=1e-9,
        measure=largest(lambda run: run.forces[driver][:, 0], sign),
    )


def _absolute(run: Trajectory) -> tuple[Array, Array]:
    """Absolute angles and rates (3, T) from the joints' relative ones."""
    return np.cumsum(run.q, axis=1).T, np.cumsum(run.u, axis=1).T


def _relative(values: Sequence[float]) -> dict[str, float]:
    """The joints' values from the bars' absolute ones."""
    first, second, third = values
    return {"joint1": first, "joint2": second - first, "joint3": third - second}


def _three(values: Sequence[float], what: str) -> tuple[float, float, float]:
    if isinstance(values, str | int | float) or len(values) != 3:
        raise InputError(f"triple pendulum: {what} is {values!r}, expected three numbers")
    a, b, c = (float(value) for value in values)
    return (a, b, c)
