"""Closed loops of SDFormat: joints that the tree has no place for are constraints."""

from __future__ import annotations

import math
import re
import sysconfig
from pathlib import Path

import numpy as np
import pytest

import deltac as dc

CRANK, COUPLER, ROCKER, BASE = 0.3, 0.8, 0.6, 0.7
POSE = 0.9
"""Of the crank in the file, rad."""


def four_bar(crank: float) -> tuple[float, float]:
    """The angles of coupler and rocker against the ground, the open branch (Freudenstein 1955)."""
    dx, dy = BASE - CRANK * math.cos(crank), -CRANK * math.sin(crank)
    diagonal = math.hypot(dx, dy)
    cosine = (COUPLER**2 + diagonal**2 - ROCKER**2) / (2 * COUPLER * diagonal)
    coupler = math.atan2(dy, dx) + math.acos(cosine)
    x, y = CRANK * np.array([math.cos(crank), math.sin(crank)]) + COUPLER * np.array(
        [math.cos(coupler), math.sin(coupler)]
    )
    return coupler, math.atan2(y, x - BASE)


def rates(crank: float, speed: float, acceleration: float) -> tuple[np.ndarray, np.ndarray]:
    """Speeds and accelerations of coupler and rocker: the closed chain of vectors, differentiated."""
    coupler, rocker = four_bar(crank)

    def along(angle: float) -> np.ndarray:
        return np.array([math.cos(angle), math.sin(angle)])

    def across(angle: float) -> np.ndarray:
        return np.array([-math.sin(angle), math.cos(angle)])

    matrix = np.column_stack([COUPLER * across(coupler), -ROCKER * across(rocker)])
    velocity = np.linalg.solve(matrix, -CRANK * speed * across(crank))
    centripetal = (
        CRANK * speed**2 * along(crank)
        + COUPLER * velocity[0] ** 2 * along(coupler)
        - ROCKER * velocity[1] ** 2 * along(rocker)
    )
    return velocity, np.linalg.solve(matrix, centripetal - CRANK * acceleration * across(crank))


LINK = """<link name='{name}'><pose>{x} {y} 0 0 0 {yaw}</pose><inertial><pose>{half} 0 0 0.3 0 0</pose>
<mass>{mass}</mass><inertia><ixx>{ixx}</ixx><iyy>{iyy}</iyy><izz>{izz}</izz></inertia></inertial></link>"""
HINGE = """<joint name='{name}' type='revolute'><parent>{parent}</parent><child>{child}</child>
<pose>{x} 0 0 0.4 -0.2 0.1</pose><axis><xyz expressed_in='__model__'>0 0 1</xyz>{more}</axis></joint>"""


def file_of(path: Path, kind: str = "revolute", more: str = "") -> Path:
    """The four-bar in a world with two models, its joints' frames askew; the pin is the last joint."""
    coupler, rocker = four_bar(POSE)
    x, y = CRANK * math.cos(POSE), CRANK * math.sin(POSE)
    links = [
        ("crank", 0.0, 0.0, POSE, CRANK, 1.0),
        ("coupler", x, y, coupler, COUPLER, 2.0),
        ("rocker", BASE, 0.0, rocker, ROCKER, 1.5),
    ]
    text = "".join(
        LINK.format(
            name=n, x=x, y=y, yaw=yaw, half=length / 2, mass=mass,
            **dict(zip(("ixx", "iyy", "izz"), moments(mass, length))),
        )
        for n, x, y, yaw, length, mass in links
    )  # fmt: skip
    for name, parent, child, where in (
        ("a", "world", "crank", 0.0),
        ("b", "crank", "coupler", 0.0),
        ("c", "world", "rocker", 0.0),
        ("pin", "coupler", "rocker", ROCKER),
    ):
        closing = more if name == "pin" else ""
        hinge = HINGE.format(name=name, parent=parent, child=child, x=where, more=closing)
        text += hinge.replace("revolute", kind) if name == "pin" else hinge
    path.write_text(
        "<sdf version='1.9'><world name='w'><gravity>0 -9.81 0</gravity>"
        f"<model name='box'><link name='box'/></model><model name='bars'>{text}</model></world></sdf>"
    )
    return path


