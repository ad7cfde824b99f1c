"""One run of a humanoid of 27 degrees of freedom without contact, beside MuJoCo: RK4 and the same step.

Both record every state; we also integrate two testing functions and the work of every joint's spring and
damper, and record the accelerations.
"""

from __future__ import annotations

from typing import Any

import humanoid
import numpy as np
from measure import contest

import deltac as dc

STEPS, STEP, TARGET = 1000, 1e-3, 1.0
AGREE = 1e-9
"""How far the ends may be apart (m, rad)."""


def run(rounds: int) -> dict[str, Any]:
    """Check that both sides make the same motion, then time them; {"skipped": why} without MuJoCo."""
    name = f"{STEPS} steps of a 27-dof humanoid, ode4 + ΔC: deltac / MuJoCo RK4"
    try:
        import mujoco
        from mujoco import rollout
    except ImportError:
        return {"name": name, "skipped": "MuJoCo is not installed (the extra 'mujoco' brings it)"}
    from deltac.importers import read_mechanism

    model = humanoid.model()
    model.opt.timestep, model.opt.integrator = STEP, mujoco.mjtIntegrator.mjINT_RK4
    mechanism, _ = read_mechanism(model)
    state = dc.State(0.0, mechanism.state().q, 0.1 * np.random.default_rng(2).standard_normal(27))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = state.q, state.u
    spec = mujoco.mjtState.mjSTATE_FULLPHYSICS
    start = np.empty(mujoco.mj_stateSize(model, spec))
    mujoco.mj_getState(model, data, start, spec)

    def ours() -> dc.Trajectory:
        return dc.simulate(mechanism, state, STEPS * STEP, STEP, "ode4")

    def theirs() -> Any:
        return rollout.rollout(model, data, start, nstep=STEPS)[0]

    off = float(np.abs(ours().q[-1] - theirs()[0, -1, 1 : 1 + model.nq]).max())
    assert off < AGREE, f"deltac and MuJoCo end {off:.1e} apart"
    return {
        "name": name,
        "target": TARGET,
        **contest(ours, theirs, rounds).summary(),
        "off": off,
        "steps": STEPS,
    }


def told(found: dict[str, Any]) -> str:
    """What is particular to this contest, in words."""
    return (
        f"a step takes {1e6 * found['ours_s'] / found['steps']:.1f} µs, MuJoCo's "
        f"{1e6 * found['theirs_s'] / found['steps']:.1f} µs; ends agree to {found['off']:.0e}"
    )
