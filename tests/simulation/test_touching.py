"""Pairs that touch without closing or parting: no impact, and no hindrance to what goes on."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
import pytest

import deltac as dc
from deltac import shapes

RADIUS = 0.1


def row(count: int, restitution: float, gravity: float = 0.0) -> dc.Mechanism:
    """Equal spheres on one line; neighbours collide."""
    names = "abcd"[:count]
    return dc.Mechanism(
        [dc.bodies.sphere(name, 1.0, RADIUS) for name in names],
        [dc.prismatic(name, "ground", name, axis="x") for name in names],
        gravity=(gravity, 0.0, 0.0),
        events=[
            dc.events.impact(
                one + other,
                shapes.sphere(one, RADIUS),
                shapes.sphere(other, RADIUS),
                restitution=restitution,
            )
            for one, other in zip(names, names[1:])
        ],
    )


def ran(
    mechanism: dc.Mechanism, q: Sequence[float], u: Sequence[float], solver: str = "ode4"
) -> dc.Trajectory:
    """A run of 2 s that comes to its end without a word."""
    names = mechanism.coordinates.names
    state = mechanism.state(dict(zip(names, q)), dict(zip(names, u)))
    with warnings.catch_warnings():
        warnings.simplefilter("error", dc.SimulationStoppedWarning)
        return dc.simulate(mechanism, state, 2.0, 0.01, solver)


@pytest.mark.parametrize("solver", ["ode4", "DOP853"])
@pytest.mark.parametrize("gravity", [0.0, -9.81])
def test_a_plastic_collision_goes_on_with_the_common_velocity(solver: str, gravity: float) -> None:
    """Momentum: v = 1/2 of what one had; lost: a quarter of m v² by m/4 v². Gravity moves both alike."""
    pair = row(2, 0.0, gravity)
    run = ran(pair, (-1.0, 0.0), (1.0, 0.0), solver)
    (hit,) = run.events
    assert hit.names == ("impact ab",)
    assert hit.t == pytest.approx(0.8, abs=1e-12)
    assert hit.energy_lost == pytest.approx(0.25, abs=1e-12)
    np.testing.assert_allclose(run.u[-1], 0.5 + 2.0 * gravity, rtol=1e-13)
    np.testing.assert_allclose(run.q[-1, 1] - run.q[-1, 0], 2 * RADIUS, atol=1e-12)
    assert np.abs(dc.balance(pair, run).delta_c["wang"]).max() < 1e-11


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("gravity", [0.0, -9.81])
def test_touching_spheres_that_move_alike_are_no_event(restitution: float, gravity: float) -> None:
    run = ran(row(2, restitution, gravity), (0.0, 2 * RADIUS), (0.7, 0.7))
    assert run.events == ()
    np.testing.assert_allclose(run.u[-1], 0.7 + 2 * gravity, rtol=1e-12)


def test_a_cradle_at_rest_takes_the_blow_as_one() -> None:
    """Moreau's law: Newton's restitution in all pairs at once, b c d stay together, one event."""
    run = ran(row(4, 1.0), (-1.0, 0.0, 0.2, 0.4), (1.0, 0.0, 0.0, 0.0))
    (hit,) = run.events
    assert "impact ab" in hit.names and hit.t == pytest.approx(0.8, abs=1e-12)
    np.testing.assert_allclose(run.u[-1], (-0.5, 0.5, 0.5, 0.5), atol=1e-12)


def test_a_pair_that_rested_is_hit_again_when_it_has_parted() -> None:
    """Two stuck together meet a third at rest, with e = 0: all of them go on at a third."""
    run = ran(row(3, 0.0), (-0.4, 0.0, 0.45), (1.0, 0.0, 0.0))
    assert [event.names for event in run.events] == [("impact ab",), ("impact ab", "impact bc")]
    np.testing.assert_allclose(run.u[-1], 1.0 / 3.0, rtol=1e-13)


def test_a_pair_pressed_together_later_is_in_lasting_contact() -> None:
    """A force that sets in at 1 s presses one sphere on the other."""
    pair = row(2, 0.0)
    pushed = dc.Mechanism(
        pair.bodies,
        pair.joints,
        forces=[dc.forces.joint_torque("push", "a", "max(t - 1, 0)")],
        events=pair.events,
    )
    with pytest.warns(dc.SimulationStoppedWarning, match="'impact ab' is in lasting contact"):
        run = dc.simulate(pushed, pushed.state({"b": 2 * RADIUS}), 2.0, 0.01, "ode4")
    assert run.t[-1] == pytest.approx(1.0, abs=2e-3)  # 1e-10 m are overlapped after (6e-10)^(1/3) s
