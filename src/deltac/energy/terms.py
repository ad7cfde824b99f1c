"""Kernels of a ledger: energies, powers, momenta and residuals of sampled states."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from deltac.calls.caching import LRUCache, Once
from deltac.dynamics.coordinates import OwnCoordinates, trace_split
from deltac.dynamics.equations_of_motion import EquationsOfMotion, equations_of_motion
from deltac.dynamics.forces import total_force
from deltac.dynamics.independence import independence
from deltac.dynamics.laws import to_casadi
from deltac.dynamics.momentum import (
    MomentumFunctions,
    constraint_force,
    momentum_balances,
    momentum_functions,
)
from deltac.dynamics.recursions import rnea
from deltac.dynamics.spatial import SX
from deltac.dynamics.system import System
from deltac.dynamics.terms import (
    Constrained,
    Energies,
    Reactions,
    Terms,
    channel_powers,
    reaction_powers,
    reactions_from,
    terms,
)
from deltac.dynamics.testing_functions import MOMENTUM, TestingFunction
from deltac.energy.sampling.segments import LogRows
from deltac.errors import LogError
from deltac.kernels import Kernel
from deltac.mechanism.channels import Channel, ChannelName
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.laws import as_law, check_symbols
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory


@dataclass(frozen=True)
class LoggedForces:
    """The generalized forces of a log, reduced to the speeds on which they ever act.

    `places` maps a channel to its speeds; `columns` to where they lie among the kernel's inputs.
    """

    places: Mapping[Any, list[int]]
    columns: Mapping[Any, slice]
    size: int

    @property
    def key(self) -> tuple[tuple[str, tuple[int, ...]], ...]:
        """What tells it from others: the channels and their speeds."""
        return tuple((str(name), tuple(places)) for name, places in self.places.items())

    @staticmethod
    def of(run: Trajectory | LogRows) -> LoggedForces:
        """What the forces of a trajectory act on; a trajectory is looked at once."""
        if isinstance(run, Trajectory):
            return run.once("logged forces", lambda: LoggedForces._found(run))
        return LoggedForces._found(run)

    @staticmethod
    def _found(run: Trajectory | LogRows) -> LoggedForces:
        places: dict[ChannelName, list[int]] = {}
        columns: dict[ChannelName, slice] = {}
        start = 0
        for name, force in run.forces.items():
            acting = [int(k) for k in np.flatnonzero(force.any(axis=0))]
            places[name] = acting
            columns[name] = slice(start, start + len(acting))
            start += len(acting)
        return LoggedForces(places, columns, start)

    def values(self, run: Trajectory | LogRows) -> dict[ChannelName, np.ndarray]:
        """The columns of each channel (T, n)."""
        return {name: columns(run.forces[name], places) for name, places in self.places.items()}


def columns(values: np.ndarray, places: Sequence[int] | np.ndarray) -> np.ndarray:
    """Columns of (T, n); a view of neighbouring ones, since logs are long."""
    if not len(places):
        return values[:, :0]
    first, last = int(places[0]), int(places[-1])
    neighbours = np.array_equal(places, np.arange(first, last + 1))
    return values[:, first : last + 1] if neighbours else values[:, places]


@dataclass(frozen=True, eq=False)
class LedgerSymbols(Once):
    """A mechanism and the channels that a log's energy flows through, in symbols.

    `parts` are the model's channels, with those that the log holds in place of the model's own, and
    the log's further ones. `split` are the generalized speeds in which the kinetic energy is divided, where
    they are the user's; `measured` are driving forces of prescribed joints that were logged.
    """

    system: System
    parts: tuple[Channel, ...]
    logged: SX
    measured: Mapping[ChannelName, SX]
    constrained: Constrained | None
    split: OwnCoordinates | None
    reactions: Reactions
    computed: Terms
    with_measured: Terms | None
    udot: SX

    @property
    def driven(self) -> frozenset[ChannelName]:
        """The channels with a potential that depends on time: ``prescribed <element>`` holds ∂V/∂t."""
        explicit = {part.name.element for part in self.parts if part.explicit is not None}
        return frozenset(
            p.name for p in self.parts if p.potential is not None and p.name.element in explicit
        )

    @property
    def inputs(self) -> dict[str, SX]:
        """Inputs of kernels that need accelerations and logged forces."""
        s = self.system
        columns = {"t": s.t, "q": s.q, "u": s.u, "udot": s.udot, "logged": self.logged}
        return {name: column for name, column in columns.items() if column.shape[0]}

    def with_potential(self, law: object) -> LedgerSymbols:
        """The same with another function V(q, t) in E, and with its rate, in place of V̇, in P.

        Kane and Levinson 1988, (V, G_r): G_r = F_r + Σ W_sr ∂V/∂q_s are the generalized forces that V leaves
        out; ∂V/∂t + Σ X_s ∂V/∂q_s, which they ask to be zero, is part of the rate.
        """
        s = self.system
        V_law = as_law(law, "potential")
        check_symbols(V_law, s.mechanism.scope.in_place, "potential")
        V = to_casadi(V_law, s.values)

        def exchanged(old: Terms) -> Terms:
            change = ca.jtimes(V - old.V, ca.vertcat(s.q, s.t), ca.vertcat(s.qdot, 1))
            return replace(old, V=V, nonpotential_power=old.nonpotential_power + change)

        return self.once(
            ("potential", V_law),
            lambda: replace(
                self,
                computed=exchanged(self.computed),
                with_measured=None if self.with_measured is None else exchanged(self.with_measured),
            ),
        )


def ledger_symbols(
    mechanism: Mechanism,
    log: LoggedForces,
    speeds: CoordinateMap | None,
    start: tuple[float, np.ndarray],
) -> LedgerSymbols:
    """Write out all that a ledger needs; InputError where a motor's force is neither law nor log.

    `start` is the time and the free coordinates at which independent constraints are chosen. Written out
    once for logs of the same mechanism that hold the same forces and have the same independent constraints.
    """
    motion = equations_of_motion(mechanism)
    rows = independence(motion, *start).independent
    key = (mechanism.digest(), log.key, speeds, rows)
    return _SYMBOLS.get(key, lambda: _written_out(motion, log, speeds, rows))


_SYMBOLS: LRUCache[LedgerSymbols] = LRUCache(16)


def _written_out(
    motion: EquationsOfMotion,
    log: LoggedForces,
    speeds: CoordinateMap | None,
    rows: tuple[int, ...],
) -> LedgerSymbols:
    system, mechanism = motion.system, motion.system.mechanism
    bound = motion.constrained(rows)
    own = trace_split(system, speeds, None if bound is None else bound.rows)
    logged = ca.SX.sym("logged", log.size)
    nu = len(mechanism.speeds)
    driven = {ChannelName("prescribed", j.name) for j in mechanism.joints if j.prescribed}
    ties = {ChannelName("constraint", constraint.name) for constraint in mechanism.constraints}
    forces: dict[ChannelName, SX] = {}
    for name, places in log.places.items():
        force = ca.SX.zeros(nu)
        for k, place in enumerate(places):
            force[place] = logged[log.columns[name].start + k]
        forces[name] = force
    parts: list[Channel] = []
    for part in motion.channels:
        if part.name in forces:
            parts.append(Channel(part.name, forces.pop(part.name), part.potential, part.explicit))
        elif part.logged:
            raise LogError(
                f"the run holds no force of channel {part.name!r}, and the joint torque has no law; add "
                f"columns force.{part.name}.<speed> to the log, or say in a mapping file which column it is: "
                f'[forces."{part.name}"] "<speed>" = {{ column = "…" }}; deltac audit MODEL LOG '
                "--draft-mapping map.toml writes one to edit"
            )
        else:
            parts.append(part)
    measured = {name: force for name, force in forces.items() if name in driven | ties}
    parts.extend(Channel(n, f) for n, f in forces.items() if n not in driven | ties)
    channels = tuple(parts)
    udot = ca.SX(system.udot_all)
    reactions = reactions_from(system, udot, channels, bound)
    computed = terms(system, udot, channels, own, bound, reactions)
    with_measured = None
    if measured and set(measured) == driven | ties:
        reactions = _measured(measured, driven, nu, bound, system)
        with_measured = terms(system, udot, channels, own, bound, reactions)
    return LedgerSymbols(
        system, channels, logged, measured, bound, own, reactions, computed, with_measured, udot
    )


def _measured(
    measured: Mapping[ChannelName, SX],
    driven: set[ChannelName],
    nu: int,
    bound: Constrained | None,
    system: System,
) -> Reactions:
    """Reactions from a log: driving forces as they are, multipliers from the constraints' forces."""
    nothing = ca.SX.zeros(nu)
    driving = sum((f for name, f in measured.items() if name in driven), start=nothing)
    ties = sum((f for name, f in measured.items() if name not in driven), start=nothing)
    multipliers = ca.SX(0, 1) if bound is None else bound.multipliers_from(ties[system.free_u, :])
    return Reactions(driving, multipliers)


