"""What makes the runs of a study: a solver of ours at several steps or tolerances, MuJoCo, other programs."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, TypedDict, cast

import numpy as np

from deltac.calls.arguments import named, unknown_argument
from deltac.diagnosis.study.runs import Simulator, StudyRun
from deltac.dynamics import trace
from deltac.errors import ArgumentsError, ModelError, SourceError, WrongType
from deltac.mechanism import Mechanism, State
from deltac.models import Model, ModelLike, StateLike
from deltac.simulation import (
    Controller,
    Equations,
    Keeping,
    Options,
    Record,
    RightHandSide,
    as_equations,
    explicit,
    find_solver,
)
from deltac.trajectories import Trajectory
from deltac.verbs import simulate

MUJOCO = "mujoco:"

SAMPLES = 200
"""Rows of a run of an adaptive solver, at the same times for every tolerance."""

COARSER = (100.0, 10.0, 1.0)
"""Tolerances of an adaptive solver, as multiples of its own."""


class SimulationOptions(TypedDict, total=False):
    """Arguments of `simulate` that verbs which make several runs hand on as they are."""

    record: Record | Sequence[str] | int
    equations: Equations | RightHandSide | None
    controller: Controller | Callable[[Any, Any], object] | None
    constraints: str | Keeping


def handed_on(
    verb: Callable[..., Any], arguments: Mapping[str, Any], *, own: Iterable[str] = ()
) -> SimulationOptions:
    """What is handed on to `simulate`, with equations as `Equations`.

    UnknownName for what is no argument of the verb, nor one of `simulate` that it hands on; `own` are those
    that the verb sets itself.
    """
    option_names = [name for name in SimulationOptions.__annotations__ if name not in own]
    for name in arguments:
        if name not in option_names:
            names = [*named(inspect.signature(verb)), *option_names]
            raise unknown_argument(verb.__name__, name, names)
    options = {name: value for name, value in arguments.items() if value is not None}
    if "constraints" in arguments:
        options["constraints"] = arguments["constraints"]  # None: nothing keeps the run on them
    if "equations" in options:
        options["equations"] = as_equations(options["equations"])
    return cast(SimulationOptions, options)


@dataclass(frozen=True, eq=False)
class Maker:
    """What makes the runs of a study.

    Attributes:
        name: of the solver, or of the program.
        order: its nominal order, if known.
        simulator: the run as a function of the step, or of the tolerance; None for runs that are made.
        trusted: it integrates with our own solvers.
        equations: that were written by hand, where they are integrated in place of the mechanism's own.
    """

    name: str
    order: int | None
    simulator: Simulator | None = None
    trusted: bool = False
    equations: Equations | None = None


def own_solver(
    loaded: Model,
    state: StateLike,
    duration: float,
    solver: Options,
    options: SimulationOptions,
    order: int | None,
) -> Maker:
    """One of our solvers, as a function of its step, or of its tolerance."""
    mechanism, start = loaded.mechanism, starting(loaded, state)
    controller, equations = options.get("controller"), options.get("equations")
    if controller is not None and not isinstance(controller, Controller):
        raise WrongType(
            "controller: found a function; our solvers take a Controller(function of t, q, u), MuJoCo's a "
            "function of (model, data)"
        )
    if equations is not None:
        assert isinstance(equations, Equations)
        options = {**options, "equations": carefully(equations, mechanism, start)}
    scheme = solver.solver

    def run(knob: float) -> Trajectory:
        step, chosen = (
            (knob, solver)
            if scheme.takes_steps
            else (duration / SAMPLES, solver.with_tolerance(knob))
        )
        return simulate(mechanism, start, duration, step, chosen, **options)  # type: ignore[arg-type]

    # The error of an adaptive solver follows its tolerance, not a power of a step.
    nominal = scheme.order if scheme.takes_steps and order is None else order
    return Maker(scheme.name, nominal, run, True, options.get("equations"))  # type: ignore[arg-type]


def in_mujoco(
    model: ModelLike,
    loaded: Model,
    state: Any,
    duration: float,
    integrator: str,
    options: SimulationOptions,
    order: int | None,
) -> Maker:
    """MuJoCo's integrator of that name, recorded."""
    from deltac.recorders import mujoco_simulator

    controller = options.get("controller")
    unfit = sorted(options.keys() - {"controller"})
    if unfit or isinstance(controller, Controller):
        raise ArgumentsError(
            f"MuJoCo runs its own equations: leave out {', '.join(unfit) or 'the Controller'}; its inputs "
            "are set by controller=, a function of (model, data)"
        )
    data = type(state).__name__ == "MjData" or (state is None and not loaded.starts)
    start = state if data else loaded.start(state)  # None: MuJoCo's own start
    return other_program(
        mujoco_simulator(
            model, duration, integrator=integrator, controller=controller, state=start
        ),
        order,
    )


def other_program(simulator: Simulator, order: int | None) -> Maker:
    """A simulator that is not ours; MuJoCo's know their name and order."""
    from deltac.recorders import MujocoSimulator

    if isinstance(simulator, MujocoSimulator):
        return Maker(simulator.solver, simulator.order if order is None else order, simulator)
    name = getattr(simulator, "__name__", type(simulator).__name__)
    return Maker(name, order, simulator)


def of_logs(runs: Sequence[StudyRun], order: int | None) -> Maker:
    """Who made the logs, as the finest says itself."""
    source = next((r.run.provenance for r in reversed(runs) if r.run is not None), None)
    if source is None:
        return Maker("logs", order)
    name = f"{source.simulator} {source.solver}" if source.solver else source.simulator
    if order is None and source.simulator == "deltac" and source.solver:
        solver = find_solver(source.solver)
        order = solver.order if solver.takes_steps else None
    return Maker(name, order)


def starting(loaded: Model, state: StateLike) -> State:
    """The model's own start by default, else at zero and at rest."""
    if state is None and not loaded.starts:
        return loaded.mechanism.state()
    return loaded.start(state)


# --- equations by hand: what they raise, or cannot say, is told with the state -------------------


def carefully(equations: Equations, mechanism: Mechanism, state: State) -> Equations:
    """The equations, called with care.

    Raises InputError if they raise at the start, or return what is no u̇ or is not finite there.
    """
    from deltac.diagnosis.residuals.function import Caller
    from deltac.diagnosis.residuals.kane import Kane
    from deltac.diagnosis.residuals.states import States, own_states

    equations = explicit(trace(mechanism), equations)
    kane, free = Kane(mechanism, equations.coordinates), mechanism.free
    caller = Caller(equations.rhs, equations.name, kane)
    with suppress(ModelError):  # own coordinates of the start are not known before it is simulated
        columns = (np.array(x, dtype=np.float64)[:, None] for x in (state.q, state.u))
        q, u = (x[places] for x, places in zip(columns, (free.q, free.u)))
        start = own_states(kane, np.array([state.t]), q, u)
        udot = caller(start)[:, 0]
        if not np.isfinite(udot).all():
            raise SourceError(
                f"{equations.name} returned values that are not finite at the start: u̇ = "
                f"{udot.tolist()}. State: {start.in_words(0)}"
            )

    def rhs(t: Any, q: Any, u: Any) -> Any:
        """The function as it is for symbols; for numbers, an InputError with the state where it raises."""
        if np.asarray(u).dtype == object or np.ndim(u) != 1:
            return caller.rhs(t, q, u)
        columns = np.array([t], dtype=np.float64), q[:, None], u[:, None]
        return caller(States(*columns, kane.user_names, kane.speed_names))[:, 0]

    return replace(equations, rhs=rhs)
