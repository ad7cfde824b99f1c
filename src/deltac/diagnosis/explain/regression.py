"""The regression: residual + Σ θ x = 0 by least squares, kept as triangular factors of blocks in time.

[X r] of each block of consecutive rows is reduced by QR to as many rows as it has columns. All that
follows (fits, their errors, their comparison) needs no more than that, however long the log.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deltac.arrays import Array
from deltac.diagnosis.explain.causes import Candidate, candidates
from deltac.diagnosis.explain.columns import (
    UNIT_MOMENTS,
    Column,
    ColumnKernels,
    column_kernels,
    evaluate,
)
from deltac.diagnosis.measurements.digits import resolution, white_noise
from deltac.diagnosis.residuals.at_samples import Evaluator, Sampled
from deltac.diagnosis.residuals.rows import UNEVEN
from deltac.dynamics.spatial import SX, Inertia
from deltac.errors import LogError
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory
from deltac.trajectories.lint import gap_rows

STEPS = 20
"""Steps of Gauss–Newton for causes that are not linear; most converge in two or three."""

FOLDS, RIDGE = 4, 1e-2
"""Parts of a log of which each is predicted by the others, and what a term as large as the residual costs.

Terms far larger than it would close any equation: they take all of the model away, masses and forces alike.
"""

CALM = 0.1
"""Share of the estimated noise that a fit of few numbers leaves, from which on there is not as much."""

BLURRED, FARTHER = 2.0, 10.0
"""Squares that a fit may leave for columns known only so far, as multiples of what these do, and of the best.
"""

MOSTLY = 0.5
"""Share of a residual that is taken for no noise, whatever seems to be."""

SURE = 6.0
"""Standard errors by which a cause must stand out to be named."""


@dataclass(frozen=True, eq=False)
class Regression:
    """Weighted equations [X r] (rows, P + 1), block by block.

    Attributes:
        blocks: triangular factors (B, P + 1, P + 1), padded with zero rows.
        candidates: the causes whose columns X holds.
        rows: number of equations.
        shaken: triangular factor (P + 1, P + 1) of what the log's noise does to [X r].
        precision: sum of squares of r that the log's digits and rounding account for.
        weights: place of each body's mass and first moments -> that of their weight.
        blur: triangular factor (P + 1, P + 1) of how far the columns may be off, None where they are exact.
    """

    blocks: Array
    candidates: tuple[Candidate, ...]
    rows: int
    shaken: Array
    precision: float
    weights: Mapping[int, int] = field(default_factory=dict)
    blur: Array | None = None

    @cached_property
    def R(self) -> Array:
        """The triangular factor (P + 1, P + 1) of all blocks together."""
        width = self.blocks.shape[2]
        return np.asarray(np.linalg.qr(self.blocks.reshape(-1, width), mode="r"))

    @property
    def total(self) -> float:
        """|r|²."""
        return float(np.sum(self.R[:, -1] ** 2))

    def noise(self, fit: Fit) -> float:
        """The part of what a fit leaves that is noise: that of the terms with the fit's numbers in them."""
        c, _ = self._at(fit)
        return float(np.sum((self.shaken[:, :-1] @ c + self.shaken[:, -1]) ** 2))

    def floor(self, fit: Fit) -> float:
        """The part of what a fit leaves that is no mistake."""
        return self.precision + self.noise(fit)

    def blurred(self, fit: Fit) -> float:
        """The part of what a fit leaves that may be of columns known only so far."""
        if self.blur is None:
            return 0.0
        return float(np.sum((self.blur[:, :-1] @ self._at(fit)[0]) ** 2))

    def calmed(self, fits: Sequence[Fit]) -> Regression:
        """The same with as much noise as the best of these fits leaves, where it was taken for far more.

        A few numbers cannot fit noise. Where motion between rows looked like noise, one cause that is right
        leaves far less.
        """
        share = min((f.left / self.noise(f) for f in fits if self.noise(f) > 0.0), default=1.0)
        return self if share > CALM else replace(self, shaken=np.sqrt(share) * self.shaken)

    @cached_property
    def predicted(self) -> float:
        """Share of |r|² that all columns, fitted to three quarters of the blocks, predict of the others.

        A mistake of the equations does the same everywhere; what noise, filters and unknown forces leave in
        one part of a log says nothing of another. Of white noise it is known how large it is: that part of
        |r|² nobody can predict.
        """
        grams = np.swapaxes(self.blocks, 1, 2) @ self.blocks
        size = np.sqrt(np.maximum(np.diag(grams.sum(axis=0)), 1e-300))
        size[-1] = 1.0
        grams = grams / np.outer(size, size)
        left = 0.0
        for fold in range(FOLDS):
            test = grams[fold::FOLDS].sum(axis=0)
            known = grams.sum(axis=0) - test
            columns = known[:-1, :-1] + RIDGE * np.eye(len(known) - 1)
            c = np.append(-np.linalg.solve(columns, known[:-1, -1]), 1.0)
            left += float(c @ test @ c)
        known = max(self.unlike_noise, 1e-300)
        return float(np.clip((self.total - left) / known, 0.0, 1.0))

    @property
    def unlike_noise(self) -> float:
        """What |r|² is without that of noise, half of it at least: the size of noise is an estimate."""
        return max(self.total - self.noise(self.nothing), MOSTLY * self.total)

    @property
    def nothing(self) -> Fit:
        """The fit of no cause."""
        return Fit((), (), self.total)

    @cached_property
    def directions(self) -> tuple[Array, ...]:
        """R times the tangent at θ = 0 of every candidate, (P + 1, d) each."""
        return tuple(self.R[:, list(c.columns)] @ c.linear for c in self.candidates)

    @cached_property
    def sizes(self) -> Array:
        """Norm of each candidate's directions together (C,)."""
        return np.array([np.linalg.norm(d) for d in self.directions])

    def fit(self, chosen: Sequence[int]) -> Fit:
        """Least squares by the candidates with these numbers together."""
        parts = [self.candidates[k] for k in chosen]
        edges = np.concatenate([[0], np.cumsum([c.size for c in parts])]).astype(int)
        theta = np.zeros(edges[-1])
        heavier = len(parts) > 1 and any(c.kind == "gravity" for c in parts)
        curved = heavier or _products(parts) or any(c.quadratic is not None for c in parts)
        for _ in range(STEPS if curved else 1):
            c, J = self._linearised(parts, edges, theta)
            e = self.R[:, :-1] @ c + self.R[:, -1]
            step = np.linalg.lstsq(self.R[:, :-1] @ J, -e, rcond=1e-11)[0]
            theta = theta + step
            if np.linalg.norm(step) <= 1e-12 * np.linalg.norm(theta):
                break
        c, _ = self._linearised(parts, edges, theta)
        left = float(np.sum((self.R[:, :-1] @ c + self.R[:, -1]) ** 2))
        values = tuple(theta[a:b] for a, b in zip(edges[:-1], edges[1:]))
        return Fit(tuple(chosen), values, left)

    def _linearised(
        self, parts: Sequence[Candidate], edges: Array, theta: Array
    ) -> tuple[Array, Array]:
        """Coefficients (P,) of all columns and their derivatives (P, d)."""
        width = self.R.shape[1] - 1
        c, J = np.zeros(width), np.zeros((width, len(theta)))
        for part, a, b in zip(parts, edges[:-1], edges[1:]):
            np.add.at(c, list(part.columns), part.coefficients(theta[a:b]))
            np.add.at(J[:, a:b], list(part.columns), part.tangent(theta[a:b]))
        for i, k, per in _products(parts):  # what is heavier and moved is more than both
            place, start, end = int(edges[i]), int(edges[k]), int(edges[k + 1])
            at, factor = list(parts[k].columns), per * theta[place]
            moved = parts[k].coefficients(theta[start:end])
            np.add.at(c, at, factor * moved)
            np.add.at(J[:, start:end], at, factor * parts[k].tangent(theta[start:end]))
            np.add.at(J[:, place], at, per * moved)
        for part, a in zip(parts, edges[:-1]):  # another gravity pulls at the other masses
            if part.kind == "gravity" and self.weights:
                masses, pulled = list(self.weights), list(self.weights.values())
                c[pulled] += theta[a] * c[masses]
                J[pulled] += theta[a] * J[masses]
                J[pulled, a] += c[masses]
        return c, J

    def tangents(self, fit: Fit) -> tuple[Array, Array]:
        """R times the derivatives of a fit's coefficients (P + 1, d), and what it leaves (P + 1,)."""
        c, J = self._at(fit)
        return self.R[:, :-1] @ J, self.R[:, :-1] @ c + self.R[:, -1]

    def _at(self, fit: Fit) -> tuple[Array, Array]:
        if not fit.chosen:
            width = self.R.shape[1] - 1
            return np.zeros(width), np.zeros((width, 0))
        parts = [self.candidates[k] for k in fit.chosen]
        edges = np.concatenate([[0], np.cumsum([c.size for c in parts])]).astype(int)
        return self._linearised(parts, edges, np.concatenate(fit.theta))

    def left_by_block(self, fit: Fit) -> Array:
        """What a fit leaves of the squares of each block (B,)."""
        c, _ = self._at(fit)
        e = self.blocks[:, :, :-1] @ c + self.blocks[:, :, -1]
        return np.asarray(np.sum(e**2, axis=1))

    def covariance(self, fit: Fit) -> Array:
        """Covariance (d, d) of a fit's numbers, the larger of two estimates of each variance.

        White noise: σ² (JᵀJ)⁻¹; and whatever is correlated within blocks: the sandwich of the blocks'
        scores (Liang and Zeger 1986, Biometrika 73). What is noise in q, u, u̇ is in both.
        """
        c, J = self._at(fit)
        d = J.shape[1]
        X = self.R[:, :-1] @ J
        inverse = np.linalg.pinv(X.T @ X, rcond=1e-14, hermitian=True)
        white = max(fit.left, self.precision) / max(1, self.rows - d) * inverse
        e = self.blocks[:, :, :-1] @ c + self.blocks[:, :, -1]
        scores = np.einsum("kij,ki->kj", self.blocks[:, :, :-1] @ J, e)
        blocks = len(self.blocks)
        meat = scores.T @ scores * blocks / max(1, blocks - d)
        robust = inverse @ meat @ inverse
        scale = np.sqrt(np.maximum(1.0, np.diag(robust) / np.maximum(np.diag(white), 1e-300)))
        return np.asarray(white * np.outer(scale, scale))

    def stands_out(self, fit: Fit, sure: float = SURE) -> bool:
        """Whether every cause of a fit is many times the errors of its numbers (Wald's test)."""
        if not fit.chosen:
            return False
        covariance, start = self.covariance(fit), 0
        for theta in fit.theta:
            where = slice(start, start + len(theta))
            start += len(theta)
            inverse = np.linalg.pinv(covariance[where, where], rcond=1e-12, hermitian=True)
            if not float(theta @ inverse @ theta) > len(theta) * sure**2:
                return False
        return True

    def same(self, a: Fit, b: Fit, sure: float = 3.0) -> bool:
        """Whether the data do not prefer fit a to b, which leaves more.

        Both leave no more than precision explains, or the difference of what they leave does not
        stand out of its scatter over the blocks (Vuong 1989, Econometrica 57).
        """
        blurred = all(fit.left <= self.precision + BLURRED * self.blurred(fit) for fit in (a, b))
        if blurred and b.left <= self.precision + FARTHER * a.left:
            return True
        if b.left <= max(4.0 * a.left, self.precision):
            difference = self.left_by_block(b) - self.left_by_block(a)
            scatter = float(np.std(difference, ddof=1)) * np.sqrt(len(difference))
            return float(np.sum(difference)) <= sure * scatter and b.left < 2.0 * a.left
        return False


