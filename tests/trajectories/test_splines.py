"""Integrals and rates of splines: beside SciPy's own splines, and exact for polynomials of their degree."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from deltac.arrays import EPS, Array
from deltac.trajectories import splines
from deltac.trajectories.splines import spline_integrals, spline_rates

RNG = np.random.default_rng(1)
TIMES = {
    "even": np.linspace(3.0, 5.0, 400),
    "scattered": np.sort(RNG.uniform(0.0, 2.0, 300)),
    "few": np.linspace(0.0, 1.0, 6),
}


@pytest.mark.parametrize("degree", [1, 3, 5])
@pytest.mark.parametrize("t", TIMES.values(), ids=TIMES)
def test_as_scipy(t: Array, degree: int) -> None:
    x = np.sin(np.outer(t, [1.0, 3.0, 7.0]))
    spline = make_interp_spline(t, x, k=degree)
    integrals = np.diff(spline.antiderivative()(t), axis=0)
    # The difference of SciPy's sums from the first time on loses as many roundings as there are rows.
    np.testing.assert_allclose(spline_integrals(t, x, degree), integrals, atol=len(t) * EPS)
    if degree > 1:
        rates = spline.derivative()(t)
        loss = EPS * np.abs(x).max() / np.diff(t).min()
        np.testing.assert_allclose(spline_rates(t, x, degree), rates, atol=20.0 * loss)


@pytest.mark.parametrize("degree", [1, 3, 5])
def test_polynomials_are_exact(degree: int) -> None:
    t = TIMES["few"]
    powers = np.arange(1.0, degree + 2.0)
    x = powers * t[:, None] ** (powers - 1.0)
    np.testing.assert_allclose(
        spline_integrals(t, x, degree), np.diff(t[:, None] ** powers, axis=0), atol=100.0 * EPS
    )


def test_long_columns_are_not_remembered(monkeypatch: pytest.MonkeyPatch) -> None:
    t = np.linspace(0.0, 1.0, 50)
    x = np.cos(t)[:, None]
    known = spline_rates(t, x, 5)
    short = splines._rates(len(t))
    before = short.cache_info().currsize  # type: ignore[attr-defined]
    for limit in ("SHORT", "LONG_LOG"):
        monkeypatch.setattr(splines, limit, 10)
    np.testing.assert_array_equal(spline_rates(t, x, 5), known)
    spline_rates(t + 1.0, x, 5)
    assert short.cache_info().currsize == before and splines._rates(len(t)) is not short  # type: ignore[attr-defined]


def test_what_has_no_spline_is_refused() -> None:
    t = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    with pytest.raises(ValueError, match="infs or NaNs"):
        spline_integrals(t, np.full((7, 1), np.nan), 3)
