"""Fixed steps: compiled, several to a call; or from Python, where a function cannot be compiled."""

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
from deltac.simulation.careful import CarefulStep
from deltac.simulation.correction import energy_correction
from deltac.simulation.course import Course, Motion
from deltac.simulation.equations import Controller
from deltac.simulation.flow import Flow
from deltac.simulation.projection import SMALLEST_PIVOT
from deltac.simulation.solvers.solver import Solver
from deltac.simulation.stages import (
    Correct,
    Settle,
    StageRate,
    march,
    numeric_masks,
    settled,
    symbolic_masks,
)

MOST_STEPS_PER_CALL = 8
INSTRUCTIONS_PER_CALL = 4000
INSTRUCTIONS_PER_CALL_OF_LONG_RUNS = 12_500
LONG_RUN = 50_000
"""Compile time grows with the code, about a second for 10 000 instructions: beyond these, fewer steps
are unrolled into one call. Runs of many steps pay for more.
"""

MOST_INSTRUCTIONS = 12_000
"""A step larger than this is not compiled as one: ẋ is, and the step goes stage by stage."""

ROWS_PER_BLOCK = 8192


@dataclass(frozen=True)
class FixedStepper:
    """The compiled step of a solver for a flow: x and a step counter in, the next m of them out.

    `long` tells that the run has so many steps that unrolling more of them pays.
    """

    flow: Flow
    solver: Solver
    long: bool = False

    @cached_property
    def _single_step(self) -> Any:
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

    @cached_property
    def one_step(self) -> Kernel:
        """A single step of any length: (x; p, t, h) -> x and the smallest pivot."""
        flow, t, h = self.flow, ca.SX.sym("t"), ca.SX.sym("h")
        x, worst = self._single_step(flow.x, ca.SX(0), flow.p, t, h)
        return Kernel(
            {"x": flow.x, "constants": ca.vertcat(flow.p, t, h)},
            {"x": x, "worst": worst},
            name=f"{self.solver.name} single step",
        )

    @property
    def fusible(self) -> bool:
        """Whether a whole step is small enough to be compiled as one."""
        return bool(self._single_step.n_instructions() <= MOST_INSTRUCTIONS)

    @cached_property
    def steps_per_call(self) -> int:
        """How many steps are fused into one call."""
        most = INSTRUCTIONS_PER_CALL_OF_LONG_RUNS if self.long else INSTRUCTIONS_PER_CALL
        room = most // max(1, int(self._single_step.n_instructions()))
        return max(1, min(MOST_STEPS_PER_CALL, room))

    @cached_property
    def kernel(self) -> Kernel:
        """The fused step: (x, k; p, t0, h) -> `steps_per_call` rows, each (x, k, smallest pivot).

        Parameters go in as inputs: heyoka's calls with parameters cost a microsecond more.
        """
        flow = self.flow
        k, t0, h = ca.SX.sym("k"), ca.SX.sym("t0"), ca.SX.sym("h")
        rows, x = [], flow.x
        for i in range(self.steps_per_call):
            x, worst = self._single_step(x, k + i, flow.p, t0, h)
            rows.append(ca.vertcat(x, k + (i + 1), worst))
        return Kernel(
            {"row": ca.vertcat(flow.x, k), "constants": ca.vertcat(flow.p, t0, h)},
            {"rows": ca.vertcat(*rows)},
            name=f"{self.solver.name} step",
        )

    def run(self, course: Course) -> Motion:
        """Take the steps of a course; stop at the first state that is not finite."""
        p, x0, t0, h = course.p, course.x0, course.t0, course.h
        steps, every = course.steps, course.every
        width, fused = len(x0) + 2, self.steps_per_call
        single, kernel_out = self.kernel.compile().single, np.empty(fused * width)
        kernel_in = np.concatenate([x0, [0.0], p, [t0, h]])
        row = kernel_in[: width - 1]
        careful = self._careful(p)
        calls_per_block = max(1, ROWS_PER_BLOCK // fused)
        block = np.empty((calls_per_block, fused * width))
        last = np.append(row, 1.0)[None, :]
        kept, done, message = [last], 0, ""
        while done < steps:
            calls = min(calls_per_block, math.ceil((steps - done) / fused))
            for i in range(calls):
                single(kernel_in, kernel_out)
                if (
                    careful is not None
                    and not kernel_out[width - 1 :: width].min() > SMALLEST_PIVOT
                ):
                    _retake(careful, row, kernel_out.reshape(fused, width), t0, h)
                block[i] = kernel_out
                row[:] = kernel_out[-width:-1]
            rows = block[:calls].reshape(-1, width)[: steps - done]
            # Adding up is faster than looking at every entry, and no sum hides what is not finite.
            if (
                not np.isfinite(rows.sum())
                and (bad := ~np.isfinite(rows[:, :-1]).all(axis=1)).any()
            ):
                rows = rows[: int(np.argmax(bad))]
                message = _stopped(t0 + (done + len(rows) + 1) * h, t0 + (done + len(rows)) * h)
            numbers = done + 1 + np.arange(len(rows))
            kept.append(rows[numbers % every == 0].copy())
            last = rows[-1:].copy() if len(rows) else last
            done += len(rows)
            if message and done % every:
                kept.append(last)  # the last state it had, though between samples
            if course.progress is not None:
                course.progress(done / steps)
            if message:
                break
        table = np.concatenate(kept)
        return Motion(t0 + table[:, -2] * h, table[:, :-2], np.empty((len(table), 0)), message)

    def _careful(self, p: Array) -> CarefulStep | None:
        """The way over singular configurations, where there are constraints to be singular."""
        if self.flow.bound is None or self.flow.equations is not None:
            return None
        return CarefulStep(self.flow, self.solver, numeric_masks(self.flow), p)


def _retake(careful: CarefulStep, row: Array, rows: Array, t0: float, h: float) -> None:
    """Take the steps of a call again, from `row` on, and write them into `rows`."""
    x, k = row[:-1].copy(), row[-1]
    for i in range(len(rows)):
        x = careful(t0 + (k + i) * h, x, h)
        rows[i] = np.concatenate([x, [k + i + 1, 1.0]])


def run_in_python(
    flow: Flow, solver: Solver, controller: Controller | None, course: Course
) -> Motion:
    """Fixed steps with ẋ evaluated stage by stage, calling the user's functions in between."""
    step, p, h = solver.step, course.p, course.h
    assert step is not None
    rate, settle, correct = StageRate(flow, controller, p), Settle(flow, p), Correct(flow, p, h)
    parts = numeric_masks(flow)
    careful = None
    if flow.bound is not None and controller is None and flow.equations is None:
        careful = CarefulStep(flow, solver, parts, p)
    before = 1.0

    def advance(t: float, following: float, x: Array, held: Array) -> Array | str:
        nonlocal before
        with np.errstate(all="ignore"):
            x_next, worst = settle(following, step(rate, t, x, h, parts))
            x_next = correct(following, x_next)
        if careful is not None and not min(worst, before) > SMALLEST_PIVOT:
            x_next = careful(t, x, h)
        before = worst
        return x_next if np.isfinite(x_next).all() else _stopped(following, t)

    return march(course, rate, advance)


def _stopped(bad: float, last: float) -> str:
    return (
        f"stopped: the state is not finite at t = {bad:.9g} s; it was last finite at t = {last:.9g} s. "
        "A smaller step may help"
    )
