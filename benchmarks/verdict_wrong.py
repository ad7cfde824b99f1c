"""Wrong equations, parameters and forces: motions that should be called wrong, where they differ."""

from __future__ import annotations

import random
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import equations
import numpy as np
from verdict_runs import Case, delivery, length, running

import deltac as dc
from deltac.repair.mutate.operators import mutants
from deltac.simulation.solvers import SOLVERS

HERE = Path(__file__).resolve().parent

FOREIGN = ("accelerations", "positions and speeds")
"""How runs of another mechanism are delivered: its integrals are its own and no part of a log."""


def mutated(seed: int, each: int) -> Iterator[Case]:
    """Single mistakes in the hand-written equations of the cases of `equations`."""
    for case in equations.CASES:
        text = (HERE / "equations" / f"{case}.py").read_text("utf-8")
        mechanism, coordinates = equations.load(case)
        start, duration, step = start_of(case, mechanism)
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
                "wrong: single mistake",
                False,
                mechanism,
                running(mechanism, start, duration, solver, equations=handed),
                (coarse, coarse / 2, coarse / 4),
                function,
                coordinates,
                SOLVERS[solver].order,
            )
            taken += 1
            if taken == each:
                break


def start_of(case: str, mechanism: dc.Mechanism) -> tuple[dc.State, float, float]:
    """Where the motions of a hand-written case start, how long they last and at which step."""
    if case == "heavy_top":
        speeds = {"tip.wx": 1.0, "tip.wy": 8.0, "tip.wz": -2.0}
        return mechanism.state({}, speeds=speeds), 1.0, 0.005
    if case == "two_link_arm":
        return mechanism.state({"a": 1.2, "b": -0.7}), 2.0, 0.01
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
        try:
            other = problem.mechanism.with_parameters(**{parameter: 1.01 * value})
        except dc.InputError:
            continue  # no body has such moments of inertia
        solver, coarse = draw.choice(("ode4", "ode5")), problem.step * draw.choice((1, 2, 4))
        duration = length(problem, coarse)
        if value == 0.0:
            continue
        delivered = draw.choice(FOREIGN)
        yield Case(
            f"{name}: {parameter} 1 % larger, {solver}, h = {coarse:.3g} s, {delivered}",
            "wrong: parameter 1 %",
            False,
            problem.mechanism,
            delivery(running(other, problem.state, duration, solver), delivered),
            (coarse, coarse / 2, coarse / 4),
            order=SOLVERS[solver].order,
            differs=partial(_moves_otherwise, problem, other, duration, coarse),
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
                duration = length(problem, coarse)
                if other.events:
                    continue
                yield Case(
                    f"{name}: {lost} lost, {solver}, h = {coarse:.3g} s, {delivered}",
                    "wrong: lost force",
                    False,
                    mechanism,
                    delivery(running(other, problem.state, duration, solver), delivered),
                    (coarse, coarse / 2, coarse / 4),
                    order=SOLVERS[solver].order,
                    differs=partial(_moves_otherwise, problem, other, duration, coarse),
                )


# --- a gyroscopic term lost ---------------------------------------------------------------------------

AXES = ("x", "y", "z", "xy", "yz", "zx", "xyz")
"""Of which equations the gyroscopic term is left out."""


def gyroscopic(seed: int) -> Iterator[Case]:
    """Euler's equations by hand without parts of ω × Iω: that of all axes together does no work."""
    draw = random.Random(f"gyroscopic {seed}")
    for body, make in (("thrown box", _box), ("body on a tip", _top)):
        for lost in AXES:
            for _ in range(2):
                rates = [round(draw.choice((-1, 1)) * draw.uniform(0.5, 6.0), 2) for _ in range(3)]
                solver = draw.choice(("ode2", "ode4", "ode5"))
                coarse = 0.005 * draw.choice((0.5, 1, 2))
                mechanism, state, function = make(lost, rates)
                handed = dc.Equations(function, name="by hand")
                yield Case(
                    f"{body}: gyroscopic term of {lost} lost, ω = {rates}, {solver}, h = {coarse:.3g} s",
                    "wrong: gyroscopic term",
                    False,
                    mechanism,
                    running(mechanism, state, 400 * coarse, solver, equations=handed),
                    (coarse, coarse / 2, coarse / 4),
                    function,
                    order=SOLVERS[solver].order,
                )


def _box(lost: str, rates: list[float]) -> tuple[dc.Mechanism, dc.State, Callable[..., Any]]:
    problem = dc.problems.load("torque-free-box")
    A, B, C = 10.0 / 12 * np.array([0.97, 0.82, 0.17])
    keep = [float(axis not in lost) for axis in "xyz"]

    def rhs(t: float, q: Any, u: Any) -> np.ndarray:
        wx, wy, wz = u[3], u[4], u[5]
        zero = 0.0 * wx
        ax = keep[0] * (B - C) * wy * wz / A
        ay = keep[1] * (C - A) * wz * wx / B
        az = keep[2] * (A - B) * wx * wy / C
        return np.array([zero, zero, zero - 9.8, ax, ay, az])

    state = problem.mechanism.state(speeds={"flight": (-2.0, 2.0, 8.0, *rates)})
    return problem.mechanism, state, rhs


def _top(lost: str, rates: list[float]) -> tuple[dc.Mechanism, dc.State, Callable[..., Any]]:
    mechanism, _ = equations.load("heavy_top")
    from equations.heavy_top import A, B, C, down, g, h, m

    keep = [float(axis not in lost) for axis in "xyz"]

    def rhs(t: float, q: Any, u: Any) -> np.ndarray:
        wx, wy, wz = u
        dx, _, dz = down(q)
        ax = (h * m * g * dz - keep[0] * (C - B) * wy * wz) / A
        ay = -keep[1] * (A - C) * wz * wx / B
        az = (-h * m * g * dx - keep[2] * (B - A) * wx * wy) / C
        return np.array([ax, ay, az])

    names = ("tip.wx", "tip.wy", "tip.wz")
    return mechanism, mechanism.state({}, speeds=dict(zip(names, rates))), rhs


# --- what is really wrong -----------------------------------------------------------------------------


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
        try:
            a = dc.simulate(problem.mechanism, problem.state, duration, step, "ode4", ())
            b = dc.simulate(other, problem.state, duration, step, "ode4", ())
        except dc.InputError:
            return False  # a length of a loop: it cannot be assembled so
    rows = min(len(a), len(b))
    size = 1.0 + float(np.abs(a.u).max())
    return float(np.abs(a.u[:rows] - b.u[:rows]).max()) > 1e-5 * size
