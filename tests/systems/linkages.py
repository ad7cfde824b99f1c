"""Constrained mechanisms that several test files run, with starts that satisfy their constraints."""

from __future__ import annotations

from typing import Any

import numpy as np

import deltac as dc
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.state import State

ALL = ("wang", "liu-huston", "kane-levinson-1990")
"""The testing functions that hold on constrained mechanisms."""


def worst(ledger: Any, level: str) -> float:
    """The largest violation of any constraint at that level (position or velocity), over the run."""
    return max(float(v.max()) for name, v in ledger.violation.items() if name.startswith(level))


def linkage(**options: Any) -> tuple[Mechanism, State]:
    """A crank-rocker: crank 0.4 m, coupler 1 m, rocker 0.9 m, ground 1 m; it is nowhere singular."""
    mechanism = Mechanism(
        [
            dc.rod("crank", 1.0, 0.4, along="x"),
            dc.rod("coupler", 2.0, 1.0, along="x"),
            dc.rod("rocker", 1.5, 0.9, along="x"),
        ],
        [
            dc.revolute("input", "ground", "crank", "z"),
            dc.revolute("knee", "crank", "coupler", "z", position=[0.4, 0, 0]),
            dc.revolute("output", "ground", "rocker", "z", position=[1.0, 0, 0]),
        ],
        constraints=[
            dc.constraints.loop_revolute(
                "closure", "coupler", "rocker", point1=[1.0, 0, 0], point2=[0.9, 0, 0]
            )
        ],
        gravity=[0, -9.81, 0],
        name="crank-rocker",
        **options,
    )
    guess = mechanism.state({"input": 1.0, "knee": -0.7, "output": 1.4}, {"input": 3.0})
    return mechanism, dc.assemble(mechanism, guess, ("input",)).state


def disc(**options: Any) -> tuple[Mechanism, State]:
    """A disc that wobbles as it rolls: three speeds left of six, no steady circle."""
    constraints = options.pop("constraints", [dc.constraints.rolling("contact", "disc", 0.3)])
    mechanism = Mechanism(
        [dc.bodies.disc("disc", 1.2, 0.3, "y", 0.04)],
        [dc.free("base", "disc")],
        constraints=constraints,
        gravity=[0, 0, -9.81],
        name="rolling disc",
        **options,
    )
    lean = 0.2
    guess = mechanism.state(
        {"base": [0, 0, 0.3 * np.cos(lean), np.cos(lean / 2), np.sin(lean / 2), 0, 0]},
        {"base.wy": 8.0, "base.wx": -0.3, "base.wz": 0.4},
    )
    return mechanism, dc.assemble(mechanism, guess).state


def four_bars(count: int) -> tuple[Mechanism, State]:
    """IFToMM's A02: `count` four-bars of rods of 1 m and 1 kg in a row, upright, the first tip at 1 m/s.

    When the cranks are flat all constraints become dependent in part, and the parallelogram goes on.
    """
    bodies = [dc.rod(f"crank{k}", 1.0, 1.0, along="x") for k in range(count + 1)]
    bodies += [dc.rod(f"coupler{k}", 1.0, 1.0, along="x") for k in range(count)]
    joints = [
        dc.revolute(f"foot{k}", "ground", f"crank{k}", "z", position=[k, 0, 0])
        for k in range(count + 1)
    ]
    joints += [
        dc.revolute(f"tip{k}", f"crank{k}", f"coupler{k}", "z", position=[1, 0, 0])
        for k in range(count)
    ]
    mechanism = Mechanism(
        bodies,
        joints,
        constraints=[
            dc.constraints.loop_spherical(
                f"closure{k}", f"coupler{k}", f"crank{k + 1}", point1=[1, 0, 0], point2=[1, 0, 0]
            )
            for k in range(count)
        ],
        gravity=[0, -9.81, 0],
        name=f"{count} four-bars",
    )
    q = {f"foot{k}": np.pi / 2 for k in range(count + 1)}
    u = {f"foot{k}": -1.0 for k in range(count + 1)}
    q |= {f"tip{k}": -np.pi / 2 for k in range(count)}
    u |= {f"tip{k}": 1.0 for k in range(count)}
    return mechanism, mechanism.state(q, u)
