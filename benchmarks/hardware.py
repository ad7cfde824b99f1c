"""What the processor allows, measured on the spot: floating-point operations, and bytes from memory."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from measure import median_seconds

from deltac.kernels import Kernel
from deltac.kernels.parallel import cores, spread

OPERATIONS = 2000
BATCH = 512
COPIED = 64 * 2**20  # bytes, far beyond the caches


def run(rounds: int) -> dict[str, Any]:
    """Operations per second of one core and of all, and bytes read and written per second by all."""
    peak = _peak()
    x, outs = np.ones((peak.n_in, BATCH)), [np.empty((peak.n_out, BATCH)) for _ in range(cores())]
    repeats = 200

    def busy(out: Any) -> None:
        for _ in range(repeats):
            peak.flat(x, out=out)

    one = median_seconds(lambda: spread(busy, outs[:1]), rounds)
    every = median_seconds(lambda: spread(busy, outs), rounds)
    work = 2.0 * OPERATIONS * BATCH * repeats  # a product and a sum each
    blocks = np.array_split(np.ones(COPIED // 8), cores())
    targets = [np.empty_like(block) for block in blocks]
    copying = median_seconds(
        lambda: spread(lambda k: np.copyto(targets[k], blocks[k]), range(len(blocks))), rounds
    )
    return {
        "cores": cores(),
        "gflops_one_core": 1e-9 * work / one,
        "gflops": 1e-9 * work * cores() / every,
        "gbytes_per_s": 1e-9 * 2 * COPIED / copying,
    }


def _peak() -> Kernel:
    """Independent chains of x ← a x + b, as many as hide the latency, so that nothing else limits."""
    chains = 16
    x = ca.SX.sym("x", chains)
    y = ca.vertsplit(x)
    for k in range(OPERATIONS):
        y[k % chains] = 0.999 * y[k % chains] + 0.001
    return Kernel({"x": x}, {"y": ca.vertcat(*y)}, name="peak").compile()
