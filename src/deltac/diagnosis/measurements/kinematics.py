"""Columns of a log against the rates that the log itself has of them: q against u, u against u̇.

No dynamics is involved. Over each interval the change of a column is compared with the integral of its
rate by splines,

    x[n+1] − x[n] = r ∫x' dt + θ h (x'[n+1] − x'[n]) + defect.

h is the median interval. r is 1, unless a clock, a unit or a gear is wrong. θ is the instant that the rate
is of, in rows late or early: a scheme that takes the rate at the start or the end of its step leaves −½ or
½, rows that were stored late leave 1. What is left beyond digits, noise and the error of the splines is a
defect, row by row: copies, spikes, clipped and wrapped columns show there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import NEGLIGIBLE, ROUGHLY, SAME, Array, medians
from deltac.diagnosis.measurements.digits import Chosen, digits_of
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory
from deltac.trajectories.columns import RateNames
from deltac.trajectories.lint import LOOKED_AT, NEIGHBOURS, gap_rows
from deltac.trajectories.rates import continuous, rotation_vectors
from deltac.trajectories.splines import spline_integrals

Mask: TypeAlias = NDArray[np.bool_]

SHORTEST_PART = 12
"""Rows that a part between gaps has at least to be compared."""

SURE = 8.0
"""Standard errors by which r must differ from one."""

LEAST_RATIO = 2e-4
"""Relative differences of r from one below this are not reported: quadratures err by as much."""

OWN_QUADRATURE = 5 / 12
"""Share of h δ²x' by which a scheme's own quadrature of a rate x' may differ from that along the rows.

That of Adams and Bashforth's method of two steps, the largest in use (Hairer, Nørsett, Wanner, §III.1)."""

BEND = 1 / 6
"""Error of a trapezoid in units of h δx', at most, where x'' falls to nothing between two rows: h² δx''/12 by
the formula of Euler and Maclaurin, of an x'' that is 2 δx'/h at first."""

SWINGING = float(np.tan(1.0)) - 1.0
"""Error of a trapezoid where forces are held from row to row: tan(x)/x − 1 of what swings by 2x between rows,
up to a radian to either side."""

ON_A_CIRCLE = 1 / 3
"""The same of a straight step that is put back onto a circle: its angle θ becomes atan θ ≈ θ − θ³/3."""

MOST_REWEIGHTINGS = 12
"""Fits at most: each changes r and θ by a part of what the one before did."""

FAR_DEFECT = 30.0
"""A defect beyond this multiple of its error bar and of the others' scatter is no quadrature error."""


@dataclass(frozen=True, eq=False)
class ColumnComparison:
    """A column against its rate.

    Attributes:
        ratio, ratio_error: r and its error bar, systematic part included.
        late: θ in rows, of the median length; positive where the rate is older than the column beside it.
        defect: what is left of each interval (I,), in units of x.
        bar: error bar of each, from digits, noise and quadrature (I,).
        increments: the change of each interval (I,).
        integrals: ∫x' dt of each (I,).
        start: the row at the start of each interval (I,).
        departure: root mean square of the defects, as a share of the movement; the largest tenth left out.
        alike: correlation of the change and ∫x' dt, without sign; 0 where one is none.
        significant: whether the defects are beyond their error bars.
        outliers: intervals whose defect stands out of its bar and of the scatter of all others (I,).
        scaled: whether the rate is off by a factor, the same all along the log.
        instant: whether θ is told: the rate changes from row to row by more than its noise.
        unsteady: the movement that neither bars nor the quadrature of any scheme explain, as a share of it
            (root mean square): time stamps that scatter, rows that were interpolated, filtered speeds.
    """

    ratio: float
    ratio_error: float
    late: float
    defect: Array
    bar: Array
    increments: Array
    integrals: Array
    start: NDArray[np.intp]
    departure: float
    alike: float
    significant: bool
    outliers: Mask
    scaled: bool
    instant: bool
    unsteady: float


