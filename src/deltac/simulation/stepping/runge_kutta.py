"""Explicit methods of fixed steps, written once for symbols (compiled steps) and for arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeAlias

Rate: TypeAlias = Callable[[Any, Any], Any]
"""ẋ = f(t, x): symbols or arrays."""


Parts: TypeAlias = tuple[slice, slice, slice]
"""Where coordinates, speeds and integrals lie in x."""

StepFunction: TypeAlias = Callable[[Rate, Any, Any, Any, Parts], Any]
"""(f, t, x, h, parts) -> x one step later; the same lines serve symbols and arrays."""


@dataclass(frozen=True)
class Tableau:
    """Butcher's coefficients: `a` strictly lower triangular by rows, weights `b`, nodes `c`."""

    a: tuple[tuple[float, ...], ...]
    b: tuple[float, ...]
    c: tuple[float, ...]
    source: str


def _tableau(a: Sequence[Sequence[float]], b: Sequence[float], source: str) -> Tableau:
    rows = tuple(tuple(float(entry) for entry in row) for row in a)
    return Tableau(rows, tuple(float(w) for w in b), tuple(sum(row) for row in rows), source)


def _dop853() -> Tableau:
    from scipy.integrate import DOP853

    n = DOP853.n_stages
    a = [[float(DOP853.A[i, j]) for j in range(i)] for i in range(n)]
    nodes = tuple(float(c) for c in DOP853.C[:n])
    return Tableau(
        tuple(map(tuple, a)),
        tuple(map(float, DOP853.B)),
        nodes,
        "Hairer, Nørsett, Wanner, Solving Ordinary Differential Equations I, 1993: DOP853",
    )


_WRITTEN_OUT: dict[str, Tableau] = {
    "ode1": _tableau([[]], [1], "Euler 1768"),
    "ode2": _tableau([[], [1]], [1 / 2, 1 / 2], "Heun 1900"),
    "ode3": _tableau(
        [[], [1 / 2], [0, 3 / 4]],
        [2 / 9, 1 / 3, 4 / 9],
        "Bogacki, Shampine, Appl. Math. Lett. 2 (1989) 321-325",
    ),
    "ode4": _tableau(
        [[], [1 / 2], [0, 1 / 2], [0, 0, 1]], [1 / 6, 1 / 3, 1 / 3, 1 / 6], "Kutta 1901"
    ),
    "ode5": _tableau(
        [
            [],
            [1 / 5],
            [3 / 40, 9 / 40],
            [44 / 45, -56 / 15, 32 / 9],
            [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729],
            [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656],
        ],
        [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
        "Dormand, Prince, J. Comput. Appl. Math. 6 (1980) 19-26, weights of order 5",
    ),
}


@cache
def tableau_of(name: str) -> Tableau | None:
    """The coefficients of a solver, None if it has none. SciPy is loaded for ode8's alone."""
    return _dop853() if name == "ode8" else _WRITTEN_OUT.get(name)


def growth(tableau: Tableau, z: complex) -> complex:
    """The stability function R(z): what a step makes of ẋ = λ x, z = h λ."""
    k: list[complex] = []
    for row in tableau.a:
        k.append(1 + z * sum(a * slope for a, slope in zip(row, k)))
    return 1 + z * sum(b * slope for b, slope in zip(tableau.b, k))


def explicit_step(name: str) -> StepFunction:
    """The step x + h Σ b_i k_i with k_i = f(t + c_i h, x + h Σ a_ij k_j) of an explicit method."""

    def step(f: Rate, t: Any, x: Any, h: Any, parts: Parts) -> Any:
        tableau = tableau_of(name)
        assert tableau is not None, name
        k: list[Any] = []
        for row, c in zip(tableau.a, tableau.c):
            k.append(f(t + c * h, _moved(x, h, row, k)))
        return _moved(x, h, tableau.b, k)

    return step


def _moved(x: Any, h: Any, weights: Sequence[float], k: Sequence[Any]) -> Any:
    terms = [w * slope for w, slope in zip(weights, k) if w != 0.0]
    if not terms:
        return x
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return x + h * total


def semi_implicit_euler_step(f: Rate, t: Any, x: Any, h: Any, parts: Parts) -> Any:
    """u₊ = u + h u̇(t, q, u), then q₊ = q + h q̇(t, q, u₊); integrals take P at the step's start.

    First order; symplectic for separable systems, which keeps energy errors bounded, not small.
    """
    q, u, z = parts
    rates, after = f(t, x), x + 0.0
    after[u] = x[u] + h * rates[u]
    later = f(t, after)
    after[q], after[z] = x[q] + h * later[q], x[z] + h * rates[z]
    return after
