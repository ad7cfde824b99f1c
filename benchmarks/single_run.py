"""One run of the triple pendulum, testing functions in the loop, beside MuJoCo's RK4 at the same step.

Both sides record the state at every step: we in a `Trajectory` (t, q, u, u̇ and two integrals), MuJoCo by
its own `rollout`, a loop over `mj_step` in C on one thread that stores the state (t, q, u).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from measure import contest, median_seconds
from numpy.typing import NDArray

import deltac as dc
from deltac.kernels import evaluator_name

Array = NDArray[np.float64]
DURATION, STEP = 10.0, 1e-4
TARGET = 4.0

# Errors after 10 s against the reference: RK4's own, and rounding for ode5. Both far above what is seen.
OURS_WITHIN, THEIRS_WITHIN = 1e-11, 1e-9  # rad


def run(rounds: int) -> dict[str, Any]:
    """Check that both sides are right, then time them; {"skipped": why} without MuJoCo."""
    name = f"triple pendulum, {DURATION:g} s at {STEP:g} s: deltac ode5 + ΔC / MuJoCo RK4"
    try:
        import mujoco  # noqa: F401
        from mujoco import rollout  # noqa: F401
    except ImportError:
        return {"name": name, "skipped": "MuJoCo is not installed (the extra 'mujoco' brings it)"}
    problem = dc.problems.load("triple-pendulum")
    rival = MuJoCo(problem)

    def ours() -> dc.Trajectory:
        return dc.simulate(problem.mechanism, problem.state, DURATION, STEP, "ode5")

    accuracy = _checked(problem, ours(), rival.run())
    found = {"name": name, "target": TARGET, **contest(ours, rival.run, rounds).summary()}
    ledger_s = median_seconds(lambda: dc.balance(problem.mechanism, ours()), max(1, rounds // 3))
    return {**found, "with_ledger_s": ledger_s, **accuracy}


def told(found: dict[str, Any]) -> str:
    """What is particular to this contest, in words."""
    return (
        f"with the whole ledger {found['with_ledger_s']:.3f} s; errors after 10 s: "
        f"{found['our_error_rad']:.0e} and {found['their_error_rad']:.0e} rad"
    )


class MuJoCo:
    """The same pendulum in MuJoCo, made from the problem's own parameters."""

    def __init__(self, problem: dc.problems.Problem) -> None:
        import mujoco

        self.model = mujoco.MjModel.from_xml_string(_mjcf(problem.mechanism.parameters))
        self.data = mujoco.MjData(self.model)
        self.steps = round(DURATION / STEP)
        self.data.qpos[:], self.data.qvel[:] = problem.state.q, problem.state.u
        spec = mujoco.mjtState.mjSTATE_FULLPHYSICS
        self.start = np.empty(mujoco.mj_stateSize(self.model, spec))
        mujoco.mj_getState(self.model, self.data, self.start, spec)

    def run(self) -> Array:
        """The state (t, q, u) after every step, (steps, 7)."""
        from mujoco import rollout

        states, _ = rollout.rollout(self.model, self.data, self.start, nstep=self.steps)
        return np.asarray(states[0])


def _mjcf(p: Any) -> str:
    """Three slender bars in the plane; no geometry, so that MuJoCo has no contacts to look for."""
    bars, above = [], 0.0
    for n in (1, 2, 3):
        m, l = p[f"m{n}"], p[f"l{n}"]
        across = m * l**2 / 12
        bars.append(
            f'<body pos="0 {-above!r} 0"><joint type="hinge" axis="0 0 1"/>'
            f'<inertial pos="0 {-l / 2!r} 0" mass="{m!r}" diaginertia="{across!r} 1e-9 {across!r}"/>'
        )
        above = l
    return (
        f'<mujoco><compiler angle="radian"/>'
        f'<option timestep="{STEP}" integrator="RK4" gravity="0 {-p["g"]!r} 0">'
        '<flag contact="disable" constraint="disable" actuation="disable"/></option>'
        f"<worldbody>{''.join(bars)}{'</body>' * 3}</worldbody></mujoco>"
    )


def _checked(problem: dc.problems.Problem, run: dc.Trajectory, rival: Array) -> dict[str, float]:
    """Largest error of the angles at whole seconds, against a reference; AssertionError if too large."""
    solver = "taylor" if evaluator_name() == "heyoka" else "DOP853"
    tolerance = None if solver == "taylor" else 1e-13
    exact = dc.simulate(
        problem.mechanism, problem.state, DURATION, 1.0, solver, testing=(), tolerance=tolerance
    )
    second = round(1.0 / STEP)
    ours = float(np.abs(run.q[::second] - exact.q).max())
    theirs = float(np.abs(rival[second - 1 :: second, 1:4] - exact.q[1:]).max())
    assert ours < OURS_WITHIN, f"deltac is {ours:.1e} rad off the reference"
    assert theirs < THEIRS_WITHIN, f"MuJoCo is {theirs:.1e} rad off the reference: another model?"
    assert len(run) == len(rival) + 1, "both sides must record every step"
    return {"our_error_rad": ours, "their_error_rad": theirs}
