"""What value an expression must have for the whole function to be right, state by state.

If one expression is wrong, there is a value that it should have had: the one for which the
accelerations become the model's. It is found by Newton's method at each state by itself, n equations
for one unknown. Where they contradict each other, the mistake is not in that expression (or not in it
alone). An edit is then sought for what the value should be, which is far less work than running the
function for every edit, and finds factors and terms that are missing altogether.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deltac.diagnosis.repair.program import Program
from deltac.diagnosis.repair.samples import RIGHT
from deltac.diagnosis.repair.tape import Array

STEPS = 10
STARTS = (1.0, 0.0, -1.0, 4.0, 0.25)
"""Newton's method starts from these multiples of the value, where the earlier ones led nowhere."""

INFLUENCE = 1e-6
"""An equation in which an expression counts for less than this share of its effect does not have it."""


@dataclass(frozen=True, eq=False)
class Requirement:
    """The value that a node must have.

    value     what it is, (B,)
    required  what it must be, (B,)
    rows      the equations that it acts on, (n,) of bool
    whole     whether all equations are right then; else only those of `rows`
    linear    whether the equations are linear in it, so that there is no other such value
    """

    place: int
    slot: int
    value: Array
    required: Array
    rows: tuple[bool, ...]
    whole: bool
    linear: bool


def required(program: Program, place: int) -> Requirement | None:
    """The value that a node must have; None if there is none, or none was found."""
    slot = program.numbers[place].value.index
    start = np.broadcast_to(program.tape.values[slot], program.samples.t.shape).astype(float)
    size = np.abs(start) + np.sqrt(np.mean(start**2)) + 1e-12
    before = program.residual()
    h = 1e-4 * size

    def off(x: Array) -> Array:
        return program.residual(values={slot: x})

    slope = (off(start + h) - before) / h
    effect = np.abs(slope * size).max(axis=1)
    if not (np.isfinite(effect).all() and effect.max() > 1e-12):
        return None
    rows = effect > INFLUENCE * effect.max()
    # A straight line through three points: then one step decides.
    step = -_project(slope[rows], before[rows])
    after = off(start + step)
    straight = np.abs(after - before - slope * step).max() < 1e-7 * np.abs(slope * step).max()
    if straight:
        x, found = start + step, np.abs(after[rows]).max(axis=0) < RIGHT
        if not found.all():
            return None
    else:
        x, found = _newton(off, rows, start, size)
        if not found.all():
            return None
        after = off(x)
    whole = bool(np.abs(after).max() < RIGHT)
    if not whole and rows.all():
        return None
    return Requirement(place, slot, start, x, tuple(map(bool, rows)), whole, bool(straight))


def _newton(off, rows, start, size):  # type: ignore[no-untyped-def]
    """Roots of the residual in `rows`, state by state, and where they were found."""
    best = start.copy()
    found = np.zeros(start.shape, dtype=bool)
    for multiple in STARTS:
        x = multiple * start
        r = off(x)[rows]
        for step in range(STEPS):
            h = 1e-7 * size
            slope = (off(x + h)[rows] - r) / h
            dx = -_project(slope, r)
            x = np.where(np.isfinite(dx), x + dx, x)
            r = off(x)[rows]
            new = (np.abs(r).max(axis=0) < RIGHT) & ~found
            best[new] = x[new]
            found |= new
            if found.all():
                return best, found
            still = ~found & (np.abs(dx) > 1e-6 * size)
            if not still.any():
                break
        # Nothing found at a third of the states: they contradict each other.
        if np.mean(found) < 0.3 and multiple in (0.0, -1.0):
            break
    return best, found


def _project(slope: Array, r: Array) -> Array:
    """The multiple of the slope nearest to r, state by state."""
    square = np.sum(slope**2, axis=0)
    with np.errstate(all="ignore"):
        return np.asarray(np.sum(slope * r, axis=0) / np.maximum(square, 1e-24 * square.max()))
