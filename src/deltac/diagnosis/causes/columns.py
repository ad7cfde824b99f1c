"""Columns: what one unit of every elementary change of a mechanism adds to its equations of motion.

F_r + F*_r is linear in the ten inertial parameters of each body (mass, first moments, moments and
products of inertia about the link frame's origin), in gravity, and in coefficients of elementary
forces. So each has a column x with residual(θ) = residual(0) + Σ θ x, computed from the traced mechanism.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import casadi as ca

from deltac.arrays import Array
from deltac.dynamics.forces import total_force
from deltac.dynamics.recursions import accelerations, gather, rnea, velocities
from deltac.dynamics.spatial import SX, Inertia, cross, cross_force
from deltac.dynamics.system import Link, System
from deltac.energy.terms import LedgerSymbols, LoggedForces, ledger_symbols
from deltac.kernels.rows import at_rows
from deltac.mechanism.joints import JOINT_KINDS
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory

What = Literal[
    "inertia", "velocity", "gyroscopic", "weight", "gravity", "weight term", "velocity term",
    "damper", "friction", "drag",
    "spring", "stop", "constant", "armature", "channel", "delay", "law", "offset", "drag of a body",
    "damper of a body", "decay",
    "force", "moment", "body-force", "body-moment", "joint-place", "body-place", "number", "parameter",
    "bend",
]  # fmt: skip


OF_GEOMETRY: tuple[What, ...] = ("joint-place", "body-place", "number", "parameter")
"""Columns of `geometry_columns`."""


@dataclass(frozen=True)
class Column:
    """An elementary change: of which body, speed or channel; `index` counts those of one element.

    inertia     body; 0 mass, 1–3 first moments, 4–9 Jxx, Jyy, Jzz, Jxy, Jxz, Jyz; kg, kg·m, kg·m²
    velocity    body; what its inertia makes of speeds alone: centrifugal, Coriolis and gyroscopic terms
    gyroscopic  body; ω × Jω of its central inertia J
    weight      body; the part of its columns 0 to 3 that gravity makes
    gravity     world axis; m/s²
    weight term, velocity term  speed: what gravity, and what speeds alone, do in its equation
    damper      speed: −u; friction: −sign u; drag: −u|u|; spring: −q; constant: 1; armature: −u̇
    drag of a body  body: −|v| v at its mass centre
    damper of a body  body: 0 for −v at its mass centre, 1 for the moment −ω
    decay       all bodies together: −m v at mass centres, −m |v| v, −J ω and −J |ω| ω, in this order
    stop        speed: −max(q − c, 0) at the place c of that index, see `stops`
    channel     a channel's generalized force once more
    delay       a logged channel: 0 for −ḟ (s), 1 for f̈/2 (s²)
    law         what the residual has less where laws of time are late, and smoothed: (−1)ᵏ/k! of its k-th
                derivative by the time at a state, k from 1; s, s², …
    offset      speed: what its coordinate takes from the equations where it is logged too large: 0 in
                proportion, 1 by squares
    force, moment        body: along the world's axes, at the mass centre; N, N·m
    body-force, body-moment  the same along the body's axes
    joint-place  joint; small rotations (0–2) and translations (3–5) of the joint along the axes of its
                 parent's link frame, about the origin of that; rad, m
    body-place   joint; the same of the child on its joint, in its own link frame
    number       address of a number of an element's geometry
    parameter    name of a parameter of the mechanism
    bend         what is not linear in a cause that is built into the mechanism, in their order
    """

    what: What
    element: str
    index: int = 0

    @property
    def of(self) -> tuple[What, str]:
        """What it is of which element, whichever of its columns."""
        return self.what, self.element


class LogEquations:
    """The equations of a mechanism with the forces of a log, in `symbols`.

    `log` are its forces, `reach` the least and the largest values of all its coordinates.
    """

    def __init__(self, mechanism: Mechanism, run: Trajectory) -> None:
        self.mechanism, self.log = mechanism, LoggedForces.of(run)
        self.reach = run.q.min(axis=0), run.q.max(axis=0)
        start = (float(run.t[0]), run.q[0, mechanism.free.q])
        self.symbols: LedgerSymbols = ledger_symbols(mechanism, self.log, None, start)


@dataclass(frozen=True, eq=False)
class ColumnKernels:
    """The residual (first column) and all others as a function of samples, before what constraints take.

    It takes t, q, u, u̇, logged forces, their first and their second rates, each (T, …).
    """

    columns: tuple[Column, ...]
    speeds: int
    expression: SX
    inputs: tuple[SX, ...]

    @cached_property
    def _function(self) -> ca.Function:
        return ca.Function("columns", list(self.inputs), [self.expression])

    @property
    def cost(self) -> int:
        """Instructions of all columns at one sample, and their zeros, which are written as well."""
        f = self._function
        return int(f.n_instructions() + f.numel_out(0) - f.nnz_out(0))

    def only(self, some: Collection[tuple[What, str]]) -> ColumnKernels:
        """The same with the columns of some elements, as of `Column.of`."""
        places = [k for k, column in enumerate(self.columns) if column.of in some]
        expression = self.expression[:, [0, *(1 + k for k in places)]]
        columns = tuple(self.columns[k] for k in places)
        return replace(self, columns=columns, expression=expression)

    def __call__(self, *samples: Array) -> Array:
        """F_r + F*_r and the columns (T, n, 1 + P)."""
        (values,) = at_rows(self._function, samples)
        return values.reshape(len(values), -1, self.speeds).transpose(0, 2, 1)


Elements = Collection[tuple[What, str]] | None
"""Of which columns are wanted, as of `Column.of`; None: of all."""


def column_kernels(equations: LogEquations, some: Elements = None) -> ColumnKernels:
    """All columns of a mechanism whose forces are those of `equations`, or those of some elements.

    Terms of single equations are among the latter alone: beside all else they explain what others do.
    """
    symbols = equations.symbols
    s = symbols.system
    # Of logs of one mechanism only the places of stops differ: all else is written out once.
    rates, residual = symbols.once("residual", lambda: _residual(equations))
    columns = dict[Column, SX]()
    if some is None or any(what not in OF_GEOMETRY for what, _ in some):
        shared = symbols.once("columns", lambda: _written_out(equations))
        columns = {**shared, **_acting(_stops(equations))}
        if some is not None:
            columns |= _acting(_terms(equations, shared))
        columns = {c: x for c, x in columns.items() if some is None or c.of in some}
    inputs = (s.t, s.q, s.u, s.udot, symbols.logged, *rates)
    expression = ca.horzcat(residual, *columns.values())
    return ColumnKernels(tuple(columns), len(s.free_u), expression, inputs)


def _residual(equations: LogEquations) -> tuple[tuple[SX, SX], SX]:
    """Symbols of the rates of logged forces and of their rates, and F_r + F*_r."""
    symbols = equations.symbols
    s = symbols.system
    rate, curve = (ca.SX.sym(name, symbols.logged.shape[0]) for name in ("rate", "curve"))
    return (rate, curve), (total_force(s, symbols.parts) - rnea(s, symbols.udot))[s.free_u]


def _written_out(equations: LogEquations) -> dict[Column, SX]:
    """All columns but stops."""
    symbols = equations.symbols
    s = symbols.system
    (rate, curve), residual = symbols.once("residual", lambda: _residual(equations))
    key = ("columns", computes_weight(equations), "gravity" in equations.log.places)
    changes = {**s.once(key, lambda: _of_mechanism(equations)), **_channels(equations, rate, curve)}
    changes.update(_laws(s.t, residual))
    if symbols.constrained is None:  # else the constraints show it
        changes.update(_offsets(equations, residual))
    return _acting(changes)


def _of_mechanism(equations: LogEquations) -> dict[Column, SX]:
    """Columns that are the same whatever the log holds but gravity."""
    parts = (_inertia, _gravity, _joints, _wrenches)
    return {column: x for part in parts for column, x in part(equations).items()}


def _acting(changes: dict[Column, SX]) -> dict[Column, SX]:
    """Those that are not zero."""
    return {c: x for c, x in changes.items() if not ca.SX(x).is_zero()}


UNIT_MOMENTS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Places of the moments and products of inertia, in the order of a body's columns 4 to 9."""


