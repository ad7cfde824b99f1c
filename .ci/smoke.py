"""What an installation must be able to do: run by .ci/wheel and the workflows, outside of the sources."""

from __future__ import annotations

import sys
from pathlib import Path

import deltac as dc

assert Path(dc.__file__).is_relative_to(sys.prefix), f"deltac is imported from {dc.__file__}"

pendulum = dc.Mechanism(
    bodies=[dc.point_mass("bob", mass=2.0, at=(0, -0.5, 0))],
    joints=[dc.revolute("pivot", "ground", "bob", "z", damping=0.1)],
    gravity=(0, -9.81, 0),
)
run = dc.simulate(pendulum, {"pivot": 1.0}, duration=1.0, step=1e-3)
ledger = dc.balance(pendulum, run)
assert ledger.relative("wang") < 1e-9, ledger

run.write("run.parquet")
audit = dc.audit(pendulum, dc.read_trajectory("run.parquet"))
assert audit.verdict.kind == "consistent", audit

monitor = dc.Monitor(pendulum, tolerance=1e-6)
for k, t in enumerate(run.t):
    monitor.update(t, run.q[k], run.u[k], run.udot[k])
print(f"deltac {dc.__version__} on Python {sys.version.split()[0]}: {monitor}")
