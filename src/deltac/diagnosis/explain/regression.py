"""The regression: residual + Σ θ x = 0 by least squares, kept as triangular factors of blocks in time.

[X r] of each block of consecutive rows is reduced by QR to as many rows as it has columns. All that
follows (fits, their errors, their comparison) needs no more than that, however long the log.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import accumulate
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
)
from deltac.diagnosis.measurements.digits import resolution, white_noise
from deltac.diagnosis.residuals.at_samples import Evaluator, Sampled
from deltac.diagnosis.residuals.defect import Residual
from deltac.diagnosis.residuals.rows import Rows
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
        steps: [X r] row by row, and half of what X changes over a step (rows, P); None at samples.
    """

    blocks: Array
    candidates: tuple[Candidate, ...]
    rows: int
    shaken: Array
    precision: float
    weights: Mapping[int, int] = field(default_factory=dict)
    blur: Array | None = None
    steps: tuple[Array, Array] | None = None

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
        c = self.coefficients(fit)
        return float(np.sum((self.shaken[:, :-1] @ c + self.shaken[:, -1]) ** 2))

    def floor(self, fit: Fit) -> float:
        """The part of what a fit leaves that is no mistake."""
        return self.precision + self.noise(fit)

    def blurred(self, fit: Fit) -> float:
        """The part of what a fit leaves that may be of columns known only so far."""
        if self.blur is None:
            return 0.0
        return float(np.sum((self.blur[:, :-1] @ self.coefficients(fit)) ** 2))

    def left(self, fit: Fit) -> float:
        """What a fit leaves, whenever within a step the integrator took its causes.

        The columns are means of both ends of a step, Euler's methods take one end.
        """
        if self.steps is None:
            return fit.left
        rows, change = self.steps
        c, J = self._at(fit)
        e, late = rows[:, :-1] @ c + rows[:, -1], change @ c
        Q = np.linalg.qr(rows[:, :-1] @ J)[0]
        late = late - Q @ (Q.T @ late)  # the fit's numbers follow
        theta = np.clip(-(late @ e) / max(float(late @ late), 1e-300), -1.0, 1.0)
        return float(np.sum((e + theta * late) ** 2))

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
        edges = _edges(parts)
        theta = np.zeros(edges[-1])
        heavier = len(parts) > 1 and any(c.kind == "gravity" for c in parts)
        curved = heavier or _products(parts) or any(c.quadratic is not None for c in parts)
        for _ in range(STEPS if curved else 1):
            c, J = self._linearised(chosen, theta)
            e = self.R[:, :-1] @ c + self.R[:, -1]
            step = np.linalg.lstsq(self.R[:, :-1] @ J, -e, rcond=1e-11)[0]
            theta = theta + step
            if np.linalg.norm(step) <= 1e-12 * np.linalg.norm(theta):
                break
        c, _ = self._linearised(chosen, theta)
        left = float(np.sum((self.R[:, :-1] @ c + self.R[:, -1]) ** 2))
        return Fit(tuple(chosen), tuple(np.split(theta, edges[1:-1])) if parts else (), left)

    def _linearised(self, chosen: Sequence[int], theta: Array) -> tuple[Array, Array]:
        """Coefficients (P,) of all columns and their derivatives (P, d)."""
        parts = [self.candidates[k] for k in chosen]
        edges = _edges(parts)
        width = self.R.shape[1] - 1
        c, J = np.zeros(width), np.zeros((width, len(theta)))
        for part, a, b in zip(parts, edges[:-1], edges[1:]):
            np.add.at(c, list(part.columns), part.coefficients(theta[a:b]))
            np.add.at(J[:, a:b], list(part.columns), part.tangent(theta[a:b]))
        for i, k, per in _products(parts):  # what is heavier and moved is more than both
            place, start, end = edges[i], edges[k], edges[k + 1]
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

    def _at(self, fit: Fit) -> tuple[Array, Array]:
        return self._linearised(fit.chosen, np.concatenate([*fit.theta, np.zeros(0)]))

    def tangents(self, fit: Fit) -> tuple[Array, Array]:
        """R times the derivatives of a fit's coefficients (P + 1, d), and what it leaves (P + 1,)."""
        c, J = self._at(fit)
        return self.R[:, :-1] @ J, self.R[:, :-1] @ c + self.R[:, -1]

    def coefficients(self, fit: Fit) -> Array:
        """Coefficients (P,) of all columns."""
        return self._at(fit)[0]

    def left_by_block(self, fit: Fit) -> Array:
        """What a fit leaves of the squares of each block (B,)."""
        c = self.coefficients(fit)
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


def _edges(parts: Sequence[Candidate]) -> list[int]:
    """Where the numbers of each cause begin among those of all, and their end."""
    return [0, *accumulate(c.size for c in parts)]


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

Form = Literal["samples", "steps"]

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
LEAST = 1e-7
"""Share of the terms of the equations below which a residual needs no cause: solvers of constraints stop."""


