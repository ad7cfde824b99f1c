"""Systems of few coordinates with equations of our own, written for rows at once, and their models."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import deltac as dc
from judge.truth import Array, Plant

Numbers = Mapping[str, float]
Names = tuple[tuple[str, ...], tuple[str, ...]]
"""Kinds and elements of the causes that name a fault; no elements: any."""

MASS = ("body-mass", "body-inertia", "mass-scale")
DAMPER = ("damping", "missing-damper", "damper", "channel-differs")
SPRING = ("stiffness", "missing-spring", "spring")
FRICTION = ("missing-friction", "friction", "dry-friction", "joint-friction")
GRAVITY = ("gravity", "gravity-vector")
DRAG = ("missing-drag", "drag")
GEAR = ("actuator-gear", "channel-factor", "gear")
GEOMETRY = (
    "geometry", "length", "size", "place", "axis", "position", "orientation", "centre", "joint",
)  # fmt: skip
"""Words in the kinds of causes of geometry."""


@dataclass(frozen=True)
class System:
    """Accelerations u̇(t, q, u, τ; p) of rows (N, n), energy, and the model of `deltac` with the numbers p.

    `faults` names each number that may be wrong, with what it is counted in and the causes that name it.
    """

    name: str
    numbers: Numbers
    faults: Mapping[str, tuple[float, Names]]
    acceleration: Callable[[Array, Array, Array, Array, Numbers], Array]
    energy: Callable[[Array, Array, Numbers], Array]
    mechanism: Callable[[Numbers], dc.Mechanism]
    damping: Callable[[Numbers], Array]
    mass: Callable[[Array, Numbers], Array]

    def plant(self, p: Numbers) -> Plant:
        n = len(self.damping(p))

        def rate(t: Array, x: Array, tau: Array) -> Array:
            return np.hstack([x[:, n:], self.acceleration(t, x[:, :n], x[:, n:], tau, p)])

        return Plant(
            rate,
            lambda x: self.energy(x[:, :n], x[:, n:], p),
            n,
            self.damping(p),
            lambda x: self.mass(x[:, :n], p),
        )


def _solved(M: Array, f: Array) -> Array:
    return np.asarray(np.linalg.solve(M, f[..., None])[..., 0])


def _matrix(a: Any, b: Any, c: Any) -> Array:
    """Symmetric matrices (N, 2, 2)."""
    a, b, c = np.broadcast_arrays(a, b, c)
    return np.stack([np.stack([a, b], -1), np.stack([b, c], -1)], -2)


def double_pendulum(rng: np.random.Generator) -> System:
    """Point masses in relative angles, dampers at both joints, a torque at the first."""
    p = dict(
        m1=1.0, m2=0.7, L1=0.6, L2=0.4, c1=0.02, c2=0.01, g=9.81, k=0.0, drag=0.0, dry=0.0, gear=1.0
    )
    p |= dict(
        m1=rng.uniform(0.5, 2),
        m2=rng.uniform(0.3, 1.5),
        L1=rng.uniform(0.3, 0.8),
        L2=rng.uniform(0.3, 0.8),
    )

    def parts(q: Array, p: Numbers) -> tuple[Array, Array, Array]:
        c, s = np.cos(q[:, 1]), np.sin(q[:, 1])
        a, b, d = (
            (p["m1"] + p["m2"]) * p["L1"] ** 2,
            p["m2"] * p["L1"] * p["L2"],
            p["m2"] * p["L2"] ** 2,
        )
        return _matrix(a + d + 2 * b * c, d + b * c, d), b * s, c

    def acceleration(t: Array, q: Array, u: Array, tau: Array, p: Numbers) -> Array:
        M, bs, _ = parts(q, p)
        w, v = u.T
        g1 = (p["m1"] + p["m2"]) * p["g"] * p["L1"] * np.sin(q[:, 0])
        g2 = p["m2"] * p["g"] * p["L2"] * np.sin(q[:, 0] + q[:, 1])
        f1 = bs * v * (2 * w + v) - g1 - g2 - p["c1"] * w - p["k"] * q[:, 0] + p["gear"] * tau[:, 0]
        f1 = f1 - p["drag"] * w * np.abs(w) - p["dry"] * np.tanh(w / 0.02)
        f2 = -bs * w * w - g2 - p["c2"] * v
        return _solved(M, np.stack([f1, f2], -1))

    def energy(q: Array, u: Array, p: Numbers) -> Array:
        M = parts(q, p)[0]
        V = -(p["m1"] + p["m2"]) * p["g"] * p["L1"] * np.cos(q[:, 0]) - p["m2"] * p["g"] * p[
            "L2"
        ] * np.cos(q.sum(1))
        return np.asarray(
            0.5 * np.einsum("ni,nij,nj->n", u, M, u) + V + 0.5 * p["k"] * q[:, 0] ** 2
        )

    def mechanism(p: Numbers) -> dc.Mechanism:
        return dc.Mechanism(
            [dc.point_mass("a", p["m1"]), dc.point_mass("b", p["m2"])],
            [
                dc.revolute("j1", "ground", "a", child_position=(0, p["L1"], 0), damping=p["c1"]),
                dc.revolute("j2", "a", "b", child_position=(0, p["L2"], 0), damping=p["c2"]),
            ],
            forces=[dc.forces.joint_torque("motor", "j1")],
            gravity=(0, -p["g"], 0),
        )

    faults = {
        "m1": (p["m1"], (MASS, ("a",))),
        "m2": (p["m2"], (MASS, ("b",))),
        "c1": (p["c1"], (DAMPER, ("j1",))),
        "c2": (p["c2"], (DAMPER, ("j2",))),
        "g": (p["g"], (GRAVITY, ())),
        "L1": (p["L1"], (GEOMETRY, ("a", "j1", "j2"))),
        "L2": (p["L2"], (GEOMETRY, ("b", "j2"))),
        "k": (0.5, (SPRING, ("j1",))),
        "drag": (0.02, (DRAG, ("j1",))),
        "dry": (0.05, (FRICTION, ("j1",))),
    }
    return System(
        "double pendulum",
        p,
        faults,
        acceleration,
        energy,
        mechanism,
        lambda p: np.array([p["c1"], p["c2"]]),
        lambda q, p: parts(q, p)[0],
    )


def pendulum(rng: np.random.Generator) -> System:
    """A pendulum with a motor."""
    p = dict(m=1.0, L=rng.uniform(0.4, 1.0), c=0.05, g=9.81, drag=0.0, dry=0.0, gear=1.0)

    def acceleration(t: Array, q: Array, u: Array, tau: Array, p: Numbers) -> Array:
        f = (
            p["gear"] * tau
            - p["c"] * u
            - p["m"] * p["g"] * p["L"] * np.sin(q)
            - p["drag"] * u * np.abs(u)
        )
        return np.asarray((f - p["dry"] * np.tanh(u / 0.02)) / (p["m"] * p["L"] ** 2))

    def energy(q: Array, u: Array, p: Numbers) -> Array:
        return np.asarray(
            0.5 * p["m"] * p["L"] ** 2 * u[:, 0] ** 2 - p["m"] * p["g"] * p["L"] * np.cos(q[:, 0])
        )

    def mechanism(p: Numbers) -> dc.Mechanism:
        return dc.Mechanism(
            [dc.point_mass("bob", p["m"])],
            [dc.revolute("pivot", "ground", "bob", child_position=(0, p["L"], 0), damping=p["c"])],
            forces=[dc.forces.joint_torque("motor", "pivot")],
            gravity=(0, -p["g"], 0),
        )

    faults = {
        "m": (p["m"], (MASS, ("bob",))),
        "c": (p["c"], (DAMPER, ("pivot",))),
        "g": (p["g"], (GRAVITY, ())),
        "L": (p["L"], (GEOMETRY, ("bob", "pivot"))),
        "drag": (0.05, (DRAG, ("pivot",))),
        "dry": (0.1, (FRICTION, ("pivot",))),
        "gear": (1.0, (GEAR, ())),
    }
    return System(
        "held pendulum",
        p,
        faults,
        acceleration,
        energy,
        mechanism,
        lambda p: np.array([p["c"]]),
        lambda q, p: np.full((len(q), 1, 1), p["m"] * p["L"] ** 2),
    )


def cart_pole(rng: np.random.Generator) -> System:
    """A pole on a cart, pushed by a motor; the angle is zero upright."""
    p = dict(
        M=rng.uniform(0.5, 2),
        m=rng.uniform(0.1, 0.5),
        l=rng.uniform(0.2, 0.6),
        J=0.0,
        b=0.1,
        c=0.005,
        g=9.81,
        gear=1.0,
        dry=0.0,
    )
    p["J"] = p["m"] * p["l"] ** 2 / 3

    def mass(q: Array, p: Numbers) -> Array:
        return _matrix(
            p["M"] + p["m"], p["m"] * p["l"] * np.cos(q[:, 1]), p["J"] + p["m"] * p["l"] ** 2
        )

    def acceleration(t: Array, q: Array, u: Array, tau: Array, p: Numbers) -> Array:
        s, w = np.sin(q[:, 1]), u[:, 1]
        f1 = (
            p["gear"] * tau[:, 0]
            - p["b"] * u[:, 0]
            + p["m"] * p["l"] * s * w * w
            - p["dry"] * np.tanh(u[:, 0] / 0.02)
        )
        return _solved(mass(q, p), np.stack([f1, p["m"] * p["g"] * p["l"] * s - p["c"] * w], -1))

    def energy(q: Array, u: Array, p: Numbers) -> Array:
        K = 0.5 * np.einsum("ni,nij,nj->n", u, mass(q, p), u)
        return np.asarray(K + p["m"] * p["g"] * p["l"] * np.cos(q[:, 1]))

    def mechanism(p: Numbers) -> dc.Mechanism:
        J = p["J"]
        return dc.Mechanism(
            [
                dc.body("cart", mass=p["M"], inertia=(0.1, 0.1, 0.1)),
                dc.body("pole", mass=p["m"], inertia=(J, J, 0.05 * J), mass_centre=(0, 0, p["l"])),
            ],
            [
                dc.prismatic("rail", "ground", "cart", "x", damping=p["b"]),
                dc.revolute("hinge", "cart", "pole", "y", damping=p["c"]),
            ],
            forces=[dc.forces.joint_torque("motor", "rail")],
            gravity=(0, 0, -p["g"]),
        )

    faults = {
        "M": (p["M"], (MASS, ("cart",))),
        "m": (p["m"], (MASS, ("pole",))),
        "J": (
            p["J"],
            (
                (
                    "body-moments",
                    "body-moment",
                    "body-inertia",
                    "body-tensor",
                    "missing-rotor-inertia",
                    "armature",
                ),
                ("pole", "hinge"),
            ),
        ),
        "l": (p["l"], ((*GEOMETRY, "body-centre"), ("pole", "hinge"))),
        "b": (p["b"], (DAMPER, ("rail",))),
        "c": (p["c"], (DAMPER, ("hinge",))),
        "g": (p["g"], (GRAVITY, ())),
        "gear": (1.0, (GEAR, ())),
        "dry": (0.2, (FRICTION, ("rail",))),
    }
    return System(
        "cart-pole",
        p,
        faults,
        acceleration,
        energy,
        mechanism,
        lambda p: np.array([p["b"], p["c"]]),
        mass,
    )


def ball_on_floor(rng: np.random.Generator) -> System:
    """A ball on a floor by Hertz's law with the damping of Hunt and Crossley."""
    p = dict(
        m=rng.uniform(0.3, 2),
        g=9.81,
        k=float(10 ** rng.uniform(3.3, 4.3)),
        d=rng.uniform(0.0, 0.4),
        drag=0.0,
    )
    r = 0.1

    def acceleration(t: Array, q: Array, u: Array, tau: Array, p: Numbers) -> Array:
        depth = np.maximum(0.0, r - q)
        f = p["k"] * depth**1.5 * np.maximum(0.0, 1 - p["d"] * u) - p["drag"] * u
        return np.asarray(f / p["m"] - p["g"])

    def energy(q: Array, u: Array, p: Numbers) -> Array:
        depth = np.maximum(0.0, r - q[:, 0])
        return np.asarray(
            0.5 * p["m"] * u[:, 0] ** 2 + p["m"] * p["g"] * q[:, 0] + p["k"] * depth**2.5 / 2.5
        )

    def mechanism(p: Numbers) -> dc.Mechanism:
        shapes = dc.shapes
        return dc.Mechanism(
            [dc.bodies.sphere("ball", p["m"], r)],
            [dc.prismatic("height", "ground", "ball", "z")],
            forces=[
                dc.forces.contact(
                    "floor",
                    shapes.sphere("ball", r),
                    shapes.half_space(),
                    p["k"],
                    exponent=1.5,
                    dissipation=p["d"],
                )
            ],
            gravity=(0, 0, -p["g"]),
        )

    contact = ("contact", "stiffness", "dissipation", "spring", "channel-factor")
    both = ("floor", "ball", "spring floor", "contact floor")
    faults = {
        "m": (p["m"], ((*MASS, *contact), both)),
        "k": (p["k"], ((*contact, *MASS), both)),
        "g": (p["g"], (GRAVITY, ())),
        "d": (0.3, (contact, both)),
        "drag": (0.05, ((*DRAG, *DAMPER), ("height", "ball"))),
    }
    return System(
        "ball on floor",
        p,
        faults,
        acceleration,
        energy,
        mechanism,
        lambda p: np.zeros(1),
        lambda q, p: np.full((len(q), 1, 1), p["m"]),
    )


