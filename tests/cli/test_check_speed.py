"""`deltac check` starts cold and is done soon: processor time of a new process."""

from __future__ import annotations

import resource
import subprocess
import sys
from pathlib import Path

import pytest

CHAIN = """
import casadi as ca
import numpy as np
import deltac as dc
from deltac.dynamics.system import trace
from deltac.dynamics.terms import forward

def chain():
    bodies = [dc.box(f"b{k}", 1 + 0.1 * k, (0.1, 0.3, 0.2), (0, -0.15, 0)) for k in range(N)]
    at = lambda k: dict(position=(0, -0.3 if k else 0, 0), damping=0.01)
    joints = [dc.revolute(f"j{k}", f"b{k-1}" if k else "ground", f"b{k}", "xyz"[k % 3], **at(k))
              for k in range(N)]
    return dc.Mechanism(bodies, joints, gravity=(0, -9.81, 0))

def equations():
    s = trace(chain())
    f = ca.Function("f", [s.t, s.q, s.u], [forward(s).udot[s.free_u]])
    def rhs(t, q, u):
        value = np.array(f(t, q, u)).ravel()
        value[1] *= FACTOR
        return value
    return dc.Equations(rhs)
"""


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1.0, 1.01])
@pytest.mark.parametrize(("dof", "seconds"), [(3, 2.0), (30, 10.0)])
def test_cold_start(tmp_path: Path, dof: int, seconds: float, factor: float) -> None:
    path = tmp_path / "chain.py"
    path.write_text(CHAIN.replace("FACTOR", str(factor)).replace("N)", f"{dof})"), "utf-8")
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-c", "from deltac.cli import main; main()", "check"]
    done = subprocess.run(
        [*command, f"{path}:chain", f"{path}:equations"], capture_output=True, text=True
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert done.returncode == (0 if factor == 1.0 else 1), done.stdout + done.stderr
    took = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    assert took < seconds
    print(f"{dof} dof, factor {factor}: {took:.2f} s")
