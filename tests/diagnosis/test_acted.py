"""Logs of commands in place of the forces that acted; the cart-pole's own equations are the oracle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import deltac as dc
from tests.systems.cart_pole import CartPole, rk4

pytestmark = pytest.mark.case_study("test_controllers_without_forces_in_the_log_accuse_no_model")

STEP, ROWS, HELD = 0.002, 900, 5
Actuator = Callable[[np.ndarray], np.ndarray]


def commanded(
    system: CartPole, actuator: Callable[[list[float]], float], damping: float = 1.5
) -> dc.Trajectory:
    """A log of the commands of a controller of 100 Hz; `actuator` makes a force of those so far."""
    q, u = np.array([0.1, -0.4]), np.array([0.3, 1.0])
    command, said, rows = 0.0, [], []
    for k in range(ROWS):
        if k % HELD == 0:
            command = 12.0 * (0.4 * np.sin(2.0 * k * STEP) - q[0]) - damping * u[0]
        said.append(command)
        rows.append((k * STEP, *q, *u, command))
        force = actuator(said)
        f = lambda t, q, u, F=force: system.acceleration(t, q, u, F)  # noqa: E731
        q, u = rk4(f, k * STEP, q, u, STEP)
    table = np.array(rows)
    named = ("time", "q.slide", "q.hinge", "u.slide", "u.hinge", "force.actuator motor.slide")
    return dc.read_trajectory(dict(zip(named, table.T)), model=system.mechanism())


def test_a_delay_of_many_rows() -> None:
    system = CartPole()
    run = commanded(system, lambda said: said[max(len(said) - 9, 0)])
    found = dc.audit(system.mechanism(), run)
    [told] = [f for f in found.verdict.findings if f.code == "F-ACTUATOR-DELAY"]
    # Eight whole rows; what is held over a step acts half of it later, by the mean.
    assert told.factor is not None and 8 * STEP <= told.factor < 8.51 * STEP
    assert found.verdict.kind == "consistent"


@pytest.mark.parametrize(
    ("low", "high", "ends"), [(-2.0, 0.4, ("-2", "0.4")), (-2.0, 9.0, ("-2",))]
)
def test_a_limit(low: float, high: float, ends: tuple[str, ...]) -> None:
    system = CartPole()
    run = commanded(system, lambda said: float(np.clip(said[-1], low, high)))
    assert run.forces["actuator motor"].min() < low  # more than acted
    found = dc.audit(system.mechanism(), run)
    [finding] = [f for f in found.verdict.findings if f.code == "F-LIMITED-FORCES"]
    assert all(end in finding.what.split() or f"{end}," in finding.what for end in ends)
    assert found.verdict.kind == "consistent" and not found.causes
    # The classical method is exact to h⁵, 1e-11 of what flows.
    assert found.attribution is not None
    assert abs(found.attribution.integrator.energy) < 1e-8


@pytest.mark.parametrize(
    ("run_by", "actuator"),
    [
        # Beside a controller without damping, almost a delay.
        pytest.param({"slide": 0.0}, lambda said: said[-1], marks=pytest.mark.slow),
        pytest.param({"pole": 0.7}, lambda said: said[-1], marks=pytest.mark.slow),
        pytest.param({}, lambda said: 0.8 * said[-1], marks=pytest.mark.slow),
        ({}, lambda said: said[-1] + 0.5),
    ],
    ids=["damper", "mass", "gear", "offset"],
)
def test_mistakes_are_no_limits(run_by: dict[str, float], actuator: Actuator) -> None:
    run = commanded(replace(CartPole(), **run_by), actuator, damping=0.0)  # type: ignore[arg-type]
    found = dc.audit(CartPole().mechanism(), run)
    assert "F-LIMITED-FORCES" not in {f.code for f in found.verdict.findings}
    assert found.verdict.kind in ("equation-error", "unresolved")


Force = Callable[[float], float]


def driven(said: Force, acting: Force, held: int = 0, uneven: float = 0.0) -> dc.Trajectory:
    """A log of forces of time, sampled every so many rows and held, or acting along the steps (0)."""
    system, rng = CartPole(), np.random.default_rng(3)
    h = STEP * (1.0 + uneven * rng.uniform(-1.0, 1.0, ROWS))
    t = np.concatenate([[0.0], np.cumsum(h)])
    q, u, rows = np.array([0.1, -0.4]), np.array([0.3, 1.0]), []
    for k in range(ROWS):
        at = t[k - k % held] if held else t[k]
        rows.append((t[k], *q, *u, said(at)))
        f = lambda s, q, u, at=at: system.acceleration(s, q, u, acting(at if held else s))  # noqa: E731
        q, u = rk4(f, t[k], q, u, h[k])
    named = ("time", "q.slide", "q.hinge", "u.slide", "u.hinge", "force.actuator motor.slide")
    return dc.read_trajectory(dict(zip(named, np.array(rows).T)), model=system.mechanism())


def waves(t: float) -> float:
    return float(4.0 * np.sin(5.0 * t) + 2.0 * np.cos(11.0 * t))


def square(t: float) -> float:
    return 4.0 if np.sin(5.0 * t) >= 0.0 else -4.0


@pytest.mark.parametrize(
    ("said", "acting", "how", "kind", "code"),
    [
        (
            waves,
            lambda t: float(np.clip(waves(t), -3.0, 4.0)),
            {},
            "consistent",
            "F-LIMITED-FORCES",
        ),
        (waves, lambda t: waves(t - 9 * STEP), {}, "consistent", "F-ACTUATOR-DELAY"),
        (waves, lambda t: min(waves(t), 3.0), {"held": 5}, "consistent", "F-LIMITED-FORCES"),
        # Of a force of two values a wrong gear limits it as well.
        (square, lambda t: 0.9 * square(t), {"held": 1}, "equation-error", None),
        (waves, waves, {"held": 5, "uneven": 0.3}, "consistent", None),
    ],
    ids=["smooth limit", "smooth delay", "one bound", "gear of two values", "uneven steps"],
)
def test_forces_of_time(
    said: Force, acting: Force, how: dict[str, float], kind: str, code: str | None
) -> None:
    found = dc.audit(CartPole().mechanism(), driven(said, acting, **how))  # type: ignore[arg-type]
    assert found.verdict.kind == kind
    told = {f.code: f for f in found.verdict.findings}
    # The delay of all forces is that of the only one.
    late = {"F-ACTUATOR-DELAY", "F-LATE-FORCES"} & set(told)
    assert len(late) == (code == "F-ACTUATOR-DELAY")
    assert ("F-LIMITED-FORCES" in told) == (code == "F-LIMITED-FORCES")
    for one in late:
        assert told[one].factor == pytest.approx(9 * STEP, abs=1e-6)
    if how.get("held") == 5 and code:  # one bound alone
        assert "did not exceed 3," in told[code].what


Command = Callable[[float], float]
Acting = Callable[[list[float]], float]


def by_motors(
    mechanism: dc.Mechanism, motors: dict[str, tuple[Command, Acting]], duration: float = 2.0
) -> dc.Trajectory:
    """A run by Runge–Kutta's method with what its motors were told in place of what they did."""
    said: dict[str, list[float]] = {name: [] for name in motors}

    def controller(t: float, q: np.ndarray, u: np.ndarray) -> dict[str, float]:
        for name, (command, _) in motors.items():
            said[name].append(command(t))
        return {name: float(acting(said[name])) for name, (_, acting) in motors.items()}

    run = dc.simulate(
        mechanism,
        mechanism.state(),
        duration,
        step=STEP,
        solver="rk4",
        controller=dc.Controller(controller),
    )
    forces = dict(run.forces)
    for name, values in said.items():
        channel = next(c for c in forces if c.endswith(name))
        there = values[1:]  # the first time it was asked before the run
        there += values[-1:] * (len(run) - len(there))
        place = int(np.argmax(np.abs(forces[channel]).max(axis=0)))
        forces[channel] = np.zeros_like(forces[channel])
        forces[channel][:, place] = there[: len(run)]
    some = dc.Provenance("somebody")
    return replace(run, forces=forces, works={}, integrals={}, udot=None, provenance=some)


