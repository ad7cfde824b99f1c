"""Columns of the geometry: what small changes of places, axes and lengths do to the equations of motion.

A joint that sits elsewhere, or is turned, is one more joint beside it that rests at a small coordinate. Its
column is the derivative of F_r + F*_r with respect to that: with its motion subspace ξ and the velocity v
and acceleration a of the body that carries it (gravity in it), all bodies beyond have velocities larger by
ψ̇ = v × ξ and accelerations larger by ψ̈ = a × ξ + v × ψ̇, in their own frames, and their forces act on the
bodies before from another place, ξ ×* f. So one sweep over the tree gives all columns. Force elements and
constraints are differentiated body by body, as laws of poses and velocities of bodies that nothing joins.

S. Singh, R. P. Russell, P. M. Wensing, IEEE Robot. Autom. Lett. 7 (2022) 1776-1783.

Numbers of elements and constraints (lengths, points, radii, ratios) and named parameters of the mechanism are
kept as symbols and differentiated directly.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from deltac.arrays import EPS, Array
from deltac.diagnosis.causes.columns import (
    Column,
    ColumnKernels,
    Elements,
    LogEquations,
    What,
    computes_weight,
)
from deltac.dynamics.constraints import constraint_rows
from deltac.dynamics.forces import channels
from deltac.dynamics.laws import Varied
from deltac.dynamics.recursions import accelerations, rnea, velocities
from deltac.dynamics.scene import TracedScene
from deltac.dynamics.spatial import SX, Transform, cross_force
from deltac.dynamics.system import System, trace
from deltac.mechanism.channels import Channel
from deltac.mechanism.forces import Tendon
from deltac.mechanism.joints import Joint
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.parts import Part
from deltac.mechanism.polynomials import Polynomial


@dataclass(frozen=True)
class Change:
    """What one unit of a change adds: to F_r + F*_r with the multipliers as they are (n,), and to ψ̇ (nc,)."""

    force: SX
    acceleration: SX


def geometry_columns(equations: LogEquations, some: Elements = None) -> ColumnKernels:
    """The columns of joints' places, of numbers of elements and constraints, and of parameters.

    They are called as other columns are. The first one is M (u̇ of the model − u̇), and the others are the
    derivatives of that: M ∂u̇/∂θ. Without constraints these are F_r + F*_r and its derivative at the given u̇.
    With constraints M ∂u̇/∂θ = x + Gᵀδλ and G ∂u̇/∂θ = −(δG u̇ + δγ), where x = δ(F_r + F*_r) + δGᵀ λ: exact
    where the equations close, else to first order in the residual.
    """
    symbols = equations.symbols
    s, bound = symbols.system, symbols.constrained
    if symbols.with_measured is not None:
        bound = None  # forces of constraints are those of the log
    multipliers = ca.SX(0, 1) if bound is None else symbols.reactions.multipliers
    index = () if bound is None else bound.rows.index
    changes: dict[Column, Change] = {}
    for part, own in GEOMETRY_PARTS.items():
        if some is None or any(what in own for what, _ in some):
            every = part(equations, multipliers, index)
            changes.update((c, x) for c, x in every if some is None or c.of in some)
    force = sum((p.force for p in symbols.parts), start=ca.SX.zeros(s.u_all.shape[0]))
    first = Change(
        (force - rnea(s, symbols.udot))[s.free_u],
        ca.SX(0, 1) if bound is None else bound.rows.gamma + ca.mtimes(bound.rows.G, s.udot),
    )
    columns = []
    for change in (first, *changes.values()):
        x = change.force
        if bound is not None:
            reaction = bound.schur.multipliers(x, change.acceleration)
            x = x + ca.mtimes(bound.rows.G.T, reaction)
        columns.append(x)
    if symbols.with_measured is not None and symbols.constrained is not None:
        G = symbols.constrained.rows.G
        columns[0] += ca.mtimes(G.T, symbols.reactions.multipliers)
    rates = [ca.SX.sym(name, symbols.logged.shape[0]) for name in ("rate", "curve")]
    inputs = (s.t, s.q, s.u, s.udot, symbols.logged, *rates)
    return ColumnKernels(tuple(changes), len(s.free_u), ca.horzcat(*columns), inputs)


def _own(equations: LogEquations, parts: Sequence[Channel]) -> list[SX]:
    """Generalized forces of channels that neither the log holds nor gravity makes."""
    return [
        p.force
        for p in parts
        if not p.logged and p.name not in equations.log.places and p.name != "gravity"
    ]


# --- places of joints ---------------------------------------------------------------------------------


def _joints(
    equations: LogEquations, multipliers: SX, index: Sequence[int]
) -> Iterator[tuple[Column, Change]]:
    """Displacements of each joint in its parent, and of each body on its joint: one sweep, tip to root."""
    s = equations.symbols.system
    nu = s.u_all.shape[0]
    base = ca.vertcat(ca.SX.zeros(3), -s.gravity) if computes_weight(equations) else None
    V = velocities(s, s.u_all)
    A = accelerations(s, V, equations.symbols.udot, base)
    J = _jacobians(s)
    loose = _LooseBodies.of(equations, V, J, multipliers, index)
    still, ground = ca.SX(6, 1), ca.SX(6, 1) if base is None else base
    carried: list[_Carried] = []
    for k, link in enumerate(s.links):
        momentum = link.inertia @ V[k]
        inertia = link.inertia @ ca.SX.eye(6)
        over = _cross_motion(V[k])
        coriolis = _force_crosses(momentum) - ca.mtimes(over.T, inertia) - ca.mtimes(inertia, over)
        wrench = link.inertia @ A[k] + cross_force(V[k], momentum) - loose.wrenches[k]
        nothing = ca.SX(len(index), 6)
        rows = _Rows(
            loose.by_place[k],
            loose.by_velocity[k] - ca.vertcat(ca.mtimes(J[k].T, coriolis), nothing),
            -ca.vertcat(ca.mtimes(J[k].T, inertia), nothing),
        )
        carried.append(_Carried(rows, wrench))
    along, rates = ca.vertcat(s.q, s.u, s.t), ca.vertcat(s.qdot, s.udot, 1)
    for k in reversed(range(len(s.links))):
        link, own_rows = s.links[k], carried[k]
        back = own_rows.seen_through(link.X)
        before = link.parent
        v, a = (V[before], A[before]) if before >= 0 else (still, ground)
        moves: tuple[tuple[What, int, _Carried, SX, SX], ...] = (
            ("body-place", k, own_rows, V[k], A[k]),
            ("joint-place", before, back, v, a),
        )
        for what, start, side, v, a in moves:
            if what == "body-place" and not _has_place_of_its_own(s, k):
                continue
            effect = side.rows.of(v, a)
            force = effect[:nu, :]
            if start >= 0:  # the wrench acts on what comes before from another place
                force = force - ca.mtimes(J[start].T, _force_crosses(side.wrench))
            force = force[s.free_u, :]
            psi = ca.vec(ca.densify(effect[nu:, :]))
            rate = ca.reshape(ca.jtimes(psi, along, rates), len(index), 6)
            for n in range(6):
                column = Column(what, link.joint.name, n)
                change = Change(force[:, n], rate[:, n])
                if not (ca.SX(change.force).is_zero() and ca.SX(change.acceleration).is_zero()):
                    yield column, change
        if before >= 0:
            carried[before] = carried[before] + back


@dataclass(frozen=True)
class _Rows:
    """What displacements, velocities and accelerations (6) of a link add to generalized forces and to ψ."""

    place: SX
    velocity: SX
    acceleration: SX

    def of(self, v: SX, a: SX) -> SX:
        """What displacements (6) of all that is carried add, relative to a body with motion v, a."""
        over = _cross_motion(
            v
        )  # ψ̇ = v × ξ, ψ̈ = a × ξ + v × ψ̇, from the left: rows are fewer than products
        of_rate = self.velocity + ca.mtimes(self.acceleration, over)
        of_place = self.place + ca.mtimes(of_rate, over)
        return of_place + ca.mtimes(self.acceleration, _cross_motion(a))


@dataclass(frozen=True)
class _Carried:
    """A link with all that it carries: what moving them does, and the wrench that they need."""

    rows: _Rows
    wrench: SX

    def __add__(self, other: _Carried) -> _Carried:
        own, more = self.rows, other.rows
        rows = _Rows(
            own.place + more.place,
            own.velocity + more.velocity,
            own.acceleration + more.acceleration,
        )
        return _Carried(rows, self.wrench + other.wrench)

    def seen_through(self, X: Transform) -> _Carried:
        """The same in the frame that X leads from."""

        def back(rows: SX) -> SX:
            return _back(X, rows.T).T

        rows = self.rows
        in_parent = _Rows(back(rows.place), back(rows.velocity), back(rows.acceleration))
        return _Carried(in_parent, _back(X, self.wrench))


def _back(X: Transform, F: SX) -> SX:
    """Force vectors (6 by any number) from the frame that X leads to back to the one that it leads from."""
    n, f = X.rotate_back(F[:3, :]), X.rotate_back(F[3:, :])
    return ca.vertcat(n + ca.mtimes(ca.skew(X.r), f), f)


def _jacobians(s: System) -> list[SX]:
    """J (6, nu) of each link: its velocity is J u."""
    jacobians: list[SX] = []
    for link in s.links:
        J = ca.SX(6, s.u_all.shape[0]) if link.parent < 0 else link.X @ jacobians[link.parent]
        if link.S.shape[1]:
            J[:, link.u] = link.S
        jacobians.append(ca.sparsify(J))
    return jacobians


def _cross_motion(V: SX) -> SX:
    """The matrix of V × of motion vectors."""
    w, v = ca.skew(V[:3]), ca.skew(V[3:])
    return ca.blockcat([[w, ca.SX(3, 3)], [v, w]])


def _force_crosses(F: SX) -> SX:
    """The matrix that takes motion vectors V to V ×* F."""
    n, f = ca.skew(F[:3]), ca.skew(F[3:])
    return -ca.blockcat([[n, f], [f, ca.SX(3, 3)]])


def _has_place_of_its_own(s: System, k: int) -> bool:
    """Whether a body's place on its joint is none of another joint's: massless bodies carry one joint."""
    link = s.links[k]
    body = link.joint.child
    if link.joint.kind in ("fixed", "free"):
        return False
    return not (s.mechanism.body(body).massless and len(s.mechanism.children[body]) == 1)


def displacements(s: System, joint: Joint) -> tuple[Array, Array]:
    """Columns of "joint-place" and "body-place" (6, 6 each) of unit displacements of a joint.

    Three translations along axes of the body, then three small rotations about them through the joint: of the
    joint in its parent along the parent's axes, and of the child on its joint along the child's axes.
    """
    link = s.links[s.index[joint.child]]
    position, child = (
        np.array([s.mechanism.number(x) for x in place])
        for place in (joint.position, joint.child_position)
    )
    parent = Transform(ca.SX.eye(3), ca.SX.zeros(3))
    if link.parent >= 0:
        parent = s.links[link.parent].to_body
    return _displacements(parent, position), _displacements(link.to_body, child)


def _displacements(to_body: Transform, place: Array) -> Array:
    E, r = (np.array(ca.evalf(ca.densify(ca.SX(x)))) for x in (to_body.E, to_body.r))
    axes, at = E.T, r.ravel() + E.T @ place
    motion = np.zeros((6, 6))
    motion[3:, :3] = motion[:3, 3:] = axes
    motion[3:, 3:] = np.cross(at, axes, axisa=0, axisb=0, axisc=0)
    motion[np.abs(motion) < 4.0 * EPS] = (
        0.0  # turned frames leave rounding where planar motion has zeros
    )
    return motion


# --- force elements and constraints, as laws of bodies that nothing joins -------------------------------


@dataclass(frozen=True)
class _LooseBodies:
    """What force elements and constraints do to a mechanism whose bodies are displaced each by itself.

    `wrenches` (6,) act on each link; `by_place` and `by_velocity` (nu + nc, 6) are the derivatives of
    generalized forces and of ψ along displacements and velocities of each link, in its frame.
    """

    wrenches: list[SX]
    by_place: list[SX]
    by_velocity: list[SX]

    @staticmethod
    def of(
        equations: LogEquations,
        V: Sequence[SX],
        jacobians: Sequence[SX],
        multipliers: SX,
        index: Sequence[int],
    ) -> _LooseBodies:
        """Those of a mechanism whose links have the velocities `V` and these Jacobians."""
        s = equations.symbols.system
        count, nu = len(s.links), s.u_all.shape[0]
        E = [ca.SX.sym("E", 3, 3) for _ in s.links]
        r = [ca.SX.sym("r", 3) for _ in s.links]
        v, factor = ca.SX.sym("v", 6 * count), ca.SX.sym("lambda", len(index))
        links = tuple(
            replace(
                link, parent=-1, X=Transform(E[k], r[k]), S=ca.SX.eye(6),
                u=slice(nu + 6 * k, nu + 6 * k + 6),
            )
            for k, link in enumerate(s.links)
        )  # fmt: skip
        scene = TracedScene(replace(s, links=links, u_all=ca.vertcat(s.u_all, v)))
        total = ca.SX.zeros(nu + 6 * count)
        for element in s.mechanism.elements:
            total += sum(_own(equations, element.channels(scene)))
        place = ca.vertcat(*(ca.vertcat(ca.vec(e), o) for e, o in zip(E, r)))
        turned = [_of_pose(e) for e in E]
        directions = ca.vertcat(*(ca.mtimes(T, v[6 * k : 6 * k + 6]) for k, T in enumerate(turned)))
        rows = list[SX]()
        for constraint in s.mechanism.constraints if len(index) else ():
            for phi in constraint.positions(scene):
                along, rates = ca.vertcat(place, s.q, s.t), ca.vertcat(directions, s.qdot, 1)
                rows.append(ca.jtimes(phi, along, rates))
            rows += constraint.motions(scene)
        psi = ca.vertcat(ca.SX(0, 1), *rows)[list(index)]
        total[nu:] += ca.mtimes(ca.jacobian(psi, v).T, factor)
        both = ca.vertcat(total, psi)
        J = ca.jacobian(both, ca.vertcat(place, v))
        of_place = [ca.mtimes(J[:, 12 * k : 12 * k + 12], turned[k]) for k in range(count)]
        of_velocity = [J[:, 12 * count + 6 * k :][:, :6] for k in range(count)]
        zero = ca.vertcat(
            *(ca.vertcat(ca.vec(pose.E), pose.r) for pose in s.poses), *V, multipliers
        )
        wrenches, *derivatives = ca.substitute(
            [total[nu:], *of_place, *of_velocity],
            [ca.vertcat(place, v, factor)],
            [ca.densify(zero)],
        )

        def generalized(part: SX) -> SX:
            """Rows of joints' speeds and of ψ, from those of joints, links and ψ."""
            forces = part[:nu, :]
            for k in range(count):
                block = ca.sparsify(part[nu + 6 * k : nu + 6 * k + 6, :])
                if block.nnz():
                    forces = forces + ca.mtimes(jacobians[k].T, block)
            return ca.vertcat(forces, part[nu + 6 * count :, :])

        forces = [generalized(ca.sparsify(part)) for part in derivatives]
        return _LooseBodies(ca.vertsplit(wrenches, 6), forces[:count], forces[count:])


