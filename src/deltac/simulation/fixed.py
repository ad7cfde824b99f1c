"""Fixed steps: compiled, several to a call; or from Python, where a function cannot be compiled."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deltac.dynamics.spatial import SX
from deltac.kernels import Kernel
from deltac.simulation.careful import CarefulStep
from deltac.simulation.correction import energy_correction
from deltac.simulation.equations import Controller
from deltac.simulation.flow import Flow, quaternions
from deltac.simulation.projection import SMALLEST_PIVOT, pivot, projection
from deltac.simulation.solvers.solver import Parts, Solver

Array = NDArray[np.float64]
Progress = Callable[[float], None]
"""Told the fraction of a run that is done."""

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
class Motion:
    """Samples of a run: times (T,), states x (T, n), motors' values (T, m), and where it stopped."""

    t: Array
    x: Array
    inputs: Array
    message: str = ""


@dataclass(frozen=True, eq=False)
class Course:
    """Fixed steps to be taken: `steps` of length h (s) from the state x0 at t0, every `every`-th kept.

    `p` are the values of the parameters; `progress` is told the fraction done.
    """

    p: Array
    x0: Array
    t0: float
    h: float
    steps: int
    every: int = 1
    progress: Progress | None = None


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

        after = step(rate, t0 + k * h, flow.x, h, _masks(flow))
        after, worst = _settled(flow, t0 + (k + 1) * h, flow.normalised(after))
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
            bad = ~np.isfinite(rows[:, :-1]).all(axis=1)
            if bad.any():
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


def _settled(flow: Flow, t: SX, x: SX) -> tuple[SX, SX]:
    """The state back on its constraints, and the smallest pivot there (1 without constraints)."""
    if flow.projecting:
        projected, worst = projection(flow)(t, x, flow.p)
        return projected, worst
    if flow.bound is not None and flow.own is None:
        return x, pivot(flow)(t, x, flow.p)
    return x, ca.SX(1)


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


Advance: TypeAlias = Callable[[float, float, Array, Array], Array | str]
"""(t, t + h, x, motors' values) -> the state after the step, or in words why there is none."""


def march(course: Course, rate: StageRate, advance: Advance) -> Motion:
    """Take steps one by one from Python, the motors asked in between, until one cannot be taken."""
    x, held, message = course.x0.copy(), rate.hold(course.t0, course.x0), ""
    kept = [(course.t0, x.copy(), held)]
    for k in range(course.steps):
        t, following = course.t0 + k * course.h, course.t0 + (k + 1) * course.h
        after = advance(t, following, x, held)
        if isinstance(after, str):
            message = after
            if k % course.every:
                kept.append((t, x.copy(), held))
            break
        x, held = after, rate.hold(following, after)
        if (k + 1) % course.every == 0:
            kept.append((following, x.copy(), held))
        if course.progress is not None and k % 64 == 63:
            course.progress((k + 1) / course.steps)
    times, states, inputs = (np.array(column) for column in zip(*kept))
    return Motion(times, states, inputs, message)


@lru_cache(maxsize=64)
def settle_kernel(flow: Flow) -> Kernel | None:
    """What is done to a state after each step: unit quaternions, and back on the constraints.

    (t, x, p) -> x and the smallest pivot; None where there is nothing to be done.
    """
    if flow.bound is None and (flow.own is not None or not quaternions(flow.system.mechanism)):
        return None
    x, worst = _settled(flow, flow.t, flow.normalised(flow.x))
    inputs = {"t": flow.t, "x": flow.x, **({"p": flow.p} if flow.p.shape[0] else {})}
    return Kernel(inputs, {"x": x, "worst": worst}, name="projection")


class Settle:
    """`settle_kernel` for one state at a time."""

    def __init__(self, flow: Flow, p: Array) -> None:
        """Compile it; `p` are the values of the parameters."""
        self._kernel = settle_kernel(flow)
        self._in = np.concatenate([np.zeros(1 + flow.x.shape[0]), p])
        self._out = np.empty(flow.x.shape[0] + 1)

    def __call__(self, t: float, x: Array, p: Array | None = None) -> tuple[Array, float]:
        """The settled state, and the smallest pivot of its constraints; `p` if the parameters changed."""
        if self._kernel is None:
            return x, 1.0
        if p is not None:
            self._in[1 + len(x) :] = p
        self._in[0], self._in[1 : 1 + len(x)] = t, x
        self._kernel.single(self._in, self._out)
        return self._out[:-1].copy(), float(self._out[-1])


