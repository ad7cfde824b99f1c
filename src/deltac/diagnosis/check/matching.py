"""What a residual consists of: the model's own terms with wrong factors, else plain functions of the state.

A sum of few candidates with constant coefficients must give the residual to seven digits; then it is no
coincidence. Coefficients that are formulas in the model's parameters say what the mistake is: 1/g, g is
missing; l2/l1, one length in place of another.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from itertools import combinations, combinations_with_replacement, islice, permutations
from typing import Any

import casadi as ca
import numpy as np

from deltac.arrays import HALF_DIGITS, SAME, SIX_DIGITS, Array, max_norm
from deltac.calls.caching import LRUCache
from deltac.diagnosis.residuals.at_states import EquationTest
from deltac.diagnosis.residuals.kane import Kane
from deltac.diagnosis.residuals.states import TRIAL_STATES, States
from deltac.dynamics.forces import channels
from deltac.dynamics.recursions import crba, rnea
from deltac.dynamics.spatial import SX
from deltac.dynamics.system import System, trace
from deltac.errors import InputError
from deltac.kernels.lowering import to_sympy
from deltac.mechanism.expressions import symbol_of
from deltac.results import TEXT_WIDTH, Serialisable

# --- terms as people write them, in the model's parameters ---------------------------------------

MOST_WRITTEN_SPEEDS = 4
"""Terms grow exponentially with the number of speeds, and so does the time to simplify them;
so many coordinates and speeds have plain functions of a residual or a factor."""

MOST_INSTRUCTIONS, MOST_NODES = 300, 500
"""Of a term before it is simplified: SymPy takes a second for the latter."""


FRACTIONS = tuple({Fraction(a, b) for a in (1, 2, 3, 4) for b in (1, 2, 3, 4, 6, 12)})
"""Numbers that people write, forget or put in."""

Key = tuple[str, str]
"""What a term is: its kind, and the channel or speed that it is of."""


def written(kane: Kane, key: Key, row: int) -> str:
    """A term of the equation of one own speed, with its sign in F_r + F*_r; "" if it is too long."""
    expression = _in_symbols(kane, key, row)
    if expression is None:
        return ""
    import sympy

    text = _as_text(sympy.factor(expression))
    return text if len(text) <= TEXT_WIDTH else ""


def summands(kane: Kane, key: Key, row: int) -> list[tuple[str, Any]]:
    """The summands of a term as people write them, with functions of (t, q, u) that give their values.

    Products of parameters, functions of the coordinates and rates, at the mechanism's parameters; and sums of
    those that differ by parameters alone. Empty for a term that is one product, or too long.
    """
    expression = _in_symbols(kane, key, row)
    if expression is None:
        return []
    import sympy

    names, values = _names(kane), kane.mechanism.parameters
    numbers = {symbol_of(name): value for name, value in values.items()}
    flat = [symbol_of(name) for group in names[:3] for name in group]
    parts = sympy.Add.make_args(sympy.expand(expression))
    if len(parts) < 2:
        return []
    alike: dict[Any, list[Any]] = {}
    for part in parts:
        factor, shape = part.as_independent(*flat, as_Add=False)
        alike.setdefault(shape, []).append(factor)
    several = [(shape, some) for shape, some in alike.items() if 1 < len(some) < len(parts)]
    sums = [sympy.factor(sympy.Add(*some)) * shape for shape, some in several]
    return [
        (_as_text(part), sympy.lambdify(flat, part.subs(numbers), "numpy"))
        for part in (*sums, *parts)
    ]


def _names(kane: Kane) -> tuple[list[str], ...]:
    """What a term depends on: time, coordinates, speeds, parameters."""
    return (
        ["t"],
        list(kane.coordinate_names),
        [f"u.{name}" for name in kane.speed_names],
        list(kane.mechanism.parameters),
    )


def _in_symbols(kane: Kane, key: Key, row: int) -> Any:
    """A term in SymPy's symbols, sines collected; None where it is too long to be read."""
    if len(kane.speed_names) > MOST_WRITTEN_SPEEDS:
        return None
    mechanism = kane.mechanism
    system = trace(mechanism, vary=tuple(mechanism.parameters))
    term, own_q, own_u = _term(system, kane, key, row)
    names, expression = _names(kane), 0
    for part in _by_rates(term, own_u):  # each alone is short
        function = ca.Function("term", [system.t, own_q, own_u, system.p], [ca.densify(part)])
        tidied = _tidied(function, names)
        if tidied is None:
            return None
        expression = expression + tidied
    return expression


