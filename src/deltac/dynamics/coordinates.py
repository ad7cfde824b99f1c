"""A user's own coordinates and generalized speeds in symbols (see `CoordinateMap`)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from deltac.arrays import HALF_DIGITS, Array
from deltac.dynamics.constraints import ConstraintRows
from deltac.dynamics.laws import to_casadi
from deltac.dynamics.spatial import SX
from deltac.dynamics.system import System
from deltac.errors import ModelError, UnknownName, closest
from deltac.mechanism.coordinate_map import CoordinateMap

INDEPENDENT_COLUMNS = HALF_DIGITS
"""Own speeds whose constraint columns are independent by less than this are not taken as dependent."""


@dataclass(frozen=True)
class OwnCoordinates:
    """Own coordinates q′ = `own_q`, speeds u′ = `own_u` (symbols), and the mechanism's from them.

    `q` and `u` are the mechanism's free coordinates and speeds, u = `Y` u′ + `Z`; all of (t, q′, u′).
    `own_qdot` is q̇′. `inverse` is q′ of the mechanism's symbols (t, q), or None if unknown.

    `mapped` tells that q′ are the user's; else they are the mechanism's, because the user chose none, or
    chose some that give the others only by assembly: then `user_q` are the user's coordinates, of (t, q′).
    `removal` tells that speeds without a law follow from the constraints: it gives the change of speeds
    that removes a violation (nc,) of them and leaves the own speeds alone. `names` are those of the own
    speeds.
    """

    own_q: SX
    own_u: SX
    q: SX
    u: SX
    Y: SX
    Z: SX
    own_qdot: SX
    inverse: SX | None
    mapped: bool
    user_q: SX | None = None
    removal: Callable[[SX], SX] | None = None
    names: tuple[str, ...] = ()

    def own_state(self, system: System) -> tuple[SX, SX]:
        """q′ and u′ in the mechanism's symbols (t, q, u); InputError if the map has no inverse."""
        if self.inverse is None:
            raise ModelError(
                "the coordinate map is not linear with as many coordinates, so its inverse is unknown; "
                "give inverse= with each own coordinate as a law of the mechanism's q.<coordinate>"
            )
        Y, Z = ca.substitute([self.Y, self.Z], [self.own_q], [self.inverse])
        return self.inverse, solve_tall(Y, system.u - Z) if Y.shape[0] else Z

    def udot(self, system: System, own_udot: SX) -> SX:
        """The mechanism's free accelerations from u̇′, in (t, q′, u′, u̇′)."""
        along = ca.vertcat(self.own_q, self.own_u, system.t)
        return ca.jtimes(self.u, along, ca.vertcat(self.own_qdot, own_udot, 1))

    def user_rate(self, system: System) -> SX:
        """Rates of the coordinates that the user chose, of (t, q′, u′)."""
        if self.user_q is None:
            return self.own_qdot
        along = ca.vertcat(self.own_q, system.t)
        return ca.jtimes(self.user_q, along, ca.vertcat(self.own_qdot, 1))


