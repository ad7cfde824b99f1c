"""Generated C says what the other evaluators say, one state at a time, in batches and over and over."""

from __future__ import annotations

import shutil

import casadi as ca
import numpy as np
import pytest

import deltac as dc
from deltac.errors import PackageError
from deltac.kernels import Kernel, c_evaluator

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler cc")


def kernel() -> Kernel:
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 2)
    y = ca.if_else(x[0] < 0, ca.sin(x) * p[0], ca.exp(-(x**2)) + ca.atan2(x, p[1]))
    return Kernel({"x": x}, {"x": y}, p)


def every_way(name: str, monkeypatch: pytest.MonkeyPatch) -> list[np.ndarray]:
    monkeypatch.setenv("DELTAC_EVALUATOR", name)
    rng = np.random.default_rng(3)
    x, p = rng.normal(size=(3, 21)), rng.uniform(1, 2, size=(2, 21))
    made, one, bound = kernel(), np.empty(3), np.empty(3)
    first, its = np.ascontiguousarray(x[:, 0]), np.ascontiguousarray(p[:, 0])
    made.single(first, one, its)
    made.bound(first, bound, its)()
    np.testing.assert_array_equal(bound, one)
    found = [made.flat(x, p), one, made.iterate(first, 7, p[:, :3].T)]
    np.testing.assert_array_equal(found[0][:, 0], one)
    return found


@needs_compiler
def test_c_agrees_with_the_interpreter(monkeypatch: pytest.MonkeyPatch) -> None:
    found, expected = (every_way(name, monkeypatch) for name in ("c", "casadi"))
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-13, atol=1e-15)


@needs_compiler
def test_a_run_and_its_verdict_by_c(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, found = dc.problems.load("triple-pendulum"), []
    for name in ("c", "casadi"):
        monkeypatch.setenv("DELTAC_EVALUATOR", name)
        run = dc.simulate(problem, duration=1.0, step=1e-2, solver="ode4")
        found.append((run.q[-1], dc.balance(problem, run).delta_c["wang"]))
    for a, b in zip(*found, strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-12)


@needs_compiler
def test_the_compiler_is_asked_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DELTAC_EVALUATOR", "c")
    first = kernel().compile(single=True)
    monkeypatch.setattr(c_evaluator, "_made", lambda function: pytest.fail("compiled again"))
    again = kernel().compile(single=True)
    x, p = np.array([0.1, -0.2, 0.3]), np.array([1.0, 2.0])
    found = [made.single(x, np.empty(3), p) for made in (first, again)]
    np.testing.assert_array_equal(found[0], found[1])


def test_without_a_compiler_the_remedy_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DELTAC_EVALUATOR", "c")
    monkeypatch.setenv("CC", "/nowhere/cc")
    with pytest.raises(PackageError, match="no C compiler '/nowhere/cc'.*CC"):
        kernel().compile()
