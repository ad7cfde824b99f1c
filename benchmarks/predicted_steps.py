"""`audit.step_for` against runs at the step that it predicts: `python benchmarks/predicted_steps.py`.

Logs of 1 s of t, q, u and motor torques: by deltac's own solvers on the library, and by MuJoCo, Drake and
Exudyn on drawn trees of hinges and sliders with sinusoidal torques. Each predicts the step for a quarter of
its |ΔC| and for four times as much; the same program runs at that step.
"""

from __future__ import annotations

import argparse
import math
import warnings
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from foreign import simulators
from foreign.machines import draw

import deltac as dc
from deltac.arrays import ROUGHLY

PROBLEMS = (
    "bead-on-hoop", "chaotic-double-body", "double-pendulum", "driven-pendulum", "elastic-pendulum",
    "heavy-top", "simple-pendulum", "torque-free-box", "triple-pendulum",
)  # fmt: skip
SOLVERS = ("ode1", "semi-implicit-euler", "ode1be", "ode2", "implicit-midpoint", "ode4")
MUJOCO = ("Euler", "implicit", "implicitfast", "RK4")
DRAKE = ("sap", "runge_kutta3")
EXUDYN = ("TrapezoidalIndex2", "ExplicitMidpoint", "RK44")
STEP, NEAR = 2e-3, 0.3

Log = Callable[[float], dc.Trajectory]
"""The log at a step."""


def own(problem: dc.Problem, solver: str) -> Log:
    """By a solver of deltac, as another program would log it."""

    def log(step: float) -> dc.Trajectory:
        run = dc.simulate(problem, None, 1.0, step, solver)
        return replace(run, udot=None, forces={}, works={}, integrals={})

    return log


def foreign(run: simulators.Run, program: str, method: str) -> Log:
    """By another program."""

    def log(step: float) -> dc.Trajectory:
        if program == "MuJoCo":
            rows = simulators.mujoco_loop(run, step, method, "before", 1)
        elif program == "Drake":
            rows = simulators.drake(run, step, method, "direct")
        else:
            rows = simulators.exudyn_tree(run, step, method, 0.8)
        torques = {f"actuator m{k}": np.zeros_like(rows.u) for k in run.motors}
        for k in run.motors:
            torques[f"actuator m{k}"][:, k] = rows.tau[:, k]
        names = run.machine.joints
        return dc.Trajectory(
            t=rows.t, q=rows.q, u=rows.u, forces=torques, coordinates=names, speeds=names,
            provenance=dc.Provenance(program, step=step),
        )  # fmt: skip

    return log


def drawn(seed: int) -> simulators.Run:
    """A tree of joints without springs, that all three programs read, with its torques."""
    rng = np.random.default_rng(seed)
    machine = draw(rng)
    for k in range(len(machine.links)):
        machine = machine.with_link(k, stiffness=0.0, armature=0.0)
    n, motors = len(machine.links), len(machine.motors)
    size = 0.3 * sum(link.mass for link in machine.links)
    drive = simulators.Drive(
        size * rng.uniform(0.1, 0.5, motors), rng.uniform(1.0, 7.0, motors),
        rng.uniform(0.0, 6.0, motors), 0.0, 0.01,
    )  # fmt: skip
    return simulators.Run(machine, drive, rng.uniform(-1, 1, n), rng.uniform(-1.5, 1.5, n), 1.0)


def ratios(model: object, log: Log) -> list[float | str]:
    """Energy error at each predicted step as a multiple of what was asked for; or why it is refused."""
    audit = dc.audit(model, log(STEP))
    result = list[float | str]()
    for factor in (0.25, 4.0):
        tolerance = audit.relative * factor
        if tolerance > ROUGHLY:
            continue  # of so large an error nothing is predicted
        try:
            step = audit.step_for(tolerance)
        except dc.InputError as refused:
            return [str(refused)]
        used = 1.0 / math.ceil(1.0 / step)
        at = dc.audit(model, log(used))
        size = float(np.abs(at.energy_error).max()) / audit.reference_energy
        assert audit.integrator is not None
        result.append(size / (tolerance * (used / step) ** audit.integrator.order))
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--machines", type=int, default=6)
    parser.add_argument("--only", choices=("own", "foreign"))
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    cases: list[tuple[str, object, Log]] = []
    if options.only != "foreign":
        for name in PROBLEMS:
            problem = dc.problems.load(name)
            cases += [(f"deltac {s}", problem, own(problem, s)) for s in SOLVERS]
    if options.only != "own":
        for seed in range(options.machines):
            run = drawn(seed)
            programs = (("MuJoCo", MUJOCO), ("Drake", DRAKE), ("Exudyn", EXUDYN))
            cases += [
                (f"{program} {method}", run.machine.mechanism(), foreign(run, program, method))
                for program, methods in programs
                for method in methods
            ]
    table: dict[str, list[float]] = defaultdict(list)
    refusals: dict[str, list[str]] = defaultdict(list)
    for name, model, log in cases:
        for ratio in ratios(model, log):
            if isinstance(ratio, str):
                refusals[name].append(ratio)
                print(f"{name}: {ratio[:120]}", flush=True)
            else:
                table[name].append(ratio)
    print("| log by | within 30 % | worst | refused |\n|---|---:|---:|---:|")
    good = 0
    for name in dict.fromkeys(name for name, _, _ in cases):
        near = sum(abs(r - 1.0) <= NEAR for r in table[name])
        worst = max(table[name], key=lambda r: abs(math.log(r)), default=math.nan)
        good += near
        print(f"| {name} | {near} of {len(table[name])} | {worst:.2f} | {len(refusals[name])} |")
    print(f"{good} of {sum(map(len, table.values()))} within 30 %")


if __name__ == "__main__":
    main()
