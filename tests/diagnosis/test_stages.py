"""Forces at the stages of a step: contacts that no row shows. MuJoCo's own solver is the oracle."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import deltac as dc

mujoco = pytest.importorskip("mujoco", reason="the extra 'mujoco' is not installed")

LEG = """
<mujoco>
  <option timestep="0.005" integrator="RK4"/>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 .1"/>
    <body name="trunk" pos="0 0 0.75">
      <joint name="up" type="slide" axis="0 0 1"/>
      <joint name="along" type="slide" axis="1 0 0"/>
      <joint name="tilt" type="hinge" axis="0 1 0"/>
      <geom name="trunk" type="capsule" size="0.06" fromto="0 0 0 0 0 0.25" density="900"/>
      <body name="shank">
        <joint name="knee" type="hinge" axis="0 1 0" range="-60 60" limited="true" damping="0.3"/>
        <geom name="shank" type="capsule" size="0.04" fromto="0 0 0 0.1 0 -0.5" density="900"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
"""A leg that falls, hits the floor and the stop of its knee."""


def fallen(duration: float = 1.5) -> tuple[Any, dc.Trajectory]:
    model = mujoco.MjModel.from_xml_string(LEG)
    return model, dc.run_mujoco(model, duration)


def test_rk4_over_contacts_closes_to_rounding() -> None:
    model, run = fallen()
    assert any(name.kind == "contact" for name in run.forces)
    audit = dc.audit(model, run)
    assert audit.verdict.kind in ("consistent", "integration-error")
    assert audit.integrator is not None
    assert audit.integrator.names == ("rk4",)
    assert audit.attribution is not None
    # ΔC of works at the stages is all of the integrator: no quadrature, no doubt of forces between rows.
    assert audit.attribution.integrator.energy == pytest.approx(audit.energy_error[-1], rel=1e-9)
    assert audit.attribution.integrator.error < 1e-9 * audit.reference_energy


def test_works_of_the_steps_are_not_those_of_the_exact_motion() -> None:
    """What RK4 takes for the work of a damper is off by as much as its states: both are in the bar."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><option timestep="0.01" integrator="RK4"/><worldbody><body>
        <joint name="pin" type="hinge" axis="0 1 0" damping="0.05"/>
        <inertial pos="0 0 -0.5" mass="1.2" diaginertia="0.01 0.02 0.01"/>
        </body></worldbody><actuator><motor name="motor" joint="pin"/></actuator></mujoco>"""
    )
    data, torques = mujoco.MjData(model), list[float]()
    data.qpos[0] = 1.0

    def control(model: Any, data: Any) -> None:
        data.ctrl[0] = 3.0 * np.sin(11.0 * data.time) - 0.5 * data.qvel[0]
        torques.append(float(data.ctrl[0]))

    run = dc.run_mujoco(model, 2.0, data=data, controller=control)
    inertia, weight = 0.02 + 1.2 * 0.5**2, 1.2 * 9.81 * 0.5

    def energy(x: Any) -> float:
        return float(0.5 * inertia * x[1] ** 2 - weight * np.cos(x[0]))

    def flow(x: Any, torque: float, h: float) -> Any:
        def rate(_: float, x: Any) -> list[float]:
            return [x[1], (torque - 0.05 * x[1] - weight * np.sin(x[0])) / inertia]

        return solve_ivp(rate, (0.0, h), x, "DOP853", rtol=1e-13, atol=1e-15).y[:, -1]

    rows = np.column_stack([run.q, run.u])
    true = 0.0
    for a, b, torque in zip(rows, rows[1:], torques, strict=False):
        true += 0.5 * (energy(b) - energy(flow(a, torque, 0.01)))
        true += 0.5 * (energy(flow(b, torque, -0.01)) - energy(a))
    audit = dc.audit(model, run)
    assert audit.integrator is not None and audit.integrator.names == ("rk4",)
    assert audit.attribution is not None
    share = audit.attribution.integrator
    assert abs(share.energy - true) <= 2.0 * share.error < 1e-6