@dataclass(frozen=True, eq=False)
class Fit:
    """Causes with their numbers, and the sum of squares that they leave."""

    chosen: tuple[int, ...]
    theta: tuple[Array, ...]
    left: float


def _products(parts: Sequence[Candidate]) -> list[tuple[int, int, float]]:
    """Pairs of causes whose product is in the residual: the factor, what it scales, by how much."""
    pairs = ((i, k, a.scales(b)) for i, a in enumerate(parts) for k, b in enumerate(parts))
    return [pair for pair in pairs if pair[2]]


def factored(blocks: Sequence[Array]) -> Array:
    """Triangular factors (B, n, n) of matrices (rows, n)."""
    width = blocks[0].shape[1]
    made = np.zeros((len(blocks), width, width))
    for k, block in enumerate(blocks):
        R = np.linalg.qr(block, mode="r")
        made[k, : len(R)] = R
    return made


# --- from a log to the regression ----------------------------------------------------------------

Form = Literal["samples", "weak"]

MOST_ROWS = 3000
MOST_NUMBERS = 8_000_000
"""Samples that are looked at, in stretches over the log; fewer where the mechanism is large."""

NOISY = 1e-4
"""Share of the terms from which on noise, and not the size of the terms, sets an equation's weight."""

SLIP = 0.4
"""Share of its usual speed below which a joint may stick, or a soft friction not yet have its full size."""

