"""Spatial vector algebra (Featherstone 2008, chapter 2) on CasADi matrices.

A motion vector is V = (ω; v), a force vector F = (n; f): angular part first, v and n taken at the
frame's origin. `Transform` carries them between frames.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, wraps
from typing import Any, TypeAlias

import casadi as ca

SX: TypeAlias = Any
"""A CasADi SX matrix (CasADi has no type stubs)."""


def inlined(operation: Callable[..., Any]) -> Callable[..., Any]:
    """An operation on matrices, transforms and inertias, written out once for each of their shapes.

    Recursions make thousands of them: a call of a CasADi function costs as much as a single operation.
    """

    @cache
    def written(kinds: tuple[_Kind, ...]) -> tuple[Any, _Kind]:
        symbols = [[ca.SX.sym("x", *shape) for shape in kind.shapes] for kind in kinds]
        result = _parts(operation(*(kind.whole(x) for kind, x in zip(kinds, symbols))))
        return ca.Function("inlined", sum(symbols, start=[]), result.matrices), result.kind

    @wraps(operation)
    def called(*arguments: Any) -> Any:
        parts = [_parts(x) for x in arguments]
        function, kind = written(tuple(p.kind for p in parts))
        return kind.whole(function.call([x for p in parts for x in p.matrices]))

    return called


@dataclass(frozen=True)
class _Kind:
    """What matrices of these shapes make: an object of a class with `of`, or a matrix alone."""

    shapes: tuple[tuple[int, int], ...]
    owner: Any = None
    more: Any = None

    def whole(self, matrices: list[SX]) -> Any:
        """The object."""
        return self.owner.of(self.more, *matrices) if self.owner else matrices[0]


@dataclass(frozen=True, eq=False)
class _Parts:
    """An argument or a result, taken apart."""

    matrices: list[SX]
    kind: _Kind


def _parts(x: Any) -> _Parts:
    return x.parts if isinstance(x, Inertia | Transform) else _Parts([x], _Kind((x.shape,)))


def cross(a: SX, b: SX) -> SX:
    """The vector product of two 3-vectors."""
    return ca.cross(a, b)


@inlined
def cross_motion(V: SX, W: SX) -> SX:
    """V × W of two motion vectors: the rate of W when it is fixed in a frame that moves with V."""
    return ca.vertcat(cross(V[:3], W[:3]), cross(V[:3], W[3:]) + cross(V[3:], W[:3]))


@inlined
def cross_force(V: SX, F: SX) -> SX:
    """V ×* F: the rate of a force vector that is fixed in a frame that moves with V."""
    return ca.vertcat(cross(V[:3], F[:3]) + cross(V[3:], F[3:]), cross(V[:3], F[3:]))


def axis_rotation(axis: Sequence[float], angle: SX) -> SX:
    """R whose columns are axes turned by `angle` about the unit vector `axis` (Rodrigues).

    Written as a aᵀ + c (1 − a aᵀ) + s a×, so that zeros and ones of a coordinate axis stay constants.
    """
    a = ca.DM(list(axis))
    along = ca.mtimes(a, a.T)
    return along + ca.cos(angle) * (ca.DM.eye(3) - along) + ca.sin(angle) * ca.skew(a)


def quaternion_rotation(q: SX) -> SX:
    """R of the quaternion q/|q|, scalar first; body to parent components."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    s = 2 / ca.dot(q, q)
    return ca.vertcat(
        ca.horzcat(1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)),
        ca.horzcat(s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x)),
        ca.horzcat(s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y)),
    )


