"""A term of a mechanism's equations as people write it, in the model's parameters."""

from __future__ import annotations

from itertools import islice
from typing import Any

import casadi as ca

from deltac.diagnosis.kane import Kane
from deltac.dynamics.coordinates import trace_map
from deltac.dynamics.forces import channels
from deltac.dynamics.recursions import crba, gather, rnea
from deltac.dynamics.spatial import SX, cross
from deltac.dynamics.system import System, trace
from deltac.errors import InputError
from deltac.kernels.lowering import to_sympy
from deltac.mechanism.laws import symbol_of

MOST_SPEEDS = 4
"""Terms grow exponentially with the number of speeds, and so does the time to simplify them."""

MOST_INSTRUCTIONS, MOST_NODES = 300, 500
"""Of a term before it is simplified: SymPy takes a second for the latter."""

LONGEST = 100
"""Characters of a term that is still worth reading."""

PLAIN = 12
"""The largest denominator of a fraction that is not written as a decimal number."""

Key = tuple[str, str, tuple[int, ...] | None]
"""What a term is: its kind, the channel, speed or body, and the rates that it is proportional to."""


def written(kane: Kane, key: Key, row: int) -> str:
    """A term of the equation of one own speed, with its sign in F_r + F*_r; "" if it is too long."""
    if len(kane.speed_names) > MOST_SPEEDS or key[0] == "inertia by body":
        return ""
    mechanism = kane.mechanism
    system = trace(mechanism, vary=tuple(mechanism.parameters))
    term, own_q, own_u = _term(system, kane, key, row)
    function = ca.Function("term", [system.t, own_q, own_u, system.p], [ca.densify(ca.cse(term))])
    if function.n_instructions() > MOST_INSTRUCTIONS:
        return ""
    names = [
        ["t"],
        list(kane.coordinate_names),
        [f"u.{name}" for name in kane.speed_names],
        list(mechanism.parameters),
    ]
    try:
        found = to_sympy(function, [[symbol_of(name) for name in group] for group in names])[0][0]
        text = _tidy(found)
    except (InputError, ValueError, TypeError, ArithmeticError):  # what SymPy cannot write
        return ""
    return text if len(text) <= LONGEST else ""


def _tidy(expression: Any) -> str:
    """Sums of products of sines collected, numbers as people write them."""
    import sympy

    if _larger(expression, MOST_NODES):
        return ""
    expanded = sympy.expand(sympy.nsimplify(sympy.sympify(expression), rational=True))
    if _larger(expanded, MOST_NODES):
        return ""
    found = sympy.factor(sympy.fu(expanded))
    odd = [r for r in found.atoms(sympy.Rational) if r.q > PLAIN]
    rounded = found.xreplace({r: sympy.Float(f"{float(r):.6g}") for r in odd})
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
    own = None if kane.coordinates is None else trace_map(system, kane.coordinates)
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