_TIDIED: LRUCache[Any] = LRUCache(512)
"""Terms in SymPy's symbols: simplifying one takes a tenth of a second, and each is asked for twice."""


def _tidied(function: ca.Function, names: Sequence[Sequence[str]]) -> Any:
    """The value of a function of arguments of those names, sines collected; None where it is too long."""
    if function.n_instructions() > MOST_INSTRUCTIONS:
        return None
    key = (function.serialize(), *map(tuple, names))
    return _TIDIED.get(key, lambda: _collected(function, names))


def _collected(function: ca.Function, names: Sequence[Sequence[str]]) -> Any:
    import sympy

    try:
        symbols = [[symbol_of(name) for name in group] for group in names]
        expression = to_sympy(function, symbols)[0][0]
        if _larger(expression, MOST_NODES):
            return None
        expanded = sympy.expand(sympy.nsimplify(sympy.sympify(expression), rational=True))
        return None if _larger(expanded, MOST_NODES) else sympy.fu(expanded)
    except (InputError, ValueError, TypeError, ArithmeticError):  # what SymPy cannot write
        return None


def _as_text(expression: Any) -> str:
    """An expression with numbers as people write them."""
    import sympy

    largest = max(fraction.denominator for fraction in FRACTIONS)
    odd = [r for r in expression.atoms(sympy.Rational) if r.q > largest]
    rounded = expression.xreplace({r: sympy.Float(f"{float(r):.6g}") for r in odd})
    return str(sympy.sstr(rounded, full_prec=False))


def _larger(expression: Any, most: int) -> bool:
    """Whether an expression has more than `most` nodes; shared ones count each time."""
    import sympy

    return sum(1 for _ in islice(sympy.preorder_traversal(expression), most + 1)) > most


def _term(system: System, kane: Kane, key: Key, row: int) -> tuple[SX, SX, SX]:
    """The term in own symbols, and these."""
    kind, name = key
    free = system.free_u
    n = len(free)
    own = kane.own
    own_q, own_u = (system.q, system.u) if own is None else (own.own_q, own.own_u)
    Y = ca.SX.eye(n) if own is None else own.Y

    def moved(x: SX) -> SX:
        """Expressed in own symbols."""
        if own is None:
            return x
        return ca.substitute(x, ca.vertcat(system.q, system.u), ca.vertcat(own.q, own.u))

    if kind == "inertia":
        j = kane.speed_names.index(name)
        M = moved(crba(system)[free, free])
        term = -ca.mtimes(Y.T, ca.mtimes(M, Y))[row, j]
    elif kind == "gyroscopic":
        bias = moved(rnea(system, system.at_rest)[free])
        if own is not None:
            rest = own.udot(system, ca.SX.zeros(own_u.shape[0]))
            bias = bias + ca.mtimes(moved(crba(system)[free, free]), rest)
        term = -ca.mtimes(Y.T, bias)[row]
    else:
        (force,) = (part.force for part in channels(system) if part.name == name)
        term = ca.mtimes(Y.T, moved(force[free]))[row]
    return term, own_q, own_u


def _by_rates(term: SX, u: SX) -> list[SX]:
    """The parts of a polynomial of second degree in the rates that are proportional to a product of these.

    The term itself, if it is none.
    """
    slope, curvature = ca.jacobian(term, u), ca.hessian(term, u)[0]
    if ca.depends_on(curvature, u):
        return [term]
    zero, count = ca.SX.zeros(u.shape[0]), u.shape[0]
    linear = [ca.substitute(slope[i], u, zero) * u[i] for i in range(count)]
    pairs = combinations_with_replacement(range(count), 2)
    square = [curvature[i, j] * u[i] * u[j] / (1 + (i == j)) for i, j in pairs]
    parts = [ca.substitute(term, u, zero), *linear, *square]
    return [part for part in map(ca.cse, parts) if not part.is_zero()] or [term]


