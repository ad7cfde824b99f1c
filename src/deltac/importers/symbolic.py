"""The equations of motion of a small mechanism, to read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from deltac.dynamics.equations_of_motion import equations_of_motion
from deltac.errors import InputError
from deltac.kernels.lowering import to_sympy
from deltac.mechanism.joints import KINDS
from deltac.mechanism.laws import symbol_of
from deltac.mechanism.mechanism import Mechanism

LARGEST = 8
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
    M: Any
    h: Any
    G: Any
    gamma: Any
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
    """Write a mechanism's equations of motion out in its coordinates, speeds and parameters.

    They are the recursions that the kernels run, carried over to SymPy, so that what is read is what is
    computed. `simplify` expands them and gathers sines and cosines, which takes seconds from 3 speeds on.

    Raises InputError for more than `LARGEST` free speeds.
    """
    free = mechanism.free
    if len(free.u) > LARGEST:
        raise InputError(
            f"symbolic equations: {mechanism.name} has {len(free.u)} free speeds, expected {LARGEST} "
            "at most; equations of larger systems fill pages"
        )
    motion = equations_of_motion(mechanism, vary=tuple(mechanism.parameters))
    system, rows = motion.system, motion.rows
    outputs = {
        "M": motion.M,
        "h": (motion.bias - motion.force)[system.free_u],
        "G": rows.G,
        "gamma": rows.gamma,
    }
    arguments = [system.t, system.q, system.u, system.inputs, system.p]
    function = ca.Function("equations", arguments, [ca.densify(e) for e in outputs.values()])
    coordinates = tuple(mechanism.coordinates[int(i)].name for i in free.q)
    speeds = tuple(mechanism.speeds[int(i)].name for i in free.u)
    symbols = [
        [symbol_of("t")],
        [symbol_of(f"q.{c}") for c in coordinates],
        [symbol_of(f"u.{s}") for s in speeds],
        _inputs(mechanism),
        [symbol_of(p) for p in mechanism.parameters],
    ]
    found = to_sympy(function, symbols)
    made = {
        what: _matrix(entries, expression.shape, simplify)
        for (what, expression), entries in zip(outputs.items(), found)
    }
    kinds = {joint.name: KINDS[joint.kind] for joint in mechanism.joints}
    rates = frozenset(e.name for e in mechanism.speeds if kinds[e.joint].rates)
    return SymbolicEquations(coordinates, speeds, **made, rates=rates)


def _inputs(mechanism: Mechanism) -> list[Any]:
    from deltac.mechanism.forces import JointTorque

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
