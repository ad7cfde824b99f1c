"""The equations of motion with a log's forces, evaluated at arrays of its rows."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deltac.arrays import HALF_DIGITS, Array
from deltac.diagnosis.causes.columns import ColumnKernels
from deltac.dynamics.forces import total_force
from deltac.dynamics.recursions import aba, crba, rnea
from deltac.energy.terms import LedgerSymbols, LoggedForces, ledger_symbols
from deltac.kernels.rows import RowExpression
from deltac.mechanism.channels import PASSIVE, ChannelName
from deltac.mechanism.forces import JointDamper
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory
from deltac.trajectories.columns import RateNames


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of a log, or states between them: free q (T, nq) and u (T, n), the logged forces F (T, m)."""

    t: Array
    q: Array
    u: Array
    F: Array

    def take(self, rows: slice | NDArray[np.intp]) -> Rows:
        """Some of them."""
        return Rows(self.t[rows], self.q[rows], self.u[rows], self.F[rows])

    def replaced(self, rows: NDArray[np.intp], own: Rows) -> Rows:
        """The same with others in the place of some of them."""
        columns = [np.array(x) for x in (self.t, self.q, self.u, self.F)]
        for x, y in zip(columns, (own.t, own.q, own.u, own.F), strict=True):
            x[rows] = y
        return Rows(*columns)

    @staticmethod
    def join(parts: Sequence[Rows]) -> Rows:
        """Rows of several, one after the other."""
        columns = zip(*((r.t, r.q, r.u, r.F) for r in parts), strict=True)
        return Rows(*(np.concatenate(x) for x in columns))


@dataclass(frozen=True, eq=False)
class Intervals:
    """Intervals between consecutive rows of a log: their starts and ends, N of them.

    `stages`: logged forces (N, m) at the later stages of the step that the solver made from the start.
    """

    start: Rows
    end: Rows
    stages: tuple[Array, ...] = ()

    @property
    def h(self) -> Array:
        """Lengths (N, 1), s."""
        return np.asarray((self.end.t - self.start.t)[:, None])

    def __len__(self) -> int:
        return len(self.start.t)

    def take(self, which: NDArray[np.intp]) -> Intervals:
        """Some of them."""
        stages = tuple(F[which] for F in self.stages)
        return Intervals(self.start.take(which), self.end.take(which), stages)


class _Expressions:
    """What is evaluated of a mechanism with a log's forces: made once for logs of the same columns."""

    def __init__(self, mechanism: Mechanism, log: LoggedForces, symbols: LedgerSymbols) -> None:
        s, at = symbols.system, symbols.system.free_u
        bound, terms = symbols.constrained, symbols.computed
        force = total_force(s, symbols.parts)
        if bound is None:
            a = aba(s, force)[0][at]
            G = ca.SX(0, len(at))
        else:
            still = ca.SX(s.udot_all)
            still[at] = 0
            r = (force - rnea(s, still))[at]
            a, _ = bound.schur.solve(r, bound.rows.gamma)
            G = bound.rows.G
        # Engines treat damping implicitly in joints, and some of them in cords, between bodies and in laws of
        # actuators as well.
        joints = {x.name for x in mechanism.elements if isinstance(x, JointDamper)}
        own = [p for p in symbols.parts if p.name not in log.places]
        drives = [p for p in own if p.name.kind == "actuator" and ca.depends_on(p.force, s.u)]
        dampers = [p for p in own if p.name.kind == "damper"] + drives
        in_joints = [p for p in dampers if p.name.kind == "damper" and p.name.element in joints]
        damping, whole = (
            ca.SX(sum((p.force[at] for p in some), start=ca.SX.zeros(len(at))))
            for some in (in_joints, dampers)
        )
        E = ca.SX(terms.K2 + terms.K1 + terms.K0 + terms.V)
        along_q = ca.jtimes(s.qdot, s.u, ca.gradient(E, s.q), True)
        driven = ca.gradient(ca.SX(terms.K1 + 2 * terms.K0), s.u)
        place = {"t": s.t, "q": s.q}
        state = {**place, "u": s.u}
        self.acceleration = RowExpression("a", {**state, "logged": symbols.logged}, a, often=True)
        self.damping = RowExpression("d", {**state, "logged": symbols.logged}, damping, whole)
        self.matrices = RowExpression("m", place, crba(s)[at, at], G)
        self.qdot = RowExpression("r", state, s.qdot)
        self.energy = RowExpression("e", state, ca.vertcat(along_q, ca.gradient(E, s.u)), driven)
        self.rows_of_G, self.n = G.shape[0], len(at)
        self.damped = bool(in_joints) and not damping.is_zero()
        self.damped_elsewhere = len(dampers) > len(in_joints)
        self.dampers = tuple(frozenset(p.name for p in some) for some in (in_joints, dampers))


