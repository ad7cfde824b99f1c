"""Constructors called in a wrong way: the message names the argument, and what is close to it."""

from __future__ import annotations

import inspect
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import deltac as dc

ARM = dc.rod("arm", 1.0, 1.0)
HINGE = dc.revolute("hinge", "ground", "arm")
OPTIONS = "position rotation child_position child_rotation stiffness rest damping armature motion"


def arm(**parts: Any) -> dc.Mechanism:
    return dc.Mechanism([ARM], [HINGE], **parts)


@pytest.mark.parametrize("kind", [n for n in dc.joints.__all__ if n != "Joint"])
def test_every_joint_shows_its_options(kind: str) -> None:
    offered = inspect.signature(getattr(dc.joints, kind)).parameters
    assert set(OPTIONS.split()) <= offered.keys()
    assert not any(p.kind in (p.VAR_KEYWORD, p.VAR_POSITIONAL) for p in offered.values())
    assert ("pitch" in offered) is (kind == "screw")


WRONG: list[tuple[Callable[[], Any], str]] = [
    (
        lambda: dc.revolute("j", "ground", "a", postion=0),  # type: ignore[call-arg]
        "revolute: unknown argument 'postion'; did you mean 'position'",
    ),
    (lambda: dc.revolute("j", "ground", "a", pitch=1), "unknown argument 'pitch'"),  # type: ignore[call-arg]
    (
        lambda: dc.forces.joint_damper("d", "j", dampin=1),  # type: ignore[call-arg]
        "joint_damper: unknown argument 'dampin'; did you mean 'damping'",
    ),
    (lambda: arm(force=[]), "Mechanism: unknown argument 'force'; did you mean 'forces'"),
    (
        lambda: dc.revolute("j"),  # type: ignore[call-arg]
        r"missing a required argument: 'parent'; write revolute\(name, parent",
    ),
    (lambda: dc.rod("a", 1, 1, "x", (0, 0, 0), 5), "rod: too many positional arguments"),  # type: ignore[call-arg]
    (
        lambda: dc.revolute("j", "ground", ARM),  # type: ignore[arg-type]
        "joint 'j': .* expected the name of a body; write 'arm'",
    ),  # type: ignore[arg-type]
    (
        lambda: arm(forces=[dc.forces.spring_damper("s", ARM, "ground")]),  # type: ignore[arg-type]
        "spring-damper 's': .*write 'arm'",
    ),  # type: ignore[arg-type]
    (
        lambda: arm(forces=[dc.forces.joint_damper("d", HINGE, 1)]),  # type: ignore[arg-type]
        "joint damper 'd': .*write 'hinge'",
    ),  # type: ignore[arg-type]
    (
        lambda: arm(events=[dc.events.joint_stop("s", HINGE, upper=1)]),  # type: ignore[arg-type]
        "joint stop 's': .*write 'hinge'",
    ),  # type: ignore[arg-type]
    (
        lambda: arm(forces=[HINGE]),
        r"forces of the mechanism: found joint 'hinge', expected what deltac",
    ),
    (
        lambda: dc.Mechanism(ARM, [HINGE]),  # type: ignore[arg-type]
        "bodies of the mechanism: found body 'arm', expected a sequence",
    ),  # type: ignore[arg-type]
    (lambda: arm(parameters=[1.0]), r"parameters: found \[1.0\], expected values by name"),
    (lambda: dc.forces.joint_torque("m", "j", f"{np.float64(2.9)!r}*t"), r"write float\(x\)"),
]


@pytest.mark.parametrize(("make", "said"), WRONG)
def test_a_wrong_call_says_what_is_meant(make: Callable[[], Any], said: str) -> None:
    with pytest.raises(dc.InputError, match=said):
        make()


@pytest.mark.parametrize("angle", [60, 90.0, -45, 180, 3600])
def test_degrees_are_suspected(angle: float) -> None:
    with pytest.warns(dc.SuspicionWarning, match=r"math\.radians") as told:
        state = arm().state({"hinge": angle})
    assert told[0].filename == __file__ and state.q[0] == angle


@pytest.mark.parametrize("angle", [5, -5, 6.2, 61.3, 20 * np.pi])
def test_radians_are_not(angle: float) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert arm().state({"hinge": angle}, speeds={"hinge": 90.0}).q[0] == angle
        slide = dc.Mechanism([ARM], [dc.prismatic("x", "ground", "arm")])
        assert slide.state({"x": 60}).q[0] == 60
