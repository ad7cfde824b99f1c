"""What a solver integrates: ẋ = f(t, x) with x = (q, u, works, ∫P), in symbols.

q and u are the free coordinates and speeds, or the user's own ones where equations are written by
hand; behind them stand the work of each channel and the integral of the power P of each testing function,
so that solver and step treat powers as they treat the motion (theory: the integral "in the loop").
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deltac.arrays import SOLVED, Array
from deltac.calls.arguments import checked
from deltac.calls.caching import Once
from deltac.dynamics.coordinates import OwnCoordinates, trace_split
from deltac.dynamics.equations_of_motion import equations_of_motion, evaluate_at, quaternions
from deltac.dynamics.forces import total_force
from deltac.dynamics.momentum import MomentumFunctions, momentum_functions
from deltac.dynamics.spatial import SX
from deltac.dynamics.system import System
from deltac.dynamics.terms import (
    Constrained,
    Reactions,
    Terms,
    channel_powers,
    reaction_powers,
    reactions_from,
    terms,
)
from deltac.dynamics.testing_functions import MOMENTUM, testing_functions
from deltac.errors import ArgumentsError, InputError
from deltac.kernels import Kernel
from deltac.mechanism.channels import CORRECTIONS, ENERGY_CORRECTION, Channel, ChannelName
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.state import State
from deltac.simulation.equations import ByHand, Equations

OFF_CONSTRAINTS = SOLVED**0.5
"""A state this far off a constraint (m or rad, per s of motion constraints) is not on it.