def by_hand() -> dc.Mechanism:
    """Plates whose angles are measured from the ground's x axis or the crank, one pin by hand."""
    rods = [
        dc.body(
            n,
            mass=m,
            inertia=_turned(m, length),
            mass_centre=(length / 2, 0.0, 0.0),
        )
        for n, m, length in (
            ("crank", 1.0, CRANK),
            ("coupler", 2.0, COUPLER),
            ("rocker", 1.5, ROCKER),
        )
    ]
    joints = [
        dc.revolute("a", "ground", "crank"),
        dc.revolute("b", "crank", "coupler", position=(CRANK, 0.0, 0.0)),
        dc.revolute("c", "ground", "rocker", position=(BASE, 0.0, 0.0)),
    ]
    pin = dc.constraints.loop_revolute(
        "pin", "coupler", "rocker", point1=(COUPLER, 0, 0), point2=(ROCKER, 0, 0)
    )
    return dc.Mechanism(rods, joints, constraints=[pin], gravity=(0.0, -9.81, 0.0))


def moments(mass: float, length: float) -> list[float]:
    """Principal moments of a plate."""
    return [share * mass * length**2 / 12 for share in (0.6, 0.7, 1.0)]


def _turned(mass: float, length: float) -> list[list[float]]:
    """The file's moments, whose frame is rolled by 0.3."""
    c, s = math.cos(0.3), math.sin(0.3)
    R = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    tensor: list[list[float]] = (R @ np.diag(moments(mass, length)) @ R.T).tolist()
    return tensor


@pytest.mark.parametrize(("crank", "speed"), [(POSE, 0.0), (0.2, 3.0), (2.4, -5.0)])
def test_a_four_bar_is_the_one_built_by_hand(crank: float, speed: float, tmp_path: Path) -> None:
    mechanism, report = dc.read_mechanism(f"{file_of(tmp_path / 'bars.sdf')}:bars")
    assert mechanism.coordinates.names == ("a", "c", "b")
    assert [constraint.name for constraint in mechanism.constraints] == ["pin"]
    assert {remark.element for remark in report.read} == {"tree", "pin"}

    coupler, rocker = four_bar(crank)
    coupler_pose, rocker_pose = four_bar(POSE)
    (coupler_speed, rocker_speed), _ = rates(crank, speed, 0.0)
    speeds = {"a": speed, "b": coupler_speed - speed, "c": rocker_speed}
    angles = {"a": crank, "b": coupler - crank, "c": rocker}
    poses = {"a": POSE, "b": coupler_pose - POSE, "c": rocker_pose}

    imported = dc.evaluate(
        mechanism, mechanism.state({n: angles[n] - poses[n] for n in angles}, speeds)
    )
    hand = by_hand()
    written = dc.evaluate(hand, hand.state(angles, speeds))
    index = [hand.coordinates.names.index(n) for n in mechanism.coordinates.names]
    assert imported.kinetic == pytest.approx(written.kinetic, rel=1e-13)
    assert imported.udot == pytest.approx(written.udot[index], rel=1e-11, abs=1e-11)

    a, c, b = imported.udot
    _, (coupler_acceleration, rocker_acceleration) = rates(crank, speed, a)
    assert (b + a, c) == pytest.approx((coupler_acceleration, rocker_acceleration), rel=1e-11)


def test_the_pose_of_the_file_starts_a_run_that_stays_closed(tmp_path: Path) -> None:
    loaded = dc.load_model(f"{file_of(tmp_path / 'bars.sdf')}:bars")
    run = dc.simulate(loaded, duration=0.5, step=2e-3)
    crank = POSE + run.coordinate("a")
    assert np.ptp(crank) > 0.5
    closed = np.array([four_bar(angle)[1] for angle in crank])
    assert run.coordinate("c") + four_bar(POSE)[1] == pytest.approx(closed, abs=1e-9)


def test_what_acts_in_a_pin_that_closes_a_loop_comes_from_the_log(tmp_path: Path) -> None:
    more = "<dynamics><damping>0.2</damping><spring_stiffness>3</spring_stiffness></dynamics>"
    mechanism, report = dc.read_mechanism(f"{file_of(tmp_path / 'bars.sdf', more=more)}:bars")
    assert not mechanism.forces
    assert {r.consequence.partition("channel ")[2] for r in report.acting} == {
        "'damper pin'",
        "'spring pin'",
    }


def test_a_kind_that_closes_no_loop_is_refused(tmp_path: Path) -> None:
    with pytest.raises(dc.InputError, match="'pin'.*'screw'.*expected one of revolute") as refused:
        dc.read_mechanism(f"{file_of(tmp_path / 'bars.sdf', 'screw')}:bars")
    assert refused.value.code == "E-MODEL"


