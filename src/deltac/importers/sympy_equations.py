"""Equations of motion from `sympy.physics.mechanics`, as equations under test."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from deltac.calls.arguments import checked
from deltac.dynamics import equations_of, to_casadi, trace
from deltac.errors import ModelError, UnknownName, WrongType, closest
from deltac.kernels import to_sympy
from deltac.mechanism import (
    JOINT_KINDS,
    CoordinateMap,
    Law,
    LawLike,
    Mechanism,
    as_law,
    symbol_names,
    symbol_of,
)
from deltac.simulation import Equations

if TYPE_CHECKING:
    from sympy import Expr, Matrix
    from sympy.physics.mechanics import KanesMethod, LagrangesMethod


@checked
def equations_from_sympy(
    method: KanesMethod | LagrangesMethod,
    coordinates: Mapping[str, Expr] | None = None,
    *,
    speeds: Mapping[str, Expr] | None = None,
    inverse: Mapping[str, LawLike] | None = None,
    parameters: Mapping[Expr | str, LawLike] | None = None,
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
        InputError: an object of another class, equations that were not formed, or a constant without a value.
    """
    t, q, u, rates, M, f = _formed(method)
    values = _values(parameters or {})
    state = {v: symbol_of(f"q.{_name_of(v)}") for v in q} | {
        v: symbol_of(f"u.{_name_of(w)}") for v, w in zip(u, _speed_variables(q, u, rates))
    }

    def law(expression: Any, what: str) -> Law:
        import sympy

        expr = sympy.sympify(expression).xreplace(rates).xreplace(state)
        expr = expr.xreplace({s: v for s, v in values.items() if not isinstance(s, str)})
        named = {s: values[s.name] for s in expr.free_symbols if s.name in values}
        expr = as_law(expr.xreplace(named).doit(), f"{what} of {name}")
        symbols = {"t", *(s.name for s in state.values())}
        for symbol in sorted(symbol_names(expr) - symbols):
            raise UnknownName(
                f"{name}: no value for {symbol!r}; give it in parameters="
                f"{{{symbol!r}: …}}{closest(symbol, [str(s) for s in values]) if values else ''}"
            )
        return expr

    own_q = tuple(_name_of(v) for v in q)
    own_u = tuple(_name_of(v) for v in _speed_variables(q, u, rates))
    laws = coordinates if coordinates is not None else {n: v for n, v in zip(own_q, q)}
    q_laws = {c: law(e, f"coordinate {c!r}") for c, e in laws.items()}
    if speeds is None:
        u_laws = {c: law(_rate(e, t), f"rate of {c!r}") for c, e in laws.items()}
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
        raise WrongType(
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
        raise ModelError(
            f"the {type(method).__name__} has no equations yet ({error}); call {forming}() first"
        ) from None
    return t, q, u, rates, M, f


def _speed_variables(q: Sequence[Any], u: Sequence[Any], rates: Mapping[Any, Any]) -> list[Any]:
    """What each speed is called after: the coordinate whose rate it is, or itself."""
    variables = []
    for speed in u:
        if speed.is_Derivative:
            variables.append(speed.args[0])
            continue
        same = [
            rate.args[0] for rate, value in rates.items() if value == speed and rate.args[0] in q
        ]
        variables.append(same[0] if same else speed)
    return variables


def _name_of(variable: Any) -> str:
    return str(variable.func.__name__) if hasattr(variable, "func") else str(variable)


def _rate(expression: Any, t: Any) -> Any:
    import sympy

    return sympy.sympify(expression).diff(t)


def _values(parameters: Mapping[Any, Any]) -> dict[Any, Any]:
    """Values by symbol or function, and by name."""
    import sympy

    numbers: dict[Any, Any] = {}
    for key, value in parameters.items():
        numbers[key] = sympy.sympify(as_law(value, f"parameter {key}"))
    return numbers


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


# --- the equations of motion of a small mechanism, to read ---------------------------------------

MOST_SPEEDS_WRITTEN = 8
"""Most free speeds for which equations are written out: their size grows exponentially."""


@dataclass(frozen=True, eq=False)
class SymbolicEquations:
    """M u̇ + h = Gᵀ λ, with G u̇ + γ = 0, for the free speeds, as SymPy matrices.

    `M` (n by n) is the mass matrix; `h` (n) holds the gyroscopic and all active forces, those with
    the sign of h: h = −(forces) + (velocity terms). `G` (m by n) and `gamma` (m) are there for
    constraints, else m = 0. Their symbols are `t`, `q.<coordinate>`, `u.<speed>`, the parameters, and
    `input.<motor>` for motors without a law.
    """

    coordinates: tuple[str, ...]
    speeds: tuple[str, ...]
    M: Matrix
    h: Matrix
    G: Matrix
    gamma: Matrix
    rates: frozenset[str]

    def latex(self) -> str:
        r"""The equations in LaTeX, to be set in a display: M \dot u + h = G^T λ."""
        import sympy

        names = {symbol_of(f"q.{c}"): rf"q_{{\text{{{_text(c)}}}}}" for c in self.coordinates}
        speeds = [
            rf"\dot{{q}}_{{\text{{{_text(s)}}}}}"
            if s in self.rates
            else rf"u_{{\text{{{_text(s)}}}}}"
            for s in self.speeds
        ]
        names |= {symbol_of(f"u.{s}"): written for s, written in zip(self.speeds, speeds)}
        for symbol in self.h.free_symbols:
            if symbol.name.startswith("input."):
                names[symbol] = rf"\tau_{{\text{{{_text(symbol.name[6:])}}}}}"

        def matrix(value: Any) -> str:
            return str(sympy.latex(value, symbol_names=names, mat_str="bmatrix", mat_delim=""))

        dots = [
            rf"\ddot{{q}}_{{\text{{{_text(s)}}}}}" if s in self.rates else rf"\dot{written}"
            for s, written in zip(self.speeds, speeds)
        ]
        column = r"\begin{bmatrix}" + r"\\".join(dots) + r"\end{bmatrix}"
        right = "0" if not len(self.gamma) else matrix(self.G) + r"^{\mathsf{T}} \lambda"
        lines = f"{matrix(self.M)} {column} + {matrix(self.h)} = {right}"
        if len(self.gamma):
            lines += rf", \qquad {matrix(self.G)} {column} + {matrix(self.gamma)} = 0"
        return lines


def symbolic_equations(mechanism: Mechanism, *, simplify: bool = True) -> SymbolicEquations:
    """Write the equations of motion of a mechanism out: the core of `deltac.symbolic_equations`."""
    free = mechanism.free
    if len(free.u) > MOST_SPEEDS_WRITTEN:
        raise ModelError(
            f"symbolic equations: {mechanism.name} has {len(free.u)} free speeds, expected "
            f"{MOST_SPEEDS_WRITTEN} at most; equations of larger systems fill pages"
        )
    motion = equations_of(trace(mechanism, tuple(mechanism.parameters)))
    system, rows = motion.system, motion.rows
    outputs = {
        "M": motion.M,
        "h": (motion.bias - motion.force)[system.free_u],
        "G": rows.G,
        "gamma": rows.gamma,
    }
    arguments = [system.t, system.q, system.u, system.inputs, system.p]
    function = ca.Function("equations", arguments, [ca.densify(e) for e in outputs.values()])
    coordinates = mechanism.coordinates.free_names
    speeds = mechanism.speeds.free_names
    symbols = [
        [symbol_of("t")],
        [symbol_of(f"q.{c}") for c in coordinates],
        [symbol_of(f"u.{s}") for s in speeds],
        _inputs(mechanism),
        [symbol_of(p) for p in mechanism.parameters],
    ]
    expressions = to_sympy(function, symbols)
    blocks = {
        what: _matrix(entries, expression.shape, simplify)
        for (what, expression), entries in zip(outputs.items(), expressions)
    }
    kinds = {joint.name: JOINT_KINDS[joint.kind] for joint in mechanism.joints}
    rates = frozenset(e.name for e in mechanism.speeds if kinds[e.joint].rates)
    return SymbolicEquations(coordinates, speeds, **blocks, rates=rates)


def _inputs(mechanism: Mechanism) -> list[Any]:
    from deltac.mechanism import JointTorque

    return [
        symbol_of(f"input.{element.name}" + (f".{k}" if len(joint.speeds) > 1 else ""))
        for element in mechanism.elements
        if isinstance(element, JointTorque) and element.torque is None
        for joint in [mechanism.joint(element.joint)]
        for k in range(len(joint.speeds))
    ]


def _matrix(entries: list[Any], shape: tuple[int, int], simplify: bool) -> Any:
    """A SymPy matrix from entries column by column."""
    import sympy

    rows, columns = shape
    tidy = [_tidy(sympy.sympify(entry), simplify) for entry in entries]
    return sympy.Matrix(rows, columns, lambda i, j: tidy[i + j * rows])


def _tidy(entry: Any, simplify: bool) -> Any:
    """Short fractions in place of floats (0.5 → 1/2); expanded, with sines and cosines gathered."""
    import sympy

    def fraction(number: Any) -> Any:
        near = sympy.Rational(str(number)).limit_denominator(1000)
        close = abs(float(near) - float(number)) <= 1e-15 * abs(float(number))
        return near if close else number

    entry = entry.xreplace({number: fraction(number) for number in entry.atoms(sympy.Float)})
    return sympy.trigsimp(sympy.expand(entry)) if simplify else entry


def _text(name: str) -> str:
    return name.replace("_", r"\_")