@dataclass(frozen=True, eq=False)
class Prepared:
    """A regression, and the scales of its equations.

    form        at "samples", with measured accelerations, or over "steps" from row to row
    scale       typical size of the terms of each equation (n,), N or N·m
    residual    root mean square of what the model leaves of each (n,)
    noise       root mean square of what the log's noise makes of each (n,)
    columns     what one unit of each column makes of the equations (rows, n, P)
    u           speeds (rows, n); time: of the log (s)
    spacing     of the log's rows (s)
    sliding     whether what joints do that hardly move was left out
    """

    regression: Regression
    kernels: ColumnKernels
    form: Form
    scale: Array
    residual: Array
    noise: Array
    columns: Array
    u: Array
    time: float
    spacing: float
    sliding: bool

    @property
    def samples(self) -> int:
        """How many rows were looked at."""
        return len(self.u)

    @property
    def mechanism(self) -> Mechanism:
        """The model."""
        return self.kernels.evaluator.mechanism

    def effect(self, fit: Fit) -> tuple[Array, float]:
        """Root mean square of the generalized forces that a fit's causes make (n,), and their energy (J)."""
        force = self.columns @ self.regression.coefficients(fit)
        power = np.sum(self.u * force, axis=1)
        return np.sqrt(np.mean(force**2, axis=0)), abs(float(np.mean(power))) * self.time


def prepare(
    mechanism: Mechanism,
    run: Trajectory,
    left: Residual | None = None,
    *,
    sliding: bool = False,
    stops_in: Mapping[int, tuple[float, float]] | None = None,
) -> Prepared:
    """The regression of a run's residual on all columns of the mechanism.

    Without `left` the residual is that of the equations at the samples, with their accelerations; else it is
    what they leave from row to row, weighed by its error bars. With `sliding`, equations of joints are left
    out where those hardly move. `stops_in`: between which values of a coordinate stops are looked for, if not
    all over the log.

    Raises InputError for a log of too few rows.
    """
    if len(run) < LEAST_ROWS:
        raise too_short(run)
    evaluator = Evaluator(mechanism, run)
    for place, between in (stops_in or {}).items():
        for end, value in zip(evaluator.reach, between):
            end[place] = value
    kernels = column_kernels(evaluator)
    if left is None:
        return _at_samples(kernels, run, sliding)
    return _over_steps(kernels, run, left, sliding)


def too_short(run: Trajectory) -> LogError:
    """Says that a log has not enough consecutive samples."""
    return LogError(
        f"the log has {len(run)} samples; an explanation needs {LEAST_ROWS} consecutive ones at least, and "
        "many more to tell causes apart: log a longer or a finer run, without gaps"
    )


