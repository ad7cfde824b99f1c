"""Constraints of the textbook: the geometry of every kind, in plain NumPy.

Each kind is written twice, as one draws it on paper: where things are, f(x, t), and how fast they move,
ψ = J v + f_t (or A v + b at motion constraints), with velocities and ω × d instead of derivatives. What
follows from them is in `tests.oracles.textbook.constrained`. Laws must be smooth.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from deltac.mechanism.constraints import (
    Angle,
    Distance,
    HigherPair,
    Holonomic,
    Loop,
    MotionConstraint,
    PointOn,
    Rolling,
    Skate,
    perpendiculars,
)
from deltac.mechanism.laws import rate
from deltac.mechanism.mechanism import Mechanism
from tests.oracles.textbook.kinematics import Array, Frame, coordinate_rates, skew


@dataclass(frozen=True, eq=False)
class Scene:
    """Bodies as they are and move at an instant; everything may be complex inside `along`.

    `frames` hold partial velocities for the columns of `w`; `u` (nu,) are the joints' speeds. Pairs that
    methods return are a quantity and its rate.
    """

    mechanism: Mechanism
    t: Any
    q: Array
    u: Array
    frames: Mapping[str, Frame]
    w: Array

    def laws(self, laws: Iterable[Any], **more: Any) -> tuple[Array, Array]:
        """Values of laws, and their explicit rates ∂/∂t."""
        known = self.known(**more)
        given = list(laws)
        return (
            np.array([value(law, known) for law in given]),
            np.array([value(rate(law), known) for law in given]),
        )

    def known(self, **more: Any) -> dict[str, Any]:
        """Values of the symbols in laws."""
        m = self.mechanism
        q = {f"q.{e.name}": self.q[e.index] for e in m.coordinates}
        u = {f"u.{e.name}": self.u[e.index] for e in m.speeds}
        return {**m.parameters, **q, **u, "t": self.t, **more}

    def turned(self, body: str) -> Array:
        """The body's axes in the world, as columns."""
        return self.frames[body].turned

    def omega(self, body: str) -> Array:
        """Angular velocity (world)."""
        omega: Array = self.frames[body].P_w @ self.w
        return omega

    def velocity(self, body: str, place: Array) -> Array:
        """Velocity of the body's material point at `place`."""
        velocity: Array = self.frames[body].partial_velocity(place) @ self.w
        return velocity

    def point(self, body: str, point: Iterable[Any]) -> tuple[Array, Array]:
        """A point given in the body frame, which may wander there: place and velocity."""
        at, wanders = self.laws(point)
        place = self.frames[body].place(at)
        return place, self.velocity(body, place) + self.turned(body) @ wanders

    def axis(self, body: str, axis: Iterable[float]) -> tuple[Array, Array]:
        """A direction fixed in a body, and its rate ω × a."""
        a = self.turned(body) @ np.array(axis)
        return a, np.cross(self.omega(body), a)

    def seen_from(self, body: str, place: Array, velocity: Array) -> tuple[Array, Array]:
        """Coordinates of a place in a body frame, and their rates."""
        frame = self.frames[body]
        relative = velocity - self.velocity(body, place)
        return frame.turned.T @ (place - frame.origin), frame.turned.T @ relative


@lru_cache(maxsize=4096)
def _compiled(law: Any) -> tuple[tuple[str, ...], Callable[..., Any]]:
    import sympy

    symbols = sorted(law.free_symbols, key=lambda symbol: str(symbol.name))
    return tuple(symbol.name for symbol in symbols), sympy.lambdify(symbols, law, "numpy")


def value(law: Any, known: Mapping[str, Any]) -> Any:
    """A smooth law at real or complex values."""
    if isinstance(law, float):
        return law
    names, function = _compiled(law)
    return function(*(known[name] for name in names))


def slopes(law: Any, names: Iterable[str], known: Mapping[str, Any]) -> Array:
    """The partial derivatives of a law by symbols of those names."""
    by_name = {} if isinstance(law, float) else {s.name: s for s in law.free_symbols}
    found = [value(_slope(law, by_name[n]), known) if n in by_name else 0.0 for n in names]
    return np.array(found)


