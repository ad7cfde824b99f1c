"""Sweeps: what bare calls give, whoever does the work, and exactly once whatever happens."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

import deltac as dc
from deltac.errors import FileError, InputError
from deltac.fleets.store import Store
from tests.support.commands import command

M1, Q1 = np.linspace(0.5, 2.0, 10), np.linspace(0.1, 0.5, 10)
PLAN: dict[str, Any] = {
    "name": "pendulums",
    "model": "double-pendulum",
    "duration": 1.0,
    "step": 0.01,
    "vary": {
        "solver": ["ode4", "ode5"],
        "parameter": {"m1": M1.tolist()},
        "q": {"joint1": Q1.tolist()},
    },
}


def compared(frame: pl.DataFrame) -> pl.DataFrame:
    return frame.drop("seconds")


@pytest.fixture(scope="module")
def crew() -> Iterator[ThreadPoolExecutor]:
    """One worker process for most tests of this file."""
    with ThreadPoolExecutor(1) as executor:
        yield executor


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dc.Fleet:
    return dc.sweep(PLAN, tmp_path_factory.mktemp("undisturbed") / "out", workers=1)


def test_rows_are_those_of_the_bare_ensemble(undisturbed: dc.Fleet) -> None:
    frame = undisturbed.frame
    assert len(frame) == 200 and undisturbed.exit_code == 0
    problem = dc.problems.load("double-pendulum")
    m, q = (x.ravel() for x in np.meshgrid(M1, Q1, indexing="ij"))
    Q = np.tile(problem.state.q, (100, 1))
    Q[:, 0] = q
    U = np.tile(problem.state.u, (100, 1))
    for solver in ("ode4", "ode5"):
        bare = dc.simulate_ensemble(problem, (Q, U), 1.0, 0.01, solver, vary={"m1": m}, record=20)
        rows = frame.filter(pl.col("solver") == solver)
        np.testing.assert_array_equal(rows["parameter.m1"], m)
        np.testing.assert_array_equal(rows["q.joint1"], q)
        largest = np.abs(bare.delta_c["wang"]).max(axis=0)
        np.testing.assert_array_equal(rows["energy_error"], largest)
        V = bare.potential
        energy = bare.kinetic.max(axis=0) + np.ptp(V, axis=0)
        np.testing.assert_allclose(rows["relative"], largest / energy, rtol=1e-15)


def test_an_ensemble_tells_its_energies() -> None:
    """K and V by the ledger of one member's own run."""
    problem = dc.problems.load("double-pendulum")
    ensemble = dc.simulate_ensemble(
        problem, [problem.state] * 2, 1.0, 0.01, vary={"m1": [1.0, 2.0]}, record=50
    )
    for k, m1 in enumerate((1.0, 2.0)):
        ledger = dc.balance(problem.mechanism.with_parameters(m1=m1), ensemble.member(k))
        np.testing.assert_allclose(ensemble.kinetic[:, k], ledger.kinetic, rtol=1e-12)
        V = ledger.potential_energy
        np.testing.assert_allclose(ensemble.potential[:, k], V, rtol=1e-12)
    assert not ensemble.corrections.any()


def test_nothing_is_done_twice(
    undisturbed: dc.Fleet, tmp_path: Path, crew: ThreadPoolExecutor
) -> None:
    """The same plan again does nothing; another plan only what is new."""
    folder = tmp_path / "out"
    shutil.copytree(undisturbed.folder, folder)
    before = {p.name: p.stat().st_mtime_ns for p in (folder / "pieces").iterdir()}

    class None_(ThreadPoolExecutor):
        def submit(self, *args: Any, **keywords: Any) -> Any:
            raise AssertionError("nothing is to be done")

    again = dc.sweep(PLAN, folder, executor=None_(1))
    assert again.verdicts == undisturbed.verdicts
    assert {p.name: p.stat().st_mtime_ns for p in (folder / "pieces").iterdir()} == before
    assert compared(again.frame).equals(compared(undisturbed.frame))
    longer = {**PLAN, "vary": {**PLAN["vary"], "parameter": {"m1": [*M1.tolist(), 3.0]}}}
    told: list[float] = []
    found = dc.sweep(longer, folder, executor=crew, progress=told.append)
    assert len(found.frame) == 220 and told[0] == pytest.approx(200 / 220) and told[-1] == 1.0
    assert found.frame["address"].n_unique() == 220
    assert dc.sweep(PLAN, folder).frame["address"].equals(undisturbed.frame["address"])


def test_a_sweep_killed_before_its_table_was_written(
    undisturbed: dc.Fleet, tmp_path: Path, crew: ThreadPoolExecutor
) -> None:
    """All rows are there, in pieces: the table is in the plan's order, without those of other plans."""
    folder = tmp_path / "out"
    longer = {**PLAN, "vary": {**PLAN["vary"], "parameter": {"m1": [*M1.tolist(), 3.0]}}}
    dc.sweep(longer, folder, executor=crew)
    dc.sweep(PLAN, folder, executor=crew)
    (folder / "results.parquet").unlink()
    found = dc.fleet_status(folder)
    assert found.done == found.total == 200 and found.others == 20
    assert compared(found.frame).equals(compared(undisturbed.frame))


