"""Kane's equations of a mechanism at many states at once, in joint or in own coordinates.

Everything that the equations consist of is affine in the accelerations. So it is evaluated once at each
state; any number of candidate accelerations can then be tested there by products of small matrices.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from deltac.arrays import Array
from deltac.dynamics.constraints import Rows, constraint_rows
from deltac.dynamics.coordinates import OwnCoordinates, trace_map
from deltac.dynamics.forces import Channel, channels
from deltac.dynamics.recursions import crba, rnea
from deltac.dynamics.spatial import SX
from deltac.dynamics.system import System, trace
from deltac.mechanism.coordinates import CoordinateMap
from deltac.mechanism.joints import KINDS
from deltac.mechanism.mechanism import Mechanism

RANK = 1e-10
"""Singular values below this share of the largest count as zero."""


@dataclass(frozen=True, eq=False)
class Point:
    """The mechanism's free coordinates and speeds at B states, from own ones.

    `q` (nq, B), `u` = Y u′ + Z (n, B); `Y` (B, n, p) and `rest`, u̇ where u̇′ = 0 (n, B).
    """

    t: Array
    q: Array
    u: Array
    Y: Array
    rest: Array


@dataclass(frozen=True, eq=False)
class Terms:
    """Terms of Kane's equations of the free speeds at B states: −M u̇ − bias + Σ forces + Gᵀλ = 0.

    `M` (B, n, n), `bias` (n, B), `forces` one (n, B) for each channel; `phi`, `psi`, `gamma` (nc, B) and
    `G` (B, nc, n) of all constraints, with ψ̇ = G u̇ + γ.
    """

    M: Array
    bias: Array
    forces: dict[str, Array]
    phi: Array
    psi: Array
    gamma: Array
    G: Array

    @property
    def force(self) -> Array:
        """The sum of all forces (n, B)."""
        return np.asarray(sum(self.forces.values(), start=np.zeros(self.bias.shape)))


class Kane:
    """A mechanism written out, and functions of arrays of its states (batch last)."""

    def __init__(self, mechanism: Mechanism, coordinates: CoordinateMap | None = None) -> None:
        """Trace the mechanism and the map; InputError where the map does not fit it."""
        self.mechanism = mechanism
        self.coordinates = coordinates
        self.system: System = trace(mechanism)
        self.parts: tuple[Channel, ...] = channels(self.system)
        self.rows: Rows = constraint_rows(self.system)
        self.own: OwnCoordinates | None = (
            None if coordinates is None else trace_map(self.system, coordinates)
        )

    @cached_property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names of the own coordinates (without a map, of the free ones)."""
        if self.coordinates is not None and self.coordinates.q:
            return self.coordinates.coordinates
        return tuple(self.mechanism.coordinates[int(k)].name for k in self.mechanism.free.q)

    @cached_property
    def speed_names(self) -> tuple[str, ...]:
        """Names of the own speeds (without a map, of the free ones)."""
        if self.coordinates is not None:
            return self.coordinates.speeds
        return tuple(self.mechanism.speeds[int(k)].name for k in self.mechanism.free.u)

    @cached_property
    def quaternions(self) -> list[slice]:
        """Places of unit quaternions among the free coordinates."""
        return quaternions(self.mechanism)

    # --- functions of states -------------------------------------------------------------------

    def function(self, outputs: Sequence[SX], *more: SX) -> Any:
        """Outputs (dense columns) of (t, q, u, further symbols), motors without a law at zero."""
        s = self.system
        columns = [ca.densify(ca.vec(x)) for x in outputs]
        if s.inputs.shape[0]:
            columns = ca.substitute(columns, [s.inputs], [ca.SX.zeros(s.inputs.shape[0])])
        return ca.Function("kane", [s.t, s.q, s.u, *more], columns, {"cse": True})

    @cached_property
    def _terms(self) -> Any:
        s, free = self.system, self.system.free_u
        rest = ca.SX(s.udot_all)
        rest[free] = 0
        forces = ca.horzcat(ca.SX(len(free), 0), *(part.force[free] for part in self.parts))
        r = self.rows
        return self.function(
            [crba(s)[free, free], rnea(s, rest)[free], forces, r.phi, r.psi, r.gamma, r.G]
        )

    def terms(self, t: Array, q: Array, u: Array) -> Terms:
        """The equations' terms at states t (B,), q (nq, B), u (n, B)."""
        n, batch = u.shape
        M, bias, forces, phi, psi, gamma, G = evaluate(self._terms, t[None, :], q, u)
        by_channel = forces.reshape(len(self.parts), n, batch)
        return Terms(
            M=matrices(M, n, n),
            bias=bias,
            forces={part.name: by_channel[k] for k, part in enumerate(self.parts)},
            phi=phi,
            psi=psi,
            gamma=gamma,
            G=matrices(G, len(self.rows), n),
        )

    @cached_property
    def _map(self) -> Any:
        assert self.own is not None
        own, t = self.own, self.system.t
        rest = own.udot(self.system, ca.SX.zeros(own.own_u.shape[0]))
        columns = [ca.densify(ca.vec(x)) for x in (own.q, own.u, own.Y, rest)]
        return ca.Function("map", [t, own.own_q, own.own_u], columns, {"cse": True})

    def point(self, t: Array, own_q: Array, own_u: Array) -> Point:
        """The mechanism's coordinates and speeds from own ones."""
        if self.own is None:
            n, batch = own_u.shape
            eye = np.broadcast_to(np.eye(n), (batch, n, n))
            return Point(t, own_q, own_u, eye, np.zeros((n, batch)))
        q, u, Y, rest = evaluate(self._map, t[None, :], own_q, own_u)
        return Point(t, q, u, matrices(Y, len(u), len(own_u)), rest)

    @cached_property
    def _inverse(self) -> Any:
        assert self.own is not None and self.own.inverse is not None
        s = self.system
        return ca.Function("inverse", [s.t, s.q], [ca.densify(self.own.inverse)])

    def own_coordinates(self, t: Array, q: Array) -> Array | None:
        """Own coordinates from the mechanism's; None if the map's inverse is not known."""
        if self.own is None:
            return q
        if self.own.inverse is None:
            return None
        return evaluate(self._inverse, t[None, :], q)[0]

    @cached_property
    def _rates(self) -> Any:
        s = self.system
        return ca.Function("rates", [s.q], [ca.densify(ca.vec(ca.jacobian(s.qdot, s.u)))])

    def rates(self, q: Array) -> Array:
        """W (B, nq, n) of q̇ = W u."""
        n = len(self.system.free_u)
        return matrices(evaluate(self._rates, q)[0], len(q), n)

    @cached_property
    def _own_rates(self) -> Any:
        assert self.own is not None
        own = self.own
        return ca.Function(
            "rates", [self.system.t, own.own_q, own.own_u], [ca.densify(own.own_qdot)]
        )

    def own_rates(self, t: Array, own_q: Array, own_u: Array) -> Array:
        """q̇ (nq, B) of the own coordinates at states in own coordinates and speeds."""
        if self.own is None:
            return times(self.rates(own_q), own_u)
        return evaluate(self._own_rates, t[None, :], own_q, own_u)[0]


