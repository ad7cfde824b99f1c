"""Mistakes so large that the motion is another one: a wrong axis, a term left out, rotors that do not exist.

The arm is run by MuJoCo, the double pendulum by equations and a fourth-order Runge–Kutta method written by
hand. Torques are held over two steps, and every second row is logged.
"""

from __future__ import annotations

import re
from typing import TypeAlias

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

import deltac as dc

pytestmark = pytest.mark.case_study("test_another_axis_is_named")

Array: TypeAlias = NDArray[np.float64]

STEP = 2e-3

JOINTS = ("base", "shoulder", "elbow", "wrist")


def arm(axis: str = "1 0 0", armature: float = 0.02) -> str:
    """Four links, each of which turns about an axis of its own."""
    axes, masses = ("0 0 1", "0 1 0", "0 1 0", axis), (3.0, 2.0, 1.0, 0.5)
    links = "".join(
        f"""<body name="{name}_link" pos="{0.3 if k else 0.0} 0 {0.0 if k else 0.5}">
        <joint name="{name}" axis="{axes[k]}" damping="{0.4 / (k + 1)}" armature="{armature}"/>
        <inertial pos="0.14 0.02 {0.01 * k}" mass="{masses[k]}"
            fullinertia="0.004 0.02 0.02 0.001 -0.002 0"/>"""
        for k, name in enumerate(JOINTS)
    )
    motors = "".join(f'<motor name="m_{name}" joint="{name}"/>' for name in JOINTS)
    return (
        f'<mujoco><option timestep="{STEP}" integrator="RK4"/><worldbody>{links}'
        f"{'</body>' * len(JOINTS)}</worldbody><actuator>{motors}</actuator></mujoco>"
    )


def run(xml: str) -> dc.Trajectory:
    """Every second row of a run."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    data.qpos[:] = (0.3, -0.5, 0.8, 0.4)
    rows = list[tuple[float, Array, Array, Array]]()
    for k in range(1200):
        sway = np.sin(np.array([2.0, 2.7, 3.3, 4.1]) * k * STEP + np.arange(4))
        if k % 2 == 0:  # a controller that is asked in every second step
            data.ctrl[:] = np.array([8.0, 12.0, 6.0, 1.0]) * sway - 0.5 * data.qvel
        rows.append((k * STEP, data.qpos.copy(), data.qvel.copy(), data.ctrl.copy()))
        mujoco.mj_step(model, data)
    t, q, u, tau = map(np.array, zip(*rows[::2], strict=True))
    forces = {f"actuator m_{name}": tau * (np.arange(4) == k) for k, name in enumerate(JOINTS)}
    return dc.Trajectory(t=t, q=q, u=u, coordinates=JOINTS, speeds=JOINTS, forces=forces)


def test_another_axis_is_named() -> None:
    audit = dc.audit(mujoco.MjModel.from_xml_string(arm()), run(arm("0 1 0")))
    assert audit.verdict.kind == "equation-error"
    assert [(f.kind, f.element) for f in audit.findings if f.weight == "cause"] == [
        ("joint-axis", "wrist")
    ]


def test_rotors_that_no_joint_has_are_named() -> None:
    """Without its rotor, the wrist has a twentieth of the inertia that the model gives it."""
    audit = dc.audit(mujoco.MjModel.from_xml_string(arm(armature=0.1)), run(arm(armature=0.0)))
    assert audit.verdict.kind == "equation-error"
    assert {(c.kind, c.element) for c in audit.causes} == {("armature", name) for name in JOINTS}
    for cause in audit.causes:
        assert cause.values[0] == pytest.approx(0.0, abs=1e-6)


def chain(armature: float) -> mujoco.MjModel:
    """Links in a plane, the last of so little inertia that rotors are most of it; nothing turns the first."""
    axes = ("1 0 0", "0 1 0", "0 1 0", "0 1 0")
    links = "".join(
        f"""<body pos="{0.25 if k else 0.0} 0 0"><joint name="j{k}" axis="{axis}" armature="{armature}"/>
        <inertial pos="0.12 0 0" mass="{2.0 * 0.5**k}"
        diaginertia="{0.005 * 0.5**k} {0.02 * 0.4**k} {0.02 * 0.4**k}"/>"""
        for k, axis in enumerate(axes)
    )
    motors = "".join(f'<motor joint="j{k}" gear="{12.0 * 0.5**k}"/>' for k in range(1, len(axes)))
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{STEP}" integrator="implicitfast"/><worldbody>{links}'
        f"{'</body>' * len(axes)}</worldbody><actuator>{motors}</actuator></mujoco>"
    )


@pytest.mark.long
def test_rotors_that_the_model_lacks_in_all_joints_are_named() -> None:
    """By the controls of MuJoCo's own log; the one that does not turn could have any rotor."""
    true, rng = chain(0.02), np.random.default_rng(5)
    data, rows = mujoco.MjData(true), list[tuple[float, Array, Array, Array]]()
    for k in range(400):
        if k % 20 == 0:
            data.ctrl[:] = rng.uniform(-1.0, 1.0, true.nu)
        rows.append((data.time, data.qpos.copy(), data.qvel.copy(), data.ctrl.copy()))
        mujoco.mj_step(true, data)
    names = ("time", "qpos", "qvel", "ctrl")
    log = dict(zip(names, map(np.array, zip(*rows, strict=True)), strict=True))
    found = dc.audit(chain(0.0), log)
    assert found.verdict.kind == "equation-error"
    assert {(c.kind, c.element) for c in found.causes} == {
        ("missing-rotor-inertia", f"j{k}") for k in range(1, true.nv)
    }
    for cause in found.causes:
        assert cause.values[0] == pytest.approx(0.02, abs=4.0 * cause.errors[0] + 1e-9)