@pytest.mark.long
def test_a_mass_is_found_beside_contacts() -> None:
    model, run = fallen(0.8)
    assert any(name.kind == "contact" for name in run.forces)
    other = copy.copy(model)
    body = model.body("trunk").id
    other.body_mass[body] *= 1.01
    other.body_inertia[body] *= 1.01
    audit = dc.audit(other, run)
    [cause] = audit.causes
    assert (cause.kind, cause.element) == ("body-inertia", "trunk")
    # Rows are exact, and the equations are linear in a mass.
    assert cause.size == pytest.approx(1.0 / 1.01, rel=1e-6)


def test_files_hold_the_stages(tmp_path: Path) -> None:
    _, run = fallen()
    for name in ("log.parquet", "log.csv"):
        dc.write_trajectory(run, tmp_path / name)
        again = dc.read_trajectory(tmp_path / name)
        assert run.stages is not None and again.stages is not None
        assert np.array_equal(again.stages, run.stages)


SERVO = """
<mujoco>
  <option timestep="0.004" integrator="RK4"/>
  <worldbody>
    <body name="arm">
      <joint name="pivot" type="hinge" axis="0 1 0" damping="0.2"/>
      <inertial pos="0 0 -0.4" mass="{mass}" diaginertia="0.02 0.02 0.02"/>
    </body>
  </worldbody>
  <actuator><position name="servo" joint="pivot" kp="60"/></actuator>
</mujoco>
"""
"""Targets change at the rows: within a step the force of the servo does what no spline through rows does."""


def swung(mass: float, duration: float = 3.0) -> dc.Trajectory:
    def target(_: Any, data: Any) -> None:
        data.ctrl[:] = 0.8 * np.sin(9.0 * data.time)

    model = mujoco.MjModel.from_xml_string(SERVO.format(mass=mass))
    return dc.run_mujoco(model, duration, controller=target)


def lacking(run: dc.Trajectory, mass: float, model: float) -> float:
    """What a model of another mass lacks along the exact flow of each step, J (by SciPy)."""
    total, inertia, g = 0.0, {m: 0.02 + m * 0.16 for m in (mass, model)}, 9.81
    for t, (q,), (u,) in zip(run.t[:-1], run.q, run.u):
        c = 0.8 * np.sin(9.0 * t)

        def flow(_: float, x: Any, c: float = c) -> list[float]:
            force = 60.0 * (c - x[0])
            a = (force - 0.2 * x[1] - mass * g * 0.4 * np.sin(x[0])) / inertia[mass]
            left = inertia[model] * a + model * g * 0.4 * np.sin(x[0]) + 0.2 * x[1] - force
            return [x[1], a, left * x[1]]

        end = solve_ivp(flow, (0.0, 0.004), [q, u, 0.0], rtol=1e-10, atol=1e-13).y[:, -1]
        total += float(end[2])
    return total


@pytest.mark.long
def test_a_mistake_beside_a_servo_has_its_joules() -> None:
    run = swung(1.03)
    audit = dc.audit(mujoco.MjModel.from_xml_string(SERVO.format(mass=1.0)), run)
    assert [(c.kind, c.element) for c in audit.causes] == [("body-mass", "arm")]
    assert audit.attribution is not None
    true = lacking(run, 1.03, 1.0)
    # Forces at stages are those of states of second order in the step: ΔC of both together is exact.
    assert audit.attribution.equations.energy == pytest.approx(true, rel=0.01)
    assert audit.attribution.integrator.energy == pytest.approx(
        audit.energy_error[-1] - true, abs=0.01 * abs(true)
    )


@pytest.mark.long
def test_a_servo_of_which_rows_are_left_out_is_in_balance() -> None:
    audit = dc.audit(mujoco.MjModel.from_xml_string(SERVO.format(mass=1.0)), swung(1.0).every(5))
    assert audit.verdict.kind == "consistent"
