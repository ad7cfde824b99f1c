"""A balance in chunks is the balance of the whole."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import deltac as dc
from deltac.energy.accumulator import OVERLAP, balance_chunks
from deltac.trajectories import scan_trajectory


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> tuple[dc.Mechanism, dc.Trajectory, Path]:
    problem = dc.problems.load("triple-pendulum", damping=0.02)
    run = dc.simulate(
        problem.mechanism, problem.state, duration=2.0, step=1e-3, solver="ode1", record=("wang",)
    )
    path = tmp_path_factory.mktemp("logs") / "run.parquet"
    run.write(path)
    return problem.mechanism, run, path


@pytest.mark.parametrize("work", ["in-loop", "samples", "discrete"])
@pytest.mark.parametrize("rows", [400, 404])
def test_the_same_answer(
    log: tuple[dc.Mechanism, dc.Trajectory, Path], work: str, rows: int
) -> None:
    mechanism, run, path = log
    whole = dc.balance(mechanism, run, work, ("wang",))
    chunks = scan_trajectory(path, rows, OVERLAP)
    parts, kept = balance_chunks(mechanism, chunks, work, ("wang",))
    np.testing.assert_array_equal(parts.t, run.t)  # fewer rows than are kept: all of them
    np.testing.assert_array_equal(kept.q, run.q)
    scale = whole.energy_exchanged
    np.testing.assert_allclose(parts.delta_c["wang"], whole.delta_c["wang"], atol=1e-12 * scale)
    for name, values in whole.work.items():
        np.testing.assert_allclose(parts.work[name], values, atol=1e-12 * scale)
    # What works may be off is not counted, and bars add up over chunks.
    bars = sum(bar[-1] for bar in parts.work_error.values())
    assert parts.energy_exchanged == pytest.approx(scale, rel=1e-12, abs=bars)
    assert np.all(parts.error_bar["wang"] >= 0.99 * whole.error_bar["wang"] - 1e-12 * scale)


def test_what_is_kept_has_the_largest_error(
    log: tuple[dc.Mechanism, dc.Trajectory, Path],
) -> None:
    mechanism, run, path = log
    whole = dc.balance(mechanism, run, "in-loop")
    parts, kept = balance_chunks(mechanism, scan_trajectory(path, 400, OVERLAP), "in-loop", keep=20)
    assert 20 <= len(kept) <= 30 + 4 * 6  # and in each chunk the extremes of K and V
    assert (kept.t[0], kept.t[-1]) == (run.t[0], run.t[-1])
    assert np.abs(parts.delta_c["wang"]).max() == pytest.approx(
        np.abs(whole.delta_c["wang"]).max(), rel=1e-12
    )


def test_no_chunks() -> None:
    mechanism = dc.problems.load("simple-pendulum").mechanism
    with pytest.raises(dc.InputError, match="no rows"):
        balance_chunks(mechanism, iter(()))


def test_chunks_that_do_not_overlap(log: tuple[dc.Mechanism, dc.Trajectory, Path]) -> None:
    mechanism, _, path = log
    with pytest.raises(dc.InputError, match="overlap=8"):
        balance_chunks(mechanism, scan_trajectory(path, 400, 1), "discrete")
