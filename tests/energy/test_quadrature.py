"""Integrals along samples: their order, and whether their error bars can be believed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import deltac as dc
from deltac.energy.sampling import quadrature
from deltac.energy.sampling.quadrature import hermite, integrate, lagrange
from deltac.energy.sampling.samples import Between, Samples, Smooth, at_samples, spline_rate
from tests.support.slow import repeated
from tests.systems.machines import robot, workshop

Array = NDArray[np.float64]


def analytic(t: Array, derived: bool = False) -> Samples:
    """y = sin 3t with its rate; z = cos 2t as values alone."""
    y, dy = np.sin(3 * t)[:, None], 3 * np.cos(3 * t)[:, None]
    if derived:
        dy = spline_rate(t, y)
    z = np.cos(2 * t)[:, None]
    return Samples(
        t, {"y": Smooth(y, lambda: dy)}, {"z": z}, {}, frozenset({"y"} if derived else ())
    )


def cumulated(samples: Samples, powers: Any, window: int) -> Array:
    """∫ from the first sample to each of them, (T, m), by Hermite interpolation in a window."""
    parts = hermite(samples, powers, at_samples(samples, powers), window, samples.smooth)
    return parts.cumsum(axis=1).T


def integrand(t: Array, between: Between) -> Array:
    """ẏ y² and ẏ² e^y: integrals known, and by a fine rule."""
    y, dy = between.values["y"][:, 0], between.rates["y"][:, 0]
    return np.stack([dy * y**2, dy**2 * np.exp(y)], axis=1)


GAUSS = np.polynomial.legendre.leggauss(100)


def reference(t: float) -> Array:
    nodes, weights = GAUSS
    s = 0.5 * t * (nodes + 1)
    second = 0.5 * t * weights @ (9 * np.cos(3 * s) ** 2 * np.exp(np.sin(3 * s)))
    return np.array([np.sin(3 * t) ** 3 / 3, second])


@pytest.mark.parametrize(("window", "order"), quadrature.HERMITE_ORDERS.items())
def test_order_of_the_interpolation(window: int, order: int) -> None:
    """Cubic and heptic Hermite interpolation: order 4 and 8 at least."""
    errors = []
    for count in (21, 41):
        t = np.linspace(0, 2, count)
        found = cumulated(analytic(t), integrand, window)[-1]
        errors.append(np.abs(found - reference(2.0)).max())
    assert np.log2(errors[0] / errors[1]) > order - 0.4


def test_windows_reproduce_the_polynomials_they_should() -> None:
    """A cubic's values and rates are exact in both windows, on uneven times too."""
    t = np.array([0.0, 0.3, 0.4, 0.9, 1.0, 1.7])
    y, dy = (t**3 - t)[:, None], (3 * t**2 - 1)[:, None]
    samples = Samples(t, {"y": Smooth(y, lambda: dy)}, {}, {})
    for window in quadrature.HERMITE_ORDERS:
        found = cumulated(samples, lambda t, b: b.values["y"] * b.rates["y"], window)[:, 0]
        np.testing.assert_allclose(found, y[:, 0] ** 2 / 2, atol=1e-14)


@pytest.mark.parametrize("spacing", ["even", "uneven"])
def test_order_of_the_powers_alone(spacing: str) -> None:
    """Polynomials through eight samples: order 8, and exact to degree 7 whatever the spacing."""
    errors = []
    for count in (41, 81):
        t = np.linspace(0, 2, count)
        if spacing == "uneven":
            t += 0.1 * np.sin(np.pi * t)
        samples = analytic(t)
        found = lagrange(samples, at_samples(samples, integrand))[:, -1]
        errors.append(np.abs(found - reference(2.0)).max())
        powers = lagrange(samples, t[None, :] ** np.arange(8)[:, None])
        exact = t[None, :] ** np.arange(1, 9)[:, None] / np.arange(1, 9)[:, None]
        np.testing.assert_allclose(powers, exact, rtol=1e-13, atol=1e-13)
    assert np.log2(errors[0] / errors[1]) > quadrature.SAMPLED - 1.5


