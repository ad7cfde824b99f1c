"""`deltac audit`: what it prints, and its exit status."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import deltac as dc
from deltac import cli
from tests.support.commands import command

MODEL, HINGE = "double-pendulum", "simple-pendulum"


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Logs of a good, a coarse and a mistaken run, and one in degrees."""
    folder = tmp_path_factory.mktemp("logs")
    p = dc.problems.load(MODEL)
    good = dc.simulate(p.mechanism, p.state, duration=1.0, step=1e-3, solver="ode5", record=())
    good.write(folder / "good.parquet")
    coarse = dc.simulate(p.mechanism, p.state, duration=1.0, step=1e-2, solver="ode1", record=())
    coarse.write(folder / "coarse.csv")
    replace(good, q=np.degrees(good.q)).write(folder / "degrees.parquet")
    hinge = dc.problems.load(HINGE)
    wrong = replace(hinge.mechanism, forces=(dc.forces.joint_damper("oil", "pivot", 0.01),))
    for mechanism, name in ((hinge.mechanism, "swung"), (wrong, "damped")):
        swung = dc.simulate(mechanism, hinge.state, 1.0, step=4e-3, solver="ode8", record=())
        replace(swung, forces={}).write(folder / f"{name}.parquet")
    return folder


run = partial(command, "audit")


@pytest.mark.parametrize(
    ("log", "status", "said"),
    [
        ("good.parquet", 0, "consistent"),
        ("coarse.csv", 1, "integration-error"),
        ("degrees.parquet", 3, "[F-DEGREES]"),
    ],
)
def test_status_and_verdict(
    logs: Path, log: str, status: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    found, out, err = run(MODEL, str(logs / log), capsys=capsys)
    assert (found, err) == (status, ""), out
    assert said in " ".join(out.split())
    assert "gravity" in out  # the table
    assert "Not visible to this test" in out


def test_json_and_figure(logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "audit.png"
    status, out, _ = run(
        HINGE,
        str(logs / "damped.parquet"),
        "--explain",
        "--time-limit",  # its words are those without: test_explain_names_the_causes
        "0.001",
        "--json",
        "--figure",
        str(picture),
        capsys=capsys,
    )
    held = json.loads(out)
    assert held["exit_code"] == status == 1
    (cause,) = held["explanation"]["causes"]
    assert (cause["element"], cause["values"]) == ("pivot", pytest.approx([0.01], rel=1e-6))
    assert {f["code"] for f in held["findings"] if f["weight"] == "cause"} == {"F-MISSING-DAMPER"}
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_the_tolerance_decides(logs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    coarse = str(logs / "coarse.csv")
    assert run(MODEL, coarse, "--tolerance", "0.9", capsys=capsys)[0] == 0


def test_how_the_log_is_read(logs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        cli.main(["audit", MODEL, str(logs / "good.parquet"), "--explain-log", "--json"])
    assert not stop.value.code
    read = {
        entry["column"]: entry["meaning"]
        for entry in json.loads(capsys.readouterr().out)["columns"]
    }
    assert read["time"] == "time"
    assert read["q.joint1"] == "q.joint1"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["no-such-model", "good.parquet"], "E-NAME"),
        ([MODEL, "god.parquet"], "good.parquet"),
        ([MODEL, "god.parquet"], "E-FILE"),
        (["simple-pendulum", "good.parquet"], "joint2"),
        ([MODEL, "good.parquet", "--tolerance", "0"], "E-VALUE"),
        ([MODEL, "good.parquet", "--work", "guess"], "known: in-loop"),
        ([MODEL, "good.parquet", "--figure", "a.gif"], "E-FILE"),
        ([MODEL, "good.parquet", "--figure", "no/folder/a.png"], "E-FILE"),
    ],
)
def test_bad_input_is_status_2(
    logs: Path,
    arguments: list[str],
    said: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(logs)
    status, out, err = run(*arguments, capsys=capsys)
    assert (status, out) == (2, "")
    assert said in err
    assert "Traceback" not in err


@pytest.mark.parametrize(
    ("column", "value"),
    [("u.joint1", 1e160), ("q.joint1", -1e200), ("udot.joint2", 1e300), ("u.joint2", np.nan)],
)
def test_garbage_among_the_numbers_is_bad_input(
    column: str, value: float, logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import polars

    frame = polars.read_parquet(logs / "good.parquet")
    x = frame[column].to_numpy().copy()
    x[7] = value
    frame.with_columns(polars.Series(column, x)).write_parquet(tmp_path / "damaged.parquet")
    status, out, err = run(MODEL, str(tmp_path / "damaged.parquet"), "--json", capsys=capsys)
    told = json.loads(out)
    assert (status, told["exit_code"], told["error"]["code"]) == (2, 2, "E-LOG")
    assert f"'{column}'" in err and "row 7 " in err and told["error"]["message"] in err


@pytest.mark.long
def test_what_the_import_left_to_the_log_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("mujoco", reason="the extra 'mujoco' is not installed")
    from tests.systems.mujoco_models import ARM, arm_run

    (tmp_path / "arm.xml").write_text(ARM)
    arm_run().write(tmp_path / "arm.parquet")
    status, out, _ = run(str(tmp_path / "arm.xml"), str(tmp_path / "arm.parquet"), capsys=capsys)
    told = " ".join(out.split())
    assert status == 0
    assert "2 left to the log, 0 assumed" in told and "Left to the log: m1 (actuator)" in told


@pytest.mark.long
def test_explain_names_the_causes(logs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = str(logs / "damped.parquet")
    status, out, err = run(HINGE, log, "--explain", capsys=capsys)
    assert (status, err) == (1, ""), out
    assert "equation-error" in out
    assert "a viscous damping of 0.01" in " ".join(out.split()).lower()
    assert "missing-damper" in out  # the table


def test_another_value_of_a_number(logs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With another gravity the energy no longer closes: nothing optional is needed to see it."""
    given = HINGE, str(logs / "swung.parquet"), "--time-limit", "0.001", "--set"
    assert run(*given, "g=9.8", capsys=capsys)[0] == 0
    assert run(*given, "g=5", capsys=capsys)[0] == 1
    status, _, told = run(*given, "gg=5", capsys=capsys)
    assert status == 2 and "E-NAME" in told


def test_a_fleet_refuses_a_replay_that_it_would_not_make(
    logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = MODEL, str(logs / "good.parquet"), "--replay", "--out", str(tmp_path / "out"), "--json"
    code, out, _ = command("audit", *given, capsys=capsys)
    assert (code, json.loads(out)["error"]["code"]) == (2, "E-ARGUMENTS")
    assert not (tmp_path / "out").exists()


def test_times_of_too_few_digits(
    logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run_of = dc.read_trajectory(logs / "good.parquet")
    rows = np.column_stack([np.round(run_of.t, 2), run_of.q, run_of.u])
    names = [*(f"q.{n}" for n in run_of.coordinates), *(f"u.{n}" for n in run_of.speeds)]
    path, head = tmp_path / "rounded.csv", ",".join(["t", *names])
    np.savetxt(path, rows, delimiter=",", header=head, comments="", fmt="%.12g")
    status, _, err = run(MODEL, str(path), capsys=capsys)
    assert status == 2 and "--step 0.001" in err
    assert run(MODEL, str(path), "--step", "0.001", capsys=capsys)[0] == 0
    assert run(MODEL, str(path), "--step", "-1", capsys=capsys)[0] == 2
