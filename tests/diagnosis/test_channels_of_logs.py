"""Forces of a log that the model has a law for, or its file, or neither: a bob that slides along its rod."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest

import deltac as dc
from deltac.arrays import Array
from tests.diagnosis.test_pendulum_logs import rk4

G, MASS, REST, SPRING, DAMPING, STEP, ROWS = 9.81, 0.7, 0.6, 60.0, 0.08, 0.005, 1001


def pendulum(damping: float = DAMPING) -> dc.Mechanism:
    """A point that slides along a rod on a spring: its mass centre is its origin."""
    return dc.Mechanism(
        [dc.bodies.frame("rod"), dc.point_mass("bob", MASS)],
        [
            dc.revolute("swing", "ground", "rod", axis="y"),
            dc.prismatic("slide", "rod", "bob", "z", stiffness=SPRING, damping=damping, rest=-REST),
        ],
        gravity=(0, 0, -G),
    )


def rates(q: Array, u: Array, torque: float = 0.0) -> Array:
    (angle, z), (turn, speed) = q, u
    out = -SPRING * (z + REST) - DAMPING * speed
    return np.array(
        [
            (torque / MASS - 2.0 * z * speed * turn + G * z * np.sin(angle)) / z**2,
            out / MASS + z * turn**2 - G * np.cos(angle),
        ]
    )


def log(semi_implicit: bool = False, torque: float = 0.0) -> dict[str, Array]:
    t, rows = STEP * np.arange(ROWS), []
    q, u = np.array([0.7, -REST - 0.1]), np.zeros(2)
    for now in t.tolist():
        rows.append([*q, *u])
        if semi_implicit:
            u = u + STEP * rates(q, u)
            q = q + STEP * u
        else:
            q, u = rk4(partial(rates, torque=torque * np.sin(7.0 * now)), q, u, STEP)
    x = np.array(rows)
    names = ("q.swing", "q.slide", "u.swing", "u.slide")
    return {"time": t, **dict(zip(names, x.T, strict=True))}


def test_a_logged_damper_of_another_strength_is_told() -> None:
    """Less than a thousandth of what is exchanged, and more than a thousandth of what the system has."""
    rows = log()
    rows["force.damper slide.slide"] = -DAMPING * rows["u.slide"]
    audit = dc.audit(pendulum(0.95 * DAMPING), rows)
    missing = 0.05 * DAMPING * np.trapezoid(rows["u.slide"] ** 2, dx=STEP)
    tolerance = audit.tolerance
    assert tolerance * audit.reference_energy < missing < tolerance * audit.energy_exchanged
    assert audit.verdict.kind == "equation-error"
    [told] = [f for f in audit.findings if f.code == "F-CHANNEL-DIFFERS"]
    assert told.factor == pytest.approx(1.0 / 0.95, rel=1e-9)
    # What moves less than is allowed is told as well.
    less = dc.audit(pendulum(0.99 * DAMPING), rows)
    assert less.verdict.kind == "consistent"
    assert [f.weight for f in less.findings if f.code == "F-CHANNEL-DIFFERS"] == ["note"]
    same = dc.audit(pendulum(), rows)
    assert same.verdict.kind == "consistent" and not same.findings


def test_a_logged_force_where_nothing_moves() -> None:
    """No energy is exchanged, of which a difference were a share."""
    angle, still = 0.0, -REST - MASS * G / SPRING
    t = STEP * np.arange(100)
    rows = {"time": t, "q.swing": 0 * t + angle, "q.slide": 0 * t + still}
    rows |= {"u.swing": 0 * t, "u.slide": 0 * t, "force.damper slide.slide": 0 * t}
    audit = dc.audit(pendulum(), rows)
    assert audit.verdict.kind == "unresolved" and audit.energy_exchanged == 0.0


def test_a_logged_force_that_is_the_models_own_is_so_between_rows() -> None:
    """The log does not say its step: by splines through its rows no method of a step makes them."""
    rows = log(semi_implicit=True)
    plain = dc.audit(pendulum(), rows)
    rows["force.spring slide.slide"] = -SPRING * (rows["q.slide"] + REST)
    audit = dc.audit(pendulum(), rows)
    assert audit.verdict.kind == plain.verdict.kind == "integration-error"
    assert audit.attribution is not None and plain.attribution is not None
    expected = plain.attribution.integrator.energy
    assert audit.attribution.integrator.energy == pytest.approx(expected, rel=1e-6)


def test_a_force_that_neither_has_is_of_the_equations() -> None:
    """Of a body whose mass centre is its origin, no size says how far that may be off."""
    rows = log(torque=0.6)
    audit = dc.audit(pendulum(), rows)
    assert audit.verdict.kind == "equation-error", audit.explain()
    # It is held over each step.
    torque = 0.6 * np.sin(7.0 * rows["time"][:-1])
    work = float(np.sum(torque * np.diff(rows["q.swing"])))
    assert audit.attribution is not None
    assert audit.attribution.equations.energy == pytest.approx(work, rel=1e-2)


ARM = """<mujoco><option timestep="0.002" integrator="RK4"/><worldbody>
 <body><joint name="hip" axis="0 1 0" damping=".1" frictionloss="{friction}"/>
  <inertial pos="0 0 -.3" mass="2" diaginertia=".03 .03 .01"/>
  <body pos="0 0 -.6"><joint name="knee" axis="0 1 0" damping=".1"/>
   <inertial pos="0 0 -.25" mass="1" diaginertia=".02 .02 .008"/></body></body></worldbody>
 <actuator><motor name="A" joint="hip"/></actuator></mujoco>"""


def test_friction_of_the_models_file_that_the_log_lacks_accuses_nobody(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(ARM.format(friction=0.15))
    data = mujoco.MjData(model)
    data.qpos[:] = 0.7, -0.3
    rows: list[list[float]] = []
    for _ in range(800):
        data.ctrl[0] = 3.0 * np.sin(6.0 * data.time)
        rows.append([data.time, *data.qpos, *data.qvel, data.ctrl[0]])
        mujoco.mj_step(model, data)
    names = ("time", "q.hip", "q.knee", "u.hip", "u.knee", "force.actuator A.hip")
    table = dict(zip(names, np.array(rows).T, strict=True))
    for name, friction, verdict in (("own", 0.15, "unresolved"), ("none", 0.0, "equation-error")):
        path = tmp_path / f"{name}.xml"
        path.write_text(ARM.format(friction=friction), "utf-8")
        audit = dc.audit(str(path), table)
        assert audit.verdict.kind == verdict, audit.explain()
        assert [c.element for c in audit.causes if c.kind == "missing-friction"] == ["hip"]
