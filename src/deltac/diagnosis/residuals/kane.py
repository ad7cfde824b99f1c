"""Kane's equations of a mechanism at many states at once, in joint or in own coordinates.

Everything that the equations consist of is affine in the accelerations. So it is evaluated once at each
state; any number of candidate accelerations can then be tested there by products of small matrices.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from deltac.arrays import ASSEMBLED, SMALL_SHARE, Array, max_norm
from deltac.dynamics.admissible import onto_positions
from deltac.dynamics.constraints import ConstraintRows
from deltac.dynamics.coordinates import OwnCoordinates, trace_map
from deltac.dynamics.equations_of_motion import (
    EquationsOfMotion,
    equations_of_motion,
    evaluate_at,
    matrices,
    quaternions,
)
from deltac.dynamics.spatial import SX
from deltac.dynamics.system import System
from deltac.errors import ModelError
from deltac.mechanism.channels import Channel
from deltac.mechanism.coordinate_map import CoordinateMap, own_coordinates
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.state import State


@dataclass(frozen=True, eq=False)
class StatePoint:
    """The mechanism's free coordinates and speeds at B states, from own ones.

    `q` (nq, B), `u` = Y u′ + Z (n, B); `Y` (B, n, p) and `rest`, u̇ where u̇′ = 0 (n, B).
    """

    t: Array
    q: Array
    u: Array
    Y: Array
    rest: Array


WINDOW = (0.0, 10.0)
"""Times (s) that are drawn from, for laws that depend on time."""


@dataclass(frozen=True, eq=False)
class Scales:
    """Natural scales: `length` (m) and `rate` (1/s); `lever` (n,) is the length for speeds in m/s, else 1.

    A motion u = lever·rate has inertia forces of the size of the forces that act at rest.
    """

    length: float
    rate: float
    lever: Array

    @property
    def speed(self) -> Array:
        """A natural speed for each free speed (n,), m/s or rad/s."""
        return self.lever * self.rate


class Kane:
    """A mechanism written out, and functions of arrays of its states (batch last)."""

    def __init__(
        self,
        mechanism: Mechanism,
        coordinates: CoordinateMap | str | None = None,
        start: State | None = None,
        vary: Sequence[str] = (),
    ) -> None:
        """Trace the mechanism and the map; InputError where the map does not fit it.

        `start` tells which assembly of its loops is meant, where own coordinates leave that open. Parameters
        named in `vary` stay symbols; only `EquationTest.M`, `residual` and `acceleration` take their values.
        """
        self.mechanism = mechanism
        self.start = start
        self.coordinates = own_coordinates(mechanism, coordinates)
        self.motion: EquationsOfMotion = equations_of_motion(mechanism, vary)
        self.system: System = self.motion.system
        self.parts: tuple[Channel, ...] = self.motion.channels
        self.rows: ConstraintRows = self.motion.rows
        self.own: OwnCoordinates | None = (
            None
            if self.coordinates is None
            else trace_map(self.system, self.coordinates, self.rows)
        )

    @cached_property
    def scales(self) -> Scales:
        """The length and the rate at which the mechanism's own forces move it."""
        return _natural_scales(self)

    @cached_property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names of the coordinates of states: own ones, or the mechanism's free ones.

        These too where the user's give the others only by assembly (`user_names`).
        """
        if self.coordinates is not None and self.own is not None and self.own.mapped:
            return self.coordinates.coordinates
        return self.mechanism.coordinates.free_names

    @property
    def assembled(self) -> bool:
        """Whether the constraints say what the user's coordinates leave open."""
        return self.own is not None and self.own.user_q is not None

    @property
    def mode(self) -> str:
        """From where the assembly of the loops is taken, in words; "" where nothing is left open."""
        if not self.assembled or not any(self.rows.holonomic):
            return ""
        if self.start is not None:
            return "the start"
        return "one that was drawn; a pair (mechanism, state) for the model says which is meant"

    @cached_property
    def base(self) -> tuple[float, Array]:
        """A time and an assembled configuration (nq,) that tells which assembly is meant."""
        state = self.mechanism.state() if self.start is None else self.start
        q0 = state.q[self.mechanism.free.q]
        rng, still = np.random.default_rng(0), np.zeros(len(self.mechanism.free.u))
        for spread in (0.0, *np.linspace(0.1, 3.0, 30)):  # an assembled place may be far from q = 0
            near = q0 + spread * rng.standard_normal(len(q0))
            for place in self.motion.quaternions:
                near[place] /= np.linalg.norm(near[place])
            q = onto_positions(self.motion, state.t, near)
            phi, _ = self.motion.violation(state.t, q, still)
            if max_norm(phi) < ASSEMBLED:
                return state.t, q
        raise ModelError(
            f"mechanism {self.mechanism.name!r} could not be assembled near q = 0; give a pair (mechanism, "
            "state) for the model, so that the assembly that is meant is known"
        )

    @cached_property
    def user_names(self) -> tuple[str, ...]:
        """Names of the coordinates that functions of the user's are written in."""
        if not self.assembled:
            return self.coordinate_names
        assert self.coordinates is not None
        return self.coordinates.coordinates

    @cached_property
    def _user_function(self) -> Any:
        assert self.own is not None and self.own.user_q is not None
        s, own = self.system, self.own
        columns = [own.user_q, own.user_rate(s), ca.vec(ca.jacobian(own.user_q, s.q))]
        inputs = [s.t, s.q, own.own_u]
        return ca.Function("user", inputs, [ca.densify(x) for x in columns], {"cse": True})

    def user_coordinates(self, t: Array, q: Array, u: Array) -> tuple[Array, Array]:
        """The coordinates that functions of the user's are written in, and their rates, at states."""
        if not self.assembled:
            return q, self.own_rates(t, q, u)
        y, rate, _ = evaluate_at(self._user_function, t[None, :], q, u)
        return y, rate

    def user_slope(self, t: Array, q: Array) -> Array:
        """Jacobian (B, ny, nq) of those coordinates by the mechanism's."""
        u = np.zeros((len(self.speed_names), q.shape[1]))
        y, _, slope = evaluate_at(self._user_function, t[None, :], q, u)
        return matrices(slope, len(y), len(q))

    @cached_property
    def speed_names(self) -> tuple[str, ...]:
        """Names of the own speeds (without a map, of the free ones)."""
        if self.coordinates is not None:
            return self.coordinates.speeds
        return self.mechanism.speeds.free_names

    # --- functions of states -------------------------------------------------------------------

    def function(self, outputs: Sequence[SX], *more: SX) -> Any:
        """Outputs (dense columns) of (t, q, u, further symbols), motors without a law at zero."""
        s = self.system
        columns = [ca.densify(ca.vec(x)) for x in outputs]
        if s.inputs.shape[0]:
            columns = ca.substitute(columns, [s.inputs], [ca.SX.zeros(s.inputs.shape[0])])
        return ca.Function("kane", [s.t, s.q, s.u, *more], columns, {"cse": True})

    @cached_property
    def _map(self) -> Any:
        assert self.own is not None
        own, t = self.own, self.system.t
        rest = own.udot(self.system, ca.SX.zeros(own.own_u.shape[0]))
        columns = [ca.densify(ca.vec(x)) for x in (own.q, own.u, own.Y, rest)]
        inputs = [t, own.own_q, own.own_u, self.system.p]
        return ca.Function("map", inputs, columns, {"cse": True})

    def point(self, t: Array, own_q: Array, own_u: Array, p: ArrayLike = ()) -> StatePoint:
        """The mechanism's coordinates and speeds from own ones; `p` as in `EquationsOfMotion.terms`."""
        if self.own is None:
            n, batch = own_u.shape
            eye = np.broadcast_to(np.eye(n), (batch, n, n))
            return StatePoint(t, own_q, own_u, eye, np.zeros((n, batch)))
        q, u, Y, rest = evaluate_at(self._map, t[None, :], own_q, own_u, p)
        return StatePoint(t, q, u, matrices(Y, len(u), len(own_u)), rest)

    @cached_property
    def _inverse(self) -> Any:
        assert self.own is not None and self.own.inverse is not None
        s = self.system
        return ca.Function("inverse", [s.t, s.q], [ca.densify(self.own.inverse)])

    def own_coordinates(self, t: Array, q: Array) -> Array | None:
        """Own coordinates from the mechanism's; None if the map's inverse is not known."""
        if self.own is None:
            return q
        if self.own.inverse is None:
            return None
        return evaluate_at(self._inverse, t[None, :], q)[0]

    @cached_property
    def _own_rates(self) -> Any:
        s, own = self.system, self.own
        if own is None:
            return ca.Function("rates", [s.t, s.q, s.u], [ca.densify(s.qdot)])
        inputs = [s.t, own.own_q, own.own_u]
        if self.coordinates is None or not (self.coordinates.q and self.coordinates.u):
            return ca.Function("rates", inputs, [ca.densify(own.own_qdot)])
        along = ca.substitute(s.qdot, ca.vertcat(s.q, s.u), ca.vertcat(own.q, own.u))
        columns = [along - ca.jacobian(own.q, s.t), ca.vec(ca.jacobian(own.q, own.own_q))]
        return ca.Function("rates", inputs, [ca.densify(x) for x in columns])

    def own_rates(self, t: Array, own_q: Array, own_u: Array) -> Array:
        """q̇ (nq, B) of the own coordinates at states in own coordinates and speeds."""
        rates, *slopes = evaluate_at(self._own_rates, t[None, :], own_q, own_u)
        if not slopes:
            return rates
        # By orthogonal factors: the symbols' normal equations lose half of the digits.
        back: Array = np.asarray(np.linalg.pinv(matrices(slopes[0], len(rates), len(own_q))))
        return times(back, rates)