def trace_map(
    system: System, coordinate_map: CoordinateMap, rows: ConstraintRows
) -> OwnCoordinates:
    """Write a coordinate map out in symbols; `rows` are the mechanism's constraints, or independent ones.

    InputError where it does not fit the mechanism.
    """
    mechanism = system.mechanism
    coordinate_map.check(mechanism)
    q_laws, u_laws = coordinate_map.laws()
    q_names = [mechanism.coordinates[i].name for i in system.free_q]
    u_names = [mechanism.speeds[i].name for i in system.free_u]
    assembled = coordinate_map.assembled(mechanism)
    mapped = bool(q_laws) and not assembled
    own_names = coordinate_map.coordinates if coordinate_map.coordinates else tuple(q_names)
    own_u = ca.SX.sym("own_u", len(coordinate_map.speeds) or len(own_names))
    if u_laws or assembled:
        _enough(own_u.shape[0], len(u_laws) or own_u.shape[0], rows, u_names, mechanism.name)
    values: dict[str, SX] = {
        **{name: system.values[name] for name in mechanism.parameters},
        "t": system.t,
    }
    values.update({f"u.{name}": own_u[k] for k, name in enumerate(coordinate_map.speeds)})

    # The user's coordinates y: own ones, or functions of the mechanism's.
    chosen = ca.SX.sym("own_q", len(own_names))
    reported: SX | None = None
    own_q = chosen if mapped else system.q
    if assembled:
        reported = _user_q(system, coordinate_map, q_laws, values, q_names)
    values.update({f"q.{name}": chosen[k] for k, name in enumerate(own_names)})
    in_state = reported if reported is not None else own_q

    def law(given_law: object) -> SX:
        return ca.substitute(to_casadi(given_law, values), chosen, in_state)

    q = ca.vertcat(*(law(q_laws[n]) for n in q_names)) if mapped else own_q
    W = ca.substitute(system.W, system.q, q)
    Jq, q_t = ca.jacobian(q, own_q), ca.jacobian(q, system.t)
    G, psi = (ca.substitute(x, system.q, q) for x in (rows.G, rows.at_rest(system.u)))
    removal: Callable[[SX], SX] | None = None
    if u_laws:
        places = [k for k, name in enumerate(u_names) if name in u_laws]
        speeds = ca.vertcat(*(law(u_laws[u_names[k]]) for k in places))
    elif assembled and q_laws:
        missing = [name for name in q_laws if name not in u_names]
        if missing:
            raise ModelError(
                f"the coordinate map has no u=, but the rate of {missing[0]!r} is no speed of the mechanism; "
                "give u= with some of the mechanism's speeds"
            )
        places = [u_names.index(name) for name in q_laws]
        rates = ca.vertcat(*(to_casadi(q_laws[u_names[k]], values) for k in places))
        speeds = ca.jtimes(rates, ca.vertcat(chosen, system.t), ca.vertcat(own_u, 1))
        speeds = ca.substitute(speeds, chosen, in_state)
    elif assembled:  # rates of functions of the mechanism's coordinates
        assert reported is not None
        slope, drift = ca.mtimes(ca.jacobian(reported, own_q), W), ca.jacobian(reported, system.t)
        stack = ca.vertcat(G, slope)

        def removal(violation: SX) -> SX:
            return solve_tall(stack, ca.vertcat(-violation, ca.SX.zeros(own_u.shape[0])))

        u = solve_tall(stack, ca.vertcat(-psi, own_u - drift))
        places = list(range(len(u_names)))
        speeds = u
    else:
        if len(system.free_q) != len(system.free_u):
            raise ModelError(
                "the coordinate map has no u=, but the speeds of spherical and free joints are not the "
                "rates of their coordinates; give u= with each of the mechanism's speeds"
            )
        places, speeds = list(range(len(u_names))), ca.mtimes(Jq, own_u) + q_t
    if len(places) < len(u_names):  # the others follow from the constraints
        rest = [k for k in range(len(u_names)) if k not in places]

        def removal(violation: SX) -> SX:
            change = ca.SX.zeros(len(u_names))
            change[rest] = -solve_tall(G[:, rest], violation)
            return change

        u = _completed(G, psi, places, rest, speeds)
    else:
        u = speeds
    Y = ca.jacobian(u, own_u)
    if ca.depends_on(Y, own_u):
        raise ModelError("the coordinate map's u= must be linear in its own speeds u.<name>")
    Z = ca.substitute(u, own_u, ca.SX.zeros(own_u.shape[0]))
    if not mapped:
        own_qdot = ca.mtimes(W, u)
    elif not u_laws:
        own_qdot = own_u
    else:
        own_qdot = solve_tall(Jq, ca.mtimes(W, u) - q_t)
    inverse: SX | None = system.q
    if mapped and coordinate_map.inverse:
        inverse = _laws_of_state(system, coordinate_map, values, q_names)
    elif mapped:
        inverse = _solved(q, own_q, system.q)
    names = coordinate_map.speeds or tuple(own_names)
    return OwnCoordinates(
        own_q, own_u, q, u, Y, Z, own_qdot, inverse, mapped, reported, removal, names
    )


