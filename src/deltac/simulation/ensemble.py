"""Ensembles: many runs of one mechanism, side by side in SIMD lanes and on all cores.

Small mechanisms go by whole steps, compiled as one expression and several to a call; larger ones stage by
stage, with array combinations between. Members are handled in chunks that stay in the cache; each member's
numbers depend on itself alone, to the last bit, whatever the chunks and threads.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from deltac.errors import InputError, closest
from deltac.kernels import Kernel
from deltac.kernels.kept import Kept
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.state import State
from deltac.simulation.careful import CarefulStep
from deltac.simulation.feasibility import constraint_start
from deltac.simulation.fixed import FixedStepper, numeric_masks, settle_kernel
from deltac.simulation.flow import Flow, build_flow
from deltac.simulation.projection import SMALLEST_PIVOT
from deltac.simulation.solvers import Solver, find_solver
from deltac.simulation.solvers.solver import Parts
from deltac.simulation.time_scales import check_start
from deltac.trajectories import Provenance, Trajectory

Array: TypeAlias = NDArray[np.float64]
CHUNK = 512
"""Members that go together: their states and stages fit a core's cache."""

FUSED_INSTRUCTIONS = 4000
"""Whole steps are compiled up to this size, a few of them to a call; beyond it, ẋ alone is."""


@dataclass(frozen=True, eq=False)
class Ensemble:
    """Runs of N members at K recorded times.

    Attributes:
        t: recorded times (K,).
        q, u: coordinates (K, N, nq) and speeds (K, N, nu) of all joints.
        integrals: ∫P of each testing function (K, N), J.
        delta_c: ΔC of each testing function (K, N), J.
        stopped: time at which a member's state ceased to be finite, NaN for those that completed (N,);
            from then on its values are NaN.
    """

    t: Array
    q: Array
    u: Array
    integrals: Mapping[str, Array]
    delta_c: Mapping[str, Array]
    stopped: Array
    coordinates: tuple[str, ...]
    speeds: tuple[str, ...]
    provenance: Provenance

    def __len__(self) -> int:
        return int(self.q.shape[1])

    def member(self, k: int) -> Trajectory:
        """One run as a trajectory, up to where it stopped."""
        completed = math.isnan(self.stopped[k])
        rows = len(self.t) if completed else int(np.searchsorted(self.t, self.stopped[k]))
        return Trajectory(
            t=self.t[:rows],
            q=self.q[:rows, k],
            u=self.u[:rows, k],
            integrals={name: values[:rows, k] for name, values in self.integrals.items()},
            coordinates=self.coordinates,
            speeds=self.speeds,
            provenance=self.provenance,
        )

    def __repr__(self) -> str:
        failed = int(np.isfinite(self.stopped).sum())
        return (
            f"Ensemble({len(self)} members, {len(self.t)} recorded times to {self.t[-1]:g} s"
            f"{f', {failed} stopped early' if failed else ''})"
        )


