"""Equations, schemes, exact flows, and true joules of integrator and mistake.

Let z_k be the states of a simulation, φ the exact flow of the equations that were simulated over one step,
φ* that of the model's, with the same forces, and E = K + V the model's energy. The flow φ* keeps
C = E − ∫P dt, so what a step adds to C is, to the first order of its defect,

    integrator   E(z_{k+1}) − E(φ(z_k))       what the step did that its own equations do not
    mistake      E(φ(z_k)) − E(φ*(z_k))       what its equations do that the model's do not

and both add up to the step's share of ΔC. The defects are weighed with ∂E/∂x at the end of the step; the flow
backwards from z_{k+1} weighs them at its beginning. The truth is the mean of the two, and half of their
difference is `slack`, within which definitions of the shares may differ. So is the product of both errors:
what the step does to the wrong equations differs from what it does to the model's by as much, relatively, as
the equations do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array: TypeAlias = NDArray[np.float64]
Torque = Callable[[Array, Array], Array]
"""The force (N, m) of the steps `k` (N,), at the time `t` (N,) within each."""


@dataclass(frozen=True)
class Plant:
    """ẋ = f(t, x, τ) of rows x = (q, u), (N, n), with the energy of its model, (N,) J."""

    rate: Callable[[Array, Array, Array], Array]
    energy: Callable[[Array], Array]
    nq: int
    damping: Array | None = None
    mass: Callable[[Array], Array] | None = None


@dataclass(frozen=True)
class Motion:
    """States x (N+1, n) at every step of a simulation, and the forces that acted."""

    t: Array
    x: Array
    torque: Torque


def held(values: Array) -> Torque:
    """Forces (N+1, m) that keep their value over the step."""
    return lambda k, t: values[k]


def ramped(values: Array, h: float) -> Torque:
    """Forces that go straight from row to row."""

    def torque(k: Array, t: Array) -> Array:
        share = (t / h - k)[:, None]
        return np.asarray(
            values[k] + share * (values[np.minimum(k + 1, len(values) - 1)] - values[k])
        )

    return torque


def advanced(plant: Plant, scheme: str, k: Array, x: Array, torque: Torque, h: float) -> Array:
    """One step of a scheme from rows x (N, n) at the steps k (N,)."""
    n, t = plant.nq, k * h

    def f(s: float, y: Array) -> Array:
        return plant.rate(t + s, y, torque(k, t + s))

    a = f(0.0, x)
    q, u = x[:, :n], x[:, n:]
    if scheme == "explicit-euler":
        return x + h * a
    if scheme == "heun":
        return x + h / 2 * (a + f(h, x + h * a))
    if scheme == "rk4":
        b = f(h / 2, x + h / 2 * a)
        c = f(h / 2, x + h / 2 * b)
        return x + h / 6 * (a + 2 * b + 2 * c + f(h, x + h * c))
    if scheme == "leapfrog":
        v = u + h / 2 * a[:, n:]
        p = q + h * v
        return np.hstack([p, v + h / 2 * f(h, np.hstack([p, v]))[:, n:]])
    du = h * a[:, n:]
    if scheme == "implicit-damping":
        assert plant.mass is not None and plant.damping is not None
        M = plant.mass(x)
        du = np.linalg.solve(
            M + h * np.diag(plant.damping), np.einsum("nij,nj->ni", M, du)[..., None]
        )[..., 0]
    elif scheme != "semi-implicit-euler":
        raise ValueError(scheme)
    v = u + du
    return np.hstack([q + h * v, v])


def simulated(
    plant: Plant,
    scheme: str,
    x: Array,
    h: float,
    steps: int,
    control: Callable[[int, Array], Array],
    hold: str,
) -> Motion:
    """A run under a controller, asked at every step; `hold`: "held", or "ramped" to the next command."""
    rows, values = [np.asarray(x, float)], [control(0, np.asarray(x, float))]
    for k in range(steps):
        x, now = rows[-1], values[-1]
        following = control(k + 1, x) if hold == "ramped" else now

        def torque(i: Array, t: Array, a: Array = now, b: Array = following, k: int = k) -> Array:
            return np.asarray(a + (b - a) * (t / h - k)[:, None])

        rows.append(advanced(plant, scheme, np.array([k]), x[None], torque, h)[0])
        values.append(following if hold == "ramped" else control(k + 1, rows[-1]))
        if not np.isfinite(rows[-1]).all() or np.abs(rows[-1]).max() > 1e3:
            raise ValueError("the motion ran away")
    table = np.array(values)
    return Motion(
        np.arange(steps + 1) * h,
        np.array(rows),
        ramped(table, h) if hold == "ramped" else held(table),
    )


def flow(plant: Plant, motion: Motion, k: Array, x: Array, backward: bool = False) -> Array:
    """The exact flow of rows x (N, n) over the steps k, or backwards over them: DOP853, all rows at once."""
    start, end = motion.t[k], motion.t[k + 1]
    if backward:
        start, end = end, start
    size = np.abs(motion.x).max(axis=0) + 1e-3

    def f(s: float, y: Array) -> Array:
        t = start + s * (end - start)
        rows = y.reshape(x.shape) * size
        return np.asarray(
            (end - start)[:, None] * plant.rate(t, rows, motion.torque(k, t)) / size
        ).ravel()

    with np.errstate(all="ignore"):
        solution = solve_ivp(
            f,
            (0.0, 1.0),
            (x / size).ravel(),
            "DOP853",
            [1.0],
            rtol=1e-12,
            atol=1e-14,
            first_step=1.0,
        )
    return np.asarray(solution.y[:, -1].reshape(x.shape) * size)


@dataclass(frozen=True)
class Joules:
    """Of integrator and mistake since the first row (N+1,), and their slack.

    `effect`: the largest difference of the two exact flows over a step, as a share of each state's size; None
    where it is not known.
    """

    integrator: Array
    mistake: Array
    integrator_slack: Array
    mistake_slack: Array
    effect: float | None = None


def joules(simulated_plant: Plant, model: Plant, motion: Motion, right: bool) -> Joules:
    """The true shares of ΔC of a motion, see above."""
    E, k, z = model.energy, np.arange(len(motion.t) - 1), motion.x
    ahead, back = (
        flow(simulated_plant, motion, k, x, b) for x, b in ((z[:-1], False), (z[1:], True))
    )
    ahead_model, back_model = (
        (ahead, back)
        if right
        else (flow(model, motion, k, x, b) for x, b in ((z[:-1], False), (z[1:], True)))
    )

    def summed(first: Array, second: Array) -> tuple[Array, Array]:
        a, b = (np.concatenate([[0.0], np.cumsum(x)]) for x in (first, second))
        return (a + b) / 2, np.abs(a - b) / 2

    of_step, step_slack = summed(E(z[1:]) - E(ahead), E(back) - E(z[:-1]))
    of_mistake, mistake_slack = summed(E(ahead) - E(ahead_model), E(back_model) - E(back))
    differs, n = ahead - ahead_model, model.nq
    effect = float((np.abs(differs) / (np.abs(z).max(axis=0) + 1e-3)).max())
    moves = np.linalg.norm((ahead_model - z[:-1])[:, n:]) + 1e-300
    product = np.abs(of_step) * min(1.0, float(np.linalg.norm(differs[:, n:]) / moves))
    return Joules(of_step, of_mistake, step_slack + product, mistake_slack + product, effect)
