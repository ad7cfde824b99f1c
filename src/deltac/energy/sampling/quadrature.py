"""Integrals of powers along sampled motions, with an error bar (theory: the integral "on samples").

Two kinds of rules. `lagrange` goes by the powers at the samples alone: polynomials through eight of them,
of order eight, and nothing else to evaluate. `hermite` interpolates the motion between samples, through
values and rates of the nearest (two for the low order, four for the high one), and sums the power over
the Gauss–Lobatto nodes of every interval: three more evaluations each, and far smaller constants where
samples are sparse. The error is estimated by leaving out every second sample.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import accumulate

import numpy as np

from deltac.arrays import EPS, TINY, Array
from deltac.energy.sampling.interpolation import (
    Block,
    blocks,
    hermite_kernel,
    lagrange_kernel,
    window_times,
    windows_of,
)
from deltac.energy.sampling.samples import Between, Powers, Samples, at_samples
from deltac.kernels.kernel import BLOCK_STATES
from deltac.kernels.parallel import cores, spread

_INNER = float(np.sqrt(3.0 / 7.0))
INNER = (0.5 - 0.5 * _INNER, 0.5, 0.5 + 0.5 * _INNER)
INNER_WEIGHTS = (49 / 180, 32 / 90, 49 / 180)
OUTER_WEIGHT = 1 / 20
"""Gauss–Lobatto rule with five nodes on [0, 1], exact to degree 7 (Abramowitz, Stegun 25.4.32)."""

HERMITE_ORDERS = {2: 4, 4: 8}
"""Samples in a window of `hermite` -> order of the interpolation error in the spacing."""

SAMPLED = 8
"""Samples in a window of `lagrange`, and its order."""

TAPS = SAMPLED // 2 - 1
"""Samples of the window on either side of those of its interval."""

ROWS_AT_ONCE = BLOCK_STATES // 2
"""Intervals in a batch: their windows stay in cache, and are not a power of two apart."""

THINNED = 5
"""Samples from which on some can be left out, to see what that changes."""

TWICE_THINNED = 2 * THINNED - 1
"""Samples of which every second ones can be thinned again."""

CACHED_NUMBERS = 1 << 15
"""Numbers of integrals, or of their bars, that are found at once: they stay in cache."""


def lagrange(samples: Samples, sampled: Array) -> Array:
    """∫ from the first sample on (m, T) of polynomials through the powers `sampled` (m, T) there."""
    t, window = samples.clock, min(SAMPLED, len(samples.t))
    total = np.empty_like(sampled)
    if len(t) >= SAMPLED and samples.even:
        sums = _even_sums(float((t[-1] - t[0]) / (len(t) - 1)))

        def some(rows: slice) -> None:
            total[rows] = sums.sums(sampled[rows], 1)

        spread(some, _in_cache(sampled), numbers=sampled.size)
        return total

    def share(rows: slice) -> None:
        _lagrange(t, sampled[rows], window, total[rows])

    size = -(-len(total) // min(cores(), max(1, len(total)))) or 1
    spread(share, _rows(total, size), numbers=sampled.size)
    return total


def _in_cache(values: Array) -> list[slice]:
    """The rows of (m, T) in parts whose numbers stay in cache."""
    return _rows(values, max(1, CACHED_NUMBERS // values.shape[1]))


def _rows(values: Array, size: int) -> list[slice]:
    return [slice(a, a + size) for a in range(0, len(values), size)]


class EvenSums:
    """`lagrange` of equidistant samples, `width` (s) apart: the same weights everywhere but near the ends.

    Away from these every sample is summed once, and what weights add is at either end of the integral alone
    (as in Gregory's rule): ∫ P dt from row a to row n is h Σ P_m (a ≤ m < n) + g_n − g_a with
    g_n = h (P_n/2 + Σ τ_i (P_{n+i} − P_{n−i})), where τ are the `tails`.
    """

    def __init__(self, width: float) -> None:
        self.width = width
        places = np.arange(SAMPLED) - np.arange(SAMPLED - 1.0)[:, None]
        self._weights = lagrange_kernel(SAMPLED)(z=places, width=1.0)["weights"]

    @property
    def tails(self) -> Array:
        """τ_1, τ_2, τ_3: of the weights of an interval in the middle of its window those beyond its end."""
        return np.cumsum(self._weights[TAPS, :TAPS])[::-1]

    def sums(self, powers: Array, spacing: int) -> Array:
        """∫ from the first sample on (m, T) of powers (m, T ≥ `SAMPLED`) at samples of that `spacing`."""
        sums, stop = np.empty_like(powers), powers.shape[1] - TAPS
        sums[:, 0] = 0.0
        starts = powers[:, :SAMPLED] @ self._weights[:TAPS].T
        np.cumsum(starts, axis=1, out=sums[:, 1 : TAPS + 1])
        middle = 0.5 * powers[:, TAPS:stop]
        for k, tail in enumerate(self.tails, start=1):
            middle += tail * (powers[:, TAPS + k : stop + k] - powers[:, TAPS - k : stop - k])
        middle += (sums[:, TAPS] - middle[:, 0])[:, None]
        middle[:, 1:] += np.cumsum(powers[:, TAPS : stop - 1], axis=1)
        sums[:, TAPS:stop] = middle
        ends = powers[:, -SAMPLED:] @ self._weights[TAPS + 1 :].T
        sums[:, stop:] = sums[:, [stop - 1]] + np.cumsum(ends, axis=1)
        sums *= spacing * self.width
        return sums


_even_sums = lru_cache(maxsize=16)(EvenSums)


def _lagrange(t: Array, powers: Array, window: int, sums: Array) -> None:
    """`lagrange` at times that are not equidistant, to `sums`."""
    kernel = lagrange_kernel(window)
    sums[:, 0] = 0.0
    for start, stop, first in blocks(len(t), window, ROWS_AT_ONCE):
        size = stop - start
        x = np.empty((kernel.n_in, size))
        window_times(t, start, first, x[:window], x[window:])
        windows = (powers[:, first + j : first + j + size] for j in range(window))
        block = sum(w * values for w, values in zip(kernel.flat(x), windows))
        block[:, 0] += sums[:, start]
        np.cumsum(block, axis=1, out=sums[:, start + 1 : stop + 1])


def hermite(
    samples: Samples,
    powers: Powers,
    sampled: Array,
    window: int,
    rates: Collection[str],
) -> Array:
    """∫ over the interval before each sample (m, T): Lobatto's rule along motions interpolated in a window.

    `sampled` are the powers (m, T) at the samples, which are the outer nodes; `rates` names what the powers
    need rates of.
    """
    t, window = samples.clock, min(window, len(samples.t))
    names = sorted(samples.smooth, key=lambda name: name not in rates)  # those with rates first
    values = [samples.smooth[name].values for name in names]
    slopes = [samples.smooth[name].rates for name in names]
    plain = list(samples.plain.values())
    sizes = {name: y.shape[1] for name, y in zip([*names, *samples.plain], [*values, *plain])}
    rated = {f"rate {name}": sizes[name] for name in names if name in rates}
    kernel = hermite_kernel(
        window,
        sum(y.shape[1] for y in values),
        sum(rated.values()),
        sum(f.shape[1] for f in plain),
        INNER,
    )
    places = _places(sizes | rated)
    y, dy, f = (_side_by_side(columns, len(t)) for columns in (values, slopes, plain))
    total = np.zeros_like(sampled)
    for together in _together(blocks(len(t), window, ROWS_AT_ONCE)):
        block = slice(together[0][0], together[-1][1])
        after, size = slice(block.start + 1, block.stop + 1), block.stop - block.start
        x = np.empty((kernel.n_in, size))
        for start, stop, first in together:
            part = x[:, start - block.start : stop - block.start]
            z, width, *windows = (part[where] for where in kernel.input_slices.values())
            window_times(t, start, first, z, width)
            for rows, out in zip((y, dy, f), windows):
                windows_of(rows, first, window, out)
        powers_between = kernel.flat(x)
        width = x[kernel.input_slices["width"]][0]
        end = sampled[:, after]
        if samples.steady:  # what acts at the end is still that of the start
            end = powers(*samples.at(after, block, rates)).T
        # The inner nodes of all intervals, one kind after the other.
        nodes = np.hstack([powers_between[where] for where in kernel.output_slices.values()])
        times = np.concatenate([samples.t[block] + node * width for node in INNER])
        at = {name: nodes[place].T for name, place in places.items()}
        at |= {n: np.tile(y[block], (len(INNER), 1)) for n, y in samples.steady.items()}
        between = Between(at, {name: at[f"rate {name}"] for name in names if name in rates})
        inner = powers(times, between).T
        part = OUTER_WEIGHT * (sampled[:, block] + end)
        for k, weight in enumerate(INNER_WEIGHTS):
            part += weight * inner[:, k * size : (k + 1) * size]
        np.multiply(part, width, out=total[:, after])
    return total


def _side_by_side(columns: Sequence[Array], count: int) -> Array:
    """Time-first columns, (T, n) each, as the rows of one array (Σ n, T)."""
    return np.concatenate([np.empty((0, count)), *(column.T for column in columns)])


def _together(several: Iterable[Block]) -> Iterator[list[Block]]:
    """Neighbouring blocks, with the short ones at the ends of a motion joined to the next."""
    blocks: list[Block] = []
    for block in several:
        if blocks and block[1] - blocks[0][0] > ROWS_AT_ONCE + SAMPLED:
            yield blocks
            blocks = []
        blocks.append(block)
    if blocks:
        yield blocks


def _places(sizes: Mapping[str, int]) -> dict[str, slice]:
    ends = [0, *accumulate(sizes.values())]
    return {name: slice(a, b) for name, a, b in zip(sizes, ends, ends[1:])}


@dataclass(frozen=True)
class Integral:
    """Cumulated integrals by a rule.

    `value` (T, m) and their error bars `bar` (T, m); `order`: that in the spacing which the errors of
    the leading columns show together, zero where it was not observed.
    """

    value: Array
    bar: Array
    rule: str
    order: float


@dataclass(frozen=True)
class _Rule:
    """Cumulated integrals (m, T) from samples and the powers there.

    `order` in the spacing; `window`: the samples that an interval is seen through.
    """

    name: str
    order: int
    window: int
    sums: Callable[[Samples, Array], Array]


def integrate(
    samples: Samples,
    powers: Powers,
    sampled: Array | None = None,
    rates: Collection[str] | None = None,
    leading: slice = slice(None),
) -> Integral:
    """Cumulated integrals with error bars, by the rules whose bars are smaller.

    The powers at the samples suffice where the bar of `lagrange` is down to rounding. Otherwise the motion
    is interpolated too, in either window; and `lagrange`, whose windows are wide, is left out of the
    choice where the log is not seen to be smooth.

    The bar at a time is the largest difference so far between using all and every second sample,
    divided by 2^(p/2 − 1), where p is the order observed with every fourth sample too: half of it is
    counted on, for a single halving shows it but roughly. Where rates had to be derived none is: the
    ends of a spline have their own. Times far from zero, unevenly spaced, add what their rounding may do.

    Args:
        samples: what is known of the motion.
        powers: (times, between) -> (rows, m).
        sampled: the powers (m, T) at the samples; evaluated if None.
        rates: names of what the powers need rates of; by default all that is smooth.
        leading: the columns that decide by which rules the integrals are taken.
    """
    rated = samples.smooth.keys() if rates is None else rates
    sampled = at_samples(samples, powers, rated) if sampled is None else sampled
    integral = _chosen(samples, powers, sampled, rated, leading)
    blur = float(np.spacing(np.abs(samples.t).max()))
    if blur > 4 * np.spacing(np.ptp(samples.t)) and not samples.even:
        # Σ P_k (δ_{k+1} − δ_k), summed by parts.
        moved = np.abs(np.diff(sampled, axis=1, prepend=0.0)).cumsum(axis=1) + np.abs(sampled)
        return replace(integral, bar=integral.bar + blur * moved.T)
    return integral


def _chosen(
    samples: Samples, powers: Powers, sampled: Array, rated: Collection[str], leading: slice
) -> Integral:
    """The integral by the rule with the smallest bars."""
    thinned = {1: (samples, sampled)}
    steps = (2,) if samples.derived else (2, 4)
    for n in steps if len(samples.t) >= THINNED else ():
        thin = samples.every(n)
        # Derived rates are others when samples are left out, and so is what was held.
        anew = samples.derived or samples.steady
        thinned[n] = thin, at_samples(thin, powers, rated) if anew else sampled[:, ::n]

    def interpolated(window: int) -> _Rule:
        return _Rule(
            f"hermite {window}",
            HERMITE_ORDERS[window],
            window,
            lambda s, at: hermite(s, powers, at, window, rated).cumsum(axis=1),
        )

    first = None
    if len(samples.t) > 4 * SAMPLED and not samples.steady:
        by_samples = _Rule(
            "samples",
            SAMPLED,
            SAMPLED,
            lambda s, at: lagrange(s, np.ascontiguousarray(at)),
        )
        first = _estimated(by_samples, thinned, leading)
        flow = max(np.trapezoid(np.abs(row), samples.t) for row in sampled[leading])
        if exact_to_rounding(first.bar[-1, leading].max(), flow, len(samples.t)):
            return first
    high, low = (_estimated(interpolated(window), thinned, leading) for window in (4, 2))
    best = high if high.bar[-1, leading].sum() <= low.bar[-1, leading].sum() else low
    if first is None or first.order < SAMPLED / 2:
        return best
    return _by_column(first, best, leading)


def _by_column(first: Integral, second: Integral, leading: slice) -> Integral:
    """Each column by the rule with the smaller bar; named is that of most of the leading ones.

    Forces that were logged and those of the model are not interpolated equally well.
    """
    a, b = first.bar[-1], second.bar[-1]
    best = first if a[leading].sum() < b[leading].sum() else second
    value = np.where(a < b, first.value, second.value)
    return Integral(value, np.where(a < b, first.bar, second.bar), best.rule, best.order)


def _estimated(
    rule: _Rule, thinned: Mapping[int, tuple[Samples, Array]], leading: slice
) -> Integral:
    fine = rule.sums(*thinned[1])
    count = fine.shape[1]
    bar = np.empty(fine.shape)
    if count < THINNED:  # nothing can be left out: as much error as integral
        np.maximum.accumulate(np.abs(fine), axis=1, out=bar)
        return Integral(fine.T, bar.T, rule.name, 0.0)
    half = rule.sums(*thinned[2])
    observed = count >= TWICE_THINNED and not thinned[1][0].derived
    quarter = rule.sums(*thinned[4]) if observed else None
    # Windows reach beyond their interval: each sample has the bar of an even one after all it saw.
    ahead = max(rule.window, 4) // 4
    finer, coarser = np.zeros((2, len(fine)))

    def estimate(rows: slice) -> None:
        error = fine[rows, ::2] - half[rows]
        even = np.maximum.accumulate(np.abs(error), axis=1)
        if quarter is not None:
            # Sums over intervals: in a cumulated error contributions may cancel by chance.
            finer[rows] = np.abs(np.diff(error)).sum(axis=1)
            coarser[rows] = np.abs(np.diff(half[rows, ::2] - quarter[rows])).sum(axis=1)
            even /= reduction(finer[rows], coarser[rows], rule.order)[:, None]
        last = np.broadcast_to(even[:, -1:], (len(even), 2 * ahead + 1))
        increments = np.hstack([even[:, ahead:], last])
        bar[rows, ::2] = increments[:, : (count + 1) // 2]
        bar[rows, 1::2] = increments[:, 1 : 1 + count // 2]

    spread(estimate, _in_cache(fine), numbers=fine.size)
    order = observed_order(finer[leading], coarser[leading]) if quarter is not None else 0.0
    return Integral(fine.T, bar.T, rule.name, order)


def reduction(finer: Array, coarser: Array, order: int) -> Array:
    """What the difference between all and every second sample is divided by.

    `finer` is the sum of such differences over all intervals, `coarser` that between every second and every
    fourth sample; no more than what a rule of that `order` can have.
    """
    ratio = np.divide(
        coarser, finer, out=np.array(coarser, dtype=float), where=np.asarray(finer) > 0
    )
    return np.asarray(np.sqrt(np.clip(ratio / 4.0, 1.0, 2.0**order / 4.0)))


def observed_order(finer: Array, coarser: Array) -> float:
    """The order in the spacing that such differences of several columns show together."""
    return float(np.log2(max(float(coarser.sum()), TINY) / max(float(finer.sum()), TINY)))


def exact_to_rounding(bar: float, flow: float, count: int) -> bool:
    """Whether the bar of integrals over so many samples is rounding; `flow` is that of the powers' sizes."""
    return bool(bar <= EPS * np.sqrt(count) * flow)
