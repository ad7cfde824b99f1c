"""Instructions and times of the kernels of serial chains: the cost of a mechanism must be linear in it."""

from __future__ import annotations

from typing import Any

import numpy as np
from measure import median_seconds, seconds

import deltac as dc
from deltac.dynamics.forces import channels
from deltac.dynamics.system import trace
from deltac.dynamics.terms import forward, terms
from deltac.kernels import Kernel

BATCH = 4096


def run(sizes: tuple[int, ...], rounds: int, gflops: float) -> list[dict[str, Any]]:
    """For random chains in space: accelerations by the articulated-body recursion, and kinetic energy.

    `gflops` is what all cores can do; instructions count as one operation each.
    """
    return [_measured(dof, rounds, gflops) for dof in sizes]


def growth(found: list[dict[str, Any]]) -> str:
    """How cost per degree of freedom changes from size to size, in words."""
    pairs = zip(found, found[1:])
    return "; ".join(
        f"{a['dof']} → {b['dof']} dof: instructions per dof × "
        f"{b['udot_instructions_per_dof'] / a['udot_instructions_per_dof']:.2f}, time per dof × "
        f"{b['udot_ns_per_state_and_dof'] / a['udot_ns_per_state_and_dof']:.2f}"
        for a, b in pairs
    )


def chain(dof: int, seed: int = 1) -> dc.Mechanism:
    """A serial chain of `dof` hinges about random axes, each body with a full inertia tensor."""
    rng = np.random.default_rng(seed)
    bodies, joints = [], []
    for k in range(dof):
        principal = rng.uniform(0.5, 0.9, 3)  # any three of these obey the triangle inequality
        turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
        inertia = turn @ np.diag(principal) @ turn.T
        centre = rng.uniform(-0.3, 0.3, 3).tolist()
        bodies.append(dc.body(f"body{k}", rng.uniform(0.5, 2.0), inertia.tolist(), centre))
        joints.append(
            dc.revolute(
                f"joint{k}",
                f"body{k - 1}" if k else "ground",
                f"body{k}",
                rng.standard_normal(3).tolist(),
                position=rng.uniform(-0.5, 0.5, 3).tolist(),
            )
        )
    return dc.Mechanism(bodies, joints, gravity=(0.0, 0.0, -9.81), name=f"chain of {dof}")


def accelerations(mechanism: dc.Mechanism) -> Kernel:
    """u̇ by articulated bodies, written out and not compiled yet."""
    system = trace(mechanism)
    columns = {"q": system.q, "u": system.u}
    return Kernel(columns, {"udot": forward(system, channels(system)).udot})


def _measured(dof: int, rounds: int, gflops: float) -> dict[str, Any]:
    mechanism = chain(dof)
    kernels: dict[str, Kernel] = {}

    def write_out() -> None:
        system = trace(mechanism)
        parts = channels(system)
        columns = {"q": system.q, "u": system.u}
        kernels["motion"] = Kernel(columns, {"udot": forward(system, parts).udot})
        known = terms(system, system.udot_all, parts)
        kernels["kinetic"] = Kernel(columns, {"K": known.K}, name="kinetic energy")

    traced_in = seconds(write_out)
    motion = kernels["motion"]
    compiled_in = seconds(motion.compile)
    x = np.random.default_rng(2).standard_normal((motion.n_in, BATCH))
    out = np.empty((motion.n_out, BATCH))
    per_state = median_seconds(lambda: motion.flat(x, out=out), rounds) / BATCH
    return {
        "dof": dof,
        "udot_instructions": motion.instructions,
        "udot_instructions_per_dof": round(motion.instructions / dof, 1),
        "kinetic_instructions": kernels["kinetic"].instructions,
        "trace_s": traced_in,
        "compile_s": compiled_in,
        "udot_ns_per_state": 1e9 * per_state,
        "udot_ns_per_state_and_dof": 1e9 * per_state / dof,
        "of_peak": 1e-9 * motion.instructions / per_state / gflops,
        **_pinocchio(mechanism, x, out, rounds),
    }


def _pinocchio(
    mechanism: dc.Mechanism, x: np.ndarray, udot: np.ndarray, rounds: int
) -> dict[str, Any]:
    """Its time of a state: called from Python, and of a batch; nothing without it."""
    try:
        from peers import pinocchio_chain
    except ImportError:
        return {}
    return pinocchio_chain.measured(mechanism, x, udot, rounds)
