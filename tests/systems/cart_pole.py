"""A cart with a pole, its equations written by hand, and logs of it by integrators that users write.

The oracle shares no code with deltac: Lagrange's equations of x and θ, θ right-handed about y from the
horizontal, so that the pole's centre is at x + l cos θ, −l sin θ.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

import deltac as dc

Array: TypeAlias = NDArray[np.float64]
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

    def inertia_matrix(self, q: Array) -> Array:
        """The mass matrix."""
        coupling = -self.pole * self.length * np.sin(q[1])
        both = self.inertia + self.pole * self.length**2
        return np.array([[self.cart + self.pole, coupling], [coupling, both]])

    def acceleration(self, t: float, q: Array, u: Array, force: float | None = None) -> Array:
        """Accelerations of slide and hinge."""
        m, l, theta = self.pole, self.length, q[1]
        push = float(self.force(t)) if force is None else force
        right = [
            push - self.slide * u[0] + m * l * np.cos(theta) * u[1] ** 2,
            m * self.gravity * l * np.cos(theta) - self.hinge * u[1],
        ]
        return np.asarray(np.linalg.solve(self.inertia_matrix(q), right))

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


def rk4(f, t, q, u, h):  # type: ignore[no-untyped-def]
    a1 = f(t, q, u)
    a2 = f(t + h / 2, q + h / 2 * u, u + h / 2 * a1)
    a3 = f(t + h / 2, q + h / 2 * u + h**2 / 4 * a1, u + h / 2 * a2)
    a4 = f(t + h, q + h * u + h**2 / 2 * a2, u + h * a3)
    return q + h * u + h**2 / 6 * (a1 + a2 + a3), u + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)


def trapezoidal(f, t, q, u, h):  # type: ignore[no-untyped-def]
    a = f(t, q, u)
    v = u + h * a
    for _ in range(60):
        x = q + h / 2 * (u + v)
        v = u + h / 2 * (a + f(t + h, x, v))
    return q + h / 2 * (u + v), v


def implicit_euler(f, t, q, u, h):  # type: ignore[no-untyped-def]
    v = u
    for _ in range(60):
        v = u + h * f(t + h, q + h * v, v)
    return q + h * v, v


SCHEMES: dict[str, Step] = {
    "explicit-euler": explicit_euler,
    "semi-implicit-euler": semi_implicit_euler,
    "heun": heun,
    "rk4": rk4,
    "trapezoidal": trapezoidal,
    "implicit-euler": implicit_euler,
}


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
        q, u = SCHEMES[scheme](
            lambda s, x, v, now=now: system.acceleration(s, x, v, now), t, q, u, step
        )
    t_, q_, u_, a_, f_ = (np.array([row[k] for row in rows]) for k in range(5))
    return dc.Trajectory(
        t=t_, q=q_, u=u_, udot=a_ if accelerations else None, coordinates=NAMES, speeds=NAMES,
        forces={"actuator motor": np.column_stack([f_, 0 * f_])},
        provenance=dc.Provenance("own loop"),
    )  # fmt: skip


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
            after = system.acceleration(t + step, x, v)
        a = ((1 - af) * after + af * exact - am * a) / (1 - am)
        exact, q, u = after, x, v
    t_, q_, u_, a_, f_ = (np.array([row[k] for row in rows]) for k in range(5))
    return dc.Trajectory(
        t=t_, q=q_, u=u_, udot=a_, coordinates=NAMES, speeds=NAMES,
        forces={"actuator motor": np.column_stack([f_, 0 * f_])},
        provenance=dc.Provenance("own loop"),
    )  # fmt: skip
