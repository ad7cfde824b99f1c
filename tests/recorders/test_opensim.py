"""Recording OpenSim: a driven arm with a muscle, a floating base with contact; a planted fault."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import deltac as dc
from deltac.errors import PackageError

pytestmark = pytest.mark.skipif(
    find_spec("opensim") is None, reason="OpenSim (pip install opensim) is not installed"
)


def arm(mass: float = 0.8) -> dc.Mechanism:
    inertia, centre = (0.02, 0.005, 0.02), (0, -0.2, 0)
    return dc.Mechanism(
        bodies=[dc.body("upper", 1.5, inertia, centre), dc.body("fore", mass, inertia, centre)],
        joints=[
            dc.revolute("shoulder", "ground", "upper", "z"),
            dc.revolute("elbow", "upper", "fore", "z", position=(0, -0.4, 0)),
        ],
        forces=[
            dc.forces.joint_torque("lift", "shoulder"),
            dc.forces.joint_spring("ligament", "elbow", 2.0, rest=0.1),
        ],
        gravity=(0, -9.81, 0),
    )


PROBE = dc.Mechanism(
    bodies=[
        dc.body("hull", 2.0, (0.03, 0.04, 0.05), (0.02, 0.01, -0.03)),
        dc.body("boom", 0.5, (0.004, 0.006, 0.007), (0.1, 0, 0.05)),
    ],
    joints=[
        dc.free("base", "hull"),
        dc.revolute("hinge", "hull", "boom", "z", position=(0.1, 0, 0.1)),
    ],
    gravity=(0, -9.81, 0),
)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dc.Trajectory]:
    folder = tmp_path_factory.mktemp("opensim")
    script = Path(__file__).with_name("opensim_runs.py")
    subprocess.run([sys.executable, str(script), str(folder)], check=True, timeout=120)
    return {path.stem: dc.read_trajectory(path) for path in folder.glob("*.parquet")}


def order(model: dc.Mechanism, coarse: dc.Trajectory, fine: dc.Trajectory) -> float:
    errors = [
        float(np.abs(dc.balance(model, run, testing=("wang",)).delta_c["wang"]).max())
        for run in (coarse, fine)
    ]
    return float(np.log2(errors[0] / errors[1]))


def test_a_driven_arm_with_a_muscle(runs: dict[str, dc.Trajectory]) -> None:
    run = runs["arm_0.002"]
    names = {"actuator lift", "actuator biceps", "spring ligament", "limit stop"}
    assert set(run.forces) == names
    assert all(np.abs(f).max() > 0.01 for f in run.forces.values())
    lift = 4.0 * np.sin(5.0 * run.t + 0.3)
    np.testing.assert_allclose(run.forces["actuator lift"][:, 0], lift, atol=1e-12)
    ligament = -2.0 * (run.q[:, 1] - 0.1)
    np.testing.assert_allclose(run.forces["spring ligament"][:, 1], ligament, atol=1e-12)
    assert np.abs(dc.residuals(arm(), run)["coordinates"]).max() < 1e-12
    assert 2.7 < order(arm(), runs["arm_0.004"], run) < 4.5


def test_a_planted_fault_is_named(runs: dict[str, dc.Trajectory]) -> None:
    wrong, run = arm(mass=0.9), runs["arm_0.002"]
    assert dc.audit(wrong, run).verdict.kind == "equation-error"
    assert "fore" in str(dc.explain_residual(wrong, run).causes[0])


def test_a_floating_base_on_a_floor(runs: dict[str, dc.Trajectory]) -> None:
    coarse, run = runs["probe_0.002"], runs["probe_0.001"]
    assert set(run.forces) == {"contact foot"}
    assert np.abs(run.forces["contact foot"]).max() > 20.0
    assert np.abs(dc.residuals(PROBE, run)["coordinates"]).max() < 1e-11
    assert order(PROBE, coarse, run) > 1.5  # friction has corners
    assert dc.audit(PROBE, run).verdict.kind != "equation-error"


def test_beside_casadi_it_cannot_be_loaded() -> None:
    with pytest.raises(PackageError, match="another"):
        dc.record_opensim(None)
