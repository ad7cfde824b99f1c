"""A number as a formula in a model's parameters: 0.583 as l2/l1, 0.102 as 1/g."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

import numpy as np

from deltac.arrays import HALF_DIGITS, Array

CLOSE = 1e-5
"""Differences that six digits do not show: of a factor from one, and by normal equations, which lose half of
the digits."""

FRACTIONS = tuple(
    sorted(
        {Fraction(a, b) for a in (1, 2, 3, 4) for b in (1, 2, 3, 4, 6, 12)},
        key=lambda f: (f.numerator * f.denominator, f),
    )
)
"""Numbers that people forget or put in, the plainest first."""

MOST = 24
"""Parameters of which pairs are tried."""


@dataclass(frozen=True)
class Formula:
    """`text` in Python's notation; `cost` counts its parts: 0 for a plain number."""

    text: str
    cost: float


def formula(
    number: float, parameters: Mapping[str, float], within: str | None = None
) -> Formula | None:
    """The simplest product of a fraction and of powers of at most two parameters that a number is.

    None if it is none. Parameters that are 0 or 1 are never named. `within` is the term whose factor the
    number is: what is divided by must be in it.
    """
    if not np.isfinite(number) or number == 0.0 or abs(abs(number) - 1.0) < CLOSE:
        return None
    named = tuple(
        (name, abs(value))
        for name, value in parameters.items()
        if value != 0.0 and abs(abs(value) - 1.0) > HALF_DIGITS
    )[:MOST]
    logs, powers = _products(named)
    sign = "-" if number < 0 else ""
    inside = None if not within else set(re.findall(r"[A-Za-z_]\w*", within))
    best: tuple[float, int, Fraction, tuple[tuple[str, int], ...]] | None = None
    for place, fraction in enumerate(FRACTIONS):
        errors = np.abs(logs - np.log(abs(number) / float(fraction)))
        for k in np.flatnonzero(errors < 2.0 * HALF_DIGITS):
            parts = powers[int(k)]
            if len(parts) > 1 and fraction != 1:
                continue
            if inside is not None and any(p < 0 and name not in inside for name, p in parts):
                continue
            odd = 0.0 if fraction == 1 else 0.6 if parts else 1.5
            cost = _cost(parts) + odd + 0.02 * place
            if best is None or cost < best[0]:
                best = cost, place, fraction, parts
    if best is None:
        return None
    cost, _, fraction, parts = best
    return Formula(sign + _written(fraction, parts), cost + 0.3 * bool(sign))


@lru_cache(maxsize=16)
def _products(
    named: tuple[tuple[str, float], ...],
) -> tuple[Array, list[tuple[tuple[str, int], ...]]]:
    """Logarithms of products of powers of at most two parameters, and what they are of."""
    powers: list[tuple[tuple[str, int], ...]] = [()]
    powers += [((name, p),) for name, _ in named for p in (1, -1, 2, -2)]
    for (a, _), (b, _) in itertools.combinations(named, 2):
        powers += [
            ((a, p), (b, q)) for p, q in ((1, 1), (-1, -1), (1, -1), (-1, 1), (2, -2), (-2, 2))
        ]
    values = {name: np.log(value) for name, value in named}
    return np.array([sum(p * values[n] for n, p in parts) for parts in powers]), powers


def _cost(parts: tuple[tuple[str, int], ...]) -> float:
    cost = sum(1.0 + 0.3 * (abs(p) - 1) for _, p in parts)
    exchanged = len(parts) == 2 and sum(p for _, p in parts) == 0
    return cost - 1.3 * exchanged  # one length in place of another is one mistake


def _written(fraction: Fraction, parts: tuple[tuple[str, int], ...]) -> str:
    def power(name: str, p: int) -> str:
        return name if abs(p) == 1 else f"{name}**{abs(p)}"

    above = [power(n, p) for n, p in parts if p > 0]
    below = [power(n, p) for n, p in parts if p < 0]
    if fraction.numerator != 1 or not above:
        above.insert(0, str(fraction.numerator))
    if fraction.denominator != 1:
        below.insert(0, str(fraction.denominator))
    top = "*".join(above)
    if not below:
        return top
    return f"{top}/{below[0]}" if len(below) == 1 else f"{top}/({'*'.join(below)})"