def energy(model: mujoco.MjModel, q: Array, u: Array) -> float:
    """Kinetic and potential energy by MuJoCo itself, J."""
    data = mujoco.MjData(model)
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data.qpos[:], data.qvel[:] = q, u
    mujoco.mj_forward(model, data)
    return float(data.energy.sum())


def test_a_few_rows_name_a_mistake_and_all_have_its_joules() -> None:
    """Thousands of rows with hundreds of columns of causes: what is certain in 300 rows needs no others.

    Torques are held over each step and nothing is damped, so that E − Σ τ·Δq of the true arm is the error of
    MuJoCo's Euler in closed form.
    """
    rows, size = 1500, 1.04
    right = re.sub(' damping="[^"]*"', "", arm()).replace('"RK4"', '"Euler"')
    assert right.count('mass="1.0"') == 1
    true = mujoco.MjModel.from_xml_string(right.replace('mass="1.0"', f'mass="{size}"'))
    data, states = mujoco.MjData(true), list[tuple[Array, Array, Array]]()
    data.qpos[:] = (0.3, -0.5, 0.8, 0.4)
    for k in range(rows):
        data.ctrl[:] = (
            np.array([8.0, 12.0, 6.0, 1.0])
            * np.sin(np.array([2.0, 2.7, 3.3, 4.1]) * k * STEP + np.arange(4))
            - np.array([1.0, 1.0, 0.5, 0.2]) * data.qvel
        )
        states.append((data.qpos.copy(), data.qvel.copy(), data.ctrl.copy()))
        mujoco.mj_step(true, data)
    q, u, tau = map(np.array, zip(*states, strict=True))
    forces = {f"actuator m_{name}": tau * (np.arange(4) == k) for k, name in enumerate(JOINTS)}
    log = dc.Trajectory(
        t=np.arange(rows, dtype=np.float64) * STEP,
        q=q,
        u=u,
        coordinates=JOINTS,
        speeds=JOINTS,
        forces=forces,
    )
    found = dc.audit(mujoco.MjModel.from_xml_string(right), log)
    assert found.verdict.kind == "equation-error"
    (cause,) = found.causes
    assert (cause.kind, cause.element) == ("body-mass", "elbow_link")
    assert cause.size == pytest.approx(size, abs=4.0 * cause.size_error + 1e-9)
    assert found.inference is not None and found.attribution is not None
    assert len(found.inference.blocks[0].r) < rows / 4 and len(found.inference.w) == rows - 1
    error = energy(true, q[-1], u[-1]) - energy(true, q[0], u[0])
    error -= float(np.sum(tau[:-1] * np.diff(q, axis=0)))
    told = found.attribution.integrator
    assert abs(told.energy - error) <= 3.0 * told.error