@lru_cache(maxsize=4096)
def _slope(law: Any, symbol: Any) -> Any:
    derivative = law.diff(symbol)
    return derivative if derivative.free_symbols else float(derivative)


# --- the kinds: (f, ψ) of holonomic rows, then ψ of motion rows --------------------------------------

Rows = tuple[list[Any], list[Any]]


def _loop(now: Scene, c: Loop) -> Rows:
    place1, velocity1 = now.point(c.body1, c.point1)
    place2, velocity2 = now.point(c.body2, c.point2)
    first, turning = now.turned(c.body1), now.omega(c.body2) - now.omega(c.body1)
    gap, opening = place2 - place1, velocity2 - velocity1
    sides = np.array(perpendiculars(c.axis1))
    a2, _ = now.axis(c.body2, c.axis2)
    f, psi = [*gap], [*opening]
    if c.kind == "prismatic":
        f = [*(sides @ first.T @ gap)]
        psi = [*(sides @ first.T @ (opening - np.cross(now.omega(c.body1), gap)))]
    if c.kind in ("prismatic", "weld"):
        wanted: Array = np.array(c.rotation).T
        relative = first.T @ now.turned(c.body2) @ wanted
        f += [*_vee(relative)]
        psi += [*_vee(first.T @ skew(turning) @ now.turned(c.body2) @ wanted)]
    if c.kind == "revolute":
        f += [*(sides @ first.T @ a2)]
        psi += [*(sides @ first.T @ np.cross(turning, a2))]
    if c.kind == "universal":
        a1, _ = now.axis(c.body1, c.axis1)
        f.append(a1 @ a2)
        psi.append(turning @ np.cross(a2, a1))
    return f, psi


def _vee(R: Array) -> Array:
    """The vector of the skew part of R."""
    return 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])


def _distance(now: Scene, c: Distance) -> Rows:
    place1, velocity1 = now.point(c.body1, c.point1)
    place2, velocity2 = now.point(c.body2, c.point2)
    gap, opening = place2 - place1, velocity2 - velocity1
    (l,), (l_dot,) = now.laws((c.length,))
    square = gap @ gap
    f = 0.5 * (square / l - l)
    return [f], [(gap @ opening) / l - 0.5 * l_dot * (square / l**2 + 1)]


def _point_on(now: Scene, c: PointOn) -> Rows:
    x, x_dot = now.seen_from(c.on, *now.point(c.body, c.point))
    place = dict(zip("xyz", x))
    f, f_t = now.laws(c.equations, **place)
    gradients = [slopes(law, "xyz", now.known(**place)) for law in c.equations]
    return [*f], [g @ x_dot + e for g, e in zip(gradients, f_t)]


def _angle(now: Scene, c: Angle) -> Rows:
    a1, a1_dot = now.axis(c.body1, c.axis1)
    a2, a2_dot = now.axis(c.body2, c.axis2)
    (angle,), (opening,) = now.laws((c.angle,))
    cosine, cosine_dot = a1 @ a2, a1_dot @ a2 + a1 @ a2_dot
    return [np.arccos(cosine) - angle], [-cosine_dot / np.sqrt(1 - cosine**2) - opening]


def _holonomic(now: Scene, c: Holonomic) -> Rows:
    f, f_t = now.laws((c.law,))
    names = [f"q.{name}" for name in now.mechanism.coordinates.names]
    q_dot = coordinate_rates(now.mechanism, now.q) @ now.u
    return [*f], [slopes(c.law, names, now.known()) @ q_dot + f_t[0]]


def _motion(now: Scene, c: MotionConstraint) -> Rows:
    return [], [value(c.law, now.known())]


def _lowest(now: Scene, c: Rolling) -> Array:
    """The wheel's point that is lowest over the plane: down the circle, then down the tube."""
    n, _ = now.axis(c.on, c.normal)
    a, _ = now.axis(c.body, c.axis)
    (radius, tube), _ = now.laws((c.radius, c.tube))
    place, _ = now.point(c.body, c.centre)
    if radius != 0.0:
        down = -(n - (n @ a) * a)
        place = place + radius * down / np.sqrt(down @ down)
    lowest: Array = place - tube * n
    return lowest


