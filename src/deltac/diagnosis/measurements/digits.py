"""How exact the numbers of a log are: their digits, and white noise on them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property, partial
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import EPS, NEGLIGIBLE, Array, max_norm, medians
from deltac.calls.caching import derived
from deltac.energy.terms import LoggedForces
from deltac.trajectories import Trajectory
from deltac.trajectories.lint import LOOKED_AT, NEIGHBOURS, stretch_rows

SINGLE = float(np.finfo(np.float32).eps)
DIGIT_PROBES = 400


LEAST_VALUES = 3
"""Distinct values that a column needs before its digits are counted: a constant shows none."""

LEVELS = 8
"""The same of forces where all states are doubles: fewer are commands, such as on and off."""

Chosen: TypeAlias = slice | NDArray[np.intp]

Rule: TypeAlias = Callable[[Array], Array]
"""Sizes of numbers -> half of the last digit of each."""


class Digits:
    """How exact the numbers of a log are (T, n), column by column.

    Columns of half and single precision, of a fixed number of decimals or of significant digits, and counts
    of an encoder are recognised by their values; all others are taken for doubles. Zeros have no error. Of
    more than `LOOKED_AT` rows so many tell that: half of them neighbours, half spread evenly. Columns of
    fewer than `least` different numbers say nothing about theirs.
    """

    def __init__(self, values: Array, least: int = LEAST_VALUES) -> None:
        self._values = values
        self._least = least
        self._short = len(values) <= LOOKED_AT

    @cached_property
    def _rules(self) -> dict[int, Rule]:
        """Of the columns that are not plain doubles."""
        values = self._values
        if not self._short:
            spread = np.linspace(0, len(values) - 1, LOOKED_AT // 2).astype(np.intp)
            near = stretch_rows(len(values), NEIGHBOURS // 2, LOOKED_AT // NEIGHBOURS)
            values = values[np.union1d(near, spread)]  # twice the same row is no repeated number
        if not values.size:
            return {}
        rows = np.linspace(0, len(values) - 1, DIGIT_PROBES).astype(np.intp)
        ordered = np.sort(np.ascontiguousarray(values.T), axis=1)
        different = 1 + np.count_nonzero(ordered[:, 1:] != ordered[:, :-1], axis=1)
        rules = {
            k: _of_column(values[:, k], rows, self._least)
            for k, probe in enumerate(values[rows[DIGIT_PROBES // 2]].tolist())
            if different[k] <= REPEATS * len(values) or not _of_many_digits(probe)
        }
        # Columns are written alike: one that hardly changes has the digits of the others if it fits them.
        sample = next((values[rows, k] for k in rules if different[k] >= LEVELS), None)
        few = np.flatnonzero((different < self._least) & values.any(axis=0))
        for k in few.tolist() if sample is not None else ():
            rules[k] = _of_probes(np.concatenate([sample, values[rows, k]])) or rules[k]
        return rules

    @property
    def few(self) -> bool:
        """Whether a column has fewer digits than doubles."""
        last = len(self._values) - 1
        some = np.linspace(0, last, min(last + 1, DIGIT_PROBES)).astype(np.intp)
        return bool(np.any(self.half(some) > 2.0 * EPS * np.abs(self._values[some])))

    @cached_property
    def noise(self) -> Array:
        """Standard deviation of white noise (n,); see `white_noise`."""
        return white_noise(self._values)

    @cached_property
    def _halves(self) -> Array:
        return self._half_of(self._values)

    def _half_of(self, values: Array) -> Array:
        half = EPS * np.abs(values)
        for k, rule in self._rules.items():
            half[:, k] = rule(np.abs(values[:, k]))
        return half

    def half(self, rows: Chosen = slice(None)) -> Array:
        """Half of the last digit of every number at some rows."""
        return self._halves[rows] if self._short else self._half_of(self._values[rows])

    def scatter(self, rows: Chosen = slice(None)) -> Array:
        """Three standard deviations of noise and half a digit of every number at some rows."""
        return np.asarray(self.half(rows) + 3.0 * self.noise)


@derived
def digits_of(run: Trajectory) -> Mapping[str, Digits]:
    """Those of "q", "u" and "udot" of a run, found when they are asked for, and of "force <channel>".

    Of forces the columns in which they ever act.
    """
    digits = {"q": Digits(run.q), "u": Digits(run.u)}
    if run.udot is not None:
        digits["udot"] = Digits(run.udot)
    least = least_of_forces(digits)
    forces = LoggedForces.of(run).values(run)
    return digits | {f"force {n}": Digits(f, least) for n, f in forces.items()}


def least_of_forces(digits: Mapping[str, Digits]) -> int:
    """Different numbers from which on the digits of a force are told, beside those of "q" and "u".

    Where all states are doubles, a force of few values, such as on and off, is commanded so, and not rounded.
    """
    return LEAST_VALUES if digits["q"].few or digits["u"].few else LEVELS


def resolution(values: Array) -> Array:
    """Half of the last digit of every number (T, n), column by column; see `Digits`."""
    return Digits(values).half()


def scatter(values: Array) -> Array:
    """Three standard deviations of noise and half a digit of every number (T, n)."""
    return Digits(values).scatter()


def _of_many_digits(x: float) -> bool:
    """Whether a number proves that those of its column are not written by few digits or in few bits."""
    return float(f"{x:.11e}") != x and round(x, 12) != x and float(np.float32(x)) != x


def _of_column(column: Array, rows: NDArray[np.intp], least: int) -> Rule:
    probes = np.unique(column[rows])
    values = len(probes)
    probes = probes[probes != 0.0]
    if values < least or not len(probes):
        return lambda size: EPS * size
    rule = _of_probes(probes)
    if rule is not None:
        return rule
    count = 0.5 * _count(column)
    return lambda size: np.maximum(EPS * size, count)


def _of_probes(probes: Array) -> Rule | None:
    """The rule of numbers of few digits or bits."""
    probes = np.unique(probes[probes != 0.0])
    readings = [rule for find in (_significant, _decimals, _binary) if (rule := find(probes))]
    # Numbers of few decimals have few significant digits too: the coarser is meant.
    size = np.abs(probes)
    return max(readings, key=lambda rule: float(rule(size).sum()), default=None)


def _binary(probes: Array) -> Rule | None:
    """Half or single precision; halves of few bits have few decimals as well."""
    if np.all(np.abs(probes) < MOST_HALF) and np.array_equal(probes.astype(np.float16), probes):
        return _half_of_half_precision
    if np.array_equal(probes.astype(np.float32).astype(np.float64), probes):
        return lambda size: SINGLE * size
    return None


MOST_HALF = float(np.finfo(np.float16).max)
"""Numbers beyond this are none of half precision."""

REPEATS = 1.0 - NEGLIGIBLE
"""Share of different numbers of a column below which it may hold counts."""


def _count(column: Array) -> float:
    """The count of which a column holds whole multiples, up to a constant; 0 if there is none."""
    levels = np.unique(column)
    if len(levels) < LEVELS or len(levels) > REPEATS * len(column):
        return 0.0
    gaps = np.diff(levels)
    count = float(gaps.min())
    if count < 1e-9 * max_norm(levels):
        return 0.0
    remainder = np.abs((levels - levels[0]) / count - np.rint((levels - levels[0]) / count))
    return count if float(remainder.max()) < 1e-3 else 0.0


def _half_of_half_precision(size: Array) -> Array:
    """Nobody computes in half precision: numbers were rounded once, to the nearest."""
    # Rows that were no probes may be beyond; the largest number has no neighbour.
    rounded = np.minimum(size, np.nextafter(np.float16(MOST_HALF), np.float16(0))).astype(
        np.float16
    )
    return np.asarray(0.5 * np.spacing(rounded).astype(np.float64) * (size > 0.0))


def _significant(probes: Array) -> Rule | None:
    numbers = probes.tolist()
    for digits in range(3, 13):
        if all(float(f"{x:.{digits - 1}e}") == x for x in numbers):
            return partial(_half_of_significant, digits)
    return None


def _half_of_significant(digits: int, size: Array) -> Array:
    decade = np.floor(np.log10(size, out=np.zeros_like(size), where=size > 0.0))
    return np.where(size > 0.0, 0.5 * 10.0 ** (decade - digits + 1), 0.0)


def _decimals(probes: Array) -> Rule | None:
    numbers = probes.tolist()
    for decimals in range(1, 13):
        if all(round(x, decimals) == x for x in numbers):
            return partial(np.full_like, fill_value=0.5 * 10.0**-decimals)
    return None


WHITE_RATIO = (0.75, 1.35)
"""Ratio of noise by eighth differences to that by sixth between which what is seen is white noise."""


def white_noise(x: Array) -> Array:
    """Standard deviation of white noise on samples of smooth signals (T, n), of each by its high differences.

    Differences of order 2m of white noise have √C(4m, 2m) times its deviation; those of a smooth signal
    fall from one order to the next. What falls is taken for signal; what keeps its value from most samples to
    the next is held, and has no noise.
    """
    if len(x) < 16:
        return np.zeros(x.shape[1])
    if len(x) > LOOKED_AT:  # the few differences across the joints do not move a median
        x = x[stretch_rows(len(x), NEIGHBOURS, LOOKED_AT // NEIGHBOURS)]
    high = np.ascontiguousarray(np.diff(x, 6, axis=0).T)
    sixth = 1.4826 * medians(np.abs(high)) / np.sqrt(924.0)
    eighth = 1.4826 * medians(np.abs(np.diff(high, 2))) / np.sqrt(12870.0)
    white = (WHITE_RATIO[0] * sixth < eighth) & (eighth < WHITE_RATIO[1] * sixth)
    held = np.mean(x[1:] == x[:-1], axis=0) > 0.5
    return np.where(white & ~held, eighth, 0.0)