def pendulum(lacking: float) -> dc.Trajectory:
    """A driven double pendulum whose first equation lacks a share of its terms in products of speeds."""
    g, l1, m1, m2, c1, c2, j1, j2 = 9.81, 0.6, 1.2, 0.8, 0.25, 0.3, 0.05, 0.03

    def rate(x: Array, tau: Array) -> Array:
        (q1, q2), u = x[:2], x[2:]
        k = m2 * l1 * c2
        m12 = j2 + m2 * c2**2 + k * np.cos(q2)
        m11 = j1 + j2 + m1 * c1**2 + m2 * (l1**2 + c2**2) + 2.0 * k * np.cos(q2)
        M = np.array([[m11, m12], [m12, j2 + m2 * c2**2]])
        terms = (
            k * np.sin(q2) * np.array([-(2.0 * u[0] + u[1]) * u[1] * (1.0 - lacking), u[0] ** 2])
        )
        far = m2 * c2 * g * np.sin(q1 + q2)
        weight = np.array([(m1 * c1 + m2 * l1) * g * np.sin(q1) + far, far])
        return np.concatenate([u, np.linalg.solve(M, tau - terms - weight)])

    h, x, rows = 2e-3, np.array([0.9, -0.6, 0.0, 0.0]), list[Array]()
    tau = np.zeros(2)
    for k in range(1500):
        if k % 2 == 0:
            tau = np.array([3.0, 1.0]) * np.sin(np.array([2.0, 3.5]) * k * h) - 0.2 * x[2:]
        rows.append(np.r_[k * h, x, tau])
        k1 = rate(x, tau)
        k2 = rate(x + h / 2 * k1, tau)
        k3 = rate(x + h / 2 * k2, tau)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(x + h * k3, tau))
    t, q, u, forces = np.split(np.array(rows[::2]), (1, 3, 5), axis=1)
    each = {f"actuator m{k}": forces * (np.arange(2) == k) for k in range(2)}
    names = ("hip", "knee")
    return dc.Trajectory(t=t[:, 0], q=q, u=u, coordinates=names, speeds=names, forces=each)


PENDULUM = dc.Mechanism(
    bodies=[
        dc.body("upper", 1.2, inertia=(0.05, 0.001, 0.05), mass_centre=(0, -0.25, 0)),
        dc.body("lower", 0.8, inertia=(0.03, 0.001, 0.03), mass_centre=(0, -0.3, 0)),
    ],
    joints=[
        dc.revolute("hip", "ground", "upper", "z"),
        dc.revolute("knee", "upper", "lower", "z", position=(0, -0.6, 0)),
    ],
    gravity=(0, -9.81, 0),
)


def test_a_column_that_is_not_read_is_told() -> None:
    log = pendulum(0.0)
    columns = {"t": log.t, "q.hip": log.q[:, 0], "q.knee": log.q[:, 1], "actuator m7": log.t}
    assert "actuator m7" in dc.audit(PENDULUM, columns).explain()


def test_a_term_that_one_equation_lacks_is_named_where_motors_act() -> None:
    assert dc.audit(PENDULUM, pendulum(0.0)).verdict.kind == "consistent"
    audit = dc.audit(PENDULUM, pendulum(1.0))
    assert audit.verdict.kind == "equation-error"
    assert [(c.kind, c.element) for c in audit.causes] == [("velocity-term", "hip")]


UPPER, LOWER, LOAD = (3.0, 0.2, 0.05), (2.0, 0.17, 0.03), (0.5, 0.33)
"""Mass, place of the centre and moment of inertia of two links; mass and place of a load on the second."""

SHOULDER, DAMPING = 0.4, np.array([0.8, 0.4])


def arm_on_a_table(lower: tuple[float, float, float]) -> dc.Mechanism:
    """Two links that turn about vertical axes."""
    links = {"upper": UPPER, "lower": lower}
    return dc.Mechanism(
        bodies=[
            dc.body(name, m, inertia=(0.001, moment, moment), mass_centre=(c, 0, 0))
            for name, (m, c, moment) in links.items()
        ],
        joints=[
            dc.revolute("j1", "ground", "upper", "z", damping=DAMPING[0]),
            dc.revolute("j2", "upper", "lower", "z", position=(SHOULDER, 0, 0), damping=DAMPING[1]),
        ],
    )


