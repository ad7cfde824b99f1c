"""MJCF and URDF files: what they become, and what is said of those that cannot be read."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from deltac.dynamics.recursions import crba
from deltac.dynamics.system import trace
from deltac.errors import InputError
from deltac.foreign.limits import Limits
from deltac.importers import read_mechanism
from tests.support.mujoco_comparison import differences

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: the extra 'mujoco'")

LINK = """<link name="{name}"><inertial><origin xyz="{x} .1 0" rpy=".3 .2 .1"/><mass value="{mass}"/>
  <inertia ixx=".3" iyy=".4" izz=".5" ixy=".02" ixz="-.03" iyz=".01"/></inertial>{shape}</link>"""
MESH = "<{0}><geometry><mesh filename='package://robot/{0}.stl'/></geometry></{0}>"
JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
  <origin xyz=".2 0 .1" rpy=".1 -.2 .4"/><axis xyz="0.6 0 0.8"/><dynamics damping=".3"/>
  <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>"""


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    """A chain: revolute, prismatic, fixed, continuous; its meshes cannot be opened."""
    links = [
        LINK.format(
            name=f"l{k}",
            x=0.1 * k,
            mass=1 + k,
            shape=MESH.format("visual") + MESH.format("collision"),
        )
        for k in range(5)
    ]
    kinds = ("revolute", "prismatic", "fixed", "continuous")
    joints = [
        JOINT.format(name=f"j{k}", kind=kind, parent=f"l{k}", child=f"l{k + 1}")
        for k, kind in enumerate(kinds)
    ]
    path = tmp_path / "robot.urdf"
    path.write_text(f"<robot name='robot'>{''.join(links + joints)}</robot>")
    return path


def mass_matrix(mechanism: Any, q: Any) -> Any:
    system = trace(mechanism)
    return np.array(ca.Function("M", [system.q], [ca.densify(crba(system))])(q))


def test_urdf_against_pinocchio(robot: Path) -> None:
    """The mass matrix, by a library with a parser of its own, to rounding."""
    pin = pytest.importorskip("pinocchio", reason="Pinocchio is not installed on this platform")
    mechanism, report = read_mechanism(robot)
    assert mechanism.coordinates.names == ("j0", "j1", "j3")
    assert any("meshes" in remark.what for remark in report.assumed)
    model = pin.buildModelFromUrdf(str(robot))
    assert [*model.names][1:] == ["j0", "j1", "j3"]
    q = np.array([0.4, -0.3, 0.9])
    # A continuous joint has the cosine and sine of its angle as coordinates there.
    M = np.triu(pin.crba(model, model.createData(), np.array([*q[:2], np.cos(q[2]), np.sin(q[2])])))
    expected = M + np.triu(M, 1).T
    np.testing.assert_allclose(mass_matrix(mechanism, q), expected, rtol=0, atol=1e-13 * M.max())


def test_urdf_on_a_free_base(robot: Path) -> None:
    pin = pytest.importorskip("pinocchio", reason="Pinocchio is not installed on this platform")
    mechanism, report = read_mechanism(str(robot), base="free")
    assert mechanism.coordinates.names[:4] == ("base.x", "base.y", "base.z", "base.qw")
    assert any("floats" in remark.what for remark in report.assumed)
    model = pin.buildModelFromUrdf(str(robot), pin.JointModelFreeFlyer())
    q = np.array([0.4, -0.3, 0.9])
    own = np.array([0, 0, 0, 1, 0, 0, 0, *q])  # unturned, where velocities of both agree
    theirs = np.array([0, 0, 0, 0, 0, 0, 1, *q[:2], np.cos(q[2]), np.sin(q[2])])
    M = np.triu(pin.crba(model, model.createData(), theirs))
    expected = M + np.triu(M, 1).T
    np.testing.assert_allclose(mass_matrix(mechanism, own), expected, rtol=0, atol=1e-13 * M.max())


def test_path_spec_and_model_are_the_same(tmp_path: Path) -> None:
    text = (
        "<mujoco model='arm'><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>"
    )
    path = tmp_path / "arm.xml"
    path.write_text(text)
    spec = mujoco.MjSpec.from_string(text)
    made = [read_mechanism(source)[0] for source in (path, str(path), spec, spec.compile())]
    assert {mechanism.hash for mechanism in made} == {made[0].hash}
    assert {mechanism.name for mechanism in made} == {"arm"}
    assert max(differences(mujoco, spec.compile(), made[0]).values()) < 1e-12


BAD = {
    "missing.xml": (None, "does not exist"),
    "model.scn": ("<sdf/>", r"expected \.xml"),
    "broken.xml": ("<mujoco><worldbody>", "MuJoCo cannot compile broken.xml"),
    "unknown.xml": ("<mujoco><oops/></mujoco>", "oops"),
    "broken.urdf": ("<robot name='r'><link", "model file 'broken.urdf' is not XML"),
    "binary.urdf": (b"\xff\xfe\x00\x01", "cannot be read"),
    "plate.urdf": (
        "<robot name='r'><link name='a'/><link name='b'><inertial><mass value='1'/><inertia ixx='1' "
        "iyy='1' izz='-9' ixy='0' ixz='0' iyz='0'/></inertial></link><joint name='j' type='continuous'>"
        "<parent link='a'/><child link='b'/></joint></robot>",
        "link 'b'.*-9",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files(tmp_path: Path, name: str) -> None:
    text, message = BAD[name]
    if text is not None:
        (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError, match=message):
        read_mechanism(tmp_path / name)


def test_bad_arguments(robot: Path) -> None:
    with pytest.raises(InputError, match="found int"):
        read_mechanism(3)
    with pytest.raises(InputError, match="'hard'"):
        read_mechanism(robot, equality="hard")
    with pytest.raises(InputError, match="'floating'"):
        read_mechanism(robot, base="floating")


def test_without_mujoco_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch, robot: Path) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(InputError, match=r'pip install "deltac\[mujoco\]"'):
        read_mechanism(robot)


def test_a_few_lines_that_ask_for_millions_of_bodies(tmp_path: Path) -> None:
    path = tmp_path / "bomb.xml"
    path.write_text(
        "<mujoco><worldbody><replicate count='3000' offset='1 0 0'><replicate count='3000' offset='0 1 0'>"
        "<body><freejoint/><geom size='.1'/></body></replicate></replicate></worldbody></mujoco>"
    )
    with (
        Limits(seconds=1).applied(),
        pytest.raises(InputError, match=r"bomb\.xml.*(seconds|crashes MuJoCo|GB)"),
    ):
        read_mechanism(path)