One of Newton's steps leaves the square of that, on constraints whose curvature is of order one.
"""


@checked
@dataclass(frozen=True)
class Projection:
    """Project q and u onto the constraints after each step, with the smallest change in the mass metric.

    With `energy` the state is then projected onto ΔC = 0 of Wang's function in the same way. What that does
    to the energy is booked as `correction energy`. ΔC therefore still shows what the solver lost, but not how
    accurate the corrected motion is.
    """

    energy: bool = False


@checked
@dataclass(frozen=True)
class Baumgarte:
    """Stabilise accelerations: ψ̇ + 2α ψ + β² φ = 0; α and β in 1/s (Baumgarte 1972)."""

    alpha: float
    beta: float

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not isinstance(value, int | float) or not 0.0 <= value < math.inf:
                raise InputError(
                    f"Baumgarte: {name} is {value!r}; expected a finite number of 1/s, 0 or more, such as "
                    "10.0"
                )


USUAL_PROJECTION = Projection()

Keeping: TypeAlias = Projection | Baumgarte | None
"""How a run stays on its constraints; None: on the level of accelerations alone."""


def keeping(constraints: str | Keeping) -> Keeping:
    """What the argument `constraints` says, "projection" written out; InputError for anything else."""
    if isinstance(constraints, str) and constraints == "projection":
        return Projection()
    if constraints is None or isinstance(constraints, Projection | Baumgarte):
        return constraints
    raise InputError(
        f"constraints is {constraints!r}; expected 'projection', deltac.Projection(energy=True), "
        "deltac.Baumgarte(alpha, beta) in 1/s, or None"
    )


@dataclass(frozen=True, eq=False)
class StateFlow(Once):
    """ẋ in symbols, and what is observed of a motion.

    Inputs: `t`, the state `x`, values of motors `inputs`, parameters `p`; and the
    `accelerations` of a hand-written function that could not be traced (else empty), which takes the
    coordinates `user_q` if these are not those of x. `q_size`, `u_size`
    divide x; `works`, then `integrals` name what follows. The outputs `q_all`, `u_all`, `udot_all`, the
    `driving` forces and the constraints' `reactions` are full vectors of the mechanism. `bound` holds the
    constraints that the equations are built on, `energies` the testing functions' E, K and V of (t, x);
    `split` are the generalized speeds of the testing functions, where they are not the mechanism's;
    `damping` is Baumgarte's (α, β); `slip` is ψ of the motion rows that were left out as redundant, of the
    constraints `slipping`.
    """

    system: System
    testing: tuple[str, ...]
    works: tuple[ChannelName, ...]
    integrals: tuple[str, ...]
    equations: Equations | None
    user_q: SX | None
    own: OwnCoordinates | None
    split: OwnCoordinates | None
    bound: Constrained | None
    projecting: bool
    correcting: bool
    damping: tuple[float, float]
    t: SX
    x: SX
    inputs: SX
    accelerations: SX
    p: SX
    xdot: SX
    q_size: int
    u_size: int
    q_all: SX
    u_all: SX
    udot_all: SX
    driving: SX
    reactions: Mapping[ChannelName, SX]
    energies: SX
    slip: SX
    slipping: tuple[str, ...]

    @property
    def departures(self) -> tuple[tuple[str, ...], SX]:
        """What a run that cannot meet its constraints misses (`OFF_CONSTRAINTS`): names of rows; ψ, then φ.

        ψ is of the motion rows `slipping`, φ (if it is projected) of those that the equations are built on.
        """
        if self.bound is None or not self.projecting:
            return self.slipping, self.slip
        rows = self.bound.rows
        return self.slipping + rows.names, ca.vertcat(self.slip, rows.phi)

    @cached_property
    def traced(self) -> bool:
        """Whether ẋ is known in symbols entirely, so that steps can be compiled."""
        return bool(self.accelerations.shape[0] == 0)

    @cached_property
    def driven(self) -> bool:
        """Whether the motion follows from what is prescribed, so that only powers are integrated."""
        determined = not self.u_size if self.bound is None else self.bound.determined
        return self.own is None and determined

    @cached_property
    def quaternions(self) -> tuple[slice, ...]:
        """Places of unit quaternions in x; none where x holds the user's own coordinates."""
        if self.own is not None and self.own.mapped:
            return ()
        return quaternions(self.system.mechanism)

    @cached_property
    def parts(self) -> tuple[slice, slice, slice]:
        """Where q, u and what is integrated (`works` and `integrals`) lie in x."""
        n = self.q_size + self.u_size
        return slice(0, self.q_size), slice(self.q_size, n), slice(n, self.x.shape[0])

    def powers(
        self,
        all_terms: Terms,
        parts: tuple[Channel, ...],
        reactions: Reactions,
        bound: Constrained | None,
    ) -> SX:
        """The rates of all integrals (W), for accelerations whoever made them."""
        by_channel = _powers(self.system, parts, reactions, bound)
        working = [by_channel[name] for name in self.works]
        momenta = None
        if any(name.startswith(MOMENTUM) for name in self.integrals):
            momenta = _momenta(self.system, parts, reactions, bound, self.split)
        return _integrands(all_terms, working, self.testing, self.integrals, momenta)

    def booked(self, changes: SX) -> SX:
        """What integrals take of `changes` of the testing functions' energies and of what follows them."""
        rest = len(self.integrals) - changes.shape[0]
        return ca.vertcat(ca.SX.zeros(len(self.works)), changes, ca.SX.zeros(rest))

    @cached_property
    def tested(self) -> slice:
        """Where the integrals of the testing functions lie in x."""
        first = self.parts[2].start + len(self.works)
        return slice(first, first + len(self.testing))

    @cached_property
    def rate(self) -> Any:
        """(t, x, p) -> ẋ, as a CasADi function."""
        return ca.Function("f", [self.t, self.x, self.p], [ca.densify(self.xdot)], {"cse": True})

    @cached_property
    def energy(self) -> Any:
        """(t, x, p) -> the testing functions' E, K and V, as a CasADi function."""
        return ca.Function("E", [self.t, self.x, self.p], [self.energies])

    @cached_property
    def _user_q_at(self) -> Any:
        """(t, x, p) -> the coordinates that equations by hand take, as a CasADi function."""
        return ca.Function("user_q", [self.t, self.x, self.p], [ca.densify(self.user_q)])

    def by_hand(self, t: float, x: Array, p: Array) -> Array:
        """The accelerations that equations by hand, called from Python, give at a state."""
        assert self.equations is not None
        q, u, _ = self.parts
        own_q = x[q].copy() if self.user_q is None else evaluate_at(self._user_q_at, t, x, p)[0]
        return self.equations(t, own_q, x[u].copy())

    def kernel(self, name: str, outputs: Mapping[str, SX], **further: SX) -> Kernel:
        """Compiled: (t, x, p, …) -> outputs."""
        inputs = {"t": self.t, "x": self.x, "p": self.p, **further}
        return Kernel({n: c for n, c in inputs.items() if c.shape[0]}, outputs, name=name)

    def normalised(self, x: SX) -> SX:
        """The state, or its coordinates, with quaternions brought back to unit length."""
        result = ca.SX(x)
        for place in self.quaternions:
            result[place] = x[place] / ca.sqrt(ca.dot(x[place], x[place]))
        return result

    def start(self, state: State, p: NDArray[np.float64]) -> NDArray[np.float64]:
        """The solver's state at the start, integrals as they begin; `p`: the parameters' values."""
        free = self.system.mechanism.free
        q, u = state.q[free.q], state.u[free.u]
        if self.own is not None:
            system = self.system
            own_q, own_u = self.own.own_state(system)
            inputs = [system.t, system.q, system.u, system.p]
            values = ca.Function("own", inputs, [own_q, own_u])
            column = values(state.t, q, u, p)
            q, u = (np.array(part).ravel() for part in column)
        x = np.concatenate([q, u, np.zeros(len(self.works) + len(self.integrals))])
        if self.correcting:  # the energy as it should be starts at K + V
            x[-1] = float(np.array(self.energy(state.t, x, p))[-2:].sum())
        return x