class _Change:
    """Causes with their coefficients: by how much M, the generalized forces and the dampers are others.

    Dampers are those of the channels in joints, and all of them.

    F_r + F*_r + Σ θ_j x_j = 0 with columns that are affine in u̇: those of the first kernels.
    """

    def __init__(
        self,
        kernels: Sequence[ColumnKernels],
        coefficients: Array,
        dampers: Sequence[frozenset[ChannelName]],
    ) -> None:
        columns, own = kernels[0].columns, coefficients[: len(kernels[0].columns)]
        self._force = _sum(kernels[0], own, "x", rated=True) if own.any() else None
        self._damping = list[RowExpression | None]()
        for channels in dampers:
            damps = [
                x.what == "damper" or (x.what == "channel" and x.element in channels)
                for x in columns
            ]
            some = np.where(damps, own, 0.0)
            self._damping.append(_sum(kernels[0], some, "d") if some.any() else None)
        self.damped = self._damping[0] is not None

    def force(self, t: Array, q: Array, u: Array, a: Array, F: Array) -> tuple[Array, Array]:
        """Sum x (T, n) of the columns of forces and masses, and ∂x/∂u̇ (T, n, n)."""
        n = a.shape[1]
        if self._force is None:
            return np.zeros_like(a), np.zeros((len(t), n, n))
        x, A = self._force(t, q, u, a, F)
        return x, A.reshape(len(t), n, n).transpose(0, 2, 1)

    def damping(self, t: Array, q: Array, u: Array, F: Array, everywhere: bool) -> Array:
        """What of x are dampers in joints, or `everywhere` (T, n)."""
        damping = self._damping[int(everywhere)]
        return np.zeros_like(u) if damping is None else damping(t, q, u, np.zeros_like(u), F)[0]


def _sum(columns: ColumnKernels, c: Array, name: str, rated: bool = False) -> RowExpression:
    """Columns times coefficients where logged forces stand still; `rated`: and its derivatives by u̇."""
    t, q, u, udot, logged, *rates = columns.inputs
    x = ca.mtimes(columns.expression[:, 1:], ca.sparsify(ca.DM(c)))
    x = ca.substitute(x, ca.vertcat(*rates), ca.SX.zeros(ca.vertcat(*rates).shape))
    inputs = {"t": t, "q": q, "u": u, "udot": udot, "logged": logged}
    return RowExpression(name, inputs, x, *([ca.jacobian(x, udot)] if rated else []))


