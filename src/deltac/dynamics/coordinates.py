"""A user's own coordinates and generalized speeds in symbols (see `CoordinateMap`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca

from deltac.dynamics.laws import to_casadi
from deltac.dynamics.spatial import SX
from deltac.dynamics.system import System
from deltac.errors import InputError
from deltac.mechanism.coordinate_map import CoordinateMap


@dataclass(frozen=True)
class OwnCoordinates:
    """Own coordinates q′ = `own_q`, speeds u′ = `own_u` (symbols), and the mechanism's from them.

    `q` and `u` are the mechanism's free coordinates and speeds, u = `Y` u′ + `Z`; all of (t, q′, u′).
    `own_qdot` is q̇′. `inverse` is q′ of the mechanism's symbols (t, q), or None if unknown.
    """

    own_q: SX
    own_u: SX
    q: SX
    u: SX
    Y: SX
    Z: SX
    own_qdot: SX
    inverse: SX | None

    def own_state(self, system: System) -> tuple[SX, SX]:
        """q′ and u′ in the mechanism's symbols (t, q, u); InputError if the map has no inverse."""
        if self.inverse is None:
            raise InputError(
                "the coordinate map is not linear with as many coordinates, so its inverse is unknown; "
                "give inverse= with each own coordinate as a law of the mechanism's q.<coordinate>"
            )
        Y, Z = ca.substitute([self.Y, self.Z], [self.own_q], [self.inverse])
        return self.inverse, _solve(Y, system.u - Z) if Y.shape[0] else Z

    def udot(self, system: System, own_udot: SX) -> SX:
        """The mechanism's free accelerations from u̇′, in (t, q′, u′, u̇′)."""
        along = ca.vertcat(self.own_q, self.own_u, system.t)
        return ca.jtimes(self.u, along, ca.vertcat(self.own_qdot, own_udot, 1))


def trace_map(system: System, given: CoordinateMap) -> OwnCoordinates:
    """Write a coordinate map out in symbols; InputError where it does not fit the mechanism."""
    mechanism = system.mechanism
    given.check(mechanism)
    q_names = [mechanism.coordinates[i].name for i in system.free_q]
    u_names = [mechanism.speeds[i].name for i in system.free_u]
    constants = {name: system.values[name] for name in mechanism.parameters}
    own_names = given.coordinates if given.q else tuple(q_names)
    own_q = ca.SX.sym("own_q", len(own_names))
    own_u = ca.SX.sym("own_u", len(given.speeds) or len(own_names))
    values: dict[str, SX] = {**constants, "t": system.t}
    values.update({f"q.{name}": own_q[k] for k, name in enumerate(own_names)})
    values.update({f"u.{name}": own_u[k] for k, name in enumerate(given.speeds)})

    q = ca.vertcat(*(to_casadi(given.q[n], values) for n in q_names)) if given.q else own_q
    Jq = ca.jacobian(q, own_q)
    q_t = ca.jacobian(q, system.t)
    W = _rates_matrix(system, q)
    if given.u:
        u = ca.vertcat(*(to_casadi(given.u[name], values) for name in u_names))
    else:
        if not _all_rates(system):
            raise InputError(
                "the coordinate map has no u=, but the speeds of spherical and free joints are not the "
                "rates of their coordinates; give u= with each of the mechanism's speeds"
            )
        u = ca.mtimes(Jq, own_u) + q_t
    Y = ca.jacobian(u, own_u)
    if ca.depends_on(Y, own_u):
        raise InputError("the coordinate map's u= must be linear in its own speeds u.<name>")
    Z = ca.substitute(u, own_u, ca.SX.zeros(own_u.shape[0]))
    if not given.u:
        own_qdot = own_u
    elif given.q:
        own_qdot = _solve(Jq, ca.mtimes(W, u) - q_t)
    else:
        own_qdot = ca.mtimes(W, u)
    return OwnCoordinates(
        own_q, own_u, q, u, Y, Z, own_qdot, _inverse(system, given, own_q, q, Jq, constants)
    )


def trace_split(system: System, given: CoordinateMap | None) -> OwnCoordinates | None:
    """Own generalized speeds in which testing functions divide the kinetic energy; none by default.

    InputError for a mechanism with constraints: there λ belongs to the speeds of the joints, and v_t is what
    the constraints leave.
    """
    if given is None:
        return None
    if system.mechanism.constraints:
        raise InputError(
            f"coordinates: mechanism {system.mechanism.name!r} has constraints, which choose already how "
            "the motion is divided; leave own generalized speeds out"
        )
    return trace_map(system, given)


def _solve(A: SX, b: SX) -> SX:
    """Solve A x = b, where b is in the range of a matrix with at least as many rows as columns."""
    if A.shape[0] == A.shape[1]:
        return ca.solve(A, b)
    return ca.solve(ca.mtimes(A.T, A), ca.mtimes(A.T, b))


def _all_rates(system: System) -> bool:
    return len(system.free_q) == len(system.free_u)


def _rates_matrix(system: System, q: SX) -> SX:
    """W of q̇ = W u at the mechanism's coordinates given in own symbols."""
    W = ca.jacobian(system.qdot, system.u)
    return ca.substitute(W, system.q, q)


def _inverse(
    system: System, given: CoordinateMap, own_q: SX, q: SX, Jq: SX, constants: Mapping[str, SX]
) -> SX | None:
    if not given.q:
        return system.q
    if given.inverse:
        names = [system.mechanism.coordinates[i].name for i in system.free_q]
        values = {**constants, "t": system.t}
        values.update({f"q.{name}": system.q[k] for k, name in enumerate(names)})
        return ca.vertcat(*(to_casadi(given.inverse[name], values) for name in given.coordinates))
    if ca.depends_on(Jq, own_q) or Jq.shape[0] != Jq.shape[1]:
        return None
    offset = ca.substitute(q, own_q, ca.SX.zeros(own_q.shape[0]))
    return ca.solve(Jq, system.q - offset)