STRETCHES = 16
BLOCKS = 16
LEAST_ROWS = 24
HALF_WINDOW = 32
POWER = 8
"""Windows of the weak form: half width in samples; φ = (1 − s²)^8 is smooth enough for trapezoids."""

BARS = 1.5
"""Error bars of what is excused that need no cause."""

LEAST: dict[Form, float] = {"samples": 1e-7, "weak": 1e-5}
"""Share of the terms of the equations below which a residual is not explained.

Solvers of constraints stop there; over windows the integrator's own error is part of the residual.
"""


@dataclass(frozen=True, eq=False)
class Prepared:
    """A regression, and the scales of its equations.

    form        at samples, with measured accelerations, or "weak"
    speeds      names of the free speeds (n,)
    scale       typical size of the terms of each equation (n,), N or N·m
    residual    root mean square of what the model leaves of each (n,)
    noise       root mean square of what the log's noise makes of each (n,)
    samples     how many were looked at; spacing: of them (s)
    sliding     whether what joints do that hardly move was left out
    """

    regression: Regression
    kernels: ColumnKernels
    form: Form
    speeds: tuple[str, ...]
    scale: Array
    residual: Array
    noise: Array
    samples: int
    spacing: float
    sliding: bool


@dataclass(frozen=True, eq=False)
class Excused:
    """What of a residual is no mistake of the equations, for the weak form.

    columns  of consecutive samples: generalized forces (T, n, m) that an unknown integrator may leave, each
             as large as a consistent one leaves at most; what they span is taken off the residual and all
             causes, as far as columns so small may account for it
    bar      error bar of each equation (n,), N or N·m
    """

    columns: Callable[[Sampled], Array]
    bar: Array


