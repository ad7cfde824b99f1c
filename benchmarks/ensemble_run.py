"""Thousands of trajectories at once, beside `mujoco.rollout`: RK4 on both sides, same step, same threads.

We integrate two testing functions in the loop and hand back the states and ΔC at the end of each member;
`rollout` stores the state of every member at every step, as it always does. So it runs a tenth of the
steps, and its time is scaled: a step takes it as long whatever their number, but its memory grows with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import humanoid
import numpy as np
from measure import contest
from numpy.typing import NDArray

import deltac as dc
from deltac.kernels.parallel import cores

Array = NDArray[np.float64]
MEMBERS, STEP = 4096, 1e-3
CHECKED = 8
"""Members whose end is compared with MuJoCo's, and with a run in much smaller steps."""


@dataclass(frozen=True)
class Race:
    """A mechanism on both sides. `agree`: of q with the rival's at the end, relative to the largest |q|."""

    name: str
    mechanism: dc.Mechanism
    model: Any
    Q: Array
    U: Array
    steps: int
    target: float
    agree: float


def run(rounds: int, members: int = MEMBERS) -> list[dict[str, Any]]:
    """Check that both sides are right, then time them; {"skipped": why} without MuJoCo."""
    if find_spec("mujoco") is None:
        why = "MuJoCo is not installed (the extra 'mujoco' brings it)"
        return [{"name": "ensembles: deltac / mujoco.rollout", "skipped": why}]
    return [_timed(race, rounds) for race in (_pendulum(members), _humanoid(members))]


def told(found: dict[str, Any]) -> str:
    """What is particular to this contest, in words."""
    return (
        f"a step takes {found['ours_ns_per_step']:.1f} ns, MuJoCo's {found['their_ns_per_step']:.0f} ns, "
        f"{found['threads']} threads; MuJoCo runs {found['their_steps']} of the {found['steps']} steps, "
        f"scaled; ends agree to {found['off']:.0e}"
    )


def _pendulum(members: int) -> Race:
    from peers import Pendulum, mujoco_pendulum

    problem, rng = dc.problems.load("triple-pendulum"), np.random.default_rng(1)
    model = mujoco_pendulum.model(Pendulum(problem, 1000 * STEP, STEP))
    Q = problem.state.q + 0.1 * rng.standard_normal((members, 3))
    U = problem.state.u + 0.1 * rng.standard_normal((members, 3))
    return Race("triple pendulum", problem.mechanism, model, Q, U, 1000, 100.0, 1e-9)


def _humanoid(members: int) -> Race:
    from deltac.importers import read_mechanism

    model, rng = humanoid.model(), np.random.default_rng(2)
    mechanism, _ = read_mechanism(model)
    Q = np.tile(mechanism.state().q, (members, 1))
    U = 0.1 * rng.standard_normal((members, 27))
    return Race("27-dof humanoid", mechanism, model, Q, U, 100, 12.0, 1e-7)


def _timed(race: Race, rounds: int) -> dict[str, Any]:
    import mujoco
    from mujoco import rollout

    threads, model = cores(), race.model
    model.opt.timestep, model.opt.integrator = STEP, mujoco.mjtIntegrator.mjINT_RK4
    datas = [mujoco.MjData(model) for _ in range(threads)]
    spec = mujoco.mjtState.mjSTATE_FULLPHYSICS
    states = np.empty((len(race.Q), mujoco.mj_stateSize(model, spec)))
    for row, q, u in zip(states, race.Q, race.U):
        datas[0].qpos[:], datas[0].qvel[:] = q, u
        mujoco.mj_getState(model, datas[0], row, spec)
    their_steps = max(10, race.steps // 10)

    def ours(steps: int = race.steps) -> dc.Ensemble:
        return dc.simulate_ensemble(
            race.mechanism, (race.Q, race.U), steps * STEP, STEP, "ode4", threads=threads
        )

    def theirs() -> Array:
        found, _ = rollout.rollout(model, datas, states, nstep=their_steps)
        return np.asarray(found)

    ends, theirs_ends = ours(their_steps).q[-1], theirs()[:, -1, 1 : 1 + model.nq]
    off = float(np.abs(ends - theirs_ends).max() / np.abs(ends).max())
    assert off < race.agree, f"{race.name}: deltac and MuJoCo differ by {off:.1e}"
    measured = contest(ours, theirs, rounds).summary()
    per_step = (measured["ours_s"] / race.steps, measured["theirs_s"] / their_steps)
    scale = their_steps / race.steps
    return {
        "name": f"{len(race.Q)} × {race.steps} steps, {race.name}, ode4 + ΔC: deltac / mujoco.rollout RK4",
        "target": race.target,
        **measured,
        "theirs_s": measured["theirs_s"] / scale,
        "ratio": measured["ratio"] / scale,
        "ratio_range": [r / scale for r in measured["ratio_range"]],
        "ours_ns_per_step": 1e9 * per_step[0] / len(race.Q),
        "their_ns_per_step": 1e9 * per_step[1] / len(race.Q),
        "steps": race.steps,
        "their_steps": their_steps,
        "threads": threads,
        "off": off,
    }
