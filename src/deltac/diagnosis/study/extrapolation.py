"""A better motion from the runs of a study: Richardson's extrapolation by the observed order.

Runs at steps h, h/2, h/4 differ by C(t) hʳ and terms of higher order. Where a study has found r, the leading
term can be taken off, and from three runs the next one as well (Richardson 1927; Hairer, Nørsett, Wanner,
*Solving Ordinary Differential Equations I*, II.9). What the last elimination changed says how good the result
is. Everything that a run records (speeds, accelerations, forces, integrals) has such an expansion. So has ΔC,
which is zero for the exact motion and therefore judges: an extrapolated motion has to close better than the
solver itself would with as many steps as all runs together.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from deltac.arrays import EPS, Array
from deltac.diagnosis.study.convergence import LEAST_ORDER, Convergence, order_text
from deltac.diagnosis.study.curves import Comparison, one_sided
from deltac.diagnosis.study.runs import BalancedRun
from deltac.dynamics.admissible import onto_positions, onto_speeds
from deltac.dynamics.equations_of_motion import equations_of_motion, quaternions
from deltac.errors import SolverError
from deltac.mechanism.mechanism import Mechanism
from deltac.results import Report, Section, number
from deltac.trajectories import Trajectory
from deltac.trajectories.trajectory import column_by_column

SPREAD = 0.3
"""Spread of an observed order by which one term may be taken off where the solver's is not known."""

ROUNDING = 16 * EPS
"""Error of an extrapolated number for rounding, as a share of the largest of its kind."""

SYMMETRIC = ("implicit-midpoint", "discrete-gradient")
"""Solvers whose error has even powers of the step only."""


@dataclass(frozen=True, eq=False)
class Extrapolation(Report, omit=("run",)):
    """The motion that the runs of a study tend to, with an estimate of its error at every sample.

    Attributes:
        run: the extrapolated motion at the common times of the runs, as far as they stay together;
            constraints are met.
        q_error, u_error: what the last elimination changed: estimates (T, nq), (T, nu) of the error. The
            largest among quantities of one unit and neighbouring samples, since each passes through zero.
        order: by which it was extrapolated; `powers`: of the step, that were eliminated.
        steps: of the runs that were used, coarsest first, s.
        finest_error: the estimate for the finest run that was used (T,), largest over coordinates.
    """

    run: Trajectory
    q_error: Array
    u_error: Array
    order: float
    powers: tuple[float, ...]
    steps: tuple[float, ...]
    finest_error: Array

    @property
    def error(self) -> Array:
        """The largest estimate over the coordinates (T,), m, rad or 1."""
        return np.asarray(self.q_error.max(axis=1, initial=0.0))

    @property
    def exit_code(self) -> int:
        """0: there is an extrapolated motion."""
        return 0

    def summary(self) -> str:
        """How good the motion is, beside the finest run."""
        return (
            f"extrapolated by order {number(self.order)} from {len(self.steps)} runs: coordinates to "
            f"{number(float(self.error.max()), digits=2)}, those of the finest run to "
            f"{number(float(self.finest_error.max()), digits=2)}"
        )

    def sections(self) -> Iterator[Section]:
        """The summary, and from which runs and up to when."""
        yield f"{self.summary()[0].upper()}{self.summary()[1:]} (rad, m)."
        used = ", ".join(f"{h:g}" for h in self.steps)
        powers = " and ".join(f"h^{p:g}" for p in self.powers)
        yield (
            f"Runs at h = {used} s; error terms taken off: {powers}; up to t = {self.run.t[-1]:.6g} s."
        )