def _unit_inertias() -> Iterable[Inertia]:
    """Spatial inertias of one unit of each of the ten parameters."""
    nothing = ca.SX(3, 3)
    yield Inertia(nothing, nothing, ca.SX.eye(3))
    for k in range(3):
        axis = ca.SX(3, 1)
        axis[k] = 1
        yield Inertia(nothing, ca.sparsify(ca.skew(axis)), nothing)
    for i, j in UNIT_MOMENTS:
        J = ca.SX(3, 3)
        J[i, j] = J[j, i] = 1
        yield Inertia(J, nothing, nothing)


def _inertia(equations: LogEquations) -> dict[Column, SX]:
    s = equations.symbols.system
    base = ca.vertcat(ca.SX.zeros(3), -s.gravity) if computes_weight(equations) else None
    V = velocities(s, s.u_all)
    A = accelerations(s, V, equations.symbols.udot, base)
    steady = accelerations(s, V, ca.SX.zeros(s.u_all.shape[0]), None)
    changes: dict[Column, SX] = {}
    for k, (link, along) in enumerate(zip(s.links, _partial_velocities(s))):
        body = link.joint.child
        if s.mechanism.body(body).massless:
            continue
        turning = link.inertia @ steady[k] + cross_force(V[k], link.inertia @ V[k])
        moment = cross(V[k][:3], ca.mtimes(central_inertia(link), V[k][:3]))
        wrenches = {
            Column("velocity", body): -turning,
            Column("gyroscopic", body): -ca.vertcat(moment, ca.SX(3, 1)),
        }
        for index, inertia in enumerate(_unit_inertias()):
            F = inertia @ A[k] + cross_force(V[k], inertia @ V[k])
            wrenches[Column("inertia", body, index)] = -F
            if base is not None and index < 4:
                weight = inertia @ ca.vertcat(ca.SX.zeros(3), s.poses[k].E @ s.gravity)
                wrenches[Column("weight", body, index)] = weight
        changes |= {column: ca.mtimes(along.T, F) for column, F in wrenches.items()}
    return changes