def test_one_motor_delayed_another_limited() -> None:
    """What one of them does moves the other's joint, too."""
    arm = dc.Mechanism(
        [dc.bodies.rod("upper", 1.0, 1.0), dc.bodies.rod("lower", 1.0, 0.8)],
        [
            dc.joints.revolute("hip", "ground", "upper", "y", damping=0.1),
            dc.joints.revolute("knee", "upper", "lower", "y", position=[1, 0, 0]),
        ],
        [dc.forces.joint_torque("m1", "hip"), dc.forces.joint_torque("m2", "knee")],
        gravity=[0, 0, -9.81],
    )
    run = by_motors(
        arm,
        {
            "m1": (waves, lambda told: told[max(len(told) - 7, 0)]),
            "m2": (lambda t: 3.0 * np.cos(5.0 * t), lambda told: np.clip(told[-1], -1.5, 2.0)),
        },
    )
    found = dc.audit(arm, run).verdict
    told = {f.element: (f.code, f.factor) for f in found.findings}
    assert told == {
        "actuator m1": ("F-ACTUATOR-DELAY", pytest.approx(6 * STEP)),
        "actuator m2": ("F-LIMITED-FORCES", None),
    }
    assert found.kind == "consistent"


def test_held_forces_beside_a_prescribed_joint() -> None:
    """The driving force changes along a step in which the motor's does not: both works count."""
    shaken = dc.Mechanism(
        [dc.bodies.frame("cart"), dc.bodies.rod("pole", 1.0, 0.8)],
        [
            dc.joints.prismatic("shake", "ground", "cart", "x", motion="0.1*sin(5*t)"),
            dc.joints.revolute("hinge", "cart", "pole", "y", damping=0.05),
        ],
        [dc.forces.joint_torque("motor", "hinge")],
        gravity=[0, 0, -9.81],
    )
    motor = (lambda t: 2.0 * np.sin(4.0 * t), lambda told: told[-1])
    found = dc.audit(shaken, by_motors(shaken, {"motor": motor}))
    assert found.verdict.kind == "consistent"
    assert np.abs(found.ledger.delta_c["wang"]).max() < 1e-4 * found.ledger.energy_exchanged


