"""`study`: the same motion at several steps: integration error or wrong equations?"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from deltac.diagnosis.findings import Finding
from deltac.diagnosis.models import Model, load_model
from deltac.diagnosis.study.by_hand import carefully
from deltac.diagnosis.study.measuring import studied
from deltac.diagnosis.study.result import Study
from deltac.diagnosis.study.runs import (
    Progress,
    Simulator,
    StudyRun,
    checked_steps,
    logged,
    simulated,
)
from deltac.errors import InputError
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.state import State
from deltac.simulation.equations import Controller, Equations
from deltac.simulation.flow import Stabilisation
from deltac.simulation.simulate import simulate
from deltac.simulation.solvers import find_solver
from deltac.trajectories import Trajectory

TOLERANCE = 1e-6
"""Energy error that is accepted by default, as a fraction of the energy turned over."""

MUJOCO = "mujoco:"

SAMPLES = 200
"""Rows of a run of an adaptive solver, at the same times for every tolerance."""


def study(
    model: Any,
    state: State | Any = None,
    duration: float | None = None,
    steps: Sequence[float] | None = None,
    solver: str = "",
    equations: Equations | Callable[..., Any] | None = None,
    testing: Sequence[str] = ("wang", "liu-huston"),
    *,
    simulator: Simulator | None = None,
    logs: Sequence[Any] = (),
    tolerances: Sequence[float] | None = None,
    tolerance: float = TOLERANCE,
    order: int | None = None,
    controller: Controller | None = None,
    control: Callable[[Any, Any], object] | None = None,
    stabilisation: Stabilisation = "projection",
    mapping: Any = None,
    progress: Progress | None = None,
) -> Study:
    """Study a motion at several steps, and say whether its error is the integrator's or the equations'.

    Args:
        model: a Mechanism, a Problem, the name of a problem, an ``.xml`` or ``.urdf`` file, a
            mujoco.MjModel or MjSpec, or ``file.py:callable``.
        state: where the motion starts; for a Problem its own by default, else at zero and at rest. With
            MuJoCo an mjData will do.
        duration: s; for a Problem its own by default.
        steps: s, three or more to tell most; for a Problem 4, 2 and 1 times its own step by
            default (where 4 of them do not divide its duration: 1, 1/2 and 1/4).
        solver: a name of `solver_names()` ("ode5" by default), or "mujoco:" and an integrator's name.
        equations: hand-written equations of motion in place of the mechanism's own, or their function.
        testing: testing functions that are integrated in the loop.
        simulator: a function of the step (s) that returns a Trajectory: any simulator at all.
        logs: logs of the same motion at several steps, in place of simulating it; paths or Trajectories.
        tolerances: in place of steps, for adaptive solvers.
        tolerance: accepted |ΔC| as a fraction of the energy turned over.
        order: the nominal order of `simulator`, if it has one.
        controller: sets the motors that have no law; for MuJoCo give `control`.
        control: called as control(model, data) before each step of MuJoCo.
        stabilisation: as for `simulate`.
        mapping: path of a mapping file, for `logs` whose columns have other names or units.
        progress: called with the fraction done and what is being done.

    Returns:
        The study: verdict, observed orders, findings, runs.

    Raises:
        InputError: the arguments are unusable, or no run at all came about.
    """
    if not (isinstance(tolerance, int | float) and 0.0 < tolerance < 1.0):
        raise InputError(f"tolerance is {tolerance!r}; expected a number between 0 and 1")
    loaded = load_model(model)
    if equations is not None and not isinstance(equations, Equations):
        equations = Equations(equations)
    if logs:
        given = simulator is not None or steps is not None or tolerances is not None
        if given or solver:
            raise InputError(
                "logs= are runs already: leave out steps, tolerances, solver and simulator"
            )
        runs = logged(loaded.mechanism, logs, mapping)
        maker = _of_logs(runs, order)
        findings: list[Finding] = []
    else:
        if tolerances is not None and steps is not None:
            raise InputError("give steps= or tolerances=, not both")
        adaptive = tolerances is not None
        wanted = tolerances if steps is None else steps
        if wanted is None:
            wanted = _default_steps(loaded)
        values, findings = checked_steps(wanted, "tolerance" if adaptive else "step")
        if simulator is not None:
            if solver or equations is not None or controller is not None:
                raise InputError(
                    "simulator= makes the runs by itself: leave out solver, equations and controller"
                )
            maker = _of_user(simulator, order)
        else:
            state = loaded.problem.state if state is None and loaded.problem else state
            duration = _duration(loaded, duration)
            solver = solver or ("DOP853" if adaptive else _default_solver(loaded))
            if solver.startswith(MUJOCO):
                if equations is not None or controller is not None:
                    raise InputError(
                        "MuJoCo runs its own equations: leave out equations= and controller= (its inputs "
                        "are set by control=)"
                    )
                from deltac.recorders import mujoco_simulator

                name = solver.removeprefix(MUJOCO)
                run = mujoco_simulator(
                    model, duration, integrator=name, control=control, state=state
                )
                maker = _of_user(run, order)
            else:
                maker = _own(
                    loaded.mechanism,
                    loaded.mechanism.state() if state is None else state,
                    duration,
                    solver,
                    testing,
                    equations,
                    controller,
                    stabilisation,
                    order,
                    adaptive=adaptive,
                )
        runs = simulated(loaded.mechanism, maker.simulator, values, progress, trusted=maker.own)
    _some(runs)
    return studied(
        loaded,
        tuple(runs),
        maker.name,
        maker.order,
        equations,
        findings,
        float(tolerance),
        own_solver=maker.own,
        unit="" if tolerances is not None else "s",
    )


# --- what is run ----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Maker:
    """What makes the runs: its name, its nominal order if known, and whether it is one of our solvers."""

    simulator: Simulator
    name: str
    order: int | None
    own: bool = False


def _own(
    mechanism: Mechanism,
    state: State,
    duration: float,
    solver: str,
    testing: Sequence[str],
    equations: Equations | None,
    controller: Controller | None,
    stabilisation: Stabilisation,
    order: int | None,
    *,
    adaptive: bool,
) -> _Maker:
    """One of our solvers as a function of its step, or of its tolerance."""
    if not isinstance(state, State):
        raise InputError(
            f"state: found {type(state).__name__}, expected a State: make it by mechanism.state(...)"
        )
    if equations is not None:
        equations = carefully(equations, mechanism, state)
    found = find_solver(solver)
    if adaptive and found.takes_steps:
        raise InputError(
            f"solver {solver!r} takes fixed steps: give steps= in place of tolerances="
        )
    if not adaptive and not found.takes_steps:
        raise InputError(
            f"solver {solver!r} chooses its own steps: give tolerances= in place of steps="
        )

    def run(step: float) -> Trajectory:
        return simulate(
            mechanism,
            state,
            duration,
            duration / SAMPLES if adaptive else step,
            solver,
            testing,
            equations,
            controller=controller,
            tolerance=step if adaptive else None,
            stabilisation=stabilisation,
        )

    # The error of an adaptive solver follows its tolerance, not a power of a step.
    nominal = None if adaptive else found.order
    return _Maker(run, solver, nominal if order is None else order, own=True)


def _of_user(simulator: Simulator, order: int | None) -> _Maker:
    """A simulator that is not ours; MuJoCo's know their name and order."""
    from deltac.recorders import MujocoSimulator

    if isinstance(simulator, MujocoSimulator):
        return _Maker(simulator, simulator.solver, simulator.order if order is None else order)
    return _Maker(simulator, getattr(simulator, "__name__", type(simulator).__name__), order)


