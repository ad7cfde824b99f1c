"""What the oracles share: integration at high accuracy, and Lagrange's equations by SymPy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import sympy
from scipy.integrate import solve_ivp

Values = dict[str, float]


def integrated(rhs: Callable[..., Any], start: Sequence[float], times: Sequence[float]) -> Any:
    """States at the times (s), one row each."""
    solution = solve_ivp(
        rhs, (0.0, times[-1]), start, method="DOP853", t_eval=times, rtol=1e-13, atol=1e-14
    )
    assert solution.success
    return solution.y.T


def lagrange(L: Any, t: Any, coordinates: Sequence[Any]) -> Callable[..., Any]:
    """ẏ(t, y), y = (q, q̇), of a Lagrangian in functions of t."""
    q = sympy.Matrix(coordinates)
    v = q.diff(t)
    momenta = sympy.Matrix([sympy.diff(L, rate) for rate in v])
    M = momenta.jacobian(v)
    force = sympy.Matrix([sympy.diff(L, c) for c in q]) - momenta.jacobian(q) * v
    names = sympy.symbols(f"a:{len(q)}"), sympy.symbols(f"w:{len(q)}")
    plain = dict(zip(v, names[1], strict=True)), dict(zip(q, names[0], strict=True))
    M, force = (e.subs(plain[0]).subs(plain[1]) for e in (M, force))
    at = sympy.lambdify([*names[0], *names[1]], (M, force), "numpy", cse=True)

    def rhs(t: float, y: Any) -> Any:
        mass, right = at(*y)
        return np.concatenate([y[len(q) :], np.linalg.solve(mass, right).ravel()])

    return rhs


def constrained(M: Any, force: Any, G: Any, gamma: Any) -> tuple[Any, Any]:
    """Accelerations and least multipliers λ of M a = f − Gᵀλ, G a = −γ (dense, by SVD)."""
    response = np.linalg.solve(M, np.column_stack([force, G.T]))
    S = G @ response[:, 1:]
    lam = np.linalg.lstsq(S, gamma + G @ response[:, 0], rcond=1e-9)[0]
    return response[:, 0] - response[:, 1:] @ lam, lam
