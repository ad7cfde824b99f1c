"""A log as observations: stretches of consecutive rows, the noise of each number, the steps between rows."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import EPS, ROUNDED, Array
from deltac.diagnosis.inference.integrators import WHOLE, step_of, steps_between
from deltac.diagnosis.inference.model import Intervals, LogModel, Rows
from deltac.diagnosis.inference.whitening import Innovations
from deltac.diagnosis.measurements.digits import digits_of, white_noise
from deltac.diagnosis.measurements.kinematics import SHORTEST_PART, stretches
from deltac.trajectories import Trajectory


@dataclass(frozen=True, eq=False)
class Observations:
    """Intervals between consecutive rows of a log, and what is known of their numbers.

    pieces       first and last + 1 of the intervals of each stretch; `rows` the same of the rows of the log
    noise        standard deviations (N, 2n) of the rows at the starts and at the ends of the intervals
    digits       what of that comes from their digits
    of_forces    standard deviations (N, m) of the forces by their digits, and by noise that may be on them
    unknown      components of the state that the log does not have: speeds made of coordinates (2n,)
    beyond       the rows less the states at the starts and ends of the intervals, (N, 2n): none at first
    duration     of the whole log, s
    step         of the integrator, s
    counts       its steps (N,) in each interval; None where these are not whole
    """

    intervals: Intervals
    pieces: list[tuple[int, int]]
    rows: list[tuple[int, int]]
    noise: tuple[Array, Array]
    digits: tuple[Array, Array]
    of_forces: tuple[Array, Array]
    unknown: NDArray[np.bool_]
    beyond: tuple[Array, Array]
    duration: float
    step: float
    counts: NDArray[np.intp] | None

    @property
    def whole(self) -> float:
        """Time of the whole log over that of the intervals."""
        return self.duration / float(self.intervals.h.sum())

    @property
    def thinned(self) -> NDArray[np.bool_]:
        """Intervals (N,) that are longer than a step."""
        return np.asarray(self.intervals.h[:, 0] > EVERY_STEP * self.step)

    @property
    def steps(self) -> Array:
        """The integrator's step (N, 1) in each interval, s."""
        h = self.intervals.h
        if self.counts is None or np.ptp(h) <= WHOLE * self.step:
            return np.asarray(np.minimum(self.step, h))
        return np.asarray(h / self.counts[:, None])

    @property
    def noise_of_steps(self) -> Array:
        """Noise (N, 2n) of the rows at the ends where known steps make them: two coordinates make a speed."""
        own = self.noise[1]
        of_q = own[:, : own.shape[1] // 2]
        made = np.concatenate([of_q, np.sqrt(2.0) * of_q / self.intervals.h], axis=1)
        return np.where(self.unknown, made, own)

    def errors(self, model: LogModel, end: Rows, Phi: Array) -> Array:
        """Prediction errors (N, 2n) by the ends of a flow, or of a method's map, with its derivatives Φ.

        What the rows are beyond the states at which the flow is taken adds to them.
        """
        w = model.difference(end, self.intervals.end)
        if not self.unknown.any():
            return w
        return np.asarray(w + (self.beyond[1] - np.einsum("kij,kj->ki", Phi, self.beyond[0])))

    def innovations(self, Phi: Array, Q: Array) -> Innovations:
        """The whitener of prediction errors with these transition matrices and process noise."""
        return Innovations(self.pieces, Phi, self.noise, Q, not self.unknown.any())

    def at(self, model: LogModel, errors: tuple[Array, Array]) -> Observations:
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
        noise, digits, beyond, of_forces = (
            (x[0][kept], x[1][kept]) for x in (self.noise, self.digits, self.beyond, self.of_forces)
        )
        return replace(
            self,
            intervals=self.intervals.take(kept),
            pieces=pieces,
            rows=edges,
            noise=noise,
            digits=digits,
            of_forces=of_forces,
            beyond=beyond,
            counts=None if self.counts is None else self.counts[kept],
        )

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
        noise = np.maximum(noise, FINEST * np.median(np.abs(w), axis=0))
        start, end = (np.maximum(d, noise) for d in self.digits)
        return replace(self, noise=(start, end))


EVERY_STEP = 1.01
"""Rows further apart than so many steps of the integrator are not all of its steps."""

FINEST = 1e-6
"""Least noise of a column as a share of the median of its prediction errors: what is finer is not needed, and
covariances keep their digits."""


def observations(model: LogModel, run: Trajectory, most: int) -> Observations | None:
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
    nothing, channels = [np.zeros((len(chosen), 0))], list(model.log.values(run))
    halves = nothing + [digits[f"force {n}"].half(chosen) / np.sqrt(3.0) for n in channels]
    white = nothing + [
        np.broadcast_to(digits[f"force {n}"].noise, x.shape)
        for n, x in zip(channels, halves[1:], strict=True)
    ]
    ends = np.cumsum([0, *(b - a - 1 for a, b in edges)]).tolist()
    both = noise[starts], noise[starts + 1]
    intervals = Intervals(
        all_rows.take(starts), all_rows.take(starts + 1), model.stages(run, chosen[starts])
    )
    declared = run.provenance.step
    step = min(declared or step_of(intervals.h), float(np.median(intervals.h)))
    return Observations(
        intervals=intervals,
        pieces=list(zip(ends, ends[1:], strict=False)),
        rows=edges,
        noise=both,
        digits=both,
        of_forces=(np.concatenate(halves, axis=1)[starts], np.concatenate(white, axis=1)[starts]),
        unknown=np.repeat([False, derived], model.n),
        beyond=(np.zeros_like(both[0]), np.zeros_like(both[0])),
        duration=float(run.t[-1] - run.t[0]),
        step=step,
        counts=steps_between(intervals.h, declared and step),
    )


def _alike(values: Array, chosen: NDArray[np.intp], half: Array) -> Array:
    """How many rows share the rounding of the chosen ones: a number stays within its last digit in them.

    White noise of the variance times that has the spectrum of such errors where it is slow. `half` of the
    last digits and the result are of the chosen rows.
    """
    shared = np.ones_like(half)
    coarse = half > ROUNDED * np.abs(values[chosen])
    for k in np.flatnonzero(coarse.any(axis=0)):
        changes = np.diff(values[:, k]) != 0.0
        runs = np.diff(np.flatnonzero(np.concatenate([[True], changes, [True]])))
        shared[:, k] = np.where(coarse[:, k], np.repeat(runs, runs)[chosen], 1.0)
    return shared


LEAST_INTERVALS = 4
"""Intervals from which on anything is inferred."""

LONG_STRETCHES = 4
"""Stretches of a long log: slow fields show in long ones."""


def _evenly(edges: list[tuple[int, int]], most: int, total: int) -> list[tuple[int, int]]:
    """Stretches with so many rows in all, taken from those of a log in proportion to their lengths.

    The first and the last are at its ends: what it does between stretches follows from both sides.
    """
    chosen = list[tuple[int, int]]()
    for k, (a, b) in enumerate(edges):
        share = max(SHORTEST_PART, int(most * (b - a) / total))
        parts = max(1, min(LONG_STRETCHES // len(edges), share // SHORTEST_PART))
        size = min(share // parts, b - a)
        places = np.linspace(0.0, 1.0, parts) if parts > 1 else [k / max(len(edges) - 1, 1)]
        chosen += [
            (a + int(x * (b - a - size)), a + int(x * (b - a - size)) + size) for x in places
        ]
    while sum(b - a for a, b in chosen) > 1.2 * most and len(chosen) > 2:
        some = np.linspace(0, len(chosen) - 1, len(chosen) // 2).astype(int)
        chosen = [chosen[j] for j in some.tolist()]
    return chosen


def _unknown_speeds(run: Trajectory, which: NDArray[np.intp]) -> Array:
    """Standard deviations (T, n) of speeds that were made of the coordinates: the change over a row."""
    rate = np.gradient(run.u[:, which], axis=0)
    return np.broadcast_to(np.sqrt(np.mean(rate**2, axis=0)) + EPS, rate.shape)
