"""Trajectories with events: smooth pieces between them, and what impulses add.

No quadrature and no interpolation goes across an event. The rows of a run are complemented by two at each
event, before and after; powers are integrated within each piece, and the works of the impulses are added.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deltac.arrays import SAME, Array
from deltac.dynamics.coordinates import trace_split
from deltac.dynamics.impacts import Impulses, impulse_terms
from deltac.dynamics.momentum import momentum_balances
from deltac.dynamics.system import System
from deltac.dynamics.terms import Constrained
from deltac.dynamics.testing_functions import TestingFunction
from deltac.energy.sampling.quadrature import TWICE_THINNED, Integral, hermite, integrate
from deltac.energy.sampling.samples import Powers, Samples
from deltac.mechanism.channels import ByChannel
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.trajectories import Occurrence, Provenance, Trajectory

INWARD = SAME
"""Rows at which a law switches are evaluated this fraction of an interval within their piece: there the law
is that of the piece.
"""

UNEVEN_ROWS = 0.02
"""Least interval among four rows, as a fraction of the largest."""


@dataclass(frozen=True, eq=False)
class LogRows:
    """The rows of a run, with two more at each event within.

    `own` are the places of the run's own rows, `starts` those at which a new piece begins; `inward` (T,)
    is how far (s) within their piece the rows at events lie, None without events.
    """

    t: Array
    q: Array
    u: Array
    udot: Array | None
    forces: ByChannel
    coordinates: tuple[str, ...]
    speeds: tuple[str, ...]
    provenance: Provenance
    own: NDArray[np.intp] | slice
    starts: tuple[int, ...]
    inward: Array | None
    events: tuple[Occurrence, ...]

    def __len__(self) -> int:
        return len(self.t)


def rows_of(run: Trajectory) -> LogRows:
    """The rows of a run and of its events; one at the time of the first row is over."""
    events = tuple(event for event in run.events if event.t > run.t[0])
    shared = (run.coordinates, run.speeds, run.provenance)
    if not events:
        every = slice(None)  # a view of long columns, not a copy
        return LogRows(run.t, run.q, run.u, run.udot, run.forces, *shared, every, (), None, ())
    # An event's rows come before the first row that is not earlier: such a row has the state after.
    at = np.repeat(np.searchsorted(run.t, [event.t for event in events], "left"), 2)
    starts = tuple(int(row) for row in at[1::2] + np.arange(1, len(at), 2))

    def inserted(values: Array, pairs: Sequence[Array] | Sequence[float]) -> Array:
        return np.insert(values, at, np.array(pairs), axis=0)

    def both(before: str, after: str) -> list[Array]:
        return [getattr(event, name) for event in events for name in (before, after)]

    t = np.insert(run.t, at, [time for event in events for time in (event.t, event.t)])
    forces = {}
    for name, force in run.forces.items():
        nothing = np.zeros(force.shape[1])
        pairs = [
            side.get(name, nothing)
            for event in events
            for side in (event.forces_before, event.forces_after)
        ]
        forces[name] = inserted(force, pairs)
    own = np.ones(len(t), dtype=bool)
    own[[row + k for row in starts for k in (-1, 0)]] = False
    inward = np.zeros(len(t))
    for event, row in zip(events, starts):
        if any(name.startswith("switch ") for name in event.names):
            inward[row] = INWARD * (t[min(row + 1, len(t) - 1)] - t[row])
            inward[row - 1] = INWARD * (t[row - 2] - t[row - 1])
    return LogRows(
        t,
        inserted(run.q, both("q", "q")),
        inserted(run.u, both("u_before", "u_after")),
        None if run.udot is None else inserted(run.udot, both("udot_before", "udot_after")),
        forces,
        *shared,
        np.flatnonzero(own),
        starts,
        inward,
        events,
    )


def integrate_pieces(
    samples: Samples,
    starts: Sequence[int],
    powers: Powers,
    sampled: Array,
    rates: Sequence[str],
    leading: slice,
) -> Integral:
    """`integrate` within every smooth piece, and nothing across the events between them.

    Rows of a piece that are no events are integrated as a run of their own where there are enough. What is
    left, and intervals from an event to the next row, is interpolated through four rows, with what it
    differs by from two as its bar; where rows are too few, or too unevenly spaced for that, through two,
    and the bar is what this differs by from the trapezoidal rule.
    """
    if not starts:
        return integrate(samples, powers, sampled, rates, leading)
    with np.errstate(divide="ignore", invalid="ignore"):
        parts = hermite(samples, powers, sampled, 2, rates)[:, 1:]
    width = np.diff(samples.t)
    plain = 0.5 * width * (sampled[:, 1:] + sampled[:, :-1])
    bars = np.abs(parts - plain)
    rules, orders = [], []
    for first, stop in pairwise((0, *starts, len(samples.t))):
        inner = slice(first + (first > 0), stop - (stop < len(samples.t)))
        long = inner.stop - inner.start >= TWICE_THINNED
        for rows in ((first, first + 4), (stop - 4, stop)) if long else ((first, stop),):
            if rows[1] - rows[0] >= 4 and _even(width[rows[0] : rows[1] - 1]):
                piece, places = slice(*rows), slice(rows[0], rows[1] - 1)
                better = hermite(samples.rows(piece), powers, sampled[:, piece], 4, rates)[:, 1:]
                bars[:, places] = np.abs(better - parts[:, places])
                parts[:, places] = better
        if long:
            integral = integrate(samples.rows(inner), powers, sampled[:, inner], rates, leading)
            places = slice(inner.start, inner.stop - 1)
            parts[:, places] = np.diff(integral.value.T, axis=1)
            bars[:, places] = np.diff(integral.bar.T, axis=1)
            bars[:, inner.start] += integral.bar[0]
            rules.append(integral.rule)
            orders.append(integral.order)
    nothing = np.zeros(len(width), dtype=bool)
    nothing[np.array(starts) - 1] = True
    nothing |= width == 0.0
    parts[:, nothing], bars[:, nothing] = 0.0, 0.0
    return Integral(
        _cumulated(parts),
        _cumulated(bars),
        ", ".join(dict.fromkeys(rules)) or "hermite 4",
        min(orders, default=0.0),
    )


def _even(widths: Array) -> bool:
    """Whether intervals are alike enough for a polynomial through all of their ends."""
    return bool(widths.min() > UNEVEN_ROWS * widths.max())


def _cumulated(parts: Array) -> Array:
    """Sums from the first row on, (T, m), of the parts (m, T − 1) of every interval."""
    return np.cumsum(np.hstack([np.zeros((len(parts), 1)), parts]), axis=1).T


@dataclass(frozen=True)
class Jumps:
    """What the impulses of a run's events come to, cumulated at its rows (T,): J, and kg·m/s or kg·m²/s.

    `work` by channel, `functions` what flows into E of each testing function, `momentum` by balance,
    `speeds` the generalized impulses (T, n) on the free (or own) speeds; `exchanged` sums all
    |work|.
    """

    work: ByChannel
    functions: Mapping[str, Array]
    momentum: Mapping[str, Array]
    speeds: Array
    exchanged: Array


def jumps(
    rows: LogRows,
    t: Array,
    system: System,
    constrained: Constrained | None,
    functions: Sequence[TestingFunction],
    speeds: CoordinateMap | None,
) -> Jumps:
    """Works of the impulses up to times `t`."""
    events = [event for event in rows.events if event.impulses]
    if not events:
        return Jumps({}, {}, {}, np.zeros((len(t), 0)), np.zeros(len(t)))
    impulses = Impulses.symbols(len(system.mechanism.speeds))
    own = trace_split(system, speeds, None if constrained is None else constrained.rows)
    impulsive = impulse_terms(system, impulses, own, constrained)
    balances = momentum_balances(system)
    outputs = [function.P(impulsive) for function in functions]
    outputs += [ca.dot(balance.alpha, impulses.contact) for balance in balances]
    impulse = (impulses.contact + impulses.driving + impulses.constraint)[system.free_u, :]
    if own is not None:
        impulse = ca.mtimes(ca.substitute(own.Y, own.own_q, own.own_state(system)[0]).T, impulse)
    outputs.append(impulse)
    inputs = [system.t, system.q, system.u, *impulses.columns().values()]
    f = ca.Function("jumps", inputs, [ca.vertcat(ca.SX(0, 1), *outputs)])
    free = system.mechanism.free
    changes = np.array(
        [
            np.array(
                f(
                    event.t,
                    event.q[free.q],
                    event.u_before[free.u],
                    event.u_before,
                    event.u_after,
                    *kinds,
                )
            ).ravel()
            for event in events
            for kinds in [[_sum_of(event, kind) for kind in ("impact", "prescribed", "constraint")]]
        ]
    )
    passed = np.searchsorted([event.t for event in events], t, "right")

    def cumulated(values: Array) -> Array:
        return np.concatenate([[0.0], np.cumsum(values)])[passed]

    channels = dict.fromkeys(channel for event in events for channel in event.impulses)
    works = {
        channel: np.array([event.work.get(channel, 0.0) for event in events])
        for channel in channels
    }
    return Jumps(
        {channel: cumulated(values) for channel, values in works.items()},
        {g.name: cumulated(changes[:, k]) for k, g in enumerate(functions)},
        {b.name: cumulated(changes[:, len(functions) + k]) for k, b in enumerate(balances)},
        np.array([cumulated(f) for f in changes.T[len(functions) + len(balances) :]]).T,
        cumulated(sum((np.abs(w) for w in works.values()), start=np.zeros(len(events)))),
    )


def _sum_of(event: Occurrence, kind: str) -> Array:
    """The impulses of a kind of channel together (nu,)."""
    chosen = [j for channel, j in event.impulses.items() if channel.kind == kind]
    return np.sum(chosen, axis=0) if chosen else np.zeros(len(event.u_before))
