"""From a log to the regression: rows of the equations of motion, at samples or over windows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deltac.diagnosis.equations import Evaluator, Sampled
from deltac.diagnosis.explanation.causes import candidates
from deltac.diagnosis.explanation.columns import (
    UNIT_MOMENTS,
    Column,
    ColumnKernels,
    column_kernels,
    evaluate,
)
from deltac.diagnosis.explanation.regression import Regression, factored
from deltac.diagnosis.resolution import resolution
from deltac.dynamics.spatial import SX, Inertia
from deltac.errors import InputError
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory
from deltac.trajectories.suspicions import gap_rows

Array: TypeAlias = NDArray[np.float64]
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


def prepare(
    mechanism: Mechanism, run: Trajectory, form: Form, *, sliding: bool = False
) -> Prepared:
    """The regression of a run's residual on all columns of the mechanism.

    With `sliding`, equations of joints are left out where those hardly move.

    Raises InputError for a log of too few rows.
    """
    if len(run) < LEAST_ROWS:
        raise InputError(
            f"the log has {len(run)} samples; an explanation needs {LEAST_ROWS} at least, and many more to "
            "tell causes apart: log a longer or a finer run"
        )
    evaluator = Evaluator(mechanism, run)
    kernels = column_kernels(evaluator)
    rows = _Rows(kernels, form)
    stretches = _stretches(run, evaluator, kernels, form)
    whole = np.concatenate([rows(s) for s in stretches])
    scale = _scale(whole, kernels)
    digits = _digits(kernels, form, stretches)
    shaken = _shaken(rows, stretches)
    noise = np.sqrt(np.mean(shaken[..., 0] ** 2, axis=0))
    if form == "weak":
        digits = np.hypot(digits, _quadrature(rows, whole[..., 0], stretches))
    weight = 1.0 / np.maximum(np.maximum(noise, NOISY * scale), 1e-300)
    moving = _moving(rows, stretches) if sliding else np.ones(whole.shape[:2])
    matrix = _arranged(whole * (weight * moving)[..., None])
    count = min(BLOCKS, max(2, len(matrix) // 8))
    blocks = [b.reshape(-1, matrix.shape[2]) for b in np.array_split(matrix, count)]
    shaken = _arranged(shaken * weight[:, None])
    share = float(moving.mean()) * len(matrix) / len(shaken)
    precise = np.sum(((4.0 * digits + LEAST[form] * scale) * weight) ** 2)
    regression = Regression(
        factored(blocks),
        candidates(evaluator, kernels.columns),
        int(moving.sum()),
        factored([shaken.reshape(-1, matrix.shape[2])])[0] * np.sqrt(share),
        float(len(matrix) * precise),
        _weights(kernels.columns),
    )
    free = [mechanism.speeds[int(k)].name for k in mechanism.free.u]
    residual = np.sqrt(np.mean(whole[..., 0] ** 2, axis=0))
    return Prepared(
        regression, kernels, form, tuple(free), scale, residual, noise,
        sum(len(s.samples.t) for s in stretches), 1.01 * float(np.median(np.diff(run.t))), sliding,
    )  # fmt: skip


def _weights(columns: Sequence[Column]) -> dict[int, int]:
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
        raise InputError(
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
    for name in run.provenance.notes.get("held", "").split(";"):
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
    """∫ φ f − φ̇ m dt over windows, by trapezoids; ∫φ dt = 1."""
    half, centres = _centres(len(t))
    made = np.empty((len(centres), *force.shape[1:]))
    for k, c in enumerate(centres):
        rows = slice(c - half, c + half + 1, stride)
        start, end = t[c - half], t[c + half]
        s = (2.0 * t[rows] - start - end) / (end - start)
        phi = (1.0 - s**2) ** POWER
        slope = -2.0 * POWER * s * (1.0 - s**2) ** (POWER - 1) * 2.0 / (end - start)
        dt = np.gradient(t[rows])
        dt[[0, -1]] *= 0.5
        whole = float(np.sum(phi * dt))
        made[k] = np.einsum("t,tij->ij", phi * dt / whole, force[rows])
        made[k] -= np.einsum("t,tij->ij", slope * dt / whole, momentum[rows])
    return made


def _scale(whole: Array, kernels: ColumnKernels) -> Array:
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
WHITE = (0.75, 1.35)
"""Ratio of noise by eighth differences to that by sixth between which what is seen is white noise."""


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


def _arranged(values: Array) -> Array:
    """[r X] as [X r]."""
    return np.concatenate([values[..., 1:], values[..., :1]], axis=2)


def _moving(rows: _Rows, stretches: Sequence[_Stretch]) -> Array:
    """1 where a joint moves, 0 where it hardly does (rows, n)."""
    u = np.concatenate([rows.slowest(s) for s in stretches])
    typical = np.sqrt(np.mean(u**2, axis=0))
    return np.asarray((u > SLIP * typical).astype(float))


def _noise(values: Array) -> Array:
    """Standard deviation of white noise on each column, (T, n); zero where none shows."""
    made = np.zeros_like(values)
    for k, column in enumerate(values.T):
        made[:, k] = white_noise(column)
    return made


def white_noise(x: Array) -> float:
    """Standard deviation of white noise on samples of a smooth signal, by its high differences.

    Differences of order 2m of white noise have √C(4m, 2m) times its deviation; those of a smooth signal
    fall from one order to the next. What falls is taken for signal.
    """
    if len(x) < 16:
        return 0.0
    sixth = 1.4826 * float(np.median(np.abs(np.diff(x, 6)))) / np.sqrt(924.0)
    eighth = 1.4826 * float(np.median(np.abs(np.diff(x, 8)))) / np.sqrt(12870.0)
    if sixth <= 0.0 or not WHITE[0] < eighth / sixth < WHITE[1]:
        return 0.0
    return float(eighth)
