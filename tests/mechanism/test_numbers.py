"""Numbers of a mechanism by name: what they are of, and that other values do what they say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import deltac as dc

MODEL = """
<mujoco model="leg"><option gravity="0 0 -9.81" integrator="RK4" timestep="0.001"/>
 <worldbody><body name="thigh" pos="0 0 1">
  <joint name="hip" axis="0 1 0" damping="0.1" armature="0.01"/>
  <geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.04" mass="3" contype="0"/>
  <body name="left-shank" pos="0 0 -0.4"><joint name="knee" axis="0 1 0" stiffness="2"/>
   <geom type="capsule" fromto="0 0 0 0.1 0 -0.4" size="0.03" mass="2" contype="0"/></body></body></worldbody>
</mujoco>"""
OTHER = {
    "body.left-shank.mass": 3.3,
    "body.left-shank.mass_centre.x": 0.03,
    "joint.hip.damping": 0.4,
    "joint.hip.armature": 0.05,
    "joint.knee.stiffness": 5.0,
    "joint.knee.position.z": -0.5,
    "gravity": 1.62,
}


@pytest.fixture(scope="module")
def leg(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("mujoco", reason="reads the model")
    path = tmp_path_factory.mktemp("numbers") / "leg.xml"
    path.write_text(MODEL)
    return path


def test_other_values_move_the_model_as_mujoco_with_the_same(leg: Path) -> None:
    import mujoco

    mechanism = dc.load_model(leg).mechanism
    changed = mechanism.with_parameters(**OTHER)
    run = dc.simulate(changed, changed.state({"hip": 0.5, "knee": -0.3}), 0.2, 1e-3, "ode4")
    model = mujoco.MjModel.from_xml_path(str(leg))
    shank = model.body("left-shank")
    shank.mass, shank.ipos[0], shank.pos[2] = 3.3, 0.03, -0.5
    model.dof_damping[0], model.dof_armature[0] = 0.4, 0.05
    model.jnt_stiffness[1], model.opt.gravity[2] = 5.0, -1.62
    data = mujoco.MjData(model)
    mujoco.mj_setConst(model, data)
    data.qpos[:] = 0.5, -0.3
    for _ in range(200):
        mujoco.mj_step(model, data)
    assert run.q[-1] == pytest.approx(data.qpos, abs=1e-12)  # the same method, rounded otherwise
    both = {name: [mechanism.numbers[name], value] for name, value in OTHER.items()}
    members = dc.simulate_ensemble(
        mechanism, changed.state({"hip": 0.5, "knee": -0.3}), 0.2, 1e-3, "ode4", vary=both
    )
    assert members.q[-1, 1] == pytest.approx(run.q[-1], abs=1e-12)
    assert np.abs(members.q[-1, 0] - run.q[-1]).max() > 1e-3


def test_every_number_can_be_opened_and_nothing_changes(leg: Path) -> None:
    mechanism = dc.load_model(leg).mechanism
    opened = mechanism.opened(*(n for n in mechanism.numbers if not n.startswith("gravity.")))
    state = mechanism.state({"hip": 0.7, "knee": 0.2}, {"hip": 1.0, "knee": -2.0})
    a, b = (dc.evaluate(m, state).udot for m in (mechanism, opened))
    assert a == pytest.approx(b, rel=1e-12)
    for name in opened.parameters:
        assert opened.numbers[name] == mechanism.numbers[name]


def test_two_dampers_of_a_joint_have_names_of_their_own() -> None:
    arm = dc.Mechanism(
        [dc.body("arm", 1.0, (1, 1, 1))],
        [dc.revolute("hinge", "ground", "arm")],
        [dc.forces.joint_damper("oil", "hinge", 0.1), dc.forces.joint_damper("air", "hinge", 0.2)],
    )
    assert arm.numbers["joint.hinge.damping"] == 0.1
    assert arm.numbers["force.air.damping"] == 0.2


@pytest.mark.parametrize(
    ("name", "value", "code", "near"),
    [
        ("body.left-shnk.mass", 1.0, "E-NAME", "body.left-shank.mass"),
        ("gravty", 1.0, "E-NAME", "gravity"),
        ("body.thigh.mass", -1.0, "E-MODEL", "thigh"),
        ("joint.hip.damping", float("nan"), "E-MODEL", "joint.hip.damping"),
    ],
)
def test_a_wrong_name_or_value_is_refused(
    name: str, value: float, code: str, near: str, leg: Path
) -> None:
    with pytest.raises(dc.InputError, match=near) as refused:
        dc.load_model(leg).mechanism.with_parameters(**{name: value})
    assert refused.value.code == code


def test_the_command_line_sets_and_lists_them(
    leg: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import json

    from tests.support.commands import command as run

    status, out, _ = run(
        "describe", str(leg), "--set", "gravity=1.62", "--numbers", "--json", capsys=capsys
    )
    assert status == 0 and json.loads(out)["gravity"] == 1.62
    status, out, err = run("study", str(leg), "--set", "gravity=low", capsys=capsys)
    assert status == 2 and "NAME=NUMBER" in err
