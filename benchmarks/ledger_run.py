"""The ledger of a long log of a humanoid, beside a Python loop over `mj_forward` with energies.

Both sides have the log in memory. We give powers, works and error bars of all channels, four testing
functions and the momenta; the loop gives the energies and three powers at the samples, and no works. Both
use all cores. In our time is all that a first call does, the compiler included; in theirs the start of the
processes, which share the log. Nothing touches in this motion, and MuJoCo is told not to look for it.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import humanoid
import numpy as np
from measure import contest, median_seconds
from numpy.typing import NDArray

import deltac as dc
from deltac.dynamics.testing_functions import applicable, testing_functions
from deltac.energy.sampling.quadrature import INNER
from deltac.energy.terms import LoggedForces, ledger_kernels, ledger_symbols
from deltac.kernels.kernel import BLOCK_STATES
from deltac.kernels.parallel import cores, spread

Array = NDArray[np.float64]
TARGET = 50.0
KEPT = 20_000
"""Rows of the ledger that keeps some."""

# Both sides evaluate the same closed forms; what is left is rounding, and what the quadrature's bar says.
AGREE = 1e-10  # relative to the largest


def run(rows: int, rounds: int) -> dict[str, Any]:
    """Check that both sides are right, then time them; {"skipped": why} without MuJoCo."""
    name = f"27-dof humanoid, ledger of {rows} samples: deltac / Python loop over mj_forward"
    if find_spec("mujoco") is None:
        return {"name": name, "skipped": "MuJoCo is not installed (the extra 'mujoco' brings it)"}
    from deltac.importers import read_mechanism

    log = humanoid.log(rows)
    mechanism, _ = read_mechanism(humanoid.model())

    def ours() -> dc.Ledger:
        return dc.balance(mechanism, log, work="samples")

    def theirs() -> Array:
        return humanoid.in_parallel(_loop, log.q, log.u, sum(log.forces.values()))

    ledger = ours()
    accuracy = _checked(ledger, theirs())
    found = {"name": name, "target": TARGET, **contest(ours, theirs, rounds).summary()}
    reading = median_seconds(lambda: read_once(log), rounds)
    kept = median_seconds(lambda: dc.balance(mechanism, log, work="samples", keep=KEPT), rounds)
    bare = _bare(mechanism, log, rounds)
    return {
        **found,
        "kept_s": kept,
        "kept_times_reading": kept / reading,
        "bare_s": bare,
        "bare_times_reading": bare / reading,
        "rows": rows,
        "channels": len(ledger.power),
        "rule": ledger.rule,
        "nodes_between": 0 if ledger.rule == "samples" else len(INNER),
        "samples_per_s": rows / found["ours_s"],
        "their_samples_per_s": rows / found["theirs_s"],
        "reading_s": reading,
        "times_reading": found["ours_s"] / reading,
        **accuracy,
    }


def told(found: dict[str, Any]) -> str:
    """What is particular to this contest, in words."""
    return (
        f"{found['samples_per_s']:.0f} samples/s, the loop {found['their_samples_per_s']:.0f}; "
        f"{found['channels']} channels, works by rule {found['rule']!r}, "
        f"{found['nodes_between']} nodes between samples; "
        f"{found['times_reading']:.0f} times as long as reading q, u and the forces "
        f"({found['reading_s']:.3f} s); with {KEPT} rows kept "
        f"{found['kept_times_reading']:.1f} times, the bare kernel on states in its cache "
        f"{found['bare_times_reading']:.1f} times"
    )


def _bare(mechanism: dc.Mechanism, log: dc.Trajectory, rounds: int) -> float:
    """Seconds of the compiled equations alone for as many samples on all cores; nothing is kept."""
    forces = LoggedForces.of(log)
    symbols = ledger_symbols(mechanism, forces, None, (0.0, log.q[0]))
    kernel = ledger_kernels(
        symbols, testing_functions(applicable(constrained=False)), forces.places
    ).at_samples
    x = np.random.default_rng(1).random((kernel.n_in, BLOCK_STATES))
    kernel.compile()

    def some(blocks: int) -> None:
        out = np.empty((kernel.n_out, BLOCK_STATES))
        for _ in range(blocks):
            kernel.flat(x, out=out)

    share = [len(log) // BLOCK_STATES // cores()] * cores()
    return median_seconds(lambda: spread(some, share), rounds)


def read_once(log: dc.Trajectory) -> float:
    """Read q, u and every force array once."""
    return float(sum(a.sum() for a in (log.q, log.u, *log.forces.values())))


def _loop(q: Array, u: Array, applied: Array) -> Array:
    """V, K, and the powers of springs, dampers and applied forces, (T, 5)."""
    import mujoco

    model = humanoid.model()
    data = mujoco.MjData(model)
    found = np.empty((len(q), 5))
    for row, qpos, qvel, force in zip(found, q, u, applied, strict=True):
        data.qpos, data.qvel, data.qfrc_applied = qpos, qvel, force
        mujoco.mj_forward(model, data)
        row[:2] = data.energy
        row[2] = data.qfrc_spring @ qvel
        row[3] = data.qfrc_damper @ qvel
        row[4] = force @ qvel
    return found


def _checked(ledger: dc.Ledger, rival: Array) -> dict[str, float]:
    """K, V and powers agree with MuJoCo's, and the balance closes; AssertionError if not."""
    kinds = {"spring": ("spring",), "damper": ("damper",), "logged": ("actuator", "applied")}
    powers = [
        sum(p for name, p in ledger.power.items() if name.startswith(kind))
        for kind in kinds.values()
    ]
    pairs = zip(
        ("V", "K", *kinds),
        (ledger.potential_energy - ledger.potential_energy[0], ledger.kinetic, *powers),
        (rival[:, 0] - rival[0, 0], *rival[:, 1:].T),
        strict=True,
    )
    off = {f"off_{name}": float(np.abs(a - b).max() / np.abs(b).max()) for name, a, b in pairs}
    for name, value in off.items():
        assert value < AGREE, f"{name}: deltac and MuJoCo differ by {value:.1e}"
    for name, values in ledger.delta_c.items():
        assert np.all(np.abs(values) <= ledger.error_bar[name]), f"{name} does not close"
    return {**off, "relative_error": ledger.relative("wang")}
