"""Newton's batches on MuJoCo Warp, on the CPU: driven arms, a floating base on a floor; a planted fault.

Newton is in single precision, and its kernels take a minute to compile when they are first run.
"""

from __future__ import annotations

import warnings
from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.recorders import record_batch

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        find_spec("newton") is None or find_spec("mujoco_warp") is None,
        reason="Newton and MuJoCo Warp (pip install newton mujoco-warp) are not installed",
    ),
]


def builder() -> Any:
    import newton

    return newton.ModelBuilder(gravity=(0.0, 0.0, -9.81))


def arm() -> Any:
    import warp

    made, joints, parent = builder(), [], -1
    inertia = warp.mat33(0.02, 0, 0, 0, 0.02, 0, 0, 0, 0.005)
    for name, mass in (("shoulder", 1.5), ("elbow", 0.8)):
        link = made.add_link(
            mass=mass, inertia=inertia, com=warp.vec3(0, 0, -0.2), lock_inertia=True
        )
        place = warp.vec3(0, 0, 0.0 if parent < 0 else -0.4)
        joints.append(
            made.add_joint_revolute(
                parent=parent,
                child=link,
                axis=warp.vec3(0, 1, 0),
                parent_xform=warp.transform(place, warp.quat_identity()),
                child_xform=warp.transform_identity(),
                armature=0.0,
                label=name,
            )
        )
        parent = link
    made.add_articulation(joints)
    return made


def ball() -> Any:
    import warp

    made = builder()
    hull = made.add_body(xform=warp.transform(warp.vec3(0, 0, 0.12), warp.quat_identity()))
    made.add_shape_sphere(hull, radius=0.1)
    return made


def recorded(
    one: Any, dt: float, duration: float, worlds: int = 2, floor: bool = False, speed: float = 0.0
) -> tuple[Any, list[dc.Trajectory]]:
    import newton

    many = builder()
    many.replicate(one, worlds)
    if floor:
        many.add_ground_plane()
    model = many.finalize(device="cpu")
    solver = newton.solvers.SolverMuJoCo(model)
    now, later, control = model.state(), model.state(), model.control()
    q, u = now.joint_q.numpy(), now.joint_qd.numpy()
    per_world = len(u) // worlds
    u[::per_world] = speed
    if not floor:
        q += np.linspace(0.1, 0.8, len(q), dtype=np.float32)
    now.joint_q.assign(q)
    now.joint_qd.assign(u)
    newton.eval_fk(model, now.joint_q, now.joint_qd, now)
    solver.step(now, later, control, None, 1e-6)  # the state reaches MuJoCo's data
    now, later = later, now
    rec = record_batch(solver.mj_model, solver.mjw_data)
    force = np.zeros(len(u), np.float32)
    for k in range(round(duration / dt)):
        if not floor:
            force[::per_world] = 4 * np.sin(5 * k * dt + 0.3)
        control.joint_f.assign(force)
        solver.step(now, later, control, None, dt)
        now, later = later, now
        rec.sample(solver.mjw_data)
    return solver.mj_model, rec.episodes()


@pytest.mark.filterwarnings("ignore")
def test_driven_arms() -> None:
    errors = []
    for dt in (4e-3, 2e-3):
        mj_model, runs = recorded(arm(), dt, 0.4)
        mechanism, _ = dc.read_mechanism(mj_model)
        assert len(runs) == 2 and all(run.provenance.step == pytest.approx(dt) for run in runs)
        assert not np.allclose(runs[0].q, runs[1].q)
        motor = runs[0].forces["applied all"][:, 0]
        np.testing.assert_allclose(
            motor, 4 * np.sin(5 * dt * np.arange(len(motor)) + 0.3), atol=1e-4
        )
        ledgers = [dc.balance(mechanism, run, work="discrete", testing=("wang",)) for run in runs]
        errors.append([np.abs(ledger.delta_c["wang"]).max() for ledger in ledgers])
    assert (np.log2(np.divide(errors[0], errors[1])) > 0.7).all(), errors


@pytest.mark.filterwarnings("ignore")
def test_a_planted_fault_is_named() -> None:
    mj_model, (run, _) = recorded(arm(), 1e-3, 0.4)
    mechanism, _ = dc.read_mechanism(mj_model)
    assert dc.audit(mechanism, run).verdict.kind != "equation-error"
    heavier = mechanism.with_parameters(**{f"body.{mechanism.bodies[1].name}.mass": 1.0})
    assert dc.audit(heavier, run).verdict.kind == "equation-error"
    assert mechanism.bodies[1].name in str(dc.explain_residual(heavier, run).causes[0])


@pytest.mark.filterwarnings("ignore")
def test_a_floating_base_on_a_floor() -> None:
    mj_model, runs = recorded(ball(), 1e-3, 0.3, floor=True, speed=0.5)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        mechanism, _ = dc.read_mechanism(mj_model)
    run = runs[0]
    push = run.forces["constraint all"]
    assert np.abs(push[:20]).max() < 1e-9 and np.abs(push).max() > 10.0
    ledger = dc.balance(mechanism, run, work="discrete", testing=("wang",))
    assert ledger.relative("wang") < 0.05