def compare(
    t: Array,
    moved: Array,
    rate: Array,
    bar: Array,
    edges: Sequence[tuple[int, int]],
    *,
    projected: bool = False,
) -> list[ColumnComparison | None]:
    """Compare changes (T − 1, n) over all intervals with rates (T, n), between gaps (`edges`), by columns.

    `bar` is what digits and noise of x and x' make of a change (T − 1, n). `projected` tells whether states
    may have been put back onto constraints after each step. None where nothing moves.
    """
    # A scheme, or a delay, is late by a time that is the same where rows are lost.
    typical = float(np.median(np.diff(t)))
    straight = []
    for a, b in edges:
        x = np.ascontiguousarray(rate[a:b].T)  # a row of every array is a column of the log
        change, half = np.diff(x), 0.5 * np.diff(t[a:b])
        straight.append((half * (x[:, 1:] + x[:, :-1]), typical * change, half, change))
    trapezoid, L = (np.hstack([part[k] for part in straight]) for k in (0, 1))
    start = np.concatenate([np.arange(a, b - 1) for a, b in edges])
    D, noise = (np.ascontiguousarray(x[start].T) for x in (moved, bar))
    parts = []
    for (a, b), (own, _, half, change) in zip(edges, straight):
        fine, coarse = (spline_integrals(t[a:b], rate[a:b], k).T for k in (5, 3))
        second = np.diff(change)
        ends = (second[:, :1], second, second[:, -1:])
        curved = half * (np.hstack(ends[1:]) + np.hstack(ends[:2]))
        bias = fine - coarse
        parts.append((fine, curved, np.abs(bias) + 0.02 * np.abs(fine - own), bias))
    fine, C, S, B = (np.hstack(x) for x in zip(*parts))
    extent = _sizes(D)
    active = np.flatnonzero((_sizes(fine) > 0.0) & (extent > 0.0))
    comparisons: list[ColumnComparison | None] = [None] * len(D)
    if not len(active):
        return comparisons
    if len(active) < len(D):
        fine, trapezoid, L, C, S, B, D, noise, extent = (
            x[active] for x in (fine, trapezoid, L, C, S, B, D, noise, extent)
        )
    # Rows of a scheme obey a trapezoid also where a force jumps and splines ring; sampled motion the splines.
    integrals = np.stack([fine, trapezoid])
    spread = np.hypot(noise, 1e-3 * extent[:, None] + S)
    I, r, late, residual, keep, by_splines = _robust(integrals, L, D, spread, noise)
    bars = noise + S
    count = np.maximum(keep.sum(axis=-1), 1)
    scatter = np.sqrt(np.sum(keep * residual**2, axis=-1) / count)
    # A scheme's own quadrature of x' may differ from ours by c h δ²x', |c| ≤ `OWN_QUADRATURE`. Of
    # oscillations that looks like another r, and is found from what it would leave besides.
    x, y, variance = _least_squares(I * keep, L * keep, C * keep)
    error = scatter * np.sqrt(variance)
    alone = keep * (C - x[:, None] * I - y[:, None] * L)
    size = np.sqrt(np.sum(alone**2, axis=-1) / count)
    if projected:  # that shortens the steps evenly, and leaves nothing to tell it by
        c = np.full_like(size, OWN_QUADRATURE + ON_A_CIRCLE)
    else:
        c = np.fmin(OWN_QUADRATURE, 4.0 * scatter / np.where(size > 0.0, size, np.nan))
    # Nor is r told better than one quadrature along the rows tells it like another: a trapezoid that leaves
    # less than splines is that of a scheme, or of forces that were held from row to row.
    otherwise = np.abs(np.vecdot(B, fine)) / np.vecdot(fine, fine)
    otherwise += np.abs(np.vecdot(fine - I, I)) / np.vecdot(I, I)
    # Of rates that decay evenly a delay of a row does the same.
    along = np.vecdot(I, L) / np.vecdot(I, I)
    remainder = _sizes(L - along[:, None] * I)
    alike = np.where(remainder < ROUGHLY * _sizes(L), _sizes(L) / _sizes(I), 0.0)
    most = OWN_QUADRATURE + ON_A_CIRCLE * projected
    squares = np.maximum(np.sum(keep * C**2, axis=-1), 1e-300)
    by_scheme = np.clip(np.sum(keep * C * residual, axis=-1) / squares, -most, most)
    rest, barred, defect = _sizes(residual - by_scheme[:, None] * C), _sizes(bars), _sizes(residual)
    unsteady = np.sqrt(np.maximum(rest**2 - barred**2, 0.0)) / extent
    # Where forces change at the rows, nothing tells how a rate runs between them. If it swings, trapezoids
    # of another factor fit and splines, which are smooth at the rows, do not; so it is with a scheme that
    # steps from row to row, half a row late or not at all. If the rate only bends, some of that is left.
    of_steps = np.abs(2.0 * late - np.round(2.0 * late)) < NEGLIGIBLE
    kinked = (by_splines > 2.0) & ~of_steps
    bend = np.minimum(BEND * _sizes(L) / _sizes(I), unsteady / NEGLIGIBLE)
    bent = SWINGING * kinked + bend * np.minimum(by_splines, 1.0)
    ratio_error = SURE * error + c * _sizes(C) / _sizes(I) + otherwise + alike + bent
    scaled = np.abs(r - 1.0) > np.maximum(ratio_error, LEAST_RATIO)
    instant = _sizes(L) > 4.0 * _sizes(noise)
    size = np.abs(residual)
    outliers = size > FAR_DEFECT * (bars + 1.4826 * medians(size)[:, None]) + 1e-6 * extent[:, None]
    squared = np.vecdot(D, D) * np.vecdot(I, I)
    correlation = np.abs(np.vecdot(D, I)) / np.sqrt(np.where(squared > 0.0, squared, np.inf))
    for k, column in enumerate(active):
        comparisons[column] = ColumnComparison(
            float(r[k]),
            float(ratio_error[k]),
            float(late[k]),
            residual[k],
            bars[k],
            D[k],
            I[k],
            start,
            float(defect[k] / max(extent[k], 1e-300)),
            float(correlation[k]),
            bool(defect[k] > 4.0 * max(barred[k], 1e-300)),
            outliers[k],
            bool(scaled[k])
            and _steady(I[k, keep[k]], (D[k] - late[k] * L[k])[keep[k]], float(r[k])),
            bool(instant[k]),
            float(unsteady[k]),
        )
    return comparisons


