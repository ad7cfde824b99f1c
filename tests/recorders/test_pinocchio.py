"""Recording loops around Pinocchio: a driven arm, a floating base, a contact; a planted fault."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import deltac as dc
from deltac.errors import InputError
from deltac.recorders import record_pinocchio
from deltac.trajectories import Trajectory

pin = pytest.importorskip("pinocchio", reason="Pinocchio (deltac[pin]) is not installed")

DAMPING = 0.1


def arm() -> Any:
    model = pin.Model()
    model.gravity.linear = np.array([0.0, 0.0, -9.81])
    first = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "shoulder")
    inertia = pin.Inertia(1.5, np.array([0.2, 0.0, 0.05]), np.diag([0.01, 0.05, 0.05]))
    model.appendBodyToJoint(first, inertia, pin.SE3.Identity())
    place = pin.SE3(np.eye(3), np.array([0.4, 0.0, 0.0]))
    second = model.addJoint(first, pin.JointModelRUBY(), place, "elbow")
    inertia = pin.Inertia(0.8, np.array([0.15, 0.0, 0.0]), np.diag([0.005, 0.02, 0.02]))
    model.appendBodyToJoint(second, inertia, pin.SE3.Identity())
    return model


def arm_mechanism(mass: float = 0.8) -> dc.Mechanism:
    return dc.Mechanism(
        bodies=[
            dc.body("upper", 1.5, (0.01, 0.05, 0.05), (0.2, 0, 0.05)),
            dc.body("fore", mass, (0.005, 0.02, 0.02), (0.15, 0, 0)),
        ],
        joints=[
            dc.revolute("shoulder", "ground", "upper", "y", damping=DAMPING),
            dc.revolute("elbow", "upper", "fore", "y", position=(0.4, 0, 0)),
        ],
        forces=[
            dc.forces.joint_torque("shoulder", "shoulder"),
            dc.forces.joint_torque("elbow", "elbow"),
        ],
        gravity=(0, 0, -9.81),
    )


def integrated(
    model: Any,
    q: Any,
    v: Any,
    step: float,
    duration: float,
    torque: Callable[[float, Any, Any], Any],
    sample: Callable[[float, Any, Any], None],
    stage: Callable[[float, float, Any, Any], None] = lambda duration, t, q, v: None,
) -> None:
    """Runge's and Kutta's method on the configuration's Lie group (Munthe-Kaas with a chart at each step)."""
    data = model.createData()

    def slope(t: float, dq: Any, v: Any, weight: float) -> tuple[Any, Any]:
        here = pin.integrate(model, q, dq)
        stage(weight * step, t, here, v)
        a = pin.aba(model, data, here, v, torque(t, here, v))
        # The rate of the chart's coordinates: dExp⁻¹ v.
        J = pin.dIntegrate(model, q, dq, pin.ArgumentPosition.ARG1)
        return np.linalg.solve(J, v), a

    for k in range(round(duration / step) + 1):
        t = k * step
        sample(t, q, v)
        z = np.zeros(model.nv)
        k1 = slope(t, z, v, 1 / 6)
        k2 = slope(t + step / 2, step / 2 * k1[0], v + step / 2 * k1[1], 1 / 3)
        k3 = slope(t + step / 2, step / 2 * k2[0], v + step / 2 * k2[1], 1 / 3)
        k4 = slope(t + step, step * k3[0], v + step * k3[1], 1 / 6)
        dq = step / 6 * (k1[0] + 2 * k2[0] + 2 * k3[0] + k4[0])
        v = v + step / 6 * (k1[1] + 2 * k2[1] + 2 * k3[1] + k4[1])
        q = pin.integrate(model, q, dq)


def drive(t: float) -> Any:
    return np.array([4.0 + np.sin(7 * t), 0.5 * np.cos(5 * t)])


