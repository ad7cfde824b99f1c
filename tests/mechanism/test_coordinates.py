"""Maps to coordinates of the user's own choice: what they must cover, what they may use."""

from __future__ import annotations

from typing import Any

import pytest

from deltac.errors import InputError
from deltac.mechanism.bodies import box
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.joints import revolute, spherical
from deltac.mechanism.mechanism import Mechanism

A, B = box("upper", 1, [1, 1, 1]), box("lower", 1, [1, 1, 1])
CHAIN = Mechanism(
    [A, B],
    [revolute("hip", "ground", "upper"), revolute("knee", "upper", "lower")],
    parameters={"r": 2.0},
)
BALL = Mechanism([A], [spherical("ball", "ground", "upper")])


def test_speeds_are_named_like_the_coordinates() -> None:
    given = CoordinateMap(("a", "b"), q={"hip": "q.a", "knee": "r*q.b - q.a"})
    assert given.speeds == ("a", "b")
    given.check(CHAIN)


def test_maps_of_speeds_alone() -> None:
    CoordinateMap(speeds=("s", "w"), u={"hip": "u.s*cos(q.knee)", "knee": "u.w + t"}).check(CHAIN)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"q": {"hip": 1}}, ["name its own coordinates"]),
        ({"u": {"hip": 1}}, ["name its own speeds"]),
        ({"coordinates": "ab", "q": {"hip": "q.a"}}, ["sequence", "'ab'"]),
        ({"coordinates": ("a", "a"), "q": {"hip": "q.a"}}, ["twice"]),
        ({"coordinates": ("a",), "q": {"hip": "gamma(q.a)"}}, ["'hip'", "gamma"]),
    ],
)
def test_maps_that_cannot_be(options: dict[str, Any], words: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        CoordinateMap(**options)
    for word in words:
        assert word in str(caught.value)


ABSOLUTE = {"hip": "q.a", "knee": "q.b - q.a"}


@pytest.mark.parametrize(
    ("mechanism", "options", "words"),
    [
        (
            CHAIN,
            {"coordinates": ("a", "b"), "q": {"hip": "q.a", "kne": "q.b"}},
            ["'kne'", "'knee'"],
        ),
        (CHAIN, {"coordinates": ("a", "b"), "q": {"hip": "q.a"}}, ["no law", "knee"]),
        (CHAIN, {"coordinates": ("a",), "q": {"hip": "q.a", "knee": "q.a"}}, ["give u="]),
        (CHAIN, {"coordinates": ("a", "b"), "q": {**ABSOLUTE, "hip": "q.c"}}, ["'hip'", "q.c"]),
        (CHAIN, {"speeds": ("s",), "u": {"hip": "u.s", "knee": 0}}, ["1 speeds", "2 free"]),
        (CHAIN, {"speeds": ("s", "w"), "u": {"hip": "u.s", "knee": "u.v"}}, ["'knee'", "u.v"]),
        (
            CHAIN,
            {"coordinates": ("a", "b"), "q": ABSOLUTE, "inverse": {"a": "q.hip"}},
            ["inverse", "no law", "b"],
        ),
        (
            CHAIN,
            {
                "coordinates": ("a", "b"),
                "q": ABSOLUTE,
                "inverse": {"a": "q.hip", "b": "q.a"},
            },
            ["inverse of 'b'", "q.a"],
        ),
    ],
)
def test_maps_that_do_not_fit(
    mechanism: Mechanism, options: dict[str, Any], words: list[str]
) -> None:
    with pytest.raises(InputError) as caught:
        CoordinateMap(**options).check(mechanism)
    for word in words:
        assert word in str(caught.value)