def _natural_scales(kane: Kane) -> Scales:
    """The length and the rate at which a mechanism's own forces move it (see `Scales`)."""
    length = _length(kane.mechanism)
    units = [kane.mechanism.speeds[int(k)].unit for k in kane.mechanism.free.u]
    lever = np.array([length if unit == "m/s" else 1.0 for unit in units])
    rng = np.random.default_rng(0)
    t = rng.uniform(*WINDOW, 32)
    q = any_coordinates(kane.mechanism, length, rng, 32)
    at_rest = kane.motion.terms(t, q, np.zeros((len(lever), 32)))
    force = np.abs(at_rest.force - at_rest.bias)
    inertia = np.einsum("bij,i,j->b", np.abs(at_rest.M), lever, lever)
    energy = lever @ force
    usable = np.isfinite(energy) & np.isfinite(inertia) & (inertia > 0.0)
    ratio = energy[usable] / inertia[usable]
    rate = float(np.sqrt(np.median(ratio))) if usable.any() else 0.0
    return Scales(length, rate if rate > 1e-6 else 1.0, lever)


def _length(mechanism: Mechanism) -> float:
    """The largest length (m) among joint placements, mass centres and radii of gyration; 1 if none.

    An inertia with next to no mass has no such radius: it is taken with a share of the whole mass.
    """
    number = mechanism.number
    light = SMALL_SHARE * sum(number(body.mass) for body in mechanism.bodies if not body.massless)
    lengths = [0.0]
    for joint in mechanism.joints:
        for place in (joint.position, joint.child_position):
            lengths.append(float(np.linalg.norm([number(x) for x in place])))
    for body in mechanism.bodies:
        lengths.append(float(np.linalg.norm([number(x) for x in body.mass_centre])))
        if not body.massless:
            trace = sum(number(body.inertia[k][k]) for k in range(3))
            lengths.append(float(np.sqrt(trace / (2.0 * max(number(body.mass), light)))))
    return max(lengths) or 1.0


def any_coordinates(
    mechanism: Mechanism, length: float, rng: np.random.Generator, count: int
) -> Array:
    """Free coordinates (nq, count) without regard to constraints."""
    entries = [mechanism.coordinates[int(k)] for k in mechanism.free.q]
    reach = np.array([length if entry.unit == "m" else np.pi for entry in entries])
    q = reach[:, None] * rng.uniform(-1.0, 1.0, (len(entries), count))
    for place in quaternions(mechanism):
        turn = rng.standard_normal((4, count))
        q[place] = turn / np.linalg.norm(turn, axis=0)
    return q


def times(A: Array, x: Array) -> Array:
    """A x at every state: matrices (B, m, n) by columns (n, B)."""
    return np.asarray((A @ x.T[:, :, None])[:, :, 0].T)
