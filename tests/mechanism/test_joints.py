"""Joints: their coordinates and speeds, and what they refuse."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from deltac.errors import InputError, ModelError
from deltac.mechanism.bodies import sphere
from deltac.mechanism.joints import (
    JOINT_KINDS,
    cylindrical,
    fixed,
    free,
    planar,
    prismatic,
    revolute,
    screw,
    spherical,
    universal,
)
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.quantities import rotation_matrix

NAN = float("nan")
SIZES = {  # (coordinates, speeds), from the design's table of joints
    "fixed": (0, 0),
    "revolute": (1, 1),
    "prismatic": (1, 1),
    "screw": (1, 1),
    "cylindrical": (2, 2),
    "universal": (2, 2),
    "planar": (3, 3),
    "spherical": (4, 3),
    "free": (7, 6),
}


def test_every_kind_has_its_size() -> None:
    assert set(SIZES) == set(JOINT_KINDS)
    for name, kind in JOINT_KINDS.items():
        assert (len(kind.coordinates), len(kind.speeds)) == SIZES[name]


def test_names_and_units_of_coordinates_and_speeds() -> None:
    balls = [sphere(name, 1, 1) for name in "abc"]
    joints = [
        free("base", "a"),
        revolute("elbow", "a", "b"),
        universal("wrist", "b", "c"),
    ]
    mechanism = Mechanism(balls, joints)
    assert mechanism.coordinates.names == (
        *("base.x", "base.y", "base.z", "base.qw", "base.qx", "base.qy", "base.qz"),
        *("elbow", "wrist.first", "wrist.second"),
    )
    assert mechanism.speeds.names == (
        *("base.vx", "base.vy", "base.vz", "base.wx", "base.wy", "base.wz"),
        *("elbow", "wrist.first", "wrist.second"),
    )
    assert mechanism.coordinates["base.y"].unit == "m"
    assert mechanism.coordinates["base.qw"].unit == "1"
    assert mechanism.speeds["base.wz"].unit == "rad/s"
    assert mechanism.coordinates.of("wrist") == slice(8, 10)
    assert mechanism.speeds["elbow"].slice == slice(6, 7)
    assert mechanism.coordinates[7].joint == "elbow"
    assert [entry.joint for entry in mechanism.coordinates[7:9]] == ["elbow", "wrist"]


def test_one_law_serves_every_slot() -> None:
    joint = planar("slider", "ground", "a", damping="c*t", stiffness=[1, 2, 3], rest=0.5)
    assert [str(law) for law in joint.damping] == ["c*t"] * 3
    assert joint.rest == (0.5, 0.5, 0.5)
    assert spherical("ball", "ground", "a", stiffness=2.0).stiffness == (2.0,)


@pytest.mark.parametrize(
    "rotation",
    [
        [[1, 0, 0], [0, 1, 0]],
        [["a", "b", "c"]] * 3,
        np.full((3, 3), np.nan),
        "turned",
        np.diag([1, 1, -1]),
        2.0 * np.eye(3),
    ],
)
def test_what_is_no_rotation_is_refused(rotation: Any) -> None:
    with pytest.raises(ModelError, match="rotation of joint 'hinge'"):
        revolute("hinge", "ground", "bar", rotation=rotation)


@pytest.mark.parametrize("axis", ["x", "-y", (1.0, 2.0, -0.5)])
def test_a_rotation_turns_about_its_axis(axis: Any) -> None:
    from scipy.spatial.transform import Rotation

    from deltac.mechanism.quantities import unit_vector

    n = np.array(unit_vector(axis, "axis"))
    np.testing.assert_allclose(
        rotation_matrix(axis, 0.7), Rotation.from_rotvec(0.7 * n).as_matrix(), atol=1e-15
    )


def test_quaternions_place_a_joint_as_matrices_do() -> None:
    quaternion = [np.cos(0.35), 0.0, np.sin(0.35), 0.0]
    joint = revolute("hinge", "ground", "a", rotation=quaternion)
    c, s = np.cos(0.7), np.sin(0.7)
    np.testing.assert_allclose(joint.rotation, [[c, 0, s], [0, 1, 0], [-s, 0, c]], atol=1e-15)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: revolute("hip", "a", "a"), ["'hip'", "'a'", "itself"]),
        (
            lambda: revolute("hip", "a", "ground"),
            ["'hip'", "ground", "the order is revolute(name, parent, child)"],
        ),
        (lambda: revolute(" hip", "ground", "a"), ["' hip'", "blanks"]),
        (lambda: revolute("hip", "ground", "a", "q"), ["'hip'", "'q'", "known: x, y, z"]),
        (lambda: revolute("hip", "ground", "a", [NAN, 0, 1]), ["'hip'", "nan"]),
        (lambda: universal("hip", "ground", "a", "x", "-x"), ["'hip'", "parallel"]),
        (lambda: spherical("hip", "ground", "a", motion="t"), ["'hip'", "spherical", "build"]),
        (lambda: free("hip", "a", motion="t"), ["'hip'", "free", "build"]),
        (lambda: fixed("hip", "ground", "a", motion="t"), ["motion of joint 'hip'", "no motion"]),
        (lambda: fixed("hip", "ground", "a", damping=1), ["damping of joint 'hip'", "no motion"]),
        (lambda: revolute("hip", "ground", "a", rest=1), ["rest of joint 'hip'", "stiffness"]),
        (
            lambda: spherical("hip", "ground", "a", stiffness=1, rest=1),
            ["rest of joint 'hip'", "rotation="],
        ),
        (lambda: revolute("hip", "ground", "a", armature=-1), ["armature of joint 'hip'", "-1"]),
        (
            lambda: universal("hip", "ground", "a", damping=[1, 2, 3]),
            ["damping of joint 'hip'", "expected 2", "found 3"],
        ),
        (
            lambda: revolute("hip", "ground", "a", rotation=np.diag([1, 1, -1])),
            ["rotation of joint 'hip'", "determinant is -1"],
        ),
        (
            lambda: revolute("hip", "ground", "a", rotation=[2, 0, 0, 0]),
            ["rotation of joint 'hip'", "length 2", "expected 1"],
        ),
        (
            lambda: revolute("hip", "ground", "a", rotation=3.0),  # type: ignore[arg-type]
            ["rotation of joint 'hip'", "3 by 3", "quaternion"],
        ),
        (lambda: screw("hip", "ground", "a", pitch=NAN), ["pitch of joint 'hip'", "nan"]),
        (lambda: prismatic("hip", "ground", "a", position=[0, 1]), ["position", "'hip'", "three"]),
        (
            lambda: cylindrical("hip", "ground", "a", motion=["t"]),
            ["motion of joint 'hip'", "expected 2", "found 1"],
        ),
        (
            lambda: revolute("hip", "ground", "a", motion="gamma(t)"),
            ["motion of joint 'hip'", "gamma"],
        ),
        (
            lambda: spherical("hip", "ground", "a", child_rotation=rotation_matrix("x", 1)),
            ["'hip'", "child_rotation", "rotation"],
        ),
        (lambda: free("hip", "a", child_position=[0, 0, 1]), ["'hip'", "child_position"]),
    ],
)
def test_what_a_joint_refuses(make: Callable[[], object], words: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        make()
    for word in words:
        assert word in str(caught.value)