def driven_arm(step: float, stages: bool = False) -> Trajectory:
    model = arm()

    def stage(duration: float, t: float, q: Any, v: Any) -> None:
        if stages:
            damper = {"damper shoulder": [-DAMPING * v[0], 0.0]}
            rec.stage(duration, q, v, tau=drive(t), forces=damper)  # type: ignore[arg-type]

    def torque(t: float, q: Any, v: Any) -> Any:
        return drive(t) - np.array([DAMPING, 0.0]) * v

    with record_pinocchio(model, arm_mechanism()) as rec:
        integrated(
            model,
            np.array([0.3, np.cos(3.0), np.sin(3.0)]),  # the angle passes π
            np.array([0.5, 2.0]),
            step,
            1.0,
            torque,
            lambda t, q, v: rec.sample(
                t, q, v, tau=drive(t), forces={"damper shoulder": np.array([-DAMPING * v[0], 0.0])}
            ),
            stage,
        )
    return rec.trajectory(solver="rk4", step=step, order=4)


def order(mechanism: dc.Mechanism, runs: list[Trajectory]) -> tuple[float, list[float]]:
    errors = []
    for run in runs:
        ledger = dc.balance(mechanism, run, work="samples", testing=("wang",))
        errors.append(float(np.abs(ledger.delta_c["wang"]).max()))
        assert float(ledger.error_bar["wang"].max()) < errors[-1]
    return float(np.log2(errors[0] / errors[1])), errors


def test_a_driven_arm_closes_at_the_order_of_its_integrator() -> None:
    runs = [driven_arm(0.008), driven_arm(0.004)]
    assert np.abs(np.diff(runs[0].q[:, 1])).max() < 1.0  # unwound
    assert runs[0].q[:, 1].max() > np.pi
    observed, errors = order(arm_mechanism(), runs)
    assert 3.6 < observed < 5.4, errors
    left = dc.residuals(arm_mechanism(), runs[0])["coordinates"]
    assert np.abs(left).max() < 1e-12


@pytest.mark.long
def test_a_planted_fault_is_named() -> None:
    run = driven_arm(0.01)
    audit = dc.audit(arm_mechanism(mass=0.9), run)
    assert audit.verdict.kind == "equation-error"
    assert "fore" in str(audit.causes[0])
    assert dc.audit(arm_mechanism(), run).verdict.kind == "consistent"


def bars(mechanism: dc.Mechanism, run: Trajectory) -> tuple[float, float]:
    """|ΔC| and its bar, of works taken by stages."""
    ledger = dc.balance(mechanism, run, testing=("wang",))
    assert ledger.method == "in-loop"
    return float(np.abs(ledger.delta_c["wang"]).max()), float(ledger.error_bar["wang"].max())


def test_works_by_the_stages_of_the_loop() -> None:
    runs = [driven_arm(step, stages=True) for step in (0.008, 0.004)]
    found = [bars(arm_mechanism(), run) for run in runs]
    assert all(bar < 1e-12 for _, bar in found)
    assert 3.6 < np.log2(found[0][0] / found[1][0]) < 5.4
    assert bars(arm_mechanism(mass=0.81), runs[1])[0] > 1e4 * found[1][0]
    assert runs[0].provenance.order == 4
    assert runs[0].provenance.held is None  # nobody said
    # Other rows of the same run.
    thin = bars(arm_mechanism(), runs[1].every(10))
    assert thin[0] <= found[1][0] and thin[1] < 1e-12


STIFF, LOSS = 4000.0, 30.0


