"""Robots as their makers publish them: M, bias and V against Pinocchio's own parser and recursions."""

from __future__ import annotations

import sysconfig
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from deltac.dynamics.forces import channels
from deltac.dynamics.recursions import crba, rnea
from deltac.dynamics.system import trace
from deltac.dynamics.terms import terms
from deltac.errors import InputError
from deltac.importers import read_mechanism

pytest.importorskip("mujoco", reason="MuJoCo is not installed: the extra 'mujoco'")
pin: Any = pytest.importorskip("pinocchio", reason="Pinocchio is not installed on this platform")

PACKAGE = "cmeel.prefix/share/example-robot-data/robots"
ROBOTS = sorted(Path(sysconfig.get_path("purelib"), PACKAGE).rglob("*.urdf"))
QUICK = {
    "icub.urdf",
    "tiago_no_hand.urdf",
    "anymal.urdf",
    "allegro_left_hand.urdf",
    "b1.urdf",
    "panda.urdf",
}
REFUSED = {
    "romeo_laas_small.urdf": r"link 'body': its principal moment of inertia -0\.0213468 ",
    "ur3.urdf": "has no <robot> with links",  # a file of xacro definitions
}

needs_robots = pytest.mark.skipif(
    not ROBOTS, reason="example-robot-data is not installed: the extra 'models'"
)


def quick(path: Path) -> Any:
    marks = [] if path.name in QUICK | REFUSED.keys() else [pytest.mark.slow]
    return pytest.param(path, id=f"{path.parts[-3]}/{path.stem}", marks=marks)


def differences(path: Path, states: int = 3) -> dict[str, float]:
    """Largest differences of M, bias and V from Pinocchio's, relative to the largest of each."""
    mechanism, _ = read_mechanism(path)
    model = pin.buildModelFromUrdf(str(path))
    if model.nv == 0:
        pytest.skip("nothing moves")
    data = model.createData()
    system = trace(mechanism)
    nv = len(mechanism.speeds.names)
    assert model.nv == nv
    places = [model.joints[model.getJointId(n)] for n in mechanism.coordinates.names]
    order = np.array([joint.idx_v for joint in places], dtype=int)
    bias = rnea(system, ca.SX.zeros(nv), ca.vertcat(ca.SX.zeros(3), -system.gravity))
    # MuJoCo's weight is 9.81 m/s² as Pinocchio's.
    V = terms(system, system.udot_all, channels(system)).V
    function = ca.Function(
        "f", [system.q, system.u], [ca.densify(x) for x in (crba(system), bias, V)]
    )
    rng = np.random.default_rng(7)
    found = {"M": 0.0, "bias": 0.0, "V": 0.0}
    first: tuple[float, float] | None = None
    for _ in range(states):
        q, u = rng.uniform(-1.5, 1.5, nv), rng.normal(0, 1, nv)
        theirs = pin.neutral(model)
        v = np.zeros(nv)
        for joint, angle, speed in zip(places, q, u, strict=True):
            if joint.nq == 2:  # continuous: cosine and sine
                theirs[joint.idx_q : joint.idx_q + 2] = np.cos(angle), np.sin(angle)
            else:
                theirs[joint.idx_q] = angle
            v[joint.idx_v] = speed
        upper = np.triu(pin.crba(model, data, theirs))
        M = (upper + np.triu(upper, 1).T)[np.ix_(order, order)]
        h = pin.nonLinearEffects(model, data, theirs, v)[order]
        W = float(pin.computePotentialEnergy(model, data, theirs))
        own = [np.array(x) for x in function(q, u)]
        found["M"] = max(
            found["M"], np.abs(own[0] - M).max(initial=0.0) / np.abs(M).max(initial=1e-300)
        )
        scale = np.abs(h).max(initial=1e-300)
        found["bias"] = max(found["bias"], np.abs(own[1].ravel() - h).max(initial=0.0) / scale)
        if first is not None:  # of what stands still, V is a constant that Pinocchio leaves out
            turned = abs((own[2].item() - first[0]) - (W - first[1]))
            found["V"] = max(found["V"], turned / (abs(W) + abs(first[1]) + abs(first[0])))
        first = first or (own[2].item(), W)
    return found


@needs_robots
@pytest.mark.parametrize("path", [quick(path) for path in ROBOTS])
def test_a_robot_against_pinocchio(path: Path) -> None:
    if path.name in REFUSED:
        with pytest.raises(InputError, match=REFUSED[path.name]):
            read_mechanism(path)
        return
    assert max(differences(path).values()) < 1e-12  # rounding of sums of some hundred terms


# -- what a file may say of a link ---------------------------------------------------------------


def file(folder: Path, inertia: str, joint: str = "revolute", extra: str = "") -> Path:
    path = folder / "arm.urdf"
    path.write_text(
        f"""<robot name='arm'><link name='base'/><link name='upper'>{inertia}</link>
        <joint name='elbow' type='{joint}'><parent link='base'/><child link='upper'/><axis xyz='0 1 0'/>
        <limit lower='-1' upper='1' effort='1' velocity='1'/></joint>{extra}</robot>"""
    )
    return path


def inertial(
    mass: str = "1", ixx: str = "1", iyy: str = "1", izz: str = "1", rpy: str = "0 0 0"
) -> str:
    return (
        f"<inertial><origin xyz='0 0 .1' rpy='{rpy}'/><mass value='{mass}'/><inertia ixx='{ixx}' "
        f"iyy='{iyy}' izz='{izz}' ixy='0' ixz='0' iyz='0'/></inertial>"
    )


