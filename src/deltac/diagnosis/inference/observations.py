"""A log as observations: stretches of consecutive rows, the noise of each number, forces between rows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import factorial

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import EPS, Array
from deltac.diagnosis.inference.flow import Prediction
from deltac.diagnosis.inference.forces import FORCES, LoggedForce
from deltac.diagnosis.inference.model import Intervals, Model, Rows
from deltac.diagnosis.inference.whitening import Innovations
from deltac.diagnosis.measurements.digits import digits_of, white_noise
from deltac.diagnosis.measurements.kinematics import stretches
from deltac.trajectories import Trajectory


@dataclass(frozen=True, eq=False)
class Observations:
    """Intervals between consecutive rows of a log, and what is known of their numbers.

    pieces       first and last + 1 of the intervals of each stretch; `rows` the same of the rows of the log
    noise        standard deviations (N, 2n) of the rows at the starts and at the ends of the intervals
    digits       what of that comes from their digits
    force_noise  of the forces (N, m)
    unknown      components of the state that the log does not have: speeds made of coordinates (2n,)
    beyond       the rows less the states at the starts and ends of the intervals, (N, 2n): none at first
    """

    intervals: Intervals
    pieces: list[tuple[int, int]]
    rows: list[tuple[int, int]]
    noise: tuple[Array, Array]
    digits: tuple[Array, Array]
    force_noise: Array
    unknown: NDArray[np.bool_]
    beyond: tuple[Array, Array]

    def shift(self, Phi: Array) -> Array:
        """What the rows beyond the states at which the flow is taken add to prediction errors (N, 2n)."""
        return np.asarray(self.beyond[1] - np.einsum("kij,kj->ki", Phi, self.beyond[0]))

    def innovations(self, Phi: Array, Q: Array) -> Innovations:
        """The whitener of prediction errors with these transition matrices and process noise."""
        return Innovations(self.pieces, Phi, self.noise, Q, not self.unknown.any())

    def at(self, model: Model, errors: tuple[Array, Array]) -> Observations:
        """With the flow taken at the states that rows with such errors (N, 2n) are of."""
        change = [e - b for e, b in zip(errors, self.beyond, strict=True)]
        ends = self.intervals.start, self.intervals.end
        start, end = (model.displaced(at, -x) for at, x in zip(ends, change, strict=True))
        intervals = replace(self.intervals, start=start, end=end)
        # What was made of coordinates is off by as much as that.
        off = np.sqrt(np.mean(errors[1] ** 2, axis=0))
        first, last = (np.where(self.unknown, off, x) for x in self.noise)
        return replace(self, intervals=intervals, beyond=errors, noise=(first, last))

    def without(self, lost: NDArray[np.bool_]) -> Observations:
        """Without some of the intervals; stretches are cut there."""
        kept = np.flatnonzero(~lost)
        pieces, at = [], 0
        for first, last in self.pieces:
            cuts = np.flatnonzero(np.diff(np.concatenate([[1], lost[first:last], [1]]).astype(int)))
            for a, b in zip(cuts[::2], cuts[1::2], strict=True):
                pieces.append((at, at + int(b - a)))
                at += int(b - a)
        starts = [np.arange(a, b - 1) for a, b in self.rows]
        rows = np.concatenate(starts)[kept]
        edges = [(int(rows[a]), int(rows[b - 1]) + 2) for a, b in pieces]
        noise, digits, beyond = (
            (x[0][kept], x[1][kept]) for x in (self.noise, self.digits, self.beyond)
        )
        return Observations(
            self.intervals.take(kept), pieces, edges, noise, digits, self.force_noise[kept],
            self.unknown, beyond,
        )  # fmt: skip

    def running(self, x: Array) -> Array:
        """Running sums (N, …) of what each interval adds, x; gaps add by the mean rates on both sides."""
        sums = np.cumsum(x, axis=0)
        for first, gap, before, after in self._gaps(x):
            sums[first:] += 0.5 * gap * (before + after)
        return np.asarray(sums)

    def in_gaps(self, x: Array) -> Array:
        """Standard error (N,) of running sums by the gaps, of which rates differ on both sides."""
        variance = np.zeros(len(x))
        for first, gap, before, after in self._gaps(x):
            variance[first:] += (0.5 * gap * (before - after)) ** 2
        return np.sqrt(variance)

    def _gaps(self, x: Array) -> Iterator[tuple[int, float, Array, Array]]:
        """The first interval after each gap, its length (s), and mean rates of x before and after it.

        These are of times as long as the gap, or the shorter stretch: a rate linear in time is exact.
        """
        start, end = self.intervals.start.t, self.intervals.end.t
        for (a, last), (first, b) in zip(self.pieces, self.pieces[1:], strict=False):
            left, right = float(end[last - 1]), float(start[first])
            length = min(right - left, left - start[a], end[b - 1] - right) + 1e-9 * (right - left)
            i = a + int(np.searchsorted(start[a:last], left - length))
            j = first + int(np.searchsorted(end[first:b], right + length, "right"))
            i, j = min(i, last - 1), max(j, first + 1)
            before = x[i:last].sum(axis=0) / (left - start[i])
            after = x[first:j].sum(axis=0) / (end[j - 1] - right)
            yield first, right - left, before, after

    @property
    def rounding(self) -> float:
        """Least variance that whitened prediction errors have from the digits of the rows."""
        shares = np.mean((self.digits[1] / self.noise[1]) ** 2, axis=0)[~self.unknown]
        return float(shares.min(initial=1.0))

    def with_noise(self, w: Array) -> Observations:
        """With the white noise that prediction errors w (N, 2n) show beside the digits.

        Summed up they are the noise of the rows beside what is smooth, w_k ≈ e_{k+1} − e_k, however unevenly
        or coarsely the motion is sampled.
        """
        first, last = max(self.pieces, key=lambda piece: piece[1] - piece[0])
        noise = white_noise(np.cumsum(w[first:last], axis=0))
        noise = np.maximum(noise, FINEST * np.sqrt(np.mean(w**2, axis=0)))
        return replace(self, noise=tuple(np.maximum(d, noise) for d in self.digits))


FINEST = 1e-6
"""Least noise of a column as a share of its prediction errors: what is finer is not needed, and covariances
keep their digits."""


def observations(model: Model, run: Trajectory, most: int) -> Observations | None:
    """Stretches of at most so many rows, evenly over the log; None for too short a log."""
    edges = stretches(run)
    total = sum(b - a for a, b in edges)
    if total > most:
        edges = _evenly(edges, most, total)
    if sum(b - a - 1 for a, b in edges) < LEAST_INTERVALS:
        return None
    # Of a long log only what the stretches take is looked at; `starts` are places among the chosen rows.
    chosen = np.concatenate([np.arange(a, b) for a, b in edges])
    places = np.cumsum([0, *(b - a for a, b in edges)])
    starts = np.concatenate([np.arange(a, b - 1) for a, b in zip(places, places[1:], strict=False)])
    all_rows, digits = model.rows(run.take(chosen)), digits_of(run)

    def deviations(of: str) -> Array:
        # Uniform within a digit; a double that was computed is off by some of its last.
        values = run.q if of == "q" else run.u
        size = np.maximum(values.max(axis=0, initial=0.0), -values.min(axis=0, initial=0.0))
        half = digits[of].half(chosen)
        variance = half**2 / 3.0 * _alike(values, chosen, half)
        return np.asarray(np.sqrt(variance + (4.0 * EPS * (1.0 + size)) ** 2))

    of_q, of_u = deviations("q")[:, model.of_q], deviations("u")[:, model.of_u]
    along = np.zeros_like(of_u)
    for i, j in model.rates:
        along[:, j] = of_q[:, i]
    for i, j in model.quaternions:
        along[:, j : j + 3] = 2.0 * of_q[:, i : i + 4].mean(axis=1, keepdims=True)
    noise = np.concatenate([along, of_u], axis=1)
    derived = "u" in run.provenance.derived
    if derived:
        noise[:, model.n :] = _unknown_speeds(run, model.of_u)[chosen]
    of_F = [np.zeros((len(chosen), 0))] + [
        np.sqrt(digits[f"force {n}"].half(chosen) ** 2 / 3.0 + digits[f"force {n}"].noise ** 2)
        for n in model.log.values(run)
    ]
    ends = np.cumsum([0, *(b - a - 1 for a, b in edges)]).tolist()
    both = noise[starts], noise[starts + 1]
    return Observations(
        Intervals(
            all_rows.take(starts), all_rows.take(starts + 1), model.stages(run, chosen[starts])
        ),
        list(zip(ends, ends[1:], strict=False)),
        edges,
        both,
        both,
        np.concatenate(of_F, axis=1)[starts],
        np.repeat([False, derived], model.n),
        (np.zeros_like(both[0]), np.zeros_like(both[0])),
    )


def _alike(values: Array, chosen: NDArray[np.intp], half: Array) -> Array:
    """How many rows share the rounding of the chosen ones: a number stays within its last digit in them.

    White noise of the variance times that has the spectrum of such errors where it is slow. `half` of the
    last digits and the result are of the chosen rows.
    """
    shared = np.ones_like(half)
    coarse = half > COARSE * np.abs(values[chosen])
    for k in np.flatnonzero(coarse.any(axis=0)):
        changes = np.diff(values[:, k]) != 0.0
        runs = np.diff(np.flatnonzero(np.concatenate([[True], changes, [True]])))
        shared[:, k] = np.where(coarse[:, k], np.repeat(runs, runs)[chosen], 1.0)
    return shared


COARSE = 1e-12
"""Half of a last digit, as a share of the number, from which on it is one that was rounded."""

LEAST_INTERVALS = 4
"""Intervals from which on anything is inferred."""

SHORTEST = 12
"""Rows of a stretch at least."""

STRETCHES = 4
"""Stretches of a long log: slow fields show in long ones."""


def _evenly(edges: list[tuple[int, int]], most: int, total: int) -> list[tuple[int, int]]:
    """Stretches with so many rows in all, taken from those of a log in proportion to their lengths."""
    chosen = list[tuple[int, int]]()
    for a, b in edges:
        share = max(SHORTEST, int(most * (b - a) / total))
        parts = max(1, min(STRETCHES // len(edges), share // SHORTEST))
        size = min(share // parts, b - a)
        chosen += [(int(s), int(s) + size) for s in np.linspace(a, b - size, parts).astype(int)]
    while sum(b - a for a, b in chosen) > 1.2 * most and len(chosen) > 1:
        chosen = chosen[::2]
    return chosen


def _unknown_speeds(run: Trajectory, which: NDArray[np.intp]) -> Array:
    """Standard deviations (T, n) of speeds that were made of the coordinates: the change over a row."""
    rate = np.gradient(run.u[:, which], axis=0)
    return np.broadcast_to(np.sqrt(np.mean(rate**2, axis=0)) + EPS, rate.shape)


# --- forces between rows -------------------------------------------------------------------------


def unit_responses(model: Model, at: Rows) -> Iterator[Array]:
    """What a unit of each logged force adds to the accelerations (N, n)."""
    base = model.at(at)
    for k in range(at.F.shape[1]):
        d = 1e-3 * (1.0 + np.abs(at.F[:, k]).max())
        F = at.F.copy()
        F[:, k] += d
        yield (model.acceleration(at.t, at.q, at.u, F) - base) / d


def unknown(
    model: Model,
    log: Observations,
    flow: Prediction,
    force: LoggedForce,
    kinds: Sequence[str],
    w: Array,
    thinned: NDArray[np.bool_],
) -> tuple[Array, Array, Array]:
    """Covariances (N, 2n, 2n) of what the flow does not know: own, between rows, across constraints.

    Its own error, with digits and noise of logged forces; across constraints, what a solver does to keep
    them. In intervals of which a step is lost (`thinned`, N) a force may have taken any way from one row to
    the next: by its change, uniformly. In others, one that is smooth (`kinds`) may differ from its spline.
    """
    n, h, at = model.n, log.intervals.h, flow.nodes[0]
    Q = np.zeros((len(h), 2 * n, 2 * n))
    diagonal = np.arange(2 * n)
    Q[:, diagonal, diagonal] = flow.error**2
    coarse = np.any(log.force_noise > 1e-12 * np.abs(at.F).max(axis=0, initial=1e-300), axis=0)
    smooth = np.array([FORCES[kind][2] > 0.0 for kind in kinds], dtype=bool)
    doubt = np.where(smooth, force.doubt, 0.0)
    some = coarse.any() or thinned.any() or doubt.any()
    own, moves = list[Array](), list[Array]()
    for k, response in enumerate(unit_responses(model, at) if some else ()):
        du = response * h * log.force_noise[:, k : k + 1]
        own.append(np.concatenate([0.5 * h * du, du], axis=1))
        bends = np.abs(force.bends[0][:, k]) + np.abs(force.bends[1][:, k])
        lost = np.hypot(force.change[:, k] / np.sqrt(12.0), bends / 6.0)
        size = np.where(thinned, lost, doubt[:, k])
        if size.any():
            du = response * (h[:, 0] * size)[:, None]
            moves.append(np.concatenate([0.5 * h * du, du], axis=1))
            moves.append(np.concatenate([h * du / np.sqrt(12.0), np.zeros_like(du)], axis=1))
    Q, between = Q + _outer(own, Q), _outer(moves, Q)
    across = np.zeros_like(Q)
    if model.rows_of_G:
        M, G = model.matrices(at.t, at.q)
        directions, _ = np.linalg.qr(np.linalg.solve(M, G.transpose(0, 2, 1)))
        size = ACROSS * np.sqrt(np.mean(w**2, axis=0) + np.mean(log.noise[0] ** 2, axis=0)).max()
        across[:, :n, :n] = across[:, n:, n:] = size**2 * directions @ directions.transpose(0, 2, 1)
    return Q, between, across


def _outer(columns: Sequence[Array], like: Array) -> Array:
    """Σ x xᵀ (N, 2n, 2n) of columns x (N, 2n)."""
    if not columns:
        return np.zeros_like(like)
    X = np.stack(columns, axis=2)
    return np.asarray(X @ X.transpose(0, 2, 1))


def rates(J: Array) -> Array:
    """About the spectral radii (N, 1) of ∂f/∂x."""
    J2 = J @ J
    return np.asarray(np.linalg.norm(J2 @ J2, axis=(1, 2))[:, None] ** 0.25)


def remainder(J: Array, first: Array, h: Array, step: Array) -> Array:
    """Standard deviations (N, 2n) of what the series in the step leaves out, interval by interval.

    Along a field of first order, (N, 2n, k), terms beyond third order are to it as those of e^ρ − 1 are to ρ,
    ρ the step times the spectral radius of ∂f/∂x, and at most as large: an onset of friction or contact tells
    little.
    """
    rho = np.minimum(step * rates(J), STIFF)
    beyond = sum(rho**k / factorial(k + 1) for k in range(3, 12))
    return np.asarray(np.minimum(beyond, 1.0) * h * np.abs(first).max(axis=2))


STIFF = 3.0
"""A step times the spectral radius from which on the series says nothing."""

ACROSS = 1e3
"""How much more than the prediction errors a solver may do across the constraints: nothing is told by
these."""