def _least_squares(a: Array, b: Array, y: Array) -> tuple[Array, Array, Array]:
    """The x and z of least |x a + z b − y|² along the last axis, and the variance of x for unit scatter.

    By Gram–Schmidt. Where b is a multiple of a, of all solutions the smallest.
    """

    def over(x: Array, by: Array) -> Array:
        return np.divide(x, by, out=np.zeros_like(by), where=by > 0.0)

    aa = np.vecdot(a, a)
    k = over(np.vecdot(a, b), aa)
    c = b - k[..., None] * a
    cc = np.vecdot(c, c)
    independent = np.sqrt(aa * cc) > SAME * (aa * (1.0 + k**2) + cc)
    first = over(np.vecdot(a, y), aa)
    z = np.where(independent, over(np.vecdot(c, y), cc), k * first / (1.0 + k**2))
    one = np.ones_like(aa)
    variance = np.where(
        independent, over(one, aa) + over(k**2, cc), over(one, aa) / (1.0 + k**2) ** 2
    )
    return first - k * z, z, variance


def _robust(
    integrals: Array, linear: Array, moved: Array, spread: Array, noise: Array
) -> tuple[Array, Array, Array, Array, Mask, Array]:
    """∫x' dt, R and θ by reweighted least squares, what they leave, and the intervals that are no outliers.

    Along the last axis, of every column at once, by that of the quadratures `integrals`, by splines and by
    trapezoids, that leaves least. Last comes what splines leave in units of what trapezoids do.
    """
    columns, weight = np.arange(len(moved)), 1.0 / spread
    r, late = np.zeros((2, *integrals.shape[:2]))
    for _ in range(MOST_REWEIGHTINGS):
        before = r, late
        r, late, _ = _least_squares(integrals * weight, linear * weight, moved * weight)
        residual = moved - r[..., None] * integrals - late[..., None] * linear
        size = np.abs(residual)
        typical = medians(size)
        best = np.argmin(typical, axis=0), columns
        if np.allclose((r[best], late[best]), [x[best] for x in before], SAME, SAME):
            break
        # Absolute values count, not squares: a few impacts must not bend the line.
        weight = 1.0 / np.sqrt(np.maximum(size, 1e-3 * spread + typical[..., None]) * spread)
    keep = size[best] <= 7.0 * typical[best][:, None] + 3.0 * noise
    by_splines = typical[0] / np.maximum(typical[1], 1e-300)
    return integrals[best], r[best], late[best], residual[best], keep, by_splines


def _steady(integrals: Array, moved: Array, ratio: float) -> bool:
    """Whether all parts of a log say the same factor: a clock and a gear do, impacts and kinks do not."""
    weights, near = [], []
    for x, y in zip(np.array_split(integrals, NEIGHBOURS), np.array_split(moved, NEIGHBOURS)):
        size = float(x @ x)
        if size > 0.0:
            weights.append(size)
            near.append(abs(float(x @ y) / size - ratio) < 0.5 * abs(ratio - 1.0))
    return bool(weights) and float(np.dot(weights, near)) > 0.8 * sum(weights)