@dataclass(frozen=True)
class LedgerKernels:
    """The kernels of a ledger, and what their outputs are, in order.

    `at_samples`: K2, K1, K0 and V (`energies`), the `potential` of each source, each `momentum`, the powers
    of the `conservative` channels, then all of `between`: the powers of the other `channels`, the powers P
    of the testing `functions`, the `force` on each momentum. Momenta are those of the balances (`momenta`),
    then those of the `speeds` that have momentum testing functions. Conservative is what has a potential,
    unless the log holds its force: its work is what the potential lost, and its power need not be integrated.

    Where works were `recorded`, P lacks the powers of those channels, and of the conservative ones:
    `entering` tells whose works are to be added to its integral.
    """

    conservative: tuple[ChannelName, ...]
    channels: tuple[ChannelName, ...]
    potential: tuple[ChannelName, ...]
    functions: tuple[str, ...]
    momenta: tuple[str, ...]
    speeds: tuple[str, ...]
    at_samples: Kernel
    between: Kernel
    recorded: frozenset[ChannelName] = frozenset()

    def entering(self, function: str) -> frozenset[ChannelName]:
        """Channels whose work enters ∫P of a function although their power is not part of `between`."""
        if not self.recorded:
            return frozenset()
        if function == "liu-huston":
            return self.recorded.union(self.conservative)
        return self.recorded.difference(self.potential)

    @property
    def powers(self) -> tuple[ChannelName, ...]:
        """All channels of forces."""
        return self.conservative + self.channels