@pytest.mark.parametrize("count", [9, 31, 32, 33, 55, 56, 800, 1600])
@pytest.mark.parametrize("start", [0.0, -1e3])
def test_equidistant_samples_share_their_weights(count: int, start: float) -> None:
    """Degree 7 exactly, wherever blocks and bands of windows end, and whatever the time of the start."""
    t = start + np.linspace(-1, 1, count)
    x = t - start
    found = lagrange(Samples(t, {}, {}, {}), x[None, :] ** np.arange(8)[:, None])
    degree = np.arange(1, 9)[:, None]
    exact = (x[None, :] ** degree - (-1.0) ** degree) / degree
    np.testing.assert_allclose(found, exact, atol=2e-15 * np.sqrt(count) * max(1.0, abs(start)))


def test_the_powers_alone_serve_where_the_log_is_smooth_and_dense() -> None:
    dense = integrate(analytic(np.linspace(0, 2, 1001)), integrand)
    assert dense.rule == "samples"
    exact = np.array([reference(s) for s in np.linspace(0, 2, 1001)])
    np.testing.assert_allclose(dense.value, exact, atol=1e-13)
    t = np.linspace(0, 2, 1001)
    kinked = Samples(t, {}, {"z": np.abs(t - 0.777)[:, None]}, {})
    assert integrate(kinked, lambda t, b: b.values["z"]).rule != "samples"
    held = Samples(t, {}, {}, {"f": np.cos(t)[:, None]})
    found = integrate(held, lambda t, b: b.values["f"])
    assert found.rule != "samples"
    np.testing.assert_allclose(
        found.value[1:, 0], np.cumsum(np.cos(t[:-1]) * np.diff(t)), rtol=1e-13
    )


def test_held_values_are_constant_until_the_next_sample() -> None:
    t = np.array([0.0, 1.0, 3.0])
    samples = Samples(t, {}, {}, {"f": np.array([[2.0], [-1.0], [9.0]])})
    found = cumulated(samples, lambda t, b: b.values["f"], 2)[:, 0]
    np.testing.assert_allclose(found, [0, 2, 0], atol=1e-15)


@pytest.mark.parametrize("derived", [False, True])
@pytest.mark.parametrize("count", [5, 6, 9, 10, 17, 33, 65, 129])
def test_bars_of_known_integrals(count: int, derived: bool) -> None:
    rng = np.random.default_rng(count)
    even = np.linspace(0, 2, count)
    uneven = even + np.r_[0, rng.uniform(-0.3, 0.3, count - 2), 0] * (2 / (count - 1))
    for t in (even, uneven):
        found = integrate(analytic(t, derived), integrand)
        exact = np.array([reference(s) for s in t])
        error = np.abs(found.value - exact)
        assert (error <= found.bar + 1e-14).all()


@pytest.mark.parametrize("count", [2, 3, 4])
def test_a_few_samples_whose_rates_are_derived(count: int) -> None:
    found = integrate(analytic(np.linspace(0.0, 0.1, count), derived=True), integrand)
    assert np.isfinite(found.value).all()
    np.testing.assert_array_equal(found.bar[-1], np.abs(found.value).max(axis=0))


@pytest.mark.parametrize("offset", [1e3, 1e6, 1.7e9])
@pytest.mark.parametrize("spacing", ["even", "uneven"])
@pytest.mark.parametrize("derived", [False, True])
def test_bars_hold_where_times_are_far_from_zero(
    offset: float, spacing: str, derived: bool
) -> None:
    """Seconds since 1970 are rounded to 2e-7 s: even ones cost nothing, others are in the bar."""
    t = np.linspace(0, 2, 401)
    if spacing == "uneven":
        t[1:-1] += np.random.default_rng(3).uniform(-0.3, 0.3, 399) * 0.005
    near = analytic(t, derived)
    far = replace(near, t=t + offset)
    exact = np.array([reference(s) for s in t])
    found = integrate(far, lambda t, between: integrand(t - offset, between))
    error = np.abs(found.value - exact)
    assert (error <= found.bar + 1e-14).all()
    if spacing == "even":
        span = np.spacing(offset) / 2.0  # how well the duration itself is known
        assert error.max() <= 1e-12 + span * np.abs(exact).max()