def rubbing_slider(rng: np.random.Generator) -> System:
    """A mass on a spring that rubs: dry friction of its own."""
    p = dict(m=rng.uniform(0.3, 3), k=rng.uniform(20, 200), f=rng.uniform(0.1, 1.0), c=0.05)
    width = float(rng.choice([0.01, 0.05]))

    def acceleration(t: Array, q: Array, u: Array, tau: Array, p: Numbers) -> Array:
        return np.asarray((-p["k"] * q - p["f"] * np.tanh(u / width) - p["c"] * u + tau) / p["m"])

    def energy(q: Array, u: Array, p: Numbers) -> Array:
        return np.asarray(0.5 * p["m"] * u[:, 0] ** 2 + 0.5 * p["k"] * q[:, 0] ** 2)

    def mechanism(p: Numbers) -> dc.Mechanism:
        return dc.Mechanism(
            [dc.point_mass("block", p["m"])],
            [dc.prismatic("slide", "ground", "block", "x", stiffness=p["k"], damping=p["c"])],
            forces=[
                dc.forces.joint_friction("rub", "slide", p["f"], width=width),
                dc.forces.joint_torque("motor", "slide"),
            ],
        )

    faults = {
        "m": (p["m"], (MASS, ("block",))),
        "k": (p["k"], ((*SPRING, "channel-factor"), ())),
        "f": (p["f"], ((*FRICTION, "channel-factor"), ())),
        "c": (p["c"], (DAMPER, ("slide",))),
    }
    return System(
        "rubbing slider",
        p,
        faults,
        acceleration,
        energy,
        mechanism,
        lambda p: np.array([p["c"]]),
        lambda q, p: np.full((len(q), 1, 1), p["m"]),
    )