def _of_pose(E: SX) -> SX:
    """Rates (12, 6) of the entries of E and of r along displacements or velocities of a link in its frame."""
    turn = ca.vertcat(*(ca.skew(E[:, k]) for k in range(3)))
    return ca.blockcat([[turn, ca.SX(9, 3)], [ca.SX(3, 3), E.T]])


# --- numbers of elements and constraints -----------------------------------------------------------------

POINTS = {"point": "body", "point1": "body1", "point2": "body2", "centre": "body"}
"""Fields of points, and the fields of the bodies in whose frames they are."""

SIZES = ("radius", "tube", "length", "size")
LAWS = ("angle", "law", "equations")


@dataclass(frozen=True)
class Number:
    """A number of the geometry of an element or constraint.

    address    its name, as of `Mechanism.numbers` where it is there: ``force.cord.length``
    kind       of the cause that it is another one
    part       the element, as messages call it
    what       the number in words
    body       in whose frame it is a component, if it is one; `axis` which, else empty
    """

    address: str
    kind: str
    part: str
    what: str
    value: float
    symbol: SX
    body: str = ""
    axis: str = ""


class _Opened:
    """Copies of parts in which the numbers of their geometry are symbols."""

    def __init__(self) -> None:
        self.numbers: list[Number] = []
        self.values: dict[str, SX] = {}

    def part(self, part: Part, group: str) -> Any:
        """The same part with symbols."""
        varied = copy(part)
        for field in fields(part):  # type: ignore[arg-type]
            at, value = f"{group}.{part.name}.{field.name}", getattr(part, field.name)
            object.__setattr__(varied, field.name, self._field(part, at, field.name, value))
        return varied

    def _field(self, part: Part, at: str, name: str, value: Any) -> Any:
        if name in POINTS:
            owner = "on" if name == "point" and hasattr(part, "centre") else POINTS[name]
            return self._point(part, at, value, getattr(part, owner), "attachment")
        if name in ("first", "second") and is_dataclass(value):
            return self._shape(part, at, value)
        if name == "branches":
            return tuple(self._branch(part, f"{at}.{k}", x) for k, x in enumerate(value))
        if name == "coordinates" and isinstance(part, Tendon):
            return tuple((q, self._coefficient(part, f"{at}.{q}", q, x)) for q, x in value)
        if name in SIZES:
            kind = "element-length" if name == "length" else "contact-size"
            return self._size(part, at, value, kind, f"the {name} of {part.where}")
        if name in LAWS:
            return self._law(part, at, value)
        return value

    def _number(self, part: Part, at: str, value: Any, **more: str) -> Any:
        return self._replaced(part, at, value, **more) if isinstance(value, float) else value

    def _replaced(self, part: Part, at: str, value: float, **more: str) -> Any:
        symbol = ca.SX.sym(at)
        self.numbers.append(Number(at, part=part.where, value=value, symbol=symbol, **more))
        return Varied.of(value, symbol)

    def _coefficient(self, part: Part, at: str, name: str, value: Any) -> Any:
        what = f"{part.where}, the coefficient of {name!r},"
        return self._number(part, at, value, kind="law-number", what=what)

    def _point(self, part: Part, at: str, value: Any, body: str, kind: str) -> Any:
        what = f"the point of {part.where} on {body}"
        return tuple(
            self._number(part, f"{at}.{axis}", x, kind=kind, what=what, body=body, axis=axis)
            for axis, x in zip("xyz", value)
        )

    def _size(self, part: Part, at: str, value: Any, kind: str, what: str) -> Any:
        if isinstance(value, tuple):
            labels = "xyz" if len(value) == 3 else "01"
            sizes = zip(labels, value)
            if len(set(value)) == 1:  # a band without width is one length
                first = self._size(part, at, value[0], kind, what)
                return (first,) * len(value)
            return tuple(self._size(part, f"{at}.{k}", x, kind, f"{what} ({k})") for k, x in sizes)
        return self._number(part, at, value, kind=kind, what=what) if value else value

    def _shape(self, part: Part, at: str, shape: Any) -> Any:
        varied = copy(shape)
        where = self._point(part, f"{at}.position", shape.position, shape.body, "contact-position")
        object.__setattr__(varied, "position", where)
        for field in fields(shape):
            if field.name in SIZES:
                what = f"the {field.name} of the {shape.where} in {part.where}"
                value = getattr(shape, field.name)
                size = self._size(part, f"{at}.{field.name}", value, "contact-size", what)
                object.__setattr__(varied, field.name, size)
        return varied

    def _branch(self, part: Part, at: str, branch: Any) -> Any:
        varied = copy(branch)
        points = tuple(
            (body, self._point(part, f"{at}.{k}", point, body, "attachment"))
            for k, (body, point) in enumerate(branch.points)
        )
        object.__setattr__(varied, "points", points)
        return varied

    def _law(self, part: Part, at: str, law: Any) -> Any:
        if isinstance(law, tuple):
            return tuple(self._law(part, f"{at}.{k}", x) for k, x in enumerate(law))
        what = f"the law of {part.where}"
        if isinstance(law, float):
            return self._number(part, at, law, kind="law-number", what=what)
        import sympy

        law = law.expression if isinstance(law, Polynomial) else law
        if not isinstance(law, sympy.Basic):
            return law
        numbers = sorted(law.atoms(sympy.Float), key=lambda x: (abs(x), x))
        changes = {}
        for k, entry in enumerate(numbers):  # q1 − 1.7 q2 has the number 1.7
            size = self._in_law(part, f"{at}.{k}", abs(float(entry)), what)
            changes[entry] = size * (1 if entry > 0 else -1)
        return law.xreplace(changes)

    def _in_law(self, part: Part, name: str, size: float, what: str) -> Any:
        import sympy

        opened = self._number(part, name, size, kind="law-number", what=what)
        self.values[name] = opened.symbol
        return sympy.Symbol(name, real=True)


