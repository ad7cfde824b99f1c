"""Cases of the verdict's bench: motions by right and by wrong equations, drawn by a seed.

A case makes the runs of one motion at three steps, as some simulator would deliver them, and the model
they are to be judged against. Whether the equations are right is known beforehand, or found by comparing
accelerations at random states: never by what is to be tested.
"""

from __future__ import annotations

import random
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import deltac as dc
from deltac.diagnosis.mutation import mutants
from deltac.simulation.solvers import SOLVERS

HERE = Path(__file__).resolve().parent

EXPLICIT = ("ode1", "ode2", "ode3", "ode4", "ode5", "ode8", "semi-implicit-euler")
IMPLICIT = tuple(s.name for s in SOLVERS.values() if s.family == "implicit")

HANDED_OVER = ("full", "full", "no accelerations", "positions and speeds", "float32", "decimated")
"""How runs are delivered: with all that they hold; without u̇; without u̇ and integrals; …"""

FOREIGN = ("accelerations", "positions and speeds")
"""The same of runs of another mechanism, whose integrals are its own and no part of a log."""

LONGEST = 400
"""Steps of the coarsest run, at most."""

COARSENESS = (1, 1, 4, 16, 64)
"""Multiples of a problem's own step; the largest are far too coarse for most."""


@dataclass(frozen=True, eq=False)
class Case:
    """One motion to be judged: `runs` makes it at each of `steps`; `equations` is what moves it.

    group     what kind of case it is; `name` tells it from others
    right     whether the equations, forces and model belong together
    function  the hand-written equations, where there are any, for the check
    """

    name: str
    group: str
    right: bool
    mechanism: dc.Mechanism
    runs: Callable[[float], dc.Trajectory]
    steps: tuple[float, ...]
    function: Callable[..., Any] | None = None
    coordinates: Any = None
    order: int | None = None


# --- right ------------------------------------------------------------------------------------------


def right(seed: int, count: int) -> Iterator[Case]:
    """Problems of the library by right equations: solvers, steps and ways of delivery drawn."""
    draw = random.Random(f"right {seed}")
    names = list(dc.problems.names())
    for k in range(count):
        problem = dc.problems.load(names[k % len(names)])
        implicit = draw.random() < 0.2
        solver = draw.choice(IMPLICIT if implicit and not problem.mechanism.events else EXPLICIT)
        coarse = problem.step * draw.choice(COARSENESS[:3] if implicit else COARSENESS)
        delivered = draw.choice(HANDED_OVER)
        yield Case(
            f"{problem.name}, {solver}, h = {coarse:.3g} s, {delivered}",
            "right: library",
            True,
            problem.mechanism,
            delivery(simulating(problem, solver, _duration(problem, coarse)), delivered),
            (coarse, coarse / 2, coarse / 4),
            order=SOLVERS[solver].order,
        )


def by_hand(seed: int) -> Iterator[Case]:
    """Right equations written by hand, as an unknown simulator would use them."""
    draw = random.Random(f"by hand {seed}")
    for problem in map(dc.problems.load, dc.problems.names()):
        if problem.equations is None:
            continue
        for delivered in dict.fromkeys(HANDED_OVER):
            coarse = problem.step * draw.choice(COARSENESS)
            run = simulating(problem, "ode4", _duration(problem, coarse), problem.equations)
            yield Case(
                f"{problem.name} by hand, ode4, h = {coarse:.3g} s, {delivered}",
                "right: by hand",
                True,
                problem.mechanism,
                delivery(run, delivered),
                (coarse, coarse / 2, coarse / 4),
                order=4,
            )


TRAPS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("bouncing-ball", {}),
    ("striking-slider-crank", {}),
    ("block-on-incline", {}),
    ("stick-slip", {}),
    ("clutch", {}),
    ("ball-on-compliant-floor", {}),
    ("tumbling-box", {}),
    ("driven-pendulum", {}),
    ("ball-on-rising-table", {}),
    ("disc-on-moving-plane", {}),
    ("chaotic-double-body", {}),
    ("free-particle", {}),
    ("triple-pendulum", {"correct": "energy"}),
    ("andrews-squeezer", {"stabilisation": (20.0, 20.0)}),
    ("n-four-bar", {"stabilisation": (20.0, 20.0)}),
    ("rolling-disc", {"stabilisation": "none"}),
)
"""What has led energy tests astray: impacts, dry friction, contact, moving supports, chaos, stabilisation."""


def traps(seed: int) -> Iterator[Case]:
    """Right motions that look wrong to a naive test."""
    draw = random.Random(f"traps {seed}")
    for name, options in TRAPS:
        if name not in dc.problems.names():
            continue
        problem = dc.problems.load(name)
        for delivered in dict.fromkeys(HANDED_OVER):
            coarse = problem.step * draw.choice((1, 4, 16))
            solver = draw.choice(("ode2", "ode4", "ode5"))
            run = simulating(problem, solver, _duration(problem, coarse), **options)
            told = ", ".join(f"{k} {v}" for k, v in options.items())
            yield Case(
                f"{name}{told and ' '}{told}, {solver}, h = {coarse:.3g} s, {delivered}",
                "right: traps",
                True,
                problem.mechanism,
                delivery(run, delivered),
                (coarse, coarse / 2, coarse / 4),
                order=SOLVERS[solver].order,
            )
    yield from _chaos()


