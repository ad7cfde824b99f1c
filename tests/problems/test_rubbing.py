"""Problems with friction and contact in their limits: ideal friction, the stated error, other parameters."""

from __future__ import annotations

import math

import numpy as np
import pytest

from deltac import balance, problems, simulate, simulate_ensemble
from deltac.problems.problem import period
from deltac.references import solved


@pytest.mark.slow
def test_stick_slip_tends_to_two_level_friction() -> None:
    """Period 2 D/V + (2/ω)(π − arctan(D ω/V)), D = (μ_s − μ_k) m g/k, as Stribeck speed and width vanish."""
    D, V, omega = 0.1 * 9.81 / 100.0, 0.1, 10.0
    ideal = 2 * D / V + 2 / omega * (math.pi - math.atan(D * omega / V))
    off = []
    for stribeck, width, step in ((5e-3, 2e-4, 5e-5), (1.25e-3, 4e-5, 1e-5), (3e-4, 1e-5, 2e-6)):
        p = problems.load("stick-slip", stribeck=stribeck, width=width)
        run = simulate(p.mechanism, p.state, 2.0, step, "ode5", record=())
        off.append(abs(period("x")(run) - ideal))
    assert off[0] > 1.5 * off[1] > 1.5**2 * off[2]
    assert off[2] <= 0.01 * ideal


def test_missing_heat_goes_with_the_width() -> None:
    """Heat falls short of μ m g cos α s by at most 0.2785 w μ m g cos α t, and in proportion to w."""
    missing = []
    for width in (1e-2, 5e-3, 2.5e-3):
        p = problems.load("block-on-incline", width=width)
        heat = next(r for r in p.reference if r.quantity.startswith("heat missing"))
        missing.append(heat.measure(solved(p)))
        assert 0.0 < missing[-1] <= heat.value + heat.accuracy
    # Creep begins a little after the width is reached: proportional up to its share of the run.
    assert missing[0] / missing[1] == pytest.approx(2.0, rel=0.02)
    assert missing[1] / missing[2] == pytest.approx(2.0, rel=0.02)


def test_parameters_of_a_contact_may_vary() -> None:
    """A compiled run with another stiffness is the run of a mechanism with that stiffness."""
    p = problems.load("ball-on-compliant-floor")
    softer = p.mechanism.with_parameters(k=800.0)
    run = simulate(softer.varying("k"), p.state, 1.0, 1e-3, "ode5")
    plain = simulate(softer, p.state, 1.0, 1e-3, "ode5")
    np.testing.assert_allclose(run.q, plain.q, rtol=0, atol=1e-11)
    members = simulate_ensemble(
        p.mechanism, p.state, 1.0, 1e-3, "ode5", vary={"k": [800.0, 2000.0]}, record=100
    )
    np.testing.assert_allclose(members.q[:, 0], plain.q[::100], rtol=0, atol=1e-11)
    assert abs(members.q[-1, 0, 0] - members.q[-1, 1, 0]) > 1e-3


def test_the_belt_pays_for_the_heat() -> None:
    """Over a whole period the oscillator keeps its energy: what the belt's drive gives becomes heat."""
    p = problems.load("stick-slip")
    run = solved(p)
    ledger = balance(p.mechanism, run)
    span = period("x")(run)
    first = int(np.flatnonzero((run.coordinate("x")[:-1] < 0) & (run.coordinate("x")[1:] >= 0))[0])
    last = int(np.argmin(np.abs(run.t - run.t[first] - span)))
    given = np.ptp(ledger.work["prescribed belt"][[first, last]])
    heat = np.ptp(ledger.work["friction rub"][[first, last]])
    # A period is not a whole number of steps: what is missing of it is less than a step's power.
    assert given == pytest.approx(heat, abs=2 * p.step * 0.4 * 9.81 * 0.3)
    assert heat > 0.1
