"""Descriptions that make no mechanism: every message names the part, the mistake and the remedy."""

from __future__ import annotations

from typing import Any

import pytest

from deltac.errors import InputError
from deltac.mechanism.bodies import body, box, frame
from deltac.mechanism.channels import ChannelName
from deltac.mechanism.forces import (
    joint_damper,
    joint_spring,
    joint_torque,
    point_force,
    spring_damper,
)
from deltac.mechanism.joints import revolute, spherical, universal
from deltac.mechanism.mechanism import Mechanism

A, B = box("upper", 1, [1, 1, 1]), box("lower", 1, [1, 1, 1])
SHOULDER = revolute("shoulder", "ground", "upper")
ELBOW = spherical("elbow", "upper", "lower")
NAN = float("nan")


def refused(words: list[str], **changes: Any) -> None:
    parts: dict[str, Any] = {"bodies": [A, B], "joints": [SHOULDER, ELBOW], **changes}
    with pytest.raises(InputError) as caught:
        Mechanism(**parts)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("joints", "words"),
    [
        ([SHOULDER, revolute("e", "uper", "lower")], ["'e'", "'uper'", "did you mean 'upper'"]),
        ([revolute("s", "gruond", "upper"), ELBOW], ["'s'", "'gruond'", "did you mean 'ground'"]),
        (
            [revolute("s", "lower", "upper"), ELBOW],
            ["'s' (lower → upper)", "'elbow' (upper → lower)", "cycle", "tree"],
        ),
        (
            [SHOULDER, ELBOW, revolute("f", "ground", "lower")],
            ["'lower'", "'elbow' and 'f'", "constraint"],
        ),
        ([SHOULDER], ["'lower'", "no joint", "free"]),
        ([SHOULDER, spherical("shoulder", "upper", "lower")], ["two joints", "'shoulder'"]),
        (
            [universal("s", "ground", "upper"), revolute("s.first", "upper", "lower")],
            ["'s' and 's.first'", "rename"],
        ),
        (["shoulder"], ["joints", "'shoulder'", "revolute"]),
        ([revolute("s", "ground", "upper", motion="q.e"), ELBOW], ["motion", "'s'", "'q.e'"]),
        ([revolute("s", "ground", "upper", motion="A*t"), ELBOW], ["motion", "'s'", "'A'"]),
    ],
)
def test_joints_that_make_no_tree(joints: list[Any], words: list[str]) -> None:
    refused(words, joints=joints)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"bodies": [A, A]}, ["two bodies", "'upper'"]),
        ({"bodies": [A, "lower"]}, ["bodies", "'lower'", "deltac.body"]),
        ({"bodies": [A, frame("lower")]}, ["'elbow'", "'lower'", "massless", "armature"]),
        (
            {"bodies": [box("upper", "m", [1, 1, 1]), B], "parameters": {"m": -1}},
            ["mass of body 'upper'", "-1", "positive"],
        ),
        (
            {"bodies": [body("upper", 1, ["p", 1, 1]), B], "parameters": {"p": 3}},  # type: ignore[arg-type]
            ["'upper'", "triangle"],
        ),
        (
            {"bodies": [box("upper", "mas", [1, 1, 1]), B], "parameters": {"mass": 1}},
            ["body 'upper'", "'mas'", "did you mean 'mass'"],
        ),
        ({"parameters": {"t": 1}}, ["parameter 't'", "other than"]),
        ({"parameters": {"a b": 1}}, ["parameter 'a b'"]),
        ({"parameters": {3: 1.0}}, ["parameter 3"]),
        ({"parameters": {"k": NAN}}, ["parameter 'k'", "nan", "finite"]),
        ({"parameters": {"k": "stiff"}}, ["parameter 'k'", "'stiff'", "finite number"]),
        ({"gravity": [0, 0]}, ["gravity", "three", "[0, 0]"]),
        ({"gravity": 9.81}, ["gravity", "three", "9.81"]),
        ({"gravity": [0, 0, NAN]}, ["gravity", "component z", "nan"]),
        ({"gravity": [0, 0, "-g"]}, ["gravity", "'g'"]),
        ({"name": 3}, ["name of the mechanism", "3"]),
    ],
)
def test_parts_that_do_not_fit(changes: dict[str, Any], words: list[str]) -> None:
    refused(words, **changes)