def crane(rng: np.random.Generator) -> System:
    """A load that hangs on a trolley driven to and fro.

    Its energy is that of the sway in the trolley's frame: the drive's work goes with the accelerations that
    the log has, so that only a force on the sway adds to C.
    """
    A, w = float(rng.uniform(0.1, 0.6)), float(rng.uniform(1.0, 4.0))
    p = dict(m=float(np.exp(rng.uniform(-1, 1))), l=rng.uniform(0.3, 1.5), J=0.0, c=0.0, g=9.81)
    p |= dict(J=0.05 * p["m"] * p["l"] ** 2, c=0.02 * p["m"] * p["l"] ** 2)

    def acceleration(t: Array, q: Array, u: Array, tau: Array, p: Numbers) -> Array:
        pull = (A * w * w * np.sin(w * t))[:, None] * np.cos(q) * p["m"] * p["l"]
        f = -p["m"] * p["g"] * p["l"] * np.sin(q) - p["c"] * u - pull
        return np.asarray(f / (p["J"] + p["m"] * p["l"] ** 2))

    def energy(q: Array, u: Array, p: Numbers) -> Array:
        K = 0.5 * (p["J"] + p["m"] * p["l"] ** 2) * u[:, 0] ** 2
        return np.asarray(K - p["m"] * p["g"] * p["l"] * np.cos(q[:, 0]))

    def mechanism(p: Numbers) -> dc.Mechanism:
        J = p["J"]
        return dc.Mechanism(
            [
                dc.body("trolley", mass=2.0, inertia=(1.0, 1.0, 1.0)),
                dc.body("load", mass=p["m"], inertia=(J, J, J), mass_centre=(0, 0, -p["l"])),
            ],
            [
                dc.prismatic("x", "ground", "trolley", "x", motion=f"{A!r}*sin({w!r}*t)"),
                dc.revolute("sway", "trolley", "load", "y", damping=p["c"]),
            ],
            gravity=(0, 0, -p["g"]),
            name=f"{A!r} {w!r}",
        )

    turning = (
        "body-moments",
        "body-moment",
        "body-inertia",
        "body-tensor",
        "missing-rotor-inertia",
        "armature",
    )
    faults = {
        "m": (p["m"], (("body-centre", *MASS, *turning, *DAMPER), ("load", "sway"))),
        "g": (p["g"], (GRAVITY, ())),
        "J": (p["J"], (turning, ("load", "sway"))),
        "c": (p["c"], (DAMPER, ("sway",))),
        "l": (p["l"], ((*GEOMETRY, "body-centre"), ("load", "sway"))),
    }
    return System(
        "crane",
        p,
        faults,
        acceleration,
        energy,
        mechanism,
        lambda p: np.array([p["c"]]),
        lambda q, p: np.full((len(q), 1, 1), p["J"] + p["m"] * p["l"] ** 2),
    )
