"""Constraints in symbols: positions, velocities, Jacobians, and what depends on time alone.

A holonomic row is φ(q, t) = 0; every row has ψ(q, u, t) = G u + b = 0 at velocity level (φ̇ = ψ), where
u holds all speeds, those of prescribed joints too, and b is what is left without any motion:
f_t of the theory for a configuration constraint, b for a motion constraint. Rows are written on the
released system (symbols for prescribed joints) and their derivatives are exact.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca

from deltac.arrays import ASSEMBLED
from deltac.dynamics.scene import TracedScene
from deltac.dynamics.spatial import SX
from deltac.dynamics.system import System, released


@dataclass(frozen=True)
class ConstraintRows:
    """All rows of a mechanism's constraints, in the symbols of its system.

    `names` (nc) tell the constraint of each row, `index` its place among all rows that they state,
    `holonomic` which have a position level. `phi` (nc,) is
    φ, zero where there is none; `psi` (nc,) is ψ; `G_all` (nc by nu) and `G` (nc by free speeds) its
    Jacobians; `b` (nc,) its explicit part; `gamma` (nc,) is ψ̇ at u̇ = 0 of the free speeds, so that
    ψ̇ = G u̇ + γ.
    """

    names: tuple[str, ...]
    index: tuple[int, ...]
    holonomic: tuple[bool, ...]
    phi: SX
    psi: SX
    G_all: SX
    G: SX
    b: SX
    gamma: SX

    def __len__(self) -> int:
        return len(self.names)

    def select(self, rows: Sequence[int]) -> ConstraintRows:
        """Some of the rows."""
        k = list(rows)
        return ConstraintRows(
            tuple(self.names[i] for i in k),
            tuple(self.index[i] for i in k),
            tuple(self.holonomic[i] for i in k),
            self.phi[k],
            self.psi[k],
            self.G_all[k, :],
            self.G[k, :],
            self.b[k],
            self.gamma[k],
        )

    @staticmethod
    def none(system: System) -> ConstraintRows:
        """No rows, of a system."""
        nothing, nu = ca.SX(0, 1), system.u_all.shape[0]
        G = ca.SX(0, len(system.free_u))
        return ConstraintRows((), (), (), nothing, nothing, ca.SX(0, nu), G, nothing, nothing)

    def at_rest(self, u: SX) -> SX:
        """ψ (nc,) where the free speeds `u` are zero; prescribed joints move."""
        return ca.substitute(self.psi, u, ca.SX.zeros(u.shape[0]))

    def places(self, name: str) -> list[int]:
        """The rows of a constraint."""
        return [k for k, owner in enumerate(self.names) if owner == name]


def constraint_rows(system: System) -> ConstraintRows:
    """Write out all constraints. Rows that vanish identically (out of a planar loop's plane) are left out."""
    if not system.mechanism.constraints:
        return ConstraintRows.none(system)
    twin = released(system)
    entries = row_entries(TracedScene(twin), lambda phi: _rate(twin, phi))
    names = tuple(name for name, *_ in entries)
    holonomic = tuple(of_place for _, of_place, _, _ in entries)
    phi = ca.vertcat(ca.SX(0, 1), *(phi for _, _, phi, _ in entries))
    psi = ca.vertcat(ca.SX(0, 1), *(rate for _, _, _, rate in entries))
    G_all = ca.jacobian(psi, twin.u_all)
    b = ca.substitute(psi, twin.u_all, ca.SX.zeros(twin.u_all.shape[0]))
    # The symbols of the released system give way to the system's own.
    phi, psi, G_all, b = ca.substitute(
        [phi, psi, G_all, b], [twin.q_all, twin.u_all], [system.q_all, system.u_all]
    )
    along = ca.vertcat(system.q, system.t)
    gamma = ca.jtimes(psi, along, ca.vertcat(system.qdot, 1))
    G = ca.simplify(G_all[:, system.free_u])
    rows = ConstraintRows(names, tuple(range(len(names))), holonomic, phi, psi, G_all, G, b, gamma)
    present = [
        k for k in range(len(names)) if ca.sparsify(G_all[k, :]).nnz() or not _vanishes(rows, k)
    ]
    return rows if len(present) == len(names) else rows.select(present)


def row_entries(scene: TracedScene, rate: Callable[[SX], SX]) -> list[tuple[str, bool, SX, SX]]:
    """Of each row of the constraints its name, whether it is holonomic, φ (else 0), and φ̇ or ψ."""
    entries: list[tuple[str, bool, SX, SX]] = []
    for constraint in scene.system.mechanism.constraints:
        positions, motions = constraint.positions(scene), constraint.motions(scene)
        entries += [(constraint.name, True, phi, rate(phi)) for phi in positions]
        entries += [(constraint.name, False, ca.SX(0), psi) for psi in motions]
    return entries


def _vanishes(rows: ConstraintRows, k: int) -> bool:
    """Whether a row without motion holds by itself: constants at rounding level."""
    values = ca.vertcat(rows.phi[k], rows.b[k])
    return bool(values.is_constant()) and float(ca.norm_inf(ca.DM(values))) < ASSEMBLED


def _rate(system: System, phi: SX) -> SX:
    """φ̇ of the released system: it moves with q̇ = W u, and explicitly with t."""
    along = ca.vertcat(system.q_all, system.t)
    return ca.jtimes(phi, along, ca.vertcat(system.qdot_all, 1))