@pytest.mark.parametrize(
    ("inertia", "words"),
    [
        (inertial(mass="-1"), r"link 'upper'.*mass is -1 kg"),
        (inertial(ixx="-0.5"), r"link 'upper'.*moment of inertia -0\.5 "),
        (inertial(mass="nan"), r"link 'upper'.*mass is 'nan'"),
        (inertial(mass="1e999"), r"link 'upper'.*'1e999'"),
        (inertial(izz="²"), r"link 'upper'.*izz"),
        (inertial(rpy="0 0"), r"link 'upper'.*'0 0', expected 3 numbers"),
        (inertial(ixx="1,0"), r"link 'upper'.*ixx"),
    ],
)
def test_impossible_inertias_are_refused_with_link_and_value(
    inertia: str, words: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=words):
        read_mechanism(file(tmp_path, inertia))


@pytest.mark.parametrize(
    ("inertia", "mass", "moment", "remark"),
    [
        (inertial(izz="9"), 1.0, 9.0, "triangle inequality"),
        (inertial(mass="0"), 0.0, 1.0, "inertia without mass"),
        (inertial(mass="0", ixx="0", iyy="0", izz="0"), 0.0, 0.0, None),
        (inertial(ixx="0", iyy="0", izz="0"), 1.0, 0.0, None),
        (inertial(ixx="-1e-20", iyy="0", izz="0"), 1.0, 0.0, None),
        ("<inertial><mass value='2'/></inertial>", 2.0, 0.0, None),
        ("", 0.0, 0.0, None),
    ],
)
@pytest.mark.parametrize(
    "joint", ["revolute", "continuous", "prismatic", "fixed", "floating", "planar"]
)
def test_unusual_inertias_are_taken_as_they_are(
    joint: str, inertia: str, mass: float, moment: float, remark: str | None, tmp_path: Path
) -> None:
    mechanism, report = read_mechanism(file(tmp_path, inertia, joint))
    upper = mechanism.body("upper")
    assert upper.mass == mass
    assert upper.inertia[2][2] == pytest.approx(moment, abs=1e-15)
    said = [r for r in report.assumed if r.element == "upper"]
    assert [remark in r.what for r in said] == ([True] if remark else []) if remark else not said


def test_a_negative_moment_beside_a_larger_one_is_taken(tmp_path: Path) -> None:
    """An antenna of wrong inertia, fixed to a heavy link, moves with it: their sum is what counts."""
    antenna = "<link name='antenna'>" + inertial(mass="0.001", ixx="-1e-3") + "</link>"
    antenna += "<joint name='a' type='fixed'><parent link='upper'/><child link='antenna'/></joint>"
    mechanism, report = read_mechanism(file(tmp_path, inertial(), extra=antenna))
    assert mechanism.body("antenna").inertia[0][0] == -1e-3
    assert any(r.element == "antenna" for r in report.assumed)


@pytest.mark.parametrize(
    "text",
    [
        "<!DOCTYPE r [<!ENTITY a 'aaaa'>]><robot name='r'><link name='&a;'/></robot>",
        "<robot name='r'>" + "<a>" * 50_000 + "</a>" * 50_000 + "</robot>",
        "<robot name='r'/>",
        "<sdf/>",
        "",
    ],
    ids=range(5),
)
def test_files_that_are_no_robots(text: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    with pytest.raises(InputError, match=r"arm\.urdf"):
        read_mechanism(path)


# -- run by MuJoCo -------------------------------------------------------------------------------


@pytest.mark.parametrize("base", ["fixed", "free"])
def test_a_urdf_is_run_by_mujoco_and_audited_by_the_mechanism_that_is_read(
    base: str, tmp_path: Path
) -> None:
    from deltac.energy import balance
    from deltac.recorders import run_mujoco

    path = file(tmp_path, inertial(mass="2", ixx=".1", iyy=".1", izz=".1"))
    if base == "free":  # a base that moves has mass
        path.write_text(
            path.read_text().replace(
                "<link name='base'/>", f"<link name='base'>{inertial()}</link>"
            )
        )
    run = run_mujoco(path, 0.2, integrator="rk4", step=1e-3, base=base)
    mechanism, _ = read_mechanism(path, base=base)
    assert run.coordinates == mechanism.coordinates.names
    ledger = balance(mechanism, run)
    assert np.abs(ledger.delta_c["wang"]).max() < 1e-7  # a swing of some joules, by order 4


def test_mujoco_says_which_urdf_it_does_not_simulate(tmp_path: Path) -> None:
    from deltac.recorders import run_mujoco

    with pytest.raises(InputError, match=r"arm\.urdf: .*inertia"):
        run_mujoco(file(tmp_path, inertial(izz="9")), 0.1)
    with pytest.raises(InputError, match="floating joint 'elbow'"):
        run_mujoco(file(tmp_path, inertial(), "floating"), 0.1)


def test_a_run_that_breaks_off_in_its_first_step_is_its_start(tmp_path: Path) -> None:
    import mujoco

    from deltac.recorders import run_mujoco

    model = mujoco.MjModel.from_xml_path(str(file(tmp_path, inertial())))
    data = mujoco.MjData(model)
    data.qvel[:] = 1e11  # beyond what MuJoCo takes for a speed
    run = run_mujoco(model, 0.1, data=data)
    assert len(run) == 1 and run.u[0, 0] == 1e11
    assert not run.provenance.completed and "in the step from t = 0 s" in run.provenance.message
