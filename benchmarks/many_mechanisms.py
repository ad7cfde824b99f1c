"""`python benchmarks/many_mechanisms.py COUNT`: one process that simulates many different mechanisms.

Chains of one to four bodies with random joints, masses and lengths, each with its own compiled kernels; one
of five has its balance taken, one of fifty is audited. Printed are the resident memory of the process and the
CPU time a mechanism, after each hundredth; the disk cache is off, so that everything is compiled.
"""

from __future__ import annotations

import os
import sys
import time

import numpy as np

os.environ["DELTAC_CACHE"] = "off"
import deltac as dc  # noqa: E402, the cache is switched off before deltac reads the environment

SOLVERS = ("ode4", "implicit-midpoint", "DOP853")
EVERY = 100


def chain(rng: np.random.Generator) -> dc.Mechanism:
    """A chain of rods, each hinged or sliding on the one before."""
    count = int(rng.integers(1, 5))
    bodies = [
        dc.rod(f"b{k}", rng.uniform(1, 2), rng.uniform(0.5, 1), along="-y") for k in range(count)
    ]
    joints = [
        rng.choice([dc.revolute, dc.revolute, dc.prismatic])(
            f"j{k}",
            f"b{k - 1}" if k else "ground",
            f"b{k}",
            position=(0, -0.5, 0) if k else (0, 0, 0),
            axis=str(rng.choice(["x", "z"])),
        )
        for k in range(count)
    ]
    return dc.Mechanism(bodies, joints, gravity=(0, -9.81, 0))


def resident() -> float:
    """Memory of this process (MB)."""
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def main(count: int) -> None:
    """Simulate, and print a line after each hundredth."""
    rng = np.random.default_rng(1)
    start = time.process_time()
    for k in range(1, count + 1):
        mechanism = chain(rng)
        state = mechanism.state({c.name: 0.3 for c in mechanism.coordinates})
        run = dc.simulate(mechanism, state, 0.1, 0.01, SOLVERS[k % 3])
        if k % 5 == 0:
            dc.balance(mechanism, run)
        if k % 50 == 0:
            dc.audit(mechanism, run)
        if k % EVERY == 0:
            taken = (time.process_time() - start) / EVERY
            print(
                f"{k:6d} mechanisms {resident():6.0f} MB {1e3 * taken:6.0f} ms CPU each", flush=True
            )
            start = time.process_time()


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5000)
