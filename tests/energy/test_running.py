"""Running integrals: those of `EvenSums`, which goes through windows of eight samples, by another route."""

from __future__ import annotations

import numpy as np
import pytest

from deltac.energy.sampling.quadrature import EvenSums
from deltac.energy.sampling.running import REACH, ROWS_AHEAD, Running

ROWS, FIRST = 144, 64


@pytest.mark.parametrize("columns", [1, 9])
def test_the_integrals_of_windows(columns: int) -> None:
    t = np.arange(ROWS + 200)
    rng = np.random.default_rng(1)
    powers = np.array([np.sin(0.05 * (k + 2) * t + k) for k in range(columns)])
    powers += 0.01 * rng.standard_normal(powers.shape)
    windows = EvenSums(1.0)
    fine, half, quarter = (windows.sums(np.ascontiguousarray(powers[:, ::n]), n) for n in (1, 2, 4))
    running = Running(ROWS, columns)
    running.powers[:] = powers[:, FIRST - REACH : FIRST + ROWS + REACH + 1].T
    state = running()

    expected = (fine[:, FIRST : FIRST + ROWS + 1] - fine[:, FIRST, None]).T
    places = np.arange(ROWS + 1)
    np.testing.assert_allclose(running.value(places), expected, atol=1e-12)
    np.testing.assert_array_equal(state["value"], running.value(places[-1:])[0])

    error = (fine[:, ::2] - half)[:, FIRST // 2 :]
    error -= error[:, :1].copy()
    seen = (places[:-1] + ROWS_AHEAD + 1) // 2
    most, least = running.reached(places[:-1])
    np.testing.assert_allclose(most, np.maximum.accumulate(error, axis=1)[:, seen].T, atol=1e-12)
    np.testing.assert_allclose(least, np.minimum.accumulate(error, axis=1)[:, seen].T, atol=1e-12)

    end = ROWS // 2
    np.testing.assert_allclose(state["error"], error[:, end], atol=1e-12)
    np.testing.assert_allclose(state["most"], error[:, : end + 1].max(axis=1), atol=1e-12)
    np.testing.assert_allclose(state["least"], error[:, : end + 1].min(axis=1), atol=1e-12)
    steps = np.abs(np.diff(error[:, : end + 1])).sum(axis=1)
    np.testing.assert_allclose(state["finer"], steps, atol=1e-11)
    coarse = (half[:, ::2] - quarter)[:, FIRST // 4 : FIRST // 4 + ROWS // 4 + 1]
    steps = np.abs(np.diff(coarse)).sum(axis=1)
    np.testing.assert_allclose(state["coarser"], steps, atol=1e-11)
    size = np.abs(powers[:, FIRST : FIRST + ROWS]).sum(axis=1)
    np.testing.assert_allclose(state["size"], size, rtol=1e-13)
