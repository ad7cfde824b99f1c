"""`linearise` and `equilibrium`: small motions about a motion, and where a mechanism can rest."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from deltac.analysis.model import Instants, instants
from deltac.arrays import NEWTON_STEPS, SAME, Array, max_norm
from deltac.calls.arguments import checked
from deltac.dynamics.admissible import onto_positions
from deltac.dynamics.equations_of_motion import (
    EquationsOfMotion,
    equations_of_motion,
    evaluate_at,
    matrices,
)
from deltac.dynamics.independence import RANK_TOLERANCE
from deltac.dynamics.recursions import rnea
from deltac.dynamics.singular_inertia import regular_least_squares
from deltac.errors import ModelError, StateError, WrongType
from deltac.mechanism.state import State
from deltac.models import ModelLike, StateLike
from deltac.results import Report, Section, Table, number
from deltac.simulation.constraints.feasibility import START_TOLERANCE


@dataclass(frozen=True, eq=False, repr=False)
class Linearisation(Report):
    """δẋ = A δx + B δi about a motion, in independent coordinates and speeds.

    δx holds displacements along the independent speeds (δq = W δθ: of a coordinate whose rate is its speed
    that is δq itself; of a quaternion the small rotation, body components), then changes of independent
    speeds. Whatever the constraints make depend on them is eliminated. A is exact about any motion. Its
    eigenvalues decide stability where the motion is an equilibrium or steady.

    Attributes:
        state: the state about which the motion is linearised.
        A: (d, d), 1/s and mixed units.
        B: (d, inputs), derivatives by the motors without a law.
        names: what each entry of δx is: "δ <speed>" for displacements, "<speed>" for speeds.
        inputs: names of the columns of B.
    """

    state: State
    A: Array
    B: Array
    names: tuple[str, ...]
    inputs: tuple[str, ...]

    @property
    def eigenvalues(self) -> Array:
        """Of A (d,), complex, 1/s, by rising real part."""
        values = np.linalg.eigvals(self.A).astype(complex)
        return values[np.lexsort((values.imag, values.real))]

    def summary(self) -> str:
        """The size of it, and the eigenvalue with the largest real part."""
        values = self.eigenvalues
        growth = f", Re λ ≤ {number(float(values[-1].real), '1/s')}" if len(values) else ""
        return f"linearised at t = {self.state.t:g} s: {len(values)} states{growth}"

    def sections(self) -> Iterator[Section]:
        """The eigenvalues, with frequency and damping."""
        yield self.summary()
        rows = []
        for value in self.eigenvalues:
            if value.imag < 0.0:
                continue
            size = abs(value)
            rows.append(
                (
                    number(float(value.real), digits=6),
                    number(float(value.imag), digits=6),
                    number(float(value.imag) / (2 * math.pi)) if value.imag else "",
                    number(float(-value.real) / size) if value.imag else "",
                )
            )
        yield Table(("Re λ, 1/s", "Im λ, 1/s", "frequency, Hz", "damping ratio"), tuple(rows))

    def contents(self) -> dict[str, Any]:
        """Matrices and names; eigenvalues as pairs of real and imaginary part."""
        pairs = [[float(value.real), float(value.imag)] for value in self.eigenvalues]
        return {**super().contents(), "eigenvalues": pairs}


@dataclass(frozen=True, eq=False, repr=False)
class Equilibrium(Report):
    """An equilibrium of a mechanism: the state, its multipliers, and small motions about it.

    Attributes:
        state: with free speeds zero, on its constraints.
        multipliers: λ of every constraint row.
        residual: largest remaining generalized force (N or N·m).
        linearisation: of the motion about it.
        stability: "asymptotically stable", "unstable", or "marginal" where the linear terms do not decide, as
            in every undamped equilibrium that is not unstable.
    """

    state: State
    multipliers: Array
    residual: float
    linearisation: Linearisation
    stability: str

    @property
    def eigenvalues(self) -> Array:
        """Of small motions, 1/s, by rising real part."""
        return self.linearisation.eigenvalues

    def summary(self) -> str:
        """Whether it is stable."""
        return f"equilibrium at t = {self.state.t:g} s: {self.stability}"

    def sections(self) -> Iterator[Section]:
        """Its stability and small motions."""
        yield self.summary()
        yield from self.linearisation.sections()


@checked
def linearise(
    model: ModelLike, state: StateLike = None, *, inputs: Mapping[str, ArrayLike] | None = None
) -> Linearisation:
    """Linearise the equations of motion about the motion through a state.

    Args:
        model: a Mechanism, a Problem, a problem's name, a model file or ``file.py:callable``.
        state: on its constraints; by default the model's own start.
        inputs: values (N·m or N) of the motors without a law, by name; zero where not given.

    Raises:
        InputError: a state that does not fit the model or violates a constraint.
    """
    at = instants(model, state, inputs)
    if not at.single:
        raise WrongType("state: expected a State to linearise about, found a Trajectory")
    return _linearised(equations_of_motion(at.mechanism), at)


@checked
def equilibrium(
    model: ModelLike, guess: StateLike = None, *, inputs: Mapping[str, ArrayLike] | None = None
) -> Equilibrium:
    """Find the equilibrium near a guess, where the free speeds and their accelerations are zero.

    With prescribed joints it is a relative equilibrium at the guess's time, like that of a bead on a rotating
    hoop. Newton's method solves for forces and constraints together. Coordinates that do not matter (the
    place of a ball on a table) keep their guess.

    Args:
        model: a Mechanism, a Problem, a problem's name, a model file or ``file.py:callable``.
        guess: its coordinates are where the search starts; by default the model's own start.
        inputs: values (N·m or N) of the motors without a law, by name; zero where not given.

    Raises:
        InputError: none is found from the guess; the message names the speed with the largest remaining
            force.
    """
    at = instants(model, guess, inputs)
    if not at.single:
        raise WrongType("guess: expected a State, found a Trajectory")
    mechanism, motion = at.mechanism, equations_of_motion(at.mechanism)
    free, rows = mechanism.free, motion.rows
    t, p = float(at.t[0]), len(mechanism.free.u)
    position = np.array(rows.holonomic, dtype=bool)
    q = onto_positions(motion, t, at.q[0][free.q])
    u: Array = np.zeros(p)
    lam: Array = np.zeros(len(rows))
    _, psi = motion.violation(t, q, u)
    if max_norm(psi) > START_TOLERANCE:
        worst = rows.names[int(np.argmax(np.abs(psi)))]
        raise ModelError(
            f"equilibrium: constraint {worst!r} moves at t = {t:g} s, so nothing can be at rest; hold it "
            f"still"
        )
    f, slopes = _residual(motion), Slopes(motion)

    # The multipliers that balance best where the search starts.
    terms = motion.terms(t, q, u, inputs=at.inputs[0])
    if len(rows):
        pull = terms.force - terms.bias
        lam = np.asarray(np.linalg.lstsq(terms.G.T, -pull, rcond=1e-10)[0])
    # Forces are compared with those at the guess and with those of a unit displacement, because at rest all
    # forces of a pendulum vanish.
    _, scale, _ = evaluate_at(f, t, q, at.inputs[0], lam)
    stiffness = slopes.at_rest(t, q, lam, at.inputs[0])[0]
    size = max(float(scale.max(initial=0.0)), max_norm(stiffness), 1e-300)

    def imbalance(q: Array, lam: Array) -> Array:
        force, _, phi = evaluate_at(f, t, q, at.inputs[0], lam)
        return np.concatenate([force / size, phi[position]])

    residual = imbalance(q, lam)
    for _ in range(NEWTON_STEPS):
        if max_norm(residual) < 1e-15:
            break
        r_q, G, W = slopes.at_rest(t, q, lam, at.inputs[0])
        none = np.zeros((int(position.sum()), len(lam)))
        J = np.block([[r_q / size, -G.T / size], [G[position], none]])
        step = np.linalg.lstsq(J, -residual, rcond=1e-12)[0]
        # A step turns nothing by more than half a radian, and is halved until it helps.
        share = min(1.0, 0.5 / max(max_norm(step[:p]), 1e-300))
        while share > 1e-4:
            trial = q + share * (W @ step[:p])
            for place in motion.quaternions:
                trial[place] /= np.linalg.norm(trial[place])
            trial_residual = imbalance(trial, lam + share * step[p:])
            if np.linalg.norm(trial_residual) < (1 - 0.1 * share) * np.linalg.norm(residual):
                break
            share *= 0.5
        else:
            break
        q, lam, residual = trial, lam + share * step[p:], trial_residual
    force = np.abs(residual[:p])
    if not max_norm(residual) < SAME:
        k = int(np.argmax(force)) if p else 0
        name = mechanism.speeds[int(free.u[k])].name
        raise StateError(
            f"equilibrium: none found from this guess; {force[k] * size:.3g} N or N·m remain on {name!r}. "
            "Give another guess, or add something that holds it"
        )
    full_q, full_u = at.q[0].copy(), at.u[0].copy()
    full_q[free.q], full_u[free.u] = q, 0.0
    state = mechanism.state(full_q, full_u, t)
    at_state = Instants(
        mechanism, at.t, full_q[None, :], full_u[None, :], at.inputs, None, single=True
    )
    small = _linearised(motion, at_state)
    return Equilibrium(state, lam, float(force.max(initial=0.0)) * size, small, _stability(small))


def _stability(small: Linearisation) -> str:
    """By the eigenvalues, which are known to the root of rounding at worst (double ones)."""
    values = small.eigenvalues
    size = max(1.0, max_norm(values))
    # A defective pair splits by the root of rounding.
    least = 1e-7 * size
    if (values.real > least).any():
        return "unstable"
    return "asymptotically stable" if (values.real < -least).all() and len(values) else "marginal"


def _linearised(motion: EquationsOfMotion, at: Instants) -> Linearisation:
    mechanism, rows, free = at.mechanism, motion.rows, at.mechanism.free
    t, q, u, inputs = float(at.t[0]), at.q[0][free.q], at.u[0][free.u], at.inputs[0]
    phi, psi = motion.violation(t, q, u)
    violation = np.abs(np.concatenate([phi, psi]))
    if len(violation) and not float(violation.max()) <= START_TOLERANCE:
        worst = rows.names[int(violation.argmax()) % len(rows)]
        raise StateError(
            f"state: it violates constraint {worst!r} by {violation.max():.3g} m or rad (per s); "
            "deltac.assemble(mechanism, state) finds a consistent state nearby"
        )
    p, m = len(free.u), len(inputs)
    slopes = Slopes(motion)
    M, G, W, bias, gamma = slopes.equations(t, q, u, inputs)
    # [M −Gᵀ; G 0] [u̇; λ] = −[bias; γ], and the same of the slopes by displacements, speeds and inputs.
    solution = regular_least_squares(mechanism, M, G)

    def solved(force: Array, rate: Array) -> tuple[Array, Array]:
        """Columns (p, ·) and (nc, ·) of the system's solution."""
        response = solution.solved(force)
        multipliers = solution.schur_inverse @ (rate - G @ response)
        return response + solution.response @ multipliers, multipliers

    acceleration, lam = solved(-bias[:, None], -gamma[:, None])
    point = (t, q, u, acceleration[:, 0], lam[:, 0], inputs)
    r_q, c_q, psi_q, kin = slopes.along(*point, dq=W)
    r_u, c_u, _, _ = slopes.along(*point, du=np.eye(p))
    r_i, c_i, _, _ = slopes.along(*point, di=np.eye(m))
    udot, _ = solved(-np.hstack([r_q, r_u, r_i]), -np.hstack([c_q, c_u, c_i]))
    # δq = W δθ, so δθ̇ = δu + W⁺ (∂q̇/∂q W − Ẇ) δθ.
    turning = np.linalg.pinv(W) @ (kin - slopes.frame_rate(t, q, u))
    whole = np.block([[turning, np.eye(p)], [udot[:, :p], udot[:, p : 2 * p]]])
    # The tangent of the constraints: G δθ = 0 of positions, ψ_q W δθ + G δu = 0 of all rows. The independent
    # entries are fixed ones, so that the tangent may turn in the motion and no rate of it is needed.
    position = np.array(rows.holonomic, dtype=bool)
    at_q, T_q = _tangent(G[position])
    at_u, T_u = _tangent(G)
    dependent = [k for k in range(p) if k not in at_u]
    follow = np.zeros((p, len(at_q)))
    if dependent:
        needed = psi_q @ T_q
        follow[dependent] = -np.linalg.pinv(G[:, dependent], rcond=RANK_TOLERANCE) @ needed
    T = np.block([[T_q, np.zeros((p, len(at_u)))], [follow, T_u]])
    independent = [*at_q, *(p + k for k in at_u)]
    B = np.vstack([np.zeros((p, m)), udot[:, 2 * p :]])
    names = mechanism.speeds.free_names
    state = mechanism.state(at.q[0], at.u[0], t)
    motors = [
        motor.name if len(joint.speeds) == 1 else f"{motor.name} {speed}"
        for motor in mechanism.motors
        for joint in [mechanism.joint(motor.joint)]
        for speed in joint.speeds
    ]
    return Linearisation(
        state,
        (whole @ T)[independent],
        B[independent],
        (*(f"δ {names[k]}" for k in at_q), *(names[k] for k in at_u)),
        tuple(motors),
    )


