"""How exact the numbers of a log are: their digits, and white noise on them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import EPS, Array
from deltac.caching import derived
from deltac.trajectories import Trajectory

SINGLE = float(np.finfo(np.float32).eps)
HALF, LEAST_HALF = float(np.finfo(np.float16).eps), float(np.finfo(np.float16).smallest_subnormal)
PROBES = 400


def resolution(values: Array) -> Array:
    """Half of the last digit of every number (T, n), column by column.

    Columns of half and single precision, of a fixed number of decimals or of significant digits, and counts
    of an encoder are recognised by their values; all others are taken for doubles. Zeros have no error.
    """
    half = EPS * np.abs(values)
    if not values.size:
        return half
    rows = np.linspace(0, len(values) - 1, PROBES).astype(np.intp)
    ordered = np.sort(np.ascontiguousarray(values.T), axis=1)
    different = 1 + np.count_nonzero(ordered[:, 1:] != ordered[:, :-1], axis=1)
    for k, probe in enumerate(values[rows[PROBES // 2]].tolist()):
        if different[k] <= REPEATS * len(values) or not _of_many_digits(probe):
            half[:, k] = _of_column(values[:, k], rows)
    return half


def _of_many_digits(x: float) -> bool:
    """Whether a number proves that those of its column are not written by few digits or in few bits."""
    return float(f"{x:.11e}") != x and round(x, 12) != x and float(np.float32(x)) != x


def _of_column(column: Array, rows: NDArray[np.intp]) -> Array:
    size = np.abs(column)
    probes = np.unique(column[rows])
    values = len(probes)
    probes = probes[probes != 0.0]
    if values < 3 or not len(probes):  # a constant says nothing about its digits
        return EPS * size
    found = (_significant(size, probes), _decimals(size, probes), _binary(size, probes))
    readings = [half for half in found if half is not None]
    if readings:  # numbers of few decimals have few significant digits too: the coarser is meant
        return max(readings, key=lambda half: float(half.sum()))
    return np.maximum(EPS * size, 0.5 * _count(column))


def _binary(size: Array, probes: Array) -> Array | None:
    """Half or single precision; halves of few bits have few decimals as well."""
    if np.all(np.abs(probes) < MOST_HALF) and np.array_equal(probes.astype(np.float16), probes):
        return HALF * size + LEAST_HALF * (size > 0.0)
    if np.array_equal(probes.astype(np.float32).astype(np.float64), probes):
        return SINGLE * size
    return None


MOST_HALF = float(np.finfo(np.float16).max)
"""Numbers beyond this are none of half precision."""

REPEATS = 0.95
"""Share of different numbers of a column below which it may hold counts."""


def _count(column: Array) -> float:
    """The count of which a column holds whole multiples, up to a constant; 0 if there is none."""
    levels = np.unique(column)
    if len(levels) < 8 or len(levels) > REPEATS * len(column):
        return 0.0
    gaps = np.diff(levels)
    count = float(gaps.min())
    if count < 1e-9 * float(np.abs(levels).max()):
        return 0.0
    off = np.abs((levels - levels[0]) / count - np.rint((levels - levels[0]) / count))
    return count if float(off.max()) < 1e-3 else 0.0


def _significant(size: Array, probes: Array) -> Array | None:
    numbers = probes.tolist()
    for digits in range(3, 13):
        if all(float(f"{x:.{digits - 1}e}") == x for x in numbers):
            decade = np.floor(np.log10(size, out=np.zeros_like(size), where=size > 0.0))
            return np.where(size > 0.0, 0.5 * 10.0 ** (decade - digits + 1), 0.0)
    return None


def _decimals(size: Array, probes: Array) -> Array | None:
    numbers = probes.tolist()
    for decimals in range(1, 13):
        if all(round(x, decimals) == x for x in numbers):
            return np.full_like(size, 0.5 * 10.0**-decimals)
    return None


def medians(values: Array) -> Array:
    """Medians along the last axis, many times as fast as by `np.median`, which looks for NaN by sorting."""
    middle = values.shape[-1] // 2
    ordered = np.partition(values, middle, axis=-1)
    found = ordered[..., middle]
    if values.shape[-1] % 2 == 0:
        found = 0.5 * (ordered[..., :middle].max(axis=-1) + found)
    return np.where(np.isnan(values).any(axis=-1), np.nan, found)


MANY, STRETCHES = 20_000, 8
"""Rows by which the deviation of noise is known to a hundredth, and the stretches of a longer log that they
are taken from.
"""

WHITE = (0.75, 1.35)
"""Ratio of noise by eighth differences to that by sixth between which what is seen is white noise."""


def white_noise(x: Array) -> Array:
    """Standard deviation of white noise on samples of smooth signals (T, n), of each by its high differences.

    Differences of order 2m of white noise have √C(4m, 2m) times its deviation; those of a smooth signal
    fall from one order to the next. What falls is taken for signal.
    """
    if len(x) < 16:
        return np.zeros(x.shape[1])
    if len(x) > MANY:  # the few differences across the joints do not move a median
        size = MANY // STRETCHES
        starts = np.linspace(0, len(x) - size, STRETCHES).astype(np.intp)
        x = np.concatenate([x[a : a + size] for a in starts])
    high = np.ascontiguousarray(np.diff(x, 6, axis=0).T)
    sixth = 1.4826 * medians(np.abs(high)) / np.sqrt(924.0)
    eighth = 1.4826 * medians(np.abs(np.diff(high, 2))) / np.sqrt(12870.0)
    white = (WHITE[0] * sixth < eighth) & (eighth < WHITE[1] * sixth)
    return np.where(white, eighth, 0.0)


def scatter(values: Array) -> Array:
    """Three standard deviations of noise and half a digit of every number (T, n)."""
    return np.asarray(resolution(values) + 3.0 * white_noise(values))


@derived
def scatter_of(run: Trajectory) -> tuple[Array, Array]:
    """`scatter` of the coordinates and of the speeds of a run."""
    return scatter(run.q), scatter(run.u)
