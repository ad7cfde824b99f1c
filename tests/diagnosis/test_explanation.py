"""`explain_residual`: faults planted in runs are named, with their size, or it says why not.

What a fault changes is known to all digits, so without noise the numbers must be the planted ones: to
1e-6, a decade above the share of the terms at which solvers are allowed to stop (1e-7).
"""

from __future__ import annotations

import copy
import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import deltac as dc

mujoco = pytest.importorskip("mujoco", reason="the extra 'mujoco' is not installed")

from tests.support.slow import crossed, repeated  # noqa: E402
from tests.systems.mujoco_models import ARM, BOX, arm_run, box_run, model_of, scaled, with_changes  # noqa: E402

pytestmark = pytest.mark.case_study("test_arguments_that_make_no_sense")

EXACT = 1e-6
NOISE = 1e-4


def noisy(run: dc.Trajectory, relative: float, seed: int = 0) -> dc.Trajectory:
    rng = np.random.default_rng(seed)

    def shaken(x: Any) -> Any:
        return x + relative * np.sqrt(np.mean(x**2, axis=0)) * rng.standard_normal(x.shape)

    assert run.udot is not None
    forces = {n: shaken(f) for n, f in run.forces.items()}
    return replace(run, q=shaken(run.q), u=shaken(run.u), udot=shaken(run.udot), forces=forces)


def the_cause(found: dc.Explanation, kind: str, element: str) -> dc.Cause:
    """The only cause, of that kind and element; no other does as well."""
    assert found.kind == "explained", str(found)
    assert [(c.kind, c.element) for c in found.causes] == [(kind, element)], str(found)
    return found.causes[0]


# --- the right model ----------------------------------------------------------------------------------


@pytest.mark.parametrize(("relative", "measured"), crossed((0.0, NOISE), (False, True)))
def test_nothing_is_blamed_for_a_right_log(relative: float, measured: bool) -> None:
    run = noisy(arm_run(), relative)
    found = dc.explain_residual(model_of(ARM), run if measured else replace(run, udot=None))
    assert found.kind == "nothing", str(found)
    assert found.causes == ()


# --- one cause ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("solver", repeated(["ode1", "semi-implicit-euler"], "ode1"))
def test_what_a_method_of_first_order_makes_of_the_cause_is_no_other_cause(solver: str) -> None:
    """Euler's methods take a force at one end of a step: of a damper's h/2 times its rate is left."""

    def pendulum(damping: float | None) -> dc.Mechanism:
        hinge = dc.revolute("hinge", "ground", "rod", axis="y", damping=damping)
        return dc.Mechanism([dc.rod("rod", 1.0, 0.6)], [hinge], gravity=(0, 0, -9.81))

    damped = pendulum(0.1)
    run = dc.simulate(damped, damped.state({"hinge": 0.5}), 2.0, 1e-3, solver)
    rows = dc.Trajectory(t=run.t, q=run.q, u=run.u, coordinates=("hinge",), speeds=("hinge",))
    cause = the_cause(dc.explain_residual(pendulum(None), rows), "missing-damper", "hinge")
    assert cause.values[0] == pytest.approx(0.1, rel=5e-3)  # h c/J = 8e-4 of it


def test_the_mass_of_a_body() -> None:
    model = with_changes(ARM, body_mass=[1, 1, 1 / 1.02])
    cause = the_cause(dc.explain_residual(model, arm_run()), "body-mass", "lower")
    assert cause.values[0] == pytest.approx(1.02, rel=EXACT)
    assert "the mass of `lower` in the run is 1.02 times the model's: 2 % larger" in str(cause)


def test_a_mass_centre_that_moved_far() -> None:
    """Moments of inertia change by the square of it: a tangent alone would be off by a fifth."""
    model = copy.copy(model_of(ARM))
    model.body_ipos[2, 0] -= 0.06
    cause = the_cause(dc.explain_residual(model, arm_run()), "body-centre", "lower")
    assert cause.names == ("x",)
    assert cause.values[0] == pytest.approx(0.06, rel=EXACT)


def test_gravity_of_another_size_and_direction() -> None:
    cause = the_cause(
        dc.explain_residual(with_changes(ARM, gravity=9.8), arm_run()), "gravity", "gravity"
    )
    assert 9.8 * cause.values[0] == pytest.approx(9.81, rel=EXACT)
    tilted = copy.copy(model_of(ARM))
    tilted.opt.gravity[:] = [0.3, 0.0, -9.7]
    found = dc.explain_residual(tilted, arm_run())
    values = {c.names: c.values for c in found.causes if c.kind == "gravity-vector"}
    assert list(values) == [("x", "z")]  # the arm swings in that plane
    assert values["x", "z"] == pytest.approx((0.0, -9.81), rel=EXACT, abs=1e-6)