class _Changed(_Opened):
    """Copies of parts in which some of these numbers are larger."""

    def __init__(self, by: Mapping[str, float]) -> None:
        super().__init__()
        self.by = by

    def _replaced(self, part: Part, at: str, value: float, **more: str) -> Any:
        return value + self.by.get(at, 0.0)

    def _in_law(self, part: Part, name: str, size: float, what: str) -> Any:
        import sympy

        return sympy.Float(size + self.by.get(name, 0.0))


def with_numbers(mechanism: Mechanism, by: Mapping[str, float]) -> Mechanism:
    """The mechanism with some numbers of the geometry of its elements and constraints larger, by address."""
    changed = _Changed(by)
    return replace(
        mechanism,
        forces=[changed.part(e, "force") for e in mechanism.forces],
        constraints=[changed.part(c, "constraint") for c in mechanism.constraints],
    )


def geometry_numbers(mechanism: Mechanism) -> tuple[tuple[Number, ...], Mechanism, dict[str, SX]]:
    """The numbers of the geometry of elements and constraints; the mechanism with symbols in their place.

    And values of further symbols in its laws. The mechanism is to be written out only.
    """
    opened = _Opened()
    forces = tuple(opened.part(e, "force") for e in mechanism.forces)
    constraints = tuple(opened.part(c, "constraint") for c in mechanism.constraints)
    varied = copy(mechanism)
    varied.__dict__.pop("elements", None)
    object.__setattr__(varied, "forces", forces)
    object.__setattr__(varied, "constraints", constraints)
    return tuple(opened.numbers), varied, opened.values


