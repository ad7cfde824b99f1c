"""A mechanism written out in symbols: what every recursion starts from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from deltac.calls.caching import LRUCache, Once
from deltac.dynamics.frames import aligned_joints, constant_turns
from deltac.dynamics.joints import joint_motion
from deltac.dynamics.laws import to_casadi
from deltac.dynamics.spatial import SX, Inertia, Transform, Turn, rigid_inertia
from deltac.errors import check_names
from deltac.mechanism.joints import JOINT_KINDS, Joint
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.scope import GROUND


@dataclass(frozen=True)
class Link:
    """A body with the joint that carries it, in the *link frame*: the joint's frame on the child.

    Of a joint with a single oblique axis that frame is turned, z along the axis (`frames`).

    `parent` is the parent's place in `System.links` (−1: ground); `X` leads from the parent's link
    frame to this one; `S` (6 by n) is the motion subspace, `S_dot` its rate in the link frame and
    `c` = Ṡ u the bias; `W` gives q̇ = W u; `q`, `u` are the joint's places in the full vectors;
    `to_body` leads to the body frame.
    """

    joint: Joint
    parent: int
    X: Transform
    S: SX
    S_dot: SX
    c: SX
    W: SX
    q: slice
    u: slice
    inertia: Inertia
    armature: SX
    mass: SX
    centre: SX
    to_body: Transform


@dataclass(frozen=True, eq=False)
class System(Once):
    """Symbols and links of a mechanism.

    Inputs: time `t`, free coordinates `q` and speeds `u`, free accelerations `udot`, values `inputs`
    of the motors that a controller or a log supplies, and the parameters `p` that are kept symbolic
    (named in `vary`). `q_all`, `u_all`, `udot_all`, `qdot_all` are the full vectors, in which a
    prescribed joint's law and its exact derivatives stand in place of symbols.
    """

    mechanism: Mechanism
    vary: tuple[str, ...]
    t: SX
    q: SX
    u: SX
    udot: SX
    inputs: SX
    p: SX
    q_all: SX
    u_all: SX
    udot_all: SX
    qdot_all: SX
    links: tuple[Link, ...]
    values: Mapping[str, SX]

    @cached_property
    def poses(self) -> tuple[Transform, ...]:
        """From the world to each link frame."""
        transforms: list[Transform] = []
        for link in self.links:
            X = Transform(link.X.E, link.X.r)  # along a chain, turns would add up: matrices do not
            transforms.append(X if link.parent < 0 else transforms[link.parent].then(X))
        return tuple(transforms)

    @cached_property
    def gravity(self) -> SX:
        """Acceleration of free fall, world components."""
        return self.vector(tuple(self.mechanism.gravity))

    def number(self, law: object) -> SX:
        """A law or quantity in symbols."""
        return to_casadi(law, self.values)

    def vector(self, laws: Sequence[object]) -> SX:
        """Several laws as a column."""
        return ca.vertcat(*(self.number(law) for law in laws))

    @property
    def free_q(self) -> list[int]:
        """Places of the free coordinates."""
        return [int(i) for i in self.mechanism.free.q]

    @property
    def free_u(self) -> list[int]:
        """Places of the free speeds."""
        return [int(i) for i in self.mechanism.free.u]

    @property
    def driven_u(self) -> list[int]:
        """Places of the prescribed speeds."""
        return [entry.index for entry in self.mechanism.speeds if entry.prescribed]

    @cached_property
    def qdot(self) -> SX:
        """Rates of the free coordinates."""
        return self.qdot_all[self.free_q, :]

    @cached_property
    def W(self) -> SX:
        """W (nq, p) of q̇ = W u + X, free coordinates and speeds."""
        return ca.jacobian(self.qdot, self.u)

    @cached_property
    def at_rest(self) -> SX:
        """Accelerations (nu,) of prescribed joints by their laws, and zero of free ones."""
        udot = ca.SX(self.udot_all)
        udot[self.free_u] = 0
        return udot

    @cached_property
    def index(self) -> Mapping[str, int]:
        """The place of each body's link; the ground is −1."""
        places = {link.joint.child: k for k, link in enumerate(self.links)}
        return {GROUND: -1, **places}

    def point(self, body: str, point: Sequence[object]) -> tuple[int, SX]:
        """The link of a body, and a point given in its body frame in the link frame."""
        place = self.index[body]
        p = self.vector(point)
        if place < 0:
            return place, p
        to_body = self.links[place].to_body
        return place, to_body.r + ca.mtimes(to_body.E.T, p)

    @cached_property
    def input_places(self) -> Mapping[str, slice]:
        """Where each motor without a law finds its values in `inputs`."""
        places: dict[str, slice] = {}
        start = 0
        for motor in self.mechanism.motors:
            count = len(self.mechanism.joint(motor.joint).speeds)
            places[motor.name] = slice(start, start + count)
            start += count
        return places