def _partial_velocities(s: System) -> list[SX]:
    """What each free speed adds to the spatial velocity of each link: matrices (6, n), V = X V_parent + S u.

    The generalized active forces of a wrench at a link are its products with them, as in Kane's method.
    """
    unit = ca.SX.eye(s.u_all.shape[0])[:, s.free_u]
    return [ca.sparsify(x) for x in velocities(s, unit)]


def computes_weight(equations: LogEquations) -> bool:
    """Whether gravity is the model's, and not a logged force."""
    parts = {part.name for part in equations.symbols.parts}
    return "gravity" in parts and "gravity" not in equations.log.places


def _gravity(equations: LogEquations) -> dict[Column, SX]:
    s = equations.symbols.system
    changes: dict[Column, SX] = {}
    if "gravity" in equations.log.places:
        return changes
    for axis in range(3):
        wrenches: dict[int, SX] = {}
        for k, (link, pose) in enumerate(zip(s.links, s.poses)):
            if not s.mechanism.body(link.joint.child).massless:
                weight = link.mass * pose.E[:, axis]
                wrenches[k] = ca.vertcat(cross(link.centre, weight), weight)
        changes[Column("gravity", "", axis)] = gather(s, wrenches)[s.free_u]
    return changes


def _terms(equations: LogEquations, changes: dict[Column, SX]) -> dict[Column, SX]:
    """Terms of single equations, of which whoever writes them by hand may forget one."""
    s, speeds = equations.symbols.system, equations.mechanism.speeds
    n, weight, steady = len(s.free_u), ca.SX(len(s.free_u), 1), ca.SX(len(s.free_u), 1)
    for column, x in changes.items():
        if column.what == "gravity":
            weight += s.gravity[column.index] * x
        elif column.what == "velocity":
            steady += x
    terms: dict[Column, SX] = {}
    for row, place in enumerate(s.free_u) if n > 1 else ():
        each: tuple[tuple[What, SX], ...] = (("weight term", weight), ("velocity term", steady))
        for what, x in each:
            own = ca.SX(n, 1)
            own[row] = x[row]
            terms[Column(what, speeds[place].name)] = own
    return terms