@pytest.mark.slow  # by its audit: tests/diagnosis/test_audit.py
def test_a_motor_that_delivers_half() -> None:
    found = dc.explain_residual(model_of(ARM), scaled(arm_run(), "actuator m1", 2.0))
    cause = the_cause(found, "actuator-gear", "actuator m1")
    assert cause.values[0] == pytest.approx(0.5, rel=EXACT)
    assert "`actuator m1` delivers 0.5 of its logged force" in str(found)


def test_a_motor_that_acts_late() -> None:
    """f(t − τ) of a sine; the parabola in τ is off by τ³ω³/6, with ω = 3 rad/s: 3e-5 of τ."""
    run, late = arm_run(), 0.008
    forces = dict(run.forces)
    f = forces["actuator m1"].copy()
    f[:, 0] = 0.9 * np.sin(3.0 * (run.t + late))  # commanded so much before; gear 3 × 0.3
    assert np.allclose(forces["actuator m1"][:, 0], 0.9 * np.sin(3.0 * run.t), atol=1e-9)
    found = dc.explain_residual(model_of(ARM), replace(run, forces={**forces, "actuator m1": f}))
    cause = the_cause(found, "actuator-delay", "actuator m1")
    assert cause.values[0] == pytest.approx(late, rel=1e-3)


def test_a_rest_angle_and_a_stiffness() -> None:
    sprung = ARM.replace('damping="0.02"', 'damping="0.02" stiffness="1.5" springref="20"')
    run = dc.run_mujoco(model_of(sprung), 1.0, integrator="rk4")
    other = with_changes(sprung, qpos_spring=[1.0, 1.5])
    cause = the_cause(dc.explain_residual(other, run), "rest-angle", "elbow")
    assert cause.values[0] == pytest.approx(np.radians(20.0), rel=EXACT)
    softer = with_changes(sprung, jnt_stiffness=[1.0, 0.8])
    cause = the_cause(dc.explain_residual(softer, run), "stiffness", "elbow")
    assert (cause.values[0], cause.model[0]) == pytest.approx((1.5, 1.2), rel=EXACT)


def test_a_force_at_a_point_of_a_floating_body() -> None:
    """It acts off the mass centre, along the body: a thrust, and a moment of the body."""
    thruster = dc.Mechanism(
        bodies=[dc.bodies.box("hull", 2.0, (0.4, 0.3, 0.2))],
        joints=[dc.free("hull", "hull")],
        forces=[
            dc.forces.point_force("jet", "hull", (0.0, 3.0, 0.0), (0.1, 0.0, 0.0), frame="body")
        ],
        gravity=(0, 0, -9.81),
    )
    start = thruster.state(speeds={"hull": [0, 0, 5, 0.5, 1.0, 2.0]})
    run = dc.simulate(thruster, start, 1.0, 2e-3, solver="ode5")
    found = dc.explain_residual(replace(thruster, forces=()), replace(run, forces={}))
    assert {(c.kind, c.names) for c in found.causes} == {
        ("thrust", ("y",)),
        ("body-torque", ("z",)),
    }
    by_kind = {c.kind: c.values[0] for c in found.causes}
    assert by_kind["thrust"] == pytest.approx(3.0, rel=EXACT)
    assert by_kind["body-torque"] == pytest.approx(0.3, rel=EXACT)


@pytest.mark.parametrize(
    ("moved", "heavier"),
    [
        (0.05, 1.3),
        pytest.param(0.01, 1.02, marks=pytest.mark.slow),
        pytest.param(-0.06, 0.8, marks=pytest.mark.slow),
    ],
)
def test_a_body_that_is_heavier_and_has_its_mass_centre_elsewhere(
    moved: float, heavier: float
) -> None:
    """The product of both is in the residual: to first order, 0.05 m and 1.3 look like 0.065 m and 1.6."""
    model = copy.copy(model_of(ARM))
    model.body_ipos[2, 0] -= moved
    model.body_mass[2] /= heavier
    found = dc.explain_residual(model, arm_run())
    assert found.kind == "explained", str(found)
    values = {(c.kind, c.element, c.names): c.values[0] for c in found.causes}
    planted = {
        ("body-centre", "lower", ("x",)): moved,
        ("body-mass", "lower", ("factor",)): heavier,
    }
    assert values == pytest.approx(planted, rel=EXACT)
    assert f"is displaced by {moved:g} " in str(found)  # without brackets