def followed(lower: tuple[float, float, float], h: float, every: int) -> dc.Trajectory:
    """The arm on its path, by controllers that are asked at every stage of a fourth-order method."""
    m, c, moment = lower

    def torques(t: float, x: Array) -> Array:
        path = np.array([0.8, 0.9]) * np.sin(np.array([2.1, 2.7]) * t + np.array([0.2, -0.5]))
        return np.asarray(np.array([60.0, 40.0]) * (path - x[:2]) - np.array([9.0, 5.0]) * x[2:])

    def rate(t: float, x: Array) -> Array:
        q2, u = x[1], x[2:]
        k, s = m * SHOULDER * c * np.cos(q2), m * SHOULDER * c * np.sin(q2)
        own = moment + m * c**2
        first = UPPER[2] + UPPER[0] * UPPER[1] ** 2 + m * SHOULDER**2 + own + 2.0 * k
        M = np.array([[first, own + k], [own + k, own]])
        terms = np.array([-s * (2.0 * u[0] + u[1]) * u[1], s * u[0] ** 2])
        return np.concatenate([u, np.linalg.solve(M, torques(t, x) - DAMPING * u - terms)])

    x, rows = np.array([0.1, -0.4, 0.5, 0.0]), list[Array]()
    for t in h * np.arange(round(5.0 / h)):
        rows.append(np.r_[t, x, torques(t, x)])
        k1 = rate(t, x)
        k2 = rate(t + h / 2, x + h / 2 * k1)
        k3 = rate(t + h / 2, x + h / 2 * k2)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(t + h, x + h * k3))
    t, q, u, forces = np.split(np.array(rows[::every]), (1, 3, 5), axis=1)
    each = {f"actuator m{k}": forces * (np.arange(2) == k) for k in range(2)}
    names = ("j1", "j2")
    return dc.Trajectory(t=t[:, 0], q=q, u=u, coordinates=names, speeds=names, forces=each)


@pytest.mark.parametrize(("h", "every"), [(2e-3, 2), (4e-3, 1)])
def test_a_payload_changes_mass_centre_and_moments_together(h: float, every: int) -> None:
    m, c, moment = LOWER
    load, place = LOAD
    loaded = m + load
    centre = (m * c + load * place) / loaded
    own = moment + m * (c - centre) ** 2 + load * (place - centre) ** 2
    audit = dc.audit(arm_on_a_table(LOWER), followed((loaded, centre, own), h, every))
    told = {cause.kind: cause.values[0] for cause in audit.causes if cause.element == "lower"}
    # Splines of torques lack some millionths of them.
    assert told == {
        "body-mass": pytest.approx(loaded / m, rel=1e-4),
        "body-centre": pytest.approx(centre - c, rel=1e-3),
        "body-moments": pytest.approx(own / moment, rel=1e-3),
    }
    # A method of fourth order loses nothing of some millionths of these joules: all is the load's.
    assert audit.attribution is not None
    lost = float(np.atleast_1d(audit.energy_error)[-1])
    assert audit.attribution.equations.energy == pytest.approx(lost, rel=2e-3)


RING, INNER, WHEEL = 0.004, (0.002, 0.0015, 0.0017), (0.0008, 0.0014)


def of_gimbals(t: float, x: Array, share: float) -> tuple[Array, float]:
    """Rates of a gyroscope in two gimbals by Lagrange's equations, and the inner one's products of speeds.

    With moments A, B, C of the inner gimbal and A, A, C of the wheel; of those terms a `share`.
    """
    (A, B, C), (transverse, axial) = INNER, WHEEL
    _, tilt, _, outer, inner, spin = x
    s, c = np.sin(tilt), np.cos(tilt)
    term = outer**2 * s * c * (B - C + transverse) - axial * (spin + outer * c) * outer * s
    mass = [[RING + (B + transverse) * s * s + (C + axial) * c * c, axial * c], [axial * c, axial]]
    turning = 2.0 * s * c * (B + transverse - C - axial) * outer * inner - axial * spin * inner * s
    first, last = np.linalg.solve(mass, [-turning, axial * outer * inner * s])
    tilting = (0.03 * np.sin(7.0 * t) + share * term) / (A + transverse)
    return np.array([outer, inner, spin, first, tilting, last]), float(term)


