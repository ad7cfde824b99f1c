"""The mechanism as a whole: order, names, immutability, parameters, digest."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, replace

import pytest

from deltac.errors import InputError
from deltac.mechanism.bodies import box, rod
from deltac.mechanism.forces import joint_damper, joint_torque, spring_damper
from deltac.mechanism.joints import revolute, spherical
from deltac.mechanism.mechanism import Mechanism
from tests.support.processes import printed


def arm(**changes: object) -> Mechanism:
    parts: dict[str, object] = {
        "bodies": [rod("upper", "m", 1.0), box("lower", 1.0, [1, 1, 1])],
        "joints": [
            revolute("shoulder", "ground", "upper", damping=0.1, stiffness="k"),
            spherical("elbow", "upper", "lower"),
        ],
        "parameters": {"m": 2.0, "k": 3.0},
    }
    return Mechanism(**{**parts, **changes})  # type: ignore[arg-type]


def test_joints_come_with_parents_before_children() -> None:
    shuffled = arm(
        joints=[spherical("elbow", "upper", "lower"), revolute("shoulder", "ground", "upper")]
    )
    assert [joint.name for joint in shuffled.joints] == ["shoulder", "elbow"]
    assert shuffled.coordinates.names[0] == "shoulder"


def test_branches_keep_the_order_they_were_given_in() -> None:
    bodies = [box(name, 1, [1, 1, 1]) for name in "abcd"]
    joints = [
        revolute("ja", "ground", "a"),
        revolute("jc", "b", "c"),
        revolute("jb", "a", "b"),
        revolute("jd", "a", "d"),
    ]
    assert [j.name for j in Mechanism(bodies, joints).joints] == ["ja", "jb", "jc", "jd"]


def test_lookup_and_children() -> None:
    mechanism = arm()
    assert mechanism.body("upper").name == "upper"
    assert mechanism.joint("elbow").kind == "spherical"
    assert [j.name for j in mechanism.children["upper"]] == ["elbow"]
    with pytest.raises(InputError, match="unknown body 'uper'; did you mean 'upper'"):
        mechanism.body("uper")
    with pytest.raises(InputError, match="unknown joint 'elbo'; did you mean 'elbow'"):
        mechanism.joint("elbo")


def test_own_springs_and_dampers_are_elements() -> None:
    more = spring_damper("tie", "ground", "lower", stiffness=1.0)
    mechanism = arm(forces=[more])
    kinds = [(type(e).__name__, e.name) for e in mechanism.elements]
    assert kinds == [
        ("JointSpring", "shoulder"),
        ("JointDamper", "shoulder"),
        ("SpringDamper", "tie"),
    ]


def test_immutable() -> None:
    mechanism = arm()
    with pytest.raises(FrozenInstanceError):
        mechanism.name = "leg"  # type: ignore[misc]
    assert isinstance(mechanism.bodies, tuple)
    assert isinstance(mechanism.joints, tuple)


def test_free_entries_leave_prescribed_joints_out() -> None:
    driven = arm(
        joints=[
            revolute("shoulder", "ground", "upper", motion="sin(t)"),
            spherical("elbow", "upper", "lower"),
        ]
    )
    assert driven.free.q.tolist() == [1, 2, 3, 4]
    assert driven.free.u.tolist() == [1, 2, 3]
    assert [entry.prescribed for entry in driven.speeds] == [True, False, False, False]


def test_parameters_give_numbers() -> None:
    mechanism = arm()
    assert mechanism.number(mechanism.body("upper").mass) == 2.0
    heavier = mechanism.with_parameters(m=5)
    assert heavier.number(heavier.body("upper").mass) == 5.0
    assert mechanism.number(mechanism.body("upper").mass) == 2.0
    with pytest.raises(InputError, match="unknown parameter 'kk'; did you mean 'k'"):
        mechanism.with_parameters(kk=1.0)
    with pytest.raises(InputError, match="mass of body 'upper': found -1"):
        mechanism.with_parameters(m=-1.0)


def test_digest_follows_what_matters() -> None:
    mechanism = arm()
    assert mechanism.hash == arm().hash
    assert mechanism.hash == replace(mechanism, name="other").hash
    others = [
        mechanism.with_parameters(m=2.5),
        arm(gravity=[0, 0, -9.81]),
        arm(forces=[joint_damper("d", "elbow", [1, 1, 1])]),
        arm(bodies=[rod("upper", "m", 1.0 + 1e-15), box("lower", 1.0, [1, 1, 1])]),
        arm(joints=[revolute("shoulder", "ground", "upper", "y"), mechanism.joint("elbow")]),
        arm(joints=[revolute("shoulder", "ground", "upper", motion="t"), mechanism.joint("elbow")]),
    ]
    assert len({mechanism.hash, *(other.hash for other in others)}) == 1 + len(others)


def test_digest_without_a_parameters_value() -> None:
    one, other = arm(), arm().with_parameters(m=7.0)
    assert one.digest(["m"]) == other.digest(["m"])
    assert one.digest(["k"]) != other.digest(["k"])
    assert one.digest(["m"]) != one.digest()


@pytest.mark.long
def test_the_digest_is_the_same_in_every_process() -> None:
    """It goes into logs: it must not depend on the hash seed of a process."""
    code = (
        "from deltac import Mechanism, revolute, rod\n"
        "m = Mechanism([rod('a', 'm*(2 + cos(k)) + k', 1)], [revolute('j', 'ground', 'a',"
        " motion='sin(k*t) + m*t**2')], parameters={'m': 1, 'k': 2})\n"
        "print(m.hash)"
    )
    assert len(printed(code)) == 1


def test_repr_is_short() -> None:
    assert repr(arm(name="arm")) == (
        "Mechanism('arm': 2 bodies, 2 joints, 4 free speeds, 2 force elements)"
    )


def test_a_motor_without_a_law_waits_for_one() -> None:
    assert joint_torque("motor", "elbow").torque is None
    assert joint_torque("motor", "elbow", [1, "t", 0]).torque is not None
