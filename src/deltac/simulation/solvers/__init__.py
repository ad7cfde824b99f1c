"""Solvers by name: fixed steps, explicit and implicit; adaptive ones of SciPy and SUNDIALS; Taylor."""

from __future__ import annotations

import difflib

from deltac.errors import InputError
from deltac.simulation.solvers.explicit import explicit_step
from deltac.simulation.solvers.solver import Solver
from deltac.simulation.solvers.symplectic import semi_implicit_euler_step

_FIXED = (
    Solver("ode1", "fixed", 1, explicit_step("ode1"), 1, ("euler",)),
    Solver("ode2", "fixed", 2, explicit_step("ode2"), 2, ("heun",)),
    Solver("ode3", "fixed", 3, explicit_step("ode3"), 3, ("bs3", "bogacki-shampine")),
    Solver("ode4", "fixed", 4, explicit_step("ode4"), 4, ("rk4",)),
    Solver("ode5", "fixed", 5, explicit_step("ode5"), 6, ("dopri5", "dormand-prince")),
    Solver("ode8", "fixed", 8, explicit_step("ode8"), 12, ("dop853",)),
    Solver("semi-implicit-euler", "fixed", 1, semi_implicit_euler_step, 2, ("symplectic-euler",)),
)
_IMPLICIT = tuple(
    Solver(name, "implicit", order, None, 1, aliases)
    for name, order, aliases in (
        ("ode1be", 1, ("backward-euler",)),
        ("implicit-midpoint", 2, ("midpoint",)),
        ("generalized-alpha", 2, ("chung-hulbert",)),
        ("discrete-gradient", 2, ("energy-momentum",)),
    )
)
_ADAPTIVE = tuple(
    Solver(name, "adaptive", order, None, 0, ())
    for name, order in (
        ("RK23", 3),
        ("RK45", 5),
        ("DOP853", 8),
        ("Radau", 5),
        ("BDF", None),
        ("LSODA", None),
        ("CVODES", None),
        ("IDAS", None),
    )
)
_TAYLOR = (
    Solver("taylor", "taylor", None, None, 0, ()),
    Solver("taylor-quad", "taylor", None, None, 0, ()),
)

SOLVERS: dict[str, Solver] = {s.name: s for s in (*_FIXED, *_IMPLICIT, *_ADAPTIVE, *_TAYLOR)}
"""Every solver by its own name."""

_BY_ALIAS = {alias: solver for solver in SOLVERS.values() for alias in solver.aliases}


def solver_names() -> tuple[str, ...]:
    """The names of all solvers, without aliases."""
    return tuple(SOLVERS)


def find_solver(name: str) -> Solver:
    """The solver of that name or alias; InputError lists all of them for an unknown one."""
    if not isinstance(name, str):
        raise InputError(f"solver is {name!r}; expected a name, such as 'ode5'")
    solver = SOLVERS.get(name) or _BY_ALIAS.get(name)
    if solver is None:
        listed = ", ".join(
            s.name + (f" ({', '.join(s.aliases)})" if s.aliases else "") for s in SOLVERS.values()
        )
        match = difflib.get_close_matches(name, [*SOLVERS, *_BY_ALIAS], n=1)
        hint = f"; did you mean {match[0]!r}?" if match else ""
        raise InputError(f"unknown solver {name!r}{hint}; known: {listed}")
    return solver


__all__ = ["SOLVERS", "Solver", "find_solver", "solver_names"]
