"""Steps of many members at once: whole steps compiled, or stage by stage for large mechanisms.

State arrays are (n, B), a column a member. Where a member's numbers lie in a batch leaves no trace in
them: all arithmetic is in kernels, elementwise, and B is a multiple of the SIMD width.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeAlias

import casadi as ca
import numpy as np

from deltac.arrays import TINY, Array
from deltac.calls.caching import derived
from deltac.dynamics.kkt import LEAST_PIVOT
from deltac.dynamics.spatial import SX
from deltac.errors import SolverError
from deltac.kernels import Kernel
from deltac.kernels.simd import AVX512_WIDTH, INSTRUCTIONS_CACHED
from deltac.simulation.constraints.singular import CarefulStep
from deltac.simulation.flow import OFF_CONSTRAINTS, StateFlow
from deltac.simulation.solvers import Solver
from deltac.simulation.stepping.explicit import FUSED_INSTRUCTIONS, FixedMethod
from deltac.simulation.stepping.interpreted import settle_kernel
from deltac.simulation.stepping.runge_kutta import tableau_of

MOST_STEPS_PER_CALL = 8

CHUNK_BYTES = 2**20
"""The arrays of a chunk of members together: they stay in the cache of one core."""

CHUNKS = (8 * 11, 8 * 127)
"""Fewest and most members in a chunk; a call costs some microseconds, so that fewer do not pay."""


Tick: TypeAlias = Callable[[int], None]
"""Told after each kernel call how many steps it took; what it raises ends the work."""


@dataclass(frozen=True)
class Span:
    """Steps `first` to `first` + `count` of size `h` (s), from time `t0` on."""

    t0: float
    h: float
    first: int
    count: int


class Advance:
    """Takes chunks of members through spans of steps, for one flow and solver.

    With `along`, the places of parameters in `flow.p`, the state is followed by its derivatives with
    respect to them, ∂x/∂p: exact ones of the discrete motion, by forward differentiation of a step.
    """

    def __init__(
        self, flow: StateFlow, solver: Solver, count: int, along: tuple[int, ...] = ()
    ) -> None:
        """Choose and compile the way for spans of `count` steps.

        Raises InputError where derivatives are asked of a step too large to be compiled as one.
        """
        self.flow, self.solver = flow, solver
        self.rows = flow.x.shape[0] * (1 + len(along))
        size = _method(flow, solver).instructions * (1 + 2 * len(along))
        self.fused = 0
        if size <= FUSED_INSTRUCTIONS or along:
            if size > INSTRUCTIONS_CACHED:
                raise SolverError(
                    f"sensitivity: a step of {flow.system.mechanism.name!r} with its derivatives has about "
                    f"{size} instructions, too many to compile as one (at most {INSTRUCTIONS_CACHED}); take "
                    "differences between members with vary= instead, or name fewer parameters"
                )
            room = max(1, min(MOST_STEPS_PER_CALL, FUSED_INSTRUCTIONS // size))
            self.fused = max(m for m in range(1, room + 1) if count % m == 0)
            steps_kernel(flow, solver, self.fused, along).compile()
        else:
            rate_kernel(flow).compile()
        self.along = along

    def chunk(self, members: int, threads: int) -> int:
        """How many of so many members go together: what stays in the cache, and as much for every thread."""
        arrays = 2 if self.fused else self.solver.stages + 3
        most = CHUNK_BYTES // (8 * (int(self.rows) + 2) * arrays)
        most = min(max(most, CHUNKS[0]), CHUNKS[1]) // AVX512_WIDTH
        rounds = -(-members // (AVX512_WIDTH * most * threads))
        # An odd number of vectors: rows a power of two apart would share few places in the cache.
        even = -(-members // (AVX512_WIDTH * rounds * threads)) | 1
        return min(max(even, CHUNKS[0] // AVX512_WIDTH), most - 1 | 1) * AVX512_WIDTH

    def __call__(
        self, x: Array, steps_done: Array, p: Array, span: Span, tick: Tick
    ) -> tuple[Array, Array]:
        """The states (rows, B) after the span, and the number of steps (B,) that members have taken.

        A member whose state ceases to be finite is frozen at one that it had before, and takes no more
        steps. `p` (np, B) are the values of the parameters.
        """
        with np.errstate(all="ignore"):
            after, worst, count = (self._whole if self.fused else self._staged)(
                x, steps_done, p, span, tick
            )
        if self.flow.bound is not None:
            for k in np.flatnonzero(~(worst > LEAST_PIVOT) & (steps_done == span.first)):
                after[:, k], count[k] = self._carefully(x[:, k], p[:, k], span, tick)
        return after, count

    def _whole(
        self, x: Array, count: Array, p: Array, span: Span, tick: Tick
    ) -> tuple[Array, Array, Array]:
        kernel = steps_kernel(self.flow, self.solver, self.fused, self.along)
        n, B = x.shape
        current, after = np.empty((n + 3, B)), np.empty((n + 3, B))
        current[:n], current[n], current[n + 1], current[n + 2] = x, span.first, 1.0, count
        constants = np.empty((len(p) + 2, B))
        constants[:-2], constants[-2], constants[-1] = p, span.t0, span.h
        for _ in range(0, span.count, self.fused):
            kernel.flat(current, constants, out=after)
            current, after = after, current
            tick(self.fused)
        return current[:n], current[n + 1], current[n + 2]

    def _staged(
        self, x: Array, count: Array, p: Array, span: Span, tick: Tick
    ) -> tuple[Array, Array, Array]:
        flow, (n, B) = self.flow, x.shape
        rate, settle = rate_kernel(flow), settle_kernel(flow)
        assembly = None if flow.bound is None else _assembly_kernel(flow)
        inputs = np.empty((rate.n_in, B))
        inputs[1 + n :] = p
        y, worst, count = inputs[1 : 1 + n], np.ones(B), count.copy()
        tableau = tableau_of(self.solver.name)
        # x, then the rates of the stages; behind x the settling kernel has a row for its pivot.
        arrays = np.empty(((len(tableau.b) if tableau is not None else 1) + 1, n, B))
        now = arrays.reshape(-1, B)[:n]
        settled = arrays.reshape(-1, B)[: n + 1]
        now[...] = x

        def evaluate(t: float, state: Array) -> Array:
            inputs[0], y[...] = t, state
            return rate.flat(inputs, out=np.empty((n, B)))

        for k in range(span.first, span.first + span.count):
            t = span.t0 + k * span.h
            if tableau is not None:
                for i, row in enumerate(tableau.a):
                    inputs[0] = t + tableau.c[i] * span.h
                    _combine(arrays, tuple(span.h * a for a in row), y)
                    rate.flat(inputs, out=arrays[i + 1])
                _combine(arrays, tuple(span.h * b for b in tableau.b), y)
            else:
                assert self.solver.step is not None
                y[...] = self.solver.step(evaluate, t, now, span.h, flow.parts)
            if settle is not None:
                inputs[0] = span.t0 + (k + 1) * span.h
                settle.flat(inputs, out=settled)
                np.minimum(worst, settled[n], out=worst)
            else:
                now[...] = y
            # Adding up is faster than looking at every entry, and no sum hides what is not finite.
            alive = np.isfinite(np.add.reduce(now, axis=0)) & (count == k)
            if assembly is not None:
                state = np.concatenate([np.full((1, B), span.t0 + (k + 1) * span.h), now])
                alive &= assembly.flat(state, p)[0] > 0.0
            count += alive
            if not alive.all():
                np.copyto(now, x, where=~alive)
            tick(1)
        return now.copy(), worst, count

    def _carefully(self, x: Array, p: Array, span: Span, tick: Tick) -> tuple[Array, float]:
        """A member whose constraints became dependent on the way, by least squares.

        Its derivatives are not known beyond: NaN.
        """
        n = self.flow.x.shape[0]
        careful = CarefulStep(self.flow, self.solver, p)
        state = x[:n]
        for k in range(span.count):
            after = careful(span.t0 + (span.first + k) * span.h, state, span.h)
            if not np.isfinite(after).all():
                return np.concatenate([state, np.full(len(x) - n, np.nan)]), span.first + k
            state = after
            tick(0)
        return np.concatenate([state, np.full(len(x) - n, np.nan)]), span.first + span.count


@derived
def _method(flow: StateFlow, solver: Solver) -> FixedMethod:
    return FixedMethod(flow, solver)


@derived
def steps_kernel(
    flow: StateFlow, solver: Solver, fused: int, along: tuple[int, ...] = ()
) -> Kernel:
    """(x, k, worst, taken; p, t0, h) -> the same `fused` steps later, so that buffers may alternate.

    `worst` is the smallest pivot on the way, `count` counts the steps of members that stay finite
    and on their constraints; others keep the state they had.
    """
    step = _step(flow, solver, along)
    x = ca.SX.sym("x", step.size1_in(0))
    k, t0, h = ca.SX.sym("k"), ca.SX.sym("t0"), ca.SX.sym("h")
    worst, count = ca.SX.sym("worst"), ca.SX.sym("taken")
    after, smallest, sums = x, worst, ca.SX(0)
    met, assembly = ca.SX(1), _assembly(flow)
    for i in range(fused):
        after, pivot = step(after, k + i, flow.p, t0, h)
        if flow.bound is not None:
            smallest = ca.fmin(smallest, pivot)
            met = ca.logic_and(
                met, assembly(t0 + (k + i + 1) * h, after[: flow.x.shape[0]], flow.p)
            )
        sums = sums + ca.fabs(_total(after))  # remembers any state on the way that was not finite
    healthy = ca.logic_and(ca.logic_and(sums < 1.0 / TINY, count == k), met)
    return Kernel(
        {"x": x, "k": k, "worst": worst, "taken": count},
        {
            "x": ca.if_else(healthy, after, x),
            "k": k + fused,
            "worst": smallest,
            "taken": ca.if_else(healthy, count + fused, count),
        },
        ca.vertcat(flow.p, t0, h),
        name="steps",
    )


@derived
def _step(flow: StateFlow, solver: Solver, along: tuple[int, ...]) -> Any:
    """(x, k, p, t0, h) -> the state and its derivatives one step later, and the smallest pivot met."""
    single = _method(flow, solver).single_step
    if not along:
        return single
    k, t0, h = ca.SX.sym("k"), ca.SX.sym("t0"), ca.SX.sym("h")
    after, pivot = single(flow.x, k, flow.p, t0, h)
    states, moved = [flow.x], [after]
    for place in along:
        rate, unit = ca.SX.sym("dx", flow.x.shape[0]), ca.SX.zeros(flow.p.shape[0])
        unit[place] = 1
        states.append(rate)
        moved.append(ca.jtimes(after, ca.vertcat(flow.x, flow.p), ca.vertcat(rate, unit)))
    inputs = [ca.vertcat(*states), k, flow.p, t0, h]
    return ca.Function("step", inputs, [ca.densify(ca.vertcat(*moved)), pivot], {"cse": True})


@derived
def _assembly(flow: StateFlow) -> Any:
    """(t, x, p) -> whether a state is on the constraints."""
    violation = ca.mmax(ca.fabs(ca.densify(ca.vertcat(flow.departures[1], 0))))
    return ca.Function("assembly", [flow.t, flow.x, flow.p], [violation <= OFF_CONSTRAINTS])


@derived
def _assembly_kernel(flow: StateFlow) -> Kernel:
    """The same, compiled, for states on their own."""
    assembly = _assembly(flow)(flow.t, flow.x, flow.p)
    return Kernel({"t": flow.t, "x": flow.x}, {"assembly": assembly}, flow.p, name="assembly")


def _total(x: SX) -> SX:
    total = ca.SX(0)
    for entry in ca.vertsplit(x):
        total = total + entry
    return total


@derived
def rate_kernel(flow: StateFlow) -> Kernel:
    """(t, x, p) -> ẋ."""
    return flow.kernel("rate", {"xdot": flow.xdot})


@lru_cache(maxsize=64)
def _combination(weights: tuple[float, ...]) -> Kernel:
    """(x, k_1, …) -> x + Σ w_i k_i, entry by entry; the weights are folded into the code."""
    x, k = ca.SX.sym("x"), ca.SX.sym("k", len(weights))
    total = x
    for weight, rate in zip(weights, ca.vertsplit(k)):
        total = total + weight * rate
    return Kernel({"x": x, "k": k}, {"y": total}, name="stage")


def _combine(stages: Array, weights: tuple[float, ...], out: Array) -> None:
    """Write x + Σ w_i k_i to `out` (n, B), where `stages` (s + 1, n, B) holds x and the rates."""
    if not any(weights):
        out[...] = stages[0]
        return
    used = stages.reshape(len(stages), -1)[: len(weights) + 1]
    _combination(weights).flat(used, out=out.reshape(1, -1))
