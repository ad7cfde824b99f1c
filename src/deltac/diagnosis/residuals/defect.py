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
    sum_of,
    trimmed,
)
from deltac.diagnosis.residuals.schemes import Steps
from deltac.trajectories import Trajectory

WIDTHS = (1, 8, 32)
"""Windows over which a residual may be averaged against noise, in intervals."""

SECOND = ("mixed", "middle", "curve")
"""Scheme columns of second order."""

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
        fitted: coefficients of the scheme columns.
        taken: root mean square of what they took off, without the largest tenth (n,).
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
    fitted: Mapping[str, float]
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
    groups = channel_groups(model)
    held = all(stairs(rows.F).held for rows, _ in log.stretches)
    parts = [_defects(model, rows, groups, held) for rows, _ in log.stretches]
    c = _fit(parts, parts[0].names)
    return _judged(model, log.run, log.stretches, parts, c, off, steps, groups, log.unsteady, held)


@dataclass(frozen=True, eq=False)
class _Defects:
    """Defects w (I, n) of some intervals `at` of a stretch, scheme columns by name, inertia N (I, n, n).

    `interpolation` and `forces`, the ways in which these may change between rows, are what may be added to
    the accelerations `a` (I, n).
    """

    w: Array
    columns: Mapping[str, Array]
    N: Array
    a: Array
    interpolation: Array
    forces: Mapping[str, Array]
    bounds: Mapping[str, float]
    at: NDArray[np.intp]

    @property
    def names(self) -> list[str]:
        return list(self.columns)

    def within(self, some: slice) -> _Defects:
        """Those of some of its intervals."""
        columns = {n: x[some] for n, x in self.columns.items()}
        forces = {n: x[some] for n, x in self.forces.items()}
        return _Defects(
            self.w[some], columns, self.N[some], self.a[some], self.interpolation[some], forces,
            self.bounds, self.at[some],
        )  # fmt: skip

    @cached_property
    def column_forces(self) -> Mapping[str, Array]:
        """The scheme columns as forces, N times each (I, n)."""
        made = self.N @ np.stack([*self.columns.values()], axis=2)
        return {name: made[:, :, k] for k, name in enumerate(self.columns)}


