"""Assembly: from an approximate guess to coordinates and speeds that satisfy all constraints."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deltac.arrays import Array
from deltac.dynamics.constraints import Rows, constraint_rows
from deltac.dynamics.independence import independence, row_names, without_rounding
from deltac.dynamics.recursions import crba
from deltac.dynamics.system import System, trace
from deltac.errors import InputError, closest
from deltac.mechanism.joints import KINDS
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.state import State
from deltac.simulation.feasibility import violation
from deltac.simulation.flow import quaternions

TOLERANCE = 1e-15
"""Newton's steps go on until the violation is below this, or falls no more."""

MOST_ITERATIONS = 200


@dataclass(frozen=True)
class Assembly:
    """A consistent state, and what the constraints are like there.

    `freedom` counts the degrees of freedom; `redundant` tells, in words, the rows that follow from
    others (harmless if `residual`, the largest violation left, is at rounding); `singular` whether the
    configuration has a smaller rank than its neighbourhood. `moved` is the largest change of a
    coordinate of the guess.
    """

    state: State
    residual: float
    freedom: int
    redundant: str
    singular: bool
    moved: float


def assemble(mechanism: Mechanism, guess: State, pinned: Collection[str] = ()) -> Assembly:
    """Find coordinates and speeds near a guess that satisfy every constraint.

    Args:
        mechanism: with constraints.
        guess: an approximate state; its time is kept.
        pinned: names of coordinates and speeds of `mechanism` that keep the values of the guess.

    Returns:
        The assembly; its state is nearest to the guess in the sense of damped Newton steps in the mass
        metric.

    Raises:
        InputError: an unknown pinned name, or constraints that cannot be met: the message names the worst
            constraint and its residual.
    """
    q_free = [mechanism.coordinates[int(i)].name for i in mechanism.free.q]
    u_free = [mechanism.speeds[int(i)].name for i in mechanism.free.u]
    for name in pinned:
        if name not in q_free and name not in u_free:
            raise InputError(
                f"pinned: unknown coordinate {name!r}{closest(name, [*q_free, *u_free])}"
            )
    system = trace(mechanism)
    rows = constraint_rows(system)
    t, q, u = guess.t, guess.q[mechanism.free.q].copy(), guess.u[mechanism.free.u].copy()
    if len(rows):
        solver = _Newton(system, rows, t)
        # A pinned coordinate of a joint holds the speed that moves it; joints in quaternions as a whole.
        held_q = _held(mechanism, [n for n in pinned if n in q_free])
        held_u = np.array([name in pinned for name in u_free], dtype=bool)
        q = solver.coordinates(q, ~held_q)
        u = solver.speeds(q, u, ~held_u)
    found = independence(system, rows, t, q, np.empty(0))
    full_q, full_u = guess.q.copy(), guess.u.copy()
    moved = float(np.abs(full_q[mechanism.free.q] - q).max(initial=0.0))
    full_q[mechanism.free.q], full_u[mechanism.free.u] = q, u
    phi, psi = violation(system, rows, t, q, u)
    return Assembly(
        state=mechanism.state(full_q, full_u, t),
        residual=float(np.abs(np.concatenate([phi, psi])).max(initial=0.0)),
        freedom=found.freedom,
        redundant=row_names(rows, found.redundant),
        singular=found.singular,
        moved=moved,
    )


class _Newton:
    """Damped least-squares Newton steps on φ, then one linear step on ψ."""

    def __init__(self, system: System, rows: Rows, t: float) -> None:
        self.rows, self.t = rows, t
        free = system.free_u
        W = ca.jacobian(system.qdot, system.u)
        M = crba(system)[free, free]
        self.at = ca.Function("at", [system.t, system.q], [rows.phi, rows.G, W, M])
        self.psi = ca.Function("psi", [system.t, system.q, system.u], [rows.psi])
        self.system = system

    def coordinates(self, q: Array, movable: NDArray[np.bool_]) -> Array:
        """Q with φ = 0, moving only some speeds' directions."""
        position = np.array(self.rows.holonomic)
        phi, G, W, M = self._at(q)
        size = float(np.abs(phi).max(initial=0.0))
        for _ in range(MOST_ITERATIONS):
            if size <= TOLERANCE:
                break
            delta = _least(M, G[position], -phi[position], movable)
            scale = 1.0
            while True:
                trial = _unit(self.system, q + scale * (W @ delta))
                values = self._at(trial)
                found = float(np.abs(values[0]).max(initial=0.0))
                if found < (1.0 - 0.1 * scale) * size or scale < 1e-3:
                    break
                scale *= 0.5
            if not found < size:
                break
            q, (phi, G, W, M), size = trial, values, found
        if size > 1e-9:
            raise _unmet(self.rows, phi, "position", "m or rad")
        return q

    def speeds(self, q: Array, u: Array, movable: NDArray[np.bool_]) -> Array:
        """U with ψ = 0 at q, changed as little as possible."""
        _, G, _, M = self._at(q)
        for _ in range(3):
            psi = np.array(self.psi(self.t, q, u)).ravel()
            u = u + _least(M, G, -psi, movable)
        psi = np.array(self.psi(self.t, q, u)).ravel()
        if float(np.abs(psi).max(initial=0.0)) > 1e-9 * max(1.0, float(np.abs(u).max(initial=0.0))):
            raise _unmet(self.rows, psi, "velocity", "m/s or rad/s")
        return u

    def _at(self, q: Array) -> tuple[Array, Array, Array, Array]:
        phi, G, W, M = (np.array(value) for value in self.at(self.t, q))
        return phi.ravel(), G, W, M


def _least(M: Array, G: Array, target: Array, movable: NDArray[np.bool_]) -> Array:
    """The least change of the movable speeds, in the mass metric, that G maps nearest to `target`."""
    step = np.zeros(G.shape[1])
    if movable.any() and len(target):
        root = np.linalg.cholesky(M[np.ix_(movable, movable)])
        scaled = np.linalg.solve(root, without_rounding(G[:, movable]).T).T
        step[movable] = np.linalg.solve(root.T, np.linalg.lstsq(scaled, target, rcond=1e-10)[0])
    return step


def _held(mechanism: Mechanism, pinned: Collection[str]) -> NDArray[np.bool_]:
    """Which free speeds must not move the pinned coordinates."""
    held = np.zeros(len(mechanism.free.u), dtype=bool)
    place = {int(index): k for k, index in enumerate(mechanism.free.u)}
    for name in pinned:
        entry = mechanism.coordinates[name]
        joint = mechanism.joint(entry.joint)
        first_q = mechanism.coordinates.of(joint.name).start
        u_slice = mechanism.speeds.of(joint.name)
        offset = KINDS[joint.kind].quaternion
        within = entry.index - first_q
        if offset is not None and within >= offset:
            moving = range(u_slice.stop - 3, u_slice.stop)
        else:
            moving = range(u_slice.start + within, u_slice.start + within + 1)
        for index in moving:
            held[place[index]] = True
    return held


def _unit(system: System, q: Array) -> Array:
    q = q.copy()
    for where in quaternions(system.mechanism):
        q[where] /= np.linalg.norm(q[where])
    return q


def _unmet(rows: Rows, values: Array, level: str, unit: str) -> InputError:
    worst = int(np.argmax(np.abs(values)))
    return InputError(
        f"the constraints cannot be met at {level} level from this guess: {rows.names[worst]!r} is off by "
        f"{abs(values[worst]):.3g} {unit} at best. Either they contradict each other (or what is pinned), "
        "or the guess is too far away"
    )
