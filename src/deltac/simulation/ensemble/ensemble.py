"""Ensembles: many runs of one mechanism, side by side in SIMD lanes and on all cores.

Members go in chunks that stay in a core's cache (`ensemble_steps`); each member's numbers depend on
itself alone, to the last bit, whatever the chunks and threads. Memory is that of the result.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from threading import Lock

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from deltac.arrays import Array
from deltac.calls.caching import LRUCache, derived
from deltac.calls.progress import Progress
from deltac.dynamics.testing_functions import MOMENTUM
from deltac.errors import ArgumentsError, InputError, ModelError
from deltac.kernels import Kernel
from deltac.kernels.parallel import check_cancelled, cores, spread
from deltac.kernels.simd import AVX512_WIDTH
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.state import State
from deltac.simulation.arguments import check_request, count, positive
from deltac.simulation.constraints.feasibility import check_members, constraint_start
from deltac.simulation.ensemble.members import (
    States,
    check_prescribed,
    member_count,
    member_parameters,
    member_solvers,
    member_states,
    member_steps,
    record_grid,
    repeated,
)
from deltac.simulation.ensemble.steps import Advance, Span
from deltac.simulation.flow import StateFlow, build_flow
from deltac.simulation.recording import RECORD, Record
from deltac.simulation.solvers import FixedStep, Solver
from deltac.simulation.step_size.time_scales import check_start
from deltac.trajectories import Provenance, Trajectory


@dataclass(frozen=True, eq=False)
class Ensemble:
    """Runs of N members at K recorded times.

    Attributes:
        t: recorded times (K,).
        q, u: coordinates (K, N, nq) and speeds (K, N, nu) of all joints.
        integrals: ∫P of each testing function (K, N), J.
        delta_c: ΔC of each testing function (K, N), J.
        kinetic, potential: K and V of all sources (K, N), J.
        corrections: work of the projections onto constraints since the start (K, N), J; zero without any. ΔC
            counts it as a force, as `Ledger.corrections` does.
        stopped: (N,) time up to which a member that blew up was finite and met its constraints (to a few
            steps), NaN for members that completed. Later values of such a member are NaN.
        steps, solvers: of each member, (N,).
        sensitivity: ∂ΔC/∂p (K, N) of each testing function by each parameter asked for, J per its unit.
    """

    t: Array
    q: Array
    u: Array
    integrals: Mapping[str, Array]
    delta_c: Mapping[str, Array]
    kinetic: Array
    potential: Array
    corrections: Array
    stopped: Array
    steps: Array
    solvers: tuple[str, ...]
    coordinates: tuple[str, ...]
    speeds: tuple[str, ...]
    provenance: Provenance
    sensitivity: Mapping[str, Mapping[str, Array]] = field(default_factory=dict)

    def __len__(self) -> int:
        return int(self.q.shape[1])

    def member(self, k: int) -> Trajectory:
        """One run as a trajectory, up to where it stopped; InputError if there is no such member."""
        if not isinstance(k, int | np.integer) or not -len(self) <= k < len(self):
            raise InputError(
                f"member {k!r}: there are {len(self)}; expected a whole number from 0 to {len(self) - 1}"
            )
        completed = math.isnan(self.stopped[k])
        message = (
            ""
            if completed
            else f"stopped after t = {self.stopped[k]:g} s: the state is not finite, or constraints can no "
            "longer be met; deltac.simulate of the member alone tells which"
        )
        rows = len(self.t) if completed else int(np.searchsorted(self.t, self.stopped[k], "right"))
        return Trajectory(
            t=self.t[:rows],
            q=self.q[:rows, k],
            u=self.u[:rows, k],
            integrals={name: values[:rows, k] for name, values in self.integrals.items()},
            coordinates=self.coordinates,
            speeds=self.speeds,
            provenance=replace(
                self.provenance,
                solver=self.solvers[k],
                step=float(self.steps[k]),
                completed=completed,
                message=message,
            ),
        )

    def __repr__(self) -> str:
        failed = int(np.isfinite(self.stopped).sum())
        return (
            f"Ensemble({len(self)} members, {len(self.t)} recorded times to {self.t[-1]:g} s"
            f"{f', {failed} stopped early' if failed else ''})"
        )


def simulate_ensemble(
    mechanism: Mechanism,
    states: States,
    duration: float,
    step: ArrayLike,
    solver: str | FixedStep | Sequence[str | FixedStep] = "ode5",
    record: Record | Sequence[str] | int = RECORD,
    *,
    vary: Mapping[str, ArrayLike] | None = None,
    sensitivity: Sequence[str] = (),
    threads: int | None = None,
    progress: Progress | None = None,
) -> Ensemble:
    """Simulate many members of a mechanism: the core of `deltac.simulate_ensemble`."""
    duration = positive(duration, "duration")
    threads = None if threads is None else count(threads, "threads")
    recording = Record.of(record)
    if recording.coordinates is not None:
        raise ArgumentsError(
            "record: an ensemble has no coordinates of its own for testing functions; simulate its members "
            "one by one, or leave the coordinates out"
        )
    if MOMENTUM in recording.testing:
        raise ArgumentsError(
            "record: an ensemble does not integrate the momentum functions; take dc.balance of its members, "
            "or leave 'momentum' out"
        )
    if mechanism.events:
        raise ModelError(
            f"mechanism {mechanism.name!r} has {len(mechanism.events)} events (stops, impacts, …), which an "
            "ensemble does not stop at; simulate its members one by one, or leave the events out"
        )
    mechanism, names, p = member_parameters(mechanism, {} if vary is None else vary, sensitivity)
    t0, Q, U = member_states(mechanism, states)
    h, solvers = member_steps(step, duration), member_solvers(solver)
    members = member_count(Q=len(Q), vary=p.shape[1], step=len(h), solver=len(solvers))
    Q, U, p, h = (repeated(a, members, axis) for a, axis in ((Q, 0), (U, 0), (p, 1), (h, 0)))
    solvers = solvers * (members // len(solvers))
    interval, records = record_grid(h, duration, recording.every)
    if not isinstance(states, State):  # one state for all keeps its prescribed joints to itself
        check_prescribed(mechanism, t0, Q, U, names, p)
    first = State(t0, Q[0], U[0])
    # By identity: hashing a solver for each of 10⁵ members takes as long as some of their steps.
    distinct = {id(one): one for one in solvers}
    kinds = [
        (distinct[one], size) for one, size in dict.fromkeys(zip(map(id, solvers), h.tolist()))
    ]
    for one, size in kinds:
        check_request(mechanism, one, None, None, size)
        check_start(mechanism, first, one, size)
    check_members(mechanism, t0, Q, U, names, p)
    rows = constraint_start(mechanism, first, solvers[0], "projection", names, p[:, 0])
    testing = tuple(recording.testing)
    flow = _FLOWS.get(
        (mechanism.digest(names), testing, tuple(names), rows),
        lambda: build_flow(mechanism, testing, vary=names, rows=rows, works=False),
    )
    along = tuple(names.index(name) for name in sensitivity)
    result = _Result.empty(mechanism, flow, records + 1, members, len(along))
    q_part, u_part, _ = flow.parts

    jobs: list[tuple[Advance, int, NDArray[np.intp]]] = []
    for one, size in kinds:
        group = np.flatnonzero((h == size) & np.array([other is one for other in solvers]))
        per_record = round(interval / size)
        advance = Advance(flow, one, per_record, along)
        chunk = advance.chunk(len(group), threads or cores())
        starts = range(0, len(group), chunk)
        jobs += [(advance, per_record, group[i : i + chunk]) for i in starts]
    telling = _Telling(progress, sum(records * each * len(own) for _, each, own in jobs))

    def work(job: tuple[Advance, int, NDArray[np.intp]]) -> None:
        advance, per_record, own = job
        # Whole vectors: the last member fills up the lanes that are left.
        padded = own[
            np.minimum(np.arange(-(-len(own) // AVX512_WIDTH) * AVX512_WIDTH), len(own) - 1)
        ]
        x = np.zeros((advance.rows, len(padded)))
        x[q_part], x[u_part] = Q[padded][:, mechanism.free.q].T, U[padded][:, mechanism.free.u].T
        values, own_step = np.ascontiguousarray(p[:, padded]), interval / per_record
        steps_done = np.zeros(len(padded))
        result.keep(0, own, t0, x, values, np.ones(len(padded), dtype=bool))
        for k in range(records):
            span = Span(t0, own_step, k * per_record, per_record)
            x, steps_done = advance(
                x, steps_done, values, span, lambda steps: telling(steps * len(own))
            )
            alive = steps_done == (k + 1) * per_record
            result.keep(k + 1, own, t0 + (k + 1) * interval, x, values, alive)
        lost = steps_done < records * per_record
        result.stopped[own] = np.where(lost, t0 + steps_done * own_step, math.nan)[: len(own)]

    spread(work, jobs, threads)
    return result.ensemble(
        mechanism, t0 + interval * np.arange(records + 1.0), h, solvers, sensitivity
    )


class _Telling:
    """Tells `progress` the fraction of the members' steps that is done, a thousand times at most.

    Work that nobody waits for ends here.
    """

    def __init__(self, progress: Progress | None, total: int) -> None:
        self._progress, self._total = progress, total
        self._done, self._reported, self._lock = 0, 0, Lock()

    def __call__(self, steps: int) -> None:
        check_cancelled()
        if self._progress is None:
            return
        with self._lock:
            self._done += steps
            if 1000 * (self._done - self._reported) >= self._total or self._done == self._total:
                self._reported = self._done
                self._progress(self._done / self._total)


_FLOWS: LRUCache[StateFlow] = LRUCache(16)
"""Traced flows, shared by ensembles that differ in values alone."""


@derived
def _observation(flow: StateFlow, along: int) -> Kernel:
    """(t, x; p) -> full q, u; ∫P and E of the testing functions, K, V, corrections; ∂ΔC by parameters."""
    n, tested, count = flow.x.shape[0], flow.tested, len(flow.testing)
    E, inputs, outputs = flow.energies[:count, :], [flow.x], {}
    moved = ca.SX(0, 1)
    for place in range(flow.p.shape[0] - along, flow.p.shape[0]):
        rate, unit = ca.SX.sym("dx", n), ca.SX.zeros(flow.p.shape[0])
        unit[place] = 1
        inputs.append(rate)
        dE = ca.jtimes(E, ca.vertcat(flow.x, flow.p), ca.vertcat(rate, unit))
        moved = ca.vertcat(moved, dE, rate[tested])
    outputs = {
        "q": ca.densify(flow.q_all),
        "u": ca.densify(flow.u_all),
        "integral": flow.x[tested],
        "E": flow.energies,
        "corrections": ca.sum1(flow.x[tested.stop :]),
        "moved": ca.densify(moved),
    }
    return Kernel({"t": flow.t, "x": ca.vertcat(*inputs)}, outputs, flow.p, name="observation")


@dataclass(frozen=True, eq=False)
class _Result:
    """The arrays of an ensemble while it is made; threads write to columns of their own."""

    flow: StateFlow
    observe: Kernel
    q: Array
    u: Array
    sums: dict[str, Array]
    stopped: Array

    @staticmethod
    def empty(mechanism: Mechanism, flow: StateFlow, K: int, N: int, along: int) -> _Result:
        nq, nu, count = len(mechanism.coordinates), len(mechanism.speeds), len(flow.testing)
        sizes = {"integral": count, "E": count + 2, "corrections": 1, "moved": 2 * count * along}
        sums = {name: np.empty((size, K, N)) for name, size in sizes.items()}
        observe = _observation(flow, along).compile()
        return _Result(flow, observe, np.empty((K, N, nq)), np.empty((K, N, nu)), sums, np.empty(N))

    def keep(
        self, k: int, own: NDArray[np.intp], t: float, x: Array, p: Array, alive: NDArray[np.bool_]
    ) -> None:
        """Write the k-th record of members `own`; those not alive become NaN."""
        values_now = self.observe.flat(np.concatenate([np.full((1, x.shape[1]), t), x]), p)
        values_now[:, ~alive] = math.nan
        values_now = values_now[:, : len(own)]
        parts = self.observe.output_slices
        self.q[k, own], self.u[k, own] = values_now[parts["q"]].T, values_now[parts["u"]].T
        for name, values in self.sums.items():
            values[:, k, own] = values_now[parts[name]]

    def ensemble(
        self,
        mechanism: Mechanism,
        t: Array,
        steps: Array,
        solvers: Sequence[Solver],
        parameters: Sequence[str],
    ) -> Ensemble:
        """The finished ensemble, with ΔC and its derivatives."""
        names, z = self.flow.testing, self.sums["integral"]
        *E, kinetic, potential = self.sums["E"]
        moved = self.sums["moved"].reshape(len(parameters), 2, len(names), *z.shape[1:])
        slopes = moved[:, 0] - moved[:, 0, :, :1] - moved[:, 1]
        shared = len(set(map(id, solvers))) == 1 and len(set(steps.tolist())) == 1
        return Ensemble(
            t=t,
            q=self.q,
            u=self.u,
            integrals=dict(zip(names, z)),
            delta_c={name: e - e[:1] - flowed for name, e, flowed in zip(names, E, z)},
            kinetic=kinetic,
            potential=potential,
            corrections=self.sums["corrections"][0],
            stopped=self.stopped,
            steps=steps,
            solvers=tuple(solver.name for solver in solvers),
            coordinates=mechanism.coordinates.names,
            speeds=mechanism.speeds.names,
            provenance=Provenance(
                simulator="deltac",
                solver=solvers[0].name if shared else None,
                step=float(steps[0]) if shared else None,
                model=mechanism.name,
                model_hash=mechanism.hash,
            ),
            sensitivity={
                name: {parameter: slopes[j, i] for j, parameter in enumerate(parameters)}
                for i, name in enumerate(names if parameters else ())
            },
        )
