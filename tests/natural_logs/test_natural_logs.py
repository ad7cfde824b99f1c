"""Logs as people have them: read as they are, after an unedited draft, or refused with a remedy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import deltac as dc
from deltac.trajectories import draft_mapping, explain, read_trajectory
from deltac.trajectories.columns import RateNames
from tests.natural_logs.cases import AS_IS, CASES, DRAFTED, REFUSED, Case
from tests.natural_logs.models import STARTS

NEEDS = {".mcap": "mcap_ros2", ".bag": "rosbags", "": "rosbags", ".hdf5": "h5py", ".xml": "mujoco"}
DRIVEN = ("pinocchio.npz", "mujoco_policy_50hz.npz")


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.file)
def test_each_is_read_as_the_table_says(case: Case, tmp_path: Path) -> None:
    for suffix in {case.path.suffix, Path(str(case.model)).suffix} & set(NEEDS):
        if suffix or case.path.is_dir():
            pytest.importorskip(NEEDS[suffix], reason="an optional reader is not installed")
    mechanism = dc.load_model(case.model).mechanism  # type: ignore[arg-type]
    mapping = None
    if case.outcome != AS_IS:
        with pytest.raises(dc.InputError) as refused:
            read_trajectory(case.path, None, mechanism)
        assert refused.value.code == (case.code or "E-LOG")
        mapping = tmp_path / "map.toml"
        mapping.write_text(draft_mapping(case.path, mechanism), "utf-8")
    notes = explain(case.path, None, mechanism)  # never fails
    assert any(r.note.startswith("missing") for r in notes) == (case.outcome != AS_IS)
    if case.outcome == REFUSED:
        with pytest.raises(dc.InputError):
            read_trajectory(case.path, mapping, mechanism)
        return
    run = read_trajectory(case.path, mapping, mechanism)
    start = np.array(STARTS[case.machine])
    if case.machine == "walker":
        start[3:7] /= np.linalg.norm(start[3:7])
    assert run.q[0] == pytest.approx(start, abs=1e-6)
    # The motion is the model's: coordinates by their speeds, and the energy of the undriven ones.
    # Semi-implicit Euler, PyBullet's and Drake's, errs by h² a / 2 a row; a stays below 120 rad/s².
    h = np.diff(run.t)[:, None]
    integral = h * (run.u[1:] + run.u[:-1]) / 2
    i, j = np.array(RateNames.of(run.coordinates, run.speeds).rates).T
    assert np.diff(run.q, axis=0)[:, i] == pytest.approx(integral[:, j], abs=60 * h.max() ** 2)
    if case.file not in DRIVEN:
        ledger = dc.balance(mechanism, run)
        assert np.abs(ledger.delta_c["wang"]).max() < 5e-3 * ledger.energy_exchanged


def test_every_log_that_is_kept_is_a_case() -> None:
    kept = {path.name for path in (Path(__file__).parent / "logs").iterdir()}
    assert kept == {case.file for case in CASES}
    outcomes = [case.outcome for case in CASES]
    assert outcomes.count(AS_IS) + outcomes.count(DRAFTED) >= 34