class LogModel:
    """A mechanism with a log's forces: accelerations, mass matrix, constraints and energy at rows.

    Displacements and directions of the state have 2n components: along the n free speeds (of a quaternion,
    the three of its rotation vector), then of the speeds themselves. `of_q` and `of_u` are the columns of the
    log in which the state is.
    """

    def __init__(self, mechanism: Mechanism, run: Trajectory) -> None:
        self.mechanism, self.log = mechanism, LoggedForces.of(run)
        free = mechanism.free
        start = (float(run.t[0]), run.q[0, free.q])
        self.symbols: LedgerSymbols = ledger_symbols(mechanism, self.log, None, start)
        made = self.symbols.once(
            "inference", lambda: _Expressions(mechanism, self.log, self.symbols)
        )
        self._expressions = made
        self.rows_of_G, self.n, self.damped = made.rows_of_G, made.n, made.damped
        # What is in logged forces of servos some engines treat implicitly as well.
        driven = {k for n, at in self.log.places.items() if n.kind == "actuator" for k in at}
        of = run.provenance.servo_damping
        self.servos = np.array([of.get(run.speeds[k], 0.0) * (k in driven) for k in free.u])
        self.damped_elsewhere = made.damped_elsewhere or bool(self.servos.any())
        self.exponentials = True
        self.rated = run.udot is not None and "udot" not in run.provenance.derived
        self.change: _Change | None = None
        self.cost = int(made.acceleration.function.n_instructions())
        names = RateNames.of(run.coordinates, run.speeds)
        self.of_q, self.of_u = np.asarray(free.q), np.asarray(free.u)
        free_q = {int(k): i for i, k in enumerate(free.q)}
        free_u = {int(k): i for i, k in enumerate(free.u)}
        rates = [(free_q[i], free_u[j]) for i, j in names.rates if i in free_q and j in free_u]
        self.rates = np.array(rates, dtype=np.intp).reshape(-1, 2)
        self.quaternions = [
            (free_q[i], free_u[j]) for _, i, j in names.quaternions if i in free_q and j in free_u
        ]

    def of_mechanism(self, mechanism: Mechanism, run: Trajectory) -> LogModel:
        """The same of another mechanism, with the same joints and channels."""
        return LogModel(mechanism, run)

    def rows(self, run: Trajectory) -> Rows:
        """All rows of a run: free coordinates and speeds, forces as logged."""
        forces = [np.zeros((len(run), 0)), *self.log.values(run).values()]
        return Rows(run.t, run.q[:, self.of_q], run.u[:, self.of_u], np.concatenate(forces, axis=1))

    def completed(self, rows: Rows) -> Rows:
        """The rows with all free coordinates and speeds."""
        return rows

    def stages(self, run: Trajectory, rows: NDArray[np.intp]) -> tuple[Array, ...]:
        """Logged forces (N, m) at the later stages of the steps from some rows; none where the log has none.

        It has their sums: what these are beyond those of the rows, the columns of a speed share.
        """
        if run.stages is None or any(
            name.kind in PASSIVE for name, p in self.log.places.items() if p
        ):
            return ()
        speeds = np.array([k for p in self.log.places.values() for k in p], dtype=np.intp)
        F = self.rows(run.take(rows)).F
        share = (speeds[:, None] == np.arange(len(run.speeds))) / 1.0
        change = run.stages[rows] - (F @ share)[:, None]
        if np.abs(change[:, :, np.setdiff1d(np.arange(len(run.speeds)), speeds)]).any():
            return ()
        change = change @ (share / np.maximum(share.sum(axis=0), 1.0)).T
        return tuple((F[:, None] + change).transpose(1, 0, 2))

    def changed(self, kernels: Sequence[ColumnKernels], coefficients: Array) -> LogModel:
        """The model with causes in its equations: coefficients (P,), of the columns of the first kernels."""
        other = copy(self)
        dampers = self._expressions.dampers
        other.change = _Change(kernels, coefficients, dampers) if coefficients.any() else None
        other.damped = self._expressions.damped or (
            other.change is not None and other.change.damped
        )
        return other

    def by_quaternions(self) -> LogModel:
        """The model as programs have it that add ½ h q ⊗ ω to a quaternion, and normalise it."""
        other = copy(self)
        other.exponentials = False
        return other

    def acceleration(self, t: Array, q: Array, u: Array, F: Array) -> Array:
        """u̇ (T, n) of the free speeds."""
        a = self._expressions.acceleration(t, q, u, F)[0]
        if self.change is None:
            return a
        # M u̇ = F + x(u̇) with x affine in u̇: exact from any u̇ that it is evaluated at.
        M, G = self._of_model(t, q)
        x, A = self.change.force(t, q, u, a, F)
        return a + _constrained(M - A, G, x[..., None])[..., 0]

    def at(self, rows: Rows) -> Array:
        """The same at rows."""
        return self.acceleration(rows.t, rows.q, rows.u, rows.F)

    def at_each(self, parts: Sequence[Rows]) -> list[Array]:
        """The same at several, all of one length: where these are short, several in one evaluation."""
        size = len(parts[0].t)
        some = max(1, AT_ONCE // max(size, 1))
        groups = (parts[k : k + some] for k in range(0, len(parts), some))
        return [
            np.asarray(a)
            for group in groups
            for a in self.at(Rows.join(group)).reshape(len(group), size, self.n)
        ]

    def every(self, rows: Rows) -> Array:
        """u̇ of all free speeds at rows."""
        return self.at(rows)

    def damping(self, t: Array, q: Array, u: Array, F: Array, everywhere: bool = False) -> Array:
        """Generalized forces (T, n) of dampers, of the model's own in joints or of those `everywhere`."""
        own = self._expressions.damping(t, q, u, F)[int(everywhere)]
        if everywhere:
            own = own + self.servo_damping(t, q, u)
        if self.change is None:
            return own
        return own + self.change.damping(t, q, u, F, everywhere)

    def servo_damping(self, t: Array, q: Array, u: Array) -> Array:
        """What of logged forces is damping by servos' own laws (T, n)."""
        return np.asarray(-self.servos * u)

    def rate(self, t: Array, q: Array, u: Array) -> Array:
        """q̇ (T, nq) of the free coordinates: their speeds, but for quaternions."""
        if len(self.rates) < q.shape[1]:
            return self._expressions.qdot(t, q, u)[0]
        qdot, (of_q, of_u) = np.empty_like(q), self.rates.T
        qdot[:, of_q] = u[:, of_u]
        return qdot

    def energy_gradient(self, rows: Rows) -> Array:
        """What a jump of the state adds to ΔC (T, 2n), J: ∂(K + V)/∂x, less what drives are booked for it.

        The power of a drive is ω·dp/dt, p the momentum along its prescribed speed ω. Where accelerations are
        derived from the rows, a jump of u is part of dp/dt and does the work ∂(ω·p)/∂u; a jump of q is not,
        since q̇ is that of the speeds. ω·p = K₁ + 2 K₀.
        """
        gradient, driven = self._expressions.energy(rows.t, rows.q, rows.u)
        if not self.rated:
            gradient = gradient - np.concatenate([np.zeros_like(driven), driven], axis=1)
        return np.asarray(gradient)

    def powers(self, rows: Rows, a: Array) -> Array:
        """Power (T, n, p) by which changes of the accelerations (T, n, p) flow through each speed, W."""
        return np.asarray(rows.u[:, :, None] * (self.matrices(rows.t, rows.q)[0] @ a))

    def response(self, t: Array, q: Array, force: Array) -> Array:
        """What generalized forces (T, n) or (T, n, p) add to the accelerations."""
        M, G = self.matrices(t, q)
        columns = force if force.ndim == 3 else force[..., None]
        a = _constrained(M, G, columns)
        return np.asarray(a if force.ndim == 3 else a[..., 0])

    def of_geometry(self, t: Array, q: Array, columns: Array) -> Array:
        """Accelerations (T, n, p) of columns M ∂u̇/∂θ."""
        return np.asarray(np.linalg.solve(self.matrices(t, q)[0], columns))

    def inertia(self, at: Rows) -> Array:
        """Inertia (T, n) of each free speed: the diagonal of M."""
        return np.asarray(np.einsum("tii->ti", self.matrices(at.t, at.q)[0]))

    def matrices(self, t: Array, q: Array) -> tuple[Array, Array]:
        """Mass matrix M (T, n, n) and constraint Jacobian G (T, m, n)."""
        M, G = self._of_model(t, q)
        if self.change is not None:
            rest = np.zeros((len(t), self.n))
            F = np.zeros((len(t), self.symbols.logged.shape[0]))
            M = M - self.change.force(t, q, rest, rest, F)[1]
        return M, G

    def impulses(self, t: Array, q: Array) -> Array:
        """What unit impulses of the constraints do to the speeds, M⁻¹Gᵀ (T, n, m)."""
        M, G = self.matrices(t, q)
        return np.asarray(np.linalg.solve(M, G.transpose(0, 2, 1)))

    def _of_model(self, t: Array, q: Array) -> tuple[Array, Array]:
        flat, g = self._expressions.matrices(t, q)
        G = g.reshape(len(t), self.n, self.rows_of_G).transpose(0, 2, 1)
        return flat.reshape(len(t), self.n, self.n), G

    def moved(self, q: Array, u: Array, h: Array) -> Array:
        """Coordinates moved along constant speeds for a time h (T, 1): rotations by exponentials."""
        end, (of_q, of_u) = np.array(q), self.rates.T
        end[:, of_q] += h * u[:, of_u]
        for i, j in self.quaternions:
            turn = h * u[:, j : j + 3]
            angle = np.linalg.norm(turn, axis=1, keepdims=True)
            w, v = np.cos(angle / 2.0), 0.5 * np.sinc(angle / (2.0 * np.pi)) * turn
            if not self.exponentials:
                w = 1.0 / np.hypot(1.0, 0.5 * angle)
                v = 0.5 * w * turn
            p = q[:, i : i + 4]
            end[:, i : i + 1] = p[:, :1] * w - np.sum(p[:, 1:] * v, axis=1, keepdims=True)
            end[:, i + 1 : i + 4] = p[:, :1] * v + w * p[:, 1:] + np.cross(p[:, 1:], v)
        return end

    def displaced(self, at: Rows, by: Array) -> Rows:
        """States displaced by (T, 2n)."""
        q = self.moved(at.q, by[:, : self.n], np.ones((len(by), 1)))
        return Rows(at.t, q, at.u + by[:, self.n :], at.F)

    def projections(self, near: Rows, noise: Array) -> Callable[[Rows], Iterator[Rows]]:
        """A function that yields states projected onto the constraints as others `near` satisfy them.

        Where noise (T, 2n) hides the square of the displacement, one that is linear and orthogonal. Otherwise
        one with the masses as metric and an orthogonal one, by two steps of Newton's method. Along a
        displacement constraints change by G at its middle, to third order.
        """
        nothing, G = np.zeros_like(near.u), self.matrices(near.t, near.q)[1]
        inverse = np.asarray(np.linalg.pinv(G))

        def moved(by: Array) -> Array:
            return self.displaced(near, np.concatenate([by, nothing], axis=1)).q

        def of(matrices: Array, x: Array) -> Array:
            return np.asarray((matrices @ x[:, :, None])[:, :, 0])

        def constrained(q: Array, by_masses: bool) -> tuple[Array, Array]:
            M, G = self.matrices(near.t, q)
            along = np.linalg.solve(M, G.transpose(0, 2, 1)) if by_masses else G.transpose(0, 2, 1)
            return G, along @ np.linalg.pinv(G @ along, hermitian=True)

        def each(at: Rows) -> Iterator[Rows]:
            d, rates = self.difference(near, at)[:, : self.n], of(G, near.u)
            if np.all(d**2 <= noise[:, : self.n]):
                q = moved(d - of(inverse @ G, d))
                change = of(self.matrices(near.t, q)[1], at.u) - rates
                yield Rows(at.t, q, at.u - of(inverse, change), at.F)
                return
            for by_masses in (True, False):
                by = d
                with suppress(np.linalg.LinAlgError):  # states that ran away are not put back
                    for _ in range(2):
                        change = of(self.matrices(near.t, moved(0.5 * by))[1], by)
                        by = by - of(constrained(moved(by), by_masses)[1], change)
                    q = moved(by)
                    own, back = constrained(q, by_masses)
                    yield Rows(at.t, q, at.u - of(back, of(own, at.u) - rates), at.F)

        return each

    def difference(self, start: Rows, end: Rows) -> Array:
        """The displacement (T, 2n) that takes `start` to `end`."""
        along = np.zeros_like(start.u)
        of_q, of_u = self.rates.T
        along[:, of_u] = end.q[:, of_q] - start.q[:, of_q]
        for i, j in self.quaternions:
            p, r = (x / np.linalg.norm(x, axis=1, keepdims=True) for x in (
                start.q[:, i : i + 4], end.q[:, i : i + 4]))  # fmt: skip
            w = np.sum(p * r, axis=1, keepdims=True)
            v = p[:, :1] * r[:, 1:] - r[:, :1] * p[:, 1:] - np.cross(p[:, 1:], r[:, 1:])
            along[:, j : j + 3] = 2.0 * np.where(w < 0.0, -v, v)
        return np.concatenate([along, end.u - start.u], axis=1)

    def jacobian(self, at: Rows) -> Array:
        """∂ẋ/∂x (T, 2n, 2n) by differences, accurate to some 1e-8 of its size."""
        n, count = self.n, len(at.t)
        J = np.zeros((count, 2 * n, 2 * n))
        J[:, np.arange(n), n + np.arange(n)] = 1.0
        for _, j in self.quaternions:
            w = at.u[:, j : j + 3]
            J[:, j + 1, j + 2], J[:, j + 2, j], J[:, j, j + 1] = w[:, 0], w[:, 1], w[:, 2]
            J[:, j + 2, j + 1], J[:, j, j + 2], J[:, j + 1, j] = -w[:, 0], -w[:, 1], -w[:, 2]
        states, sizes = self.neighbours(at, HALF_DIGITS)
        here, *ends = self.at_each([at, *states])
        for k, (end, d) in enumerate(zip(ends, sizes, strict=True)):
            J[:, n:, k] = (end - here) / d
        return J

    def neighbours(self, at: Rows, size: float) -> tuple[list[Rows], list[float]]:
        """States displaced along each component, and by how much; by `size` at states of unit size."""
        states, sizes = list[Rows](), [size] * self.n
        for e in np.eye(self.n)[:, None]:
            q = self.moved(at.q, np.broadcast_to(e, at.u.shape), np.full((len(at.t), 1), size))
            states.append(Rows(at.t, q, at.u, at.F))
        for k, e in enumerate(np.eye(self.n)[:, None]):
            sizes.append(size * (1.0 + float(np.nanmax(np.abs(at.u[:, k]), initial=0.0))))
            states.append(Rows(at.t, at.q, at.u + sizes[-1] * e, at.F))
        return states, sizes


def _constrained(M: Array, G: Array, force: Array) -> Array:
    """Accelerations (T, n, k) by forces: M⁻¹F, without M⁻¹Gᵀ(G M⁻¹Gᵀ)⁻¹G M⁻¹F, which constraints take."""
    if not G.shape[1]:
        return np.asarray(np.linalg.solve(M, force))
    inverse: Array = np.asarray(np.linalg.inv(M), dtype=np.float64)
    response = inverse @ G.transpose(0, 2, 1)
    multipliers = _pseudoinverse(G @ response)
    return np.asarray((inverse - response @ multipliers @ response.transpose(0, 2, 1)) @ force)


SINGULAR = 1e-10
"""Share of the largest singular value below which one is none: redundant constraints leave such."""


def _pseudoinverse(A: Array) -> Array:
    """A⁺ of each of some matrices; by singular values, ten times as long, only where one may be none."""
    try:
        inverse = np.asarray(np.linalg.inv(A), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.pinv(A, rcond=SINGULAR))
    condition = np.linalg.norm(A, axis=(1, 2)) * np.linalg.norm(inverse, axis=(1, 2))
    some = np.flatnonzero(~(condition * SINGULAR < 1.0))
    if len(some):
        inverse[some] = np.linalg.pinv(A[some], rcond=SINGULAR)
    return inverse


AT_ONCE = 4096
"""Rows up to which states are evaluated together: a call costs as much as some hundred rows, and longer
columns leave the cache."""
