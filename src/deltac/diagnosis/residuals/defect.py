"""The defect: what the equations leave from row to row, whatever the integrator, and its error bar.

The mean accelerations D = (u[n+1] − u[n])/h are compared with the exact flow, w = D − (1/h)∫a dt, with a
interpolated along the rows. An unknown integrator, unknown substeps and forces that are not known between
rows leave a w that is a combination of differences of a over a step: with q, u, t or a force taken at the
other end (first order), and their second differences. These *scheme columns* are fitted with coefficients
within the bounds that any consistent scheme keeps, and taken off. The rest, times the mass matrix, is a
residual of the equations of motion in N and N·m. Its error bar holds what digits and noise of the log,
interpolation, forces between rows and the next order of the scheme may leave.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import EPS, Array
from deltac.diagnosis.measurements.digits import resolution
from deltac.diagnosis.residuals.rows import (
    PIECES,
    UNEVEN,
    Model,
    Rows,
    Stretch,
    StretchesOfLog,
    channel_groups,
    mass_energy,
    mass_norm,
    mass_product,
    mean_over_steps,
    multiply,
    ramped,
    rms,
    stairs,
    trimmed,
)
from deltac.diagnosis.residuals.schemes import Steps

WIDTHS = (1, 8, 32)
"""Windows over which a residual may be averaged against noise, in intervals."""

VISIBLE = 1e3 * EPS
"""Share of its size that a scheme column has in the mass metric at least: less is rounding."""

BESIDES = 0.4
"""Share of the columns of second order that the next order is thought to be, beside what was fitted."""

NEARBY = (-3, -2, -1, 1, 2, 3)
"""Rows whose force may have acted in place of a row's own, where forces are held."""

CHANCE = 4.0
"""Standard deviations by which an estimated covariance may be off."""

BLOCKS = 16
"""Parts of a log over whose scatter the standard error of a number is taken."""

TINY_SQUARE = 1e-200
"""A sum of squares below this is of something that does not happen in a log."""

CARRIED = 2.0
"""How much worse than q and u rows may keep the relation of u and u̇."""

TRIMMED = 0.05
"""Share of the intervals, those with the largest defects, that fits leave out: impacts are few rows."""


@dataclass(frozen=True, eq=False)
class Residual:
    """What the equations leave from row to row; n free speeds, W windows.

    Attributes:
        t: the middle of each window (W,).
        forces: what the equations leave in each, scheme columns taken off (W, n), N or N·m.
        allowed: error bar of each of these (W, n).
        size, bar, scale: its root mean square without the largest tenth, its error bar, the size of the
            terms (n,).
        bars: what the error bar is made of, by name (n,).
        taken: root mean square of what scheme columns took off, without the largest tenth (n,).
        hidden: energy (J) that a mistake could have done in the time of the log: the work of what is left,
            and the largest that a damper, a constant force or another inertia of a joint may have done.
        spent: energy (J) that the residual does in it, without sign.
        noisy: how much of what looks like noise on the log is that, in standard deviations.
        intervals: what it was made of, for causes to be tested by.
    """

    t: Array
    forces: Array
    allowed: Array
    size: Array
    bar: Array
    scale: Array
    taken: Array
    hidden: float
    spent: float
    bars: Mapping[str, Array]
    noisy: float
    intervals: Intervals

    @property
    def ratio(self) -> Array:
        """`size` in units of the error bar (n,)."""
        return np.asarray(self.size / np.maximum(self.bar, 1e-300))

    @property
    def relative(self) -> Array:
        """`size` as a share of the terms (n,)."""
        return np.asarray(self.size / np.maximum(self.scale, 1e-300))