def _rolling(now: Scene, c: Rolling) -> Rows:
    """The lowest point's height changes as the material point there moves: it is the lowest."""
    lowest = _lowest(now, c)
    n, _ = now.axis(c.on, c.normal)
    base, _ = now.point(c.on, c.point)
    _, wanders = now.laws(c.point)
    slip = now.velocity(c.body, lowest) - now.velocity(c.on, lowest)
    x, _ = now.seen_from(c.on, lowest, slip)
    surface, _ = now.laws(c.surface_velocity, **dict(zip("xyz", x)))
    turned = now.turned(c.on)
    sides = turned @ np.array(perpendiculars(c.normal)).T
    rising = n @ (slip - turned @ wanders)
    return [n @ (lowest - base)], [rising, *(sides.T @ (slip - turned @ surface))]


def _higher_pair(now: Scene, c: HigherPair) -> Rows:
    """Normals −∇f turn with their bodies and, in these, as the point wanders: ġ = −H ẋ − ∂∇f/∂t."""
    place, velocity = now.point(c.at, (0.0, 0.0, 0.0))
    heights, normals = [], []
    for body, law in ((c.body1, c.surface1), (c.body2, c.surface2)):
        x, x_dot = now.seen_from(body, place, velocity)
        known = now.known(**dict(zip("xyz", x)))
        by_name = {s.name: s for s in law.free_symbols}
        gradient = [law.diff(by_name[n]) if n in by_name else 0.0 for n in "xyz"]
        g = -np.array([value(_number(e), known) for e in gradient])
        H = [-slopes(_number(e), "xyzt", known) for e in gradient]
        g_dot = np.array(H) @ np.append(x_dot, 1.0)
        size = np.sqrt(g @ g)
        f, (f_dot,) = value(law, known), slopes(law, "t", known)
        n = g / size
        heights.append((f / size, (f_dot - g @ x_dot) / size - f * (g @ g_dot) / size**3))
        n_dot = (g_dot - n * (n @ g_dot)) / size
        turned = now.turned(body)
        normals.append((turned @ n, np.cross(now.omega(body), turned @ n) + turned @ n_dot))
    (n1, n1_dot), (n2, n2_dot) = normals
    d, d_dot = now.axis(c.body2, c.along)
    across, across_dot = np.cross(n2, d), np.cross(n2_dot, d) + np.cross(n2, d_dot)
    size = np.sqrt(across @ across)
    e2 = across / size
    e2_dot = (across_dot - e2 * (e2 @ across_dot)) / size
    e1, e1_dot = np.cross(e2, n2), np.cross(e2_dot, n2) + np.cross(e2, n2_dot)
    f = [heights[0][0], heights[1][0], n1 @ e1, n1 @ e2]
    psi = [heights[0][1], heights[1][1], n1_dot @ e1 + n1 @ e1_dot, n1_dot @ e2 + n1 @ e2_dot]
    slip = now.velocity(c.body1, place) - now.velocity(c.body2, place)
    return f, psi + ([e1 @ slip, e2 @ slip] if c.rolling else [])


def _number(law: Any) -> Any:
    return law if getattr(law, "free_symbols", ()) else float(law)


def _skate(now: Scene, c: Skate) -> Rows:
    place, velocity = now.point(c.body, c.point)
    across, _ = now.axis(c.body, c.lateral)
    (drift,), _ = now.laws((c.drift,))
    return [], [across @ (velocity - now.velocity(c.on, place)) - drift]


KINDS: dict[type, Callable[[Scene, Any], Rows]] = {
    Loop: _loop,
    Distance: _distance,
    PointOn: _point_on,
    Angle: _angle,
    Holonomic: _holonomic,
    MotionConstraint: _motion,
    Rolling: _rolling,
    HigherPair: _higher_pair,
    Skate: _skate,
}
"""f and ψ of every kind; ψ has the motion rows behind the holonomic ones."""
