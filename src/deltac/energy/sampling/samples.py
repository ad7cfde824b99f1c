"""A motion at sample times, and functions of it evaluated there, block by block on all cores."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TypeAlias

import numpy as np

from deltac.arrays import Array
from deltac.energy.sampling.interpolation import clock, equidistant
from deltac.kernels.kernel import BLOCK_STATES
from deltac.kernels.parallel import spread
from deltac.trajectories.splines import smooth_rates

Powers: TypeAlias = Callable[[Array, "Between"], Array]
"""(times, between) -> (rows, m)."""


@dataclass(frozen=True)
class Between:
    """Quantities at samples, or at one node of every interval: values and rates by name, (rows, n)."""

    values: dict[str, Array]
    rates: dict[str, Array]


@dataclass(frozen=True, eq=False)
class Smooth:
    """Values (T, n) that have rates; these are found when somebody asks for them."""

    values: Array
    find_rates: Callable[[], Array]

    @cached_property
    def rates(self) -> Array:
        """The rates (T, n)."""
        return self.find_rates()


@dataclass(frozen=True)
class Samples:
    """What is known at sample times `t` (T,).

    `smooth` maps a name to values and rates; `plain` to values (T, n) alone, interpolated by polynomials
    through the same window; `steady` to values that are constant until the next sample. The rates of what
    is named in `derived` are those of a spline, since nobody measured them. Samples at events are
    evaluated `inward` (T,; s) from there, within their smooth piece.
    """

    t: Array
    smooth: dict[str, Smooth]
    plain: dict[str, Array]
    steady: dict[str, Array]
    derived: frozenset[str] = frozenset()
    inward: Array | None = None

    @cached_property
    def even(self) -> bool:
        """Whether the times are equidistant, but for their rounding."""
        return equidistant(self.t)

    @cached_property
    def clock(self) -> Array:
        """Times from the first on (T,); without their rounding where they are equidistant."""
        return clock(self.t, even=self.even)

    def rows(self, rows: slice) -> Samples:
        """Some samples of a smooth piece, with the rates that they have among all."""

        def cut(column: Smooth) -> Smooth:
            return Smooth(column.values[rows], lambda: column.rates[rows])

        return Samples(
            self.t[rows],
            {name: cut(column) for name, column in self.smooth.items()},
            {name: y[rows] for name, y in self.plain.items()},
            {name: y[rows] for name, y in self.steady.items()},
            self.derived,
        )

    def every(self, n: int) -> Samples:
        """Every n-th sample; what was derived is derived from these alone, what was held is its mean."""
        thin = self.rows(slice(None, None, n))
        starts = np.arange(0, len(self.t) - 1, n)
        width = np.diff(self.t)[:, None]
        for name, y in self.steady.items():
            mean = np.add.reduceat(y[:-1] * width, starts) / np.add.reduceat(width, starts)
            thin.steady[name] = np.concatenate([mean, y[-1:]])[: len(thin.t)]
        for name in self.derived:
            values = thin.smooth[name].values
            thin.smooth[name] = Smooth(values, partial(spline_rate, thin.t, values))
        return thin

    def at(self, rows: slice, steps: slice, rated: Collection[str]) -> tuple[Array, Between]:
        """Times and quantities at `rows`; what is steady is that of the rows `steps`."""
        t = self.t[rows]
        values = {name: column.values[rows] for name, column in self.smooth.items()}
        if self.inward is not None:
            aside = self.inward[rows]
            t = t + aside
            for name, column in self.smooth.items():
                values[name] = values[name] + aside[:, None] * column.rates[rows]
        values |= {name: y[rows] for name, y in self.plain.items()}
        values |= {name: y[steps] for name, y in self.steady.items()}
        rates = {name: self.smooth[name].rates[rows] for name in rated}
        return t, Between(values, rates)


def spline_rate(t: Array, y: Array) -> Array:
    """Rates (T, n) of a spline through the values `y` (T, n) at sample times."""
    return smooth_rates(clock(t), y)


def row_blocks(count: int) -> list[slice]:
    """Rows in blocks that stay in cache."""
    starts = range(0, count, BLOCK_STATES)
    return [slice(start, min(start + BLOCK_STATES, count)) for start in starts]


def at_samples(samples: Samples, powers: Powers, rated: Collection[str] | None = None) -> Array:
    """The powers at the samples themselves, (m, T); `rated` names what they need rates of (default: all)."""
    rated = samples.smooth.keys() if rated is None else rated
    if samples.inward is not None:  # found before threads ask for them
        _ = [column.rates for column in samples.smooth.values()]
    first, *others = row_blocks(len(samples.t))
    start = powers(*samples.at(first, first, rated)).T
    values = np.empty((len(start), len(samples.t)))
    values[:, first] = start

    def evaluate(rows: slice) -> None:
        values[:, rows] = powers(*samples.at(rows, rows, rated)).T

    spread(evaluate, others, numbers=values.size)
    return values