# --- the terms that a mechanism's equations are made of ------------------------------------------
# Equations with one term T wrong by a factor k leave the residual (1 − k) T: twice the term where
# its sign is wrong, the term itself where it is missing. So the residual is compared with the
# model's own terms, and where none fits with products of sines, cosines and rates.


@dataclass(frozen=True, eq=False)
class Summand:
    """A candidate: what it is called and its values at the states (B,).

    A term of the model's own equation (with its sign in F_r + F*_r) has a `key`; a plain function has none.
    `symbols` is the term as people write it, where it is one summand of what has the name; `row` the
    equation that it is of; `of` the variables of a plain function, None where an acceleration is in it.
    """

    name: str
    values: Array
    key: Key | None = None
    symbols: str = ""
    row: int = 0
    of: frozenset[str] | None = None


def own_parts(test: EquationTest, udot: Array, row: int) -> list[Summand]:
    """The terms of one equation at the accelerations `udot`, whole and in their summands."""
    states, scale = test.states, float(test.typical(udot)[row])
    inertia = -test.M[:, row, :].T * udot
    whole = [Summand(_called(n), f[row], ("channel", n), row=row) for n, f in test.forces.items()]
    whole.append(
        Summand("the sum of the gyroscopic terms", -test.bias[row], ("gyroscopic", ""), row=row)
    )
    for name, values in zip(test.speeds, inertia):
        whole.append(Summand(inertia_term(name), values, ("inertia", name), row=row))
    parts = list(whole)
    for part in whole:
        assert part.key is not None
        kind, name = part.key
        for text, function in summands(test.kane, part.key, row):
            values = function(states.t, *states.q, *states.u)
            if kind == "inertia":
                text, values = f"{text}*u̇.{name}", values * udot[test.speeds.index(name)]
            values = np.broadcast_to(np.asarray(values, dtype=float), states.t.shape)
            parts.append(replace(part, values=values, symbols=text))
    sizes = (max_norm(part.values) for part in parts)
    return [part for part, size in zip(parts, sizes) if SAME * scale < size < np.inf]


def inertia_term(speed: str) -> str:
    """What the inertia term of an acceleration is called."""
    return f"the inertia term of {speed}'s acceleration"


def _called(channel: str) -> str:
    return "gravity" if channel == "gravity" else f"{channel!r}"


def plain_parts(states: States, udot: Array, coordinates: Sequence[int]) -> list[Summand]:
    """Products of sines and cosines of some coordinates, rates and accelerations."""
    q, names = states.q, states.coordinates
    shapes: list[tuple[str, Array, set[str]]] = [("", np.ones(len(states)), set())]
    for k in coordinates:
        of = {f"q.{names[k]}"}
        for text, angle in ((names[k], q[k]), (f"2·{names[k]}", 2 * q[k])):
            shapes += [(*shape, of) for shape in circular(text, angle)]
        shapes += [
            (f"{names[k]}{power}", q[k] ** p, of) for p, power in enumerate(("", "²", "³"), 1)
        ]
    for i, j in combinations(coordinates, 2):
        of = {f"q.{names[i]}", f"q.{names[j]}"}
        for text, angle in sums(names[i], names[j], q[i], q[j]):
            shapes += [(*shape, of) for shape in circular(text, angle)]
        shapes.append((f"({names[j]} - {names[i]})", q[j] - q[i], of))
    rates: list[tuple[str, Array, set[str] | None]] = [("", np.ones(len(states)), set())]
    for i, speed in enumerate(states.speeds):
        rates.append((f"u.{speed}", states.u[i], {f"u.{speed}"}))
        rates.append((f"u̇.{speed}", udot[i], None))
        for j in range(i, len(states.speeds)):
            of = {f"u.{speed}", f"u.{states.speeds[j]}"}
            product = f"u.{speed}²" if i == j else f"u.{speed}·u.{states.speeds[j]}"
            rates.append((product, states.u[i] * states.u[j], of))
    return [
        Summand(
            "·".join(filter(None, (a, b))) or "1",
            x * y,
            of=None if of_rates is None else frozenset(of | of_rates),
        )
        for a, x, of in shapes
        for b, y, of_rates in rates
    ]


