"""What can be refused before a run is computed, and the grid that it is computed on."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from deltac.arrays import Array
from deltac.calls.caching import LRUCache
from deltac.dynamics.digits import NOISY, acceleration_error, noise
from deltac.dynamics.equations_of_motion import equations_of_motion, evaluate_at
from deltac.dynamics.singular_inertia import singular_inertia, unit_diagonal
from deltac.errors import (
    ArgumentsError,
    InputError,
    LimitError,
    SolverError,
    StateError,
    number_or_nan,
    warn_user,
)
from deltac.foreign.limits import Limits
from deltac.mechanism.coordinate_map import own_coordinates
from deltac.mechanism.events import Event
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.state import State
from deltac.simulation.equations import Controller, Equations
from deltac.simulation.flow import Keeping, Projection, StateFlow
from deltac.simulation.solvers import Solver
from deltac.simulation.stepping.interpreted import StageRate
from deltac.simulation.stepping.protocol import StepGrid

STEPS_OF_A_RUN = 10**15
"""Steps of a run at most: time is still told apart from step to step, and it would take years."""


def check_request(
    mechanism: Mechanism,
    solver: Solver,
    equations: Equations | None,
    controller: Controller | None,
    step: float | None,
) -> None:
    """InputError for arguments that do not go together, or not with the mechanism."""
    if step is not None:
        positive(step, "step")
    if solver.takes_steps and step is None:
        raise SolverError(f"solver {solver.name!r} takes fixed steps; give step= in seconds")
    motors = [motor.name for motor in mechanism.motors]
    if motors and controller is None:
        raise ArgumentsError(
            f"joint torque {motors[0]!r} has no law; give simulate a controller that sets it, or the "
            "joint torque a law"
        )
    if controller is not None and not motors:
        raise ArgumentsError(
            "a controller was given, but no joint torque is without a law; leave out the laws of the joint "
            "torques that it is to set"
        )
    if controller is not None and controller.hold and not solver.takes_steps:
        raise SolverError(
            f"solver {solver.name!r} chooses its own steps, over which a controller cannot be held; use a "
            "fixed-step solver such as 'ode5', or Controller(..., hold=False)"
        )
    if controller is not None and equations is not None:
        raise ArgumentsError(
            "equations by hand and a controller were both given; let the equations take the controller "
            "in, or use the mechanism's own dynamics"
        )


def check_events(mechanism: Mechanism, equations: Equations | None, switches: bool) -> bool:
    """Whether a run has events to look for; InputError where it cannot look for them."""
    if not mechanism.events and not switches:
        return False
    hits = [event.name for event in mechanism.events if not isinstance(event, Event)]
    if hits and equations is not None and own_coordinates(mechanism, equations.coordinates):
        raise ArgumentsError(
            f"impact or stop {hits[0]!r} and equations by hand in coordinates of their own cannot be "
            "combined; write the equations in the mechanism's coordinates, or leave them out"
        )
    return True


def check_correction(keeping: Keeping, solver: Solver, *, watching: bool) -> None:
    """InputError for a correction of the energy that does not go with the solver or with events."""
    if not (isinstance(keeping, Projection) and keeping.energy):
        return
    if solver.multistep or solver.family == "taylor":
        raise SolverError(
            f"the energy is corrected after each step, and solver {solver.name!r} builds on earlier states; "
            "use a one-step solver such as 'ode5', 'implicit-midpoint' or 'DOP853'"
        )
    if watching:
        raise ArgumentsError(
            "Projection(energy=True) cannot be combined with events (impacts, stops, switches): an impact "
            "loses energy that a correction would put back; leave one of them out"
        )


def check_derivatives(flow: StateFlow, solver: Solver, controller: Controller | None) -> None:
    """InputError where a solver differentiates what can only be called from Python."""
    if flow.traced and controller is None:
        return
    if solver.family == "implicit" and controller is not None and not controller.hold:
        raise SolverError(
            f"solver {solver.name!r} needs the derivatives of a controller that acts within steps, and they "
            "are unknown; use Controller(..., hold=True), or 'ode5'"
        )
    if solver.family in ("taylor", "sundials"):
        instead = "'ode5' or 'DOP853'" if solver.family == "taylor" else "'Radau' or 'BDF'"
        raise SolverError(
            f"solver {solver.name!r} needs equations in symbols; a function called from Python, or a "
            f"controller, cannot be differentiated. Use {instead}"
        )


class IllConditionedWarning(UserWarning):
    """The accelerations of a mechanism have few correct digits in double precision."""


INACCURATE, WORTHLESS = 1e-6, 0.1
"""Relative errors of the accelerations at the start that are told, and that are refused."""


def _tell_digits(
    mechanism: Mechanism, vary: Sequence[str], error: float, state: State, p: Array, *, tied: bool
) -> None:
    """StateError for accelerations without a digit, `IllConditionedWarning` for few; `error` is theirs."""
    if not error > INACCURATE:
        return
    free = mechanism.free
    M = equations_of_motion(mechanism, vary).ties(state.t, state.q[free.q], state.u[free.u], p)[0]
    words = (
        f"the accelerations of {mechanism.name!r} at the start are wrong by {error:.1g} of themselves in "
        f"double precision: {_contrast(mechanism, M, tied=tied)}"
    )
    remedy = (
        "Fasten what weighs nothing beside the rest (a fixed joint), or give it the mass of what it "
        "stands for"
    )
    if error > WORTHLESS:
        raise StateError(f"{words}. Its accelerations have no correct digit. {remedy}")
    warn_user(f"{words}. Nor can the run be better. {remedy}", IllConditionedWarning)


def _contrast(mechanism: Mechanism, M: Array, *, tied: bool) -> str:
    """Which speeds move hardly any inertia of their own, in words."""
    names = mechanism.speeds.free_names
    values, motions = np.linalg.eigh(unit_diagonal(M)[0])
    share = np.abs(motions[:, 0])
    which = [repr(names[int(k)]) for k in np.argsort(-share)[:3] if share[k] > 0.1 * share.max()]
    if values[0] > 1e-6 and not tied:
        return (
            "a body is very small beside the distances and speeds at which it moves, or large forces "
            "cancel"
        )
    if values[0] > 1e-6:  # it is the constraints
        return "constraints tie bodies of too different masses, or nearly the same motions"
    return (
        f"a motion of {', '.join(which)} has {max(values[0], 0.0):.1g} of the inertia that each has alone, "
        "as where a very light body carries a heavy one, or joints nearly coincide"
    )


def check_accelerations(
    flow: StateFlow,
    mechanism: Mechanism,
    controller: Controller | None,
    state: State,
    x0: Array,
    p: Array,
    vary: Sequence[str] = (),
    rows: Sequence[int] = (),
) -> None:
    """The accelerations at the start must be finite, have digits, and the mass matrix be regular.

    What was found of the last few starts is kept with the flow: many runs begin at one state.
    """
    if not np.isfinite(x0).all():
        raise StateError("the coordinate map has no finite own coordinates for the initial state")

    def accelerations(x: Array) -> Array:
        return np.asarray(evaluate_at(flow.rate, state.t, x, p)[0][flow.parts[1]])

    def relative_error() -> float:
        """InputError where there are no accelerations."""
        if flow.traced and controller is None:
            (xdot,) = evaluate_at(flow.rate, state.t, x0, p)
        else:
            rate = StageRate(flow, controller, p)
            rate.hold(state.t, x0)
            xdot = rate(state.t, x0)
        _, u_part, _ = flow.parts
        error = 0.0
        if flow.equations is None:
            free, motion = mechanism.free, equations_of_motion(mechanism, vary)
            M = motion.mass_matrix(state.t, state.q[free.q], p)
            if singular := singular_inertia(mechanism, M):
                raise singular
            suspect = False
            if flow.traced and controller is None and len(x0[u_part]) == len(M):
                suspect = noise(accelerations, M, x0) > NOISY
            at = (state.t, state.q[free.q], state.u[free.u], p)
            error = acceleration_error(motion, rows, *at, suspect=suspect)
        bad = np.flatnonzero(~np.isfinite(xdot[u_part]))
        if bad.size:
            names = mechanism.speeds.free_names
            which = ", ".join(repr(names[int(k)]) for k in bad if flow.own is None)
            raise StateError(
                f"the accelerations are not finite at the start (t = {state.t:g}) {which and 'for ' + which}"
                ": a law is not defined there, or equations by hand give no number"
            )
        return error

    if flow.traced and controller is None:
        cache = flow.once("starts", lambda: LRUCache[float](16))
        place = (state.t, *(a.tobytes() for a in (state.q, state.u, x0, p)))
        error = cache.get(place, relative_error)
    else:  # a function of the user may answer otherwise the next time
        error = relative_error()
    _tell_digits(mechanism, vary, error, state, p, tied=bool(rows))


def positive(value: float, what: str) -> float:
    """The value as a float; InputError unless it is positive and finite."""
    number = number_or_nan(value)
    if not (math.isfinite(number) and number > 0.0):
        raise InputError(f"{what} is {value!r}; expected a positive, finite number")
    return number


def count(value: int, what: str) -> int:
    """The value as an int; InputError unless it is one, and positive."""
    if not isinstance(value, int | np.integer) or value < 1:
        raise InputError(f"{what} is {value!r}; expected a whole number, 1 or more")
    return int(value)


def three_steps(duration: float, step: float) -> tuple[float, float, float]:
    """Steps of a study, each half of the previous one: down to `step`, or from it where 4 h do not divide."""
    coarsest = 4.0 * step
    whole = abs(round(duration / coarsest) * coarsest - duration) < 1e-9 * duration
    h = coarsest if whole else step
    return (h, h / 2, h / 4)


def whole_steps(duration: float, step: float | None, every: int) -> int:
    """How many steps make up the duration; InputError unless it is a whole number, and of `every`."""
    assert step is not None
    if not duration / step <= STEPS_OF_A_RUN:
        raise SolverError(
            f"step {step:g} goes {duration / step:.3g} times into the duration {duration:g}; expected at "
            f"most {STEPS_OF_A_RUN:.0e} steps, what can be counted and waited for. Give a larger step"
        )
    steps = round(duration / step)
    rows, most = steps // every + 1, Limits.current().rows
    if rows > most:
        raise LimitError(
            f"step {step:g} makes {rows:.3g} rows of the duration {duration:g}, more than {most:.3g}; give "
            f"record={10 ** math.ceil(math.log10(every * rows / most))}, or a larger step"
        )
    if steps < 1 or abs(steps * step - duration) > 1e-9 * duration:
        near = duration / max(1, math.ceil(duration / step))
        raise SolverError(
            f"step {step:g} does not divide the duration {duration:g} (it goes {duration / step:.6g} "
            f"times); the next smaller one that does is {near:.12g}"
        )
    if steps % every:
        raise SolverError(f"record: every = {every} does not divide the number of steps, {steps}")
    return steps


LOOKS = 8
"""How often a solver that goes from sample to sample looks for events between two of them."""


def sample_grid(
    start: float, duration: float, step: float | None, solver: Solver, *, watching: bool
) -> StepGrid | None:
    """Samples `step` apart, the end included; None for the own steps of a solver that tells them."""
    if step is None:
        if solver.family == "scipy":
            return None
        step = duration / 200
    looks = LOOKS if watching and solver.family != "scipy" else 1
    count = math.ceil(duration / step * looks * (1 - 1e-12))
    return StepGrid(start, step / looks, count, start + duration, looks)