def coordinates_against_speeds(
    mechanism: Mechanism, run: Trajectory
) -> dict[str, ColumnComparison]:
    """Coordinates against speeds, for every free speed that moves a coordinate or turns a quaternion."""
    rows, edges = _looked_at(run)
    if not edges:
        return {}
    kinematics = RateNames.of(run.coordinates, run.speeds)
    free = {int(k) for k in mechanism.free.u}
    t, q, u = run.t[rows], run.q[rows], run.u[rows]
    digits = digits_of(run)
    fine_q, fine_u = digits["q"].scatter(rows), digits["u"].scatter(rows)
    fine_u = fine_u * float(np.diff(run.t).max(initial=0.0))
    projected = bool(mechanism.constraints)
    rates: list[int] = []
    moved, bars = [], []
    for i, j in kinematics.rates:
        if j in free:
            rates.append(j)
            moved.append(np.diff(q[:, i]))
            bars.append(fine_q[1:, i] + fine_q[:-1, i] + fine_u[1:, j])
    for _, i, j in kinematics.quaternions:
        if j not in free:
            continue
        turned = rotation_vectors(continuous(q[:, i : i + 4]), "body")
        # Half a turn more per row, and the commutator of turns: of second order in the angle.
        size = np.linalg.norm(turned, axis=1)
        bar = 2.0 * fine_q[1:, i : i + 4].sum(axis=1) + size**3 / 6.0
        bar = bar + 0.1 * size * np.pad(
            np.linalg.norm(np.diff(turned, axis=0), axis=1), (0, 1), mode="edge"
        )
        for k in range(3):
            rates.append(j + k)
            moved.append(turned[:, k])
            bars.append(bar + fine_u[1:, j + k])
    if not rates:
        return {}
    M, B = (np.stack(columns, axis=1) for columns in (moved, bars))
    comparisons = compare(t, M, u[:, rates], B, edges, projected=projected)
    by_speed = {run.speeds[j]: one for j, one in zip(rates, comparisons) if one is not None}
    if not isinstance(rows, slice):  # the rows of the log, not of those that were looked at
        by_speed = {name: replace(one, start=rows[one.start]) for name, one in by_speed.items()}
    return by_speed


def stretches(run: Trajectory) -> list[tuple[int, int]]:
    """Rows (first, last + 1) of samples without gaps or events in between; a choice of them in long logs."""
    happened = np.searchsorted(run.t, [e.t for e in run.events])
    cuts = np.unique(np.concatenate([gap_rows(run.t) + 1, happened, [0, len(run)]]).astype(np.intp))
    pieces = [(int(a), int(b)) for a, b in zip(cuts[:-1], cuts[1:]) if b - a >= SHORTEST_PART]
    total = sum(b - a for a, b in pieces)
    if total <= LOOKED_AT:
        return pieces
    share, parts = LOOKED_AT / total, []
    for a, b in pieces:
        size = max(SHORTEST_PART, int(share * (b - a) / 3))
        if b - a <= 3 * size:
            parts.append((a, b))
            continue
        middle = (a + b - size) // 2
        parts += [(a, a + size), (middle, middle + size), (b - size, b)]
    return parts


def _looked_at(run: Trajectory) -> tuple[Chosen, list[tuple[int, int]]]:
    """The rows of the stretches of a long log, else all; and where these stretches are among them."""
    edges = stretches(run)
    if len(run) <= LOOKED_AT:
        return slice(None), edges
    rows = np.concatenate([np.arange(a, b) for a, b in edges] or [np.arange(0)])
    ends = np.cumsum([0, *(b - a for a, b in edges)]).tolist()
    return rows, list(zip(ends, ends[1:]))


# --- what all columns have in common ----------------------------------------------------------------------


def unsteadiness(comparisons: Mapping[str, ColumnComparison]) -> float:
    """How far rows are those of one motion at their times, as a share of the movement: `unsteady` of most.

    Scattered time stamps and interpolation are common to all columns; one bad column is not.
    """
    return float(np.median([c.unsteady for c in comparisons.values()])) if comparisons else 0.0


def trusted(run: Trajectory) -> bool:
    """Whether it is known how the rows came about: our own runs, and those of our MuJoCo recorder."""
    return run.provenance.simulator == "deltac" or bool(run.provenance.stage)


def size_of(x: Array) -> float:
    """Root mean square of numbers without the largest tenth."""
    return float(_sizes(x))


def _sizes(x: Array) -> Array:
    """The same along the last axis of (…, I)."""
    count = x.shape[-1]
    if not count:
        return np.zeros(x.shape[:-1])
    most = max(1, int(0.9 * count))
    squares = np.partition(np.asarray(x, dtype=float) ** 2, most - 1, axis=-1)
    return np.asarray(np.sqrt(np.mean(squares[..., :most], axis=-1)))