def ledger_kernels(
    symbols: LedgerSymbols,
    functions: Sequence[TestingFunction],
    logged: Container[str],
    recorded: frozenset[ChannelName] = frozenset(),
    *,
    momenta: bool = False,
) -> LedgerKernels:
    """Write the kernels out, with the momentum functions if `momenta`.

    The log holds forces of `logged` channels, and works of `recorded` ones.
    """
    s, k = symbols.system, symbols.computed
    potential = {p.name: p.potential for p in symbols.parts if p.potential is not None}
    power = channel_powers(s, symbols.parts)
    power |= reaction_powers(s, symbols.reactions, symbols.constrained)
    conservative = {n: power.pop(n) for n in potential if n not in logged}

    def without_recorded(all_terms: Terms) -> Terms:
        """The terms without the powers whose integrals are known."""
        if not recorded:
            return all_terms
        # In the order of the channels: kernels are kept by their text, and that of sets is by chance.
        recorded_powers = {n: power[n] for n in power if n in recorded}
        return replace(
            all_terms,
            force_power=all_terms.force_power
            - sum([*recorded_powers.values(), *conservative.values()]),
            nonpotential_power=all_terms.nonpotential_power
            - sum(p for n, p in recorded_powers.items() if n not in potential),
        )

    P = {
        name: function.P(without_recorded(variant))
        for function in functions
        for name, variant in variants(symbols, function.name).items()
    }
    balances = momentum_balances(s)
    of_speeds = (of_momenta(symbols),) if momenta else ()
    between = {
        "channels": _column(power.values()),
        "functions": _column(P.values()),
        "force": _column(
            [*(b.force(symbols.parts) for b in balances), *(variant.rate for variant in of_speeds)]
        ),
    }
    at_samples = {
        "energies": ca.vertcat(k.K2, k.K1, k.K0, k.V),
        "potential": _column(potential.values()),
        "momentum": _column(
            [*(b.momentum for b in balances), *(variant.momentum for variant in of_speeds)]
        ),
        "conservative": _column(conservative.values()),
    }
    return LedgerKernels(
        tuple(conservative),
        tuple(power),
        tuple(potential),
        tuple(P),
        tuple(balance.name for balance in balances),
        tuple(name for variant in of_speeds for name in variant.names),
        _kernel(symbols, at_samples | between),
        _kernel(symbols, between),
        recorded,
    )