def residual_of(model: Model, log: StretchesOfLog, off: float, steps: Steps | None) -> Residual:
    """What the equations leave of a log, of which the best scheme leaves `off` in some `steps`."""
    intervals, c = _fitted(Intervals.of(model, log.stretches))
    # Kinks of held forces look like noise; but noise would not let any scheme come closer than itself.
    believed = 1.0
    if steps is not None and steps.digits > 0.0:
        believed = min(1.0, 2.0 * off / steps.digits)
    found = _judged(intervals, c, log, believed)
    if found.intervals.width > 1:
        c, uncertain = _fitted_under_noise(found)
        found = _judged(intervals, c, log, believed, uncertain)
    return found


@dataclass(frozen=True)
class SchemeColumn:
    """What an integrator may leave: its name, and the largest coefficient that a consistent one has.

    `second`: it is of second order; `of_rows`: it is that of held forces which act in other rows.
    """

    name: str
    bound: float
    second: bool = False
    of_rows: bool = False


@dataclass(frozen=True, eq=False)
class Defects:
    """Defects w (I, n) of the intervals `at` of consecutive rows, and what may have made them.

    columns        scheme columns (I, n, m)
    N              inertia (I, n, n)
    a              accelerations at the starts (I, n)
    interpolation  what interpolation may leave of their means (I, n)
    bent           force (I, n) by which those that are not held may differ from straight lines between rows
    """

    rows: Stretch
    at: NDArray[np.intp]
    w: Array
    columns: Array
    N: Array
    a: Array
    interpolation: Array
    bent: Array

    def within(self, some: slice | NDArray[np.intp]) -> Defects:
        """Those of some of its intervals."""
        each = (self.w, self.columns, self.N, self.a, self.interpolation, self.bent)
        return Defects(self.rows, self.at[some], *(x[some] for x in each))

    @property
    def h(self) -> Array:
        """Lengths of the intervals (I,)."""
        return np.asarray(self.rows.h[self.at, 0])

    @cached_property
    def column_forces(self) -> Array:
        """The scheme columns as forces, N times each (I, n, m)."""
        return np.asarray(self.N @ self.columns)


