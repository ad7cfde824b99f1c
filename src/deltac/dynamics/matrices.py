"""The matrices of the energy theorem of one mechanism at one instant, as users see them.

    v = R u + v_t,    J v + f_t = 0          configuration constraints: joints and loops
    v = R̂ û + v̂_t,    A v + b = 0            motion constraints as well
    F + F* + F′ = 0,  F* = −(M v̇ + β)        Newton and Euler, body by body
    R̂ᵀ(F + F*) = 0,   F′ = F′_joints + Jᵀλ_c + Aᵀλ_m

after K. Gugaratshan's thesis, section 2.5, in dense NumPy by the route of `deltac.dynamics.textbook`: no
line of it is shared with the recursions that simulations and ledgers use.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from deltac import rotations
from deltac.arrays import Array
from deltac.dynamics.textbook.constrained import ConstrainedTextbook
from deltac.dynamics.textbook.kinematics import along, is_prescribed
from deltac.errors import InputError, UnknownName, closest
from deltac.mechanism.mechanism import Mechanism

ILL_CHOSEN = 1e-7
"""Dependent speeds that follow from the independent ones only with errors of 1/this are ill chosen."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Matrices:
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

    t: Any
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

    def to_dict(self) -> dict[str, Any]:
        """All of it as lists and numbers, by name."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {n: v.tolist() if isinstance(v, np.ndarray) else v for n, v in values.items()}


def matrices_at(
    mechanism: Mechanism,
    t: float,
    q: Array,
    u: Array,
    *,
    udot: Array | None = None,
    inputs: Mapping[str, Sequence[float]] | None = None,
    independent: Collection[str] = (),
    joints: bool = False,
) -> Matrices:
    """The matrices at the instant (t, q, u) of all joints.

    Args:
        mechanism: any that can be simulated.
        t: time, s.
        q: coordinates of all joints (nq,).
        u: speeds of all joints (nu,), which meet the constraints.
        udot: accelerations (nu,) that F* is taken of; by default those of the mechanism's own motion.
        inputs: values (N or N·m) of motors without a law, by name; zero where not given.
        independent: names of the independent speeds; by default those in which the others are best expressed.
        joints: the constraints of the tree's joints as well.

    Raises:
        InputError: unknown names, and independent speeds that the others do not follow from.
    """
    held: dict[str, Sequence[float]] = {
        motor.name: [0.0] * len(mechanism.joint(motor.joint).speeds) for motor in mechanism.motors
    }
    held.update(inputs or {})
    book = _Book(mechanism, t, q, u, held, tuple(independent))
    return book.matrices(udot, joints)


def stacked(samples: Sequence[Matrices]) -> Matrices:
    """Matrices of one mechanism at several instants as one, samples in front.

    Quaternions in x keep their sign from sample to sample.
    """
    values: dict[str, Any] = {}
    for field in fields(Matrices):
        given = [getattr(sample, field.name) for sample in samples]
        values[field.name] = given[0] if isinstance(given[0], tuple) else np.array(given)
    x = values["x"]
    for k in range(3, x.shape[1], 7):
        turns = np.sign(np.einsum("ij,ij->i", x[1:, k : k + 4], x[:-1, k : k + 4]))
        x[1:, k : k + 4] *= np.cumprod(np.where(turns < 0.0, -1.0, 1.0))[:, None]
    return Matrices(**values)


@dataclass(frozen=True, eq=False)
class Split:
    """Independent speeds u of the joints' free ones: free = U u + z, fixed places, smooth in (q, t)."""

    rows: tuple[int, ...]
    independent: tuple[int, ...]
    dependent: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class _Book(ConstrainedTextbook):
    """The textbook with a choice of independent speeds, and the joints as constraints."""

    independent: tuple[str, ...] = ()

    @cached_property
    def _free_names(self) -> tuple[str, ...]:
        return tuple(self.mechanism.speeds[int(k)].name for k in self.book.free)

    @cached_property
    def _wanted(self) -> tuple[int, ...]:
        """Places of the wanted speeds among the free ones."""
        for name in self.independent:
            if name not in self._free_names:
                near = closest(name, self._free_names)
                raise UnknownName(f"independent: no free speed is called {name!r}{near}")
        return tuple(self._free_names.index(name) for name in dict.fromkeys(self.independent))

    @cached_property
    def _kept(self) -> list[int]:
        """Rows of the stacked vectors: those of bodies, and of rotors that have inertia."""
        N = 6 * len(self.mechanism.bodies)
        return [*range(N), *(N + np.flatnonzero(self.book.M.diagonal()[N:]))]

    # --- independent speeds ----------------------------------------------------------------------

    def _split(self, rows: Array, wanted: Sequence[int]) -> Split:
        """Independent speeds under some rows: those wanted, then those that others best follow from.

        Columns of G are taken by Gaussian elimination with full pivoting, wanted ones last: what is pivoted
        on is dependent.
        """
        p = self.G.shape[1]
        places = np.flatnonzero(rows)
        size = np.linalg.norm(self.G[places], axis=1)
        present = size > 1e-9 * max(1e-300, size.max(initial=0.0))
        places = places[present]
        left = self.G[places] / size[present][:, None]
        columns = [k for k in range(p) if k not in set(wanted)]
        pivots: list[tuple[int, int]] = []
        for allowed in (columns, list(wanted)):
            while len(pivots) < len(places):
                open_rows = [i for i in range(len(places)) if i not in {i for i, _ in pivots}]
                open_columns = [j for j in allowed if j not in {j for _, j in pivots}]
                if not open_rows or not open_columns:
                    break
                block = np.abs(left[np.ix_(open_rows, open_columns)])
                at = np.unravel_index(int(block.argmax()), block.shape)
                if block[at] <= ILL_CHOSEN:
                    break
                i, j = open_rows[int(at[0])], open_columns[int(at[1])]
                if allowed is not columns:
                    asked = ", ".join(self._free_names[k] for k in wanted)
                    raise InputError(
                        f"independent: at t = {self.t:g} s the speeds {asked} are not independent, "
                        f"{self._free_names[j]!r} follows from the others; leave it out"
                    )
                left = (
                    left
                    - np.outer(left[:, j] / left[i, j], left[i])
                    * (np.arange(len(places)) != i)[:, None]
                )
                pivots.append((i, j))
        dependent = tuple(j for _, j in pivots)
        return Split(
            tuple(int(places[i]) for i, _ in pivots),
            tuple(k for k in range(p) if k not in dependent),
            dependent,
        )

    def _free_speeds(self, split: Split, instant: Array) -> Array:
        """[U z] (free, p + 1) at (q, t, speeds of prescribed joints): free speeds = U u + z."""
        nq, free = len(self.q), self.book.free
        q, t, driven = instant[:nq], instant[nq], instant[nq + 1 :]
        count = len(split.independent)
        made = np.zeros((len(free), count + 1), dtype=instant.dtype)
        made[list(split.independent), range(count)] = 1.0
        if split.dependent:
            offset = self._psi(t, q, driven)
            units = np.eye(len(driven), dtype=instant.dtype)[free]
            G = np.array([self._psi(t, q, driven + unit) - offset for unit in units]).T
            rows = list(split.rows)
            right = np.column_stack([G[np.ix_(rows, list(split.independent))], offset[rows]])
            left = G[np.ix_(rows, list(split.dependent))]
            made[list(split.dependent)] = -np.linalg.solve(left, right)
        return made

    def _moving(self, split: Split) -> tuple[Array, Array, Array, Array]:
        """R, v_t and their rates."""
        b = self.book
        here = np.concatenate([b.q, [b.t], b.u_t])
        rate = np.concatenate([b.q_dot, [1.0], b.udot_t])
        made = self._free_speeds(split, here)
        made_dot = along(lambda instant: self._free_speeds(split, instant).ravel(), here, rate)
        made_dot = made_dot.reshape(made.shape)
        count = len(split.independent)
        all_speeds, all_dot = np.zeros((2, len(b.u), count + 1))
        all_speeds[b.free], all_dot[b.free] = made, made_dot
        all_speeds[:, count] += b.u_t
        all_dot[:, count] += b.udot_t
        both = b.P @ all_speeds
        both_dot = b.P @ all_dot + b.P_dot @ all_speeds
        return both[:, :count], both[:, count], both_dot[:, :count], both_dot[:, count]

    # --- joints of the tree ----------------------------------------------------------------------

    @cached_property
    def _hinges(self) -> list[tuple[str, str, str, Array, Array, slice]]:
        """Joint, parent, child, place of its frame on the child, its directions (6, n), its speeds."""
        m, moved = self.mechanism, self.book.tree.moved
        found = []
        for joint in m.joints:
            place, G_v, G_w = moved[joint.name]
            directions = np.vstack([G_v, G_w])
            found.append(
                (joint.name, joint.parent, joint.child, place, directions, m.speeds.of(joint.name))
            )
        return found

    def _twist(self, parent: str, child: str, place: Array) -> Array:
        """Relative twist (6, n) of a child and its parent at a place, from the velocities v of bodies."""
        first, second = (self._apart[body] for body in (parent, child))
        linear = second.partial_velocity(place) - first.partial_velocity(place)
        return np.vstack([linear, second.P_w - first.P_w])

    @cached_property
    def _speeds(self) -> Array:
        """The joints' speeds (nu, n) from the velocities v of bodies."""
        found = [
            np.linalg.pinv(directions) @ self._twist(parent, child, place)
            for _, parent, child, place, directions, _ in self._hinges
        ]
        return np.vstack(found)

    @cached_property
    def _ties(self) -> Array:
        """J and A row by row, on bodies alone: laws in joint speeds (gears, say) act through the twists."""
        N = 6 * len(self.mechanism.bodies)
        ties = self.B + self.B[:, N:] @ self._speeds
        ties[:, N:] = 0.0
        return ties

    def _joint_rows(self) -> tuple[Array, Array]:
        """J and f_t of the joints: the relative twist of parent and child, less what the joint leaves free.

        A prescribed joint leaves nothing free: all six components follow its law. A rotor follows its speed.
        """
        b = self.book
        driven = is_prescribed(b.mechanism)
        rows, right = [], []
        for _, parent, child, place, directions, where in self._hinges:
            twist = self._twist(parent, child, place)
            if bool(driven[where].any()):
                rows.append(twist)
                right.append(-directions @ b.u_t[where])
            else:
                U, _, _ = np.linalg.svd(directions, full_matrices=True)
                across = U[:, directions.shape[1] :].T
                rows.append(across @ twist)
                right.append(np.zeros(len(across)))
            first = 6 * len(b.mechanism.bodies) + where.start
            for k, speed in enumerate(self._speeds[where]):
                if first + k in self._kept:
                    rows.append(np.eye(len(b.M))[[first + k]] - speed)
                    right.append(np.zeros(1))
        return np.vstack(rows), np.concatenate(right)

    def _reactions(self, forces: Array) -> tuple[Array, Array, Array]:
        """Place, force and moment on the child of each joint, from the joints' share of F′ (n,).

        What the joint nearest to the ground passes on is the sum over all bodies beyond it.
        """
        b, m = self.book, self.mechanism
        index = {body.name: k for k, body in enumerate(m.bodies)}
        force = {name: forces[6 * k : 6 * k + 3] for name, k in index.items()}
        moment = {name: b.turned[k] @ forces[6 * k + 3 : 6 * k + 6] for name, k in index.items()}
        centre = {name: b.x[k] for name, k in index.items()}
        found: dict[str, tuple[Array, Array, Array]] = {}
        for name, parent, child, place, _, _ in reversed(self._hinges):
            passed = force[child]
            about = moment[child] + np.cross(centre[child] - place, passed)
            found[name] = (place, passed, about)
            if parent in index:
                force[parent] = force[parent] + passed
                moment[parent] = moment[parent] + about + np.cross(place - centre[parent], passed)
        ordered = [found[name] for name, *_ in self._hinges]
        places, passed_on, moments = (
            np.array([entry[k] for entry in ordered]).reshape(-1, 3) for k in range(3)
        )
        return places, passed_on, moments

    # --- all together ----------------------------------------------------------------------------

    def matrices(self, udot: Array | None, joints: bool) -> Matrices:
        """All of it, for accelerations `udot` (nu,) or the mechanism's own."""
        b, m = self.book, self.mechanism
        loops = self.holonomic
        inner = self._split(np.ones(len(loops), dtype=bool), self._wanted)
        # The speeds of û are among those of u: motion constraints only take some of these away.
        outer = self._split(loops, inner.independent)
        R, v_t, R_dot, v_t_dot = self._moving(outer)
        R_hat, v_t_hat, _, _ = self._moving(inner)
        a = self.udot if udot is None else np.asarray(udot, dtype=float)
        v_dot, F_star, F_prime = b.v_dot(a), b.F_star(a), b.F_prime(a)
        lam = self.multipliers(a)
        place, force, moment = self._reactions(F_prime - self._ties.T @ lam)
        tree = self._joint_rows() if joints else (np.zeros((0, len(b.M))), np.zeros(0))
        keep, names, free_u = self._kept, self._free_names, b.u[b.free]
        components = ("vx", "vy", "vz", "wx", "wy", "wz")
        parts = [f"{body.name}.{component}" for body in m.bodies for component in components]
        N = len(parts)
        parts += [f"rotor {m.speeds[k - N].name}" for k in keep[N:]]
        owner = np.array(self.names, dtype=object)
        return Matrices(
            t=self.t,
            bodies=tuple(body.name for body in m.bodies),
            rows=tuple(parts),
            joints=tuple(joint.name for joint in m.joints),
            speeds=tuple(names[k] for k in outer.independent),
            speeds_hat=tuple(names[k] for k in inner.independent),
            loop_rows=tuple(owner[loops]),
            motion_rows=tuple(owner[~loops]),
            x=np.concatenate(
                [np.append(at, rotations.quaternion(E)) for at, E in zip(b.x, b.turned)]
            ),
            u=free_u[list(outer.independent)],
            u_hat=free_u[list(inner.independent)],
            v=b.v[keep],
            v_dot=v_dot[keep],
            B=b.P[keep],
            R=R[keep],
            v_t=v_t[keep],
            R_dot=R_dot[keep],
            v_t_dot=v_t_dot[keep],
            R_hat=R_hat[keep],
            v_t_hat=v_t_hat[keep],
            J=self._ties[loops][:, keep],
            f_t=self.c[loops],
            A=self._ties[~loops][:, keep],
            b=self.c[~loops],
            J_joints=tree[0][:, keep],
            f_t_joints=tree[1],
            M=b.M[np.ix_(keep, keep)],
            beta=b.beta[keep],
            F_V=b.F_V[keep],
            F_D=b.F_D[keep],
            F=b.F[keep],
            F_star=F_star[keep],
            F_prime=F_prime[keep],
            F_r=R_hat.T @ b.F,
            F_r_star=R_hat.T @ F_star,
            udot=a,
            lambda_c=lam[loops],
            lambda_m=lam[~loops],
            reaction_place=place,
            reaction_force=force,
            reaction_moment=moment,
        )
