"""A cart with a pole, its equations written by hand, and logs of it by integrators that users write.

The oracle shares no code with deltac: Lagrange's equations of x and θ, θ right-handed about y from the
horizontal, so that the pole's centre is at x + l cos θ, −l sin θ.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

import deltac as dc

Array: TypeAlias = NDArray[np.float64]
Rate: TypeAlias = Callable[[float, Array, Array], Array]
NAMES = ("slide", "hinge")


@dataclass(frozen=True)
class CartPole:
    """Masses (kg), length to the pole's centre (m), central inertia (kg·m²), dampers, gravity (m/s²)."""

    cart: float = 1.5
    pole: float = 0.6
    length: float = 0.4
    inertia: float = 0.03
    slide: float = 0.3
    hinge: float = 0.05
    gravity: float = 9.81
    drive: float = 4.0

    def force(self, t: Array | float) -> Array:
        """The motor's force on the cart, N."""
        return np.asarray(self.drive * np.sin(3.0 * np.asarray(t)))

    def acceleration(self, t: float, q: Array, u: Array, force: float | None = None) -> Array:
        """Accelerations of slide and hinge: M u̇ = f by Cramer's rule, in plain numbers."""
        m, l, theta, rate = self.pole, self.length, float(q[1]), float(u[1])
        push = self.drive * math.sin(3.0 * t) if force is None else force
        x = push - self.slide * float(u[0]) + m * l * math.cos(theta) * rate**2
        y = m * self.gravity * l * math.cos(theta) - self.hinge * rate + self.more(theta, rate)
        a, b, c = self.cart + m, -m * l * math.sin(theta), self.inertia + m * l**2
        return np.array([c * x - b * y, a * y - b * x]) / (a * c - b * b)

    def more(self, angle: float, rate: float) -> float:
        """A torque at the hinge that the mechanism does not have."""
        return 0.0

    def mechanism(self) -> dc.Mechanism:
        """The same as a mechanism; the motor's force is left to the log."""
        return dc.Mechanism(
            bodies=[
                dc.body("cart", mass=self.cart, inertia=(0.01, 0.01, 0.01)),
                dc.body(
                    "pole", mass=self.pole, inertia=(1e-4, self.inertia, self.inertia),
                    mass_centre=(self.length, 0, 0),
                ),
            ],
            joints=[
                dc.prismatic("slide", "ground", "cart", "x", damping=self.slide),
                dc.revolute("hinge", "cart", "pole", "y", damping=self.hinge),
            ],
            forces=[dc.forces.joint_torque("motor", "slide")],
            gravity=(0, 0, -self.gravity),
            name="cart-pole",
        )  # fmt: skip


Step = Callable[
    [Callable[[float, Array, Array], Array], float, Array, Array, float], tuple[Array, Array]
]


def explicit_euler(f, t, q, u, h):  # type: ignore[no-untyped-def]
    return q + h * u, u + h * f(t, q, u)


def semi_implicit_euler(f, t, q, u, h):  # type: ignore[no-untyped-def]
    v = u + h * f(t, q, u)
    return q + h * v, v


def heun(f, t, q, u, h):  # type: ignore[no-untyped-def]
    a = f(t, q, u)
    v = u + h * a
    return q + h / 2 * (u + v), u + h / 2 * (a + f(t + h, q + h * u, v))


def rk4(f: Rate, t: float, q: Array, u: Array, h: float) -> tuple[Array, Array]:
    a1 = f(t, q, u)
    a2 = f(t + h / 2, q + h / 2 * u, u + h / 2 * a1)
    a3 = f(t + h / 2, q + h / 2 * u + h**2 / 4 * a1, u + h / 2 * a2)
    a4 = f(t + h, q + h * u + h**2 / 2 * a2, u + h * a3)
    return q + h * u + h**2 / 6 * (a1 + a2 + a3), u + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)


def fixed_point(f: Callable[[Array], Array], x: Array) -> Array:
    """What a contraction tends to, to the last bits."""
    for _ in range(60):
        before, x = x, f(x)
        if close(x, before):
            break
    return x


def close(x: Array, before: Array) -> bool:
    """Whether an iteration has come to rest."""
    return float(np.abs(x - before).max()) < 1e-15 * float(np.abs(x).max())


def trapezoidal(f, t, q, u, h):  # type: ignore[no-untyped-def]
    a = f(t, q, u)
    v = fixed_point(lambda v: u + h / 2 * (a + f(t + h, q + h / 2 * (u + v), v)), u + h * a)
    return q + h / 2 * (u + v), v


def implicit_euler(f, t, q, u, h):  # type: ignore[no-untyped-def]
    v = fixed_point(lambda v: u + h * f(t + h, q + h * v, v), u)
    return q + h * v, v


SCHEMES: dict[str, Step] = {
    "explicit-euler": explicit_euler,
    "semi-implicit-euler": semi_implicit_euler,
    "heun": heun,
    "rk4": rk4,
    "trapezoidal": trapezoidal,
    "implicit-euler": implicit_euler,
}


@lru_cache(64)
def log(
    system: CartPole,
    scheme: str = "rk4",
    *,
    step: float = 0.004,
    duration: float = 3.0,
    held: bool = False,
    accelerations: bool = True,
) -> dc.Trajectory:
    """The rows of a user's own loop: state, accelerations and force at the start of each step."""
    q, u = np.array([0.1, -0.4]), np.array([0.3, 1.0])
    rows = []
    for k in range(round(duration / step)):
        t = k * step
        now = float(system.force(t)) if held else None
        rows.append((t, q, u, system.acceleration(t, q, u), float(system.force(t))))
        q, u = SCHEMES[scheme](partial(system.acceleration, force=now), t, q, u, step)
    t_, q_, u_, a_, f_ = (np.array([row[k] for row in rows]) for k in range(5))
    return dc.Trajectory(
        t=t_, q=q_, u=u_, udot=a_ if accelerations else None, coordinates=NAMES, speeds=NAMES,
        forces={"actuator motor": np.column_stack([f_, 0 * f_])},
        provenance=dc.Provenance("own loop"),
    )  # fmt: skip


@lru_cache(8)
def generalized_alpha(system: CartPole, rho: float = 0.7, *, step: float = 0.008) -> dc.Trajectory:
    """Generalized-α (Chung and Hulbert 1993) with its own, algorithmic accelerations in the log."""
    am, af = (2 * rho - 1) / (rho + 1), rho / (rho + 1)
    gamma = 0.5 + af - am
    beta = 0.25 * (gamma + 0.5) ** 2
    q, u = np.array([0.1, -0.4]), np.array([0.3, 1.0])
    exact = system.acceleration(0.0, q, u)
    a, rows = exact, []
    for k in range(400):
        t = k * step
        rows.append((t, q, u, a, float(system.force(t))))
        after = exact
        for _ in range(80):
            new = ((1 - af) * after + af * exact - am * a) / (1 - am)
            x = q + step * u + step**2 * ((0.5 - beta) * a + beta * new)
            v = u + step * ((1 - gamma) * a + gamma * new)
            before, after = after, system.acceleration(t + step, x, v)
            if close(after, before):
                break
        a = ((1 - af) * after + af * exact - am * a) / (1 - am)
        exact, q, u = after, x, v
    t_, q_, u_, a_, f_ = (np.array([row[k] for row in rows]) for k in range(5))
    return dc.Trajectory(
        t=t_, q=q_, u=u_, udot=a_, coordinates=NAMES, speeds=NAMES,
        forces={"actuator motor": np.column_stack([f_, 0 * f_])},
        provenance=dc.Provenance("own loop"),
    )  # fmt: skip