def prepare(
    mechanism: Mechanism,
    run: Trajectory,
    form: Form,
    *,
    sliding: bool = False,
    excused: Excused | None = None,
    stops_in: Mapping[int, tuple[float, float]] | None = None,
) -> Prepared:
    """The regression of a run's residual on all columns of the mechanism.

    With `sliding`, equations of joints are left out where those hardly move. What is `excused` needs no
    cause. `stops_in`: between which values of a coordinate stops are looked for, if not all over the log.

    Raises InputError for a log of too few rows.
    """
    if len(run) < LEAST_ROWS:
        raise LogError(
            f"the log has {len(run)} samples; an explanation needs {LEAST_ROWS} at least, and many more to "
            "tell causes apart: log a longer or a finer run"
        )
    evaluator = Evaluator(mechanism, run)
    for place, between in (stops_in or {}).items():
        for end, value in zip(evaluator.reach, between):
            end[place] = value
    kernels = column_kernels(evaluator)
    rows = _Rows(kernels, form)
    stretches = _stretches(run, evaluator, kernels, form)
    whole = np.concatenate([rows(s) for s in stretches])
    scale = terms_of(whole, kernels)
    digits = _digits(kernels, form, stretches)
    shaken = _shaken(rows, stretches)
    noise = np.sqrt(np.mean(shaken[..., 0] ** 2, axis=0))
    if form == "weak":
        digits = np.hypot(digits, _quadrature(rows, whole[..., 0], stretches))
    unsure = np.maximum(noise, NOISY * scale)
    if excused is not None:
        unsure = np.maximum(unsure, excused.bar)
    weight = 1.0 / np.maximum(unsure, 1e-300)
    moving = _moving(rows, stretches) if sliding else np.ones(whole.shape[:2])
    matrix = arranged(whole * (weight * moving)[..., None])
    certain = 4.0 * digits + LEAST[form] * scale
    if excused is not None:
        certain = np.hypot(certain, BARS * excused.bar)
    precise = np.sum((certain * weight) ** 2)
    if excused is not None and form == "weak":
        level = float(np.sqrt(precise / matrix.shape[1]))
        matrix = _without(matrix, excused, stretches, weight * moving, level)
    count = min(BLOCKS, max(2, len(matrix) // 8))
    blocks = [b.reshape(-1, matrix.shape[2]) for b in np.array_split(matrix, count)]
    shaken = arranged(shaken * weight[:, None])
    share = float(moving.mean()) * len(matrix) / len(shaken)
    regression = Regression(
        factored(blocks),
        candidates(evaluator, kernels.columns),
        int(moving.sum()),
        factored([shaken.reshape(-1, matrix.shape[2])])[0] * np.sqrt(share),
        float(len(matrix) * precise),
        weights_of(kernels.columns),
    )
    free = [mechanism.speeds[int(k)].name for k in mechanism.free.u]
    residual = np.sqrt(np.mean(whole[..., 0] ** 2, axis=0))
    return Prepared(
        regression, kernels, form, tuple(free), scale, residual, noise,
        sum(len(s.samples.t) for s in stretches), 1.01 * float(np.median(np.diff(run.t))), sliding,
    )  # fmt: skip


def weights_of(columns: Sequence[Column]) -> dict[int, int]:
    """Place of each body's mass and first moments -> that of their weight."""
    places = {column: k for k, column in enumerate(columns)}
    masses = ((c, Column("inertia", c.element, c.index)) for c in columns if c.what == "weight")
    return {places[mass]: places[weight] for weight, mass in masses if mass in places}


@dataclass(frozen=True, eq=False)
class _Stretch:
    """Consecutive samples, with the first and second rates of their logged forces."""

    samples: Sampled
    rate: Array
    curve: Array

    @staticmethod
    def of(samples: Sampled) -> _Stretch:
        if not samples.logged.shape[1]:
            return _Stretch(samples, samples.logged, samples.logged)
        from scipy.interpolate import CubicSpline

        spline = CubicSpline(samples.t, samples.logged)
        return _Stretch(samples, spline(samples.t, 1), spline(samples.t, 2))

    @property
    def columns(self) -> list[Array]:
        s = self.samples
        return [s.t[:, None], s.q, s.u, s.udot, s.logged, self.rate, self.curve]


def _stretches(
    run: Trajectory, evaluator: Evaluator, kernels: ColumnKernels, form: Form
) -> list[_Stretch]:
    """The log between its gaps, or parts of it where it is long."""
    given = run if run.udot is not None else replace(run, udot=np.zeros_like(run.u))
    everything = Sampled.of(evaluator.mechanism, given, evaluator.log)
    if form == "weak":
        everything = replace(everything, logged=_centred(run, evaluator, everything.logged))
    width = kernels.speeds * (1 + len(kernels.columns))
    most = int(np.clip(MOST_NUMBERS // max(width, 1), 300, MOST_ROWS))
    edges = [0, *(gap_rows(run.t) + 1), len(run)]
    pieces: list[NDArray[np.intp]] = []
    for a, b in zip(edges[:-1], edges[1:]):
        rows = np.arange(a, b)
        share = max(LEAST_ROWS, int(most * len(rows) / len(run)))
        if len(rows) <= share:
            pieces.append(rows)
            continue
        count = max(1, min(STRETCHES, share // 100))
        length = share // count
        starts = np.linspace(0, len(rows) - length, count).astype(int)
        pieces += [rows[s : s + length] for s in starts]
    kept = [p for p in pieces if len(p) >= LEAST_ROWS]
    if not kept:
        raise LogError(
            f"the log has no {LEAST_ROWS} consecutive samples between its gaps: log without gaps"
        )
    return [_Stretch.of(everything.take(p)) for p in kept]


def _centred(run: Trajectory, evaluator: Evaluator, logged: Array) -> Array:
    """Forces that were held from each row to the next, as their mean over the steps around each row.

    Trapezoids then err by (h²/12) ∫ φ″ f, and by as much with the momentum, whose rate jumps with f.
    """
    step = run.provenance.step
    if step is None or not np.isclose(np.median(np.diff(run.t)), step, rtol=0.01, atol=0.0):
        return logged
    made = logged.copy()
    for name in run.provenance.held or ():
        where = evaluator.log.columns.get(name)
        if where is not None:
            made[1:, where] = 0.5 * (logged[1:, where] + logged[:-1, where])
    return made


class _Rows:
    """The residual and its columns (rows, n, 1 + P) of a stretch, at samples or over windows."""

    def __init__(self, kernels: ColumnKernels, form: Form, residual_only: bool = False) -> None:
        if residual_only:
            kernels = replace(kernels, expression=kernels.expression[:, 0])
        self._function = kernels.pointwise() if form == "samples" else kernels.weak()
        self._form, self._speeds = form, kernels.speeds

    def __call__(self, stretch: _Stretch, stride: int = 1) -> Array:
        found = evaluate(self._function, stretch.columns, self._speeds)
        if self._form == "samples":
            return found[0]
        momentum, force = found
        return _windows(stretch.samples.t, momentum, force, stride)

    def slowest(self, stretch: _Stretch) -> Array:
        """The smallest |u| that each row saw (rows, n)."""
        u = np.abs(stretch.samples.u)
        if self._form == "samples":
            return u
        half, centres = _centres(len(u))
        return np.array([u[c - half // 2 : c + half // 2 + 1].min(axis=0) for c in centres])


def _centres(count: int) -> tuple[int, NDArray[np.intp]]:
    """Half width of windows over so many samples, and their middles."""
    half = int(np.clip(count // 8, 8, HALF_WINDOW))
    return half, np.arange(half, count - half, max(1, half // 8))


def _windows(t: Array, momentum: Array, force: Array, stride: int = 1) -> Array:
    """∫ φ f − φ̇ m dt over windows; ∫φ dt = 1."""
    half, centres = _centres(len(t))
    even = bool(np.ptp(np.diff(t)) < UNEVEN * np.median(np.diff(t)))
    made = np.empty((len(centres), *force.shape[1:]))
    for k, c in enumerate(centres):
        rows = slice(c - half, c + half + 1, stride)
        start, end = t[c - half], t[c + half]
        s = (2.0 * t[rows] - start - end) / (end - start)
        phi = (1.0 - s**2) ** POWER
        slope = -2.0 * POWER * s * (1.0 - s**2) ** (POWER - 1) * 2.0 / (end - start)
        dt = _weights(t[rows], even)
        whole = float(np.sum(phi * dt))
        made[k] = np.einsum("t,tij->ij", phi * dt / whole, force[rows])
        made[k] -= np.einsum("t,tij->ij", slope * dt / whole, momentum[rows])
    return made


def _weights(t: Array, even: bool) -> Array:
    """Weights of samples in an integral over a window: trapezoids on an even clock, else splines."""
    if even:
        weights = np.gradient(t)
        weights[[0, -1]] *= 0.5
        return np.asarray(weights)
    from scipy.interpolate import make_interp_spline

    return np.asarray(make_interp_spline(t, np.eye(len(t)), k=5).integrate(t[0], t[-1]))


def _without(
    matrix: Array, excused: Excused, stretches: Sequence[_Stretch], weight: Array, level: float
) -> Array:
    """The weighted equations (rows, n, P + 1) without what excused columns account for.

    Along what they span, the equations are divided by what the columns amount to there, with coefficients of
    one at most, and a noise of `level` in each of them. Small columns take off nothing: without this, the
    step times a damping would take off the inertia itself, which it is proportional to.
    """
    made = []
    for s in stretches:
        force = excused.columns(s.samples)
        made.append(_windows(s.samples.t, np.zeros_like(force), force))
    columns = np.concatenate(made) * weight[..., None]
    U, size, _ = np.linalg.svd(columns.reshape(-1, columns.shape[2]), full_matrices=False)
    kept = 1.0 / np.sqrt(1.0 + (size / max(level, 1e-300)) ** 2)
    rows = matrix.reshape(-1, matrix.shape[2])
    return np.asarray((rows - U @ ((1.0 - kept)[:, None] * (U.T @ rows))).reshape(matrix.shape))


def terms_of(whole: Array, kernels: ColumnKernels) -> Array:
    """Typical size of the terms of each equation (n,): of each inertial parameter, of each channel."""
    inertia = {x.joint.child: x.inertia for x in kernels.evaluator.symbols.system.links}
    magnitude = np.zeros(whole.shape[:2])
    for k, column in enumerate(kernels.columns):
        if column.what == "channel":
            magnitude += np.abs(whole[..., 1 + k])
        elif column.what == "inertia":
            value = float(ca.evalf(_ten(inertia[column.element])[column.index]))
            magnitude += np.abs(value * whole[..., 1 + k])
    scale = np.sqrt(np.mean(magnitude**2, axis=0))
    floor = 1e-6 * float(scale.max(initial=0.0))
    return np.asarray(np.maximum(scale, floor))


def _ten(inertia: Inertia) -> list[SX]:
    """The ten parameters of a rigid spatial inertia: mass, first moments, moments and products."""
    J, H, M = inertia.J, inertia.H, inertia.M
    first = [H[2, 1], H[0, 2], H[1, 0]]
    return [M[0, 0], *first, *(J[i, j] for i, j in UNIT_MOMENTS)]


# --- uncertainty --------------------------------------------------------------------------------------


def _quadrature(rows: _Rows, residual: Array, stretches: Sequence[_Stretch]) -> Array:
    """What sampling makes of the integrals (n,): a third of their change on every second sample."""
    coarse = np.concatenate([rows(s, 2)[..., 0] for s in stretches])
    return np.asarray(np.sqrt(np.mean((coarse - residual) ** 2, axis=0)) / 3.0)


PERTURBATIONS = 2
COLUMNS = ("q", "u", "udot", "logged")


def _some(stretches: Sequence[_Stretch]) -> Sequence[_Stretch]:
    """A few of them, over the whole log."""
    return stretches[:: max(1, len(stretches) // 4)]


def _moved(stretch: _Stretch, size: Callable[[Array], Array], rng: np.random.Generator) -> _Stretch:
    """The stretch with every number moved at random by a size."""
    moved = {}
    for name in COLUMNS:
        values = getattr(stretch.samples, name)
        moved[name] = values + rng.standard_normal(values.shape) * size(values)
    return replace(stretch, samples=replace(stretch.samples, **moved))


def _digits(kernels: ColumnKernels, form: Form, stretches: Sequence[_Stretch]) -> Array:
    """Root mean square (n,) of what the log's digits make of the residual."""
    rows = _Rows(kernels, form, residual_only=True)
    rng = np.random.default_rng(0)
    changes = [
        rows(_moved(s, lambda x: resolution(x) / np.sqrt(3.0), rng))[..., 0] - rows(s)[..., 0]
        for s in _some(stretches)
        for _ in range(PERTURBATIONS)
    ]
    return np.asarray(np.sqrt(np.mean(np.concatenate(changes) ** 2, axis=0)))


def _shaken(rows: _Rows, stretches: Sequence[_Stretch]) -> Array:
    """What noise like that of the log does to the residual and its columns (some rows, n, 1 + P)."""
    rng = np.random.default_rng(1)
    return np.concatenate([rows(_moved(s, _noise, rng)) - rows(s) for s in _some(stretches)])


def arranged(values: Array) -> Array:
    """[r X] as [X r]."""
    return np.concatenate([values[..., 1:], values[..., :1]], axis=2)


def _moving(rows: _Rows, stretches: Sequence[_Stretch]) -> Array:
    """1 where a joint moves, 0 where it hardly does (rows, n)."""
    u = np.concatenate([rows.slowest(s) for s in stretches])
    typical = np.sqrt(np.mean(u**2, axis=0))
    return np.asarray((u > SLIP * typical).astype(float))


def _noise(values: Array) -> Array:
    """Standard deviation of white noise on each column, (T, n); zero where none shows."""
    return np.broadcast_to(white_noise(values), values.shape)