def simulate_ensemble(
    mechanism: Mechanism,
    states: State | tuple[ArrayLike, ArrayLike],
    duration: float,
    step: float,
    solver: str = "ode4",
    testing: Sequence[str] = ("wang", "liu-huston"),
    *,
    vary: Mapping[str, ArrayLike] | None = None,
    record_every: int | None = None,
    threads: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> Ensemble:
    """Simulate many members of a mechanism with a fixed-step solver.

    Args:
        mechanism: what moves.
        states: one state for all members, or (Q, U) of shapes (N, nq) and (N, nu), all joints.
        duration: how long, s.
        step: of the solver, s; it must divide the duration.
        solver: a fixed-step one, see `simulate`.
        testing: names of the testing functions integrated in the loop.
        vary: values (N,) of parameters by name, other ones in each member; no compilation is repeated for
            other values.
        record_every: keep every so many steps; by default the start and the end alone.
        threads: how many cores; all by default.
        progress: called with the fraction done.

    Raises:
        InputError: as `simulate`, and for sizes that do not fit, naming the array.
    """
    found = find_solver(solver)
    if found.family != "fixed":
        raise InputError(
            f"ensembles take explicit fixed steps, {solver!r} does not; use 'ode4' or 'ode8'"
        )
    if mechanism.events:
        raise InputError(
            f"mechanism {mechanism.name!r} has {len(mechanism.events)} events (stops, impacts, …), which an "
            "ensemble does not stop at; simulate its members one by one, or leave the events out"
        )
    steps = round(duration / step)
    if steps < 1 or abs(steps * step - duration) > 1e-9 * duration:
        raise InputError(f"step {step:g} does not divide the duration {duration:g}")
    every = steps if record_every is None else record_every
    if every < 1 or steps % every:
        raise InputError(f"record_every {every} does not divide the number of steps, {steps}")
    names, p = _parameters(mechanism, vary or {})
    t0, Q, U = _states(mechanism, states, p.shape[1] if names else None)
    members = len(Q)
    if names and p.shape[1] != members:
        p = np.repeat(p, members, axis=1)
    p = p if names else np.empty((0, members))
    first = mechanism.state(Q[0], U[0], t0)
    check_start(mechanism, first, found, step)
    rows = constraint_start(mechanism, first, found, None, "projection")
    flow = _flow(mechanism, tuple(testing), tuple(names), rows)
    h = duration / steps
    x = np.empty((flow.x.shape[0], members))
    q_part, u_part, z_part = flow.parts
    x[q_part], x[u_part], x[z_part] = Q[:, mechanism.free.q].T, U[:, mechanism.free.u].T, 0.0
    kept = np.empty((steps // every + 1, *x.shape))
    kept[0] = x
    advance = _Advance(flow, found, h, t0, every)
    pieces = [slice(i, min(i + CHUNK, members)) for i in range(0, members, CHUNK)]
    done = [0]

    def work(piece: slice) -> None:
        state, parameters = x[:, piece].copy(), np.ascontiguousarray(p[:, piece])
        for k in range(steps // every):
            state = advance(state, parameters, k * every)
            kept[k + 1][:, piece] = state
        done[0] += 1
        if progress is not None:
            progress(done[0] / len(pieces))

    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        list(pool.map(work, pieces))
    times: Array = t0 + h * every * np.arange(steps // every + 1, dtype=np.float64)
    return _ensemble(mechanism, flow, found, step, times, kept, p)


_FLOWS: Kept[Flow] = Kept(16)


def _flow(
    mechanism: Mechanism, testing: tuple[str, ...], vary: tuple[str, ...], rows: tuple[int, ...]
) -> Flow:
    """The traced flow, shared by ensembles that differ in values alone."""
    return _FLOWS.get(
        (mechanism.digest(vary), testing, vary, rows),
        lambda: build_flow(mechanism, testing, vary=vary, rows=rows),
    )


class _Advance:
    """`every` steps of a chunk of members."""

    def __init__(self, flow: Flow, solver: Solver, h: float, t0: float, every: int) -> None:
        self.flow, self.solver, self.h, self.t0, self.every = flow, solver, h, t0, every
        size = int(_stepper(flow, solver)._single_step.n_instructions())
        self.fused = 0
        if size <= FUSED_INSTRUCTIONS:
            room = max(1, FUSED_INSTRUCTIONS // size)
            self.fused = max(m for m in range(1, room + 1) if every % m == 0)
            self.kernel = _steps_kernel(flow, solver, self.fused)
        else:
            self.kernel = _rate_kernel(flow)
            masks = numeric_masks(flow)
            self.parts = Parts(*(mask[:, None] for mask in (masks.q, masks.u, masks.z)))
        self.settle = settle_kernel(flow)

    def __call__(self, x: Array, p: Array, start: int) -> Array:
        """The states (nx, B) after `every` steps from step number `start` on."""
        begin = x
        with np.errstate(all="ignore"):
            x, worst = (self._whole if self.fused else self._staged)(x, p, start)
        flagged = np.flatnonzero(~(worst > SMALLEST_PIVOT)) if self.flow.bound is not None else ()
        for k in flagged:
            x[:, k] = self._carefully(begin[:, k], p[:, k], start)
        return x

    def _whole(self, x: Array, p: Array, start: int) -> tuple[Array, Array]:
        n, B = x.shape
        given = np.empty((self.kernel.n_in, B))
        given[:n], given[n + 1 : n + 1 + len(p)] = x, p
        given[-2], given[-1] = self.t0, self.h
        out = np.empty((n + 1, B))
        worst = np.ones(B)
        for k in range(start, start + self.every, self.fused):
            given[n] = k
            self.kernel.flat(given, out=out)
            given[:n] = out[:n]
            np.minimum(worst, out[n], out=worst)
        return given[:n].copy(), worst

    def _staged(self, x: Array, p: Array, start: int) -> tuple[Array, Array]:
        n, B = x.shape
        given, out = np.empty((self.kernel.n_in, B)), np.empty((n, B))
        given[1 + n :] = p
        worst = np.ones(B)

        def rate(t: float, state: Array) -> Array:
            given[0], given[1 : 1 + n] = t, state
            return self.kernel.flat(given, out=out).copy()

        step = self.solver.step
        assert step is not None
        for k in range(start, start + self.every):
            t = self.t0 + k * self.h
            x = step(rate, t, x, self.h, self.parts)
            if self.settle is not None:
                given[0], given[1 : 1 + n] = t + self.h, x
                settled = self.settle.flat(given)
                x = settled[:n]
                np.minimum(worst, settled[n], out=worst)
        return x, worst

    def _carefully(self, x: Array, p: Array, start: int) -> Array:
        """A member whose constraints became dependent on the way, by least squares."""
        careful = CarefulStep(self.flow, self.solver, numeric_masks(self.flow), p)
        for k in range(start, start + self.every):
            x = careful(self.t0 + k * self.h, x, self.h)
        return x


@lru_cache(maxsize=16)
def _stepper(flow: Flow, solver: Solver) -> FixedStepper:
    return FixedStepper(flow, solver)


@lru_cache(maxsize=16)
def _steps_kernel(flow: Flow, solver: Solver, fused: int) -> Kernel:
    """(x, k, p, t0, h) -> x after `fused` steps and the smallest pivot on the way."""
    stepper = _stepper(flow, solver)
    k, t0, h = ca.SX.sym("k"), ca.SX.sym("t0"), ca.SX.sym("h")
    x, worst = flow.x, ca.SX(1)
    for i in range(fused):
        x, pivot = stepper._single_step(x, k + i, flow.p, t0, h)
        worst = ca.fmin(worst, pivot)
    return Kernel(
        {"x": flow.x, "k": k, "p": ca.vertcat(flow.p, t0, h)},
        {"x": x, "worst": worst},
        name="steps",
    )


@lru_cache(maxsize=16)
def _rate_kernel(flow: Flow) -> Kernel:
    inputs = {"t": flow.t, "x": flow.x, **({"p": flow.p} if flow.p.shape[0] else {})}
    return Kernel(inputs, {"xdot": flow.xdot}, name="rate")


def _parameters(mechanism: Mechanism, vary: Mapping[str, ArrayLike]) -> tuple[list[str], Array]:
    """Names and values (n, N) of the parameters that differ between members."""
    names = list(vary)
    columns = []
    for name in names:
        if name not in mechanism.parameters:
            raise InputError(
                f"vary: unknown parameter {name!r}{closest(name, mechanism.parameters)}"
            )
        values = np.atleast_1d(np.asarray(vary[name], dtype=np.float64))
        if values.ndim != 1 or not np.isfinite(values).all():
            raise InputError(f"vary: values of {name!r} must be finite numbers, an array (N,)")
        columns.append(values)
    if len({len(c) for c in columns} - {1}) > 1:
        sizes = {name: len(c) for name, c in zip(names, columns)}
        raise InputError(f"vary: the parameters differ in their number of members: {sizes}")
    count = max((len(c) for c in columns), default=1)
    return names, np.array([np.broadcast_to(c, count) for c in columns]).reshape(len(names), count)


def _states(
    mechanism: Mechanism, states: State | tuple[ArrayLike, ArrayLike], members: int | None
) -> tuple[float, Array, Array]:
    """Start time, Q (N, nq), U (N, nu), checked."""
    if isinstance(states, State):
        count = members or 1
        return states.t, np.tile(states.q, (count, 1)), np.tile(states.u, (count, 1))
    Q, U = (np.atleast_2d(np.asarray(values, dtype=np.float64)) for values in states)
    for what, values, entries in (("Q", Q, mechanism.coordinates), ("U", U, mechanism.speeds)):
        if values.ndim != 2 or values.shape[1] != len(entries):
            raise InputError(
                f"{what} has shape {values.shape}, expected (N, {len(entries)}): {', '.join(entries.names)}"
            )
        bad = np.argwhere(~np.isfinite(values))
        if len(bad):
            raise InputError(
                f"{what}: member {bad[0][0]}, {entries[int(bad[0][1])].name!r} is not finite"
            )
    if len(Q) != len(U):
        raise InputError(f"Q has {len(Q)} members, U has {len(U)}")
    if members not in (None, 1, len(Q)):
        raise InputError(f"vary has {members} members, the states have {len(Q)}")
    return 0.0, Q, U


def _ensemble(
    mechanism: Mechanism,
    flow: Flow,
    solver: Solver,
    step: float,
    times: Array,
    kept: Array,
    p: Array,
) -> Ensemble:
    """The recorded states as full vectors, with ΔC."""
    inputs = {"t": flow.t, "x": flow.x, **({"p": flow.p} if flow.p.shape[0] else {})}
    outputs = {"q": ca.densify(flow.q_all), "u": ca.densify(flow.u_all), "E": flow.energies}
    observe = Kernel(inputs, outputs, name="observation")
    K, n, members = kept.shape
    seen = np.empty((K, observe.n_out, members))
    for k in range(K):
        t = np.full((1, members), times[k])
        seen[k] = observe.flat(np.concatenate([t, kept[k], p]))
    parts = observe.output_slices
    bad = ~np.isfinite(kept).all(axis=1)
    first_bad = np.where(bad.any(axis=0), bad.argmax(axis=0), K)
    stopped = np.where(first_bad < K, times[np.minimum(first_bad, K - 1)], math.nan)
    seen[np.broadcast_to((np.arange(K)[:, None] >= first_bad)[:, None, :], seen.shape)] = math.nan
    integrals: dict[str, Array] = {}
    delta_c: dict[str, Array] = {}
    z = flow.parts[2].start
    for i, name in enumerate(flow.testing):
        integrals[name] = kept[:, z + i]
        E = seen[:, parts["E"]][:, i]
        delta_c[name] = E - E[0] - integrals[name]
    return Ensemble(
        t=times,
        q=seen[:, parts["q"]].transpose(0, 2, 1),
        u=seen[:, parts["u"]].transpose(0, 2, 1),
        integrals=integrals,
        delta_c=delta_c,
        stopped=stopped,
        coordinates=mechanism.coordinates.names,
        speeds=mechanism.speeds.names,
        provenance=Provenance(
            simulator="deltac",
            solver=solver.name,
            step=step,
            model=mechanism.name,
            model_hash=mechanism.hash,
        ),
    )