@lru_cache(maxsize=64)
def _correction_kernel(flow: Flow) -> Kernel:
    """(t, x; p, h) -> x with its energy as it should be."""
    h = ca.SX.sym("h")
    corrected = energy_correction(flow)(flow.t, flow.x, flow.p, h)
    inputs = {"t": flow.t, "x": flow.x, "constants": ca.vertcat(flow.p, h)}
    return Kernel(inputs, {"x": corrected}, name="energy correction")


class Correct:
    """`energy_correction` for one state at a time, where a run asks for it."""

    def __init__(self, flow: Flow, p: Array, h: float) -> None:
        """Compile it; `p` are the values of the parameters, `h` is the step."""
        self._kernel: Kernel | None = None
        if not flow.correcting:
            return
        self._kernel = _correction_kernel(flow)
        self._in = np.concatenate([np.zeros(1 + flow.x.shape[0]), p, [h]])
        self._out = np.empty(flow.x.shape[0])

    def __call__(self, t: float, x: Array) -> Array:
        """The state with its energy as it should be."""
        if self._kernel is None:
            return x
        self._in[0], self._in[1 : 1 + len(x)] = t, x
        return self._kernel.single(self._in, self._out).copy()


@lru_cache(maxsize=64)
def _rate_kernels(flow: Flow) -> tuple[Kernel, Kernel]:
    """ẋ, and the full state that a controller sees."""
    values = {"t": flow.t, "x": flow.x}
    extra = {"inputs": flow.inputs, "given": flow.given}
    inputs = {**values, **{name: e for name, e in extra.items() if e.shape[0]}}
    rate = Kernel(inputs, {"xdot": flow.xdot}, flow.p, name="rate")
    return rate, Kernel(values, {"q": flow.q_all, "u": flow.u_all}, flow.p, name="state")


class StageRate:
    """ẋ(t, x) with a controller, or with equations that are called from Python."""

    def __init__(self, flow: Flow, controller: Controller | None, p: Array) -> None:
        """Compile ẋ; `p` are the values of the parameters."""
        self._flow, self._controller = flow, controller
        self._rate, self._state = _rate_kernels(flow)
        self.parameters = p
        self._in, self._out = np.empty(self._rate.n_in), np.empty(self._rate.n_out)
        self.held = np.zeros(flow.inputs.shape[0])

    def hold(self, t: float, x: Array) -> Array:
        """Ask the controller at the start of a step (and at samples); returns the motors' values."""
        if self._controller is not None:
            self.held = self._asked(t, x)
        return self.held.copy()

    def __call__(self, t: float, x: Array) -> Array:
        """ẋ."""
        flow = self._flow
        values = self.held
        if self._controller is not None and not self._controller.hold:
            values = self._asked(t, x)
        given: Array = np.empty(0)
        if flow.equations is not None and not flow.traced:
            q, u, _ = flow.parts
            given = flow.equations(t, x[q].copy(), x[u].copy())
        self._in[:] = np.concatenate([[t], x, values, given])
        p = self.parameters if len(self.parameters) else None
        return self._rate.single(self._in, self._out, p).copy()

    def batch(self, t: Array, x: Array) -> Array:
        """ẋ (T, n) of many states (T, n), where nothing is called from Python."""
        p = self.parameters if len(self.parameters) else None
        return self._rate.flat(np.vstack([t, x.T]), p).T

    def _asked(self, t: float, x: Array) -> Array:
        """The controller's answer, checked, in the order of `System.inputs`."""
        from deltac.simulation.control import motor_values

        assert self._controller is not None
        state = self._state(t=t, x=x, parameters=self.parameters if len(self.parameters) else None)
        return motor_values(
            self._controller, self._flow.system, t, state["q"].ravel(), state["u"].ravel()
        )


def _masks(flow: Flow) -> Parts:
    masks = []
    for place in flow.parts:
        mask = ca.DM.zeros(flow.x.shape[0])
        mask[place] = 1
        masks.append(mask)
    return Parts(*masks)


def numeric_masks(flow: Flow) -> Parts:
    """The masks of q, u and integrals as arrays."""
    masks = _masks(flow)
    return Parts(*(np.array(mask).ravel() for mask in (masks.q, masks.u, masks.z)))


def _stopped(bad: float, last: float) -> str:
    return (
        f"stopped: the state is not finite at t = {bad:.9g} s; it was last finite at t = {last:.9g} s. "
        "A smaller step may help"
    )