def trace(mechanism: Mechanism, vary: Sequence[str] = ()) -> System:
    """Write a mechanism out in symbols; parameters named in `vary` stay symbols, others are folded in.

    The same description has the same system, with the same symbols, each time; its `mechanism` may differ
    from the one given in the values of the parameters that vary.

    Raises InputError for an unknown parameter.
    """
    check_names(vary, mechanism.parameters, "vary: unknown parameter")
    names = tuple(vary)
    key = (mechanism.digest(names), mechanism.name, names)
    return _SYSTEMS.get(key, lambda: _written_out(mechanism, names))


_SYSTEMS: LRUCache[System] = LRUCache(32)


def _written_out(mechanism: Mechanism, vary: tuple[str, ...]) -> System:
    t = ca.SX.sym("t")
    p = ca.SX.sym("p", len(vary))
    values: dict[str, SX] = {name: ca.SX(value) for name, value in mechanism.parameters.items()}
    values.update({name: p[k] for k, name in enumerate(vary)})
    values["t"] = t

    q = ca.SX.sym("q", len(mechanism.free.q))
    u = ca.SX.sym("u", len(mechanism.free.u))
    udot = ca.SX.sym("udot", len(mechanism.free.u))
    q_all = ca.SX.zeros(len(mechanism.coordinates))
    u_all = ca.SX.zeros(len(mechanism.speeds))
    udot_all = ca.SX.zeros(len(mechanism.speeds))
    for k, place in enumerate(mechanism.free.q):
        q_all[int(place)] = q[k]
    for k, place in enumerate(mechanism.free.u):
        u_all[int(place)], udot_all[int(place)] = u[k], udot[k]
    for joint in mechanism.joints:
        start_q = mechanism.coordinates.of(joint.name).start
        start_u = mechanism.speeds.of(joint.name).start
        for k, law in enumerate(joint.motion):
            s = to_casadi(law, values)
            s_dot = ca.densify(ca.jacobian(s, t))  # of a constant: a zero, not an empty entry
            q_all[start_q + k], u_all[start_u + k] = s, s_dot
            udot_all[start_u + k] = ca.densify(ca.jacobian(s_dot, t))
    count = sum(len(mechanism.joint(motor.joint).speeds) for motor in mechanism.motors)
    inputs = ca.SX.sym("inputs", count)
    symbols = (t, q, u, udot, inputs, p, q_all, u_all, udot_all)
    return _linked(System(mechanism, vary, *symbols, ca.SX(0, 1), (), values))


def released(system: System) -> System:
    """The same mechanism with symbols in place of the prescribed joints' laws.

    Its q, u, u̇ are full vectors; t and p are those of `system`. Constraints are written on it, so that
    what depends on time explicitly is told from what moves with a prescribed joint.
    """
    mechanism = system.mechanism
    q = ca.SX.sym("q", len(mechanism.coordinates))
    u = ca.SX.sym("u", len(mechanism.speeds))
    udot = ca.SX.sym("udot", len(mechanism.speeds))
    symbols = {"q": q, "u": u, "udot": udot}
    return _linked(replace(system, **symbols, q_all=q, u_all=u, udot_all=udot))