def circular(text: str, angle: Array) -> list[tuple[str, Array]]:
    """Sine and cosine of an angle, in words and in values."""
    return [(f"sin({text})", np.sin(angle)), (f"cos({text})", np.cos(angle))]


def sums(a: str, b: str, x: Array, y: Array) -> list[tuple[str, Array]]:
    """Difference and sum of two variables, the later one first, in words and in values."""
    return [(f"{b} - {a}", y - x), (f"{b} + {a}", y + x)]


# --- which of them a residual is made of ---------------------------------------------------------

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


def explain_row(test: EquationTest, residual: Array, udot: Array, row: int) -> tuple[Match, ...]:
    """The model's own terms that the residual (B,) of one equation consists of; empty if it is no such sum.

    That the equation's own acceleration is missing is no explanation: the residual is the sum of all terms.
    """
    own = inertia_term(test.speeds[row])
    return _in_words(test, residual, own_parts(test, udot, row), own)


def explain_acceleration(test: EquationTest, error: Array, k: int) -> tuple[Match, ...]:
    """The terms of the model that the error (B,) of one acceleration consists of, as u̇ = M⁻¹(f) has them.

    Equations that were solved for the accelerations by hand have every force in every acceleration; a
    mistake in one of them is no term of any row of M u̇ = f.
    """
    return _in_words(test, -error, acceleration_parts(test, k), "")


def acceleration_parts(test: EquationTest, k: int) -> list[Summand]:
    """The terms of all equations but inertia as M⁻¹ brings them into one acceleration."""
    inverse: Array = np.asarray(np.linalg.inv(test.M), dtype=float)
    right = test.acceleration
    parts = [Summand(AS_A_WHOLE, right[k], ("whole", ""), row=k)]
    for row, speed in enumerate(test.speeds):
        share = inverse[:, k, row]
        where = f"equation {row + 1} ({speed})"
        drive = share * (sum(f[row] for f in test.forces.values()) - test.bias[row])
        parts.append(Summand(f"what drives {where}", drive, ("force", ""), row=row))
        parts += [
            replace(p, name=f"{p.name} of {where}", values=share * p.values)
            for p in own_parts(test, right, row)
            if p.key is not None and p.key[0] != "inertia"
        ]
    return [p for p in parts if np.abs(p.values).max() > 1e-9 * np.abs(right[k]).max()]


AS_A_WHOLE = "the acceleration as a whole"


def _in_words(
    test: EquationTest, residual: Array, parts: Sequence[Summand], own: str
) -> tuple[Match, ...]:
    """The fewest parts that a residual consists of, each with its formula and its term written out."""
    parameters = test.kane.mechanism.parameters

    def cost(part: Summand, coefficient: float) -> float:
        """Missing or of the other sign first, then twice or by half, then the plainest formula."""
        if _is_plain(1.0 - coefficient):
            return float(coefficient < 0.9)
        text = formula(1.0 - coefficient, parameters, _written(test, part))
        return 1.0 + symbols(text) if text else np.inf

    def whole(part: Summand, coefficient: float) -> bool:
        """Whether the equation's own acceleration would be missing: that says nothing."""
        return part.name == own and not part.symbols and abs(coefficient - 1.0) < SIX_DIGITS

    matches = explain_by(residual, parts, cost)
    if any(whole(*match) for match in matches):
        matches = ()
    odd = len(matches) > 1 and not all(np.isfinite(cost(*match)) for match in matches)
    if not matches or odd:
        varied = _with_ratio(test, residual, parts)
        if varied:
            return varied
    terms = []
    for part, c in matches:
        term = _written(test, part)
        text = "" if _is_plain(1.0 - c) else formula(1.0 - c, parameters, term)
        terms.append(Match(part.name, c, 1.0 - c, term, text))
    return tuple(terms)


