"""Conventions in which log and model differ are named, and accuse nobody."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import deltac as dc
from deltac.diagnosis.audit.conventions import _left
from deltac.diagnosis.inference.inference import infer_alone
from deltac.diagnosis.inference.model import LogModel
from tests.support.slow import repeated

pytestmark = pytest.mark.case_study("test_the_log_itself_has_no_doubt")

Change = Callable[[dc.Trajectory], dc.Trajectory]


def mechanism(axis: str = "z") -> dc.Mechanism:
    """Two bars that hang from a cart."""
    return dc.Mechanism(
        bodies=[
            dc.body("cart", 2.0, inertia=(0.1, 0.1, 0.1)),
            dc.body("upper", 1.0, inertia=(0.02, 0.001, 0.02), mass_centre=(0, -0.25, 0)),
            dc.body("lower", 0.6, inertia=(0.012, 0.002, 0.013), mass_centre=(0.05, -0.2, 0.02)),
        ],
        joints=[
            dc.prismatic("rail", "ground", "cart", "x"),
            dc.revolute("hip", "cart", "upper", "z"),
            dc.revolute("knee", "upper", "lower", axis, position=(0, -0.5, 0)),
        ],
        gravity=(0, -9.81, 0),
    )


@cache
def run(axis: str = "z") -> dc.Trajectory:
    """As another program would log it: driven at both hinges."""
    motors = [
        dc.forces.joint_torque("m1", "hip", "1.5*sin(3*t)"),
        dc.forces.joint_torque("m2", "knee", "0.4*cos(5*t)"),
    ]
    model = replace(mechanism(axis), forces=motors)
    start = model.state({"hip": 1.0, "knee": -0.5})
    made = dc.simulate(model, start, duration=0.6, step=2e-3, solver="rk4")
    forces = {}
    for place, (name, torque) in enumerate(
        {"actuator m1": 1.5 * np.sin(3 * made.t), "actuator m2": 0.4 * np.cos(5 * made.t)}.items()
    ):
        forces[name] = np.zeros_like(made.u)
        forces[name][:, place + 1] = torque
    return replace(
        made, forces=forces, works={}, integrals={}, udot=None, provenance=dc.Provenance("other")
    )


def scaled(factors: tuple[float, float, float]) -> Change:
    return lambda r: replace(r, q=r.q * factors, u=r.u * factors)


def absolute(r: dc.Trajectory) -> dc.Trajectory:
    q, u = r.q.copy(), r.u.copy()
    q[:, 2] += q[:, 1]
    u[:, 2] += u[:, 1]
    return replace(r, q=q, u=u)


def exchanged(r: dc.Trajectory) -> dc.Trajectory:
    places = [0, 2, 1]
    return replace(r, q=r.q[:, places], u=r.u[:, places])


def other_forces(r: dc.Trajectory) -> dc.Trajectory:
    (a, f), (b, g) = r.forces.items()
    at, by = (int(np.flatnonzero(np.ptp(x, axis=0))[0]) for x in (f, g))
    x, y = np.zeros_like(f), np.zeros_like(g)
    x[:, at], y[:, by] = g[:, by], f[:, at]
    return replace(r, forces={a: x, b: y})


DEGREE = 180.0 / np.pi


@pytest.mark.parametrize(
    ("kind", "element", "change"),
    [
        # In all columns: tests/diagnosis/test_audit_logs.py.
        pytest.param("degrees", "", scaled((1.0, DEGREE, DEGREE)), marks=pytest.mark.slow),
        pytest.param("degrees", "knee", scaled((1.0, 1.0, DEGREE)), marks=pytest.mark.slow),
        ("millimetres", "", scaled((1e3, 1.0, 1.0))),
        ("axis-sign", "knee", scaled((1.0, 1.0, -1.0))),
        ("absolute-angles", "", absolute),
        pytest.param("swapped-joints", "hip", exchanged, marks=pytest.mark.slow),
        ("swapped-forces", "actuator m1", other_forces),
    ],
)
def test_a_convention_is_named_and_accuses_nobody(kind: str, element: str, change: Change) -> None:
    found = dc.audit(mechanism(), change(run()))
    doubts = [f for f in found.findings if f.weight == "doubt"]
    assert found.verdict.kind == "unresolved", found.verdict.explain()
    assert [f.kind for f in doubts] == [kind]
    told = {(doubts[0].kind, doubts[0].element), *doubts[0].equals}
    assert any(k == kind and e.split()[-1:] == element.split()[-1:] for k, e in told), told


def test_the_log_itself_has_no_doubt() -> None:
    found = dc.audit(mechanism(), run())
    assert found.verdict.kind == "consistent"
    assert not [f for f in found.findings if f.weight != "note"]


def test_the_force_of_one_joint_with_the_other_sign() -> None:
    """Both remedies that are told make the log consistent."""
    force = run().forces["actuator m2"]
    turned = replace(run(), forces={**run().forces, "actuator m2": -force})
    (doubt,) = [f for f in dc.audit(mechanism(), turned).findings if f.weight == "doubt"]
    assert (doubt.kind, doubt.element) == ("force-sign", "knee")
    other = scaled((1.0, 1.0, -1.0))(run())
    (doubt,) = [f for f in dc.audit(mechanism(), other).findings if f.weight == "doubt"]
    assert (doubt.kind, doubt.element) == ("axis-sign", "knee")


@pytest.mark.slow  # by smaller angles: tests/diagnosis/test_sizes_of_geometry.py
def test_another_axis_of_a_joint() -> None:
    found = dc.audit(mechanism("x"), run())
    first = found.findings[0]
    assert (found.verdict.kind, first.kind, first.element) == (
        "equation-error",
        "joint-axis",
        "knee",
    )


@pytest.mark.parametrize("joint", repeated(["hip", "knee"], "hip"))
def test_a_joint_that_is_turned_round_with_its_motor(joint: str) -> None:
    """As of a simulator whose axis points the other way: all that the log says of the joint is negative."""
    sign = np.where(np.array(run().speeds) == joint, -1.0, 1.0)
    forces = {name: f * sign for name, f in run().forces.items()}
    found = dc.audit(mechanism(), replace(run(), q=run().q * sign, u=run().u * sign, forces=forces))
    first = found.findings[0]
    assert (found.verdict.kind, first.kind, first.element) == ("equation-error", "axis-sign", joint)


def test_a_motor_that_fails_is_told_with_its_time() -> None:
    """Until 0.3 s the force of the knee's motor acts as logged, afterwards not."""
    failing = [
        dc.forces.joint_torque("m1", "hip", "1.5*sin(3*t)"),
        dc.forces.joint_torque("m2", "knee", "0.4*cos(5*t)*(1 - tanh(1e4*(t - 0.3)))/2"),
    ]
    model = replace(mechanism(), forces=failing)
    start = model.state({"hip": 1.0, "knee": -0.5})
    made = dc.simulate(model, start, duration=0.6, step=2e-3, solver="rk4")
    first = dc.audit(mechanism(), replace(run(), q=made.q, u=made.u)).findings[0]
    assert (first.kind, first.element) == ("actuator-gear", "actuator m2")
    assert first.factor == pytest.approx(0.0, abs=1e-2)
    assert "before, the equations hold" in first.evidence


