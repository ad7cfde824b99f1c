"""The one-step test: does each row of a log follow from the one before by the model's equations?

No accelerations are needed. With a(t, q, u, F) the model's acceleration at a row and its logged forces,
and D = (u[n+1] − u[n])/h, every integrator leaves a relation between D and values of a:

    explicit Euler D = a[n],  trapezoidal rule D = (a[n] + a[n+1])/2,  generalized-α a two-step relation, …

1. **Identification.** If one of them closes to the digits of the log, the equations are right, whatever
   the energy does, and the integrator is known.
2. **Defect.** Otherwise D is compared with the exact flow, w = D − (1/h)∫a dt, with a interpolated along the
   rows. An unknown integrator, unknown substeps and forces that are not known between rows leave a w that
   is a combination of differences of a over a step: with q, u, t or a force taken at the other end
   (first order), and their second differences. These *scheme columns* are fitted with coefficients
   within the bounds that any consistent scheme keeps, and taken off. The rest, times the mass matrix, is
   a residual of the equations of motion in N and N·m. Its error bar holds what digits and noise of the
   log, interpolation, forces between rows and the next order of the scheme may leave.

A residual beyond its bar is a mistake of the equations, or a force that the log lacks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from typing import Any, TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from deltac.arrays import EPS, Array
from deltac.diagnosis.measurements.digits import digits_of, medians, resolution
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

IDENTIFYING = 120
"""Steps that identify an integrator."""

CLOSED = 1e-8
"""A scheme closes if it leaves this share of the accelerations: iterations of implicit methods stop there."""

PROVES = 1e-7
"""A scheme that leaves less than this share of the accelerations proves the equations."""

ALIKE = 1e-11
"""Share of the accelerations up to which the relations of two methods are the same."""

DISTINCT = 10.0
"""How much better than all others a scheme must close to be named."""

WIDTHS = (1, 8, 32)
"""Windows over which a residual may be averaged against noise, in intervals."""

CLEAR = 10.0
"""Error bars beyond which a residual is significant. Of right equations it stays below five."""

NAMED = 3.0
"""Error bars beyond which it is, where one cause explains it all along the log."""

LOCAL = 30.0
"""Error bars beyond which a single window stands out: a few rows must not be accused for less."""

LEAST = 2e-5
"""Residuals below this share of the terms are not told: solvers stop and filters leave traces there."""

SECOND = ("mixed", "middle", "curve")
"""Scheme columns of second order."""

UNEVEN = 1e-3
"""Relative differences of intervals from which on a log is not uniform."""

VISIBLE = 1e3 * EPS
"""Share of its size that a scheme column has in the mass metric at least: less is rounding."""

BESIDES = 0.4
"""Share of the columns of second order that the next order is thought to be, beside what was fitted."""

NEAR = 3
"""Windows around one that stands out that may show traces of the same."""

MATERIAL = 5e-2
"""Share of the terms that a force which is missing now and then must be."""

RESTING, SHARE_RESTING = 40, 0.2
"""Intervals without a change of any force that a log of held forces has at least."""

NEARBY = (-3, -2, -1, 1, 2, 3)
"""Rows whose force may have acted in place of a row's own, where forces are held."""

TAKEN_BACK = 0.1
"""Share of its last residual that the sum over a spike may leave."""

SPIKE = 3
"""Steps in which a spike is over: its own two, and one more where windows overlap."""

STARTING = 5
"""Steps in which a method of several steps may start in another way."""

FEWEST = 3
"""Windows that must stand out to speak of a force that is missing now and then."""

CHANCE = 4.0
"""Standard deviations by which an estimated covariance may be off."""

BLOCKS = 16
"""Parts of a log over whose scatter the standard error of a number is taken."""

TINY_SQUARE = 1e-200
"""A sum of squares below this is of something that does not happen in a log."""

CARRIED = 2.0
"""How much worse than q and u rows may keep the relation of u and u̇."""

TRIMMED = 0.05
"""Share of the intervals, those with the largest defects, that fits leave out: impacts are few rows."""


