"""`deltac check` in a process of its own, of chains with all their equations in one function."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.commands import command
from tests.support.slow import repeated

CHAIN = """
import casadi as ca
import numpy as np
import deltac as dc
from deltac.dynamics.system import trace
from deltac.dynamics.terms import forward

def chain():
    bodies = [dc.bodies.box(f"b{k}", 1 + 0.1 * k, (0.1, 0.3, 0.2), (0, -0.15, 0)) for k in range(N)]
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


@pytest.mark.long
@pytest.mark.parametrize("factor", repeated((1.0, 1.01), 1.01))
@pytest.mark.parametrize("dof", repeated((3, 30), 3))
def test_a_new_process_tells_right_from_wrong(tmp_path: Path, dof: int, factor: float) -> None:
    path = tmp_path / "chain.py"
    path.write_text(CHAIN.replace("FACTOR", str(factor)).replace("N)", f"{dof})"), "utf-8")
    command = [sys.executable, "-m", "deltac", "check", f"{path}:chain", f"{path}:equations"]
    command.append("--json")
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == (0 if factor == 1.0 else 1), done.stdout + done.stderr
    found = json.loads(done.stdout)
    assert found["verdict"] == ("consistent" if factor == 1.0 else "equation-error")


@pytest.mark.parametrize("arguments", [("check",), ("study", "--steps", "0.02,0.01")])
def test_a_function_that_ends_the_program_is_no_verdict(
    tmp_path: Path, arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit status 0 means consistent."""
    path = tmp_path / "ending.py"
    path.write_text("import sys\n\n\ndef rhs(t, q, u):\n    sys.exit(0)\n", "utf-8")
    name, *options = arguments
    given = [f"{path}:rhs"] if name == "check" else ["--equations", f"{path}:rhs"]
    status, out, err = command(name, "simple-pendulum", *given, *options, capsys=capsys)
    assert (status, out) == (2, "")
    assert f"{path}:rhs called sys.exit(0)" in err
