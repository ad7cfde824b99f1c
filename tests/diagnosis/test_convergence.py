"""The fit of an order study against curves whose limit and order are known by construction."""

from __future__ import annotations

import numpy as np
import pytest

from deltac import observed_order
from deltac.diagnosis.study.convergence import between_runs, order_of
from deltac.diagnosis.study.curves import common_times
from deltac.errors import InputError

T = np.linspace(0.0, 2.0, 60)
HALVES = np.array([4e-3, 2e-3, 1e-3])


def curves(steps: np.ndarray, order: float, limit: float, size: float = 1.0) -> np.ndarray:
    shape = size * np.sin(3.0 * T) * T / (steps[0] ** order)
    return np.array([limit * T + shape * h**order for h in steps])


def test_the_published_table_of_the_four_bar_gives_order_two() -> None:
    """IFToMM benchmark A02: largest energy errors of one second-order solver, to its three or four digits."""
    found = observed_order(
        [1e-3, 5e-4, 2.5e-4, 1.25e-4],
        [1.143e-3, 2.858e-4, 7.15e-5, 1.795e-5],
        [5e-7, 5e-8, 5e-8, 5e-9],
    )
    assert found.trend == "falls to zero"
    assert found.order == pytest.approx(2.0, abs=0.01)
    assert str(found) == "order 1.99 ± 0.01"


@pytest.mark.parametrize("order", [1.0, 2.5, 4.0, 8.0])
@pytest.mark.parametrize(
    "steps", [HALVES, np.array([0.01, 0.004, 0.001]), np.array([0.01, 0.008, 0.007])]
)
def test_order_and_no_limit(steps: np.ndarray, order: float) -> None:
    found = observed_order(steps, curves(steps, order, 0.0))
    assert found.trend == "falls to zero"
    assert found.order == pytest.approx(order, abs=1e-9)


@pytest.mark.parametrize("order", [1.0, 2.5, 5.0])
@pytest.mark.parametrize("steps", [HALVES, np.array([0.01, 0.004, 0.001])])
def test_order_and_limit(steps: np.ndarray, order: float) -> None:
    """The limit of such curves is exact after one extrapolation; its error bar holds it."""
    found = observed_order(steps, curves(steps, order, limit=3.0, size=0.5))
    assert found.trend == "tends to a limit"
    assert found.order == pytest.approx(order, abs=1e-6)
    assert found.limit == pytest.approx(6.0, rel=1e-9)
    assert found.limit_error > 0.0


def test_a_limit_that_hides_behind_the_step_error_is_not_claimed() -> None:
    """At first order with halved steps the correction that is left equals the last difference."""
    hidden = observed_order(HALVES, curves(HALVES, 1.0, limit=0.5, size=10.0))
    assert hidden.trend != "tends to a limit"
    assert abs(hidden.limit) < 10.0 * hidden.limit_error


def test_curves_that_do_not_fall_have_no_limit_either() -> None:
    rng = np.random.default_rng(1)
    assert observed_order(HALVES, rng.standard_normal((3, 60))).trend == "does not settle"


def test_rounding_is_no_error() -> None:
    floor = 1e-15
    assert observed_order(HALVES, [1e-15, 3e-15, 2e-15], floor).trend == "at its floor"
    fallen = observed_order([4e-3, 2e-3, 1e-3, 5e-4], [2.56e-8, 1e-10, 4e-15, 3e-15], floor)
    assert fallen.trend == "falls to zero"
    assert fallen.order == pytest.approx(8.0, abs=1e-9)


def test_coinciding_curves_tend_to_what_they_show() -> None:
    found = observed_order(HALVES, [4.2, 4.2, 4.2], 1e-12)
    assert (found.trend, found.limit) == ("tends to a limit", 4.2)
    assert found.limit_error < 1e-10


def test_two_runs_tell_an_order_but_no_limit() -> None:
    found = observed_order([2e-3, 1e-3], [1.6e-4, 1e-5])
    assert found.order == pytest.approx(4.0)
    assert np.isinf(found.limit_error)
    assert observed_order([1e-3], [1e-5]).trend == "one run"


@pytest.mark.parametrize(
    ("steps", "values", "said"),
    [
        ([1e-3, 2e-3], [1.0, 2.0], "coarsest first"),
        ([1e-3, 1e-3], [1.0, 2.0], "coarsest first"),
        ([1e-3, 0.0], [1.0, 2.0], "positive"),
        ([2e-3, 1e-3], [1.0], "one each"),
        ([2e-3, 1e-3], [1.0, np.nan], "finite"),
    ],
)
def test_unusable_tables_are_refused(steps: list[float], values: list[float], said: str) -> None:
    with pytest.raises(InputError, match=said):
        observed_order(steps, values)


def test_the_order_of_a_motion_needs_no_reference() -> None:
    x = np.array([[np.cos(T), np.sin(T)]] * 3).transpose(0, 2, 1)
    x = x + 1e3 * HALVES[:, None, None] ** 3 * T[None, :, None]
    found = between_runs(HALVES, x, np.full(3, 1e-15))
    assert found.trend == "tends to a limit"
    assert found.order == pytest.approx(3.0, abs=1e-3)  # rounding of x, 1e-16 of 1e-6


def test_amplified_rounding_is_told_from_truncation() -> None:
    """Both grow alike in a chaotic motion; only how they begin differs."""
    rng = np.random.default_rng(2)
    x = 1e-15 * rng.standard_normal((3, 60, 1)) * np.exp(14.0 * T)[None, :, None]
    assert between_runs(HALVES, x, np.full(3, 1e-15)).trend == "at its floor"


def test_common_times() -> None:
    fine, coarse = np.arange(0, 1.0005, 1e-3), np.arange(0, 1.002, 4e-3)
    t, rows = common_times([coarse, fine])
    np.testing.assert_allclose(t, coarse)
    np.testing.assert_array_equal(rows[1], 4 * np.arange(251))
    odd, _ = common_times([np.arange(0, 1, 3e-3), np.arange(0, 1, 2e-3)])
    np.testing.assert_allclose(odd, np.arange(0, 1, 6e-3))


@pytest.mark.parametrize("order", [1, 2, 5, 8])
def test_an_order_is_seen_from_the_differences_of_three_runs(order: int) -> None:
    """Errors e, e/2ʳ, e/16ʳ of runs at h, h/2, h/16 have known differences."""
    e, gain, h = 3e-7, 2.0**order, (1.0, 1 / 2, 1 / 16)
    coarse, fine = e * (1 - 1 / gain), e * (1 / gain - gain**-4)
    assert order_of(h, coarse, fine) == pytest.approx(order, rel=1e-6)
    assert order_of(h, -1e-7, 2e-7) == 0.0  # finer runs that are no nearer
