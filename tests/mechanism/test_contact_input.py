"""Friction and contact that make no sense are refused, with the part, the value and the remedy."""

from __future__ import annotations

from typing import Any

import pytest

from deltac import InputError, Mechanism, free, point_mass, prismatic, revolute, shapes
from deltac.bodies import sphere
from deltac.forces import (
    contact,
    friction_law,
    joint_damper,
    joint_friction,
    point_friction,
    spring_damper,
)
from deltac.joints import fixed, spherical

BALL, FLOOR = shapes.sphere("ball", 0.1), shapes.half_space()


def machine(*forces: Any, **parameters: float) -> Mechanism:
    return Mechanism(
        [sphere("ball", 1.0, 0.1), sphere("top", 1.0, 0.1), sphere("hung", 1.0, 0.1)],
        [free("base", "ball"), spherical("spin", "ball", "top"), revolute("j", "top", "hung", "z")],
        forces,
        parameters=parameters,
    )


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: contact("c", BALL, FLOOR, -1.0), r"stiffness of contact 'c': found -1, expected"),
        (
            lambda: contact("c", BALL, FLOOR, 1.0, model="magic"),  # type: ignore[arg-type]
            r"model of contact 'c': found 'magic'",
        ),
        (lambda: contact("c", BALL, "floor", 1.0), r"contact 'c': expected a shape such as"),  # type: ignore[arg-type]
        (lambda: contact("c", BALL, shapes.point("ball"), 1.0), r"both shapes belong to 'ball'"),
        (lambda: contact(" c", BALL, FLOOR, 1.0), r"needs a name without surrounding blanks"),
        (lambda: contact("c", BALL, FLOOR, 1.0, deepest=-1), r"deepest of contact 'c': found -1"),
        (lambda: friction_law(0.2, static=0.3), r"give both static and stribeck, or neither"),
        (lambda: friction_law(0.2, width=0.0), r"width of friction law: found 0, expected a pos"),
        (lambda: friction_law(0.2, static=1, stribeck=-1), r"stribeck of friction law: found -1"),
        (lambda: joint_friction("f", "j", [1, 2], viscous=[1, 2, 3]), r"expected 3 values, found"),
        (
            lambda: point_friction("f", "ball", 1, 0.2, on="ball"),
            r"connects body 'ball' with itself",
        ),
        (lambda: point_friction("f", "ball", 1, 0.2, normal=(0, 0, 0)), r"no direction"),
    ],
)
def test_parts_that_cannot_be(make: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()


@pytest.mark.parametrize(
    ("element", "message"),
    [
        (joint_friction("f", "elbow", 1.0), r"joint friction 'f': unknown joint 'elbow'"),
        (joint_friction("f", "spin", 1.0), r"laws of joint friction 'f': expected 3 values"),
        (
            joint_friction("f", "j", "q.jj"),
            r"friction of joint friction 'f': unknown symbol 'q.jj'",
        ),
        (joint_friction("f", "j", 1.0, width="t"), r"width of joint friction 'f': unknown symbol"),
        (joint_friction("f", "j", -0.1), r"'f' is -0.1: below zero it would create energy.*allow"),
        (joint_friction("f", "j", 0.1, viscous=-2), r"'f' is -2: below zero it would create"),
        (joint_friction("f", "j", "-2*k"), r"'f' is -6: below zero it would create energy"),
        (joint_friction("f", "j", 1.0, static=0.5, stribeck=1), r"static 0.5 is below coulomb 1"),
        (joint_damper("d", "j", -0.3), r"damping of joint damper 'd' is -0.3: below zero"),
        (point_friction("f", "bal", 1.0, 0.2), r"unknown body 'bal'.*did you mean 'ball'"),
        (point_friction("f", "ball", "N", 0.2), r"normal force of point friction 'f': unknown"),
        (contact("c", shapes.sphere("bowl", 1), FLOOR, 1.0), r"unknown body 'bowl'"),
        (contact("c", BALL, FLOOR, "K"), r"contact 'c': unknown symbol 'K'"),
        (contact("c", BALL, FLOOR, "-k"), r"stiffness of contact 'c': found -3"),
        (contact("c", BALL, FLOOR, 1.0, exponent=0.5), r"exponent of contact 'c': found 0.5"),
        (
            contact("c", BALL, FLOOR, 1.0, dissipation=-1),
            r"dissipation of contact 'c' is -1: below",
        ),
        (contact("c", BALL, FLOOR, 1.0, friction=-0.2), r"friction of contact 'c' is -0.2: below"),
        (contact("c", BALL, FLOOR, 1.0, friction="t"), r"friction of contact 'c': unknown symbol"),
    ],
)
def test_parts_that_do_not_fit_the_mechanism(element: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        machine(element, k=3.0)


@pytest.mark.parametrize(
    "element",
    [
        joint_friction("f", "j", -0.1, allow_energy_source=True),
        joint_friction("f", "j", "sin(t)"),  # its sign is not known beforehand
        joint_damper("d", "j", -0.3, allow_energy_source=True),
        contact("c", BALL, FLOOR, 1.0, dissipation=-1, friction=-1, allow_energy_source=True),
        point_friction("f", "ball", 1.0, -0.2, allow_energy_source=True),
    ],
)
def test_sources_of_energy_that_are_meant(element: Any) -> None:
    assert machine(element).elements


def test_dampers_of_joints_are_no_sources_either() -> None:
    with pytest.raises(InputError, match=r"damping of joint damper 'x' is -1: below zero"):
        Mechanism([point_mass("m", 1.0)], [prismatic("x", "ground", "m", "x", damping=-1.0)])


def test_names_of_channels_are_told_apart() -> None:
    spring = spring_damper("c", "ball", "hung", stiffness=1.0)
    with pytest.raises(InputError, match="both use the channel 'spring c'"):
        machine(contact("c", BALL, FLOOR, 1.0), spring)
    with pytest.raises(InputError, match="both use the channel 'friction c'"):
        machine(contact("c", BALL, FLOOR, 1.0), joint_friction("c", "j", 1.0))


def test_a_fixed_joint_does_not_rub() -> None:
    with pytest.raises(InputError, match=r"joint 'glued' is fixed"):
        Mechanism(
            [sphere("a", 1, 0.1), sphere("b", 1, 0.1)],
            [free("f", "a"), fixed("glued", "a", "b")],
            [joint_friction("rub", "glued", 1.0)],
        )


def test_sizes_by_parameters_are_checked_with_their_values() -> None:
    ball = contact("c", shapes.sphere("ball", "r"), FLOOR, 1.0)
    assert machine(ball, r=0.2).with_parameters(r=0.3)
    with pytest.raises(
        InputError, match=r"radius of the sphere shape of 'ball' in contact 'c': found -0"
    ):
        machine(ball, r=-0.2)