def _written(test: EquationTest, part: Summand) -> str:
    if part.symbols or part.key is None or part.key[0] in ("whole", "force"):
        return part.symbols
    return written(test.kane, part.key, part.row)


def _with_ratio(test: EquationTest, residual: Array, parts: Sequence[Summand]) -> tuple[Match, ...]:
    """One part that enters with a plain function of the state as its factor, the plainest; empty for none."""
    texts, F = ratios(test)
    size = float(np.linalg.norm(residual))
    best: tuple[Match, ...] = ()
    least = np.inf
    for part in parts:
        if part.key is None:
            continue
        stands = part.values - residual
        Z = F * part.values
        with np.errstate(all="ignore"):
            c = (Z @ stands) / np.einsum("sb,sb->s", Z, Z)
            rest = np.linalg.norm(stands - c[:, None] * Z, axis=1)
        fits = np.flatnonzero((rest <= HALF_DIGITS * size) & (np.abs(c) > SIX_DIGITS))
        term = _written(test, part) if len(fits) else ""
        for k in fits:
            number = float(c[k])
            text = formula(number, test.kane.mechanism.parameters, term or "1")
            odd = not text and abs(abs(number) - 1.0) >= SIX_DIGITS
            price = symbols(texts[k]) + symbols(text) + (symbols(f"{number:.6f}") if odd else 0)
            if price < least:
                best, least = (Match(part.name, number, number, term, text, texts[k]),), price
    return best