def _enough(
    own: int, laws: int, rows: ConstraintRows, names: Sequence[str], mechanism: str
) -> None:
    """ModelError where own speeds, or laws of some speeds, cannot tell the motion."""
    free = len(names) - len(rows)
    if min(own, laws) >= free:
        return
    what = f"names {own} speeds" if own < free else f"gives {laws} of the mechanism's speeds"
    remainder = "" if not len(rows) else f" that the constraints leave of {', '.join(names)}"
    raise ModelError(
        f"the coordinate map {what}, but the motion of {mechanism!r} has {free} independent ones"
        f"{remainder}; give "
        f"{free - min(own, laws)} more"
    )


def _user_q(
    system: System,
    coordinate_map: CoordinateMap,
    q_laws: Mapping[str, object],
    values: Mapping[str, SX],
    q_names: Sequence[str],
) -> SX:
    """Own coordinates as functions of the mechanism's (t, q)."""
    if coordinate_map.inverse:
        return _laws_of_state(system, coordinate_map, values, q_names)
    y = ca.SX.sym("y", len(coordinate_map.coordinates))
    of_y = {**values, **{f"q.{name}": y[k] for k, name in enumerate(coordinate_map.coordinates)}}
    laws = ca.vertcat(*(to_casadi(law, of_y) for law in q_laws.values()))
    for name in q_laws:
        if name not in q_names:
            raise UnknownName(f"the coordinate map: {name!r} is prescribed{closest(name, q_names)}")
    values_at_state = ca.vertcat(*(system.q[list(q_names).index(name)] for name in q_laws))
    own_q = _solved(laws, y, values_at_state)
    if own_q is None:
        raise ModelError(
            f"the coordinate map gives {', '.join(q_laws)} by {', '.join(coordinate_map.coordinates)}, "
            "and how these follow from the mechanism's coordinates is not known; give inverse= with each own "
            "coordinate as a law of the mechanism's q.<coordinate>"
        )
    return own_q


def trace_split(
    system: System, coordinate_map: CoordinateMap | None, rows: ConstraintRows | None = None
) -> OwnCoordinates | None:
    """Own generalized speeds in which testing functions divide the kinetic energy; none by default.

    `rows` are the mechanism's independent constraints. Own speeds that they make dependent on the others are
    eliminated: the last of them that can be, as the textbooks number them.
    """
    if coordinate_map is None:
        return None
    bound = ConstraintRows.none(system) if rows is None else rows
    own = trace_map(system, coordinate_map, bound)
    count, free = own.own_u.shape[0], own.u.shape[0] - len(bound)
    if not len(bound) or own.removal is not None or count == free:
        return own
    G, psi = (ca.substitute(x, system.q, own.q) for x in (bound.G, bound.at_rest(system.u)))
    columns, rest = ca.mtimes(G, own.Y), psi + ca.mtimes(G, own.Z)
    dependent = _dependent(system, own, columns, count - free)
    independent = [k for k in range(count) if k not in dependent]
    small = ca.SX.sym("own_u", len(independent))
    u = ca.mtimes(own.Y, _completed(columns, rest, independent, dependent, small)) + own.Z
    return replace(
        own,
        own_u=small,
        u=u,
        Y=ca.jacobian(u, small),
        Z=ca.substitute(u, small, ca.SX.zeros(len(independent))),
        names=tuple(own.names[k] for k in independent),
    )


