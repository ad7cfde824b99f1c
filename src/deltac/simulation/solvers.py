"""Solvers: by name, and as option objects where a solver has options of its own (`deltac.solvers`)."""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass, fields, replace
from typing import ClassVar

from deltac.calls.arguments import checked
from deltac.errors import InputError, SolverError, UnknownName, WrongType, number_or_nan
from deltac.simulation.stepping.runge_kutta import (
    StepFunction,
    explicit_step,
    semi_implicit_euler_step,
)


@dataclass(frozen=True)
class Solver:
    """A solver: its Simulink name, its family, its order.

    Families: "fixed" (explicit) and "implicit" take steps of the user's length; "scipy", "sundials"
    and "taylor" choose their own. `step` advances the explicit ones of family "fixed", at the cost of
    `stages` evaluations of ẋ; `order` is None where it varies along the run. Of a `multistep` method the
    state may not be changed between steps.
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

    @property
    def passes_singular(self) -> bool:
        """Whether steps near dependent constraints are taken with multipliers by least squares."""
        return self.step is not None or self.family == "scipy"


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


@dataclass(frozen=True, kw_only=True)
class Options:
    """What every solver can be told; the classes below add what is their own.

    Attributes:
        switches: find the instants at which a law has a kink or a jump (abs, sign, min, max, where), and
            let no step go across one: the solver keeps its order.
    """

    switches: bool = False

    @property
    def solver(self) -> Solver:
        """The solver that these are the options of."""
        # Each kind has a name: a field, a constant, or made of its own options.
        return find_solver(self.name)  # type: ignore[attr-defined]

    def with_tolerance(self, tolerance: float) -> Options:
        """The same solver with another tolerance, of those that have one."""
        # The kinds that choose their steps declare it.
        return replace(self, tolerance=tolerance)  # type: ignore[call-arg]


@dataclass(frozen=True)
class FixedStep(Options):
    """A solver of fixed steps by its name, explicit or implicit, without further options."""

    name: str = "ode5"
    families: ClassVar[tuple[str, ...]] = ("fixed", "implicit")

    def __post_init__(self) -> None:
        _check(self, self.name)


@dataclass(frozen=True)
class GeneralizedAlpha(Options):
    """The generalized-α method of Chung and Hulbert, implicit, with fixed steps.

    `spectral_radius` is that at infinite frequency, from 0 (asymptotic annihilation) to 1 (no high-frequency
    dissipation).
    """

    spectral_radius: float = 0.8
    name: ClassVar[str] = "generalized-alpha"

    def __post_init__(self) -> None:
        radius = number_or_nan(self.spectral_radius)
        if not 0.0 <= radius <= 1.0:
            raise InputError(
                f"spectral_radius is {self.spectral_radius!r}; expected a number from 0 (asymptotic "
                "annihilation) to 1 (no high-frequency dissipation)"
            )


@dataclass(frozen=True)
class Adaptive(Options):
    """A solver that chooses its steps.

    `tolerance` is relative to each state; near zero, to a thousandth of its size, which is estimated at the
    start in the state's own unit (energies by the kinetic energy that the motion reaches).
    """

    name: str
    tolerance: float = 1e-9
    families: ClassVar[tuple[str, ...]]

    def __post_init__(self) -> None:
        _check(self, self.name)
        _check_tolerance(self.tolerance)


@dataclass(frozen=True)
class Scipy(Adaptive):
    """An adaptive solver of SciPy: RK23, RK45, DOP853, Radau, BDF or LSODA.

    `tolerance` is relative to each state; near zero, to a thousandth of its size.
    """

    name: str = "DOP853"
    families: ClassVar[tuple[str, ...]] = ("scipy",)


@dataclass(frozen=True)
class Sundials(Adaptive):
    """CVODES, of u̇ = f, or IDAS, of the equations of motion unsolved.

    `tolerance` is relative to each state; near zero, to a thousandth of its size.
    """

    name: str = "CVODES"
    families: ClassVar[tuple[str, ...]] = ("sundials",)


@dataclass(frozen=True)
class Taylor(Options):
    """Heyoka's adaptive Taylor method, the reference: its order follows from the tolerance.

    `tolerance` is relative to the size of each state, which is estimated at the start; None is the precision
    of the numbers, double or, with `quad`, quadruple.
    """

    tolerance: float | None = None
    quad: bool = False

    def __post_init__(self) -> None:
        if self.tolerance is not None:
            _check_tolerance(self.tolerance)

    @property
    def name(self) -> str:
        """What runs call it."""
        return "taylor-quad" if self.quad else "taylor"


def solver_options(solver: str | Options, tolerance: float | None = None) -> Options:
    """The solver as an option object, with a tolerance that was given beside its name.

    InputError for an unknown solver, and for a tolerance of one that takes fixed steps.
    """
    if isinstance(solver, Options):
        if tolerance is not None:
            raise SolverError(f"tolerance= was given beside {solver!r}; give it to that object")
        return solver
    scheme = find_solver(solver)
    if tolerance is not None and scheme.takes_steps:
        raise SolverError(
            f"solver {scheme.name!r} takes fixed steps and no tolerance; give a smaller step, or use an "
            "adaptive solver such as deltac.solvers.Scipy('DOP853', tolerance=...)"
        )
    if scheme.name == "generalized-alpha":
        return GeneralizedAlpha()
    if scheme.takes_steps:
        return FixedStep(scheme.name)
    if scheme.family == "taylor":
        return Taylor(tolerance, scheme.name == "taylor-quad")
    chosen = Adaptive.tolerance if tolerance is None else tolerance
    return Scipy(scheme.name, chosen) if scheme.family == "scipy" else Sundials(scheme.name, chosen)


def _check(options: FixedStep | Adaptive, name: str) -> None:
    """InputError unless it is a solver of the families that an option object is for."""
    scheme = find_solver(name)
    if scheme.family in options.families:
        return
    proper = type(solver_options(name))
    takes = ", ".join(field.name for field in fields(proper))
    raise SolverError(
        f"solver {scheme.name!r} is not one of {type(options).__name__}; write "
        f"deltac.solvers.{proper.__name__}(...), which takes {takes}"
    )


def _check_tolerance(value: float) -> None:
    if not 0.0 < number_or_nan(value) < math.inf:
        raise SolverError(f"tolerance is {value!r}; expected a positive, finite number")


@checked
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


def find_solver(name: object) -> Solver:
    """The solver of that name or alias; UnknownName lists all of them.

    Capitals count only where they must: `DOP853` chooses its steps, `dop853` does not.
    """
    if not isinstance(name, str):
        raise WrongType(
            f"solver is {name!r}; expected a name, such as 'ode5', or an object such as "
            "deltac.solvers.Scipy('DOP853', tolerance=1e-9)"
        )
    if name in SOLVERS:
        return SOLVERS[name]
    by_name = {**_BY_ALIAS, **SOLVERS}
    alike = {n: s for n, s in by_name.items() if n.lower() == name.lower()}
    solver = by_name.get(name) or (next(iter(alike.values())) if len(alike) == 1 else None)
    if solver is None:
        listed = ", ".join(
            s.name + (f" ({', '.join(s.aliases)})" if s.aliases else "") for s in SOLVERS.values()
        )
        match = difflib.get_close_matches(name, [*SOLVERS, *_BY_ALIAS], n=1)
        meant = _ELSEWHERE.get(name.lower()) or (repr(match[0]) if match else "")
        hint = f"; did you mean {meant}?" if meant else ""
        raise UnknownName(f"unknown solver {name!r}{hint}; known: {listed}")
    return solver
