"""Audits of double pendulums by SciPy's `solve_ivp`, right and wrong: `python benchmarks/judge/solve_ivp.py`.

Lagrange's equations by hand; six methods at tolerances from the default to 1e-8; rows of the solver's own
steps or of its dense output. The integrator's true joules are ΔC of the rows by the machine's own numbers.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import deltac as dc

Array = NDArray[np.float64]
NUMBERS = {"m1": 1.2, "m2": 0.9, "l1": 0.8, "l2": 0.7, "g": 9.81, "c1": 0.05, "c2": 0.03}
METHODS = ("RK45", "RK45", "RK23", "DOP853", "LSODA", "Radau", "BDF")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=30, help="every second one is wrong")
    given = parser.parse_args()
    verdicts: Counter[tuple[str, str]] = Counter()
    within = total = 0
    for number in range(given.count):
        rng = np.random.default_rng([given.seed, number])
        wrong = number % 2 == 1
        run, made, what = case(rng, wrong)
        found = dc.audit(model(NUMBERS), run)
        verdicts["wrong" if wrong else "right", found.verdict.kind] += 1
        true = float(np.abs(dc.balance(model(made), run).delta_c["wang"]).max())
        joules = found.attribution.integrator.largest if found.attribution else (np.nan, np.nan)
        if not wrong and found.attribution:
            total += 1
            within += abs(joules[0] - true) <= max(
                2.0 * joules[1], 0.01 * found.tolerance * found.reference_energy
            )
        causes = ", ".join(f"{c.kind} {c.element}" for c in found.causes)
        told = f"{joules[0]:.2g} ± {joules[1]:.1g} J, true {true:.2g}"
        print(f"{number:3d} {what}: {found.verdict.kind}; integrator {told}; {causes}", flush=True)
    for (truth, kind), count in sorted(verdicts.items()):
        print(f"{truth} {kind}: {count}")
    print(f"integrator's joules of right ones within two told errors: {within} of {total}")


def case(rng: np.random.Generator, wrong: bool) -> tuple[dc.Trajectory, dict[str, float], str]:
    """A run, the numbers that made it, and what it is."""
    made, fault = dict(NUMBERS), ""
    method, tolerance = str(rng.choice(METHODS)), float(rng.choice([1e-3, 1e-3, 1e-5, 1e-8]))
    dt = float(rng.choice([0.002, 0.01, 0.02])) if rng.random() < 0.75 else None
    start = [rng.uniform(-1.5, 1.5), rng.uniform(-1.0, 1.0), 0.0, 0.0]
    end = float(rng.choice([3.0, 10.0]))
    if wrong:
        name = str(rng.choice(list(NUMBERS)))
        size = float(rng.choice([-1, 1]) * 10 ** rng.uniform(-2.0, -0.7))
        size *= 4.0 if name.startswith("c") else 1.0
        made[name] *= 1.0 + size
        fault = f" {name} {size:+.3f}"
    at = None if dt is None else np.arange(0.0, end + 1e-9, dt)
    loose = 1e-6 if tolerance >= 1e-5 else 1e-9
    y = solve_ivp(rate(made), (0.0, end), start, method, at, rtol=tolerance, atol=loose)
    machine = model(NUMBERS)
    run = dc.Trajectory(
        t=y.t, q=y.y[:2].T, u=y.y[2:].T, provenance=dc.Provenance("solve_ivp"),
        coordinates=machine.coordinates.names, speeds=machine.speeds.names,
    )  # fmt: skip
    return run, made, f"{method} {tolerance:g} {dt or 'steps'}{fault}"


def rate(p: dict[str, float]) -> Callable[[float, Array], Array]:
    """ẏ of relative angles and their rates, from Lagrange's equations of the absolute ones."""
    m1, m2, l1, l2, g = (p[name] for name in ("m1", "m2", "l1", "l2", "g"))

    def f(_: float, y: Array) -> Array:
        (a, b), (u, v) = y[:2], y[2:]
        first, second, between = a, a + b, -b
        couple = m2 * l1 * l2
        mass = [
            [(m1 + m2) * l1**2, couple * np.cos(between)],
            [couple * np.cos(between), m2 * l2**2],
        ]
        push = [
            -couple * np.sin(between) * (u + v) ** 2 - (m1 + m2) * g * l1 * np.sin(first)
            - p["c1"] * u + p["c2"] * v,
            couple * np.sin(between) * u**2 - m2 * g * l2 * np.sin(second) - p["c2"] * v,
        ]  # fmt: skip
        alpha = np.linalg.solve(mass, push)
        return np.array([u, v, alpha[0], alpha[1] - alpha[0]])

    return f


def model(p: dict[str, float]) -> dc.Mechanism:
    """The double pendulum of two point masses, with dampers in both joints."""
    return dc.Mechanism(
        bodies=[
            dc.point_mass("b1", p["m1"], (0, 0, -p["l1"])),
            dc.point_mass("b2", p["m2"], (0, 0, -p["l2"])),
        ],
        joints=[
            dc.revolute("j1", "ground", "b1", axis="y", damping=p["c1"]),
            dc.revolute("j2", "b1", "b2", axis="y", position=(0, 0, -p["l1"]), damping=p["c2"]),
        ],
        gravity=(0, 0, -p["g"]),
    )


if __name__ == "__main__":
    main()
