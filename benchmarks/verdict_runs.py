"""A case of the verdict's bench, how its runs are made, and how they are handed over."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import deltac as dc

LONGEST = 300
"""Steps of the coarsest run, at most."""


@dataclass(frozen=True, eq=False)
class Case:
    """One motion to be judged: `runs` makes it at each of `steps`, as some simulator would.

    group     what kind of case it is; `name` tells it from others
    right     whether the equations, forces and model belong together
    model     what the motion is judged against: a mechanism, or a model of MuJoCo
    function  the hand-written equations, where there are any, for the check
    differs   whether the motion is another one than by the right equations: else the case is dropped
    """

    name: str
    group: str
    right: bool
    model: Any
    runs: Callable[[float], dc.Trajectory]
    steps: tuple[float, ...]
    function: Callable[..., Any] | None = None
    coordinates: Any = None
    order: int | None = None
    differs: Callable[[], bool] | None = None


def simulating(
    problem: Any, solver: str, duration: float, equations: Any = None, **options: Any
) -> Callable[[float], dc.Trajectory]:
    """A problem's motion as a function of the step."""
    return running(
        problem.mechanism, problem.state, duration, solver, equations=equations, **options
    )


def running(
    mechanism: dc.Mechanism, state: dc.State, duration: float, solver: str, **options: Any
) -> Callable[[float], dc.Trajectory]:
    def run(step: float) -> dc.Trajectory:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return dc.simulate(mechanism, state, duration, step, solver, **options)

    return run


def delivery(run: Callable[[float], dc.Trajectory], how: str) -> Callable[[float], dc.Trajectory]:
    """The same runs as they come out of a log."""

    def delivered(step: float) -> dc.Trajectory:
        made = run(step)
        bare = {n: v for n, v in made.integrals.items() if n.startswith("correction")}
        match how:
            case "full":
                return made
            case "accelerations":
                return replace(made, works={}, integrals=bare)
            case "no accelerations":
                return _without_accelerations(made)
            case "positions and speeds":
                return _foreign(replace(made, udot=None, works={}, integrals=bare, events=()))
            case "float32":
                return _foreign(_rounded(replace(made, works={}, integrals=bare)))
            case _:
                return replace(made, works={}, integrals=bare).every(4)

    return delivered


def _without_accelerations(run: dc.Trajectory) -> dc.Trajectory:
    events = tuple(replace(e, udot_before=None, udot_after=None) for e in run.events)
    return replace(run, udot=None, events=events)


def _foreign(run: dc.Trajectory) -> dc.Trajectory:
    """Without events, the run is none of ours any more: ours would have told of them."""
    source = dc.Provenance("another program", step=run.provenance.step)
    return replace(run, provenance=source)


def _rounded(run: dc.Trajectory) -> dc.Trajectory:
    def short(values: np.ndarray) -> np.ndarray:
        return values.astype(np.float32).astype(np.float64)

    return replace(
        run,
        q=short(run.q),
        u=short(run.u),
        udot=None if run.udot is None else short(run.udot),
        forces={n: short(f) for n, f in run.forces.items()},
        events=(),
    )


def length(problem: Any, coarse: float) -> float:
    """As long as the problem, but no more steps than `LONGEST`; a whole number of them."""
    steps = max(8, min(LONGEST, round(problem.duration / coarse)))
    return steps * coarse
