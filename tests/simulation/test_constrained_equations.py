"""Equations written by hand for constrained mechanisms, and residuals of constrained runs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.energy import balance, residuals
from deltac.errors import InputError
from tests.systems import four_bar
from tests.systems.linkages import ALL, disc, four_bars, worst


def by_hand(sign: float) -> dc.Equations:
    """A four-bar's pendulum equation in the three joint angles; `sign` −1 gets the coupler wrong."""
    factor = 2 * 9.81 / (5 / 3)

    def rhs(t: Any, q: Any, u: Any) -> Any:
        swing = -factor * np.cos(q[0])
        return np.array([swing, swing, -sign * swing])

    return dc.Equations(rhs)


def test_equations_by_hand_for_a_loop() -> None:
    """In the joints' own coordinates: right ones close and keep the loop, wrong ones do neither."""
    mechanism, state = four_bars(1)
    right = balance(
        mechanism,
        dc.simulate(
            mechanism, state, 0.6, 0.002, "ode5", ALL, equations=by_hand(1), constraints=None
        ),
    )
    wrong = balance(
        mechanism,
        dc.simulate(
            mechanism, state, 0.6, 0.002, "ode5", ALL, equations=by_hand(-1), constraints=None
        ),
    )
    for function in ALL:
        assert np.abs(right.delta_c[function]).max() < 1e-11
        assert np.abs(wrong.delta_c[function]).max() > 0.1
    assert worst(right, "position") < 1e-12 and worst(wrong, "position") > 0.1


def test_equations_in_fewer_coordinates() -> None:
    """One angle satisfies the loop by itself: the run is that of the model with multipliers."""
    mechanism, state = four_bars(1)
    laws = {"foot0": "q.theta", "foot1": "q.theta", "tip0": "-q.theta"}
    minimal = dc.CoordinateMap(("theta",), q=laws, inverse={"theta": "q.foot0"})
    equations = dc.Equations(lambda t, q, u: -11.772 * np.cos(q), coordinates=minimal)
    run = dc.simulate(mechanism, state, 0.4, 0.001, "ode5", ALL, equations=equations)
    own = dc.simulate(mechanism, state, 0.4, 0.001, "ode5", ALL)
    assert np.abs(run.q - own.q).max() < 1e-10
    for function in ALL:
        assert np.abs(balance(mechanism, run).delta_c[function]).max() < 1e-10


def test_equations_in_fewer_coordinates_need_their_inverse() -> None:
    mechanism, state = four_bars(1)
    laws = {"foot0": "q.theta", "foot1": "q.theta", "tip0": "-q.theta"}
    unknown = dc.Equations(lambda t, q, u: -q, dc.CoordinateMap(("theta",), q=laws))
    with pytest.raises(InputError, match="give inverse="):
        dc.simulate(mechanism, state, 0.1, 0.01, "ode4", equations=unknown)
    free = dc.problems.load("triple-pendulum")
    few = dc.CoordinateMap(("a",), q={"joint1": "q.a", "joint2": "q.a", "joint3": "q.a"})
    with pytest.raises(InputError, match="1 coordinates for 3 speeds"):
        dc.simulate(free.mechanism, free.state, 0.1, 0.01, equations=dc.Equations(abs, few))


def test_residuals_of_a_run_are_at_rounding() -> None:
    mechanism, state = disc()
    run = dc.simulate(mechanism, state, 0.2, 0.01, "ode4", ())
    found = residuals(mechanism, run)
    for name in (*ALL, "coordinates"):
        assert np.abs(found[name]).max() < 1e-11


@pytest.mark.parametrize("compiled", [None, False])
def test_parameters_of_a_coordinate_map_vary(compiled: bool | None) -> None:
    """θ̈ = −s, s = θ − offset: compiled code that is kept for all offsets takes the one of the run."""
    mechanism, start = replace(four_bar.mechanism(), parameters={"offset": 0.0}), four_bar.start()
    equations = dc.Equations(
        lambda t, q, u: np.array([-q[0]]),
        dc.CoordinateMap(("s",), q={"crank": "q.s + offset"}),
        compiled=compiled,
    )
    for offset in (0.0, 1.0):
        model = mechanism.with_parameters(offset=offset).varying("offset")
        run = dc.simulate(model, start, 0.1, 0.01, "ode8", equations=equations)
        away, rate = start.q[0] - offset, start.u[0]
        expected = offset + away * np.cos(run.t) + rate * np.sin(run.t)
        np.testing.assert_allclose(run.q[:, 0], expected, atol=1e-12)
