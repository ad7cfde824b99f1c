"""A log as the one-step test sees it: stretches of consecutive rows, and the model evaluated along them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deltac.arrays import Array
from deltac.diagnosis.measurements.digits import digits_of
from deltac.diagnosis.measurements.kinematics import stretches
from deltac.dynamics.forces import total_force
from deltac.dynamics.recursions import aba, crba, rnea
from deltac.energy.sampling.splines import spline_integrals
from deltac.energy.terms import LedgerSymbols, LoggedForces, ledger_symbols
from deltac.kernels.rows import Expression
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory
from deltac.trajectories.columns import Kinematics

WORK = 1e9
"""Instructions that the test may take, about: some seconds. Longer logs are looked at in stretches."""

MOST_ROWS, LEAST_ROWS = 2500, 200
PIECES = 8
"""Rows of the test, and the number of stretches that they are taken from."""

UNEVEN = 1e-3
"""Relative differences of intervals from which on a log is not uniform."""

RESTING, SHARE_RESTING = 40, 0.2
"""Intervals without a change of any force that a log of held forces has at least."""


class Functions:
    """What the test evaluates of a mechanism with a log's forces: made once for logs of the same columns."""

    def __init__(self, mechanism: Mechanism, log: LoggedForces, symbols: LedgerSymbols) -> None:
        s, at = symbols.system, symbols.system.free_u
        bound = symbols.constrained
        tau = total_force(s, symbols.parts)
        if bound is None:
            a = aba(s, tau)[0][at]
            G = ca.SX(0, len(at))
        else:
            still = ca.SX(s.udot_all)
            still[at] = 0
            r = (tau - rnea(s, still))[at]
            multipliers = bound.schur.multipliers(r, bound.rows.gamma)
            a = bound.schur.free_response(r) + bound.schur.response(multipliers)
            G = bound.rows.G
        damped = [
            p.force[at]
            for p in symbols.parts
            if p.name.kind == "damper" and p.name not in log.places
        ]
        damping = ca.SX(sum(damped, start=ca.SX.zeros(len(at))))
        bias = rnea(s, ca.SX.zeros(len(mechanism.speeds)))[at]
        size = sum((ca.fabs(p.force[at]) for p in symbols.parts), start=ca.fabs(bias))
        place = {"t": s.t, "q": s.q}
        inputs = {**place, "u": s.u, "logged": symbols.logged}
        self.acceleration = Expression("a", inputs, a, often=True)
        self.damping = Expression("d", inputs, damping)
        self.terms = Expression("s", inputs, size)
        M, w = crba(s)[at, at], ca.SX.sym("w", len(at))
        self.matrices = Expression("m", place, M, G)
        self.inertial = Expression("i", {**place, "w": w}, M @ w, ca.diag(M))
        self.qdot = Expression("r", {**place, "u": s.u}, s.qdot)
        if bound is not None:
            terms = ca.mtimes(ca.fabs(G), ca.fabs(s.u_all[at]))
            self.psi = Expression("v", {**place, "u": s.u}, ca.SX(bound.rows.psi), terms)
        self.rows_of_G, self.n = G.shape[0], len(at)
        self.damped = bool(damped) and not damping.is_zero()
        self.of_time = bool(ca.depends_on(a, s.t))