def tumbler(step: float, floor: bool) -> tuple[dc.Mechanism, Trajectory]:
    """A box that flies and, with a floor, lands on a spring and damper below its reference point."""
    model = pin.Model()
    model.gravity.linear = np.array([0.0, 0.0, -9.81])
    base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    inertia = pin.Inertia(2.0, np.array([0.05, 0.02, -0.03]), np.diag([0.02, 0.03, 0.04]))
    model.appendBodyToJoint(base, inertia, pin.SE3.Identity())
    mechanism = dc.Mechanism(
        bodies=[dc.body("box", 2.0, (0.02, 0.03, 0.04), (0.05, 0.02, -0.03))],
        joints=[dc.free("base", "box")],
        gravity=(0, 0, -9.81),
    )

    def contact(q: Any, v: Any) -> Any:
        R = pin.Quaternion(q[6], q[3], q[4], q[5]).toRotationMatrix()
        depth, rate = -q[2], -(R @ v[:3])[2]
        push = max(0.0, depth) * (STIFF + LOSS * STIFF * 1e-3 * rate) if floor else 0.0
        return np.concatenate([R.T @ np.array([0.0, 0.0, push]), np.zeros(3)])

    thrust = pin.Force(np.array([0.5, -1.0, 2.0]), np.array([0.02, 0.03, -0.01]))
    external = [pin.Force.Zero(), thrust]
    with record_pinocchio(model, mechanism, names={"root_joint": "base"}) as rec:
        integrated(
            model,
            np.array([0.0, 0.0, 0.05, 0.0, 0.0, 0.0, 1.0]),
            np.array([0.5, 0.2, 0.0, 2.0, -3.0, 1.0]),
            step,
            0.4,
            lambda t, q, v: contact(q, v) + np.array(thrust),
            lambda t, q, v: rec.sample(
                t, q, v, fext=external, forces={"contact floor": contact(q, v)}
            ),
            lambda duration, t, q, v: rec.stage(
                duration, q, v, fext=external, forces={"contact floor": contact(q, v)}
            ),
        )
    return mechanism, rec.trajectory("rk4", step)


@pytest.mark.parametrize("floor", [False, True])
def test_a_floating_base_closes_too(floor: bool) -> None:
    runs = [tumbler(step, floor) for step in (0.004, 0.002)]
    mechanism = runs[0][0]
    for _, run in runs:
        assert np.abs(dc.residuals(mechanism, run)["coordinates"]).max() < 1e-10
    taken = [bars(mechanism, run) for _, run in runs]
    assert all(bar < 1e-12 for _, bar in taken)
    assert (1.5 if floor else 3.5) < np.log2(taken[0][0] / taken[1][0]) < 5.5
    if not floor:
        observed, errors = order(mechanism, [run for _, run in runs])
        assert 3.5 < observed < 5.5, errors
        return
    # The contact's force has a kink where it opens: of second order at best.
    ledgers = [dc.balance(mechanism, run, work="samples") for _, run in runs]
    assert all(ledger.relative("wang") < 2e-3 for ledger in ledgers)
    assert ledgers[0].work["contact floor"][-1] < -0.1
    assert np.abs(ledgers[0].work["applied external"]).max() > 0.01


def test_a_monitor_takes_the_rows() -> None:
    model, mechanism = arm(), arm_mechanism()
    monitor = dc.Monitor(mechanism, on_exceed=None)
    run = driven_arm(0.01)
    with record_pinocchio(model, monitor=monitor) as rec:
        for k, t in enumerate(run.t):
            q = np.array([run.q[k, 0], np.cos(run.q[k, 1]), np.sin(run.q[k, 1])])
            damper = np.array([-DAMPING * run.u[k, 0], 0.0])
            rec.sample(t, q, run.u[k], tau=drive(t), forces={"damper shoulder": damper})
    ledger = dc.balance(mechanism, run, work="samples", testing=("wang",))
    assert abs(monitor.delta_c - ledger.delta_c["wang"][-1]) <= monitor.error_bar + 1e-9
    with pytest.raises(InputError):
        rec.trajectory()


def test_what_cannot_be_recorded() -> None:
    with pytest.raises(InputError, match="names="):
        record_pinocchio(arm(), dc.load_model("double-pendulum"))
    with pytest.raises(InputError, match="names"):
        record_pinocchio(arm(), names={"wrist": "hand"})
    with record_pinocchio(arm()) as rec:
        with pytest.raises(InputError, match="expected"):
            rec.sample(0.0, np.zeros(2), np.zeros(2))
        with pytest.raises(InputError, match="3: one for each joint"):
            rec.sample(0.0, np.array([0, 1.0, 0]), np.zeros(2), fext=[])