def _over_steps(kernels: ColumnKernels, run: Trajectory, left: Residual, sliding: bool) -> Prepared:
    """The regression of what the one-step test leaves.

    What an integrator may leave needs no cause: along its columns the equations are divided by what these
    amount to, with coefficients of one at most, and a noise of one error bar in each equation. Small columns
    take off nothing: else the step times a damping would take off the inertia itself, which it is
    proportional to.
    """
    width = kernels.speeds * (1 + len(kernels.columns))
    intervals = left.intervals.few(max(300, MOST_NUMBERS // width))

    def columns(rows: Rows, udot: Array, k: NDArray[np.intp], F: Array) -> Array:
        rate, curve = _rates(rows.t, rows.F)
        return kernels(rows.t[k], rows.q[k], rows.u[k], udot[k], F, rate[k], curve[k])[..., 1:]

    (whole, change), residual = intervals.made_by(columns), -intervals.defects
    matrix = np.concatenate([whole, residual[..., None], change], axis=2)
    weight = 1.0 / np.hypot(left.bar, LEAST * left.scale)
    moving = _where_it_moves(intervals.slowest, sliding)
    counts = (weight * moving)[..., None]
    flat, scheme = (
        x.reshape(x.shape[0] * x.shape[1], x.shape[2])
        for x in (matrix * counts, intervals.scheme * counts)
    )
    U, size, _ = np.linalg.svd(scheme, full_matrices=False)
    kept = 1.0 / np.sqrt(1.0 + size**2)
    flat = flat - U @ ((1.0 - kept)[:, None] * (U.T @ flat))
    count = len(kernels.columns) + 1
    # White noise is known by its size: what no cause explains, and nothing predicts.
    noise = left.bars["noise"] * weight
    shaken = np.append(np.zeros(count - 1), np.sqrt(len(whole) * np.sum(noise**2)))
    return regression_of(
        kernels, run, flat[:, :count].reshape(*moving.shape, count), whole, intervals.u, residual,
        left.bars["noise"], left.scale, float(np.sum(1.0 - noise**2)), shaken[None], moving, sliding,
        steps=(flat[:, :count], flat[:, count:]),
    )  # fmt: skip


def _at_samples(kernels: ColumnKernels, run: Trajectory, sliding: bool) -> Prepared:
    """The regression of what the equations leave at the samples."""
    stretches = _stretches(run, kernels)
    whole = np.concatenate([kernels(*s.columns) for s in stretches])
    scale = terms_of(whole, kernels)
    some = stretches[:: max(1, len(stretches) // 4)]
    digits = _digits(kernels, some)
    shaken = _moved(kernels, some, _noise, np.random.default_rng(1))
    noise = np.sqrt(np.mean(shaken[..., 0] ** 2, axis=0))
    weight = 1.0 / np.maximum(np.maximum(noise, NOISY * scale), 1e-300)
    u = np.concatenate([s.samples.u for s in stretches])
    moving = _where_it_moves(np.abs(u), sliding)
    matrix = arranged(whole * (weight * moving)[..., None])
    precise = float(np.sum(((4.0 * digits + LEAST * scale) * weight) ** 2))
    shaken = arranged(shaken * weight[:, None]).reshape(-1, matrix.shape[2])
    shaken *= np.sqrt(float(np.sum(moving)) / float(len(shaken)))
    return regression_of(
        kernels, run, matrix, whole[..., 1:], u, whole[..., 0], noise, scale, precise, shaken, moving,
        sliding,
    )  # fmt: skip


def regression_of(
    kernels: ColumnKernels,
    run: Trajectory,
    matrix: Array,
    columns: Array,
    u: Array,
    residual: Array,
    noise: Array,
    scale: Array,
    precise: float,
    shaken: Array,
    moving: Array,
    sliding: bool = False,
    steps: tuple[Array, Array] | None = None,
    blur: Array | None = None,
) -> Prepared:
    """The regression of weighted equations [X r] (rows, n, P + 1), of which `shaken` is noise.

    `precise` is the sum of squares of what digits and rounding leave of one row; `moving` (rows, n) tells
    which equations count; `steps` and `blur` are those of `Regression`, the rest of `Prepared`.
    """
    width = matrix.shape[2]
    count = min(BLOCKS, max(2, len(matrix) // 8))
    blocks = [b.reshape(-1, width) for b in np.array_split(matrix, count)]
    regression = Regression(
        factored(blocks),
        candidates(kernels.evaluator, kernels.columns),
        int(moving.sum()),
        factored([shaken])[0],
        len(matrix) * precise,
        weights_of(kernels.columns),
        blur,
        steps,
    )
    return Prepared(
        regression, kernels, "samples" if steps is None else "steps", scale,
        np.sqrt(np.mean(residual**2, axis=0)), noise, columns, u, float(np.ptp(run.t)),
        1.01 * float(np.median(np.diff(run.t))), sliding,
    )  # fmt: skip


def _where_it_moves(speeds: Array, sliding: bool) -> Array:
    """1 where a joint moves, 0 where it hardly does (rows, n); with `sliding` only."""
    if not sliding:
        return np.ones(speeds.shape)
    typical = np.sqrt(np.mean(speeds**2, axis=0))
    return np.asarray((speeds > SLIP * typical).astype(float))


def _rates(t: Array, forces: Array) -> tuple[Array, Array]:
    """First and second rates of logged forces (T, m)."""
    if not forces.shape[1]:
        return forces, forces
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(t, forces)
    return spline(t, 1), spline(t, 2)


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
        return _Stretch(samples, *_rates(samples.t, samples.logged))

    @property
    def columns(self) -> list[Array]:
        s = self.samples
        return [*s.columns, self.rate, self.curve]


def _stretches(run: Trajectory, kernels: ColumnKernels) -> list[_Stretch]:
    """The log between its gaps, or parts of it where it is long."""
    evaluator = kernels.evaluator
    everything = Sampled.of(evaluator.mechanism, run, evaluator.log)
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
        raise too_short(run)
    return [_Stretch.of(everything.take(p)) for p in kept]


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


PERTURBATIONS = 2


def _moved(
    kernels: ColumnKernels,
    stretches: Sequence[_Stretch],
    size: Callable[[Array], Array],
    rng: np.random.Generator,
) -> Array:
    """How residual and columns change (rows, n, 1 + P) as every number moves at random by its size."""
    changes = []
    for stretch in stretches:
        moved = {}
        for name in ("q", "u", "udot", "logged"):
            values = getattr(stretch.samples, name)
            moved[name] = values + rng.standard_normal(values.shape) * size(values)
        there = replace(stretch, samples=replace(stretch.samples, **moved))
        changes.append(kernels(*there.columns) - kernels(*stretch.columns))
    return np.concatenate(changes)


def _digits(kernels: ColumnKernels, stretches: Sequence[_Stretch]) -> Array:
    """Root mean square (n,) of what the log's digits make of the residual."""
    rng = np.random.default_rng(0)
    each = [s for s in stretches for _ in range(PERTURBATIONS)]
    changes = _moved(kernels.residual_only, each, lambda x: resolution(x) / np.sqrt(3.0), rng)
    return np.asarray(np.sqrt(np.mean(changes[..., 0] ** 2, axis=0)))


def arranged(values: Array) -> Array:
    """[r X] as [X r]."""
    return np.concatenate([values[..., 1:], values[..., :1]], axis=2)


def _noise(values: Array) -> Array:
    """Standard deviation of white noise on each column, (T, n); zero where none shows."""
    return np.broadcast_to(white_noise(values), values.shape)