@dataclass(frozen=True, eq=False)
class Intervals:
    """The intervals of a log as linear equations: what they leave, and what causes would, over windows.

    `parts` are its stretches, `table` tells what their scheme columns are, `width` is that of the windows in
    intervals; `held` whether forces are held over each step.
    """

    model: Model
    parts: Sequence[Defects]
    table: Sequence[SchemeColumn]
    held: bool
    width: int = 1

    @staticmethod
    def of(model: Model, stretches: Sequence[Stretch]) -> Intervals:
        """Those of all stretches; of held forces those in which none changes."""
        held = all(stairs(rows.F).held for rows in stretches)
        uneven = any(np.ptp(r.h) > UNEVEN * float(np.median(r.h)) for r in stretches)
        groups = channel_groups(model)
        if held:  # of one controller: whatever delays them delays all
            groups = {"forces": sorted({k for places in groups.values() for k in places})}
        made = [_defects(model, rows, groups, held, uneven) for rows in stretches]
        return Intervals(model, [part for part, _ in made], made[0][1], held)

    @cached_property
    def bounds(self) -> Array:
        """The largest coefficients of the scheme columns (m,)."""
        return np.array([column.bound for column in self.table])

    def with_columns(self, kept: NDArray[np.bool_]) -> Intervals:
        """The same with some of the scheme columns."""
        parts = [replace(p, columns=p.columns[:, :, kept]) for p in self.parts]
        return replace(self, parts=parts, table=[c for c, own in zip(self.table, kept) if own])

    def windows(self, values: Iterable[Array]) -> Array:
        """Means (W, …) of what the intervals of each part have (I, …)."""
        return np.concatenate([_window(x, p.h, self.width) for x, p in zip(values, self.parts)])

    @property
    def defects(self) -> Array:
        """What the equations leave, scheme columns and all (W, n), N or N·m."""
        return self.windows(multiply(p.N, p.w) for p in self.parts)

    @property
    def scheme(self) -> Array:
        """The scheme columns (W, n, m), each as large as a consistent scheme leaves at most."""
        return self.bounds * self.windows(p.column_forces for p in self.parts)

    @property
    def u(self) -> Array:
        """Speeds (W, n)."""
        return self.windows(p.rows.u[p.at] for p in self.parts)

    @property
    def slowest(self) -> Array:
        """The smallest |u| of each window (W, n)."""
        found, half = [], max(1, self.width // 2)
        for p in self.parts:
            ends = np.minimum(np.abs(p.rows.u[p.at]), np.abs(p.rows.u[p.at + 1]))
            least = np.minimum.reduceat(ends, np.arange(0, len(ends), half))
            if self.width > 1:
                least = np.minimum(least[:-1], least[1:])
            found.append(least[: len(_window(p.w, p.h, self.width))])
        return np.concatenate(found)

    @property
    def early(self) -> float:
        """The share of their changes by which held forces act before the row that tells them."""
        along = total = 0.0
        for p in self.parts:
            changing = np.setdiff1d(np.arange(len(p.rows.h)), p.at)
            w = _plain(self.model, p.rows, self.held)[1][changing]
            before = p.rows.taken(changing)
            after = replace(before, F=p.rows.F[changing + 1])
            x = self.model.at(after) - self.model.at(before)
            N = self.model.inertia(before.t, before.q)
            along += mass_product(x, N, w)
            total += mass_product(x, N, x)
        return along / total if total > 0.0 else 0.0

    def few(self, most: int) -> Intervals:
        """Those of stretches of so many intervals together, over the whole log."""
        count = sum(len(p.at) for p in self.parts)
        if count <= most:
            return self
        chosen = []
        for p in self.parts:
            share = max(4 * self.width, most * len(p.at) // count)
            pieces = max(1, min(PIECES, share // max(100, 4 * self.width)))
            size = min(share // pieces, len(p.at))
            starts = np.linspace(0, len(p.at) - size, pieces).astype(int)
            chosen += [p.within(slice(s, s + size)) for s in starts.tolist()]
        return replace(self, parts=chosen)

    def made_by(
        self, column: Callable[[Rows, Array, NDArray[np.intp], Array], Array]
    ) -> tuple[Array, Array]:
        """What generalized forces make of the windows (W, n, P), and half of what that changes over a step.

        `column` gives them (T, n, P) at some rows of a part: it takes the part's rows, its accelerations
        (T, n) as the motion has them, which rows, and the logged forces (rows, m) there.
        """
        found, changes = list[Array](), list[Array]()
        for p in self.parts:
            udot, rows, starts, ends = self._udot(p), p.rows, p.at, p.at + 1
            F = rows.F[starts if self.held else ends]
            first = self._added(rows, starts, column(rows, udot, starts, rows.F[starts]))
            last = self._added(rows, ends, column(rows, udot, ends, F))
            found.append(p.N @ (0.5 * (first + last)))
            changes.append(p.N @ (0.5 * (last - first)))
        return self.windows(found), self.windows(changes)

    def _udot(self, p: Defects) -> Array:
        """Accelerations (T, n): those of the model, and the defects as far as noise allows."""
        rows = p.rows
        middle = (rows.t[:-1] + 0.5 * rows.h[:, 0])[p.at]
        left, times = _window(p.w, p.h, self.width), _window(middle, p.h, self.width)
        besides = [np.interp(rows.t, times, x) for x in left.T] if len(left) else 0.0
        return np.asarray(self.model.at(rows) + np.transpose(besides))

    def _added(self, rows: Rows, k: NDArray[np.intp], force: Array) -> Array:
        """What forces (I, n, P) at some rows add to the accelerations."""
        M, G = self.model.matrices(rows.t[k], rows.q[k])
        if self.model.rows_of_G:
            return self.model.compliance(M, G) @ force
        return np.asarray(np.linalg.solve(M, force))


def _plain(model: Model, rows: Rows, held: bool) -> tuple[Array, Array, Array]:
    """Accelerations at the rows (T, n), the defects w (I, n), and the error of interpolation (I, n).

    The accelerations are those that are smooth along the rows: without forces where these are held.
    """
    a = model.at(rows)
    smooth, forced = a, np.zeros_like(a[:-1])
    if held:  # splines of jumps would ring: a = a(F = 0) + what the forces add, held over a step
        smooth = model.at(replace(rows, F=np.zeros_like(rows.F)))
        end = model.acceleration(rows.t[1:], rows.q[1:], rows.u[1:], rows.F[:-1])
        forced = 0.5 * (a[:-1] - smooth[:-1] + end - smooth[1:])
    mean = mean_over_steps(rows.t, smooth, 5)
    return smooth, rows.D - mean - forced, mean - mean_over_steps(rows.t, smooth, 3)


def _defects(
    model: Model, rows: Stretch, groups: Mapping[str, list[int]], held: bool, uneven: bool
) -> tuple[Defects, list[SchemeColumn]]:
    """The defects of a stretch, and what their scheme columns are; of forces in `groups`."""
    smooth, w, interpolation = _plain(model, rows, held)
    t0, q0, u0, F0 = rows.t[:-1], rows.q[:-1], rows.u[:-1], rows.F[:-1]
    t1, q1, u1, F1 = rows.t[1:], rows.q[1:], rows.u[1:], rows.F[1:]
    a = model.at(rows) if held else smooth
    a0, a1 = a[:-1], a[1:]
    N = model.inertia(t0, q0)
    table, columns = list[SchemeColumn](), list[Array]()

    def offer(
        name: str, bound: float, values: Array, *, second: bool = False, of_rows: bool = False
    ) -> None:
        table.append(SchemeColumn(name, bound, second, of_rows))
        columns.append(values)

    def with_forces(places: list[int], F: Array) -> Array:
        """What other forces at some places, held over each step, would add."""
        if np.array_equal(F, F0[:, places]):
            return np.zeros_like(a0)
        other = F0.copy()
        other[:, places] = F
        return np.asarray(model.acceleration(t0, q0, u0, other) - a0)

    by_q, by_u = (model.acceleration(t0, *x, F0) - a0 for x in ((q1, u0), (q0, u1)))
    offer("q", 0.75, by_q)
    offer("u", 0.75, by_u)
    if model.damped:
        change = model.damping(t0, q0, u1, F0) - model.damping(t0, q0, u0, F0)
        offer("damping", 1.0, model.response(t0, q0, change))
    if model.of_time:
        offer("t", 1.6, model.acceleration(t1, q0, u0, F0) - a0)
    bent = np.zeros_like(w)
    for name, places in groups.items():
        F = rows.F[:, places]
        for k in NEARBY if held else (1,):  # held or interpolated, of this row or one near it
            offer(f"{name} {k:+d}", 1.6, with_forces(places, _row(F, k)), of_rows=held)
        # As commanded now and then, where more happened in between.
        offer(f"{name} ramped", 1.6, with_forces(places, ramped(F)[:-1]), of_rows=held)
        if not held:
            second = np.diff(F, 2, axis=0)
            curved = with_forces(places, F[:-1] + np.vstack([second, second[-1:]]))
            bent += np.abs(multiply(N, curved))
    if uneven:  # one step of a scheme is another share of each interval
        share = float(rows.h.min()) / rows.h
        for column, values in list(zip(table, columns)):
            offer(f"{column.name} by h", 2.0 * column.bound, values * share)
    offer("mixed", 1.0, model.acceleration(t0, q1, u1, F0) - a0 - by_q - by_u, second=True)
    u = 0.5 * (u0 + u1)
    half = model.moved(q0, u, 0.5 * rows.h)
    middle = model.acceleration(0.5 * (t0 + t1), half, u, 0.5 * (F0 + F1))
    offer("middle", 1.0, middle - 0.5 * (a0 + a1), second=True)
    curve = np.diff(smooth, 2, axis=0)
    curve = 0.5 * (np.vstack([curve, curve[-1:]]) + np.vstack([curve[:1], curve]))
    offer("curve", 0.5, curve, second=True)
    at = np.flatnonzero(stairs(rows.F).known) if held else np.arange(len(w))
    every = Defects(
        rows, np.arange(len(w)), w, np.stack(columns, axis=2), N, a0, interpolation, bent
    )
    return every.within(at) if held else every, table


def _row(F: Array, k: int) -> Array:
    """The forces (T − 1, m) `k` rows after each step's own; those of the end repeat."""
    return np.asarray(F[np.clip(np.arange(len(F) - 1) + k, 0, len(F) - 1)])


def _fitted(intervals: Intervals) -> tuple[Intervals, Array]:
    """The intervals with the scheme columns that show, and their coefficients in the mass metric (m,).

    Of columns that constraints take off altogether what is left is rounding.
    """
    energy, whole = np.zeros((2, len(intervals.table)))
    for p in intervals.parts:
        energy += np.einsum("tij,tij->j", p.columns, p.column_forces)
        size = np.linalg.norm(p.N, axis=(1, 2))
        whole += np.tensordot(size, p.columns * p.columns, 1).sum(axis=0)
    intervals = intervals.with_columns(energy > VISIBLE * whole)
    blocks = [(p.w, p.columns, p.column_forces, p.N) for p in intervals.parts]
    return intervals, _trimmed_fit(blocks, intervals.bounds)[0]


def _trimmed_fit(
    blocks: Sequence[tuple[Array, Array, Array, Array]], bounds: Array, prior: float = 0.0
) -> tuple[Array, Array]:
    """Coefficients (m,) within their bounds by least squares, the largest defects left out; their covariance.

    Of each block: defects (I, n), columns X (I, n, m), N X, and the metric N. Coefficients are `prior` times
    as sure as their bounds to be zero.
    """
    from scipy.optimize import lsq_linear

    count = len(bounds)
    c, covariance = np.zeros(count), np.zeros((count, count))
    for _ in range(3 if count else 0):
        A, b = np.diag((prior / bounds) ** 2), np.zeros(count)
        for w, X, NX, N in blocks:
            energy = mass_energy(N, w - X @ c)
            last = int((1.0 - TRIMMED) * (len(energy) - 1))
            kept = energy <= np.partition(energy, last)[last]
            flat = NX[kept].reshape(-1, count)
            A += X[kept].reshape(-1, count).T @ flat
            b += w[kept].ravel() @ flat
        # of a column that is zero in all rows that are kept; its variance must stay a number
        scale = np.sqrt(np.maximum(np.diag(A), 1e-200))
        values, vectors = np.linalg.eigh(A / np.outer(scale, scale))
        roots = np.sqrt(np.maximum(values, 1e-14 * values.max()))
        right = (vectors.T @ (b / scale)) / roots
        found, most = vectors @ (right / roots), bounds * scale + 1e-300
        if np.any(np.abs(found) > most):
            found = lsq_linear(roots[:, None] * vectors.T, right, (-most, most)).x
        c = found / scale
        half = vectors / roots / scale[:, None]
        covariance = half @ half.T
    return c, covariance


def _fitted_under_noise(found: Residual) -> tuple[Array, Array]:
    """The coefficients of a log whose noise hides what an integrator leaves in a single step.

    Noise of the states is in the defects and in the columns, so that rows fit each other's noise. Means over
    windows have next to none of it. Each equation counts by its own noise, and by what is left of the
    equation that fits best; coefficients are as large as their bounds at first sight. Also what their errors
    leave of each equation (n,), N or N·m.
    """
    intervals = found.intervals
    X = intervals.windows(p.column_forces for p in intervals.parts)
    inertia = _inertia(intervals)
    unlike = float(np.min(rms(found.forces) ** 2 / np.maximum(inertia, 1e-300)))
    weight = 1.0 / np.maximum(found.bars["noise"] ** 2 + unlike * inertia, 1e-300)
    block = intervals.defects, X, X * weight[:, None], np.diag(weight)
    c, covariance = _trimmed_fit([block], intervals.bounds, prior=1.0)
    # Windows overlap by half, so that every row counts twice.
    errors = np.einsum("wnp,pq,wnq->wn", X, 2.0 * covariance, X)
    return c, np.asarray(np.sqrt(np.mean(errors, axis=0)))


def _inertia(intervals: Intervals) -> Array:
    """The mean inertia of each equation (n,)."""
    diagonals = [np.einsum("tii->ti", p.N) for p in intervals.parts]
    return np.asarray(np.mean(np.concatenate(diagonals), axis=0))


def _window(values: Array, weights: Array, width: int) -> Array:
    """Means of (I, …) over windows of so many intervals, weighted by a bump."""
    if width == 1:
        return values
    count = len(values) // max(1, width // 2) - 1
    if count < 1:
        return values[:0]

    def overlapping(x: Array) -> Array:
        seen = np.lib.stride_tricks.sliding_window_view(x, width, axis=0)
        return np.asarray(seen[:: width // 2][:count])

    weight = np.sin(np.pi * (np.arange(width) + 0.5) / width) ** 2 * overlapping(weights)
    weight /= weight.sum(axis=1, keepdims=True)
    flat = overlapping(values.reshape(len(values), -1)) @ weight[:, :, None]
    return np.asarray(flat.reshape(count, *values.shape[1:]))


def _judged(
    intervals: Intervals,
    c: Array,
    log: StretchesOfLog,
    believed: float,
    uncertain: Array | None = None,
) -> Residual:
    """What the coefficients `c` leave, over windows as wide as noise asks for.

    Seeming noise is `believed` in part; `uncertain` (n,) is what errors of the coefficients leave.
    """
    model, parts = intervals.model, intervals.parts
    rest = [p.w - p.columns @ c for p in parts]
    raw = [multiply(p.N, w) for p, w in zip(parts, rest)]
    left = np.concatenate(raw)
    taken = trimmed(np.concatenate([p.column_forces @ c for p in parts]))
    each = _systematic(intervals, c, log.unsteady)
    bars = {name: rms(np.concatenate(x)) for name, x in each.items()}
    systematic_bar = np.sqrt(np.sum(np.square([*bars.values()]), axis=0))
    rng, noise = np.random.default_rng(5), []
    real = _share_of_noise(intervals, rest)
    for p in parts:
        # Rounding is no noise: it hardly changes for a while.
        fine = np.minimum(resolution(p.rows.u), p.rows.scatter.u)
        scatter = replace(p.rows.scatter, u=fine + real * (p.rows.scatter.u - fine))
        shaken = p.rows.shaken(scatter, rng)
        moved = _plain(model, shaken, intervals.held)[1][p.at] - p.w
        noise.append(believed * multiply(p.N, moved))
    for width in WIDTHS:
        if width > 1 and max(map(len, raw)) < 4 * width:
            break
        intervals = replace(intervals, width=width)
        noise_bar = rms(intervals.windows(noise))
        if np.all(noise_bar <= systematic_bar):
            break
    if uncertain is not None:
        bars["coefficients"] = uncertain
    residual = intervals.windows(raw)
    size = [
        model.terms(r.t[p.at], r.q[p.at], r.u[p.at], r.F[p.at]) + np.abs(multiply(p.N, p.a))
        for p in parts
        for r in (p.rows,)
    ]
    inertia = np.sqrt(np.maximum(_inertia(intervals), 1e-300))
    scale = rms(np.concatenate(size))
    scale = np.maximum(scale, 1e-3 * inertia * float((scale / inertia).max()))
    speeds = np.concatenate([np.abs(p.rows.u[:-1]) / p.rows.h for p in parts])
    rounding = 1e-13 * scale + 20.0 * EPS * rms(speeds) * inertia**2
    bars |= {"noise": noise_bar, "rounding": rounding}
    time = float(log.run.t[-1] - log.run.t[0])
    # What is left may be a mistake altogether, and noise may hide another; the next order is no mistake.
    power = np.sum(np.concatenate([p.rows.u[p.at] for p in parts]) * left, axis=1)
    lengths = np.concatenate([p.h for p in parts])
    work = float(np.abs(np.cumsum(power * lengths / float(lengths.sum()))).max()) * time
    return Residual(
        t=intervals.windows((p.rows.t[:-1] + 0.5 * p.rows.h[:, 0])[p.at] for p in parts),
        forces=residual,
        allowed=intervals.windows(np.sum(x, axis=0) for x in zip(*each.values())),
        size=trimmed(residual),
        bar=np.sqrt(np.sum(np.square([*bars.values()]), axis=0)),
        scale=scale,
        taken=taken,
        hidden=work + _mistakes(intervals, residual, time),
        spent=abs(float(np.mean(power))) * time,
        bars=bars,
        noisy=believed * min(1.0, np.sqrt(3.0) * real),
        intervals=intervals,
    )


def _systematic(intervals: Intervals, c: Array, unsteady: float) -> dict[str, list[Array]]:
    """What else than mistakes and noise may be left of each part's intervals (I, n), by its reason."""
    parts = intervals.parts
    second = np.array([column.second for column in intervals.table], dtype=bool)
    of_rows = np.array([column.of_rows for column in intervals.table], dtype=bool)
    # Next order: what second differences leave, times the relative change over a step, by all causes.
    squares = [np.sum(p.columns * p.column_forces, axis=1)[:, ~second] for p in parts]
    change = np.concatenate([np.sqrt(np.maximum(x, 0.0)).sum(axis=1) for x in squares])
    typical = np.concatenate([mass_norm(p.N, p.a) for p in parts])
    rate = float(np.clip(np.median(change) / max(float(np.median(typical)), 1e-300), 0.0, 1.0))
    growth = rate * (1.0 + 2.0 * float(np.abs(c[~second]).max(initial=0.0)))
    # As much of them as was fitted is believed to be there, and some besides; of held forces as much as was
    # fitted of each way in which they may be of other rows.
    next_order = growth * np.where(second, np.abs(c) + BESIDES, 0.0)
    between = np.where(of_rows, np.abs(c), 0.0)
    return {
        "next order": [np.abs(p.column_forces) @ next_order for p in parts],
        "interpolation": [np.abs(multiply(p.N, p.interpolation)) for p in parts],
        "forces between rows": [0.5 * (p.bent + np.abs(p.column_forces) @ between) for p in parts],
        "times of rows": [
            CARRIED * unsteady * np.abs(multiply(p.N, p.rows.D[p.at])) for p in parts
        ],
    }


def _mistakes(intervals: Intervals, residual: Array, time: float) -> float:
    """The largest work (J) that a simple mistake may have done in a time without being seen.

    A damper of one joint or of all alike, a constant force or another inertia of one joint is fitted to the
    residual (W, n) together with the scheme columns, each of which may be as large as its bound; three
    standard errors are added. Those are the larger of two: of white noise, and of the scatter of the scores
    over blocks of the log.
    """
    parts = intervals.parts
    energy = np.sum((residual / np.maximum(rms(residual), 1e-100)) ** 2, axis=1)
    kept = energy <= np.quantile(energy, 1.0 - TRIMMED)  # what acts all along shows in the others
    residual = residual[kept]
    weight = 1.0 / np.maximum(rms(residual), 1e-100)  # whose square is a number
    windows, n = residual.shape
    X = (intervals.scheme[kept] * weight[:, None]).reshape(windows * n, -1)
    U, size, _ = np.linalg.svd(X, full_matrices=False)
    taken = size**2 / (1.0 + size**2)
    U, y = U.reshape(windows, n, -1), residual * weight
    starts = np.unique(np.linspace(0, windows, BLOCKS + 1).astype(np.intp))[:-1]

    def by_block(x: Array) -> Array:
        return np.asarray(np.add.reduceat(x, starts))

    def and_of_all(x: Array) -> Array:
        """What is of each joint (.., n, ..), and of dampers of all of them alike, as of a wrong default."""
        every = [x.sum(axis=1, keepdims=True)] if kind is speeds else []
        return np.concatenate([x, *every], axis=1)

    of_columns = by_block(np.einsum("wnp,wn->wp", U, y))
    speeds = [p.rows.u[p.at] for p in parts]
    u, h = np.concatenate(speeds), np.concatenate([p.h for p in parts])
    share = h[:, None] * (time / float(h.sum()))
    most = 0.0
    for kind in (
        speeds,
        [np.ones_like(p.w) for p in parts],
        [multiply(p.N, p.a) for p in parts],
    ):
        m = intervals.windows(kind)[kept] * weight
        with_columns, products, squares = (
            and_of_all(by_block(x)) for x in (U * m[..., None], m * y, m * m)
        )
        a = with_columns.sum(axis=0)
        total = squares.sum(axis=0)
        exists = total > TINY_SQUARE  # else nothing moves there, and theta may be anything
        seen = np.maximum(total - np.sum(taken * a * a, axis=1), EPS * total)
        seen = np.where(exists, seen, 1.0)
        theta = (products.sum(axis=0) - (taken * a) @ of_columns.sum(axis=0)) / seen
        scores = products - of_columns @ (taken * a).T
        scores -= theta * (squares - np.sum(with_columns * (taken * a), axis=2))
        error = np.sqrt(np.maximum(1.0 / seen, np.sum((scores / seen) ** 2, axis=0)))
        works = and_of_all(np.cumsum(np.concatenate(kind) * u * share, axis=0))
        done = np.abs(works).max(axis=0)
        sure = np.where(np.arange(len(theta)) < n, 3.0, 1.0)  # noise of each joint counts already
        most = max(most, float(np.max((np.abs(theta) + sure * error) * done * exists)))
    return most


def _share_of_noise(intervals: Intervals, rest: Sequence[Array]) -> float:
    """How much of what looks like noise of the speeds is that, in standard deviations.

    Noise of u leaves mean accelerations that follow each other with opposite signs: −2 Σ wᵀN w′ over
    neighbours is its energy. What forces leave that change from step to step has no such relation.
    """
    rng = np.random.default_rng(7)
    total = between = apparent = 0.0
    count = pairs = steps = 0
    for p, w in zip(intervals.parts, rest):
        rows, scatter = p.rows, p.rows.scatter
        of_u = replace(scatter, q=np.zeros_like(scatter.q), F=np.zeros_like(scatter.F))
        shaken = _plain(intervals.model, rows.shaken(of_u, rng), intervals.held)[1][p.at] - p.w
        apparent += mass_product(shaken, p.N, shaken)
        total += mass_product(w, p.N, w)
        k = np.flatnonzero(np.diff(p.at) == 1)
        between += mass_product(w[k], p.N[k], w[k + 1])
        count += w.size
        pairs += len(k)
        steps += len(w)
    if not apparent > 0.0 or pairs < CHANCE**2:
        return 1.0
    between *= steps / pairs
    known = max(-2.0 * between, 0.0) + CHANCE * total / np.sqrt(max(count, 1))
    return float(np.clip(np.sqrt(known / apparent), 0.0, 1.0))
