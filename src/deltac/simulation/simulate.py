"""One verb: `simulate` a mechanism, with testing functions integrated in the loop."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.caching import LRUCache
from deltac.deprecation import renamed_keywords
from deltac.dynamics.system import trace
from deltac.kernels import Kernel
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.mechanism import Mechanism
from deltac.models import ModelLike, StateLike, opened
from deltac.simulation.arguments import (
    check_accelerations,
    check_correction,
    check_derivatives,
    check_events,
    check_request,
    count,
    positive,
    sample_grid,
    whole_steps,
)
from deltac.simulation.constraints.energy import check_correction_held
from deltac.simulation.constraints.feasibility import constraint_start
from deltac.simulation.constraints.singular import CarefulStep
from deltac.simulation.equations import Controller, Equations, by_hand
from deltac.simulation.events.run import Eventful, EventRun, eventful
from deltac.simulation.flow import Flow, Stabilisation, build_flow
from deltac.simulation.recording import observer, recorded, while_assembled, with_occurrences
from deltac.simulation.solvers import Solver, find_solver
from deltac.simulation.step_size.stiffness import explained
from deltac.simulation.step_size.time_scales import check_start
from deltac.simulation.stepping.explicit import (
    INSTRUCTIONS_PER_CALL,
    INSTRUCTIONS_PER_CALL_OF_LONG_RUNS,
    LONG_RUN,
    FixedMethod,
    FixedSteps,
)
from deltac.simulation.stepping.implicit import ImplicitMethod, ImplicitSteps, check_radius
from deltac.simulation.stepping.interpreted import Finish, StageRate, numeric_masks
from deltac.simulation.stepping.loop import Loop
from deltac.simulation.stepping.protocol import StepGrid, Stepper
from deltac.simulation.stepping.scipy import ScipySteps
from deltac.simulation.stepping.sundials import SundialsSteps
from deltac.simulation.stepping.taylor import TaylorSteps
from deltac.trajectories import Provenance, Trajectory

DEFAULT_TOLERANCE = 1e-9


class SimulationStopped(UserWarning):
    """A run ended before its time; the trajectory holds what was computed."""


@renamed_keywords(mechanism="model", speeds="coordinates")
def simulate(
    model: ModelLike,
    state: StateLike = None,
    duration: float | None = None,
    step: float | None = None,
    solver: str = "ode5",
    testing: Sequence[str] = ("wang", "liu-huston"),
    equations: Equations | Callable[..., Any] | None = None,
    *,
    controller: Controller | None = None,
    tolerance: float | None = None,
    record_every: int = 1,
    coordinates: CoordinateMap | None = None,
    stabilisation: Stabilisation = "projection",
    correct: str | None = None,
    spectral_radius: float | None = None,
    vary: Sequence[str] = (),
    switches: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Trajectory:
    """Simulate a mechanism from a state, and integrate the powers of testing functions with it.

    Args:
        model: what moves: a Mechanism, a Problem, or what else `load_model` takes.
        state: where it starts (`mechanism.state(...)`), or values by name; by default the model's own start.
        duration: how long, s; by default the problem's.
        step: of a fixed-step solver, s; it must divide the duration. For the others the spacing of
            samples; without it they are sampled at their own steps (Taylor, CVODES, IDAS: 200 samples).
        solver: a name or alias of `solver_names()`.
        testing: names of the testing functions whose power is integrated by the same solver and step;
            the integrals (J) are in the trajectory's `integrals`.
        equations: hand-written equations of motion in place of the mechanism's own: `Equations`, or a
            function of (t, q, u) that returns u̇, in the mechanism's own coordinates.
        controller: sets the motors that have no law (`joint_torque` without torque).
        tolerance: relative tolerance of adaptive solvers (default 1e-9; Taylor: machine precision).
        record_every: keep every so many steps of a fixed-step solver.
        coordinates: own generalized speeds in which the Kane–Levinson functions divide the kinetic energy.
        stabilisation: how the run stays on its constraints: "projection" of q and u after each step (least
            in the mass metric), Baumgarte's (α, β) in 1/s, or "none".
        correct: "energy" brings the state back to ΔC = 0 of Wang's function after each step of a fixed-step
            solver, by the least change in the mass metric. What that does to the energy is booked as
            `correction energy`, so ΔC still shows what the solver lost; what the corrected motion is
            worth, it does not show.
        spectral_radius: of the generalized-α solver at infinite frequency, from 0 (what is fast is gone
            in a step) to 1 (no numerical damping); default 0.8.
        vary: parameters that stay parameters of the compiled code, so that other values of them need no
            new compilation.
        switches: find the instants at which a law has a kink or a jump (abs, sign, min, max, where), and
            let no step go across one: the solver keeps its order.
        progress: called with the fraction done.

    Returns:
        Trajectory with q, u, u̇ of all joints, the forces (channels ``prescribed`` and ``actuator``) that
        drove it, and the integrals. A run whose state ceases to be finite, or whose implicit step has no
        solution, stops there with a warning `SimulationStopped`; the trajectory keeps what there is and its
        provenance says when and why.

    Raises:
        InputError: before anything is computed, for what cannot be simulated as it is.

    Warns:
        EnergyLeft: corrections of the energy could not keep up with what the steps lost.
        StiffStep: the step is far too large for friction, contact, or the mechanism; tells the time scale.
    """
    mechanism, state, duration = opened(model, state, duration)
    if equations is not None and not isinstance(equations, Equations):
        equations = Equations(equations)
    found = find_solver(solver)
    duration = positive(duration, "duration")
    every = count(record_every, "record_every")
    check_request(mechanism, state, found, equations, controller, step, tolerance)
    radius = check_radius(found, spectral_radius)
    watching = check_events(mechanism, equations, switches)
    check_correction(correct, found, watching=watching)
    steps = whole_steps(duration, step, every) if found.takes_steps else 0
    check_start(mechanism, state, found, step)
    rows = constraint_start(mechanism, state, found, equations, stabilisation)
    made = _compiled(
        mechanism,
        found,
        testing,
        equations,
        coordinates,
        vary,
        rows,
        stabilisation,
        correct,
        steps,
        watching,
        switches,
    )
    flow = made.flow
    check_derivatives(flow, found, controller)
    p = np.array([mechanism.parameters[name] for name in vary])
    x0 = flow.start(state, p)
    check_accelerations(flow, mechanism, controller, state, x0, p)
    if found.takes_steps:
        h = duration / steps
        grid: StepGrid | None = StepGrid(state.t, h, steps, state.t + steps * h, every)
    else:
        grid = sample_grid(state.t, duration, step, found, watching=watching)
    ready, moving = made.events, made.moving
    rate = StageRate(moving, controller, p)
    events = None
    if ready is not None:
        rate.hold(state.t, x0)
        events = ready.run(rate, p, state.t, x0)
        p_run = events.p
    else:
        p_run = p
    compiled = flow.traced and controller is None
    stepper = _stepper(made, found, rate, p_run, tolerance, radius, compiled=compiled)
    careful = None
    if found.step is not None and compiled and flow.bound is not None and equations is None:
        careful = CarefulStep(moving, found, numeric_masks(moving), p_run)
    loop = Loop(
        stepper,
        rate,
        Finish(moving, p_run),
        state.t,
        x0,
        grid.end if grid is not None else state.t + duration,
        grid,
        careful,
        events,
        progress,
    )
    motion = loop.run()
    if found.family == "fixed":
        motion = explained(flow, found, duration / steps, p, x0, motion)
    motion = while_assembled(flow, motion, p)
    if motion.message:
        warnings.warn(motion.message, SimulationStopped, stacklevel=2)
    if correct is not None:
        check_correction_held(flow, motion.t, motion.x, p)
    provenance = Provenance(
        simulator="deltac",
        solver=found.name,
        step=step if found.takes_steps else None,
        tolerance=tolerance,
        model=mechanism.name,
        model_hash=mechanism.hash,
        completed=not motion.message,
        message=motion.message,
        notes=_notes(mechanism, equations, controller, correct, events),
    )
    run = recorded(mechanism, flow, made.observe, motion, p, provenance)
    if events is None:
        return run
    return with_occurrences(moving, made.observe_events, events.happened, run)


# --- compiled parts, kept between calls ----------------------------------------------------------

Method: TypeAlias = FixedMethod | ImplicitMethod | None


@dataclass(frozen=True, eq=False)
class Compiled:
    """What runs that differ in numbers alone share.

    `moving` is the flow that the solver integrates: `flow`, with its branches held where they are events.
    """

    flow: Flow
    moving: Flow
    method: Method
    events: Eventful | None
    observe: Kernel
    observe_events: Kernel


_KEPT: LRUCache[Compiled] = LRUCache(32)


def _compiled(
    mechanism: Mechanism,
    solver: Solver,
    testing: Sequence[str],
    equations: Equations | None,
    speeds: CoordinateMap | None,
    vary: Sequence[str],
    rows: tuple[int, ...],
    stabilisation: Stabilisation,
    correct: str | None,
    steps: int,
    watching: bool,
    switches: bool,
) -> Compiled:
    """The flow, its solver's method and its observer; made once for all that differs in code."""
    written = None if equations is None else by_hand(trace(mechanism, vary), equations)
    key = (
        mechanism.digest(vary),
        solver.name,
        tuple(testing),
        None if written is None else written.key,
        speeds,
        tuple(vary),
        rows,
        stabilisation,
        correct,
        steps >= LONG_RUN,
        watching,
        switches,
    )

    def make() -> Compiled:
        flow = build_flow(
            mechanism,
            testing,
            written,
            speeds,
            vary,
            rows,
            stabilisation,
            correcting=correct == "energy",
        )
        events = eventful(flow, speeds, switches) if watching else None
        moving = flow if events is None else events.flow
        method: Method = None
        if solver.family == "fixed":
            method = FixedMethod(moving, solver, _room(steps, watching=watching))
        elif solver.family == "implicit":
            method = ImplicitMethod(moving, solver)
        observe = observer(flow)
        return Compiled(
            flow, moving, method, events, observe, observer(moving) if switches else observe
        )

    return _KEPT.get(key, make)


