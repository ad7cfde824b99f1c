"""SDFormat files against Drake's own parser, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import deltac as dc

FILE = Path(__file__).parent / "arm.sdf"


def test_what_is_read() -> None:
    mechanism, report = dc.read_mechanism(FILE)
    assert mechanism.name == "walker"
    assert mechanism.coordinates.names[-2:] == ("hip", "extension")
    assert [r.what for r in report.ignored] == ["limits"]
    assert {r.element for r in report.assumed} == {"base", "world"}
    state = dc.load_model(str(FILE)).start()
    assert state.q[:3] == pytest.approx([0.1, -0.2, 0.5])


def test_mass_matrix_gravity_and_damping_are_drakes() -> None:
    parsing = pytest.importorskip("pydrake.multibody.parsing", reason="Drake is not installed")
    from pydrake.multibody.plant import MultibodyPlant

    plant = MultibodyPlant(0.0)
    parsing.Parser(plant).AddModels(str(FILE))
    plant.mutable_gravity_field().set_gravity_vector([0, 0, -9.8])
    plant.Finalize()
    context = plant.CreateDefaultContext()
    mechanism, _ = dc.read_mechanism(FILE)
    rng = np.random.default_rng(3)
    for _ in range(3):
        quaternion = rng.standard_normal(4)
        quaternion /= np.linalg.norm(quaternion)
        place, joints, joint_rates = (
            rng.standard_normal(3),
            rng.uniform(-1, 1, 2),
            rng.standard_normal(2),
        )
        velocity, spin = (
            rng.standard_normal(3),
            rng.standard_normal(3),
        )  # of the body's origin, in world axes
        R = _matrix(quaternion)
        plant.SetPositions(context, [*quaternion, *place, *joints])
        plant.SetVelocities(context, [*spin, *velocity, *joint_rates])
        q = {f"base.q{k}": x for k, x in zip("wxyz", quaternion)}
        q |= {f"base.{k}": x for k, x in zip("xyz", place)} | {
            "hip": joints[0],
            "extension": joints[1],
        }
        u = {f"base.v{k}": x for k, x in zip("xyz", velocity)}
        u |= {f"base.w{k}": x for k, x in zip("xyz", R.T @ spin)}
        u |= {"hip": joint_rates[0], "extension": joint_rates[1]}
        found = dc.evaluate(mechanism, mechanism.state(q, u))
        assert found.kinetic == pytest.approx(plant.CalcKineticEnergy(context), rel=1e-12)
        potential = plant.CalcPotentialEnergy(context)
        assert sum(found.potential.values()) == pytest.approx(potential, rel=1e-12)
        # Accelerations: gravity, gyroscopic terms and the damper at once.
        derivatives = plant.AllocateTimeDerivatives()
        plant.CalcTimeDerivatives(context, derivatives)
        theirs = derivatives.CopyToVector()[-8:]
        assert found.udot[-2:] == pytest.approx(theirs[-2:], rel=1e-9)


def _matrix(q: np.ndarray) -> np.ndarray:
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


MODEL = "<sdf version='1.9'><model name='m'>{}</model></sdf>"
LINK = "<link name='{}'/>"
JOINT = "<joint name='j' type='{}'><parent>world</parent><child>{}</child></joint>"


@pytest.mark.parametrize(
    "text",
    [
        "<sdf",
        "<robot/>",
        "<sdf version='1.9'/>",
        MODEL.format(""),
        MODEL.format(LINK.format("a") + LINK.format("a")),
        MODEL.format("<include><uri>model://x</uri></include>" + LINK.format("a")),
        MODEL.format(LINK.format("a") + JOINT.format("revolute", "b")),
        MODEL.format(LINK.format("a") + JOINT.format("gearbox", "a")),
        MODEL.format("<link name='a'><pose>1 2 3</pose></link>"),
        MODEL.format("<link name='a'><pose relative_to='b'>0 0 0 0 0 0</pose></link>"),
        MODEL.format("<link name='a'><inertial><mass>x</mass></inertial></link>"),
        MODEL.format(
            LINK.format("a") + "<joint name='j' type='fixed'><parent>a</parent><child>a</child></joint>"
        ),
        MODEL.format(
            LINK.format("a") + JOINT.format("fixed", "a")
            + "<joint name='k' type='gearbox'><parent>world</parent><child>a</child></joint>"
        ),
        "<!DOCTYPE x><sdf version='1.9'/>",
    ],
)  # fmt: skip
def test_files_that_are_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "model.sdf"
    path.write_text(text)
    with pytest.raises(dc.InputError) as refused:
        dc.load_model(str(path))
    assert refused.value.code == "E-MODEL"


def test_mimic_joints_and_transmissions_of_urdf(tmp_path: Path) -> None:
    pytest.importorskip("mujoco", reason="MuJoCo reads URDF")
    link = (
        "<link name='{}'><inertial><mass value='1'/><origin xyz='0.1 0 0'/>"
        "<inertia ixx='.01' iyy='.01' izz='.01' ixy='0' ixz='0' iyz='0'/></inertial></link>"
    )
    joint = (
        "<joint name='{0}' type='continuous'><parent link='base'/><child link='{1}'/>"
        "<axis xyz='0 1 0'/>{2}</joint>"
    )
    text = (
        "<robot name='grip'><link name='base'/>" + link.format("l") + link.format("r")
        + joint.format("left", "l", "") + joint.format("right", "r", "<mimic joint='left' multiplier='-2'/>")
        + "<transmission name='t'><joint name='left'/><actuator name='motor'/></transmission></robot>"
    )  # fmt: skip
    path = tmp_path / "grip.urdf"
    path.write_text(text)
    mechanism, report = dc.read_mechanism(path)
    run = dc.simulate(mechanism, mechanism.state({"left": 0.1, "right": -0.2}), 0.5, 0.01)
    assert run.coordinate("right") == pytest.approx(-2 * run.coordinate("left"), abs=1e-9)
    assert np.ptp(run.coordinate("left")) > 0.1
    assert any("transmission" in remark.what for remark in report.ignored)


@pytest.mark.parametrize(
    "name", ["robot.urdf.xacro", "robot.xacro", "leg.osim", "arm.slx", "arm.usd"]
)
def test_files_that_are_no_models_here(name: str) -> None:
    with pytest.raises(dc.InputError) as refused:
        dc.load_model(name)
    assert refused.value.code == "E-MODEL"


def test_unexpanded_macros(tmp_path: Path) -> None:
    pytest.importorskip("mujoco", reason="MuJoCo reads URDF")
    path = tmp_path / "robot.urdf"
    path.write_text(
        "<robot name='r' xmlns:xacro='http://www.ros.org/wiki/xacro'><link name='a'/><xacro:leg/></robot>"
    )
    with pytest.raises(dc.InputError, match="xacro robot.urdf > ") as refused:
        dc.read_mechanism(path)
    assert refused.value.code == "E-MODEL"


FINGERS = """<sdf version='1.11'><model name='grip'><static>true</static>
<link name='palm'/>{}</model></sdf>"""
FINGER = """<link name='{0}'><inertial><mass>1</mass><pose>0.1 0 0 0 0 0</pose>
<inertia><ixx>.01</ixx><iyy>.01</iyy><izz>.01</izz></inertia></inertial></link>
<joint name='{0}_hinge' type='revolute'><parent>palm</parent><child>{0}</child>
<axis><xyz>0 1 0</xyz>{1}</axis></joint>"""
MIMIC = "<mimic joint='{}'><multiplier>-2</multiplier><offset>0.3</offset><reference>0.1</reference></mimic>"


def test_mimic_joints(tmp_path: Path) -> None:
    path = tmp_path / "grip.sdf"
    path.write_text(
        FINGERS.format(FINGER.format("l", "") + FINGER.format("r", MIMIC.format("l_hinge")))
    )
    loaded = dc.load_model(path)
    start = loaded.start()  # at r = -2 (0 - 0.1) + 0.3
    assert loaded.mechanism.coordinates.names == ("l_hinge", "r_hinge")
    assert start.q == pytest.approx([0.0, 0.5])
    run = dc.simulate(loaded, start, 0.5, 0.01)
    left, right = run.coordinate("l_hinge"), run.coordinate("r_hinge")
    assert right == pytest.approx(-2 * (left - 0.1) + 0.3, abs=1e-9)
    assert np.ptp(left) > 0.1


@pytest.mark.parametrize(
    "fingers",
    [
        FINGER.format("l", "") + FINGER.format("r", MIMIC.format("x_hinge")),
        FINGER.format("l", MIMIC.format("r_hinge")) + FINGER.format("r", MIMIC.format("l_hinge")),
    ],
)
def test_mimic_joints_that_are_refused(fingers: str, tmp_path: Path) -> None:
    path = tmp_path / "grip.sdf"
    path.write_text(FINGERS.format(fingers))
    with pytest.raises(dc.InputError) as refused:
        dc.read_mechanism(path)
    assert refused.value.code == "E-MODEL"


def test_a_base_that_floats_is_told_with_the_path(tmp_path: Path) -> None:
    pytest.importorskip("mujoco", reason="MuJoCo reads URDF")
    path = tmp_path / "box.urdf"
    inertia = "<inertia ixx='.1' iyy='.1' izz='.1' ixy='0' ixz='0' iyz='0'/>"
    link = f"<inertial><mass value='1'/>{inertia}</inertial>"
    path.write_text(f"<robot name='box'><link name='box'>{link}</link></robot>")
    assert "base.z" in dc.load_model(f"{path}:free").mechanism.coordinates.names
    assert not dc.load_model(f"{path}:fixed").mechanism.coordinates.names
    run = dc.run_mujoco(f"{path}:free", duration=0.1)
    assert run.coordinate("base.z")[-1] < 0.0
    with pytest.raises(dc.InputError) as refused:
        dc.load_model(f"{tmp_path / 'box.sdf'}:free")
    assert refused.value.code == "E-MODEL"


@pytest.mark.parametrize("kind", ["ball", "universal"])
def test_what_acts_in_joints_of_several_axes_is_told(kind: str, tmp_path: Path) -> None:
    dynamics = "<dynamics><damping>0.2</damping><spring_stiffness>3</spring_stiffness></dynamics>"
    axes = f"<axis><xyz>1 0 0</xyz></axis><axis2><xyz>0 1 0</xyz>{dynamics}</axis2>"
    path = tmp_path / "log.sdf"
    path.write_text(
        f'<sdf version="1.9"><model name="m"><link name="a"/><joint name="j" type="{kind}">'
        f"<parent>world</parent><child>a</child>{axes}</joint></model></sdf>"
    )
    mechanism, report = dc.read_mechanism(path)
    assert not mechanism.forces
    assert {r.consequence.partition("channel ")[2] for r in report.ignored} == {
        "'damper j'",
        "'spring j'",
    }


TWO = """<sdf version="1.9"><world name="w"><gravity>0 0 -9.81</gravity>
  <model name="left"><link name="a"><inertial><mass>2</mass></inertial></link></model>
  <model name="right"><link name="b"><inertial><mass>MASS</mass></inertial></link></model>
</world></sdf>"""


def test_one_of_several_models_by_name(tmp_path: Path) -> None:
    (path := tmp_path / "two.sdf").write_text(TWO.replace("MASS", "3"))
    masses = [
        [b.mass for b in dc.load_model(f"{path}:{name}").mechanism.bodies]
        for name in ("left", "right")
    ]
    assert masses == [[2.0], [3.0]]
    assert dc.read_mechanism(f"{path}:right")[0].bodies[0].name == "b"
    with pytest.raises(dc.InputError, match="two.sdf:left, two.sdf:right"):
        dc.load_model(str(path))
    with pytest.raises(dc.InputError, match="no model 'righ'; did you mean 'right'"):
        dc.load_model(f"{path}:righ")


def test_a_link_without_mass_names_a_remedy(tmp_path: Path) -> None:
    (path := tmp_path / "two.sdf").write_text(TWO.replace("MASS", "0"))
    with pytest.raises(dc.InputError, match="link 'b' has mass 0, expected a positive one; give"):
        dc.load_model(f"{path}:right")
