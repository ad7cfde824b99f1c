"""A term of a mechanism's equations as people write it, in the model's parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import combinations, combinations_with_replacement, islice
from typing import Any

import casadi as ca
import numpy as np

from deltac.arrays import SAME, Array
from deltac.calls.caching import LRUCache
from deltac.diagnosis.residuals.at_states import EquationTest
from deltac.diagnosis.residuals.kane import Kane
from deltac.diagnosis.residuals.states import States
from deltac.dynamics.forces import channels
from deltac.dynamics.recursions import crba, rnea
from deltac.dynamics.spatial import SX
from deltac.dynamics.system import System, trace
from deltac.errors import InputError
from deltac.kernels.lowering import to_sympy
from deltac.mechanism.expressions import symbol_of
from deltac.results import TEXT_WIDTH

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
        still = ca.SX(system.udot_all)
        still[free] = 0
        bias = moved(rnea(system, still)[free])
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
    sizes = (float(np.abs(part.values).max()) for part in parts)
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