def _chaos() -> Iterator[Case]:
    """The thesis's 50 s run, whose digits are lost after a few seconds."""
    from deltac.studies.thesis.runs import problem

    tumbling = problem("tumbling")
    for solver in ("ode4", "ode5"):
        for delivered in ("full", "no accelerations"):
            run = simulating(tumbling, solver, 50.0)
            yield Case(
                f"thesis 4.8, {solver}, {delivered}",
                "right: traps",
                True,
                tumbling.mechanism,
                delivery(run, delivered),
                (0.02, 0.01, 0.005),
                order=SOLVERS[solver].order,
            )


# --- wrong ------------------------------------------------------------------------------------------


def mutated(seed: int, each: int) -> Iterator[Case]:
    """Single mistakes in the hand-written equations of the six cases of `equations`."""
    import equations

    for case in equations.CASES:
        text = (HERE / "equations" / f"{case}.py").read_text("utf-8")
        mechanism, coordinates = equations.load(case)
        start, duration, step = _start(case, mechanism)
        draw = random.Random(f"{case} {seed}")
        right = _function(text, case)
        pool = mutants(text, "rhs", seed=seed)
        draw.shuffle(pool)
        taken = 0
        for mutant in pool:
            function = _function(mutant.text, case)
            if function is None or not _differs(function, right, coordinates, mechanism):
                continue
            solver = draw.choice(("ode2", "ode4", "ode5"))
            coarse = step * draw.choice((0.5, 1, 2))
            handed = dc.Equations(function, coordinates, name=f"{case}.py")
            yield Case(
                f"{case}.py:{mutant.line}: {mutant.before} -> {mutant.after} ({mutant.kind}), {solver}",
                f"wrong: {mutant.kind}",
                False,
                mechanism,
                _runner(mechanism, start, duration, solver, equations=handed),
                (coarse, coarse / 2, coarse / 4),
                function,
                coordinates,
                SOLVERS[solver].order,
            )
            taken += 1
            if taken == each:
                break


def _start(case: str, mechanism: dc.Mechanism) -> tuple[dc.State, float, float]:
    """Where the motions of a hand-written case start, how long they last and at which step."""
    if case == "heavy_top":
        speeds = {"tip.wx": 1.0, "tip.wy": 8.0, "tip.wz": -2.0}
        return mechanism.state({}, speeds=speeds), 1.0, 0.005
    problem = dc.problems.load(case.replace("_", "-"))
    return problem.state, 2.0, 0.01


def parameters(seed: int, count: int) -> Iterator[Case]:
    """Runs of a mechanism one of whose parameters is 1 % larger than the model says."""
    draw = random.Random(f"parameters {seed}")
    pairs = [
        (name, parameter)
        for name in dc.problems.names()
        for parameter in dc.problems.load(name).mechanism.parameters
        if not dc.problems.load(name).mechanism.events
    ]
    draw.shuffle(pairs)
    taken = 0
    for name, parameter in pairs:
        problem = dc.problems.load(name)
        value = problem.mechanism.parameters[parameter]
        other = problem.mechanism.with_parameters(**{parameter: 1.01 * value})
        solver, coarse = draw.choice(("ode4", "ode5")), problem.step * draw.choice((1, 2, 4))
        duration = _duration(problem, coarse)
        try:
            if value == 0.0 or not _moves_otherwise(problem, other, duration, coarse / 4):
                continue
        except dc.InputError:
            continue  # a length of a loop: it cannot be assembled so
        delivered = draw.choice(FOREIGN)
        yield Case(
            f"{name}: {parameter} 1 % larger, {solver}, h = {coarse:.3g} s, {delivered}",
            "wrong: parameter 1 %",
            False,
            problem.mechanism,
            delivery(_runner(other, problem.state, duration, solver), delivered),
            (coarse, coarse / 2, coarse / 4),
            order=SOLVERS[solver].order,
        )
        taken += 1
        if taken == count:
            return