@pytest.mark.parametrize(
    ("force", "words"),
    [
        (joint_damper("d", "elbwo", 1), ["joint damper 'd'", "'elbwo'", "did you mean 'elbow'"]),
        (point_force("f", "loewr", [1, 0, 0]), ["point force 'f'", "did you mean 'lower'"]),
        (point_force("f", "ground", [1, 0, 0]), ["point force 'f'", "'ground'"]),
        (spring_damper("s", "upper", "hand"), ["spring-damper 's'", "'hand'"]),
        (
            joint_torque("m", "shoulder", "q.sholder"),
            ["joint torque 'm'", "'q.sholder'", "did you mean 'q.shoulder'"],
        ),
        (joint_torque("m", "elbow", "1"), ["joint torque 'm'", "expected 3", "found 1"]),
        (joint_damper("d", "elbow", [1, 2]), ["joint damper 'd'", "expected 3", "found 2"]),
        (joint_spring("s", "elbow", [1, 2]), ["joint spring 's'", "expected 1", "found 2"]),
        (
            joint_spring("s", "shoulder", potential="u.shoulder"),
            ["potential of joint spring 's'", "'u.shoulder'"],
        ),
        (
            joint_spring("s", "shoulder", potential="q.shoulder + q.elbow.qw"),
            ["potential of joint spring 's'", "'q.elbow.qw'"],
        ),
        (
            spring_damper("s", "upper", "lower", stiffness="q.shoulder"),
            ["spring-damper 's'", "'q.shoulder'"],
        ),
        ("push", ["forces", "'push'"]),
    ],
)
def test_forces_that_do_not_fit(force: Any, words: list[str]) -> None:
    refused(words, forces=[force])


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: spring_damper("s", "a", "a"), ["spring-damper 's'", "itself"]),
        (lambda: spring_damper("s", "a", "b", stiffness=-1), ["stiffness", "'s'", "-1"]),
        (lambda: spring_damper("s", "a", "b", length=-1), ["length", "'s'", "-1"]),
        (lambda: joint_spring("s", "j"), ["'s'", "exactly one"]),
        (lambda: joint_spring("s", "j", 1, potential="q.j"), ["'s'", "exactly one"]),
        (lambda: joint_spring("s", "j", torque="sin(sin(q.j))"), ["'s'", "potential="]),
        (lambda: point_force("f", "a", frame="bdy"), ["'f'", "'world' or 'body'", "'bdy'"]),  # type: ignore[arg-type]
        (lambda: joint_damper("", "j", 1), ["name", "''"]),
        (lambda: ChannelName.parse("dampr elbow"), ["'dampr'", "did you mean 'damper'"]),
        (lambda: ChannelName.parse("damper"), ["'damper'", "no element"]),
    ],
)
def test_forces_that_cannot_be(make: Any, words: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        make()
    for word in words:
        assert word in str(caught.value)


def test_two_elements_of_one_kind_need_two_names() -> None:
    refused(
        ["both use the channel 'damper d'"],
        forces=[joint_damper("d", "elbow", [1, 1, 1]), joint_damper("d", "shoulder", 1)],
    )
    refused(
        ["both use the channel 'spring d'"],
        forces=[joint_spring("d", "elbow", 1), spring_damper("d", "upper", "ground")],
    )
    Mechanism(
        [A, B], [SHOULDER, ELBOW], [joint_spring("d", "elbow", 1), joint_damper("d", "shoulder", 1)]
    )


def test_a_driven_spring_and_a_prescribed_joint_need_two_names() -> None:
    """Both would fill the channel 'prescribed shoulder'."""
    driven = revolute("shoulder", "ground", "upper", motion="t", stiffness="1 + t**2")
    refused(["'shoulder'", "prescribed shoulder", "another name"], joints=[driven, ELBOW])
    Mechanism([A, B], [revolute("shoulder", "ground", "upper", motion="t", stiffness=1), ELBOW])
