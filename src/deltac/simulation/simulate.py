"""One verb: `simulate` a mechanism, with testing functions integrated in the loop."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np

from deltac.caching import LRUCache
from deltac.dynamics.system import trace
from deltac.errors import InputError
from deltac.kernels import Kernel
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.mechanism import Mechanism, require_mechanism
from deltac.mechanism.state import State
from deltac.simulation.adaptive import run_scipy, run_taylor
from deltac.simulation.correction import check_correction_held
from deltac.simulation.course import Course
from deltac.simulation.equations import Controller, Equations, by_hand
from deltac.simulation.events.running import Outcome
from deltac.simulation.events.simulating import (
    check_events,
    eventful,
    run_with_events,
    with_occurrences,
)
from deltac.simulation.feasibility import constraint_start
from deltac.simulation.fixed import LONG_RUN, FixedStepper, run_in_python
from deltac.simulation.flow import Flow, Stabilisation, build_flow
from deltac.simulation.implicit import ImplicitStepper, check_radius
from deltac.simulation.observation import observer, recorded, while_assembled
from deltac.simulation.preparation import (
    check_accelerations,
    check_correction,
    check_request,
    count,
    positive,
    sample_times,
    whole_steps,
)
from deltac.simulation.solvers import Solver, find_solver
from deltac.simulation.stiffness import explained
from deltac.simulation.sundials import SUNDIALS, run_sundials
from deltac.simulation.time_scales import check_start
from deltac.trajectories import Provenance, Trajectory

DEFAULT_TOLERANCE = 1e-9


class SimulationStopped(UserWarning):
    """A run ended before its time; the trajectory holds what was computed."""


def simulate(
    mechanism: Mechanism,
    state: State,
    duration: float,
    step: float | None = None,
    solver: str = "ode5",
    testing: Sequence[str] = ("wang", "liu-huston"),
    equations: Equations | None = None,
    *,
    controller: Controller | None = None,
    tolerance: float | None = None,
    record_every: int = 1,
    speeds: CoordinateMap | None = None,
    stabilisation: Stabilisation = "projection",
    correct: str | None = None,
    spectral_radius: float | None = None,
    vary: Sequence[str] = (),
    switches: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Trajectory:
    """Simulate a mechanism from a state, and integrate the powers of testing functions with it.

    Args:
        mechanism: what moves.
        state: where it starts (`mechanism.state(...)`).
        duration: how long, s.
        step: of a fixed-step solver, s; it must divide the duration. For the others the spacing of
            samples; without it they are sampled at their own steps (Taylor, CVODES, IDAS: 200 samples).
        solver: a name or alias of `solver_names()`.
        testing: names of the testing functions whose power is integrated by the same solver and step;
            the integrals (J) are in the trajectory's `integrals`.
        equations: hand-written equations of motion in place of the mechanism's own.
        controller: sets the motors that have no law (`joint_torque` without torque).
        tolerance: relative tolerance of adaptive solvers (default 1e-9; Taylor: machine precision).
        record_every: keep every so many steps of a fixed-step solver.
        speeds: generalized speeds in which the Kane–Levinson functions divide the kinetic energy.
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
    require_mechanism(mechanism)
    found = find_solver(solver)
    duration = positive(duration, "duration")
    every = count(record_every, "record_every")
    check_request(mechanism, state, found, equations, controller, step, tolerance)
    radius = check_radius(found, spectral_radius)
    watching = check_events(mechanism, found, equations, switches)
    check_correction(correct, found, watching=watching)
    steps = whole_steps(duration, step, every) if found.takes_steps else 0
    check_start(mechanism, state, found, step)
    rows = constraint_start(mechanism, state, found, equations, stabilisation)
    flow, stepper, observe = _compiled(
        mechanism, found, testing, equations, speeds, vary, rows, stabilisation, correct, steps
    )
    if found.family == "taylor" and not (flow.traced and controller is None):
        raise InputError(
            f"solver {found.name!r} needs equations in symbols; a function called from Python, or a "
            "controller, cannot be differentiated. Use 'ode5' or 'DOP853'"
        )
    p = np.array([mechanism.parameters[name] for name in vary])
    x0 = flow.start(state, p)
    check_accelerations(flow, mechanism, controller, state, x0, p)
    tol = DEFAULT_TOLERANCE if tolerance is None else tolerance
    samples = None if step is None else sample_times(state.t, duration, step)
    outcome = None
    if watching:
        grid = (duration / steps, steps, every) if found.family == "fixed" else samples
        span, ready = (state.t, state.t + duration), eventful(flow, speeds, switches)
        outcome = run_with_events(ready, found, controller, p, x0, span, grid, tol, progress)
    match found.family:
        case _ if outcome is not None:
            motion = outcome.motion
        case "fixed":
            course = Course(p, x0, state.t, duration / steps, steps, every, progress)
            compiled = controller is None and flow.traced
            if not (isinstance(stepper, FixedStepper) and compiled and stepper.fusible):
                motion = run_in_python(flow, found, controller, course)
            else:
                motion = stepper.run(course)
        case "implicit":
            assert isinstance(stepper, ImplicitStepper)
            course = Course(p, x0, state.t, duration / steps, steps, every, progress)
            motion = stepper.run(controller, course, radius)
        case "adaptive" if found.name in SUNDIALS:
            times = sample_times(state.t, duration, duration / 200 if step is None else step)
            motion = run_sundials(flow, found, controller, p, x0, times, tol, progress)
        case "adaptive":
            span = (state.t, state.t + duration)
            motion = run_scipy(flow, found, controller, p, x0, samples, span, tol, progress)
        case _:
            times = sample_times(state.t, duration, duration / 200 if step is None else step)
            quad = found.name == "taylor-quad"
            motion = run_taylor(flow, p, x0, times, tolerance, progress, quad=quad)
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
        notes=_notes(mechanism, equations, controller, correct, outcome),
    )
    run = recorded(mechanism, flow, observe, motion, p, provenance)
    return run if outcome is None else with_occurrences(ready, outcome.events, run)


# --- compiled parts, kept between calls ----------------------------------------------------------

Stepper: TypeAlias = FixedStepper | ImplicitStepper | None

_KEPT: LRUCache[tuple[Flow, Stepper, Kernel]] = LRUCache(32)


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
) -> tuple[Flow, Stepper, Kernel]:
    """The flow, its compiled step and its observer; made once for all that differs in code."""
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
    )

    def make() -> tuple[Flow, Stepper, Kernel]:
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
        stepper: Stepper = None
        if solver.family == "fixed":
            stepper = FixedStepper(flow, solver, steps >= LONG_RUN)
        elif solver.family == "implicit":
            stepper = ImplicitStepper(flow, solver)
        return flow, stepper, observer(flow)

    return _KEPT.get(key, make)


def _notes(
    mechanism: Mechanism,
    equations: Equations | None,
    controller: Controller | None,
    correct: str | None,
    outcome: Outcome | None,
) -> dict[str, str]:
    notes: dict[str, str] = {}
    if correct is not None:
        notes["corrected"] = correct
    if outcome is not None and outcome.ended:
        notes["ended"] = outcome.ended
    if equations is not None:
        notes["equations"] = equations.name
    if controller is not None and controller.hold:
        notes["held"] = ";".join(f"actuator {motor.name}" for motor in mechanism.motors)
    return notes
