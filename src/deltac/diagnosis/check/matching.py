"""What a residual consists of: the model's own terms with wrong factors, else plain functions of the state.

A sum of few candidates with constant coefficients must give the residual to seven digits; then it is no
coincidence. Coefficients that are formulas in the model's parameters say what the mistake is: 1/g, g is
missing; l2/l1, one length in place of another.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from itertools import combinations, permutations

import numpy as np

from deltac.arrays import HALF_DIGITS, Array
from deltac.diagnosis.check.terms import (
    MOST_WRITTEN_SPEEDS,
    Summand,
    circular,
    inertia_term,
    own_parts,
    plain_parts,
    sums,
    written,
)
from deltac.diagnosis.residuals.at_states import EquationTest
from deltac.results import Serialisable

MOST_TERMS = 3

FAIR = 1.0
"""An explanation that costs no more than this is not doubted: plain factors of one part or two."""

PAIRED = 120
"""Candidates of which all pairs are tried."""

FACTORS = {-1.0: "with the wrong sign", 0.0: "is missing", 2.0: "twice", 0.5: "by half"}


@dataclass(frozen=True)
class Match(Serialisable, also=("words",)):
    """`coefficient` times a part: one summand of a residual.

    For a term of the model's own equation, `factor` is what the tested equations have in place of 1: −1
    for a wrong sign, 0 for a missing term. None for a plain function of the state. `symbols`: the model's
    term as people write it, where it is short; `formula`: the factor in the model's parameters; `ratio`:
    where the factor depends on the state, what it is a multiple of ("1/cos(b)": a cosine is missing), and
    `factor` that multiple.
    """

    part: str
    coefficient: float
    factor: float | None
    symbols: str = ""
    formula: str = ""
    ratio: str = ""

    @property
    def plain(self) -> bool:
        """Whether a term of the model is missing, or enters with the wrong sign, twice or by half."""
        return self.factor is not None and not self.ratio and _is_plain(self.factor)

    @property
    def words(self) -> str:
        """The summand in words."""
        return str(self)

    def __str__(self) -> str:
        if self.factor is None:
            return f"{self.coefficient:.6g}·{self.part}"
        part = f"{self.part}, {self.symbols}," if self.symbols else self.part
        if self.ratio:
            number = self.formula or f"{self.factor:.6g}"
            number = self.ratio if number == "1" else f"{number}·{self.ratio}"
            return f"{part} enters with the factor {number}"
        for factor, words in FACTORS.items():
            if abs(self.factor - factor) < SIX_DIGITS:
                return f"{part} {'' if factor == 0.0 else 'enters '}{words}"
        number = _factor(self.factor)
        if any(c.isalpha() for c in self.formula):
            number = f"{self.formula} = {number}"
        return f"{part} enters with the factor {number}"


def _factor(factor: float) -> str:
    """A factor; one that six digits do not tell from 1 by what it differs: "1 + 1.0e-07"."""
    more = factor - 1.0
    if abs(more) >= 1e-4:
        return f"{factor:.6g}"
    return f"1 {'-' if more < 0.0 else '+'} {abs(more):.1e}"


def explain_residual(
    test: EquationTest,
    residual: Array,
    udot: Array,
    row: int,
    depends: tuple[str, ...] | None = None,
) -> tuple[Match, ...]:
    """What the residual (B,) of one equation consists of: the model's own terms, else plain functions.

    `depends` names what it changes with, if that is known. Empty if it is no such sum.
    """
    terms = explain_row(test, residual, udot, row)
    return terms or explain_plainly(test, residual, udot, depends)


def explain_row(test: EquationTest, residual: Array, udot: Array, row: int) -> tuple[Match, ...]:
    """The model's own terms that the residual (B,) of one equation consists of; empty if it is no such sum.

    That the equation's own acceleration is missing is no explanation: the residual is the sum of all terms.
    """
    own = inertia_term(test.speeds[row])
    return _told(test, residual, own_parts(test, udot, row), own)


def explain_acceleration(test: EquationTest, error: Array, k: int) -> tuple[Match, ...]:
    """The terms of the model that the error (B,) of one acceleration consists of, as u̇ = M⁻¹(f) has them.

    Equations that were solved for the accelerations by hand have every force in every acceleration; a
    mistake in one of them is no term of any row of M u̇ = f.
    """
    return _told(test, -error, acceleration_parts(test, k), "")


def acceleration_parts(test: EquationTest, k: int) -> list[Summand]:
    """The terms of all equations but inertia as M⁻¹ brings them into one acceleration."""
    inverse: Array = np.asarray(np.linalg.inv(test.M), dtype=float)
    right = test.acceleration
    parts = [Summand(WHOLE, right[k], ("whole", "", None), row=k)]
    for row, speed in enumerate(test.speeds):
        share = inverse[:, k, row]
        where = f"equation {row + 1} ({speed})"
        drive = share * (sum(f[row] for f in test.forces.values()) - test.bias[row])
        parts.append(Summand(f"what drives {where}", drive, ("force", "", None), row=row))
        parts += [
            replace(p, name=f"{p.name} of {where}", values=share * p.values)
            for p in own_parts(test, right, row)
            if p.key is not None and "inertia" not in p.key[0]
        ]
    return [p for p in parts if np.abs(p.values).max() > 1e-9 * np.abs(right[k]).max()]


WHOLE = "the acceleration as a whole"


def _told(
    test: EquationTest, residual: Array, parts: Sequence[Summand], own: str
) -> tuple[Match, ...]:
    """The fewest parts that a residual consists of, each with its formula and its term written out."""
    parameters = test.kane.mechanism.parameters

    def cost(part: Summand, coefficient: float) -> float:
        if _is_plain(1.0 - coefficient):
            return 0.1 * (coefficient < 0.9)  # twice, or by half
        matches = formula(1.0 - coefficient, parameters, _written(test, part))
        return 3.0 if matches is None else 0.5 + matches.cost

    matches = explain_by(residual, parts, cost=cost)
    price = sum(cost(p, c) for p, c in matches) + (len(matches) - 1)
    if not matches or price > FAIR:
        varied = _with_ratio(test, residual, parts)
        if varied is not None and (not matches or varied[1] < price):
            match, _, part = varied
            return (replace(match, symbols=_written(test, part)),)
    if own and any(
        p.name == own and not p.symbols and abs(c - 1.0) < SIX_DIGITS for p, c in matches
    ):
        return ()
    terms = []
    for part, c in matches:
        term = _written(test, part)
        factor = None if _is_plain(1.0 - c) else formula(1.0 - c, parameters, term)
        terms.append(Match(part.name, c, 1.0 - c, term, "" if factor is None else factor.text))
    return tuple(terms)


def _written(test: EquationTest, part: Summand) -> str:
    if part.symbols or part.key is None or part.key[0] in ("whole", "force"):
        return part.symbols
    return written(test.kane, part.key, part.row)


def _with_ratio(
    test: EquationTest, residual: Array, parts: Sequence[Summand]
) -> tuple[Match, float, Summand] | None:
    """One part that enters with a plain function of the state as its factor; what that costs; the part."""
    texts, F, prices = ratios(test)
    size = float(np.linalg.norm(residual))
    best: tuple[Match, float, Summand] | None = None
    for part in parts:
        if part.key is None:
            continue
        stands = part.values - residual
        Z = F * part.values
        with np.errstate(all="ignore"):
            c = (Z @ stands) / np.einsum("sb,sb->s", Z, Z)
            rest = np.linalg.norm(stands - c[:, None] * Z, axis=1)
        fits = np.flatnonzero((rest <= HALF_DIGITS * size) & (np.abs(c) > 1e-6))
        term = _written(test, part) if len(fits) else ""
        for k in fits:
            number = float(c[k])
            multiple = formula(number, test.kane.mechanism.parameters, term or "1")
            price = float(prices[k]) + (
                0.0
                if abs(abs(number) - 1.0) < SIX_DIGITS
                else 2.0
                if multiple is None
                else 0.5 + multiple.cost
            )
            if best is None or price < best[1]:
                text = "" if multiple is None else multiple.text
                best = Match(part.name, number, number, "", text, texts[k]), price, part
    return best


def ratios(test: EquationTest) -> tuple[list[str], Array, Array]:
    """Plain functions of the state that are forgotten, put in, or stand for others: texts, values, costs."""
    states = test.states
    one = np.ones(len(states))
    own = list(zip(states.coordinates, states.q))[:MOST_WRITTEN_SPEEDS]
    shapes = [s for name, x in own for s in (*circular(name, x), (name, x))]
    for (a, x), (b, y) in combinations(own, 2):
        shapes += [s for text, angle in sums(a, b, x, y) for s in circular(text, angle)]
    u = [(f"u.{name}", x) for name, x in zip(states.speeds, states.u)][:MOST_WRITTEN_SPEEDS]
    pairs = combinations(u, 2)
    rates = [*u, *((f"({text})", z) for (a, x), (b, y) in pairs for text, z in sums(b, a, y, x))]
    texts: list[str] = []
    rows: list[Array] = []
    prices: list[float] = []

    def add(text: str, values: Array, price: float) -> None:
        if np.isfinite(values).all():
            texts.append(text)
            rows.append(values)
            prices.append(price)

    with np.errstate(all="ignore"):
        for some in (shapes, rates):
            for text, x in some:
                add(text, x, 1.2)
                add(f"1/{text}", one / x, 1.2)
                add(f"{text}²", x**2, 1.4)
                add(f"1/{text}²", one / x**2, 1.4)
            for (a, x), (b, y) in permutations(some, 2):
                add(f"{a}/{b}", x / y, 1.4)
                if some is not shapes:
                    add(f"({a}/{b})²", (x / y) ** 2, 1.5)
    values = np.array(rows) if rows else np.empty((0, len(states)))
    return texts, values, np.array(prices)


def explain_plainly(
    test: EquationTest, residual: Array, udot: Array, depends: tuple[str, ...] | None
) -> tuple[Match, ...]:
    """The plain functions of what it depends on that a residual (B,) consists of; empty if it is no sum."""
    names = test.states.coordinates
    some = [k for k, n in enumerate(names) if depends is None or f"q.{n}" in depends]
    if len(some) > MOST_WRITTEN_SPEEDS:
        return ()
    parts = plain_parts(test.states, udot, some)
    if depends is not None:
        parts = [p for p in parts if p.of is None or p.of <= set(depends)]
    return tuple(Match(part.name, c, None) for part, c in explain_by(residual, parts))


def explain_by(
    residual: Array,
    parts: Sequence[Summand],
    exact: float = HALF_DIGITS,
    cost: Callable[[Summand, float], float] | None = None,
) -> tuple[tuple[Summand, float], ...]:
    """The fewest parts whose sum with constant coefficients is the residual (B,); empty if none is.

    One, two of all pairs, then by orthogonal matching pursuit three. Among those that fit alike, the ones
    whose coefficients `cost` least.
    """
    size = float(np.linalg.norm(residual))
    usable = [p for p in parts if float(np.linalg.norm(p.values)) > 0.0]
    if not usable or size == 0.0:
        return ()
    columns = np.array([p.values for p in usable])
    columns = columns / np.linalg.norm(columns, axis=1)[:, None]
    along = columns @ (residual / size)
    singles = [(int(k),) for k in np.flatnonzero(1.0 - along**2 < SIX_DIGITS)]
    best = _cheapest(residual, usable, singles, exact, cost)
    if best or len(residual) < 8:
        return best
    if len(usable) <= PAIRED and cost is not None:
        best = _cheapest(residual, usable, _pairs(columns, along), exact, cost)
        if best:
            return best
    chosen: list[int] = []
    rest = residual
    for _ in range(min(MOST_TERMS, len(residual) // 4)):
        fit = np.abs(columns @ rest) / np.linalg.norm(rest)
        fit[chosen] = -1.0
        chosen.append(int(np.argmax(fit)))
        coefficients, rest = _fitted(residual, usable, chosen)
        if float(np.linalg.norm(rest)) <= exact * size:
            needed = [
                k
                for k, c in zip(chosen, coefficients)
                if abs(c) * np.linalg.norm(usable[k].values) > 10 * exact * size
            ]
            return _cheapest(residual, usable, [tuple(needed)], exact, cost)
    return ()


def _pairs(columns: Array, along: Array) -> list[tuple[int, ...]]:
    """Pairs of unit columns (A, B) that together may give what has the components `along` (A,)."""
    i, j = np.triu_indices(len(columns), 1)
    cosine = (columns @ columns.T)[i, j]
    with np.errstate(all="ignore"):
        share = (along[i] ** 2 - 2 * along[i] * along[j] * cosine + along[j] ** 2) / (1 - cosine**2)
    fits = np.flatnonzero((np.abs(1.0 - share) < SIX_DIGITS) & (np.abs(cosine) < 1.0 - 1e-9))
    return [(int(i[k]), int(j[k])) for k in fits]


def _cheapest(
    residual: Array,
    parts: Sequence[Summand],
    choices: Sequence[tuple[int, ...]],
    exact: float,
    cost: Callable[[Summand, float], float] | None,
) -> tuple[tuple[Summand, float], ...]:
    """Of the choices of parts that give the residual, the one whose coefficients cost least."""
    best: tuple[tuple[Summand, float], ...] = ()
    least = np.inf
    for chosen in choices:
        coefficients, rest = _fitted(residual, parts, chosen)
        if float(np.linalg.norm(rest)) > exact * float(np.linalg.norm(residual)):
            continue
        matches = tuple((parts[k], float(c)) for k, c in zip(chosen, coefficients))
        total = 0.0 if cost is None else sum(cost(p, c) for p, c in matches)
        if total < least:
            best, least = matches, total
    return best


def _fitted(
    residual: Array, parts: Sequence[Summand], chosen: Sequence[int]
) -> tuple[Array, Array]:
    """Coefficients of the chosen parts by least squares, and what they leave of the residual."""
    A = np.array([parts[k].values for k in chosen]).T
    coefficients: Array = np.asarray(np.linalg.lstsq(A, residual, rcond=None)[0])
    return coefficients, residual - A @ coefficients


def _is_plain(factor: float) -> bool:
    """Whether a factor is −1, 0, 2 or ½."""
    return any(abs(factor - plain) < SIX_DIGITS for plain in FACTORS)


# --- numbers as formulas in a model's parameters: 0.583 as l2/l1, 0.102 as 1/g -------------------


SIX_DIGITS = 1e-5
"""Differences that six digits do not show: of a factor from one, and by normal equations, which lose half of
the digits."""

FRACTIONS = tuple(
    sorted(
        {Fraction(a, b) for a in (1, 2, 3, 4) for b in (1, 2, 3, 4, 6, 12)},
        key=lambda f: (f.numerator * f.denominator, f),
    )
)
"""Numbers that people forget or put in, the plainest first."""

MOST_PARAMETERS = 24
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
    if not np.isfinite(number) or number == 0.0 or abs(abs(number) - 1.0) < SIX_DIGITS:
        return None
    named = tuple(
        (name, abs(value))
        for name, value in parameters.items()
        if value != 0.0 and abs(abs(value) - 1.0) > HALF_DIGITS
    )[:MOST_PARAMETERS]
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
    return Formula(sign + _as_python(fraction, parts), cost + 0.3 * bool(sign))


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


def _as_python(fraction: Fraction, parts: tuple[tuple[str, int], ...]) -> str:
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
