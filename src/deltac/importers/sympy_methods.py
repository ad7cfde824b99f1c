"""Equations of motion from `sympy.physics.mechanics`, as equations under test."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from deltac.dynamics.laws import to_casadi
from deltac.errors import InputError, closest
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.laws import Law, as_law, symbol_names, symbol_of
from deltac.simulation.equations import Equations


def equations_from_sympy(
    method: Any,
    coordinates: Mapping[str, Any] | None = None,
    *,
    speeds: Mapping[str, Any] | None = None,
    inverse: Mapping[str, Any] | None = None,
    parameters: Mapping[Any, Any] | None = None,
    name: str = "equations from SymPy",
) -> Equations:
    """The equations of a `KanesMethod` or `LagrangesMethod`, compiled, in the method's own q and u.

    Args:
        method: after `kanes_equations()` or `form_lagranges_equations()`.
        coordinates: each free coordinate of the mechanism as an expression of the method's q and the time;
            left out, the method's q have the names of the mechanism's coordinates.
        speeds: each free speed as an expression of the method's q and u, where the mechanism's speeds are not
            the rates of its coordinates (quaternions).
        inverse: the method's q, by name, as laws of the mechanism's ``q.<coordinate>``; needed where
            `coordinates` are not linear.
        parameters: values of the method's constants and of functions of time, by symbol or by name.
        name: what reports call the equations.

    Returns:
        `Equations` whose coordinate map names the state in the method's order, `method.q` then `method.u`.

    Raises:
        InputError: another object, equations that were not formed, or a constant without a value.
    """
    t, q, u, rates, M, f = _formed(method)
    values = _values(parameters or {})
    state = {v: symbol_of(f"q.{_name_of(v)}") for v in q} | {
        v: symbol_of(f"u.{_name_of(w)}") for v, w in zip(u, _speed_variables(q, u, rates))
    }

    def law(expression: Any, what: str) -> Law:
        import sympy

        found = sympy.sympify(expression).xreplace(rates).xreplace(state)
        found = found.xreplace({s: v for s, v in values.items() if not isinstance(s, str)})
        named = {s: values[s.name] for s in found.free_symbols if s.name in values}
        found = as_law(found.xreplace(named).doit(), f"{what} of {name}")
        known = {"t", *(s.name for s in state.values())}
        for symbol in sorted(symbol_names(found) - known):
            raise InputError(
                f"{name}: no value for {symbol!r}; give it in parameters="
                f"{{{symbol!r}: …}}{closest(symbol, [str(s) for s in values]) if values else ''}"
            )
        return found

    own_q = tuple(_name_of(v) for v in q)
    own_u = tuple(_name_of(v) for v in _speed_variables(q, u, rates))
    given = coordinates if coordinates is not None else {n: v for n, v in zip(own_q, q)}
    q_laws = {c: law(e, f"coordinate {c!r}") for c, e in given.items()}
    if speeds is None:
        u_laws = {c: law(_rate(e, t), f"rate of {c!r}") for c, e in given.items()}
    else:
        u_laws = {c: law(e, f"speed {c!r}") for c, e in speeds.items()}
    plain = speeds is None and all(state[v].name == f"u.{c}" for v, c in zip(u, own_q))
    mapped = CoordinateMap(
        own_q,
        () if plain else own_u,
        q=q_laws,
        u={} if plain else u_laws,
        inverse=inverse or {},
    )
    rows = [[law(M[i, j], "mass matrix") for j in range(M.shape[1])] for i in range(M.shape[0])]
    right = [law(f[i], "forcing") for i in range(M.shape[0])]
    symbols = ([s.name for s in (state[v] for v in q)], [state[v].name for v in u])
    return Equations(_compiled(rows, right, *symbols), coordinates=mapped, name=name)


def _formed(method: Any) -> tuple[Any, list[Any], list[Any], dict[Any, Any], Any, Any]:
    """Time, q, u, the rates q̇ and u, and M, f of M (u̇, λ) = f."""
    from sympy.physics.mechanics import KanesMethod, LagrangesMethod, dynamicsymbols

    t = dynamicsymbols._t
    if isinstance(method, KanesMethod):
        q, u = list(method.q), list(method.u)
        forming, rates = "kanes_equations", dict(method.kindiffdict())
    elif isinstance(method, LagrangesMethod):
        q, u = list(method.q), [v.diff(t) for v in method.q]
        forming, rates = "form_lagranges_equations", {}
    else:
        raise InputError(
            f"equations_from_sympy: found {type(method).__name__}, expected a KanesMethod or a "
            "LagrangesMethod of sympy.physics.mechanics"
        )
    try:
        if isinstance(method, LagrangesMethod) and method.coneqs:
            # Accelerations and multipliers together; the rows of q̇ stand before them.
            n = len(q)
            M, f = method.mass_matrix_full[n:, n:], method.forcing_full[n:, :]
        else:
            M, f = method.mass_matrix, method.forcing
    except (ValueError, AttributeError, TypeError) as error:
        raise InputError(
            f"the {type(method).__name__} has no equations yet ({error}); call {forming}() first"
        ) from None
    return t, q, u, rates, M, f


def _speed_variables(q: Sequence[Any], u: Sequence[Any], rates: Mapping[Any, Any]) -> list[Any]:
    """What each speed is called after: the coordinate whose rate it is, or itself."""
    found = []
    for speed in u:
        if speed.is_Derivative:
            found.append(speed.args[0])
            continue
        same = [
            rate.args[0] for rate, value in rates.items() if value == speed and rate.args[0] in q
        ]
        found.append(same[0] if same else speed)
    return found


def _name_of(variable: Any) -> str:
    return str(variable.func.__name__) if hasattr(variable, "func") else str(variable)


def _rate(expression: Any, t: Any) -> Any:
    import sympy

    return sympy.sympify(expression).diff(t)


def _values(parameters: Mapping[Any, Any]) -> dict[Any, Any]:
    """Values by symbol or function, and by name."""
    import sympy

    made: dict[Any, Any] = {}
    for key, value in parameters.items():
        made[key] = sympy.sympify(as_law(value, f"parameter {key}"))
    return made


def _compiled(
    M: Sequence[Sequence[Law]], f: Sequence[Law], q_names: Sequence[str], u_names: Sequence[str]
) -> Any:
    """rhs(t, q, u): M⁻¹ f, of which the first entries are u̇ (others are multipliers)."""
    t, q, u = ca.SX.sym("t"), ca.SX.sym("q", len(q_names)), ca.SX.sym("u", len(u_names))
    values: dict[str, Any] = {"t": t}
    values |= {name: q[k] for k, name in enumerate(q_names)}
    values |= {name: u[k] for k, name in enumerate(u_names)}
    matrix = ca.vertcat(*(ca.horzcat(*(to_casadi(x, values) for x in row)) for row in M))
    right = ca.vertcat(*(to_casadi(x, values) for x in f))
    udot = ca.solve(ca.densify(matrix), right)[: len(u_names)]
    function = ca.Function("rhs", [t, q, u], [ca.cse(udot)])

    def rhs(t: Any, q: Any, u: Any) -> Any:
        if np.asarray(q).dtype == object:
            traced = function(t, ca.vertcat(*q), ca.vertcat(*u))
            return np.array([traced[k] for k in range(len(u_names))], dtype=object)
        q, u = np.asarray(q, dtype=np.float64), np.asarray(u, dtype=np.float64)
        t = np.asarray(t, dtype=np.float64).reshape(1, -1)
        return np.array(function(t, q, u)).reshape(u.shape)

    return rhs
