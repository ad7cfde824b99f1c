"""Rows into columns in registers: every number lands where NumPy puts it, and nothing else is touched."""

from __future__ import annotations

import numpy as np
import pytest

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
        move = transposing(source, room[1 : n + 1])
        move(0, rows, 2)
        expected = np.zeros_like(room)
        expected[1 : n + 1, 2 : rows + 2] = source.T
        np.testing.assert_array_equal(room, expected)
        source[:] = rng.random(source.shape)  # what an array holds when it is moved counts
        some = slice(rows // 3, rows)
        move(some.start, some.stop - some.start, 4)
        expected[1 : n + 1, 4 : 4 + some.stop - some.start] = source[some].T
        np.testing.assert_array_equal(room, expected)


def test_columns_that_are_not_side_by_side() -> None:
    source = np.arange(600.0).reshape(60, 10)[:, ::2]
    target = aligned(5, 60)
    transposing(source, target)(0, 60, 0)
    np.testing.assert_array_equal(target, source.T)
    assert target.ctypes.data % 64 == 0
