"""The rows of M u̇ − f, of a function that has solved for u̇ by hand.

In u̇ = M⁻¹ f the effects of a mistake in M and of one in f multiply, and each reaches every u̇. In M u̇ − f,
at the model's accelerations, they add up and stay in their own rows. So f is looked for on the tape: n
slots in which the results are linear and homogeneous, everything else held. M⁻¹ is what multiplies them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from deltac.arrays import ROOT_EPS, Array
from deltac.repair.tracing.program import Program
from deltac.repair.tracing.tape import TapeChange, identity

LINEAR = ROOT_EPS
"""Relative departure from linearity that is rounding."""

SETS_OF_SLOTS = 100_000
"""Sets of slots that are looked at, of the earliest ones."""

WORST = 1.0 / ROOT_EPS
"""Condition of M⁻¹ beyond which its inverse says nothing."""


@dataclass(frozen=True, eq=False, repr=False)
class UnsolvedForm(Program):
    """A program whose residual is that of M u̇ = f, the entries of f being the slots `forces`."""

    forces: tuple[int, ...]

    solves = True

    def system(self, changes: Mapping[int, TapeChange] | None = None) -> tuple[Array, Array]:
        """M (B, n, n), not a number where M⁻¹ is singular, and f (n, B)."""
        f = self.tape.run(self.forces, changes)
        inverse = np.moveaxis(_slopes(self, self.forces, changes), -1, 0)
        bad = np.asarray(~np.isfinite(inverse).all(axis=(1, 2)))
        with np.errstate(all="ignore"):
            bad |= np.linalg.det(np.where(bad[:, None, None], 0.0, inverse)) == 0.0
            inverse = np.where(bad[:, None, None], np.eye(len(f)), inverse)
            M = np.linalg.inv(inverse)
        return np.where(bad[:, None, None], np.nan, M), f

    def matters(self, slot: int) -> bool:
        """Whether a slot is in M or f; what is made of f is neither."""
        return super().matters(slot) and not any(slot in self.tape.after(k) for k in self.forces)


def unsolved_form(program: Program) -> UnsolvedForm | None:
    """The program by the rows of M u̇ = f, where it has such rows."""
    n = len(program.samples.acceleration)
    if program.solves or n < 2:
        return None
    for forces in _forces(program):
        form = UnsolvedForm(program.trace, program.samples, forces)
        with np.errstate(all="ignore"):
            if np.isfinite(form.original_residual).all():
                return form
    return None


def _slopes(
    program: Program,
    forces: tuple[int, ...],
    changes: Mapping[int, TapeChange] | None = None,
) -> Array:
    """What the results are (n, n, B) with one of the forces 1, the others 0, in turn."""
    units = ({k: TapeChange.to(float(k == one)) for k in forces} for one in forces)
    runs = [program.run({**(changes or {}), **unit})[: len(forces)] for unit in units]
    return np.stack(runs, axis=1)


def _forces(program: Program) -> Iterator[tuple[int, ...]]:
    """Sets of slots in which the results are linear and homogeneous, the earliest first."""
    tape, n = program.tape, len(program.samples.acceleration)
    base = program.run()[:n]
    if not np.isfinite(base).all():
        return
    size = np.abs(base).max()
    used = sorted(tape.before(program.trace.outputs))
    slots, parts = [], []
    for k in used:
        if not tape.varying[k] or tape.operations[k] in (None, identity):
            continue
        if np.ndim(tape.values[k]) > 1:  # the solution of linear equations, no number
            continue
        x = np.broadcast_to(tape.values[k], program.samples.t.shape)
        none, twice = (program.run({k: TapeChange.to(factor * x)})[:n] for factor in (0.0, 2.0))
        part = base - none
        straight = np.abs(twice - base - part).max() <= LINEAR * size
        if straight and np.abs(part).max() > LINEAR * size:
            slots.append(k)
            parts.append(part.ravel())
        if math.comb(len(slots) + 1, n) > SETS_OF_SLOTS:
            break
    if len(slots) < n:
        return
    P, whole = np.array(parts), base.ravel()
    line = np.random.default_rng(0).standard_normal(len(whole)) / size
    on_line, goal = P @ line, float(whole @ line)
    sets = np.array(list(itertools.combinations(range(len(slots)), n)))
    near = np.abs(on_line[sets].sum(axis=1) - goal) <= 1e-6 * (np.abs(line).sum() + abs(goal))
    for chosen in sets[near]:
        forces = tuple(slots[i] for i in chosen)
        if np.abs(P[chosen].sum(axis=0) - whole).max() <= LINEAR * size and _free(program, forces):
            J = np.moveaxis(_slopes(program, forces), -1, 0)
            f = np.stack([np.broadcast_to(tape.values[k], base.shape[1:]) for k in forces])
            usable = bool(np.isfinite(J).all()) and np.linalg.cond(J).max() < WORST
            if usable and np.abs(np.einsum("bij,jb->ib", J, f) - base).max() <= LINEAR * size:
                yield forces


def _free(program: Program, forces: tuple[int, ...]) -> bool:
    """Whether none of the slots depends on another."""
    return not any(b in program.tape.after(a) for a in forces for b in forces)
