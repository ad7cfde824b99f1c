"""Solvers by name: fixed steps, explicit and implicit; adaptive ones of SciPy and SUNDIALS; Taylor."""

from __future__ import annotations

import difflib
from dataclasses import dataclass

from deltac.errors import UnknownName, WrongType
from deltac.simulation.stepping.runge_kutta import (
    StepFunction,
    explicit_step,
    semi_implicit_euler_step,
)


@dataclass(frozen=True)
class Solver:
    """A solver: its Simulink name, its family, its order.

    Families: "fixed" (explicit) and "implicit" take steps of the user's length; "scipy", "sundials" and
    "taylor" choose their own. `step` advances the explicit ones of family "fixed", at the cost of `stages`
    evaluations of ẋ; `order` is None where it varies along the run. Of a `multistep` method the state may not
    be changed between steps.
    """

    name: str
    family: str
    order: int | None
    step: StepFunction | None = None
    stages: int = 0
    aliases: tuple[str, ...] = ()
    multistep: bool = False

    @property
    def takes_steps(self) -> bool:
        """Whether its steps are all of one length, which the user chooses."""
        return self.family in ("fixed", "implicit")


SOLVERS: dict[str, Solver] = {
    solver.name: solver
    for solver in (
        Solver("ode1", "fixed", 1, explicit_step("ode1"), 1, ("euler",)),
        Solver("ode2", "fixed", 2, explicit_step("ode2"), 2, ("heun",)),
        Solver("ode3", "fixed", 3, explicit_step("ode3"), 3, ("bs3", "bogacki-shampine")),
        Solver("ode4", "fixed", 4, explicit_step("ode4"), 4, ("rk4",)),
        Solver("ode5", "fixed", 5, explicit_step("ode5"), 6, ("dopri5", "dormand-prince")),
        Solver("ode8", "fixed", 8, explicit_step("ode8"), 12, ("dop853",)),
        Solver(
            "semi-implicit-euler", "fixed", 1, semi_implicit_euler_step, 2, ("symplectic-euler",)
        ),
        Solver("ode1be", "implicit", 1, stages=1, aliases=("backward-euler",)),
        Solver("implicit-midpoint", "implicit", 2, stages=1, aliases=("midpoint",)),
        Solver("generalized-alpha", "implicit", 2, stages=1, aliases=("chung-hulbert",)),
        Solver("discrete-gradient", "implicit", 2, stages=1, aliases=("energy-momentum",)),
        Solver("RK23", "scipy", 3),
        Solver("RK45", "scipy", 5),
        Solver("DOP853", "scipy", 8),
        Solver("Radau", "scipy", 5),
        Solver("BDF", "scipy", None, multistep=True),
        Solver("LSODA", "scipy", None, multistep=True),
        Solver("CVODES", "sundials", None, multistep=True),
        Solver("IDAS", "sundials", None, multistep=True),
        Solver("taylor", "taylor", None),
        Solver("taylor-quad", "taylor", None),
    )
}
"""Every solver by its own name."""

_BY_ALIAS = {alias: solver for solver in SOLVERS.values() for alias in solver.aliases}


def solver_names() -> tuple[str, ...]:
    """The names of all solvers, without aliases."""
    return tuple(SOLVERS)


_ELSEWHERE = {
    "ode45": "'RK45' (the same pair, adaptive) or 'ode5' (with fixed steps)",
    "ode23": "'RK23'",
    "ode113": "'LSODA' or 'CVODES'",
    "ode15s": "'BDF', 'CVODES' or 'Radau'",
    "ode23s": "'Radau'",
    "ode23t": "'Radau'",
    "ode23tb": "'Radau'",
    "odeint": "'LSODA'",
}
"""What the solvers of MATLAB and SciPy are called here."""


def find_solver(name: str) -> Solver:
    """The solver of that name or alias (capitals do not count); UnknownName lists all of them."""
    if not isinstance(name, str):
        raise WrongType(f"solver is {name!r}; expected a name, such as 'ode5'")
    known = {n.lower(): s for n, s in (*SOLVERS.items(), *_BY_ALIAS.items())}
    solver = known.get(name.lower())
    if solver is None:
        listed = ", ".join(
            s.name + (f" ({', '.join(s.aliases)})" if s.aliases else "") for s in SOLVERS.values()
        )
        match = difflib.get_close_matches(name, [*SOLVERS, *_BY_ALIAS], n=1)
        meant = _ELSEWHERE.get(name.lower()) or (repr(match[0]) if match else "")
        hint = f"; did you mean {meant}?" if meant else ""
        raise UnknownName(f"unknown solver {name!r}{hint}; known: {listed}")
    return solver