def _dependent(system: System, own: OwnCoordinates, columns: SX, size: int) -> list[int]:
    """The last own speeds whose constraint columns are independent, at places in general position."""
    rng = np.random.default_rng(1)
    inputs = [system.t, own.own_q, system.p]
    function = ca.Function("columns", inputs, [ca.densify(columns)])
    p = [system.mechanism.parameters[name] for name in system.vary]
    some = [
        np.array(function(rng.uniform(0, 1), rng.uniform(-1.5, 1.5, own.own_q.shape[0]), p))
        for _ in range(4)
    ]
    choice: list[int] = []
    for k in reversed(range(columns.shape[1])):
        candidates = [matrix[:, [k, *choice]] for matrix in some]
        values = [np.linalg.svd(matrix, compute_uv=False) for matrix in candidates]
        if min(value[-1] / max(value[0], 1e-300) for value in values) > INDEPENDENT_COLUMNS:
            choice.append(k)
        if len(choice) == size:
            return sorted(choice)
    raise ModelError(
        f"the coordinate map has {columns.shape[1]} own speeds, of which the constraints of "
        f"{system.mechanism.name!r} determine {len(choice)} where they should determine {size}: own speeds "
        "are too few, or not independent"
    )


def check_split(
    system: System, own: OwnCoordinates, rows: ConstraintRows, t: Array, q: Array, p: Array
) -> None:
    """InputError unless motion by own speeds satisfies the constraints at places t (B,), q (nq, B).

    Only then do the own speeds say how the motion is divided: u = Y u′ + Z with G Y = 0.
    """
    if own.inverse is None or not len(rows):
        return
    Y, Z = ca.substitute([own.Y, own.Z], [own.own_q], [own.inverse])
    psi = rows.at_rest(system.u)
    moved, drift = ca.mtimes(rows.G, Y), ca.mtimes(rows.G, Z)
    # A row's size by all of its entries: alone those that own speeds reach may be rounding.
    size = ca.mmax(ca.fabs(ca.horzcat(ca.densify(Y), ca.densify(Z))))
    terms = size * ca.sum2(ca.fabs(rows.G)) + ca.fabs(psi)
    violation = ca.sum2(ca.fabs(moved)) + ca.fabs(drift + psi)
    function = ca.Function("split", [system.t, system.q, system.p], [violation / (terms + 1e-300)])
    count = len(t)
    share = np.array(
        function.map(count)(t[None, :], q, np.repeat(np.reshape(p, (-1, 1)), count, 1))
    )
    worst = np.nan_to_num(share, nan=0.0).max(axis=1, initial=0.0)
    if worst.max(initial=0.0) > HALF_DIGITS:
        name = rows.names[int(np.argmax(worst))]
        raise ModelError(
            f"the own speeds do not satisfy constraint {name!r} (they violate it by "
            f"{worst.max():.2g} of its terms), so the motion cannot be divided by them; leave laws of "
            "dependent speeds out of u=, and they are found from the constraints"
        )


def solve_tall(A: SX, b: SX) -> SX:
    """Solve A x = b, where b is in the range of a matrix with at least as many rows as columns."""
    if A.shape[0] == A.shape[1]:
        return ca.solve(A, b)
    return ca.solve(ca.mtimes(A.T, A), ca.mtimes(A.T, b))


def _completed(G: SX, psi: SX, places: list[int], rest: list[int], speeds: SX) -> SX:
    """All speeds by those at `places`: the `rest` is such that G u + ψ = 0."""
    u = ca.SX.zeros(G.shape[1])
    u[places] = speeds
    u[rest] = -solve_tall(G[:, rest], psi + ca.mtimes(G[:, places], speeds))
    return u


def _solved(laws: SX, y: SX, values: SX) -> SX | None:
    """The y at which laws that are linear in it, as many, have these values; None for other laws."""
    slope = ca.jacobian(laws, y)
    if slope.shape[0] != slope.shape[1] or ca.depends_on(slope, y):
        return None
    return ca.solve(slope, values - ca.substitute(laws, y, ca.SX.zeros(y.shape[0])))


def _laws_of_state(
    system: System, coordinate_map: CoordinateMap, values: Mapping[str, SX], q_names: Sequence[str]
) -> SX:
    """Own coordinates by `inverse`, of the mechanism's (t, q)."""
    of_q = {**values, **{f"q.{name}": system.q[k] for k, name in enumerate(q_names)}}
    return ca.vertcat(
        *(to_casadi(coordinate_map.inverse[name], of_q) for name in coordinate_map.coordinates)
    )