def quaternions(mechanism: Mechanism) -> list[slice]:
    """Places of unit quaternions among the free coordinates."""
    place = {int(index): k for k, index in enumerate(mechanism.free.q)}
    found = []
    for joint in mechanism.joints:
        offset = KINDS[joint.kind].quaternion
        if offset is not None:
            start = place[mechanism.coordinates.of(joint.name).start + offset]
            found.append(slice(start, start + 4))
    return found


def evaluate(function: Any, *columns: Array) -> list[Array]:
    """A CasADi function of columns at B states; every output (n, B)."""
    batch = columns[0].shape[1]
    found = function.map(batch).call([ca.DM(np.ascontiguousarray(c)) for c in columns])
    return [np.array(x).reshape(-1, batch) for x in found]


def matrices(flat: Array, rows: int, columns: int) -> Array:
    """Matrices (B, rows, columns) from their columns, stacked (rows·columns, B)."""
    return np.ascontiguousarray(flat.reshape(columns, rows, flat.shape[1]).transpose(2, 1, 0))


def times(A: Array, x: Array) -> Array:
    """A x at every state: matrices (B, m, n) by columns (n, B)."""
    return np.asarray(np.einsum("bij,jb->ib", A, x))


def multiplier_map(M: Array, G: Array) -> tuple[Array, Array]:
    """M⁻¹Gᵀ (B, n, nc) and (G M⁻¹ Gᵀ)⁺ (B, nc, nc), redundant rows allowed."""
    response: Array = np.asarray(np.linalg.solve(M, G.transpose(0, 2, 1)))
    inverse: Array = np.asarray(np.linalg.pinv(G @ response, rcond=RANK, hermitian=True))
    return response, inverse
