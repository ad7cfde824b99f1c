"""Declarations of events: what is accepted, and what is refused with which words."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

import deltac as dc
from deltac import shapes


def mechanism(*events: Any, **parameters: float) -> dc.Mechanism:
    return dc.Mechanism(
        bodies=[dc.bodies.sphere("ball", 1.0, 0.1), dc.bodies.sphere("other", 1.0, 0.1)],
        joints=[dc.free("base", "ball"), dc.joints.planar("plane", "ground", "other")],
        events=events,
        parameters=parameters,
    )


def test_events_belong_to_the_description() -> None:
    stop = dc.events.joint_stop(
        "wall", "plane.x", lower="low", upper="0.5 + 0.1*sin(t)", restitution="e"
    )
    made = mechanism(stop, dc.events.event("start", "t - low"), low=-1.0, e=0.5)
    assert [event.name for event in made.events] == ["wall", "start"]
    assert made.hash != mechanism(low=-1.0, e=0.5).hash
    assert made.hash != made.with_parameters(e=0.6).hash


def test_an_impact_and_an_event_may_share_a_name() -> None:
    hit = dc.events.impact("floor", shapes.sphere("ball", 0.1), shapes.half_space())
    assert len(mechanism(hit, dc.events.event("floor", "q.base.z")).events) == 2


REFUSED: list[tuple[Callable[[], Any], str]] = [
    (
        lambda: dc.events.joint_stop("s", "plane.x"),
        "joint stop 's' has no limit; give lower=, upper=",
    ),
    (lambda: dc.events.joint_stop("s", "plane.x", lower=1, upper=1), "lower is 1, upper 1"),
    (
        lambda: dc.events.joint_stop("s", "plane.x", upper=1, restitution=-0.1),
        "is -0.1; expected a number",
    ),
    (lambda: dc.events.joint_stop("s", "plane.x", upper=1, restitution=1.01), "creates energy"),
    (lambda: dc.events.joint_stop(" s", "plane.x", upper=1), "a name without surrounding blanks"),
    (
        lambda: mechanism(dc.events.joint_stop("s", "plane", upper=1)),
        "has the coordinates 'plane.x', 'plane",
    ),
    (lambda: mechanism(dc.events.joint_stop("s", "plan.x", upper=1)), "did you mean 'plane.x'"),
    (lambda: mechanism(dc.events.joint_stop("s", "base.x", upper=1)), "which has a quaternion"),
    (lambda: mechanism(dc.events.joint_stop("s", "plane.x", upper="q.plane.y")), "unknown symbol"),
    (
        lambda: mechanism(dc.events.joint_stop("s", "plane.x", upper=1, restitution="e")),
        "unknown symbol 'e'",
    ),
    (
        lambda: dc.events.impact("i", shapes.sphere("ball", 0.1), shapes.sphere("ball", 0.2)),
        "both shapes belong to 'ball'",
    ),
    (
        lambda: dc.events.impact(
            "i", shapes.sphere("ball", 0.1), shapes.half_space(), friction=-0.1
        ),
        "friction of impact 'i'",
    ),
    (
        lambda: mechanism(dc.events.impact("i", shapes.sphere("bal", 0.1), shapes.half_space())),
        "did you mean 'ball'",
    ),
    (lambda: dc.events.event("e", "t", direction="up"), "expected 'both' or 'rising' or"),  # type: ignore[arg-type]
    (lambda: dc.events.event("e", 3.0), "is the number 3, which never crosses zero"),
    (lambda: mechanism(dc.events.event("e", "q.plane.z")), "did you mean"),
    (lambda: mechanism("bang"), r"expected what deltac.events.joint_stop\(...\)"),
    (
        lambda: mechanism(dc.events.event("e", "t"), dc.events.event("e", "t")),
        "two events are called 'e'",
    ),
    (
        lambda: mechanism(*[dc.events.joint_stop("s", "plane.x", upper=1)] * 2),
        "both use the channel 'impact s'",
    ),
]


@pytest.mark.parametrize(("make", "words"), REFUSED)
def test_what_cannot_be_says_so(make: Callable[[], Any], words: str) -> None:
    with pytest.raises(dc.InputError, match=words):
        make()


def test_a_driven_joint_cannot_be_stopped() -> None:
    with pytest.raises(dc.InputError, match="follows its motion and cannot be stopped"):
        dc.Mechanism(
            bodies=[dc.point_mass("a", 1.0)],
            joints=[dc.prismatic("x", "ground", "a", motion="sin(t)")],
            events=[dc.events.joint_stop("s", "x", upper=1.0)],
        )
