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


def slides(*constraints: object, count: int = 3) -> dc.Mechanism:
    """Point masses on straight rails, named a, b, c, …: q and u are their places and speeds."""
    names = "abcdefgh"[:count]
    return dc.Mechanism(
        [dc.point_mass(f"mass {n}", 1.0) for n in names],
        [dc.prismatic(n, "ground", f"mass {n}", "x") for n in names],
        constraints=list(constraints),  # type: ignore[arg-type]
    )


# φ(q, t), φ̇ by hand, and whether φ depends on time.
BOTH_FORMS = {
    "gear": ("q.a - 2*q.b", "u.a - 2*u.b", False),
    "lock": ("q.a - 0.3", "u.a", False),
    "circle": ("q.a**2 + q.b**2 - 1", "2*q.a*u.a + 2*q.b*u.b", False),
    "cam": ("q.a - 0.2*sin(q.b)", "u.a - 0.2*cos(q.b)*u.b", False),
    "plane": ("q.a + 2*q.b - q.c - 0.5", "u.a + 2*u.b - u.c", False),
    "growing factor": ("exp(t)*(q.a - q.b)", "exp(t)*(u.a - u.b)", False),
    "swaying factor": ("(2 + sin(t))*(q.a - q.b)", "(2 + sin(t))*(u.a - u.b)", False),
    "drive": ("q.a - sin(0.75*t)", "u.a - 0.75*cos(0.75*t)", True),
    "conveyor": ("q.a - t", "u.a - 1", True),
    "moving circle": (
        "q.a**2 + (q.b - 0.1*t)**2 - 1",
        "2*q.a*u.a + 2*(q.b - 0.1*t)*(u.b - 0.1)",
        True,
    ),
    "driven cam": ("q.a - 0.2*sin(q.b + 3*t)", "u.a - 0.2*cos(q.b + 3*t)*(u.b + 3)", True),
    "growing drive": (
        "exp(t)*(q.a - q.b - t)",
        "exp(t)*(q.a - q.b - t) + exp(t)*(u.a - u.b - 1)",
        True,
    ),
    "slow drive": ("q.a - 1e-7*t", "u.a - 1e-7", True),
    "fast drive": ("q.a - 1e-6*sin(1e5*t)", "u.a - 0.1*cos(1e5*t)", True),
}


@pytest.mark.parametrize("name", BOTH_FORMS)
def test_the_class_does_not_depend_on_how_a_constraint_is_written(name: str) -> None:
    """Appendix A of the thesis, table 1 (l. 5342): f(q) = 0 is scleronomic, f(q, t) = 0 rheonomic."""
    position, velocity, timed = BOTH_FORMS[name]
    forms = [
        dc.constraints.holonomic(name, position),
        dc.constraints.motion_constraint(name, velocity),
    ]
    for form in forms:
        system = dc.classify(slides(form))
        assert system.kind == "holonomic, " + ("rheonomic" if timed else "scleronomic")
        assert system.scleronomic is system.catastatic is not timed
        assert system.moving == ((name,) if timed else ())
        assert system.freedom == 2
        assert (f"acatastatic, v_t ≠ 0: {name}" in system.explain()) is timed


@pytest.mark.parametrize("drive", ["motion", "torque", "constraint"])
def test_the_driven_triple_pendulum_is_rheonomic_however_it_is_driven(drive: str) -> None:
    """(3.2.26); as an applied torque the drive is a force, and no constraint moves."""
    system = dc.classify(dc.problems.load("triple-pendulum", drive=drive))
    assert system.kind == "holonomic, " + ("scleronomic" if drive == "torque" else "rheonomic")
    assert system.catastatic is (drive == "torque")


def test_a_prescribed_joint_that_rests_is_scleronomic() -> None:
    for motion, scleronomic in (("0.4", True), ("0.4 + 0*t", True), ("0.4*t", False)):
        hinge = dc.revolute("hinge", "ground", "bob", "z", motion=motion)
        system = dc.classify(replace(pendulum(), joints=[hinge]))
        assert system.scleronomic is scleronomic, motion


def test_rheonomic_and_nonholonomic_together() -> None:
    """A skate on a moving plane is acatastatic; only a configuration constraint makes it rheonomic."""
    skate = dc.constraints.motion_constraint("skate", "cos(q.c)*u.b - sin(q.c)*(u.a - 0.5)")
    system = dc.classify(slides(skate))
    assert system.kind == "nonholonomic, scleronomic, acatastatic" and system.moving == ("skate",)
    drive = dc.constraints.motion_constraint("drive", "u.d - cos(t)")
    system = dc.classify(slides(skate, drive, count=4))
    assert system.kind == "nonholonomic, rheonomic, acatastatic"
    assert system.integrable == ("drive",) and system.motion_constraints == ("skate",)


def test_engels_forms_have_no_integrable_row() -> None:
    """A car with a trailer: d(db − c da) vanishes with dc − d da, yet neither form integrates."""
    forms = {"first": "u.b - q.c*u.a", "second": "u.c - q.d*u.a"}
    rows = [dc.constraints.motion_constraint(*item) for item in forms.items()]
    system = dc.classify(slides(*rows, count=4))
    assert system.motion_constraints == ("first", "second") and system.integrable == ()


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


def test_what_is_not_sought_in_a_long_chain_is_told() -> None:
    count = 400
    chain = dc.Mechanism(
        bodies=[dc.rod(f"b{k}", 1.0, 1.0) for k in range(count)],
        joints=[
            dc.revolute(
                f"j{k}", f"b{k - 1}" if k else "ground", f"b{k}", position=(float(k > 0), 0, 0)
            )
            for k in range(count)
        ],
        gravity=(0, -9.81, 0),
    )
    found = dc.classify(chain)
    assert (found.freedom, found.kind) == (count, "holonomic, scleronomic")
    assert (found.constant, found.energies) == ((), {}) and found.unexamined
    assert not dc.classify("double-pendulum").unexamined


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
