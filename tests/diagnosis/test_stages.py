"""Forces at the stages of a step: contacts that no row shows. MuJoCo's own solver is the oracle."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

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