@pytest.mark.long
def test_a_circle_of_joints_floats_and_its_last_joint_closes_it(tmp_path: Path) -> None:
    joint = "<joint name='{}' type='{}'><parent>{}</parent><child>{}</child></joint>"
    text = joint.format("j", "revolute", "a", "b") + joint.format("k", "fixed", "b", "a")
    (path := tmp_path / "circle.sdf").write_text(
        f"<sdf version='1.9'><model name='m'><link name='a'/><link name='b'/>{text}</model></sdf>"
    )
    mechanism, _ = dc.read_mechanism(path)
    assert [joint.name for joint in mechanism.joints] == ["a", "j"]
    (weld,) = mechanism.constraints
    assert (weld.name, weld.body1, weld.body2) == ("k", "b", "a")  # type: ignore[attr-defined]
    run = dc.simulate(dc.load_model(path), "u.a.wz=1", 0.1, 0.01)
    assert run.coordinate("j") == pytest.approx(0.0, abs=1e-12)


BODY = """<link name='{}'><pose>0.2 0.1 0.3 0.5 -0.4 0.3</pose>
<inertial><mass>2</mass><pose>0.1 -0.2 0.15 0 0 0.2</pose>
<inertia><ixx>.3</ixx><iyy>.4</iyy><izz>.5</izz></inertia></inertial></link>"""
JOINT = """<joint name='{}' type='{}'><parent>{}</parent><child>{}</child><pose>0.1 0.2 0 0.3 0.2 0.1</pose>
<axis><xyz>0.6 0.8 0</xyz></axis><axis2><xyz>0 0 1</xyz></axis2></joint>"""


@pytest.mark.parametrize(
    ("kind", "free"),
    [("fixed", 0), ("revolute", 1), ("prismatic", 1), ("universal", 2), ("ball", 3)],
)
def test_a_loop_leaves_the_motion_that_its_joint_would(
    kind: str, free: int, tmp_path: Path
) -> None:
    """A slide and a ball carry a body; one more joint to the ground leaves what that joint alone would."""
    (looped := tmp_path / "looped.sdf").write_text(
        "<sdf version='1.9'><model name='m'>" + BODY.format("s") + BODY.format("a")
        + JOINT.format("slide", "prismatic", "world", "s") + JOINT.format("ball", "ball", "s", "a")
        + JOINT.format("j", kind, "world", "a") + "</model></sdf>"
    )  # fmt: skip
    (alone := tmp_path / "alone.sdf").write_text(
        "<sdf version='1.9'><model name='m'>" + BODY.format("a")
        + JOINT.format("j", kind, "world", "a") + "</model></sdf>"
    )  # fmt: skip
    mechanism, _ = dc.read_mechanism(looped)
    slide, *spin = dc.evaluate(mechanism, mechanism.state()).udot
    tree, _ = dc.read_mechanism(alone)
    direct = dc.evaluate(tree, tree.state()).udot
    assert len(direct) == free
    turns = tree.joints[0].child_rotation
    R = np.array(turns, dtype=float)
    axes = {
        "fixed": np.zeros((3, 0)),
        "revolute": R @ [[0.6], [0.8], [0.0]],
        "prismatic": np.zeros((3, 1)),
        "universal": R @ [[0.6, 0.0], [0.8, 0.0], [0.0, 1.0]],
        "ball": np.eye(3),
    }[kind]
    assert spin == pytest.approx(axes @ direct, rel=1e-9, abs=1e-11)
    assert slide == pytest.approx(direct[0] if kind == "prismatic" else 0.0, rel=1e-9, abs=1e-11)
    assert np.abs(direct).max(initial=9.0) > 0.1


CASSIE = Path(
    sysconfig.get_path("purelib"),
    "cmeel.prefix/share/example-robot-data/robots/cassie_description/robots/cassie_reduced.sdf",
)


@pytest.mark.slow
@pytest.mark.skipif(not CASSIE.exists(), reason="example-robot-data is not installed")
def test_cassie_falls_with_its_loops_closed(tmp_path: Path) -> None:
    """Without its dampers, what gravity gives is all kinetic energy."""
    (path := tmp_path / "cassie.sdf").write_text(
        re.sub("<damping>.*?</damping>", "", CASSIE.read_text())
    )
    loaded = dc.load_model(path)
    mechanism = loaded.mechanism
    loops = [f"{side}-{rod}" for side in ("left", "right") for rod in ("pitch-rod", "plantar-foot")]
    assert {c.name for c in mechanism.constraints} == {f"{name}-joint" for name in loops}
    guess = mechanism.state({}, {"left-knee-op": 1.0, "right-pitch-op": -2.0})
    run = dc.simulate(loaded, dc.assemble(loaded, guess).state, 0.05, 1e-3)
    first, last = (
        dc.evaluate(mechanism, dc.State(0.0, run.q[k], run.u[k])) for k in (0, len(run.t) - 1)
    )
    falls = last.kinetic - first.kinetic
    assert falls > 1.0
    assert sum(last.potential.values()) - sum(first.potential.values()) == pytest.approx(
        -falls,
        abs=1e-5 * falls,  # type: ignore[arg-type]
    )