def gyroscope(share: float) -> tuple[dc.Mechanism, dc.Trajectory, float]:
    """Its mechanism, a run by the classical method of four stages, and the work that it lacks, J."""
    none = (0.0, 0.0, 0.0)
    mechanism = dc.Mechanism(
        [
            dc.body("ring", 1.0, inertia=(0.003, 0.003, RING), mass_centre=none),
            dc.body("gimbal", 0.6, inertia=INNER, mass_centre=none),
            dc.body("wheel", 0.5, inertia=(WHEEL[0], *WHEEL), mass_centre=none),
        ],
        [
            dc.revolute("outer", "ground", "ring", "z"),
            dc.revolute("inner", "ring", "gimbal", "x"),
            dc.revolute("spin", "gimbal", "wheel", "z"),
        ],
        forces=[dc.forces.joint_torque("motor", "inner")],
        gravity=none,
    )
    h, rows = 1e-3, [np.array([0.2, 0.8, 0.0, 2.0, 0.5, 12.0])]
    t = h * np.arange(1201.0)
    for at in t[:-1].tolist():
        x = rows[-1]
        k1 = of_gimbals(at, x, share)[0]
        k2 = of_gimbals(at + h / 2, x + h / 2 * k1, share)[0]
        k3 = of_gimbals(at + h / 2, x + h / 2 * k2, share)[0]
        k4 = of_gimbals(at + h, x + h * k3, share)[0]
        rows.append(x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
    x = np.array(rows)
    power = [
        row[4] * (share - 1.0) * of_gimbals(at, row, share)[1] for at, row in zip(t, x, strict=True)
    ]
    names = ("outer", "inner", "spin")
    torque = 0.03 * np.sin(7.0 * t)
    run = dc.Trajectory(
        t=t, q=x[:, :3], u=x[:, 3:], coordinates=names, speeds=names, provenance=dc.Provenance("by hand"),
        forces={"actuator motor": np.column_stack([0.0 * t, torque, 0.0 * t])},
    )  # fmt: skip
    return mechanism, run, float(np.trapezoid(power, t))


def test_a_term_that_a_spring_resembles_to_first_order_is_named() -> None:
    """Terms of one equation are asked for where what explains nearly all does not make the rows follow."""
    assert dc.audit(*gyroscope(1.0)[:2]).verdict.kind == "consistent"
    mechanism, run, work = gyroscope(0.0)
    audit = dc.audit(mechanism, run)
    [cause] = audit.causes
    assert (cause.kind, cause.element) == ("velocity-term", "inner")
    assert cause.size == pytest.approx(0.0, abs=1e-9)
    assert audit.attribution is not None
    # The trapezoid of the power is off by h²/12 of its curvature, 1e-6 of it.
    assert audit.attribution.equations.energy == pytest.approx(work, rel=1e-5)


def wrist(centre: str) -> str:
    """Three bodies that turn about axes through one point; the middle one has its mass centre elsewhere."""
    centres, axes = ("0 0 0", centre, "0 0 0.3"), ("0 0 1", "1 0 0", "0 0 1")
    bodies = "".join(
        f"""<body name="b{k}"><joint name="j{k}" axis="{axes[k]}" damping="0.05"/>
        <inertial pos="{centres[k]}" mass="1.5" fullinertia="0.05 0.03 0.04 0.002 -0.004 0.001"/>"""
        for k in range(3)
    )
    return (
        '<mujoco><option timestep="0.002" integrator="RK4"/>'
        f"<worldbody>{bodies}{'</body>' * 3}</worldbody></mujoco>"
    )


def test_a_mass_centre_of_which_squares_alone_tell_is_found() -> None:
    """Along the axis of a body that turns about its mass centre it only adds to moments of inertia.

    MuJoCo's own RK4 in full precision closes the rows but for rounding, so that all but 1e-6 is told.
    """
    away = np.array([-0.04, 0.03, 0.02])
    model = mujoco.MjModel.from_xml_string(wrist(" ".join(map(str, away))))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = (0.3, 1.0, -0.5), (2.0, -1.0, 3.0)
    rows = list[tuple[float, Array, Array]]()
    for _ in range(500):
        rows.append((data.time, data.qpos.copy(), data.qvel.copy()))
        mujoco.mj_step(model, data)
    t, q, u = map(np.array, zip(*rows, strict=True))
    names = ("j0", "j1", "j2")
    log = dc.Trajectory(t=t, q=q, u=u, coordinates=names, speeds=names)
    audit = dc.audit(mujoco.MjModel.from_xml_string(wrist("0 0 0")), log)
    assert audit.verdict.kind == "equation-error"
    [cause] = audit.causes
    assert (cause.kind, cause.element) == ("body-centre", "b1")
    # Of the number along the axis only the square, so that its sign is not known.
    assert np.abs(cause.values) == pytest.approx(np.abs(away), rel=1e-6)