def _numbers(
    equations: LogEquations, multipliers: SX, index: Sequence[int]
) -> Iterator[tuple[Column, Change]]:
    numbers, mechanism, values = geometry_numbers(equations.mechanism)
    if not numbers:
        return
    s = equations.symbols.system
    opened = replace(s, mechanism=mechanism, values={**s.values, **values})
    p = ca.vertcat(*(n.symbol for n in numbers))
    scene = TracedScene(opened)
    forces = [f for e in mechanism.forces for f in _own(equations, e.channels(scene))]
    force = sum(forces, start=ca.SX.zeros(s.u_all.shape[0]))[s.free_u]
    names = [Column("number", n.address) for n in numbers]
    point = ca.DM([n.value for n in numbers])
    yield from _differentiated(opened, force, names, p, point, multipliers, index)


def _parameters(
    equations: LogEquations, multipliers: SX, index: Sequence[int]
) -> Iterator[tuple[Column, Change]]:
    mechanism, symbols = equations.mechanism, equations.symbols
    if not mechanism.parameters:
        return
    names = tuple(mechanism.parameters)
    s = trace(mechanism, names)
    weight = computes_weight(equations)
    base = ca.vertcat(ca.SX.zeros(3), -s.gravity) if weight else None
    udot = ca.SX(s.udot_all)
    force = sum(_own(equations, channels(s)), start=-rnea(s, udot, base))[s.free_u]
    point = ca.DM([mechanism.parameters[name] for name in names])
    columns = [Column("parameter", name) for name in names]
    own = symbols.system
    for column, change in _differentiated(s, force, columns, s.p, point, multipliers, index):
        x, rate = ca.substitute(
            [change.force, change.acceleration],
            [s.t, s.q, s.u, s.udot],
            [own.t, own.q, own.u, own.udot],
        )
        yield column, Change(x, rate)


