"""Many logs, and logs of many episodes: every one accounted for, by the verdict of its own audit."""

from __future__ import annotations

import json
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import deltac as dc
from deltac.errors import FileError, InputError
from deltac.fleets.audits import find_logs
from deltac.fleets.result import fleet_status
from deltac.kernels.rows import compiled_rows
from tests.support.commands import command

NAME = "double-pendulum"


def runs(count: int, solver: str = "ode5", step: float = 0.01) -> list[dc.Trajectory]:
    """Motions as another program would log them: no integrals, no works, no provenance."""
    problem = dc.problems.load(NAME)
    made = []
    for k in range(count):
        state = problem.mechanism.state([0.2 + 0.1 * k, 0.1])
        run = dc.simulate(problem, state, 1.0, step, solver)
        made.append(
            replace(run, udot=None, integrals={}, works={}, provenance=dc.Provenance("another"))
        )
    return made


@pytest.fixture(scope="module")
def crew() -> Iterator[ThreadPoolExecutor]:
    """One worker process for all tests of this file."""
    with ThreadPoolExecutor(1) as executor:
        yield executor


@pytest.fixture(scope="module")
def motions() -> list[dc.Trajectory]:
    return runs(4)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, motions: list[dc.Trajectory]) -> Path:
    """Good logs, one of coarse steps, one cut off, one of another model, one that is no log."""
    logs = tmp_path_factory.mktemp("logs")
    for k, run in enumerate(motions):
        run.write(logs / f"good{k}.parquet")
    runs(1, "ode1", 0.02)[0].write(logs / "coarse.parquet")
    whole = (logs / "good0.parquet").read_bytes()
    (logs / "cut.parquet").write_bytes(whole[: len(whole) // 2])
    (logs / "none.csv").write_bytes(b"\x00\x01\x02" * 100)
    other = dc.problems.load("simple-pendulum")
    dc.simulate(other, duration=0.1, step=0.01).write(logs / "other.csv")
    (logs / "notes.md").write_text("no log")
    return logs


@pytest.fixture(scope="module")
def fleet(
    folder: Path, tmp_path_factory: pytest.TempPathFactory, crew: ThreadPoolExecutor
) -> dc.Fleet:
    return dc.audit_many(NAME, folder, tmp_path_factory.mktemp("out") / "out", executor=crew)


def test_every_log_is_accounted_for(fleet: dc.Fleet, folder: Path) -> None:
    frame = fleet.frame
    assert sorted(Path(p).name for p in frame["log"]) == sorted(
        p.name for p in folder.iterdir() if p.suffix != ".md"
    )
    verdict = {Path(row["log"]).stem: row["verdict"] for row in frame.iter_rows(named=True)}
    assert {name for name, kind in verdict.items() if kind == "failed"} == {"cut", "none", "other"}
    assert verdict["coarse"] == "integration-error"
    assert fleet.exit_code == 2 and fleet.aside == 0
    failed = frame.filter(pl.col("verdict") == "failed")
    assert all(code.startswith("E-") for code in failed["code"])
    assert failed["message"].null_count() == 0


@pytest.mark.long
def test_verdicts_are_those_of_single_audits(fleet: dc.Fleet) -> None:
    for row in fleet.frame.filter(pl.col("verdict") != "failed").iter_rows(named=True):
        alone = dc.audit(NAME, row["log"])
        assert (row["verdict"], row["exit_code"]) == (alone.verdict.kind, alone.exit_code)
        assert row["relative"] == alone.relative
        assert (row["findings"] or "").split() == [f.code for f in alone.findings]


def test_only_changed_logs_are_audited_again(
    folder: Path, tmp_path: Path, crew: ThreadPoolExecutor
) -> None:
    logs, out = tmp_path / "logs", tmp_path / "out"
    logs.mkdir()
    for k in range(2):
        (logs / f"{k}.parquet").write_bytes((folder / f"good{k}.parquet").read_bytes())
    first = dc.audit_many(NAME, f"{logs}/*.parquet", out, executor=crew).frame
    (logs / "1.parquet").write_bytes((folder / "coarse.parquet").read_bytes())
    (logs / "2.parquet").write_bytes((folder / "good2.parquet").read_bytes())
    told: list[float] = []
    second = dc.audit_many(
        NAME, f"{logs}/*.parquet", out, executor=crew, progress=told.append
    ).frame
    assert told[0] == pytest.approx(1 / 3)
    assert second["verdict"].to_list() == ["consistent", "integration-error", "consistent"]
    assert second["address"][0] == first["address"][0]


def test_the_command(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pattern, out = f"{folder}/good[01].parquet", str(tmp_path / "out")
    options = ("--out", out, "--workers", "1")
    code, said, _ = command("audit", NAME, pattern, *options, "--format", "junit", capsys=capsys)
    assert code == 0 and said.count("<testcase") == 2
    code, said, _ = command("audit", NAME, pattern, *options, "--json", capsys=capsys)
    assert code == 0 and json.loads(said)["verdicts"] == {"consistent": 2}
    code, _, said = command("audit", NAME, f"{folder}/*.xyz", *options, capsys=capsys)
    assert code == 2 and "matches" in said
    code, said, _ = command("audit", "--status", out, capsys=capsys)
    assert code == 0 and "2 audits" in said


def test_urls(folder: Path, tmp_path: Path, crew: ThreadPoolExecutor) -> None:
    fsspec = pytest.importorskip("fsspec")
    memory = fsspec.filesystem("memory")
    memory.pipe("/fleet/good0.parquet", (folder / "good0.parquet").read_bytes())
    assert find_logs("memory://fleet/*.parquet")[0] == ["memory:///fleet/good0.parquet"]
    with pytest.raises(FileError):
        find_logs("memory://fleet/*.csv")
    with pytest.raises(InputError):
        find_logs("nowhere://fleet/x.parquet")
    # A store that workers reach as well.
    url = f"file://{folder}/good0.parquet"
    found = dc.audit_many(
        NAME, [url, f"file://{folder}/gone.parquet"], tmp_path / "o", executor=crew
    )
    assert found.frame["verdict"].to_list() == ["consistent", "failed"]
    assert found.frame["code"].to_list() == [None, "E-FILE"]


# --- batched logs --------------------------------------------------------------------------------


def batched(folder: Path, motions: list[dc.Trajectory], layout: str) -> Path:
    path = folder / f"batch.{layout}"
    if layout in ("parquet", "csv"):
        frame = pl.concat(
            run.to_frame().with_columns(pl.lit(k).alias("episode")) for k, run in enumerate(motions)
        )
        frame.write_parquet(path) if layout == "parquet" else frame.write_csv(path)
        return path
    arrays = {
        "t": motions[0].t,
        "qpos": np.stack([run.q for run in motions], axis=1),
        "qvel": np.stack([run.u for run in motions], axis=1),
    }
    if layout == "npz":
        np.savez(path, **arrays)  # type: ignore[arg-type]
    else:
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w") as file:
            for name, values in arrays.items():
                file[name] = values
    return path


@pytest.mark.parametrize("layout", ["parquet", "csv", "npz", "h5"])
def test_episodes_are_the_motions(
    layout: str, motions: list[dc.Trajectory], tmp_path: Path
) -> None:
    from deltac.fleets.episodes import episode_names, read_episode

    path = batched(tmp_path, motions, layout)
    names = episode_names(str(path))
    assert names is not None and [float(name) for name in names] == [0.0, 1.0, 2.0, 3.0]
    for name, run in zip(names, motions):
        read = read_episode(str(path), name, None, dc.load_model(NAME))
        np.testing.assert_array_equal(read.q, run.q)
        np.testing.assert_array_equal(read.u, run.u)
        np.testing.assert_array_equal(read.t, run.t)
    with pytest.raises(InputError):
        read_episode(str(path), "17", None, dc.load_model(NAME))


@pytest.mark.long
def test_a_verdict_for_each_episode(
    motions: list[dc.Trajectory],
    tmp_path: Path,
    crew: ThreadPoolExecutor,
    capsys: pytest.CaptureFixture[str],
) -> None:
    coarse = runs(1, "ode1", 0.01)[0]
    path = batched(tmp_path, [*motions, coarse], "npz")
    found = dc.audit_many(NAME, path, tmp_path / "out", executor=crew)
    kinds = found.frame["verdict"].to_list()
    assert kinds == ["consistent"] * 4 + ["integration-error"]
    assert found.exit_code == 1 and len(found.groups()) == 5
    code, said, _ = command("audit", NAME, str(path), "--episode", "4", "--json", capsys=capsys)
    assert code == 1 and json.loads(said)["verdict"] == "integration-error"
    # To the last bit: a single audit with the same compiled equations.
    for row, run in zip(found.frame.iter_rows(named=True), [*motions, coarse]):
        columns = {name: getattr(run, name) for name in ("t", "q", "u", "coordinates", "speeds")}
        with compiled_rows():
            alone = dc.audit(NAME, dc.Trajectory(**columns))
        told = (row["verdict"], row["confidence"], row["relative"], row["energy"], row["message"])
        verdict = alone.verdict
        same = (
            verdict.kind,
            verdict.confidence,
            alone.relative,
            alone.reference_energy,
            alone.summary(),
        )
        assert told == same
        assert row["details"] == (alone.explain() if alone.exit_code else None)


def test_arrays_that_are_no_episodes_say_why(motions: list[dc.Trajectory], tmp_path: Path) -> None:
    """Episodes first, or numbers of episodes that differ: one row, with the reason."""
    from deltac.fleets.audits import plan_audits, verdicts

    q, u = (np.stack([getattr(run, name) for run in motions], axis=1) for name in ("q", "u"))
    turned = {"qpos": q.transpose(1, 0, 2), "qvel": u.transpose(1, 0, 2)}
    cases = {"time first": turned, "numbers N": {"qpos": q, "qvel": u[:, :3]}}
    for words, arrays in cases.items():
        path = tmp_path / "log.npz"
        np.savez(path, t=motions[0].t, **arrays)  # type: ignore[arg-type]
        plan = plan_audits(NAME, path)
        assert [log.episode for log in plan.logs] == [None]
        (row,) = verdicts(plan.task, str(path), [None])
        assert row["verdict"] == "failed" and words in row["message"]


def test_what_lies_in_a_folder_and_is_no_log(
    folder: Path, tmp_path: Path, crew: ThreadPoolExecutor
) -> None:
    """By its suffix, or since it holds no table; a file that is named, or matches a pattern, is a log."""
    logs = tmp_path / "logs"
    (logs / "older").mkdir(parents=True)
    (logs / "good.parquet").write_bytes((folder / "good0.parquet").read_bytes())
    (logs / "README.txt").write_text("Runs of the arm.\n\nStarted at 12:00, 3 of them.\n")
    (logs / "config.json").write_text('{"step": 0.01, "gravity": [0, 0, -9.81]}')
    (logs / "notes.md").write_text("1 2 3")
    (logs / ".hidden.csv").write_text("")
    (logs / "table.txt").write_text("time q u\n0 1 2\n1 2 3\n2 3 4\n")
    (logs / "broken.csv").write_text("Runs")
    found = dc.audit_many(NAME, logs, tmp_path / "out", executor=crew)
    names = [Path(name).name for name in found.frame["log"]]
    assert names == ["broken.csv", "good.parquet", "table.txt"]
    skipped = [f"{logs}/{name}" for name in ("README.txt", "config.json", "notes.md", "older/")]
    assert list(found.skipped) == list(fleet_status(tmp_path / "out").skipped) == skipped
    assert find_logs(f"{logs}/*.txt") == ([f"{logs}/README.txt", f"{logs}/table.txt"], [])
    with pytest.raises(FileError, match="README"):
        (logs / "alone").mkdir()
        (logs / "alone" / "README.txt").write_text("Nothing.")
        find_logs(logs / "alone")