ARM = """<mujoco><option timestep="0.002"/><default><joint axis="0 1 0" damping=".02"/></default><worldbody>
<body><joint name="hip"/><geom type="capsule" fromto="0 0 0 0 0 -.4" size=".03"/>
<body pos="0 0 -.4"><joint name="knee"/>
<geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02" density="{density}"/></body></body></worldbody>
<actuator><motor joint="hip"/><motor joint="knee"/></actuator></mujoco>"""


@pytest.mark.parametrize(
    ("density", "driven", "kind", "code"),
    [
        (1000, True, "unresolved", "F-ASSUMED-ZERO"),
        (1300, False, "equation-error", "F-BODY-INERTIA"),
    ],
)
def test_actuators_without_forces_in_the_log(
    density: int, driven: bool, kind: str, code: str
) -> None:
    """Nothing is accused of what they may have done; a mistake that has a name is."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(ARM.format(density=density))
    data = mujoco.MjData(model)
    data.qpos[:] = 0.5, -0.3
    rows = []
    for _ in range(800):
        rows.append((data.time, *data.qpos, *data.qvel))
        if driven:
            data.ctrl[:] = 0.3 * np.sin(4.0 * data.time), 0.1 * np.cos(7.0 * data.time)
        mujoco.mj_step(model, data)
    table = np.array(rows)
    log = {"time": table[:, 0], "qpos": table[:, 1:3], "qvel": table[:, 3:]}
    found = dc.audit(mujoco.MjModel.from_xml_string(ARM.format(density=1000)), log)
    assert found.verdict.kind == kind
    assert code in {f.code for f in found.verdict.findings}


@pytest.mark.parametrize(
    ("control", "accelerations"),
    [
        ("constant", False),
        *(
            pytest.param(control, accelerations, marks=pytest.mark.slow)
            for control in ("gravity", "gravity and spring", "constant")
            for accelerations in (True, False)
            if (control, accelerations) != ("constant", False)
        ),
    ],
)
def test_controllers_without_forces_in_the_log_accuse_no_model(
    control: str, accelerations: bool
) -> None:
    """What gravity compensation, springs and constant torques leave has no more directions than motors."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(ARM.format(density=1000))
    data = mujoco.MjData(model)
    data.qpos[:] = 0.5, -0.3
    rows = []
    for _ in range(400):
        mujoco.mj_forward(model, data)
        spring = -0.3 * (data.qpos - 0.2) if "spring" in control else 0.0
        gravity = data.qfrc_bias if "gravity" in control else np.array([0.2, 0.1])
        data.ctrl[:] = gravity + spring
        mujoco.mj_forward(model, data)
        rows.append((data.time, *data.qpos, *data.qvel, *data.qacc))
        mujoco.mj_step(model, data)
    table = np.array(rows)
    log = {"time": table[:, 0], "qpos": table[:, 1:3], "qvel": table[:, 3:5]}
    log |= {"qacc": table[:, 5:]} if accelerations else {}
    assert dc.audit(model, log).verdict.kind == "unresolved"