class Model:
    """A mechanism with a log's forces: accelerations, mass matrix and constraints of arrays of rows."""

    def __init__(self, mechanism: Mechanism, run: Trajectory) -> None:
        self.mechanism, self.log = mechanism, LoggedForces.of(run)
        free = mechanism.free
        start = (float(run.t[0]), run.q[0, free.q])
        symbols: LedgerSymbols = ledger_symbols(mechanism, self.log, None, start)
        self.symbols = symbols
        made = symbols.once("one step", lambda: Functions(mechanism, self.log, symbols))
        self.functions = made
        self.rows_of_G, self.n = made.rows_of_G, made.n
        self.damped, self.of_time = made.damped, made.of_time
        self.cost = int(made.acceleration.function.n_instructions())
        names = Kinematics.of(run.coordinates, run.speeds)
        free_q = {int(k): i for i, k in enumerate(free.q)}
        free_u = {int(k): i for i, k in enumerate(free.u)}
        self.rates = [(free_q[i], free_u[j]) for i, j in names.rates if i in free_q and j in free_u]
        self.quaternions = [
            (free_q[i], free_u[j]) for _, i, j in names.quaternions if i in free_q and j in free_u
        ]

    def acceleration(self, t: Array, q: Array, u: Array, F: Array) -> Array:
        """u̇ (T, n) of the free speeds."""
        return self.functions.acceleration(t, q, u, F)[0]

    def at(self, rows: Rows) -> Array:
        """The same at rows."""
        return self.acceleration(rows.t, rows.q, rows.u, rows.F)

    def damping(self, t: Array, q: Array, u: Array, F: Array) -> Array:
        """Generalized forces (T, n) of the model's own dampers."""
        return self.functions.damping(t, q, u, F)[0]

    def terms(self, t: Array, q: Array, u: Array, F: Array) -> Array:
        """Sum of the absolute forces and bias of each equation (T, n)."""
        return self.functions.terms(t, q, u, F)[0]

    def rate(self, t: Array, q: Array, u: Array) -> Array:
        """q̇ (T, nq) of the free coordinates."""
        return self.functions.qdot(t, q, u)[0]

    def inertia(self, t: Array, q: Array) -> Array:
        """Inertia N (T, n, n): M, or with constraints that of the motions that these leave, M C M."""
        M, G = self.matrices(t, q)
        return M @ self.compliance(M, G) @ M if self.rows_of_G else M

    def inertial(self, t: Array, q: Array, w: Array) -> tuple[Array, Array]:
        """Forces N w (T, n) of accelerations (T, n), N as `inertia`, and its diagonal (T, n)."""
        if self.rows_of_G:
            N = self.inertia(t, q)
            return multiply(N, w), np.einsum("tii->ti", N)
        force, diagonal = self.functions.inertial(t, q, w)
        return force, diagonal

    def response(self, t: Array, q: Array, force: Array) -> Array:
        """What forces (T, n) add to the accelerations (T, n)."""
        M, G = self.matrices(t, q)
        if self.rows_of_G:
            return multiply(self.compliance(M, G), force)
        return np.asarray(np.linalg.solve(M, force[..., None])[..., 0])

    def matrices(self, t: Array, q: Array) -> tuple[Array, Array]:
        """Mass matrix M (T, n, n) and constraint Jacobian G (T, m, n)."""
        flat, g = self.functions.matrices(t, q)
        G = g.reshape(len(t), self.n, self.rows_of_G).transpose(0, 2, 1)
        return flat.reshape(len(t), self.n, self.n), G

    def compliance(self, M: Array, G: Array) -> Array:
        """Compliance C (T, n, n) of what constraints leave: M⁻¹ − M⁻¹Gᵀ(G M⁻¹Gᵀ)⁻¹G M⁻¹."""
        inverse: Array = np.asarray(np.linalg.inv(M), dtype=np.float64)
        response = inverse @ G.transpose(0, 2, 1)
        left = np.linalg.pinv(G @ response, rcond=1e-10)
        return np.asarray(inverse - response @ left @ response.transpose(0, 2, 1))

    def violation(self, rows: Rows) -> float:
        """How far speeds violate the constraints, as a share of what is added up in them."""
        if not self.rows_of_G:
            return 0.0
        psi, terms = self.functions.psi(rows.t, rows.q, rows.u)
        return float(np.max(trimmed(psi) / np.maximum(trimmed(terms), 1e-300)))

    def moved(self, q: Array, u: Array, h: Array) -> Array:
        """Coordinates moved along constant speeds for a time h (T, 1), on the group of rotations."""
        made = np.array(q)
        for i, j in self.rates:
            made[:, i] += h[:, 0] * u[:, j]
        for i, j in self.quaternions:
            turn = h * u[:, j : j + 3]
            angle = np.linalg.norm(turn, axis=1, keepdims=True)
            half = 0.5 * np.sinc(angle / (2.0 * np.pi))
            w, v = np.cos(angle / 2.0), half * turn
            p = q[:, i : i + 4]
            made[:, i : i + 1] = p[:, :1] * w - np.sum(p[:, 1:] * v, axis=1, keepdims=True)
            made[:, i + 1 : i + 4] = p[:, :1] * v + w * p[:, 1:] + np.cross(p[:, 1:], v)
        return made


