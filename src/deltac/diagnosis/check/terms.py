"""A term of a mechanism's equations as people write it, in the model's parameters."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, islice
from typing import Any

import casadi as ca
import numpy as np

from deltac.arrays import SAME, Array
from deltac.calls.caching import LRUCache
from deltac.diagnosis.residuals.at_states import EquationTest
from deltac.diagnosis.residuals.kane import Kane, times
from deltac.diagnosis.residuals.states import States, joined
from deltac.dynamics.equations_of_motion import evaluate_at, matrices
from deltac.dynamics.forces import channels
from deltac.dynamics.recursions import crba, gather, rnea, velocities
from deltac.dynamics.spatial import SX, cross
from deltac.dynamics.system import System, trace
from deltac.errors import InputError
from deltac.kernels.lowering import to_sympy
from deltac.mechanism.expressions import symbol_of

MOST_WRITTEN_SPEEDS = 4
"""Terms grow exponentially with the number of speeds, and so does the time to simplify them;
so many coordinates and speeds have plain functions of a residual or a factor."""

MOST_INSTRUCTIONS, MOST_NODES = 300, 500
"""Of a term before it is simplified: SymPy takes a second for the latter."""

MOST_SUMMANDS = 24
"""Summands into which a term is divided."""

LONGEST_TERM = 100
"""Characters of a term that is still worth reading."""

PLAIN = 12
"""The largest denominator of a fraction that is not written as a decimal number."""

Key = tuple[str, str, tuple[int, ...] | None]
"""What a term is: its kind, the channel, speed or body, and the rates that it is proportional to."""


def written(kane: Kane, key: Key, row: int) -> str:
    """A term of the equation of one own speed, with its sign in F_r + F*_r; "" if it is too long."""
    expression = _in_symbols(kane, key, row)
    if expression is None:
        return ""
    import sympy

    text = _as_text(sympy.factor(expression))
    return text if len(text) <= LONGEST_TERM else ""


def summands(kane: Kane, key: Key, row: int) -> list[tuple[str, Any]]:
    """The summands of a term as people write them, with functions of (t, q, u) that give their values.

    Products of parameters, functions of the coordinates and rates, at the mechanism's parameters. Empty for
    a term that is one product, or too long.
    """
    expression = _in_symbols(kane, key, row)
    if expression is None:
        return []
    import sympy

    parts = sympy.Add.make_args(sympy.expand(expression))
    if not 1 < len(parts) <= MOST_SUMMANDS:
        return []
    names, values = _names(kane), kane.mechanism.parameters
    numbers = {symbol_of(name): value for name, value in values.items()}
    arguments = [[symbol_of(name) for name in group] for group in names[:3]]
    flat = [symbol for group in arguments for symbol in group]
    return [(_as_text(part), sympy.lambdify(flat, part.subs(numbers), "numpy")) for part in parts]


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
    if len(kane.speed_names) > MOST_WRITTEN_SPEEDS or key[0] == "inertia by body":
        return None
    mechanism = kane.mechanism
    system = trace(mechanism, vary=tuple(mechanism.parameters))
    term, own_q, own_u = _term(system, kane, key, row)
    function = ca.Function("term", [system.t, own_q, own_u, system.p], [ca.densify(ca.cse(term))])
    if function.n_instructions() > MOST_INSTRUCTIONS:
        return None
    names = _names(kane)
    return _TIDIED.get((function.serialize(), *map(tuple, names)), lambda: _tidied(function, names))


_TIDIED: LRUCache[Any] = LRUCache(512)
"""Terms in SymPy's symbols: simplifying one takes a tenth of a second, and each is asked for twice."""


def _tidied(function: ca.Function, names: Sequence[Sequence[str]]) -> Any:
    """The value of a function of arguments of those names, sines collected; None where it is too long."""
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

    odd = [r for r in expression.atoms(sympy.Rational) if r.q > PLAIN]
    rounded = expression.xreplace({r: sympy.Float(f"{float(r):.6g}") for r in odd})
    return str(sympy.sstr(rounded, full_prec=False))


