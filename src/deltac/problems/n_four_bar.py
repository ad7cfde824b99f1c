"""N four-bars in a row, IFToMM benchmark A02: loops that pass through singular configurations."""

from __future__ import annotations

import math

import numpy as np

from deltac.arrays import Array
from deltac.bodies import rod
from deltac.constraints import loop_revolute
from deltac.errors import InputError
from deltac.joints import revolute
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import G, Problem, Signal, energy, instant, instants, whole
from deltac.trajectories import Trajectory

TIP = {
    2: {
        1.0: (-0.1950203019494351, -0.9807992056621738),
        5.0: (-0.8113104610051074, -0.5846155453489755),
        10.0: (0.3284581115408154, 0.9445185381786010),
    },
    40: {10.0: (0.1805122266867284, 0.9835727405823116)},
}


def problem(n: int = 2) -> Problem:
    """`n` squares of slender rods (1 kg, 1 m) share their cranks; the tips start at 1 m/s.

    Raises InputError for a number of squares below one.
    """
    if not isinstance(n, int) or n < 1:
        raise InputError(f"n-four-bar: n is {n!r}, expected a whole number of squares, 1 or more")
    bodies = [rod(f"crank{k}", "m", "l") for k in range(n + 1)]
    bodies += [rod(f"coupler{k}", "m", "l") for k in range(1, n + 1)]
    joints, loops = [], []
    for k in range(n + 1):
        joints.append(revolute(f"crank{k}", "ground", f"crank{k}", position=(float(k), 0.0, 0.0)))
    for k in range(1, n + 1):
        name, end = f"coupler{k}", ("l", 0.0, 0.0)
        joints.append(revolute(name, f"crank{k - 1}", name, position=end))
        loops.append(loop_revolute(f"pin{k}", f"crank{k}", name, point1=end, point2=end))
    mechanism = Mechanism(
        bodies=bodies,
        joints=joints,
        constraints=loops,
        gravity=(0.0, "-g", 0.0),
        parameters={"m": 1.0, "l": 1.0, "g": G},
        name=f"{n} four-bars",
    )
    inertia, moment = _reduced(n)
    start = 0.5 * inertia + moment
    reference = [instant("energy", 10.0, energy(mechanism), start, "J", "exact", 1e-13 * start)]
    total = _energy(n)

    def drift(run: Trajectory) -> float:
        """The largest departure of the energy from its start: the community's measure."""
        return float(np.ptp(total(run)))

    reference.append(whole("largest energy error", drift, 0.0, "J", "exact", 1e-12 * start))
    tip: dict[str, Signal] = {
        "tip x": lambda run: np.cos(run.coordinate("crank0")),
        "tip y": lambda run: np.sin(run.coordinate("crank0")),
    }
    reference += instants(TIP.get(n, {}), tip, "m", "exact", 5e-16)
    upright = math.pi / 2
    return Problem(
        name="n-four-bar",
        title=f"{n} four-bars in a row (IFToMM A02)",
        mechanism=mechanism,
        state=mechanism.state(
            {f"crank{k}": upright for k in range(n + 1)}
            | {f"coupler{k}": -upright for k in range(1, n + 1)},
            {f"crank{k}": -1.0 for k in range(n + 1)}
            | {f"coupler{k}": 1.0 for k in range(1, n + 1)},
        ),
        duration=10.0,
        step=1e-3,
        solver="ode4",
        source="IFToMM Technical Committee for Multibody Dynamics, Library of Computational "
        "Benchmark Problems, A02 N-four-bar mechanism",
        freedom=1,
        invariants={"energy": total},
        reference=tuple(reference),
        notes="Whenever the cranks lie flat the freedom jumps from 1 to n + 1; the motion asked for "
        "goes on as parallelograms, and is that of the pendulum I q̈ = −M cos q with "
        "I = (n + 1)/3 + n and M = ((n + 1)/2 + n) g. The community's threshold is an energy error "
        "below 1e-3 J.",
    )


def _reduced(n: int) -> tuple[float, float]:
    """Moment of inertia (kg·m²) and weight moment (N·m) of all cranks as one pendulum."""
    return (n + 1) / 3 + n, ((n + 1) / 2 + n) * G


def _energy(n: int) -> Signal:
    """Rod by rod: the cranks about their pivots; the couplers by half their mass at each end's motion.

    A slender rod between points that move with v and w has m (v² + v·w + w²)/6. At a singular
    position angles are known to the root of rounding only, so no rod may stand for another here.
    """

    def signal(run: Trajectory) -> Array:
        total = np.zeros(len(run))
        for k in range(n + 1):
            angle, rate = run.coordinate(f"crank{k}"), run.speed(f"crank{k}")
            total += rate**2 / 6 + 0.5 * G * np.sin(angle)
            if k < n:
                turn = angle + run.coordinate(f"coupler{k + 1}")
                w = rate + run.speed(f"coupler{k + 1}")
                near = rate * np.exp(1j * angle)
                far = near + w * np.exp(1j * turn)
                total += (abs(near) ** 2 + (near * far.conj()).real + abs(far) ** 2) / 6
                total += G * (np.sin(angle) + 0.5 * np.sin(turn))
        return total

    return signal
