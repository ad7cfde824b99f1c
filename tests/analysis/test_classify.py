"""The class of mechanisms: of the problem library by what is published, of small ones by construction."""

from __future__ import annotations

from dataclasses import replace

import pytest

import deltac as dc
from tests.systems.constrained_mechanisms import four_bar, parallelogram
from tests.systems.machines import pendulum

KINDS = {
    "double-pendulum": "holonomic, scleronomic",
    "driven-pendulum": "holonomic, rheonomic",
    "bead-on-hoop": "holonomic, rheonomic",
    "andrews-squeezer": "holonomic, scleronomic",
    "chaplygin-sleigh": "nonholonomic, scleronomic, catastatic",
    "knife-edge": "nonholonomic, scleronomic, catastatic",
    "rolling-disc": "nonholonomic, scleronomic, catastatic",
    "disc-on-moving-plane": "nonholonomic, scleronomic, acatastatic",
    "bicycle": "nonholonomic, scleronomic, catastatic",
}


@pytest.mark.parametrize("name", KINDS)
def test_kinds_of_published_problems(name: str) -> None:
    problem = dc.problems.load(name)
    found = dc.classify(problem)
    assert found.kind == KINDS[name]
    assert found.freedom == problem.freedom
    assert ("energy" in found.constant) == ("energy" in problem.conserved)


def test_a_prescribed_rotation_keeps_jacobis_integral() -> None:
    found = dc.classify("bead-on-hoop")
    assert found.constant[0] == "Jacobi integral" and "energy" not in found.constant
    assert not found.catastatic and found.coincide == ()


def test_momenta_of_a_free_body() -> None:
    """In free fall all but the components that gravity has a moment or a force in."""
    mechanism = dc.Mechanism(
        [dc.bodies.box("box", 1.0, [0.1, 0.2, 0.3])], [dc.free("f", "box")], gravity=[0, 0, -9.81]
    )
    assert dc.classify(mechanism).constant == ("energy", "linear x f", "linear y f", "angular z f")
    afloat = replace(mechanism, gravity=(0.0, 0.0, 0.0))
    assert len(dc.classify(afloat).constant) == 7


def test_losses_and_motors() -> None:
    damped = replace(pendulum(), joints=[dc.revolute("hinge", "ground", "bob", "z", damping=0.1)])
    found = dc.classify(damped)
    assert found.constant == () and found.nonpotential == ("damper hinge",)
    driven = replace(pendulum(), forces=[dc.forces.joint_torque("motor", "hinge")])
    assert dc.classify(driven).nonpotential == ("actuator motor",)


def test_an_integrable_constraint_on_speeds_is_holonomic() -> None:
    """u_x = 2 u_y is a gear in disguise; a skate is not."""
    wheels = dc.Mechanism(
        [dc.bodies.sphere(n, 1.0, 0.1) for n in "xy"],
        [dc.revolute(n, "ground", n) for n in "xy"],
        constraints=[dc.constraints.motion_constraint("mesh", "u.x - 2*u.y")],
    )
    found = dc.classify(wheels)
    assert found.holonomic and found.integrable == ("mesh",) and found.freedom == 1
    assert found.kind == "holonomic, scleronomic"
    assert dc.classify("knife-edge").motion_constraints


def test_redundant_rows_are_counted() -> None:
    found = dc.classify("bricard")
    assert found.freedom == 1 and found.redundant
    flat = dc.classify(four_bar(), four_bar().state(parallelogram(1.0)))
    assert flat.freedom == 1 and flat.redundant == ""


def test_coinciding_functions() -> None:
    found = dc.classify("double-pendulum")
    assert found.coincide == (("kane-levinson-1988", "kane-levinson-1990", "wang"),)
    assert "liu-huston" in found.testing_functions
    assert "kane-levinson-1988" not in dc.classify("bicycle").testing_functions


def test_json() -> None:
    import json

    known = json.loads(json.dumps(dc.classify("bicycle").to_dict()))
    assert known["freedom"] == 3 and known["joints"][0]["kind"] == "free"


def test_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    import json

    from deltac import cli

    with pytest.raises(SystemExit) as ended:
        cli.main(["describe", "double-pendulum", "--state", "joint1=30deg", "--json"])
    told = json.loads(capsys.readouterr().out)
    assert ended.value.code == 0 and told["kind"] == "holonomic, scleronomic"
    with pytest.raises(SystemExit) as ended:
        cli.main(["describe", "no-such-model"])
    assert ended.value.code == 2