def _larger(expression: Any, most: int) -> bool:
    """Whether an expression has more than `most` nodes; shared ones count each time."""
    import sympy

    return sum(1 for _ in islice(sympy.preorder_traversal(expression), most + 1)) > most


def _term(system: System, kane: Kane, key: Key, row: int) -> tuple[SX, SX, SX]:
    """The term in own symbols, and these."""
    kind, name, rates = key
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
    elif kind == "weight":
        k = system.index[name]
        link = system.links[k]
        weight = link.mass * ca.mtimes(system.poses[k].E, system.gravity)
        wrench = ca.vertcat(cross(link.centre, weight), weight)
        term = ca.mtimes(Y.T, moved(gather(system, {k: wrench})[free]))[row]
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
    return _proportional(term, own_u, rates), own_q, own_u


def _proportional(term: SX, u: SX, rates: tuple[int, ...] | None) -> SX:
    """The part of a polynomial of the rates that is proportional to some of them; all of it for None."""
    if rates is None:
        return term
    part, factor = term, ca.SX(1)
    for i in rates:
        part, factor = ca.jacobian(part, u[i]), factor * u[i]
    if len(rates) == 2 and rates[0] == rates[1]:
        factor = factor / 2
    return ca.substitute(part, u, ca.SX.zeros(u.shape[0])) * factor


# --- the terms that a mechanism's equations are made of ------------------------------------------
# Equations with one term T wrong by a factor k leave the residual (1 − k) T: twice the term where
# its sign is wrong, the term itself where it is missing. So the residual is compared with the
# model's own terms, and where none fits with products of sines, cosines and rates.


MOST_DIVIDED_SPEEDS = 8
"""Speeds up to which terms are divided by bodies and pairs of rates."""

SUMMED = ("channel", "gyroscopic", "inertia")
"""Kinds of terms that are divided into summands."""


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
    """The terms of one equation at the accelerations `udot`, whole and in their parts."""
    names = test.speeds
    scale = float(test.typical(udot)[row])
    own: list[Summand] = []

    def add(name: str, values: Array, key: Key, symbols: str = "") -> None:
        values = np.broadcast_to(np.asarray(values, dtype=float), test.states.t.shape)
        if np.abs(values).max() > SAME * scale and np.isfinite(values).all():
            own.append(Summand(name, values, key, symbols, row))

    for channel, force in test.forces.items():
        add(_called(channel), force[row], ("channel", channel, None))
    inertia = -test.M[:, row, :].T * udot
    add("the sum of the gyroscopic terms", -test.bias[row], ("gyroscopic", "", None))
    by_rates = _by_rates(test, row) if len(names) <= MOST_DIVIDED_SPEEDS else ()
    for name, values, key in by_rates:
        add(name, values, key)
    for j, name in enumerate(names):
        add(inertia_term(name), inertia[j], ("inertia", name, None))
    if len(names) <= MOST_DIVIDED_SPEEDS:
        for name, values, key in _by_bodies(test, udot, row):
            add(name, values, key)
    for part in [p for p in own if p.key is not None and p.key[0] in SUMMED and p.key[2] is None]:
        assert part.key is not None
        for text, function in summands(test.kane, part.key, row):
            values = function(test.states.t, *test.states.q, *test.states.u)
            if part.key[0] == "inertia":
                text = f"{text}*u̇.{part.key[1]}"
                values = values * udot[names.index(part.key[1])]
            add(part.name, values, part.key, text)
    return own


def inertia_term(speed: str) -> str:
    """What the inertia term of an acceleration is called."""
    return f"the inertia term of {speed}'s acceleration"


def _called(channel: str) -> str:
    return "gravity" if channel == "gravity" else f"{channel!r}"


def _by_rates(test: EquationTest, row: int) -> Iterable[tuple[str, Array, Key]]:
    """Parts of forces and gyroscopic terms by the rates that they are proportional to."""
    states = test.states
    along_rays = EquationTest(test.kane, rays(states), scales=test.scales, strict=False)
    gyroscopic: list[tuple[str, str, str, Array, Array]] = [
        ("the gyroscopic term", "gyroscopic", "", -along_rays.bias, -test.bias)
    ]
    acting = [(_called(c), "channel", c, along_rays.forces[c], test.forces[c]) for c in test.forces]
    for name, kind, which, along, whole in gyroscopic + acting:
        parts = with_rates(polarised(along[row], states), states.u)
        size = np.abs(whole[row]).max(initial=1e-300)
        if not np.allclose(sum(parts.values()), whole[row], atol=1e-9 * size):
            continue  # not a polynomial of the rates
        for rates, values in parts.items():
            how = f"with {product_of(test.speeds, rates)}" if rates else "at rest"
            yield f"{name} {how}", values, (kind, which, rates)


