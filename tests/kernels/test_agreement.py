"""Machine code and CasADi's evaluator say the same of every problem and of random mechanisms.

Both run the same instructions; they differ by the last bits of sines and by contracted products, which the
equations magnify: by their condition, which is why the bound is relative to the largest entry.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

import deltac as dc
from deltac.dynamics.forces import channels
from deltac.dynamics.system import trace
from deltac.dynamics.terms import forward, terms
from deltac.kernels import Kernel
from deltac.simulation.constraints.feasibility import constraint_start
from deltac.simulation.flow import build_flow
from deltac.simulation.solvers import find_solver
from tests.systems.random_mechanisms import Sample, samples

pytestmark = pytest.mark.heyoka

AGREE = 1e-9
QUICK = ("simple-pendulum", "chaotic-double-body", "andrews-squeezer")


def assert_agree(outputs: dict[str, Any], inputs: dict[str, Any], x: np.ndarray) -> None:
    pytest.importorskip("llvmlite")
    found = []
    for evaluator in ("llvm", "casadi"):
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("DELTAC_EVALUATOR", evaluator)
            kernel = Kernel(inputs, outputs).compile()
            found.append(kernel.flat(x))
    scale = np.abs(found[1]).max()
    assert np.isfinite(scale)
    np.testing.assert_allclose(found[0], found[1], rtol=0, atol=AGREE * max(scale, 1.0))


def about(problem: dc.problems.Problem) -> None:
    mechanism, state = problem.mechanism, problem.state
    rows = constraint_start(mechanism, state, find_solver("ode4"), "projection")
    flow = build_flow(mechanism, ("wang",), rows=rows)
    start = flow.start(state, np.empty(0))
    rng = np.random.default_rng(1)
    x = np.empty((1 + len(start), 11))
    x[0], x[1:] = state.t + rng.uniform(0, 0.1, 11), start[:, None]
    x[1:, 1:] += 1e-3 * rng.normal(size=(len(start), 10))
    assert_agree({"xdot": flow.xdot, "E": flow.energies}, {"t": flow.t, "x": flow.x}, x)


@pytest.mark.parametrize("name", QUICK)
def test_problems(name: str) -> None:
    about(dc.problems.load(name))


@pytest.mark.slow
@pytest.mark.parametrize("name", [n for n in dc.problems.names() if n not in QUICK])
def test_other_problems(name: str) -> None:
    about(dc.problems.load(name))


@pytest.mark.long
@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(samples())
def test_random_mechanisms(sample: Sample) -> None:
    system, free = trace(sample.mechanism), sample.mechanism.free
    parts = channels(system)
    motion = forward(system, parts)
    known = terms(system, motion.udot, parts)
    inputs = {
        name: column
        for name, column in {
            "t": system.t,
            "q": system.q,
            "u": system.u,
            "inputs": system.inputs,
        }.items()
        if column.shape[0]
    }
    values = {"t": [sample.t], "q": sample.q[free.q], "u": sample.u[free.u]}
    values["inputs"] = np.zeros(system.inputs.shape[0])
    x = np.concatenate([values[name] for name in inputs])[:, None]
    outputs = {"udot": ca.densify(motion.udot), "K": known.K, "V": known.V}
    assert_agree(outputs, inputs, x)