# --- the model along the rows ---------------------------------------------------------------------------


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
        self.energy = Expression("e", {**place, "w": w}, ca.bilin(M, w, w))
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
        self._rates = [
            (free_q[i], free_u[j]) for i, j in names.rates if i in free_q and j in free_u
        ]
        self._quaternions = [
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
        M, G = self._matrices(t, q)
        return M @ self._compliance(M, G) @ M if self.rows_of_G else M

    def size(self, t: Array, q: Array, w: Array) -> Array:
        """√(wᵀN w) (T,) of accelerations (T, n), N as `inertia`."""
        if self.rows_of_G:
            return _norm(self.inertia(t, q), w)
        return np.asarray(np.sqrt(np.maximum(self.functions.energy(t, q, w)[0][:, 0], 0.0)))

    def response(self, t: Array, q: Array, force: Array) -> Array:
        """What forces (T, n) add to the accelerations (T, n)."""
        M, G = self._matrices(t, q)
        if self.rows_of_G:
            return _times(self._compliance(M, G), force)
        return np.asarray(np.linalg.solve(M, force[..., None])[..., 0])

    def _matrices(self, t: Array, q: Array) -> tuple[Array, Array]:
        flat, g = self.functions.matrices(t, q)
        G = g.reshape(len(t), self.n, self.rows_of_G).transpose(0, 2, 1)
        return flat.reshape(len(t), self.n, self.n), G

    def _compliance(self, M: Array, G: Array) -> Array:
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
        for i, j in self._rates:
            made[:, i] += h[:, 0] * u[:, j]
        for i, j in self._quaternions:
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


def _rows_of(
    model: Model, run: Trajectory, edges: Sequence[tuple[int, int]]
) -> list[tuple[Rows, Rows]]:
    """Stretches of a log, each with the scatter of its numbers."""
    free = model.mechanism.free
    digits, forces = digits_of(run), model.log.values(run)
    found = []
    for a, b in edges:
        here, nothing = slice(a, b), [np.zeros((b - a, 0))]
        F = [force[here] for force in forces.values()]
        of_F = [digits[f"force {name}"].scatter(here) for name in forces]
        q, u = run.q[here][:, free.q], run.u[here][:, free.u]
        of_q = digits["q"].scatter(here)[:, free.q]
        of_u = digits["u"].scatter(here)[:, free.u]
        found.append((
            Rows(run.t[here], q, u, np.concatenate(nothing + F, axis=1)),
            Rows(run.t[here], of_q, of_u, np.concatenate(nothing + of_F, axis=1)),
        ))  # fmt: skip
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


# --- identification -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Scheme:
    """An integrator that closes: its name ("" where several do, then `among` has theirs), and order.

    `defect` is what it leaves in nine tenths of the steps, as a share of the accelerations, `typical` in
    half of them, `precision` what digits and noise may; `forces` tells which ones it took: those of the
    "start" or the "end" of a step, or "smooth" ones. `everywhere`: it closes so far that this `PROVES` the
    equations not only in the steps that were looked at, but in all.
    """

    name: str
    order: int
    defect: float
    precision: float
    forces: str
    typical: float
    among: tuple[str, ...] = ()
    everywhere: bool = False

    @property
    def late_forces(self) -> bool:
        """Whether forces beside the new state moved it there by an explicit scheme: they are one row late."""
        return self.forces == "end" and self.name in EXPLICIT


ON_THE_GROUP = "-on-the-group"
"""Ends the names of methods whose stages turn bodies along their angular velocities."""

ORDERS = {
    "explicit-euler": 1, "semi-implicit-euler": 1, "euler": 1, "implicit-euler": 1,
    "implicit-damping-euler": 1, "linearly-implicit-euler": 1, "semi-implicit-euler-vu": 1,
    "implicit-speed-euler": 1, "verlet": 2,
    "explicit-midpoint": 2, "heun": 2, "trapezoidal": 2, "implicit-midpoint": 2, "generalized-alpha": 2,
    "adams-bashforth-2": 2,
    "rk3": 3, "bs3": 3, "rk4": 4, "dopri5": 5, "rk4-on-the-group": 4, "heun-on-the-group": 2,
    "explicit-midpoint-on-the-group": 2,
}  # fmt: skip

EXPLICIT = (
    "explicit-euler", "semi-implicit-euler", "euler", "implicit-damping-euler", "linearly-implicit-euler",
    "explicit-midpoint", "heun", "rk3", "bs3", "rk4", "dopri5",
    "rk4-on-the-group", "heun-on-the-group", "explicit-midpoint-on-the-group",
)  # fmt: skip

TABLEAUS: Mapping[str, tuple[Sequence[Sequence[float]], Sequence[float]]] = {
    "explicit-midpoint": (((0.5,),), (0.0, 1.0)),
    "heun": (((1.0,),), (0.5, 0.5)),
    "rk3": (((0.5,), (-1.0, 2.0)), (1 / 6, 4 / 6, 1 / 6)),
    "bs3": (((0.5,), (0.0, 0.75)), (2 / 9, 3 / 9, 4 / 9)),
    "rk4": (((0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)), (1 / 6, 2 / 6, 2 / 6, 1 / 6)),
    "dopri5": (
        (
            (1 / 5,),
            (3 / 40, 9 / 40),
            (44 / 45, -56 / 15, 32 / 9),
            (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
            (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
        ),
        (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
    ),
}
"""Explicit Runge–Kutta methods: rows of a, weights b (Hairer, Nørsett, Wanner 1993, section II)."""


@dataclass(frozen=True, eq=False)
class Relation:
    """What an integrator makes of some steps: their mean accelerations `a` (I, n), found when asked for.

    `forces` tells which ones it took ("start", "end", "smooth"), `at` the instants (t, q, u, F) of which its
    equations are, or the middle of a step where it takes several.
    """

    name: str
    forces: str
    at: Rows
    find: Callable[[], Array]

    @cached_property
    def a(self) -> Array:
        """Mean accelerations (I, n)."""
        return self.find()

    @property
    def mark(self) -> str:
        """The forces, as a mark of its name."""
        return "" if self.forces == "start" else f"@{self.forces}"

    def of(self, some: slice) -> Relation:
        """Its part for some of the steps."""
        return Relation(self.name, self.forces, self.at.taken(some), lambda: self.a[some])


@dataclass(frozen=True, eq=False)
class Chosen:
    """Steps that are looked at, of one log or of several side by side: those that start at rows k of each.

    Logs side by side have forces that change all or none, and steps that are even all or none (`alike`).
    """

    model: Model
    parts: Sequence[tuple[Rows, NDArray[np.intp]]]
    _rows: dict[int, Rows] = field(default_factory=dict)
    _accelerations: dict[int, Array] = field(default_factory=dict)

    @staticmethod
    def alike(whole: Rows, k: NDArray[np.intp]) -> tuple[bool, bool]:
        """Whether forces change from row to row there, and whether all steps of a log are of one length."""
        held = whole.F.shape[1] > 0 and bool(np.any(whole.F[k] != whole.F[k + 1]))
        return held, bool(np.ptp(whole.h) < 1e-6 * float(whole.h.min()))

    def rows(self, j: int) -> Rows:
        """The rows j after the starts of the steps; the last one in place of those beyond."""
        if j not in self._rows:
            here = [r.taken(np.minimum(k + j, len(r.t) - 1)) for r, k in self.parts]
            self._rows[j] = Rows.joined(here)
        return self._rows[j]

    def acceleration(self, j: int) -> Array:
        """The model's accelerations (I, n) at these."""
        if j not in self._accelerations:
            self._accelerations[j] = self.model.at(self.rows(j))
        return self._accelerations[j]

    def D(self, j: int = 0) -> Array:
        """Mean accelerations (I, n) of the steps, or of those that start j rows later."""
        a, b = self.rows(j), self.rows(j + 1)
        return np.asarray((b.u - a.u) / (b.t - a.t)[:, None])


@dataclass(frozen=True, eq=False)
class Steps:
    """Some steps of a log: from `start` (I rows), by D (I, n), and what integrators make of them.

    N (I, n, n) is the inertia at their starts, `digits` the share of the accelerations that digits
    and noise seem to leave, `late` θ of q against u.
    """

    model: Model
    start: Rows
    D: Array
    N: Array
    relations: Sequence[Relation]
    digits: float
    late: float

    def named(self, relation: Relation) -> str:
        """The name of its integrator; Euler's are told apart by θ of q against u, "" where none is meant."""
        if relation.name == ACCURATE:
            return ""
        return _euler(self.late) if relation.name == "euler" else relation.name

    def off(self, relation: Relation) -> Array:
        """What a relation leaves of each step (I,), in the mass metric."""
        return _norm(self.N, self.D - relation.a)

    @cached_property
    def offs(self) -> Array:
        """The same of all relations but `ACCURATE`, which comes last (I, number of them)."""
        left = np.empty((*self.D.shape, sum(r.name != ACCURATE for r in self.relations)))
        for k in range(left.shape[2]):
            np.subtract(self.D, self.relations[k].a, out=left[..., k])
        energy: Array = np.sum(left * (self.N @ left), axis=1)
        return np.sqrt(np.maximum(energy, 0.0))


_INSTANTS = {
    "euler": (0, 0, 0), "implicit-damping-euler": (0, 0, 0), "linearly-implicit-euler": (0, 0, 0),
    "implicit-euler": (1, 1, 1), "semi-implicit-euler-vu": (0, 1, 0), "implicit-speed-euler": (1, 0, 1),
}  # fmt: skip
"""Whether t, q and u of Euler's methods are of the end of a step; of all others the middle is taken."""


def _steps_looked_at(whole: Rows) -> NDArray[np.intp]:
    """Some steps of a stretch, evenly over it; none of a stretch of few rows."""
    most = len(whole.t) - 2
    if most < 4:
        return np.zeros(0, dtype=np.intp)
    return np.unique(np.linspace(1, most, min(most, IDENTIFYING)).astype(np.intp))


def _relations(chosen: Chosen) -> list[Relation]:
    """Every integrator of the dictionary at some steps."""
    from scipy.interpolate import make_interp_spline

    model, start, end = chosen.model, chosen.rows(0), chosen.rows(1)
    t0, q0, u0, F0 = start.t, start.q, start.u, start.F
    t1, q1, u1, F1 = end.t, end.q, end.u, end.F
    h0 = (t1 - t0)[:, None]
    held, even = Chosen.alike(*chosen.parts[0])
    middle = model.moved(q0, 0.5 * (u0 + u1), 0.5 * h0)
    half_t, half_u, mean = 0.5 * (t0 + t1), 0.5 * (u0 + u1), 0.5 * (F0 + F1)
    between = [make_interp_spline(r.t, r.F, k=5) for r, _ in chosen.parts] if held else []
    found = list[Relation]()

    def smooth(c: float) -> Array:
        if not held:
            return F0
        splines = zip(between, chosen.parts)
        return np.concatenate([f(r.t[k] + c * np.diff(r.t)[k]) for f, (r, k) in splines])

    def offer(marked: str, find: Callable[[], Array]) -> None:
        name, _, forces = marked.partition("@")
        F = {"": F0, "end": F1, "smooth": mean}[forces]
        at = Rows(half_t, middle, half_u, F)
        if name in _INSTANTS:
            at_t, at_q, at_u = _INSTANTS[name]
            at = Rows((t0, t1)[at_t], (q0, q1)[at_q], (u0, u1)[at_u], F)
        found.append(Relation(name, forces or "start", at, find))

    @cache
    def rate() -> Array:
        return model.rate(t0, q0, u0)

    def a00() -> Array:
        return chosen.acceleration(0)

    def a11() -> Array:
        return chosen.acceleration(1)

    def offer_held(mark: str, F: Array) -> None:
        """Those that hold their forces over a step."""

        @cache
        def a() -> Array:
            return a00() if mark == "" else model.acceleration(t0, q0, u0, F)

        offer("euler" + mark, a)

        def damped() -> Array:
            change = model.damping(t0, q0, u1, F) - model.damping(t0, q0, u0, F)
            return a() + model.response(t0, q0, change)

        if model.damped:
            offer("implicit-damping-euler" + mark, damped)

        def linear() -> Array:
            step, along = 1e-4, u1 - u0
            ahead, back = (
                model.acceleration(t0, q0, u0 + s * step * along, F) for s in (1.0, -1.0)
            )
            return a() + (ahead - back) / (2.0 * step)

        @cache
        def a_end() -> Array:
            return a11() if mark == "" and not held else model.acceleration(t1, q1, u1, F)

        offer("linearly-implicit-euler" + mark, linear)
        offer("implicit-euler" + mark, a_end)
        offer("semi-implicit-euler-vu" + mark, lambda: model.acceleration(t0, q1, u0, F))
        offer("implicit-speed-euler" + mark, lambda: model.acceleration(t1, q0, u1, F))
        offer("trapezoidal" + mark, lambda: 0.5 * (a() + a_end()))
        offer("implicit-midpoint" + mark, lambda: model.acceleration(half_t, middle, half_u, F))
        offer(
            "verlet" + mark,
            lambda: 0.5 * (a() + model.acceleration(t1, q1, u0 + 0.5 * h0 * a(), F)),
        )
        for name in TABLEAUS:
            made = partial(_runge_kutta, model, name, t0, q0, u0, partial(_held, F), h0)
            offer(name + mark, partial(made, first=lambda: (rate(), a())))

    offer_held("", F0)
    if held:  # or forces that change within a step
        offer_held("@end", F1)
        offer("trapezoidal@smooth", lambda: 0.5 * (a00() + a11()))
        for F in (mean, smooth(0.5)):  # interpolated linearly, or of time
            along = (half_t, middle, half_u, F)
            offer("implicit-midpoint@smooth", partial(model.acceleration, *along))

        def carried() -> Array:
            before = model.acceleration(t0, q0, u0, chosen.rows(-1).F)
            return 0.5 * (before + model.acceleration(t1, q1, u1, F0))

        # Newmark's method carries its acceleration over, with the force of the step before.
        offer("trapezoidal", carried)
        offer(
            "verlet@smooth",
            lambda: 0.5 * (a00() + model.acceleration(t1, q1, u0 + 0.5 * h0 * a00(), F1)),
        )
        for name in TABLEAUS:
            made = partial(_runge_kutta, model, name, t0, q0, u0, h=h0)
            offer(name + "@smooth", partial(made, force=smooth))
            # or written one row late
            offer(name + "@end", partial(made, force=lambda c: smooth(1.0 + c)))
    if model._quaternions:
        for name in ("rk4", "heun", "explicit-midpoint"):
            turned = partial(_runge_kutta, model, name, t0, q0, u0, h=h0, on_group=True)
            offer(f"{name}{ON_THE_GROUP}", partial(turned, force=partial(_held, F0)))
            if held:
                offer(f"{name}{ON_THE_GROUP}@smooth", partial(turned, force=smooth))

    def accurate() -> Array:
        return np.concatenate([_mean(r.t, model.at(r), 5)[k] for r, k in chosen.parts])

    if even:
        found += _two_step_relations(chosen)
    offer(f"{ACCURATE}@smooth" if held else ACCURATE, accurate)
    return found


SPECTRAL_RADII = (0.0, 0.2, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)
"""ρ∞ of the generalized-α methods that are tried: those that people choose."""


def _two_step_relations(chosen: Chosen) -> list[Relation]:
    """Adams–Bashforth and generalized-α, D[n] + x D[n−1] = y₀ a[n−1] + y₁ a[n] + y₂ a[n+1], over one step."""

    @cache
    def parts() -> tuple[Array, ...]:
        before, here, after = (chosen.acceleration(j) for j in (-1, 0, 1))
        return here, chosen.D() - chosen.D(-1), before - here, after - here

    def made(x: float, y0: float, y2: float) -> Array:
        here, change, before, after = parts()
        told = here + (y0 / (1.0 + x)) * before + (y2 / (1.0 + x)) * after
        return told + (x / (1.0 + x)) * change if x else told

    methods = [("adams-bashforth-2", 0.0, -0.5, 0.0)]
    for rho in SPECTRAL_RADII:
        am, af = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
        gamma = 0.5 + af - am
        scale = 1.0 / (1.0 - am)
        y0, y2 = (1.0 - gamma) * af * scale, gamma * (1.0 - af) * scale
        methods.append(("generalized-alpha", am * scale, y0, y2))
    start = chosen.rows(0)
    return [Relation(name, "smooth", start, partial(made, *of)) for name, *of in methods]


ACCURATE = "accurate"
"""The relation of a motion that steps follow to more digits than rows are told by."""


Identified: TypeAlias = "tuple[Scheme | None, float, Steps | None]"
"""The integrator whose steps the rows are, or None; what the best one leaves; the steps looked at."""

SIDE_BY_SIDE = 4096
"""Steps of several logs that are looked at side by side: their numbers stay in the processor's cache."""


def identify(model: Model, logs: Sequence[StretchesOfLog]) -> list[Identified]:
    """The integrators whose steps the rows of logs are, those of one model side by side.

    What is left is a share of the accelerations.
    """
    found: list[Identified] = [(None, 1.0, None)] * len(logs)
    alike: dict[Any, list[tuple[int, Rows, Rows, NDArray[np.intp]]]] = {}
    for place, log in enumerate(logs):
        whole, size = max(log.stretches, key=lambda pair: len(pair[0].t))
        k = _steps_looked_at(whole)
        if len(k):
            alike.setdefault(Chosen.alike(whole, k), []).append((place, whole, size, k))
    at_once = SIDE_BY_SIDE // IDENTIFYING
    for same in alike.values():
        for several in (same[i : i + at_once] for i in range(0, len(same), at_once)):
            chosen = Chosen(model, [(whole, k) for _, whole, _, k in several])
            relations = _relations(chosen)
            here, a00, D = chosen.rows(0), chosen.acceleration(0), chosen.D()
            N = model.inertia(here.t, here.q)
            # Digits of u in D, and of q and u in a: by moving them.
            other = [
                whole.taken(k).shaken(size.taken(k), np.random.default_rng(3))
                for _, whole, size, k in several
            ]
            shaken = model.at(Rows.joined(other)) - a00
            fine = [size.u[k] / whole.h[k] for _, whole, size, k in several]
            digits_of = _norm(N, np.concatenate(fine)) + _norm(N, shaken)
            of_a, of_D = _norm(N, a00), _norm(N, D)
            last = 0
            for place, whole, _, k in several:
                some = slice(last, last := last + len(k))
                a = [chosen.acceleration(j)[some] for j in (0, 1, 2)]
                typical = float(medians(of_a[some]) + medians(of_D[some])) + 1e-300
                digits = float(medians(digits_of[some])) / typical
                least = float(np.abs(whole.u[k]).max(initial=0.0) / whole.h[k].min())
                least *= 50.0 * EPS / max(float(np.abs(D[some]).max()), 1e-300)
                own = [r.of(some) for r in relations] if len(several) > 1 else relations
                steps = Steps(
                    model, whole.taken(k), D[some], N[some], own, max(digits, least),
                    logs[place].late,
                )  # fmt: skip
                two_step = _two_step(whole, a, D[some], N[some], k, typical)
                found[place] = _identified(steps, two_step, typical, logs[place].stretches)
    return found


def _identified(
    steps: Steps, two_step: _TwoStep, typical: float, stretches_: Sequence[tuple[Rows, Rows]]
) -> Identified:
    """The integrator of a log by what all of them leave of some steps; `typical` accelerations."""
    relations, N, digits = steps.relations, steps.N, steps.digits
    offs = steps.offs
    ranked = sorted((float(left) / typical, k) for k, left in enumerate(_nearly_all(offs)))
    limit = 3.0 * digits + CLOSED
    best, first = ranked[0]
    closes = two_step.left <= 3.0 * digits + 1e-10
    if closes and two_step.name and two_step.left < best / DISTINCT:
        found = Scheme(two_step.name, 2, two_step.left, digits, "smooth", two_step.left)
        return found, two_step.left, steps
    if best > limit:
        left = np.median(offs, axis=0)
        half = relations[int(np.argmin(left))]
        typical_left = float(left.min()) / typical
        if typical_left > CLOSED or float(np.median(steps.off(relations[-1]))) < left.min():
            return None, min(best, two_step.left), steps
        name = steps.named(half)  # it closes but for what happens now and then
        found = Scheme(name, ORDERS[name], best, digits, half.forces, typical_left)
        return found, min(best, two_step.left), steps
    # Methods of one order that are the same for these equations are no rivals: the simplest one is named.
    apart = np.abs(offs - offs[:, [first]]).max(axis=0)  # no more than their distance
    near_by = (relations[int(k)] for k in np.flatnonzero(apart <= ALIKE * typical))
    same = [r for r in near_by if _norm(N, r.a - relations[first].a).max() <= ALIKE * typical]
    chosen = same[0]
    alike = {r.name for r in same}
    rivals = [x for x, k in ranked if relations[k].name not in alike]
    unique = not rivals or rivals[0] > DISTINCT * max(best, 1e-13)
    unique &= len({ORDERS[steps.named(r)] for r in same}) == 1
    base = steps.named(chosen)
    name, order = (base, ORDERS[base]) if unique else ("", 0)
    place = next(k for k, r in enumerate(relations) if r is chosen)
    typical_left = float(medians(offs[:, place])) / typical
    near = (relations[k] for x, k in ranked if x <= max(DISTINCT * max(best, 1e-13), limit))
    among = () if unique else tuple(dict.fromkeys(steps.named(r) for r in near))
    everywhere = best <= PROVES and all(
        _closes_everywhere(steps.model, rows, place, chosen, PROVES * typical)
        for rows, _ in stretches_
    )
    scheme = Scheme(name, order, best, digits, chosen.forces, typical_left, among, everywhere)
    return scheme, best, steps


def _closes_everywhere(
    model: Model, rows: Rows, place: int, relation: Relation, most: float
) -> bool:
    """Whether a relation, of a place in the dictionary, leaves no step of a stretch more than that."""
    k = np.arange(1, len(rows.t) - 1)
    chosen = Chosen(model, [(rows, k)])
    found = _relations(chosen)[place : place + 1]
    if [(r.name, r.forces) for r in found] != [(relation.name, relation.forces)]:
        return False  # other ones are offered where no force changes
    return bool(np.all(model.size(rows.t[k], rows.q[k], chosen.D() - found[0].a) <= most))


def _euler(late: float) -> str:
    return "semi-implicit-euler" if late > 0.25 else "explicit-euler" if late < -0.25 else "euler"


def _nearly_all(values: Array) -> Array:
    """What nine tenths of the steps stay within: a force that is missing now and then must not pass."""
    return np.asarray(np.quantile(values, 0.9, axis=0))


def _norm(N: Array, w: Array) -> Array:
    """√(wᵀ N w) (T,)."""
    return np.asarray(np.sqrt(np.maximum(_energy(N, w), 0.0)))


def _energy(N: Array, w: Array) -> Array:
    """wᵀ N w (T,)."""
    return np.asarray(np.vecdot(w, _times(N, w)))


def _times(N: Array, w: Array) -> Array:
    """N w (T, n)."""
    return np.asarray((N @ w[..., None])[..., 0])


def _product(v: Array, N: Array, w: Array) -> float:
    """The sum of vᵀ N w."""
    return float(np.vecdot(v, _times(N, w)).sum())


def _held(F: Array, c: float) -> Array:
    """Forces that do not change within a step."""
    return F


def _runge_kutta(
    model: Model,
    name: str,
    t: Array,
    q: Array,
    u: Array,
    force: Callable[[float], Array],
    h: Array,
    *,
    first: Callable[[], tuple[Array, Array]] | None = None,
    on_group: bool = False,
) -> Array:
    """Mean acceleration of a step of an explicit Runge–Kutta method; `force` at a fraction of the step.

    `first`: q̇ and u̇ of the first stage, where they are known.
    """
    rows, b = TABLEAUS[name]
    slopes_u: list[Array] = []
    slopes_q: list[Array] = []
    velocities: list[Array] = []
    x, v, c = q, u, 0.0
    for s in range(len(b)):
        if s:
            weights = rows[s - 1]
            c = float(sum(weights))
            v = u + h * _weighted(weights, slopes_u)
            if on_group:
                x = model.moved(q, _weighted(weights, velocities), h)
            else:
                x = q + h * _weighted(weights, slopes_q)
        now = t + c * h[:, 0]
        if s == 0 and first is not None:
            rate, slope = first()
        else:
            rate, slope = model.rate(now, x, v), model.acceleration(now, x, v, force(c))
        slopes_q.append(rate)
        velocities.append(v)
        slopes_u.append(slope)
    return _weighted(b, slopes_u)


def _weighted(weights: Iterable[float], slopes: Iterable[Array]) -> Array:
    """Σ w k."""
    first, *others = (w * k for w, k in zip(weights, slopes) if w)
    for other in others:
        first += other
    return np.asarray(first)


@dataclass(frozen=True)
class _TwoStep:
    """A two-step relation: what it leaves as a share of a, and the method whose numbers it has, or ""."""

    left: float
    name: str


def _two_step(
    rows: Rows, at: Sequence[Array], D: Array, N: Array, k: NDArray[np.intp], typical: float
) -> _TwoStep:
    """What the best relation D[n+1] + x D[n] = y0 a[n] + y1 a[n+1] + y2 a[n+2] leaves, 1 + x = Σy.

    `at` are the accelerations of the model at rows k, the next, and the next but one; D those of the steps.

    Newmark's method, HHT and generalized-α obey it when their own accelerations are eliminated (Erlicher,
    Bonaventura and Bursi 2002, Comput. Mech. 28).
    """
    h = np.diff(rows.t)
    own = np.flatnonzero(k + 1 < len(h))
    own = own[np.abs(h[k[own]] - h[k[own] + 1]) < 1e-6 * h[k[own]]]
    if len(own) < 12:
        return _TwoStep(np.inf, "")
    a, W, k = [x[own] for x in at], N[own], k[own]
    # Unknowns: x, y0, y2; y1 = 1 + x − y0 − y2.
    right = (rows.u[k + 2] - rows.u[k + 1]) / h[k + 1, None] - a[1]
    columns = [a[1] - D[own], a[0] - a[1], a[2] - a[1]]
    forces = np.array([_times(W, x).ravel() for x in columns])
    A = np.array([x.ravel() for x in columns]) @ forces.T
    b = forces @ right.ravel()
    x, y0, y2 = np.linalg.lstsq(A, b, rcond=1e-13)[0]
    left = (
        float(medians(_norm(W, right - x * columns[0] - y0 * columns[1] - y2 * columns[2])))
        / typical
    )
    if not -0.95 < x < 1.05:
        return _TwoStep(left, "")
    close = 2e-3
    if max(abs(x), abs(y0 + 0.5), abs(y2)) < close:
        return _TwoStep(left, "adams-bashforth-2")
    # x = αm/(1 − αm), y0 = (1 − γ) αf/(1 − αm), y2 = γ (1 − αf)/(1 − αm).
    am = x / (1.0 + x)
    before, after = y0 * (1.0 - am), y2 * (1.0 - am)
    p = after - before  # γ − αf
    root = (1.0 - p) ** 2 - 4.0 * before
    if root < -1e-3:
        return _TwoStep(left, "")
    choices = [0.5 * (1.0 - p + sign * np.sqrt(max(root, 0.0))) for sign in (-1.0, 1.0)]
    named = abs(p - 0.5 + am) < close and any(
        -close < af < 0.5 + close and min(abs(af - (1.0 + am) / 3.0), abs(am), abs(af)) < close
        for af in choices
    )
    return _TwoStep(left, "generalized-alpha" if named else "")


# --- the defect -----------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Residual:
    """What the equations leave from row to row; n free speeds, W windows.

    Attributes:
        t: the middle of each window (W,).
        residual: what the equations leave in each, scheme columns taken off (W, n), N or N·m.
        allowed: error bar of each of these (W, n).
        size, bar, scale: its root mean square without the largest tenth, its error bar, the size of the
            terms (n,).
        bars: what the error bar is made of, by name (n,).
        fitted: coefficients of the scheme columns.
        taken: root mean square of what they took off, without the largest tenth (n,).
        hidden: energy (J) that a mistake could have done in the time of the log: the work of what is left,
            and the largest that a damper, a constant force or another inertia of a joint may have done.
        spent: energy (J) that the residual does in it, without sign.
        noisy: how much of what looks like noise on the log is that, in standard deviations.
        columns: the scheme columns as generalized forces (T, n, m) of consecutive rows t, q, u, F, each times
            the largest coefficient that a consistent scheme may have.
    """

    t: Array
    residual: Array
    allowed: Array
    size: Array
    bar: Array
    scale: Array
    fitted: Mapping[str, float]
    taken: Array
    hidden: float
    spent: float
    bars: Mapping[str, Array]
    noisy: float
    columns: Callable[[Array, Array, Array, Array], Array]


@dataclass(frozen=True, eq=False)
class OneStep:
    """What the one-step test found; n free speeds.

    Attributes:
        scheme: the integrator whose steps the rows are, or None.
        speeds: names of the n free speeds.
        rows: how many rows were looked at.
        off_scheme: what the best scheme leaves, as a share of the accelerations.
        steps: some of the steps, and what every integrator makes of them.
        found: the residual, sought when it is first wanted: where every row follows from the one before by a
            scheme nobody asks for it.
        known_but_for_causes: whether `scheme` closes once the causes that were found are taken off; the
            residual is then what it leaves without them.
        clear: error bars beyond which the residual is significant.
    """

    scheme: Scheme | None
    speeds: tuple[str, ...]
    rows: int
    off_scheme: float
    steps: Steps | None
    found: Callable[[], Residual]
    known_but_for_causes: bool = False
    clear: float = CLEAR

    @property
    def t(self) -> Array:
        """The middle of each window (W,), s."""
        return self.found().t

    @property
    def residual(self) -> Array:
        """What the equations leave in each window (W, n), N or N·m."""
        return self.found().residual

    @property
    def allowed(self) -> Array:
        """Error bar of each of these (W, n)."""
        return self.found().allowed

    @property
    def size(self) -> Array:
        """Root mean square of the residual without the largest tenth (n,)."""
        return self.found().size

    @property
    def bar(self) -> Array:
        """Its error bar (n,)."""
        return self.found().bar

    @property
    def scale(self) -> Array:
        """Size of the terms of each equation (n,)."""
        return self.found().scale

    @property
    def bars(self) -> Mapping[str, Array]:
        """What the error bar is made of, by name (n,)."""
        return self.found().bars

    @property
    def fitted(self) -> Mapping[str, float]:
        """Coefficients of the scheme columns."""
        return self.found().fitted

    @property
    def taken(self) -> Array:
        """What the scheme columns took off (n,), N or N·m."""
        return self.found().taken

    @property
    def hidden(self) -> float:
        """Energy (J) that a mistake could have done; see `Residual`."""
        return self.found().hidden

    @property
    def spent(self) -> float:
        """Energy (J) that the residual does, without sign."""
        return self.found().spent

    @property
    def noisy(self) -> float:
        """How much of apparent noise is that; see `Residual`."""
        return self.found().noisy

    @property
    def columns(self) -> Callable[[Array, Array, Array, Array], Array]:
        """The scheme columns as generalized forces; see `Residual`."""
        return self.found().columns

    @property
    def ratio(self) -> Array:
        """`size` in units of the error bar (n,)."""
        return np.asarray(self.size / np.maximum(self.bar, 1e-300))

    @property
    def relative(self) -> Array:
        """`size` as a share of the terms (n,)."""
        return np.asarray(self.size / np.maximum(self.scale, 1e-300))

    @property
    def closes(self) -> bool:
        """Whether every row follows from the one before by a known scheme, to next to nothing.

        In logs of few digits a scheme may close to these digits: it is named, but proves no more than the
        residual does.
        """
        if self.scheme is None or self.scheme.defect > PROVES:
            return False
        return self.scheme.everywhere or bool(self.standing_out.sum() < FEWEST)

    @property
    def closes_mostly(self) -> bool:
        """Whether most rows follow from the one before by a known scheme to rounding, and some not."""
        mostly = self.scheme is not None and self.scheme.typical <= CLOSED
        return mostly and not self.known_but_for_causes and not self.closes

    @property
    def significant(self) -> NDArray[np.bool_]:
        """Which equations leave more than their error bar explains (n,); none where a scheme closes."""
        if self.closes:
            return np.zeros(len(self.speeds), dtype=np.bool_)
        return (self.ratio > self.clear) & (self.relative > LEAST)

    def to_dict(self) -> dict[str, Any]:
        """The numbers of the test, for JSON."""
        scheme = self.scheme
        return {
            "scheme": None if scheme is None else scheme.name or "several",
            "among": [] if scheme is None else list(scheme.among),
            "closes": self.closes,
            "defect": self.off_scheme,
            "residual": dict(zip(self.speeds, self.size.tolist())),
            "error_bar": dict(zip(self.speeds, self.bar.tolist())),
            "terms": dict(zip(self.speeds, self.scale.tolist())),
            "rows": self.rows,
        }

    @property
    def now_and_then(self) -> NDArray[np.bool_]:
        """Windows (W,) that stand far out of their own error bars, where the others do not."""
        rows = self.standing_out
        if self.closes_mostly:
            return rows
        around = np.convolve(rows, np.ones(2 * NEAR + 1), "same") > 0.5
        quiet = self.residual[~around]
        # What is left all the time is no contact, however much it varies.
        silent = len(quiet) > len(rows) // 3 and np.all(
            _rms(quiet) < CLEAR * self.bar + LEAST * self.scale
        )
        return rows if silent else np.zeros_like(rows)

    @property
    def standing_out(self) -> NDArray[np.bool_]:
        """Windows (W,) whose residual is far out of their own error bars, and no small part of the terms."""
        out = np.abs(self.residual) > LOCAL * (self.allowed + self.bar) + MATERIAL * self.scale
        rows = np.asarray(out.any(axis=1))
        # A force changes the momentum for good; what is taken back in the next steps is a spike of a speed.
        size = self.residual / np.maximum(self.scale, 1e-300)
        spikes = np.zeros_like(rows)
        for first in map(int, np.flatnonzero(rows)):
            for last in range(first + 1, min(first + SPIKE, len(rows) - 1) + 1):
                left = np.abs(size[first : last + 1].sum(axis=0)).max()
                if rows[last] and left < TAKEN_BACK * np.abs(size[last]).max():
                    spikes[first : last + 1] = True
        rows &= ~spikes
        # Filters leave traces at the ends of a log, methods of several steps where they start.
        exact = self.scheme is not None and self.scheme.typical <= CLOSED
        edge = STARTING if exact else max(1, len(rows) // 50)
        rows[:edge] = rows[-edge:] = False
        return rows


@dataclass(frozen=True, eq=False)
class StretchesOfLog:
    """A log as the test sees it.

    run        the log
    stretches  of its rows, each with the scatter of its numbers
    late       rows by which q is ahead of u: it tells explicit from semi-implicit Euler
    unsteady   share of the movement that no relation of q and u explains
    """

    run: Trajectory
    stretches: Sequence[tuple[Rows, Rows]]
    late: float
    unsteady: float


def one_step(
    mechanism: Mechanism, run: Trajectory, late: float = 0.0, unsteady: float = 0.0
) -> OneStep | None:
    """The test of a run's rows; None for fewer rows than `rates.LEAST_ROWS` in a row, or nothing free.

    `late` is the lateness of q against u from the kinematic test, `unsteady` the share of the movement that
    it does not explain: rows that keep the relation of q and u no better keep that of u and u̇ no better.
    """
    return one_steps(mechanism, [(run, late, unsteady)])[0]


def one_steps(
    mechanism: Mechanism, runs: Sequence[tuple[Trajectory, float, float]]
) -> list[OneStep | None]:
    """`one_step` of several runs, with what it is told of each, at once."""
    found: list[OneStep | None] = [None] * len(runs)
    if not len(mechanism.free.u):
        return found
    of_model: dict[Functions, list[tuple[int, Model, StretchesOfLog]]] = {}
    for place, (run, late, unsteady) in enumerate(runs):
        model = Model(mechanism, run)
        pieces = _rows_of(model, run, _edges(run, model.cost, 4 + len(_groups(model))))
        if not pieces:
            continue
        # What filters and means do to a loop shows in its constraints.
        unsteady = max(unsteady, *(model.violation(rows) for rows, _ in pieces))
        log = StretchesOfLog(run, pieces, late, unsteady)
        of_model.setdefault(model.functions, []).append((place, model, log))
    for several in of_model.values():
        identified = identify(several[0][1], [log for _, _, log in several])
        for (place, model, log), one in zip(several, identified):
            found[place] = _tested(model, log, *one)
    return found


def _tested(
    model: Model, log: StretchesOfLog, scheme: Scheme | None, off: float, steps: Steps | None
) -> OneStep:
    """The test of a log of which it is known what integrators leave."""
    pieces, groups = log.stretches, _groups(model)

    @cache
    def found() -> Residual:
        held = all(stairs(rows.F).held for rows, _ in pieces)
        parts = [_defects(model, rows, groups, held) for rows, _ in pieces]
        coefficients = _fit(parts, parts[0].names)
        return _judged(
            model, log.run, pieces, parts, coefficients, off, steps, groups, log.unsteady, held
        )

    mechanism = model.mechanism
    speeds = tuple(mechanism.speeds[int(k)].name for k in mechanism.free.u)
    return OneStep(scheme, speeds, sum(len(r.t) for r, _ in pieces), off, steps, found)


@dataclass(frozen=True, eq=False)
class _Defects:
    """Defects w (I, n) of some intervals `at` of a stretch, scheme columns by name, inertia N (I, n, n).

    `interpolation` and `forces`, the ways in which these may change between rows, are what may be added to
    the accelerations `a` (I, n).
    """

    w: Array
    columns: Mapping[str, Array]
    N: Array
    a: Array
    interpolation: Array
    forces: Mapping[str, Array]
    bounds: Mapping[str, float]
    at: NDArray[np.intp]

    @property
    def names(self) -> list[str]:
        return list(self.columns)

    @cached_property
    def column_forces(self) -> Mapping[str, Array]:
        """The scheme columns as forces, N times each (I, n)."""
        made = self.N @ np.stack([*self.columns.values()], axis=2)
        return {name: made[:, :, k] for k, name in enumerate(self.columns)}


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
    acting = enough and np.all(_rms(F[:-1][rest]) >= 0.5 * _rms(F))
    return Stairs(bool(acting), rest)


def _groups(model: Model) -> dict[str, list[int]]:
    """Logged channels by their places among the forces; many channels of a kind together."""
    found: dict[str, list[int]] = {}
    many = len(model.log.columns) > 6
    for name, where in model.log.columns.items():
        if where.stop > where.start:
            key = name.kind if many else name
            found.setdefault(f"force {key}", []).extend(range(where.start, where.stop))
    return found


def _mean(t: Array, a: Array, degree: int) -> Array:
    """(1/h)∫a dt over each interval (I, n), by splines of a degree."""
    degree = min(degree, len(t) - 1)
    degree -= 1 - degree % 2
    return np.asarray(spline_integrals(t, a, degree) / np.diff(t)[:, None])


def _plain(model: Model, rows: Rows, held: bool) -> tuple[Array, Array, Array]:
    """Accelerations at the rows (T, n), the defects w (I, n), and the error of interpolation (I, n)."""
    a = model.acceleration(rows.t, rows.q, rows.u, rows.F)
    smooth, forced = a, np.zeros_like(a[:-1])
    if held:  # splines of jumps would ring: a = a(F = 0) + what the forces add, held over a step
        smooth = model.acceleration(rows.t, rows.q, rows.u, np.zeros_like(rows.F))
        end = model.acceleration(rows.t[1:], rows.q[1:], rows.u[1:], rows.F[:-1])
        forced = 0.5 * (a[:-1] - smooth[:-1] + end - smooth[1:])
    mean = _mean(rows.t, smooth, 5)
    return a, rows.D - mean - forced, mean - _mean(rows.t, smooth, 3)


def _defects(
    model: Model, rows: Rows, groups: Mapping[str, list[int]], held: bool, *, whole: bool = False
) -> _Defects:
    """The defects of a stretch; if forces are held those where none changes, unless the `whole` is asked."""
    a, w, interpolation = _plain(model, rows, held)
    t0, q0, u0, F0 = rows.t[:-1], rows.q[:-1], rows.u[:-1], rows.F[:-1]
    t1, q1, u1, F1 = rows.t[1:], rows.q[1:], rows.u[1:], rows.F[1:]
    a0, a1 = a[:-1], a[1:]
    N = model.inertia(t0, q0)
    columns = {
        "q": model.acceleration(t0, q1, u0, F0) - a0,
        "u": model.acceleration(t0, q0, u1, F0) - a0,
    }
    bounds = {"q": 0.75, "u": 0.75}
    if model.damped:
        change = model.damping(t0, q0, u1, F0) - model.damping(t0, q0, u0, F0)
        columns["damping"] = model.response(t0, q0, change)
        bounds["damping"] = 1.0
    if model.of_time:
        columns["t"] = model.acceleration(t1, q0, u0, F0) - a0
        bounds["t"] = 1.6

    def with_forces(places: list[int], F: Array) -> Array:
        """What other forces at some places, held over each step, would add."""
        other = F0.copy()
        other[:, places] = F
        return np.asarray(model.acceleration(t0, q0, u0, other) - a0)

    forces = {}
    # Held forces are of one controller: whatever delays them delays all.
    together = {"forces": sorted({k for places in groups.values() for k in places})}
    for name, places in (together if held else groups).items():
        F = rows.F[:, places]
        if not np.any(F[1:] != F[:-1]):
            continue
        for k in NEARBY if held else (1,):
            key = name if k == 1 else f"{name} {k:+d}"
            columns[key] = with_forces(places, _row(F, k))
            bounds[key] = 1.6  # held or interpolated, of this row or one near it
            if held:
                forces[key] = columns[key]
        second = np.diff(F, 2, axis=0)
        if not held:
            forces[name] = with_forces(places, F[:-1] + np.vstack([second, second[-1:]]))
        ramp = ramped(F)[:-1]
        if np.any(ramp != F[:-1]):  # as commanded now and then, where more happened in between
            columns[f"{name} ramped"] = with_forces(places, ramp)
            bounds[f"{name} ramped"] = 1.6
            if held:
                forces[f"{name} ramped"] = columns[f"{name} ramped"]
    uneven = float(np.ptp(rows.h)) > UNEVEN * float(np.median(rows.h))
    if uneven:  # one step of a scheme is another share of each interval
        share = float(rows.h.min()) / rows.h
        for name in list(columns):
            columns[f"{name} by h"] = columns[name] * share
            bounds[f"{name} by h"] = 2.0 * bounds[name]
    both = model.acceleration(t0, q1, u1, F0) - a0 - columns["q"] - columns["u"]
    middle = model.acceleration(
        0.5 * (t0 + t1),
        model.moved(q0, 0.5 * (u0 + u1), 0.5 * rows.h),
        0.5 * (u0 + u1),
        0.5 * (F0 + F1),
    )
    bent = middle - 0.5 * (a0 + a1)
    columns["mixed"], columns["middle"] = both, bent
    smooth = a
    if held:
        smooth = model.acceleration(rows.t, rows.q, rows.u, np.zeros_like(rows.F))
    second = np.diff(smooth, 2, axis=0)
    curve = 0.5 * (np.vstack([second, second[-1:]]) + np.vstack([second[:1], second]))
    columns["curve"] = curve
    bounds |= {"mixed": 1.0, "middle": 1.0, "curve": 0.5}
    at = np.flatnonzero(stairs(rows.F).known) if held and not whole else np.arange(len(w))
    return _Defects(
        w[at], {n: x[at] for n, x in columns.items()}, N[at], a0[at], interpolation[at],
        {n: x[at] for n, x in forces.items()}, bounds, at,
    )  # fmt: skip


def _row(F: Array, k: int) -> Array:
    """The forces (T − 1, m) `k` rows after each step's own; those of the end repeat."""
    return np.asarray(F[np.clip(np.arange(len(F) - 1) + k, 0, len(F) - 1)])


def ramped(forces: Array) -> Array:
    """Forces (T, m) that were held over several rows, as straight lines from change to change."""
    made = forces.copy()
    rows = np.arange(len(forces))
    for k, column in enumerate(forces.T):
        starts = np.concatenate([[0], np.flatnonzero(np.diff(column)) + 1])
        if len(starts) > 2:
            made[:, k] = np.interp(rows, starts, column[starts])
    return made


def _fit(parts: Sequence[_Defects], names: Sequence[str]) -> dict[str, float]:
    """Coefficients of the scheme columns, in the mass metric, within their bounds; impacts left out.

    Columns that constraints take off altogether have none: what is left of them is rounding.
    """
    from scipy.optimize import lsq_linear

    def stacked(p: _Defects, those: Mapping[str, Array]) -> Array:
        return np.stack([those.get(n, np.zeros_like(p.w)) for n in names], axis=2)

    columns = [stacked(p, p.columns) for p in parts]
    weighted = [stacked(p, p.column_forces) for p in parts]
    energy = _sum(np.einsum("tij,tij->j", X, NX) for X, NX in zip(columns, weighted))
    whole = _sum(
        np.tensordot(np.linalg.norm(p.N, axis=(1, 2)), X * X, 1).sum(axis=0)
        for p, X in zip(parts, columns)
    )
    seen = energy > VISIBLE * whole
    names = [n for n, visible in zip(names, seen) if visible]
    if not names:
        return {}
    columns, weighted = ([x[:, :, seen] for x in those] for those in (columns, weighted))
    limit = np.array([max(p.bounds.get(n, 0.0) for p in parts) for n in names])
    c = np.zeros(len(names))
    for _ in range(3):
        A, b = np.zeros((len(names), len(names))), np.zeros(len(names))
        for p, X, NX in zip(parts, columns, weighted):
            energy = _energy(p.N, p.w - X @ c)
            last = int((1.0 - TRIMMED) * (len(energy) - 1))
            kept = energy <= np.partition(energy, last)[last]
            flat = NX[kept].reshape(-1, len(names))
            A += X[kept].reshape(-1, len(names)).T @ flat
            b += p.w[kept].ravel() @ flat
        scale = np.sqrt(np.maximum(np.diag(A), 1e-300))
        values, vectors = np.linalg.eigh(A / np.outer(scale, scale))
        roots = np.sqrt(np.maximum(values, 1e-14 * values.max()))
        right = (vectors.T @ (b / scale)) / roots
        found, most = vectors @ (right / roots), limit * scale + 1e-300
        if np.any(np.abs(found) > most):
            found = lsq_linear(roots[:, None] * vectors.T, right, (-most, most)).x
        c = found / scale
    return dict(zip(names, c.tolist()))


def _fit_under_noise(
    parts: Sequence[_Defects],
    lengths: Sequence[Array],
    names: Sequence[str],
    residual: Array,
    noise: Array,
    width: int,
) -> tuple[dict[str, float], Array]:
    """The coefficients of a log whose noise hides what an integrator leaves in a single step.

    Noise of the states is in the defects and in the columns, so that rows fit each other's noise. Means over
    windows have next to none of it. Each equation counts by its own `noise` (n,), and by what is left of the
    equation that fits best; coefficients are as large as their bounds at first sight. Also what their errors
    leave of each equation (n,), N or N·m.
    """
    if not names:
        return {}, np.zeros_like(noise)
    from scipy.optimize import lsq_linear

    if not names:  # as of a log at rest
        return {}, np.zeros(residual.shape[1])

    def windows(forces: Iterable[Array]) -> Array:
        return np.concatenate([_window(x, h, width) for x, h in zip(forces, lengths)])

    y = windows(_times(p.N, p.w) for p in parts)
    X = np.stack([windows(p.column_forces.get(n, 0.0 * p.w) for p in parts) for n in names], axis=2)
    inertia = np.mean(np.concatenate([np.einsum("tii->ti", p.N) for p in parts]), axis=0)
    unlike = float(np.min(_rms(residual) ** 2 / np.maximum(inertia, 1e-300)))
    weight = 1.0 / np.sqrt(np.maximum(noise**2 + unlike * inertia, 1e-300))
    bounds = np.array([max(p.bounds.get(n, 0.0) for p in parts) for n in names])
    prior = np.diag(1.0 / bounds)
    c = np.zeros(len(names))
    for _ in range(3):
        energy = np.sum(((y - X @ c) * weight) ** 2, axis=1)
        kept = energy <= np.quantile(energy, 1.0 - TRIMMED)
        A = (X[kept] * weight[:, None]).reshape(-1, len(names))
        b = (y[kept] * weight).ravel()
        rows, right = np.vstack([A, prior]), np.concatenate([b, np.zeros(len(names))])
        c = lsq_linear(rows, right, (-bounds, bounds)).x
    # Windows overlap by half, so that every row counts twice.
    covariance = 2.0 * np.linalg.inv(rows.T @ rows)
    errors = np.einsum("wnp,pq,wnq->wn", X, covariance, X)
    return dict(zip(names, c.tolist())), np.asarray(np.sqrt(np.mean(errors, axis=0)))


def _window(values: Array, weights: Array, width: int) -> Array:
    """Means of (I, …) over windows of so many intervals, weighted by a bump."""
    if width == 1:
        return values
    count = len(values) // max(1, width // 2) - 1
    if count < 1:
        return values[:0]
    bump = np.sin(np.pi * (np.arange(width) + 0.5) / width) ** 2
    made = []
    for j in range(count):
        here = slice(j * (width // 2), j * (width // 2) + width)
        if here.stop > len(values):
            break
        w = bump * weights[here]
        made.append(np.tensordot(w / w.sum(), values[here], axes=(0, 0)))
    return np.array(made).reshape(len(made), *values.shape[1:])


def _judged(
    model: Model,
    run: Trajectory,
    pieces: Sequence[tuple[Rows, Rows]],
    parts: Sequence[_Defects],
    c: Mapping[str, float],
    off: float,
    steps: Steps | None,
    groups: Mapping[str, list[int]],
    unsteady: float,
    held: bool,
    uncertain: Array | None = None,
) -> Residual:
    """What the coefficients `c` leave of the parts; `uncertain` (n,) is what their errors leave."""

    def forces(p: _Defects, w: Array) -> Array:
        return _times(p.N, w)

    rest = [
        p.w - sum((c[n] * p.columns[n] for n in c if n in p.columns), start=np.zeros_like(p.w))
        for p in parts
    ]
    raw = [forces(p, w) for p, w in zip(parts, rest)]
    taken = trimmed(np.concatenate([forces(p, p.w - w) for p, w in zip(parts, rest)]))
    # Next order: what second differences leave, times the relative change over a step.
    change = np.concatenate([_changes(p) for p in parts])
    typical = np.concatenate([_norm(p.N, p.a) for p in parts])
    rate = float(np.clip(np.median(change) / max(float(np.median(typical)), 1e-300), 0.0, 1.0))
    first = max((abs(x) for n, x in c.items() if n not in SECOND), default=0.0)
    growth = rate * (1.0 + 2.0 * first)
    # As much of them as was fitted is believed to be there, and some besides.
    fitted = {n: abs(c.get(n, 0.0)) + BESIDES for n in SECOND}
    seconds = [_sum(fitted[n] * np.abs(p.column_forces[n]) for n in SECOND) for p in parts]
    each: dict[str, list[Array]] = {
        "next order": [growth * x for x in seconds],
        "interpolation": [np.abs(forces(p, p.interpolation)) for p in parts],
        # Of held forces as much is believed as was fitted of each way in which they may be of other rows.
        "forces between rows": [
            _sum(
                0.5 * (abs(c.get(n, 0.0)) if held else 1.0) * np.abs(forces(p, x))
                for n, x in p.forces.items()
            )
            + np.zeros_like(p.w)
            for p in parts
        ],
        "times of rows": [
            CARRIED * unsteady * np.abs(forces(p, r.D[p.at])) for (r, _), p in zip(pieces, parts)
        ],
    }
    bars = {name: _rms(np.concatenate(x)) for name, x in each.items()}
    systematic = [_sum(x[k] for x in each.values()) for k in range(len(parts))]
    systematic_bar = np.sqrt(_sum(np.square(x) for x in bars.values()))
    rng = np.random.default_rng(5)
    # Kinks of held forces look like noise; but noise would not let any scheme come closer than itself.
    believed = (
        min(1.0, 2.0 * off / steps.digits) if steps is not None and steps.digits > 0.0 else 1.0
    )
    noise = []
    real = _share_of_noise(model, pieces, parts, rest, held)
    for (rows, size), p in zip(pieces, parts):
        fine = np.minimum(
            resolution(rows.u), size.u
        )  # rounding is no noise: it hardly changes for a while
        shaken = rows.shaken(replace(size, u=fine + real * (size.u - fine)), rng)
        noise.append(believed * forces(p, _plain(model, shaken, held)[1][p.at] - p.w))
    best: tuple[int, Array, Array] | None = None
    longest = max(len(x) for x in raw)
    for width in WIDTHS:
        if width > 1 and longest < 4 * width:
            break
        weights = [r.h[p.at, 0] for (r, _), p in zip(pieces, parts)]
        bar = _rms(np.concatenate([_window(x, h, width) for x, h in zip(noise, weights)]))
        best = (width, bar, np.concatenate([_window(x, h, width) for x, h in zip(raw, weights)]))
        if np.all(bar <= systematic_bar):
            break
    assert best is not None
    width, noise_bar, residual = best
    if width > 1 and uncertain is None:
        again, uncertain = _fit_under_noise(parts, weights, tuple(c), residual, noise_bar, width)
        return _judged(
            model, run, pieces, parts, again, off, steps, groups, unsteady, held, uncertain
        )
    if uncertain is not None:
        bars["coefficients"] = uncertain
        systematic_bar = np.hypot(systematic_bar, uncertain)
    allowed = np.concatenate([_window(x, h, width) for x, h in zip(systematic, weights)])
    times = np.concatenate(
        [
            _window((r.t[:-1, None] + 0.5 * r.h)[p.at], r.h[p.at, 0], width)[:, 0]
            for (r, _), p in zip(pieces, parts)
        ]
    )
    whole = [
        model.terms(r.t[p.at], r.q[p.at], r.u[p.at], r.F[p.at]) + np.abs(forces(p, p.a))
        for (r, _), p in zip(pieces, parts)
    ]
    magnitude = np.concatenate(whole)
    inertia = np.sqrt(
        np.maximum(
            np.mean(np.concatenate([np.einsum("tii->ti", p.N) for p in parts]), axis=0), 1e-300
        )
    )
    scale = _rms(magnitude)
    scale = np.maximum(scale, 1e-3 * inertia * float((scale / inertia).max()))
    rounding = (
        1e-13 * scale
        + 20.0
        * EPS
        * _rms(np.concatenate([np.abs(r.u[:-1]) / r.h for r, _ in pieces]))
        * inertia**2
    )
    bar = np.sqrt(noise_bar**2 + systematic_bar**2 + rounding**2)
    u = np.concatenate([r.u[p.at] for (r, _), p in zip(pieces, parts)])
    left = np.concatenate(raw)
    time = float(run.t[-1] - run.t[0])
    # What is left may be a mistake altogether, and noise may hide another; the next order is no mistake.
    lengths = np.concatenate([r.h[p.at] for (r, _), p in zip(pieces, parts)])
    share = lengths / float(lengths.sum())

    def work(force: Array) -> float:
        """The largest work (J) of a force in the time of the log."""
        return float(np.abs(np.cumsum(np.sum(u * force, axis=1) * share[:, 0])).max()) * time

    hidden = work(left) + _mistakes(pieces, parts, tuple(c), residual, width, time)
    spent = abs(float(np.mean(np.sum(u * left, axis=1)))) * time
    return Residual(
        times, residual, allowed, trimmed(residual), bar, scale, c, taken, hidden, spent,
        {**bars, "noise": noise_bar, "rounding": rounding}, believed * min(1.0, np.sqrt(3.0) * real),
        partial(_as_forces, model, groups, tuple(c), held),
    )  # fmt: skip


def _mistakes(
    pieces: Sequence[tuple[Rows, Rows]],
    parts: Sequence[_Defects],
    names: Sequence[str],
    residual: Array,
    width: int,
    time: float,
) -> float:
    """The largest work (J) that a simple mistake may have done in a time without being seen.

    A damper, a constant force or another inertia of one joint is fitted to the residual (W, n) together with
    the scheme columns, each of which may be as large as its bound; three standard errors are added. Those are
    the larger of two: of white noise, and of the scatter of the scores over blocks of the log.
    """
    lengths = [r.h[p.at, 0] for (r, _), p in zip(pieces, parts)]
    energy = np.sum((residual / np.maximum(_rms(residual), 1e-100)) ** 2, axis=1)
    kept = energy <= np.quantile(energy, 1.0 - TRIMMED)  # what acts all along shows in the others
    residual = residual[kept]
    weight = 1.0 / np.maximum(_rms(residual), 1e-100)  # whose square is a number

    def weighted(forces: Iterable[Array]) -> Array:
        made = np.concatenate([_window(x, h, width) for x, h in zip(forces, lengths)])
        return np.asarray(made[kept] * weight)

    bounds = {n: max(p.bounds.get(n, 0.0) for p in parts) for n in names}
    columns = [
        bounds[n] * weighted(p.column_forces.get(n, 0.0 * p.w) for p in parts) for n in names
    ]
    windows, n = residual.shape
    X = np.reshape(columns, (len(names), windows * n)).T
    U, size, _ = np.linalg.svd(X, full_matrices=False)
    taken = size**2 / (1.0 + size**2)
    U, y = U.reshape(windows, n, -1), residual * weight
    starts = np.unique(np.linspace(0, windows, BLOCKS + 1).astype(np.intp))[:-1]

    def by_block(x: Array) -> Array:
        return np.asarray(np.add.reduceat(x, starts))

    of_columns = by_block(np.einsum("wnp,wn->wp", U, y))
    u = np.concatenate([r.u[p.at] for (r, _), p in zip(pieces, parts)])
    share = np.concatenate(lengths)[:, None] * (time / sum(float(h.sum()) for h in lengths))
    most = 0.0
    for kind in (
        [r.u[p.at] for (r, _), p in zip(pieces, parts)],
        [np.ones_like(p.w) for p in parts],
        [_times(p.N, p.a) for p in parts],
    ):
        m = weighted(kind)
        with_columns, products, squares = (
            by_block(U * m[..., None]),
            by_block(m * y),
            by_block(m * m),
        )
        a = with_columns.sum(axis=0)
        total = squares.sum(axis=0)
        exists = total > TINY_SQUARE  # else nothing moves there, and theta may be anything
        seen = np.maximum(total - np.sum(taken * a * a, axis=1), EPS * total)
        seen = np.where(exists, seen, 1.0)
        theta = (products.sum(axis=0) - (taken * a) @ of_columns.sum(axis=0)) / seen
        scores = products - of_columns @ (taken * a).T
        scores -= theta * (squares - np.sum(with_columns * (taken * a), axis=2))
        error = np.sqrt(np.maximum(1.0 / seen, np.sum((scores / seen) ** 2, axis=0)))
        done = np.abs(np.cumsum(np.concatenate(kind) * u * share, axis=0)).max(axis=0)
        most = max(most, float(np.max((np.abs(theta) + 3.0 * error) * done * exists)))
    return most


def _share_of_noise(
    model: Model,
    pieces: Sequence[tuple[Rows, Rows]],
    parts: Sequence[_Defects],
    rest: Sequence[Array],
    held: bool,
) -> float:
    """How much of what looks like noise of the speeds is that, in standard deviations.

    Noise of u leaves mean accelerations that follow each other with opposite signs: −2 Σ wᵀN w′ over
    neighbours is its energy. What forces leave that change from step to step has no such relation.
    """
    rng = np.random.default_rng(7)
    total = between = apparent = 0.0
    count = pairs = intervals = 0
    for (rows, size), p, w in zip(pieces, parts, rest):
        still = Rows(rows.t, np.zeros_like(size.q), size.u, np.zeros_like(size.F))
        shaken = _plain(model, rows.shaken(still, rng), held)[1][p.at] - p.w
        apparent += _product(shaken, p.N, shaken)
        total += _product(w, p.N, w)
        k = np.flatnonzero(np.diff(p.at) == 1)
        between += _product(w[k], p.N[k], w[k + 1])
        count += w.size
        pairs += len(k)
        intervals += len(w)
    if not apparent > 0.0 or pairs < CHANCE**2:
        return 1.0
    between *= intervals / pairs
    known = max(-2.0 * between, 0.0) + CHANCE * total / np.sqrt(max(count, 1))
    return float(np.clip(np.sqrt(known / apparent), 0.0, 1.0))


def _as_forces(
    model: Model,
    groups: Mapping[str, list[int]],
    names: Sequence[str],
    held: bool,
    t: Array,
    q: Array,
    u: Array,
    F: Array,
) -> Array:
    """The scheme columns of consecutive rows as forces (T, n, m); the last row repeats its neighbour."""
    rows = Rows(t, q, u, F)
    found = _defects(model, rows, groups, held, whole=True)
    nothing = np.zeros_like(found.w)
    columns = np.zeros((*found.w.shape, 0))
    if names:
        columns = np.stack(
            [found.bounds.get(n, 0.0) * found.columns.get(n, nothing) for n in names], axis=2
        )
    # Coordinates that a scheme moves by other speeds than those logged change the momentum besides.
    there = model.inertia(t[1:], q[1:])
    told = model.inertia(t[1:], model.moved(q[:-1], 0.5 * (u[:-1] + u[1:]), rows.h))
    momentum = _times(there - told, u[:-1]) / rows.h
    forces = np.concatenate([found.N @ columns, momentum[..., None]], axis=2)
    return np.concatenate([forces, forces[-1:]])


def trimmed(values: Array) -> Array:
    """Root mean square of each column without its largest tenth."""
    if not len(values):
        return np.zeros(values.shape[1])
    squares = np.sort(values**2, axis=0)
    return np.asarray(np.sqrt(np.mean(squares[: max(1, int(0.9 * len(squares)))], axis=0)))


def _changes(p: _Defects) -> Array:
    """How much accelerations change over each interval (I,), by all causes, in the mass metric."""
    return _sum(
        np.sqrt(np.maximum(np.vecdot(x, p.column_forces[n]), 0.0))
        for n, x in p.columns.items()
        if n not in SECOND
    )


def _sum(arrays: Iterable[Array]) -> Array:
    """The sum of arrays."""
    return np.asarray(np.sum(list(arrays), axis=0))


def _rms(values: Array) -> Array:
    if not len(values):
        return np.zeros(values.shape[1])
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))