def rays(states: States) -> States:
    """The states at rest, then with single speeds ±1, then with pairs of speeds 1, one after the other."""
    n = len(states.u)
    unit = np.eye(n)
    pairs = [unit[i] + unit[j] for i, j in combinations(range(n), 2)]
    u = np.ones(len(states))
    along = [np.outer(ray, u) for ray in (np.zeros(n), *unit, *(-unit), *pairs)]
    return joined([replace(states, u=each) for each in along])


def polarised(along: Array, states: States) -> dict[tuple[int, ...], Array]:
    """Coefficients (B,) of a polynomial of second degree in the rates, from its values along `rays`.

    By the speeds that each is multiplied by: () for what is there at rest, (i,), (i, i), (i, j).
    """
    n = len(states.u)
    rest, *others = along.reshape(-1, len(states))
    plus, minus, both = others[:n], others[n : 2 * n], others[2 * n :]
    coefficients: dict[tuple[int, ...], Array] = {(): rest}
    for i in range(n):
        coefficients[i,] = 0.5 * (plus[i] - minus[i])
        coefficients[i, i] = 0.5 * (plus[i] + minus[i]) - rest
    for (i, j), values in zip(combinations(range(n), 2), both):
        coefficients[i, j] = values - plus[i] - plus[j] + rest
    return coefficients


def with_rates(
    coefficients: Mapping[tuple[int, ...], Array], u: Array
) -> dict[tuple[int, ...], Array]:
    """Coefficients (B,) times the products of speeds (n, B) that they belong to."""
    return {rates: c * u[list(rates)].prod(axis=0) for rates, c in coefficients.items()}


def product_of(speeds: Sequence[str], rates: tuple[int, ...]) -> str:
    """A product of speeds as people write it: "u.a", "u.a²", "u.a·u.b"; "" for none."""
    if len(set(rates)) < len(rates):
        return f"u.{speeds[rates[0]]}²"
    return "·".join(f"u.{speeds[k]}" for k in rates)


def _by_bodies(test: EquationTest, udot: Array, row: int) -> Iterable[tuple[str, Array, Key]]:
    """Gravity and inertia terms of each body alone."""
    kane, s = test.kane, test.kane.system
    free = s.free_u
    V = velocities(s, s.u_all)
    bodies, outputs = [], []
    for k, (link, pose) in enumerate(zip(s.links, s.poses)):
        if s.mechanism.body(link.joint.child).massless:
            continue
        weight = link.mass * ca.mtimes(pose.E, s.gravity)
        wrench: SX = ca.vertcat(cross(link.centre, weight), weight)
        J = ca.jacobian(V[k], s.u)
        columns = [link.inertia @ J[:, j] for j in range(J.shape[1])]
        bodies.append(link.joint.child)
        outputs.append(gather(s, {k: wrench})[free])
        outputs.append(ca.mtimes(J.T, ca.horzcat(*columns)))
    if not bodies:
        return
    point = test.point
    values = evaluate_at(kane.function(outputs), test.states.t[None, :], point.q, point.u)
    Yt, n = point.Y.transpose(0, 2, 1), len(free)
    for body, weight, flat in zip(bodies, values[::2], values[1::2]):
        yield f"gravity on body {body!r}", times(Yt, weight)[row], ("weight", body, None)
        M = Yt @ matrices(flat, n, n) @ point.Y
        for j, name in enumerate(test.speeds):
            yield (
                f"{inertia_term(name)} by body {body!r}",
                -M[:, row, j] * udot[j],
                ("inertia by body", body, None),
            )


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
            rates.append((product_of(states.speeds, (i, j)), states.u[i] * states.u[j], of))
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