def _differentiated(
    s: System,
    force: SX,
    columns: Sequence[Column],
    p: SX,
    point: SX,
    multipliers: SX,
    index: Sequence[int],
) -> Iterator[tuple[Column, Change]]:
    """The changes that symbols p make, at their values: of forces, and of the constraints' rows."""
    rate, factor = ca.SX(0, 1), ca.SX.sym("lambda", len(index))
    if len(index):
        rows = constraint_rows(s)
        rows = rows.select([rows.index.index(k) for k in index])
        rate = rows.gamma + ca.mtimes(rows.G, s.udot)
        force = force + ca.mtimes(rows.G.T, factor)
    x, y = ca.substitute(
        [ca.jacobian(force, p), ca.jacobian(rate, p)],
        [p, factor],
        [point, multipliers],
    )
    for k, column in enumerate(columns):
        if not (ca.SX(x[:, k]).is_zero() and ca.SX(y[:, k]).is_zero()):
            yield column, Change(x[:, k], y[:, k])


GEOMETRY_PARTS: dict[Callable[..., Iterator[tuple[Column, Change]]], tuple[What, ...]] = {
    _joints: ("joint-place", "body-place"),
    _numbers: ("number",),
    _parameters: ("parameter",),
}
"""What writes out columns of the geometry, and which."""