ENERGY_DUE = "energy due"
"""Integral of a corrected run: K + V at the start and Q since, what a correction brings K + V back to, J.

Q without the power of constraints that a stage violates, which is no energy that flows in.
"""


def build_flow(
    mechanism: Mechanism,
    testing: Sequence[str] = (),
    written: ByHand | None = None,
    split: CoordinateMap | None = None,
    vary: Sequence[str] = (),
    rows: Sequence[int] = (),
    constraints: Keeping = USUAL_PROJECTION,
    *,
    works: bool = True,
) -> StateFlow:
    """Write out ẋ for a mechanism.

    `written` are equations by hand in place of the mechanism's own, traced on `trace(mechanism, vary)`;
    `split` chooses the generalized speeds of the testing functions, `rows` the independent rows of the
    constraints, and `constraints` how the run stays on them; `works` tells that works of channels are
    integrated beside the testing functions, if there are any: of all that can do work but those with a
    potential, whose work is known without.
    """
    mechanics = equations_of_motion(mechanism, vary)
    system = mechanics.system
    parts = mechanics.channels
    bound = mechanics.constrained(rows)
    dependent = bound is not None and split is None and not bound.determined
    functions = testing_functions(testing, constrained=dependent)
    split_own = trace_split(system, split, None if bound is None else bound.rows)
    own: OwnCoordinates | None = None
    correcting = isinstance(constraints, Projection) and constraints.energy
    damping = (0.0, 0.0)
    if isinstance(constraints, Baumgarte):
        damping = (constraints.alpha, constraints.beta)
    rates, own_q = ca.SX(0, 1), None
    if written is None:
        motion = mechanics.motion(rows, damping)
        udot_all, reactions = motion.udot, Reactions(motion.driving, motion.multipliers)
        q, u, qdot, udot = system.q, system.u, system.qdot, udot_all[system.free_u, :]
    else:
        state = written.state
        own, q, u, qdot = state.own, state.q, state.u, state.qdot
        own_q = None if state.user_q is q else state.user_q
        if written.udot is None:
            rates = ca.SX.sym("accelerations", u.shape[0])
        udot = rates if written.udot is None else written.udot
        udot_all = ca.SX(system.udot_all)
        reactions = reactions_from(system, udot_all, parts, bound)

    # Equations in fewer speeds keep ψ = 0 by themselves, and the coordinates that follow are brought back.
    closed = own is None or own.removal is not None
    projecting = bound is not None and closed and isinstance(constraints, Projection)
    if correcting and own is not None and bound is not None:
        raise ArgumentsError(
            f"{written.equations.name if written else 'equations'}: the energy of equations in own "
            "coordinates of a mechanism with constraints is not corrected; use constraints='projection'"
        )
    names = tuple(function.name for function in functions)
    booked = CORRECTIONS if projecting or correcting else ()
    momenta = None
    if MOMENTUM in testing:
        momenta = _momenta(system, parts, reactions, bound, split_own)
    of_speeds = () if momenta is None else tuple(f"{MOMENTUM} {name}" for name in momenta.names)
    restored, due = ((ENERGY_CORRECTION,), (ENERGY_DUE,)) if correcting else ((), ())
    integrals = (*names, *booked, *restored, *of_speeds, *due)

    all_terms = terms(system, udot_all, parts, split_own, bound, reactions)
    by_channel = _powers(system, parts, reactions, bound) if works and functions else {}
    potential = {part.name for part in parts if part.potential is not None}
    working = {n: p for n, p in by_channel.items() if n not in potential and ca.sparsify(p).nnz()}
    tied = constraint_forces(bound, reactions.multipliers)
    idle = [k for k, h in enumerate(mechanics.rows.holonomic) if not (h or k in rows)]
    outputs = {
        "q": ca.SX(system.q_all),
        "u": ca.SX(system.u_all),
        "udot": udot_all,
        "driving": reactions.driving,
        "P": _integrands(all_terms, list(working.values()), names, integrals, momenta),
        "E": ca.vertcat(
            *(function.E(all_terms) for function in functions), all_terms.K, all_terms.V
        ),
        "slip": mechanics.rows.psi[idle, :],
        **{str(name): force for name, force in tied.items()},
    }
    if written is not None:
        # The mechanism's symbols give way to what the hand-written equations say of them.
        free_udot = own.udot(system, udot) if own is not None else udot
        outputs = _substituted(outputs, [system.udot], [free_udot])
        if own is not None:
            outputs = _substituted(outputs, [system.q, system.u], [own.q, own.u])
    x = ca.vertcat(q, u, ca.SX.sym("z", len(working) + len(integrals)))
    return StateFlow(
        system=system,
        testing=names,
        works=tuple(working),
        integrals=integrals,
        equations=None if written is None else written.equations,
        user_q=own_q,
        own=own,
        split=split_own,
        bound=bound,
        projecting=projecting,
        correcting=correcting,
        damping=damping,
        t=system.t,
        x=x,
        inputs=system.inputs,
        accelerations=rates,
        p=system.p,
        xdot=ca.vertcat(qdot, udot, outputs["P"]),
        q_size=q.shape[0],
        u_size=u.shape[0],
        q_all=outputs["q"],
        u_all=outputs["u"],
        udot_all=outputs["udot"],
        driving=outputs["driving"],
        reactions={n: outputs[n] for n in tied},
        energies=outputs["E"],
        slip=outputs["slip"],
        slipping=tuple(mechanics.rows.names[k] for k in idle),
    )


