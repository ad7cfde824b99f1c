"""The width of the SIMD code: what suits the processor, what may be forced, and that numbers agree."""

from __future__ import annotations

import casadi
import numpy as np
import pytest

from deltac.errors import InputError
from deltac.kernels import Kernel, simd

pytestmark = pytest.mark.heyoka


def values(monkeypatch: pytest.MonkeyPatch, width: str, batch: int) -> np.ndarray:
    pytest.importorskip("llvmlite")
    monkeypatch.setenv("DELTAC_EVALUATOR", "llvm")
    monkeypatch.setenv("DELTAC_SIMD", width)
    x = casadi.SX.sym("x", 3)
    y = casadi.sin(x) * casadi.exp(casadi.cos(x[[1, 2, 0]])) / (1 + casadi.atan2(x, 2) ** 2)
    kernel = Kernel({"x": x}, {"y": y})
    return kernel.flat(np.random.default_rng(1).normal(size=(3, batch)))


@pytest.mark.parametrize("width", ["1", "2", "4", "8"])
def test_every_width_gives_the_same_numbers(width: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """To rounding: every function is within 1 ulp, and the expression adds up a few of them."""
    found, expected = values(monkeypatch, width, 1003), values(monkeypatch, "1", 1003)
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-15)


@pytest.mark.parametrize(
    ("found", "width"),
    [
        ({"sse2", "avx", "avx2", "fma"}, 4),
        ({"avx", "avx512f"}, 4),
        ({"avx", "avx512f", "avx512dq"}, 8),
        ({"neon"}, 2),
    ],
)
def test_width_suits_the_processor(
    found: set[str], width: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DELTAC_SIMD", raising=False)
    monkeypatch.setattr(simd, "features", lambda: found)
    simd._suited.cache_clear()
    try:
        assert simd.simd_width() == width
    finally:
        simd._suited.cache_clear()


@pytest.mark.parametrize("forced", ["3", "wide", "16"])
def test_unknown_width_is_named(forced: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DELTAC_SIMD", forced)
    with pytest.raises(InputError, match=f"DELTAC_SIMD='{forced}'.*1, 2, 4, 8"):
        simd.simd_width()
