"""One verb: `simulate` a mechanism, with testing functions integrated in the loop."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from deltac.arrays import Array
from deltac.calls.caching import LRUCache
from deltac.calls.progress import Progress
from deltac.dynamics.coordinates import check_split
from deltac.dynamics.equations_of_motion import equations_of_motion, evaluate_at
from deltac.errors import warn_user
from deltac.kernels import Kernel
from deltac.mechanism.channels import ChannelName
from deltac.mechanism.coordinate_map import CoordinateMap, own_coordinates
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.state import State
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
from deltac.simulation.equations import Controller, Equations, RightHandSide, as_equations, by_hand
from deltac.simulation.flow import Keeping, StateFlow, build_flow, keeping
from deltac.simulation.recording import (
    RECORD,
    Record,
    observed,
    observer,
    recorded,
    while_assembled,
    with_occurrences,
)
from deltac.simulation.solvers import (
    GeneralizedAlpha,
    Options,
    Scipy,
    Solver,
    Sundials,
    Taylor,
    find_solver,
    solver_options,
)
from deltac.simulation.step_size.energy_error import energy_error, refuted
from deltac.simulation.step_size.sizes import state_sizes
from deltac.simulation.step_size.stiffness import explained
from deltac.simulation.step_size.time_scales import check_start
from deltac.simulation.stepping.explicit import FixedMethod, FixedSteps
from deltac.simulation.stepping.interpreted import Finish, StageRate
from deltac.simulation.stepping.loop import SteppingLoop
from deltac.simulation.stepping.protocol import StepGrid, Stepper
from deltac.trajectories import Provenance, Trajectory

if TYPE_CHECKING:
    from deltac.simulation.events.run import Eventful, EventRun
    from deltac.simulation.stepping.implicit.stepper import ImplicitMethod


class SimulationStoppedWarning(UserWarning):
    """A run ended before its time; the trajectory holds what was computed."""


def simulate(
    mechanism: Mechanism,
    state: State,
    duration: float,
    step: float | None = None,
    solver: str | Options = "ode5",
    record: Record | Sequence[str] | int = RECORD,
    equations: Equations | RightHandSide | None = None,
    *,
    controller: Controller | None = None,
    constraints: str | Keeping = "projection",
    progress: Progress | None = None,
) -> Trajectory:
    """Simulate a mechanism from a state: the core of `deltac.simulate`, which says what the arguments are."""
    vary = mechanism.varied
    options = solver_options(solver)
    scheme, recording, policy = options.solver, Record.of(record), keeping(constraints)
    equations = None if equations is None else as_equations(equations)
    duration = positive(duration, "duration")
    every = 1 if recording.every is None else count(recording.every, "record: every")
    check_request(mechanism, scheme, equations, controller, step)
    watching = check_events(mechanism, equations, options.switches)
    check_correction(policy, scheme, watching=watching)
    steps = whole_steps(duration, step, every) if scheme.takes_steps else 0
    check_start(mechanism, state, scheme, step)
    rows = constraint_start(mechanism, state, scheme, policy)
    code = _compiled(
        mechanism,
        scheme,
        recording,
        equations,
        vary,
        rows,
        policy,
        watching=watching,
        switches=options.switches,
    )
    flow = code.flow
    check_derivatives(flow, scheme, controller)
    p = np.array([mechanism.parameters[name] for name in vary])
    if flow.split is not None and flow.bound is not None:
        q0 = state.q[mechanism.free.q][:, None]
        check_split(flow.system, flow.split, flow.bound.rows, np.array([state.t]), q0, p)
    x0 = flow.start(state, p)
    check_accelerations(flow, mechanism, controller, state, x0, p, vary, rows)
    if scheme.takes_steps:
        h = duration / steps
        grid: StepGrid | None = StepGrid(state.t, h, steps, state.t + steps * h, every)
    else:
        grid = sample_grid(state.t, duration, step, scheme, watching=watching)
    eventful, flow_in_motion = code.events, code.flow_in_motion
    rate = StageRate(flow_in_motion, controller, p)
    events = None
    if eventful is not None:
        from deltac.simulation.events.run import EventRun, check_apart

        events = EventRun(
            eventful.watch, eventful.collider, rate, p
        )  # gives the rate sides of its laws
        rate.hold(state.t, x0)
        check_apart(events, state.t, x0)
        p_run = events.p
    else:
        p_run = p
    compiled = flow.traced and controller is None
    stepper = _stepper(code, options, rate, p_run, state.t, x0, duration, compiled=compiled)
    careful = None
    if scheme.passes_singular and compiled and flow.bound is not None and equations is None:
        from deltac.simulation.constraints.singular import CarefulStep

        explicit = scheme if scheme.step else find_solver("ode5")
        careful = CarefulStep(flow_in_motion, explicit, p_run, getattr(options, "tolerance", 0.0))
    loop = SteppingLoop(
        stepper,
        rate,
        Finish(flow_in_motion, p_run),
        state.t,
        x0,
        grid.end if grid is not None else state.t + duration,
        grid,
        careful,
        events,
        progress,
    )
    motion = loop.run()
    if scheme.family == "fixed":
        motion = explained(flow, scheme, duration / steps, p, x0, motion)
    columns = observed(flow, code.observe, motion, p)
    motion = while_assembled(flow, motion, columns)
    error = energy_error(flow, columns, motion) if flow.testing else None
    provenance = Provenance(
        simulator="deltac",
        solver=scheme.name,
        step=step if scheme.takes_steps else None,
        tolerance=getattr(options, "tolerance", None),
        model=mechanism.name,
        model_hash=mechanism.hash,
        completed=not motion.message,
        energy_error=None if error is None else error.largest,
        **_circumstances(mechanism, equations, controller, flow, events, recording.coordinates),
    )
    if error is not None:
        motion = refuted(flow, scheme, error, motion, p, provenance)
    if motion.message:
        warn_user(motion.message, SimulationStoppedWarning)
        provenance = replace(provenance, message=motion.message)
    if flow.correcting:
        check_correction_held(flow, motion.t, motion.x, p)
    run = recorded(mechanism, flow, columns, motion, p, provenance, guarded=careful is not None)
    if events is None:
        return run
    return with_occurrences(flow_in_motion, code.observe_events, events.happened, run)


# --- compiled parts, kept between calls ----------------------------------------------------------

Method: TypeAlias = "FixedMethod | ImplicitMethod"
"""Families whose steps are compiled ahead, on a flow; the others bring their own."""


@dataclass(frozen=True, eq=False)
class Compiled:
    """What runs that differ in numbers alone share.

    `flow_in_motion`: what the solver integrates, `flow` with its branches held where they are events.
    """

    flow: StateFlow
    flow_in_motion: StateFlow
    method: Method | None
    events: Eventful | None
    observe: Kernel
    observe_events: Kernel


_RUNS: LRUCache[Compiled] = LRUCache(32)


def _compiled(
    mechanism: Mechanism,
    solver: Solver,
    record: Record,
    equations: Equations | None,
    vary: Sequence[str],
    rows: tuple[int, ...],
    constraints: Keeping,
    *,
    watching: bool,
    switches: bool,
) -> Compiled:
    """The flow, its solver's method and its observer; made once for all that differs in code."""
    written = None
    if equations is not None:
        motion = equations_of_motion(mechanism, vary)
        written = by_hand(motion.system, equations, motion.rows.select(rows))
    split = own_coordinates(mechanism, record.coordinates)
    key = (
        mechanism.digest(vary),
        solver.name,
        tuple(record.testing),
        None if written is None else written.key,
        split,
        tuple(vary),
        rows,
        constraints,
        watching,
        switches,
    )

    def make() -> Compiled:
        flow = build_flow(mechanism, record.testing, written, split, vary, rows, constraints)
        events = None
        if watching:
            from deltac.simulation.events.run import eventful

            events = eventful(flow, split, switches)
        flow_in_motion = flow if events is None else events.flow
        method: Method | None = None  # of the families that bring their own steps
        if solver.family == "fixed":
            method = FixedMethod(flow_in_motion, solver)
        elif solver.family == "implicit":
            from deltac.simulation.stepping.implicit.stepper import ImplicitMethod

            method = ImplicitMethod(flow_in_motion, solver)
        observe = observer(flow)
        return Compiled(
            flow,
            flow_in_motion,
            method,
            events,
            observe,
            observer(flow_in_motion) if switches else observe,
        )

    return _RUNS.get(key, make)