def _integrands(
    all_terms: Terms,
    working: Sequence[SX],
    testing: Sequence[str],
    integrals: Sequence[str],
    momenta: MomentumFunctions | None,
) -> SX:
    """The rates of works and integrals (W): powers; zero of what corrections book; Q of the energy due.

    Of momentum functions, N or N·m: what changes `momenta`.
    """
    rates: dict[str, SX] = {f.name: f.P(all_terms) for f in testing_functions(testing)}
    rates[ENERGY_DUE] = all_terms.nonpotential_power + all_terms.prescribed_power
    if momenta is not None:
        of_speeds = zip(momenta.names, ca.vertsplit(momenta.rate))
        rates |= {f"{MOMENTUM} {name}": rate for name, rate in of_speeds}
    return ca.vertcat(ca.SX(0, 1), *working, *(rates.get(name, ca.SX(0)) for name in integrals))


def _momenta(
    system: System,
    parts: tuple[Channel, ...],
    reactions: Reactions,
    bound: Constrained | None,
    split: OwnCoordinates | None,
) -> MomentumFunctions:
    """The momentum testing functions, with the constraint forces of the motion."""
    force = total_force(system, parts)
    if bound is not None and split is None:
        force = force + ca.mtimes(bound.rows.G_all.T, reactions.multipliers)
    return momentum_functions(system, force, split)


def _powers(
    system: System,
    parts: tuple[Channel, ...],
    reactions: Reactions,
    bound: Constrained | None,
) -> dict[ChannelName, SX]:
    """Power of every channel (W)."""
    return channel_powers(system, parts) | reaction_powers(system, reactions, bound)


def constraint_forces(bound: Constrained | None, multipliers: SX) -> dict[ChannelName, SX]:
    """Generalized force Gᵀλ (nu,) of every constraint, by channel."""
    if bound is None:
        return {}
    rows = bound.rows
    return {
        ChannelName("constraint", name): ca.mtimes(
            rows.G_all[rows.places(name), :].T, multipliers[rows.places(name)]
        )
        for name in dict.fromkeys(rows.names)
    }


def _substituted(outputs: Mapping[str, SX], old: Sequence[SX], new: Sequence[SX]) -> dict[str, SX]:
    values = ca.substitute(list(outputs.values()), list(old), list(new))
    return dict(zip(outputs, values))