def test_another_mass_centre_mass_and_inertia_of_one_body() -> None:
    """One by one none of them explains much: body by body they are tried together."""
    model = with_changes(ARM, body_mass=[1, 1, 1 / 1.1], body_inertia=[1, 1, 1 / 1.2])
    model.body_ipos[2, 0] -= 0.02
    found = dc.explain_residual(model, arm_run())
    values = {c.kind: c.values[0] for c in found.causes}
    planted = {"body-centre": 0.02, "body-mass": 1.1, "body-moments": 1.2}
    assert values == pytest.approx(planted, rel=EXACT), str(found)
    named = [{(c.kind, c.names) for c in other} for other in (found.causes, *found.alternatives)]
    assert all(named.count(one) == 1 for one in named)


def test_what_causes_of_a_body_say_does_not_contradict() -> None:
    """Its mass with its inertia, and its inertia besides, would be two factors on one number."""
    model = with_changes(ARM, body_mass=[1, 1, 1 / 1.3], body_inertia=[1, 1, 0.8])
    found = dc.explain_residual(model, arm_run())
    for causes in (found.causes, *found.alternatives):
        kinds = {c.kind for c in causes if c.element == "lower"}
        assert not {"body-inertia", "body-mass"} <= kinds
        assert not {"body-inertia", "body-moments"} <= kinds
    values = {c.kind: c.values[0] for c in found.causes}
    assert values["body-mass"] == pytest.approx(1.3, rel=EXACT)
    assert values["body-moments"] == pytest.approx(1.25, rel=EXACT)


# --- several, noise, no accelerations -------------------------------------------------------------------


def test_four_causes_at_once() -> None:
    model = with_changes(ARM, damping=0.0, body_mass=[1, 1, 1 / 1.05], gravity=9.7)
    found = dc.explain_residual(model, arm_run())
    assert found.kind == "explained", str(found)
    values = {(c.kind, c.element): c.values[0] for c in found.causes}
    planted = {
        ("missing-damper", "shoulder"): 0.05,
        ("missing-damper", "elbow"): 0.02,
        ("body-mass", "lower"): 1.05,
        ("gravity", "gravity"): 9.81 / 9.7,
    }
    assert values == pytest.approx(planted, rel=EXACT)


@pytest.mark.parametrize(
    "measured",
    [True, pytest.param(False, marks=pytest.mark.slow)],
    ids=["accelerations", "steps"],
)
def test_noise_widens_the_error_and_not_the_answer(measured: bool) -> None:
    """Two logs, ±3 standard errors each: all are within, but once in a hundred times."""
    model, inside = with_changes(ARM, damping=0.0), []
    for seed in range(2):
        run = noisy(arm_run(), NOISE, seed)
        found = dc.explain_residual(model, run if measured else replace(run, udot=None))
        assert found.form == ("samples" if measured else "steps")
        assert {(c.kind, c.element) for c in found.causes} == {
            ("missing-damper", "shoulder"),
            ("missing-damper", "elbow"),
        }, str(found)
        truth = {"shoulder": 0.05, "elbow": 0.02}
        inside += [abs(c.values[0] - truth[c.element]) <= 3.0 * c.errors[0] for c in found.causes]
        assert all(1e-6 < c.errors[0] / c.values[0] < 0.05 for c in found.causes)
    assert sum(inside) >= len(inside) - 1


def test_dry_friction_is_found_although_it_has_no_law_at_rest() -> None:
    """MuJoCo's is soft: slow motion sees less of it, so that the number is right to a few per cent."""
    model = copy.copy(model_of(ARM))
    model.dof_frictionloss[1] = 0.03
    data = mujoco.MjData(model)
    data.qvel[:] = [2.0, -3.0]
    run = dc.run_mujoco(model, 2.0, data=data, integrator="rk4")
    run = replace(run, forces={n: f for n, f in run.forces.items() if "friction" not in n})
    found = dc.explain_residual(model_of(ARM), run)
    cause = the_cause(found, "missing-friction", "elbow")
    assert cause.values[0] == pytest.approx(0.03, rel=0.05)


# --- when the log does not tell -------------------------------------------------------------------------