def test_what_other_versions_made_is_made_again_and_said(
    undisturbed: dc.Fleet,
    tmp_path: Path,
    crew: ThreadPoolExecutor,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from deltac.fleets import store, sweep
    from deltac.fleets.fleet import RecomputedWarning

    folder = tmp_path / "out"
    shutil.copytree(undisturbed.folder, folder)
    other = {**store.versions(), "numpy": "99.0"}
    for module in (store, sweep):
        monkeypatch.setattr(module, "versions", lambda: other)
    with pytest.warns(RecomputedWarning, match=r"200 rows .*numpy .* → 99"):
        again = dc.sweep(PLAN, folder, executor=crew)
    assert (again.done, again.others) == (200, 200)
    assert dc.fleet_status(folder).others == 200
    assert compared(again.frame).drop("address").equals(compared(undisturbed.frame).drop("address"))


def test_tolerances_are_an_axis(tmp_path: Path, crew: ThreadPoolExecutor) -> None:
    found = dc.sweep(
        "simple-pendulum",
        tmp_path / "out",
        vary={"solver": ["DOP853", "ode4"], "solver_tolerance": [1e-4, 1e-10], "step": [0.05]},
        duration=1.0,
        executor=crew,
    )
    frame = found.frame
    assert frame["solver_tolerance"].to_list() == [1e-4, 1e-10, None]
    coarse, fine, _ = frame["energy_error"]
    problem = dc.problems.load("simple-pendulum")
    alone = dc.simulate(problem, duration=1.0, solver=dc.solvers.Scipy("DOP853", 1e-4))
    left = np.abs(dc.balance(problem, alone).uncorrected("wang")).max()
    assert coarse == pytest.approx(left) and coarse > 100.0 * fine
    found.report(tmp_path / "page.html")


def test_any_executor_and_any_chunk_give_the_same(
    undisturbed: dc.Fleet, tmp_path: Path, crew: ThreadPoolExecutor
) -> None:
    found = dc.sweep(PLAN, tmp_path / "out", executor=crew, chunk=37)
    assert len(Store.open(tmp_path / "out").pieces()) == 6
    assert compared(found.frame).equals(compared(undisturbed.frame))


def test_members_that_cannot_be_run_are_accounted_for(
    tmp_path: Path, crew: ThreadPoolExecutor
) -> None:
    """A negative mass is refused, a step beyond stability blows up; the others are as they are."""
    found = dc.sweep(
        "double-pendulum",
        tmp_path / "out",
        vary={"parameter.m1": [1.0, -1.0, 2.0], "solver": ["ode1", "ode5"]},
        step=0.25,
        duration=50.0,
        executor=crew,
    )
    frame = found.frame
    assert len(frame) == 6 and found.verdicts["failed"] == 2 and found.exit_code == 2
    failed = frame.filter(pl.col("verdict") == "failed")
    assert failed["parameter.m1"].to_list() == [-1.0, -1.0]
    assert all(code.startswith("E-") for code in failed["code"])
    lost = frame.filter(pl.col("stopped").is_not_null())
    assert set(lost["solver"]) <= {"ode1", "ode5"} and len(lost) >= 2
    assert set(lost["verdict"]) == {"integration-error"}


def test_solvers_and_mechanisms_that_ensembles_lack(
    tmp_path: Path, crew: ThreadPoolExecutor
) -> None:
    """By single runs: the same outcome as `simulate` and `balance`."""
    found = dc.sweep(
        "bouncing-ball",
        tmp_path / "out",
        vary={"q.height": [0.5, 1.0]},
        duration=0.3,
        executor=crew,
    )
    problem = dc.problems.load("bouncing-ball")
    for row in found.frame.iter_rows(named=True):
        state = problem.mechanism.state({"height": row["q.height"]})
        run = dc.simulate(problem, state, 0.3, row["step"], row["solver"])
        ledger = dc.balance(problem, run)
        assert row["energy_error"] == np.abs(ledger.uncorrected("wang")).max()
        assert row["verdict"] == "consistent"


def test_studies(tmp_path: Path, crew: ThreadPoolExecutor) -> None:
    found = dc.sweep(
        "simple-pendulum",
        tmp_path / "out",
        verb="study",
        vary={"q.pivot": [0.5]} if "pivot" in names("simple-pendulum") else {},
        step=0.01,
        duration=1.0,
        solver="ode4",
        executor=crew,
    )
    (row,) = found.frame.iter_rows(named=True)
    assert row["verdict"] == "consistent" and row["order"] == pytest.approx(4.0, abs=0.15)


@pytest.mark.heyoka
def test_studies_by_a_solver_without_a_tolerance_of_its_own(
    tmp_path: Path, crew: ThreadPoolExecutor
) -> None:
    plan = {"model": "simple-pendulum", "verb": "study", "duration": 0.5, "solver": "taylor"}
    (row,) = dc.sweep(plan, tmp_path / "out", executor=crew).frame.iter_rows(named=True)
    assert row["verdict"] == "consistent"


def names(problem: str) -> tuple[str, ...]:
    return dc.problems.load(problem).mechanism.coordinates.names


# --- what may happen to a folder ----------------------------------------------------------------


def test_folders_of_others(undisturbed: dc.Fleet, tmp_path: Path) -> None:
    folder = undisturbed.folder
    with pytest.raises(InputError, match="pendulums"):
        dc.sweep({**PLAN, "name": "another"}, folder)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("x")
    with pytest.raises(InputError, match="--out"):
        dc.sweep(PLAN, tmp_path / "mine")
    with pytest.raises(FileError):
        dc.fleet_status(tmp_path / "mine")
    later = tmp_path / "later"
    shutil.copytree(folder, later)
    head = json.loads((later / "fleet.json").read_text())
    (later / "fleet.json").write_text(json.dumps({**head, "format": 99}))
    with pytest.raises(FileError, match="format is 99"):
        dc.sweep(PLAN, later)


def test_a_folder_has_one_writer(undisturbed: dc.Fleet) -> None:
    pytest.importorskip("fcntl")
    with (
        Store.open(undisturbed.folder).locked(),
        pytest.raises(InputError, match="another process"),
    ):
        dc.sweep(PLAN, undisturbed.folder)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write all")
def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(FileError, match="--out"):
            dc.sweep(PLAN, tmp_path / "out")
    finally:
        tmp_path.chmod(0o700)


def test_a_damaged_piece_is_made_again(
    undisturbed: dc.Fleet, tmp_path: Path, crew: ThreadPoolExecutor
) -> None:
    folder = tmp_path / "out"
    shutil.copytree(undisturbed.folder, folder)
    piece = next((folder / "pieces").glob("*.parquet"))
    piece.write_bytes(piece.read_bytes()[:-20])
    found = dc.sweep(PLAN, folder, executor=crew)
    assert compared(found.frame).equals(compared(undisturbed.frame))


# --- the command line -----------------------------------------------------------------------------

TOML = """\
name = "pendulums"
model = "double-pendulum"
duration = 1.0
step = 0.01
[vary]
solver = ["ode4", "ode5"]
parameter.m1 = {m1}
q.joint1 = {q1}
"""


def written(folder: Path) -> Path:
    path = folder / "pendulums.toml"
    path.write_text(TOML.format(m1=M1.tolist(), q1=Q1.tolist()))
    return path


def test_the_command(
    undisturbed: dc.Fleet, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan, folder = written(tmp_path), tmp_path / "out"
    shutil.copytree(undisturbed.folder, folder)
    code, out, _ = command("sweep", str(plan), "--out", str(folder), "--json", capsys=capsys)
    told = json.loads(out)
    assert code == 0 and told["verdicts"] == {"consistent": 200} and told["done"] == 200
    code, out, _ = command("sweep", "--status", str(folder), capsys=capsys)
    assert code == 0 and "200" in out
    code, out, _ = command(
        "sweep", str(plan), "--out", str(folder), "--format", "junit", capsys=capsys
    )
    assert code == 0 and out.count("<testcase") == 2
    address = undisturbed.frame["address"][7]
    code, out, _ = command("sweep", str(plan), "--only", address, capsys=capsys)
    row = undisturbed.frame.row(7, named=True)
    assert json.loads(out)["energy_error"] == row["energy_error"]
    assert command("sweep", capsys=capsys)[0] == command("sweep", "x.csv", capsys=capsys)[0] == 2


@pytest.mark.parametrize(("step", "duration"), [(0.01, 20.0), (0.01, 9.97)])
def test_a_motion_that_turns_where_it_is_looked_at(step: float, duration: float) -> None:
    """Its period divides the times of the records (2000 steps), or there is but one of these (997 steps)."""
    from deltac.fleets.sweep import plan_sweep

    point = {"m1": 0.765886287625418, "q": 0.5123745819397993}
    plan = plan_sweep(
        "double-pendulum",
        vary={"parameter.m1": [point["m1"], 1.0], "q.joint1": [point["q"]]},
        solver="ode4",
        step=step,
        duration=duration,
        tolerance=1e-4,
    )
    piece = plan.piece([0, 1])
    frame = piece.table(piece())
    problem = dc.problems.load("double-pendulum")
    mechanism = problem.mechanism.with_parameters(m1=point["m1"])
    q = problem.state.q.copy()
    q[0] = point["q"]
    ledger = dc.balance(
        mechanism, dc.simulate(mechanism, mechanism.state(q), duration, step, "ode4")
    )
    energy = float(ledger.kinetic.max() + np.ptp(ledger.potential_energy))
    assert frame["verdict"].to_list() == ["consistent"] * 2
    assert 0.5 * energy < frame["energy"][0] <= energy * (1.0 + 1e-9)