def _tangent(G: Array) -> tuple[list[int], Array]:
    """Independent speeds, and T (p, d) with G T = 0 whose rows of these are the identity."""
    from scipy.linalg import qr

    p = G.shape[1]
    size = np.linalg.norm(G, axis=1)
    G = G[size > 1e-12] / size[size > 1e-12][:, None]
    if not len(G):
        return list(range(p)), np.eye(p)
    _, R, order = qr(G, mode="economic", pivoting=True)
    rank = int((np.abs(np.diag(R)) > RANK_TOLERANCE).sum())
    dependent, independent = order[:rank], sorted(int(k) for k in order[rank:])
    T = np.zeros((p, len(independent)))
    T[independent, range(len(independent))] = 1.0
    T[dependent] = -np.linalg.pinv(G[:, dependent]) @ G[:, independent]
    return independent, T


class Slopes:
    """Slopes of the equations of motion along directions, evaluated one direction after the other.

    r = M u̇ + h − f − Gᵀλ, with M and h as in `MotionTerms`, ψ̇, ψ and q̇. A derivative along one direction
    takes as long as a few evaluations of inverse dynamics; matrices of slopes, written out, grow with the
    square of the mechanism.
    """

    def __init__(self, motion: EquationsOfMotion) -> None:
        """Of the equations of a mechanism."""
        self._motion = motion
        self._function = motion.system.once("slopes", lambda: _directional(motion))
        self._frame = motion.system.once("frame rate", lambda: _frame_rate(motion))

    def along(
        self, *point: Any, dq: Any = None, du: Any = None, da: Any = None, di: Any = None
    ) -> list[Array]:
        """Slopes of r, ψ̇, ψ, q̇ as columns, one for each direction.

        `here` are t, q, u, u̇, λ and inputs; directions of q, u, u̇ and inputs are columns (n, directions).
        """
        rates = dict(zip((1, 2, 3, 5), (dq, du, da, di)))
        count = next(d.shape[1] for d in rates.values() if d is not None)
        directions = [
            np.zeros((len(point[k]), count)) if d is None else d for k, d in rates.items()
        ]
        if not count:
            sizes = [self._function.numel_out(k) for k in range(4, 8)]
            return [np.zeros((size, 0)) for size in sizes]
        return evaluate_at(self._function, *point, *directions)[4:]

    def equations(
        self, t: float, q: Array, u: Array, inputs: Array
    ) -> tuple[Array, Array, Array, Array, Array]:
        """M (p, p), G (nc, p), W (nq, p); h − f (p,), and γ (nc,)."""
        p, nc = len(u), len(self._motion.rows)
        point = (t, q, u, np.zeros(p), np.zeros(nc), inputs)
        M = self.along(*point, da=np.eye(p))[0]
        _, _, G, W = self.along(*point, du=np.eye(p))
        still = [np.zeros(n) for n in (len(q), p, p, len(inputs))]
        bias, gamma = evaluate_at(self._function, *point, *still)[:2]
        return 0.5 * (M + M.T), G, W, bias, gamma

    def at_rest(self, t: float, q: Array, lam: Array, inputs: Array) -> tuple[Array, Array, Array]:
        """Slopes of r (p, p) by displacements along W, G and W, where free speeds and accelerations are 0."""
        p = len(self._motion.system.free_u)
        point = (t, q, np.zeros(p), np.zeros(p), lam, inputs)
        _, _, G, W = self.along(*point, du=np.eye(p))
        return self.along(*point, dq=W)[0], G, W

    def frame_rate(self, t: float, q: Array, u: Array) -> Array:
        """Ẇ (nq, p)."""
        (flat,) = evaluate_at(self._frame, t, q, u)
        return matrices(flat, len(q), len(u))


