"""What a recommendation chooses from: our solvers with their steps or tolerances, and MuJoCo's."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from deltac.arrays import LONG_LOG
from deltac.diagnosis.recommend.work_precision import Deadline, Family, MotionRows, VerifiedSpan
from deltac.diagnosis.study.simulators import MUJOCO, SAMPLES, SimulationOptions
from deltac.errors import ArgumentsError, InputError, SolverError, WrongType
from deltac.importers.files import with_base
from deltac.mechanism import Mechanism, State
from deltac.simulation import SOLVERS, Controller, Record, Solver, find_solver, solver_options
from deltac.trajectories import Trajectory
from deltac.verbs import simulate

Control = Callable[[Any, Any], object]

LADDER = (1.0, 1.25, 1.6, 2.0, 2.5, 3.2, 4.0, 5.0, 6.4, 8.0)
"""Numbers of steps go up by these within a factor of ten: a quarter more each time."""

FEWEST, MOST = 20, 5_000_000
"""Steps of the coarsest and of the finest setting of a solver of ours."""

MOST_OF_MUJOCO = 10 * LONG_LOG
"""Steps of the finest setting in MuJoCo, where each is recorded."""

SEARCHED_ROWS = LONG_LOG
"""Longer runs are judged in the search on at least so many of their steps; verified on all of them."""

FINER = (2, 8, 16, 32, 64)
"""A fixed step is verified against a sixteenth of it, if half of it shows the order; else two references
are to agree."""

TIGHTER, TIGHTEST = (1e1, 1e2, 1e3, 1e4, 1e5), 1e-13
"""An adaptive solver is verified likewise, at its tolerance divided by these, down to rounding."""

DENSE, DECADES = 1000, 7
"""An adaptive run may be sampled anywhere. It is verified on so many rows of the whole motion, and of its
first 10th, 100th, … where a fast transient would fall between those."""

TOLERANCES = tuple(10.0 ** (-k / 2.0) for k in range(6, 25))
"""Settings of adaptive solvers: half decades from 1e-3 to 1e-12; a tenth of that is still computed."""

SUITED = ("DOP853", "Radau", "CVODES", "IDAS")
"""Adaptive solvers that are tried unless others are named; the rest is dearer at every tolerance."""

EXPLICIT = ("RK23", "RK45", "DOP853")
"""Adaptive solvers without systems of equations, whose steps stiffness limits."""


def families(
    source: Any,
    mechanism: Mechanism,
    state: State,
    duration: float,
    solvers: Sequence[str] | None,
    options: SimulationOptions,
    deadline: Deadline,
) -> tuple[list[Family], tuple[str, ...]]:
    """The families to choose from, and notes on what was left out.

    A run that is under way at the `deadline` ends with `OutOfTime`.

    Raises InputError for unknown solvers, and for a controller that they do not take.
    """
    in_mujoco = _runs_in_mujoco(source)
    controller = options.get("controller")
    ours = controller if isinstance(controller, Controller) else None
    theirs = None if isinstance(controller, Controller) else controller
    if isinstance(solvers, str):
        solvers = solvers.split(",")
    if solvers is not None and not solvers:
        raise InputError("recommend: solvers is empty; name some, or leave it out")
    names = _suited(mechanism, ours, in_mujoco=in_mujoco) if solvers is None else list(solvers)
    outside = [n for n in names if n.startswith(MUJOCO)]
    if outside and not in_mujoco:
        raise SolverError(
            f"recommend: {outside[0]!r} needs a MuJoCo model (.xml, .urdf, MjModel), but the model is "
            f"{mechanism.name or 'a mechanism'!r}"
        )
    if theirs is not None and not outside:
        raise WrongType(
            "controller: found a function, which MuJoCo's integrators take; our own solvers take a "
            "Controller(function of t, q, u)"
        )
    if outside and options.keys() - {"controller"}:
        names = sorted(options.keys() - {"controller"})
        raise ArgumentsError(
            f"recommend: MuJoCo's integrators cannot take {', '.join(names)}; leave it out"
        )
    choice, notes = [], []
    for name in names:
        if name in outside:
            choice.append(
                _mujoco(source, state, duration, name.removeprefix(MUJOCO), theirs, deadline)
            )
            continue
        solver = find_solver(name)
        if solver.family == "taylor":
            notes.append(
                f"{solver.name} chooses its step by itself and is made for references, not chosen from"
            )
        else:
            choice.append(_own(solver, mechanism, state, duration, options, deadline))
    if not choice:
        raise SolverError(f"recommend: nothing to choose from; {'; '.join(notes)}")
    return choice, tuple(notes)


def _suited(mechanism: Mechanism, controller: Controller | None, *, in_mujoco: bool) -> list[str]:
    """Names that are tried when none are given: explicit ones first, orders high to low.

    The first ones tell how fast the motion is, and so what others can be worth.
    """
    if in_mujoco:
        from deltac.recorders.mujoco_recorder import MUJOCO_ORDERS

        return [
            f"{MUJOCO}{name}" for name in sorted(MUJOCO_ORDERS, key=lambda n: -MUJOCO_ORDERS[n])
        ]
    stepping = [s for s in SOLVERS.values() if s.takes_steps]
    adaptive = (
        [] if controller and controller.hold else [SOLVERS[n] for n in SUITED if n in SOLVERS]
    )
    ranked = sorted(stepping, key=lambda s: -(s.order or 0)) + adaptive
    return [s.name for s in sorted(ranked, key=_implicit)]


def _implicit(solver: Solver) -> bool:
    return solver.family != "fixed" and solver.name not in EXPLICIT


def _own(
    solver: Solver,
    mechanism: Mechanism,
    state: State,
    duration: float,
    options: SimulationOptions,
    deadline: Deadline,
) -> Family:
    def run(
        step: float, span: float = duration, every: int = 1, tolerance: float | None = None
    ) -> Trajectory:
        deadline.begin()
        return simulate(
            mechanism,
            state,
            span,
            step,
            solver_options(solver.name, tolerance),
            Record(("wang",), every),
            progress=deadline.check,
            **options,  # type: ignore[arg-type, misc]
        )

    def stepped(step: float, rows: int, finer: int = 1) -> Trajectory:
        steps = round(duration / step)
        return run(duration / (finer * steps), every=finer * _every(steps, rows))

    def every_step(step: float) -> list[VerifiedSpan]:
        steps = round(duration / step)
        return [
            VerifiedSpan(
                lambda: stepped(step, steps),
                lambda divisor: stepped(step, steps, round(divisor)),
                FINER,
                float(FINER[2] ** (solver.order or 1)),
            )
        ]

    def adaptive(tolerance: float) -> Trajectory:
        return run(duration / SAMPLES, tolerance=tolerance)

    def beginning(tolerance: float, span: float) -> VerifiedSpan:
        divisors = tuple(sorted({min(n, tolerance / TIGHTEST) for n in TIGHTER}))
        return VerifiedSpan(
            lambda: run(span / DENSE, span, tolerance=tolerance),
            lambda divisor: run(span / DENSE, span, tolerance=tolerance / divisor),
            divisors,
            divisors[min(2, len(divisors) - 1)],
        )

    def beginnings(tolerance: float) -> list[VerifiedSpan]:
        return [beginning(tolerance, duration / 10**k) for k in range(DECADES)]

    if solver.family in ("scipy", "sundials"):
        return Family(
            solver.name,
            solver.order,
            0,
            TOLERANCES,
            "tolerance",
            adaptive,
            beginnings,
            halved=lambda h: h / 10.0,
            implicit=_implicit(solver),
        )
    return Family(
        solver.name,
        solver.order,
        solver.stages,
        _steps(duration, FEWEST, MOST),
        "step",
        lambda step: stepped(step, SEARCHED_ROWS),
        every_step,
        work=lambda step: stepped(step, SAMPLES),
        implicit=_implicit(solver),
    )


def _mujoco(
    source: Any,
    state: State,
    duration: float,
    integrator: str,
    controller: Control | None,
    deadline: Deadline,
) -> Family:
    from deltac.recorders.mujoco_recorder import as_run, mujoco_simulator

    recorded = mujoco_simulator(
        source, duration, integrator=integrator, controller=controller, state=state
    )

    def plain(step: float, every: int = 0) -> MotionRows:
        """The run without recording, what a user will pay for; or with its motion at every so many steps."""
        import mujoco

        deadline.begin()
        model = as_run(recorded.model, step, recorded.integrator)
        data = mujoco.MjData(model)
        mujoco.mj_copyData(data, model, recorded.data)
        start = data.time
        rows = [(start, data.qpos.copy(), data.qvel.copy())]
        for k in range(round(duration / step)):
            if k % 1024 == 0:
                deadline.check()
            if controller is not None:
                controller(model, data)
            mujoco.mj_step(model, data)
            if every and (k + 1) % every == 0:
                rows.append((start + (k + 1) * step, data.qpos.copy(), data.qvel.copy()))
        t, q, u = zip(*rows)
        return MotionRows(np.array(t), np.array(q), np.array(u))

    def every_step(step: float) -> list[VerifiedSpan]:
        return [
            VerifiedSpan(
                partial(recorded, step),
                lambda divisor: plain(step / divisor, every=round(divisor)),
                FINER,
                float(FINER[2] ** (recorded.order or 1)),
            )
        ]

    return Family(
        f"{MUJOCO}{integrator.lower()}",
        recorded.order,
        4 if recorded.order == 4 else 1,
        _steps(duration, FEWEST, MOST_OF_MUJOCO),
        "step",
        recorded,
        every_step,
        plain,
        recorder=True,
    )


def _runs_in_mujoco(source: Any) -> bool:
    if isinstance(source, str) or hasattr(source, "suffix"):
        return with_base(source)[0].suffix.lower() in (".xml", ".mjcf", ".urdf")
    return type(source).__module__.partition(".")[0] == "mujoco"


def _steps(duration: float, fewest: int, most: int) -> tuple[float, ...]:
    """Steps that divide the duration, coarse to fine."""
    counts = sorted(
        {
            round(m * 10**k)
            for m in LADDER
            for k in range(1, 8)
            if fewest <= round(m * 10**k) <= most and (m * 10**k) % 1 == 0
        }
    )
    return tuple(duration / n for n in counts)


def _every(steps: int, rows: int) -> int:
    """Keep every so many steps: the most that divides them and leaves so many rows, or all."""
    most = max(1, steps // rows)
    return next(r for r in range(most, 0, -1) if steps % r == 0)