def extrapolated(
    mechanism: Mechanism,
    solver: str,
    runs: Sequence[BalancedRun],
    compared: Comparison,
    state: Convergence,
    nominal: int | None,
    function: str,
) -> Extrapolation:
    """Extrapolate the last three of `runs`, coarsest first, that `compared` puts side by side.

    Raises InputError where the runs do not converge, are too few, or have impacts, and where ΔC of the
    testing `function` shows that nothing is gained.
    """
    if len(runs) < 3:
        raise _refused(f"there are {len(runs)} runs, and it takes three to see how they converge")
    if state.order is None or state.order < LEAST_ORDER or state.trend == "does not settle":
        raise _refused(f"the motion {'has ' if state.order is not None else ''}{state}")
    if any(entry.run.events for entry in runs):
        raise _refused("the runs have impacts or switches, across which errors have no expansion")
    last, order = runs[-3:], float(state.order)
    powers: tuple[float, ...] = (order,)
    if nominal is not None:
        order = float(nominal)
        powers = (order, order + (2.0 if solver in SYMMETRIC else 1.0))
    elif (state.order_error or 0.0) > SPREAD:
        raise _refused(f"the order of the motion is uncertain: {order_text(state)}")
    within = compared.within
    rows = [at[:within] for at in compared.rows[-3:]]
    steps = tuple(entry.step for entry in last)
    before = _weights(steps[-2:], powers[:1]) if powers[1:] else _weights(steps[:2], powers)
    before = np.pad(before, (1, 0) if powers[1:] else (0, 1))
    best = np.pad(_weights(steps[-len(powers) - 1 :], powers), (2 - len(powers), 0))
    curves = [entry.energy_error[function][at] for entry, at in zip(last, rows)]
    energy_error, finest_error = (
        float(np.abs(c).max()) for c in (best @ np.array(curves), curves[-1])
    )
    same_cost = 1.0 / sum(1.0 / h for h in steps)  # one run with the steps of all three
    plain = finest_error * float((same_cost / steps[-1]) ** order)
    if energy_error > plain and finest_error > float(last[-1].bar[function].max()):
        raise _refused(
            f"|ΔC| would be {energy_error:.1e} J, and {plain:.1e} J with {solver} at a step of "
            f"{same_cost:.2g} s, which costs the same"
        )

    def combined(values: Sequence[Array]) -> tuple[Array, Array, Array]:
        """The extrapolated value, what the last elimination changed, and the error of the finest run."""
        limit, earlier = (np.tensordot(w, np.array(values), axes=1) for w in (best, before))
        floor = ROUNDING * np.abs(values[-1]).max(axis=0, initial=0.0)
        return limit, np.abs(limit - earlier) + floor, np.abs(limit - values[-1]) + floor

    def column(values: Sequence[Array]) -> tuple[Array, Array, Array]:
        return combined([value[at] for value, at in zip(values, rows)])

    finest = last[-1].run
    reference = finest.q[rows[-1]]
    sided = [
        one_sided(mechanism, np.array(entry.run.q[at]), reference) for entry, at in zip(last, rows)
    ]
    q, q_error, finest_error_q = combined(sided)
    u, u_error, _ = column([entry.run.u for entry in last])
    q_error = _envelope(q_error, [c.unit for c in mechanism.coordinates])
    u_error = _envelope(u_error, [c.unit for c in mechanism.speeds])
    q, u = _admissible(mechanism, finest.t[rows[-1]], q, u)

    run = replace(
        column_by_column(
            [replace(entry.run, stages=None) for entry in last], lambda values: column(values)[0]
        ),
        t=finest.t[rows[-1]],
        q=q,
        u=u,
        events=finest.events,
        provenance=replace(
            finest.provenance, notes={**finest.provenance.notes, "extrapolated": f"order {order:g}"}
        ),
    )
    return Extrapolation(
        run, q_error, u_error, order, powers, steps, finest_error_q.max(axis=1, initial=0.0)
    )


def _weights(steps: Sequence[float], powers: Sequence[float]) -> Array:
    """Neville's weights w of runs at these steps: Σ w y is L of y = L + Σ C h^p, p in `powers`."""
    A = np.array([[1.0, *(h**p for p in powers)] for h in steps])
    return np.asarray(np.linalg.solve(A.T, np.eye(len(steps))[0]))


def _envelope(error: Array, units: Sequence[str]) -> Array:
    """The largest estimate (T, n) among columns of one unit and samples in a twentieth of the time."""
    rows = len(error)
    reach = max(1, rows // 40)
    envelope = np.empty_like(error)
    for unit in set(units):
        same = np.array([u == unit for u in units])
        worst = error[:, same].max(axis=1)
        padded = np.pad(worst, reach)
        around = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1).max(axis=1)
        envelope[:, same] = around[:, None]
    return envelope


def _admissible(mechanism: Mechanism, t: Array, q: Array, u: Array) -> tuple[Array, Array]:
    """Quaternions of unit length, and constraints met: both are off by the error of the extrapolation."""
    motion, free = equations_of_motion(mechanism), mechanism.free
    q, u = np.array(q), np.array(u)
    own = q[:, free.q].T
    for place in quaternions(mechanism):
        own[place] /= np.linalg.norm(own[place], axis=0)
    speeds = u[:, free.u].T
    if mechanism.constraints:
        own = onto_positions(motion, t, own)
        speeds = onto_speeds(motion, t, own, speeds)
    q[:, free.q], u[:, free.u] = own.T, speeds.T
    return q, u


def _refused(why: str) -> SolverError:
    return SolverError(f"extrapolate: {why}. Study smaller steps, or a shorter motion")
