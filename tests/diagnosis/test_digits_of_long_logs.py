"""Digits of more rows than are looked at: the same as those of fewer rows."""

from __future__ import annotations

import numpy as np
import pytest

from deltac.arrays import EPS
from deltac.diagnosis.measurements.digits import Digits, resolution
from deltac.trajectories import Trajectory, suspicions
from deltac.trajectories.lint import LOOKED_AT

ROWS = 3 * LOOKED_AT
T = 1e-3 * np.arange(ROWS)
SMOOTH = np.sin(0.7 * T) + 0.1 * np.cos(13.0 * T)
COUNT = 2.0 * np.pi / 2**14
COLUMNS = {
    "doubles": (SMOOTH, EPS * np.abs(SMOOTH)),
    "single": (SMOOTH.astype("f4"), np.finfo("f4").eps * np.abs(SMOOTH.astype("f4").astype(float))),
    "decimals": (np.round(SMOOTH, 5), np.full(ROWS, 0.5e-5)),
    "encoder": (np.round(SMOOTH / COUNT) * COUNT, np.full(ROWS, 0.5 * COUNT)),
    "slow encoder": (np.round(SMOOTH / 1e3 / COUNT) * COUNT, None),
    "constant": (np.full(ROWS, 0.3), np.full(ROWS, EPS * 0.3)),
}


@pytest.mark.parametrize("name", COLUMNS)
def test_each_kind_is_recognised(name: str) -> None:
    values, expected = COLUMNS[name]
    digits = Digits(np.stack([SMOOTH, np.asarray(values, dtype=float)], axis=1))
    few = Digits(digits._values[:LOOKED_AT])
    some = np.array([5, LOOKED_AT - 1])
    # The count is the least difference of what was seen: known to the rounding of the numbers.
    np.testing.assert_allclose(digits.half(some), few.half(some), rtol=1e-9)
    assert digits.half().shape == (ROWS, 2)
    if expected is not None:
        np.testing.assert_allclose(digits.half()[:, 1], expected, rtol=1e-9)


def test_slips_of_a_long_log_are_seen() -> None:
    q, u = SMOOTH, np.gradient(SMOOTH, T)
    run = Trajectory(
        t=np.asarray(T, dtype=float),
        q=(180.0 / np.pi * q)[:, None],
        u=u[:, None],
        coordinates=("a",),
        speeds=("a",),
    )
    found = [s for s in suspicions(run) if s.certain]
    assert [s.kind for s in found] == ["degrees"] and found[0].factors["q.a"] == np.pi / 180.0


@pytest.mark.parametrize("rows", [20_001, 25_000, 40_000])
def test_rows_that_are_looked_at_twice_are_no_counts(rows: int) -> None:
    x = np.linspace(0.0, 50.0, rows)[:, None] ** 2
    np.testing.assert_array_equal(resolution(x), EPS * x)