@dataclass(frozen=True, eq=False)
class Rows:
    """Consecutive rows of a log: free q, u (T, n), the logged forces (T, m)."""

    t: Array
    q: Array
    u: Array
    F: Array

    @property
    def h(self) -> Array:
        """Length of each interval (T − 1, 1)."""
        return np.asarray(np.diff(self.t)[:, None])

    @property
    def D(self) -> Array:
        """Mean accelerations (T − 1, n)."""
        return np.asarray(np.diff(self.u, axis=0) / self.h)

    @cached_property
    def smooth_F(self) -> Callable[[Array], Array]:
        """The forces of any times by a spline of degree 5."""
        from scipy.interpolate import make_interp_spline

        spline: Callable[[Array], Array] = make_interp_spline(self.t, self.F, k=5)
        return spline

    def taken(self, rows: slice | NDArray[np.intp]) -> Rows:
        """Some of them."""
        return Rows(self.t[rows], self.q[rows], self.u[rows], self.F[rows])

    @staticmethod
    def joined(parts: Sequence[Rows]) -> Rows:
        """Rows of several, one after the other."""
        t = np.concatenate([r.t for r in parts])
        columns = zip(*((r.q.T, r.u.T, r.F.T) for r in parts))
        # Column by column, as the model's functions take and give them.
        return Rows(t, *(np.ascontiguousarray(np.concatenate(x, axis=1)).T for x in columns))

    def shaken(self, size: Rows, rng: np.random.Generator) -> Rows:
        """The same with every number moved at random by its `size`."""

        def moved(x: Array, s: Array) -> Array:
            return np.asarray(x + rng.uniform(-1.0, 1.0, x.shape) * s)

        return Rows(self.t, moved(self.q, size.q), moved(self.u, size.u), moved(self.F, size.F))


@dataclass(frozen=True, eq=False)
class Stretch(Rows):
    """Consecutive rows of a log, with the `scatter` of their numbers."""

    scatter: Rows


def rows_of(model: Model, run: Trajectory) -> list[Stretch]:
    """Stretches of a log, as many as the work allows."""
    free = model.mechanism.free
    digits, forces = digits_of(run), model.log.values(run)
    found = []
    for a, b in _edges(run, model.cost, 4 + len(channel_groups(model))):
        here, nothing = slice(a, b), [np.zeros((b - a, 0))]
        F = [force[here] for force in forces.values()]
        of_F = [digits[f"force {name}"].scatter(here) for name in forces]
        q, u = run.q[here][:, free.q], run.u[here][:, free.u]
        of_q = digits["q"].scatter(here)[:, free.q]
        of_u = digits["u"].scatter(here)[:, free.u]
        scatter = Rows(run.t[here], of_q, of_u, np.concatenate(nothing + of_F, axis=1))
        found.append(Stretch(run.t[here], q, u, np.concatenate(nothing + F, axis=1), scatter))
    return found