def _room(steps: int, *, watching: bool) -> int:
    """Instructions that steps fused into one call may have; with events they are looked at one by one."""
    if watching:
        return 0
    return INSTRUCTIONS_PER_CALL_OF_LONG_RUNS if steps >= LONG_RUN else INSTRUCTIONS_PER_CALL


def _stepper(
    made: Compiled,
    solver: Solver,
    rate: StageRate,
    p: NDArray[np.float64],
    tolerance: float | None,
    radius: float,
    *,
    compiled: bool,
) -> Stepper:
    """What takes the steps of one run."""
    flow, method = made.moving, made.method
    if isinstance(method, FixedMethod):
        return FixedSteps(method, rate, p, compiled=compiled)
    if isinstance(method, ImplicitMethod):
        return ImplicitSteps(method, rate, p, radius)
    if solver.family == "taylor":
        return TaylorSteps(flow, p, tolerance, quad=solver.name == "taylor-quad")
    accepted = DEFAULT_TOLERANCE if tolerance is None else tolerance
    if solver.family == "sundials":
        return SundialsSteps(flow, solver, p, accepted)
    return ScipySteps(flow, solver, rate, p, accepted, compiled=compiled)


def _notes(
    mechanism: Mechanism,
    equations: Equations | None,
    controller: Controller | None,
    correct: str | None,
    events: EventRun | None,
) -> dict[str, str]:
    notes: dict[str, str] = {}
    if correct is not None:
        notes["corrected"] = correct
    if events is not None and events.ended:
        notes["ended"] = events.ended
    if equations is not None:
        notes["equations"] = equations.name
    if controller is not None and controller.hold:
        notes["held"] = ";".join(f"actuator {motor.name}" for motor in mechanism.motors)
    return notes
