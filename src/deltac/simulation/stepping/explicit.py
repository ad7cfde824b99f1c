"""Explicit fixed steps: compiled, many to a call; or stage by stage, where one is taken by itself."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from deltac.arrays import Array
from deltac.dynamics.spatial import SX
from deltac.kernels import Kernel
from deltac.simulation.constraints.energy import energy_correction
from deltac.simulation.constraints.projection import SMALLEST_PIVOT
from deltac.simulation.flow import Flow
from deltac.simulation.solvers import Solver
from deltac.simulation.stepping.interpreted import (
    StageRate,
    numeric_masks,
    settled,
    symbolic_masks,
)
from deltac.simulation.stepping.protocol import Block, Step, StepGrid

MOST_STEPS_PER_CALL = 8
INSTRUCTIONS_PER_CALL = 12_500
LONG_RUN = 50_000
"""Compile time grows with the code, some 0.3 s for 10 000 instructions, and a call saves two microseconds:
only runs of so many steps pay for steps unrolled into one call.
"""

MOST_INSTRUCTIONS = 12_000
"""A step larger than this is not compiled as one: ẋ is, and the step goes stage by stage."""

ROWS_PER_BLOCK = 8192


@dataclass(frozen=True)
class FixedMethod:
    """An explicit solver on a flow, in symbols and compiled: kept between runs, and without numbers.

    As many steps are fused into one call as have `room` instructions together, one at least.
    """

    flow: Flow
    solver: Solver
    room: int = 0

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

        after = step(rate, t0 + k * h, flow.x, h, symbolic_masks(flow))
        after, worst = settled(flow, t0 + (k + 1) * h, flow.normalised(after))
        if flow.correcting:
            after = energy_correction(flow)(t0 + (k + 1) * h, after, flow.p, h)
        if tied:  # a stage on a singular configuration spoils the step, wherever it ends
            for met in pivots:
                worst = ca.fmin(worst, met)
        return ca.Function("step", [flow.x, k, flow.p, t0, h], [after, worst])

    @property
    def fusible(self) -> bool:
        """Whether a whole step is small enough to be compiled as one."""
        return bool(self.single_step.n_instructions() <= MOST_INSTRUCTIONS)

    @cached_property
    def steps_per_call(self) -> int:
        """How many steps are fused into one call."""
        fitting = self.room // max(1, int(self.single_step.n_instructions()))
        return max(1, min(MOST_STEPS_PER_CALL, fitting))

    @cached_property
    def kernel(self) -> Kernel:
        """The fused step: (x, k; p, t0, h) -> `steps_per_call` rows, each (x, k, smallest pivot).

        Parameters go in as inputs: heyoka's calls with parameters cost a microsecond more.
        """
        flow = self.flow
        k, t0, h = ca.SX.sym("k"), ca.SX.sym("t0"), ca.SX.sym("h")
        rows, x = [], flow.x
        for i in range(self.steps_per_call):
            x, worst = self.single_step(x, k + i, flow.p, t0, h)
            rows.append(ca.vertcat(x, k + (i + 1), worst))
        return Kernel(
            {"row": ca.vertcat(flow.x, k), "constants": ca.vertcat(flow.p, t0, h)},
            {"rows": ca.vertcat(*rows)},
            name=f"{self.solver.name} step",
        )


class FixedSteps:
    """The steps of an explicit method: compiled ones ahead, single ones of any length stage by stage."""

    on_grid = True

    def __init__(self, method: FixedMethod, rate: StageRate, p: Array, *, compiled: bool) -> None:
        """Of a run with parameters p; `compiled` unless users' functions are called in between."""
        self._method, self._rate, self._p = method, rate, p
        self._parts = numeric_masks(method.flow)
        self._watches = method.flow.bound is not None and method.flow.equations is None
        self._fused = method if compiled and method.fusible else None
        self._buffers: tuple[Array, Array, Array] | None = None

    def attempt(self, t: float, x: Array, until: float) -> Step:
        """To `until`, stage by stage."""
        step, rate, parts = self._method.solver.step, self._rate, self._parts
        assert step is not None

        def exact(time: float) -> Array:
            with np.errstate(all="ignore"):
                found: Array = step(rate, t, x, time - t, parts)
            return found

        return Step(t, x, until, exact(until), exact)

    def accept(self, t: float, x: Array) -> None:
        """Steps have no memory."""

    def restart(self, t: float, x: Array, p: Array) -> None:
        """Other parameters from here on."""
        self._p, self._buffers = p, None

    def ahead(self, grid: StepGrid, k: int, x: Array, most: int) -> Block | None:
        """Compiled steps, up to where the constraints become dependent."""
        if self._fused is None:
            return None
        method, width = self._fused, len(x) + 2
        fused = method.steps_per_call
        if self._buffers is None:
            constants = [*self._p, grid.start, grid.step]
            calls = max(1, ROWS_PER_BLOCK // fused)
            self._buffers = (
                np.concatenate([x, [0.0], constants]),
                np.empty(fused * width),
                np.empty((calls, fused * width)),
            )
        given, out, block = self._buffers
        row = given[: width - 1]
        row[:-1], row[-1] = x, k
        count = min(most, grid.count - k)
        calls, singular = min(len(block), math.ceil(count / fused)), False
        single, pivots, watches = (
            method.kernel.compile(single=True).single,
            out[width - 1 :: width],
            self._watches,
        )
        for i in range(calls):
            single(given, out)
            block[i] = out
            if watches and not pivots.min() > SMALLEST_PIVOT:
                count = min(count, i * fused + int(np.argmax(~(pivots > SMALLEST_PIVOT))))
                calls, singular = i + 1, count < min(most, grid.count - k)
                break
            row[:] = out[-width:-1]
        rows = block[:calls].reshape(-1, width)[:count]
        return Block(rows[:, :-2], singular)
