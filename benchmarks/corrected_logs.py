"""`correct_trajectory` on logs of MuJoCo: `python benchmarks/corrected_logs.py`.

Trees of joints swing freely for 1 s, logged every 2 ms by MuJoCo's Euler, implicit and implicitfast
integrators. The error of the log, of MuJoCo with so many times the steps that it takes as long as the
correction, and of the corrected log, against ode8; and the processor time of both.
"""

from __future__ import annotations

import argparse
import time
import warnings
from dataclasses import replace

import mujoco
import numpy as np
from foreign import simulators
from predicted_steps import drawn

import deltac as dc

STEP, FINER = 2e-3, 2048
WORSE = 1.1


def with_short_steps(run: simulators.Run, integrator: str, rows: int) -> tuple[np.ndarray, float]:
    """The coordinates (rows, n) at the times of the log by steps that are shorter, and the time taken, s."""
    model = mujoco.MjModel.from_xml_string(run.machine.mjcf(STEP / FINER, integrator))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = run.q, run.u
    q, begun = [run.q], time.process_time()
    for _ in range(rows - 1):
        mujoco.mj_step(model, data, FINER)
        q.append(data.qpos.copy())
    return np.array(q), time.process_time() - begun


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--machines", type=int, default=8)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    count = better = worse = refused = 0
    print(f"| machine | integrator | log | {FINER} × the steps | s | corrected | s | estimate |")
    print("|---|---|---:|---:|---:|---:|---:|---:|")
    for seed in range(options.machines):
        run = drawn(seed)
        none = np.zeros(0)
        drive = replace(run.drive, amplitude=none, rate=none, phase=none)
        run = replace(run, machine=replace(run.machine, motors=()), drive=drive)
        names, mechanism = run.machine.joints, run.machine.mechanism()
        state = mechanism.state(
            dict(zip(names, run.q, strict=True)), dict(zip(names, run.u, strict=True))
        )
        exact = dc.simulate(mechanism, state, 1.0 - STEP, STEP, "ode8").q
        for integrator in ("Euler", "implicit", "implicitfast"):
            rows = simulators.mujoco_loop(run, STEP, integrator, "before", 1)
            log = dc.Trajectory(
                t=rows.t, q=rows.q, u=rows.u, coordinates=names, speeds=names,
                provenance=dc.Provenance("MuJoCo", step=STEP),
            )  # fmt: skip
            finer, took = with_short_steps(run, integrator, len(rows.q))
            own, fine = (float(np.abs(q - exact[: len(q)]).max()) for q in (rows.q, finer))
            begun, count = time.process_time(), count + 1
            try:
                corrected = dc.correct_trajectory(mechanism, log)
            except dc.InputError as error:
                refused += 1
                print(
                    f"| {seed} | {integrator} | {own:.1e} | {fine:.1e} | {took:.1f} | {error} | | |"
                )
                continue
            spent = time.process_time() - begun
            left = float(np.abs(corrected.run.q - exact[: len(corrected.run)]).max())
            better, worse = better + (left < fine), worse + (left > WORSE * own)
            print(
                f"| {seed} | {integrator} | {own:.1e} | {fine:.1e} | {took:.1f} | {left:.1e} | "
                f"{spent:.1f} | {corrected.remaining.max():.0e} |",
                flush=True,
            )
    print(
        f"better than {FINER} times the steps in {better} of {count}, refused {refused}, worse {worse}"
    )


if __name__ == "__main__":
    main()