def _joints(equations: LogEquations) -> dict[Column, SX]:
    s, mechanism = equations.symbols.system, equations.mechanism
    changes: dict[Column, SX] = {}
    n = len(s.free_u)
    for row, place in enumerate(s.free_u):
        entry = mechanism.speeds[place]
        joint = mechanism.joint(entry.joint)
        u = s.u[row]
        force = {
            Column("damper", entry.name): -u,
            Column("friction", entry.name): -ca.sign(u),
            Column("drag", entry.name): -u * ca.fabs(u),
            Column("armature", entry.name): -s.udot[row],
            Column("constant", entry.name): ca.SX(1),
        }
        if JOINT_KINDS[joint.kind].rates:
            force[Column("spring", entry.name)] = -s.q_all[_coordinate(equations, int(place))]
        for column, value in force.items():
            x = ca.SX(n, 1)
            x[row] = value
            changes[column] = x
    return changes


def _coordinate(equations: LogEquations, place: int) -> int:
    """The place of the coordinate whose rate is the speed at a place."""
    mechanism = equations.mechanism
    joint = mechanism.joint(mechanism.speeds[place].joint).name
    start = mechanism.coordinates.of(joint).start
    return int(start + place - mechanism.speeds.of(joint).start)


def _stops(equations: LogEquations) -> dict[Column, SX]:
    s, mechanism = equations.symbols.system, equations.mechanism
    changes: dict[Column, SX] = {}
    for row, place in enumerate(map(int, s.free_u)):
        entry = mechanism.speeds[place]
        if JOINT_KINDS[mechanism.joint(entry.joint).kind].rates:
            at = _coordinate(equations, place)
            for k, c in enumerate(stops(equations, at)):
                x = ca.SX(len(s.free_u), 1)
                x[row] = -ca.fmax(s.q_all[at] - c, 0)
                changes[Column("stop", entry.name, k)] = x
    return changes


STOPS = (0.02, 0.06, 0.13, 0.23, 0.36, 0.5, 0.64, 0.77, 0.87, 0.94, 0.98)
"""Places of possible stops, as shares of the reach of a coordinate: dense towards its ends."""


def stops(equations: LogEquations, coordinate: int) -> tuple[float, ...]:
    """The places c of the "stop" columns of a coordinate; none where it rests."""
    low, high = (float(x[coordinate]) for x in equations.reach)
    return tuple(low + share * (high - low) for share in STOPS) if high > low else ()


def _offsets(equations: LogEquations, residual: SX) -> dict[Column, SX]:
    """Coordinates of hinges and sliders that are logged with another zero than the model's."""
    s, mechanism = equations.symbols.system, equations.mechanism
    free = {int(k): row for row, k in enumerate(mechanism.free.q)}
    changes: dict[Column, SX] = {}
    for place in s.free_u:
        entry = mechanism.speeds[place]
        joint = mechanism.joint(entry.joint)
        row = free.get(_coordinate(equations, int(place)))
        if len(joint.speeds) == 1 and JOINT_KINDS[joint.kind].rates and row is not None:
            along = ca.SX.zeros(s.q.shape[0])
            along[row] = -1
            first_order = ca.jtimes(residual, s.q, along)
            changes[Column("offset", entry.name)] = first_order
            changes[Column("offset", entry.name, 1)] = 0.5 * ca.jtimes(first_order, s.q, along)
    return changes


