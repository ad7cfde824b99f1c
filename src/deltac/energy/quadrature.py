"""Integrals of powers along sampled motions, with an error bar (theory: the integral "on samples").

Between samples the motion is interpolated by Hermite polynomials through values and rates of the
nearest samples (two for the low order, four for the high one), and the power is summed over the
Gauss–Lobatto nodes of every interval. The error is estimated by leaving out every second sample.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Powers = Callable[[Array, "Between"], Array]

_INNER = np.sqrt(3.0 / 7.0)
NODES = 0.5 * (1.0 + np.array([-1.0, -_INNER, 0.0, _INNER, 1.0]))
WEIGHTS = 0.5 * np.array([1 / 10, 49 / 90, 32 / 45, 49 / 90, 1 / 10])
"""Gauss–Lobatto rule with five nodes on [0, 1], exact to degree 7 (Abramowitz, Stegun 25.4.32)."""

ORDERS = {2: 4, 4: 8}
"""Samples in a window -> order of the interpolation error in the spacing."""

ROWS_AT_ONCE = 16384


@dataclass(frozen=True)
class Between:
    """Quantities interpolated at one node of every interval: values and rates by name, (T−1, n)."""

    values: dict[str, Array]
    rates: dict[str, Array]


@dataclass(frozen=True)
class Samples:
    """What is known at sample times `t` (T,).

    `smooth` maps a name to (values, rates), (T, n) each; `plain` to values alone, interpolated by
    polynomials through the same window; `held` to values that are constant until the next sample.
    The rates of what is named in `derived` are those of a spline, since nobody measured them.
    """

    t: Array
    smooth: dict[str, tuple[Array, Array]]
    plain: dict[str, Array]
    held: dict[str, Array]
    derived: frozenset[str] = frozenset()

    def every(self, n: int) -> Samples:
        """Every n-th sample; what was derived is derived from these alone."""
        t = self.t[::n]
        return Samples(
            t,
            {
                name: (y[::n], spline_rate(t, y[::n]) if name in self.derived else dy[::n])
                for name, (y, dy) in self.smooth.items()
            },
            {name: y[::n] for name, y in self.plain.items()},
            {name: y[::n] for name, y in self.held.items()},
            self.derived,
        )


def spline_rate(t: Array, y: Array) -> Array:
    """Rates (T, n) of a spline through the values `y` (T, n), of degree 5 where there are enough."""
    from scipy.interpolate import make_interp_spline

    degree = min(5, len(t) - 1)
    degree -= 1 - degree % 2  # odd degrees interpolate at the samples themselves
    return np.asarray(make_interp_spline(t, y, k=max(1, degree)).derivative()(t))


def cumulated(samples: Samples, powers: Powers, window: int) -> Array:
    """∫ from the first sample to each of them: (T, m) for `powers` (times, between) -> (rows, m)."""
    parts = []
    count = len(samples.t) - 1
    for start in range(0, count, ROWS_AT_ONCE):
        rows = np.arange(start, min(start + ROWS_AT_ONCE, count))
        parts.append(_intervals(samples, powers, window, rows))
    total = np.concatenate(parts)
    return np.concatenate([np.zeros((1, total.shape[1])), np.cumsum(total, axis=0)])


def _intervals(samples: Samples, powers: Powers, window: int, rows: NDArray[np.intp]) -> Array:
    """∫ over each of the intervals that start at `rows`."""
    t = samples.t
    width = t[rows + 1] - t[rows]
    first = np.clip(rows - (window // 2 - 1), 0, max(0, len(t) - window))
    places = first[:, None] + np.arange(min(window, len(t)))
    # Time in units of the interval, from its start: divided differences stay of order one.
    nodes = (t[places] - t[rows, None]) / width[:, None]
    smooth = {
        name: _hermite(nodes, y[places], dy[places] * width[:, None, None])
        for name, (y, dy) in samples.smooth.items()
    }
    plain = {name: _newton(nodes, y[places]) for name, y in samples.plain.items()}
    doubled = np.repeat(nodes, 2, axis=1)
    total: Array | None = None
    for node, weight in zip(NODES, WEIGHTS):
        values: dict[str, Array] = {name: y[rows] for name, y in samples.held.items()}
        rates: dict[str, Array] = {}
        for name, coefficients in smooth.items():
            values[name], slope = _evaluate(doubled, coefficients, node)
            rates[name] = slope / width[:, None]
        for name, coefficients in plain.items():
            values[name], _ = _evaluate(nodes, coefficients, node)
        part = weight * powers(t[rows] + node * width, Between(values, rates))
        total = part if total is None else total + part
    assert total is not None
    return total * width[:, None]


def _hermite(nodes: Array, y: Array, dy: Array) -> Array:
    """Newton coefficients (rows, 2m, n) through values and rates at m nodes, each counted twice."""
    z = np.repeat(nodes, 2, axis=1)[:, :, None]
    table = np.repeat(y, 2, axis=1)
    coefficients = [table[:, 0]]
    first = np.empty_like(table[:, 1:])
    first[:, 0::2] = dy
    first[:, 1::2] = (table[:, 2::2] - table[:, 1:-1:2]) / (z[:, 2::2] - z[:, 1:-1:2])
    table = first
    for order in range(1, z.shape[1]):
        coefficients.append(table[:, 0])
        if order + 1 < z.shape[1]:
            table = np.diff(table, axis=1) / (z[:, order + 1 :] - z[:, : -order - 1])
    return np.stack(coefficients, axis=1)


def _newton(nodes: Array, y: Array) -> Array:
    """Newton coefficients (rows, m, n) of the polynomial through m values."""
    z, table = nodes[:, :, None], y
    coefficients = [table[:, 0]]
    for order in range(1, nodes.shape[1]):
        table = np.diff(table, axis=1) / (z[:, order:] - z[:, :-order])
        coefficients.append(table[:, 0])
    return np.stack(coefficients, axis=1)


def _evaluate(nodes: Array, coefficients: Array, x: float) -> tuple[Array, Array]:
    """Value and derivative of Newton polynomials at `x`, by Horner's scheme."""
    count = coefficients.shape[1]
    value = coefficients[:, count - 1]
    slope = np.zeros_like(value)
    for k in reversed(range(count - 1)):
        step = (x - nodes[:, k])[:, None]
        slope = slope * step + value
        value = value * step + coefficients[:, k]
    return value, slope