def _linked(system: System) -> System:
    """The system with its links, and the rates of its coordinates."""
    mechanism, q_all, u_all = system.mechanism, system.q_all, system.u_all
    values = dict(system.values)
    values.update({f"q.{e.name}": q_all[e.index] for e in mechanism.coordinates})
    values.update({f"u.{e.name}": u_all[e.index] for e in mechanism.speeds})
    links = _links(mechanism, q_all, u_all, values)
    qdot_all = ca.vertcat(
        *(ca.mtimes(link.W, u_all[link.u]) for link in links if link.joint.speeds), ca.SX(0, 1)
    )
    return replace(system, values=values, links=links, qdot_all=qdot_all)


def _links(
    mechanism: Mechanism, q_all: SX, u_all: SX, values: Mapping[str, SX]
) -> tuple[Link, ...]:
    def vector(laws: Sequence[object]) -> SX:
        return ca.vertcat(*(to_casadi(law, values) for law in laws))

    place = {GROUND: -1}
    links: list[Link] = []
    aligned = aligned_joints(mechanism)
    for joint in mechanism.joints:
        framed = aligned.get(joint.name, joint)
        q, u = mechanism.coordinates.of(joint.name), mechanism.speeds.of(joint.name)
        # Differentiate along own symbols: a prescribed joint's q is an expression, not a symbol.
        own_q = ca.SX.sym("q", len(JOINT_KINDS[joint.kind].coordinates))
        own_u = ca.SX.sym("u", len(JOINT_KINDS[joint.kind].speeds))
        motion = joint_motion(framed, own_q, to_casadi(joint.pitch, values))
        bias = ca.jtimes(ca.mtimes(motion.S, own_u), own_q, ca.mtimes(motion.W, own_u))
        S_dot = ca.reshape(
            ca.jtimes(ca.vec(ca.densify(motion.S)), own_q, ca.mtimes(motion.W, own_u)),
            motion.S.shape,
        )
        turns = motion.X.turns or ()
        cosines = [ca.SX(turn.c) for turn in turns]
        sines = [ca.SX(turn.s) for turn in turns]
        # [slice, :] is a column even where a fixed joint's slice of a scalar is empty.
        E, r, S, S_dot, W, c, *rest = ca.substitute(
            [motion.X.E, motion.X.r, motion.S, S_dot, motion.W, bias, *cosines, *sines],
            [own_q, own_u],
            [q_all[q, :], u_all[u, :]],
        )
        X = Transform(E, r)
        if motion.X.turns is not None:
            placed = zip(turns, rest[: len(turns)], rest[len(turns) :])
            X = Transform(E, r, tuple(Turn(turn.axis, c, s) for turn, c, s in placed))
        parent = place[joint.parent]
        before = Transform(_turn(framed.rotation).T, vector(joint.position))
        if parent >= 0:
            before = links[parent].to_body.then(before)
        before = replace(before, turns=constant_turns(np.array(ca.DM(before.E))))
        to_body = _to_link(Transform(_turn(framed.child_rotation).T, vector(joint.child_position)))
        body = mechanism.body(joint.child)
        mass = to_casadi(body.mass, values)
        centre = to_body.r + ca.mtimes(to_body.E.T, vector(body.mass_centre))
        central = ca.vertcat(*(vector(row).T for row in body.inertia))
        central = ca.mtimes(to_body.E.T, ca.mtimes(central, to_body.E))
        armature = vector(joint.armature) if joint.armature else ca.SX.zeros(len(joint.speeds))
        place[joint.child] = len(links)
        links.append(
            Link(
                joint,
                parent,
                before.then(X),
                S,
                S_dot,
                c,
                W,
                q,
                u,
                rigid_inertia(mass, centre, central),
                armature,
                mass,
                centre,
                to_body,
            )
        )
    return tuple(links)


def _turn(rotation: Sequence[Sequence[float]]) -> SX:
    return ca.SX(ca.DM([list(row) for row in rotation]))


def _to_link(X: Transform) -> Transform:
    """The inverse of a transform."""
    return Transform(X.E.T, -ca.mtimes(X.E, X.r))