def lost_forces(seed: int) -> Iterator[Case]:
    """Runs in which one force of the model does not act."""
    draw = random.Random(f"lost {seed}")
    for name in dc.problems.names():
        problem = dc.problems.load(name)
        mechanism = problem.mechanism
        without: list[tuple[str, dc.Mechanism]] = [
            (
                element.name,
                replace(mechanism, forces=tuple(f for f in mechanism.forces if f != element)),
            )
            for element in mechanism.forces
        ]
        if any(joint.damping for joint in mechanism.joints):
            freed = tuple(replace(joint, damping=0.0) for joint in mechanism.joints)
            without.append(("damping", replace(mechanism, joints=freed)))
        if mechanism.gravity != (0.0, 0.0, 0.0):
            without.append(("gravity", replace(mechanism, gravity=(0.0, 0.0, 0.0))))
        for lost, other in without:
            for delivered in FOREIGN:
                solver, coarse = (
                    draw.choice(("ode4", "ode5")),
                    problem.step * draw.choice((1, 2, 4)),
                )
                duration = _duration(problem, coarse)
                if other.events or not _moves_otherwise(problem, other, duration, coarse / 4):
                    continue
                yield Case(
                    f"{name}: {lost} lost, {solver}, h = {coarse:.3g} s, {delivered}",
                    "wrong: lost force",
                    False,
                    mechanism,
                    delivery(_runner(other, problem.state, duration, solver), delivered),
                    (coarse, coarse / 2, coarse / 4),
                    order=SOLVERS[solver].order,
                )


# --- how runs are made and delivered ----------------------------------------------------------------


def simulating(
    problem: Any, solver: str, duration: float, equations: Any = None, **options: Any
) -> Callable[[float], dc.Trajectory]:
    """A problem's motion as a function of the step."""
    return _runner(
        problem.mechanism, problem.state, duration, solver, equations=equations, **options
    )


def _runner(
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
                return replace(made, integrals=bare)
            case "no accelerations":
                return replace(made, udot=None)
            case "positions and speeds":
                return replace(made, udot=None, integrals=bare)
            case "float32":
                return _rounded(replace(made, integrals=bare))
            case _:
                return _every(replace(made, integrals=bare), 4)

    return delivered


def _rounded(run: dc.Trajectory) -> dc.Trajectory:
    def short(values: np.ndarray) -> np.ndarray:
        return values.astype(np.float32).astype(np.float64)

    return replace(
        run,
        q=short(run.q),
        u=short(run.u),
        udot=None if run.udot is None else short(run.udot),
        forces={n: short(f) for n, f in run.forces.items()},
    )


def _every(run: dc.Trajectory, stride: int) -> dc.Trajectory:
    rows = slice(None, None, stride)
    return replace(
        run,
        t=run.t[rows],
        q=run.q[rows],
        u=run.u[rows],
        udot=None if run.udot is None else run.udot[rows],
        forces={n: f[rows] for n, f in run.forces.items()},
        integrals={n: z[rows] for n, z in run.integrals.items()},
    )


def _duration(problem: Any, coarse: float) -> float:
    """As long as the problem, but no more steps than `LONGEST`; a whole number of them."""
    steps = max(8, min(LONGEST, round(problem.duration / coarse)))
    return steps * coarse


# --- what is really wrong ---------------------------------------------------------------------------


def _function(text: str, case: str) -> Callable[..., Any] | None:
    """The function `rhs` of a module's text, None if it cannot be made or called."""
    scope: dict[str, Any] = {"__name__": f"equations.{case}"}
    try:
        exec(compile(text, f"{case}.py", "exec"), scope)
    except Exception:
        return None
    function: Callable[..., Any] = scope["rhs"]
    return function


def _differs(
    function: Callable[..., Any], right: Callable[..., Any] | None, coordinates: Any, mechanism: Any
) -> bool:
    """Whether the accelerations differ at random states, and the function gives numbers at all."""
    assert right is not None
    rng = np.random.default_rng(0)
    nq, nu = len(mechanism.free.q), len(mechanism.free.u)
    if coordinates is not None:
        nq = len(coordinates.coordinates)
        nu = len(coordinates.speeds or coordinates.coordinates)
    worst = 0.0
    for _ in range(8):
        q, u = rng.uniform(-2, 2, nq), rng.uniform(-3, 3, nu)
        try:
            with np.errstate(all="ignore"):
                a = np.asarray(function(0.3, q.copy(), u.copy()), dtype=float)
                b = np.asarray(right(0.3, q.copy(), u.copy()), dtype=float)
        except Exception:
            return False
        if a.shape != b.shape or not np.isfinite(a).all():
            return False
        worst = max(worst, float(np.abs(a - b).max() / (1.0 + np.abs(b).max())))
    return worst > 1e-6


def _moves_otherwise(problem: Any, other: dc.Mechanism, duration: float, step: float) -> bool:
    """Whether the motion of another mechanism differs from the problem's at all."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        a = dc.simulate(problem.mechanism, problem.state, duration, step, "ode5", ())
        b = dc.simulate(other, problem.state, duration, step, "ode5", ())
    rows = min(len(a), len(b))
    size = 1.0 + float(np.abs(a.u).max())
    return float(np.abs(a.u[:rows] - b.u[:rows]).max()) > 1e-5 * size


def all_cases(seed: int, scale: float = 1.0) -> Sequence[Callable[[], Iterator[Case]]]:
    """The generators of a seed, right ones first; `scale` shrinks them for a quick look."""
    return (
        lambda: right(seed, round(280 * scale)),
        lambda: by_hand(seed),
        lambda: traps(seed),
        lambda: mutated(seed, round(50 * scale)),
        lambda: parameters(seed, round(60 * scale)),
        lambda: lost_forces(seed),
    )
