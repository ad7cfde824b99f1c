"""Recording PyBullet: a driven arm, joint limits, a floating base, a contact; a planted fault."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.errors import InputError
from deltac.recorders import record_pybullet
from deltac.trajectories import Trajectory
from tests.recorders.arm import ARM, mechanism
from tests.recorders.works import takes_the_works_of_held_forces

p = pytest.importorskip("pybullet", reason="PyBullet is not installed")

PROBE = """
<robot name="probe"><link name="hull"><inertial><origin xyz="0.02 0.01 -0.03"/><mass value="2"/>
  <inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0.003" ixz="0.001" iyz="-0.002"/></inertial>
  <collision><geometry><sphere radius="0.1"/></geometry></collision></link>
  <link name="boom"><inertial><origin xyz="0.1 0 0.05"/><mass value="0.5"/>
    <inertia ixx="0.002" iyy="0.003" izz="0.004" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="hinge" type="continuous"><parent link="hull"/><child link="boom"/>
    <origin xyz="0.1 0 0.1"/><axis xyz="0 1 0"/><dynamics damping="0.03"/></joint></robot>"""
PROBE_MECHANISM = dc.Mechanism(
    bodies=[
        dc.body(
            "hull",
            2.0,
            [[0.02, 0.003, 0.001], [0.003, 0.03, -0.002], [0.001, -0.002, 0.04]],
            (0.02, 0.01, -0.03),
        ),
        dc.body("boom", 0.5, (0.002, 0.003, 0.004), (0.1, 0, 0.05)),
    ],
    joints=[
        dc.free("base", "hull"),
        dc.revolute("hinge", "hull", "boom", "y", position=(0.1, 0, 0.1), damping=0.03),
    ],
    gravity=(0, 0, -9.81),
)


@pytest.fixture
def client() -> Iterator[int]:
    number = p.connect(p.DIRECT)
    p.setGravity(0, 0, -9.81, physicsClientId=number)
    yield number
    p.disconnect(number)


def loaded(client: int, folder: Path, urdf: str, step: float, **options: Any) -> int:
    path = folder / "model.urdf"
    path.write_text(urdf)
    p.setTimeStep(step, physicsClientId=client)
    flags = p.URDF_USE_INERTIA_FROM_FILE | p.URDF_MAINTAIN_LINK_ORDER
    body = p.loadURDF(str(path), flags=flags, physicsClientId=client, **options)
    for k in range(-1, p.getNumJoints(body, physicsClientId=client)):
        p.changeDynamics(
            body, k, linearDamping=0, angularDamping=0, maxJointVelocity=1e6, physicsClientId=client
        )
        if k >= 0:
            p.setJointMotorControl2(body, k, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    return int(body)


def arm(client: int, folder: Path, step: float, limit: float = 10.0, **options: Any) -> Any:
    p.resetSimulation(physicsClientId=client)
    p.setGravity(0, 0, -9.81, physicsClientId=client)
    body = loaded(client, folder, ARM.replace("LIMIT", str(limit)), step, useFixedBase=True)
    for k, (q, u) in enumerate([(0.3, 0.5), (0.5, 2.0)]):
        p.resetJointState(body, k, q, u, physicsClientId=client)
    options = {"model": mechanism(), "names": None, **options}
    with record_pybullet(body, client=client, **options) as rec:
        for k in range(round(0.8 / step)):
            torque = 4 * np.sin(5 * k * step + 0.3)
            p.setJointMotorControl2(body, 0, p.TORQUE_CONTROL, force=torque, physicsClientId=client)
            p.stepSimulation(physicsClientId=client)
            rec.sample({"shoulder": torque})
    return rec


def as_motor(run: Trajectory) -> Trajectory:
    """The motor is called "lift" in the mechanism."""
    from dataclasses import replace

    def named(channel: str) -> str:
        return str(channel).replace("actuator shoulder", "actuator lift")

    provenance = replace(run.provenance, held=tuple(map(named, run.provenance.held or ())))
    forces, works = ({named(n): f for n, f in x.items()} for x in (run.forces, run.works))
    return replace(run, forces=forces, works=works, provenance=provenance)


def orders(model: dc.Mechanism, runs: list[Trajectory]) -> float:
    errors = [
        float(np.abs(dc.balance(model, run, work="discrete").delta_c["wang"]).max()) for run in runs
    ]
    return float(np.log2(errors[0] / errors[1]))


def test_a_driven_arm_closes_step_by_step(client: int, tmp_path: Path) -> None:
    runs = [as_motor(arm(client, tmp_path, step).trajectory()) for step in (0.004, 0.002)]
    assert set(runs[0].forces) == {"actuator lift", "damper shoulder", "damper elbow"}
    assert 0.8 < orders(mechanism(), runs) < 1.3
    takes_the_works_of_held_forces(mechanism(), runs)
    assert np.abs(dc.residuals(mechanism(), runs[0])["coordinates"]).max() < 1e-9


def test_a_joint_limit(client: int, tmp_path: Path) -> None:
    run = as_motor(arm(client, tmp_path, 0.002, limit=0.45).trajectory())
    push = run.forces["limit shoulder"][:, 0]
    assert push.min() < -1.0 and (push[run.q[:, 0] < 0.4] == 0.0).all()
    assert np.abs(dc.residuals(mechanism(), run)["coordinates"]).max() < 1e-8


@pytest.mark.long
def test_a_planted_fault_is_named(client: int, tmp_path: Path) -> None:
    run = as_motor(arm(client, tmp_path, 0.001).trajectory())
    audit = dc.audit(mechanism(mass=0.9), run)
    assert audit.verdict.kind == "equation-error"
    assert "fore" in str(audit.causes[0])
    assert dc.audit(mechanism(), run).verdict.kind != "equation-error"


def probe(client: int, folder: Path, step: float, floor: bool) -> Trajectory:
    p.resetSimulation(physicsClientId=client)
    p.setGravity(0, 0, -9.81, physicsClientId=client)
    if floor:
        plane = p.createCollisionShape(p.GEOM_PLANE, physicsClientId=client)
        p.createMultiBody(0, plane, physicsClientId=client)
    body = loaded(
        client,
        folder,
        PROBE,
        step,
        basePosition=[0, 0, 0.13],
        baseOrientation=[0.5, 0.1, -0.3, 0.8],
    )
    p.resetJointState(body, 0, 0.3, 2.0, physicsClientId=client)
    p.resetBaseVelocity(body, [0.5, 0.2, 0.0], [3, -2, 1], physicsClientId=client)
    with record_pybullet(body, PROBE_MECHANISM, names={"hull": "base"}, client=client) as rec:
        for _ in range(round(0.3 / step)):
            if not floor:
                p.applyExternalTorque(
                    body, -1, [0.1, 0.2, -0.3], p.WORLD_FRAME, physicsClientId=client
                )
            p.stepSimulation(physicsClientId=client)
            rec.sample()
    return rec.trajectory()


@pytest.mark.parametrize("floor", [False, True])
def test_a_floating_base_with_a_joint(client: int, tmp_path: Path, floor: bool) -> None:
    runs = [probe(client, tmp_path, step, floor) for step in (0.002, 0.001)]
    acted = "contact all" if floor else "applied external"
    assert set(runs[0].forces) == {"damper hinge", acted}
    size = max(np.abs(f).max() for f in runs[0].forces.values())
    left = np.abs(dc.residuals(PROBE_MECHANISM, runs[0])["coordinates"]).max()
    assert left < 1e-7 * max(size, 10.0)
    takes_the_works_of_held_forces(PROBE_MECHANISM, runs)
    ledger = dc.balance(PROBE_MECHANISM, runs[1], work="discrete")
    if floor:
        assert ledger.work["contact all"][-1] < -0.1
        assert ledger.relative("wang") < 0.05
    else:
        assert 0.8 < orders(PROBE_MECHANISM, runs) < 1.4


def test_a_monitor_stops_the_loop(client: int, tmp_path: Path) -> None:
    model = dc.Mechanism(
        bodies=mechanism().bodies, joints=mechanism().joints, gravity=(0, 0, -9.81)
    )
    with pytest.raises(dc.BoundExceeded):
        arm(client, tmp_path, 0.004, model=None, monitor=dc.Monitor(model, bound=0.01))
    monitor = dc.Monitor(model, on_exceed=None)
    arm(client, tmp_path, 0.002, model=None, monitor=monitor)
    run = arm(client, tmp_path, 0.002, model=model).trajectory()
    ledger = dc.balance(model, run, work="discrete", testing=("wang",))
    assert monitor.rows == len(run) + 1
    theirs = ledger.delta_c["wang"]
    assert abs(monitor.delta_c - theirs[-1]) <= 3 * np.abs(np.diff(theirs)).max()


def test_what_cannot_be_recorded(client: int, tmp_path: Path) -> None:
    body = loaded(client, tmp_path, PROBE, 0.001)
    with pytest.raises(InputError, match="names="):
        record_pybullet(body, mechanism(), client=client)
    with record_pybullet(body, client=client) as rec:
        p.stepSimulation(physicsClientId=client)
        with pytest.raises(InputError, match="no joint 'elbow'"):
            rec.sample({"elbow": 1.0})
    p.setPhysicsEngineParameter(numSubSteps=4, physicsClientId=client)
    with pytest.raises(InputError, match="4 substeps"):
        record_pybullet(body, client=client)
