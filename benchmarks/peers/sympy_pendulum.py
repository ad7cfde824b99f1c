"""The triple pendulum in SymPy: Kane's equations, lambdified, in a loop in Python or by SciPy."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import sympy as sp
from scipy.integrate import solve_ivp
from sympy.physics.mechanics import (
    KanesMethod,
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

from peers.python_loop import LASTING, runge_kutta4
from peers.rival import Array, Pendulum, Rival


def rivals(pendulum: Pendulum) -> Iterator[Rival]:
    """M solved in symbols, numbers of Python: for three unknowns far faster than NumPy's arrays."""
    short, equations = pendulum.lasting(LASTING), kane()
    udot = equations.M.LUsolve(equations.f)
    arguments = [equations.q + equations.u, equations.constants]
    compiled = sp.lambdify(arguments, [*equations.u, *udot], modules="math", cse=True)
    constants = values(pendulum).tolist()

    def rate(x: Array) -> Array:
        return np.array(compiled(x.tolist(), constants))

    start = np.concatenate([short.q, short.u])

    def loop() -> Array:
        return runge_kutta4(rate, start, short.step, short.steps)[:, :3]

    def scipy() -> Array:
        """Steps of one length: a tolerance that refuses none, and none longer than the first."""
        h, span = short.step, (0.0, short.duration)
        found = solve_ivp(
            lambda t, x: rate(x), span, start, "RK45", rtol=1e3, first_step=h, max_step=h
        )
        return found.y[:3, 1 : short.steps + 1].T  # times may add up to a little less than the end

    note = f"lambdify(cse), {short.duration:g} s; "
    yield Rival("SymPy", loop, short.steps, 4, 4, note + "RK4 in Python")
    yield Rival("SymPy, SciPy RK45", scipy, short.steps, 5, 6, note + "solve_ivp")


@dataclass(frozen=True)
class Kane:
    """M u̇ = f in symbols; `constants` are those of `values`, in order."""

    q: list[sp.Expr]
    u: list[sp.Expr]
    M: sp.Matrix
    f: sp.Matrix
    constants: list[sp.Symbol]


def kane() -> Kane:
    """Kane's equations of three bars on pins, relative angles."""
    q, u = dynamicsymbols("q1:4"), dynamicsymbols("u1:4")
    masses, lengths, g = sp.symbols("m1:4"), sp.symbols("l1:4"), sp.Symbol("g")
    world, pin = ReferenceFrame("N"), Point("O")
    pin.set_vel(world, 0)
    above, bars, weights = world, [], []
    for n, (angle, rate, m, l) in enumerate(zip(q, u, masses, lengths), 1):
        frame = above.orientnew(f"A{n}", "Axis", (angle, world.z))
        frame.set_ang_vel(above, rate * world.z)
        centre = pin.locatenew(f"C{n}", -l / 2 * frame.y)
        below = pin.locatenew(f"P{n}", -l * frame.y)
        for point in (centre, below):
            point.v2pt_theory(pin, world, frame)
        across = m * l**2 / 12
        bars.append(
            RigidBody(f"B{n}", centre, frame, m, (inertia(frame, across, 0, across), centre))
        )
        weights.append((centre, -m * g * world.y))
        above, pin = frame, below
    method = KanesMethod(world, q, u, kd_eqs=[a.diff() - b for a, b in zip(q, u)])
    method.kanes_equations(bars, weights)
    return Kane(q, u, method.mass_matrix, method.forcing, [*masses, *lengths, g])


def values(pendulum: Pendulum) -> Array:
    """Numbers of `Kane.constants` (7,)."""
    return np.array([*pendulum.masses, *pendulum.lengths, pendulum.gravity])