def _wrenches(equations: LogEquations) -> dict[Column, SX]:
    """Constant forces at mass centres, and constant moments; drag, and what engines take from all bodies."""
    s = equations.symbols.system
    V, nothing = velocities(s, s.u_all), ca.SX(3, 1)
    changes: dict[Column, SX] = {}
    decays: list[dict[int, SX]] = [{} for _ in range(4)]
    for k, (link, pose, along) in enumerate(zip(s.links, s.poses, _partial_velocities(s))):
        body = link.joint.child
        if s.mechanism.body(body).massless:
            continue
        w = V[k][:3]
        v, L = V[k][3:] + cross(w, link.centre), ca.mtimes(central_inertia(link), w)
        at_centre, turning, moment = (
            -ca.vertcat(x, y) for x, y in ((cross(link.centre, v), v), (L, nothing), (w, nothing))
        )
        wrenches: dict[Column, SX] = {}
        if len(set(along.sparsity().get_col())) > 1:  # else they are dampers of its joint
            wrenches[Column("damper of a body", body, 0)] = at_centre
            wrenches[Column("damper of a body", body, 1)] = moment
        wrenches[Column("drag of a body", body)] = ca.norm_2(v) * at_centre
        of_mass = link.mass * at_centre
        losses = of_mass, ca.norm_2(v) * of_mass, turning, ca.norm_2(w) * turning
        for decay, wrench in zip(decays, losses):
            decay[k] = wrench
        for axis in range(3):
            world, own = pose.E[:, axis], link.to_body.E.T[:, axis]
            wrenches |= {
                Column("force", body, axis): ca.vertcat(cross(link.centre, world), world),
                Column("moment", body, axis): ca.vertcat(world, nothing),
                Column("body-force", body, axis): ca.vertcat(cross(link.centre, own), own),
                Column("body-moment", body, axis): ca.vertcat(own, nothing),
            }
        changes |= {column: ca.mtimes(along.T, F) for column, F in wrenches.items()}
    if len(s.free_u) > 1:
        changes |= {
            Column("decay", "", k): gather(s, decay)[s.free_u] for k, decay in enumerate(decays)
        }
    return changes


def central_inertia(link: Link) -> SX:
    """The moments and products of inertia (3, 3) of a body about its mass centre, kg·m²."""
    about = ca.sumsqr(link.centre) * ca.SX.eye(3) - ca.mtimes(link.centre, link.centre.T)
    return link.inertia.J - link.mass * about


MOMENTS = {"delay": "s", "smoothing": "s²", "third moment": "s³", "fourth moment": "s⁴"}
"""Of the filter of a log, by which laws of time are late, with units: Butterworth's are in the third."""


def _laws(t: SX, residual: SX) -> dict[Column, SX]:
    """The residual with the laws of time filtered: their moments times its derivatives at a state."""
    found: dict[Column, SX] = {}
    derivative = residual
    for k in range(1, len(MOMENTS) + 1):
        if not ca.depends_on(derivative, t):
            break
        derivative = ca.jtimes(derivative, t, ca.SX(-1.0 / k))
        found[Column("law", "", k)] = derivative
    return found


def _channels(equations: LogEquations, rate: SX, curve: SX) -> dict[Column, SX]:
    symbols = equations.symbols
    at = symbols.system.free_u
    changes: dict[Column, SX] = {}
    for part in symbols.parts:
        kind = part.name.kind
        if part.name == "gravity" or kind == "correction":
            continue
        changes[Column("channel", part.name)] = part.force[at]
        if kind == "actuator" and part.name in equations.log.places:
            first = ca.jtimes(part.force, symbols.logged, rate)
            second = ca.jtimes(part.force, symbols.logged, curve)
            changes[Column("delay", part.name, 0)] = -first[at]
            changes[Column("delay", part.name, 1)] = 0.5 * second[at]
    return changes
