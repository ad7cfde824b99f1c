"""Recording Drake: continuous and discrete plants, with contact, joint limits and a floating base."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.errors import InputError
from deltac.recorders import record_drake
from deltac.trajectories import Trajectory
from tests.recorders.arm import ARM, mechanism
from tests.recorders.works import takes_the_works_of_held_forces

pytest.importorskip("pydrake", reason="Drake is not installed")


def arm(
    step: float, method: str, *, limit: float = 10.0, duration: float = 0.8, **options: Any
) -> Any:
    """A driven arm by a continuous integrator, or by a discrete contact solver; the recorder."""
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import DiscreteContactApproximation, MultibodyPlant
    from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
    from pydrake.systems.framework import DiagramBuilder
    from pydrake.systems.primitives import Sine

    continuous = method.startswith("runge")
    builder = DiagramBuilder()
    plant = builder.AddSystem(MultibodyPlant(0.0 if continuous else step))
    Parser(plant).AddModelsFromString(ARM.replace("LIMIT", str(limit)), "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    if not continuous:
        kind = {"tamsi": "kTamsi", "sap": "kSap"}[method]
        plant.set_discrete_contact_approximation(getattr(DiscreteContactApproximation, kind))
        plant.SetUseSampledOutputPorts(options.pop("sampled", True))
    plant.Finalize()
    sine = builder.AddSystem(Sine(4.0, 5.0, 0.3, 1))
    builder.Connect(sine.get_output_port(0), plant.get_actuation_input_port())
    push = options.pop("push", 0.0)
    if push:
        both = builder.AddSystem(Sine(push, 5.0, 0.3, 2))
        port = plant.get_applied_generalized_force_input_port()
        builder.Connect(both.get_output_port(0), port)
    simulator = Simulator(builder.Build())
    if continuous:
        ResetIntegratorFromFlags(simulator, method, step).set_fixed_step_mode(True)
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.SetPositions(context, [0.3, 0.5])
    plant.SetVelocities(context, [0.5, 2.0])
    with record_drake(simulator, plant, options.pop("model", mechanism()), **options) as rec:
        simulator.Initialize()
        simulator.AdvanceTo(duration)
    return rec


def observed_order(model: dc.Mechanism, runs: list[Trajectory], work: str) -> float:
    errors = []
    for run in runs:
        ledger = dc.balance(model, run, work=work, testing=("wang",))
        errors.append(float(np.abs(ledger.uncorrected("wang")).max()))
    return float(np.log2(errors[0] / errors[1]))


@pytest.mark.parametrize(("method", "order"), [("runge_kutta2", 2), ("runge_kutta3", 3)])
def test_a_continuous_arm_closes_at_the_order_of_its_integrator(method: str, order: int) -> None:
    runs = [arm(step, method).trajectory() for step in (0.01, 0.005)]
    assert len(runs[0]) == 81 and set(runs[0].forces) == {
        "actuator lift",
        "damper shoulder",
        "damper elbow",
    }
    assert order - 0.3 < observed_order(mechanism(), runs, "samples") < order + 1.3
    assert order - 0.3 < observed_order(mechanism(), runs, "in-loop") < order + 1.3
    bar = dc.balance(mechanism(), runs[0].every(4)).error_bar["wang"].max()
    assert bar < 1e-11  # the works of all steps are known, whatever rows are left
    assert np.abs(dc.residuals(mechanism(), runs[0])["coordinates"]).max() < 1e-11


@pytest.mark.parametrize(("method", "sampled"), [("tamsi", True), ("sap", True), ("sap", False)])
def test_a_discrete_arm_closes_step_by_step(method: str, sampled: bool) -> None:
    runs = [arm(step, method, sampled=sampled).trajectory() for step in (0.004, 0.002)]
    assert 0.8 < observed_order(mechanism(), runs, "discrete") < 1.3
    # The equations hold with the step's accelerations and forces: all of them were found.
    assert np.abs(dc.residuals(mechanism(), runs[0])["coordinates"]).max() < 1e-8
    assert ("correction implicit" in runs[0].forces) == (method == "sap")
    takes_the_works_of_held_forces(mechanism(), runs)
    assert not any(name.startswith(("limit", "applied")) for name in runs[0].forces)


def test_a_joint_limit_is_told_from_all_else() -> None:
    run = arm(0.002, "sap", limit=0.45).trajectory()
    assert run.q[:, 0].max() < 0.6
    push = run.forces["limit shoulder"][:, 0]
    assert push.min() < -1.0 and push.max() < 0.05 * abs(push.min())
    assert (push[run.q[:, 0] < 0.3] == 0.0).all()
    assert np.abs(dc.residuals(mechanism(), run)["coordinates"]).max() < 1e-8


@pytest.mark.parametrize(("method", "sampled"), [("tamsi", True), ("sap", False)])
def test_forces_through_the_port_are_no_limits(method: str, sampled: bool) -> None:
    run = arm(0.002, method, sampled=sampled, push=1.5).trajectory()
    wave = 1.5 * np.sin(5.0 * run.t + 0.3)
    assert np.abs(run.forces["applied external"] - wave[:, None]).max() < 1e-12
    assert not any(name.startswith("limit") for name in run.forces)
    assert np.abs(dc.residuals(mechanism(), run)["coordinates"]).max() < 1e-8


@pytest.mark.long
def test_a_planted_fault_is_named() -> None:
    run = arm(0.005, "runge_kutta3").trajectory()
    assert dc.audit(mechanism(), run).verdict.kind == "consistent"
    audit = dc.audit(mechanism(mass=0.9), run)
    assert audit.verdict.kind == "equation-error"
    assert "fore" in str(audit.causes[0])


BOX = """
<robot name="box"><link name="box"><inertial><origin xyz="0.02 0.01 -0.03"/><mass value="2"/>
  <inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><geometry><sphere radius="0.1"/></geometry></collision></link></robot>"""
BOX_MECHANISM = dc.Mechanism(
    bodies=[dc.body("box", 2.0, (0.02, 0.03, 0.04), (0.02, 0.01, -0.03))],
    joints=[dc.free("box", "box")],
    gravity=(0, 0, -9.81),
)


def box(step: float, discrete: bool, floor: bool, duration: float = 0.4) -> Trajectory:
    from pydrake.geometry import HalfSpace
    from pydrake.math import RigidTransform
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
    from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
    from pydrake.systems.framework import DiagramBuilder

    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, step if discrete else 0.0)
    Parser(plant).AddModelsFromString(BOX, "urdf")
    if floor:
        plant.RegisterCollisionGeometry(
            plant.world_body(), RigidTransform(), HalfSpace(), "floor", CoulombFriction(0.6, 0.6)
        )
    plant.Finalize()
    simulator = Simulator(builder.Build())
    if not discrete:
        ResetIntegratorFromFlags(simulator, "runge_kutta3", step).set_fixed_step_mode(True)
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    body = plant.GetBodyByName("box")
    plant.SetFreeBodyPose(context, body, RigidTransform([0, 0, 0.12]))
    plant.SetVelocities(context, [3.0, -2.0, 1.0, 0.5, 0.2, 0.0])
    name = plant.get_joint(plant.GetJointIndices()[-1]).name()
    with record_drake(simulator, plant, BOX_MECHANISM, names={name: "box"}) as rec:
        simulator.Initialize()
        simulator.AdvanceTo(duration)
    return rec.trajectory()


@pytest.mark.parametrize("discrete", [False, True])
def test_a_floating_base(discrete: bool) -> None:
    runs = [box(step, discrete, floor=False) for step in (0.004, 0.002)]
    order = observed_order(BOX_MECHANISM, runs, "discrete" if discrete else "samples")
    assert (0.8 < order < 1.3) if discrete else (2.7 < order < 4.3)
    assert np.abs(dc.residuals(BOX_MECHANISM, runs[0])["coordinates"]).max() < 1e-9


@pytest.mark.parametrize("discrete", [False, True])
def test_a_contact(discrete: bool) -> None:
    run = box(*((1e-3, True) if discrete else (2e-4, False)), floor=True, duration=0.2)
    assert np.abs(dc.residuals(BOX_MECHANISM, run)["coordinates"]).max() < 1e-6
    ledger = dc.balance(BOX_MECHANISM, run, work="discrete" if discrete else "samples")
    assert ledger.work["contact all"][-1] < -0.5
    assert ledger.relative("wang") < 0.03
    if discrete:
        takes_the_works_of_held_forces(BOX_MECHANISM, [run])
    else:  # the impact lasts some ten rows
        assert ledger.relative("wang") < 2 * ledger.error_bar["wang"][-1] / ledger.energy_exchanged
        # The works along the steps lose nothing of it.
        taken = dc.balance(BOX_MECHANISM, run)
        assert taken.relative("wang") < 0.25 * ledger.relative("wang")
        assert taken.error_bar["wang"].max() < 1e-11
    assert run.provenance.acted == ("contact all",)
    assert set(run.forces) <= {"contact all", "correction solver"}


def test_a_monitor_stops_the_simulation() -> None:
    light = dc.Monitor(mechanism(mass=0.7), bound=0.05)
    with pytest.raises(dc.BoundExceeded):
        arm(0.005, "runge_kutta3", monitor=light, model=None)
    monitor = dc.Monitor(mechanism(), bound=0.05, on_exceed=None)
    for method in ("runge_kutta3", "sap"):
        monitor.reset()
        arm(0.002, method, monitor=monitor, model=None)
        run = arm(0.002, method).trajectory()
        discrete = method == "sap"
        ledger = dc.balance(
            mechanism(), run, work="discrete" if discrete else "samples", testing=("wang",)
        )
        theirs = ledger.uncorrected("wang")[-1]
        assert abs(monitor.delta_c - theirs) <= (
            0.02 * abs(theirs) if discrete else monitor.error_bar
        )


def test_what_cannot_be_recorded() -> None:
    with pytest.raises(InputError, match="names="):
        arm(0.01, "runge_kutta3", model=BOX_MECHANISM)
