"""The discrete work of engines that hold a force over a step: h fᵀ(u_k + u_{k+1})/2."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deltac.arrays import Array
from deltac.dynamics.recursions import rnea
from deltac.energy.sampling.samples import Samples
from deltac.energy.sampling.segments import LogRows
from deltac.energy.terms import LedgerSymbols, LoggedForces
from deltac.kernels import Kernel
from deltac.mechanism.channels import ByChannel, ChannelName


@dataclass(frozen=True)
class DiscreteWork:
    """Cumulated discrete work of each channel, and of the bias forces −h(q, u), (T,).

    `explicit` is the part of `work` that is ∂V/∂t of driven springs: it feeds V and no force does it.
    """

    work: ByChannel
    explicit: Array
    bias: Array
    potential: frozenset[ChannelName]

    def at(self, rows: NDArray[np.intp] | slice) -> DiscreteWork:
        """Some of the rows."""
        work = {name: values[rows] for name, values in self.work.items()}
        return DiscreteWork(work, self.explicit[rows], self.bias[rows], self.potential)

    def of(self, function: str) -> Array:
        """What flows into E of a testing function: all forces into K, or the nonpotential into K + V.

        With the bias forces, K − work closes over a step but for the change of M(q): an identity of the
        scheme, which checks the bookkeeping and says nothing about accuracy.
        """
        chosen = [
            w
            for name, w in self.work.items()
            if function == "liu-huston" or name not in self.potential
        ]
        total = sum(chosen, start=np.zeros_like(self.bias))
        return total - self.explicit + self.bias if function == "liu-huston" else total


def discrete_work(
    symbols: LedgerSymbols, run: LogRows, samples: Samples, log: LoggedForces
) -> DiscreteWork:
    """Forces at the start of each step, times the mean of the speeds at its ends."""
    s, nu = symbols.system, len(symbols.system.mechanism.speeds)
    acting = {part.name: part.force for part in symbols.parts}
    reactions = symbols.reactions
    for joint in s.mechanism.joints:
        if joint.prescribed:
            place = s.mechanism.speeds.of(joint.name)
            force = ca.SX.zeros(nu)
            force[place] = reactions.driving[place]
            acting[ChannelName("prescribed", joint.name)] = force
    if symbols.constrained is not None:
        rows = symbols.constrained.rows
        for owner in dict.fromkeys(rows.names):
            k = rows.places(owner)
            force = ca.mtimes(rows.G_all[k, :].T, reactions.multipliers[k])
            acting[ChannelName("constraint", owner)] = force
    bias = -rnea(s, ca.SX.zeros(nu))
    forces = ca.densify(ca.vertcat(bias, *acting.values()))
    kernel = Kernel(symbols.inputs, {"forces": forces}, name="forces")
    quantities: dict[str, Array] = {"t": samples.t, **samples.plain, **samples.steady}
    quantities["q"], quantities["u"] = samples.smooth["q"].values, samples.smooth["u"].values
    quantities["udot"] = samples.smooth["u"].rates
    arrays = {name: quantities[name] for name in kernel.input_names if name != "logged"}
    if "logged" in kernel.input_names:
        arrays["logged"] = np.concatenate(
            [quantities[f"force {name}"] for name in log.places], axis=1
        )
    totals = kernel(**arrays)["forces"].reshape(len(run), -1, nu)
    h = np.diff(run.t)
    mean = 0.5 * (run.u[1:] + run.u[:-1])

    def cumulated(force: Array) -> Array:
        steps = h * np.einsum("ij,ij->i", force[:-1], mean)
        return np.concatenate([[0.0], np.cumsum(steps)])

    work = {name: cumulated(totals[:, 1 + k]) for k, name in enumerate(acting)}
    # ∂V/∂t does work though no force acts: a left-end sum, of the scheme's own order.
    driven = np.zeros(len(run))
    for part in symbols.parts:
        if part.explicit is not None:
            explicit = Kernel(symbols.inputs, {"P": part.explicit}, name="explicit")(
                **{name: arrays[name] for name in symbols.inputs}
            )["P"]
            steps = np.concatenate([[0.0], np.cumsum(h * explicit[:-1])])
            work[part.name] += steps
            driven += steps
    potential = frozenset(part.name for part in symbols.parts if part.potential is not None)
    return DiscreteWork(work, driven, cumulated(totals[:, 0]), potential)