@dataclass(frozen=True, eq=False)
class Intervals:
    """The intervals of a log as linear equations: what they leave, and what causes would, over windows.

    `parts` are stretches of rows with their defects, `names` those of the scheme columns, `width` that of the
    windows in intervals, `held` whether forces are held over each step.
    """

    model: Model
    parts: Sequence[tuple[Rows, _Defects]]
    names: tuple[str, ...]
    width: int
    held: bool

    def windows(self, values: Iterable[Array]) -> Array:
        """Means (W, …) of what the intervals of each part have (I, …)."""
        weights = (rows.h[p.at, 0] for rows, p in self.parts)
        made = [_window(x, h, self.width) for x, h in zip(values, weights)]
        return np.concatenate(made)

    @property
    def defects(self) -> Array:
        """What the equations leave, scheme columns and all (W, n), N or N·m."""
        return self.windows(multiply(p.N, p.w) for _, p in self.parts)

    @property
    def scheme(self) -> Array:
        """The scheme columns (W, n, m), each as large as a consistent scheme leaves at most."""
        made = [self._bounded(n) for n in self.names]
        return np.stack(made, axis=2) if made else np.zeros((*self.defects.shape, 0))

    def _bounded(self, name: str) -> Array:
        bound = max(p.bounds.get(name, 0.0) for _, p in self.parts)
        return bound * self.windows(p.column_forces.get(name, 0.0 * p.w) for _, p in self.parts)

    @property
    def u(self) -> Array:
        """Speeds (W, n)."""
        return self.windows(rows.u[p.at] for rows, p in self.parts)

    @property
    def slowest(self) -> Array:
        """The smallest |u| of each window (W, n)."""
        speeds = [np.minimum(np.abs(r.u[p.at]), np.abs(r.u[p.at + 1])) for r, p in self.parts]
        half = max(1, self.width // 2)
        least = [np.minimum.reduceat(x, np.arange(0, len(x), half)) for x in speeds]
        if self.width > 1:
            least = [np.minimum(x[:-1], x[1:]) for x in least]
        lengths = [len(_window(p.w, rows.h[p.at, 0], self.width)) for rows, p in self.parts]
        return np.concatenate([x[:k] for x, k in zip(least, lengths)])

    @property
    def early(self) -> float:
        """The share of their changes by which held forces act before the row that tells them."""
        along = total = 0.0
        for rows, p in self.parts:
            changing = np.setdiff1d(np.arange(len(rows.h)), p.at)
            w = _plain(self.model, rows, self.held)[1][changing]
            before = rows.taken(changing)
            after = replace(before, F=rows.F[changing + 1])
            x = self.model.at(after) - self.model.at(before)
            N = self.model.inertia(before.t, before.q)
            along += mass_product(x, N, w)
            total += mass_product(x, N, x)
        return along / total if total > 0.0 else 0.0

    def few(self, most: int) -> Intervals:
        """Those of stretches of so many intervals together, over the whole log."""
        count = sum(len(p.at) for _, p in self.parts)
        if count <= most:
            return self
        chosen = []
        for rows, p in self.parts:
            share = max(4 * self.width, most * len(p.at) // count)
            pieces = max(1, min(PIECES, share // max(100, 4 * self.width)))
            size = min(share // pieces, len(p.at))
            starts = np.linspace(0, len(p.at) - size, pieces).astype(int)
            chosen += [(rows, p.within(slice(s, s + size))) for s in starts.tolist()]
        return replace(self, parts=chosen)

    def made_by(
        self, column: Callable[[Rows, Array, NDArray[np.intp], Array], Array]
    ) -> tuple[Array, Array]:
        """What generalized forces make of the windows (W, n, P), and half of what that changes over a step.

        `column` gives them (T, n, P) at some rows of a part: it takes the part's rows, its accelerations
        (T, n) as the motion has them, which rows, and the logged forces (rows, m) there.
        """
        found, changes = list[Array](), list[Array]()
        for rows, p in self.parts:
            udot, starts, ends = self._udot(rows, p), p.at, p.at + 1
            F = rows.F[starts if self.held else ends]
            first = self._added(rows, starts, column(rows, udot, starts, rows.F[starts]))
            last = self._added(rows, ends, column(rows, udot, ends, F))
            found.append(p.N @ (0.5 * (first + last)))
            changes.append(p.N @ (0.5 * (last - first)))
        return self.windows(found), self.windows(changes)

    def _udot(self, rows: Rows, p: _Defects) -> Array:
        """Accelerations (T, n): those of the model, and the defects as far as noise allows."""
        middle = (rows.t[:-1] + 0.5 * rows.h[:, 0])[p.at]
        h = rows.h[p.at, 0]
        left, times = _window(p.w, h, self.width), _window(middle, h, self.width)
        besides = [np.interp(rows.t, times, x) for x in left.T] if len(left) else 0.0
        return np.asarray(self.model.at(rows) + np.transpose(besides))

    def _added(self, rows: Rows, k: NDArray[np.intp], force: Array) -> Array:
        """What forces (I, n, P) at some rows add to the accelerations."""
        M, G = self.model.matrices(rows.t[k], rows.q[k])
        if self.model.rows_of_G:
            return self.model.compliance(M, G) @ force
        return np.asarray(np.linalg.solve(M, force))


def _plain(model: Model, rows: Rows, held: bool) -> tuple[Array, Array, Array]:
    """Accelerations at the rows (T, n), the defects w (I, n), and the error of interpolation (I, n)."""
    a = model.acceleration(rows.t, rows.q, rows.u, rows.F)
    smooth, forced = a, np.zeros_like(a[:-1])
    if held:  # splines of jumps would ring: a = a(F = 0) + what the forces add, held over a step
        smooth = model.acceleration(rows.t, rows.q, rows.u, np.zeros_like(rows.F))
        end = model.acceleration(rows.t[1:], rows.q[1:], rows.u[1:], rows.F[:-1])
        forced = 0.5 * (a[:-1] - smooth[:-1] + end - smooth[1:])
    mean = mean_over_steps(rows.t, smooth, 5)
    return a, rows.D - mean - forced, mean - mean_over_steps(rows.t, smooth, 3)


def _defects(model: Model, rows: Rows, groups: Mapping[str, list[int]], held: bool) -> _Defects:
    """The defects of a stretch; if forces are held those where none changes."""
    a, w, interpolation = _plain(model, rows, held)
    t0, q0, u0, F0 = rows.t[:-1], rows.q[:-1], rows.u[:-1], rows.F[:-1]
    t1, q1, u1, F1 = rows.t[1:], rows.q[1:], rows.u[1:], rows.F[1:]
    a0, a1 = a[:-1], a[1:]
    N = model.inertia(t0, q0)
    columns = {
        "q": model.acceleration(t0, q1, u0, F0) - a0,
        "u": model.acceleration(t0, q0, u1, F0) - a0,
    }
    bounds = {"q": 0.75, "u": 0.75}
    if model.damped:
        change = model.damping(t0, q0, u1, F0) - model.damping(t0, q0, u0, F0)
        columns["damping"] = model.response(t0, q0, change)
        bounds["damping"] = 1.0
    if model.of_time:
        columns["t"] = model.acceleration(t1, q0, u0, F0) - a0
        bounds["t"] = 1.6

    def with_forces(places: list[int], F: Array) -> Array:
        """What other forces at some places, held over each step, would add."""
        other = F0.copy()
        other[:, places] = F
        return np.asarray(model.acceleration(t0, q0, u0, other) - a0)

    forces = {}
    # Held forces are of one controller: whatever delays them delays all.
    together = {"forces": sorted({k for places in groups.values() for k in places})}
    for name, places in (together if held else groups).items():
        F = rows.F[:, places]
        if not np.any(F[1:] != F[:-1]):
            continue
        for k in NEARBY if held else (1,):
            key = name if k == 1 else f"{name} {k:+d}"
            columns[key] = with_forces(places, _row(F, k))
            bounds[key] = 1.6  # held or interpolated, of this row or one near it
            if held:
                forces[key] = columns[key]
        second = np.diff(F, 2, axis=0)
        if not held:
            forces[name] = with_forces(places, F[:-1] + np.vstack([second, second[-1:]]))
        ramp = ramped(F)[:-1]
        if np.any(ramp != F[:-1]):  # as commanded now and then, where more happened in between
            columns[f"{name} ramped"] = with_forces(places, ramp)
            bounds[f"{name} ramped"] = 1.6
            if held:
                forces[f"{name} ramped"] = columns[f"{name} ramped"]
    uneven = float(np.ptp(rows.h)) > UNEVEN * float(np.median(rows.h))
    if uneven:  # one step of a scheme is another share of each interval
        share = float(rows.h.min()) / rows.h
        for name in list(columns):
            columns[f"{name} by h"] = columns[name] * share
            bounds[f"{name} by h"] = 2.0 * bounds[name]
    both = model.acceleration(t0, q1, u1, F0) - a0 - columns["q"] - columns["u"]
    middle = model.acceleration(
        0.5 * (t0 + t1),
        model.moved(q0, 0.5 * (u0 + u1), 0.5 * rows.h),
        0.5 * (u0 + u1),
        0.5 * (F0 + F1),
    )
    bent = middle - 0.5 * (a0 + a1)
    columns["mixed"], columns["middle"] = both, bent
    smooth = a
    if held:
        smooth = model.acceleration(rows.t, rows.q, rows.u, np.zeros_like(rows.F))
    second = np.diff(smooth, 2, axis=0)
    curve = 0.5 * (np.vstack([second, second[-1:]]) + np.vstack([second[:1], second]))
    columns["curve"] = curve
    bounds |= {"mixed": 1.0, "middle": 1.0, "curve": 0.5}
    at = np.flatnonzero(stairs(rows.F).known) if held else np.arange(len(w))
    return _Defects(
        w[at], {n: x[at] for n, x in columns.items()}, N[at], a0[at], interpolation[at],
        {n: x[at] for n, x in forces.items()}, bounds, at,
    )  # fmt: skip


def _row(F: Array, k: int) -> Array:
    """The forces (T − 1, m) `k` rows after each step's own; those of the end repeat."""
    return np.asarray(F[np.clip(np.arange(len(F) - 1) + k, 0, len(F) - 1)])


def _fit(parts: Sequence[_Defects], names: Sequence[str]) -> dict[str, float]:
    """Coefficients of the scheme columns, in the mass metric, within their bounds; impacts left out.

    Columns that constraints take off altogether have none: what is left of them is rounding.
    """
    from scipy.optimize import lsq_linear

    def stacked(p: _Defects, those: Mapping[str, Array]) -> Array:
        return np.stack([those.get(n, np.zeros_like(p.w)) for n in names], axis=2)

    columns = [stacked(p, p.columns) for p in parts]
    weighted = [stacked(p, p.column_forces) for p in parts]
    energy = sum_of(np.einsum("tij,tij->j", X, NX) for X, NX in zip(columns, weighted))
    whole = sum_of(
        np.tensordot(np.linalg.norm(p.N, axis=(1, 2)), X * X, 1).sum(axis=0)
        for p, X in zip(parts, columns)
    )
    seen = energy > VISIBLE * whole
    names = [n for n, visible in zip(names, seen) if visible]
    if not names:
        return {}
    columns, weighted = ([x[:, :, seen] for x in those] for those in (columns, weighted))
    limit = np.array([max(p.bounds.get(n, 0.0) for p in parts) for n in names])
    c = np.zeros(len(names))
    for _ in range(3):
        A, b = np.zeros((len(names), len(names))), np.zeros(len(names))
        for p, X, NX in zip(parts, columns, weighted):
            energy = mass_energy(p.N, p.w - X @ c)
            last = int((1.0 - TRIMMED) * (len(energy) - 1))
            kept = energy <= np.partition(energy, last)[last]
            flat = NX[kept].reshape(-1, len(names))
            A += X[kept].reshape(-1, len(names)).T @ flat
            b += p.w[kept].ravel() @ flat
        scale = np.sqrt(np.maximum(np.diag(A), 1e-300))
        values, vectors = np.linalg.eigh(A / np.outer(scale, scale))
        roots = np.sqrt(np.maximum(values, 1e-14 * values.max()))
        right = (vectors.T @ (b / scale)) / roots
        found, most = vectors @ (right / roots), limit * scale + 1e-300
        if np.any(np.abs(found) > most):
            found = lsq_linear(roots[:, None] * vectors.T, right, (-most, most)).x
        c = found / scale
    return dict(zip(names, c.tolist()))


def _fit_under_noise(
    parts: Sequence[_Defects],
    lengths: Sequence[Array],
    names: Sequence[str],
    residual: Array,
    noise: Array,
    width: int,
) -> tuple[dict[str, float], Array]:
    """The coefficients of a log whose noise hides what an integrator leaves in a single step.

    Noise of the states is in the defects and in the columns, so that rows fit each other's noise. Means over
    windows have next to none of it. Each equation counts by its own `noise` (n,), and by what is left of the
    equation that fits best; coefficients are as large as their bounds at first sight. Also what their errors
    leave of each equation (n,), N or N·m.
    """
    if not names:
        return {}, np.zeros_like(noise)
    from scipy.optimize import lsq_linear

    if not names:  # as of a log at rest
        return {}, np.zeros(residual.shape[1])

    def windows(forces: Iterable[Array]) -> Array:
        return np.concatenate([_window(x, h, width) for x, h in zip(forces, lengths)])

    y = windows(multiply(p.N, p.w) for p in parts)
    X = np.stack([windows(p.column_forces.get(n, 0.0 * p.w) for p in parts) for n in names], axis=2)
    inertia = np.mean(np.concatenate([np.einsum("tii->ti", p.N) for p in parts]), axis=0)
    unlike = float(np.min(rms(residual) ** 2 / np.maximum(inertia, 1e-300)))
    weight = 1.0 / np.sqrt(np.maximum(noise**2 + unlike * inertia, 1e-300))
    bounds = np.array([max(p.bounds.get(n, 0.0) for p in parts) for n in names])
    prior = np.diag(1.0 / bounds)
    c = np.zeros(len(names))
    for _ in range(3):
        energy = np.sum(((y - X @ c) * weight) ** 2, axis=1)
        kept = energy <= np.quantile(energy, 1.0 - TRIMMED)
        A = (X[kept] * weight[:, None]).reshape(-1, len(names))
        b = (y[kept] * weight).ravel()
        rows, right = np.vstack([A, prior]), np.concatenate([b, np.zeros(len(names))])
        c = lsq_linear(rows, right, (-bounds, bounds)).x
    # Windows overlap by half, so that every row counts twice.
    covariance = 2.0 * np.linalg.inv(rows.T @ rows)
    errors = np.einsum("wnp,pq,wnq->wn", X, covariance, X)
    return dict(zip(names, c.tolist())), np.asarray(np.sqrt(np.mean(errors, axis=0)))


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
    model: Model,
    run: Trajectory,
    pieces: Sequence[tuple[Rows, Rows]],
    parts: Sequence[_Defects],
    c: Mapping[str, float],
    off: float,
    steps: Steps | None,
    groups: Mapping[str, list[int]],
    unsteady: float,
    held: bool,
    uncertain: Array | None = None,
) -> Residual:
    """What the coefficients `c` leave of the parts; `uncertain` (n,) is what their errors leave."""

    def forces(p: _Defects, w: Array) -> Array:
        return multiply(p.N, w)

    rest = [
        p.w - sum((c[n] * p.columns[n] for n in c if n in p.columns), start=np.zeros_like(p.w))
        for p in parts
    ]
    raw = [forces(p, w) for p, w in zip(parts, rest)]
    taken = trimmed(np.concatenate([forces(p, p.w - w) for p, w in zip(parts, rest)]))
    # Next order: what second differences leave, times the relative change over a step.
    change = np.concatenate([_changes(p) for p in parts])
    typical = np.concatenate([mass_norm(p.N, p.a) for p in parts])
    rate = float(np.clip(np.median(change) / max(float(np.median(typical)), 1e-300), 0.0, 1.0))
    first = max((abs(x) for n, x in c.items() if n not in SECOND), default=0.0)
    growth = rate * (1.0 + 2.0 * first)
    # As much of them as was fitted is believed to be there, and some besides.
    fitted = {n: abs(c.get(n, 0.0)) + BESIDES for n in SECOND}
    seconds = [sum_of(fitted[n] * np.abs(p.column_forces[n]) for n in SECOND) for p in parts]
    each: dict[str, list[Array]] = {
        "next order": [growth * x for x in seconds],
        "interpolation": [np.abs(forces(p, p.interpolation)) for p in parts],
        # Of held forces as much is believed as was fitted of each way in which they may be of other rows.
        "forces between rows": [
            sum_of(
                0.5 * (abs(c.get(n, 0.0)) if held else 1.0) * np.abs(forces(p, x))
                for n, x in p.forces.items()
            )
            + np.zeros_like(p.w)
            for p in parts
        ],
        "times of rows": [
            CARRIED * unsteady * np.abs(forces(p, r.D[p.at])) for (r, _), p in zip(pieces, parts)
        ],
    }
    bars = {name: rms(np.concatenate(x)) for name, x in each.items()}
    systematic = [sum_of(x[k] for x in each.values()) for k in range(len(parts))]
    systematic_bar = np.sqrt(sum_of(np.square(x) for x in bars.values()))
    rng = np.random.default_rng(5)
    # Kinks of held forces look like noise; but noise would not let any scheme come closer than itself.
    believed = (
        min(1.0, 2.0 * off / steps.digits) if steps is not None and steps.digits > 0.0 else 1.0
    )
    noise = []
    real = _share_of_noise(model, pieces, parts, rest, held)
    for (rows, size), p in zip(pieces, parts):
        fine = np.minimum(
            resolution(rows.u), size.u
        )  # rounding is no noise: it hardly changes for a while
        shaken = rows.shaken(replace(size, u=fine + real * (size.u - fine)), rng)
        noise.append(believed * forces(p, _plain(model, shaken, held)[1][p.at] - p.w))
    best: tuple[int, Array, Array] | None = None
    longest = max(len(x) for x in raw)
    for width in WIDTHS:
        if width > 1 and longest < 4 * width:
            break
        weights = [r.h[p.at, 0] for (r, _), p in zip(pieces, parts)]
        bar = rms(np.concatenate([_window(x, h, width) for x, h in zip(noise, weights)]))
        best = (width, bar, np.concatenate([_window(x, h, width) for x, h in zip(raw, weights)]))
        if np.all(bar <= systematic_bar):
            break
    assert best is not None
    width, noise_bar, residual = best
    if width > 1 and uncertain is None:
        again, uncertain = _fit_under_noise(parts, weights, tuple(c), residual, noise_bar, width)
        return _judged(
            model, run, pieces, parts, again, off, steps, groups, unsteady, held, uncertain
        )
    if uncertain is not None:
        bars["coefficients"] = uncertain
        systematic_bar = np.hypot(systematic_bar, uncertain)
    allowed = np.concatenate([_window(x, h, width) for x, h in zip(systematic, weights)])
    times = np.concatenate(
        [
            _window((r.t[:-1, None] + 0.5 * r.h)[p.at], r.h[p.at, 0], width)[:, 0]
            for (r, _), p in zip(pieces, parts)
        ]
    )
    whole = [
        model.terms(r.t[p.at], r.q[p.at], r.u[p.at], r.F[p.at]) + np.abs(forces(p, p.a))
        for (r, _), p in zip(pieces, parts)
    ]
    magnitude = np.concatenate(whole)
    inertia = np.sqrt(
        np.maximum(
            np.mean(np.concatenate([np.einsum("tii->ti", p.N) for p in parts]), axis=0), 1e-300
        )
    )
    scale = rms(magnitude)
    scale = np.maximum(scale, 1e-3 * inertia * float((scale / inertia).max()))
    rounding = (
        1e-13 * scale
        + 20.0 * EPS * rms(np.concatenate([np.abs(r.u[:-1]) / r.h for r, _ in pieces])) * inertia**2
    )
    bar = np.sqrt(noise_bar**2 + systematic_bar**2 + rounding**2)
    u = np.concatenate([r.u[p.at] for (r, _), p in zip(pieces, parts)])
    left = np.concatenate(raw)
    time = float(run.t[-1] - run.t[0])
    # What is left may be a mistake altogether, and noise may hide another; the next order is no mistake.
    lengths = np.concatenate([r.h[p.at] for (r, _), p in zip(pieces, parts)])
    share = lengths / float(lengths.sum())

    def work(force: Array) -> float:
        """The largest work (J) of a force in the time of the log."""
        return float(np.abs(np.cumsum(np.sum(u * force, axis=1) * share[:, 0])).max()) * time

    hidden = work(left) + _mistakes(pieces, parts, tuple(c), residual, width, time)
    spent = abs(float(np.mean(np.sum(u * left, axis=1)))) * time
    return Residual(
        times, residual, allowed, trimmed(residual), bar, scale, c, taken, hidden, spent,
        {**bars, "noise": noise_bar, "rounding": rounding}, believed * min(1.0, np.sqrt(3.0) * real),
        Intervals(model, [(r, p) for (r, _), p in zip(pieces, parts)], tuple(c), width, held),
    )  # fmt: skip


def _mistakes(
    pieces: Sequence[tuple[Rows, Rows]],
    parts: Sequence[_Defects],
    names: Sequence[str],
    residual: Array,
    width: int,
    time: float,
) -> float:
    """The largest work (J) that a simple mistake may have done in a time without being seen.

    A damper of one joint or of all alike, a constant force or another inertia of one joint is fitted to the
    residual (W, n) together with the scheme columns, each of which may be as large as its bound; three
    standard errors are added. Those are the larger of two: of white noise, and of the scatter of the scores
    over blocks of the log.
    """
    lengths = [r.h[p.at, 0] for (r, _), p in zip(pieces, parts)]
    energy = np.sum((residual / np.maximum(rms(residual), 1e-100)) ** 2, axis=1)
    kept = energy <= np.quantile(energy, 1.0 - TRIMMED)  # what acts all along shows in the others
    residual = residual[kept]
    weight = 1.0 / np.maximum(rms(residual), 1e-100)  # whose square is a number

    def weighted(forces: Iterable[Array]) -> Array:
        made = np.concatenate([_window(x, h, width) for x, h in zip(forces, lengths)])
        return np.asarray(made[kept] * weight)

    bounds = {n: max(p.bounds.get(n, 0.0) for p in parts) for n in names}
    columns = [
        bounds[n] * weighted(p.column_forces.get(n, 0.0 * p.w) for p in parts) for n in names
    ]
    windows, n = residual.shape
    X = np.reshape(columns, (len(names), windows * n)).T
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
    speeds = [r.u[p.at] for (r, _), p in zip(pieces, parts)]
    u = np.concatenate(speeds)
    share = np.concatenate(lengths)[:, None] * (time / sum(float(h.sum()) for h in lengths))
    most = 0.0
    for kind in (
        speeds,
        [np.ones_like(p.w) for p in parts],
        [multiply(p.N, p.a) for p in parts],
    ):
        m = weighted(kind)
        with_columns, products, squares = (
            and_of_all(by_block(U * m[..., None])),
            and_of_all(by_block(m * y)),
            and_of_all(by_block(m * m)),
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


def _share_of_noise(
    model: Model,
    pieces: Sequence[tuple[Rows, Rows]],
    parts: Sequence[_Defects],
    rest: Sequence[Array],
    held: bool,
) -> float:
    """How much of what looks like noise of the speeds is that, in standard deviations.

    Noise of u leaves mean accelerations that follow each other with opposite signs: −2 Σ wᵀN w′ over
    neighbours is its energy. What forces leave that change from step to step has no such relation.
    """
    rng = np.random.default_rng(7)
    total = between = apparent = 0.0
    count = pairs = intervals = 0
    for (rows, size), p, w in zip(pieces, parts, rest):
        still = Rows(rows.t, np.zeros_like(size.q), size.u, np.zeros_like(size.F))
        shaken = _plain(model, rows.shaken(still, rng), held)[1][p.at] - p.w
        apparent += mass_product(shaken, p.N, shaken)
        total += mass_product(w, p.N, w)
        k = np.flatnonzero(np.diff(p.at) == 1)
        between += mass_product(w[k], p.N[k], w[k + 1])
        count += w.size
        pairs += len(k)
        intervals += len(w)
    if not apparent > 0.0 or pairs < CHANCE**2:
        return 1.0
    between *= intervals / pairs
    known = max(-2.0 * between, 0.0) + CHANCE * total / np.sqrt(max(count, 1))
    return float(np.clip(np.sqrt(known / apparent), 0.0, 1.0))


def _changes(p: _Defects) -> Array:
    """How much accelerations change over each interval (I,), by all causes, in the mass metric."""
    return sum_of(
        np.sqrt(np.maximum(np.vecdot(x, p.column_forces[n]), 0.0))
        for n, x in p.columns.items()
        if n not in SECOND
    )
