"""What value an expression must have for the whole function to be right, state by state.

If one expression is wrong, there is a value that it should have had: the one for which the
accelerations become the model's. It is found by Newton's method, n equations for one unknown at each
state; for an expression of constants alone, one unknown for all states at once. Where the equations
contradict each other, the mistake is not in that expression (or not in it alone). An edit is then sought
for what the value should be, which is far less work than running the function for every edit, and finds
factors and terms that are missing altogether.
"""

from __future__ import annotations

import ast
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import HALF_DIGITS, Array
from deltac.repair.tracing.program import Program
from deltac.repair.tracing.samples import RIGHT
from deltac.repair.tracing.tape import TapeChange

EDIT_ITERATIONS = 10
STARTS = (1.0, 0.0, -1.0, 4.0, 0.25)
"""Newton's method starts from these multiples of the value, where the earlier ones led nowhere."""

Flags: TypeAlias = NDArray[np.bool_]
Residual: TypeAlias = Callable[[Array], Array]
Step: TypeAlias = Callable[[Array, Array], Array]


@dataclass(frozen=True, eq=False)
class Requirement:
    """The value that a node must have.

    value       what it is, (B,)
    required    what it must be, (B,)
    weight      how much the equations depend on it, (B,): where they hardly do, rounding decides the value
    rows        the equations that it acts on, (n,) of bool
    sufficient  whether all equations are right then; else only those of `rows`
    unique      whether there is no other such value
    """

    place: int
    slot: int
    value: Array
    required: Array
    weight: Array
    rows: tuple[bool, ...]
    sufficient: bool
    unique: bool


@dataclass(eq=False, repr=False)
class Requirements:
    """The values that the nodes of a program must have, found one by one.

    `undecided` are nodes for which no value was found, though there may be one.
    """

    program: Program
    solved: dict[int, Requirement] = field(default_factory=dict)
    undecided: list[int] = field(default_factory=list)

    def find(self, place: int) -> None:
        """Find what one node must be, if it is still one number that counts."""
        if place not in self.program.numbers:
            return
        slot = self.program.numbers[place].value.index
        constant = not self.program.tape.varying[slot]
        with np.errstate(all="ignore"):
            outcome = self._solve(place, slot, constant)
            within = not isinstance(self.program.source.owner(place), ast.Module)
            if constant and within and not isinstance(outcome, Requirement):
                # It may be constant by mistake: what should stand there depends on the state.
                outcome = self._solve(place, slot, False) or outcome
        if isinstance(outcome, Requirement):
            self.solved[place] = outcome
        elif outcome is None:
            self.undecided.append(place)

    def closing(self, place: int, row: int) -> Requirement | None:
        """What one node must be for one equation to be right, whatever becomes of the others."""
        slot = self.program.numbers[place].value.index
        with np.errstate(all="ignore"):
            requirement = self._solve(place, slot, not self.program.tape.varying[slot], only=row)
        return requirement if isinstance(requirement, Requirement) else None

    def _solve(
        self, place: int, slot: int, common: bool, only: int | None = None
    ) -> Requirement | bool | None:
        """The requirement; False if there can be none, None if none was found.

        `common`: one value for all states of a set of parameters. `only`: for this equation alone.
        """
        program = self.program
        start = program.values(slot)
        group = program.samples.group
        starts = np.searchsorted(group, np.arange(group[-1] + 1))

        def residual(x: Array) -> Array:
            return program.residual({slot: TapeChange.to(x)})

        def nearest(slope: Array, r: Array) -> Array:
            """The step that makes r smallest, by least squares over what the unknown is common to."""
            down, square = np.sum(slope * r, axis=0), np.sum(slope**2, axis=0)
            if common:
                down, square = (np.add.reduceat(x, starts)[group] for x in (down, square))
            return np.asarray(-down / np.maximum(square, 1e-24 * square.max()))

        size = sizes(start)
        before = program.original_residual
        h = 1e-4 * size
        slope = (residual(start + h) - before) / h
        effect = np.abs(slope * size).max(axis=1)
        if not np.isfinite(effect).all():
            return None
        if not effect.max() > 1e-12:
            return False
        rows: Flags = effect > HALF_DIGITS * effect.max()
        if only is not None:
            rows &= np.arange(len(rows)) == only
        if not rows.any():
            return False
        if np.abs(before[rows]).max() < RIGHT:
            return False  # what it acts on is right as it is
        step = nearest(slope[rows], before[rows])
        x, after = start + step, residual(start + step)
        bend = np.abs(after - before - slope * step).max()
        straight = bool(bend < HALF_DIGITS * np.abs(slope * step).max())
        solved = np.abs(after[rows]).max(axis=0) < RIGHT
        if straight and not solved.all():
            return False
        if not straight:
            x, solved = _divided(residual, nearest, rows, start)
            straight = bool(solved.all())
        if not straight:
            x, solved = _newton(residual, nearest, rows, start, common)
        if not solved.all():
            return None
        after = residual(x)
        sufficient = bool(np.abs(after).max() < RIGHT)
        if not sufficient and rows.all() and only is None:
            return False
        unique = straight or common
        length = np.sqrt(np.sum(slope[rows] ** 2, axis=0))
        weight = np.ones_like(x) if common else length / length.max()
        return Requirement(
            place, slot, start, x, weight, tuple(map(bool, rows)), sufficient, unique
        )


def _divided(residual: Residual, nearest: Step, rows: Flags, start: Array) -> tuple[Array, Flags]:
    """Roots where the equations are linear in 1/x, as in a divisor: one step."""
    y = 1.0 / np.where(start == 0.0, 1.0, start)
    h = 1e-4 * np.abs(y)
    before = residual(1.0 / y)[rows]
    y = y + nearest((residual(1.0 / (y + h))[rows] - before) / h, before)
    x = 1.0 / y
    return x, np.abs(residual(x)[rows]).max(axis=0) < RIGHT


def sizes(value: Array) -> Array:
    """How large a number is at each state; 1 where it is zero at all of them, which tells no size."""
    return np.abs(value) + np.sqrt(np.mean(value**2)) if value.any() else np.ones_like(value)


def _newton(
    residual: Residual, nearest: Step, rows: Flags, start: Array, common: bool
) -> tuple[Array, Flags]:
    """Roots of the residual in `rows`, and at which states they were found."""
    best = start.copy()
    solved: Flags = np.zeros(start.shape, dtype=bool)
    size = sizes(start)
    h = 1e-7 * size
    for multiple in STARTS:
        x = multiple * start
        r = residual(x)[rows]
        for _ in range(EDIT_ITERATIONS):
            dx = nearest((residual(x + h)[rows] - r) / h, r)
            x = np.where(np.isfinite(dx), x + dx, x)
            r = residual(x)[rows]
            good = np.abs(r).max(axis=0) < RIGHT
            new = (np.full_like(solved, good.all()) if common else good) & ~solved
            best[new] = x[new]
            solved |= new
            if solved.all() or not (~solved & (np.abs(dx) > 1e-6 * size)).any():
                break
        if solved.all() or (multiple == -1.0 and np.mean(solved) < 0.3):
            break  # hopeless: the states contradict each other
    if solved.all():
        # Once more: the last step of a quadratic method gives the other half of the digits.
        dx = nearest((residual(best + h)[rows] - residual(best)[rows]) / h, residual(best)[rows])
        best = np.where(np.isfinite(dx), best + dx, best)
    return best, solved