def quaternion_rates(q: SX) -> SX:
    """The matrix W (4 by 3) of q̇ = W ω, ω in body components."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    return 0.5 * ca.vertcat(
        ca.horzcat(-x, -y, -z), ca.horzcat(w, -z, y), ca.horzcat(z, w, -x), ca.horzcat(-y, x, w)
    )


@dataclass(frozen=True)
class Turn:
    """Components in axes turned about one of their own (`axis` 0, 1, 2); `c`, `s`: cosine and sine.

    A rotation written as turns costs half of what its matrix does: 6 instead of 15 operations for a
    vector, 10 to 25 instead of 75 to 90 for a matrix (Featherstone 2008, appendix A.4).
    """

    axis: int
    c: Any
    s: Any

    @property
    def places(self) -> tuple[int, int, int]:
        """The two axes that turn, and the one that stays."""
        return (self.axis + 1) % 3, (self.axis + 2) % 3, self.axis

    @property
    def matrix(self) -> SX:
        """E with v′ = E v."""
        i, j, k = self.places
        E = ca.SX(3, 3)
        E[i, i], E[i, j], E[j, i], E[j, j], E[k, k] = self.c, self.s, -self.s, self.c, 1
        return E

    @property
    def back(self) -> Turn:
        """The inverse turn."""
        return Turn(self.axis, self.c, -self.s)

    def then(self, after: Turn) -> Turn:
        """This turn and another one about the same axis, as one."""
        return Turn(
            self.axis,
            self.c * after.c - self.s * after.s,
            self.s * after.c + self.c * after.s,
        )

    def __matmul__(self, v: SX) -> SX:
        """E v, 3 by any number."""
        return _turned(self.axis, v.shape[1])(self.c, self.s, v)

    def matrix_back(self, A: SX, symmetric: bool) -> SX:
        """Eᵀ A E."""
        return _turned_back(self.axis, symmetric)(self.c, self.s, A)


# Recursions turn thousands of vectors: a call of a CasADi function costs as much as a single operation.


@cache
def _turned(axis: int, columns: int) -> Any:
    """(c, s, v) -> E v of a `Turn`."""
    c, s, v = ca.SX.sym("c"), ca.SX.sym("s"), ca.SX.sym("v", 3, columns)
    i, j, _ = Turn(axis, c, s).places
    rows = ca.vertsplit(v)
    rows[i], rows[j] = c * rows[i] + s * rows[j], c * rows[j] - s * rows[i]
    return ca.Function("turned", [c, s, v], [ca.vertcat(*rows)])


@cache
def _turned_back(axis: int, symmetric: bool) -> Any:
    """(c, s, A) -> Eᵀ A E of a `Turn`."""
    c, s, A = ca.SX.sym("c"), ca.SX.sym("s"), ca.SX.sym("A", 3, 3)
    turn = Turn(axis, c, s)
    i, j, k = turn.places
    B, back = ca.SX(A), turn.back
    half = s * (A[j, j] - A[i, i]) - c * (A[i, j] + A[j, i])
    B[i, i], B[j, j] = A[i, i] + s * half, A[j, j] - s * half
    B[i, j] = -c * half - A[j, i]
    B[j, i] = B[i, j] if symmetric else -c * half - A[i, j]
    column = back @ A[:, k]
    row = column if symmetric else back @ A[k, :].T
    for n in (i, j):
        B[n, k], B[k, n] = column[n], row[n]
    return ca.Function("turned_back", [c, s, A], [B])


@dataclass(frozen=True)
class Transform:
    """From a frame A to a frame B: `E` turns A's components into B's, `r` is B's origin in A.

    `turns`, where known, are the same rotation as E, first one first.
    """

    E: SX
    r: SX
    turns: tuple[Turn, ...] | None = None

    @staticmethod
    def of(axes: tuple[int, ...] | None, r: SX, *rotation: SX) -> Transform:
        """By r, and by E or by cosines and sines of turns about these axes."""
        if axes is None:
            return Transform(rotation[0], r)
        turns = (Turn(axis, *rotation[2 * k : 2 * k + 2]) for k, axis in enumerate(axes))
        return Transform(None, r, tuple(turns))

    @cached_property
    def parts(self) -> _Parts:
        """What `of` takes."""
        if self.turns is None:
            return _Parts([self.r, self.E], _Kind(((3, 1), (3, 3)), Transform))
        rotation = [ca.SX(x) for turn in self.turns for x in (turn.c, turn.s)]
        axes = tuple(turn.axis for turn in self.turns)
        shapes = ((3, 1), *[(1, 1)] * len(rotation))
        return _Parts([self.r, *rotation], _Kind(shapes, Transform, axes))

    def rotate(self, v: SX) -> SX:
        """E v, 3 by any number."""
        if self.turns is None:
            return ca.mtimes(self.E, v)
        for turn in self.turns:
            v = turn @ v
        return v

    def rotate_back(self, v: SX) -> SX:
        """Eᵀ v, 3 by any number."""
        if self.turns is None:
            return ca.mtimes(self.E.T, v)
        for turn in reversed(self.turns):
            v = turn.back @ v
        return v

    def _matrix_back(self, A: SX, symmetric: bool) -> SX:
        """Eᵀ A E."""
        if self.turns is None:
            product = ca.mtimes(self.E.T, ca.mtimes(A, self.E))
            return _symmetric(product) if symmetric else product
        for turn in reversed(self.turns):
            A = turn.matrix_back(A, symmetric)
        return A

    @inlined
    def __matmul__(self, V: SX) -> SX:
        """Motion vectors (6 by any number): X V."""
        w, v = V[:3, :], V[3:, :]
        return ca.vertcat(self.rotate(w), self.rotate(v - ca.mtimes(ca.skew(self.r), w)))

    def then(self, after: Transform) -> Transform:
        """The transform from A to C, `after` being the one from B to C."""
        turns = None
        if self.turns is not None and after.turns is not None:
            turns = _joined(self.turns, after.turns)
        return Transform(ca.mtimes(after.E, self.E), self.r + ca.mtimes(self.E.T, after.r), turns)

    @inlined
    def force_back(self, F: SX) -> SX:
        """A force vector from B back to A: Xᵀ F."""
        n, f = self.rotate_back(F[:3]), self.rotate_back(F[3:])
        return ca.vertcat(n + cross(self.r, f), f)

    @inlined
    def inertia_back(self, inertia: Inertia) -> Inertia:
        """A (possibly articulated) inertia from B back to A: Xᵀ I X (Featherstone 2008, table 2.2)."""
        r = ca.skew(self.r)
        J = self._matrix_back(inertia.J, True)
        H = self._matrix_back(inertia.H, False)
        M = self._matrix_back(inertia.M, True)
        H_moved = H + ca.mtimes(r, M)
        return Inertia(_symmetric(J - ca.mtimes(H_moved, r) + ca.mtimes(r, H.T)), H_moved, M)


def _joined(first: tuple[Turn, ...], after: tuple[Turn, ...]) -> tuple[Turn, ...]:
    """Turns in a row; neighbours about the same axis are one."""
    if first and after and first[-1].axis == after[0].axis:
        return (*first[:-1], first[-1].then(after[0]), *after[1:])
    return (*first, *after)


@dataclass(frozen=True)
class Inertia:
    """A symmetric spatial inertia in 3 by 3 blocks: n = J ω + H v, f = Hᵀ ω + M v."""

    J: SX
    H: SX
    M: SX

    @staticmethod
    def of(_: None, J: SX, H: SX, M: SX) -> Inertia:
        """By its blocks."""
        return Inertia(J, H, M)

    @property
    def parts(self) -> _Parts:
        """What `of` takes."""
        return _Parts([self.J, self.H, self.M], _Kind(((3, 3),) * 3, Inertia))

    @inlined
    def __matmul__(self, V: SX) -> SX:
        """The force (momentum) vectors I V, 6 by any number."""
        w, v = V[:3, :], V[3:, :]
        return ca.vertcat(
            ca.mtimes(self.J, w) + ca.mtimes(self.H, v),
            ca.mtimes(self.H.T, w) + ca.mtimes(self.M, v),
        )

    def __add__(self, other: Inertia) -> Inertia:
        return Inertia(self.J + other.J, self.H + other.H, self.M + other.M)

    def without(self, place: int) -> Inertia:
        """The same without its row and column of a coordinate (0 to 5), which are zero but for rounding."""
        J, H, M = (ca.SX(block) for block in (self.J, self.H, self.M))
        block, k = (J, place) if place < 3 else (M, place - 3)
        block[k, :], block[:, k] = 0, 0
        if place < 3:
            H[k, :] = 0
        else:
            H[:, k] = 0
        return Inertia(J, H, M)

    @inlined
    def minus_outer(self, U: SX, V: SX) -> Inertia:
        """I − U Vᵀ for 6 by n factors whose product is symmetric."""
        return Inertia(
            _symmetric(self.J - ca.mtimes(U[:3, :], V[:3, :].T)),
            self.H - ca.mtimes(U[:3, :], V[3:, :].T),
            _symmetric(self.M - ca.mtimes(U[3:, :], V[3:, :].T)),
        )


@inlined
def gyroscopic_force(inertia: Inertia, V: SX) -> SX:
    """V ×* (I V) of a rigid body, without m v × v: zero, but for rounding that turns a fast satellite."""
    w, v = V[:3], V[3:]
    from_turning = ca.mtimes(inertia.H.T, w)
    angular = ca.mtimes(inertia.J, w) + ca.mtimes(inertia.H, v)
    linear = from_turning + ca.mtimes(inertia.M, v)
    return ca.vertcat(cross(w, angular) + cross(v, from_turning), cross(w, linear))


def rigid_inertia(mass: SX, centre: SX, central: SX) -> Inertia:
    """Inertia of a rigid body about the origin; `centre` its mass centre, `central` about that."""
    c = ca.skew(centre)
    return Inertia(central + mass * ca.mtimes(c, c.T), mass * c, mass * ca.SX.eye(3))


def _symmetric(A: SX) -> SX:
    """The upper triangle mirrored: the lower one is never computed."""
    return ca.triu2symm(ca.triu(ca.densify(A)))
