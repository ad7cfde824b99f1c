"""`matrices`: the theory's matrices of a model at a state, or along a run.

    v = R u + v_t,    J v + f_t = 0          configuration constraints: joints and loops
    v = R̂ û + v̂_t,    A v + b = 0            motion constraints as well
    F + F* + F′ = 0,  F* = −(M v̇ + β)        Newton and Euler, body by body
    R̂ᵀ(F + F*) = 0,   F′ = F′_joints + Jᵀλ_c + Aᵀλ_m

after K. Gugaratshan's thesis, section 2.5. Velocities, forces and constraint rows of the bodies come from
`deltac.dynamics.maximal`; the rest is dense linear algebra.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from deltac import rotations
from deltac.analysis.model import instants
from deltac.arrays import HALF_DIGITS, Array
from deltac.calls.arguments import checked
from deltac.dynamics.maximal import maximal
from deltac.dynamics.singular_inertia import singular_inertia, without_inertia
from deltac.dynamics.system import trace
from deltac.errors import InputError, check_names
from deltac.mechanism.mechanism import Mechanism
from deltac.models import ModelLike, StateLike
from deltac.results import Serialisable
from deltac.trajectories import Trajectory


@dataclass(frozen=True, eq=False, kw_only=True)
class Matrices(Serialisable):
    """The theory's matrices at one instant; along a run every array has the samples in front, (T, …).

    N bodies; p independent speeds u under the configuration constraints, p̂ speeds û under the motion
    constraints too; l and m rows of loops and of motion constraints. Stacked vectors have n = 6N + r rows:
    for each body the mass centre's velocity (3, world components) and the angular velocity (3, body
    components), then one row for each of the r rotors, speeds whose joint has an `armature`. SI units:
    rows of velocities are m/s or rad/s, rows of forces N or N·m.

    Attributes:
        t: time (s).
        bodies, rows, joints: names of the bodies, of the n rows, and of the joints.
        speeds, speeds_hat: names of u and of û, which are speeds of joints.
        loop_rows, motion_rows: the constraint that each row of J, and of A, belongs to.
        x: of each body the mass centre (3, world) and the orientation as a unit quaternion from body to
            world, scalar first: (7N,).
        u, u_hat: the independent speeds (p,), (p̂,).
        v, v_dot: velocities (n,), and the rates of these components, v̇ (n,).
        B: velocity transformation (n, nu) of all joint speeds, v = B u_joints; J_joints B is zero but at
            prescribed speeds.
        R, v_t: partial velocities (n, p) and the velocity at u = 0 (n,): v = R u + v_t, J R = 0.
        R_dot, v_t_dot: their rates.
        R_hat, v_t_hat: the same of û, (n, p̂), (n,): v = R̂ û + v̂_t, J R̂ = 0, A R̂ = 0.
        J, f_t: configuration constraints of the loops, J v + f_t = 0: (l, n), (l,).
        A, b: motion constraints, A v + b = 0: (m, n), (m,).
        J_joints, f_t_joints: the same of the joints of the tree; without rows unless asked for.
        M: masses and central inertias, body components (n, n): block diagonal, kg and kg·m².
        beta: gyroscopic terms β (n,): ω × Iω in the rows of angular velocity, zero elsewhere.
        F_V, F_D, F: active forces at mass centres (world) and moments (body): with a potential, without one,
            and their sum (n,).
        F_star: inertia forces F* = −(M v̇ + β) (n,).
        F_prime: constraint forces F′ = −(F + F*) (n,): those of the joints and of what drives prescribed
            joints, of loops, and of motion constraints.
        F_r, F_r_star: generalized active and inertia forces R̂ᵀF, R̂ᵀF* (p̂,); their sum is zero in the
            mechanism's own motion.
        udot: accelerations (nu,) of all joint speeds that F* belongs to.
        lambda_c, lambda_m: multipliers of loops (l,) and of motion constraints (m,); the least ones where
            rows are redundant.
        reaction_place: the joint's frame on the child, world components (joints, 3), m.
        reaction_force, reaction_moment: what the joint's ideal constraint (with the drive of a prescribed
            joint, and the inertia of a rotor) exerts on the child at that place, world components
            (joints, 3), N and N·m; the parent takes the opposite. Springs, dampers and motors in the joint
            are active forces and not part of it.
    """

    t: float | Array
    bodies: tuple[str, ...]
    rows: tuple[str, ...]
    joints: tuple[str, ...]
    speeds: tuple[str, ...]
    speeds_hat: tuple[str, ...]
    loop_rows: tuple[str, ...]
    motion_rows: tuple[str, ...]
    x: Array
    u: Array
    u_hat: Array
    v: Array
    v_dot: Array
    B: Array
    R: Array
    v_t: Array
    R_dot: Array
    v_t_dot: Array
    R_hat: Array
    v_t_hat: Array
    J: Array
    f_t: Array
    A: Array
    b: Array
    J_joints: Array
    f_t_joints: Array
    M: Array
    beta: Array
    F_V: Array
    F_D: Array
    F: Array
    F_star: Array
    F_prime: Array
    F_r: Array
    F_r_star: Array
    udot: Array
    lambda_c: Array
    lambda_m: Array
    reaction_place: Array
    reaction_force: Array
    reaction_moment: Array

    def __repr__(self) -> str:
        shapes = ", ".join(
            f"{field.name} {getattr(self, field.name).shape}"
            for field in fields(self)
            if isinstance(getattr(self, field.name), np.ndarray)
        )
        return f"Matrices({', '.join(self.bodies)}; {shapes})"


@checked
def matrices(
    model: ModelLike,
    state: StateLike | Trajectory = None,
    *,
    inputs: Mapping[str, ArrayLike] | None = None,
    independent: Collection[str] = (),
    joints: bool = False,
) -> Matrices:
    """The matrices of the energy theorem: R, v_t, J, A, R̂, M, β, F, F*, F′, λ, joint reactions.

    Dense matrices, body by body: for reading, and for identities to be checked. `evaluate` is the fast way to
    M, the bias and λ.

    Args:
        model: a Mechanism, a Problem, a problem's name, a model file or ``file.py:callable``.
        state: a State; or a Trajectory, whose samples then are the first axis of every array. By default the
            problem's start.
        inputs: values (N·m or N) of the motors without a law, by name; zero where not given. A run has its
            own.
        independent: names of the speeds u that the others follow from; by default those in which the others
            are best expressed, chosen at the first sample.
        joints: also write the tree's joints as constraints, `J_joints`.

    Returns:
        `Matrices`. F* is that of the run's own accelerations where it has them, else of the equations of
        motion.

    Raises:
        InputError: a state that does not fit the model, unknown names, dependent `independent` speeds.
    """
    at = instants(model, state, inputs)
    names = tuple(independent)
    samples: list[Matrices] = []
    for k in range(len(at.t)):
        samples.append(
            matrices_at(
                at.mechanism,
                float(at.t[k]),
                at.q[k],
                at.u[k],
                udot=None if at.udot is None else at.udot[k],
                inputs=at.inputs[min(k, len(at.inputs) - 1)],
                independent=names,
                joints=joints,
            )
        )
        if not names:
            names = samples[0].speeds_hat
    return samples[0] if at.single else stacked(samples)


def matrices_at(
    mechanism: Mechanism,
    t: float,
    q: Array,
    u: Array,
    *,
    udot: Array | None = None,
    inputs: Array | None = None,
    independent: Collection[str] = (),
    joints: bool = False,
) -> Matrices:
    """The matrices at the instant (t, q, u) of all joints.

    Args:
        mechanism: any that can be simulated.
        t: time, s.
        q: coordinates of all joints (nq,).
        u: speeds of all joints (nu,), which meet the constraints; prescribed ones follow their laws.
        udot: accelerations (nu,) that F* is taken of; by default those of the mechanism's own motion.
        inputs: values (N or N·m) of the motors without a law, in their order; zero by default.
        independent: names of the independent speeds; by default those in which the others are best expressed.
        joints: the constraints of the tree's joints as well.

    Raises:
        InputError: unknown names, and independent speeds that the others do not follow from.
    """
    system, free = trace(mechanism), mechanism.free
    motors = np.zeros(system.inputs.shape[0]) if inputs is None else inputs
    full = system.once("full state", lambda: _full_state(system))
    q, u, udot_t = (np.array(x).ravel() for x in full(t, q[free.q], u[free.u]))
    u_t = np.where([entry.prescribed for entry in mechanism.speeds], u, 0.0)
    bodies = maximal(system)
    values = map(np.array, bodies.function(t, q, u, motors))
    terms = dict(zip(bodies.names, values, strict=True))
    holonomic = np.array(bodies.rows.holonomic, dtype=bool)
    instant = _Instant(mechanism, bodies.rows.names, holonomic, t, u, u_t, udot_t, terms)
    return instant.matrices(udot, tuple(independent), joints)


def _full_state(system: Any) -> Any:
    """(t, q, u) of the free entries -> q, u of all joints, and the accelerations of prescribed ones."""
    whole = [system.q_all, system.u_all, system.at_rest]
    return ca.Function("full", [system.t, system.q, system.u], whole)


def stacked(samples: Sequence[Matrices]) -> Matrices:
    """Matrices of one mechanism at several instants as one, samples in front.

    Quaternions in x keep their sign from sample to sample.
    """
    values: dict[str, Any] = {}
    for field in fields(Matrices):
        column = [getattr(sample, field.name) for sample in samples]
        values[field.name] = column[0] if isinstance(column[0], tuple) else np.array(column)
    x = values["x"]
    for k in range(3, x.shape[1], 7):
        turns = np.sign(np.einsum("ij,ij->i", x[1:, k : k + 4], x[:-1, k : k + 4]))
        x[1:, k : k + 4] *= np.cumprod(np.where(turns < 0.0, -1.0, 1.0))[:, None]
    return Matrices(**values)


@dataclass(frozen=True, eq=False)
class _Split:
    """Independent speeds among the free ones, and the rows by which the `dependent` ones follow."""

    rows: list[int]
    independent: list[int]
    dependent: list[int]


@dataclass(frozen=True, eq=False)
class _Instant:
    """A mechanism at the instant (t, q, u), and its `terms` as numbers, see `Maximal`.

    `names` (m,) tell the constraint of each row. `u_t`, `udot_t` (nu,) are the speeds and accelerations of
    prescribed joints, zero elsewhere.
    """

    mechanism: Mechanism
    names: tuple[str, ...]
    holonomic: NDArray[np.bool_]
    t: float
    u: Array
    u_t: Array
    udot_t: Array
    terms: Mapping[str, Array]

    @cached_property
    def free(self) -> NDArray[np.intp]:
        """Places of the free speeds."""
        return self.mechanism.free.u

    @cached_property
    def c(self) -> Array:
        """ψ without any motion (m,)."""
        return self.terms["c"].ravel()

    @cached_property
    def G_all(self) -> Array:
        """Jacobian of the rows (m, nu) by all speeds."""
        return np.asarray(self.terms["J"] @ self.terms["P"])

    @cached_property
    def M(self) -> Array:
        """Masses, central inertias and rotor inertias: block diagonal (n, n)."""
        m, N = self.mechanism, 6 * len(self.mechanism.bodies)
        M = np.zeros((len(self.terms["P"]),) * 2)
        for k, body in enumerate(m.bodies):
            i = 6 * k + 3
            M[range(i - 3, i), range(i - 3, i)] = m.number(body.mass)
            M[i : i + 3, i : i + 3] = [[m.number(entry) for entry in row] for row in body.inertia]
        for joint in m.joints:
            i = N + m.speeds.of(joint.name).start
            for k, armature in enumerate(joint.armature):
                M[i + k, i + k] = m.number(armature)
        return M

    @cached_property
    def beta(self) -> Array:
        """β (n,): ω × Iω in the rows of angular velocity, which are components in a turning basis."""
        v = self.terms["P"] @ self.u
        beta, momentum, turning = (
            np.zeros_like(v),
            self.M @ v,
            range(3, 6 * len(self.mechanism.bodies), 6),
        )
        for k in turning:
            beta[k : k + 3] = np.cross(v[k : k + 3], momentum[k : k + 3])
        return beta

    def v_dot(self, udot: Array) -> Array:
        """v̇ (n,) for accelerations of all joints."""
        return np.asarray(self.terms["P"] @ udot + self.terms["P_dot"] @ self.u)

    def udot(self, F: Array) -> Array:
        """All accelerations (nu,): u̇ = R̂ ṡ − G⁺γ, R̂ from singular values, and R̂ᵀ(F + F*) = 0 for ṡ."""
        free, P, G = self.free, self.terms["P"][:, self.free], self.G_all[:, self.free]
        gamma = (
            self.terms["G_dot"] @ self.u + self.terms["c_dot"].ravel() + self.G_all @ self.udot_t
        )
        udot, R_hat = self.udot_t.copy(), np.eye(len(free))
        if len(G):
            udot[free] -= np.linalg.lstsq(G, gamma, rcond=1e-9)[0]
            _, sizes, V = np.linalg.svd(G)
            R_hat = V[int((sizes > 1e-9 * sizes.max(initial=0.0)).sum()) :].T
        R = P @ R_hat
        mass, force = R.T @ self.M @ R, R.T @ (F - self.M @ self.v_dot(udot) - self.beta)
        if len(without_inertia(mass)) and (
            error := singular_inertia(self.mechanism, P.T @ self.M @ P)
        ):
            raise error
        udot[free] += R_hat @ np.linalg.solve(mass, force)
        return udot

    # --- independent speeds ----------------------------------------------------------------------

    def split(self, rows: NDArray[np.bool_], preferred: Sequence[int]) -> _Split:
        """Independent speeds under some rows: the preferred ones, then those that best express the others.

        Gaussian elimination of G with full pivoting, preferred columns last: pivot columns are dependent.
        """
        G, p = self.G_all[:, self.free], len(self.free)
        places = np.flatnonzero(rows)
        size = np.linalg.norm(G[places], axis=1)
        present = size > 1e-9 * max(1e-300, size.max(initial=0.0))
        places = places[present]
        reduced = G[places] / size[present][:, None]
        columns = [k for k in range(p) if k not in preferred]
        pivots: list[tuple[int, int]] = []
        for allowed in (columns, list(preferred)):
            while len(pivots) < len(places):
                open_rows = [i for i in range(len(places)) if i not in {i for i, _ in pivots}]
                open_columns = [j for j in allowed if j not in {j for _, j in pivots}]
                if not open_rows or not open_columns:
                    break
                block = np.abs(reduced[np.ix_(open_rows, open_columns)])
                # The first of those that are largest to rounding: symmetry makes some equal.
                largest = block >= (1.0 - 1e-9) * block.max()
                at = np.unravel_index(int(largest.argmax()), block.shape)
                if block[at] <= HALF_DIGITS:
                    break
                i, j = open_rows[int(at[0])], open_columns[int(at[1])]
                if allowed is not columns:
                    names = self.mechanism.speeds.free_names
                    raise InputError(
                        f"independent: at t = {self.t:g} s the speeds "
                        f"{', '.join(names[k] for k in preferred)} are not independent, {names[j]!r} follows "
                        "from the others; leave it out"
                    )
                others = np.arange(len(places)) != i
                reduced -= np.outer(reduced[:, j] / reduced[i, j], reduced[i]) * others[:, None]
                pivots.append((i, j))
        dependent = [j for _, j in pivots]
        independent = [k for k in range(p) if k not in dependent]
        return _Split([int(places[i]) for i, _ in pivots], independent, dependent)

    def moving(self, split: _Split) -> tuple[Array, Array, Array, Array]:
        """R, v_t and their rates."""
        # All speeds are [U z] (u, 1), with G U = 0 and G z + c = 0 in the rows of the split.
        free, count = self.free, len(split.independent)
        speeds, rates = np.zeros((2, len(self.u), count + 1))
        speeds[free[split.independent], range(count)] = 1.0
        speeds[:, count], rates[:, count] = self.u_t, self.udot_t
        if split.dependent:
            places = free[split.dependent]
            last = np.eye(count + 1)[count]
            G, G_dot = self.G_all[split.rows], self.terms["G_dot"][split.rows]
            G_dependent = G[:, places]
            violation = G @ speeds + np.outer(self.c[split.rows], last)
            speeds[places] = -np.linalg.solve(G_dependent, violation)
            violation = G_dot @ speeds + G @ rates + np.outer(self.terms["c_dot"][split.rows], last)
            rates[places] = -np.linalg.solve(G_dependent, violation)
        P, P_dot = self.terms["P"], self.terms["P_dot"]
        both, both_dot = P @ speeds, P @ rates + P_dot @ speeds
        return both[:, :count], both[:, count], both_dot[:, :count], both_dot[:, count]

    # --- joints of the tree ----------------------------------------------------------------------

    @cached_property
    def hinges(self) -> list[tuple[str, str, Array, Array, slice]]:
        """Of each joint: parent, child, place of its frame on the child, directions (6, n), speeds."""
        m, places = self.mechanism, self.terms["place"].T
        hinges = []
        for joint, place in zip(m.joints, places):
            where = m.speeds.of(joint.name)
            directions = self.terms["directions"][:, where]
            hinges.append((joint.parent, joint.child, place, directions, where))
        return hinges

    def twist(self, parent: str, child: str, place: Array) -> Array:
        """Relative twist (6, n) of a child and its parent at a place, from the velocities v of bodies."""
        twist = np.zeros((6, len(self.M)))
        for k, body in enumerate(self.mechanism.bodies):
            if body.name in (parent, child):
                sign, turned = (
                    (1 if body.name == child else -1),
                    self.terms["turned"][:, 3 * k :][:, :3],
                )
                lever = place - self.terms["x"][:, k]
                twist[:3, 6 * k : 6 * k + 3] = sign * np.eye(3)
                twist[:3, 6 * k + 3 : 6 * k + 6] = -sign * np.cross(lever, turned, axisb=0, axisc=0)
                twist[3:, 6 * k + 3 : 6 * k + 6] = sign * turned
        return twist

    @cached_property
    def speeds(self) -> Array:
        """The joints' speeds (nu, n) from the velocities v of bodies."""
        rows = [np.linalg.pinv(d) @ self.twist(p, c, place) for p, c, place, d, _ in self.hinges]
        return np.vstack(rows)

    @cached_property
    def ties(self) -> Array:
        """J and A row by row, on bodies alone: laws in joint speeds (gears, say) act through the twists."""
        J, N = self.terms["J"], 6 * len(self.mechanism.bodies)
        ties = J + J[:, N:] @ self.speeds
        ties[:, N:] = 0.0
        return np.asarray(ties)

    @cached_property
    def inertial_rows(self) -> list[int]:
        """Rows of the stacked vectors: those of bodies, and of rotors that have inertia."""
        N = 6 * len(self.mechanism.bodies)
        return [*range(N), *(N + np.flatnonzero(self.M.diagonal()[N:]))]

    def joint_rows(self) -> tuple[Array, Array]:
        """J and f_t of the joints: the relative twist of parent and child, less what the joint leaves free.

        A prescribed joint leaves nothing free: all six components follow its law. A rotor follows its speed.
        """
        rows, right = [], []
        for parent, child, place, directions, where in self.hinges:
            twist = self.twist(parent, child, place)
            if any(entry.prescribed for entry in self.mechanism.speeds[where]):
                rows.append(twist)
                right.append(-directions @ self.u_t[where])
            else:
                U, _, _ = np.linalg.svd(directions, full_matrices=True)
                across = U[:, directions.shape[1] :].T
                rows.append(across @ twist)
                right.append(np.zeros(len(across)))
            first = 6 * len(self.mechanism.bodies) + where.start
            for k, speed in enumerate(self.speeds[where]):
                if first + k in self.inertial_rows:
                    rows.append(np.eye(len(self.M))[[first + k]] - speed)
                    right.append(np.zeros(1))
        return np.vstack(rows), np.concatenate(right)

    def reactions(self, forces: Array) -> tuple[Array, Array, Array]:
        """Place, force and moment on the child of each joint, from the joints' share of F′ (n,).

        A joint transmits the sum over all bodies beyond it.
        """
        carried: dict[
            str, tuple[Array, Array, Array]
        ] = {}  # force, moment about the mass centre, centre
        for k, body in enumerate(self.mechanism.bodies):
            turned = self.terms["turned"][:, 3 * k :][:, :3]
            own = forces[6 * k : 6 * k + 6]
            carried[body.name] = own[:3], turned @ own[3:], self.terms["x"][:, k]
        reactions: list[tuple[Array, Array, Array]] = []
        for parent, child, place, _, _ in reversed(self.hinges):
            force, moment, centre = carried[child]
            about = moment + np.cross(centre - place, force)
            reactions.append((place, force, about))
            if parent in carried:
                force_beyond, moment, centre = carried[parent]
                moment = moment + about + np.cross(place - centre, force)
                carried[parent] = force_beyond + force, moment, centre
        places, forces, moments = (np.array(x).reshape(-1, 3) for x in zip(*reversed(reactions)))
        return places, forces, moments

    # --- all together ----------------------------------------------------------------------------

    def matrices(self, udot: Array | None, independent: Sequence[str], joints: bool) -> Matrices:
        """All of it, for accelerations `udot` (nu,) or the mechanism's own."""
        m, loops, keep, free = self.mechanism, self.holonomic, self.inertial_rows, self.free
        names = m.speeds.free_names
        check_names(independent, names, "independent: no free speed is called")
        preferred = [names.index(name) for name in dict.fromkeys(independent)]
        inner = self.split(np.ones(len(loops), dtype=bool), preferred)
        # The speeds of û are among those of u: motion constraints only take some of these away.
        outer = self.split(loops, inner.independent)
        R, v_t, R_dot, v_t_dot = self.moving(outer)
        R_hat, v_t_hat, _, _ = self.moving(inner)
        F_V, F_D = self.terms["F_V"].ravel(), self.terms["F_D"].ravel()
        F, P, v = F_V + F_D, self.terms["P"], self.terms["P"] @ self.u
        a = self.udot(F) if udot is None else np.asarray(udot, dtype=float)
        v_dot = self.v_dot(a)
        F_star = -(self.M @ v_dot + self.beta)
        G = self.G_all[:, free]
        force = -P[:, free].T @ (F + F_star)
        lam = np.asarray(np.linalg.lstsq(G.T, force, rcond=1e-9)[0], dtype=float)
        place, force, moment = self.reactions(-(F + F_star) - self.ties.T @ lam)
        tree = self.joint_rows() if joints else (np.zeros((0, len(v))), np.zeros(0))
        components = ("vx", "vy", "vz", "wx", "wy", "wz")
        rows = [f"{body.name}.{component}" for body in m.bodies for component in components]
        rows += [f"rotor {m.speeds[k - len(rows)].name}" for k in keep[len(rows) :]]
        owner = np.array(self.names, dtype=object)
        turned = np.split(self.terms["turned"], len(m.bodies), axis=1)
        x = [np.append(at, rotations.quaternion(E)) for at, E in zip(self.terms["x"].T, turned)]
        u = self.u[free]
        return Matrices(
            t=self.t,
            bodies=tuple(body.name for body in m.bodies),
            rows=tuple(rows),
            joints=tuple(joint.name for joint in m.joints),
            speeds=tuple(names[k] for k in outer.independent),
            speeds_hat=tuple(names[k] for k in inner.independent),
            loop_rows=tuple(owner[loops]),
            motion_rows=tuple(owner[~loops]),
            x=np.concatenate(x),
            u=u[outer.independent],
            u_hat=u[inner.independent],
            v=v[keep],
            v_dot=v_dot[keep],
            B=P[keep],
            R=R[keep],
            v_t=v_t[keep],
            R_dot=R_dot[keep],
            v_t_dot=v_t_dot[keep],
            R_hat=R_hat[keep],
            v_t_hat=v_t_hat[keep],
            J=self.ties[loops][:, keep],
            f_t=self.c[loops],
            A=self.ties[~loops][:, keep],
            b=self.c[~loops],
            J_joints=tree[0][:, keep],
            f_t_joints=tree[1],
            M=self.M[np.ix_(keep, keep)],
            beta=self.beta[keep],
            F_V=F_V[keep],
            F_D=F_D[keep],
            F=F[keep],
            F_star=F_star[keep],
            F_prime=-(F + F_star)[keep],
            F_r=R_hat.T @ F,
            F_r_star=R_hat.T @ F_star,
            udot=a,
            lambda_c=lam[loops],
            lambda_m=lam[~loops],
            reaction_place=place,
            reaction_force=force,
            reaction_moment=moment,
        )