def _directional(motion: EquationsOfMotion) -> Any:
    """(t, q, u, u̇, λ, inputs, dq, du, du̇, di) -> r, ψ̇, ψ, q̇ and their slopes along that direction."""
    s, rows, lam = motion.system, motion.rows, ca.SX.sym("lambda", len(motion.rows))
    psi_dot = ca.mtimes(rows.G, s.udot) + rows.gamma
    pull = ca.mtimes(rows.G.T, motion.weights(rows) * psi_dot - lam)
    r = (rnea(s, ca.SX(s.udot_all)) - motion.force)[s.free_u, :] + pull
    values = [r, psi_dot, rows.psi, s.qdot]
    at = [s.q, s.u, s.udot, s.inputs]
    along = [ca.SX.sym("d", x.shape[0]) for x in at]
    whole, direction = ca.vertcat(*at), ca.vertcat(*along)
    slopes = ca.vertsplit(
        ca.jtimes(ca.vertcat(*values), whole, direction),
        [0, *np.cumsum([x.shape[0] for x in values]).tolist()],
    )
    symbols = [s.t, s.q, s.u, s.udot, lam, s.inputs, *along]
    columns = [ca.densify(x) for x in (*values, *slopes)]
    return ca.Function("slopes", symbols, columns, {"cse": True})


