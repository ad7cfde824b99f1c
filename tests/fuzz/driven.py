"""`python -m tests.fuzz.driven COUNT`: random mechanisms with prescribed motion, against Newton and Euler.

The oracle knows where bodies are as functions of time, and nothing else of deltac: places and turns are
composed joint by joint, or follow from the circles of a four-bar; velocities and accelerations are central
differences of them. Drives of a tree must then be what Newton's and Euler's laws ask for beyond each joint.
The single drive of a loop must feed what kinetic and potential energy gain. ΔC of all testing functions must
be of the size that the step makes it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import deltac as dc

Array = NDArray[Any]
G = np.array([0.3, -9.81, 1.1])
FUNCTIONS = ("kane-levinson-1988", "kane-levinson-1990", "liu-huston", "wang")
DURATION, STEPS, H = 0.6, 300, 2e-3
SIXTH = np.array([-1, 9, -45, 0, 45, -9, 1]) / 60
SIXTH_TWICE = np.array([2, -27, 270, -490, 270, -27, 2]) / 180


def turn(axis: Array, angle: float) -> Array:
    """Rodrigues' formula."""
    n = axis / np.linalg.norm(axis)
    cross = np.array([[0, -n[2], n[1]], [n[2], 0, -n[0]], [-n[1], n[0], 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)


def rates(f: Callable[[float], Array], t: float) -> tuple[Array, Array]:
    """First and second derivative, of sixth order in H."""
    values = np.array([f(t + k * H) for k in range(-3, 4)])
    return np.tensordot(SIXTH, values, 1) / H, np.tensordot(SIXTH_TWICE, values, 1) / H**2


class Law:
    """a + b t + c sin(w t + p), in words and in numbers."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.a, self.b, self.c, self.p = rng.uniform(-1, 1, 4).tolist()
        self.w = rng.uniform(2, 6)
        self.text = f"{self.a!r} + {self.b!r}*t + {self.c!r}*sin({self.w!r}*t + {self.p!r})"

    def __call__(self, t: float) -> float:
        return float(self.a + self.b * t + self.c * np.sin(self.w * t + self.p))


def tree(seed: int) -> str:
    """A random tree, every joint of which is driven; "right", or what is wrong."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 5))
    parents = [int(rng.integers(-1, k)) if k else -1 for k in range(n)]
    kinds = rng.choice(["revolute", "prismatic"], n)
    axes, places, centres = (rng.uniform(-1, 1, (n, 3)) for _ in range(3))
    laws, masses = [Law(rng) for _ in range(n)], rng.uniform(0.3, 2, n)
    moments = rng.uniform(0.2, 0.3, (n, 3))
    names = [f"b{k}" for k in range(n)]
    mechanism = dc.Mechanism(
        bodies=[
            dc.body(names[k], masses[k], mass_centre=tuple(centres[k]), inertia=tuple(moments[k]))
            for k in range(n)
        ],
        joints=[
            getattr(dc.joints, kinds[k])(
                f"j{k}",
                "ground" if parents[k] < 0 else names[parents[k]],
                names[k],
                tuple(axes[k]),
                position=tuple(places[k]),
                motion=laws[k].text,
            )
            for k in range(n)
        ],
        gravity=tuple(G),
    )
    run = dc.simulate(mechanism, mechanism.state(), DURATION, DURATION / STEPS, "ode4", FUNCTIONS)

    def poses(t: float) -> list[tuple[Array, Array, Array]]:
        """Of each body: turn, origin, and the joint's place in the world."""
        found: list[tuple[Array, Array, Array]] = []
        for k in range(n):
            R, r, _ = (np.eye(3), np.zeros(3), None) if parents[k] < 0 else found[parents[k]]
            place, s = r + R @ places[k], laws[k](t)
            axis = axes[k] / np.linalg.norm(axes[k])
            if kinds[k] == "revolute":
                found.append((R @ turn(axis, s), place, place))
            else:
                found.append((R, place + R @ axis * s, place))
        return found

    def orientation(j: int, t: float) -> Array:
        return poses(t)[j][0]

    def centre(j: int, t: float) -> Array:
        R, r, _ = poses(t)[j]
        return np.asarray(r + R @ centres[j])

    largest = max(np.abs(force).max() for force in run.forces.values())
    for t in run.t[::75]:
        now = poses(t)
        for k in range(n):
            beyond = [k]
            for j in range(k + 1, n):
                beyond += [j] if parents[j] in beyond else []
            axis = now[k][0] @ (axes[k] / np.linalg.norm(axes[k]))
            needed = 0.0
            for j in beyond:
                _, a = rates(partial(centre, j), t)
                momentum = _spin(partial(orientation, j), moments[j])
                force = masses[j] * (a - G)
                arm = now[j][1] + now[j][0] @ centres[j] - now[k][2]
                moment = rates(momentum, t)[0] + np.cross(arm, force)
                needed += axis @ (moment if kinds[k] == "revolute" else force)
            row = int(np.argmin(np.abs(run.t - t)))
            found = run.forces[f"prescribed j{k}"][row, k]
            if not abs(found - needed) <= 1e-5 * (largest + 1):
                return f"drive of j{k} at t = {t}: {found}, by Newton and Euler {needed}"
    return _closed(mechanism, run)


def _spin(R: Callable[[float], Array], moments: Array) -> Callable[[float], Array]:
    """The angular momentum about the mass centre, world components."""

    def momentum(t: float) -> Array:
        now, rate = R(t), rates(R, t)[0]
        W = rate @ now.T
        omega = np.array([W[2, 1], W[0, 2], W[1, 0]])
        return np.asarray(now @ np.diag(moments) @ now.T @ omega)

    return momentum


def four_bar(seed: int) -> str:
    """A random four-bar whose crank turns, a third of them through flat positions."""
    rng = np.random.default_rng(seed)
    crank, ground = 0.2, rng.uniform(0.5, 0.7)
    flat = rng.random() < 1 / 3
    coupler = ground if flat else rng.uniform(0.5, 0.7)
    rocker = crank if flat else rng.uniform(0.4, 0.6)
    side, start, w = rng.choice([-1.0, 1.0]), rng.uniform(0.3, 1), rng.uniform(5, 15)
    lengths, gravity = (crank, coupler, rocker), G * [1, 1, 0]
    if flat:
        side = 0.0
        if rng.random() < 0.5:  # exactly flat at a sample
            start = np.pi - w * DURATION / STEPS * rng.integers(20, 200)
    masses, moments, shares = (rng.uniform(0.3, 2, 3), rng.uniform(0.01, 0.03, 3), rng.random(3))

    def angles(t: float) -> Array:
        """Directions of crank, coupler and rocker in the plane."""
        a = start + w * t
        if not side:
            return np.array([a, 0.0, a])
        gap = np.array([ground, 0.0]) - crank * np.array([np.cos(a), np.sin(a)])
        d, base = np.hypot(*gap), np.arctan2(gap[1], gap[0])
        b = base + side * np.arccos((d**2 + coupler**2 - rocker**2) / (2 * d * coupler))
        tip = coupler * np.array([np.cos(b), np.sin(b)]) - gap
        return np.array([a, b, np.arctan2(tip[1], tip[0])])

    def centres(t: float) -> Array:
        a, b, c = angles(t)
        e = [np.array([np.cos(x), np.sin(x)]) for x in (a, b, c)]
        feet = [np.zeros(2), crank * e[0], np.array([ground, 0.0])]
        return np.array([feet[k] + shares[k] * lengths[k] * e[k] for k in range(3)])

    def energy(t: float) -> Array:
        v = rates(centres, t)[0]
        spins = rates(lambda s: np.exp(1j * angles(s)), t)[0]
        K = 0.5 * (masses @ (v**2).sum(axis=1) + moments @ np.abs(spins) ** 2)
        return np.array(K - masses @ (centres(t) @ gravity[:2]))

    names = ("crank", "coupler", "rocker")
    mechanism = dc.Mechanism(
        bodies=[
            dc.body(
                names[k],
                masses[k],
                mass_centre=(shares[k] * lengths[k], 0, 0),
                inertia=(moments[k], moments[k], moments[k]),
            )
            for k in range(3)
        ],
        joints=[
            dc.revolute("A", "ground", "crank", motion=f"{float(start)!r} + {w!r}*t"),
            dc.revolute("B", "crank", "coupler", position=(crank, 0, 0)),
            dc.revolute("D", "ground", "rocker", position=(ground, 0, 0)),
        ],
        constraints=[
            dc.constraints.loop_spherical(
                "pin", "coupler", "rocker", point1=(coupler, 0, 0), point2=(rocker, 0, 0)
            )
        ],
        gravity=tuple(gravity),
    )
    a, b, c = angles(0.0)
    state = dc.assemble(mechanism, {"B": b - a, "D": c}).state
    run = dc.simulate(mechanism, state, DURATION, DURATION / STEPS, "ode4", FUNCTIONS)
    for row in range(0, len(run.t), 15):
        t = float(run.t[row])
        a, b, c = angles(t)
        off = np.exp(1j * run.q[row]) - np.exp(1j * np.array([a, b - a, c]))
        if not np.abs(off).max() <= 1e-9:
            return f"at t = {t} the motion is off by {np.abs(off).max():.1e}"
        found = run.forces["prescribed A"][row, 0]
        needed = float(rates(energy, t)[0]) / w
        if not abs(found - needed) <= 1e-5 * (abs(needed) + 10):
            return f"drive at t = {t}: {found}, by the energy {needed}"
    return _closed(mechanism, run)


def _closed(mechanism: dc.Mechanism, run: dc.Trajectory) -> str:
    """Whether ΔC is that of Simpson's rule at this step, and the rate form of every function is zero."""
    ledger = dc.balance(mechanism, run)
    for name in FUNCTIONS:
        if not np.abs(ledger.delta_c[name]).max() <= 1e-5 * ledger.energy_exchanged:
            return f"ΔC of {name} is {np.abs(ledger.delta_c[name]).max():.1e} J"
    return "right"


def judged(seed: int) -> str:
    """What became of one mechanism."""
    return four_bar(seed) if seed % 2 else tree(seed)


def main() -> int:
    """Count what became of random mechanisms; 1 if any was wrong."""
    wrong = 0
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    for seed in range(count):
        if (verdict := judged(seed)) != "right":
            wrong += 1
            print(f"seed {seed}: {verdict}", flush=True)
    print(f"{count - wrong} of {count} driven mechanisms right")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