def _stepper(
    code: Compiled,
    options: Options,
    rate: StageRate,
    p: Array,
    t: float,
    x: Array,
    duration: float,
    *,
    compiled: bool,
) -> Stepper:
    """What takes the steps of one run from (t, x)."""
    flow, method = code.flow_in_motion, code.method
    if isinstance(method, FixedMethod):
        return FixedSteps(method, rate, p, compiled=compiled)
    if method is not None:
        from deltac.simulation.stepping.implicit.stepper import ImplicitSteps

        radius = getattr(options, "spectral_radius", GeneralizedAlpha.spectral_radius)
        return ImplicitSteps(method, rate, p, radius)
    assert isinstance(options, Sundials | Scipy | Taylor)

    def interpreted(t: float, x: Array) -> Array:
        return evaluate_at(flow.rate, t, x, p)[0]

    if isinstance(options, Taylor):
        from deltac.simulation.stepping.taylor import TaylorSteps

        # Rounding is too smooth along a step to be followed.
        sizes = state_sizes(flow, interpreted, t, x, p, duration, math.inf)
        return TaylorSteps(flow, p, options.tolerance, sizes, quad=options.quad)
    sized = (t, x, p, duration, options.tolerance)
    if isinstance(options, Sundials):  # on CasADi's own evaluator, whose rounding is another
        from deltac.simulation.stepping.sundials import SundialsSteps

        sizes = state_sizes(flow, interpreted, *sized)
        return SundialsSteps(flow, options.solver, p, options.tolerance, sizes)
    from deltac.simulation.stepping.scipy import ScipySteps

    sizes = state_sizes(flow, rate, *sized)
    return ScipySteps(flow, options.solver, rate, p, options.tolerance, sizes, compiled=compiled)


def _circumstances(
    mechanism: Mechanism,
    equations: Equations | None,
    controller: Controller | None,
    flow: StateFlow,
    events: EventRun | None,
    coordinates: CoordinateMap | str | None,
) -> dict[str, Any]:
    """What is said in the provenance of how the run was code."""
    own = own_coordinates(mechanism, coordinates)
    channels: tuple[ChannelName, ...] | None = None
    if controller is not None and controller.hold:
        channels = tuple(ChannelName("actuator", motor.name) for motor in mechanism.motors)
    notes = {}
    if events is not None and events.simultaneous:
        laws = (f"{law!r} at {n} instants" for law, n in events.simultaneous.items())
        notes["simultaneous impacts"] = (
            f"resolved by {', '.join(laws)}; rigid-body mechanics does not determine their outcome"
        )
    return {
        "notes": notes,
        "corrected": "energy" if flow.correcting else "",
        "ended": "" if events is None else events.ended,
        "equations": "" if equations is None else equations.name,
        "held": channels,
        "coordinates": {} if own is None else own.to_dict(),
    }