def _frame_rate(motion: EquationsOfMotion) -> Any:
    """(t, q, u) -> Ẇ, its columns stacked."""
    s = motion.system
    W_dot = ca.jtimes(ca.vec(ca.densify(motion.W)), s.q, s.qdot)
    return ca.Function("frame_rate", [s.t, s.q, s.u], [ca.densify(W_dot)], {"cse": True})


def _residual(motion: EquationsOfMotion) -> Any:
    """(t, q, inputs, λ) -> residual forces at rest, sum of the magnitudes, φ."""
    s = motion.system

    def function() -> Any:
        lam = ca.SX.sym("lambda", len(motion.rows))
        force, size = _at_rest(motion, lam)
        columns = [force, size, motion.rows.phi]
        rest = ca.SX.zeros(s.u.shape[0])
        columns = ca.substitute([ca.densify(x) for x in columns], [s.u], [rest])
        return ca.Function("rest", [s.t, s.q, s.inputs, lam], columns, {"cse": True})

    return s.once("rest", function)


def _at_rest(motion: EquationsOfMotion, lam: Any) -> tuple[Any, Any]:
    s, rows = motion.system, motion.rows
    ties = ca.mtimes(rows.G.T, lam)
    force = (motion.bias - motion.force)[s.free_u, :] - ties
    size = ca.fabs(motion.bias[s.free_u]) + ca.fabs(ties)
    for part in motion.channels:
        size = size + ca.fabs(part.force[s.free_u])
    return force, size