def test_equal_causes_are_all_named_with_the_motion_that_would_tell() -> None:
    """Of a machine that only turns about its one axis, inertia and rotor are the same thing."""

    def wheel(armature: float, torque: str) -> dc.Mechanism:
        return dc.Mechanism(
            bodies=[dc.bodies.disc("wheel", 2.0, 0.3)],
            joints=[dc.revolute("axle", "ground", "wheel", armature=armature)],
            forces=[dc.forces.joint_torque("motor", "axle", torque)],
        )

    run = dc.simulate(wheel(0.01, "sin(3*t)"), wheel(0.01, "0").state(), 2.0, 2e-3, solver="ode4")
    found = dc.explain_residual(wheel(0.0, "sin(3*t)"), replace(run, forces={}))
    assert found.kind == "ambiguous"
    named = {(c.kind, c.element) for other in (found.causes, *found.alternatives) for c in other}
    assert ("missing-rotor-inertia", "axle") in named
    assert ("body-moments", "wheel") in named
    assert ("actuator-gear", "actuator motor") in named
    assert found.alternatives


def test_the_motion_that_would_separate_is_named() -> None:
    """At rest the mass of a hanging rod and gravity do the same; in motion they do not."""
    rod = dc.Mechanism(
        bodies=[dc.rod("rod", 1.0, 0.5, along="x")],
        joints=[dc.revolute("hinge", "ground", "rod")],
        forces=[dc.forces.joint_torque("motor", "hinge")],
        gravity=(0, -9.81, 0),
    )
    t = np.linspace(0.0, 2.0, 200)
    q = 0.5 * t[:, None]  # slowly: no accelerations
    zero = np.zeros_like(q)
    run = dc.Trajectory(
        t=t, q=q, u=zero + 0.5, udot=zero, coordinates=("hinge",), speeds=("hinge",),
        forces={"actuator motor": 1.1 * 9.81 * 0.25 * np.cos(q)},
        provenance=dc.Provenance("by hand"),
    )  # fmt: skip
    found = dc.explain_residual(rod, run)
    assert found.kind == "ambiguous", str(found)
    named = {c.kind for other in (found.causes, *found.alternatives) for c in other}
    assert {"gravity", "body-mass"} <= named
    assert found.separating.startswith("To tell some of them apart, log also a motion")


@pytest.mark.slow
def test_what_is_not_in_the_dictionary_is_not_explained() -> None:
    """A torque with the square of a speed, at a joint without a damper."""
    run = arm_run()
    odd = run.forces["actuator m2"] + 0.001 * np.sin(5.0 * run.q) * run.u**2
    found = dc.explain_residual(
        model_of(ARM), replace(run, forces={**run.forces, "actuator m2": odd})
    )
    assert found.kind == "unexplained", str(found)
    assert found.findings == ()


def test_parameters_that_the_log_does_not_excite_are_listed() -> None:
    found = dc.explain_residual(model_of(BOX), box_run())
    assert "mass of box" in found.unseen  # in free fall no force tells the mass
    with pytest.raises(dc.InputError, match="10 samples; an explanation needs 24"):
        dc.explain_residual(model_of(ARM), arm_run().every(110))


# --- the result -----------------------------------------------------------------------------------------


def test_tables_json_and_findings() -> None:
    model = with_changes(ARM, damping=0.0)
    found = dc.explain_residual(model, arm_run())
    assert json.dumps(found.to_dict(), allow_nan=False)
    lines = found.table().splitlines()
    assert len(lines) == 4 and "missing-damper" in lines[2]
    assert [f.kind for f in found.findings] == ["missing-damper"] * 2
    assert sum(c.share for c in found.causes) <= 1.01


def test_arguments_that_make_no_sense() -> None:
    with pytest.raises(dc.InputError, match="mapping"):
        dc.explain_residual(model_of(ARM), arm_run(), mapping="columns.toml")
    driven = dc.Mechanism(
        bodies=[dc.rod("rod", 1.0, 0.5)],
        joints=[dc.revolute("hinge", "ground", "rod", motion="sin(t)")],
    )
    t = np.linspace(0.0, 1.0, 50)
    run = dc.Trajectory(
        t=t, q=np.sin(t)[:, None], u=np.cos(t)[:, None], coordinates=("hinge",), speeds=("hinge",),
        provenance=dc.Provenance("by hand"),
    )  # fmt: skip
    with pytest.raises(dc.InputError, match="every joint of the model is prescribed"):
        dc.explain_residual(driven, run)
