"""Explicit fixed steps: many in one native call; or stage by stage, where one is taken by itself."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from deltac.arrays import Array
from deltac.dynamics.kkt import LEAST_PIVOT
from deltac.dynamics.spatial import SX
from deltac.kernels import Kernel
from deltac.kernels.simd import INSTRUCTIONS_CACHED
from deltac.simulation.constraints.energy import energy_correction
from deltac.simulation.flow import StateFlow
from deltac.simulation.solvers import Solver
from deltac.simulation.stepping.interpreted import StageRate, settled
from deltac.simulation.stepping.protocol import FinishedStates, Step, StepGrid, Stepper
from deltac.simulation.stepping.runge_kutta import Tableau, tableau_of

FUSED_INSTRUCTIONS = 4_000
"""A step larger than this is compiled stage by stage where that is possible: the stages share their code."""

BLOCK_BYTES = 2**22
"""Memory of the rows that are computed in one go, a row a step or a stage."""


@dataclass(frozen=True, eq=False)
class StepLoop:
    """A kernel to be iterated: rows that begin with (x, k), and parameters: (coefficients; p, t0, h).

    `coefficients` has a row for each stage of a step, if a row is a stage; else one, empty row.
    """

    kernel: Kernel
    coefficients: Array

    def run(self, k: int, x: Array, constants: Array, most: int) -> Array:
        """The rows at the ends of the next steps from step k and state x, `most` at most, one at least."""
        stages = len(self.coefficients)
        count = max(1, min(most, BLOCK_BYTES // (8 * self.kernel.n_in * stages)))
        start = np.zeros(self.kernel.n_in)
        start[: len(x)], start[len(x)] = x, k
        parameters = np.hstack([self.coefficients, np.tile(constants, (stages, 1))])
        return self.kernel.iterate(start, count * stages, parameters)[stages - 1 :: stages]


@dataclass(frozen=True)
class FixedMethod:
    """An explicit solver on a flow, in symbols and compiled: kept between runs, and without numbers.

    Native code takes many steps in one call: a loop over whole steps or, for large mechanisms, over stages.
    """

    flow: StateFlow
    solver: Solver

    @cached_property
    def single_step(self) -> Any:
        """(x, k; p, t0, h) -> x one step later, and the smallest pivot met on the way."""
        flow, step = self.flow, self.solver.step
        assert step is not None
        tied = flow.bound is not None and flow.equations is None
        met = flow.bound.schur.smallest_pivot if flow.bound is not None and tied else ca.SX(1)
        f = ca.Function("f", [flow.t, flow.x, flow.p], [flow.xdot, met], {"cse": True})
        k, t0, h = ca.SX.sym("k"), ca.SX.sym("t0"), ca.SX.sym("h")
        pivots: list[SX] = []

        def rate(t: SX, x: SX) -> SX:
            xdot, met = f(t, x, flow.p)
            pivots.append(met)
            return xdot

        after = step(rate, t0 + k * h, flow.x, h, flow.parts)
        after, worst = settled(flow, t0 + (k + 1) * h, flow.normalised(after))
        if flow.correcting:
            after = energy_correction(flow)(t0 + (k + 1) * h, after, flow.p, h)
        if tied:  # a stage on a singular configuration spoils the step, wherever it ends
            for met in pivots:
                worst = ca.fmin(worst, met)
        return ca.Function("step", [flow.x, k, flow.p, t0, h], [after, worst])

    @cached_property
    def loop(self) -> StepLoop | None:
        """What takes many steps in one call; None where a step goes stage by stage from Python."""
        if self.stages is not None and self.instructions > FUSED_INSTRUCTIONS:
            return _stages(self.flow, self.stages)
        return self._steps if self.instructions <= INSTRUCTIONS_CACHED else None

    @cached_property
    def stages(self) -> Tableau | None:
        """The tableau, where its stages and their sums are all that a step consists of."""
        plain = self.flow.bound is None and not self.flow.correcting
        return tableau_of(self.solver.name) if plain else None

    @cached_property
    def instructions(self) -> int:
        """The size of a step: that of its stages, so that a large one is not written out to know it."""
        if self.stages is not None:
            return len(self.stages.b) * int(self.flow.rate.n_instructions())
        return int(self.single_step.n_instructions())

    @property
    def _steps(self) -> StepLoop:
        """Rows (x, k, smallest pivot), one a step."""
        flow = self.flow
        k, t0, h = ca.SX.sym("k"), ca.SX.sym("t0"), ca.SX.sym("h")
        after, worst = self.single_step(flow.x, k, flow.p, t0, h)
        kernel = Kernel(
            {"x": flow.x, "k": k, "worst": ca.SX.sym("worst")},
            {"x": after, "k": k + 1, "worst": worst},
            ca.vertcat(flow.p, t0, h),
            name=f"{self.solver.name} step",
        )
        return StepLoop(kernel, np.empty((1, 0)))


def _stages(flow: StateFlow, tableau: Tableau) -> StepLoop:
    """Rows (x, k, earlier slopes), one a stage.

    All stages are the same function; coefficients tell it which of them it is: a_ij by how long ago slope j
    was computed, weights b_j that are zero but for the last stage, the node c_i, and whether it is the last.
    """
    count, n = len(tableau.b), flow.x.shape[0]
    x, k, slopes = ca.SX.sym("x", n), ca.SX.sym("k"), ca.SX.sym("slopes", n, count - 1)
    a, b = ca.SX.sym("a", count - 1), ca.SX.sym("b", count)
    t0, h, c, last = (ca.SX.sym(name) for name in ("t0", "h", "c", "last"))
    slope = flow.rate(t0 + (k + c) * h, x + h * ca.mtimes(slopes, a), flow.p)
    slopes_now = ca.horzcat(slopes, slope)
    after = x + h * ca.mtimes(slopes_now, b)
    if flow.quaternions:
        after = ca.if_else(last, flow.normalised(after), x)
    coefficients = np.zeros((count, 2 * count + 1))
    for i, row in enumerate(tableau.a):
        coefficients[i, count - 1 - i : count - 1] = row[:i]
    coefficients[-1, count - 1 : -2], coefficients[:, -2] = tableau.b, tableau.c
    coefficients[-1, -1] = 1.0
    kernel = Kernel(
        {"x": x, "k": k, "slopes": ca.vec(slopes)},
        {"x": after, "k": k + last, "slopes": ca.vec(slopes_now[:, 1:])},
        ca.vertcat(a, b, c, last, flow.p, t0, h),
        name=f"stage of {count}",
    )
    return StepLoop(kernel, coefficients)


class FixedSteps(Stepper):
    """The steps of an explicit method: compiled ones ahead, single ones of any length stage by stage."""

    def __init__(self, method: FixedMethod, rate: StageRate, p: Array, *, compiled: bool) -> None:
        """Of a run with parameters p; `compiled` unless users' functions are called in between."""
        self._method, self._rate, self._p = method, rate, p
        self._watches = method.flow.bound is not None and method.flow.equations is None
        self._loop = method.loop if compiled else None

    def attempt(self, t: float, x: Array, until: float) -> Step:
        """To `until`, stage by stage."""
        step, rate, parts = self._method.solver.step, self._rate, self._method.flow.parts
        assert step is not None

        def exact(time: float) -> Array:
            with np.errstate(all="ignore"):
                state: Array = step(rate, t, x, time - t, parts)
            return state

        return Step(t, x, until, exact(until), exact)

    def ahead(self, grid: StepGrid, k: int, x: Array, most: int) -> FinishedStates | None:
        """Compiled steps, up to where the constraints become dependent."""
        if self._loop is None:
            return None
        most, n = min(most, grid.count - k), len(x)
        rows = self._loop.run(k, x, np.array([*self._p, grid.start, grid.step]), most)
        singular = False
        if self._watches:
            good = rows[:, n + 1] > LEAST_PIVOT
            if not good.all():
                rows, singular = rows[: int(np.argmin(good))], True
        return FinishedStates(rows[:, :n], singular)
