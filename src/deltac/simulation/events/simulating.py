"""Runs with events as part of `simulate`: what can have them, how they start, what is recorded of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import casadi as ca
import numpy as np

from deltac.arrays import Array
from deltac.dynamics.coordinates import trace_map
from deltac.dynamics.impacts import impact_points
from deltac.errors import InputError
from deltac.kernels import Kernel
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.events import Event, JointStop
from deltac.mechanism.mechanism import Mechanism
from deltac.simulation.adaptive import scipy_options
from deltac.simulation.equations import Controller, Equations
from deltac.simulation.events.colliding import Collider
from deltac.simulation.events.running import TOUCHING, Happened, Outcome, Run
from deltac.simulation.events.stepping import AdaptiveSteps, FixedSteps, Stepper
from deltac.simulation.events.switching import switched
from deltac.simulation.events.watching import Watch
from deltac.simulation.flow import Flow
from deltac.simulation.observation import logged_forces, observer
from deltac.simulation.solvers import Solver
from deltac.simulation.sundials import SUNDIALS
from deltac.trajectories import Occurrence, Trajectory


def check_events(
    mechanism: Mechanism, solver: Solver, equations: Equations | None, switches: bool
) -> bool:
    """Whether a run has events to look for; InputError where it cannot look for them."""
    if not mechanism.events and not switches:
        return False
    what = f"{len(mechanism.events)} events" if mechanism.events else "switches=True"
    scipy = solver.family == "adaptive" and solver.name not in SUNDIALS
    able = scipy or (solver.family == "fixed" and solver.step is not None)
    if not able:
        raise InputError(
            f"solver {solver.name!r} cannot stop at events, and the run has {what}; use 'ode5', another "
            "explicit fixed-step solver, or one of SciPy's adaptive ones such as 'DOP853' and 'Radau'"
        )
    hits = [event.name for event in mechanism.events if not isinstance(event, Event)]
    if hits and equations is not None and equations.coordinates is not None:
        raise InputError(
            f"impact or stop {hits[0]!r} and equations by hand in coordinates of their own cannot be "
            "combined; write the equations in the mechanism's coordinates, or leave them out"
        )
    return True


@dataclass(frozen=True, eq=False)
class Eventful:
    """A flow made ready for events, compiled once: its branches held if they are to be found."""

    flow: Flow
    watch: Watch
    collider: Collider
    observe: Kernel


@lru_cache(maxsize=32)
def eventful(flow: Flow, split: CoordinateMap | None, switches: bool) -> Eventful:
    """Prepare the events of a flow."""
    system = flow.system
    functions = ca.SX(0, 1)
    names: tuple[str, ...] = ()
    if switches:
        held = switched(flow)
        flow, functions, names = held.flow, held.functions, held.names
    points = impact_points(system)
    own = trace_map(system, split) if split is not None else None
    events = tuple(e for e in system.mechanism.events if isinstance(e, Event))
    watch = Watch(flow, points, events, functions, names)
    return Eventful(flow, watch, Collider.of(flow, points, own), observer(flow))


def run_with_events(
    parts: Eventful,
    solver: Solver,
    controller: Controller | None,
    p: Array,
    x0: Array,
    span: tuple[float, float],
    grid: tuple[float, int, int] | Array | None,
    tolerance: float,
    progress: Callable[[float], None] | None,
) -> Outcome:
    """Integrate over `span` from event to event.

    `grid` is (step, number of steps, how many make a sample) of a fixed-step solver; the times of
    samples, or None for those of an adaptive one's own steps.

    Raises InputError where parts overlap at the start.
    """
    watch, flow = parts.watch, parts.flow
    full = np.concatenate([p, np.zeros(len(watch.switch_names))])
    stepper: Stepper
    if isinstance(grid, tuple):
        stepper = FixedSteps(flow, solver, controller, full, (span[0], *grid))
    else:
        options = scipy_options(tolerance)
        stepper = AdaptiveSteps(flow, solver, controller, full, span, grid, options)
    stepper.rate.hold(span[0], x0)
    _check_start(watch, stepper, full, span[0], x0)
    run = Run(watch, parts.collider, stepper, full, span[0], x0.copy(), span[1], progress)
    return run.go()


def with_occurrences(parts: Eventful, happened: Sequence[Happened], run: Trajectory) -> Trajectory:
    """The trajectory with what happened, as far as its rows go."""
    events = [e for e in happened if run.t[0] <= e.t <= run.t[-1]]
    if not events:
        return run
    seen = []
    for states, sides in (("before", "p_before"), ("after", "p_after")):
        arrays: dict[str, Array] = {
            "t": np.array([e.t for e in events]),
            "x": np.array([getattr(e, states) for e in events]),
        }
        flow = parts.flow
        if flow.inputs.shape[0]:
            arrays["inputs"] = np.array([e.inputs for e in events])
        if flow.given.shape[0]:
            assert flow.equations is not None
            q, u, _ = flow.parts
            arrays["given"] = np.array(
                [
                    flow.equations(t, x[q].copy(), x[u].copy())
                    for t, x in zip(arrays["t"], arrays["x"])
                ]
            )
        values = parts.observe(parameters=np.array([getattr(e, sides) for e in events]), **arrays)
        shaped = {name: value.reshape(len(events), -1) for name, value in values.items()}
        inputs = np.array([e.inputs for e in events])
        seen.append((shaped, logged_forces(parts.flow, shaped, inputs)))
    (before, forces_before), (after, forces_after) = seen
    made = tuple(
        Occurrence(
            t=e.t,
            names=e.names,
            q=before["q"][k],
            u_before=before["u"][k],
            u_after=after["u"][k],
            udot_before=before["udot"][k],
            udot_after=after["udot"][k],
            forces_before={name: force[k] for name, force in forces_before.items()},
            forces_after={name: force[k] for name, force in forces_after.items()},
            impulses=e.impulses,
        )
        for k, e in enumerate(events)
    )
    return replace(run, events=made)


def _check_start(watch: Watch, stepper: Stepper, p: Array, t: float, x: Array) -> None:
    """InputError where parts overlap from the start, with the pair, the depth and a remedy."""
    points = watch.points
    if not points:
        return
    gaps = watch.at(t, x, stepper.rate(t, x), p).g[: len(points)]
    worst = int(np.argmin(gaps))
    if gaps[worst] >= -TOUCHING:
        return
    point = points[worst]
    happening = next(
        e
        for e in watch.flow.system.mechanism.events
        if not isinstance(e, Event) and e.name == point.name
    )
    if isinstance(happening, JointStop):
        what = (
            f"coordinate {happening.coordinate!r} is beyond the {point.label} limit of joint stop"
        )
    else:
        pair = f"{happening.first.body!r} and {happening.second.body!r}"
        where = f" ({point.label})" if point.label else ""
        what = f"the shapes of {pair} overlap{where} at the start: impact"
    raise InputError(
        f"{what} {point.name!r} by {-gaps[worst]:.6g} m or rad at t = {t:g} s; start from a state in which "
        "the gap is zero or positive"
    )