def of_momenta(symbols: LedgerSymbols) -> MomentumFunctions:
    """The momentum testing functions: with the constraints' forces of the log, or by the equations."""
    s, force = symbols.system, total_force(symbols.system, symbols.parts)
    ties = [f for name, f in symbols.measured.items() if name.kind == "constraint"]
    if symbols.split is None and len(ties) == len(s.mechanism.constraints):
        force = sum(ties, start=force)
    elif symbols.split is None:
        force = force + constraint_force(s, force, symbols.constrained)
    return momentum_functions(s, force, symbols.split)


def _column(entries: Iterable[SX]) -> SX:
    return ca.densify(ca.vertcat(ca.SX(0, 1), *entries))


def _kernel(symbols: LedgerSymbols, outputs: Mapping[str, SX]) -> Kernel:
    """Accelerations are among the inputs only where they matter."""
    inputs = symbols.inputs
    if "udot" in inputs and not ca.depends_on(ca.vertcat(*outputs.values()), inputs["udot"]):
        del inputs["udot"]  # then nobody need interpolate them
    return Kernel(inputs, outputs, name="ledger")


def residual_kernel(
    symbols: LedgerSymbols, functions: Sequence[TestingFunction], *, momenta: bool
) -> Kernel:
    """ε = Ė − P of every function, F_r + F*_r of every free speed; ṗ_r less its rate, where `momenta`."""
    s, k = symbols.system, symbols.computed
    along = ca.vertcat(s.q, s.u, s.t)
    motion = ca.vertcat(s.qdot, s.udot, 1)
    energies = ca.vertcat(k.K2, k.K1, k.K0, k.V)
    # E is linear in the energies, so E of their rates is Ė.
    rates = Energies(*ca.vertsplit(ca.jtimes(energies, along, motion)))
    outputs: dict[str, SX] = {}
    for function in functions:
        for name, variant in variants(symbols, function.name).items():
            outputs[name] = function.E(rates) - function.P(variant)
    residual = (total_force(s, symbols.parts) - rnea(s, symbols.udot))[s.free_u]
    if symbols.constrained is not None:
        residual = residual + ca.mtimes(symbols.constrained.rows.G.T, symbols.reactions.multipliers)
    outputs["coordinates"] = residual
    if momenta:
        known_momenta = of_momenta(symbols)
        outputs[MOMENTUM] = ca.jtimes(known_momenta.momentum, along, motion) - known_momenta.rate
    return Kernel(symbols.inputs, outputs, name="residuals")


def variants(symbols: LedgerSymbols, function: str) -> dict[str, Terms]:
    """The terms that a function is evaluated with; Wang's both ways if the drive was measured."""
    if function == "wang" and symbols.with_measured is not None:
        return {"wang": symbols.with_measured, "wang-inertial": symbols.computed}
    return {function: symbols.computed}