# --- a stiff machine in coarse rows, by equations written out here -----------------------------------------

CART, BOB, ARM, STIFF, DAMPED, G = 2.0, 0.7, 0.3, 90.0, 0.4, 9.81


def stiff_rate(x: np.ndarray) -> np.ndarray:
    """A bob on a cart, held upright by a spring: (position, angle, and their rates), of the angle about y."""
    _, angle, v, w = x
    c, s = np.cos(angle), np.sin(angle)
    M = [[CART + BOB, BOB * ARM * c], [BOB * ARM * c, BOB * ARM**2]]
    push = BOB * ARM * s * w**2
    moment = BOB * G * ARM * s - STIFF * angle - DAMPED * w
    return np.concatenate([[v, w], np.linalg.solve(M, [push, moment])])


@pytest.mark.slow  # axes that point the other way: test_a_joint_that_is_turned_round_with_its_motor
@pytest.mark.parametrize("step", [0.02, 0.005])
def test_an_axis_that_points_the_other_way_is_told_in_coarse_rows(step: float) -> None:
    rows = [np.array([0.0, 0.4, 0.5, -2.0])]
    for _ in range(150):
        a = stiff_rate(rows[-1])
        b = stiff_rate(rows[-1] + step / 2 * a)
        c = stiff_rate(rows[-1] + step / 2 * b)
        d = stiff_rate(rows[-1] + step * c)
        rows.append(rows[-1] + step / 6 * (a + 2 * b + 2 * c + d))
    x = np.array(rows)
    names, at_pole = ("rail", "pole"), np.array([0.0, 1.0])
    log = dc.Trajectory(
        t=step * np.arange(len(x), dtype=float), q=x[:, :2], u=x[:, 2:], coordinates=names, speeds=names,
        forces={"spring pole": -STIFF * x[:, :2] * at_pole, "damper pole": -DAMPED * x[:, 2:] * at_pole},
        provenance=dc.Provenance("other", step=step),
    )  # fmt: skip

    def model(axis: tuple[int, int, int]) -> dc.Mechanism:
        point = (0.0, 0.0, 0.0)
        return dc.Mechanism(
            [dc.body("cart", CART, point), dc.body("bob", BOB, point, (0, 0, ARM))],
            [
                dc.prismatic("rail", "ground", "cart", "x"),
                dc.revolute("pole", "cart", "bob", axis, stiffness=STIFF, damping=DAMPED),
            ],
            gravity=(0, 0, -G),
        )

    right = dc.audit(model((0, 1, 0)), log)
    assert right.verdict.kind in ("consistent", "integration-error")
    wrong = dc.audit(model((0, -1, 0)), log)
    assert wrong.verdict.kind == "equation-error"
    finding = wrong.findings[0]
    # Turned about either axis, the machine is its own image in a mirror.
    assert finding.kind == "axis-sign"
    assert {finding.element, *(element for _, element in finding.equals)} == {"rail", "pole"}


