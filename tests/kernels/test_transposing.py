"""Rows into columns in registers: every number lands where NumPy puts it, and nothing else is touched."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from deltac.kernels import Kernel
from deltac.kernels.calls import in_turn
from deltac.kernels.transposing import aligned, transposing

SHAPES = [(1000, 27), (8, 8), (13, 9), (40, 3), (5, 30), (3, 2), (1, 40), (50, 1), (9, 6)]


@pytest.mark.parametrize("width", ["8", "4", "2", "1"])
@pytest.mark.parametrize("evaluator", ["llvm", "casadi"])
def test_as_numpy_does(width: str, evaluator: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if evaluator == "llvm":
        pytest.importorskip("llvmlite", reason="the native function is LLVM's")
    monkeypatch.setenv("DELTAC_SIMD", width)
    monkeypatch.setenv("DELTAC_EVALUATOR", evaluator)
    rng = np.random.default_rng(0)
    for rows, n in SHAPES:
        source = rng.random((rows, n + 2))[:, 1 : n + 1]
        room = np.zeros((n + 2, rows + 5))
        target = room[1 : n + 1, 2 : rows + 2]
        move = transposing(source, target)
        move(0)
        expected = np.zeros_like(room)
        expected[1 : n + 1, 2 : rows + 2] = source.T
        np.testing.assert_array_equal(room, expected)
        source[:] = rng.random(source.shape)  # what an array holds when it is moved counts
        some = slice(rows // 3, rows)
        transposing(source, target[:, some], moving=True)(some.start)
        expected[1 : n + 1, 2 + some.start : rows + 2] = source[some].T
        np.testing.assert_array_equal(room, expected)


@pytest.mark.parametrize("evaluator", ["llvm", "casadi"])
def test_many_calls_as_one(evaluator: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if evaluator == "llvm":
        pytest.importorskip("llvmlite", reason="the native function is LLVM's")
    monkeypatch.setenv("DELTAC_EVALUATOR", evaluator)
    rng = np.random.default_rng(1)
    log, columns = rng.random((50, 9)), aligned(9, 16)
    doubled, back = aligned(9, 16), aligned(16, 9)
    x = ca.SX.sym("x", 9)
    kernel = Kernel({"x": x}, {"y": 2.0 * x})
    at_once = in_turn(
        [
            transposing(log[8:], columns, moving=True),
            kernel.bound_batch(columns, doubled),
            transposing(doubled, back),
        ]
    )
    for first in (0, 5, 26):
        at_once(first)
        np.testing.assert_array_equal(back, 2.0 * log[8 + first : 24 + first])
    in_turn([])(3)


def test_columns_that_are_not_side_by_side() -> None:
    source = np.arange(600.0).reshape(60, 10)[:, ::2]
    target = aligned(5, 60)
    transposing(source, target)(0)
    np.testing.assert_array_equal(target, source.T)
    assert target.ctypes.data % 64 == 0