@dataclass(frozen=True)
class Integral:
    """Cumulated integrals `value` (T, m) with error bars `bar` (T, m), through `window` samples."""

    value: Array
    bar: Array
    window: int


def integrate(samples: Samples, powers: Powers) -> Integral:
    """Cumulated integrals with error bars, by the window whose bars are smaller.

    The bar at a time is the largest difference so far between using all and every second sample,
    divided by 2^(p/2 − 1), where p is the order observed with every fourth sample too: half of it is
    counted on, for a single halving shows it but roughly. Where rates had to be derived none is: the
    ends of a spline have their own.
    """
    found = [_estimated(samples, powers, window) for window in ORDERS]
    low, high = found
    return high if high.bar[-1].sum() <= low.bar[-1].sum() else low


def _estimated(samples: Samples, powers: Powers, window: int) -> Integral:
    fine = cumulated(samples, powers, window)
    if len(samples.t) < 5:  # nothing can be left out: as much error as integral
        return Integral(fine, np.maximum.accumulate(np.abs(fine), axis=0), window)
    half = cumulated(samples.every(2), powers, window)
    error = fine[::2] - half
    bar_even = np.maximum.accumulate(np.abs(error), axis=0)
    if len(samples.t) >= 9 and not samples.derived:
        # Sums over intervals: in a cumulated error contributions may cancel by chance.
        finer = _variation(error)
        coarser = _variation(half[::2] - cumulated(samples.every(4), powers, window))
        ratio = coarser / np.where(finer > 0.0, finer, 1.0)
        bar_even = bar_even / np.sqrt(np.clip(ratio / 4.0, 1.0, 2.0 ** ORDERS[window] / 4.0))
    # Windows reach beyond their interval: each sample has the bar of the even one after the next.
    index = np.minimum((np.arange(len(samples.t)) + 3) // 2, len(bar_even) - 1)
    return Integral(fine, bar_even[index], window)


def _variation(error: Array) -> Array:
    return np.asarray(np.abs(np.diff(error, axis=0)).sum(axis=0))