def test_bars_grow_with_what_a_log_leaves_out() -> None:
    kinked = Samples(t := np.linspace(0, 2, 41), {}, {"z": np.abs(t - 0.777)[:, None]}, {})
    found = integrate(kinked, lambda t, b: b.values["z"])
    exact = np.where(t < 0.777, 0.777 * t - t**2 / 2, 0.777**2 / 2 + (t - 0.777) ** 2 / 2)
    assert (np.abs(found.value[:, 0] - exact) <= found.bar[:, 0] + 1e-14).all()
    assert found.bar[-1, 0] > 1e-5  # whatever order a smooth log would have


def test_the_order_of_evaluation_leaves_no_trace(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bit for bit, however the samples are cut into batches."""
    mechanism, state = robot()
    run = dc.simulate(mechanism, state, 0.5, 0.01, "ode1")
    whole = dc.balance(mechanism, run, work="samples", testing=("wang",))
    for rows in (1, 7, 16):
        monkeypatch.setattr(quadrature, "ROWS_AT_ONCE", rows)
        cut = dc.balance(mechanism, run, work="samples", testing=("wang",))
        np.testing.assert_array_equal(cut.delta_c["wang"], whole.delta_c["wang"])
        for name, work in whole.work.items():
            np.testing.assert_array_equal(cut.work[name], work)
    part = dc.balance(mechanism, run.between(0.0, 0.255), work="samples", testing=("wang",))
    for name, power in part.power.items():
        np.testing.assert_array_equal(power, whole.power[name][: len(part.t)])


# --- real motions: against integrals that the Taylor method took in the loop --------------------------

FINE = 1024


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(robot, id="robot"),
        pytest.param(workshop, id="workshop", marks=pytest.mark.slow),
    ],
)
def fine(request: pytest.FixtureRequest) -> tuple[dc.Mechanism, dc.Trajectory]:
    mechanism, state = request.param()
    return mechanism, dc.simulate(mechanism, state, 2.0, 2.0 / FINE, "taylor")


def rows(run: dc.Trajectory, chosen: Any) -> dc.Trajectory:
    """A log of some rows only."""
    pick = {name: getattr(run, name)[chosen] for name in ("t", "q", "u", "udot")}
    forces = {name: values[chosen] for name, values in run.forces.items()}
    sums: dict[str, Any] = {
        k: {n: v[chosen] for n, v in getattr(run, k).items()} for k in ("works", "integrals")
    }
    return replace(run, **pick, forces=forces, **sums)


@pytest.mark.long
@pytest.mark.heyoka
@pytest.mark.parametrize("log", ["even", "uneven", "no accelerations"])
@pytest.mark.parametrize("stride", repeated([8, 16, 32, 64], 8, 64))
def test_bars_of_real_motions(fine: Any, log: str, stride: int) -> None:
    """The true error is below the bar, and the bar is within three decades of it or tiny."""
    mechanism, run = fine
    chosen = np.arange(0, FINE + 1, stride)
    if log == "uneven":
        rng = np.random.default_rng(stride)
        chosen[1:-1] += rng.integers(-stride // 4, stride // 4 + 1, len(chosen) - 2)
    part = rows(run, chosen)
    if log == "no accelerations":
        part = replace(part, udot=None)
    truth = dc.balance(mechanism, rows(run, chosen), work="in-loop")
    ledger = dc.balance(mechanism, part, work="samples", testing=tuple(truth.delta_c))
    assert ledger.basis["u̇"] == ("derived" if log == "no accelerations" else "measured")
    for name, exact in truth.delta_c.items():
        error = np.abs(ledger.delta_c[name] - exact)
        bar = ledger.error_bar[name]
        assert (error <= bar + truth.error_bar[name]).all(), error.max() / bar.max()
        assert bar.max() < max(1000 * error.max(), 1e-11 * ledger.energy_exchanged)
