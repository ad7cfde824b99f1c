"""Runs of OpenSim, recorded and written to a folder: OpenSim cannot be in one process with CasADi."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import opensim

import deltac as dc

ZERO = opensim.Vec3(0)


def started(model: Any, accuracy: float, step: float) -> Any:
    """A manager of the model's default state, with a largest step."""
    state = model.initSystem()
    manager = opensim.Manager(model)
    manager.setIntegratorMethod(opensim.Manager.IntegratorMethod_RungeKutta3)
    manager.setIntegratorAccuracy(accuracy)
    manager.setIntegratorMinimumStepSize(step)
    manager.setIntegratorMaximumStepSize(step)
    manager.initialize(state)
    return manager


def arm() -> Any:
    """Two links; a motor, a muscle, a ligament, a limit."""
    model = opensim.Model()
    model.setName("arm")
    model.setGravity(opensim.Vec3(0, -9.81, 0))
    parent, place = model.getGround(), ZERO
    for name, bone, mass in (("shoulder", "upper", 1.5), ("elbow", "fore", 0.8)):
        inertia = opensim.Inertia(0.02, 0.005, 0.02)
        body = opensim.Body(bone, mass, opensim.Vec3(0, -0.2, 0), inertia)
        pin = opensim.PinJoint(name, parent, place, ZERO, body, ZERO, ZERO)
        pin.updCoordinate().setName(f"{name}_flexion")
        model.addBody(body)
        model.addJoint(pin)
        parent, place = body, opensim.Vec3(0, -0.4, 0)
    pin.updCoordinate().setDefaultSpeedValue(3.0)
    lift = opensim.CoordinateActuator("shoulder_flexion")
    lift.setName("lift")
    lift.setOptimalForce(4.0)
    ligament = opensim.SpringGeneralizedForce("elbow_flexion")
    ligament.setName("ligament")
    ligament.setStiffness(2.0)
    ligament.setRestLength(0.1)
    limit = opensim.CoordinateLimitForce(
        "elbow_flexion", 20.0, 0.05, -20.0, 0.05, 0.001, 20.0, False
    )
    limit.setName("stop")
    biceps = opensim.Millard2012EquilibriumMuscle("biceps", 15.0, 0.2, 0.2, 0.0)
    biceps.set_ignore_tendon_compliance(True)
    biceps.set_ignore_activation_dynamics(True)
    biceps.addNewPathPoint("origin", model.getGround(), opensim.Vec3(0.05, 0.0, 0.0))
    biceps.addNewPathPoint("insertion", body, opensim.Vec3(0.03, -0.03, 0.0))
    for force in (lift, ligament, limit, biceps):
        model.addForce(force)
    brain = opensim.PrescribedController()
    for actuator, law in ((lift, opensim.Sine(1.0, 5.0, 0.3)), (biceps, opensim.Constant(0.3))):
        brain.addActuator(actuator)
        brain.prescribeControlForActuator(actuator.getName(), law)
    model.addController(brain)
    model.finalizeConnections()
    return model


def probe() -> Any:
    """A hull that floats, with a boom, falls on a floor."""
    model = opensim.Model()
    model.setName("probe")
    model.setGravity(opensim.Vec3(0, -9.81, 0))
    hull = opensim.Body(
        "hull", 2.0, opensim.Vec3(0.02, 0.01, -0.03), opensim.Inertia(0.03, 0.04, 0.05)
    )
    boom = opensim.Body(
        "boom", 0.5, opensim.Vec3(0.1, 0, 0.05), opensim.Inertia(0.004, 0.006, 0.007)
    )
    base = opensim.FreeJoint("base", model.getGround(), hull)
    hinge = opensim.PinJoint("hinge", hull, opensim.Vec3(0.1, 0, 0.1), ZERO, boom, ZERO, ZERO)
    hinge.updCoordinate().setDefaultSpeedValue(2.0)
    start = ((0.3, 3.0), (-0.2, -2.0), (0.4, 1.0), (0.0, 0.5), (0.15, -0.2), (0.0, 0.1))
    for k, (value, speed) in enumerate(start):
        base.upd_coordinates(k).setDefaultValue(value)
        base.upd_coordinates(k).setDefaultSpeedValue(speed)
    for body in (hull, boom):
        model.addBody(body)
    for joint in (base, hinge):
        model.addJoint(joint)
    turned = opensim.Vec3(0, 0, -1.5707963267948966)
    floor = opensim.ContactHalfSpace(ZERO, turned, model.getGround(), "floor")
    ball = opensim.ContactSphere(0.1, ZERO, hull, "ball")
    foot = opensim.SmoothSphereHalfSpaceForce("foot", ball, floor)
    foot.set_stiffness(1e5)
    foot.set_dissipation(0.5)
    foot.set_static_friction(0.5)
    foot.set_dynamic_friction(0.4)
    foot.set_viscous_friction(0.1)
    foot.set_transition_velocity(0.1)
    for part in (floor, ball):
        model.addContactGeometry(part)
    model.addForce(foot)
    model.finalizeConnections()
    return model


def main(folder: Path) -> None:
    opensim.Logger.setLevelString("off")
    for name, made, accuracy, steps in (
        ("arm", arm, 1.0, (0.004, 0.002)),
        ("probe", probe, 1.0, (0.002, 0.001)),
    ):
        for step in steps:
            model = made()
            manager = started(model, accuracy, step)
            manager.integrate(0.3)
            with dc.record_opensim(model) as rec:
                rec.states(manager.getStatesTable())
            rec.trajectory("rk3", step).write(folder / f"{name}_{step}.parquet")
    assert "casadi" not in sys.modules


if __name__ == "__main__":
    main(Path(sys.argv[1]))
