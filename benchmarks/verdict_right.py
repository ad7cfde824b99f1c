"""Right equations: motions that must never be called wrong."""

from __future__ import annotations

import random
from collections.abc import Iterator
from typing import Any

from verdict_runs import Case, delivery, length, simulating

import deltac as dc
from deltac.simulation.solvers import SOLVERS

EXPLICIT = ("ode1", "ode2", "ode3", "ode4", "ode5", "ode8", "semi-implicit-euler")
IMPLICIT = tuple(s.name for s in SOLVERS.values() if s.family == "implicit")

HANDED_OVER = ("full", "full", "no accelerations", "positions and speeds", "float32", "decimated")
"""How runs are delivered: with all that they hold; without u̇; without u̇ and integrals; …"""

COARSENESS = (1, 1, 4, 16, 64)
"""Multiples of a problem's own step; the largest are far too coarse for most."""


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
            delivery(simulating(problem, solver, length(problem, coarse)), delivered),
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
            run = simulating(problem, "ode4", length(problem, coarse), problem.equations)
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
    ("triple-pendulum", {"constraints": dc.Projection(energy=True)}),
    ("andrews-squeezer", {"constraints": dc.Baumgarte(20.0, 20.0)}),
    ("n-four-bar", {"constraints": dc.Baumgarte(20.0, 20.0)}),
    ("rolling-disc", {"constraints": None}),
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
            run = simulating(problem, solver, length(problem, coarse), **options)
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
    from thesis.runs import problem

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