def _default_steps(loaded: Model) -> tuple[float, ...]:
    if loaded.problem is None:
        raise InputError("give steps=, three or more, each half of the one before")
    h, duration = loaded.problem.step, loaded.problem.duration
    coarser = abs(round(duration / (4 * h)) * 4 * h - duration) < 1e-9 * duration
    return (4 * h, 2 * h, h) if coarser else (h, h / 2, h / 4)


def _default_solver(loaded: Model) -> str:
    return loaded.problem.solver if loaded.problem is not None else "ode5"


def _duration(loaded: Model, duration: float | None) -> float:
    if duration is not None:
        return float(duration)
    if loaded.problem is None:
        raise InputError("say how long the motion lasts: duration= in seconds")
    return loaded.problem.duration


def _of_logs(runs: Sequence[StudyRun], order: int | None) -> _Maker:
    """Who made the logs, as the finest says itself."""

    def none(step: float) -> Trajectory:
        raise InputError("logs are runs already")

    source = next((r.run.provenance for r in reversed(runs) if r.run is not None), None)
    if source is None:
        return _Maker(none, "logs", order)
    name = f"{source.simulator} {source.solver}" if source.solver else source.simulator
    if order is None and source.simulator == "deltac" and source.solver:
        order = find_solver(source.solver).order
    return _Maker(none, name, order)


def _some(runs: Sequence[StudyRun]) -> None:
    """InputError unless there is a run to judge."""
    if not any(entry.usable for entry in runs):
        told = "; ".join(dict.fromkeys(entry.failure for entry in runs))
        raise InputError(f"no step gave a run that can be judged: {told}")
