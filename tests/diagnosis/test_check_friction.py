"""Friction and contact act at slow slip and small overlap: states are drawn there, or it is said."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac import shapes

Rhs = Callable[[Any, Any, Any], Any]


def block(**law: Any) -> dc.Mechanism:
    """2 kg on a spring of 10 N/m, with friction of 3 N."""
    return dc.Mechanism(
        [dc.point_mass("b", 2.0)],
        [dc.prismatic("x", "ground", "b", axis="x", stiffness=10.0)],
        forces=[dc.forces.joint_friction("f", "x", 3.0, **law)],
    )


def kind(mechanism: dc.Mechanism, rhs: Rhs, **options: Any) -> str:
    return dc.check_equations(mechanism, rhs, **options).verdict.kind


@pytest.mark.parametrize("width", [1e-6, 1e-3, 0.3])
def test_the_width_of_friction_is_tested(width: float) -> None:
    mechanism = block(width=width)

    def right(w: float) -> Rhs:
        return lambda t, q, u: -1.5 * np.tanh(u / w) - 5.0 * q

    assert kind(mechanism, right(width)) == "consistent"
    for wrong in (0.1 * width, 1.01 * width, 2.0 * width):
        assert kind(mechanism, right(wrong)) == "equation-error", wrong
    found = dc.check_equations(mechanism, lambda t, q, u: -1.5 * np.sign(u) - 5.0 * q)
    assert found.verdict.kind == "equation-error"
    (blame,) = found.blame
    assert blame.depends_on == ("u.x",)
    assert found.example is not None and 0.0 < abs(found.example.state["u.x"]) < 10.0 * width


def test_the_stribeck_speed_is_tested() -> None:
    mechanism = block(static=6.0, stribeck=1e-4, width=1e-6)

    def rhs(speed: float, excess: float = 1.0) -> Rhs:
        return lambda t, q, u: (
            -1.5 * (1.0 + excess * np.exp(-((u / speed) ** 2))) * np.tanh(u / 1e-6) - 5.0 * q
        )

    assert kind(mechanism, rhs(1e-4)) == "consistent"
    assert kind(mechanism, rhs(2e-4)) == "equation-error"
    assert kind(mechanism, rhs(1e-4, 0.0)) == "equation-error"


@pytest.mark.long
@pytest.mark.parametrize("width", [1e-3, 1e-6])
def test_slip_that_is_a_difference_of_speeds(width: float) -> None:
    """A bead on a cart; own speeds are both absolute, so slip is their difference."""
    mechanism = dc.Mechanism(
        [dc.point_mass("cart", 4.0), dc.point_mass("bead", 1.0)],
        [
            dc.prismatic("x", "ground", "cart", axis="x"),
            dc.prismatic("s", "cart", "bead", axis="x"),
        ],
        forces=[
            dc.forces.point_friction(
                "rub", "bead", 10.0, dc.forces.friction_law(0.2, width=width), on="cart", normal="z"
            )
        ],
    )
    absolute = dc.CoordinateMap(("a", "b"), q={"x": "q.a", "s": "q.b - q.a"})

    def rhs(w: float) -> Rhs:
        def f(t: Any, q: Any, u: Any) -> Any:
            force = 2.0 * np.tanh((u[1] - u[0]) / w)
            return np.array([force / 4.0, -force])

        return f

    assert kind(mechanism, rhs(width), coordinates=absolute) == "consistent"
    for wrong in (0.5, 2.0):
        assert kind(mechanism, rhs(wrong * width), coordinates=absolute) == "equation-error"


def ball(radius: float = 0.01, width: float = 1e-3) -> dc.Mechanism:
    """A small ball that slides on a floor far below, which it meets in no random state."""
    return dc.Mechanism(
        [dc.point_mass("carriage", 0.5), dc.point_mass("ball", 1.0)],
        [dc.prismatic("x", "ground", "carriage", "x"), dc.prismatic("z", "carriage", "ball", "z")],
        gravity=(0.0, 0.0, -9.81),
        forces=[
            dc.forces.contact(
                "floor",
                shapes.sphere("ball", radius),
                shapes.half_space("ground", normal="z", position=(0.0, 0.0, -20.0)),
                1e4,
                dissipation=0.3,
                friction=dc.forces.friction_law(0.5, width=width),
            )
        ],
    )


def falling(stiffness: float = 1e4, d: float = 0.3, width: float = 1e-3) -> Rhs:
    def f(t: Any, q: Any, u: Any) -> Any:
        overlap = np.maximum(0.01 - 20.0 - q[1], 0.0)
        normal = stiffness * overlap * np.maximum(1.0 - d * u[1], 0.0)
        return np.array([-0.5 * normal * np.tanh(u[0] / width) / 1.5, normal - 9.81])

    return f


def test_contact_that_no_random_state_meets_is_tested() -> None:
    assert dc.random_states(ball()).q.min() > -2.0
    right = dc.check_equations(ball(), falling())
    assert right.verdict.kind == "consistent", right.explain()
    assert not any("floor" in words for words in right.verdict.limits)
    for wrong in (falling(stiffness=0.0), falling(d=0.2), falling(width=2e-3), falling(width=1e-4)):
        assert kind(ball(), wrong) == "equation-error"


def test_what_is_not_sampled_is_named() -> None:
    states = dc.random_states(ball())
    found = dc.check_equations(ball(), falling(), states=states)
    assert found.verdict.kind == "consistent"
    limits = " ".join(found.verdict.limits)
    assert "contact 'floor', whose shapes overlap at none of the states" in limits
    assert "friction of contact 'floor' at slips about its width of 0.001" in limits
    mechanism = block(width=1e-3)
    fast = dc.check_equations(
        mechanism, lambda t, q, u: -1.5 * np.sign(u) - 5.0 * q, states=dc.random_states(mechanism)
    )
    assert "friction 'f' at slips about its width of 0.001" in " ".join(fast.verdict.limits)
    assert "friction 'f'" in " ".join(fast.explain().split())


def test_events_are_named_as_not_seen() -> None:
    mechanism = dc.Mechanism(
        [dc.point_mass("b", 1.0)],
        [dc.prismatic("x", "ground", "b", axis="x")],
        events=[dc.events.joint_stop("buffer", "x", upper=1.0, restitution=0.5)],
    )
    found = dc.check_equations(mechanism, lambda t, q, u: 0.0 * q)
    assert found.verdict.limits[-1] == "what happens at events (buffer)"


def test_single_precision_is_not_accused_of_slow_slip() -> None:
    def rhs(t: Any, q: Any, u: Any) -> Any:
        q, u = np.float32(q), np.float32(u)
        return (np.float32(-1.5) * np.tanh(u / np.float32(1e-3)) - np.float32(5) * q).astype(float)

    assert kind(block(width=1e-3), rhs) != "equation-error"