def _edges(run: Trajectory, cost: int, columns: int) -> list[tuple[int, int]]:
    """Stretches of rows, as many as the work allows."""
    most = int(np.clip(WORK / max(cost * (columns + 10), 1), LEAST_ROWS, MOST_ROWS))
    found = stretches(run)
    total = sum(b - a for a, b in found)
    if total <= most:
        return found
    made = []
    for a, b in found:
        share = max(12, int(most * (b - a) / total))
        pieces = max(1, min(PIECES, share // 100))
        size = share // pieces
        made += [(int(s), int(s) + size) for s in np.linspace(a, b - size, pieces).astype(int)]
    return sorted(set(made))


def mass_norm(N: Array, w: Array) -> Array:
    """√(wᵀ N w) (T,)."""
    return np.asarray(np.sqrt(np.maximum(mass_energy(N, w), 0.0)))


def mass_energy(N: Array, w: Array) -> Array:
    """wᵀ N w (T,)."""
    return np.asarray(np.vecdot(w, multiply(N, w)))


def multiply(N: Array, w: Array) -> Array:
    """N w (T, n)."""
    return np.asarray((N @ w[..., None])[..., 0])


def mass_product(v: Array, N: Array, w: Array) -> float:
    """The sum of vᵀ N w."""
    return float(np.vecdot(v, multiply(N, w)).sum())


@dataclass(frozen=True, eq=False)
class StretchesOfLog:
    """A log as the test sees it.

    run        the log
    stretches  of its rows
    late       rows by which q is ahead of u: it tells explicit from semi-implicit Euler
    unsteady   share of the movement that no relation of q and u explains
    """

    run: Trajectory
    stretches: Sequence[Stretch]
    late: float
    unsteady: float


@dataclass(frozen=True)
class Stairs:
    """Forces that a log holds for several rows, as sampled controllers do, and its intervals."""

    held: bool
    known: NDArray[np.bool_]


def stairs(F: Array) -> Stairs:
    """Whether forces (T, m) are held, and in which intervals (T − 1,) none of them changes.

    Where they rest while they act, nothing about forces within a step is unknown.
    """
    rest = np.all(F[1:] == F[:-1], axis=1)
    enough = rest.sum() >= max(RESTING, SHARE_RESTING * len(rest)) and not rest.all()
    acting = enough and np.all(rms(F[:-1][rest]) >= 0.5 * rms(F))
    return Stairs(bool(acting), rest)


def channel_groups(model: Model) -> dict[str, list[int]]:
    """Logged channels by their places among the forces; many channels of a kind together."""
    found: dict[str, list[int]] = {}
    many = len(model.log.columns) > 6
    for name, where in model.log.columns.items():
        if where.stop > where.start:
            key = name.kind if many else name
            found.setdefault(f"force {key}", []).extend(range(where.start, where.stop))
    return found


def mean_over_steps(t: Array, a: Array, degree: int) -> Array:
    """(1/h)∫a dt over each interval (I, n), by splines of a degree."""
    degree = min(degree, len(t) - 1)
    degree -= 1 - degree % 2
    return np.asarray(spline_integrals(t, a, degree) / np.diff(t)[:, None])


def ramped(forces: Array) -> Array:
    """Forces (T, m) that were held over several rows, as straight lines from change to change."""
    made = forces.copy()
    rows = np.arange(len(forces))
    for k, column in enumerate(forces.T):
        starts = np.concatenate([[0], np.flatnonzero(np.diff(column)) + 1])
        if len(starts) > 2:
            made[:, k] = np.interp(rows, starts, column[starts])
    return made


def trimmed(values: Array) -> Array:
    """Root mean square of each column without its largest tenth."""
    if not len(values):
        return np.zeros(values.shape[1])
    squares = np.sort(values**2, axis=0)
    return np.asarray(np.sqrt(np.mean(squares[: max(1, int(0.9 * len(squares)))], axis=0)))


def rms(values: Array) -> Array:
    """Root mean square of each column."""
    if not len(values):
        return np.zeros(values.shape[1])
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))
