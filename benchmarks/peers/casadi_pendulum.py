"""The triple pendulum in CasADi: deltac's own expressions of a step, by what CasADi has to evaluate them.

`mapaccum` takes all steps in one call and keeps all states. This is no other program's model: it tells
what a CasADi user gets from the same step, without testing functions.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import casadi as ca
import numpy as np

from deltac.simulation.flow import build_flow
from deltac.simulation.solvers import find_solver
from peers.rival import Array, Pendulum, Rival

SOLVER = "ode5"


def rivals(pendulum: Pendulum) -> Iterator[Rival]:
    """CasADi's virtual machine, and its C code where there is a compiler."""
    solver, march = find_solver(SOLVER), _march(pendulum)
    assert solver.order is not None
    steps, cost = pendulum.steps, (solver.order, solver.stages)
    yield Rival("CasADi, interpreted", _runner(march, pendulum), steps, *cost, "mapaccum: q, u")
    compiler = shutil.which("cc")
    if compiler:
        compiled = _compiled(march, compiler)
        note = "mapaccum as C by cc -O3: q, u"
        yield Rival("CasADi, compiled as C", _runner(compiled, pendulum), steps, *cost, note)


def _march(pendulum: Pendulum) -> ca.Function:
    """x at the start -> x after every step, a column each."""
    flow, solver = build_flow(pendulum.problem.mechanism), find_solver(SOLVER)
    assert solver.step is not None
    rate = ca.Function("rate", [flow.t, flow.x], [flow.xdot], {"cse": True})
    after = solver.step(rate, 0.0, flow.x, pendulum.step, flow.parts)
    step = ca.Function("step", [flow.x], [after], {"cse": True})
    return step.mapaccum("march", pendulum.steps)


def _compiled(march: ca.Function, compiler: str) -> ca.Function:
    """The same function as machine code; the library stays loaded when its file is gone."""
    with tempfile.TemporaryDirectory() as folder:
        source, library = Path(folder, "march.c"), Path(folder, "march.so")
        generator = ca.CodeGenerator(source.name)
        generator.add(march)
        generator.generate(f"{folder}/")
        command = [compiler, "-O3", "-march=native", "-fPIC", "-shared", source, "-o", library]
        subprocess.run(command, check=True)
        return ca.external(march.name(), str(library))


def _runner(march: ca.Function, pendulum: Pendulum) -> Callable[[], Array]:
    start = np.concatenate([pendulum.q, pendulum.u])
    return lambda: np.array(march(start))[:3].T
