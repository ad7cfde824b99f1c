"""Witness functions: what a run watches of (t, x), whose sign must not change unnoticed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from deltac.arrays import Array
from deltac.dynamics.impacts import ImpactPoint
from deltac.dynamics.spatial import SX
from deltac.kernels import Kernel
from deltac.mechanism.events import Event
from deltac.simulation.flow import StateFlow

DIRECTIONS = {"falling": -1, "both": 0, "rising": 1}


@dataclass(frozen=True)
class Witness:
    """Values of the witness functions at an instant: g, ġ (n,), and g̈ of the impact points."""

    g: Array
    rate: Array
    bend: Array


@dataclass(frozen=True, eq=False)
class Witnesses:
    """The witness functions of a run: the gaps of impact points first, then events, then switches."""

    flow: StateFlow
    points: tuple[ImpactPoint, ...]
    events: tuple[Event, ...]
    switches: SX
    switch_names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.points) + len(self.events) + int(self.switches.shape[0])

    @property
    def directions(self) -> Array:
        """−1: falling through zero counts, 1: rising, 0: both."""
        directions = [DIRECTIONS[event.direction] for event in self.events]
        return np.array([-1] * len(self.points) + directions + [0] * len(self.switch_names))

    @property
    def names(self) -> tuple[str, ...]:
        """What each is called when it happens."""
        return (
            *(point.channel for point in self.points),
            *(f"event {event.name}" for event in self.events),
            *(f"switch {name}" for name in self.switch_names),
        )

    @cached_property
    def _kernel(self) -> Kernel:
        flow, system = self.flow, self.flow.system
        g = [point.gap for point in self.points]
        g += [system.number(event.expression) for event in self.events]
        own = ca.vertcat(ca.SX(0, 1), *g)
        if flow.own is not None:
            (own,) = ca.substitute([own], [system.q, system.u], [flow.own.q, flow.own.u])
        values = ca.vertcat(own, self.switches)
        xdot = ca.SX.sym("xdot", flow.x.shape[0])
        along, rates = ca.vertcat(flow.x, flow.t), ca.vertcat(xdot, 1)
        # ġ of a gap in q̇'s own symbols, so that it can be differentiated once more.
        gaps = own[: len(self.points)]
        q, u = flow.x[flow.parts[0]], flow.x[flow.parts[1]]
        qdot = flow.xdot[flow.parts[0]]
        closing = ca.jtimes(gaps, ca.vertcat(q, flow.t), ca.vertcat(qdot, 1))
        bend = ca.jtimes(
            closing, ca.vertcat(q, u, flow.t), ca.vertcat(xdot[: q.numel() + u.numel()], 1)
        )
        outputs = {"g": values, "rate": ca.jtimes(values, along, rates), "bend": bend}
        inputs = {"t": flow.t, "x": flow.x, "xdot": xdot}
        return Kernel(
            inputs, {n: o for n, o in outputs.items() if o.numel()}, flow.p, name="events"
        )

    def at(self, t: float, x: Array, xdot: Array, p: Array) -> Witness:
        """What is seen at a state with its rates."""
        kernel, n, m = self._kernel, len(self), len(self.points)
        x_in = np.concatenate([[t], x, xdot])
        values = kernel.single(x_in, np.empty(kernel.n_out), p if len(p) else None)
        return Witness(values[:n], values[n : 2 * n], values[2 * n : 2 * n + m])

    def along(self, t: Array, x: Array, xdot: Array, p: Array) -> tuple[Array, Array]:
        """Values and rates, (n, T) each, at many states (T, n)."""
        kernel, n = self._kernel, len(self)
        values = kernel.flat(np.vstack([t, x.T, xdot.T]), p if len(p) else None)
        return values[:n], values[n : 2 * n]