def ratios(test: EquationTest) -> tuple[list[str], Array]:
    """Plain functions of the state that are forgotten, put in, or stand for others: texts and values."""
    states = test.states
    own = list(zip(states.coordinates, states.q))[:MOST_WRITTEN_SPEEDS]
    shapes = [s for name, x in own for s in (*circular(name, x), (name, x))]
    for (a, x), (b, y) in combinations(own, 2):
        shapes += [s for text, angle in sums(a, b, x, y) for s in circular(text, angle)]
    u = [(f"u.{name}", x) for name, x in zip(states.speeds, states.u)][:MOST_WRITTEN_SPEEDS]
    pairs = combinations(u, 2)
    rates = [*u, *((f"({text})", z) for (a, x), (b, y) in pairs for text, z in sums(b, a, y, x))]
    factors: list[tuple[str, Array]] = []
    with np.errstate(all="ignore"):
        for some in (shapes, rates):
            for text, x in some:
                factors += [(text, x), (f"1/{text}", 1.0 / x)]
                factors += [(f"{text}²", x**2), (f"1/{text}²", 1.0 / x**2)]
            factors += [(f"{a}/{b}", x / y) for (a, x), (b, y) in permutations(some, 2)]
        factors += [(f"({a}/{b})²", (x / y) ** 2) for (a, x), (b, y) in permutations(rates, 2)]
    finite = [(text, values) for text, values in factors if np.isfinite(values).all()]
    rows = np.array([values for _, values in finite]).reshape(-1, len(states))
    return [text for text, _ in finite], rows


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
    cost: Callable[[Summand, float], float] = lambda part, coefficient: 0.0,
) -> tuple[tuple[Summand, float], ...]:
    """The fewest parts whose sum with constant coefficients is the residual (B,); empty if none is.

    By orthogonal matching pursuit, of fewer parts than a quarter of the states: more would fit anything. Of
    parts that are proportional to each other, the one whose coefficient `cost` least.
    """
    usable = [p for p in parts if float(np.linalg.norm(p.values)) > 0.0]
    size = float(np.linalg.norm(residual))
    if not usable or size == 0.0:
        return ()
    sizes = np.array([np.linalg.norm(p.values) for p in usable])
    directions = np.array([p.values for p in usable]) / sizes[:, None]
    chosen: list[int] = []
    remainder = residual
    for _ in range(min(TRIAL_STATES, len(residual) // 4)):
        fit = np.abs(directions @ remainder)
        fit[chosen] = -1.0
        chosen.append(int(np.argmax(fit)))
        A = directions[chosen].T
        along = np.linalg.lstsq(A, residual, rcond=None)[0]
        remainder = residual - A @ along
        if float(np.linalg.norm(remainder)) <= HALF_DIGITS * size:
            break
    else:
        return ()
    matches = []
    for k, share in zip(chosen, along):
        if abs(share) < SIX_DIGITS * size:
            continue
        cosines = directions @ directions[k]
        alike = np.flatnonzero(1.0 - cosines**2 < HALF_DIGITS)
        fits = [(usable[j], float(share * cosines[j] / sizes[j])) for j in alike]
        matches.append(min(fits, key=lambda match: cost(*match)))
    return tuple(matches)


def _is_plain(factor: float) -> bool:
    """Whether a factor is −1, 0, 2 or ½."""
    return any(abs(factor - plain) < SIX_DIGITS for plain in FACTORS)


# --- numbers as formulas in a model's parameters: 0.583 as l2/l1, 0.102 as 1/g -------------------


def symbols(text: str) -> int:
    """How many names, numbers and signs a formula has: of two that fit, the one with fewer is meant."""
    return len(re.findall(r"\w+|[^\w\s]", text))


def formula(number: float, parameters: Mapping[str, float], within: str | None = None) -> str:
    """The plainest product of a fraction and of powers of at most two parameters that a number is.

    Empty if it is none. Parameters that are 0 or 1 are never named. `within` is the term whose factor the
    number is: what is divided by must be in it.
    """
    if not np.isfinite(number) or number == 0.0 or abs(abs(number) - 1.0) < SIX_DIGITS:
        return ""
    logs, products = _products(
        tuple(
            (name, abs(value))
            for name, value in parameters.items()
            if value != 0.0 and abs(abs(value) - 1.0) > HALF_DIGITS
        )
    )
    inside = None if not within else set(re.findall(r"[A-Za-z_]\w*", within))
    for k in np.flatnonzero(np.abs(logs - np.log(abs(number))) < 2.0 * HALF_DIGITS):
        text, divisors = products[int(k)]
        if inside is None or divisors <= inside:
            return f"-{text}" if number < 0.0 else text
    return ""


@lru_cache(maxsize=16)
def _products(
    named: tuple[tuple[str, float], ...],
) -> tuple[Array, list[tuple[str, frozenset[str]]]]:
    """Logarithms of fractions and of powers of parameters, their texts and divisors, the plainest first."""
    values = {name: np.log(value) for name, value in named}
    powers: list[dict[str, int]] = [{name: p} for name in values for p in (1, -1, 2, -2)]
    several = [(f, some) for f in FRACTIONS for some in ({}, *powers)]
    exponents = ((1, 1), (-1, -1), (1, -1), (-1, 1), (2, -2), (-2, 2))
    for a, b in combinations(values, 2):
        several += [(Fraction(1), {a: p, b: q}) for p, q in exponents]
    rows = []
    for fraction, some in several:
        log = np.log(float(fraction)) + sum(p * values[name] for name, p in some.items())
        text, below = _as_python(fraction, some), frozenset(n for n, p in some.items() if p < 0)
        rows.append((symbols(text), float(log), text, below))
    rows.sort(key=lambda row: row[0])
    return np.array([log for _, log, *_ in rows]), [(text, below) for *_, text, below in rows]


def _as_python(fraction: Fraction, powers: Mapping[str, int]) -> str:
    def product(number: int, sign: int) -> list[str]:
        factors = [
            n if abs(p) == 1 else f"{n}**{abs(p)}" for n, p in powers.items() if p * sign > 0
        ]
        return factors if number == 1 else [str(number), *factors]

    above, below = product(fraction.numerator, 1), product(fraction.denominator, -1)
    top = "*".join(above) or "1"
    if not below:
        return top
    return f"{top}/{below[0]}" if len(below) == 1 else f"{top}/({'*'.join(below)})"
