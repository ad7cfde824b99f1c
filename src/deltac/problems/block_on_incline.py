"""A block that slides down an incline and comes to rest by Coulomb friction."""

from __future__ import annotations

import math

from deltac.bodies import point_mass
from deltac.forces import friction_law, point_friction
from deltac.joints import prismatic
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import G, Problem, coordinate, instant, speed, whole, work
from deltac.trajectories import Trajectory

MASS, SLOPE, FRICTION, START = 2.0, math.radians(15.0), 0.5, 2.0


def problem(width: float = 5e-3) -> Problem:
    """Shoved down at 2 m/s; it stops after some 0.9 s. `width` of the regularisation, m/s."""
    pull, hold = G * math.sin(SLOPE), FRICTION * G * math.cos(SLOPE)
    down = (math.cos(SLOPE), 0.0, -math.sin(SLOPE))
    normal = (math.sin(SLOPE), 0.0, math.cos(SLOPE))
    mechanism = Mechanism(
        bodies=[point_mass("block", "m")],
        joints=[prismatic("s", "ground", "block", down)],
        forces=[
            point_friction(
                "incline",
                "block",
                f"m*{G}*{math.cos(SLOPE)!r}",
                friction_law("mu", width=width),
                normal=normal,
            )
        ],
        gravity=(0, 0, -G),
        parameters={"m": MASS, "mu": FRICTION},
        name="block on an incline",
    )
    stop = START / (hold - pull)
    early = 0.5
    distance = START * early - 0.5 * (hold - pull) * early**2
    strength = MASS * hold

    def heat(run: Trajectory) -> float:
        return -float(work(mechanism, "friction incline")(run)[-1])

    def shortfall(run: Trajectory) -> float:
        return strength * float(run.coordinate("s")[-1]) - heat(run)

    duration = 1.5
    # The maximum of x (1 − tanh x) is Lambert's W(1/e).
    bound = strength * 0.27846454276107374 * width * duration
    return Problem(
        name="block-on-incline",
        title="Block on an incline with Coulomb friction",
        mechanism=mechanism,
        state=mechanism.state(None, {"s": START}),
        duration=duration,
        step=1e-4,
        solver="ode5",
        source="closed form: heat μ m g cos α s; with tanh friction the time to the speed v is "
        "w [a y + b ln(a cosh y − b sinh y)]/(a² − b²), y = v/w, a = g sin α, b = μ g cos α",
        reference=(
            instant("s", early, coordinate("s"), distance, "m", "exact", 1e-14),
            instant(
                "heat",
                early,
                lambda run: -work(mechanism, "friction incline")(run),
                strength * distance,
                "J",
                "exact",
                1e-13,
            ),
            instant(
                "speed",
                0.9,
                speed("s"),
                speed_at(0.9, width),
                "m/s",
                "exact",
                1e-12,
            ),
            whole(
                "creep at last, instead of rest",
                lambda run: float(run.speed("s")[-1]),
                width * math.atanh(pull / hold),
                "m/s",
                "exact",
                1e-12,
            ),
            whole(
                "heat missing from μ m g cos α s", shortfall, 0.5 * bound, "J", "exact", 0.5 * bound
            ),
        ),
        notes=f"An ideal block stops at {stop:.6g} s. Regularised friction of the width w creeps on at "
        "w artanh(tan α/μ). Its heat falls short of μ m g cos α s by at most 0.2785 w μ m g cos α t, "
        "since v (1 − tanh(v/w)) <= 0.2785 w.",
    )


def speed_at(t: float, width: float) -> float:
    """The speed (m/s) at the time t (s), by bisection of the closed form."""
    a, b = G * math.sin(SLOPE), FRICTION * G * math.cos(SLOPE)

    def time(v: float) -> float:
        y = v / width
        # ln(a cosh y − b sinh y) + ln(…) of the start; e^y taken out, for y is large. Negative inside: |·|.
        log = y + math.log(abs((a - b) + (a + b) * math.exp(-2.0 * y)) / 2.0)
        return width * (a * y + b * log) / (a * a - b * b)

    low, high = width * math.atanh(a / b) * (1 + 1e-15), START
    for _ in range(200):
        middle = 0.5 * (low + high)
        # The speed falls: more time has passed at lower speeds.
        if time(middle) - time(START) > t:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