def test_forces_that_act_where_a_reading_does_not_look() -> None:
    """A few stretches of a log are read in other conventions: what acts elsewhere has no column there."""
    forces = {name: np.array(force) for name, force in run().forces.items()}
    for force in forces.values():
        force[:100] = 0.0
    log = replace(run(), forces=forces)
    inference = infer_alone(mechanism(), log)
    assert inference is not None and len(inference.forces) == 2
    part = log.take(slice(0, 90))
    left = _left(LogModel(mechanism(), part), part, inference)
    assert 1e-6 < left < 1.0  # without the torques that acted there


def test_what_stands_still_in_other_units_explains_nothing() -> None:
    """A wheel on a falling carriage, turned by a motor of which the log lacks the torque.

    In degrees it would hardly turn, and the weight of both would explain nearly all that is seen.
    """
    t = 2e-3 * np.arange(500, dtype=float)
    wheel = dc.body("wheel", 0.5, (0.005, 0.005, 0.01))
    model = dc.Mechanism(
        [dc.point_mass("carriage", 0.5), wheel],
        [dc.prismatic("fall", "ground", "carriage", "z"), dc.revolute("axle", "carriage", "wheel")],
        gravity=(0, 0, -9.81),
    )
    swing, rate = 3.0, 10.0
    q = np.column_stack([-0.5 * 9.81 * t**2, swing * np.sin(rate * t)])
    u = np.column_stack([-9.81 * t, swing * rate * np.cos(rate * t)])
    names = ("fall", "axle")
    found = dc.audit(model, dc.Trajectory(t=t, q=q, u=u, coordinates=names, speeds=names))
    assert not [f for f in found.findings if f.weight == "doubt"]
    assert found.verdict.kind == "equation-error"


SLIDE = """<mujoco><option timestep="0.02" integrator="implicitfast"/><worldbody>
    <body><joint name="rail" type="slide" axis="{} 0 0"/>
      <inertial pos="0 0 0" mass="3" diaginertia="0.1 0.1 0.1"/>
      <body pos="0 0 -0.1"><joint name="swing" axis="0 1 0"/>
        <inertial pos="0 0 -0.3" mass="1" diaginertia="0.02 0.02 0.001"/>
        <body pos="0 0 -0.6"><joint name="tip" axis="0 1 0"/>
          <inertial pos="0 0 -0.2" mass="0.5" diaginertia="0.01 0.01 0.001"/></body></body></body></worldbody>
    <actuator><motor name="push" joint="rail"/></actuator></mujoco>"""


def test_an_axis_that_points_the_other_way_is_told_beside_large_errors_of_the_step() -> None:
    """Read the right way, these leave a fifth of what the wrong sign leaves, and a known step none."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo (deltac[mujoco]) is not installed")
    model = mujoco.MjModel.from_xml_string(SLIDE.format(1))
    data, rows, names = mujoco.MjData(model), [], ("rail", "swing", "tip")
    data.qpos[:], data.qvel[:] = (0.0, 1.2, -0.8), (0.5, 3.0, -6.0)
    for _ in range(1000):
        data.ctrl[:] = np.sin(6.0 * data.time)
        rows.append((data.time, data.qpos.copy(), data.qvel.copy(), data.ctrl[0]))
        mujoco.mj_step(model, data)
    t, q, u, push = map(np.array, zip(*rows, strict=True))
    forces = {"actuator push": push[:, None] * np.array([1.0, 0.0, 0.0])}
    log = dc.Trajectory(t=t, q=q, u=u, coordinates=names, speeds=names, forces=forces)
    found = dc.audit(mujoco.MjModel.from_xml_string(SLIDE.format(-1)), log)
    assert found.verdict.kind == "equation-error"
    assert [(f.kind, f.element) for f in found.findings if f.weight == "cause"] == [
        ("axis-sign", "rail")
    ]
